//! Random parts to be cut by a torch, and the machine that cuts them.
//!
//! Invariant: a program depends on its seed alone.

use crate::cut_judge::JudgedMachine;
use crate::sender::TestRandom;
use std::fmt::Write;

const PIERCE_MS: f64 = 200.0;
/// Pulses of each axis in a control period while it moves off its home switch: homing does not find it better.
const HOMED_WITHIN: [i64; 3] = [1, 1, 2];

/// What the judge knows of this machine.
pub const JUDGED: JudgedMachine = JudgedMachine {
    pulses_per_mm: 160.0,
    fire: "spindle",
    input: 5,
    pierce_ms: PIERCE_MS,
    pilot_ms: 298.0,
    has_lead_ins: false,
};

/// The material of a torch that senses. Its heights are equal: the judge knows the pierce, and not the way to the
/// height of the cut.
pub const MATERIALS: &str = "units = \"mm\"\ndefault = 1\n[[material]]\nnumber = 1\nname = \"Steel\"\nkerf_mm = 0\n\
    pierce_height_mm = 3\npierce_delay_s = 0.2\ncut_height_mm = 3\nfeed_mm_per_min = 1800\n";
const SENSE: &str = "materials = \"materials.toml\"\nsense = { contacts = [9], sheet_mm = -20, start_mm = 5, \
    below_mm = 5, probe_mm_per_s = 20, latch_mm_per_s = 5, safe_mm = 8 }\n";

/// Inputs of the home switches.
const HOME_SWITCHES: &str = "[[card.input]]\nnumber = 0\nuse = \"home\"\naxis = \"x\"\n[[card.input]]\nnumber = 1\n\
    use = \"home\"\naxis = \"y\"\n[[card.input]]\nnumber = 2\nuse = \"home\"\naxis = \"z\"\n";

/// What kind of torch and machine a job has.
#[derive(Clone, Copy, Debug)]
pub struct MachineKind {
    /// Whether the torch senses the sheet before each start.
    pub senses: bool,
    /// Whether the axes have home switches.
    pub homes: bool,
}

/// The machine file.
#[must_use]
pub fn machine(kind: MachineKind) -> String {
    let sense = if kind.senses { SENSE } else { "" };
    let mut text = String::new();
    for (axis, pulses, switch) in [("x", 160, "lower"), ("y", 160, "lower"), ("z", 640, "upper")] {
        let _ = writeln!(
            text,
            "[[axis]]\nname = \"{axis}\"\npulses_per_mm = {pulses}\nmax_velocity_mm_per_s = 200\n\
             max_acceleration_mm_per_s2 = 2500\nmax_jerk_mm_per_s3 = 40000\ntravel_mm = [-100, 500]"
        );
        if kind.homes {
            let _ = writeln!(
                text,
                "home = {{ switch = \"{switch}\", position_mm = 0, search_mm_per_s = 150, latch_mm_per_s = 2 }}"
            );
        }
    }
    text + "[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nok = { input = 5 }\ncollision = [7]\n\
            start = { pierce_s = 0.2, start_s = 1, retry_s = 0.5 }\n"
        + sense
        + "[card]\nwatchdog_ms = 2000\n[[card.input]]\nnumber = 13\nuse = \"emergency-stop\"\n"
        + if kind.homes { HOME_SWITCHES } else { "" }
}

/// A program of several contours: lines and arcs, with or without compensation, in subprograms of some depth.
#[must_use]
pub fn program(chance: &mut TestRandom) -> String {
    let depth = chance.below(4);
    let mut subs = String::new();
    let mut text = String::from("G21 G90 G94 F1800 G64 P0.05\n");
    for contour in 0..2 + chance.below(3) {
        let (x, y) = (20 + 60 * contour, 20 + chance.below(40));
        let side = ["G40", "G41.1 D1", "G42.1 D1"][chance.below(3)];
        let mut body = format!("M3 S1\n{side}\nG1 X{} Y{y}\n", x + 10);
        let width = 15 + chance.below(20);
        let _ = match chance.below(3) {
            0 => writeln!(body, "G1 X{} Y{y}\nG1 X{} Y{}\nG1 X{x} Y{}", x + 10 + width, x + 10 + width, y + 12, y + 12),
            1 => writeln!(body, "G3 X{} Y{} I0 J{}\nG1 X{x} Y{}", x + 10, y + 30, 15, y + 30),
            _ => writeln!(body, "G1 X{} Y{}\nG1 X{} Y{}", x + 20, y + 9, x + 10, y + 25),
        };
        body += "G40\nM5\n";
        let _ = writeln!(text, "G0 X{x} Y{y}");
        if depth == 0 {
            text += &body;
            continue;
        }
        let number = 100 * (contour + 1);
        let _ = write!(subs, "o{number} sub\n{body}o{number} endsub\n");
        for level in 1..depth {
            let _ = write!(subs, "o{} sub\no{} call\no{} endsub\n", number + level, number + level - 1, number + level);
        }
        let _ = writeln!(text, "o{} call", number + depth - 1);
    }
    subs + &text + "G0 X0 Y0\nM2\n"
}

/// Whether the counts of a card are those at its pins, within what homing finds a switch.
#[must_use]
pub fn is_homed_at(counts: &[i64], counted: &[i64]) -> bool {
    let is_near = |((count, counted), within): ((&i64, &i64), i64)| (count - counted).abs() <= within;
    counts.iter().zip(counted).zip(HOMED_WITHIN).all(is_near)
}
