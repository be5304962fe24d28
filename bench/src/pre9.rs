//! Savings of precompiled cycles and the pre-scan (PRE-9): the measurement of the example `pre9`, as a page with a
//! table and a plot.
//!
//! Invariant: page and plot show the same figures, those of this call.

use super::chart::{self, Panel};
use super::circumstances;
use retrace_task_support::process::cargo;
use std::fmt::Write as _;
use std::path::Path;
use std::process::Stdio;

/// The measured programs: their names in the example, and the quantity that grows in them.
const SERIES: [(&str, &str); 3] =
    [("cycles", "lines that call a cycle"), ("jumps", "lines that call a subprogram"), ("both", "lines of each kind")];

/// The variants, in the order of the example's columns.
const WAYS: [&str; 4] = ["line by line", "precompiled cycles", "pre-scan", "both"];

/// A measured program: its series, the share in per cent, and milliseconds of each variant.
struct Row {
    series: String,
    share: u32,
    taken: [f64; 4],
}

pub(super) fn run(root: &Path, _full: bool) -> Result<bool, String> {
    let rows = measured(root)?;
    let write =
        |path: &str, text: String| std::fs::write(root.join(path), text).map_err(|error| format!("{path}: {error}"));
    write("docs/figures/pre-scan.svg", plot(&rows))?;
    let page = page(root, &rows);
    println!("{page}");
    write("docs/pre-scan.md", page)?;
    Ok(spared(&rows, "cycles", 1) && spared(&rows, "jumps", 2) && spared(&rows, "both", 3))
}

fn measured(root: &Path) -> Result<Vec<Row>, String> {
    let arguments = ["run", "--quiet", "--release", "--package", "retrace-gcode", "--example", "pre9"];
    let output = cargo(root, &arguments).stderr(Stdio::inherit()).output();
    let output = output.map_err(|error| format!("cargo cannot be run: {error}"))?;
    if !output.status.success() {
        return Err(format!("the example `pre9`: {}", output.status));
    }
    let text = String::from_utf8_lossy(&output.stdout);
    let rows: Option<Vec<Row>> = text.lines().map(row).collect();
    rows.filter(|rows| !rows.is_empty()).ok_or_else(|| "the example `pre9` printed something else".into())
}

fn row(line: &str) -> Option<Row> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let [series, share, taken @ ..] = words.as_slice() else { return None };
    let taken: Vec<f64> = taken.iter().map(|word| word.parse().ok()).collect::<Option<_>>()?;
    Some(Row { series: (*series).into(), share: share.parse().ok()?, taken: taken.try_into().ok()? })
}

/// Whether the saving of a variant grows with the share, from the smallest share to the greatest.
fn spared(rows: &[Row], series: &str, way: usize) -> bool {
    let mut of_series = rows.iter().filter(|row| row.series == series).map(|row| row.taken[0] - row.taken[way]);
    let first = of_series.next().unwrap_or(f64::NAN);
    of_series.next_back().is_some_and(|last| last > first && last > 0.0)
}

fn plot(rows: &[Row]) -> String {
    let panels = SERIES.map(|(name, title)| {
        let of_series: Vec<&Row> = rows.iter().filter(|row| row.series == name).collect();
        let lines = [0, 1, 2, 3]
            .map(|way| of_series.iter().map(|row| (f64::from(row.share), row.taken[way])).collect::<Vec<_>>());
        Panel { title: title.to_owned(), lines: lines.to_vec() }
    });
    chart::draw(&panels, &WAYS, "share of the lines, %", "ms")
}

fn page(root: &Path, rows: &[Row]) -> String {
    let mut page = String::from(
        "# What precompiled cycles and the pre-scan save\n\n\
         Written by `cargo xtask bench pre9`. Programs of 10 000 lines with a growing share of lines that call a \
         cycle (`CYCLE81`)\n\
         or a subprogram (20 of them, with two blocks each, behind M2), the rest feed moves, are decoded to the text \
         of their\n\
         canonical functions in four ways:\n\n\
         - **line by line**: at every call the cycle is read from its file and compiled; a call of a subprogram \
         searches the\n  \
         text for it, from the current line and then from the beginning, and its lines are read again each time;\n\
         - **precompiled cycles** (PRE-1 to PRE-3): the cycle is compiled once, before the program;\n\
         - **pre-scan** (PRE-5, PRE-6): every jump has its target, and the lines of subprograms are compiled, when \
         the program is\n  \
         opened, which is part of the time; the cycle is still compiled at every call;\n\
         - **both**: what `retrace` does.\n\n\
         Reading, executing and printing a block are the same code in all four, and a test checks that their \
         canonical functions are\n\
         the same. In the last third of the table the share is that of each kind: at 50 % every line is a call.\n\n",
    );
    let _ = writeln!(page, "{} Medians of 7 runs in turn, milliseconds.\n", circumstances(root));
    let _ = writeln!(page, "![Time over share, four ways](figures/pre-scan.svg)\n");
    let _ =
        writeln!(page, "| share of | % | {} | line by line / both |\n|---|--:|--:|--:|--:|--:|--:|", WAYS.join(" | "));
    for row in rows {
        let title = SERIES.iter().find(|(name, _)| *name == row.series).map_or("", |(_, title)| title);
        let [plain, cycles, prescan, both] = row.taken;
        let (share, ratio) = (row.share, plain / both);
        let _ =
            writeln!(page, "| {title} | {share} | {plain:.2} | {cycles:.2} | {prescan:.2} | {both:.2} | {ratio:.1} |");
    }
    let at = |series: &str, share| rows.iter().find(|row| row.series == series && row.share == share);
    if let (Some(cycles), Some(jumps)) = (at("cycles", 50), at("jumps", 50)) {
        let idle = super::measured::median(
            rows.iter().filter(|row| row.share == 0).map(|row| row.taken[2] / row.taken[0]).collect(),
        );
        let _ = writeln!(
            page,
            "\nBoth effects grow with the share. With half of the lines calls of a cycle, precompiling makes decoding \
                {:.1} times as fast;\n\
             with half of them calls of a subprogram, the pre-scan makes it {:.1} times as fast. A program without \
             either takes {:.2} times\n\
             as long with the pre-scan, which reads each line once more.",
            cycles.taken[0] / cycles.taken[1],
            jumps.taken[0] / jumps.taken[2],
            idle,
        );
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_read_and_what_is_none_is_refused() {
        let read = row("jumps 30 4.5 4 3 2.25").expect("a row");
        assert_eq!((read.series.as_str(), read.share, read.taken), ("jumps", 30, [4.5, 4.0, 3.0, 2.25]));
        assert!(row("jumps 30 4.5 4 3").is_none() && row("jumps x 1 2 3 4").is_none() && row("").is_none());
    }

    #[test]
    fn a_saving_that_does_not_grow_is_seen() {
        let rows = |last: f64| {
            let row = |share, taken| Row { series: "jumps".into(), share, taken };
            [row(0, [5.0, 5.0, 5.0, 5.0]), row(50, [last, 5.0, 5.0, 5.0])]
        };
        assert!(spared(&rows(9.0), "jumps", 2) && !spared(&rows(5.0), "jumps", 2) && !spared(&rows(9.0), "none", 2));
    }
}
