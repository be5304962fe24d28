//! Motion: distance of plans from the optimum, compared with LinuxCNC's planners, and the cost of planning.
//!
//! Invariant: every figure is of this call, except LinuxCNC's times and the optima of corners, whose origin is given.

use super::{build_command, circumstances, folder};
use retrace_task_support::process;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Stdio;

/// A row of the table as the benches of the crates print it: name, quantity, figure, goal, verdict, note.
pub(super) struct Row(pub(super) [String; 6]);

impl Row {
    /// A row whose figure must be at most `most`, or below it where `strictly`.
    pub(super) fn at_most(name: &str, what: &str, figure: f64, most: f64, strictly: bool, note: String) -> Self {
        let is_met = if strictly { figure < most } else { figure <= most };
        let sign = if strictly { '<' } else { '≤' };
        let verdict = if is_met { "met" } else { "missed" };
        Self([name.into(), what.into(), format!("{figure:.4}"), format!("{sign} {most}"), verdict.into(), note])
    }

    fn read(line: &str) -> Option<Self> {
        let mut fields = line.strip_prefix("row\t")?.split('\t').map(str::to_owned);
        let mut next = || fields.next();
        Some(Self([next()?, next()?, next()?, next()?, next()?, next().unwrap_or_default()]))
    }

    pub(super) fn is_missed(&self) -> bool {
        self.0[4] == "missed"
    }
}

pub(super) fn run(root: &Path, full: bool) -> Result<bool, String> {
    let mut rows = of_bench(root, "retrace-motion", "motion", ALL_BUT_Q10, None, full)?;
    rows.extend(of_bench(root, "retrace-controller", "job", &[], None, full)?);
    let binary = build_command(root)?;
    let folder = folder(&binary, "motion")?;
    let mut remarks = Vec::new();
    match std::env::var_os("RETRACE_PROGRAMS").map(PathBuf::from) {
        Some(programs) => rows.extend(super::peers::rows(&binary, &programs, &folder, &mut remarks)?),
        None => remarks.push("Q5, Q6: left out, RETRACE_PROGRAMS names no folder with the programs.".to_owned()),
    }
    rows.extend(super::legality::rows(&binary, &folder)?);
    rows.sort_by(|a, b| a.0[0].cmp(&b.0[0]));
    let page = page(root, &rows, &remarks);
    println!("\n{page}");
    let path = root.join("docs/bench-motion.md");
    std::fs::write(&path, page).map_err(|error| format!("{}: {error}", path.display()))?;
    Ok(!rows.iter().any(Row::is_missed))
}

/// Rows of the planner's bench that the page of motion has; the bench of optima has its own.
const ALL_BUT_Q10: &[&str] = &["Q1", "Q2", "Q3", "Q4", "Q7", "S1", "S2"];

/// The rows that a crate's bench prints: those of the groups with these names, or all. The bench finds decoded programs
/// in the folder `canon`.
pub(super) fn of_bench(
    root: &Path,
    package: &str,
    bench: &str,
    names: &[&str],
    canon: Option<&Path>,
    full: bool,
) -> Result<Vec<Row>, String> {
    println!("{package}: {bench}");
    let mut command = process::cargo(root, &["bench", "--package", package, "--bench", bench, "--"]);
    command.args(names);
    if let Some(canon) = canon {
        command.env("RETRACE_CANON", canon);
    }
    if full {
        command.arg("--full");
    }
    let output = command.stderr(Stdio::inherit()).output().map_err(|error| format!("cargo cannot be run: {error}"))?;
    if !output.status.success() {
        return Err(format!("the bench {bench} of {package} failed"));
    }
    let text = String::from_utf8_lossy(&output.stdout);
    print!("{text}");
    Ok(text.lines().filter_map(Row::read).collect())
}

fn page(root: &Path, rows: &[Row], remarks: &[String]) -> String {
    let mut page = String::from(
        "# Motion: figures\n\n\
         Written by `cargo xtask bench motion`; `--full` uses the full sizes. All rows are for the built-in machine \
         (100 mm/s,\n\
         1 000 mm/s², 20 000 mm/s³ each axis, 1 ms, a reserve of 10 % of acceleration and jerk) unless a row says \
         otherwise.\n\
         Times are in whole periods. The bench generates paths from formulas and fixed seeds; LinuxCNC's times were \
         measured\n\
         once, under the conditions given below. rsruckig's time (S1) shows how fast the computer was in this run.\n\n",
    );
    let _ = writeln!(page, "{}\n", circumstances(root));
    page + &table(rows, remarks)
}

/// The rows as a table, with their notes below it.
pub(super) fn table(rows: &[Row], remarks: &[String]) -> String {
    let mut page = String::from("| # | what | figure | goal | |\n|---|---|--:|--:|---|\n");
    for Row([name, what, figure, goal, verdict, _]) in rows {
        let verdict = if verdict == "missed" { "**missed**" } else { verdict };
        let _ = writeln!(page, "| {name} | {what} | {figure} | {goal} | {verdict} |");
    }
    page.push_str("\nConditions and details:\n\n");
    for Row([name, what, .., note]) in rows {
        if !note.is_empty() {
            let _ = writeln!(page, "- {name}, {what}: {note}");
        }
    }
    for remark in remarks {
        let _ = writeln!(page, "- {remark}");
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_is_read_as_it_is_printed() {
        let row = Row::read("row\tQ2\tcut line\t1.0071\t≤ 1.001\tmissed\tper piece").expect("a row");
        assert!(row.is_missed() && row.0[5] == "per piece");
        assert!(Row::read("Running benches").is_none() && Row::read("row\tQ2").is_none());
        assert!(Row::at_most("Q5", "", 1.0, 1.0, true, String::new()).is_missed());
        assert!(!Row::at_most("Q5", "", 1.0, 1.0, false, String::new()).is_missed());
    }
}
