//! `retrace shop jobs` and `retrace shop show`.
//!
//! Invariant: nothing is written; what is shown of a run is what its journal says now.

use retrace_config::NumberedError;
use retrace_journal::Timestamp;
use retrace_shop::{
    CheckSummary, HandledContent, HandledMessage, Inbox, LedgerJob, LedgerRun, ShopJob, ShopJobState, read_messages,
    run_state,
};
use serde_json::{Value, json};

use super::shop_jobs::{FoundJob, ShopJobs};
use crate::escape;
use crate::jobs::table;

/// Number of finished jobs that are listed without --all.
const LISTED_FINISHED: usize = 20;
/// Number of texts for the operator that are listed, and their greatest age.
const LISTED_TEXTS: usize = 5;
const TEXT_AGE_MS: u64 = 86_400_000;

/// A job with its state.
pub struct JobRow<'a> {
    /// The job.
    pub job: &'a ShopJob,
    /// The job of the ledger; `None` where it waits to be taken.
    pub listed: Option<&'a LedgerJob>,
    /// State of the job.
    pub state: ShopJobState,
}

impl<'a> JobRow<'a> {
    fn of(found: FoundJob<'a>) -> Self {
        match found {
            FoundJob::Listed(listed) => Self { job: &listed.job, listed: Some(listed), state: listed.state() },
            FoundJob::Queued(job) => Self { job, listed: None, state: ShopJobState::Queued },
        }
    }

    /// Name of the program; empty where it waits to be taken.
    pub fn program(&self) -> &str {
        self.listed.map_or("", |job| job.program.as_str())
    }

    /// Number of good pieces.
    pub fn good_pieces(&self) -> u32 {
        self.listed.map_or(0, LedgerJob::good_pieces_now)
    }

    /// Result of the check, once it was checked.
    pub fn check(&self) -> Option<&CheckSummary> {
        self.listed.and_then(|job| job.check.as_ref())
    }

    fn json(&self, place: usize) -> Value {
        json!({
            "order": place,
            "id": self.job.id,
            "state": self.state.word(),
            "program": self.program(),
            "good": self.good_pieces(),
            "quantity": self.job.quantity,
            "errors": self.check().map(|check| check.errors),
            "warnings": self.check().map(|check| check.warnings),
            "time_s": self.check().and_then(|check| check.time_s),
            "submitter": self.job.submitter,
            "submitted": self.job.submitted,
            "order_number": self.job.order_number,
            "note": self.job.note,
            "material": self.job.material,
            "next_step": self.next_step(),
        })
    }

    /// What can be done with the job.
    fn next_step(&self) -> String {
        let id = self.job.id;
        match self.state {
            ShopJobState::Queued | ShopJobState::Taken => "retrace shop agent --once".into(),
            ShopJobState::Ready => format!("retrace run --job {id}"),
            ShopJobState::Interrupted => self.listed.and_then(LedgerJob::resume_command).unwrap_or_default(),
            ShopJobState::Unknown | ShopJobState::Refused => {
                self.next_word().unwrap_or(format!("retrace shop show {id}"))
            }
            _ => String::new(),
        }
    }
}

impl JobRow<'_> {
    /// The command by which the operator of an old machine says that a piece is good.
    fn next_word(&self) -> Option<String> {
        let is_open = |run: &&LedgerRun| run.is_sent() && run.outcome.is_none() && !run.is_scrap;
        let run = self.listed?.runs.iter().find(is_open)?;
        Some(format!("retrace shop good {} {}", self.job.id, run.id))
    }
}

/// The last texts for the operator, the oldest first.
fn last_texts(messages: &[HandledMessage]) -> Vec<(&HandledMessage, &str)> {
    let oldest = Timestamp::now().ms().saturating_sub(TEXT_AGE_MS);
    let texts = messages.iter().filter(|message| message.when.ms() >= oldest).filter_map(|message| {
        let HandledContent::Text { text } = &message.content else { return None };
        Some((message, text.as_str()))
    });
    let texts: Vec<(&HandledMessage, &str)> = texts.collect();
    texts[texts.len().saturating_sub(LISTED_TEXTS)..].to_vec()
}

fn texts_json(texts: &[(&HandledMessage, &str)]) -> Vec<Value> {
    texts.iter().map(|(message, text)| json!({"when": message.when, "from": message.from, "text": text})).collect()
}

/// Rows of the jobs in their order, and the number of those that are left out: of the finished ones, all but the last.
pub fn rows(jobs: &ShopJobs, is_all: bool) -> (Vec<JobRow<'_>>, usize) {
    let mut rows: Vec<JobRow<'_>> = jobs.ledger.jobs().iter().map(|job| JobRow::of(FoundJob::Listed(job))).collect();
    rows.extend(jobs.queued.iter().map(|job| JobRow::of(FoundJob::Queued(job))));
    rows.sort_by_key(|row| row.job.id);
    let finished = rows.iter().filter(|row| row.state.is_final()).count();
    let mut hidden = if is_all { 0 } else { finished.saturating_sub(LISTED_FINISHED) };
    let hidden_count = hidden;
    rows.retain(|row| {
        let is_hidden = hidden > 0 && row.state.is_final();
        hidden -= usize::from(is_hidden);
        !is_hidden
    });
    (rows, hidden_count)
}

/// Lists the jobs, below the last texts for the operator.
///
/// # Errors
/// `E5009`, `E5010` where the texts cannot be read.
pub fn list(jobs: &ShopJobs, is_json: bool, is_all: bool) -> Result<(), NumberedError> {
    let messages = read_messages(&jobs.machine.messages())?;
    let texts = last_texts(&messages);
    let (rows, hidden_count) = rows(jobs, is_all);
    if is_json {
        let rows: Vec<Value> = rows.iter().enumerate().map(|(number, row)| row.json(number + 1)).collect();
        crate::out::line(json!({"machine": jobs.machine.name(), "jobs": rows, "texts": texts_json(&texts)}));
        return Ok(());
    }
    for (message, text) in &texts {
        say!("{} {}: {}", message.when, escape::name(&message.from), escape::lines(text));
    }
    if rows.is_empty() {
        say!("machine {} has no jobs; `retrace shop submit FILE` submits one", jobs.machine.name());
        return Ok(());
    }
    let cells: Vec<[String; 9]> = rows.iter().enumerate().map(|(number, row)| cells(number + 1, row)).collect();
    let head = ["no.", "job", "state", "program", "pieces", "check", "order", "from", "note"];
    say!("{}", table(head, &cells).trim_end());
    if hidden_count > 0 {
        say!("{hidden_count} more with --all");
    }
    Ok(())
}

fn cells(place: usize, row: &JobRow<'_>) -> [String; 9] {
    let text = |text: &str| escape::name(text).into_owned();
    [
        place.to_string(),
        row.job.id.to_string(),
        row.state.word().into(),
        text(row.program()),
        format!("{}/{}", row.good_pieces(), row.job.quantity),
        row.check().map_or_else(String::new, check_text),
        text(&row.job.order_number),
        text(&row.job.submitter),
        text(&row.job.note),
    ]
}

/// Result of a check in words.
#[must_use]
pub fn check_text(check: &CheckSummary) -> String {
    let count = |number: usize, what: &str| format!("{number} {what}{}", if number == 1 { "" } else { "s" });
    match (check.errors, check.warnings) {
        (0, 0) => "no errors".into(),
        (0, warnings) => count(warnings, "warning"),
        (errors, 0) => count(errors, "error"),
        (errors, warnings) => format!("{}, {}", count(errors, "error"), count(warnings, "warning")),
    }
}

/// Prints all details of a job.
///
/// # Errors
/// `E5004` where there is none.
pub fn show(jobs: &ShopJobs, id: &str, is_json: bool) -> Result<(), NumberedError> {
    let row = JobRow::of(jobs.find(id)?);
    if is_json {
        crate::out::line(details_json(jobs, &row));
        return Ok(());
    }
    say!("{}: {}", row.job.id, row.state.word());
    for (name, text) in details(jobs, &row) {
        say!("  {name:10} {text}");
    }
    Ok(())
}

/// Details of a job as names and texts; a row without a name continues the one before.
pub fn details(jobs: &ShopJobs, row: &JobRow<'_>) -> Vec<(&'static str, String)> {
    let job = row.job;
    let mut rows = vec![
        ("for", job.target.to_string()),
        ("pieces", format!("{} of {}", row.good_pieces(), job.quantity)),
        ("submitted", format!("{} by {}", job.submitted, escape::name(&job.submitter))),
        ("bundle", job.bundle.to_string()),
    ];
    let texts = [("order", &job.order_number), ("note", &job.note), ("material", &job.material)];
    rows.extend(texts.into_iter().filter(|(_, text)| !text.is_empty()).map(|(name, text)| (name, text.clone())));
    if let Some(demand) = &job.machine_file {
        let others = if demand.is_required { "no other one" } else { "another one is a warning" };
        rows.push(("made for", format!("the machine file with the hash {}; {others}", demand.hash)));
    }
    if let Some(listed) = row.listed.filter(|listed| listed.is_held()) {
        rows.push(("program", Inbox::of(&jobs.machine).program(listed).display().to_string()));
    }
    if let Some(check) = row.check() {
        let time = check.time_s.map(|time| format!(", {time:.0} s")).unwrap_or_default();
        rows.push(("check", format!("{}{time}", check_text(check))));
        rows.extend(check.diagnostics.iter().map(|one| ("", diagnostic_text(one))));
    }
    for run in row.listed.iter().flat_map(|job| &job.runs) {
        let scrap = if run.is_scrap { ", scrap" } else { "" };
        rows.push(("run", format!("{}: {}{scrap}, started {}", run.id, run_state(run).word(), run.started)));
    }
    let next_step = row.next_step();
    if !next_step.is_empty() {
        rows.push(("next step", next_step));
    }
    rows
}

/// A diagnostic of `retrace check --json` as one line.
fn diagnostic_text(one: &Value) -> String {
    let text = |key: &str| one[key].as_str().unwrap_or_default().to_owned();
    let line = one["range"]["start"]["line"].as_u64().map(|line| format!("line {line}: ")).unwrap_or_default();
    format!("{}[{}]: {line}{}", text("severity"), text("number"), text("cause"))
}

fn details_json(jobs: &ShopJobs, row: &JobRow<'_>) -> Value {
    let run = |run: &LedgerRun| {
        json!({
            "id": run.id,
            "journal": run.journal.display().to_string(),
            "state": run_state(run).word(),
            "scrap": run.is_scrap,
            "started": run.started,
        })
    };
    let held = row.listed.filter(|listed| listed.is_held());
    json!({
        "job": row.job,
        "state": row.state.word(),
        "good": row.good_pieces(),
        "program": held.map(|job| Inbox::of(&jobs.machine).program(job).display().to_string()),
        "check": row.check(),
        "runs": row.listed.iter().flat_map(|job| &job.runs).map(run).collect::<Vec<_>>(),
        "next_step": row.next_step(),
    })
}
