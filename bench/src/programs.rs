//! Decoding programs: `retrace canon` compared with `rs274 -g`, both with their output discarded.
//!
//! Invariant: both are run in turn within one call, and the start-up time of each, with a program of one line, is
//! subtracted.

use super::generate::{self, Subs};
use super::measured::{Measured, median};
use super::{build_command, circumstances, folder, stream};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// A program, and the required factor over the peer.
struct Case {
    name: &'static str,
    what: &'static str,
    text: Option<Vec<u8>>,
    goal: f64,
}

/// Result of a case: seconds of processor time.
struct Row {
    case: Case,
    lines: usize,
    ours: f64,
    peer: Option<f64>,
}

/// How often each is run.
const ROUNDS: usize = 7;

/// The peer's name.
const PEER: &str = "rs274";

pub(super) fn run(root: &Path, full: bool) -> Result<bool, String> {
    let binary = build_command(root)?;
    let folder = folder(&binary, "programs")?;
    let peer = find_peer();
    if peer.is_none() {
        println!("{PEER} is not installed: our own figures alone");
    }
    let rows = compared(&binary, peer.as_deref(), &folder, ROUNDS)?;
    let growth = growth(&binary, &folder, ROUNDS)?;
    let streamed = stream::measure(&binary, &folder, full)?;
    let page = page(root, &rows, &growth, &streamed);
    println!("\n{page}");
    let path = root.join("docs/bench-programs.md");
    std::fs::write(&path, page).map_err(|error| format!("{}: {error}", path.display()))?;
    let seconds = |name: &str| rows.iter().find(|row| row.case.name == name).map_or(f64::NAN, |row| row.ours);
    // The location of subprograms must not matter; a tenth is the difference of two runs of the same program.
    let is_even = seconds("half calls, behind M2") <= 1.1 * seconds("half calls, first");
    let missed = rows.iter().any(|row| row.peer.is_some_and(|peer| peer / row.ours < row.case.goal));
    Ok(!missed && is_even && streamed.is_within())
}

fn find_peer() -> Option<PathBuf> {
    let folders = std::env::var_os("PATH")?;
    std::env::split_paths(&folders).map(|folder| folder.join(PEER)).find(|path| path.is_file())
}

/// The programs that are compared.
fn cases() -> Vec<Case> {
    let made = |name, what, text: String, goal| Case { name, what, text: Some(text.into_bytes()), goal };
    let real = std::env::var_os("RETRACE_PROGRAMS")
        .and_then(|folder| std::fs::read(PathBuf::from(folder).join("stellabee1.ngc")).ok());
    vec![
        made("plain G1", "feed moves with 2 or 3 axes", generate::plain(200_000), 15.0),
        made("half canned cycles", "G81, G82, G83 and feed moves in turn", generate::canned(100_000), 15.0),
        made(
            "half calls, behind M2",
            "100 subprograms of 2 blocks behind M2, feed moves between the calls",
            generate::calls(50_000, 100, Subs::BehindTheEnd),
            50.0,
        ),
        made(
            "half calls, first",
            "the same with the subprograms before the program, so that no search is needed",
            generate::calls(50_000, 100, Subs::First),
            0.0,
        ),
        made(
            "half calls, 10 behind M2",
            "the same with 10 subprograms: the peer searches for each of them once, through the rest of the program, \
                so the ratio \
             grows with their number and with the length of the program",
            generate::calls(50_000, 10, Subs::BehindTheEnd),
            0.0,
        ),
        made(
            "half calls, 1 000 behind M2",
            "the same with 1 000 different subprograms",
            generate::calls(20_000, 1000, Subs::BehindTheEnd),
            50.0,
        ),
        made(
            "half expressions",
            "assignments and moves with named parameters and functions, feed moves between them",
            generate::expressions(100_000),
            10.0,
        ),
        Case { name: "stellabee1.ngc", what: "a real program for milling", text: real, goal: 10.0 },
    ]
}

/// A running case: its commands, and the results of their runs.
struct Running {
    case: Case,
    lines: usize,
    ours: Measured,
    peer: Option<Measured>,
    our_times: Vec<f64>,
    peer_times: Vec<f64>,
}

/// A peer that takes longer than this, seconds, is not run in every round; its figure varies by little then.
const LONG: f64 = 5.0;

impl Running {
    /// One round: both in turn.
    fn run(&mut self) -> Result<(), String> {
        self.our_times.push(self.ours.run()?.cpu_s);
        let is_long = self.peer_times.len() >= 3 && median(self.peer_times.clone()) > LONG;
        if let (Some(peer), false) = (&self.peer, is_long) {
            self.peer_times.push(peer.run()?.cpu_s);
        }
        Ok(())
    }
}

/// Each case with both programs in turn; a round is over all cases, so that other load affects them alike.
fn compared(ours: &Path, peer: Option<&Path>, folder: &Path, rounds: usize) -> Result<Vec<Row>, String> {
    let running = |case: Case, file: &str, lines: usize| {
        let command = |program: &Path, option: &str| Measured {
            program: program.to_path_buf(),
            arguments: vec![option.into(), file.into()],
            folder: folder.to_path_buf(),
        };
        let (ours, peer) = (command(ours, "canon"), peer.map(|peer| command(peer, "-g")));
        Running { case, lines, ours, peer, our_times: Vec::new(), peer_times: Vec::new() }
    };
    write(folder, "empty.ngc", b"M2\n")?;
    let empty = Case { name: "", what: "", text: None, goal: 0.0 };
    let mut all = vec![running(empty, "empty.ngc", 1)];
    for (index, mut case) in cases().into_iter().enumerate() {
        let Some(text) = case.text.take() else {
            println!("{}: left out, RETRACE_PROGRAMS names no folder that holds it", case.name);
            continue;
        };
        let file = format!("case-{index}.ngc");
        write(folder, &file, &text)?;
        all.push(running(case, &file, text.iter().filter(|byte| **byte == b'\n').count()));
    }
    for round in 1..=rounds {
        println!("round {round} of {rounds}");
        all.iter_mut().try_for_each(Running::run)?;
    }
    let mut starts = (0.0, 0.0);
    let mut rows = Vec::new();
    for (index, Running { case, lines, our_times, peer_times, .. }) in all.into_iter().enumerate() {
        let (ours, theirs) = (median(our_times), median(peer_times));
        if index == 0 {
            starts = (ours, theirs);
            continue;
        }
        let peer = peer.map(|_| (theirs - starts.1).max(1e-9));
        rows.push(Row { case, lines, ours: (ours - starts.0).max(1e-9), peer });
    }
    Ok(rows)
}

fn write(folder: &Path, file: &str, text: &[u8]) -> Result<(), String> {
    let path = folder.join(file);
    std::fs::write(&path, text).map_err(|error| format!("{}: {error}", path.display()))
}

/// Lines and nanoseconds a line of plain programs of growing length.
fn growth(ours: &Path, folder: &Path, rounds: usize) -> Result<Vec<(u64, f64)>, String> {
    let run = |file: &str| Measured {
        program: ours.to_path_buf(),
        arguments: vec!["canon".into(), file.into()],
        folder: folder.to_path_buf(),
    };
    let mut points = Vec::new();
    for lines in [10_000, 100_000, 1_000_000, 10_000_000] {
        write(folder, "long.ngc", generate::plain(lines).as_bytes())?;
        let (mut starts, mut wholes) = (Vec::new(), Vec::new());
        for _ in 0..if lines > 1_000_000 { 3 } else { rounds } {
            starts.push(run("empty.ngc").run()?.cpu_s);
            wholes.push(run("long.ngc").run()?.cpu_s);
        }
        let nanoseconds = (median(wholes) - median(starts)) / lines as f64 * 1e9;
        println!("{lines} lines: {nanoseconds:.0} ns a line");
        points.push((lines, nanoseconds));
    }
    let _ = std::fs::remove_file(folder.join("long.ngc"));
    Ok(points)
}

fn page(root: &Path, rows: &[Row], growth: &[(u64, f64)], streamed: &stream::Streamed) -> String {
    let mut page = String::from(
        "# Decoding programs: figures\n\n\
         Written by `cargo xtask bench programs`; `--full` uses the full sizes. `retrace canon FILE` is compared with \
         `rs274 -g FILE` of\n\
         LinuxCNC, alternately, with discarded output: processor time of the whole process, less the time for a \
         program of one\n\
         line. The bench generates the programs from fixed seeds.\n\n",
    );
    let _ = writeln!(page, "{} Medians of {ROUNDS} rounds.\n", circumstances(root));
    page.push_str(
        "| program | lines | retrace, ms | million lines/s | rs274, ms | ratio | goal \
        |\n|---|--:|--:|--:|--:|--:|--:|\n",
    );
    for row in rows {
        let speed = row.lines as f64 / row.ours / 1e6;
        let (peer, ratio) = row.peer.map_or(("not installed".into(), "-".into()), |peer| {
            (format!("{:.1}", peer * 1e3), format!("{:.1}", peer / row.ours))
        });
        let goal = if row.case.goal > 0.0 { format!("≥ {}", row.case.goal) } else { "-".into() };
        let (name, lines, ours) = (row.case.name, row.lines, row.ours * 1e3);
        let _ = writeln!(page, "| {name} | {lines} | {ours:.2} | {speed:.2} | {peer} | {ratio} | {goal} |");
    }
    page.push('\n');
    for row in rows {
        let _ = writeln!(page, "- {}: {}.", row.case.name, row.case.what);
    }
    page.push_str("\nPlain programs of growing length, `retrace canon` alone:\n\n| lines | ns a line |\n|--:|--:|\n");
    for (lines, nanoseconds) in growth {
        let _ = writeln!(page, "| {lines} | {nanoseconds:.0} |");
    }
    page.push('\n');
    page.push_str(&streamed.text());
    page
}
