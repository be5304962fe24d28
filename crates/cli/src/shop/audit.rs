//! `retrace shop audit`: one machine has each job, and no piece was run twice.
//!
//! Invariant: nothing is written. A fault ends the command with an error.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use retrace_config::NumberedError;
use retrace_journal::JobStore;
use retrace_shop::{AuditFault, AuditReport, HeldJob, Ledger, MachineFolder, ShopFile, audit_broker, audit_roots};
use serde_json::{Value, json};

use super::host;

/// Runs the command over ledgers and journals.
///
/// # Errors
/// `E5019` where something is wrong.
pub fn run(file: &ShopFile, roots: &[PathBuf], is_json: bool) -> Result<(), NumberedError> {
    let roots = if roots.is_empty() { std::slice::from_ref(&file.root) } else { roots };
    let roots: Vec<PathBuf> = roots.iter().map(|root| absolute(root)).collect();
    let report = audit_roots(&roots, &journals(&roots));
    print(&report, report.jobs.len(), is_json)
}

/// Runs the command over events and claims at the broker.
///
/// # Errors
/// `E5019` where something is wrong; those of the broker.
pub fn run_broker(file: &ShopFile, is_json: bool) -> Result<(), NumberedError> {
    let (jobs, faults) = audit_broker(&host::connect(file)?)?;
    print(&AuditReport { jobs: Vec::new(), faults }, jobs, is_json)
}

fn print(report: &AuditReport, jobs: usize, is_json: bool) -> Result<(), NumberedError> {
    if is_json {
        crate::out::line(report_json(report));
    } else {
        report.faults.iter().for_each(|fault| say!("{}", fault_text(fault)));
        say!("{jobs} jobs, {} faults", report.faults.len());
    }
    match report.faults.len() {
        0 => Ok(()),
        count => {
            let what = format!("the audit has found {count} faults");
            Err(NumberedError::new("E5019", what, "look at each job with `retrace shop show`; see docs/shop.md"))
        }
    }
}

fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// The folder of journals of this user, and those that the ledgers name.
fn journals(roots: &[PathBuf]) -> Vec<JobStore> {
    let machines = roots.iter().filter_map(|root| MachineFolder::all(root).ok()).flatten();
    let ledgers = machines.filter_map(|machine| Ledger::read(&machine.ledger()).ok());
    let named = |ledger: Ledger| {
        let runs = ledger.jobs().iter().flat_map(|job| &job.runs).filter(|run| !run.is_sent());
        runs.map(|run| run.journal.clone()).collect::<Vec<PathBuf>>()
    };
    let usual = JobStore::open_or_default(None).ok().map(|store| store.folder().to_owned());
    let folders: BTreeSet<PathBuf> = ledgers.flat_map(named).chain(usual).collect();
    folders.iter().map(|folder| JobStore::open(folder)).collect()
}

fn fault_text(fault: &AuditFault) -> String {
    match fault.id {
        Some(id) => format!("job {id}: {}", fault.cause),
        None => fault.cause.clone(),
    }
}

fn report_json(report: &AuditReport) -> Value {
    let job = |job: &HeldJob| {
        json!({
            "id": job.id,
            "machine": job.machine,
            "root": job.root.display().to_string(),
            "state": job.state.word(),
            "good": job.good_pieces,
            "quantity": job.quantity,
        })
    };
    let fault = |fault: &AuditFault| json!({"id": fault.id, "cause": fault.cause});
    json!({
        "jobs": report.jobs.iter().map(job).collect::<Vec<_>>(),
        "faults": report.faults.iter().map(fault).collect::<Vec<_>>(),
    })
}
