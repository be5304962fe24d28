//! `retrace home`, `jog` and `mdi`: a machine is set up from the shell, one task after the other.

use retrace_tests::command::{Bench, CommandOutput};
use serde_json::Value;

fn counts(result: &CommandOutput) -> Vec<i64> {
    let last = result.out.lines().last().unwrap_or_default();
    let report: Value =
        serde_json::from_str(last).unwrap_or_else(|_| panic!("no report: {}\n{}", result.out, result.err));
    ["x", "y", "z"].map(|axis| report["position_counts"][axis].as_i64().expect("a count")).to_vec()
}

#[test]
fn an_axis_is_jogged_to_the_pulse_and_no_further_than_its_soft_limit() {
    let bench = Bench::new();
    let there = bench.retrace(["jog", "x", "-12.5", "--json"]);
    assert_eq!((there.code, counts(&there)), (Some(0), vec![-12_500, 0, 0]), "{}", there.err);
    assert!(there.err.contains("does not keep its position"), "{}", there.err);
    let limit = bench.retrace(["jog", "Y", "2000.5", "--json"]);
    assert_eq!((limit.code, counts(&limit)), (Some(0), vec![0, 2_000_000, 0]), "{}", limit.err);
    assert!(limit.out.contains("\"cut_short\":true"), "{}", limit.out);
    for (axis, mm) in [("q", "1"), ("a", "1"), ("x", "inf"), ("x", "far")] {
        let refused = bench.retrace(["jog", axis, mm]);
        assert_eq!((refused.code, refused.out.as_str()), (Some(2), ""), "{axis} {mm}: {}", refused.err);
    }
}

#[test]
fn blocks_by_hand_go_on_from_each_other_over_the_parameter_file() {
    let bench = Bench::new();
    let mdi = |block: &str| bench.retrace(["mdi", block, "--params", "mill.var", "--json"]);
    assert_eq!(mdi("G10 L2 P1 X5 Y-3").code, Some(0));
    let there = mdi("G0 X1 Y1");
    assert_eq!((there.code, counts(&there)), (Some(0), vec![6_000, -2_000, 0]), "{}", there.err);
    bench.file("part.ngc", "G0 X2 Y2\nM2\n");
    let run = bench.retrace(["run", "part.ngc", "--params", "mill.var", "--json"]);
    assert_eq!(counts(&run), [7_000, -1_000, 0]);

    let wrong = mdi("G1 X1");
    assert_eq!(wrong.code, Some(1), "no feed: {}", wrong.err);
    assert_eq!(mdi("G0 X2001").code, Some(1));
    let dry = bench.retrace(["mdi", "G0 X10", "--dry-run"]);
    assert!(dry.code == Some(0) && dry.out.contains("nothing was moved"), "{}{}", dry.out, dry.err);
}

/// A machine whose axes x and z have home switches.
const HOMED: &str = "homed = true\n[[axis]]\nname = \"x\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = \
    100\nmax_acceleration_mm_per_s2 = 1000\n\
    max_jerk_mm_per_s3 = 20000\ntravel_mm = [-20, 300]\nhome = { switch = \"lower\", position_mm = -2.5 }\n\
    [[axis]]\nname = \"y\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = 100\nmax_acceleration_mm_per_s2 = 1000\n\
    max_jerk_mm_per_s3 = 20000\ntravel_mm = [-20, 300]\n\
    [[axis]]\nname = \"z\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = 100\nmax_acceleration_mm_per_s2 = 1000\n\
    max_jerk_mm_per_s3 = 20000\ntravel_mm = [-100, 20]\nhome = { switch = \"upper\" }\n\
    [[card.input]]\nnumber = 1\nuse = \"home\"\naxis = \"x\"\n[[card.input]]\nnumber = 2\nuse = \"upper-limit\"\naxis \
    = \"z\"\n";

#[test]
fn an_axis_without_a_switch_is_not_homed() {
    let bench = Bench::new();
    let none = bench.retrace(["home"]);
    assert!(none.code == Some(2) && none.err.contains("E2161"), "{}", none.err);
    bench.file("mill.toml", HOMED);
    let all = bench.retrace(["home", "--machine", "mill.toml", "--json"]);
    assert_eq!(all.code, Some(0), "{}\n{}", all.out, all.err);
    let y = bench.retrace(["home", "y", "--machine", "mill.toml"]);
    assert!(y.code == Some(2) && y.err.contains("axis Y has no home switch"), "{}", y.err);
}

#[cfg(target_os = "linux")]
#[test]
fn a_served_card_is_homed_jogged_and_moved_by_a_block_and_keeps_its_position() {
    use retrace_tests::served::ServedCard;
    let bench = Bench::new();
    let path = bench.file("mill.toml", format!("{HOMED}[card]\nwatchdog_ms = 2000\n"));
    let path = path.to_string_lossy().into_owned();
    let served = ServedCard::with(&["--machine", &path]);
    let result = |arguments: &[&str]| {
        let usual = ["--card", served.port.as_str(), "--machine", &path, "--json"];
        let result = bench.retrace(arguments.iter().chain(&usual));
        assert_eq!(result.code, Some(0), "{arguments:?}: {}\n{}", result.out, result.err);
        counts(&result)
    };
    let homed = result(&["home"]);
    // The switch opens at its count; the axis comes to rest a little beyond.
    assert!((homed[0] - -2_500).abs() < 1_000 && (homed[2] - 20_000).abs() < 1_000 && homed[1] == 0, "{homed:?}");
    let jogged = result(&["jog", "x", "7.25"]);
    assert_eq!(jogged, [homed[0] + 7_250, 0, homed[2]]);
    let moved = result(&["mdi", "G0 X10 Y4"]);
    assert_eq!(moved, [10_000, 4_000, homed[2]]);
    assert_eq!(result(&["jog", "z", "-3"]), [10_000, 4_000, homed[2] - 3_000]);
}

/// The machine that has to be homed: all of its axes can be.
fn unhomed() -> String {
    let y = "name = \"y\"\n";
    let at = HOMED.find(y).expect("axis y");
    let (before, after) = HOMED.split_at(at);
    let after =
        after.replacen("travel_mm = [-20, 300]\n", "travel_mm = [-20, 300]\nhome = { switch = \"lower\" }\n", 1);
    format!(
        "{}{after}[[card.input]]\nnumber = 3\nuse = \"home\"\naxis = \"y\"\n[card]\nwatchdog_ms = 2000\n",
        before.replace("homed = true\n", "")
    )
}

#[cfg(target_os = "linux")]
#[test]
fn no_program_moves_a_machine_before_it_was_homed_since_its_card_was_switched_on() {
    use retrace_tests::served::ServedCard;
    let bench = Bench::new();
    let path = bench.file("mill.toml", unhomed()).to_string_lossy().into_owned();
    bench.file("part.ngc", "G0 X5 Y5\nM2\n");
    let result = |served: &ServedCard, arguments: &[&str], file: &str| {
        bench.retrace(arguments.iter().chain(&["--card", served.port.as_str(), "--machine", file, "--json"]))
    };
    let refused = |served: &ServedCard, arguments: &[&str], axes: &str| {
        let result = result(served, arguments, &path);
        assert_eq!(result.code, Some(2), "{arguments:?}: {}\n{}", result.out, result.err);
        assert!(result.err.contains("E2162") && result.err.contains(axes), "{arguments:?}: {}", result.err);
        assert!(result.err.contains(&format!("retrace home --card {}", served.port)), "{}", result.err);
    };
    let done = |served: &ServedCard, arguments: &[&str], file: &str| {
        let result = result(served, arguments, file);
        assert_eq!(result.code, Some(0), "{arguments:?}: {}\n{}", result.out, result.err);
    };
    let served = ServedCard::with(&["--machine", &path]);
    refused(&served, &["run", "part.ngc"], "axes Z, X, Y were");
    refused(&served, &["mdi", "G0 X1"], "axes Z, X, Y were");
    // Blocks without motion, and manual motion, are executed nevertheless.
    done(&served, &["mdi", "G10 L2 P1 X1"], &path);
    done(&served, &["jog", "x", "1"], &path);
    done(&served, &["home", "X"], &path);
    refused(&served, &["run", "part.ngc"], "axes Z, Y were");
    done(&served, &["home"], &path);
    done(&served, &["run", "part.ngc"], &path);
    done(&served, &["mdi", "G0 X1"], &path);
    drop(served);

    let again = ServedCard::with(&["--machine", &path]);
    refused(&again, &["run", "part.ngc"], "axes Z, X, Y were");
    let allowing = bench.file("allowing.toml", format!("{}[manual]\nallow_unhomed = true\n", unhomed()));
    done(&again, &["run", "part.ngc"], &allowing.to_string_lossy());
    // The simulated card in the process counts as homed.
    let sim = bench.retrace(["run", "part.ngc", "--machine", &path]);
    assert_eq!(sim.code, Some(0), "{}", sim.err);
}

#[test]
fn a_written_machine_file_is_enough_to_home_and_to_run_on_the_simulated_card() {
    let bench = Bench::new();
    for kind in ["waterjet", "plasma", "router", "lathe"] {
        let file = format!("{kind}.toml");
        assert_eq!(bench.retrace(["machine", "new", kind, "-o", &file]).code, Some(0));
        let home = bench.retrace(["home", "--machine", &file]);
        assert_eq!(home.code, Some(0), "{kind}: {}\n{}", home.out, home.err);
    }
    // The torch is lit twice and switched off: the arc is established each time, and ends.
    bench.file("cut.ngc", "G0 X10 Y10 Z4\nM3 S1\nG1 X30 F3000\nM5\nG0 X40\nM3\nG1 X60\nM5\nM2\n");
    let run = bench.retrace(["run", "cut.ngc", "--machine", "plasma.toml", "--json"]);
    assert_eq!((run.code, counts(&run)), (Some(0), vec![9_600, 1_600, 2_560]), "{}\n{}", run.out, run.err);
    let plot = bench.retrace(["plot", "cut.ngc", "--machine", "plasma.toml", "--profile", "-o", "cut.svg"]);
    assert_eq!(plot.code, Some(0), "{}", plot.err);

    // Where M5 waits until the same contact has opened, it opens.
    let text = std::fs::read_to_string(bench.path("plasma.toml")).expect("written");
    let text = text.replace("[code.M5]\n", "[code.M5]\nwaits_for = { input = 5, active = false, timeout_ms = 500 }\n");
    bench.file("waits.toml", text);
    let run = bench.retrace(["run", "cut.ngc", "--machine", "waits.toml", "--json"]);
    assert_eq!((run.code, counts(&run)), (Some(0), vec![9_600, 1_600, 2_560]), "{}\n{}", run.out, run.err);
}
