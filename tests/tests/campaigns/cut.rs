//! The journal of a job that ended in a blend, in a loop, while going back and while streaming, cut at every write and
//! at every byte of its last records: the rest is resumed and reaches the exact end, or it is refused with the reason.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use retrace_tests::command::{Bench, cases};
use serde_json::Value;

/// Blends, a loop in a subprogram, codes with a duration and synchronous ones.
const PROGRAM: &str = "G21 G90 G94 F3000\nG64 P0.5\nM3 S1000\nG1 X10\nM62 P10\nX12 Y5\nX5 Y9\nM63 P10\nO100 sub\nO101 \
    repeat [3]\nG91\nM62 P12\nG1 X3 Y1\n\
    X-3 Y2 Z-0.5\nM63 P12\nX1\nG90\nO101 endrepeat\nO100 endsub\nO100 call\nM8\nG4 P0.3\nG1 X6 Y-4\nG3 X12 Y2 I0 \
    J6\nM9\nG1 X0 Y0 Z0\nX11.111 Y7.007 Z-3.3\nM5\nM2\n";
/// Its end, in pulses.
const END: [i64; 3] = [11_111, 7_007, -3_300];

/// A job that did not reach its end, and its journal.
struct InterruptedJob {
    bench: Bench,
    folder: PathBuf,
    journal: Vec<u8>,
}

/// Runs the program until the operator stops it; the journal must record where.
fn interrupted_job(program: &str, operator: &str, stood: &str) -> InterruptedJob {
    let bench = Bench::new();
    bench.file("part.ngc", PROGRAM);
    bench.file("stop.op", operator);
    let input = if program == "-" { PROGRAM } else { "" };
    let result = bench
        .retrace_reading(["run", program, "--operator", "stop.op", "--json", "--journal", "jobs"], input.as_bytes());
    assert_eq!(result.code, Some(4), "{}\n{}", result.out, result.err);
    let mut jobs = fs::read_dir(bench.path("jobs")).expect("a folder of jobs");
    let folder = jobs.next().expect("a job").expect("a job").path();
    let journal = fs::read(folder.join("journal")).expect("a journal");
    let text = String::from_utf8_lossy(&journal).into_owned();
    let last = text.lines().rev().find(|line| line.contains("{\"position\":")).expect("a place");
    assert!(last.contains(stood), "{stood}: {last}");
    InterruptedJob { bench, folder, journal }
}

/// Lengths to which the journal is cut: the end of every line, every byte of the last two before the one with the
/// outcome of the job, which a killed job does not have, and some of that one. `wanted` of them, evenly distributed.
fn cuts(journal: &[u8], wanted: usize) -> Vec<usize> {
    let ends: Vec<usize> = (0..journal.len()).filter(|&at| journal[at] == b'\n').map(|at| at + 1).collect();
    let last = ends.len() - 1;
    let bytes = ends[last - 3]..=ends[last - 1];
    let mut all: Vec<usize> =
        ends.into_iter().chain(bytes.clone()).chain((*bytes.end()..journal.len()).step_by(50)).collect();
    all.sort_unstable();
    all.dedup();
    let every = all.len().div_ceil(wanted.max(1));
    all.into_iter().rev().step_by(every).collect()
}

impl InterruptedJob {
    /// Resumes the job after its journal was cut to this length; returns the result.
    fn resume_after_cut(&self, length: usize) -> String {
        let jobs = self.bench.path("cut");
        let _ = fs::remove_dir_all(&jobs);
        copy(&self.folder, &jobs.join(self.folder.file_name().expect("a name")), &self.journal[..length]);
        let resume = ["resume", "--yes", "--json", "--journal", "cut"];
        let mut result = self.bench.retrace(resume);
        let mut how = "completed".to_owned();
        if result.code != Some(0) && result.err.contains("E2208") {
            result = self.bench.retrace(resume.into_iter().chain(["--program", "part.ngc"]));
            how = "completed, sent again".to_owned();
        }
        let told = format!("cut to {length} of {}: {}\n{}", self.journal.len(), result.out, result.err);
        if result.code == Some(0) {
            let report: Value = serde_json::from_str(result.out.lines().last().unwrap_or_default()).expect("a report");
            let counts = ["x", "y", "z"].map(|axis| report["position_counts"][axis].as_i64());
            assert_eq!((counts, report["outcome"].as_str()), (END.map(Some), Some("completed")), "{told}");
            assert_eq!(report["limit_violations"], 0, "{told}");
            return how;
        }
        let number = ["E2204", "E2209"].into_iter().find(|number| result.err.contains(number));
        let number = number.unwrap_or_else(|| panic!("{told}"));
        assert!(result.code == Some(2) && result.err.contains("help:"), "{told}");
        // only a job that never began cannot be resumed
        let begins = self.journal.iter().position(|&byte| byte == b'\n').map_or(0, |at| at + 1);
        assert!(length < begins, "{told}");
        format!("refused with {number}")
    }

    /// Cuts it everywhere.
    fn cut_everywhere(&self, name: &str) {
        let mut counted: BTreeMap<String, u32> = BTreeMap::new();
        for length in cuts(&self.journal, cases(6) as usize) {
            *counted.entry(self.resume_after_cut(length)).or_default() += 1;
        }
        println!("{name}: {} bytes, {counted:?}", self.journal.len());
        assert!(counted.contains_key("completed") || counted.contains_key("completed, sent again"), "{counted:?}");
    }
}

fn copy(from: &Path, to: &Path, journal: &[u8]) {
    fs::create_dir_all(to).expect("a folder");
    for file in fs::read_dir(from).expect("a job's folder") {
        let file = file.expect("a file");
        // the output at the end of the job did not exist yet
        if file.file_name() != "report.json" {
            fs::copy(file.path(), to.join(file.file_name())).expect("a copy");
        }
    }
    fs::write(to.join("journal"), journal).expect("a cut journal");
}

#[test]
fn left_in_a_blend() {
    interrupted_job("part.ngc", "at 0.47s stop\n", "\"line\":7").cut_everywhere("blend");
}

#[test]
fn left_in_the_loop_of_a_subprogram() {
    interrupted_job("part.ngc", "at 1.2s stop\n", "\"line\":1").cut_everywhere("loop");
}

#[test]
fn left_while_going_back() {
    interrupted_job("part.ngc", "at 1s hold\nafter 0.2s reverse 100%\nafter 0.3s stop\n", "\"mode\":\"reverse\"")
        .cut_everywhere("going back");
}

#[test]
fn left_while_it_arrived() {
    interrupted_job("-", "at 1.2s stop\n", "\"line\":1").cut_everywhere("stream");
}

#[test]
fn a_job_that_never_began_is_refused() {
    let left = interrupted_job("part.ngc", "at 0.47s stop\n", "");
    let begins = left.journal.iter().position(|&byte| byte == b'\n').expect("a line");
    for length in [0, 1, begins / 2, begins] {
        assert!(left.resume_after_cut(length).starts_with("refused"), "{length}");
    }
}
