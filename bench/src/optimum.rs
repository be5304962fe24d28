//! Speed laws compared with the optimum on the same path: windows of programs of others and of random paths.
//!
//! Invariant: the bench of the planner measures; this task gives it the programs, as `retrace canon` prints them.

use super::motion::{Row, of_bench, table};
use super::{build_command, circumstances, folder};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Programs of which windows are compared.
const PROGRAMS: [&str; 5] = ["stellabee1", "3D_Chips", "LHchips4", "Cereal", "Pasta"];

const HEAD: &str = "# Speed laws compared with the optimum: figures\n\n\
    Written by `cargo xtask bench optimum`. The optimum is the fastest speed law with limited jerk on the same path, \
    between the same two states (`crates/motion/benches/motion/law_optimum.rs`): a sequence of cone programs on a grid \
    of about 1 ms, solved by Clarabel. Windows of up to 1.5 s are drawn by their share of the time, among those that \
    are in motion and have a curve: 8 of each program and one of each of 20 random paths. `RETRACE_SEED` repeats a \
    draw. What a plan loses at stops and in glides, or because it enters a window too slowly, is not in these \
    figures.\n\n";

pub(super) fn run(root: &Path, full: bool) -> Result<bool, String> {
    let binary = build_command(root)?;
    let folder = folder(&binary, "optimum")?;
    let mut remarks = Vec::new();
    match std::env::var_os("RETRACE_PROGRAMS").map(PathBuf::from) {
        Some(programs) => decode(&binary, &programs, &folder, &mut remarks)?,
        None => remarks.push("Only random paths: RETRACE_PROGRAMS names no folder with the programs.".to_owned()),
    }
    let rows = of_bench(root, "retrace-motion", "motion", &["Q10"], Some(&folder), full)?;
    let page = format!("{HEAD}{}\n\n{}", circumstances(root), table(&rows, &remarks));
    println!("\n{page}");
    let path = root.join("docs/bench-optimum.md");
    std::fs::write(&path, page).map_err(|error| format!("{}: {error}", path.display()))?;
    Ok(!rows.iter().any(Row::is_missed))
}

/// Writes the canonical functions of the programs that are in the folder `programs`.
fn decode(binary: &Path, programs: &Path, folder: &Path, remarks: &mut Vec<String>) -> Result<(), String> {
    for name in PROGRAMS {
        let (file, decoded) = (programs.join(format!("{name}.ngc")), folder.join(format!("{name}.canon")));
        if !file.is_file() {
            let _ = std::fs::remove_file(&decoded);
            remarks.push(format!("{name} is left out, it is not in the folder."));
            continue;
        }
        let output = Command::new(binary).arg("canon").arg(&file).output();
        let output = output.map_err(|error| format!("{} cannot be run: {error}", binary.display()))?;
        if !output.status.success() {
            return Err(format!("{}: {}", file.display(), String::from_utf8_lossy(&output.stderr)));
        }
        std::fs::write(&decoded, output.stdout).map_err(|error| format!("{}: {error}", decoded.display()))?;
    }
    Ok(())
}
