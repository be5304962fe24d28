//! Drip feed from a socket that stalls, is cut and comes again: bounded memory, exact counts, and a stop on the path when it dries up.

use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::thread::sleep;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, binary, cases};
use retrace_tests::run::Run;
use retrace_tests::sender::{Chance, Trouble, send};
use serde_json::Value;

/// How long a run may take; one of a million lines in the tests' own profile on a busy machine.
const PATIENCE: Duration = Duration::from_secs(900);

/// The most memory that a run may have taken, in MiB (DNC campaign): 27.5 of them are half an hour's history.
const MOST_MIB: f64 = 48.0;

/// The seed of the campaign.
fn seed() -> u64 {
    std::env::var("RETRACE_FIRST_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(1)
}

/// A program of so many lines, most of them 0.2 mm long at 100 mm/s, on a curve, with switching, dwells and corners now and then.
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

/// Runs the command to its report.
fn report(bench: &Bench, program: &str, more: &[&str]) -> Value {
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
    let said = std::fs::read_to_string(&out).unwrap_or_default();
    let err = std::fs::read_to_string(&err).unwrap_or_default();
    let last = said.lines().last().unwrap_or_else(|| panic!("no report: {err}"));
    let report: Value = serde_json::from_str(last).expect("JSON");
    assert_eq!((&report["event"], &report["outcome"]), (&"report".into(), &"completed".into()), "{err}\n{last}");
    assert_eq!((&report["limit_violations"], &report["underruns"]), (&0.into(), &0.into()), "{report}");
    for axis in ["x", "y", "z"] {
        let of = |what: &str| report[what][axis].as_f64().unwrap_or_else(|| panic!("{what}: {report}"));
        assert_eq!(of("position_counts"), (of("commanded_mm") * of("pulses_per_mm")).round(), "{report}");
    }
    report
}

/// The same as a file and from a bad sender, with these arguments: ends at the same counts, in bounded memory.
fn as_file_and_from_a_sender(lines: u32, arguments: &[&str]) -> Value {
    let bench = Bench::new();
    let text = long_program(lines);
    let file = bench.file("long.ngc", &text);
    let whole = report(&bench, &file.to_string_lossy(), &[]);
    let mut chance = Chance::new(seed());
    let cuts = 3 + (lines / 50_000) as usize;
    let mut trouble = Trouble::anywhere(&mut chance, text.len(), cuts, 4 * cuts, 250);
    // behind the first line, which is how a program's last one looks
    trouble.cuts.insert(0, 2);
    let sent = report(&bench, &send(Arc::new(text), trouble), arguments);
    for same in ["position_counts", "commanded_mm", "blocks", "canonical"] {
        assert_eq!(sent[same], whole[same], "{same}");
    }
    let mib = [&whole, &sent].map(|report| report["peak_rss_mib"].as_f64().unwrap_or(0.0));
    let s = [&whole, &sent].map(|report| report["wall_s"].as_f64().unwrap_or(0.0));
    println!(
        "{lines} lines, {} periods: {:.1} MiB, {:.1} s from the sender, {:.1} MiB, {:.1} s as a file",
        sent["periods"], mib[1], s[1], mib[0], s[0]
    );
    assert!(mib[1] <= MOST_MIB, "{} MiB: {sent}", mib[1]);
    sent
}

#[test]
fn from_a_socket_that_stalls_and_is_cut_it_ends_as_from_a_file_in_bounded_memory() {
    as_file_and_from_a_sender(cases(20_000), &[]);
}

#[test]
fn when_the_feed_dries_up_the_machine_stops_on_the_path_and_goes_on_when_it_comes_again() {
    let bench = Bench::new();
    // 25 mm/s along X and round a corner, a line every 40 ms
    let mut text = String::from("G21 G90 G64 P0.01\nF1500\n");
    for k in 1..=80 {
        let _ = if k <= 50 { writeln!(text, "G1 X{k}") } else { writeln!(text, "G1 Y{}", k - 50) };
    }
    text.push_str("M2\n");
    let at = |line: &str| text.find(line).expect("a line of it");
    // nothing for longer than what is planned ahead lasts; then it is cut, and comes again in time or not
    let trouble = Trouble {
        cuts: vec![at("G1 Y10\n") + 4],
        goes_away: true,
        stalls: vec![(at("G1 X20\n") + 3, Duration::from_millis(2500)), (at("G1 X40\n"), Duration::from_millis(2500))],
    };
    let program = send(Arc::new(text.into_bytes()), trouble);
    let run = Run::of(&bench, Path::new(&program), &["--realtime", "--no-tui"]);
    run.assert_exact_and_legal();
    assert_eq!(run.counts(), [50_000, 30_000, 0]);
    // it stood and waited, though not as long as the sender: what was there already was run first
    let waiting_s = run.number("waiting_s");
    assert!((2.0..8.0).contains(&waiting_s), "{}", run.report);
    // where it stood, on the straight line
    let (mut x, mut stood, mut y) = (0, std::collections::BTreeMap::<i64, u32>::new(), 0);
    for row in &run.records.rows {
        x += row.increments[0];
        y += row.increments[1];
        if row.rate_nano == 0 && (1_000..50_000).contains(&x) {
            assert_eq!(y, 0, "on the path");
            *stood.entry(x).or_default() += 1;
        }
    }
    assert!(stood.values().filter(|&&periods| periods > 500).count() >= 2, "{stood:?}");
}
