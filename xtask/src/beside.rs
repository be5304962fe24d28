//! The step `firmware` beside the step `browser`: the one computes, the other mostly waits.
//!
//! Invariant: what the step prints is printed whole, behind that of the other step; it passes only if its own process
//! reports success.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// Variable with the command that the step `test` has built.
pub(crate) const TESTED_COMMAND: &str = "RETRACE_TESTED_COMMAND";

/// The step, as a process of its own at a lower priority: the pages in the browsers are used as in real time.
pub(crate) struct FirmwareTests {
    child: Child,
    output: PathBuf,
}

impl FirmwareTests {
    /// Starts it. `None` where this cannot be done: the step is run in its turn then.
    pub(crate) fn start(root: &Path, command: Option<&Path>) -> Option<Self> {
        let output = root.join("target/firmware-tests.txt");
        let file = File::create(&output).ok()?;
        let mut nice = Command::new("nice");
        nice.args(["-n", "10"]).arg(std::env::current_exe().ok()?).args(["firmware", "test"]).current_dir(root);
        if let Some(command) = command {
            nice.env(TESTED_COMMAND, command);
        }
        let child = nice.stdin(Stdio::null()).stdout(file.try_clone().ok()?).stderr(file).spawn().ok()?;
        Some(Self { child, output })
    }

    /// Waits for its end. Returns whether it passed, and what it says of its checks.
    pub(crate) fn end(mut self) -> (bool, String) {
        let passed = self.child.wait().is_ok_and(|status| status.success());
        let printed = std::fs::read_to_string(&self.output).unwrap_or_default();
        print!("{printed}");
        (passed, checks_in(&printed))
    }
}

impl Drop for FirmwareTests {
    fn drop(&mut self) {
        // it may have ended by itself
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// What is said of the checks, from what the step prints.
fn checks_in(printed: &str) -> String {
    let checks: Vec<&str> = printed.lines().filter_map(|line| line.strip_prefix("firmware: ")).collect();
    checks.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checks_are_told_in_their_order() {
        let printed = "   Compiling x\nfirmware: format passed\n12 passed\nfirmware: emulation NOT RUN: no QEMU\n";
        assert_eq!(checks_in(printed), "format passed, emulation NOT RUN: no QEMU");
    }
}
