//! The commands that a job begins with, before the script of the command line and the keys of the operator.
//!
//! Invariant: they are in the order in which they are to be applied, all at the beginning of the job.

use retrace_config::NumberedError;
use retrace_controller::{ScriptInstruction, parse_script};
use retrace_journal::JobRecord;

/// Puts the optional-stop option before the script.
pub fn with_optional_stop(
    stops: Option<bool>,
    script: Vec<ScriptInstruction>,
) -> Result<Vec<ScriptInstruction>, NumberedError> {
    let Some(stops) = stops else { return Ok(script) };
    let mut all = parse_script(if stops { "at 0s optional stop on" } else { "at 0s optional stop off" }, "M1")?;
    all.extend(script);
    Ok(all)
}

/// Script of a job that is started at a screen: the contours that it skips, and optional stop.
pub fn at_screen(
    skipped: impl Iterator<Item = u32>,
    stops: bool,
    script: &[ScriptInstruction],
) -> Result<Vec<ScriptInstruction>, NumberedError> {
    let mut all = parse_script(&skip_words(skipped), "screen")?;
    // Without the command a job does not stop.
    all.extend(with_optional_stop(stops.then_some(true), script.to_vec())?);
    Ok(all)
}

/// Script of a resumed job that was confirmed: it skips what the operator has skipped, the outputs are restored without
/// another question, and an interrupted cut is continued.
pub fn of_resumed_job(
    script: &[ScriptInstruction],
    record: &JobRecord,
    recovers: bool,
) -> Result<Vec<ScriptInstruction>, NumberedError> {
    let mut all = parse_script(&skip_words(record.skipped_contours.iter().copied()), "resume")?;
    all.extend(parse_script(if recovers { "at 0s recover" } else { "at 0s leave" }, "resume")?);
    all.extend(script);
    Ok(all)
}

fn skip_words(numbers: impl Iterator<Item = u32>) -> String {
    numbers.map(|number| format!("at 0s skip contour {number}\n")).collect()
}
