//! Measurements of the planner itself for `cargo xtask bench motion`: quality compared with optima and bounds, and
//! speed.
//!
//! Invariant: one row per goal, in the order of the issue; a row that was not measured is not printed. Rows go to
//! standard output, with fields separated by tabs, for the task that adds the rows of whole programs and writes the
//! page.

mod canon;
mod corners;
mod law_optimum;
mod law_windows;
mod legality;
mod oracle;
mod quality;
mod row;
mod solver;
mod speed;
mod test_paths;

use row::Row;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    // Like every bench: run as a test, it only has to start.
    if !arguments.iter().any(|argument| argument == "--bench") {
        return;
    }
    let full = arguments.iter().any(|argument| argument == "--full");
    let only: Vec<String> = arguments.into_iter().filter(|argument| !argument.starts_with('-')).collect();
    if only == ["optima"] {
        // The table of corners, recomputed.
        print!("{}", corners::table());
        return;
    }
    for Group { names, measure } in ROWS {
        if only.is_empty() || names.iter().any(|name| only.iter().any(|only| only == name)) {
            for row in measure(full) {
                println!("{row}");
            }
        }
    }
}

/// Rows that are measured together.
struct Group {
    names: &'static [&'static str],
    /// Measures the rows; `true` takes the full sizes.
    measure: fn(bool) -> Vec<Row>,
}

/// Every group of rows that is measured together.
const ROWS: &[Group] = &[
    Group { names: &["Q1"], measure: solver::durations },
    Group { names: &["Q2"], measure: quality::cut_line },
    Group { names: &["Q3"], measure: corners::rows },
    Group { names: &["Q4"], measure: quality::windows },
    Group { names: &["Q7", "Q8", "Q9"], measure: legality::rows },
    Group { names: &["Q10"], measure: law_windows::rows },
    Group { names: &["S1"], measure: solver::speed },
    Group { names: &["S2", "S3", "S4", "S5"], measure: speed::rows },
];
