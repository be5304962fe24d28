//! Runs a job, new or resumed: shows it, records it, monitors it and writes its journal.
//!
//! Invariant: however the job ends, there is a report, the same on the screen and in the journal. A job that is refused
//! before anything moves leaves the journal unchanged.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::time::Instant;

use retrace_config::{MachineConfig, NumberedError};
use retrace_controller::{
    AnyCard, CommandReceiver, CommandSources, Event, EventKind, JobEnd, JobOptions, JobStart, JobStartError,
    JournalRecorder, Observer, Outcome, Report, ResumeError, ResumePlan, RunMode, ScriptInstruction, ScriptPlayer,
    Telemetry, resume_job,
};
use retrace_core::Place;
use retrace_gcode::{Parameters, ToolTable};
use retrace_journal::{ConsumableFile, JournalConfig};
use retrace_link::MotionCard;
use retrace_tui::ModelObserver;
use serde_json::Value;

use crate::command_failure::CommandFailure;
use crate::console::{Console, ConsoleOptions};
use crate::consumable_counter::ConsumableCounter;
use crate::consumables::{set_json, set_text};
use crate::escape;
use crate::files;
use crate::job_script::with_optional_stop;
use crate::journaled_job::JournaledJob;
use crate::machine_tables::TableFiles;
use crate::program::Program;
use crate::program_stream::{ProgramStream, StreamSource};
use crate::reported_state::ReportedState;
use crate::stop_signals::{StopPolicy, StopSignals};
use crate::terminal_operator::{Keyboard, TerminalOperator};
use crate::wait_notice::WaitWatch;

/// Said at the start of a job whose height another controller controls (CUT-49).
const EXTERNAL_HEIGHT: &str = "an external controller controls the height of the torch: while it does, the height is \
    not known here, and every start senses the sheet";

/// Options for output and operation of a job.
#[derive(Debug)]
pub struct OutputOptions<'a> {
    /// Whether to print one JSON object per line.
    pub json: bool,
    /// File for the records.
    pub records: Option<&'a Path>,
    /// Operator's script.
    pub script: Vec<ScriptInstruction>,
    /// Whether an operator is present.
    pub operator: bool,
    /// Whether the card runs in wall time.
    pub wall_time: bool,
    /// Whether M1 stops, where an option says so; otherwise it stops where Enter can be pressed at a terminal.
    pub optional_stop: Option<bool>,
    /// Whether the card is on a serial line, which needs a real-time motion thread.
    pub real_time: bool,
    /// Files of the parameters and tools.
    pub tables: TableFiles,
}

/// Connection of a job to the screen.
pub struct TuiOptions<'r> {
    /// Receiver of the operator's commands.
    pub commands: CommandReceiver,
    /// Observer that updates the screen.
    pub observer: ModelObserver,
    /// Whether the job waits for the operator at the end of its program.
    pub waits_at_end: bool,
    /// Result to show at the end.
    pub result: &'r mut JobResult,
}

/// Result of a job, for a person.
#[derive(Debug, Default)]
pub struct JobResult {
    /// One line, in parts: how it ended, its contours, and its times.
    pub short: [String; 3],
    /// Full report.
    pub text: String,
    /// Parameters and tools at the end of the program; `None` where the program did not complete.
    pub tables: Option<(Parameters, ToolTable)>,
}

/// Confirms a resumed job before anything moves, and writes the confirmation to the job's journal.
pub type ConfirmJob<'f, const A: usize> =
    Box<dyn FnOnce(&ResumePlan<A>, Option<&mut JournaledJob>) -> Result<(), CommandFailure> + 'f>;

/// Job that is ready to run.
pub struct JobRunner<'a> {
    /// Options for output and operation.
    pub options: OutputOptions<'a>,
    /// The machine.
    pub machine: &'a MachineConfig,
    /// The program.
    pub program: &'a Program,
    /// Source of a streamed program.
    pub input: Option<ProgramStream>,
    /// Start of the job.
    pub start: JobStart,
    /// Journal.
    pub journal: Option<JournaledJob>,
    /// Screen that operates it, if any.
    pub at_screen: Option<TuiOptions<'a>>,
}

impl JobRunner<'_> {
    /// Runs the job on a card. Returns its exit code. `agree` confirms a resumed job, before anything moves.
    ///
    /// # Errors
    /// Whatever prevents it from starting, and the error of `agree`.
    pub fn run<const A: usize>(
        self,
        card: &mut AnyCard<'_, A>,
        agree: ConfirmJob<'_, A>,
    ) -> Result<u8, CommandFailure> {
        let Self { options, machine, program, input, start, mut journal, at_screen } = self;
        let (commands, show, result) = match at_screen {
            Some(TuiOptions { commands, observer, waits_at_end, result }) => {
                (Some((commands, waits_at_end)), ConsoleOptions::Screen(Box::new(observer)), Some(result))
            }
            None => (None, ConsoleOptions::choose(options.json, program.lines()), None),
        };
        let console = Console::<A>::new(show, machine, options.records, program.planned_contours())?;
        // In wall time an operator can press Enter: a program stop waits.
        let (terminal, enter) = if commands.is_none() && options.wall_time && !options.operator {
            let stops = options.optional_stop.unwrap_or(true);
            Some(TerminalOperator::new(keyboard(program), stops, journal.is_some()))
        } else {
            None
        }
        .unzip();
        let run_mode = RunMode {
            wall_time: options.wall_time,
            operator: options.operator || commands.is_some() || terminal.is_some(),
            real_time: options.real_time,
        };
        let script = with_optional_stop(options.optional_stop.filter(|_| terminal.is_none()), options.script)?;
        let script = CommandSources::from_script(ScriptPlayer::new(script, machine.period_us));
        // Without a screen, signals stop the job.
        let (signals, stops) = if commands.is_none() { StopSignals::watch(StopPolicy::Job) } else { None }.unzip();
        let command_sources = match commands {
            Some((commands, true)) => script.with_operator(commands).with_release_at_end(),
            Some((commands, false)) => script.with_operator(commands),
            None => match enter {
                Some(enter) => script.with_operator(enter).with_stop_receiver(stops),
                None => script.with_stop_receiver(stops),
            },
        };
        // Where a question comes first, Ctrl-C ends the command until it is confirmed: nothing has moved yet.
        if let (Some(signals), false) = (&signals, matches!(start, JobStart::At(_))) {
            signals.listen();
        }
        let journal_config = journal.as_ref().map_or_else(JournalConfig::default, JournaledJob::journal_config);
        let job_options = JobOptions { start, commands: command_sources, run_mode, journal: journal_config };
        // In virtual time the state would be that of another moment.
        let is_reported = result.is_none() && options.wall_time;
        let reported = is_reported.then(|| ReportedState::of(machine, program.name(), program.lines())).flatten();
        let mut observers = RunObservers {
            console,
            reported,
            recorder: journal.as_ref().map(|journal| journal.recorder(machine)),
            consumables: counter(&options.tables, machine),
            waits: WaitWatch::new(program.source_status()),
            signals: signals.as_ref(),
            terminal: terminal.as_ref(),
            program,
            period_s: machine.period_s(),
            last: None,
        };
        if machine.height_control().is_some_and(|control| control.is_external()) {
            observers.console.print_note(EXTERNAL_HEIGHT);
        }
        let (decoder, last) = program.running(input);
        let (started, mut refused) = (Instant::now(), None);
        let agree = |prepared: &ResumePlan<A>| {
            refused = agree(prepared, journal.as_mut()).err();
            if let (Some(signals), None) = (&signals, &refused) {
                signals.listen();
            }
            refused.is_none()
        };
        let end = resume_job(machine, decoder, job_options, card, &mut observers, agree);
        let event_kind = observers.waits.poll_now();
        observers.report_wait(event_kind);
        if let Some(refused) = refused {
            return Err(refused);
        }
        let JobEnd { outcome, stats, summary, card } = end.map_err(start_error)?;
        let wall_s = started.elapsed().as_secs_f64();
        let RunObservers { console, reported, recorder, consumables, .. } = observers;
        drop(recorder);
        let worn = consumables.map(ConsumableCounter::finish);
        let (limit_report, alarms, line, lost_records) = console.finish();
        let report = Report {
            program: program.name(),
            machine,
            outcome: &outcome,
            line,
            stats: &stats,
            blocks: summary.as_ref().map_or(0, |s| s.blocks),
            canonical: summary.as_ref().map_or(0, |s| s.canonical),
            commanded_mm: summary.as_ref().map_or(&[], |s| &s.commanded_mm),
            card: card.status(),
            limit_report: &limit_report,
            wall_s,
            alarms: &alarms,
        };
        if let Some(reported) = reported {
            reported.end(&summary_parts(&report).concat());
        }
        let mut value = report.to_json();
        value["job"] = journal.as_ref().map_or(Value::Null, |journal| journal.id().into());
        let path = |path: &Option<PathBuf>| path.as_deref().map_or(Value::Null, |path| files::absolute(path).into());
        value["parameter_file"] = path(&options.tables.parameters);
        value["tool_table"] = path(&options.tables.tools);
        let mut worn_lines = String::new();
        match worn {
            Some(Ok(sets)) => {
                value["consumables"] = sets.iter().map(set_json).collect();
                worn_lines = sets.iter().map(|set| format!("\n  {}", set_text(set))).collect();
            }
            Some(Err(unwritable)) => worn_lines = format!("\n  {unwritable}"),
            None => value["consumables"] = Value::Null,
        }
        if result.is_none() {
            print_report(&report, (&options.tables, &worn_lines), options.json.then_some(&value));
        }
        // Standard output itself may be lost: the journal has the report and notes that.
        let lost = lost_records.clone().or_else(crate::out::lost);
        if let Some(lost) = &lost {
            value["output_lost"] = lost.cause.as_str().into();
            if outcome == Outcome::Completed {
                value["exit_code"] = 2.into();
            }
        }
        let messages = journal.map_or_else(Vec::new, |journal| journal.end(&outcome, &value));
        match result {
            Some(result) => {
                let refused =
                    if let Outcome::BlockError(text) = &outcome { format!("{text}\n") } else { String::new() };
                let text = messages
                    .iter()
                    .fold(refused + &report_text(&report, (&options.tables, &worn_lines)), |text, line| {
                        format!("{text}\n{line}")
                    });
                let tables = last.tables().filter(|_| outcome == Outcome::Completed);
                *result = JobResult { short: summary_parts(&report), text, tables };
            }
            None => messages.iter().for_each(|line| eprintln!("{line}")),
        }
        if let (Some((parameters, tools)), Outcome::Completed) = (last.tables(), &outcome) {
            let began = program.setup().start_tables();
            options.tables.write_parameters(&began.parameters, &parameters)?;
            if options.tables.has_own_tools() {
                options.tables.write_tools(&began.tools, &tools)?;
            }
        }
        let code = match (&outcome, lost_records) {
            (outcome, None) => outcome.exit_code(),
            (Outcome::Completed, Some(lost)) => {
                eprintln!("{lost}");
                2
            }
            (outcome, Some(lost)) => {
                eprintln!("{lost}");
                outcome.exit_code()
            }
        };
        Ok(code)
    }
}

/// Counter of the wear of the consumables, where the machine has a file for it.
fn counter(tables: &TableFiles, machine: &MachineConfig) -> Option<ConsumableCounter> {
    ConsumableCounter::new(ConsumableFile::at(tables.consumables.as_deref()?), machine)
}

/// Keyboard for a job of this program.
fn keyboard(program: &Program) -> Keyboard {
    match program.stream_source() {
        Some(StreamSource::StandardInput) => Keyboard::Program,
        _ if std::io::stdin().is_terminal() => Keyboard::Terminal,
        _ => Keyboard::None,
    }
}

/// Locks the memory and schedules this thread in real time, before the card's watchdog starts. Where that is not
/// permitted, it prints once per run how to permit it. Threads that this thread starts later are to leave real-time
/// scheduling.
pub fn prepare_real_time() {
    match retrace_real_time::permitted() {
        Ok(()) => {
            // Memory that cannot be locked is not worth another note.
            let _ = retrace_real_time::lock_memory();
            let _ = retrace_real_time::enter();
        }
        Err(denied) => {
            eprintln!("note: {denied}: the motion thread may be late on a loaded computer\n  {}", crate::doctor::GRANT)
        }
    }
}

fn start_error(why: JobStartError) -> NumberedError {
    match why {
        JobStartError::Machine(why) => NumberedError::new("E2112", why, "a shorter history_hours in the machine file"),
        JobStartError::Resume(why @ ResumeError::InThread { .. }) => NumberedError::new(
            "E2219",
            why.to_string(),
            "take a tap out of its holder, move the tool clear of the work, then begin before the thread: \
             `retrace resume JOB --from-line N`",
        ),
        JobStartError::Resume(why) => NumberedError::new(
            "E2216",
            format!("the breakpoint was not found: {why}"),
            "program and journal do not match; `retrace resume JOB --from-line N` starts at a line",
        ),
    }
}

/// Observer of a run: console, journal, signals and prompts.
struct RunObservers<'m, const A: usize> {
    console: Console<'m, A>,
    reported: Option<ReportedState>,
    recorder: Option<JournalRecorder<A>>,
    consumables: Option<ConsumableCounter>,
    /// Watch on the source of a streamed program.
    waits: WaitWatch,
    signals: Option<&'m StopSignals>,
    terminal: Option<&'m TerminalOperator>,
    program: &'m Program,
    period_s: f64,
    /// Last reported period: its number, place and line.
    last: Option<(u64, Place, u32)>,
}

/// Number of periods between two polls for events of the journal.
const POLL_PERIODS: u64 = 64;

impl<const A: usize> Observer<A> for RunObservers<'_, A> {
    fn on_telemetry(&mut self, telemetry: &Telemetry<A>) {
        self.console.on_telemetry(telemetry);
        if let Some(reported) = &mut self.reported {
            reported.observe(telemetry);
        }
        if let Some(signals) = self.signals {
            signals.observe(telemetry);
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.record(telemetry);
        }
        if let Some(consumables) = &mut self.consumables {
            consumables.observe(telemetry);
        }
        if let (Some(terminal), Telemetry::Event(event)) = (self.terminal, telemetry) {
            let name = |tool| self.program.tool_table().and_then(|table| table.name(tool)).map(str::to_owned);
            if let Some(text) = terminal.observe(event, name) {
                self.console.print_note(&text);
            }
        }
        let Telemetry::Period(period) = telemetry else { return };
        self.last = Some((period.period, period.place, period.line));
        if period.period.is_multiple_of(POLL_PERIODS) {
            while let Some(event_kind) = self.recorder.as_mut().and_then(|recorder| recorder.next_notice()) {
                let event = self.event(event_kind);
                self.console.on_telemetry(&Telemetry::Event(event));
            }
            let event_kind = self.waits.poll();
            self.report_wait(event_kind);
        }
    }

    fn idle(&mut self) {
        let event_kind = self.waits.poll();
        self.report_wait(event_kind);
    }
}

impl<const A: usize> RunObservers<'_, A> {
    /// Event at the last reported period.
    fn event(&self, event_kind: EventKind) -> Event {
        let (period, place, line) = self.last.unwrap_or_default();
        Event { period, time_s: period as f64 * self.period_s, place, line, kind: event_kind }
    }

    /// Reports that a streamed program is awaited, or that it arrives again.
    fn report_wait(&mut self, event_kind: Option<EventKind>) {
        let Some(event_kind) = event_kind else { return };
        let event = Telemetry::Event(self.event(event_kind));
        self.console.on_telemetry(&event);
        if let Some(recorder) = &mut self.recorder {
            recorder.record(&event);
        }
    }
}

/// Prints the report: as JSON for a script, otherwise for a person.
fn print_report<const A: usize>(report: &Report<'_, A>, texts: (&TableFiles, &str), json: Option<&Value>) {
    if let Outcome::BlockError(text) = report.outcome {
        eprintln!("{}", escape::lines(text));
    }
    match json {
        Some(value) => crate::out::line(value),
        None => crate::out::line(report_text(report, texts)),
    }
}

/// Result of a job in one line, in parts: how it ended, its contours, and its times.
fn summary_parts<const A: usize>(report: &Report<'_, A>) -> [String; 3] {
    let Report { outcome, stats, machine, .. } = report;
    let seconds = |periods: u64| periods as f64 * machine.period_s();
    let how = match outcome {
        Outcome::Completed => "completed".to_owned(),
        Outcome::Stopped => "stopped by the operator".to_owned(),
        Outcome::BlockError(_) => "stopped: a block has an error (g)".to_owned(),
        Outcome::Alarm(number, cause, _) => format!("alarm {number}: {cause}"),
    };
    let contours = match (stats.contours, stats.contours_not_cut) {
        (0, _) => String::new(),
        // The last one may be cut in part only.
        (contours, 0) if !matches!(outcome, Outcome::Completed) => {
            format!(" · {contours} contour{} begun", if contours == 1 { "" } else { "s" })
        }
        (1, 0) => " · 1 contour cut".into(),
        (contours, 0) => format!(" · {contours} contours cut"),
        (contours, not_cut) => format!(" · {not_cut} of {contours} contours NOT cut through"),
    };
    let times = format!(" · motion {:.2} s, retraced {:.2} s", seconds(stats.motion), seconds(stats.retracing));
    [how, contours, times]
}

/// Report for a person.
fn report_text<const A: usize>(report: &Report<'_, A>, (tables, worn): (&TableFiles, &str)) -> String {
    let value = report.to_json();
    let number = |key: &str| value[key].as_f64().unwrap_or(0.0);
    let times = format!(
        "  motion {:.3} s · dwell {:.3} s · switching {:.3} s · held {:.3} s · retracing {:.3} s · {} periods in \
            {:.2} s of real time",
        number("motion_s"),
        number("dwell_s"),
        number("switch_s"),
        number("held_s"),
        number("retrace_s"),
        report.stats.periods,
        report.wall_s
    );
    let each = |f: fn(&Value) -> String, key: &str| -> String {
        let axes = report.machine.axes.iter().map(|a| {
            let name = a.name.to_string();
            format!("{} {}", name.to_ascii_uppercase(), f(&value[key][&name]))
        });
        axes.collect::<Vec<_>>().join("  ")
    };
    let position = match report.position_note() {
        Some(note) => format!("  position not known: {note}"),
        None => format!(
            "  position {}  ({})",
            each(|v| format!("{:.3}", v.as_f64().unwrap_or(0.0)), "position_mm"),
            each(Value::to_string, "position_counts")
        ),
    };
    let counted = format!(
        "  limit violations {} · underruns {} · reversals {}",
        report.limit_report.violations, report.stats.underruns, report.stats.reversals
    );
    let cut = match report.stats.contours {
        0 => String::new(),
        contours => format!(
            "\n  contours {contours} · not whole {} · not cut {:.3} mm · interruptions {} · flickers {} · lit {:.1} s",
            report.stats.contours_not_cut,
            number("not_cut_mm"),
            report.stats.cut_interruptions,
            report.stats.cutter_flickers,
            number("lit_s")
        ),
    };
    let offsets = tables.parameters.as_ref().map_or(String::new(), |path| format!("\n  offsets {}", path.display()));
    format!(
        "{}: {}\n{times}\n{position}\n{counted}{cut}{worn}{offsets}",
        escape::name(report.program),
        report.outcome.word()
    )
}
