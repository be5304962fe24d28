//! Rows of the acceptance of cutting that take many cases: sources that are welded or do not go out (CUT-5), dry runs
//! of all examples (CUT-8), a spindle in holds (CUT-10), restarts with run-ups (CUT-17, CUT-43), material files
//! (CUT-22, CUT-23), flickers and losses of the contact (CUT-31).
//!
//! Invariant: what is judged comes from the trace of the pins; what the command reports is compared with it.

use retrace_tests::command::{Bench, cases, root};
use retrace_tests::not_run::not_run;
use retrace_tests::pins::{Sample, samples};
use retrace_tests::run::Run;
use retrace_tests::sender::TestRandom;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Input that proves the cutter.
const OK: u64 = 1 << 5;
const TORCH: &str = "[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nok = { input = 5 }\n\
    start = { start_s = 0.3, retry_s = 0.1, pierce_s = 0.2 }\n";
/// 20 mm, 30 mm and an arc of 31.4 mm.
const PROGRAM: &str =
    "G21 G90 F1800\nG0 X5 Y5\nM3\nG1 X25\nM5\nG0 X30\nM3\nG1 X60\nG3 X60 Y25 I0 J10\nM5\nG0 X0 Y0\nM2\n";

fn first_seed() -> u64 {
    std::env::var("RETRACE_FIRST_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(1)
}

fn machine(more: &str) -> String {
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 200\n\
             max_acceleration_mm_per_s2 = 2500\nmax_jerk_mm_per_s3 = 40000\ntravel_mm = [-100, 500]\n"
        )
    };
    format!("{}{}{more}", axis("x"), axis("y"))
}

/// Runs a program on this machine, with more arguments, in one folder for all jobs.
fn run(bench: &Bench, (machine, program): (&str, &str), more: &[&str]) -> (Run, Vec<Sample>) {
    let (machine, part) = (bench.file("m.toml", machine).display().to_string(), bench.file("part.ngc", program));
    let (vcd, bench) = (bench.path("pins.vcd"), bench);
    let trace = vcd.display().to_string();
    let usual = ["--machine", &machine, "--vcd", &trace, "--no-journal"];
    (Run::of(bench, &part, &[&usual, more].concat()), samples(&vcd))
}

fn seconds(from: &Sample, to: &Sample) -> f64 {
    (to.at_us - from.at_us) as f64 / 1e6
}

/// A contact that is active before the start: an alarm, and nothing is lit. One that stays active: an alarm, and the
/// cutter is not lit again.
#[test]
fn a_welded_contact_and_a_source_that_stays_on_are_always_told() {
    let (bench, machine) = (Bench::new(), machine(TORCH));
    let wanted = cases(4);
    for seed in (first_seed()..).take(wanted as usize) {
        let mut chance = TestRandom::new(seed);
        let at = [0; 4].map(|_| chance.below(100));
        let program = format!(
            "G21 G90 F{}\nG0 X{} Y{}\nM3\nG1 X{} Y{}\nM5\nG0 X1 Y1\nM3\nG1 X9\nM5\nM2\n",
            600 + chance.below(3000),
            at[0],
            at[1],
            at[2] + 100,
            at[3]
        );
        for (fault, alarm, lit) in [("welded", "E3022", 0), ("stays-on", "E3023", 1)] {
            let (run, trace) = run(&bench, (&machine, &program), &["--source-faults", &format!("{fault},seed={seed}")]);
            let told = run.report["alarms"][0].as_str().unwrap_or_default();
            assert!(told.starts_with(alarm), "seed {seed}, {fault}: {}", run.report);
            let lights = |pair: &&[Sample]| !pair[0].is_on("spindle") && pair[1].is_on("spindle");
            assert_eq!(trace.windows(2).filter(lights).count(), lit, "seed {seed}, {fault}");
        }
    }
    println!("{wanted} welded contacts and {wanted} sources that stay on are told");
}

/// Bursts of 1 to 9 ms, 20 a second, are no loss, and their number is right; one of 11 to 50 ms is a loss.
#[test]
fn short_flickers_are_no_loss_and_longer_ones_are() {
    let (bench, machine) = (Bench::new(), machine(TORCH));
    let (mut flickers, mut losses) = (0, 0);
    let wanted = cases(10);
    for seed in (first_seed()..).take(wanted as usize) {
        // 20 a second at 30 mm/s
        let short_ms = 1 + seed % 9;
        let spec = format!("flicker-per-m=667,flicker-ms={short_ms},seed={seed}");
        let (short, trace) = run(&bench, (&machine, PROGRAM), &["--source-faults", &spec]);
        let told = format!("seed {seed}: {}", short.output.out);
        let lit = |pair: &&[Sample]| pair[0].is_on("spindle") && pair[1].is_on("spindle");
        let gaps = trace.windows(2).filter(lit).filter(|pair| pair[0].inputs & OK != 0 && pair[1].inputs & OK == 0);
        let gaps = gaps.collect::<Vec<_>>();
        // bursts that overlap are one, which may be longer
        let is_longer = |gap: &[Sample]| {
            let ends = trace.iter().find(|now| now.at_us > gap[1].at_us && now.inputs & OK != 0);
            ends.is_none_or(|ends| seconds(&gap[1], ends) >= 0.0095)
        };
        if !gaps.iter().any(|gap| is_longer(gap)) {
            assert_eq!(short.report["outcome"], "completed", "{told}");
            assert!(short.of_kind("cutter_off").all(|event| event["reason"] != "lost"), "{told}");
            assert_eq!(short.number("cutter_flickers"), gaps.len() as f64, "{told}");
            flickers += gaps.len();
        }
        let long_ms = 11 + seed % 40;
        let spec = format!("flicker-per-m=100,flicker-ms={long_ms},seed={seed}");
        let (long, trace) = run(&bench, (&machine, PROGRAM), &["--source-faults", &spec]);
        let gap = trace.windows(2).filter(lit).find(|pair| pair[0].inputs & OK != 0 && pair[1].inputs & OK == 0);
        let lost = long.of_kind("cutter_off").any(|event| event["reason"] == "lost");
        let dark_s = gap.map_or(0.0, |gap| {
            let off = trace.iter().find(|now| now.at_us > gap[1].at_us && !now.is_on("spindle"));
            off.map_or(f64::INFINITY, |off| seconds(&gap[1], off))
        });
        // the contour may end before the contact was missed for long enough
        let is_told = if lost { (0.009..0.0111).contains(&dark_s) } else { dark_s < 0.010 };
        assert!(is_told, "seed {seed}, {long_ms} ms, off after {dark_s} s: {}", long.output.out);
        losses += u32::from(lost);
    }
    assert!(flickers > 0 && losses > 0, "{flickers} flickers, {losses} losses");
    println!("{wanted} jobs: {flickers} short flickers without a loss, {losses} jobs lost by a longer one");
}

/// A spindle turns in a hold of a minute, in a pause, and between single blocks; it stops on its word, and at the end.
#[test]
fn a_spindle_turns_in_every_hold() {
    let spindle = "[[cutter]]\nname = \"router\"\nkind = \"spindle\"\nfire = 64\n[code.M3]\nduration_ms = 500\n";
    let program = "G21 G90 F1200\nM3 S1000\nG1 X20\nG1 Y20\nG1 X0\nG1 Y0\nG1 X30\nM2\n";
    let script = "at line 3 override 100%\nafter 0.3s hold\nafter 60s resume\nafter 0.2s pause\nafter 60s spindle \
                  stop\nafter 5s spindle start\nafter 3s online\nafter 0s cycle start\nafter 0.5s override 0%\n\
                  after 60s override 100%\nafter 0s single\nafter 60s cycle start\nafter 60s cycle start\n\
                  after 60s cycle start\nafter 0s single\nafter 60s cycle start\n";
    let bench = Bench::new();
    let operator = bench.file("s.op", script).display().to_string();
    let (job, trace) = run(&bench, (&machine(spindle), program), &["--operator", &operator]);
    assert_eq!(job.report["outcome"], "completed", "{}{}", job.output.out, job.output.err);
    let word = job.of_kind("operator").find(|event| event["command"] == "spindle stop").expect("the word");
    let word_s = word["time_s"].as_f64().expect("a time");
    let stops = trace.windows(2).filter(|pair| pair[0].is_on("spindle") && !pair[1].is_on("spindle"));
    let stops: Vec<f64> = stops.map(|pair| pair[1].at_us as f64 / 1e6).collect();
    assert!(stops.len() == 1 && (stops[0] - word_s).abs() < 0.1, "{stops:?} {word_s}: {}", job.output.out);
    // the job ends with the program's last instruction, and the trace with the period before
    let last = job.of_kind("switched").last().expect("the end");
    assert_eq!((&last["code"], &last["line"]), (&"M5".into(), &8.into()), "{}", job.output.out);
    let stood = trace.windows(2).filter(|pair| pair[0].at_rest && pair[0].is_on("spindle"));
    let stood_s: f64 = stood.map(|pair| seconds(&pair[0], &pair[1])).sum();
    assert!(stood_s > 5.0 * 60.0, "{stood_s} s at rest: {}", job.output.out);
}

/// Names in the trace of every output of a cutter in this machine file.
fn cutter_outputs(machine: &str) -> Vec<String> {
    let keys = ["fire", "arm", "assist", "abrasive"];
    let channel = |line: &str| {
        let (key, value) = line.split_once('=')?;
        let number: u32 = value.split('#').next()?.trim().parse().ok()?;
        let is_output = keys.contains(&key.trim());
        is_output.then(|| if number == 64 { "spindle".to_owned() } else { format!("out{number}") })
    };
    machine.lines().filter_map(channel).collect()
}

/// Folder of the sample programs of QtPlasmaC, where Debian's package has them.
const SAMPLES: &str = "/usr/share/doc/linuxcnc/examples/nc_files";

/// No example switches an output of a cutter in a dry run, and each moves as it does otherwise.
#[test]
fn no_example_lights_anything_in_a_dry_run() {
    let examples = root().join("examples");
    let mut jobs: Vec<(PathBuf, PathBuf)> = ["15-plasma", "16-waterjet", "19-lost-pressure", "20-lost-beam"]
        .iter()
        .map(|name| (examples.join(name).with_extension("ngc"), examples.join(name).with_extension("toml")))
        .collect();
    let plasma = examples.join("plasma");
    jobs.push((plasma.join("bracket.ngc"), plasma.join("metric.toml")));
    let listed = std::fs::read_dir(Path::new(SAMPLES).join("plasmac")).into_iter().flatten();
    let found: Vec<PathBuf> = listed.filter_map(|entry| Some(entry.ok()?.path())).collect();
    let samples_found = found.len();
    for path in found.into_iter().chain([Path::new(SAMPLES).join("plasmatest.ngc")]).filter(|path| path.is_file()) {
        let is_inch = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("imperial"));
        if path.extension().is_some_and(|ending| ending == "ngc") {
            jobs.push((path, plasma.join(if is_inch { "imperial.toml" } else { "metric.toml" })));
        }
    }
    let (bench, tools) = (Bench::new(), plasma.join("tools.tbl").display().to_string());
    for (program, machine) in &jobs {
        let outputs = cutter_outputs(&std::fs::read_to_string(machine).expect("a machine file"));
        assert!(!outputs.is_empty(), "{}", machine.display());
        let (machine, vcd) = (machine.display().to_string(), bench.path("pins.vcd"));
        let trace = vcd.display().to_string();
        let arguments = ["--machine", &machine, "--vcd", &trace, "--tools", &tools, "--no-journal"];
        let dry = Run::of(&bench, program, &[&arguments[..], &["--dry-run"]].concat());
        assert_eq!(dry.report["outcome"], "completed", "{}: {}", program.display(), dry.output.err);
        let lit = samples(&vcd).into_iter().find(|sample| outputs.iter().any(|output| sample.is_on(output)));
        assert!(lit.is_none(), "{}: {lit:?}", program.display());
        let wet = Run::of(&bench, program, &arguments);
        assert_eq!(dry.counts(), wet.counts(), "{}", program.display());
        let lit = samples(&vcd).into_iter().any(|sample| outputs.iter().any(|output| sample.is_on(output)));
        assert!(lit, "{} lights nothing at all", program.display());
    }
    println!("{} dry runs", jobs.len());
    if samples_found == 0 {
        not_run("the samples of QtPlasmaC", "Debian's linuxcnc-uspace is not installed");
    }
}

/// A material file of QtPlasmaC with one to six materials, and the number of each.
fn material_file(chance: &mut TestRandom, is_inch: bool) -> String {
    let mut text = String::new();
    let mut number = 0;
    for _ in 0..1 + chance.below(6) {
        number += 1 + chance.below(40);
        let mut figure = |from: usize, to: usize| (from + chance.below(to - from)) as f64 / 1000.0;
        let unit = if is_inch { 25.4 } else { 1.0 };
        let mut length = |from: usize, to: usize| format!("{:.4}", figure(from, to) / unit);
        let lengths = [length(500, 3000), length(1000, 9000), length(500, 3000), length(100_000, 9_000_000)];
        let times = [0; 3].map(|_| format!("{:.2}", figure(0, 2000)));
        let _ = write!(
            text,
            "[MATERIAL_NUMBER_{number}]\nNAME = steel {number}\nKERF_WIDTH = {}\nTHC = {}\nPIERCE_HEIGHT = {}\n\
             PIERCE_DELAY = {}\nPUDDLE_JUMP_HEIGHT = {}\nPUDDLE_JUMP_DELAY = {}\nCUT_HEIGHT = {}\nCUT_SPEED = {}\n\
             CUT_AMPS = {}\nCUT_VOLTS = {}\nPAUSE_AT_END = {}\nGAS_PRESSURE = {}\nCUT_MODE = {}\n",
            lengths[0],
            chance.below(2),
            lengths[1],
            times[0],
            100 + chance.below(50),
            times[1],
            lengths[2],
            lengths[3],
            20 + chance.below(80),
            80 + chance.below(80),
            times[2],
            chance.below(if is_inch { 90 } else { 50 }),
            1 + chance.below(3)
        );
    }
    text
}

/// Lines of a material file, with their figures as numbers.
fn material_lines(text: &str) -> Vec<(String, String)> {
    let lines = text.lines().filter(|line| !line.is_empty() && !line.starts_with('#'));
    lines
        .map(|line| match line.split_once(" = ") {
            Some((key, value)) => {
                let number = value.parse::<f64>().map(|number| format!("{number:.3}"));
                (key.to_owned(), number.unwrap_or_else(|_| value.to_owned()))
            }
            None => (line.to_owned(), String::new()),
        })
        .collect()
}

/// A material file goes into the table and back without a difference; a damaged one is refused with section and key.
#[test]
fn material_files_come_back_and_damaged_ones_are_refused() {
    let bench = Bench::new();
    let wanted = cases(4);
    for seed in (first_seed()..).take(wanted as usize) {
        let mut chance = TestRandom::new(seed);
        let units = ["mm", "inch"][chance.below(2)];
        let text = material_file(&mut chance, units == "inch");
        bench.file("m.cfg", &text);
        let imported = bench.retrace(["materials", "import", "m.cfg", "--units", units]);
        assert_eq!(imported.code, Some(0), "seed {seed}: {}\n{text}", imported.err);
        bench.file("m.toml", &imported.out);
        let exported = bench.retrace(["materials", "export", "m.toml"]);
        assert_eq!(material_lines(&exported.out), sorted_as(&exported.out, &text), "seed {seed}: {text}");
        bench.file("again.cfg", &exported.out);
        let again = bench.retrace(["materials", "import", "again.cfg", "--units", units]);
        assert_eq!(again.out, imported.out, "seed {seed}: the table differs");
        // damaged in one line
        let lines: Vec<&str> = text.lines().collect();
        let keys = ["PIERCE_HEIGHT", "PIERCE_DELAY", "CUT_HEIGHT", "CUT_SPEED"];
        let key = keys[chance.below(keys.len())];
        let of_key: Vec<usize> = (0..lines.len()).filter(|&at| lines[at].starts_with(&format!("{key} ="))).collect();
        let at = of_key[chance.below(of_key.len())];
        let section = lines[..at].iter().rev().find(|line| line.starts_with('[')).expect("a section");
        let damage = chance.below(4);
        let (line, named) = match damage {
            0 => (String::new(), key.to_owned()),
            1 => (format!("{key} = x{}", chance.below(9)), key.to_owned()),
            2 => (format!("{key} = -1"), key.to_owned()),
            _ => (lines[at].replacen('_', "_X", 1), key.replacen('_', "_X", 1)),
        };
        let damaged: Vec<&str> = lines.iter().enumerate().map(|(n, old)| if n == at { &*line } else { *old }).collect();
        bench.file("bad.cfg", damaged.join("\n"));
        let refused = bench.retrace(["materials", "import", "bad.cfg", "--units", units]);
        let is_told = ["E2118", section, &named].iter().all(|part| refused.err.contains(part));
        assert!(refused.code == Some(2) && is_told, "seed {seed}, damage {damage}, {key}: {}", refused.err);
    }
    println!("{wanted} files there and back, {wanted} damaged ones refused");
}

/// The lines of one file in the order of the other: only order and comments may differ.
fn sorted_as(order: &str, text: &str) -> Vec<(String, String)> {
    let sections = |text: &str| -> Vec<Vec<(String, String)>> {
        let mut sections: Vec<Vec<(String, String)>> = Vec::new();
        for line in material_lines(text) {
            if line.0.starts_with('[') {
                sections.push(Vec::new());
            }
            sections.last_mut().expect("a section").push(line);
        }
        sections
    };
    let of = sections(text);
    let mut sorted = Vec::new();
    for section in sections(order) {
        let Some(same) = of.iter().find(|other| other[0] == section[0]) else { continue };
        for (key, _) in &section {
            sorted.extend(same.iter().find(|(other, _)| other == key).cloned());
        }
        assert_eq!(same.len(), section.len(), "{same:?}\n{section:?}");
    }
    sorted
}

/// Codes and outputs of the restarts, in the order of the program; the last one is the jet.
const RUN_UPS: [(&str, &str); 4] = [("M110", "out10"), ("M111", "out11"), ("M112", "out12"), ("M113", "out3")];

/// Whatever was switched off by a hold, by hand or on the way back: it comes back in the order of the program, each
/// with its run-up, and the feed begins only when the last one is ready.
#[test]
fn every_restart_waits_for_the_run_up_of_each_output() {
    let bench = Bench::new();
    let (mut restarts, mut shortest) = (0, f64::INFINITY);
    let wanted = cases(12);
    for seed in (first_seed()..).take(wanted as usize) {
        let mut chance = TestRandom::new(seed);
        let outputs = &RUN_UPS[chance.below(RUN_UPS.len())..];
        let run_ups_s: Vec<f64> = outputs.iter().map(|_| chance.below(5001) as f64 / 1000.0).collect();
        let mut more = String::from("[[cutter]]\nname = \"jet\"\nkind = \"jet\"\nfire = 3\nstanding_ms = 100\n");
        for ((code, output), run_up_s) in outputs.iter().zip(&run_ups_s) {
            let number = output.trim_start_matches("out");
            let _ = write!(more, "[code.{code}]\noutput = {number}\nduration_ms = {:.0}\n", run_up_s * 1000.0);
        }
        let lights: String = outputs.iter().map(|(code, _)| format!("{code}\n")).collect();
        let program = format!("G21 G90 F1800\nG0 X5\n{lights}G1 X45\nG1 Y40\nG1 X5\nM65 P3\nG0 X0 Y0\nM2\n");
        let mut script =
            format!("at {:.2}s hold\n", run_ups_s.iter().sum::<f64>() + 0.6 + chance.below(300) as f64 / 100.0);
        for (_, output) in outputs {
            if chance.below(3) == 0 {
                let _ = writeln!(script, "after 0.5s output {} off", output.trim_start_matches("out"));
            }
        }
        if chance.below(3) == 0 {
            script += "after 0.2s reverse 100%\nafter 0.6s leave\nafter 2s agree\n";
        }
        script += "after 0.5s resume\nafter 1s agree\nafter 40s resume\nafter 1s agree\n";
        let operator = bench.file("s.op", &script).display().to_string();
        let (job, trace) = run(&bench, (&machine(&more), &program), &["--operator", &operator]);
        let told = format!("seed {seed}\n{more}{program}{script}{}", job.output.out);
        assert_eq!(job.report["outcome"], "completed", "{told}{}", job.output.err);
        // since when each output is on
        let mut on_since: Vec<Option<u64>> = vec![None; outputs.len()];
        let mut is_fed = false;
        for (before, now) in std::iter::once(&Sample::default()).chain(&trace).zip(&trace) {
            for (at, (_, output)) in outputs.iter().enumerate() {
                match (before.is_on(output), now.is_on(output)) {
                    (false, true) => {
                        on_since[at] = Some(now.at_us);
                        let earlier = &on_since[..at];
                        assert!(
                            earlier.iter().all(Option::is_some),
                            "{told}: {output} before one that is to be before it"
                        );
                    }
                    (true, false) => on_since[at] = None,
                    _ => {}
                }
            }
            let is_lit = now.is_on("out3") && before.is_on("out3");
            let moves = before.counts != now.counts;
            if is_lit && moves && !is_fed {
                restarts += 1;
                for (at, run_up_s) in run_ups_s.iter().enumerate() {
                    let since_us = on_since[at].unwrap_or_else(|| panic!("{told}: fed without output {at}"));
                    let spare_s = (now.at_us - since_us) as f64 / 1e6 - run_up_s;
                    shortest = shortest.min(spare_s);
                    assert!(spare_s >= 0.0, "{told}: fed {spare_s} s before output {at} is ready");
                }
            }
            // a restart is behind each time that it was off
            is_fed = is_lit && (is_fed || moves);
        }
        assert!(trace.last().is_some_and(|last| !last.is_on("out3")), "{told}");
    }
    println!("{wanted} jobs, {restarts} starts; the feed began at least {shortest:.3} s behind the run-up");
    assert!(restarts > wanted, "{restarts}");
}
