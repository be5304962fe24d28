//! Files that persist between commands: who may read them, which links are not followed, and how names are shown.

use std::fs;
use std::os::unix::ffi::OsStringExt;
use std::os::unix::fs::{MetadataExt, symlink};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::sleep;
use std::time::Duration;

use retrace_tests::command::Bench;
use retrace_tests::served::ServedCard;
use serde_json::Value;

/// Modes of everything below a folder that are not 700 or 600.
fn open_to_others(folder: &Path, found: &mut Vec<String>) {
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        let of = fs::symlink_metadata(&path).expect("there");
        let expected = if of.is_dir() { 0o700 } else { 0o600 };
        if of.mode() & 0o777 != expected {
            found.push(format!("{:o} {}", of.mode() & 0o777, path.display()));
        }
        if of.is_dir() {
            open_to_others(&path, found);
        }
    }
}

/// One card at a time: a host whose line was lost opens the port of that name again, which may be the next card's by
/// then.
fn one_card() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

#[test]
fn state_files_are_private() {
    let _alone = one_card();
    let (bench, card) = (Bench::new(), ServedCard::with(&[]));
    bench.file("mill.toml", "[card]\nwatchdog_ms = 2000\n");
    bench.file("part.ngc", "G21 G90 F3000\nG10 L2 P1 X1\nG1 X3\nM2\n");
    let result = bench.retrace(["run", "part.ngc", "--card", &card.port, "--machine", "mill.toml"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    let result = bench.retrace_reading(["run", "-"], b"G21 G90 F3000\nG1 X3\nM2\n");
    assert_eq!(result.code, Some(0), "{}", result.err);
    let mut found = Vec::new();
    open_to_others(&bench.path("state"), &mut found);
    assert_eq!(found, [""; 0]);
    assert!(bench.path("state/retrace/machines").is_dir() && bench.path("state/retrace/jobs").is_dir());
}

/// The folder of the newest job.
fn newest(bench: &Bench) -> std::path::PathBuf {
    let jobs = fs::read_dir(bench.path("state/retrace/jobs")).expect("a folder");
    jobs.map(|entry| entry.expect("an entry").path()).max().expect("a job")
}

fn stopped(bench: &Bench, program: &str) {
    bench.file("stop.op", "at line 3 stop\n");
    bench.file(program, "G21 G90 F600\nG1 X3\nG1 X20\nM2\n");
    assert_eq!(bench.retrace(["run", program, "--operator", "stop.op"]).code, Some(4));
}

#[test]
fn a_lock_that_is_a_link_is_not_followed() {
    let bench = Bench::new();
    stopped(&bench, "part.ngc");
    let precious = bench.file("precious", "keep me");
    let lock = newest(&bench).join("lock");
    fs::remove_file(&lock).expect("a lock");
    symlink(&precious, &lock).expect("a link");
    let result = bench.retrace(["resume", "--yes"]);
    assert!(
        result.code == Some(2) && result.err.contains("E2105") && result.err.contains("not followed"),
        "{}",
        result.err
    );
    assert_eq!(fs::read_to_string(precious).expect("there"), "keep me");
}

#[test]
fn a_damaged_journal_is_named() {
    let bench = Bench::new();
    stopped(&bench, "older.ngc");
    sleep(Duration::from_millis(1100));
    stopped(&bench, "newer.ngc");
    let folder = newest(&bench);
    let mut bytes = fs::read(folder.join("journal")).expect("a journal");
    // Its first line; there is more behind it, so that something has moved.
    bytes[40] ^= 1;
    fs::write(folder.join("journal"), bytes).expect("written");
    let id = folder.file_name().expect("a name").to_string_lossy().into_owned();
    let result = bench.retrace(["resume", "--yes"]);
    assert!(result.code == Some(2) && result.err.contains("E2203") && result.err.contains(&id), "{}", result.err);
    assert!(result.err.contains("damaged") && !result.err.contains("E2209"), "{}", result.err);
    // An older job can still be named.
    let jobs: Value = serde_json::from_str(&bench.retrace(["jobs", "--json"]).out).expect("JSON");
    let older = jobs["jobs"].as_array().expect("a list").iter().find(|job| job["state"] == "stopped").expect("a job");
    let result = bench.retrace(["resume", older["id"].as_str().expect("a name"), "--yes"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
}

#[test]
fn names_and_messages_steer_no_terminal() {
    let bench = Bench::new();
    let name = std::ffi::OsString::from_vec(b"pa\x1b]0;x\x07rt\n.ngc".to_vec());
    fs::write(bench.path("").join(&name), "G21 G90 F600\n(MSG, hal\u{9b}2Jlo\u{9d}31m)\nG1 X3\nM2\n").expect("a file");
    for json in [false, true] {
        let mut arguments = vec!["run".as_ref(), name.as_os_str()];
        if json {
            arguments.push("--json".as_ref());
        }
        let result = bench.retrace(arguments);
        assert_eq!(result.code, Some(0), "{}", result.err);
        let is_raw = |c: char| c.is_control() && c != '\n';
        assert!(!result.out.contains(is_raw) && !result.err.contains(is_raw), "{:?}\n{:?}", result.out, result.err);
        assert!(result.out.contains("\\u001b") && result.out.contains("\\u009b"), "{}", result.out);
        if json {
            result.out.lines().for_each(|line| drop(serde_json::from_str::<Value>(line).expect("JSON")));
        }
    }
    fs::write(bench.path("").join(&name), "G21 G90 F600\n(\x1b[2J) G77\nM2\n").expect("a file");
    for command in ["run", "check"] {
        let result = bench.retrace([command.as_ref(), name.as_os_str()]);
        assert!(
            result.code == Some(1) && !result.err.contains('\x1b') && !result.out.contains('\x1b'),
            "{:?}",
            result.err
        );
    }
    let result = bench.retrace(["jobs"]);
    assert!(!result.out.contains('\x1b') && result.out.lines().count() <= 3, "{:?}", result.out);
}

#[test]
fn after_a_lost_line_nothing_is_reported_that_was_not_measured() {
    let _alone = one_card();
    let (bench, card) = (Bench::new(), ServedCard::with(&[]));
    bench.file("mill.toml", "[card]\nwatchdog_ms = 2000\n");
    bench.file("part.ngc", "G21 G90 F5000\nG1 X200\nG1 X0\nM2\n");
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "mill.toml", "--json"];
    let mut child = bench.start(&run, std::process::Stdio::null(), "said.txt");
    let text = || fs::read_to_string(bench.path("said.txt")).unwrap_or_default();
    while !text().contains("started") {
        sleep(Duration::from_millis(2));
    }
    sleep(Duration::from_millis(900));
    drop(card);
    let code = child.wait().expect("it ends").code();
    let report: Value = serde_json::from_str(text().lines().last().unwrap_or_default()).expect("a report");
    assert_eq!((code, report["outcome"].as_str()), (Some(3), Some("alarm")), "{report}");
    assert_eq!((&report["position_counts"], &report["position_mm"]), (&Value::Null, &Value::Null), "{report}");
    assert!(report["position_note"].as_str().is_some_and(|note| note.contains("not confirmed")), "{report}");
    assert_eq!(report["limit_violations"], 0, "no standstill is made up: {report}");
    assert!(report["max_velocity"]["x"].as_f64().is_some_and(|v| v > 80.0), "it was moving: {report}");
}

#[test]
fn who_shows_outputs_and_alarms() {
    let _alone = one_card();
    let bench = Bench::new();
    bench.file("stop.toml", "[card]\nwatchdog_ms = 2000\n[[card.input]]\nnumber = 13\nuse = \"emergency-stop\"\n");
    let machine = bench.path("stop.toml").display().to_string();
    let mut card = ServedCard::with(&["--machine", &machine]);
    bench.file("on.ngc", "G21 G90 F3000\nM64 P5\nG1 X3\nM2\n");
    let run = ["run", "on.ngc", "--card", &card.port.clone(), "--machine", "stop.toml"];
    let who = card.identify(&bench);
    assert_eq!((&who["outputs_on"], &who["alarm"]), (&serde_json::json!([]), &Value::Null), "{who}");
    assert_eq!(bench.retrace(run).code, Some(0));
    let result = bench.retrace(["card", "identify", &card.port, "--machine", "stop.toml"]);
    assert!(result.out.contains("outputs output 5 1") && result.out.contains("no alarm"), "{}", result.out);
    let who = card.identify(&bench);
    assert_eq!(who["outputs_on"], serde_json::json!([{"channel": 5, "value": 1}]), "{who}");
    card.operate("press emergency-stop");
    assert_eq!(bench.retrace(run).code, Some(3));
    let result = bench.retrace(["card", "identify", &card.port]);
    assert!(result.out.contains("alarm[E3012]") && result.out.contains("outputs"), "{}", result.out);
}
