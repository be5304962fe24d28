//! Whole programs compared with LinuxCNC's two planners.
//!
//! Invariant: LinuxCNC's times are not measured here: they were taken once with its own planner code, off line, over
//! the same files, and are in a table.

use super::motion::Row;
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

/// A program of LinuxCNC's own tests and examples, and the seconds of motion of LinuxCNC 2.10-pre's default planner,
/// which limits no jerk, and of its jerk-limited one (PLANNER_TYPE 1): 100 mm/s along the path, each axis 100 mm/s, 1
/// 000 mm/s², 20 000 mm/s³, 1 ms, feed as programmed, 0.05 mm where G64 names no P, no tool or spindle time.
struct Peer {
    program: &'static str,
    trapezoid_s: f64,
    s_curve_s: f64,
}

const PEERS: &[Peer] = &[
    Peer { program: "3D_Chips", trapezoid_s: 56.2, s_curve_s: 228.4 },
    Peer { program: "Cereal", trapezoid_s: 211.7, s_curve_s: 316.1 },
    Peer { program: "Pasta", trapezoid_s: 184.8, s_curve_s: 270.6 },
    Peer { program: "LHchips4", trapezoid_s: 211.1, s_curve_s: 848.3 },
    Peer { program: "contour", trapezoid_s: 17.9, s_curve_s: 149.4 },
    Peer { program: "straight_short_lines_X", trapezoid_s: 1.05, s_curve_s: 15.7 },
    Peer { program: "spiral_lines", trapezoid_s: 20.1, s_curve_s: 77.1 },
    Peer { program: "wheels", trapezoid_s: 15.8, s_curve_s: 145.9 },
    Peer { program: "stellabee1", trapezoid_s: 3003.0, s_curve_s: 18704.8 },
    Peer { program: "cds", trapezoid_s: 686.1, s_curve_s: 727.2 },
    Peer { program: "daisy", trapezoid_s: 30.8, s_curve_s: 40.4 },
];

const CONDITIONS: &str = "reference times: LinuxCNC 2.10-pre, its planner code off line; 100 mm/s along the path, \
    each axis 100 mm/s, \
                          1 000 mm/s², 20 000 mm/s³, 1 ms, G64 without P 0.05 mm; ours with the reserve of 10 %, \
                          LinuxCNC without any";

/// Rows of Q5 and Q6, and the emitted records as a part of Q7.
pub(super) fn rows(
    binary: &Path,
    programs: &Path,
    folder: &Path,
    remarks: &mut Vec<String>,
) -> Result<Vec<Row>, String> {
    let machine = four_axes(folder)?;
    let (mut over_s_curve, mut over_trapezoid) = (Vec::new(), Vec::new());
    let (mut broken, mut note) = (0, String::new());
    for peer in PEERS {
        let file = programs.join(format!("{}.ngc", peer.program));
        if !file.is_file() {
            remarks.push(format!("Q5, Q6: {} is left out, it is not in the folder.", peer.program));
            continue;
        }
        let report = played(binary, &file, &["--machine", &machine])?;
        let motion_s = report["motion_s"].as_f64().unwrap_or(f64::NAN);
        broken += report["limit_violations"].as_u64().unwrap_or(u64::MAX);
        over_s_curve.push((peer.program, motion_s / peer.s_curve_s));
        over_trapezoid.push((peer.program, motion_s / peer.trapezoid_s));
        let (s, t) = (motion_s / peer.s_curve_s, motion_s / peer.trapezoid_s);
        let _ = write!(note, "{} {motion_s:.3} s ({s:.3}, {t:.3}); ", peer.program);
    }
    if over_s_curve.is_empty() {
        return Ok(Vec::new());
    }
    let (name, most) = largest(&over_s_curve);
    let (name_t, max_t) = largest(&over_trapezoid);
    let count = over_s_curve.len();
    let q6 = format!("largest {max_t:.3}, {name_t}");
    let what = |of: &str| format!("{count} programs, time over LinuxCNC's {of} planner, geometric mean");
    Ok(vec![
        Row::at_most(
            "Q5",
            &what("S-curve"),
            geometric_mean(&over_s_curve),
            0.36,
            false,
            format!("{note}{CONDITIONS}."),
        ),
        Row::at_most("Q5", &format!("the largest single: {name}"), most, 1.0, true, String::new()),
        Row::at_most("Q6", &what("trapezoid"), geometric_mean(&over_trapezoid), 1.2, false, q6),
        Row::at_most("Q7", "limit violations in those programs", broken as f64, 0.0, false, String::new()),
    ])
}

/// The program with the largest ratio.
fn largest(of: &[(&'static str, f64)]) -> (&'static str, f64) {
    of.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or(("none", f64::NAN))
}

fn geometric_mean(of: &[(&str, f64)]) -> f64 {
    (of.iter().map(|(_, ratio)| ratio.ln()).sum::<f64>() / of.len() as f64).exp()
}

/// A machine file like the built-in machine, with a fourth axis of the same limits, which one program needs.
fn four_axes(folder: &Path) -> Result<String, String> {
    let mut text = String::from("name = \"four axes\"\n");
    for name in ["x", "y", "z", "a"] {
        let travel = if name == "a" { "[-36000.0, 36000.0]" } else { "[-2000.0, 2000.0]" };
        let _ = write!(
            text,
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = 1000.0\nmax_velocity_mm_per_s = 100.0\n\
             max_acceleration_mm_per_s2 = 1000.0\nmax_jerk_mm_per_s3 = 20000.0\ntravel_mm = {travel}\n"
        );
    }
    let path = folder.join("four-axes.toml");
    std::fs::write(&path, text).map_err(|error| format!("{}: {error}", path.display()))?;
    Ok(path.display().to_string())
}

/// Runs a program on the simulated card; returns its report.
pub(super) fn played(binary: &Path, program: &Path, options: &[&str]) -> Result<serde_json::Value, String> {
    println!("{}", program.file_name().unwrap_or_default().display());
    let output = Command::new(binary).arg("run").arg(program).arg("--json").args(options).output();
    let output = output.map_err(|error| format!("{} cannot be run: {error}", binary.display()))?;
    let text = String::from_utf8_lossy(&output.stdout);
    let last = text.lines().last().unwrap_or_default();
    let report: serde_json::Value = serde_json::from_str(last).unwrap_or_default();
    if report["outcome"] == "completed" {
        return Ok(report);
    }
    Err(format!("{} did not come to its end: {last} {}", program.display(), String::from_utf8_lossy(&output.stderr)))
}
