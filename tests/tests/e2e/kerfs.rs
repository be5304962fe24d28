//! Kerfs that height control knows: those that were really cut (CUT-53).
//!
//! Invariant: the figures are those of the pins, counted by the trace of the simulated card.

use std::process::Stdio;
use std::time::Duration;

use retrace_tests::command::Bench;
use retrace_tests::pause::pause;
use retrace_tests::pins::{Sample, samples};
use retrace_tests::run::Run;
use retrace_tests::served::{ServedCard, resume_to_end, waits_for_recovery};

use crate::card::signal;
use crate::height_control::{bench, is_cutting, x};

/// A contour along X = 60 mm, and another one across it at Y = 30 mm.
const PROGRAM: &str = "G21 G90 F3000\nG0 X60 Y10\nM3 S1\nG1 Y50\nM5\nG0 X10 Y30\nM3\nG1 X110\nM5\nG0 X0 Y0\nM2\n";
/// Voids are not looked for, so that nothing but a known kerf holds the height at full feed.
const HEIGHT: &str = "delay_s = 0.1, slope_volts_per_s = 0, up_mm = 20, down_mm = 20";

fn run(bench: &Bench, faults: &str, script: &str) -> (Run, Vec<Sample>) {
    let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
    let (operator, trace) = (bench.file("s.op", script).display().to_string(), vcd.display().to_string());
    let arguments = ["--machine", &machine, "--vcd", &trace, "--source-faults", faults, "--operator", &operator];
    let run = Run::of(bench, &bench.path("part.ngc"), &arguments);
    assert_eq!(run.report["outcome"], "completed", "{faults} {script}: {}", run.output.err);
    run.assert_exact_and_legal();
    (run, samples(&vcd))
}

/// Number of periods in which the layer moves while the second contour is cut between these distances from the first.
fn moves(trace: &[Sample], [from, to]: [f64; 2]) -> usize {
    let across = trace.windows(2).filter(|pair| is_cutting(pair) && pair[1].counts[1] == 6_000);
    let there = across.filter(|pair| (from..to).contains(&(x(&pair[1]) - 60.0)));
    there.filter(|pair| pair[0].layer != pair[1].layer).count()
}

/// The sheet rises so that the torch follows it all the time. Where the first contour was cut, it does not at the
/// crossing; where an arc was lost before and the rest skipped, it does; and where the rest was cut later, it does not.
/// It is still from one kerf before the crossing on, and begins to come to rest there no earlier than that takes.
#[test]
fn the_kerfs_are_those_that_were_cut() {
    let skipped = "at 7s skip contour\n";
    let recovered = "at 7s recover\n";
    for (faults, script, is_kerf) in [("", "", true), ("lose@10,", skipped, false), ("lose@10,", recovered, true)] {
        let bench = bench(HEIGHT, PROGRAM);
        let (_, trace) = run(&bench, &format!("{faults}warp=40"), script);
        let (over, beside) = (moves(&trace, [-2.8, 2.8]), moves(&trace, [-11.0, -8.5]));

        assert!(beside > 20, "{faults}: {beside}");
        assert_eq!(over == 0, is_kerf, "{faults}: {over}");
    }
}

/// A job that is left between the two contours knows from its journal what was cut of the first one.
#[test]
fn a_resumed_job_knows_the_kerfs_that_were_cut() {
    let skipped = "at 7s skip contour\n";
    for (faults, script, is_kerf) in [("", "", true), ("lose@10,", skipped, false)] {
        let bench = bench(HEIGHT, PROGRAM);
        let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd").display().to_string());
        let faults = format!("{faults}warp=40");
        let card = ServedCard::with(&["--machine", &machine, "--source-faults", &faults, "--vcd", &vcd]);
        bench.file("s.op", format!("{script}at line 6 stop\n"));
        let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--operator", "s.op"];
        let left = bench.retrace(run);
        assert_eq!(left.code, Some(4), "{}", left.err);
        let out = resume_to_end(&bench).unwrap_or_else(|why| panic!("{why}"));
        assert!(out.contains("\"outcome\":\"completed\""), "{out}");
        let _ = card.end();
        let trace = samples(&bench.path("pins.vcd"));
        let (over, beside) = (moves(&trace, [-1.4, 1.4]), moves(&trace, [-25.0, -15.0]));
        assert!(beside > 5, "{faults}: {beside}");
        assert_eq!(over == 0, is_kerf, "{faults}: {over}");
    }
}

/// An arc that is lost shortly before a kerf, for which the card has the hold ahead, and a contour that is skipped: the
/// torch passes the place without its arc, and in the next contour it follows its voltage.
#[test]
fn a_hold_that_was_ordered_ahead_ends_with_its_contour() {
    let program = PROGRAM.replace("G0 X0 Y0\n", "G0 X10 Y70\nM3\nG1 X110\nM5\nG0 X0 Y0\n");
    let bench = bench(HEIGHT, &program);
    let (_, trace) = run(&bench, "lose@75,warp=40", "at 12s skip contour\n");
    let third = trace.windows(2).filter(|pair| is_cutting(pair) && pair[1].counts[1] == 14_000);
    let moves = third.filter(|pair| pair[0].layer != pair[1].layer).count();
    assert!(moves > 50, "{moves}");
}

fn within_s(seconds: u32, is_so: impl Fn() -> bool) -> bool {
    let look = |_| {
        pause(Duration::from_millis(10));
        is_so()
    };
    (0..seconds * 100).any(look)
}

/// A computer that stands still before the torch comes to a kerf, and until it is beyond: the card holds the height at
/// the place that it was given before, and no longer than until the computer is back.
#[test]
fn a_computer_that_stands_still_moves_no_torch_over_a_kerf() {
    let bench = bench(HEIGHT, PROGRAM);
    let text = std::fs::read_to_string(bench.path("m.toml")).expect("a machine file");
    bench.file("m.toml", format!("look_ahead_s = 3\n{text}"));
    let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd").display().to_string());
    let card = ServedCard::with(&["--machine", &machine, "--source-faults", "warp=40", "--vcd", &vcd]);
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--json"];
    let mut host = bench.start(&run, Stdio::null(), "run.txt");
    let told = || std::fs::read_to_string(bench.path("run.txt")).unwrap_or_default();
    let has_begun =
        || told().lines().filter(|line| line.contains("\"switched\"") && line.contains("\"M3\"")).count() == 2;
    assert!(within_s(30, has_begun), "the second contour begins");
    // From about 15 mm before the kerf to 10 mm behind it.
    pause(Duration::from_millis(700));
    signal(&host, "STOP");
    pause(Duration::from_millis(500));
    signal(&host, "CONT");
    // A computer that is busy besides may keep the host from running until the torch stands, and goes out.
    let has_ended = || told().contains("\"event\":\"report\"") || waits_for_recovery(&told());
    assert!(within_s(60, has_ended), "{}", told());
    let _ = (host.kill(), host.wait());
    if !told().contains("\"outcome\":\"completed\"") {
        resume_to_end(&bench).unwrap_or_else(|why| panic!("{why}"));
    }
    let _ = card.end();
    let trace = samples(&bench.path("pins.vcd"));
    assert_eq!(moves(&trace, [-1.4, 1.4]), 0);
    assert!(moves(&trace, [20.0, 45.0]) > 5, "it follows the voltage again");
}
