//! Signals to a job without a screen: it is stopped on its path, reported, and can be resumed.
#![cfg(unix)]

use std::fs::{self, File};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, binary};
use retrace_tests::served::Served;
use serde_json::Value;

const PROGRAM: &str = "G21 G90 F1200\nM3 S100\nG1 X20\nM8\nG1 X40\nG1 X0\nM2\n";
/// M8 takes two seconds.
const MILL: &str = "[card]\nwatchdog_ms = 2000\n[code.M8]\nclass = \"exclusive\"\nduration_ms = 2000\n";

struct Begun<'b> {
    bench: &'b Bench,
    child: Child,
}

impl<'b> Begun<'b> {
    fn of(bench: &'b Bench, arguments: &[&str]) -> Self {
        let file = |name: &str| File::create(bench.path(name)).expect("a file of the test");
        // A test that is run in the background inherits signals that are ignored, and an ignored signal stays ignored.
        let mut command = Command::new("env");
        command
            .arg("--default-signal=INT,TERM,HUP")
            .arg(binary())
            .args(arguments)
            .current_dir(bench.path(""))
            .env("XDG_STATE_HOME", bench.path("state"));
        command.env("XDG_CONFIG_HOME", bench.path("config")).env("XDG_CACHE_HOME", bench.path("cache"));
        command.stdin(Stdio::null()).stdout(file("out.txt")).stderr(file("err.txt"));
        Self { bench, child: command.spawn().expect("the retrace command runs") }
    }

    fn text(&self, name: &str) -> String {
        fs::read_to_string(self.bench.path(name)).unwrap_or_default()
    }

    fn until(&self, name: &str, words: &str) {
        let begun = Instant::now();
        while !self.text(name).contains(words) {
            assert!(
                begun.elapsed() < Duration::from_secs(50),
                "`{words}`: {}\n{}",
                self.text("out.txt"),
                self.text("err.txt")
            );
            sleep(Duration::from_millis(2));
        }
    }

    fn signal(&self, name: &str) {
        let told = Command::new("kill").args([name, &self.child.id().to_string()]).status();
        assert!(told.is_ok_and(|status| status.success()));
    }

    /// Waits for its end: exit code, and the report.
    fn ended(mut self) -> (Option<i32>, Value) {
        let begun = Instant::now();
        let code = loop {
            if let Some(status) = self.child.try_wait().expect("a child") {
                break status.code();
            }
            assert!(begun.elapsed() < Duration::from_secs(50), "it ends: {}", self.text("err.txt"));
            sleep(Duration::from_millis(5));
        };
        let out = self.text("out.txt");
        let report = serde_json::from_str(out.lines().last().unwrap_or_default());
        (code, report.unwrap_or_else(|error| panic!("{error}: {out}\n{}", self.text("err.txt"))))
    }
}

impl Drop for Begun<'_> {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn bench() -> Bench {
    let bench = Bench::new();
    bench.file("part.ngc", PROGRAM);
    bench.file("mill.toml", MILL);
    bench
}

#[track_caller]
fn assert_stopped((code, report): (Option<i32>, Value)) {
    assert_eq!((code, report["outcome"].as_str()), (Some(4), Some("stopped")), "{report}");
    assert_eq!(
        (report["alarms"].as_array().map(Vec::len), &report["limit_violations"]),
        (Some(0), &Value::from(0)),
        "{report}"
    );
}

#[test]
fn ctrl_c_sigterm_and_sighup_stop_the_job_and_keep_its_breakpoint() {
    let (bench, card) = (bench(), Served::with(&[]));
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "mill.toml", "--no-tui", "--json"];
    let begun = Begun::of(&bench, &run);
    begun.until("out.txt", "\"switched\"");
    sleep(Duration::from_millis(300));
    begun.signal("-INT");
    begun.until("err.txt", "stopping: the machine comes to rest");
    assert_stopped(begun.ended());
    let who = card.who(&bench);
    assert_eq!((&who["at_rest"], &who["alarm"]), (&Value::from(true), &Value::Null), "{who}");
    for signal in ["-TERM", "-HUP"] {
        let begun = Begun::of(&bench, &["resume", "--yes", "--json"]);
        begun.until("out.txt", "\"goes_on\"");
        sleep(Duration::from_millis(100));
        begun.signal(signal);
        assert_stopped(begun.ended());
    }
    let said = bench.retrace(["resume", "--yes", "--json"]);
    assert_eq!(said.code, Some(0), "{}\n{}", said.out, said.err);
}

#[test]
fn a_second_ctrl_c_is_answered_with_what_is_waited_for() {
    let (bench, card) = (bench(), Served::with(&[]));
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "mill.toml", "--no-tui", "--json"];
    let begun = Begun::of(&bench, &run);
    begun.until("out.txt", "\"code\":\"M8\"");
    begun.signal("-INT");
    begun.until("err.txt", "stopping:");
    begun.signal("-INT");
    begun.until("err.txt", "still stopping: M8 of line 4 is being executed");
    assert_stopped(begun.ended());
}

#[test]
fn a_run_in_virtual_time_that_waits_for_its_program_is_stopped_too() {
    let bench = bench();
    let mut command = Command::new(binary());
    command.args(["run", "-", "--json"]).env("XDG_STATE_HOME", bench.path("state"));
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut child = command.spawn().expect("the retrace command runs");
    sleep(Duration::from_millis(700));
    let told = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(told.is_ok_and(|status| status.success()));
    let begun = Instant::now();
    while child.try_wait().expect("a child").is_none() {
        assert!(begun.elapsed() < Duration::from_secs(20), "it ends");
        sleep(Duration::from_millis(10));
    }
    let input = child.stdin.take();
    let output = child.wait_with_output().expect("it has ended");
    drop(input);
    assert_eq!(output.status.code(), Some(4), "{}", String::from_utf8_lossy(&output.stdout));
}
