//! `retrace check` predicts the outcome of a run.

use retrace_tests::command::{Bench, assert_contains};
use retrace_tests::programs::examples;
use retrace_tests::served::ServedCard;
use retrace_tests::terminal::Terminal;
use serde_json::Value;

fn last(text: &str) -> Value {
    serde_json::from_str(text.lines().next_back().unwrap_or_default()).unwrap_or_default()
}

#[test]
fn the_time_told_is_the_time_run_for_every_example() {
    let bench = Bench::new();
    let mut seen = 0;
    for path in examples() {
        let result = bench.retrace(["check".as_ref(), path.as_os_str(), "--json".as_ref()]);
        assert_eq!(result.code, Some(0), "{}", result.err);
        let summary = last(&result.out);
        let ran = last(&bench.retrace(["run".as_ref(), path.as_os_str(), "--json".as_ref()]).out);
        for key in ["blocks", "motion_s", "dwell_s", "switch_s"] {
            assert_eq!(summary[key], ran[key], "{key} of {}", path.display());
        }
        seen += 1;
    }
    assert!(seen > 10, "{seen}");
}

#[test]
fn extents_room_tools_ranges_and_barriers_are_told_in_both_forms() {
    let bench = Bench::new();
    bench.file("tools.tbl", "T1 P1 Z40 D6 ; end mill\nT2 P2 Z55.5 D3\n");
    bench.file(
        "m.toml",
        "[code.M3]\nduration_ms = 250\n[code.M101]\noutput = 1\nin_reverse = \
        \"barrier\"\n[[output]]\nnumber = 1\nname = \"air\"\n",
    );
    let program = "G10 L2 P2 X100 Y-50\nT1 M6\nS8000 M3\nG55 G43 G0 X0 Y0 Z10\nG2 X20 I10 F600\nM101\nG4 P1.5\nM0\nT2 \
        M6\nS3000\nG1 X-5 F90\nM2\n";
    bench.file("p.ngc", program);
    let with = ["p.ngc", "--tools", "tools.tbl", "--machine", "m.toml"];
    let result = bench.retrace([&["check", "--json"][..], &with].concat());
    assert_eq!((result.code, result.err.as_str()), (Some(0), ""));
    let summary = last(&result.out);
    assert_eq!(summary["extents_mm"]["x"], serde_json::json!([95.0, 120.0]));
    assert_eq!(summary["extents_mm"]["y"], serde_json::json!([-50.0, -40.0]));
    assert_eq!(summary["travel_left_mm"]["x"], serde_json::json!([2095.0, 1880.0]));
    assert_eq!(summary["work_offsets"][0]["system"], "G55");
    assert_eq!(summary["work_offsets"][0]["extents_mm"]["y"], serde_json::json!([0.0, 10.0]));
    assert_eq!(summary["work_offsets"][0]["extents_mm"]["x"], serde_json::json!([-5.0, 20.0]));
    assert_eq!(
        summary["tools"][0],
        serde_json::json!({"number": 1, "name": "end mill", "length_mm": 40.0, "diameter_mm": 6.0})
    );
    assert_eq!((&summary["tools"][1]["number"], &summary["tools"][1]["name"]), (&Value::from(2), &Value::Null));
    assert_eq!(summary["feed_mm_per_min"], serde_json::json!([90.0, 600.0]));
    assert_eq!(summary["speed_rpm"], serde_json::json!([3000.0, 8000.0]));
    let barriers: Vec<_> = summary["barriers"]
        .as_array()
        .expect("a list")
        .iter()
        .map(|b| (b["line"].clone(), b["code"].clone()))
        .collect();
    assert_eq!(barriers, [(2.into(), "M6".into()), (6.into(), "M101".into()), (9.into(), "M6".into())]);
    assert_eq!(
        (&summary["stops"], &summary["dwell_s"], &summary["switch_s"]),
        (&serde_json::json!([8]), &1.5.into(), &0.25.into())
    );
    let text = bench.retrace([&["check"][..], &with].concat()).out;
    let parts = [
        "margin 2095.000 below, 1880.000 above",
        "in G55: X -5.000 … 20.000",
        "T1 (end mill, length 40.000 mm, diameter 6.000 mm)",
        "feed 90.0 … 600.0 mm/min · spindle 3000.0 … 8000.0 turns/min",
        "cannot be passed backward: M6 of line 2, M101 of line 6, M6 of line 9",
        "stops: line 8",
    ];
    assert_contains(&text, &parts);
    let refused = bench.retrace(["check", "-", "--json"]);
    assert_eq!((refused.code, refused.out.as_str()), (Some(2), ""));
}

#[test]
fn lengths_pierces_time_per_tool_and_feeds_beyond_the_machine_are_told() {
    let bench = Bench::new();
    bench.file("m.toml", "cutting_outputs = [3]\n");
    // 10 mm of rapid, 30 mm and a half circle of 10 mm radius of feed; the output is switched on twice
    let program = "G21 G90\nT1 M6\nG0 X10\nM64 P3\nG1 X30 F600\nG3 X10 I-10 J0 F9000\nM65 P3\nT2 M6\nM64 P3\nM64 \
        P3\nG1 X20\nM65 P3\nM2\n";
    bench.file("p.ngc", program);
    let result = bench.retrace(["check", "p.ngc", "--machine", "m.toml", "--json"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    let summary = last(&result.out);
    let is = |key: &str, value: f64| {
        let found = summary[key].as_f64().unwrap_or(f64::NAN);
        assert!((found - value).abs() < 1e-6, "{key}: {found}, not {value}: {summary}");
    };
    is("rapid_mm", 10.0);
    is("cutting_mm", 30.0 + std::f64::consts::PI * 10.0);
    is("pierces", 2.0);
    let total = ["motion_s", "dwell_s", "switch_s"].map(|key| summary[key].as_f64().expect(key)).iter().sum::<f64>();
    is("total_s", total);
    let tools = summary["tool_motion_s"].as_object().expect("tools");
    let sum = tools.values().filter_map(Value::as_f64).sum::<f64>();
    assert!((sum - summary["motion_s"].as_f64().expect("a time")).abs() < 1e-6 && tools.contains_key("2"), "{summary}");
    assert_eq!(summary["feed_above_limit"], serde_json::json!({"line": 6, "feed_mm_per_min": 9000.0}));
    let text = bench.retrace(["check", "p.ngc", "--machine", "m.toml"]).out;
    let parts = [
        "at 100 %: 0:00:",
        "pierces 2",
        "motion with each tool: T1 0:00:",
        "line 6 programs a feed of 9000.0 mm/min; the machine's maximum is 6000.0",
    ];
    assert_contains(&text, &parts);
}

#[test]
fn s_beyond_the_output_for_it_is_told() {
    let bench = Bench::new();
    bench.file("m.toml", "[card.spindle_pwm]\nmax_s = 18000\n");
    bench.file("p.ngc", "G21\nM3 S12000\nG4 P1\nS24000\nM5\nM2\n");
    let check = |more: &[&str]| bench.retrace(&[&["check", "p.ngc"], more].concat()).out;
    assert_contains(
        &check(&["--machine", "m.toml"]),
        &["warning: S24000 is above the highest of card.spindle_pwm, 18000: the output stays as at S18000"],
    );
    let summary = last(&check(&["--machine", "m.toml", "--json"]));
    assert_eq!(summary["speed_above_limit"], serde_json::json!({"s": 24000.0, "max_s": 18000.0}));
    assert_eq!(last(&check(&["--json"]))["speed_above_limit"], Value::Null);
}

#[test]
fn errors_and_warnings_are_in_the_json_with_their_range() {
    let bench = Bench::new();
    bench.file("e.ngc", "G21\nG0 (\u{fc}) X1 X2\nO1 repeat [3]\nG1 X3\nO1 endrepeat\nM2\n");
    let result = bench.retrace(["check", "e.ngc", "--json"]);
    let summary = last(&result.out);
    assert_eq!((result.code, &summary["event"]), (Some(1), &Value::from("check")), "{}", result.err);
    let found: Vec<_> =
        summary["diagnostics"].as_array().expect("a list").iter().map(|d| d["number"].clone()).collect();
    assert_eq!(found, ["E1407", "E1508"]);
    let first = &summary["diagnostics"][0];
    assert_eq!(first["file"], "e.ngc");
    let range = serde_json::json!({"start": {"line": 2, "column": 11}, "end": {"line": 2, "column": 13}});
    assert_eq!((&first["range"], &first["severity"]), (&range, &Value::from("error")));
    assert_eq!((&first["cause"], &first["remedy"]), (&Value::from("X is given twice"), &Value::from("Remove one.")));
    assert!(result.err.contains("error[E1407]"), "{}", result.err);
    bench.file("w.ngc", "M3\nM5\nM2\n");
    let summary = last(&bench.retrace(["check", "w.ngc", "--json"]).out);
    assert_eq!((&summary["diagnostics"][0]["number"], &summary["blocks"]), (&Value::from("W1002"), &Value::from(2)));
    // A torch has no speed.
    bench.file("torch.toml", "[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\n");
    let summary = last(&bench.retrace(["check", "w.ngc", "--machine", "torch.toml", "--json"]).out);
    assert_eq!(summary["diagnostics"], serde_json::json!([]), "{summary}");
}

#[test]
fn loops_without_end_are_found_whatever_the_command() {
    let bench = Bench::new();
    let nested: String = (1..40).map(|n| format!("O{n} repeat [9]\n")).collect();
    let ends: String = (1..40).rev().map(|n| format!("O{n} endrepeat\n")).collect();
    for (name, text, command) in [
        // Each takes as many blocks as the limit has: one kind of loop for each command.
        ("while.ngc", "O1 while [1]\nO1 endwhile\nM2\n".to_owned(), "check"),
        ("repeat.ngc", "O1 repeat [999999999]\n#1=[#1+1]\nO1 endrepeat\nM2\n".to_owned(), "run"),
        ("nested.ngc", format!("{nested}F100\n{ends}M2\n"), "canon"),
    ] {
        bench.file(name, &text);
        let result = bench.retrace([command, name]);
        assert!(result.code == Some(1) && result.err.contains("E1806"), "{command} {name}: {}", result.err);
    }
}

#[test]
fn a_production_loop_is_a_warning_of_check_and_a_fault_in_a_loop_comes_first() {
    let bench = Bench::new();
    bench.file("p.ngc", "O1 while [1]\nG0 X1\nG0 X0\nO1 endwhile\nM2\n");
    let result = bench.retrace(["check", "p.ngc", "--max-loop-blocks", "20000"]);
    assert!(result.code == Some(0) && result.err.contains("W1004"), "{}", result.err);
    assert!(result.err.contains("checking stopped here after 20000 blocks"), "{}", result.err);
    assert!(!result.err.contains("W1001"), "{}", result.err);
    // Its own two million blocks are not executed where a line is wrong.
    bench.file("f.ngc", "O1 while [1]\nG0 X1\nG0 X0\nG0 Y1 Y2\nO1 endwhile\nM2\n");
    let result = bench.retrace(["check", "f.ngc"]);
    assert!(result.code == Some(1) && result.err.contains("E1407") && !result.err.contains("W1004"), "{}", result.err);
}

#[test]
fn what_a_loop_gives_again_and_again_is_told_once() {
    let bench = Bench::new();
    bench.file("g.ngc", "F100\nO1 repeat [150]\nM66 P1\nG0 Z0\nO1 endrepeat\nM2\n");
    let result = bench.retrace(["check", "g.ngc"]);
    assert_eq!(result.code, Some(1));
    assert_eq!(result.err.matches("error[").count(), 1, "{}", result.err);
    assert!(result.err.contains("does not declare, and in 149 more rounds\n"), "{}", result.err);
    assert!(!result.err.contains("W1001"), "{}", result.err);
}

#[test]
fn moves_of_any_length_are_refused_in_bounded_time() {
    let bench = Bench::new();
    bench.file("slow.ngc", "G1 X10 F0.00001\nM2\n");
    bench.file("far.ngc", "F1000 G1 X90\nG1 X900000\nG2 X0 I-450000\nM2\n");
    for (name, number) in [("slow.ngc", "E1512"), ("far.ngc", "E4304")] {
        for command in ["check", "run"] {
            let began = std::time::Instant::now();
            let result = bench.retrace([command, name]);
            assert!(result.code == Some(1) && result.err.contains(number), "{command} {name}: {}", result.err);
            assert!(began.elapsed().as_secs() < 20, "{command} {name} took {:?}", began.elapsed());
        }
    }
}

#[test]
fn a_machine_file_gets_a_line_for_every_finding() {
    let bench = Bench::new();
    let text = "nam = \"mill\"\nhistory_hours = 99\n[card]\nwatchdog_ms = 1\n[code.M3]\nduration_ms = -1\n[code.M33]\n";
    bench.file("bad.toml", text);
    let result = bench.retrace(["machine", "check", "bad.toml"]);
    assert_eq!((result.code, result.out.as_str()), (Some(2), ""), "{}", result.err);
    let lines: Vec<&str> = result.err.lines().collect();
    for part in [
        "error[E2111]: bad.toml: line 1, column 1: unknown field `nam`; help: did you mean `name`?",
        "error[E2112]: bad.toml: history_hours = 99",
        "error[E2112]: bad.toml: card.watchdog_ms = 1",
        "error[E2112]: bad.toml: code.M3",
        "error[E2111]: bad.toml: [code.M33]",
        "bad.toml: 5 errors",
    ] {
        assert_eq!(lines.iter().filter(|line| line.starts_with(part)).count(), 1, "{part} in\n{}", result.err);
    }
    assert_eq!(lines.len(), 6, "{}", result.err);
    let json = last(&bench.retrace(["machine", "check", "bad.toml", "--json"]).out);
    assert_eq!(json["errors"].as_array().map(Vec::len), Some(5), "{json}");
    assert_eq!((&json["errors"][0]["number"], &json["warnings"]), (&"E2111".into(), &serde_json::json!([])));
}

#[test]
fn undeclared_inputs_and_step_rates_that_cannot_be_made_are_found() {
    let bench = Bench::new();
    let axis = |name: &str, pulses_per_mm: f64| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = {pulses_per_mm:?}\nmax_velocity_mm_per_s = 100\n\
            max_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [0, 100]\n"
        )
    };
    let axes = axis("x", 2480.0) + &axis("y", 2600.0) + &axis("z", 30_000.0);
    let text = format!("{axes}[code.M3]\nwaits_for = {{ input = 5 }}\n[[card.input]]\nnumber = 3\nuse = \"door\"\n");
    bench.file("m.toml", text);
    let result = bench.retrace(["machine", "check", "m.toml"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    assert!(result.out.contains("X: 2480 pulses/mm"), "{}", result.out);
    let lines: Vec<&str> = result.err.lines().collect();
    assert_eq!(lines.len(), 4, "{}", result.err);
    assert!(lines[0].starts_with("warning[W2115]: m.toml: code.M3 waits for input 5, which"), "{}", result.err);
    assert!(lines[1].starts_with("warning[W2116]: m.toml: axis y needs up to 260000 pulses"), "{}", result.err);
    assert!(lines[2].starts_with("warning[W2116]: m.toml: axis z needs up to 3000000 pulses"), "{}", result.err);
    assert_eq!(lines[3], "m.toml: 3 warnings");
    // The same against boards that are not there: the built-in machine fits a Pico and an STM32F405, and not an
    // STM32F401, whose shortest control period is 2 ms. A new machine file fits its board.
    let pico = bench.retrace(["machine", "check", "m.toml", "--card", "pico"]);
    assert_eq!(pico.err.matches("error[E3008]: m.toml, pico: axis ").count(), 3, "{}", pico.err);
    let written = bench.retrace(["machine", "new", "-o", "built-in.toml"]);
    assert_eq!(written.code, Some(0), "{}", written.err);
    for (board, code) in [("pico", 0), ("f405", 0), ("f401", 2)] {
        let result = bench.retrace(["machine", "check", "built-in.toml", "--card", board]);
        assert_eq!(result.code, Some(code), "{board}: {}", result.err);
        let file = format!("{board}.toml");
        let written = bench.retrace(["machine", "new", "plasma", "--board", board, "-o", &file]);
        assert_eq!((written.code, written.err.as_str()), (Some(0), ""));
        let result = bench.retrace(["machine", "check", &file, "--card", board]);
        assert_eq!(result.code, Some(0), "{}", result.err);
    }
    // The same against a card: the limits of its clock and pulses, and its own bound.
    let served = ServedCard::with(&[]);
    let result = bench.retrace(["machine", "check", "m.toml", "--card", &served.port]);
    assert_eq!(result.code, Some(2), "{}", result.err);
    let errors: Vec<&str> = result.err.lines().filter(|line| line.starts_with("error[E3008]: m.toml, ")).collect();
    assert_eq!(errors.len(), 3, "{}", result.err);
    assert!(
        errors[0].contains("axis X needs up to 248000 pulses per second, the card supports 246000 with"),
        "{}",
        errors[0]
    );
    assert!(
        errors[2].contains("axis Z needs up to 3000000 pulses per second, the card supports 2000000"),
        "{}",
        errors[2]
    );
    let run = bench.retrace(["run", "--card", &served.port, "--machine", "m.toml", "--no-journal", "m.toml"]);
    assert_ne!(run.code, Some(0), "{}", run.err);
}

/// A program for a torch has S1, one for a spindle its turns per minute: M3 tells which of them the machine has.
#[test]
fn a_cutter_that_is_named_as_a_spindle_or_the_reverse_is_a_warning() {
    let bench = Bench::new();
    let cutter = |name: &str, kind: &str| format!("[[cutter]]\nname = \"{name}\"\nkind = \"{kind}\"\nfire = 64\n");
    let materials = cutter("torch", "torch") + "spindle = 0\nmaterials = \"materials.toml\"\n";
    let materials = materials + "[[cutter]]\nname = \"drill\"\nkind = \"spindle\"\nfire = 1\nspindle = 1\n";
    bench.file(
        "materials.toml",
        "units = \"mm\"\n[[material]]\nnumber = 0\npierce_height_mm = 4\npierce_delay_s = 0.1\ncut_height_mm = \
            1.5\nfeed_mm_per_min = 600\n",
    );
    let check = |machine: &str, words: &str| {
        bench.file("m.toml", machine);
        bench.file("p.ngc", format!("G21 F600\n{words}\nG1 X10\nM5\nM2\n"));
        let result = bench.retrace(["check", "p.ngc", "--machine", "m.toml", "--json"]);
        assert_eq!(result.code, Some(0), "{}", result.err);
        let found = last(&result.out)["diagnostics"].as_array().expect("a list").clone();
        let found: Vec<String> =
            found.iter().map(|one| format!("{} {}", one["number"], one["range"]["start"])).collect();
        found.join(";").replace('"', "")
    };
    for (machine, words, warning) in [
        (cutter("torch", "torch"), "M3 $0 S1", ""),
        (cutter("torch", "torch"), "S8000 M3", "W1008 {column:1,line:2}"),
        (cutter("jet", "jet"), "S8000\nM3", "W1008 {column:1,line:3}"),
        (cutter("laser", "beam"), "M3 S8000", ""),
        (cutter("laser", "beam"), "M3 S1", ""),
        (cutter("router", "spindle"), "M3 S8000", ""),
        (cutter("router", "spindle"), "M3 $0 S1", "W1009 {column:7,line:2}"),
        (cutter("router", "spindle"), "(o=0, ph=4, pd=1, ch=1, fr=600)\nM3 S90", "W1010 {column:1,line:2}"),
        (cutter("router", "spindle"), "(o is a letter)\nM3 S90", ""),
        ("name = \"mill\"\n".into(), "M3 S1", "W1009 {column:4,line:2}"),
        (materials.clone(), "M3 $0 S1\nM5 $0", ""),
        (materials.clone(), "M3 S3000", "W1008 {column:4,line:2}"),
        (materials.clone(), "M3 $1 S3000\nM5 $1", ""),
        (materials, "M3 $1 S1\nM5 $1", "W1009 {column:7,line:2}"),
    ] {
        assert_eq!(check(&machine, words), warning, "{words} on {machine}");
    }
    bench.file("m.toml", cutter("torch", "spindle"));
    let result = bench.retrace(["machine", "check", "m.toml"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    let told = result.err.contains("warning[W2119]: m.toml: [[cutter]] torch: kind = \"spindle\", and the name is");
    assert!(told, "{}", result.err);
}

/// At a terminal a check that takes long shows its progress; Ctrl-C ends it at once.
#[test]
fn a_long_check_shows_its_lines_and_can_be_interrupted() {
    let bench = Bench::new();
    let program = "#1=0\nWHILE [#1 LT 1] DO1\nG0 X1\nG0 X0\nEND1\nM2\n";
    let program = bench.file("endless.ngc", program).to_string_lossy().into_owned();
    let mut terminal = Terminal::running(&["check", &program, "--max-loop-blocks", "2000000000"], 100, 20);
    terminal.wait_for_text("blocks in loops and calls");
    terminal.wait_for_text("of 6");
    terminal.keys("\u{3}");
    assert_ne!(terminal.wait_for_end(), Some(0));
}

/// The hold is the operator's: a program that disables it is told that it stays. The overrides can be switched off.
#[test]
fn a_program_cannot_disable_the_feed_hold() {
    let bench = Bench::new();
    bench.file("o.ngc", "M48\nM50 P0\nM51 P0\nM53 P0\nM49\nM50\nM52 P0\nM53\nG0 X1\nM2\n");
    let result = bench.retrace(["check", "o.ngc"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    assert_eq!(result.err.matches("W1012").count(), 1, "{}", result.err);
    assert_contains(&result.err, &["M53 P0: the feed hold stays enabled"]);
}
