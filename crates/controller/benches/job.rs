//! A whole job without a card: text to canonical functions, moves, plan and records. Row S6 of `cargo xtask bench
//! motion`.
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
    BlockDecoder, Cancelled, DecodedBlock, MotionSink, PlanWriteError, SwitchInstruction, feed_program,
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
}
