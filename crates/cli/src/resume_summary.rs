//! Summary of what `retrace resume` will do, printed before it does it.
//!
//! Invariant: every statement comes from planning again or from the card; nothing is guessed.

use std::fs::File;
use std::io::{self, BufRead, BufReader, IsTerminal, Read, Write};
use std::path::Path;

use retrace_config::{ChannelNames, MachineConfig, NumberedError};
use retrace_controller::ResumePlan;
use retrace_gcode::Progress;
use retrace_journal::JobRecord;
use retrace_link::channel;
use serde_json::{Value, json};

use crate::escape;
use crate::program::Program;
use crate::program_stream::ProgramStream;

/// Maximum number of blocks after the last mark in which the block of the breakpoint is searched.
const MAX_SEARCHED_BLOCKS: u64 = 100_000;

/// Job that is about to be resumed.
pub struct ResumeSummary<'a, const A: usize> {
    /// Program.
    pub program: &'a Program,
    /// Journal.
    pub record: &'a JobRecord,
    /// Machine.
    pub machine: &'a MachineConfig,
    /// File with the stored part of a streamed program.
    pub spool: &'a Path,
    /// Result of the planning.
    pub prepared: &'a ResumePlan<A>,
    /// Differences of offsets and tool data from those that the job started with, one per line.
    pub differences: Vec<String>,
    /// Differences of the machine file from the job's copy, one per line; `None` where it is unchanged.
    pub machine_changes: Option<Vec<String>>,
    /// Moves that bring the axes to the breakpoint, each by its end in counts.
    pub approach: Vec<[i64; A]>,
    /// Whether the place is the last one in the journal, and not where the card came to rest.
    pub is_older_place: bool,
}

/// Shows the summary and asks for confirmation.
pub type ConfirmResume<'f, const A: usize> = dyn FnMut(&ResumeSummary<'_, A>) -> Result<bool, NumberedError> + 'f;

/// Block at the breakpoint.
#[derive(Default)]
struct Block {
    location: String,
    text: String,
    active: String,
}

impl<const A: usize> ResumeSummary<'_, A> {
    /// Prints the summary.
    pub fn show(&self, json: bool) {
        let block = self.block().unwrap_or_default();
        if json {
            crate::out::line(self.to_json(&block));
            return;
        }
        self.lines_of(&block).iter().for_each(|line| say!("  {line}"));
    }

    /// Lines of the summary.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        self.lines_of(&self.block().unwrap_or_default())
    }

    fn lines_of(&self, block: &Block) -> Vec<String> {
        let mut lines: Vec<String> =
            self.details(block).iter().map(|(name, text)| format!("{name:10} {text}")).collect();
        let changed = |lines: &mut Vec<String>, what: String, changes: &[String]| {
            lines.push(what);
            lines.extend(changes.iter().map(|line| format!("  {line}")));
        };
        if let Some(changes) = &self.machine_changes {
            let path = self.record.job.machine.path.as_deref().unwrap_or_default();
            let what = format!("the machine file {path} has changed since the job started; the job uses its own copy:");
            changed(&mut lines, what, changes);
        }
        if !self.differences.is_empty() {
            let what = "offsets and tool data have changed since the job started; the job uses its own:".to_owned();
            changed(&mut lines, what, &self.differences);
        }
        lines
    }

    fn details(&self, block: &Block) -> Vec<(&'static str, String)> {
        let (prepared, job) = (self.prepared, &self.record.job);
        let place = prepared.start().place;
        let share = place.fraction_of_record();
        let mut words = vec![
            ("job", format!("{}, {}", job.id, escape::name(&job.program))),
            ("at", block.location.clone()),
            ("block", block.text.clone()),
            (
                "place",
                format!(
                    "{:.3} mm into the block (record {:.4})",
                    prepared.into_line_mm(),
                    f64::from(place.record.number()) + share
                ),
            ),
            ("position", self.position_text()),
            ("modes", block.active.clone()),
            ("tool", prepared.expected_outputs()[usize::from(channel::TOOL)].to_string()),
        ];
        let (differing, names) = (self.differing_outputs(), ChannelNames::of_machine(self.machine));
        let restored: Vec<String> = differing
            .iter()
            .map(|&(number, is, to)| {
                let [is, to] = [is, to].map(|value| names.value_text(number, value));
                format!("{} from {is} to {to}", names.name(number))
            })
            .collect();
        if self.is_older_place {
            let text = "the last one in the journal, up to one second of motion before the machine stopped; that \
                motion is repeated";
            words.push(("note", text.into()));
        }
        if !self.approach.is_empty() {
            words.push(("approach", self.approach_text()));
        }
        let entered = self.record.lengths();
        if !entered.is_empty() {
            let by: i64 = entered.iter().map(|change| change.pulses).sum();
            let axis = self.machine.tool_axis().map(|axis| &self.machine.axes[axis]);
            let by_mm = axis.map_or(0.0, |axis| axis.mm_of(by));
            words.push(("new tool", format!("length entered in a pause, {by_mm:+.3} mm; included in the positions")));
        }
        words.push(("switches", if restored.is_empty() { "nothing".into() } else { restored.join(", ") }));
        if let Some(tap) = prepared.tap() {
            let text =
                format!("of line {}: the card holds it in its hole; nothing moves until it is let go on", tap.line);
            words.push(("tap", text));
        }
        if let Some(thread) = prepared.thread() {
            let line = thread.line;
            let text = format!("of line {line}: the card turns the spindle, and the tool goes on in its groove");
            words.push(("thread", text));
        }
        let behind = prepared.start().reached.since(place.boundary_ahead());
        if behind > 0 {
            words.push(("then", format!("forward {behind} records to the furthest place executed, then normal run")));
        }
        words.extend(self.continued_cut().map(|text| ("cut", text)));
        words.push(("history", format!("{:.1} s, {:.3} mm back", self.history_s(), prepared.history_mm())));
        words
    }

    /// How the cut goes on in which the job was interrupted, if it was in one.
    fn continued_cut(&self) -> Option<String> {
        let (expected, record) = (self.prepared.expected_outputs(), self.record);
        let mut cutters = self.machine.cutters.iter().filter(|cutter| cutter.kind.cuts_at_rest());
        let interrupted = record.interrupted_cut().map(|cut| cut.channel);
        let lit = cutters.find(|cutter| expected[usize::from(cutter.fire)] != 0 || interrupted == Some(cutter.fire))?;
        record.certain_cut_end(lit.fire)?;
        let (name, mm) = (&lit.name, lit.run_in_mm());
        Some(if lit.starts_in_motion() {
            format!(
                "goes on: back along the path to {mm} mm before the end of the kerf, where the {name} starts in motion"
            )
        } else {
            format!("goes on: back along the path to {mm} mm before the end of the kerf, where the {name} pierces")
        })
    }

    fn position_text(&self) -> String {
        let there = position(self.machine, &self.prepared.counts());
        if self.prepared.matches_card() {
            return format!("{there}, equal to the card's counts");
        }
        format!("{there}; the machine is at {}", position(self.machine, &self.prepared.card().counts))
    }

    /// Text such as `Z to 5.000, then X to 10.000 Y to 2.000, then Z to -3.000`.
    fn approach_text(&self) -> String {
        let mut from = self.prepared.card().counts;
        let mut moves = Vec::new();
        for to in &self.approach {
            let axes = self.machine.axes.iter().zip(from.iter().zip(to)).filter(|(_, (from, to))| from != to);
            let words = axes
                .map(|(axis, (_, &count))| format!("{} to {:.3}", axis.name.to_ascii_uppercase(), axis.mm_of(count)));
            moves.push(words.collect::<Vec<_>>().join(" "));
            from = *to;
        }
        moves.join(", then ")
    }

    fn to_json(&self, block: &Block) -> Value {
        let prepared = self.prepared;
        let (place, axes) = (prepared.start().place, self.machine.axes.len().min(A));
        let outputs: Vec<Value> = self
            .differing_outputs()
            .iter()
            .map(|(number, is, to)| json!({"channel": number, "actual": is, "expected": to}))
            .collect();
        json!({
            "event": "resume",
            "job": self.record.job.id,
            "program": self.record.job.program,
            "line": prepared.line(),
            "location": block.location,
            "block": block.text,
            "into_line_mm": prepared.into_line_mm(),
            "record": place.record.number(),
            "fraction": place.fraction,
            "reached": prepared.start().reached.number(),
            "executed": prepared.start().executed,
            "counts": prepared.counts()[..axes],
            "card_counts": prepared.card().counts[..axes],
            "at_older_position": self.is_older_place,
            "tool_length_pulses": self.record.lengths().iter().map(|change| change.pulses).sum::<i64>(),
            "return_path": self.approach.iter().map(|end| &end[..axes]).collect::<Vec<_>>(),
            "active": block.active,
            "tool": prepared.expected_outputs()[usize::from(channel::TOOL)],
            "outputs": outputs,
            "history_start": prepared.oldest().number(),
            "history_s": self.history_s(),
            "history_mm": prepared.history_mm(),
            "changed_tables": self.differences,
            "changed_machine": self.machine_changes.as_deref().unwrap_or_default(),
        })
    }

    fn history_s(&self) -> f64 {
        f64::from(self.prepared.start().place.record.since(self.prepared.oldest())) * self.machine.period_s()
    }

    /// Outputs that will be switched: channel, current value, new value.
    fn differing_outputs(&self) -> Vec<(u8, i32, i32)> {
        let (is, to) = (&self.prepared.card().outputs, self.prepared.expected_outputs());
        let each = (0..channel::COUNT).filter(|&n| is[n] != to[n]);
        each.map(|n| (n as u8, is[n], to[n])).collect()
    }

    /// Finds the block by decoding the program again, up to the first block of its line after the last mark before the
    /// breakpoint.
    fn block(&self) -> Option<Block> {
        let place = self.prepared.start().place.record;
        let marks = self.record.marks().ok()?.map_while(Result::ok);
        let last = marks.take_while(|mark| !place.is_before(mark.place)).last();
        let first = last.map_or(0, |mark| mark.block.saturating_sub(1));
        let kept: ProgramStream = match File::open(self.spool) {
            Ok(file) => Box::new(BufReader::new(file).take(self.record.spooled.bytes)),
            Err(_) => Box::new(io::empty()),
        };
        let mut source = self.program.interpret_stream(kept);
        let mut steps = Vec::new();
        for number in 1..=first + MAX_SEARCHED_BLOCKS {
            steps.clear();
            if source.advance(&mut steps) == Progress::End {
                break;
            }
            if number > first && steps.iter().any(|step| step.line == self.prepared.line()) {
                return Some(Block {
                    location: source.location().to_string(),
                    text: source.line_text().trim().to_owned(),
                    active: source.active().to_string(),
                });
            }
        }
        None
    }
}

/// Text of a position: axis by axis, mm.
#[must_use]
pub fn position(machine: &MachineConfig, counts: &[i64]) -> String {
    let axes = machine.axes.iter().zip(counts);
    let each = axes.map(|(axis, &count)| format!("{} {:.3}", axis.name.to_ascii_uppercase(), axis.mm_of(count)));
    each.collect::<Vec<_>>().join(" ")
}

/// Asks on the terminal whether the machine is at this position; no where there is no terminal.
pub fn position_is_confirmed(stands: &str) -> bool {
    io::stdin().is_terminal() && ask_yes_or_no(&format!("the card was restarted: is the machine at {stands}? [y/N] "))
}

/// Asks on the terminal for confirmation.
///
/// # Errors
/// `E2215` where there is no terminal.
pub fn confirm_at_terminal() -> Result<bool, NumberedError> {
    if !io::stdin().is_terminal() {
        let what = "no terminal to confirm at; nothing has moved";
        return Err(NumberedError::new("E2215", what, "check the summary, then repeat the command with --yes"));
    }
    Ok(ask_yes_or_no("resume there? [y/N] "))
}

/// Asks on the terminal; anything but *y* is no.
pub fn ask_yes_or_no(question: &str) -> bool {
    eprint!("{question}");
    let _ = io::stderr().flush();
    let mut answer = String::new();
    let _ = io::stdin().lock().read_line(&mut answer);
    matches!(answer.trim(), "y" | "Y" | "yes")
}
