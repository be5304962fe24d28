//! `cargo xtask firmware test`: what can be tested of the firmware on this machine.
//!
//! Invariant: the verdict names each check that ran and each that did not, with the reason.

use std::path::Path;
use std::process::Command;

use super::build::{self, Board, Build};
use super::diagnostics::{self, Diagnostics};
use super::elf::Image;
use super::emulator::{self, Emulator};
use super::sections;

/// How the test ended.
pub(crate) struct Verdict {
    pub(crate) passed: bool,
    /// What ran and what did not, in a line.
    pub(crate) remark: String,
}

/// How one check ended.
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

/// A check: its name, the tools that it needs or which of them is missing, and what does it.
type Check<'a> = (&'a str, Result<(), String>, &'a dyn Fn(&Path) -> Result<bool, String>);

pub(super) fn run(root: &Path) -> Verdict {
    let compiler = build::can_build();
    let qemu = compiler.clone().and_then(|()| emulator::can_emulate().map(|_| ()));
    let checks: [Check; 5] = [
        ("format", Ok(()), &|root| in_firmware(root, &["fmt", "--check"])),
        ("clippy", Ok(()), &|root| in_firmware(root, &["clippy", "--locked", "--all-targets", "--", "-D", "warnings"])),
        ("unit tests", Ok(()), &|root| in_firmware(root, &["test", "--locked", "--lib", "--quiet"])),
        ("size", compiler, &sizes),
        ("emulation", qemu, &emulation),
    ];
    let mut verdict = Verdict { passed: true, remark: String::new() };
    for (name, tools, check) in checks {
        let ended = match tools {
            Ok(()) => check(root).into(),
            Err(missing) => Ended::NotRun(missing),
        };
        let said = match ended {
            Ended::Passed => format!("{name} passed"),
            Ended::NotRun(missing) => format!("{name} not run: {missing}"),
            Ended::Failed(reason) => {
                verdict.passed = false;
                format!("{name} FAILED: {reason}")
            }
        };
        println!("firmware: {said}");
        verdict.remark += if verdict.remark.is_empty() { "" } else { ", " };
        verdict.remark += &said;
    }
    verdict
}

/// Runs cargo in the firmware's workspace, for this machine.
fn in_firmware(root: &Path, arguments: &[&str]) -> Result<bool, String> {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(arguments).current_dir(root.join("crates/firmware"));
    command.env("CARGO_TARGET_DIR", build::target_folder(root).join("firmware"));
    let status = command.status().map_err(|error| format!("cargo cannot be run: {error}"))?;
    Ok(status.success())
}

fn sizes(root: &Path) -> Result<bool, String> {
    super::each(&Board::ALL.map(|board| Build { board, crystal: None, emulated: false }), |build| {
        sections::hold(build, &build.run(root)?)
    })
}

/// A run in QEMU, with time counted in instructions.
fn emulation(root: &Path) -> Result<bool, String> {
    let path = Build::EMULATED.run(root)?;
    let bytes = std::fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))?;
    let image = Image::read(&bytes)?;
    // a virtual nanosecond an instruction
    let mut emulator = Emulator::start(&path, &["-icount", "shift=0"])?;
    let claimed = in_company(root, emulator.line())?;
    let found = Diagnostics::read(&image, &mut emulator)?;
    let depth = diagnostics::stack_depth(&image, &mut emulator)?;
    println!(
        "emulation: {} control periods, {} late, {} bytes lost; the longest took {} instructions, the longest step \
         interrupt (all slots of a period) {}; stack {depth} bytes",
        found.periods,
        found.late_periods,
        found.lost_bytes,
        diagnostics::instructions(found.longest_period),
        diagnostics::instructions(found.longest_interrupt),
    );
    println!("emulation: the outputs' pulses {:?}, the card's counts {claimed:?}", found.counted);
    if depth > sections::STACK {
        return Err(format!("the stack is {depth} bytes deep, {} are kept for it", sections::STACK));
    }
    if found.lost_bytes > 0 {
        return Err(format!("{} bytes were lost", found.lost_bytes));
    }
    Ok(found.counted == claimed)
}

/// Plays the host over the line, by the firmware's own test of that name, which says where the card's counts ended.
fn in_company(root: &Path, line: &str) -> Result<[i32; 4], String> {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(["test", "--locked", "--test", "emulated", "--", "--nocapture"]);
    command.current_dir(root.join("crates/firmware")).env("RETRACE_CARD_LINE", line);
    command.env("CARGO_TARGET_DIR", build::target_folder(root).join("firmware"));
    let output = command.output().map_err(|error| format!("cargo cannot be run: {error}"))?;
    let said = String::from_utf8_lossy(&output.stdout);
    print!("{said}");
    if !output.status.success() {
        return Err(format!("over its line: {}", String::from_utf8_lossy(&output.stderr).trim_end()));
    }
    counts_in(&said).ok_or_else(|| "the test over the line named no counts".to_owned())
}

/// The numbers of the line `counts: …`.
fn counts_in(said: &str) -> Option<[i32; 4]> {
    let (_, rest) = said.split_once("counts:")?;
    let numbers: Vec<i32> = rest.lines().next()?.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    numbers.try_into().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_counts_are_read_from_what_the_test_prints() {
        assert_eq!(counts_in("running 1 test\ncounts: 10 -20 0 7\ntest ok"), Some([10, -20, 0, 7]));
        assert_eq!(counts_in("counts: 10 -20"), None);
        assert_eq!(counts_in(""), None);
    }
}
