//! Drip feed from a socket that stalls, is cut and reconnected: bounded memory, exact counts, and a stop on the path
//! when no data arrive.

use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::thread::sleep;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, binary, cases};
use retrace_tests::run::Run;
use retrace_tests::sender::{SenderFaults, TestRandom, send};
use serde_json::Value;

/// Longest duration of a run; one of a million lines in the tests' own profile on a busy machine.
const PATIENCE: Duration = Duration::from_secs(900);

/// The most memory that a run may have taken, in MiB (DNC campaign): 27.5 of them are half an hour's history.
const MAX_MIB: f64 = 48.0;

/// The seed of the campaign.
fn seed() -> u64 {
    std::env::var("RETRACE_FIRST_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(1)
}

/// A program of `lines` lines, most of them 0.2 mm long at 100 mm/s, on a curve, with some switching, dwells and
/// corners.
fn long_program(lines: u32) -> Vec<u8> {
    let mut text = String::from("%\nG21 G90 G17 G64 P0.01\nS9000 M3\nF6000\nG0 X100 Y0\n");
    for k in 1..lines {
        let angle = f64::from(k) * 0.002;
        let radius = 100.0 - 20.0 * (angle * 0.37).sin().abs();
        let (x, y) = (radius * angle.cos(), radius * angle.sin());
        let _ = match k % 1000 {
            0 => writeln!(text, "M6{} P{}", 2 + k / 1000 % 2, k / 1000 % 5),
            500 if k % 5000 == 500 => writeln!(text, "G4 P0.05"),
            _ => writeln!(text, "G1 X{x:.3} Y{y:.3}"),
        };
    }
    text.push_str("G0 X0 Y0\nM5\nM2\n%\n");
    text.into_bytes()
}

/// Runs the command to its end; returns its report, and the reported pauses.
fn run(bench: &Bench, program: &str, more: &[&str]) -> (Value, Vec<Value>) {
    let (out, err) = (bench.path("out.jsonl"), bench.path("err.txt"));
    let file = |path: &Path| std::fs::File::create(path).expect("a file of the test");
    let mut command = Command::new(binary());
    command.args(["run", program, "--json"]).args(more).stdin(Stdio::null()).stdout(file(&out)).stderr(file(&err));
    command.env("XDG_STATE_HOME", bench.path("state"));
    let mut child = command.spawn().expect("the retrace command runs");
    let started = Instant::now();
    while child.try_wait().expect("a child").is_none() {
        if started.elapsed() > PATIENCE {
            let _ = child.kill();
            let _ = child.wait();
            panic!("it did not end in time");
        }
        sleep(Duration::from_millis(20));
    }
    let result = std::fs::read_to_string(&out).unwrap_or_default();
    let err = std::fs::read_to_string(&err).unwrap_or_default();
    let last = result.lines().last().unwrap_or_else(|| panic!("no report: {err}"));
    let report: Value = serde_json::from_str(last).expect("JSON");
    assert_eq!((&report["event"], &report["outcome"]), (&"report".into(), &"completed".into()), "{err}\n{last}");
    assert_eq!((&report["limit_violations"], &report["underruns"]), (&0.into(), &0.into()), "{report}");
    for axis in ["x", "y", "z"] {
        let of = |what: &str| report[what][axis].as_f64().unwrap_or_else(|| panic!("{what}: {report}"));
        assert_eq!(of("position_counts"), (of("commanded_mm") * of("pulses_per_mm")).round(), "{report}");
    }
    let told = result.lines().map(|line| serde_json::from_str::<Value>(line).expect("JSON"));
    let of_pauses =
        |event: &Value| ["paused", "arrived", "command_rejected"].contains(&event["event"].as_str().unwrap_or(""));
    (report, told.filter(of_pauses).collect())
}

/// Runs the program as a file and from a bad sender, with these arguments: it ends at the same counts, in bounded
/// memory.
fn as_file_and_from_a_sender(bench: &Bench, lines: u32, arguments: &[&str]) -> Vec<Value> {
    let text = long_program(lines);
    let file = bench.file("long.ngc", &text);
    let (whole, _) = run(bench, &file.to_string_lossy(), &[]);
    let mut chance = TestRandom::new(seed());
    let cuts = 3 + (lines / 50_000) as usize;
    let mut trouble = SenderFaults::anywhere(&mut chance, text.len(), cuts, 4 * cuts, 250);
    // behind the first line, which has the form of a program's last one
    trouble.cuts.insert(0, 2);
    let (sent, told) = run(bench, &send(Arc::new(text), trouble), arguments);
    for same in ["position_counts", "commanded_mm", "blocks", "canonical"] {
        assert_eq!(sent[same], whole[same], "{same}");
    }
    let mib = [&whole, &sent].map(|report| report["peak_rss_mib"].as_f64().unwrap_or(0.0));
    let s = [&whole, &sent].map(|report| report["wall_s"].as_f64().unwrap_or(0.0));
    println!(
        "{lines} lines, {} periods: {:.1} MiB, {:.1} s from the sender, {:.1} MiB, {:.1} s as a file",
        sent["periods"], mib[1], s[1], mib[0], s[0]
    );
    assert!(mib[1] <= MAX_MIB, "{} MiB: {sent}", mib[1]);
    told
}

#[test]
fn from_a_socket_that_stalls_and_is_cut_it_ends_as_from_a_file_in_bounded_memory() {
    as_file_and_from_a_sender(&Bench::new(), cases(20_000), &[]);
}

#[test]
fn paused_at_any_moment_it_is_taken_up_where_it_was_left_and_ends_at_the_same_counts() {
    let (bench, lines) = (Bench::new(), cases(20_000));
    let mut chance = TestRandom::new(seed() ^ 0xD0C);
    // two milliseconds per line
    let pauses = 4 + lines as usize / 20_000;
    let gap_ms = lines as usize * 3 / 2 / pauses;
    let mut script = String::new();
    for _ in 0..pauses {
        let [wait, axis, mm] = [chance.below(gap_ms) + 500, chance.below(3), chance.below(200)];
        let mm = mm as f64 / 10.0 - if axis == 2 { 0.0 } else { 10.0 };
        let _ = writeln!(
            script,
            "after {}s pause\nafter 1s spindle stop\nafter 0s jog z 5\nafter 1.5s jog {} {mm}\nafter 1.5s spindle \
                start\n\
             after 0s online\nafter 0s cycle start\nafter 3s override 100%",
            wait as f64 / 1000.0,
            ["x", "y", "z"][axis],
        );
    }
    let script = bench.file("pauses.op", script);
    let told = as_file_and_from_a_sender(&bench, lines, &["--operator", &script.to_string_lossy()]);
    let of = |kind: &str| -> Vec<&Value> { told.iter().filter(|event| event["event"] == kind).collect() };
    let (paused, arrived) = (of("paused"), of("arrived"));
    assert_eq!((paused.len(), arrived.len(), of("command_rejected").len()), (pauses, pauses, 0), "{told:?}");
    for (left, back) in paused.into_iter().zip(arrived) {
        for same in ["record", "fraction", "line"] {
            assert_eq!(left[same], back[same], "{left} {back}");
        }
    }
}

/// Positions of the axes behind each record, in a run at rate 1.
fn positions(run: &Run) -> Vec<[i64; 3]> {
    let mut at = [0; 3];
    let mut positions = vec![at];
    for row in &run.records.rows {
        at.iter_mut().zip(&row.increments).for_each(|(at, increment)| *at += increment);
        if row.record as usize == positions.len() {
            positions.push(at);
        }
    }
    positions
}

#[test]
fn when_the_feed_dries_up_the_machine_stops_on_the_path_and_goes_on_when_it_comes_again() {
    // 60 lines a second, each at an angle with the next
    let mut text = String::from("G21 G90 G64 P0.01\nF1800\n");
    for k in 1..=240 {
        let _ = writeln!(text, "G1 X{:.1} Y0.0{}", f64::from(k) / 2.0, 2 * (k % 2));
    }
    text.push_str("M2\n");
    let at = |line: &str| text.find(line).expect("a line of it");
    // no data for longer than the received part lasts, also where a loaded computer begins late: within a line, and
    // between two; then it is cut
    let trouble = SenderFaults {
        cuts: vec![at("G1 X105.0") + 4],
        goes_away: true,
        stalls: vec![(at("G1 X60.0") + 4, Duration::from_secs(6)), (at("G1 X90.0"), Duration::from_secs(5))],
    };
    let bench = Bench::new();
    let path = positions(&Run::of(&bench, &bench.file("whole.ngc", &text), &[]));
    let program = send(Arc::new(text.into_bytes()), trouble);
    let run = Run::of(&bench, Path::new(&program), &["--realtime", "--no-tui"]);
    run.assert_exact_and_legal();
    assert_eq!(run.counts(), [120_000, 0, 0]);
    assert!(run.number("underruns") >= 1.0, "{}", run.report);
    let (mut counts, mut stood) = ([0; 3], std::collections::BTreeMap::<u64, u32>::new());
    for row in &run.records.rows {
        counts.iter_mut().zip(&row.increments).for_each(|(count, increment)| *count += increment);
        let [before, behind] =
            [row.record as usize, row.record as usize + usize::from(row.fraction > 0)].map(|n| path[n]);
        let is_on_it = (0..3).all(|axis| {
            let ends = [before[axis], behind[axis]];
            (ends[0].min(ends[1])..=ends[0].max(ends[1])).contains(&counts[axis])
        });
        assert!(is_on_it, "{counts:?} between {before:?} and {behind:?}: {row:?}");
        if row.rate_nano == 0 && (1..path.len() - 1).contains(&(row.record as usize)) {
            *stood.entry(row.record).or_default() += 1;
        }
    }
    assert!(stood.values().filter(|&&periods| periods > 500).count() >= 1, "{stood:?}");
}
