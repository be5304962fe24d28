//! M6 of a machine whose operator changes the tool (PRB-21), at the pins of the card.

use retrace_tests::command::Bench;
use retrace_tests::pins::samples;
use retrace_tests::run::Run;
use serde_json::json;

const MACHINE: &str = "tool_change = \"manual\"\n[manual_tool_change]\nposition_mm = [50, 10, 2]\n\
    measure = \"setter\"\ntravel_mm = 80\n[[card.input]]\nnumber = 0\nuse = \"probe\"\n[probe]\n\
    setter_mm = [100, 90, -80]\n";
const WORK: &str = "box=95:105,85:95,-100:-50";

fn bench(program: &str) -> Bench {
    let bench = Bench::new();
    bench.file("m.toml", MACHINE);
    bench.file("part.ngc", program);
    bench
}

#[test]
fn m6_goes_to_its_position_waits_and_measures_the_tool() {
    let program = "G21 G90 F1800\nM3 S1000\nG1 X10 Z-5\nT2 M6\nX20\n(print,mode #<_motion_mode> offset #5403 z #<_z>)\n\
        G91\nT1 M6\nM5\nX1 Y-80\n(print,mode #<_motion_mode> offset #5403 incremental #<_incremental>)\nM2\n";
    let bench = bench(program);
    let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
    let trace = vcd.display().to_string();
    let operator = bench.file("s.op", "after 20s cycle start\nafter 60s cycle start\n").display().to_string();
    let arguments = ["--machine", &machine, "--work", WORK, "--vcd", &trace, "--operator", &operator];
    let run = Run::of(&bench, &bench.path("part.ngc"), &arguments);
    run.assert_exact_and_legal();
    let texts: Vec<_> = run.of_kind("message").filter_map(|message| message["text"].as_str()).collect();
    assert!(texts.contains(&"mode 10.000000 offset 30.000000 z -28.000000"), "{texts:?}");
    assert!(texts.contains(&"mode 10.000000 offset 30.000000 incremental 1.000000"), "{texts:?}");
    let changes: Vec<_> =
        run.of_kind("tool_change").map(|change| (change["tool"].clone(), change["time_s"].as_f64())).collect();
    assert_eq!(changes.iter().map(|(tool, _)| tool.clone()).collect::<Vec<_>>(), [json!(2), json!(1)]);
    // The second change is not reached by X at the end: it is at the setter, and the program goes on from there.
    assert_eq!(run.counts(), vec![101_000, 10_000, 2000]);
    let pins = samples(&vcd);
    for ((_, time_s), cycle_start_s) in changes.iter().zip([20.0, 60.0]) {
        assert!(time_s.is_some_and(|time_s| time_s < cycle_start_s - 5.0), "{time_s:?}");
        let before = pins.iter().rfind(|pin| pin.at_us < (cycle_start_s * 1e6) as u64).expect("a sample");
        assert_eq!(before.counts[..3], [50_000, 10_000, 2000], "it waits there");
    }
    // From the way to the position on, the spindle is off until the program switches it on again.
    let away = pins.iter().position(|pin| pin.counts[2] > -4999 && pin.counts[0] == 10_000).expect("the way up");
    assert!(pins[away..].iter().all(|pin| !pin.is_on("spindle")));
    assert!(pins[..away].iter().any(|pin| pin.is_on("spindle")));
    // Z first, then X and Y.
    let across = pins[away..].iter().find(|pin| pin.counts[0] > 10_100).expect("the way across");
    assert_eq!(across.counts[2], 2000);
}

fn touch_bench(program: &str) -> Bench {
    let bench = bench(program);
    let machine = MACHINE.replace("measure = \"setter\"", "measure = \"touch\"\ntouch_mm = [80, 85, 12]");
    bench.file("m.toml", machine.replace("setter_mm = [100, 90, -80]\n", ""));
    bench
}

/// Behind the change the tool comes down on the surface that is 12 mm over the work zero, in the coordinates in force,
/// with the spindle off; its length is in the tool table and in force, and the program goes on as it was.
#[test]
fn m6_touches_the_tool_off_at_the_work() {
    // The zero is at X20 Y5 Z-70 of the machine: the surface, at Z-50, is 20 mm over it.
    let program = "G21 G90 F1800\nG10 L2 P1 X20 Y5 Z-70\nM3 S1000\nG1 X-10 Z75\nG91 G1\nT2 M6\nM5\nX1\n\
        (print,mode #<_motion_mode> offset #5403 z #<_z> incremental #<_incremental>)\nM2\n";
    let bench = touch_bench(program);
    let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
    let trace = vcd.display().to_string();
    let operator = bench.file("s.op", "after 20s cycle start\n").display().to_string();
    let arguments = ["--machine", &machine, "--work", WORK, "--vcd", &trace, "--operator", &operator];
    let run = Run::of(&bench, &bench.path("part.ngc"), &arguments);
    assert_eq!(run.report["outcome"], "completed", "{}", run.output.err);
    run.assert_exact_and_legal();
    let texts: Vec<_> = run.of_kind("message").filter_map(|message| message["text"].as_str()).collect();
    // The tip is at 20 mm where the surface is at 12 mm: the tool is 8 mm long. Z is 2 mm of the machine, 72 mm less 8.
    let shown = "mode 10.000000 offset 8.000000 z 64.000000 incremental 1.000000";
    assert!(texts.contains(&shown), "{texts:?}");
    assert_eq!(run.counts(), vec![101_000, 90_000, 2000]);
    let pins = samples(&vcd);
    let lowest = pins.iter().map(|pin| pin.counts[2]).min();
    assert!(lowest.is_some_and(|counts| (-50_500..=-50_000).contains(&counts)), "{lowest:?}");
    let low: Vec<_> = pins.iter().filter(|pin| pin.counts[2] < -10_000).collect();
    assert!(low.iter().all(|pin| pin.counts[..2] == [100_000, 90_000] && !pin.is_on("spindle")), "only there, and off");
}

/// Without a surface the program ends where the travel does: the spindle is off, and nothing moves any more.
#[test]
fn a_tool_that_touches_nothing_ends_the_program_at_rest() {
    let bench = touch_bench("G21 G90 F1800\nM3 S1000\nG1 X10\nT2 M6\nM3\nG1 X20\nM2\n");
    let vcd = bench.path("pins.vcd");
    let arguments =
        ["run", "part.ngc", "--machine", "m.toml", "--json", "--vcd", "pins.vcd", "--work", "box=0:1,0:1,-9:-8"];
    let result = bench.retrace(arguments);
    assert!(result.code == Some(3) && result.out.contains("E3029"), "{}{}", result.out, result.err);
    let pins = samples(&vcd);
    let last = pins.last().expect("a sample");
    assert!(last.counts[..2] == [80_000, 85_000] && last.at_rest && !last.is_on("spindle"), "{last:?}");
}

/// The tool is put in where there is room for it: a pause at the prompt, jogs, and the way back.
#[test]
fn the_axes_are_jogged_at_the_prompt_and_brought_back() {
    let bench = bench("G21 G90 F1800\nG1 X10\nT0 M6\nG1 X20\nM2\n");
    let machine = bench.path("m.toml").display().to_string();
    let script = "after 5s pause\nafter 1s jog x 5\nafter 2s jog z 10\nafter 2s online\nafter 1s cycle start\n\
        after 3s cycle start\n";
    let operator = bench.file("s.op", script).display().to_string();
    let run = Run::of(&bench, &bench.path("part.ngc"), &["--machine", &machine, "--operator", &operator]);
    run.assert_exact_and_legal();
    let change = run.of_kind("tool_change").next().expect("it asks");
    assert_eq!((change["tool"].clone(), run.counts()), (json!(0), vec![20_000, 10_000, 2000]));
    assert!(run.output.out.contains("[5000,0,10000]"), "{}", run.output.out);
}

#[test]
fn what_m6_cannot_do_is_refused_before_anything_moves() {
    for block in ["T1 M6 G43 H1", "M6 X5", "M6 M3", "T1 M6 G[1 + 1]", "M[3 + 3]"] {
        let bench = bench(&format!("G21 G90 F1800\nG1 X1\n{block}\nM2\n"));
        let result = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--json"]);
        assert!(result.code == Some(1) && result.err.contains("E1737"), "{block}: {}", result.err);
        assert!(!result.out.contains("\"started\""), "{block}: {}", result.out);
    }
    for (wrong, what) in [
        ("[manual_tool_change]\nposition_mm = [1, 2, 3]\n", "changes its tools itself"),
        ("tool_change = \"manual\"\n[manual_tool_change]\nmeasure = \"setter\"\n", "needs a probe input"),
        ("tool_change = \"manual\"\n[manual_tool_change]\nmeasure = \"touch\"\n", "needs a probe input and the place"),
        ("tool_change = \"manual\"\n[manual_tool_change]\ntouch_mm = [1, 2, 3]\n", "a tool that is not touched off"),
    ] {
        let bench = bench("M2\n");
        bench.file("m.toml", wrong);
        let result = bench.retrace(["machine", "check", "m.toml"]);
        assert!(result.code == Some(2) && result.err.contains(what), "{wrong}: {}", result.err);
    }
    // A stream has no subprograms of files.
    let bench = bench("");
    let input = b"G21 G90\nT1 M6\nM2\n";
    let result = bench.retrace_reading(["run", "-", "--machine", "m.toml", "--json"], input);
    assert!(result.code == Some(1) && result.err.contains("tool_change"), "{}{}", result.out, result.err);
}

#[test]
fn a_change_in_a_subprogram_and_one_of_the_programs_own_work_too() {
    let text = "G21 G90 F1800\no<part> sub\nT#1 M6\n(print,tool #<_current_tool> arg #1)\no<part> endsub\n\
        o1 repeat [2]\no<part> call [2]\no1 endrepeat\nM2\n";
    let bench = bench(text);
    let run = |bench: &Bench| bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--work", WORK, "--json"]);
    let result = run(&bench);
    assert_eq!(result.code, Some(0), "{}{}", result.out, result.err);
    assert_eq!(result.out.matches("tool 2.000000 arg 2.000000").count(), 2, "{}", result.out);
    assert_eq!(result.out.matches("length of tool 2.000000: 30.000000").count(), 2, "{}", result.out);
    let own = "o<tool_change> sub\nM6\n(print,mine)\no<tool_change> endsub\n";
    bench.file("part.ngc", format!("{own}{text}"));
    let result = run(&bench);
    assert_eq!((result.code, result.out.matches("mine").count()), (Some(0), 2), "{}{}", result.out, result.err);
    assert!(!result.out.contains("length of tool"), "{}", result.out);
}
