//! The other commands: help, check, canon, size and plot.

use retrace_tests::command::{Bench, read_one_line_of, root};
use retrace_tests::programs::examples;

#[test]
fn every_command_has_help_with_an_example() {
    let bench = Bench::new();
    for command in ["", "run", "check", "canon", "plot", "size", "cycles", "card"] {
        let arguments: Vec<&str> = [command, "--help"].into_iter().filter(|word| !word.is_empty()).collect();
        let said = bench.retrace(&arguments);
        assert_eq!(said.code, Some(0), "{command}: {}", said.err);
        assert!(
            said.out.contains("Example") && said.out.contains(&format!("retrace {command}")),
            "{command}: {}",
            said.out
        );
    }
}

#[test]
fn the_examples_that_help_names_are_there() {
    let bench = Bench::new();
    for command in ["run", "check", "canon", "plot"] {
        let said = bench.retrace([command, "--help"]);
        let named = said.out.split_whitespace().filter(|word| word.starts_with("examples/"));
        for path in named.clone() {
            assert!(root().join(path).is_file(), "{command}: {path}");
        }
        assert!(named.count() > 0, "{command}: {}", said.out);
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
        let said = bench.retrace(arguments);
        assert_eq!((said.code, said.err.as_str()), (Some(0), ""), "{}", program.display());
    }
}

#[test]
fn canon_prints_canonical_functions_one_a_line() {
    let bench = Bench::new();
    bench.file("a.ngc", "G21 G90\nN20 G0 X25.4\nG1 Y50.8 F2540\nG20 G0 Z1\nM2\n");
    let said = bench.retrace(["canon", "a.ngc"]);
    assert_eq!(said.code, Some(0), "{}", said.err);
    for call in [
        "USE_LENGTH_UNITS(CANON_UNITS_MM)",
        "STRAIGHT_TRAVERSE(25.4000, 0.0000, 0.0000, 0.0000, 0.0000, 0.0000)",
        "SET_FEED_RATE(2540.0000)",
        "STRAIGHT_FEED(25.4000, 50.8000, 0.0000, 0.0000, 0.0000, 0.0000)",
        "USE_LENGTH_UNITS(CANON_UNITS_INCHES)",
        "STRAIGHT_TRAVERSE(1.0000, 2.0000, 1.0000, 0.0000, 0.0000, 0.0000)",
        "PROGRAM_END()",
    ] {
        assert!(said.out.lines().any(|line| line.ends_with(&format!(" {call}"))), "{call}: {}", said.out);
    }
    for (index, line) in said.out.lines().enumerate() {
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
            println!("not run: rs274 is not installed");
            return;
        };
        let said = bench.retrace(["canon".as_ref(), program.as_os_str()]);
        assert_eq!(said.out, String::from_utf8_lossy(&output.stdout), "{}", program.display());
    }
}

#[test]
fn size_gives_the_requirements_own_example() {
    let said = Bench::new().retrace(["size", "--axes", "3", "--hours", "0.5", "--period-ms", "2.5", "--bytes", "2"]);
    assert_eq!(said.code, Some(0), "{}", said.err);
    // REV-4.
    let digits: String =
        said.out.lines().next().unwrap_or_default().chars().filter(|letter| !letter.is_whitespace()).collect();
    assert!(digits.contains("4320000"), "{}", said.out);
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
        let said = bench.retrace(arguments);
        assert_eq!(said.code, Some(0), "{name}: {}", said.err);
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
        let said = bench.retrace(["plot", &program, "-o", wrong]);
        assert_eq!(said.code, Some(2), "{wrong}: {}", said.err);
    }
}

#[test]
fn a_profile_is_drawn_of_a_range_of_program_lines() {
    let bench = Bench::new();
    let program = "G21 G90 G64\nG1 X10 F3000\nG1 X20\nG1 X20 Y10\nG4 P1\nG1 X0 Y0\nM2\n";
    bench.file("p.ngc", program);
    let draw = |more: &[&str]| {
        let said = bench.retrace([&["plot", "p.ngc", "--profile", "-o", "p.svg"][..], more].concat());
        (said, std::fs::read_to_string(bench.path("p.svg")).unwrap_or_default())
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
    let (said, middle) = draw(&["--from", "3", "--to", "4"]);
    assert_eq!(said.code, Some(0), "{}", said.err);
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
        let (said, svg) = draw(wrong);
        assert!(said.code == Some(2) && said.err.contains("E2143") && said.err.contains(part), "{}", said.err);
        assert_eq!(svg, "", "nothing is drawn");
    }
    let said = bench.retrace(["plot", "p.ngc", "--from", "2", "-o", "p.svg"]);
    assert_eq!(said.code, Some(2), "a range needs --profile: {}", said.err);
}

#[test]
fn a_reader_that_goes_away_stops_nothing_and_is_no_panic() {
    let program = root().join("examples/03-arcs.ngc");
    let program = program.to_string_lossy();
    for arguments in [&["run", &program, "--json"][..], &["run", &program], &["canon", &program]] {
        let said = read_one_line_of(arguments);
        assert_eq!((said.code, said.err.as_str()), (Some(0), ""), "{arguments:?}");
        assert!(!said.out.is_empty());
    }
}

#[test]
fn cycles_are_listed_checked_compiled_and_shown() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("mine")).expect("a folder of the test");
    bench.file("mine/BOX.SPF", "PROC BOX(REAL WW) SAVE\nG1 X=WW\nY=HH\n");
    let folders = ["--cycles", "mine", "--compiled", "kept"];
    let cycles = |words: &[&str]| bench.retrace(["cycles"].iter().chain(words).chain(&folders));
    let said = cycles(&["check"]);
    assert_eq!((said.code, said.out.as_str()), (Some(1), ""));
    assert!(
        said.err.contains("error[E1906]: HH is neither a variable") && said.err.contains("BOX.SPF:3:3"),
        "{}",
        said.err
    );
    bench.file("mine/BOX.SPF", "PROC BOX(REAL WW) SAVE\nG1 X=WW\n");
    assert!(cycles(&["compile"]).out.starts_with("13 cycles: 13 compiled now, 0 up to date"));
    let said = cycles(&[]);
    let row = |name: &str| said.out.lines().find(|line| line.starts_with(name)).unwrap_or_default().to_owned();
    assert!(row("BOX ").contains("up to date") && row("CYCLE95").contains(" 3     shipped"), "{}", said.out);
    assert!(cycles(&["show", "cycle81"]).out.contains("PROC CYCLE81(REAL RTP"));
    let said = cycles(&["show", "CYCLE80"]);
    assert_eq!(said.code, Some(2));
    assert!(said.err.contains("error[E1931]") && said.err.contains("help"), "{}", said.err);
}

#[test]
fn keys_of_the_ini_file_are_taken_and_others_are_noted() {
    let bench = Bench::new();
    let ini =
        "[RS274NGC]\nORIENT_OFFSET = 20\nDISABLE_G92_PERSISTENCE = 1\nDISABLE_FANUC_STYLE_SUB = 1\nLOG_LEVEL = 3\n";
    bench.file("m.ini", ini);
    bench.file("p.var", "5210\t1\n5211\t3\n5220\t1\n");
    bench.file("a.ngc", "(debug,#5210 #5211)\nM19 R350 P1\nM2\n");
    let said = bench.retrace(["canon", "a.ngc", "--ini", "m.ini", "--params", "p.var"]);
    assert_eq!(said.code, Some(0), "{}", said.err);
    assert!(said.out.contains("MESSAGE(\"0.000000 0.000000\")"), "{}", said.out);
    assert!(said.out.contains("ORIENT_SPINDLE(0, 370.0000, 1)"), "{}", said.out);
    assert!(said.err.contains("without effect in [RS274NGC] of m.ini: LOG_LEVEL = 3"), "{}", said.err);
    bench.file("b.ngc", "M98 P1\nM2\nO1\nM99\n");
    let said = bench.retrace(["canon", "b.ngc", "--ini", "m.ini"]);
    assert!(said.code == Some(1) && said.err.contains("E1732"), "{}", said.err);
}
