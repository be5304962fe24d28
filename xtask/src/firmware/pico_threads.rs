//! Threads by the emulated Pico: an axis follows the encoder of a spindle that turns at its pins.
//!
//! Invariant: the axis is judged by its pulses at the pins and the true angle of the spindle, at the begin of every
//! control period.

use std::path::Path;

use super::pico::{Rig, wrong_in_job};
use super::pico_emulator::{AtInputs, Line, PicoEmulator};
use super::test::job;
use serde_json::Value;

/// The program with two passes at different speeds, and the machine.
const PROGRAM: &str = "crates/firmware/emulated-thread.ngc";
const MACHINE: &str = "crates/firmware/emulated-thread.toml";
/// Counts a turn, revolutions per minute at the full output for S, the part of the speed by which it swings five times
/// a second, and pulses in a turn.
const SPINDLE: &str = "400,1200,0.03,1000";
/// Speeds of the passes in revolutions per minute, and the least number of control periods in which each is judged.
const PASSES: [(f64, u64); 2] = [(1000.0, 130), (700.0, 190)];
/// Largest distance of both passes from one helix, in pulses: one pulse, and half of it for each of the rounding of the
/// record, its part, and the edges' microseconds.
const MAX_WIDTH: f64 = 2.5;
/// Pulses after which the encoder dies: 1500 up, 4000 down and up again, and 3300 down, where the pitch ends.
const IN_SECOND_PASS: u32 = 12_800;
/// Alarms of an encoder that fails: it shows no count, or the axis could not follow what it shows.
const DEAD: [&str; 2] = ["E3033", "E3035"];
/// Cycles of a millisecond.
const CYCLES_PER_MS: u64 = 125_000;

/// A thread in two passes. In the second one, behind the part that is judged, the encoder dies.
pub(super) fn emulation(root: &Path) -> Result<bool, String> {
    let rig = Rig::build(root)?;
    let event = Some(("encoder", IN_SECOND_PASS));
    let emulator = PicoEmulator::start(root, rig.image(), Line::Usb, event, AtInputs::Spindle(SPINDLE))?;
    let mut command = rig.command(root, &["run", PROGRAM, "--card"], &emulator);
    let report = job(command.args(["--machine", MACHINE]))?;
    let found = emulator.finish()?;
    let (passes, seen) = (passes_of(&found), &found["event"]);
    println!(
        "threads by the Pico: passes at {passes:.2?}; a period took {} cycles at most, {} late in motion; once the \
         encoder is dead: spindle off after {} cycles, last step after {}, {}",
        found["max_period"], found["late"]["motion"], seen["spindle_off"], seen["steps_ended"], report.alarms
    );
    let mut wrong = wrong_in_job(&found);
    wrong.extend(wrong_in_passes(&passes));
    if !DEAD.iter().any(|alarm| report.alarms.contains(alarm)) || !ends_in_time(seen) {
        wrong.push(format!("the encoder dies, and the job ended as `{}`: {}, {seen}", report.outcome, report.alarms));
    }
    if wrong.is_empty() { Ok(true) } else { Err(wrong.join(", ")) }
}

/// What was seen of a pass.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pass {
    rpm: f64,
    periods: u64,
    /// Least and largest distance from the helix of the first place, in pulses.
    off: [f64; 2],
}

fn passes_of(found: &Value) -> Vec<Pass> {
    let pass = |of: &Value| {
        let off = [of["off"][0].as_f64()?, of["off"][1].as_f64()?];
        Some(Pass { rpm: of["rpm"].as_f64()?, periods: of["periods"].as_u64()?, off })
    };
    found["thread"].as_array().into_iter().flatten().filter_map(pass).collect()
}

/// What is wrong with the passes: they have to be at their speeds, and on one helix.
fn wrong_in_passes(passes: &[Pass]) -> Vec<String> {
    let are_there = passes.len() == PASSES.len()
        && passes
            .iter()
            .zip(PASSES)
            .all(|(pass, (rpm, periods))| (pass.rpm - rpm).abs() < rpm * 0.05 && pass.periods >= periods);
    let least = passes.iter().map(|pass| pass.off[0]).fold(f64::INFINITY, f64::min);
    let most = passes.iter().map(|pass| pass.off[1]).fold(f64::NEG_INFINITY, f64::max);
    let told = [
        (!are_there, "the passes are not those of the program".to_owned()),
        (most - least > MAX_WIDTH, format!("the helix is {:.2} pulses wide", most - least)),
    ];
    told.into_iter().filter_map(|(is_so, what)| is_so.then_some(what)).collect()
}

/// Whether spindle and steps end soon after the encoder has died.
fn ends_in_time(seen: &Value) -> bool {
    let within = |name: &str, ms: u64| seen[name].as_u64().is_some_and(|time| time <= ms * CYCLES_PER_MS);
    within("spindle_off", 30) && within("steps_ended", 90)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PASS: [Pass; 2] =
        [Pass { rpm: 1010.0, periods: 200, off: [-0.9, 0.8] }, Pass { rpm: 690.0, periods: 300, off: [-0.5, 1.1] }];

    #[test]
    fn passes_on_one_helix_are_right_and_others_are_not() {
        assert!(wrong_in_passes(&PASS).is_empty());
        assert_eq!(wrong_in_passes(&PASS[..1]).len(), 1);
        assert_eq!(wrong_in_passes(&[PASS[0], Pass { off: [1.5, 1.7], ..PASS[1] }]).len(), 1, "another helix");
        assert_eq!(wrong_in_passes(&[PASS[0], PASS[0]]).len(), 1, "the same speed");
        assert_eq!(passes_of(&serde_json::json!({})), []);
    }

    #[test]
    fn what_was_not_seen_is_not_in_time() {
        let seen = serde_json::json!({"spindle_off": 3_000_000, "steps_ended": 10_000_000});
        assert!(ends_in_time(&seen));
        assert!(!ends_in_time(&serde_json::json!({"spindle_off": 3_000_000, "steps_ended": 12_000_000})));
        assert!(!ends_in_time(&serde_json::json!({"steps_ended": 1})));
    }
}
