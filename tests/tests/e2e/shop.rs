//! Jobs of a shop on one machine: submitted, taken, checked, started at the machine, and each cut once (SHP).

use std::collections::BTreeSet;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, CommandOutput, assert_contains};
use serde_json::Value;

const PART: &str = "G21 G90 G94 F3000\nG1 X20\nX25 Y5\nX0 Y0\nM2\n";
/// A program that takes a minute, so that nothing of it ends while a test looks at it.
const LONG_PART: &str = "G21 G90 G94 F600\nG1 X200\nX0\nX200\nM2\n";
/// A program with two errors.
const BAD: &str = "G1 X1 Q\n";

fn bench() -> Bench {
    let bench = Bench::new();
    bench.file("part.ngc", PART);
    bench.file("bad.ngc", BAD);
    bench
}

/// Standard output of a command that succeeds.
#[track_caller]
fn done(bench: &Bench, arguments: &[&str]) -> String {
    let result = bench.retrace(arguments);
    assert_eq!(result.code, Some(0), "{arguments:?}: {}\n{}", result.out, result.err);
    result.out
}

#[track_caller]
fn assert_refused(result: &CommandOutput, number: &str) {
    let is_refused = result.code == Some(2) && result.err.contains(&format!("error[{number}]"));
    assert!(is_refused && result.err.contains("help:"), "{number}: {}\n{}", result.out, result.err);
}

/// Submits a job. Returns its name.
fn submit(bench: &Bench, arguments: &[&str]) -> String {
    done(bench, &[&["shop", "submit"], arguments].concat()).trim().to_owned()
}

fn json(bench: &Bench, arguments: &[&str]) -> Value {
    serde_json::from_str(&done(bench, arguments)).expect("one object")
}

/// State, good pieces and ordered pieces of a job.
fn state(bench: &Bench, id: &str) -> (String, u64, u64) {
    let jobs = json(bench, &["shop", "jobs", "--json", "--all"]);
    let job = jobs["jobs"].as_array().expect("a list").iter().find(|job| job["id"] == id).expect("the job").clone();
    let number = |key: &str| job[key].as_u64().expect("a number");
    (job["state"].as_str().expect("a state").to_owned(), number("good"), number("quantity"))
}

fn is(state: &str, good: u64, quantity: u64) -> (String, u64, u64) {
    (state.to_owned(), good, quantity)
}

fn machine_folder(bench: &Bench) -> PathBuf {
    bench.path("state").join("retrace/shop/local")
}

/// The first file below a folder with this name.
fn file_below(folder: &Path, name: &str) -> PathBuf {
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("a folder") {
            let path = entry.expect("read").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.ends_with(name) {
                return path;
            }
        }
    }
    panic!("no {name} below {}", folder.display())
}

#[test]
fn a_job_is_submitted_checked_started_at_the_machine_and_done() {
    let bench = bench();
    bench.file("call.ngc", "o<part2> call\nM2\n");
    bench.file("part2.ngc", "o<part2> sub\nG0 X1\no<part2> endsub\n");
    let arguments = ["call.ngc", "part2.ngc", "--note", "burr inside", "--material", "steel 4 mm"];
    let id = submit(&bench, &[&arguments[..], &["--order", "4711/2"]].concat());
    assert_eq!(state(&bench, &id), is("queued", 0, 1));
    assert_refused(&bench.retrace(["run", "--job", &id]), "E5012");
    assert_contains(&done(&bench, &["shop", "agent", "--once"]), &["taken", "ready, no errors"]);
    assert_eq!(state(&bench, &id), is("ready", 0, 1));
    // what happens to the submitted files is no matter any more
    bench.file("call.ngc", BAD);
    assert_contains(&done(&bench, &["shop", "jobs"]), &["4711/2", "burr inside", "call.ngc", "0/1", "ready"]);
    assert_eq!(json(&bench, &["shop", "jobs", "--json"])["jobs"][0]["order_number"], "4711/2");
    assert_contains(&done(&bench, &["shop", "show", &id]), &["order      4711/2", "steel 4 mm", "retrace run --job"]);
    // a unique beginning of the name is enough
    done(&bench, &["run", "--job", &id[..20]]);
    assert_eq!(state(&bench, &id), is("done", 1, 1));
    assert_refused(&bench.retrace(["run", "--job", &id]), "E5013");
    assert_refused(&bench.retrace(["run", "--job", "f"]), "E5004");
    let shown = json(&bench, &["shop", "show", &id, "--json"]);
    assert_eq!((shown["runs"].as_array().map(Vec::len), &shown["runs"][0]["state"]), (Some(1), &"completed".into()));
    assert_eq!(shown["job"]["order_number"], "4711/2");
    assert_contains(&done(&bench, &["shop", "audit"]), &["1 jobs, 0 faults"]);
}

#[test]
fn a_job_with_errors_is_refused_with_its_diagnostics() {
    let bench = bench();
    let id = submit(&bench, &["bad.ngc"]);
    assert_contains(&done(&bench, &["shop", "agent", "--once"]), &["refused, 2 errors"]);
    assert_eq!(state(&bench, &id), is("refused", 0, 1));
    let shown = done(&bench, &["shop", "show", &id]);
    assert_contains(&shown, &["error[E1101]: line 1: Q is not followed by a value", "error[E1006]"]);
    assert_eq!(json(&bench, &["shop", "show", &id, "--json"])["check"]["errors"], 2);
    assert_refused(&bench.retrace(["run", "--job", &id]), "E5012");
    // where the check itself fails, the job stays unchecked
    bench.file("shop.toml", "root = \"other\"\nmachine_file = \"wrong.toml\"\n");
    bench.file("wrong.toml", "axis = 1\n");
    let other = ["--shop-file", "shop.toml"];
    submit(&bench, &["part.ngc", other[0], other[1]]);
    assert_refused(&bench.retrace(["shop", "agent", "--once", other[0], other[1]]), "E5016");
    assert_contains(&done(&bench, &["shop", "jobs", other[0], other[1]]), &["taken"]);
    fs::remove_file(bench.path("wrong.toml")).expect("deleted");
    bench.file("shop.toml", "root = \"other\"\n");
    assert_contains(&done(&bench, &["shop", "agent", "--once", other[0], other[1]]), &["ready"]);
}

#[test]
fn a_job_of_three_pieces_is_three_runs_and_scrap_does_not_count() {
    let bench = bench();
    let id = submit(&bench, &["part.ngc", "--quantity", "3"]);
    done(&bench, &["shop", "agent", "--once"]);
    for good in 1..=2 {
        done(&bench, &["run", "--job", &id]);
        assert_eq!(state(&bench, &id), is("ready", good, 3));
    }
    let runs = json(&bench, &["shop", "show", &id, "--json"])["runs"].clone();
    done(&bench, &["shop", "scrap", &id, runs[0]["id"].as_str().expect("a name")]);
    assert_refused(&bench.retrace(["shop", "scrap", &id, "20000101-000000-part"]), "E5020");
    for (good, expected) in [(2, "ready"), (3, "done")] {
        done(&bench, &["run", "--job", &id]);
        assert_eq!(state(&bench, &id), is(expected, good, 3));
    }
    assert_refused(&bench.retrace(["run", "--job", &id]), "E5013");
    assert_contains(&done(&bench, &["shop", "audit"]), &["0 faults"]);
}

#[test]
fn a_killed_run_is_interrupted_resumed_and_counted_once() {
    let bench = bench();
    bench.file("long.ngc", LONG_PART);
    let id = submit(&bench, &["long.ngc", "--quantity", "2"]);
    done(&bench, &["shop", "agent", "--once"]);
    let mut run = bench.start(&["run", "--job", &id, "--realtime", "--no-tui", "--json"], Stdio::null(), "killed.txt");
    let begun = Instant::now();
    while !fs::read_to_string(bench.path("killed.txt")).unwrap_or_default().contains("started") {
        assert!(begun.elapsed() < Duration::from_secs(50), "it begins");
        sleep(Duration::from_millis(1));
    }
    sleep(Duration::from_millis(300));
    assert_eq!(state(&bench, &id), is("running", 0, 2));
    assert_refused(&bench.retrace(["run", "--job", &id]), "E5012");
    assert_refused(&bench.retrace(["shop", "recall", &id]), "E5015");
    assert_refused(&bench.retrace(["shop", "give-up", &id]), "E5015");
    run.kill().expect("it is killed");
    run.wait().expect("it ends");
    assert_eq!(state(&bench, &id), is("interrupted", 0, 2));
    let refused = bench.retrace(["run", "--job", &id]);
    assert_refused(&refused, "E5012");
    assert_contains(&refused.err, &["retrace resume "]);
    assert_refused(&bench.retrace(["shop", "recall", &id]), "E5015");
    // nothing of the shop resumes it
    done(&bench, &["shop", "agent", "--once"]);
    assert_eq!(state(&bench, &id), is("interrupted", 0, 2));
    done(&bench, &["resume", "--yes"]);
    assert_eq!(state(&bench, &id), is("ready", 1, 2));
    done(&bench, &["run", "--job", &id]);
    assert_eq!(state(&bench, &id), is("done", 2, 2));
    let shown = json(&bench, &["shop", "show", &id, "--json"]);
    assert_eq!(shown["runs"].as_array().map(Vec::len), Some(2));
    // the ledger has the ends: the journals may be deleted
    fs::remove_dir_all(bench.path("state").join("retrace/jobs")).expect("deleted");
    assert_eq!(state(&bench, &id), is("done", 2, 2));
    assert_contains(&done(&bench, &["shop", "audit"]), &["1 jobs, 0 faults"]);
}

#[test]
fn an_agent_that_is_killed_at_any_moment_takes_each_job_once() {
    const JOBS: usize = 24;
    let bench = bench();
    let mut ids = BTreeSet::new();
    // a different program each time, so that no content is that of another job
    for number in 0..JOBS {
        let name = format!("part{number}.ngc");
        bench.file(&name, format!("{PART}(job {number})\n"));
        if number % 2 == 0 {
            ids.insert(submit(&bench, &[&name]));
        }
    }
    let (mut kills, mut random, mut ready) = (0, 0x2545_f491_4f6c_dd1d_u64, 0);
    // grows while a busy computer leaves an agent no time to do anything
    let mut longest_ms = 70;
    let begun = Instant::now();
    loop {
        let mut agent = bench.start(&["shop", "agent"], Stdio::null(), "agent.txt");
        // half of the jobs arrive while the agent works
        let next = (0..JOBS).find(|number| number % 2 == 1 && !bench.path(&format!("sent{number}")).exists());
        if let Some(number) = next {
            ids.insert(submit(&bench, &[&format!("part{number}.ngc")]));
            bench.file(&format!("sent{number}"), "");
        }
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        sleep(Duration::from_millis(random % longest_ms));
        agent.kill().expect("it is killed");
        agent.wait().expect("it ends");
        kills += 1;
        let jobs = json(&bench, &["shop", "jobs", "--json", "--all"]);
        let count = jobs["jobs"].as_array().expect("a list").iter().filter(|job| job["state"] == "ready").count();
        if count == JOBS && next.is_none() {
            break;
        }
        longest_ms = if count > ready { 70 } else { longest_ms * 5 / 4 };
        ready = count;
        assert!(begun.elapsed() < Duration::from_secs(300), "{ready} jobs are ready after {kills} kills");
    }
    done(&bench, &["shop", "agent", "--once"]);
    let audit = json(&bench, &["shop", "audit", "--json"]);
    let found: Vec<&str> =
        audit["jobs"].as_array().expect("a list").iter().filter_map(|job| job["id"].as_str()).collect();
    assert_eq!(found.len(), JOBS, "each job once, after {kills} kills");
    assert_eq!(found.into_iter().collect::<BTreeSet<_>>(), ids.iter().map(String::as_str).collect());
    assert_eq!(audit["faults"], Value::Array(Vec::new()));
    assert!(fs::read_dir(machine_folder(&bench).join("queue")).expect("a queue").next().is_none(), "it is empty");
    assert!(kills > JOBS / 2, "{kills} kills");
}

/// The agent reads programs in pieces: it takes one of 20 MB within its 64 MiB (SHP-2).
#[cfg(target_os = "linux")]
#[test]
fn an_agent_takes_a_large_program_in_little_memory() {
    let bench = bench();
    let block = "G1 X10.125 Y20.25 (a long program)\n";
    bench.file("large.ngc", format!("G21 G90 F3000\n{}M2\n", block.repeat(20_000_000 / block.len())));
    let id = submit(&bench, &["large.ngc"]);
    let mut agent = bench.start(&["shop", "agent"], Stdio::null(), "agent.txt");
    let status = PathBuf::from(format!("/proc/{}/status", agent.id()));
    let (begun, mut peak_kib) = (Instant::now(), 0);
    while state(&bench, &id).0 != "ready" {
        let text = fs::read_to_string(&status).expect("it runs");
        let peak = text.lines().find_map(|line| line.strip_prefix("VmHWM:")).expect("its peak");
        peak_kib = peak.trim().trim_end_matches(" kB").parse().expect("a number");
        assert!(begun.elapsed() < Duration::from_secs(120), "it is not taken");
        sleep(Duration::from_millis(50));
    }
    agent.kill().expect("it is killed");
    agent.wait().expect("it ends");
    assert!(peak_kib > 1_000 && peak_kib < 64 * 1024, "{peak_kib} KiB");
}

#[test]
fn what_is_not_begun_is_given_back() {
    let bench = bench();
    let [queued, ready, given_up] = [1, 2, 3].map(|_| submit(&bench, &["part.ngc"]));
    assert_refused(&bench.retrace(["shop", "give-up", &queued]), "E5015");
    done(&bench, &["shop", "recall", &queued]);
    done(&bench, &["shop", "agent", "--once"]);
    done(&bench, &["shop", "recall", &ready]);
    done(&bench, &["shop", "give-up", &given_up]);
    for (id, expected) in [(&queued, "returned"), (&ready, "returned"), (&given_up, "ended early")] {
        assert_eq!(state(&bench, id), is(expected, 0, 1));
        assert_refused(&bench.retrace(["run", "--job", id]), "E5012");
        assert_refused(&bench.retrace(["shop", "recall", id]), "E5015");
    }
    assert!(!machine_folder(&bench).join("inbox").join(&ready).exists());
    assert_contains(&done(&bench, &["shop", "audit"]), &["3 jobs, 0 faults"]);
}

#[test]
fn a_job_for_another_machine_file_is_a_warning_or_refused() {
    let bench = bench();
    bench.file("mill.toml", "control_period_ms = 1\n");
    let warned = submit(&bench, &["part.ngc", "--made-for", "mill.toml"]);
    let refused = submit(&bench, &["part.ngc", "--made-for", "mill.toml", "--only-made-for"]);
    done(&bench, &["shop", "agent", "--once"]);
    let result = bench.retrace(["run", "--job", &warned]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    assert_contains(&result.err, &["warning: job", "was made for another machine file"]);
    assert_refused(&bench.retrace(["run", "--job", &refused]), "E5014");
    let right = bench.retrace(["run", "--job", &refused, "--machine", "mill.toml"]);
    assert!(right.code == Some(0) && !right.err.contains("another machine file"), "{}", right.err);
}

#[test]
fn what_was_changed_behind_the_shop_is_found() {
    let bench = bench();
    let id = submit(&bench, &["part.ngc"]);
    done(&bench, &["shop", "agent", "--once"]);
    let program = file_below(&machine_folder(&bench).join("inbox"), "part.ngc");
    fs::write(&program, "G0 X99\nM2\n").expect("written");
    assert_refused(&bench.retrace(["run", "--job", &id]), "E5006");
    assert_refused(&bench.retrace(["shop", "audit"]), "E5019");
    fs::write(&program, PART).expect("written");
    assert_contains(&done(&bench, &["shop", "audit"]), &["0 faults"]);
    // a run of the file that no ledger knows
    done(&bench, &["run", &program.display().to_string()]);
    let result = bench.retrace(["shop", "audit"]);
    assert_refused(&result, "E5019");
    assert_contains(&result.out, &["no ledger knows it"]);
    let ledger = machine_folder(&bench).join("inbox/ledger");
    let text = fs::read_to_string(&ledger).expect("a ledger");
    fs::write(&ledger, text.replacen("part.ngc", "evil.ngc", 1)).expect("written");
    for command in [vec!["shop", "jobs"], vec!["shop", "agent", "--once"], vec!["run", "--job", &id]] {
        assert_refused(&bench.retrace(&command), "E5009");
    }
}

#[test]
fn what_cannot_be_submitted_is_refused_with_its_number() {
    let bench = bench();
    for (arguments, number) in [
        (vec!["part.ngc", "--machine", "Mill"], "E5002"),
        (vec!["part.ngc", "--machine", "mill"], "E5003"),
        (vec!["part.ngc", "part.ngc"], "E5005"),
        (vec!["missing.ngc"], "E5010"),
        (vec!["part.ngc", "--quantity", "0"], "E5006"),
        (vec!["part.ngc", "--order", "47\n11"], "E5006"),
        (vec!["part.ngc", "--note", "two\nlines"], "E5006"),
    ] {
        assert_refused(&bench.retrace([&["shop", "submit"], &arguments[..]].concat()), number);
    }
    assert_contains(&done(&bench, &["shop", "jobs"]), &["machine local has no jobs"]);
    bench.file("wrong.toml", "nam = \"mill\"\n");
    let result = bench.retrace(["shop", "jobs", "--shop-file", "wrong.toml"]);
    assert_refused(&result, "E5001");
    assert_contains(&result.err, &["did you mean `name`?"]);
    // an inbox of 100 bytes takes one of two jobs; the other one waits
    bench.file("small.toml", "root = \"small\"\ninbox_gib = 0.0000001\n");
    let small = ["--shop-file", "small.toml"];
    for _ in 0..2 {
        submit(&bench, &["part.ngc", small[0], small[1]]);
        sleep(Duration::from_millis(2));
    }
    bench.file("long.ngc", format!("{PART}{}", "(a comment)\n".repeat(10)));
    submit(&bench, &["long.ngc", small[0], small[1]]);
    let result = bench.retrace(["shop", "agent", "--once", small[0], small[1]]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    assert_contains(&result.err, &["error[E5008]", "the job waits"]);
    assert_contains(&done(&bench, &["shop", "jobs", small[0], small[1]]), &["queued"]);
}

#[test]
fn serve_begins_with_no_job_of_the_shop_and_a_job_needs_its_journal() {
    let bench = bench();
    let id = submit(&bench, &["part.ngc"]);
    done(&bench, &["shop", "agent", "--once"]);
    assert_refused(&bench.retrace(["serve", "--job", &id]), "E5012");
    for option in ["--serve", "--no-journal", "--dry-run", "part.ngc"] {
        let result = bench.retrace(["run", "--job", &id, option]);
        assert_eq!(result.code, Some(2), "{option}: {}", result.out);
        assert_contains(&result.err, &["cannot be used with"]);
    }
    assert_eq!(state(&bench, &id), is("ready", 0, 1));
}

#[test]
fn files_of_a_watched_folder_become_jobs_each_once() {
    let bench = bench();
    bench.file("shop.toml", "root = \"data\"\n[watch]\npath = \"in\"\nready_file = true\n");
    let file = ["--shop-file", "shop.toml"];
    fs::create_dir(bench.path("in")).expect("a folder");
    for name in ["a.ngc", "b.ngc", "b.ngc.ready", "a.ngc.ready"] {
        bench.file(&format!("in/{name}"), if name.ends_with("ready") { "" } else { PART });
    }
    done(&bench, &["shop", "agent", "--once", file[0], file[1]]);
    bench.file("in/a.ngc", PART);
    bench.file("in/a.ngc.ready", "");
    let result = bench.retrace(["shop", "agent", "--once", file[0], file[1]]);
    assert!(result.code == Some(0) && result.err.contains("error[E5017]"), "{}", result.err);
    let listed = json(&bench, &["shop", "jobs", "--json", file[0], file[1]]);
    let ready = listed["jobs"].as_array().expect("a list").iter().filter(|job| job["state"] == "ready").count();
    assert_eq!(ready, 2, "{listed}");
    assert_eq!(fs::read_dir(bench.path("in/done")).expect("a folder").count(), 2);
    assert_eq!(fs::read_dir(bench.path("in/failed")).expect("a folder").count(), 1);
    assert_eq!(fs::read_dir(bench.path("in")).expect("a folder").count(), 2, "nothing else is left");
    // one agent is enough
    let mut agent = bench.start(&["shop", "agent", file[0], file[1]], Stdio::null(), "agent.txt");
    let id = submit(&bench, &["part.ngc", file[0], file[1]]);
    let begun = Instant::now();
    while !done(&bench, &["shop", "show", &id, file[0], file[1]]).contains("ready") {
        assert!(begun.elapsed() < Duration::from_secs(50), "the agent takes it");
        sleep(Duration::from_millis(20));
    }
    let second = bench.retrace(["shop", "agent", "--once", file[0], file[1]]);
    agent.kill().expect("it is killed");
    agent.wait().expect("it ends");
    assert_refused(&second, "E5011");
}

/// A FIFO in the watched folder: a job for each writer, in their order, and nothing of it is started. One without a
/// writer, and one whose writer is silent, hold nothing up.
#[test]
fn a_fifo_of_the_watched_folder_is_a_job_for_each_writer() {
    let bench = bench();
    bench.file("shop.toml", "root = \"data\"\n[watch]\npath = \"in\"\nready_file = true\n");
    let file = ["--shop-file", "shop.toml"];
    fs::create_dir(bench.path("in")).expect("a folder");
    let fifos = ["in/cam.ngc", "in/silent.ngc"].map(|name| bench.path(name));
    assert!(Command::new("mkfifo").args(&fifos).status().expect("mkfifo").success());
    let [fifo, silent] = fifos;
    let path = fifo.to_str().expect("a name");
    for refused in [["check", path].as_slice(), &["shop", "submit", path, file[0], file[1]]] {
        assert_eq!(bench.retrace(refused).code, Some(2), "{refused:?}");
    }
    // nobody writes: the agent has nothing to do
    let _ = done(&bench, &["shop", "agent", "--once", file[0], file[1]]);
    let mut agent = bench.start(&["shop", "agent", file[0], file[1]], Stdio::null(), "agent.txt");
    let mut held = fs::File::options().write(true).open(silent).expect("the agent reads");
    held.write_all(b"G1 X1\n").expect("it is read");
    for _ in 0..3 {
        fs::write(&fifo, PART).expect("it is read to its end");
    }
    fs::write(&fifo, "%\nM2\n%\n%\nM2\n%\n").expect("it is read to its end");
    let listed = || json(&bench, &["shop", "jobs", "--json", file[0], file[1]]);
    let begun = Instant::now();
    let is_ready = |job: &Value| job["state"] == "ready" && job["program"].to_string().contains("cam-");
    while listed()["jobs"].as_array().expect("a list").iter().filter(|job| is_ready(job)).count() < 3 {
        assert!(begun.elapsed() < Duration::from_secs(50), "{}", listed());
        sleep(Duration::from_millis(50));
    }
    sleep(Duration::from_millis(1500));
    let jobs = listed();
    assert_eq!(jobs["jobs"].as_array().expect("a list").len(), 3, "{jobs}");
    assert_eq!(bench.retrace(["jobs"]).out.lines().filter(|line| line.contains("cam-")).count(), 0, "no run");
    agent.kill().expect("it is killed");
    agent.wait().expect("it ends");
    // the agent is gone, and the next one deletes what its writer has not finished
    assert!(held.write_all(b"M2\n").is_err());
    let _ = done(&bench, &["shop", "agent", "--once", file[0], file[1]]);
    assert_eq!(listed()["jobs"].as_array().expect("a list").len(), 3);
    let errors = bench.retrace(["shop", "agent", "--once", file[0], file[1]]);
    assert_eq!(errors.err, "");
    assert!(!bench.path("in/.silent.ngc.part").exists(), "deleted");
}

#[test]
fn a_series_of_pieces_is_run_where_the_job_permits_it_and_ends_with_a_bad_one() {
    let bench = bench();
    let single = submit(&bench, &["part.ngc", "--quantity", "3"]);
    let series = submit(&bench, &["part.ngc", "--quantity", "4", "--may-repeat"]);
    let _ = done(&bench, &["shop", "agent", "--once"]);
    let run = |id: &str, pieces: &str| bench.retrace(["run", "--job", id, "--repeat", pieces]);
    assert_refused(&run(&single, "2"), "E5043");
    assert_refused(&run(&series, "5"), "E5043");
    assert_refused(&run(&series, "0"), "E5043");
    assert_eq!((state(&bench, &single), state(&bench, &series)), (is("ready", 0, 3), is("ready", 0, 4)));
    let two = run(&series, "2");
    assert_eq!(two.code, Some(0), "{}", two.err);
    assert_contains(&two.err, &["piece 1 of 2", "piece 2 of 2"]);
    assert_eq!(state(&bench, &series), is("ready", 2, 4));
    assert_eq!(run(&single, "1").code, Some(0), "one piece is no series");
    // the second piece of a series that is stopped is the last one
    let mut child = bench.start(&["run", "--job", &series, "--repeat", "2", "--json"], Stdio::null(), "told.txt");
    let begun = Instant::now();
    while state(&bench, &series).1 < 3 && begun.elapsed() < Duration::from_secs(20) {
        sleep(Duration::from_millis(1));
    }
    child.kill().expect("it is killed");
    child.wait().expect("it ends");
    let (_, good, _) = state(&bench, &series);
    assert!((3..=4).contains(&good), "{good}");
    let _ = done(&bench, &["shop", "audit"]);
}

/// A cycle that the program calls goes with the job; without it the job is refused, and a changed one is found.
#[test]
fn a_job_brings_its_cycles() {
    let bench = bench();
    bench.file("row.ngc", "G21 G90 G94 F6000\nMARK(12)\nM2\n");
    bench.file("MARK.SPF", "PROC MARK(REAL LENGTH)\nG1 G90 AX[1]=LENGTH\nM17\n");
    let without = submit(&bench, &["row.ngc"]);
    let id = submit(&bench, &["row.ngc", "MARK.SPF", "--quantity", "2"]);
    done(&bench, &["shop", "agent", "--once"]);
    assert_eq!((state(&bench, &without), state(&bench, &id)), (is("refused", 0, 1), is("ready", 0, 2)));
    assert_contains(&done(&bench, &["run", "--job", &id]), &["position X 12.000"]);
    assert_eq!(state(&bench, &id), is("ready", 1, 2));
    let stored = file_below(&machine_folder(&bench), "MARK.SPF");
    fs::write(stored, "PROC MARK(REAL LENGTH)\nG1 G90 AX[1]=2*LENGTH\nM17\n").expect("written");
    assert_refused(&bench.retrace(["run", "--job", &id]), "E5006");
}
