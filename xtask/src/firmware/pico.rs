//! The Pico's image in its emulator: a whole job by the command.
//!
//! Invariant: pulses are judged by what the emulated pins did, control period by control period.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::build::{Board, Build};
use super::pico_emulator::{self, AtInputs, Line, PicoEmulator};
use super::sections::Budget;
use super::test::job;
use crate::suite;
use retrace_task_support::process;
use serde_json::Value;

/// Files of the emulated job: the program, the machine and the operator.
pub(super) const PROGRAM: &str = "crates/firmware/emulated-pico.ngc";
const MACHINE: &str = "crates/firmware/emulated-pico.toml";
const OPERATOR: &str = "crates/firmware/emulated-pico.op";
/// What the emulator runs.
const IMAGE: Build = Build { board: Board::Pico, crystal: None, emulated: false };

/// The image, and the command that runs on it.
pub(super) struct Rig {
    image: PathBuf,
    binary: PathBuf,
}

impl Rig {
    /// Builds both.
    ///
    /// # Errors
    /// One of them does not build.
    pub(super) fn build(root: &Path) -> Result<Self, String> {
        Ok(Self { image: IMAGE.run(root)?, binary: suite::build_command(root)? })
    }

    /// The image.
    pub(super) fn image(&self) -> &Path {
        &self.image
    }

    /// Starts the emulator with its line; `event` happens after so many pulses.
    ///
    /// # Errors
    /// It does not start.
    pub(super) fn start(&self, root: &Path, line: Line, event: Option<(&str, u32)>) -> Result<PicoEmulator, String> {
        PicoEmulator::start(root, &self.image, line, event, AtInputs::Nothing)
    }

    /// A command whose last argument is the emulator's line.
    pub(super) fn command(&self, root: &Path, words: &[&str], emulator: &PicoEmulator) -> Command {
        let mut command = Command::new(&self.binary);
        command.current_dir(root).args(words).arg(emulator.line());
        command
    }
}

/// Package and filter of the tests that compare the image with the card crate, period by period.
const COMPARISON: [&str; 6] = ["--package", "retrace-controller", "--test", "testsuite", "--", "pico::"];

/// The variable by which these tests find script, image and emulator, and its value.
///
/// # Errors
/// The image does not build, or the emulator is not installed.
pub(crate) fn comparison_environment(root: &Path) -> Result<(&'static str, String), String> {
    let (_, rp2040js) = pico_emulator::can_emulate(root)?;
    let script = root.join("crates/firmware/emulator/lockstep.mjs");
    Ok(("RETRACE_PICO", [script, IMAGE.run(root)?, rp2040js].map(|path| path.display().to_string()).join(",")))
}

/// A slice of the campaign `pico`: random jobs, and homing.
pub(super) fn comparison(root: &Path) -> Result<bool, String> {
    let (name, value) = comparison_environment(root)?;
    let mut command = process::cargo(root, &["test", "--quiet"]);
    command.args(COMPARISON).args(["--include-ignored", "--nocapture", "--test-threads=1"]).env(name, value);
    Ok(command.status().map_err(|error| format!("cargo cannot be run: {error}"))?.success())
}

/// A job with a hold and a reverse run on a fast machine, over USB.
pub(super) fn emulation(root: &Path) -> Result<bool, String> {
    let rig = Rig::build(root)?;
    let emulator = rig.start(root, Line::Usb, None)?;
    let mut command = rig.command(root, &["run", PROGRAM, "--card"], &emulator);
    let report = job(command.args(["--machine", MACHINE, "--operator", OPERATOR]))?;
    let found = emulator.finish()?;
    print_job(&found);
    let mut wrong = wrong_in_job(&found);
    if report.outcome != "completed" || report.reversals == 0 {
        wrong.push(format!(
            "the job ended as `{}` with {} reversals: {}",
            report.outcome, report.reversals, report.alarms
        ));
    }
    if found["net"] != serde_json::json!(report.counts) {
        wrong.push(format!("the command reported the counts {:?}", report.counts));
    }
    if found["usb"] != serde_json::json!(["retrace", "retrace card", pico_emulator::SERIAL]) {
        wrong.push(format!("the USB names are {}", found["usb"]));
    }
    if wrong.is_empty() { Ok(true) } else { Err(wrong.join(", ")) }
}

/// The program that goes as far in mm as a tenth of the frequency in kHz.
const FREQUENCY_PROGRAM: &str = "crates/firmware/emulated-frequency.ngc";
/// Frequencies at the input, in Hz; pulses for each, and the greatest deviation: some edges in a control period.
const FREQUENCIES_HZ: [u32; 2] = [250_000, 7_500];
const PULSES_PER_HZ: f64 = 0.24;
const DEVIATION: f64 = 480.0;

/// The frequency at an input, as a program reads it.
pub(super) fn frequency(root: &Path) -> Result<bool, String> {
    let rig = Rig::build(root)?;
    for hz in FREQUENCIES_HZ {
        let emulator = PicoEmulator::start(root, &rig.image, Line::Usb, None, AtInputs::WaveHz(hz))?;
        let mut command = rig.command(root, &["run", FREQUENCY_PROGRAM, "--card"], &emulator);
        let report = job(command.args(["--machine", MACHINE]))?;
        let _ = emulator.finish()?;
        let [x, ..] = report.counts;
        println!("frequency at an input of the Pico: {hz} Hz, read as {:.0}", f64::from(x) / PULSES_PER_HZ);
        if report.outcome != "completed" || (f64::from(x) - f64::from(hz) * PULSES_PER_HZ).abs() > DEVIATION {
            return Err(format!("{hz} Hz: the job ended as `{}` at {x}: {}", report.outcome, report.alarms));
        }
    }
    Ok(true)
}

/// The program that cuts along a sheet that rises, and its machine; what the module sends is in `torch.mjs`.
const TORCH_PROGRAM: &str = "crates/firmware/emulated-torch.ngc";
const TORCH_MACHINE: &str = "crates/firmware/emulated-torch.toml";
/// Greatest deviation of the height where the torch follows the sheet, in mm.
const HEIGHT_DEVIATION_MM: f64 = 0.4;

/// Height control by the voltage of a module at UART0, over USB: with sentences, in silence, and with noise.
pub(super) fn voltage_module(root: &Path) -> Result<bool, String> {
    let rig = Rig::build(root)?;
    let emulator = PicoEmulator::start(root, &rig.image, Line::Usb, None, AtInputs::Torch)?;
    let mut command = rig.command(root, &["run", TORCH_PROGRAM, "--card"], &emulator);
    let report = job(command.args(["--machine", TORCH_MACHINE]))?;
    let found = emulator.finish()?;
    println!("voltage from a module at the Pico: {}; late in motion: {}", found["torch"], found["late"]["motion"]);
    let mut wrong = wrong_in_cut(&found["torch"]);
    if report.outcome != "completed" {
        wrong.push(format!("the job ended as `{}`: {}", report.outcome, report.alarms));
    }
    if found["lost_bytes"] != 0 || found["late"]["motion"] != 0 {
        wrong.push(format!("bytes were lost, or periods were late: {}", found["late"]));
    }
    if wrong.is_empty() { Ok(true) } else { Err(wrong.join(", ")) }
}

/// What is wrong with a cut, from the heights in its parts.
fn wrong_in_cut(parts: &Value) -> Vec<String> {
    let follows = ["follows", "follows_behind_silence", "follows_with_noise"].into_iter().filter(|&part| {
        let [above, below] = ["above_mm", "below_mm"].map(|key| parts[part][key].as_f64().unwrap_or(f64::INFINITY));
        let is_near = above.abs() <= HEIGHT_DEVIATION_MM && below.abs() <= HEIGHT_DEVIATION_MM;
        !is_near || count(&parts[part], "places") < 10
    });
    let stays = ["silence", "noise"].into_iter().filter(|&part| count(&parts[part], "places") != 1);
    let follows = follows.map(|part| format!("{part}: the torch does not follow the sheet"));
    follows.chain(stays.map(|part| format!("{part}: the torch moves without a reading"))).collect()
}

/// The step output of an axis, wired to the frequency input: what the owner of a board can do without an instrument.
pub(super) fn step_test(root: &Path) -> Result<bool, String> {
    let rig = Rig::build(root)?;
    let emulator = PicoEmulator::start(root, &rig.image, Line::Usb, None, AtInputs::StepsOf(0))?;
    let mut command = rig.command(root, &["doctor"], &emulator);
    command.args(["--machine", MACHINE, "--step-test", "x", "--yes", "--json"]);
    let output = command.output().map_err(|error| format!("the command cannot be run: {error}"))?;
    let _ = emulator.finish()?;
    let found: Value = serde_json::from_slice(&output.stdout)
        .map_err(|_| format!("the step test: {}", String::from_utf8_lossy(&output.stderr)))?;
    println!("step test of the Pico: {found}");
    Ok(found["step_test"]["passed"] == true)
}

/// The program that probes, its machine, and the surfaces of axis 2 at the pin of input 3: in pulses below the start,
/// and the cycles from that pulse to the contact, half of those to the next pulse.
const PROBE_PROGRAM: &str = "crates/firmware/emulated-probe.ngc";
const PROBE_MACHINE: &str = "crates/firmware/emulated-probe.toml";
const SURFACES: &str = "2,19,1003:6250,1234:2500,61:62500";

/// Touches of a probe, whose moments the card captures.
pub(super) fn probing(root: &Path) -> Result<bool, String> {
    let rig = Rig::build(root)?;
    let emulator = PicoEmulator::start(root, &rig.image, Line::Usb, None, AtInputs::Probe(SURFACES))?;
    let mut command = rig.command(root, &["run", PROBE_PROGRAM, "--card"], &emulator);
    let output = command.args(["--machine", PROBE_MACHINE, "--json"]).output();
    let output = output.map_err(|error| format!("the command cannot be run: {error}"))?;
    let _ = emulator.finish()?;
    let told = String::from_utf8_lossy(&output.stdout);
    let depth = |text: &str| text.strip_prefix("touch -").and_then(|mm| mm.parse::<f64>().ok());
    let touches: Vec<i64> = told
        .lines()
        .filter_map(|line| serde_json::from_str::<Value>(line).ok())
        .filter_map(|event| event["text"].as_str().and_then(depth))
        .map(|mm| (mm * 1000.0).round() as i64)
        .collect();
    let surfaces: Vec<i64> =
        SURFACES.split(',').skip(2).filter_map(|surface| surface.split(':').next()?.parse().ok()).collect();
    println!("probing by the Pico: surfaces at {SURFACES}, touched at {touches:?}");
    if touches == surfaces {
        return Ok(true);
    }
    Err(format!("touched at {touches:?}: {}", String::from_utf8_lossy(&output.stderr)))
}

fn count(found: &Value, name: &str) -> u64 {
    found[name].as_u64().unwrap_or(u64::MAX)
}

fn print_job(found: &Value) {
    println!(
        "emulation of the Pico: {} control periods, {} pulses, {} wrong; late: {} in motion, {} at rest; a period took \
         {} cycles on average and {} at most, an interrupt {}; step high {}, low {} cycles at least; stack {} bytes; \
         {} times slower than the chip",
        found["periods"],
        found["pulses"],
        found["wrong"],
        found["late"]["motion"],
        found["late"]["opening"],
        found["mean_period"],
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
pub(super) fn wrong_in_job(found: &Value) -> Vec<String> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_not_seen_is_wrong() {
        assert!(!wrong_in_job(&serde_json::json!({})).is_empty());
        assert_eq!(wrong_in_cut(&serde_json::json!({})).len(), 5);
    }

    #[test]
    fn a_torch_that_does_not_follow_or_does_not_stay_is_wrong() {
        let part = |above_mm: f64, places: u32| {
            let below_mm = -0.1;
            serde_json::json!({"above_mm": above_mm, "below_mm": below_mm, "places": places})
        };
        let cut = |follows: Value, silence: Value| {
            let (behind, noise) = (part(0.2, 50), part(0.9, 1));
            let with_noise = part(0.0, 50);
            wrong_in_cut(&serde_json::json!({
                "follows": follows, "silence": silence, "follows_behind_silence": behind, "noise": noise,
                "follows_with_noise": with_noise,
            }))
        };
        assert!(cut(part(0.1, 50), part(0.5, 1)).is_empty());
        assert_eq!(cut(part(0.41, 50), part(0.5, 1)).len(), 1, "too high");
        assert_eq!(cut(part(0.1, 2), part(0.5, 1)).len(), 1, "it stays");
        assert_eq!(cut(part(0.1, 50), part(0.5, 2)).len(), 1, "it moves");
    }
}
