//! Subprograms, files, the branch table, cycles and user codes, through the command (PRE-1 … PRE-8).

use retrace_tests::command::{Bench, CommandOutput};

/// The lines of the canonical functions that move.
fn moves(result: &CommandOutput) -> Vec<String> {
    assert_eq!(result.code, Some(0), "{}\n{}", result.out, result.err);
    let moves = result.out.lines().filter(|line| line.contains("STRAIGHT_") || line.contains("ARC_FEED"));
    moves.map(|line| line.get(13..).unwrap_or_default().to_owned()).collect()
}

fn traverse(x: f64, y: f64, z: f64) -> String {
    format!("STRAIGHT_TRAVERSE({x:.4}, {y:.4}, {z:.4}, 0.0000, 0.0000, 0.0000)")
}

fn feed(x: f64, y: f64, z: f64) -> String {
    format!("STRAIGHT_FEED({x:.4}, {y:.4}, {z:.4}, 0.0000, 0.0000, 0.0000)")
}

#[test]
fn subprograms_are_found_behind_the_end_in_files_and_in_named_folders() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("library")).expect("a folder");
    bench.file(
        "part.ngc",
        "o<part> sub\nG0 X#1\no<deep> call [#1 + 1]\no<part> endsub\no<deep> sub\nG0 Y#1\no<deep> endsub\n",
    );
    bench.file("library/far.ngc", "o<far> sub\nG0 Z7\no<far> endsub\n");
    bench.file("300.ngc", "O300\nG0 X0.5\nM99\n");
    bench.file("main.ngc", "G21\no<part> call [3]\no9 call\nM98 P300 L2\no<far> call\nM2\no9 sub\nG0 Z1\no9 endsub\n");
    let result = bench.retrace(["canon", "main.ngc", "--subs", "library"]);
    let wanted = [
        traverse(3.0, 0.0, 0.0),
        traverse(3.0, 4.0, 0.0),
        traverse(3.0, 4.0, 1.0),
        traverse(0.5, 4.0, 1.0),
        traverse(0.5, 4.0, 1.0),
        traverse(0.5, 4.0, 7.0),
    ];
    assert_eq!(moves(&result), wanted);
    // What the card executes belongs to lines of the program itself, also in files that it calls.
    let result = bench.retrace(["run", "main.ngc", "--subs", "library", "--records", "records.csv"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    let records = std::fs::read_to_string(bench.path("records.csv")).expect("records");
    let lines: std::collections::BTreeSet<&str> =
        records.lines().skip(1).filter_map(|row| row.split(',').nth(1)).collect();
    assert!(lines.is_subset(&["0", "2", "4", "5", "6", "8"].into()), "{lines:?}");
    assert!(lines.is_superset(&["2", "4", "5", "8"].into()), "{lines:?}");
}

#[test]
fn every_jump_stands_in_the_table_and_what_leads_nowhere_is_refused_before_anything_moves() {
    let bench = Bench::new();
    bench.file("part.ngc", "o<part> sub\nG0 X1\no<part> endsub\n");
    bench.file(
        "main.ngc",
        "o1 if [#1 EQ 0]\no<part> call\no1 else\nCYCLE81(10,0,2,-5)\no1 endif\no2 repeat [2]\nG0 X2\no2 \
            endrepeat\nM2\n",
    );
    let result = bench.retrace(["check", "main.ngc", "--table"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    let rows: Vec<Vec<&str>> = result.out.lines().take(7).map(|line| line.split_whitespace().collect()).collect();
    let wanted = [
        vec!["1", "main.ngc:1", "if", "->", "main.ngc:3"],
        vec!["2", "main.ngc:2", "call", "O<part>", "->", "part.ngc:2"],
        vec!["3", "main.ngc:3", "else", "->", "main.ngc:5"],
        vec!["4", "main.ngc:4", "cycle", "CYCLE81", "->", "compiled", "cycle"],
        vec!["5", "main.ngc:6", "repeat", "->", "main.ngc:9"],
        vec!["6", "main.ngc:8", "endrepeat", "->", "main.ngc:7"],
        vec!["7", "part.ngc:1", "sub", "->", "part.ngc:4"],
    ];
    assert_eq!(rows, wanted);

    bench.file("bad.ngc", "G21\nG0 X1\no5 call\no1 if [1]\nG0 X2 X3\no1 endif\nCYCLE99(1)\no7 while [1]\nM2\n");
    let result = bench.retrace(["run", "bad.ngc", "--records", "records.csv"]);
    assert_eq!(result.code, Some(1), "{}", result.err);
    for (number, place) in
        [("E1804", "bad.ngc:3:1"), ("E1407", "bad.ngc:5:7"), ("E1821", "bad.ngc:7:1"), ("E1802", "bad.ngc:8:1")]
    {
        assert!(result.err.contains(number) && result.err.contains(place), "{number} at {place}: {}", result.err);
    }
    assert!(!bench.path("records.csv").exists(), "nothing may run");
}

#[test]
fn a_program_that_arrives_calls_what_has_arrived() {
    let bench = Bench::new();
    let known = "G21\no1 sub\nG0 X#1\no1 endsub\no2 repeat [2]\no1 call [4]\no2 endrepeat\nM2\n";
    let result = bench.retrace_reading(["canon", "-"], known.as_bytes());
    assert_eq!(moves(&result), [traverse(4.0, 0.0, 0.0), traverse(4.0, 0.0, 0.0)]);
    let result = bench.retrace_reading(["canon", "-"], "G21\no1 call\nM2\no1 sub\no1 endsub\n".as_bytes());
    assert_eq!(result.code, Some(1));
    assert!(result.err.contains("E1811"), "{}", result.err);
}

#[test]
fn cycles_of_the_users_folder_are_called_and_run_on_the_card() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("cycles")).expect("a folder");
    bench.file("cycles/FRAME.SPF", "PROC FRAME(REAL _A, REAL _B) SAVE\nG1 G91 X=_A\nY=_B\nX=-_A\nY=-_B\nM17\n");
    bench.file("main.ngc", "G21 G90 F600\nG0 X5 Y5 Z5\nFRAME(10, 4)\nCYCLE81(10,0,2,-3)\nG1 X1\nM2\n");
    let folders = ["--cycles", "cycles", "--compiled", "compiled"];
    let canon = bench.retrace(["canon", "main.ngc"].into_iter().chain(folders));
    let wanted = [
        traverse(5.0, 5.0, 5.0),
        feed(15.0, 5.0, 5.0),
        feed(15.0, 9.0, 5.0),
        feed(5.0, 9.0, 5.0),
        feed(5.0, 5.0, 5.0),
        traverse(5.0, 5.0, 2.0),
        feed(5.0, 5.0, -3.0),
        traverse(5.0, 5.0, 10.0),
        // G91 of the cycle is over.
        feed(1.0, 5.0, 10.0),
    ];
    assert_eq!(moves(&canon), wanted);
    let run = bench.retrace(["run", "main.ngc", "--json"].into_iter().chain(folders));
    assert_eq!(run.code, Some(0), "{}", run.err);
    let report: serde_json::Value =
        serde_json::from_str(run.out.lines().last().expect("a report")).expect("a report in JSON");
    let ends = [("x", 1.0), ("y", 5.0), ("z", 10.0)];
    for (axis, end) in ends {
        assert_eq!(report["commanded_mm"][axis], end, "{report}");
        assert_eq!(report["position_counts"][axis], end * 1000.0, "{report}");
    }
}

#[test]
fn an_alarm_of_a_cycle_moves_nothing() {
    let bench = Bench::new();
    bench.file("main.ngc", "G21 F100\nG0 Z5\nCYCLE81(-10,0,2,-20)\nM2\n");
    let result = bench.retrace(["run", "main.ngc", "--records", "records.csv"]);
    assert_eq!(result.code, Some(1), "{}", result.err);
    assert!(result.err.contains("61101") && result.err.contains("main.ngc:3:1"), "{}", result.err);
    assert!(!bench.path("records.csv").exists(), "nothing may run");
}

#[test]
fn user_codes_switch_the_outputs_that_the_machine_file_declares() {
    let bench = Bench::new();
    let result = bench.retrace(["machine", "new"]);
    bench.file("mill.toml", result.out + "\n[code.M101]\noutput = 3\n[code.M102]\noutput = 3\noff = true\n");
    bench.file("main.ngc", "G21 F600\nG1 X1\nM101\nG1 X2\nM102\nM2\n");
    let result = bench.retrace(["run", "main.ngc", "--machine", "mill.toml", "--json"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    assert!(result.out.contains("M101") && result.out.contains("M102"), "{}", result.out);
    let result = bench.retrace(["run", "main.ngc"]);
    assert_eq!(result.code, Some(1), "{}", result.err);
    assert!(result.err.contains("M101") && result.err.contains("main.ngc:3"), "{}", result.err);
}

#[test]
fn a_run_logs_and_keeps_its_parameters_and_a_check_does_neither() {
    let bench = Bench::new();
    bench.file("kept.var", "5161 0\n");
    bench.file("main.ngc", "G21\n(logopen,out.txt)\n#40 = 12.5\n(log,forty is #40)\n(logclose)\nG0 X1\nG28.1\nM2\n");
    let run = |command: &str| bench.retrace([command, "main.ngc", "--params", "kept.var"]);
    assert_eq!(run("check").code, Some(0));
    assert_eq!(std::fs::read_to_string(bench.path("kept.var")).expect("parameters"), "5161 0\n");
    assert!(!bench.path("out.txt").exists(), "a check writes nothing");
    assert_eq!(run("run").code, Some(0));
    assert_eq!(std::fs::read_to_string(bench.path("out.txt")).expect("a log"), "forty is 12.500000\n");
    let kept = std::fs::read_to_string(bench.path("kept.var")).expect("parameters");
    assert!(kept.contains("40\t12.500000") && kept.contains("5161\t1.000000"), "{kept}");
    // A program that does not reach its end does not change them.
    bench.file("main.ngc", "G21\n#40 = 99\nG0 X1\nM2\n");
    bench.file("stop.op", "at 0s stop\n");
    let result = bench.retrace(["run", "main.ngc", "--params", "kept.var", "--operator", "stop.op"]);
    assert_eq!(result.code, Some(4), "{}", result.err);
    assert_eq!(std::fs::read_to_string(bench.path("kept.var")).expect("parameters"), kept);
}
