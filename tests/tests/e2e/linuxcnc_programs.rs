//! LinuxCNC's example programs that probe, thread and turn, as Debian installs them, run to their end on the simulated
//! machine.
//!
//! Invariant: what a program wrote of its touches is compared with the modelled work, to a pulse of 1 µm.

use retrace_tests::command::{Bench, CommandOutput, cases};
use retrace_tests::not_run::not_run;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// Where Debian's linuxcnc-uspace installs the programs.
const PROGRAMS: &str = "/usr/share/linuxcnc/ncfiles";
const MACHINE: &str = "[spindle]\ncounts_per_turn = 400\nmax_rpm = 3000\n[[card.input]]\nnumber = 0\nuse = \"probe\"\n\
    [probe]\nspindle = \"may-turn\"\n";
/// Millimetres of an inch, the unit of most of the programs.
const INCH: f64 = 25.4;

/// A bench with a lathe that probes, where the programs are installed.
fn bench(test: &str) -> Option<Bench> {
    if !Path::new(PROGRAMS).is_dir() {
        not_run(test, "Debian's linuxcnc-uspace is not installed");
        return None;
    }
    let bench = Bench::new();
    bench.file("m.toml", MACHINE);
    bench.file("tools.tbl", "T1 P1 Z0\nT4 P4 Z0\nT9 P9 Z0\n");
    Some(bench)
}

/// Checks a program, and runs it to its end. The folder has its subprograms.
fn run(bench: &Bench, program: &Path, folder: &str, more: &[&str]) -> CommandOutput {
    let (path, folder) = (program.display().to_string(), format!("{PROGRAMS}/{folder}"));
    let with = ["--machine", "m.toml", "--tools", "tools.tbl", "--subs", &folder, "--json"];
    let parameters = if bench.path("p.var").is_file() { &["--params", "p.var"][..] } else { &[] };
    let arguments = |command| [&[command, path.as_str()][..], &with, parameters].concat();
    let checked = bench.retrace(arguments("check"));
    assert_eq!(checked.code, Some(0), "{path}: {}", checked.err);
    assert!(!checked.err.contains("warning"), "{path}: {}", checked.err);
    let result = bench.retrace([&arguments("run")[..], more].concat());
    assert_eq!(result.code, Some(0), "{path}: {}{}", result.out, result.err);
    let report: Value = serde_json::from_str(result.out.lines().next_back().unwrap_or_default()).unwrap_or_default();
    assert_eq!((&report["outcome"], &report["limit_violations"]), (&"completed".into(), &0.into()), "{path}");
    assert_eq!(report["underruns"], 0, "{path}");
    result
}

fn installed(name: &str) -> PathBuf {
    Path::new(PROGRAMS).join(name)
}

/// The numbers of a line, without the letters before them.
fn numbers(line: &str) -> Vec<f64> {
    line.split_whitespace().filter_map(|word| word.trim_start_matches(['X', 'Y', 'Z']).parse().ok()).collect()
}

/// Each touch that a program wrote, in inches: its height is that of the work there.
fn assert_touches(bench: &Bench, file: &str, count: usize, height_mm: impl Fn(f64, f64) -> f64) {
    let text = fs::read_to_string(bench.path(file)).unwrap_or_else(|error| panic!("{file}: {error}"));
    let touches: Vec<Vec<f64>> =
        text.lines().filter(|line| !line.starts_with('#')).map(numbers).filter(|found| found.len() >= 3).collect();
    assert_eq!(touches.len(), count, "{file}");
    for touch in &touches {
        let [x, y, z] = [touch[0] * INCH, touch[1] * INCH, touch[2] * INCH];
        // Six decimals of an inch are read.
        assert!((z - height_mm(x, y)).abs() < 0.001 + 2e-5, "{file}: {x} {y}: {z} for {}", height_mm(x, y));
    }
}

/// The same program over fewer points of the same area.
fn coarse(bench: &Bench) -> PathBuf {
    let whole = fs::read_to_string(installed("smartprobe.ngc")).expect("it is installed");
    let text = whole.replace("=.04 ", "=.2 ").replace("=51 ", "=11 ");
    assert_eq!(text.matches("=11 ").count() + text.matches("=.2 ").count(), 4, "{text}");
    bench.file("coarse.ngc", text)
}

#[test]
fn the_grids_that_are_probed_are_those_of_the_work() {
    let Some(bench) = bench("LinuxCNC's programs that probe a grid") else { return };
    run(&bench, &installed("gridprobe.ngc"), "", &["--work", "z<-5;box=20:60,5:20,-6:1"]);
    let over_box = |x: f64, y: f64| {
        if (20.0..60.0).contains(&x) && (5.0..20.0).contains(&y) { 1.0 } else { -5.0 }
    };
    assert_touches(&bench, "probe-results.txt", 65, over_box);
    // Across, the probe goes at the height of the last touch, and climbs where it meets the boss.
    let boss = "z<-2;boss=1,2,30,-6:10";
    let over_boss = |x: f64, y: f64| if (x - 1.0).hypot(y - 2.0) < 15.0 { 10.0 } else { -2.0 };
    // With its 2 601 points only where more cases are asked for (`RETRACE_CASES`): they take a quarter of a minute.
    let (smart, count) = if cases(1) > 1 { (installed("smartprobe.ngc"), 51 * 51) } else { (coarse(&bench), 11 * 11) };
    run(&bench, &smart, "", &["--work", boss]);
    assert_touches(&bench, "probe-results.ngc", count, over_boss);
    let call = "o<rectangle_probe> call [-1] [1] [0.2] [-1] [1] [0.2] [1.1] [-0.1] [20] [20] [0]\nM2\n";
    run(&bench, &bench.file("main.ngc", call), "ngcgui_lib", &["--work", boss]);
    assert_touches(&bench, "rectangle_probe_result.txt", 11 * 11, over_boss);
}

/// The bore is 40 mm wide and begins off its centre. The macro of the lathe adds the probe's diameter.
#[test]
fn the_hole_that_is_probed_has_its_diameter_and_its_centre() {
    let Some(bench) = bench("LinuxCNC's programs that probe a hole") else { return };
    for (folder, arguments, probe) in [("", "[1]", 6.0), ("macros/lathe", "[1] [25] [.1] [6]", 0.0)] {
        let main = format!("G20 G90\nG0 X0 Y0 Z0\no<probe-hole> call {arguments}\n(print,at #<_x> #<_y>)\nG0 Z1\nM2\n");
        let result = run(&bench, &bench.file("main.ngc", main), folder, &["--work", "bore=3,-2,40,-10:5"]);
        let texts: Vec<String> = result
            .out
            .lines()
            .filter_map(|line| serde_json::from_str::<Value>(line).ok()?["text"].as_str().map(str::to_owned))
            .collect();
        let of = |start: &str| {
            let text = texts.iter().find_map(|text| text.trim().strip_prefix(start)).expect(start);
            numbers(text)
        };
        let wide = of("Dia ")[0] * INCH - probe;
        let pulses = 0.002 + 2e-5;
        assert!((wide - 40.0).abs() < pulses, "{folder}: {wide}");
        let at = of("at ");
        let [x, y] = [at[0] * INCH, at[1] * INCH];
        assert!((x - 3.0).abs() < pulses && (y + 2.0).abs() < pulses, "{folder}: {x} {y}");
    }
}

#[test]
fn an_edge_that_is_probed_from_each_side_is_where_the_work_is() {
    let Some(bench) = bench("LinuxCNC's programs that probe an edge") else { return };
    let work = "box=10:40,20:50,-20:-4";
    for (name, start, parameter, expected) in [
        ("xplus", "X0 Y30\nZ-6", 5061, 10.0),
        ("xminus", "X50 Y30\nZ-6", 5061, 40.0),
        ("yplus", "X20 Y10\nZ-6", 5062, 20.0),
        ("yminus", "X20 Y60\nZ-6", 5062, 50.0),
        ("down", "X20 Y30\nZ2", 5063, -4.0),
    ] {
        let main = format!(
            "G21 G90\nG0 Z10\n{start}\no<{name}> call [300] [20] [1] [20] [1000] [0]\n(print,at #{parameter})\nM2\n"
        );
        let result = run(&bench, &bench.file("main.ngc", main), "probe", &["--work", work]);
        let found = result.out.split("\"at ").nth(1).and_then(|rest| rest.split('"').next()).map(numbers);
        let found = found.and_then(|found| found.first().copied()).expect(name);
        assert!((found - expected).abs() < 0.001 + 1e-6, "{name}: {found}");
    }
}

/// The switch is at the place of G30, and as high for both tools: the second one has no offset to the first.
#[test]
fn a_tool_is_measured_at_a_switch() {
    let Some(bench) = bench("LinuxCNC's program that measures a tool") else { return };
    bench.file("p.var", "5181 100\n5182 50\n5183 50.8\n");
    let work = "box=90:110,40:60,-20:12";
    let result = run(&bench, &installed("tool-length-probe.ngc"), "", &["--work", work]);
    for text in ["reference length is 0.472441", "new length is 0.472441"] {
        assert!(result.out.contains(text), "{}", result.out);
    }
}

#[test]
fn threads_and_what_is_turned_are_cut_to_their_end() {
    let Some(bench) = bench("LinuxCNC's programs that thread and turn") else { return };
    for name in ["threading.ngc", "g76.ngc", "lathe-g76.ngc", "lathe_pawn.ngc"] {
        run(&bench, &installed(name), "", &[]);
    }
    for (call, start) in [
        ("threading> call [20] [30] [1] [1.5] [-20] [0] [1]", "X30 Z5"),
        ("threading> call [20] [30] [1] [1.5] [-20] [1] [0]", "X15 Z5"),
        ("boring> call [30] [100] [1] [.1] [-20] [0] [0] [1]", "X20 Z2"),
        ("turning> call [20] [100] [1] [.1] [-20] [0] [0] [1] [1500]", "X30 Z2"),
        ("facing> call [-1] [100] [.5] [.1] [-2] [0] [1] [1500]", "X30 Z2"),
        ("chamfer> call [25] [100] [.5] [-5] [1] [2] [1] [0] [0] [1500]", "X30 Z2"),
        ("radius> call [25] [100] [.5] [0] [-5] [1] [0] [2] [1] [0] [0]", "X30 Z2"),
        ("drill> call [6] [-20] [30000] [.1] [1] [5] [.5]", "X30 Z2"),
    ] {
        let main = format!("G7 G18 G21\nG0 {start}\no<{call}\nM2\n");
        run(&bench, &bench.file("main.ngc", main), "macros/lathe", &[]);
    }
}

/// The time of these checks is measured, not tested: docs/campaigns.md has it.
#[test]
fn their_check_finds_no_error_and_tells_little() {
    let Some(bench) = bench("the check of LinuxCNC's programs") else { return };
    for name in ["gridprobe", "smartprobe", "ngcgui_lib/rectangle_probe", "threading", "g76"] {
        let program = installed(&format!("{name}.ngc"));
        // A subprogram alone is no program.
        let call = "o<rectangle_probe> call [-1] [1] [0.2] [-1] [1] [0.2] [1.1] [-0.1] [20] [20] [0]\nM2\n";
        let program = if name.contains('/') { bench.file("main.ngc", call) } else { program };
        let [program, subs] = [program.display().to_string(), format!("{PROGRAMS}/ngcgui_lib")];
        let arguments = ["check", &program, "--machine", "m.toml", "--tools", "tools.tbl", "--subs", &subs];
        let checked = bench.retrace(arguments);
        assert_eq!(checked.code, Some(0), "{name}: {}", checked.err);
        let notes = [&checked.out, &checked.err].map(|text| text.matches("note").count()).iter().sum::<usize>();
        assert!(notes <= 3 && !checked.err.contains("warning"), "{name}: {}{}", checked.out, checked.err);
    }
}
