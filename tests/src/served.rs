//! A simulated card that `retrace card serve` serves during a test.
//!
//! Invariant: it is ended with the test, however that ends.

use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::command::{Bench, CommandOutput, binary};

/// Largest number of times that a machine is homed where it ends in an alarm.
const MAX_HOMINGS: u32 = 6;

/// Largest number of times that a job is resumed which the computer kept from its end.
const MAX_RESUMES: u32 = 6;

/// How long a job without an operator may wait with its cutter off.
const MAX_WAIT: Duration = Duration::from_secs(5);

/// Resumes the job of a killed host on its card until it ends: again where the computer kept the host from running for
/// longer than the watchdog allows, or until the cutter went off at rest. Returns the output of the commands.
///
/// # Errors
/// The same, where it ends otherwise.
pub fn resume_to_end(bench: &Bench) -> Result<String, String> {
    let mut told = String::new();
    for _ in 0..MAX_RESUMES {
        let (code, out) = cut(bench, &["resume", "--yes", "--json"]);
        told += &format!("--- resumed: {code:?}\n{out}");
        match code {
            Some(0) => return Ok(told),
            Some(3) | None => {}
            Some(_) => break,
        }
    }
    Err(told)
}

/// Runs a job of a torch or a laser on a served card until it ends, and resumes it where the computer kept its host
/// from running for longer than the cutter may stay on at rest. Returns the output of the commands.
///
/// # Errors
/// The same, where it ends otherwise.
pub fn cut_to_end(bench: &Bench, arguments: &[&str]) -> Result<String, String> {
    match cut(bench, arguments) {
        (Some(0), told) => Ok(told),
        (Some(3) | None, told) => match resume_to_end(bench) {
            Ok(resumed) => Ok(told + &resumed),
            Err(resumed) => Err(told + &resumed),
        },
        (Some(_), told) => Err(told),
    }
}

/// Runs a job, and kills the host where it waits for an operator because the cutter went off in the cut. Returns its
/// exit code, if it was not killed, and its output.
fn cut(bench: &Bench, arguments: &[&str]) -> (Option<i32>, String) {
    let mut host = bench.start(arguments, Stdio::null(), "cut.txt");
    let read = || std::fs::read_to_string(bench.path("cut.txt")).unwrap_or_default();
    let mut waiting_since = Instant::now();
    loop {
        sleep(Duration::from_millis(20));
        if let Some(status) = host.try_wait().expect("a child") {
            return (status.code(), read());
        }
        if !waits_for_recovery(&read()) {
            waiting_since = Instant::now();
        } else if waiting_since.elapsed() > MAX_WAIT {
            host.kill().expect("it is killed");
            host.wait().expect("it ends");
            return (None, read());
        }
    }
}

/// Whether the last cut of a job waits, by its output up to now.
#[must_use]
pub fn waits_for_recovery(told: &str) -> bool {
    let is_off = |line: &&str| ["at_rest", "lost"].iter().any(|why| line.contains(&format!("\"reason\":\"{why}\"")));
    let goes_on = |line: &str| line.contains("\"event\":\"run_resumed\"");
    told.lines().rev().take_while(|line| !goes_on(line)).any(|line| is_off(&line))
}

/// A card being served.
#[derive(Debug)]
pub struct ServedCard {
    child: Child,
    out: BufReader<ChildStdout>,
    /// The pseudo-terminal that hosts open.
    pub port: String,
}

impl ServedCard {
    /// Serves a card with these additional arguments.
    ///
    /// # Panics
    /// Where it prints no path.
    #[must_use]
    pub fn with(arguments: &[&str]) -> Self {
        let mut command = Command::new(binary());
        command.args(["card", "serve", "--pty", "--until-eof", "--json"]).args(arguments);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().expect("the retrace command runs");
        let mut out = BufReader::new(child.stdout.take().expect("a pipe"));
        let mut port = String::new();
        out.read_line(&mut port).expect("a line");
        assert!(port.starts_with('/'), "a path: {port}");
        Self { child, out, port: port.trim_end().to_owned() }
    }

    /// Identity and position of the card.
    ///
    /// # Panics
    /// Where no card answers.
    #[must_use]
    pub fn identify(&self, bench: &Bench) -> Value {
        let result = bench.retrace(["card", "identify", &self.port, "--json"]);
        assert_eq!(result.code, Some(0), "{}", result.err);
        serde_json::from_str(&result.out).expect("one JSON object")
    }

    /// Runs a program on it, with a watchdog that tolerates a computer under load: the watchdog is tested elsewhere.
    #[must_use]
    pub fn run(&self, bench: &Bench, program: &str) -> CommandOutput {
        self.run_with(bench, program, &[])
    }

    /// Runs a program on it with further arguments.
    #[must_use]
    pub fn run_with(&self, bench: &Bench, program: &str, arguments: &[&str]) -> CommandOutput {
        bench.file("patient.toml", "[card]\nwatchdog_ms = 2000\n");
        let usual = ["run", program, "--card", &self.port, "--machine", "patient.toml", "--json"];
        bench.retrace(usual.iter().chain(arguments))
    }

    /// Homes every axis of the machine file `m.toml`, again where the computer kept the host from running for longer
    /// than the watchdog allows; returns the output of the commands.
    ///
    /// # Errors
    /// The same, where it is not homed.
    pub fn home(&self, bench: &Bench) -> Result<String, String> {
        let mut told = String::new();
        for _ in 0..MAX_HOMINGS {
            let homed = bench.retrace(["home", "--card", &self.port, "--machine", "m.toml", "--json"]);
            told += &format!("--- home: {:?}\n{}{}\n", homed.code, homed.out, homed.err);
            match homed.code {
                Some(0) => return Ok(told),
                Some(3) => {
                    let _ = bench.retrace(["card", "clear", &self.port, "--machine", "m.toml"]);
                }
                _ => break,
            }
        }
        Err(told)
    }

    /// Sends a line to its standard input, which operates the machine manually.
    ///
    /// # Panics
    /// Where it has ended.
    pub fn operate(&mut self, line: &str) {
        let input = self.child.stdin.as_mut().expect("a pipe");
        writeln!(input, "{line}").expect("it listens");
    }

    /// Ends it; returns its final output.
    ///
    /// # Panics
    /// Where that is not JSON.
    #[must_use]
    pub fn end(mut self) -> Value {
        drop(self.child.stdin.take());
        let mut text = String::new();
        self.out.read_to_string(&mut text).expect("text");
        serde_json::from_str(&text).expect("one JSON object")
    }
}

impl Drop for ServedCard {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
