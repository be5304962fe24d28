//! The other commands: help, check, canon, size and plot.

use retrace_tests::command::{Bench, read_one_line_of, root};
use retrace_tests::not_run::not_run;
use retrace_tests::programs::examples;

#[test]
fn every_command_has_help_with_an_example() {
    let bench = Bench::new();
    for command in ["", "run", "check", "canon", "plot", "size", "cycles", "card"] {
        let arguments: Vec<&str> = [command, "--help"].into_iter().filter(|word| !word.is_empty()).collect();
        let result = bench.retrace(&arguments);
        assert_eq!(result.code, Some(0), "{command}: {}", result.err);
        assert!(
            result.out.contains("Example") && result.out.contains(&format!("retrace {command}")),
            "{command}: {}",
            result.out
        );
    }
}

#[test]
fn the_examples_that_help_names_are_there() {
    let bench = Bench::new();
    for command in ["run", "check", "canon", "plot"] {
        let result = bench.retrace([command, "--help"]);
        let named = result.out.split_whitespace().filter(|word| word.starts_with("examples/"));
        for path in named.clone() {
            assert!(root().join(path).is_file(), "{command}: {path}");
        }
        assert!(named.count() > 0, "{command}: {}", result.out);
    }
}

#[test]
fn every_example_checks_without_a_word_on_standard_error() {
    let bench = Bench::new();
    for program in examples() {
        let machine = program.with_extension("toml");
        let mut arguments = vec!["check".as_ref(), program.as_os_str()];
        if machine.exists() {
            arguments.extend(["--machine".as_ref(), machine.as_os_str()]);
        }
        let result = bench.retrace(arguments);
        assert_eq!((result.code, result.err.as_str()), (Some(0), ""), "{}", program.display());
    }
}

#[test]
fn canon_prints_canonical_functions_one_a_line() {
    let bench = Bench::new();
    bench.file("a.ngc", "G21 G90\nN20 G0 X25.4\nG1 Y50.8 F2540\nG20 G0 Z1\nM2\n");
    let result = bench.retrace(["canon", "a.ngc"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    for call in [
        "USE_LENGTH_UNITS(CANON_UNITS_MM)",
        "STRAIGHT_TRAVERSE(25.4000, 0.0000, 0.0000, 0.0000, 0.0000, 0.0000)",
        "SET_FEED_RATE(2540.0000)",
        "STRAIGHT_FEED(25.4000, 50.8000, 0.0000, 0.0000, 0.0000, 0.0000)",
        "USE_LENGTH_UNITS(CANON_UNITS_INCHES)",
        "STRAIGHT_TRAVERSE(1.0000, 2.0000, 1.0000, 0.0000, 0.0000, 0.0000)",
        "PROGRAM_END()",
    ] {
        assert!(result.out.lines().any(|line| line.ends_with(&format!(" {call}"))), "{call}: {}", result.out);
    }
    for (index, line) in result.out.lines().enumerate() {
        let number = line.get(..5).and_then(|field| field.trim().parse::<usize>().ok());
        assert_eq!(number, Some(index + 1), "{line}");
    }
    bench.file("wrong.ngc", "G21\nG77\nM2\n");
    assert_eq!(bench.retrace(["canon", "wrong.ngc"]).code, Some(1));
}

#[test]
fn canon_equals_rs274_where_that_is_installed() {
    let bench = Bench::new();
    for program in examples() {
        let text = std::fs::read_to_string(&program).expect("an example");
        if text.contains("CYCLE") {
            // The peer does not have cycles of this kind.
            continue;
        }
        let output = std::process::Command::new("rs274")
            .arg("-g")
            .arg(&program)
            .current_dir(root().join("examples"))
            .env("HOME", bench.path("."))
            .stdin(std::process::Stdio::null())
            .output();
        let Ok(output) = output else {
            return not_run("canon_equals_rs274_where_that_is_installed", "rs274 is not installed");
        };
        let result = bench.retrace(["canon".as_ref(), program.as_os_str()]);
        assert_eq!(result.out, String::from_utf8_lossy(&output.stdout), "{}", program.display());
    }
}

#[test]
fn size_gives_the_requirements_own_example() {
    let result = Bench::new().retrace(["size", "--axes", "3", "--hours", "0.5", "--period-ms", "2.5", "--bytes", "2"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    // REV-4.
    let digits: String =
        result.out.lines().next().unwrap_or_default().chars().filter(|letter| !letter.is_whitespace()).collect();
    assert!(digits.contains("4320000"), "{}", result.out);
}

#[test]
fn plots_are_drawn_in_both_formats_and_of_both_kinds() {
    let bench = Bench::new();
    let program = root().join("examples/02-back-up.ngc");
    let operator = root().join("examples/02-back-up.op");
    let program = program.to_string_lossy();
    let draw = |name: &str, more: &[&str]| {
        let mut arguments = vec!["plot", &program, "-o", name];
        arguments.extend(more);
        let result = bench.retrace(arguments);
        assert_eq!(result.code, Some(0), "{name}: {}", result.err);
        std::fs::read(bench.path(name)).expect("the drawing")
    };
    let plain = String::from_utf8(draw("path.svg", &[])).expect("text");
    assert!(
        plain.starts_with("<svg") && plain.trim_end().ends_with("</svg>") && !plain.contains("aria-label=\"retraced")
    );
    assert_eq!(plain.as_bytes(), draw("again.svg", &[]), "the same drawing is the same file");
    let retraced = String::from_utf8(draw("retraced.svg", &["--operator", &operator.to_string_lossy()])).expect("text");
    assert!(retraced.contains("aria-label=\"retraced"), "the retraced stretch is marked");
    assert!(draw("path.png", &["--view", "iso"]).starts_with(b"\x89PNG\r\n\x1a\n"));
    let profile = String::from_utf8(draw("profile.svg", &["--profile"])).expect("text");
    assert!(profile.contains("jerk") && profile.contains("axis limit"));
    for wrong in ["path.bmp", "absent/path.svg"] {
        let result = bench.retrace(["plot", &program, "-o", wrong]);
        assert_eq!(result.code, Some(2), "{wrong}: {}", result.err);
    }
}

#[test]
fn a_profile_is_drawn_of_a_range_of_program_lines() {
    let bench = Bench::new();
    let program = "G21 G90 G64\nG1 X10 F3000\nG1 X20\nG1 X20 Y10\nG4 P1\nG1 X0 Y0\nM2\n";
    bench.file("p.ngc", program);
    let draw = |more: &[&str]| {
        let result = bench.retrace([&["plot", "p.ngc", "--profile", "-o", "p.svg"][..], more].concat());
        (result, std::fs::read_to_string(bench.path("p.svg")).unwrap_or_default())
    };
    // The summary begins with the duration.
    let seconds = |svg: &str| -> f64 {
        let (before, _) = svg.split_once(" s in periods of").expect("a summary");
        before
            .rsplit(|c: char| !c.is_ascii_digit() && c != '.')
            .next()
            .and_then(|text| text.parse().ok())
            .expect("a number")
    };
    let all = seconds(&draw(&[]).1);
    let (result, middle) = draw(&["--from", "3", "--to", "4"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    assert!(middle.contains("p.ngc, lines 3 to 4"), "the title names the range");
    let parts = [draw(&["--to", "2"]).1, middle, draw(&["--from", "5"]).1].map(|svg| seconds(&svg));
    assert!(parts.iter().all(|&part| part > 0.2 && part < all), "{parts:?} of {all}");
    // They are all of the motion, except the dwell of a second; a blend between two lines belongs to both of them.
    assert!((parts.iter().sum::<f64>() + 1.0 - all).abs() < 0.05, "{parts:?} of {all}");
    std::fs::remove_file(bench.path("p.svg")).expect("a drawing");
    for (wrong, part) in [
        (&["--from", "4", "--to", "3"][..], "the first line is after the last"),
        (&["--from", "5", "--to", "5"], "nothing moves there"),
        (&["--from", "100"], "nothing moves there"),
    ] {
        let (result, svg) = draw(wrong);
        assert!(result.code == Some(2) && result.err.contains("E2143") && result.err.contains(part), "{}", result.err);
        assert_eq!(svg, "", "nothing is drawn");
    }
    let result = bench.retrace(["plot", "p.ngc", "--from", "2", "-o", "p.svg"]);
    assert_eq!(result.code, Some(2), "a range needs --profile: {}", result.err);
}

#[test]
fn a_reader_that_goes_away_stops_nothing_and_is_no_panic() {
    let program = root().join("examples/03-arcs.ngc");
    let program = program.to_string_lossy();
    for arguments in [&["run", &program, "--json"][..], &["run", &program], &["canon", &program]] {
        let result = read_one_line_of(arguments);
        assert_eq!((result.code, result.err.as_str()), (Some(0), ""), "{arguments:?}");
        assert!(!result.out.is_empty());
    }
}

#[test]
fn cycles_are_listed_checked_compiled_and_shown() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("mine")).expect("a folder of the test");
    bench.file("mine/BOX.SPF", "PROC BOX(REAL WW) SAVE\nG1 X=WW\nY=HH\n");
    let folders = ["--cycles", "mine", "--compiled", "kept"];
    let cycles = |words: &[&str]| bench.retrace(["cycles"].iter().chain(words).chain(&folders));
    let result = cycles(&["check"]);
    assert_eq!((result.code, result.out.as_str()), (Some(1), ""));
    assert!(
        result.err.contains("error[E1906]: HH is neither a variable") && result.err.contains("BOX.SPF:3:3"),
        "{}",
        result.err
    );
    bench.file("mine/BOX.SPF", "PROC BOX(REAL WW) SAVE\nG1 X=WW\n");
    assert!(cycles(&["compile"]).out.starts_with("13 cycles: 13 compiled now, 0 up to date"));
    let result = cycles(&[]);
    let row = |name: &str| result.out.lines().find(|line| line.starts_with(name)).unwrap_or_default().to_owned();
    assert!(row("BOX ").contains("up to date") && row("CYCLE95").contains(" 3     shipped"), "{}", result.out);
    assert!(cycles(&["show", "cycle81"]).out.contains("PROC CYCLE81(REAL RTP"));
    let result = cycles(&["show", "CYCLE80"]);
    assert_eq!(result.code, Some(2));
    assert!(result.err.contains("error[E1931]") && result.err.contains("help"), "{}", result.err);
}

#[test]
fn keys_of_the_ini_file_are_taken_and_others_are_noted() {
    let bench = Bench::new();
    let ini =
        "[RS274NGC]\nORIENT_OFFSET = 20\nDISABLE_G92_PERSISTENCE = 1\nDISABLE_FANUC_STYLE_SUB = 1\nLOG_LEVEL = 3\n";
    bench.file("m.ini", ini);
    bench.file("p.var", "5210\t1\n5211\t3\n5220\t1\n");
    bench.file("a.ngc", "(debug,#5210 #5211)\nM19 R350 P1\nM2\n");
    let result = bench.retrace(["canon", "a.ngc", "--ini", "m.ini", "--params", "p.var"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    assert!(result.out.contains("MESSAGE(\"0.000000 0.000000\")"), "{}", result.out);
    assert!(result.out.contains("ORIENT_SPINDLE(0, 370.0000, 1)"), "{}", result.out);
    assert!(result.err.contains("without effect in [RS274NGC] of m.ini: LOG_LEVEL = 3"), "{}", result.err);
    bench.file("b.ngc", "M98 P1\nM2\nO1\nM99\n");
    let result = bench.retrace(["canon", "b.ngc", "--ini", "m.ini"]);
    assert!(result.code == Some(1) && result.err.contains("E1732"), "{}", result.err);
}
