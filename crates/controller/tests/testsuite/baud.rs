//! The load of the link: bytes per control period, including all overhead, and motion that never runs dry, forward and
//! backward, at the supported baud rates.

use crate::wired;
use retrace_core::Rate;

use std::path::PathBuf;

use retrace_config::MachineConfig;
use retrace_controller::Outcome;
use retrace_hal_sim::CardSimulatorSettings;
use wired::{Done, Path, Trial, ended_well, good_line, run};

/// A machine with four axes and this control period in ms.
fn machine(period_ms: f64) -> MachineConfig {
    let mut file = format!("control_period_ms = {period_ms}\n");
    for axis in ["x", "y", "z", "a"] {
        file += &format!(
            "[[axis]]\nname = \"{axis}\"\npulses_per_mm = 1000.0\nmax_velocity_mm_per_s = 100.0\n\
             max_acceleration_mm_per_s2 = 1000.0\nmax_jerk_mm_per_s3 = 20000.0\ntravel_mm = [-2000.0, 2000.0]\n"
        );
    }
    MachineConfig::parse(&file, "four axes").expect("valid")
}

/// The numbered examples that run on a machine without further files, and real programs where a folder of them is
/// given.
fn programs() -> Vec<PathBuf> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../examples");
    let mut all: Vec<PathBuf> = ["01-first-cut.ngc", "03-waterjet.ngc"].iter().map(|name| root.join(name)).collect();
    all.retain(|path| path.exists());
    if let Some(folder) = std::env::var_os("RETRACE_PROGRAMS") {
        let entries = std::fs::read_dir(folder).expect("the folder of programs");
        all.extend(
            entries
                .filter_map(|entry| Some(entry.ok()?.path()))
                .filter(|path| path.extension().is_some_and(|e| e == "ngc")),
        );
    }
    all.sort();
    all
}

fn over(machine: &MachineConfig, program: &str, script: &str, baud: u32) -> Done {
    let rig = CardSimulatorSettings { up: good_line(baud), down: good_line(baud), ..CardSimulatorSettings::default() };
    run(Trial { machine, program, script, rig, pulled: Vec::new(), tapped: false }).expect("opened")
}

/// Bytes per period: from the host, from the card.
fn cost(done: &Done) -> [f64; 2] {
    [done.line.written, done.line.read].map(|bytes| bytes as f64 / done.periods as f64)
}

/// The first lines of a program, with an end.
fn beginning(text: &str, lines: usize) -> String {
    let mut text: String =
        text.lines().filter(|line| !line.trim().starts_with('%')).take(lines).fold(String::new(), |t, l| t + l + "\n");
    text.push_str("M2\n");
    text
}

#[test]
fn twelve_bytes_a_period_are_enough_and_nothing_runs_dry() {
    for (period_ms, baud) in [(1.0, 230_400), (2.0, 115_200)] {
        let machine = machine(period_ms);
        for file in programs() {
            let text = beginning(&std::fs::read_to_string(&file).expect("a program"), 400);
            let name = file.file_name().expect("a file").to_string_lossy().into_owned();
            let done = over(&machine, &text, "", baud);
            if let Outcome::BlockError(why) = &done.outcome {
                // its beginning alone is not a program
                println!("{name}: left out: {why}");
                continue;
            }
            assert!(done.completed(), "{name}: {:?}", done.outcome);
            let [up, down] = cost(&done);
            println!(
                "{name} at {period_ms} ms over {baud} baud: {up:.2} + {down:.2} bytes a period, {} underruns",
                done.underruns
            );
            assert!(up + down <= 12.0, "{name}: {up} + {down} bytes a period");
            assert_eq!(done.underruns, 0, "{name}: {:?}", done.events);
        }
    }
}

#[test]
fn backward_at_full_rate_nothing_runs_dry_either() {
    let path_of = |turns: u32| {
        let mut text = String::from("G21 G90 G17 G64 P0.02\nF5400\nG1 X20\n");
        for k in 0..turns {
            text += &format!("G2 X20 Y0 I-20 J0\nG1 X{} Y0.5\nG1 X20 Y0\n", 19.0 + f64::from(k % 2) / 2.0);
        }
        text + "M2\n"
    };
    for (period_ms, baud) in [(1.0, 230_400), (2.0, 115_200)] {
        let machine = machine(period_ms);
        let program = path_of(5);
        let path = Path::of(&machine, &program);
        let done = over(&machine, &program, "at 6s reverse 100%\nafter 5s forward 100%\nafter 3s leave\n", baud);
        ended_well(&path, &done).expect("it ends well");
        assert!(done.completed() && done.underruns == 0, "{:?}", done.outcome);
        let dry = done.log.iter().filter(|period| period.rate < Rate::ZERO && period.short).count();
        let back = done.log.iter().filter(|period| period.rate < Rate::ZERO).count();
        let [up, down] = cost(&done);
        println!(
            "back for {back} periods of {period_ms} ms over {baud} baud: {dry} held down; {up:.2} + {down:.2} bytes a \
                period"
        );
        assert_eq!(dry, 0);
        assert!(up + down <= 12.0);
    }
}
