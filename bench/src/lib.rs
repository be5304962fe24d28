//! `cargo xtask bench`: time and memory of the command, compared with other programs and with its goals.
//!
//! Invariant: a figure is the median of runs of this call; what could not be run has no figure and is reported.
#![forbid(unsafe_code)]

mod chart;
mod generate;
mod legality;
mod measured;
mod motion;
mod optimum;
mod peers;
mod pre9;
mod programs;
mod stream;

use retrace_task_support::process::{build, cargo};
use std::path::{Path, PathBuf};
use std::process::Command;

/// One group of measurements.
pub struct Bench {
    /// Its name on the command line.
    pub name: &'static str,
    /// What it measures and which page it writes.
    pub purpose: &'static str,
    run: fn(&Path, bool) -> Result<bool, String>,
}

/// Every group.
pub const BENCHES: &[Bench] = &[
    Bench {
        name: "programs",
        purpose: "decoding compared with rs274, over program length, and from standard input; writes \
            docs/bench-programs.md",
        run: programs::run,
    },
    Bench {
        name: "pre9",
        purpose: "what precompiled cycles and the pre-scan spare (PRE-9); writes docs/pre-scan.md",
        run: pre9::run,
    },
    Bench {
        name: "motion",
        purpose: "plans compared with optima, limits and LinuxCNC's planners, and the speed of planning; writes \
            docs/bench-motion.md",
        run: motion::run,
    },
    Bench {
        name: "optimum",
        purpose: "speed laws compared with the optimum on the same path; writes docs/bench-optimum.md",
        run: optimum::run,
    },
];

/// Runs a group and returns whether all was measured; `full` takes the full sizes.
pub fn run(root: &Path, bench: &Bench, full: bool) -> bool {
    match (bench.run)(root, full) {
        Ok(passed) => passed,
        Err(reason) => {
            eprintln!("xtask: {reason}");
            false
        }
    }
}

/// Builds the command with all optimisation, and returns where cargo put it.
fn build_command(root: &Path) -> Result<PathBuf, String> {
    let arguments = ["build", "--release", "--package", "retrace-cli", "--message-format", "json-render-diagnostics"];
    build(&mut cargo(root, &arguments))
}

/// A folder for the measured files, next to the command.
fn folder(binary: &Path, name: &str) -> Result<PathBuf, String> {
    let folder = binary.parent().unwrap_or(Path::new(".")).join("bench").join(name);
    std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    Ok(folder)
}

/// Date, commit and machine, in general words, as a line of a page.
fn circumstances(root: &Path) -> String {
    let result = |program: &str, arguments: &[&str]| {
        let output = Command::new(program).args(arguments).current_dir(root).output();
        output.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned()).unwrap_or_default()
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load = load.split_whitespace().next().unwrap_or("?").to_owned();
    format!(
        "Measured on {}, after commit {}, {} with {cores} cores, load {load} at the end.",
        result("date", &["+%Y-%m-%d"]),
        result("git", &["rev-parse", "--short=10", "HEAD"]),
        std::env::consts::ARCH,
    )
}
