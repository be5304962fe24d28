//! A program that ignores the input that proves the torch (M62 P1 to M65 P1, CUT-33), seen at the card's pins.
//!
//! Invariant: the torch is off whenever the machine is not cutting, also while its loss is not watched.

use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, assert_contains, retrace_command};
use retrace_tests::pins::{Sample, samples};
use retrace_tests::run::Run;
use retrace_tests::served::{ServedCard, resume_to_end};
use retrace_tests::terminal::Terminal;

const PULSES: f64 = 200.0;
const MATERIALS: &str = "units = \"mm\"\ndefault = 1\n[[material]]\nnumber = 1\nname = \"Mesh\"\nkerf_mm = 1.4\n\
    pierce_height_mm = 3.8\npierce_delay_s = 0.4\ncut_height_mm = 1.5\nfeed_mm_per_min = 1800\n";
/// The input is ignored in passing from X30 to X60 of the first cut, and in the whole second one.
const PROGRAM: &str = "G21 G90 F1800\nG0 X10\nM3 S1\nG1 X30\nM62 P1\nG1 X60\nM63 P1\nG1 X70\nM5\nG0 X100\nM64 P1\nM3\n\
    G1 X160\nM5\nM65 P1\nG0 X0\nM2\n";

fn machine() -> String {
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = {PULSES}\nmax_velocity_mm_per_s = 100\n\
             max_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-50, 500]\n"
        )
    };
    format!(
        "{}{}{}[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nmaterials = \"materials.toml\"\n\
         ok = {{ input = 5 }}\nstart = {{ start_s = 1.0, retry_s = 0.5 }}\n[card]\nwatchdog_ms = 2000\n",
        axis("x"),
        axis("y"),
        axis("z")
    )
}

fn bench(program: &str) -> Bench {
    let bench = Bench::new();
    for (name, text) in [("part.ngc", program), ("m.toml", &machine()), ("materials.toml", MATERIALS)] {
        bench.file(name, text);
    }
    bench
}

fn run(program: &str, faults: &str, script: &str, more: &[&str]) -> (Run, Vec<Sample>) {
    let bench = bench(program);
    let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
    let (operator, trace) = (bench.file("s.op", script).display().to_string(), vcd.display().to_string());
    let mut arguments =
        vec!["--machine", &machine, "--vcd", &trace, "--source-faults", faults, "--operator", &operator];
    arguments.extend(more);
    let run = Run::of(&bench, &bench.path("part.ngc"), &arguments);
    (run, samples(&vcd))
}

/// The torch is on at rest only where an instruction needs it, and never in a rapid or in reverse.
fn assert_off_outside_of_cuts(trace: &[Sample], told: &str) {
    for pair in trace.windows(2) {
        let lit = pair[0].is_on("spindle") && pair[1].is_on("spindle");
        assert!(!lit || pair[1].rate >= 0.0, "{told}: lit in reverse: {:?}", pair[1]);
        assert!(!lit || pair[0].counts[0] <= pair[1].counts[0], "{told}: lit on the way back: {:?}", pair[1]);
    }
    assert!(trace.last().is_some_and(|sample| !sample.is_on("spindle")), "{told}");
}

/// An arc that goes out where it is ignored interrupts nothing; where it is watched it does. A start where it is
/// ignored does not wait for it, and takes the time of its pierce.
#[test]
fn the_loss_of_an_ignored_arc_ends_no_cut() {
    let (whole, trace) = run(PROGRAM, "", "", &[]);
    whole.assert_exact_and_legal();
    assert_eq!(whole.number("not_cut_mm"), 0.0, "{}", whole.report);
    // From X30 to X60, and from X100 to X160.
    assert!((whole.number("not_watched_mm") - 90.0).abs() < 0.2, "{}", whole.report);
    let watched: Vec<_> = whole.of_kind("loss_watch").map(|event| event["watched"].as_bool()).collect();
    assert_eq!(watched, [Some(false), Some(true), Some(false), Some(true)]);
    let unwatched = |mm: f64| {
        let at = (mm * PULSES) as i64;
        trace.iter().find(|sample| sample.is_on("spindle") && sample.counts[0] >= at).map(|s| s.is_on("unwatched"))
    };
    assert_eq!(
        [20.0, 29.9, 30.1, 59.9, 60.1, 101.0, 159.0].map(unwatched).map(Option::unwrap),
        [false, false, true, true, false, true, true]
    );
    // Lost at 25 mm of cut: X35 is ignored, and X60 is where it is watched again, with the arc still out.
    let (lost, trace) = run(PROGRAM, "lose@25", "", &[]);
    let off = lost.of_kind("cutter_off").next().expect("it is lost in the end");
    assert_eq!(off["reason"], "lost", "{off}");
    let held = trace.iter().find(|sample| sample.counts[0] > (60.0 * PULSES) as i64 && !sample.is_on("spindle"));
    assert!(held.is_some_and(|sample| sample.counts[0] < (61.0 * PULSES) as i64), "{held:?}");
    // Lit where it is ignored, and never proven: it goes out soon behind the place where it is watched.
    let unproven = PROGRAM.replace("M3 S1", "M64 P1\nM3 S1").replace("M62 P1\n", "");
    let (dark, trace) = run(&unproven, "no-start=1", "", &[]);
    let off = dark.of_kind("cutter_off").next().expect("it is off in the end");
    assert_eq!(off["reason"], "lost", "{off}");
    let last = trace.iter().rev().find(|sample| sample.is_on("spindle")).expect("it was lit");
    assert!((60.0..67.0).contains(&(last.counts[0] as f64 / PULSES)), "{last:?}");
    // No arc at all, and none is waited for.
    let second = PROGRAM.replace("M3 S1\n", "");
    let (none, trace) = run(&second, "no-start=1", "", &[]);
    assert_eq!((&none.report["outcome"], none.of_kind("cutter_off").count()), (&"completed".into(), 0));
    let lit = trace.iter().position(|sample| sample.is_on("spindle")).expect("it is lit");
    let moved = trace[lit..].iter().find(|sample| sample.counts[0] > (100.0 * PULSES) as i64).expect("it moves");
    let pierce_s = (moved.at_us - trace[lit].at_us) as f64 / 1e6;
    assert!((0.4..0.6).contains(&pierce_s), "{pierce_s} s");
    let checked = bench(PROGRAM).retrace(["check", "part.ngc", "--machine", "m.toml"]);
    assert_eq!((checked.code, checked.out.contains("W1011")), (Some(0), false), "{}", checked.out);
}

/// Hold, cutter off by hand, reverse and stop put the torch out as ever; a restart ignores the input again where the
/// program does, and watches it where the program does.
#[test]
fn the_torch_is_off_and_comes_back_unwatched() {
    let (whole, _) = run(PROGRAM, "", "", &[]);
    for script in [
        "at line 6 override 100%\nafter 0.5s hold\nafter 2s recover\n",
        "at line 6 override 100%\nafter 0.5s cutter off\nafter 2s recover\n",
        "at line 13 override 100%\nafter 1s hold\nafter 2s recover\n",
        // Back to where the arc is watched, and on from there.
        "at line 8 override 100%\nafter 0.1s reverse 100%\nafter 1.5s forward 100%\nafter 4s recover\n\
         after 4s recover\n",
    ] {
        let (run, trace) = run(PROGRAM, "", script, &[]);
        assert_eq!((&run.report["outcome"], run.counts()), (&"completed".into(), whole.counts()), "{script}");
        assert_eq!(run.number("not_cut_mm"), 0.0, "{script}: {}", run.report);
        assert!((run.number("not_watched_mm") - 90.0).abs() < 1.0, "{script}: {}", run.report);
        assert_off_outside_of_cuts(&trace, script);
        for sample in trace.iter().filter(|sample| sample.is_on("spindle") && sample.line == 4) {
            assert!(!sample.is_on("unwatched"), "{script}: {sample:?}");
        }
        for sample in trace.iter().filter(|sample| sample.is_on("spindle") && sample.line == 13) {
            assert!(sample.is_on("unwatched"), "{script}: {sample:?}");
        }
    }
    let (stopped, trace) = run(PROGRAM, "", "at line 6 override 100%\nafter 0.5s stop\n", &[]);
    assert_eq!(stopped.report["outcome"], "stopped");
    assert_off_outside_of_cuts(&trace, "stop");
    // A start in the middle of what is ignored.
    let (from, trace) = run(PROGRAM, "no-start=1", "", &["--start-line", "13"]);
    assert_eq!(from.report["outcome"], "completed", "{}", from.output.err);
    assert!(trace.iter().filter(|sample| sample.is_on("spindle")).all(|sample| sample.is_on("unwatched")));
}

/// The host is killed where the arc is ignored: the torch is off in time, and the resumed job ignores it again.
#[test]
fn a_killed_host_leaves_the_torch_off_and_the_loss_watched() {
    let bench = bench(PROGRAM);
    let (vcd, machine) = (bench.path("pins.vcd"), bench.path("m.toml").display().to_string());
    let card = ServedCard::with(&["--machine", &machine, "--vcd", &vcd.display().to_string(), "--speed", "4"]);
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--json"];
    let mut host = bench.start(&run, Stdio::null(), "killed.txt");
    let told = || std::fs::read_to_string(bench.path("killed.txt")).unwrap_or_default();
    let begun = Instant::now();
    while !told().contains("\"watched\":false") {
        assert!(begun.elapsed() < Duration::from_secs(30), "{}", told());
        thread::sleep(Duration::from_millis(5));
    }
    host.kill().expect("it is killed");
    host.wait().expect("it ends");
    let resumed = resume_to_end(&bench).unwrap_or_else(|why| panic!("{why}"));
    assert_contains(&resumed, &["\"watched\":false", "not_watched_mm"]);
    let _ = card.end();
    let trace = samples(&vcd);
    assert_off_outside_of_cuts(&trace, "killed");
    let lit = trace.iter().filter(|sample| sample.is_on("spindle") && sample.line == 13);
    assert!(lit.clone().count() > 0 && lit.clone().all(|sample| sample.is_on("unwatched")));
}

/// A job at a terminal without a screen says how an interrupted cut goes on, and Enter is `recover`; where there is no
/// terminal it says how to end it.
#[test]
fn a_lost_cut_is_recovered_at_a_plain_terminal() {
    let bench = bench(PROGRAM);
    let file = |name: &str| bench.path(name).display().to_string();
    let (part, machine, journal) = (file("part.ngc"), file("m.toml"), file("jobs"));
    let run = ["run", &part, "--machine", &machine, "--realtime", "--no-tui", "--journal", &journal];
    let faults = ["--source-faults", "lose@10"];
    let mut terminal = Terminal::running(&[&run[..], &faults].concat(), 200, 40);
    terminal.wait_for_text("the cut of line 4 waits for `recover`; press Enter to resume, Ctrl-C to stop");
    // Enter before the machine is at rest is refused, and asked for again.
    for _ in 0..100 {
        if terminal.text().contains("recover") && terminal.text().contains("igniting") {
            break;
        }
        terminal.keys("\n");
        thread::sleep(Duration::from_millis(100));
    }
    assert_eq!(terminal.wait_for_end(), Some(0), "{}", terminal.text());
    let run = ["run", "part.ngc", "--machine", "m.toml", "--realtime", "--json", "--journal", "jobs"];
    let err = std::fs::File::create(bench.path("err.txt")).expect("a file of the test");
    let mut command = retrace_command(run.iter().chain(&faults));
    command.current_dir(bench.path("."));
    let mut host = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(err).spawn().expect("the command runs");
    let begun = Instant::now();
    let told = || std::fs::read_to_string(bench.path("err.txt")).unwrap_or_default();
    while !told().contains("no terminal to press Enter at: stop it with `kill ") {
        assert!(begun.elapsed() < Duration::from_secs(30), "{}", told());
        thread::sleep(Duration::from_millis(20));
    }
    assert!(told().contains("the cut of line 4 waits for `recover`"), "{}", told());
    host.kill().expect("it is killed");
    host.wait().expect("it ends");
}
