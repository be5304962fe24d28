//! What the emulated Pico does when something fails in motion: the firmware, the processor, the line, the host.
//!
//! Invariant: times are those of the chip, from the failure to what the pins did.

use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use super::pico::Rig;
use super::pico_emulator::{EventState, Line, PicoEmulator};
use retrace_task_support::process;
use serde_json::Value;

/// The program in which something fails, and the machine: the built-in one, with an output for S.
const PROGRAM: &str = "crates/firmware/emulated.ngc";
const MACHINE: &str = "crates/firmware/emulated-spindle.toml";
/// Cycles of a millisecond.
const CYCLES_PER_MS: u64 = 125_000;
/// Pulses after which something fails: the machine is in the program's first move.
const IN_MOTION: u32 = 12_000;
/// Longest time until the command has noticed that a card has failed, or has found it.
const LIMIT: Duration = Duration::from_secs(60);
/// Alarm of the card that its host was silent.
const SILENT_HOST: &str = "E3011";

/// A failure, and what must be seen.
struct Failure {
    event: &'static str,
    line: Line,
    /// Whether what was seen is safe.
    judge: fn(&Value) -> bool,
    /// Whether the end of the command is waited for, which takes some seconds. To the command a card that is silent for
    /// one cause is as silent for another.
    is_noticed: bool,
    /// Whether the card can be reached again, and the alarm that it shows then.
    goes_on: Option<Option<&'static str>>,
}

/// The failures. The firmware finds a defect of its own: no step and no output from then on. The processor does nothing
/// any more: the steps end with the period that was queued, and the watchdog resets the chip. No control period begins
/// any more: the firmware sets all outputs low within 100 ms. The line is cut, the USB cable is pulled out, or the host
/// is killed: the card stops on the path after its watchdog time of 250 ms, and the spindle is off. The supply breaks
/// down for a moment: the chip starts anew with another number of its start and counts of 0, and what the host still
/// sends moves nothing.
const FAILURES: [Failure; 7] = [
    Failure {
        event: "panic",
        line: Line::Uart,
        judge: |seen| {
            within(seen, "steps_ended", CYCLES_PER_MS / 100)
                && is_off_within(seen, CYCLES_PER_MS / 100)
                && seen["pulses_after"] == 0
                && seen["high_pins"] == serde_json::json!([])
        },
        is_noticed: true,
        goes_on: None,
    },
    Failure {
        event: "freeze",
        line: Line::Usb,
        judge: |seen| within(seen, "steps_ended", 2 * CYCLES_PER_MS) && within(seen, "watchdog", 51 * CYCLES_PER_MS),
        is_noticed: false,
        goes_on: None,
    },
    Failure {
        event: "stuck",
        line: Line::Usb,
        judge: |seen| {
            within(seen, "steps_ended", 2 * CYCLES_PER_MS)
                && is_off_within(seen, 100 * CYCLES_PER_MS)
                && seen["high_pins"] == serde_json::json!([])
        },
        is_noticed: false,
        goes_on: None,
    },
    Failure { event: "cut", line: Line::Uart, judge: host_is_silent, is_noticed: false, goes_on: None },
    Failure {
        event: "unplug",
        line: Line::Usb,
        judge: host_is_silent,
        is_noticed: true,
        goes_on: Some(Some(SILENT_HOST)),
    },
    Failure {
        event: "kill",
        line: Line::Usb,
        judge: host_is_silent,
        is_noticed: false,
        goes_on: Some(Some(SILENT_HOST)),
    },
    Failure { event: "reset", line: Line::Uart, judge: nothing_moves, is_noticed: true, goes_on: Some(None) },
];

/// Whether the card has done what it has to without a host. It runs then, and its output for S does not end its cycle
/// before it goes low with the spindle.
fn host_is_silent(seen: &Value) -> bool {
    let goes_low_at_once =
        seen["spindle_off"].as_u64().is_some_and(|off| within(seen, "pwm_off", off + CYCLES_PER_MS / 50));
    is_off_within(seen, 260 * CYCLES_PER_MS) && within(seen, "steps_ended", 450 * CYCLES_PER_MS) && goes_low_at_once
}

/// Whether the card that has started anew has made no step, and has no output on.
fn nothing_moves(seen: &Value) -> bool {
    let is_low = seen["high_pins"] == serde_json::json!([]);
    seen["pulses_after"] == 0 && is_low && within(seen, "spindle_off", CYCLES_PER_MS)
}

/// Whether the spindle was off by then, and the output for its speed low.
fn is_off_within(seen: &Value, cycles: u64) -> bool {
    within(seen, "spindle_off", cycles) && within(seen, "pwm_off", cycles)
}

/// Whether a time was seen and is not longer than this.
fn within(seen: &Value, name: &str, cycles: u64) -> bool {
    seen[name].as_u64().is_some_and(|time| time <= cycles)
}

/// Every failure, one after the other.
pub(super) fn emulation(root: &Path) -> Result<bool, String> {
    let rig = Rig::build(root)?;
    let mut wrong = Vec::new();
    for failure in &FAILURES {
        if let Err(reason) = run(root, &rig, failure) {
            wrong.push(format!("`{}` {reason}", failure.event));
        }
    }
    if wrong.is_empty() { Ok(true) } else { Err(wrong.join(", ")) }
}

fn run(root: &Path, rig: &Rig, failure: &Failure) -> Result<(), String> {
    let emulator = rig.start(root, failure.line, Some((failure.event, IN_MOTION)))?;
    let mut host = Host::start(rig, root, &emulator)?;
    emulator.wait_for(EventState::Happened)?;
    if failure.is_noticed {
        host.must_fail()?;
    } else {
        if failure.event != "kill" {
            emulator.wait_for(EventState::Over)?;
        }
        host.kill();
    }
    let greeting = match failure.goes_on {
        Some(alarm) => Some((identify(root, rig, &emulator)?, alarm)),
        None => None,
    };
    let found = emulator.finish()?;
    let seen = &found["event"];
    println!("emulation of the Pico: {}", describe(failure, seen));
    if !(failure.judge)(seen) {
        return Err(format!("is not safe: {seen}"));
    }
    if found["wrong"] != 0 {
        return Err(format!("makes other pulses than ordered: {}", found["wrong_first"]));
    }
    greeting.map_or(Ok(()), |(greeting, alarm)| compare(&greeting, alarm, &found))
}

/// Checks that the card at rest reports the position of the pins, and why it has stopped.
fn compare(greeting: &Value, alarm: Option<&str>, found: &Value) -> Result<(), String> {
    let reported = (&greeting["at_rest"], &greeting["alarm"]["number"], &greeting["counts"]);
    if reported != (&Value::Bool(true), &Value::from(alarm), &found["net"]) {
        return Err(format!("ends at the counts {}, and the card reports {greeting}", found["net"]));
    }
    Ok(())
}

/// Finds the card once the event is over.
fn identify(root: &Path, rig: &Rig, emulator: &PicoEmulator) -> Result<Value, String> {
    emulator.wait_for(EventState::Over)?;
    let log = std::env::temp_dir().join(format!("retrace-xtask-pico-{}", std::process::id()));
    let ended = process::run(&mut rig.command(root, &["card", "identify", "--json"], emulator), LIMIT, &log)?;
    for extension in ["out", "err"] {
        // left behind it would only take room
        let _ = std::fs::remove_file(log.with_extension(extension));
    }
    serde_json::from_str(&ended.output).map_err(|_| format!("leaves a card that is not found: {}", ended.last_words()))
}

/// The command that runs a job.
struct Host(Child);

impl Host {
    fn start(rig: &Rig, root: &Path, emulator: &PicoEmulator) -> Result<Self, String> {
        let mut command = rig.command(root, &["run", PROGRAM, "--json", "--machine", MACHINE, "--card"], emulator);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        command.spawn().map(Self).map_err(|error| format!("the command cannot be run: {error}"))
    }

    fn kill(&mut self) {
        // it may have ended by itself
        let _ = self.0.kill();
        let _ = self.0.wait();
    }

    /// Waits for its end, which must not be that of a completed job.
    fn must_fail(&mut self) -> Result<(), String> {
        let until = Instant::now() + LIMIT;
        loop {
            match self.0.try_wait() {
                Ok(Some(status)) if status.success() => return Err("is not noticed by the command".into()),
                Ok(Some(_)) => return Ok(()),
                Ok(None) if Instant::now() < until => std::thread::sleep(Duration::from_millis(20)),
                Ok(None) => return Err("does not end the command".into()),
                Err(error) => return Err(error.to_string()),
            }
        }
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        self.kill();
    }
}

fn describe(failure: &Failure, seen: &Value) -> String {
    let time = |key: &str| {
        seen[key].as_u64().map_or_else(|| "never".into(), |cycles| format!("{:.2} ms", cycles as f64 / 125e3))
    };
    format!(
        "`{}` in motion ({}): the last edge of a step after {}, spindle off after {}, its PWM low after {}, reset by \
         the watchdog after {}",
        failure.event,
        failure.line.name(),
        time("steps_ended"),
        time("spindle_off"),
        time("pwm_off"),
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
        assert!(FAILURES.iter().all(|failure| !(failure.judge)(&seen)));
    }

    #[test]
    fn a_position_that_is_not_that_of_the_pins_is_seen() {
        let greeting = serde_json::json!({"at_rest": true, "alarm": {"number": "E3011"}, "counts": [1, 2]});
        let alarm = Some(SILENT_HOST);
        assert!(compare(&greeting, alarm, &serde_json::json!({"net": [1, 2]})).is_ok());
        assert!(compare(&greeting, alarm, &serde_json::json!({"net": [1, 3]})).is_err());
        assert!(compare(&greeting, None, &serde_json::json!({"net": [1, 2]})).is_err());
        assert!(compare(&serde_json::json!({}), None, &serde_json::json!({})).is_err());
    }
}
