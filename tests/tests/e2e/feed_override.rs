//! Override above 100 %: planned from the first place that the ring has no space for; below it, in force at once.

use retrace_tests::command::{Bench, root};
use retrace_tests::records::RATE_ONE;
use retrace_tests::run::Run;

/// A line of 300 mm at 10 mm/s, and a return over a corner in blending.
const LINE: &str = "G21 G90 G64 P0.02\nF600\nG1 X300\nY20\nX250 Y25\nM2\n";

/// Runs `program` under `script`.
fn run(program: &str, script: &str) -> Run {
    let bench = Bench::new();
    let (program, script) = (bench.file("program.ngc", program), bench.file("script.op", script));
    Run::of(&bench, &program, &["--operator", &script.to_string_lossy()])
}

/// Speed along X in mm/s over 20 ms at `time_s`.
fn speed(run: &Run, time_s: f64) -> f64 {
    let period = (time_s * 1000.0) as usize;
    let pulses: i64 = run.records.rows[period..period + 20].iter().map(|row| row.increments[0]).sum();
    pulses as f64 / 20.0
}

#[test]
fn a_raised_override_acts_within_half_a_second_and_a_lowered_one_at_once() {
    let plain = run(LINE, "");
    let run = run(
        LINE,
        "at 5s override 150%\nat 8s override 200%\nat 10s override 120%\nat 12s override 60%\nat 14s override 300%\n",
    );
    run.assert_exact_and_legal();
    assert_eq!(run.counts(), plain.counts());
    assert!(run.number("motion_s") < 0.8 * plain.number("motion_s"), "{}", run.report);
    for (time_s, wanted) in [
        (4.9, 10.0),
        (5.45, 10.0),
        (5.6, 15.0),
        (7.9, 15.0),
        (8.6, 20.0),
        // The rate takes a tenth of a second; the planned override replaces it after half a second of planned motion.
        (10.36, 12.0),
        (11.3, 12.0),
        (12.36, 6.0),
        (13.3, 6.0),
        (15.0, 20.0),
    ] {
        let v = speed(&run, time_s);
        assert!((v - wanted).abs() <= 0.06 * wanted, "{v} mm/s at {time_s} s, not {wanted}");
    }
    let planned: Vec<_> =
        run.of_kind("override_planned").map(|e| (e["percent"].as_f64(), e["period"].as_u64())).collect();
    // Exactly the look-ahead, at rate 1; below it the place is reached later, and the rate provides the request
    // meanwhile.
    let expected = [(150.0, 5500), (200.0, 8500), (120.0, 10_834), (100.0, 13_000), (200.0, 14_600)];
    for ((percent, period), (wanted, latest)) in planned.iter().zip(expected) {
        assert_eq!(*percent, Some(wanted), "{planned:?}");
        assert!(period.is_some_and(|period| period <= latest), "{planned:?}");
    }
    assert_eq!(planned.len(), 5, "{planned:?}");
    let refused: Vec<_> = run.of_kind("command_rejected").collect();
    assert!(
        refused.len() == 1 && refused[0]["reason"].as_str().is_some_and(|why| why.contains("200 %")),
        "{refused:?}"
    );
}

/// For any speed of the planner, the records are equal.
#[test]
fn a_run_with_overrides_can_be_repeated_to_the_pulse() {
    let program = std::fs::read_to_string(root().join("examples/03-arcs.ngc")).expect("an example");
    let script = "at 0s override 130%\nat 1s override 180%\nafter 0.1s override 40%\nafter 0.3s override 200%\nafter \
        2s reverse 100%\n\
                  after 1s leave\nafter 1s override 110%\n";
    let first = run(&program, script);
    first.assert_exact_and_legal();
    for _ in 0..3 {
        let again = run(&program, script);
        assert!(again.records.rows == first.records.rows, "the records differ");
    }
    assert!(first.of_kind("override_planned").count() >= 3, "{:?}", first.events);
}

/// Lines 3, 4 and 7 are rapid moves, the first two with a blended corner between them; 5 and 6 are cuts.
const RAPIDS: &str = "G21 G90 F1200\nG64 P0.05\nG0 X100\nG61.1 G0 X200 Y20\nG1 Y60\nX150\nG0 X0\nM2\n";

fn rates_of(run: &Run, line: u64) -> Vec<f64> {
    run.records.rows.iter().filter(|row| row.line == line).map(|row| row.rate_nano as f64 / RATE_ONE as f64).collect()
}

fn largest(rates: &[f64]) -> f64 {
    rates.iter().copied().fold(0.0, f64::max)
}

#[test]
fn rapid_moves_have_an_override_of_their_own() {
    let plain = run(RAPIDS, "");
    for (script, feed, rapid) in [
        ("at 0s override 40%\n", 0.4, 1.0),
        ("at 0s rapid override 25%\n", 1.0, 0.25),
        ("at 0s override 60%\nat 0s rapid override 50%\n", 0.6, 0.5),
        ("at 0s override 150%\nat 0s rapid override 50%\n", 1.0, 0.5),
    ] {
        let run = run(RAPIDS, script);
        run.assert_exact_and_legal();
        assert_eq!(run.counts(), plain.counts());
        for (line, most) in [(3, rapid), (4, rapid), (5, feed), (6, feed), (7, rapid)] {
            let reached = largest(&rates_of(&run, line));
            assert!((reached - most).abs() < 1e-9, "{script}line {line}: {reached}, not {most}");
        }
    }
    let slow = run(RAPIDS, "at 0s override 25%\n");
    let periods = |run: &Run, lines: &[u64]| lines.iter().map(|&line| rates_of(run, line).len()).sum::<usize>() as f64;
    let (rapids, cuts) =
        (periods(&slow, &[3, 4, 7]) / periods(&plain, &[3, 4, 7]), periods(&slow, &[5, 6]) / periods(&plain, &[5, 6]));
    assert!(rapids < 1.3 && cuts > 3.5, "rapid moves took {rapids} times as long, cuts {cuts}");
}

#[test]
fn an_override_of_zero_and_a_hold_stop_rapid_moves_too() {
    for (stop, go) in
        [("override 0%", "override 100%"), ("rapid override 0%", "rapid override 100%"), ("hold", "resume")]
    {
        let run = run(RAPIDS, &format!("at 1s {stop}\nafter 2s {go}\n"));
        run.assert_exact_and_legal();
        let standing = run.records.rows[1400..2900].iter().all(|row| row.rate_nano == 0 && row.line == 3);
        assert!(standing, "{stop}");
    }
}
