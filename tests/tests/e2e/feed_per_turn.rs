//! G95 on a machine whose feed per turn is that of the commanded speed (SPN-8).

use retrace_tests::command::Bench;
use retrace_tests::run::Run;
use serde_json::Value;

const MACHINE: &str = "[spindle]\nfeed_per_turn = \"commanded\"\n";

/// Seconds of motion of a program, by `check` and by a run.
fn seconds(program: &str) -> [f64; 2] {
    let bench = Bench::new();
    let machine = bench.file("m.toml", MACHINE).display().to_string();
    let path = bench.file("part.ngc", program);
    let checked = bench.retrace(["check", "part.ngc", "--machine", "m.toml", "--json"]);
    assert_eq!(checked.code, Some(0), "{}", checked.err);
    let report: Value = serde_json::from_str(checked.out.lines().next_back().unwrap_or_default()).unwrap_or_default();
    let run = Run::of(&bench, &path, &["--machine", &machine]);
    run.assert_exact_and_legal();
    [&report, &run.report].map(|report| report["motion_s"].as_f64().unwrap_or_default())
}

#[test]
fn a_feed_per_turn_is_that_of_the_commanded_speed() {
    // 0.5 mm a turn at 120 and 240 turns a minute are 1 and 2 mm/s; a rapid and an arc of a quarter turn.
    let turn = "G21 G90 G95 F0.5 S120 M3\nG1 X10\nS240 G1 X20\nG2 X30 Y-10 J-10\nM5\nM2\n";
    let minute = "G21 G90 G94 F60 M3\nG1 X10\nF120 G1 X20\nG2 X30 Y-10 J-10\nM5\nM2\n";
    for (by_turn, by_minute) in seconds(turn).into_iter().zip(seconds(minute)) {
        assert!((by_turn - by_minute).abs() < 0.15 && by_turn > 20.0, "{by_turn} {by_minute}");
    }
    // In inches, and back to a feed per minute.
    let inches = seconds("G20 G90 G95\nF0.1 S60 M4\nG1 X1\nG94 F12\nG1 X2\nM5\nM2\n");
    assert!(inches.iter().all(|seconds| (15.0..15.3).contains(seconds)), "{inches:?}");
}

#[test]
fn a_feed_per_turn_without_a_turning_spindle_is_refused() {
    let probe = "[[card.input]]\nnumber = 0\nuse = \"probe\"\n";
    for (machine, program, number) in [
        ("", "G95 F0.5 S100 M3\nG1 X1\n", "E4315"),
        (MACHINE, "G95 F0.5 S100\nG1 X1\n", "E4315"),
        (MACHINE, "G95 F0.5 S100 M3\nG1 X1\nM5\nG1 X2\n", "E4315"),
        (MACHINE, "G95 F0.5 S100\nG38.2 Z-1\n", "E4316"),
    ] {
        let bench = Bench::new();
        bench.file("m.toml", format!("{machine}{probe}"));
        bench.file("part.ngc", format!("G21 G90\n{program}M2\n"));
        for command in ["check", "run"] {
            let result = bench.retrace([command, "part.ngc", "--machine", "m.toml", "--json"]);
            let told = format!("{}{}", result.out, result.err);
            assert!(result.code == Some(1) && told.contains(number), "{command} {program}: {told}");
            assert!(!result.out.contains("\"started\""), "{told}");
        }
    }
    // Whether the spindle turns behind this branch is known to the run alone.
    let bench = Bench::new();
    bench.file("m.toml", format!("{MACHINE}{probe}"));
    let program = "G21 G90 F100\nG38.3 Z-1\nG95 F1 S60\no1 if [#5070 EQ 0]\nM3\no1 endif\nG1 X1\nM5\nM2\n";
    bench.file("part.ngc", program);
    let result = bench.retrace(["check", "part.ngc", "--machine", "m.toml"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    let result = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--json"]);
    assert_eq!(result.code, Some(0), "{}{}", result.out, result.err);
    let result = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--work", "z<-0.5", "--json"]);
    assert!(result.code == Some(1) && format!("{}{}", result.out, result.err).contains("E4315"), "{}", result.out);
}
