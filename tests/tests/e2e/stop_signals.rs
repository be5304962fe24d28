//! Signals to a job without a screen: it is stopped on its path, reported, and can be resumed. And Enter at its
//! terminal, which is cycle start.

use std::fs::{self, File};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, binary};
use retrace_tests::pause::pause;
use retrace_tests::served::ServedCard;
use retrace_tests::terminal::Terminal;
use serde_json::Value;

const PROGRAM: &str = "G21 G90 F1200\nM3 S100\nG1 X20\nM8\nG1 X40\nG1 X0\nM2\n";
/// M8 takes two seconds.
const MILL: &str = "[card]\nwatchdog_ms = 2000\n[code.M8]\nclass = \"exclusive\"\nduration_ms = 2000\n";

/// The command. A test that runs in the background inherits ignored signals, and an ignored signal remains ignored.
fn with_default_signals() -> Command {
    let mut command = Command::new("env");
    command.arg("--default-signal=INT,TERM,HUP").arg(binary());
    command
}

struct Begun<'b> {
    bench: &'b Bench,
    child: Child,
}

impl<'b> Begun<'b> {
    fn of(bench: &'b Bench, arguments: &[&str]) -> Self {
        let file = |name: &str| File::create(bench.path(name)).expect("a file of the test");
        let mut command = with_default_signals();
        command.args(arguments).current_dir(bench.path("")).env("XDG_STATE_HOME", bench.path("state"));
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
    let (bench, card) = (bench(), ServedCard::with(&[]));
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "mill.toml", "--no-tui", "--json"];
    let begun = Begun::of(&bench, &run);
    begun.until("out.txt", "\"switched\"");
    pause(Duration::from_millis(300));
    begun.signal("-INT");
    begun.until("err.txt", "stopping: braking on the path");
    assert_stopped(begun.ended());
    let who = card.identify(&bench);
    assert_eq!((&who["at_rest"], &who["alarm"]), (&Value::from(true), &Value::Null), "{who}");
    for signal in ["-TERM", "-HUP"] {
        let begun = Begun::of(&bench, &["resume", "--yes", "--json"]);
        begun.until("out.txt", "\"run_resumed\"");
        pause(Duration::from_millis(100));
        begun.signal(signal);
        assert_stopped(begun.ended());
    }
    let result = bench.retrace(["resume", "--yes", "--json"]);
    assert_eq!(result.code, Some(0), "{}\n{}", result.out, result.err);
}

#[test]
fn a_second_ctrl_c_is_answered_with_what_is_waited_for() {
    let (bench, card) = (bench(), ServedCard::with(&[]));
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "mill.toml", "--no-tui", "--json"];
    let begun = Begun::of(&bench, &run);
    begun.until("out.txt", "\"code\":\"M8\"");
    begun.signal("-INT");
    begun.until("err.txt", "stopping:");
    begun.signal("-INT");
    begun.until("err.txt", "still stopping: M8 of line 4 must complete first");
    assert_stopped(begun.ended());
}

#[test]
fn a_run_in_virtual_time_that_waits_for_its_program_is_stopped_too() {
    let bench = bench();
    let mut command = with_default_signals();
    command.args(["run", "-", "--json"]).env("XDG_STATE_HOME", bench.path("state"));
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut child = command.spawn().expect("the retrace command runs");
    pause(Duration::from_millis(700));
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

const STOPS: &str = "G21 G90 F6000\nG1 X2\nM0\nG1 X4\nM1\nG1 X6\nT2 M6\nG1 X8\nM2\n";

/// A folder with a program that stops at M0, M1 and M6, on a machine with manual tool changes.
fn stops() -> Bench {
    let bench = Bench::new();
    bench.file("stops.ngc", STOPS);
    bench.file("manual.toml", "tool_change = \"manual\"\n");
    bench.file("tools.tbl", "T2 P2 Z10 D6 ; end mill\n");
    bench
}

#[test]
fn m0_m1_and_m6_wait_in_wall_time_and_enter_at_the_terminal_goes_on() {
    let bench = stops();
    let path = |name: &str| bench.path(name).display().to_string();
    let (program, machine, tools, jobs) = (path("stops.ngc"), path("manual.toml"), path("tools.tbl"), path("jobs"));
    let run = [
        "run",
        &program,
        "--machine",
        &machine,
        "--tools",
        &tools,
        "--journal",
        &jobs,
        "--realtime",
        "--no-tui",
        "--records",
        &path("records.csv"),
    ];
    let mut terminal = Terminal::running(&run, 180, 40);
    // Typed before anything is waited for: it is not an answer.
    terminal.keys("\n\n\n");
    let waits = [
        "M0 of line 3 waits; press Enter",
        "M1 of line 5 waits; press Enter",
        "M6 of line 7 waits: insert tool 2 (end mill); press Enter",
    ];
    for (answered, wait) in waits.into_iter().enumerate() {
        terminal.wait_for_text(wait);
        pause(Duration::from_millis(700));
        assert_eq!(terminal.text().matches("operator: cycle start").count(), answered, "{}", terminal.text());
        assert!(!terminal.text().contains("completed"), "it waits: {}", terminal.text());
        terminal.keys("\n");
    }
    assert_eq!(terminal.wait_for_end(), Some(0), "{}", terminal.text());
    // It stopped at each of them, and nowhere else for so long.
    let records = fs::read_to_string(bench.path("records.csv")).expect("the records");
    let mut stood = std::collections::BTreeMap::<String, u32>::new();
    for row in records.lines().skip(1).map(|row| row.split(',').collect::<Vec<_>>()) {
        if row[2] == "0.000000000" {
            *stood.entry(row[5].to_owned() + row[1]).or_default() += 1;
        }
    }
    let long = stood.values().filter(|&&periods| periods > 600).count();
    assert_eq!(long, 3, "{stood:?}");
    // With the switch off, M1 is passed.
    let mut off = run.to_vec();
    off.extend(["--optional-stop", "off"]);
    let mut terminal = Terminal::running(&off, 180, 40);
    for wait in ["M0 of line 3 waits", "M6 of line 7 waits"] {
        terminal.wait_for_text(wait);
        pause(Duration::from_millis(200));
        terminal.keys("\n");
    }
    assert_eq!(terminal.wait_for_end(), Some(0), "{}", terminal.text());
    assert!(!terminal.text().contains("M1 of line"), "{}", terminal.text());
}

#[test]
fn without_a_terminal_a_program_stop_says_the_way_out_and_a_resumed_job_keeps_the_switch_of_m1() {
    let bench = stops();
    let run = ["run", "stops.ngc", "--realtime", "--json", "--journal", "jobs", "--optional-stop", "off"];
    let begun = Begun::of(&bench, &run);
    begun.until("err.txt", "M0 of line 3 waits; no terminal to press Enter at: stop it with `kill ");
    // Longer than the timeout for an absent operator elsewhere.
    pause(Duration::from_secs(12));
    assert!(!begun.text("out.txt").contains("\"report\""), "it still waits: {}", begun.text("out.txt"));
    begun.signal("-TERM");
    assert_stopped(begun.ended());
    let jobs = bench.path("jobs").display().to_string();
    let mut terminal = Terminal::running(&["resume", "--yes", "--realtime", "--journal", &jobs], 180, 40);
    terminal.wait_for_text("M0 of line 3 waits; press Enter");
    pause(Duration::from_millis(200));
    terminal.keys("\n");
    assert_eq!(terminal.wait_for_end(), Some(0), "{}", terminal.text());
    assert!(!terminal.text().contains("M1 of line"), "M1 is passed, as before: {}", terminal.text());
}

#[test]
fn a_program_on_standard_input_is_not_taken_for_enter() {
    let bench = stops();
    let mut command = with_default_signals();
    command.args(["run", "-", "--realtime", "--json", "--journal"]).arg(bench.path("jobs"));
    let err = File::create(bench.path("err.txt")).expect("a file of the test");
    let mut child =
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(err).spawn().expect("the retrace command runs");
    std::io::Write::write_all(child.stdin.as_mut().expect("a pipe"), STOPS.as_bytes()).expect("it reads");
    let begun = Begun { bench: &bench, child };
    begun.until("err.txt", "M0 of line 3 waits; standard input is the program, not a keyboard: stop it with `kill ");
    pause(Duration::from_millis(500));
    begun.signal("-TERM");
    let mut begun = begun;
    let started = Instant::now();
    while begun.child.try_wait().expect("a child").is_none() {
        assert!(started.elapsed() < Duration::from_secs(30), "it ends: {}", begun.text("err.txt"));
        sleep(Duration::from_millis(5));
    }
    assert_eq!(begun.child.wait().expect("it has ended").code(), Some(4));
}

#[test]
fn a_job_in_the_background_waits_without_being_stopped_by_its_terminal() {
    let bench = stops();
    let line = format!(
        "$RETRACE run {} --realtime --no-tui --journal {} & PID=$!; sleep 4; kill -TERM $PID; wait $PID; echo code=$?",
        bench.path("stops.ngc").display(),
        bench.path("jobs").display(),
    );
    let mut terminal = Terminal::shell(&line, 200, 40);
    terminal.wait_for_text("M0 of line 3 waits; this command runs in the background: bring it to the foreground (fg)");
    terminal.keys("\n");
    terminal.wait_for_text("code=4");
    assert_eq!(terminal.wait_for_end(), Some(0));
}

#[test]
fn ctrl_c_sigterm_and_sighup_stop_work_by_hand() {
    let bench = Bench::new();
    let switch = "[[card.input]]\nnumber = 2\nuse = \"upper-limit\"\naxis = \"z\"\n";
    let axis = |name: &str, home: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = \
                100\nmax_acceleration_mm_per_s2 = 1000\n\
            max_jerk_mm_per_s3 = 20000\ntravel_mm = [-20, 900]\n{home}"
        )
    };
    let axes = axis("x", "") + &axis("y", "") + &axis("z", "home = { switch = \"upper\" }\n");
    bench.file("mill.toml", format!("homed = true\n{axes}[card]\nwatchdog_ms = 2000\n{switch}"));
    let machine = bench.path("mill.toml").display().to_string();
    let card = ServedCard::with(&["--machine", &machine]);
    let at = |axis: usize| card.identify(&bench)["counts"][axis].as_i64().expect("a count");
    let works =
        [(&["jog", "x", "800"][..], "-INT", 0), (&["mdi", "G1 Y800 F3000"], "-TERM", 1), (&["home", "z"], "-HUP", 2)];
    for (work, signal, axis) in works {
        let arguments = [work, &["--card", &card.port, "--machine", "mill.toml", "--json"]].concat();
        let begun = Begun::of(&bench, &arguments);
        pause(Duration::from_millis(2500));
        begun.signal(signal);
        begun.until("err.txt", "stopping: braking on the path, cutting outputs go off");
        let (code, report) = begun.ended();
        assert_eq!((code, report["outcome"].as_str()), (Some(4), Some("stopped")), "{work:?}: {report}");
        let who = card.identify(&bench);
        assert_eq!((&who["at_rest"], &who["alarm"]), (&Value::from(true), &Value::Null), "{who}");
        assert!((1..800_000).contains(&at(axis)), "{work:?} was on its way: {who}");
        assert_eq!(who["counts"][axis], report["position_counts"][["x", "y", "z"][axis]], "{who}");
    }
}
