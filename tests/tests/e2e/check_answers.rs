//! `retrace check` of programs that ask the machine (PRB-17 … PRB-19).

use retrace_tests::command::{Bench, root};
use serde_json::Value;

#[test]
fn a_probing_program_is_checked_without_its_answers() {
    let bench = Bench::new();
    bench.file("p.ngc", "G21 G90 F100\nG0 X10 Z5\nG38.2 Z-5\nG10 L20 P1 Z0\nG0 Z9\nG1 X20\nM2\n");
    let result = bench.retrace(["check", "p.ngc"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    assert!(result.out.contains("at 100 %: at least "), "{}", result.out);
    // The end of the probing move is checked like any other.
    assert!(result.out.contains("Z -5.000 … 5.000 mm"), "{}", result.out);
    bench.file("far.ngc", "G21 G90 F100\nG38.2 Z-5000\nM2\n");
    let result = bench.retrace(["check", "far.ngc"]);
    assert!(result.code == Some(1) && result.err.contains("E4304"), "{}", result.err);
}

#[test]
fn moves_that_depend_on_measurements_are_counted_in_one_note() {
    let bench = Bench::new();
    let text = "G21 G90 F100\nG38.2 Z-5\nG91\nG0 Z1\nG1 X1\nG90\nG0 Z9\nG1 X5\nM2\n";
    bench.file("p.ngc", text);
    let result = bench.retrace(["check", "p.ngc"]);
    let note = "note: 2 moves depend on measurements; their limits are checked as they are planned";
    assert!(result.code == Some(0) && result.out.contains(note), "{}", result.out);
    let json = bench.retrace(["check", "p.ngc", "--json"]).out;
    assert!(json.contains("\"measured_moves\":[4,5]") && json.contains("\"is_time_partial\":true"), "{json}");
    bench.file("known.ngc", "G21 F100\nG1 X5\nM2\n");
    let result = bench.retrace(["check", "known.ngc"]);
    assert!(!result.out.contains("at least") && !result.out.contains("measurements"), "{}", result.out);
}

#[test]
fn a_limit_that_only_one_side_of_a_branch_exceeds_is_an_error() {
    let bench = Bench::new();
    bench.file("b.ngc", "G21 F100\nG38.3 Z-5\no1 if [#5070 EQ 0]\nG0 X5000\no1 else\nG0 X5\no1 endif\nG0 Y1\nM2\n");
    let result = bench.retrace(["check", "b.ngc"]);
    assert!(result.code == Some(1) && result.err.contains("E4304"), "{}", result.err);
    assert_eq!(result.err.matches("error[").count(), 1, "{}", result.err);
}

#[test]
fn a_reference_point_that_was_never_set_is_unknown_without_a_parameter_file() {
    let bench = Bench::new();
    bench.file("g.ngc", "G21 G90 F100\nG0 X1 Z5\nG30\nG38.2 Z0\nM2\n");
    let result = bench.retrace(["check", "g.ngc"]);
    assert!(result.code == Some(0) && result.out.contains("note: 2 moves depend on measurements"), "{}", result.out);
    bench.file("params.var", "5181 0\n");
    let result = bench.retrace(["check", "g.ngc", "--params", "params.var"]);
    assert!(result.code == Some(1) && result.err.contains("E1719"), "{}", result.err);
}

#[test]
fn a_material_that_is_declared_behind_a_question_is_known() {
    let bench = Bench::new();
    let example = |name: &str| std::fs::read_to_string(root().join("examples/plasma").join(name)).expect("an example");
    bench.file("metric-materials.toml", example("metric-materials.toml"));
    bench.file("m.toml", example("metric.toml") + "\n[[card.input]]\nnumber = 0\nuse = \"probe\"\n");
    let text = "G21 G90 F100\nG38.3 X5\n(o=1, nu=77, na=x, ph=4, pd=0.5, ch=2, fr=1000)\nM190 P77\nM2\n";
    bench.file("p.ngc", text);
    let result = bench.retrace(["check", "p.ngc", "--machine", "m.toml"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
}

/// Seconds of motion, and whether they are the least possible ones.
fn motion(bench: &Bench, text: &str) -> (f64, bool) {
    bench.file("m.ngc", text);
    let result = bench.retrace(["check", "m.ngc", "--json"]);
    let report: Value = serde_json::from_str(result.out.lines().next_back().unwrap_or_default()).unwrap_or_default();
    assert_eq!(result.code, Some(0), "{}", result.err);
    (report["motion_s"].as_f64().unwrap_or_default(), report["is_time_partial"] == true)
}

#[test]
fn the_time_has_the_moves_that_are_made_for_certain_between_known_places() {
    let bench = Bench::new();
    // A second to the place where it probes. The touch may come at once, and the way back is as unknown.
    let (seconds, is_partial) = motion(&bench, "G21 G90 F60\nG1 X1\nM2\n");
    assert!((1.0..1.5).contains(&seconds) && !is_partial, "{seconds}");
    let (seconds, is_partial) = motion(&bench, "G21 G90 F60\nG1 X1\nG38.2 Z-5\nG1 Z5\nM2\n");
    assert!((1.0..1.5).contains(&seconds) && is_partial, "{seconds}");
    let wait = |words: &str| motion(&bench, &format!("G21 G90 F60\nG1 X1\nM66 P0 {words}\nM2\n")).1;
    assert!(wait("L3 Q5") && !wait("L0"));
    // One side alone is not certain, and the place behind both is unknown.
    let branch = "G21 G90 F60\nG38.3 Z0\no1 if [#5070]\nG1 X50\no1 endif\n";
    let (seconds, is_partial) = motion(&bench, &format!("{branch}M2\n"));
    assert!(seconds < 0.1 && is_partial, "{seconds}");
    let (seconds, _) = motion(&bench, &format!("{branch}G1 X60\nM2\n"));
    assert!(seconds < 0.1, "{seconds}");
    let (seconds, _) = motion(&bench, &format!("{branch}G1 X60\nG1 X70\nM2\n"));
    assert!((10.0..11.0).contains(&seconds), "{seconds}");
}
