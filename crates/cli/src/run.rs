//! `retrace run`: machines a program.
//!
//! Invariant: nothing moves before machine file, script and program have been read and checked.

use std::io::Write;
use std::path::Path;
use std::time::Instant;

use retrace_controller::index::Keeping;
use retrace_controller::job::{self, Begin, Conduct, JobEnd};
use retrace_controller::machine::Machine;
use retrace_controller::operator::Instruction;
use retrace_controller::orders::{Heard, Operators};
use retrace_controller::refusal::Refusal;
use retrace_controller::report::Report;
use retrace_controller::script::ScriptPlayer;
use retrace_controller::session::{Manner, Outcome};
use retrace_hal_sim::{Clock, SimCard};
use retrace_link::{MotionCard, Start};
use serde_json::Value;

use crate::args;
use crate::console::{Console, Show, unwritable};
use crate::files;
use crate::operate;
use crate::program::{Failure, Program};
use crate::screen::live::Live;
use crate::wired;

/// Runs the command; its exit code.
///
/// # Errors
/// What keeps the job from beginning.
pub fn run(args: &args::Run) -> Result<u8, Failure> {
    let at_screen = operate::is_wanted(args)?;
    let machine = files::machine(args.machine.as_deref())?;
    let script = files::script(args.operator.as_deref())?;
    match machine.axes.len() {
        0..=4 => on_card::<4>(args, machine, script, at_screen),
        5..=6 => on_card::<6>(args, machine, script, at_screen),
        _ => on_card::<9>(args, machine, script, at_screen),
    }
}

/// Finds the card, and runs the job on it.
fn on_card<const A: usize>(
    args: &args::Run,
    machine: Machine,
    script: Vec<Instruction>,
    at_screen: bool,
) -> Result<u8, Failure> {
    if args.card == "sim" {
        let job = Job::open(args, &machine, script)?;
        let clock = if args.realtime || at_screen { Clock::wall(machine.period_us) } else { Clock::Virtual };
        let mut card =
            machine.rate_limits().and_then(|limits| SimCard::<A>::new(0, limits, clock)).ok_or_else(|| {
                Refusal::new("E2113", "the rate law does not fit the card's memory", "see docs/errors.md")
            })?;
        if at_screen {
            return operate::operate(args, &machine, job.program, job.script, &mut card);
        }
        return job.run(card, args.realtime, None).map(|(code, _)| code);
    }
    // Everything that can be refused without the card is refused before it is asked for.
    Job::open(args, &machine, script.clone())?;
    let mut card = wired::find::<A>(&args.card)?;
    card.settle(wired::nonce()).map_err(|fault| wired::failed(&args.card, &fault))?;
    let mut counts = [0; A];
    if let Some(greeting) = card.greeting() {
        wired::fits(&args.card, &greeting.identity, &machine)?;
        counts = greeting.counts;
    }
    let machine = machine.standing_at(&counts);
    let job = Job::open(args, &machine, script)?;
    // From here on the card expects to hear of the host all the time.
    card.open(machine.card_settings(Start::at(0))).map_err(|fault| wired::failed(&args.card, &fault))?;
    let code = if at_screen {
        operate::operate(args, &machine, job.program, job.script, &mut *card)?
    } else {
        job.run(&mut *card, true, None)?.0
    };
    // The card stands, or has an alarm that says more than this would.
    let _ = card.close();
    Ok(code)
}

/// Somebody who operates a job at a screen.
pub struct AtScreen<'r> {
    /// His words.
    pub heard: Heard,
    /// What shows him the job.
    pub live: Live,
    /// What he is told at its end.
    pub ended: &'r mut Ended,
}

/// How a job ended, for a person.
#[derive(Debug, Default)]
pub struct Ended {
    /// In a line.
    pub short: String,
    /// In some.
    pub text: String,
}

/// A job, ready to run.
pub struct Job<'a> {
    args: &'a args::Run,
    machine: &'a Machine,
    script: Vec<Instruction>,
    program: Program,
}

impl<'a> Job<'a> {
    /// Of a program that was opened and checked for this machine.
    pub fn of(args: &'a args::Run, machine: &'a Machine, script: Vec<Instruction>, program: Program) -> Self {
        Self { args, machine, script, program }
    }

    /// Opens the program and checks it whole.
    fn open(args: &'a args::Run, machine: &'a Machine, script: Vec<Instruction>) -> Result<Self, Failure> {
        let program = Program::open(&args.reading, machine)?;
        program.check(machine)?;
        if let (Some(line), Some(lines)) = (args.start_line, program.lines())
            && u64::from(line) > lines
        {
            let what = format!("--start-line {line}: {} has {lines} lines", program.name());
            return Err(Refusal::new("E2151", what, "a line of the program").into());
        }
        Ok(Self { args, machine, script, program })
    }

    /// Runs it on a card, in wall time where that is how the card's time passes: its exit code, and the card. `at_screen`: who operates it
    /// there, if anybody does.
    ///
    /// # Errors
    /// What keeps it from beginning; a file that cannot be written at its end.
    pub fn run<const A: usize, C: MotionCard<A>>(
        self,
        card: C,
        wall_time: bool,
        at_screen: Option<AtScreen<'_>>,
    ) -> Result<(u8, C), Failure> {
        let Self { args, machine, script, program } = self;
        let (heard, show, ended) = match at_screen {
            Some(AtScreen { heard, live, ended }) => (Some(heard), Show::Screen(live), Some(ended)),
            None => (None, Show::choose(args.json, program.lines()), None),
        };
        let mut console = Console::<A>::new(show, machine, args.records.as_deref())?;
        let manner = Manner { wall_time, operator: args.operator.is_some() || heard.is_some() };
        let begin = args.start_line.map_or(Begin::First, Begin::Line);
        let script = Operators::script(ScriptPlayer::new(script, machine.period_us));
        let operators = match heard {
            Some(heard) => script.and(heard),
            None => script,
        };
        let conduct = Conduct { begin, operators, manner, keeping: Keeping::default() };
        let started = Instant::now();
        let (decoder, last) = program.running();
        let end = job::run(machine, decoder, conduct, card, &mut console)
            .map_err(|why| Refusal::new("E2112", why.to_string(), "a shorter history_hours in the machine file"))?;
        let wall_s = started.elapsed().as_secs_f64();
        let (verdict, alarms, line) = console.finish()?;
        let JobEnd { outcome, tally, summary, card } = end;
        let report = Report {
            program: program.name(),
            machine,
            outcome: &outcome,
            line,
            tally: &tally,
            blocks: summary.as_ref().map_or(0, |s| s.blocks),
            canonical: summary.as_ref().map_or(0, |s| s.canonical),
            commanded_mm: summary.as_ref().map_or(&[], |s| &s.commanded_mm),
            counts: card.status().counts,
            verdict: &verdict,
            wall_s,
            alarms: &alarms,
        };
        match ended {
            Some(ended) => {
                let refused = if let Outcome::Refused(text) = &outcome { format!("{text}\n") } else { String::new() };
                *ended = Ended { short: short(&report), text: refused + &told(&report) };
            }
            None => tell(&report, args.json),
        }
        if let Some(folder) = &args.journal {
            keep(&report.to_json(), folder)?;
        }
        if let (Some(path), Outcome::Completed) = (&args.reading.params, &outcome) {
            last.write(path)?;
        }
        Ok((outcome.exit_code(), card))
    }
}

/// The report, for a script or for a person.
fn tell<const A: usize>(report: &Report<'_, A>, json: bool) {
    if let Outcome::Refused(text) = report.outcome {
        eprintln!("{text}");
    }
    if json {
        crate::out::line(report.to_json());
    } else {
        crate::out::line(told(report));
    }
}

/// How a job ended, in a line.
fn short<const A: usize>(report: &Report<'_, A>) -> String {
    let Report { outcome, tally, machine, .. } = report;
    let seconds = |periods: u64| periods as f64 * machine.period_s();
    let how = match outcome {
        Outcome::Completed => "completed".to_owned(),
        Outcome::Stopped => "stopped by the operator".to_owned(),
        Outcome::Refused(_) => "stopped: a block has an error (g)".to_owned(),
        Outcome::Alarm(number, cause, _) => format!("alarm {number}: {cause}"),
    };
    format!("{how} · motion {:.2} s, retraced {:.2} s", seconds(tally.motion), seconds(tally.retracing))
}

/// The report for a person.
fn told<const A: usize>(report: &Report<'_, A>) -> String {
    let value = report.to_json();
    let seconds = |key: &str| value[key].as_f64().unwrap_or(0.0);
    let times = format!(
        "  motion {:.3} s · dwell {:.3} s · switching {:.3} s · held {:.3} s · retracing {:.3} s · {} periods in {:.2} s of real time",
        seconds("motion_s"),
        seconds("dwell_s"),
        seconds("switch_s"),
        seconds("held_s"),
        seconds("retrace_s"),
        report.tally.periods,
        report.wall_s
    );
    let each = |f: fn(&Value) -> String, key: &str| -> String {
        let axes = report.machine.axes.iter().map(|a| {
            let name = a.name.to_string();
            format!("{} {}", name.to_ascii_uppercase(), f(&value[key][&name]))
        });
        axes.collect::<Vec<_>>().join("  ")
    };
    let position = format!(
        "  position {}  ({})",
        each(|v| format!("{:.3}", v.as_f64().unwrap_or(0.0)), "position_mm"),
        each(Value::to_string, "position_counts")
    );
    let counted = format!(
        "  limit violations {} · underruns {} · reversals {}",
        report.verdict.violations, report.tally.underruns, report.tally.reversals
    );
    format!("{}: {}\n{times}\n{position}\n{counted}", report.program, report.outcome.word())
}

/// Keeps the report in the journal's folder.
fn keep(report: &Value, folder: &Path) -> Result<(), Refusal> {
    let named = |error| unwritable(&folder.display().to_string(), &error);
    std::fs::create_dir_all(folder).map_err(named)?;
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).map_or(0, |d| d.as_millis());
    let mut file = std::fs::File::create(folder.join(format!("report-{now}.json"))).map_err(named)?;
    writeln!(file, "{report:#}").map_err(named)
}
