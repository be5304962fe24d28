//! Runs the judge of cuts, a program of its own (`tests/judge`), on the traces of two jobs.
//!
//! Invariant: the judge gets the two files and the figures of the machine, and nothing else.

use crate::command::{at_lower_priority, built};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Longest time in ms that a card waits at rest for the next instruction with the cutter on, with some periods until
/// the cutter is off.
const HANDOVER_MS: u32 = 102;

/// What the judge knows of the machine.
#[derive(Clone, Copy, Debug)]
pub struct JudgedMachine {
    /// Pulses per mm of X and Y.
    pub pulses_per_mm: f64,
    /// Name of the output that fires.
    pub fire: &'static str,
    /// Number of the input that proves the cutter.
    pub input: u32,
    /// Time in ms from the proof to the first motion.
    pub pierce_ms: f64,
    /// Shortest time in ms from the ignition to the first motion.
    pub pilot_ms: f64,
    /// Whether the job may have lead-ins of shifted starts.
    pub has_lead_ins: bool,
}

/// What the judge found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verdict {
    /// What the judge says of all figures together.
    pub good: bool,
    /// Cells of the sheet that the uninterrupted job cut and the other did not.
    pub not_cut: u64,
    /// Cells that only the interrupted job cut.
    pub cut_besides: u64,
    /// Length in records of the gaps of more than one record that only the uninterrupted job cut.
    pub records_not_cut: f64,
    /// Samples at a place of the uninterrupted job with other counts.
    pub wrong_counts: u64,
    /// Ignitions at which motion began too early.
    pub too_early: u64,
    /// Times that the cutter was on at rest for too long.
    pub standing: u64,
    /// Samples with the cutter on and the path running backward.
    pub backward: u64,
    /// Samples with the cutter on in a rapid.
    pub lit_in_rapid: u64,
    /// Times that the cutter was on with an alarm latched for too long.
    pub lit_under_alarm: u64,
    /// Whether the cutter was on for too long behind the last motion.
    pub lit_after_motion: bool,
    /// Ignitions at a place at which the uninterrupted job never has the cutter on.
    pub ignited_elsewhere: u64,
    /// Whether the cutter is on at the end.
    pub on_at_end: bool,
    /// Number of ignitions.
    pub ignitions: u64,
    /// Length in mm that was cut, with what was cut twice.
    pub cut_mm: f64,
}

impl Verdict {
    /// Whether the part is whole and the cutter was never on where it must not be: the `good` of the judge, and of a
    /// verdict in which a test has replaced figures.
    #[must_use]
    pub fn is_good(&self) -> bool {
        let Self { good, ignitions, cut_mm, .. } = *self;
        *self == Self { good, ignitions, cut_mm, ..Self::default() }
    }

    fn parse(line: &str) -> Option<Self> {
        let object: Value = serde_json::from_str(line).ok()?;
        let (count, number) = (|name: &str| object[name].as_u64(), |name: &str| object[name].as_f64());
        let is_true = |name: &str| object[name].as_bool();
        Some(Self {
            good: is_true("good")?,
            not_cut: count("not_cut")?,
            cut_besides: count("cut_besides")?,
            records_not_cut: number("records_not_cut")?,
            wrong_counts: count("wrong_counts")?,
            too_early: count("too_early")?,
            standing: count("standing")?,
            backward: count("backward")?,
            lit_in_rapid: count("lit_in_rapid")?,
            lit_under_alarm: count("lit_under_alarm")?,
            lit_after_motion: is_true("lit_after_motion")?,
            ignited_elsewhere: count("ignited_elsewhere")?,
            on_at_end: is_true("on_at_end")?,
            ignitions: count("ignitions")?,
            cut_mm: number("cut_mm")?,
        })
    }
}

/// The `cut-judge` binary: the one in `CUT_JUDGE_BIN`, or one that cargo builds in the profile of the tests.
fn binary() -> &'static Path {
    static BINARY: OnceLock<PathBuf> = OnceLock::new();
    BINARY.get_or_init(|| match std::env::var_os("CUT_JUDGE_BIN") {
        Some(path) => PathBuf::from(path),
        None => built("cut-judge").expect("cargo builds the judge"),
    })
}

/// Compares a trace with that of the job without an interruption, both value change dumps.
///
/// # Panics
/// Where the judge cannot read one of them.
#[must_use]
pub fn judge(whole: impl AsRef<Path>, trace: impl AsRef<Path>, machine: &JudgedMachine) -> Verdict {
    judge_standing(whole.as_ref(), trace.as_ref(), machine, 0)
}

/// As [`judge`], for a card behind a line: the cutter may be on while the card waits for the next instruction.
///
/// # Panics
/// As [`judge`].
#[must_use]
pub fn judge_served(whole: impl AsRef<Path>, trace: impl AsRef<Path>, machine: &JudgedMachine) -> Verdict {
    judge_standing(whole.as_ref(), trace.as_ref(), machine, HANDOVER_MS)
}

fn judge_standing(whole: &Path, trace: &Path, machine: &JudgedMachine, standing_ms: u32) -> Verdict {
    let JudgedMachine { pulses_per_mm, fire, input, pierce_ms, pilot_ms, has_lead_ins } = *machine;
    let mut command = at_lower_priority(binary());
    command.args([whole, trace]).args(["--fire", fire, "--input", &input.to_string()]);
    command.args(["--standing-ms", &standing_ms.to_string()]);
    let numbers = [("--pulses-per-mm", pulses_per_mm), ("--pierce-ms", pierce_ms), ("--pilot-ms", pilot_ms)];
    for (option, number) in numbers {
        command.args([option, &number.to_string()]);
    }
    if has_lead_ins {
        command.arg("--lead-ins");
    }
    let output = command.output().expect("the judge runs");
    let text = String::from_utf8_lossy(&output.stdout);
    let verdict = Verdict::parse(&text).unwrap_or_else(|| panic!("{}", String::from_utf8_lossy(&output.stderr)));
    assert_eq!(output.status.code(), Some(if verdict.good { 0 } else { 1 }), "{text}");
    assert_eq!(verdict.good, verdict.is_good(), "a figure of the judge is not read here: {text}");
    verdict
}

/// Judges the height of a torch in a trace, with these options; the figures, and whether all are good.
///
/// # Panics
/// Where the judge cannot read it.
#[must_use]
pub fn judge_heights(trace: impl AsRef<Path>, options: &[&str]) -> Value {
    let mut command = at_lower_priority(binary());
    let output = command.arg("heights").arg(trace.as_ref()).args(options).output().expect("the judge runs");
    let figures: Value = serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&output.stderr)));
    assert_eq!(output.status.code(), Some(if figures["good"] == true { 0 } else { 1 }), "{figures}");
    figures
}
