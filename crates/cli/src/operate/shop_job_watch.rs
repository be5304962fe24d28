//! Keeps the list of the shop's jobs on the screens up to date.
//!
//! Invariant: it only reads; nothing that it finds stops or delays the machine. Ledger and queue are read again only
//! when they have changed, or while a run has not ended.

use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant, SystemTime};

use retrace_config::NumberedError;
use retrace_shop::{ContentHash, ShopFile, ShopJobState};
use retrace_tui::{ScreenModel, ShopJobRow, ShopJobTable, lock_model};

use crate::args;
use crate::shop::{JobRow, ShopJobs, check_text, details, rows};
use crate::shop_piece::{check_machine_file, machine_file_name};

/// Interval at which files are looked at.
const LOOK_INTERVAL: Duration = Duration::from_millis(500);
/// Interval at which jobs with runs that have not ended are read again.
const RUN_INTERVAL: Duration = Duration::from_secs(2);
/// Interval at which the end of the screen is noticed.
const END_INTERVAL: Duration = Duration::from_millis(50);
/// Most jobs that are listed.
const MAX_ROWS: usize = 500;
/// Most rows of details of a job.
const MAX_DETAILS: usize = 60;
/// Details that the list shows itself, or that mean nothing at the machine.
const LEFT_OUT: [&str; 3] = ["machine", "bundle", "program"];

/// Watches the jobs until it is dropped.
#[derive(Debug)]
pub(super) struct ShopJobWatch {
    is_over: Arc<AtomicBool>,
}

impl ShopJobWatch {
    /// Watches the jobs of the shop, for a machine that runs with this text of its machine file.
    pub(super) fn begin(args: &args::Run, machine_text: &str, model: &Arc<Mutex<ScreenModel>>) -> Self {
        let is_over = Arc::new(AtomicBool::new(false));
        let (over, model) = (Arc::clone(&is_over), Arc::clone(model));
        let (args, machine_text) = (args.clone(), machine_text.to_owned());
        thread::spawn(move || watch(&args, &machine_text, &model, &over));
        Self { is_over }
    }
}

impl Drop for ShopJobWatch {
    fn drop(&mut self) {
        // The thread may be waiting for a disk; it ends by itself.
        self.is_over.store(true, Ordering::Relaxed);
    }
}

/// What shows that files have changed: the shop file, the ledger with its length, and the queue.
type Stamp = [Option<(SystemTime, u64)>; 3];

fn watch(args: &args::Run, machine_text: &str, model: &Mutex<ScreenModel>, is_over: &AtomicBool) {
    let mut read: Option<(Stamp, Instant, bool)> = None;
    while !is_over.load(Ordering::Relaxed) {
        let shop_file = ShopFile::load(args.shop.shop_file.as_deref());
        let stamp = stamp_of(args.shop.shop_file.as_deref(), shop_file.as_ref().ok());
        let is_due =
            read.is_none_or(|(before, at, has_runs)| before != stamp || has_runs && at.elapsed() > RUN_INTERVAL);
        if is_due {
            let (table, has_runs) = match shop_file.and_then(|file| table_of(&file, args, machine_text)) {
                Ok(found) => found,
                Err(refusal) => {
                    let before = lock_model(model).shop_jobs.as_deref().cloned().unwrap_or_default();
                    (ShopJobTable { error: one_line(&refusal), ..before }, true)
                }
            };
            show(model, table);
            read = Some((stamp, Instant::now(), has_runs));
        }
        let begun = Instant::now();
        while begun.elapsed() < LOOK_INTERVAL && !is_over.load(Ordering::Relaxed) {
            thread::sleep(END_INTERVAL);
        }
    }
}

fn show(model: &Mutex<ScreenModel>, table: ShopJobTable) {
    let mut model = lock_model(model);
    if model.shop_jobs.as_deref() != Some(&table) {
        model.shop_jobs = Some(Arc::new(table));
        model.changes += 1;
    }
}

fn stamp_of(path: Option<&Path>, file: Option<&ShopFile>) -> Stamp {
    let stamp = |path: &Path| {
        let found = fs::metadata(path).ok()?;
        Some((found.modified().ok()?, found.len()))
    };
    let machine = file.map(ShopFile::machine_folder);
    [
        path.and_then(stamp),
        machine.as_ref().and_then(|machine| stamp(&machine.ledger())),
        machine.as_ref().and_then(|machine| stamp(&machine.queue())),
    ]
}

fn one_line(refusal: &NumberedError) -> String {
    format!("{}: {} · {}", refusal.number, refusal.cause, refusal.remedy)
}

/// The table, and whether a job has a run that has not ended.
fn table_of(file: &ShopFile, args: &args::Run, machine_text: &str) -> Result<(ShopJobTable, bool), NumberedError> {
    let (jobs, unreadable) = ShopJobs::read_silently(file)?;
    let path = args.machine_file.path();
    let checked_with = other_machine_file(file, machine_text);
    let (found, mut hidden) = rows(&jobs, false);
    hidden += found.len().saturating_sub(MAX_ROWS);
    let is_open = |row: &JobRow<'_>| {
        let mut runs = row.listed.iter().flat_map(|job| &job.runs);
        runs.any(|run| run.outcome.is_none())
    };
    let has_runs = found.iter().any(is_open);
    let rows = found.iter().take(MAX_ROWS).map(|row| {
        let made_for = check_machine_file(row.job, path, machine_text);
        let (made_for, is_refused) = match made_for {
            Ok(warning) => (warning, false),
            Err(refusal) => (Some(format!("{} ({})", refusal.cause, refusal.number)), true),
        };
        ShopJobRow {
            id: row.job.id.to_string(),
            state: row.state.word(),
            is_ready: row.state == ShopJobState::Ready && !is_refused,
            program: row.program().to_owned(),
            good: row.good_pieces(),
            quantity: row.job.quantity,
            most_pieces: if row.job.may_repeat { row.job.quantity.saturating_sub(row.good_pieces()).max(1) } else { 1 },
            check: row.check().map(check_text).unwrap_or_default(),
            submitter: row.job.submitter.clone(),
            order_number: row.job.order_number.clone(),
            note: row.job.note.clone(),
            material: row.job.material.clone(),
            warnings: made_for.into_iter().chain(checked_with.clone()).collect(),
            details: details_of(&jobs, row),
        }
    });
    let table = ShopJobTable {
        machine: jobs.machine.name().to_string(),
        machine_file: machine_file_name(path),
        rows: rows.collect(),
        hidden,
        error: unreadable.first().map(one_line).unwrap_or_default(),
    };
    Ok((table, has_runs))
}

/// Warning where the jobs are checked with another machine file than this screen runs with.
fn other_machine_file(file: &ShopFile, machine_text: &str) -> Option<String> {
    let path = file.machine_file.as_deref();
    let text = crate::files::machine_text(path).ok()?;
    if ContentHash::of(text.as_bytes()) == ContentHash::of(machine_text.as_bytes()) {
        return None;
    }
    Some(format!(
        "the agent checks jobs with {}, which is not the machine file of this screen",
        machine_file_name(path)
    ))
}

fn details_of(jobs: &ShopJobs, row: &JobRow<'_>) -> Vec<(String, String)> {
    let is_ready = row.state == ShopJobState::Ready;
    details(jobs, row)
        .into_iter()
        .filter(|(name, _)| !(LEFT_OUT.contains(name) || is_ready && *name == "next step"))
        .map(|(name, text)| (name.to_owned(), text))
        .take(MAX_DETAILS)
        .collect()
}
