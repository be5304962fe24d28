//! `retrace materials`, and programs on a machine with a material table.

use retrace_tests::command::{Bench, root};
use retrace_tests::not_run::not_run;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A material file of QtPlasmaC in inches.
const CFG: &str = "# my materials\n[MATERIAL_NUMBER_2]\nNAME = Mild steel 1/8\" = 45 A\nKERF_WIDTH = 0.055\nTHC = 1\n\
    PIERCE_HEIGHT = 0.15\nPIERCE_DELAY = 0.2\nPUDDLE_JUMP_HEIGHT = 0\nPUDDLE_JUMP_DELAY = 0\nCUT_HEIGHT = 0.06\n\
    CUT_SPEED = 100\nCUT_AMPS = 45\nCUT_VOLTS = 110\nPAUSE_AT_END = 0\nGAS_PRESSURE = 75\nCUT_MODE = 1\n\
    [MATERIAL_NUMBER_1]\nCUT_SPEED = 60\nCUT_HEIGHT = 0.06\nPIERCE_HEIGHT = 0.2\nPIERCE_DELAY = 0.5\n";

/// A machine that cuts by materials. Inputs are not waited for.
const MACHINE: &str = "homed = true\n[[axis]]\nname = \"x\"\npulses_per_mm = 100\nmax_velocity_mm_per_s = 200\n\
    max_acceleration_mm_per_s2 = 2000\nmax_jerk_mm_per_s3 = 40000\ntravel_mm = [0, 500]\n\
    [[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nspindle = 0\nmaterials = \"tables/materials.toml\"\n";

const PROGRAM: &str =
    "G20\nM190 P2\nM66 P3 L3 Q1\nF#<_hal[plasmac.cut-feed-rate]>\nG0 X1\nM3 $0 S1\nG1 X3\nM5 $0\nM2\n";

#[test]
fn a_material_file_comes_through_the_command_and_back() {
    let bench = Bench::new();
    bench.file("m.cfg", CFG);
    let imported = bench.retrace(["materials", "import", "m.cfg", "--units", "inch", "--out", "m.toml"]);
    assert_eq!(imported.code, Some(0), "{}", imported.err);
    let listed = bench.retrace(["materials", "list", "m.toml"]);
    assert!(listed.out.contains("2* Mild steel 1/8\" = 45 A") && listed.out.contains("100.0"), "{}", listed.out);
    let shown = bench.retrace(["materials", "show", "m.toml", "2"]);
    assert!(shown.out.contains("kerf_inch = 0.055\n") && shown.out.contains("height_control = on"), "{}", shown.out);
    let missing = bench.retrace(["materials", "show", "m.toml", "7"]);
    assert!(missing.code == Some(2) && missing.err.contains("E2117"), "{}", missing.err);
    let exported = bench.retrace(["materials", "export", "m.toml"]);
    let lines = |text: &str| {
        let mut lines: Vec<String> =
            text.lines().filter(|line| !line.starts_with('#') && !line.is_empty()).map(str::to_owned).collect();
        lines.sort();
        lines
    };
    let (was, is) = (lines(CFG), lines(&exported.out));
    // The second material has no optional keys, which are 0.
    let added: Vec<&String> = is.iter().filter(|line| !was.contains(line)).collect();
    assert!(was.iter().all(|line| is.contains(line)), "{}", exported.out);
    assert!(added.iter().all(|line| line.ends_with("= 0") || *line == "NAME = "), "{added:?}");
    // An existing file stays.
    let again = bench.retrace(["materials", "import", "m.cfg", "--units", "inch", "--out", "m.toml"]);
    assert!(again.code == Some(2) && again.err.contains("E2105"), "{}", again.err);
    bench.file("bad.cfg", CFG.replace("CUT_SPEED = 60", "CUT_SPED = 60"));
    let refused = bench.retrace(["materials", "import", "bad.cfg", "--units", "inch"]);
    let told = ["E2118", "[MATERIAL_NUMBER_1]", "CUT_SPED", "did you mean CUT_SPEED?"];
    assert!(refused.code == Some(2) && told.iter().all(|part| refused.err.contains(part)), "{}", refused.err);
}

/// A bench with the machine, its table and the program.
fn cutting_bench() -> Bench {
    let bench = Bench::new();
    bench.file("m.cfg", CFG);
    bench.file("machine.toml", MACHINE);
    bench.file("cut.ngc", PROGRAM);
    std::fs::create_dir_all(bench.path("tables")).expect("a folder");
    let table = bench.retrace(["materials", "import", "m.cfg", "--units", "inch"]).out;
    bench.file("tables/materials.toml", &table);
    bench
}

#[test]
fn a_program_uses_the_material_table_beside_the_machine_file() {
    let bench = cutting_bench();
    // From another folder: the table is found beside the machine file.
    let checked = bench.retrace(["check", "cut.ngc", "--machine", "./machine.toml"]);
    assert_eq!((checked.code, checked.err.as_str()), (Some(0), ""), "{}", checked.out);
    assert!(checked.out.contains("feed 2540.0 mm/min"), "{}", checked.out);
    bench.file("other.ngc", PROGRAM.replace("P2", "P3"));
    let refused = bench.retrace(["check", "other.ngc", "--machine", "machine.toml"]);
    assert!(refused.code == Some(1) && refused.err.contains("E1733"), "{}", refused.err);
    bench.file("tables/materials.toml", "units = \"mm\"\nkerf = 1\n");
    for command in [vec!["check", "cut.ngc", "--machine", "machine.toml"], vec!["machine", "check", "machine.toml"]] {
        let broken = bench.retrace(command);
        assert!(broken.code == Some(2) && broken.err.contains("E2117"), "{}", broken.err);
    }
}

#[test]
fn a_job_whose_material_table_has_changed_is_not_resumed() {
    let bench = cutting_bench();
    bench.file("stop.op", "at 0.5s stop\n");
    let stopped = bench.retrace(["run", "cut.ngc", "--machine", "machine.toml", "--operator", "stop.op"]);
    assert_eq!(stopped.code, Some(4), "{}", stopped.err);
    let table = std::fs::read_to_string(bench.path("tables/materials.toml")).expect("the table");
    bench.file("tables/materials.toml", table.replace("100", "90"));
    let refused = bench.retrace(["resume", "--yes"]);
    let told = refused.err.contains("E2210") && refused.err.contains("the material table");
    assert!(refused.code == Some(2) && told, "{}", refused.err);
    bench.file("tables/materials.toml", &table);
    let resumed = bench.retrace(["resume", "--yes"]);
    assert_eq!(resumed.code, Some(0), "{}", resumed.err);
}

/// Where Debian's package installs the sample programs of QtPlasmaC.
const SAMPLES: &str = "/usr/share/linuxcnc/ncfiles";

/// The samples, with the shipped machine that each belongs to.
fn samples() -> Vec<(PathBuf, &'static str)> {
    let folder = Path::new(SAMPLES);
    let listed = std::fs::read_dir(folder.join("plasmac")).into_iter().flatten();
    let mut samples: Vec<PathBuf> = listed.filter_map(|entry| Some(entry.ok()?.path())).collect();
    samples.push(folder.join("plasmatest.ngc"));
    samples.retain(|path| path.is_file() && path.extension().is_some_and(|ending| ending == "ngc"));
    samples.sort();
    let machine = |path: &PathBuf| {
        let is_inch = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("imperial"));
        if is_inch { "imperial.toml" } else { "metric.toml" }
    };
    samples.into_iter().map(|path| (path.clone(), machine(&path))).collect()
}

/// The starts of each cutter in a list of a check or of a run, without those that never started.
fn starts(list: &Value) -> BTreeMap<String, u64> {
    let of = |entry: &Value| Some((entry["cutter"].as_str()?.to_owned(), entry["starts"].as_u64()?));
    list.as_array().into_iter().flatten().filter_map(of).filter(|&(_, starts)| starts > 0).collect()
}

#[test]
fn the_samples_of_qtplasmac_are_checked_and_run_to_their_end() {
    let bench = Bench::new();
    let shipped = root().join("examples/plasma");
    let bracket = [shipped.join("bracket.ngc"), "--machine".into(), shipped.join("metric.toml")];
    for command in ["check", "run"] {
        let done = bench.retrace(std::iter::once(PathBuf::from(command)).chain(bracket.clone()));
        assert!(done.code == Some(0) && !done.err.contains("warning"), "{command}: {}", done.err);
    }
    let samples = samples();
    if samples.len() < 2 {
        return not_run("the samples of QtPlasmaC", "Debian's linuxcnc-uspace is not installed");
    }
    let tools = shipped.join("tools.tbl").display().to_string();
    for (path, machine) in &samples {
        // The wear is counted on from job to job.
        let bench = Bench::new();
        let (path, machine) = (path.display().to_string(), shipped.join(machine).display().to_string());
        let arguments = [path.as_str(), "--machine", &machine, "--tools", &tools, "--json"];
        let last = |out: &str| -> Value {
            serde_json::from_str(out.lines().next_back().unwrap_or_default()).unwrap_or_default()
        };
        let checked = bench.retrace(["check"].into_iter().chain(arguments));
        assert_eq!(checked.code, Some(0), "{path}: {}", checked.err);
        let run = bench.retrace(["run"].into_iter().chain(arguments));
        assert_eq!(run.code, Some(0), "{path}: {}", run.err);
        let (checked, report) = (last(&checked.out), last(&run.out));
        assert_eq!((&report["outcome"], &report["limit_violations"]), (&json!("completed"), &json!(0)), "{path}");
        // The plan knows what the run will do (CUT-60).
        assert_eq!(checked["contour_count"], report["contours"], "{path}");
        let ran_s = report["periods"].as_f64().expect("a number") * report["period_ms"].as_f64().expect("one") / 1000.0;
        let said_s = checked["total_s"].as_f64().expect("a time");
        assert!((said_s - ran_s).abs() <= 0.01 * ran_s, "{path}: {said_s} s, and the run took {ran_s} s");
        let mut ran = starts(&report["consumables"]);
        // A check counts no starts of a marker: it pierces nothing.
        ran.remove("scribe");
        assert_eq!(ran, starts(&checked["consumable_starts"]), "{path}");
    }
    println!("{} samples ran", samples.len());
}

#[test]
fn materials_of_a_program_are_saved_only_when_that_is_asked_for() {
    let bench = cutting_bench();
    let program = PROGRAM.replace(
        "M190 P2",
        "(o=1, nu=7, na=New, ph=0.15, pd=0.1, ch=0.06, fr=90)\n(o=2, nu=1, ph=0.2, pd=0.5, ch=0.06, fr=70)\n\
            (o=0, ph=0.2, pd=0.5, ch=0.06, fr=70)\nM190 P7",
    );
    bench.file("cut.ngc", program);
    let table = bench.path("tables/materials.toml");
    let before = format!("# mine\n{}", std::fs::read_to_string(&table).expect("the table"));
    bench.file("tables/materials.toml", &before);
    let text = || std::fs::read_to_string(&table).expect("the table");
    let arguments = ["cut.ngc", "--machine", "machine.toml"];
    for command in ["check", "run"] {
        assert_eq!(bench.retrace([&[command][..], &arguments].concat()).code, Some(0));
        assert_eq!(text(), before, "{command} alone writes nothing");
    }
    bench.file("stop.op", "at 0.5s stop\n");
    let stopped = [&["run", "--save-materials", "--operator", "stop.op"][..], &arguments].concat();
    assert_eq!(bench.retrace(stopped).code, Some(4));
    assert_eq!(text(), before, "the program has not completed");
    for command in ["check", "run"] {
        bench.file("tables/materials.toml", &before);
        let saved = bench.retrace([&[command, "--save-materials"][..], &arguments].concat());
        assert!(saved.code == Some(0) && saved.err.contains("materials.toml: material 7, 1"), "{}", saved.err);
        let after = text();
        assert!(after.starts_with("# mine\n") && after.contains("number = 7\nname = \"New\"\n"), "{after}");
        let shown = bench.retrace(["materials", "show", "tables/materials.toml", "1"]).out;
        assert!(shown.contains("feed_inch_per_min = 70\n") && !shown.contains("name = 1"), "{shown}");
        assert_eq!(bench.retrace(["materials", "list", "tables/materials.toml"]).out.lines().count(), 4, "{after}");
    }
    let again = bench.retrace([&["check", "--save-materials"][..], &["cut.ngc", "--machine", "machine.toml"]].concat());
    assert!(again.code == Some(0) && again.err.contains("has every material"), "{}", again.err);
    // Refused before anything moves: no table, a stream, a table in another form.
    let inline = "units = \"inch\"\nmaterial = [{ number = 1, pierce_height_inch = 0.2, pierce_delay_s = 0.1, \
        cut_height_inch = 0.06, feed_inch_per_min = 60 }]\n";
    bench.file("tables/materials.toml", inline);
    bench.file("plain.ngc", "G0 X1\nM2\n");
    for arguments in [
        vec!["run", "--save-materials", "plain.ngc"],
        vec!["run", "--save-materials", "cut.ngc", "--machine", "machine.toml"],
        vec!["check", "--save-materials", "cut.ngc", "--machine", "machine.toml"],
        vec!["run", "--save-materials", "-", "--machine", "machine.toml"],
    ] {
        let refused = bench.retrace(&arguments);
        assert!(refused.code == Some(2) && refused.err.contains("E2120"), "{arguments:?}: {}", refused.err);
    }
    assert_eq!(text(), inline);
}

/// Tube cutting and M159, of which the package has no sample.
#[test]
fn a_tube_is_cut_with_its_z_words_and_pierces_are_described() {
    let bench = Bench::new();
    bench.file(
        "tube.ngc",
        "G21 G90\n#<tube_cut> = 1\n(o=0, pd=0.5)\nF1500\nm159 p601 q2\nm159 p605 q[1.5*2]\nG0 X10 Z30 A0\n\
            G92 Z[#5422 + 0]\nM3 $0 S1\nG1 Z28 F1500\nG1 A360\nM5 $0\nG0 Z40\nM2\n",
    );
    let machine = root().join("examples/plasma/metric-tube.toml").display().to_string();
    let run = bench.retrace(["run", "tube.ngc", "--machine", &machine]);
    assert!(run.code == Some(0) && run.out.contains("A 360.000"), "{} {}", run.err, run.out);
    let plain = root().join("examples/plasma/metric.toml").display().to_string();
    let refused = bench.retrace(["check", "tube.ngc", "--machine", &plain]);
    assert!(refused.code == Some(1) && refused.err.contains("E1409"), "{}", refused.err);
}
