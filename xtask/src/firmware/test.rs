//! `cargo xtask firmware test`: the tests of the firmware that this machine can run.
//!
//! Invariant: the verdict names each check that ran and each that did not, with the reason.

use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use super::build::{self, Board, Build};
use super::computer_watch::ComputerWatch;
use super::diagnostics::{self, Diagnostics};
use super::elf::Image;
use super::emulator::{self, Emulator};
use super::sections::Budget;
use super::{pico, pico_emulator, pico_failures, pico_threads, sections};
use crate::suite;
use retrace_task_support::process;

/// Result of the test.
pub(crate) struct Verdict {
    pub(crate) passed: bool,
    /// One line with what ran and what did not.
    pub(crate) remark: String,
}

/// Result of one check.
enum Ended {
    Passed,
    Failed(String),
    NotRun(String),
}

impl From<Result<bool, String>> for Ended {
    fn from(result: Result<bool, String>) -> Self {
        match result {
            Ok(true) => Self::Passed,
            Ok(false) => Self::Failed("see above".into()),
            Err(reason) => Self::Failed(reason),
        }
    }
}

/// The step generator has other limits on this chip.
const UNIT_TESTS_RP2350: [&str; 7] = ["test", "--locked", "--lib", "--quiet", "--features", "rp2350", "rp2040"];

/// A check: its name, the tools that it needs or which of them is missing, and what does it.
type Check<'a> = (&'a str, Result<(), String>, &'a (dyn Fn(&Path) -> Result<bool, String> + Sync));

/// Number of the last checks that are run two at a time: each emulates a Pico, in one thread and in time of its own.
const EMULATED: usize = 7;

/// Most runs of a check whose host was late.
const RUNS: u32 = 3;

/// Runs the checks whose names contain `part`.
pub(super) fn run(root: &Path, part: &str) -> Verdict {
    let compilers = build::can_build(&Board::ALL);
    let qemu = build::can_build(&[Board::F405]).and_then(|()| emulator::can_emulate().map(|_| ()));
    let rp2040js = build::can_build(&[Board::Pico]).and_then(|()| pico_emulator::can_emulate(root).map(|_| ()));
    let checks: [Check; 14] = [
        ("format", Ok(()), &|root| in_firmware(root, &["fmt", "--check"])),
        ("clippy", Ok(()), &|root| in_firmware(root, &["clippy", "--locked", "--all-targets", "--", "-D", "warnings"])),
        ("unit tests", Ok(()), &|root| in_firmware(root, &["test", "--locked", "--lib", "--quiet"])),
        ("unit tests as for an RP2350", Ok(()), &|root| in_firmware(root, &UNIT_TESTS_RP2350)),
        ("size", compilers, &sizes),
        ("emulation", qemu, &emulation),
        ("emulation of the Pico", rp2040js.clone(), &pico::emulation),
        ("frequency at an input of the Pico", rp2040js.clone(), &pico::frequency),
        ("voltage from a module at the Pico", rp2040js.clone(), &pico::voltage_module),
        ("step test of the Pico", rp2040js.clone(), &pico::step_test),
        ("probing by the Pico", rp2040js.clone(), &pico::probing),
        ("threads by the Pico", rp2040js.clone(), &pico_threads::emulation),
        ("failures of the Pico", rp2040js.clone(), &pico_failures::emulation),
        ("pins of the Pico against the simulator", rp2040js, &pico::comparison),
    ];
    let is_asked = |check: &&Check| check.0.contains(part);
    let (one_by_one, emulated) = checks.split_at(checks.len() - EMULATED);
    let emulated: Vec<&Check> = emulated.iter().filter(is_asked).collect();
    let asked = checks.iter().filter(is_asked).count();
    let mut told: Vec<(bool, String)> =
        one_by_one.iter().filter(is_asked).map(|check| run_check(root, check)).collect();
    let (next, ended) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                while let number = next.fetch_add(1, Ordering::Relaxed)
                    && let Some(check) = emulated.get(number)
                {
                    let one = run_check(root, check);
                    ended.lock().unwrap_or_else(PoisonError::into_inner).push((number, one));
                }
            });
        }
    });
    let mut ended = ended.into_inner().unwrap_or_else(PoisonError::into_inner);
    ended.sort_by_key(|(number, _)| *number);
    told.extend(ended.into_iter().map(|(_, one)| one));
    let passed = told.iter().all(|(passed, _)| *passed) && told.len() == asked && asked > 0;
    Verdict { passed, remark: told.into_iter().map(|(_, said)| said).collect::<Vec<String>>().join(", ") }
}

/// Runs a check. Returns whether nothing failed, and what is said of it.
fn run_check(root: &Path, (name, tools, check): &Check) -> (bool, String) {
    let ended = match tools {
        Ok(()) => run_with_host_in_time(name, || check(root)),
        Err(missing) => Ended::NotRun(missing.clone()),
    };
    let (passed, said) = match ended {
        Ended::Passed => (true, format!("{name} passed")),
        Ended::NotRun(missing) => (true, format!("{name} NOT RUN: {missing}")),
        Ended::Failed(reason) => (false, format!("{name} FAILED: {reason}")),
    };
    println!("firmware: {said}");
    (passed, said)
}

/// Alarm of a card whose host has read no reports for too long: an emulated card runs on while its host stands still.
const HOST_WAS_LATE: &str = "E3005";

/// Runs a check, and again where its host was late on a computer that was taken away. Everything else that a check
/// finds fails at once, and the last run fails whatever the computer did.
fn run_with_host_in_time(name: &str, check: impl Fn() -> Result<bool, String>) -> Ended {
    for run in 1..RUNS {
        let watch = ComputerWatch::start();
        let result = check();
        let disturbance = watch.end();
        match result {
            Err(reason) if reason.contains(HOST_WAS_LATE) && disturbance.is_large() => {
                println!("firmware: {name}, run {run} of {RUNS}: {reason}; {disturbance}");
            }
            ended => return ended.into(),
        }
    }
    check().into()
}

/// Runs cargo in the firmware's workspace, for this machine.
fn in_firmware(root: &Path, arguments: &[&str]) -> Result<bool, String> {
    let mut command = process::cargo(&root.join("crates/firmware"), arguments);
    command.env("CARGO_TARGET_DIR", build::target_folder(root).join("firmware"));
    let status = command.status().map_err(|error| format!("cargo cannot be run: {error}"))?;
    Ok(status.success())
}

fn sizes(root: &Path) -> Result<bool, String> {
    super::each(&Board::ALL.map(|board| Build { board, crystal: None, emulated: false }), |build| {
        sections::hold(build, &build.run(root)?)
    })
}

/// Files of the emulated job: the program, the machine and the operator.
const PROGRAM: &str = pico::PROGRAM;
const MACHINE: &str = "crates/firmware/emulated.toml";
const OPERATOR: &str = "crates/firmware/emulated.op";

/// A job in QEMU, by the command, with time counted in instructions: a program with switching, a hold and a reverse
/// run.
fn emulation(root: &Path) -> Result<bool, String> {
    let path = Build::EMULATED.run(root)?;
    let command = suite::build_command(root)?;
    let bytes = std::fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))?;
    let image = Image::read(&bytes)?;
    // one virtual nanosecond per instruction
    let mut emulator = Emulator::start(&path, &["-icount", "shift=0"])?;
    let mut command = Command::new(command);
    command.current_dir(root).args(["run", PROGRAM, "--card", emulator.line(), "--machine", MACHINE]);
    let report = job(command.args(["--operator", OPERATOR]))?;
    let found = Diagnostics::read(&image, &mut emulator)?;
    let depth = diagnostics::stack_depth(&image, &mut emulator)?;
    println!(
        "emulation: {} control periods, {} late, {} bytes lost, {} orders refused; one took {} instructions on \
         average and {} at most, filling a buffer of 250 µs {} at most; stack {depth} bytes",
        found.periods,
        found.late_periods,
        found.lost_bytes,
        found.refused,
        diagnostics::instructions(found.mean_period),
        diagnostics::instructions(found.max_period),
        diagnostics::instructions(found.max_interrupt),
    );
    println!("emulation: pulses at the outputs {:?}, counts reported {:?}", found.counted, report.counts);
    println!(
        "emulation: the DMA and the port NOT RUN: QEMU has neither; the processor has played the buffers to a counter"
    );
    let stack = Budget::of(Board::F405).stack;
    let told = [
        (report.outcome != "completed", format!("the job ended as `{}`: {}", report.outcome, report.alarms)),
        (report.reversals == 0, "nothing was run backward".to_owned()),
        (found.counted != report.counts, "the outputs' pulses are not those reported".to_owned()),
        (found.lost_bytes > 0 || found.refused > 0, "bytes were lost, or pulses did not fit".to_owned()),
        (depth > stack, format!("{stack} bytes are reserved for the stack")),
    ];
    let wrong: Vec<String> = told.into_iter().filter_map(|(is_so, what)| is_so.then_some(what)).collect();
    if wrong.is_empty() { Ok(true) } else { Err(wrong.join(", ")) }
}

/// Report of the command on a job.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Report {
    pub(super) outcome: String,
    /// Alarms, as they are reported.
    pub(super) alarms: String,
    pub(super) reversals: u64,
    /// Final counts of X, Y, Z and A.
    pub(super) counts: [i32; 4],
}

/// Longest time that a job may take; it takes some 20 s on a busy computer.
const LIMIT: Duration = Duration::from_secs(300);

/// Runs a job and reads its report.
pub(super) fn job(command: &mut Command) -> Result<Report, String> {
    command.arg("--json");
    static JOBS: AtomicUsize = AtomicUsize::new(0);
    let number = JOBS.fetch_add(1, Ordering::Relaxed);
    let log = std::env::temp_dir().join(format!("retrace-xtask-firmware-{}-{number}", std::process::id()));
    let ended = process::run(command, LIMIT, &log)?;
    for extension in ["out", "err"] {
        // left behind it would only take room
        let _ = std::fs::remove_file(log.with_extension(extension));
    }
    let report = ended.output.lines().next_back().and_then(report_in);
    report.ok_or_else(|| format!("the job ended without a report: {}", ended.last_words()))
}

/// The report, from the line of JSON that it is.
fn report_in(line: &str) -> Option<Report> {
    let report: serde_json::Value = serde_json::from_str(line).ok()?;
    let mut counts = [0; 4];
    for (count, axis) in counts.iter_mut().zip(["x", "y", "z", "a"]) {
        // an axis that the machine does not have is at 0
        let position = &report["position_counts"][axis];
        *count = if position.is_null() { 0 } else { i32::try_from(position.as_i64()?).ok()? };
    }
    let outcome = report["outcome"].as_str()?.to_owned();
    Some(Report { outcome, alarms: report["alarms"].to_string(), reversals: report["reversals"].as_u64()?, counts })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_is_read_and_anything_else_is_not() {
        let line = "{\"outcome\":\"completed\",\"alarms\":[],\"reversals\":2,\
                    \"position_counts\":{\"x\":10,\"y\":-20,\"z\":7},\"more\":[]}";
        let report = Report { outcome: "completed".into(), alarms: "[]".into(), reversals: 2, counts: [10, -20, 7, 0] };
        assert_eq!(report_in(line), Some(report));
        assert_eq!(report_in("{\"event\":\"switched\"}"), None);
        assert_eq!(report_in(&line.replace("-20", "0.5")), None);
        assert_eq!(report_in("no JSON"), None);
    }
}
