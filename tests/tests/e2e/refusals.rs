//! Bad input is refused before anything moves: what is wrong, where, what to do, and the exit code of the interface.

use retrace_tests::command::{Bench, CommandOutput, root};

/// Checks a refusal: exit code, error number, a place, and help; and not a pulse was emitted.
fn assert_refused(bench: &Bench, result: &CommandOutput, code: i32, words: &[&str]) {
    assert_eq!(result.code, Some(code), "{}\n{}", result.out, result.err);
    assert!(result.err.contains("error[E"), "no number: {}", result.err);
    assert!(result.err.contains("help"), "no help: {}", result.err);
    for word in words {
        assert!(result.err.contains(word), "`{word}` is missing: {}", result.err);
    }
    let records = std::fs::read_to_string(bench.path("records.csv")).unwrap_or_default();
    assert!(
        records.lines().skip(1).all(|row| row.split(',').skip(5).all(|pulses| pulses == "0")),
        "it moved: {records}"
    );
}

fn run(bench: &Bench, program: &str, more: &[&str]) -> CommandOutput {
    let mut arguments = vec!["run", program, "--records", "records.csv"];
    arguments.extend(more);
    bench.retrace(arguments)
}

#[test]
fn a_missing_file_a_folder_and_an_empty_program() {
    let bench = Bench::new();
    assert_refused(&bench, &run(&bench, "absent.ngc", &[]), 2, &["absent.ngc"]);
    std::fs::create_dir(bench.path("folder.ngc")).expect("a folder");
    assert_refused(&bench, &run(&bench, "folder.ngc", &[]), 2, &["folder.ngc"]);
    bench.file("empty.ngc", "");
    assert_refused(&bench, &run(&bench, "empty.ngc", &[]), 1, &["empty.ngc"]);
    bench.file("blank.ngc", "\n\n   \n");
    assert_refused(&bench, &run(&bench, "blank.ngc", &[]), 1, &["blank.ngc"]);
}

#[test]
fn a_binary_program() {
    let bench = Bench::new();
    bench.file("binary.ngc", (0..=255_u8).cycle().take(4096).collect::<Vec<_>>());
    assert_refused(&bench, &run(&bench, "binary.ngc", &[]), 1, &["binary.ngc"]);
    let elf = std::fs::read(retrace_tests::command::binary()).expect("the command itself");
    bench.file("elf.ngc", &elf[..elf.len().min(1 << 20)]);
    assert_refused(&bench, &run(&bench, "elf.ngc", &[]), 1, &["elf.ngc"]);
}

#[test]
fn errors_of_a_program_with_line_and_column() {
    // Program, the line of the error, and the word that it is about.
    let programs = [
        ("unknown word", "G21\nG1 X1 F100\nG1 X2 E3\nM2\n", 3),
        ("unknown code", "G21 G90\nG1 X1 F100\nG33 Z1 K1\nM2\n", 3),
        ("arc whose radii disagree", "G21 G17\nG0 X0 Y0\nF100\nG2 X10 Y0 I3 J0\nM2\n", 4),
        ("arc by radius too short", "G21 G17\nG0 X0 Y0\nF100\nG2 X10 Y0 R2\nM2\n", 4),
        ("feed of zero", "G21\nG1 X10\nM2\n", 2),
        ("feed of zero, told", "G21\nF0\nG1 X10\nM2\n", 3),
        ("negative feed", "G21\nF-5\nG1 X10\nM2\n", 2),
        ("two words of one group", "G21\nG0 G1 X1 F100\nM2\n", 2),
        ("unclosed comment", "G21\nG0 X1 (where does it end\nM2\n", 2),
        ("unclosed bracket", "G21\nG0 X[1 + 2\nM2\n", 2),
        ("division by zero", "G21\nG0 X[1 / 0]\nM2\n", 2),
    ];
    for (what, text, line) in programs {
        let bench = Bench::new();
        bench.file("wrong.ngc", text);
        println!("{what}");
        let result = run(&bench, "wrong.ngc", &[]);
        assert_refused(&bench, &result, 1, &["wrong.ngc", &format!("wrong.ngc:{line}:")]);
        let checked = bench.retrace(["check", "wrong.ngc"]);
        assert_eq!(checked.code, Some(1), "{what}: {}", checked.err);
    }
}

#[test]
fn a_move_beyond_the_soft_limits_with_its_line() {
    let programs = [
        ("G21 G90\nG0 X10\nG0 X2001\nM2\n", 3, "2001"),
        ("G21 G90 G17\nF1000\nG0 X1990 Y0\nG3 X1990 Y0 I15 J0\nM2\n", 4, "2020"),
        ("G21 G91\nG1 Z-1999 F5000\nZ-1\nZ-1\nM2\n", 4, "-2001"),
    ];
    for (text, line, position) in programs {
        let bench = Bench::new();
        bench.file("wrong.ngc", text);
        let words = ["soft limit", position, &format!("wrong.ngc:{line}")];
        assert_refused(&bench, &run(&bench, "wrong.ngc", &[]), 1, &words);
        let checked = bench.retrace(["check", "wrong.ngc"]);
        assert_eq!(checked.code, Some(1), "{}", checked.err);
    }
}

#[test]
fn several_errors_are_told_at_once() {
    let bench = Bench::new();
    bench.file("wrong.ngc", "G21 G90\nG1 X1 F100\nG77 X1\nG1 X2\nY[1 / 0]\nX3 W\nM2\n");
    let result = bench.retrace(["check", "wrong.ngc"]);
    assert_eq!(result.code, Some(1));
    for line in [3, 5, 6] {
        assert!(result.err.contains(&format!("wrong.ngc:{line}:")), "line {line}: {}", result.err);
    }
}

#[test]
fn a_machine_file_with_a_misspelt_key() {
    let bench = Bench::new();
    bench.file("m.toml", "name = \"mill\"\ncontrol_perod_ms = 2\n");
    let program = root().join("examples/01-first-cut.ngc");
    let result = run(&bench, &program.to_string_lossy(), &["--machine", "m.toml"]);
    assert_refused(&bench, &result, 2, &["m.toml", "line 2", "control_perod_ms", "control_period_ms"]);
    bench.file("m.toml", "control_period_ms = -1\n");
    let result = run(&bench, &program.to_string_lossy(), &["--machine", "m.toml"]);
    assert_refused(&bench, &result, 2, &["control_period_ms"]);
    let result = run(&bench, &program.to_string_lossy(), &["--machine", "absent.toml"]);
    assert_refused(&bench, &result, 2, &["absent.toml"]);
}

#[test]
fn an_operator_who_is_not_understood() {
    let bench = Bench::new();
    bench.file("s.op", "at 1s hold\nafter 1s revers 100%\n");
    let program = root().join("examples/01-first-cut.ngc");
    let result = run(&bench, &program.to_string_lossy(), &["--operator", "s.op"]);
    assert_refused(&bench, &result, 2, &["s.op", "line 2", "reverse"]);
}

#[test]
fn a_start_line_that_the_program_does_not_have() {
    let bench = Bench::new();
    let program = root().join("examples/01-first-cut.ngc");
    let result = run(&bench, &program.to_string_lossy(), &["--start-line", "600"]);
    assert_refused(&bench, &result, 2, &["600"]);
}

#[test]
fn wrong_usage() {
    for arguments in
        [&["run"][..], &["fly"], &["run", "--sideways", "x.ngc"], &["plot", "x.ngc"], &["size", "--axes", "x"], &[]]
    {
        let result = Bench::new().retrace(arguments);
        assert_eq!(result.code, Some(2), "{arguments:?}: {}", result.err);
        assert!(result.err.contains("--help") || result.err.contains("Usage"), "{arguments:?}: {}", result.err);
        assert!(result.out.is_empty(), "{arguments:?}: {}", result.out);
    }
}

#[test]
fn a_refused_run_with_json_reports_nothing_as_done() {
    let bench = Bench::new();
    bench.file("wrong.ngc", "G21\nG1 X10\nM2\n");
    let result = run(&bench, "wrong.ngc", &["--json"]);
    assert_eq!(result.code, Some(1));
    assert!(!result.out.contains("completed"), "{}", result.out);
}
