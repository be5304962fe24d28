//! A whole job without a card: text to canonical functions, moves, plan and records, and the check of a threading
//! program. Rows S6 and S7 of `cargo xtask bench motion`.
//!
//! Invariant: the program is made before the clock starts; everything between its text and its last record is timed, on
//! one core.

#[path = "../../motion/benches/motion/row.rs"]
#[allow(dead_code)]
mod row;
#[path = "../../motion/benches/motion/test_paths.rs"]
#[allow(dead_code)] // this bench uses its part
mod test_paths;

use std::fmt::Write as _;
use std::time::Instant;

use retrace_config::MachineConfig;
use retrace_controller::{
    BlockDecoder, Cancelled, DecodedBlock, MotionSink, PlanWriteError, SwitchInstruction, analyse_program,
    check_program, feed_program,
};
use retrace_core::Flags;
use retrace_gcode::{CanonStep, Prescan, Program, Progress, Setup, Text};
use retrace_link::OutputChange;
use retrace_motion::{Arc, FeedRate, PathMode, Planner};

use row::{Goal, Row, median};
use test_paths::TestMove;

/// A program being decoded.
struct Decoder(Program<&'static [u8]>);

impl BlockDecoder for Decoder {
    fn next_block(&mut self, steps: &mut Vec<CanonStep>) -> DecodedBlock {
        match self.0.advance(steps) {
            Progress::End => DecodedBlock::End,
            _ => DecodedBlock::Block,
        }
    }
}

/// Plans, and takes every record out as soon as it exists.
struct Records {
    planner: Planner<3>,
    records: u64,
    pulses: i64,
}

impl Records {
    fn drain(&mut self) {
        while let Some(record) = self.planner.next_record() {
            self.records += 1;
            self.pulses += record.increments.iter().map(|count| i64::from(*count)).sum::<i64>();
        }
    }
}

impl MotionSink<3> for Records {
    fn straight(&mut self, end_mm: [f64; 3], feed: FeedRate, mode: PathMode, line: u32) -> Result<(), PlanWriteError> {
        self.planner.line(end_mm, feed, mode, line)?;
        self.drain();
        Ok(())
    }

    fn arc(&mut self, arc: &Arc<3>, feed: FeedRate, mode: PathMode, line: u32) -> Result<(), PlanWriteError> {
        self.planner.arc(arc, feed, mode, line)?;
        self.drain();
        Ok(())
    }

    fn action(&mut self, _: OutputChange, _: u32) {}

    fn exclusive(&mut self, _: SwitchInstruction<'_>) -> Result<(), Cancelled> {
        self.planner.stop(Flags::NONE);
        self.drain();
        Ok(())
    }

    fn message(&mut self, _: String, _: u32) -> Result<(), Cancelled> {
        Ok(())
    }
}

/// A 3-D surface of 0.1 mm lines, at the feed at which `lines` lines take `seconds` seconds.
fn program(lines: usize, seconds: f64) -> String {
    let moves = test_paths::surface(lines).moves;
    let mut at = [0.0; 3];
    let length: f64 = moves
        .iter()
        .map(|step| {
            let from = std::mem::replace(&mut at, step.end());
            from.iter().zip(&at).map(|(a, b)| (b - a) * (b - a)).sum::<f64>().sqrt()
        })
        .sum();
    let mut text = format!("G21 G90 G17 G64 P0.05\nF{:.1}\n", length / seconds * 60.0);
    for step in &moves {
        let [x, y, z] = step.end();
        if let TestMove::Line(_) = step {
            // Writing into memory cannot fail.
            let _ = writeln!(text, "G1 X{x:.3} Y{y:.3} Z{z:.3}");
        }
    }
    text + "M2\n"
}

/// Passes of the threading program.
const PASSES: u32 = 80;

/// A thread in small infeeds. Each pass leaves the work at 45° in a blended corner, as in LinuxCNC's `threading.ngc`.
fn threading_program() -> String {
    let mut text = "G21 G90 G64 P0.02\nS400 M3\n".to_owned();
    for pass in 0..PASSES {
        let (depth, infeed) = (0.0125 * f64::from(pass), 0.007 * f64::from(PASSES - pass));
        let (start, end, x) = (18.0 + infeed, 2.5 + infeed, 3.0 - depth);
        // Writing into memory cannot fail.
        let _ = write!(text, "G0 X{:.3} Z{start:.3}\nG0 X{:.3}\nG1 X{x:.3} F500\n", x + 5.0, x + 2.5);
        let _ = write!(text, "G33 Z{end:.3} K1.27\nG33 X{:.3} Z{infeed:.3} K1.796\nG0 X8\n", x + 2.5);
    }
    text + "M2\n"
}

/// Seconds for what `retrace check` does with a long program: the check of every move, then the analysis.
fn check_threads(text: &Text, machine: &MachineConfig) -> (f64, u64) {
    let started = Instant::now();
    let setup = Setup::rs274();
    let prescan = std::sync::Arc::new(Prescan::scan("program", text.clone(), &setup));
    let decoder = || Decoder(Program::prescanned(prescan.clone(), Setup::rs274()));
    let (_, findings, checked) = check_program::<9>(machine, &mut decoder());
    assert!(findings.is_empty(), "{findings:?}");
    let analysed = analyse_program::<4>(machine, &mut decoder(), Some(checked.threads));
    let (.., analysis) = analysed.expect("the limits are valid");
    let took = started.elapsed().as_secs_f64();
    assert_eq!(analysis.threads.iter().len(), PASSES as usize);
    (took, analysis.motion_periods)
}

fn threads_row(rounds: usize) -> Row {
    let machine = MachineConfig::parse("[spindle]\ncounts_per_turn = 400\nmax_rpm = 3000\n", "threads");
    let machine = machine.expect("the built-in machine with an encoder is valid");
    let text = Text::from(threading_program().as_str());
    let runs: Vec<(f64, u64)> = (0..rounds).map(|_| check_threads(&text, &machine)).collect();
    Row {
        name: "S7",
        what: format!("check of a thread of {PASSES} passes that leave the work in a blended corner"),
        figure: 1000.0 * median(runs.iter().map(|run| run.0).collect()),
        unit: "ms",
        goal: Goal::AtMost(50.0),
        note: format!("{:.1} s of motion; median of {rounds}", runs[0].1 as f64 * machine.period_s()),
    }
}

/// Processor time equals wall time here: nothing waits.
fn run(text: &Text, machine: &MachineConfig) -> (f64, u64, u64) {
    let setup = Setup::rs274();
    let planner = Planner::new(machine.limits(), [0.0; 3]).expect("the built-in machine is valid");
    let started = Instant::now();
    let prescan = std::sync::Arc::new(Prescan::scan("program", text.clone(), &setup));
    let mut decoder = Decoder(Program::prescanned(prescan, setup));
    let mut sink = Records { planner, records: 0, pulses: 0 };
    let (blocks, findings) = feed_program(machine, &mut decoder, &mut sink);
    sink.planner.stop(Flags::NONE);
    sink.drain();
    let took = started.elapsed().as_secs_f64();
    assert!(findings.is_empty() && sink.pulses != 0, "{findings:?}");
    (took, blocks, sink.records)
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    // As in every bench: run as a test, it only has to start.
    if !arguments.iter().any(|argument| argument == "--bench") {
        return;
    }
    let full = arguments.iter().any(|argument| argument == "--full");
    let (lines, rounds) = (1_000_000, if full { 5 } else { 3 });
    let machine = MachineConfig::built_in().expect("the built-in machine is valid");
    let text = Text::from(program(lines, 3600.0).as_str());
    let runs: Vec<(f64, u64, u64)> = (0..rounds).map(|_| run(&text, &machine)).collect();
    let figure = median(runs.iter().map(|run| run.0).collect());
    let (_, blocks, records) = runs[0];
    let row = Row {
        name: "S6",
        what: "a job of 10⁶ lines and an hour: parse, plan, emit".to_owned(),
        figure,
        unit: "s",
        goal: Goal::AtMost(2.0),
        note: format!("{blocks} blocks, {records} records, without card; median of {rounds}"),
    };
    println!("{row}");
    println!("{}", threads_row(2 * rounds + 1));
}
