//! QEMU with the firmware in it: its serial line, and its monitor.
//!
//! Invariant: QEMU ends with the value that started it; every wait is bounded.

use std::io::{Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use retrace_task_support::tools;

/// Installation of QEMU.
const GET_QEMU: &str = "qemu-system-arm from your distribution, on PATH (docs/firmware.md)";
const PROMPT: &str = "(qemu) ";
/// Longest wait for an answer of the monitor.
const PATIENCE: Duration = Duration::from_secs(20);

/// A running QEMU.
pub(super) struct Emulator {
    child: Child,
    monitor: ChildStdin,
    result: Arc<Mutex<String>>,
    line: String,
}

/// Checks that QEMU is installed.
///
/// # Errors
/// It is not; the text says how to install it.
pub(super) fn can_emulate() -> Result<std::path::PathBuf, String> {
    tools::program("qemu-system-arm").ok_or_else(|| format!("no qemu-system-arm: {GET_QEMU}"))
}

impl Emulator {
    /// Starts the image on QEMU's netduinoplus2, which has an STM32F405.
    ///
    /// # Errors
    /// QEMU is not installed, or does not start.
    pub(super) fn start(image: &Path, options: &[&str]) -> Result<Self, String> {
        let mut command = Command::new(can_emulate()?);
        command.args(["-machine", "netduinoplus2", "-display", "none", "-serial", "pty", "-monitor", "stdio"]);
        command.arg("-kernel").arg(image).args(options);
        let mut child = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::inherit())
            .spawn()
            .map_err(|error| format!("QEMU cannot be started: {error}"))?;
        let (Some(monitor), Some(mut output)) = (child.stdin.take(), child.stdout.take()) else {
            return Err("QEMU has no pipes".into());
        };
        let result = Arc::new(Mutex::new(String::new()));
        let heard = Arc::clone(&result);
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(count @ 1..) = output.read(&mut bytes) {
                if let Ok(mut heard) = heard.lock() {
                    heard.push_str(&String::from_utf8_lossy(&bytes[..count]));
                }
            }
        });
        let mut emulator = Self { child, monitor, result, line: String::new() };
        let greeting = emulator.wait(0, |result| result.contains(PROMPT) && line_in(result).is_some())?;
        emulator.line = line_in(&greeting).unwrap_or_default();
        Ok(emulator)
    }

    /// The terminal that is the card's serial line.
    pub(super) fn line(&self) -> &str {
        &self.line
    }

    /// Whether it is running.
    pub(super) fn runs(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(None))
    }

    /// Reads words of the target's memory.
    ///
    /// # Errors
    /// QEMU does not answer.
    pub(super) fn words(&mut self, address: u32, count: usize) -> Result<Vec<u32>, String> {
        let answer = self.ask(&format!("xp /{count}wx {address:#x}"))?;
        let words = words_in(&answer);
        if words.len() == count { Ok(words) } else { Err(format!("QEMU said: {answer}")) }
    }

    fn ask(&mut self, question: &str) -> Result<String, String> {
        let from = self.result.lock().map_or(0, |result| result.len());
        writeln!(self.monitor, "{question}").map_err(|error| format!("QEMU's monitor: {error}"))?;
        // its echo ends before the answer begins, on a line of its own
        self.wait(from, |result| result.split_once('\n').is_some_and(|(_, answer)| answer.ends_with(PROMPT)))
    }

    /// Waits until the output from position `from` on is as wanted.
    fn wait(&mut self, from: usize, wanted: impl Fn(&str) -> bool) -> Result<String, String> {
        let until = Instant::now() + PATIENCE;
        loop {
            let result =
                self.result.lock().map(|result| result.get(from..).unwrap_or_default().to_owned()).unwrap_or_default();
            if wanted(&result) {
                return Ok(result);
            }
            if !self.runs() {
                return Err(format!("QEMU has ended: {result}"));
            }
            if Instant::now() > until {
                return Err(format!("QEMU does not answer: {result}"));
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        // it may have ended by itself
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The terminal that QEMU names: `char device redirected to … (label serial0)`.
fn line_in(result: &str) -> Option<String> {
    result.split_once("redirected to ").and_then(|(_, rest)| rest.split_whitespace().next()).map(str::to_owned)
}

/// The words of a dump: lines of an address, a colon, and words.
fn words_in(answer: &str) -> Vec<u32> {
    answer
        .lines()
        .filter_map(|line| line.split_once(": 0x").map(|(_, words)| words))
        .flat_map(|words| words.split_whitespace())
        .filter_map(|word| u32::from_str_radix(word.trim_start_matches("0x"), 16).ok())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_and_the_words_are_found_in_what_qemu_says() {
        let greeting = "char device redirected to pts/7 (label serial0)\r\nQEMU 7.2\r\n(qemu) ";
        assert_eq!(line_in(greeting).as_deref(), Some("pts/7"));
        let answer = "xp /5wx 0x10\r\n\
            0000000020000010: 0x52540001 0x00000002 0x00000003 0xffffffff\r\n0000000020000020: 0x00000005\r\n(qemu) ";
        assert_eq!(words_in(answer), [0x5254_0001, 2, 3, u32::MAX, 5]);
    }
}
