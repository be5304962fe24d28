//! Checks a job by `retrace check --json` in a process of its own, of lower priority (SHP-11).
//!
//! Invariant: a job is refused for errors of its program only. Where the check itself fails, the job stays unchecked.

use std::fs::{self, File};
use std::path::Path;
use std::process::{Command, Stdio};

use retrace_config::NumberedError;
use retrace_shop::{CheckSummary, Inbox, LedgerJob, ShopFile};

/// Maximum length of an error text that is shown, in characters.
const MAX_ERROR_CHARS: usize = 2000;

/// Result of a check.
pub enum Checked {
    /// The program can run.
    Ready(CheckSummary),
    /// It has errors.
    Errors(CheckSummary),
}

/// Checks a job against the machine file of the shop file. Takes as long as the check.
///
/// # Errors
/// `E5006` where the files of the job were changed, `E5016` where the check could not be run.
pub fn check(file: &ShopFile, inbox: &Inbox, job: &LedgerJob) -> Result<Checked, NumberedError> {
    inbox.verify(job)?;
    let errors = inbox.files(job.job.id).with_file_name("check-errors.txt");
    let failed = |why: &str| {
        let what = format!("job {} could not be checked: {why}", job.job.id);
        NumberedError::new("E5016", what, "correct the machine file or the computer; the agent checks the job again")
    };
    let program = std::env::current_exe().map_err(|error| failed(&error.to_string()))?;
    let error_file = File::create(&errors).map_err(|error| failed(&error.to_string()))?;
    let mut command = Command::new(program);
    command.arg("check").arg("--json");
    if let Some(machine) = &file.machine_file {
        command.arg("--machine").arg(machine);
    }
    if let Some(cycles) = inbox.cycles(job)? {
        command.arg("--cycles").arg(cycles);
    }
    command.arg("--").arg(inbox.program(job));
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(error_file)
        .spawn()
        .map_err(|error| failed(&error.to_string()))?;
    let output = child.stdout.take().map(CheckSummary::read);
    let status = child.wait().map_err(|error| failed(&error.to_string()))?;
    match (status.code(), output) {
        (Some(0), Some(Ok(found))) => Ok(Checked::Ready(found)),
        (Some(1), Some(Ok(found))) => Ok(Checked::Errors(found)),
        _ => Err(failed(&format!("the check ended with {status}: {}", text(&errors)))),
    }
}

/// The beginning of a text, as one line.
fn text(path: &Path) -> String {
    let bytes = fs::read(path).unwrap_or_default();
    let text = String::from_utf8_lossy(&bytes);
    text.split_whitespace().collect::<Vec<_>>().join(" ").chars().take(MAX_ERROR_CHARS).collect()
}
