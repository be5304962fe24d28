//! The Pico's image in its emulator: a whole job by the command, and what happens when something fails.
//!
//! Invariant: pulses are judged by what the emulated pins did, control period by control period.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use super::build::{Board, Build};
use super::pico_emulator::PicoEmulator;
use super::sections::Budget;
use super::test::job;
use crate::suite;
use retrace_task_support::process;
use serde_json::Value;

/// Files of the emulated job: the program, the machine and the operator.
const PROGRAM: &str = "crates/firmware/emulated-pico.ngc";
const MACHINE: &str = "crates/firmware/emulated-pico.toml";
const OPERATOR: &str = "crates/firmware/emulated-pico.op";
/// The program in which something fails.
const FAILING: &str = super::test::PROGRAM;
/// What the emulator runs.
const IMAGE: Build = Build { board: Board::Pico, crystal: None, emulated: false };
/// Cycles of a millisecond.
const CYCLES_PER_MS: u64 = 125_000;
/// Pulses after which something fails: the built-in machine is in the program's first move.
const IN_MOTION: u32 = 12_000;
/// Longest time until the command has noticed that a card has failed.
const LIMIT: Duration = Duration::from_secs(60);

/// A job with a hold and a reverse run on a fast machine, and three failures on the built-in one.
pub(super) fn emulation(root: &Path) -> Result<bool, String> {
    let image = IMAGE.run(root)?;
    let binary = suite::build_command(root)?;
    let command = |program: &str, emulator: &PicoEmulator| {
        let mut command = Command::new(&binary);
        command.current_dir(root).args(["run", program, "--card"]).arg(emulator.line());
        command
    };
    let emulator = PicoEmulator::start(root, &image, None)?;
    let report = job(command(PROGRAM, &emulator).args(["--machine", MACHINE, "--operator", OPERATOR]))?;
    let found = emulator.finish()?;
    print_job(&found);
    let mut wrong = wrong_in_job(&found);
    if report.outcome != "completed" || report.reversals == 0 {
        wrong.push(format!("the job ended as `{}` with {} reversals", report.outcome, report.reversals));
    }
    if found["net"] != serde_json::json!(report.counts) {
        wrong.push(format!("the command reported the counts {:?}", report.counts));
    }
    for (event, judge) in EVENTS {
        let emulator = PicoEmulator::start(root, &image, Some((event, IN_MOTION)))?;
        let log = std::env::temp_dir().join(format!("retrace-xtask-pico-{}", std::process::id()));
        let ended = process::run(command(FAILING, &emulator).arg("--json"), LIMIT, &log)?;
        for extension in ["out", "err"] {
            // left behind it would only take room
            let _ = std::fs::remove_file(log.with_extension(extension));
        }
        let found = emulator.finish()?;
        let seen = &found["event"];
        println!("emulation of the Pico: {}", describe_event(event, seen));
        if !judge(seen) {
            wrong.push(format!("`{event}`: {seen}"));
        }
        if ended.passed() || count(&found, "wrong") > 0 {
            wrong.push(format!("`{event}`: the command passed, or pulses are wrong: {}", found["wrong_first"]));
        }
    }
    if wrong.is_empty() { Ok(true) } else { Err(wrong.join(", ")) }
}

/// Whether what was seen after an event is safe.
type Judge = fn(&Value) -> bool;

/// The failures. The firmware finds a defect of its own: no step and no output from then on. The processor does nothing
/// any more: the steps end with the period that was queued, and the watchdog resets the chip. The line is cut: the card
/// stops on the path after its watchdog time of 250 ms, and the spindle is off.
const EVENTS: [(&str, Judge); 3] = [
    ("panic", |seen| {
        within(seen, "steps_ended", CYCLES_PER_MS / 100)
            && within(seen, "spindle_off", CYCLES_PER_MS / 100)
            && seen["pulses_after"] == 0
            && seen["high_pins"] == serde_json::json!([])
    }),
    ("freeze", |seen| within(seen, "steps_ended", 2 * CYCLES_PER_MS) && within(seen, "watchdog", 51 * CYCLES_PER_MS)),
    ("cut", |seen| {
        within(seen, "spindle_off", 260 * CYCLES_PER_MS) && within(seen, "steps_ended", 450 * CYCLES_PER_MS)
    }),
];

/// Whether a time was seen and is not longer than this.
fn within(seen: &Value, name: &str, cycles: u64) -> bool {
    seen[name].as_u64().is_some_and(|time| time <= cycles)
}

fn count(found: &Value, name: &str) -> u64 {
    found[name].as_u64().unwrap_or(u64::MAX)
}

fn print_job(found: &Value) {
    println!(
        "emulation of the Pico: {} control periods, {} pulses, {} wrong; late: {} in motion, {} at rest; the longest \
         period took {} cycles, an interrupt {}; step high {}, low {} cycles at least; stack {} bytes; {} times slower \
         than the chip",
        found["periods"],
        found["pulses"],
        found["wrong"],
        found["late"]["motion"],
        found["late"]["opening"],
        found["max_period"],
        found["max_interrupt"],
        found["worst"]["high"],
        found["worst"]["low"],
        found["stack"],
        found["slower"],
    );
    println!(
        "emulation of the Pico: pulses at the pins {}, counted by the firmware {}",
        found["net"], found["counted"]
    );
}

/// What is wrong with a whole job, from what its pins did.
fn wrong_in_job(found: &Value) -> Vec<String> {
    let stack = Budget::of(Board::Pico).stack;
    let told = [
        (count(found, "wrong") > 0, format!("periods with other pulses than ordered: {}", found["wrong_first"])),
        (found["late"]["motion"] != 0, format!("periods were late in motion: {}", found["late"]["at"])),
        (found["net"] != found["counted"], "the pins' pulses are not those that the firmware counted".to_owned()),
        (found["lost_bytes"] != 0 || found["refused"] != 0, "bytes were lost, or pulses did not fit".to_owned()),
        // the machine's pulse of 2 µs and set-up of 5 µs, and the step generator's least time between pulses
        (count(&found["worst"], "high") < 250, "a step is too short".to_owned()),
        (count(&found["worst"], "low") < 175, "the time between steps is too short".to_owned()),
        (count(&found["worst"], "before") < 625, "a direction is not stable before a step".to_owned()),
        (count(&found["worst"], "behind") < 625, "a direction is not stable after a step".to_owned()),
        (count(found, "stack") > u64::from(stack), format!("{stack} bytes are reserved for the stack")),
    ];
    told.into_iter().filter_map(|(is_so, what)| is_so.then_some(what)).collect()
}

fn describe_event(name: &str, seen: &Value) -> String {
    let time = |key: &str| {
        seen[key].as_u64().map_or_else(|| "never".into(), |cycles| format!("{:.2} ms", cycles as f64 / 125e3))
    };
    format!(
        "`{name}` in motion: the last edge of a step after {}, spindle off after {}, reset by the watchdog after {}",
        time("steps_ended"),
        time("spindle_off"),
        time("watchdog")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_not_seen_is_not_in_time() {
        let seen = serde_json::json!({"steps_ended": 20, "spindle_off": null});
        assert!(within(&seen, "steps_ended", 20) && !within(&seen, "steps_ended", 19));
        assert!(!within(&seen, "spindle_off", 1000) && !within(&seen, "watchdog", 1000));
        assert!(EVENTS.iter().all(|(_, judge)| !judge(&seen)));
        assert!(!wrong_in_job(&seen).is_empty());
    }
}
