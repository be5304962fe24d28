//! Programs that tests generate, and the location of real ones.

use crate::command::root;
use std::fmt::Write;
use std::path::PathBuf;

/// The numbered examples of the project, in their order.
///
/// # Panics
/// Where their folder cannot be read.
#[must_use]
pub fn examples() -> Vec<PathBuf> {
    let folder = std::fs::read_dir(root().join("examples")).expect("the examples");
    let mut programs: Vec<PathBuf> = folder
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|ending| ending == "ngc"))
        // The others are subprograms that these call.
        .filter(|path| path.file_name().is_some_and(|name| name.as_encoded_bytes()[0].is_ascii_digit()))
        .collect();
    programs.sort();
    programs
}

/// A program of `moves` moves to and fro of `mm` along X, with a full stop after each.
#[must_use]
pub fn full_stops(moves: u32, mm: f64) -> String {
    let mut program = String::from("G21 G90 G61.1\nF6000\n");
    for number in 0..moves {
        let _ = writeln!(program, "G1 X{}", if number % 2 == 0 { mm } else { 0.0 });
    }
    program.push_str("M2\n");
    program
}

/// A program that traces a rounded rectangle repeatedly until it has about `minutes` of motion at 50 mm/s.
#[must_use]
pub fn long_job(minutes: u32) -> String {
    let mut program = String::from("G21 G90 G17 G64 P0.05\nF3000\nG0 X10 Y0\n");
    // 2 · (80 + 40) mm of sides and a circle of radius 10.
    let lap_s = (240.0 + 20.0 * std::f64::consts::PI) / 50.0;
    let laps = (f64::from(minutes) * 60.0 / lap_s).ceil() as u32;
    for lap in 0..laps {
        let z = f64::from(lap) / f64::from(laps) * -10.0;
        let _ = writeln!(
            program,
            "G1 X90 Z{z:.4}\nG3 X100 Y10 I0 J10\nG1 Y50\nG3 X90 Y60 I-10 J0\nG1 X10\nG3 X0 Y50 I0 J-10\nG1 Y10\nG3 \
                X10 Y0 I10 J0"
        );
    }
    program.push_str("M2\n");
    program
}
