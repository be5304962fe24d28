//! What `cargo xtask bench motion` measures of the planner itself: quality beside optima and bounds, and speed.
//!
//! Invariant: one row a goal, in the order of the issue; a row that was not measured is not printed. Rows go to standard output,
//! fields parted by tabs, for the task that adds the rows of whole programs and writes the page.

mod corners;
mod oracle;
mod quality;
mod roads;
mod row;
mod speed;

use row::Row;

/// What is asked for on the command line.
struct Asked {
    full: bool,
    /// Rows to measure; all where it is empty.
    only: Vec<String>,
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    // As every bench is: run as a test, it only has to start.
    if !arguments.iter().any(|argument| argument == "--bench") {
        return;
    }
    let full = arguments.iter().any(|argument| argument == "--full");
    let only: Vec<String> = arguments.into_iter().filter(|argument| !argument.starts_with('-')).collect();
    if only == ["optima"] {
        // The table of corners, made anew.
        print!("{}", corners::table());
        return;
    }
    let asked = Asked { full, only };
    for (names, measure) in ROWS {
        if asked.only.is_empty() || names.iter().any(|name| asked.only.iter().any(|only| only == name)) {
            for row in measure(asked.full) {
                println!("{row}");
            }
        }
    }
}

/// Measures some rows; `true` takes the full sizes.
type Measure = fn(bool) -> Vec<Row>;

/// Every group of rows that is measured together.
const ROWS: &[(&[&str], Measure)] =
    &[(&["Q2"], quality::cut_line), (&["Q3"], corners::rows), (&["S2", "S3", "S4", "S5"], speed::rows)];
