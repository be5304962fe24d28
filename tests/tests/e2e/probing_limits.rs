//! Probing moves with an acceleration and a jerk of their own (PRB-3), by the command and a card with simulated work.
//!
//! Invariant: what is compared with the limits is what the card executed, in whole pulses.

use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, CommandOutput};
use retrace_tests::limits::{Axis, audit};
use retrace_tests::pins::samples;
use retrace_tests::records::Records;
use retrace_tests::run::Run;
use retrace_tests::served::ServedCard;
use serde_json::Value;

const PROBE: &str = "[card]\nwatchdog_ms = 2000\n[[card.input]]\nnumber = 0\nuse = \"probe\"\n\
                     [[card.input]]\nnumber = 13\nuse = \"emergency-stop\"\n";
/// As good as no limit of the jerk.
const STEEP: &str = "[probe]\njerk_mm_per_s3 = 1e9\novertravel_mm = 0.12\n";
/// The plane is at the next pulse; below and on it the probe is in contact.
const PLANE: &str = "z<-5.4321";
const TOUCH: i64 = -5432;
const PART: &str = "G21 G90 F3000\nG1 X2\nG38.2 Z-10 F600\n(print,touch #5063 flag #5070)\nG1 X30 F3000\nG1 Z2\nM2\n";
/// A hold in the move behind the touch: the card brakes within its own limits.
const HOLD_BEHIND: &str = "at line 5 override 100%\nafter 0.3s hold\nafter 1s resume\n";

const fn axis(acceleration: f64, jerk: f64) -> Axis {
    Axis { limits: [100.0, acceleration, jerk], pulses_per_mm: 1000.0 }
}

const BUILT_IN: Axis = axis(1000.0, 20_000.0);

fn bench(probe: &str) -> Bench {
    let bench = Bench::new();
    bench.file("m.toml", format!("{PROBE}{probe}"));
    bench.file("part.ngc", PART);
    bench
}

fn run(bench: &Bench, script: &str) -> Run {
    let operator = bench.file("s.op", script).display().to_string();
    let machine = bench.path("m.toml").display().to_string();
    Run::of(bench, &bench.path("part.ngc"), &["--machine", &machine, "--work", PLANE, "--operator", &operator])
}

/// Windows of these rows beyond the limits of axes that are alike.
fn violations(records: &Records, axis: Axis) -> [u64; 3] {
    audit(records, &[axis; 3], 0.001).violations
}

/// The rows up to the end of the probing move, and those behind it; and the lowest place of Z.
fn parts(run: &Run) -> (Records, Records, i64) {
    let rows = &run.records.rows;
    let (mut z, mut lowest, mut at, mut x_moves) = (0, 0, 0, false);
    for (number, row) in rows.iter().enumerate() {
        z += row.increments[2];
        x_moves |= z < -1000 && row.increments[0] != 0;
        // Behind the probing move Z dips where its corner with X is blended.
        if row.increments[2] < 0 && !x_moves {
            at = number + 1;
            lowest = z;
        }
    }
    let part = |rows: &[_]| Records { rows: rows.to_vec(), ..run.records.clone() };
    (part(&rows[..at]), part(&rows[at..]), lowest)
}

fn touch(run: &Run) -> i64 {
    let probed = run.events.iter().find(|event| event["event"] == "probed").expect("a touch");
    probed["counts"][2].as_i64().expect("counts")
}

#[test]
fn a_probing_move_has_its_own_limits_and_every_other_move_those_of_the_axes() {
    // With the limits of the axes the machine needs more than this overtravel.
    let refused = bench("[probe]\novertravel_mm = 0.12\n").retrace(["check", "part.ngc", "--machine", "m.toml"]);
    assert!(refused.code == Some(1) && refused.err.contains("E4311"), "{}", refused.err);
    let usual = parts(&run(&bench(""), "")).2;
    assert!((250..400).contains(&(TOUCH - usual)), "{usual}");
    for (probe, own, is_steep, most_behind) in [
        (STEEP, axis(1000.0, 1e9), true, 100),
        ("[probe]\nacceleration_mm_per_s2 = 250\njerk_mm_per_s3 = 4000\n", axis(250.0, 4000.0), false, 1500),
        ("[probe]\nacceleration_mm_per_s2 = 500\njerk_mm_per_s3 = 1e9\n", axis(500.0, 1e9), false, 200),
    ] {
        let run = run(&bench(probe), HOLD_BEHIND);
        assert_eq!(run.output.code, Some(0), "{probe}{}", run.output.err);
        assert!(run.report["held_s"].as_f64().is_some_and(|held| held > 0.5), "{}", run.report);
        let (moved, behind, lowest) = parts(&run);
        assert_eq!((touch(&run), run.counts()), (TOUCH, vec![30_000, 0, 2000]), "{probe}");
        assert!((1..=most_behind).contains(&(TOUCH - lowest)), "{probe}{lowest}");
        let [first, second] = [&moved, &behind].map(|rows| violations(rows, BUILT_IN));
        assert_eq!((is_steep, second), (first[2] > 0, [0; 3]), "{probe}{:?}", audit(&behind, &[BUILT_IN; 3], 0.001));
        // X moves before the probing move, with its own limits.
        let z_alone = audit(&moved, &[BUILT_IN, BUILT_IN, own], 0.001);
        assert_eq!(z_alone.violations, [0; 3], "{probe}{:?}", z_alone.first);
        assert_eq!(run.report["limit_violations"], 0, "{}", run.report);
    }
}

/// The move is retraced with the motion that it had, and the card's own braking within the limits of the axes.
#[test]
fn a_hold_within_the_move_and_a_reverse_run_across_it_keep_its_limits() {
    let bench = bench(STEEP);
    let held = run(&bench, "after 0.4s hold\nafter 1s resume\n");
    assert_eq!((held.output.code, touch(&held)), (Some(0), TOUCH), "{}", held.output.err);
    let (moved, behind, lowest) = parts(&held);
    assert!((1..=100).contains(&(TOUCH - lowest)), "{lowest}");
    let own = audit(&moved, &[BUILT_IN, BUILT_IN, axis(1000.0, 1e9)], 0.001);
    assert_eq!((own.violations, violations(&behind, BUILT_IN)), ([0; 3], [0; 3]), "{:?}", own.first);
    // From 10 mm/s it stops within 15 periods, of which the jerk of the axes needs 60, at the hold and at the touch.
    let z: Vec<i64> = moved.rows.iter().map(|row| row.increments[2]).chain([0]).collect();
    let stops = z.windows(15).filter(|window| window[0] == -10 && window[1] == -9 && window[14] == 0).count();
    let stops = stops + usize::from(z.ends_with(&[-2, -1, 0]));
    assert_eq!(stops, 2, "the hold and the touch: {z:?}");
    let back = run(&bench, "at line 6 reverse 100%\nafter 9s leave\n");
    assert_eq!((back.output.code, back.counts()), (Some(0), vec![30_000, 0, 2000]), "{}", back.output.err);
    assert!(back.report["retrace_s"].as_f64().is_some_and(|retraced| retraced > 1.0), "{}", back.report);
    let whole = audit(&back.records, &[BUILT_IN, BUILT_IN, axis(1000.0, 1e9)], 0.001);
    assert_eq!((whole.violations, &back.report["limit_violations"]), ([0; 3], &0.into()), "{:?}", whole.first);
}

/// Largest jerk of an axis at the pins of a card, over strides of eight periods, mm/s³.
fn jerk_at_the_pins(vcd: &Path, axis: usize) -> f64 {
    let samples = samples(vcd);
    let end_us = samples.last().map_or(0, |sample| sample.at_us);
    let (mut counts, mut next) = (Vec::new(), 0);
    for us in (0..end_us).step_by(1000) {
        while samples.get(next + 1).is_some_and(|sample| sample.at_us <= us) {
            next += 1;
        }
        counts.push(samples[next].counts[axis]);
    }
    let third = counts.windows(25).map(|at| (at[24] - 3 * at[16] + 3 * at[8] - at[0]).abs());
    // Ten pulses may be the rounding, where the rate changes.
    third.max().map_or(0.0, |most| (most - 10) as f64 / 1000.0 / 0.008_f64.powi(3))
}

fn was_held(result: &CommandOutput) -> bool {
    let events = result.out.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    events.filter_map(|event| event["held_s"].as_f64()).any(|held_s| held_s > 0.5)
}

/// A card on a line, to which each path brings its limits: also behind a killed host and an emergency stop.
#[test]
fn a_card_has_the_limits_of_the_axes_again_behind_a_probing_move_however_it_ends() {
    for end in ["touch", "kill", "press emergency-stop"] {
        let bench = bench(STEEP);
        let (path, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
        let vcd_path = vcd.display().to_string();
        let mut card = ServedCard::with(&["--machine", &path, "--work", PLANE, "--vcd", &vcd_path]);
        let script = bench.file("s.op", HOLD_BEHIND).display().to_string();
        let port = card.port.clone();
        let usual = ["--machine", "m.toml", "--card", &port, "--json", "--operator", &script];
        let arguments = ["run", "part.ngc", "--journal", "jobs"];
        if end == "touch" {
            let result = bench.retrace(arguments.iter().chain(&usual));
            assert!(result.code == Some(0) && was_held(&result), "{}{}", result.out, result.err);
            let _ = card.end();
            let rest = samples(&vcd).into_iter().find(|sample| sample.counts[2] < TOUCH && sample.at_rest);
            let lowest = rest.map_or(0, |rest| rest.counts[2]);
            assert!((1..=100).contains(&(TOUCH - lowest)), "{lowest}");
            let (x, z) = (jerk_at_the_pins(&vcd, 0), jerk_at_the_pins(&vcd, 2));
            assert!(x < 42_000.0 && z > 60_000.0, "X {x}, Z {z} mm/s³");
            continue;
        }
        let arguments: Vec<&str> = arguments.iter().chain(&usual).copied().collect();
        let mut child = bench.start(&arguments, Stdio::null(), "out.txt");
        let begun = Instant::now();
        let told = || fs::read_to_string(bench.path("out.txt")).unwrap_or_default();
        while !told().contains("\"event\":\"switching\"") {
            assert!(begun.elapsed() < Duration::from_secs(30), "{end}: the move did not begin");
            thread::sleep(Duration::from_millis(5));
        }
        thread::sleep(Duration::from_millis(250));
        if end == "kill" {
            child.kill().expect("it is killed");
        } else {
            card.operate(end);
        }
        child.wait().expect("it ends");
        thread::sleep(Duration::from_millis(3000));
        let stood_at = card.identify(&bench)["counts"][2].as_i64().unwrap_or_default();
        assert!((-9000..0).contains(&stood_at), "{end}: {stood_at}");
        if end == "kill" {
            let result = bench.retrace(["resume", "--journal", "jobs", "--yes", "--json", "--operator", &script]);
            assert!(result.code == Some(0) && was_held(&result), "{}{}", result.out, result.err);
        } else {
            card.operate("release emergency-stop");
            let cleared = bench.retrace(["card", "clear", &port, "--machine", "m.toml"]);
            assert_eq!(cleared.code, Some(0), "{}", cleared.err);
            bench.file("next.ngc", "G21 G91 F3000\nG1 X25\nM2\n");
            bench.file("s.op", HOLD_BEHIND.replace("line 5", "line 2"));
            let result = bench.retrace(["run", "next.ngc"].iter().chain(&usual));
            assert!(result.code == Some(0) && was_held(&result), "{}{}", result.out, result.err);
        }
        let _ = card.end();
        let x = jerk_at_the_pins(&vcd, 0);
        assert!(x < 42_000.0, "{end}: X {x} mm/s³");
    }
}
