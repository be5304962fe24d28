//! A scribe beside a torch (CUT-21), seen at the card's pins.
//!
//! Invariant: the scribe is on only while it is armed, and no feed begins before both times are over.

use retrace_tests::command::{Bench, assert_contains};
use retrace_tests::pins::{Sample, samples};
use retrace_tests::run::Run;

const MATERIALS: &str = "units = \"mm\"\ndefault = 1\n[[material]]\nnumber = 1\nname = \"Steel\"\nkerf_mm = 1.4\n\
    pierce_height_mm = 3.8\npierce_delay_s = 0.2\ncut_height_mm = 1.5\nfeed_mm_per_min = 1800\n";
/// Two marks of 30 mm, and a cut.
const PROGRAM: &str = "G21 G90 F1800\nG0 X10\nM3 $1 S1\nG1 X40\nM5 $1\nG0 X60\nM3 $1\nG1 X90\nM5 $1\nG0 X100\n\
    M3 $0\nG1 X130\nM5 $0\nG0 X0\nM2\n";

fn machine(marker: &str) -> String {
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 100\n\
             max_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-50, 500]\n"
        )
    };
    format!(
        "{}{}{}[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nmaterials = \"materials.toml\"\n\
         ok = {{ input = 5 }}\n[[cutter]]\nname = \"scribe\"\nkind = \"marker\"\nfire = 3\nspindle = 1\n{marker}\n\
         [[card.input]]\nnumber = 13\nuse = \"emergency-stop\"\n",
        axis("x"),
        axis("y"),
        axis("z")
    )
}

const MARKER: &str = "arm = 4\nmarker = { arm_ms = 200, on_ms = 100 }";

fn bench(marker: &str) -> Bench {
    let bench = Bench::new();
    for (name, text) in [("part.ngc", PROGRAM), ("m.toml", &machine(marker)), ("materials.toml", MATERIALS)] {
        bench.file(name, text);
    }
    bench
}

fn run(script: &str, more: &[&str]) -> (Run, Vec<Sample>) {
    let bench = bench(MARKER);
    let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
    let (operator, trace) = (bench.file("s.op", script).display().to_string(), vcd.display().to_string());
    let mut arguments = vec!["--machine", &machine, "--vcd", &trace, "--operator", &operator];
    arguments.extend(more);
    let run = Run::of(&bench, &bench.path("part.ngc"), &arguments);
    (run, samples(&vcd))
}

/// Asserts the order and the times of each mark; returns their number.
fn assert_order(trace: &[Sample], told: &str) -> usize {
    let (mut armed_us, mut on_us, mut marks) = (0, 0, 0);
    for pair in trace.windows(2) {
        let [(armed, was_armed), (on, was_on)] =
            ["out4", "out3"].map(|output| (pair[1].is_on(output), pair[0].is_on(output)));
        armed_us = if armed && !was_armed { pair[1].at_us } else { armed_us };
        if on && !was_on {
            on_us = pair[1].at_us;
            marks += 1;
            assert!(armed && on_us - armed_us >= 200_000, "{told}: on {} us behind arming", on_us - armed_us);
        }
        assert!(!on || armed, "{told}: on and not armed: {:?}", pair[1]);
        let feeds = matches!(pair[1].line, 4 | 8) && pair[0].counts[0] != pair[1].counts[0];
        assert!(!(feeds && on) || pair[1].at_us - on_us >= 100_000, "{told}: {:?}", pair[1]);
    }
    let end = trace.last().expect("a sample");
    assert!(!end.is_on("out3") && !end.is_on("out4"), "{told}: {end:?}");
    marks
}

#[test]
fn a_scribe_is_armed_before_it_is_on_and_off_before_it_is_disarmed() {
    let (whole, trace) = run("", &[]);
    whole.assert_exact_and_legal();
    assert_eq!(assert_order(&trace, ""), 2);
    let cuts = trace.iter().filter(|sample| sample.is_on("spindle"));
    assert!(cuts.clone().count() > 0 && cuts.clone().all(|sample| !sample.is_on("out3") && !sample.is_on("out4")));
    // A hold keeps it on; stop, and the end of the program, switch it off.
    let held = "at line 4 override 100%\nafter 0.3s hold\n";
    let (run_on, trace) = run(&format!("{held}after 1s resume\n"), &[]);
    assert_eq!((&run_on.report["outcome"], run_on.counts()), (&"completed".into(), whole.counts()));
    assert_eq!(assert_order(&trace, "hold"), 2);
    let (stopped, trace) = run(&format!("{held}after 1s stop\n"), &[]);
    assert_eq!((&stopped.report["outcome"], assert_order(&trace, "stop")), (&"stopped".into(), 1));
    // A start within a mark arms it again, in the same order and with the same times.
    let (from, trace) = run("", &["--start-line", "8"]);
    assert_eq!((&from.report["outcome"], assert_order(&trace, "line 8")), (&"completed".into(), 1));
}

#[test]
fn a_scribe_without_an_output_to_arm_it_is_refused() {
    for (marker, why) in [
        ("marker = { arm_ms = 200 }", "without `arm`"),
        ("arm = 4\nmarker = { arm_ms = 10001 }", "marker.arm_ms"),
        ("arm = 4\nmarker = { on_ms = -1 }", "marker.on_ms"),
    ] {
        let refused = bench(marker).retrace(["run", "part.ngc", "--machine", "m.toml"]);
        assert_eq!(refused.code, Some(2), "{marker}");
        assert_contains(&refused.err, &[why]);
    }
}
