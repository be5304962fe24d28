//! What the reporting commands know of the machine: by the local socket of the state, and by the ledger.
//!
//! Invariant: it only reads, and waits for nothing.

use std::path::Path;
use std::time::{Duration, Instant};

use retrace_config::{AxisConfig, NumberedError};
use retrace_journal::JobStore;
use retrace_shop::{MachineReport, ReportedAxis, RunState, ShopFile, StateReader, run_state};

use super::ShopJobs;
use crate::files;

/// Interval at which the ledger is read.
const LEDGER_INTERVAL: Duration = Duration::from_secs(5);

/// Observer of a machine.
#[derive(Debug)]
pub struct MachineObserver<'a> {
    file: &'a ShopFile,
    reader: StateReader,
    report: MachineReport,
    /// Axes of the machine file.
    axes: Vec<ReportedAxis>,
    ledger_read: Option<Instant>,
    /// Whether what a command reports is of this machine.
    is_alone: bool,
}

impl<'a> MachineObserver<'a> {
    /// Observer of this machine, with the axes of this machine file or that of the shop file.
    ///
    /// # Errors
    /// `E5001` without a state folder; errors of the machine file.
    pub fn new(file: &'a ShopFile, machine_file: Option<&Path>) -> Result<Self, NumberedError> {
        let axes = axes(file, machine_file)?;
        let Some(state) = JobStore::state_folder() else {
            let what = "no state folder: neither XDG_STATE_HOME nor HOME names one";
            return Err(NumberedError::new("E5001", what, "set HOME or XDG_STATE_HOME"));
        };
        let reader = StateReader::new(state.join("running"));
        Ok(Self { file, reader, report: MachineReport::default(), axes, ledger_read: None, is_alone: true })
    }

    /// Reads what has come.
    pub fn read(&mut self) {
        if self.ledger_read.is_none_or(|read| read.elapsed() >= LEDGER_INTERVAL) {
            self.ledger_read = Some(Instant::now());
            self.is_alone = self.file.machine_folder().is_alone();
            if !self.is_alone {
                self.report.forget();
            }
            let jobs = ShopJobs::read(self.file).ok();
            self.report.pieces = jobs.as_ref().map(pieces);
            self.report.shop_job = jobs.as_ref().and_then(running_job);
        }
        if self.is_alone {
            self.reader.read(&mut self.report);
        }
    }

    /// The newest report.
    #[must_use]
    pub fn report(&self) -> &MachineReport {
        &self.report
    }

    /// Axes of the machine that reports; before one does, those of the machine file.
    #[must_use]
    pub fn axes(&self) -> &[ReportedAxis] {
        let reported = self.reader.axes();
        if reported.is_empty() { &self.axes } else { reported }
    }
}

/// Axes of this machine file, or of that of the shop file.
///
/// # Errors
/// Those of the machine file.
pub fn axes(file: &ShopFile, machine_file: Option<&Path>) -> Result<Vec<ReportedAxis>, NumberedError> {
    let machine = files::machine(machine_file.or(file.machine_file.as_deref()))?;
    let axis = |axis: &AxisConfig| ReportedAxis { letter: axis.name, is_linear: !"abc".contains(axis.name) };
    Ok(machine.axes.iter().map(axis).collect())
}

/// Good pieces, and scrap, by the ledger.
fn pieces(jobs: &ShopJobs) -> [u64; 2] {
    let good = jobs.ledger.jobs().iter().map(|job| u64::from(job.good_pieces_now())).sum();
    let runs = jobs.ledger.jobs().iter().flat_map(|job| &job.runs);
    [good, runs.filter(|run| run.is_scrap).count() as u64]
}

/// Job that is running, by the ledger and the journal of its run.
fn running_job(jobs: &ShopJobs) -> Option<String> {
    let is_running = |run| run_state(run) == RunState::Running;
    jobs.ledger.jobs().iter().find(|job| job.runs.iter().any(is_running)).map(|job| job.job.id.to_string())
}
