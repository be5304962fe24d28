//! The audit of a shop: each job was held by one machine and each piece run once (SHP-17).
//!
//! Invariant: the audit only reads. What it cannot read is a fault.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use retrace_config::NumberedError;
use retrace_journal::{JobStore, ProgramSource};

use crate::inbox::Inbox;
use crate::job_id::ShopJobId;
use crate::job_state::ShopJobState;
use crate::ledger::{Ledger, LedgerJob};
use crate::machine_folder::MachineFolder;
use crate::machine_name::MachineName;
use crate::queue::JobQueue;
use crate::run_state::{RunState, run_state};

/// A job with the machine that has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HeldJob {
    /// The job.
    pub id: ShopJobId,
    /// The machine.
    pub machine: MachineName,
    /// Root of the shop.
    pub root: PathBuf,
    /// State of the job.
    pub state: ShopJobState,
    /// Number of good pieces.
    pub good_pieces: u32,
    /// Number of pieces that it orders; 0 where it waits and was not read.
    pub quantity: u32,
}

/// A fault that the audit has found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AuditFault {
    /// The job; `None` where it is not known.
    pub id: Option<ShopJobId>,
    /// What is wrong, and where.
    pub cause: String,
}

/// Result of an audit.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AuditReport {
    /// Every job, with each machine that has it in its queue or ledger.
    pub jobs: Vec<HeldJob>,
    /// The faults.
    pub faults: Vec<AuditFault>,
}

/// Audits the machines of these roots. `journals` are folders of journals in which runs are searched that no ledger
/// knows.
#[must_use]
pub fn audit_roots(roots: &[PathBuf], journals: &[JobStore]) -> AuditReport {
    let mut audit = Audit::default();
    for root in roots {
        match MachineFolder::all(root) {
            Ok(machines) if machines.is_empty() => audit.fault(None, format!("{} has no machine", root.display())),
            Ok(machines) => machines.iter().for_each(|machine| audit.machine(root, machine)),
            Err(refusal) => audit.fault(None, refusal.cause),
        }
    }
    audit.holders();
    audit.shared_runs();
    for store in journals {
        audit.unknown_runs(store);
    }
    audit.report
}

#[derive(Default)]
struct Audit {
    report: AuditReport,
    /// Jobs that run in each journal.
    runs: BTreeMap<(PathBuf, String), Vec<ShopJobId>>,
    /// Folders that have the files of jobs.
    inboxes: Vec<PathBuf>,
}

impl Audit {
    fn fault(&mut self, id: Option<ShopJobId>, cause: String) {
        self.report.faults.push(AuditFault { id, cause });
    }

    fn machine(&mut self, root: &Path, machine: &MachineFolder) {
        let name = machine.name();
        self.inboxes.push(machine.inbox());
        let ledger = match Ledger::read(&machine.ledger()) {
            Ok(ledger) => ledger,
            Err(refusal) => return self.fault(None, format!("machine {name}: {}", refusal.cause)),
        };
        for contradiction in ledger.contradictions() {
            self.fault(None, format!("machine {name}: {contradiction}"));
        }
        for job in ledger.jobs() {
            self.job(root, machine, job);
        }
        let waiting = JobQueue::of(machine).ids().and_then(|ids| {
            let of_queue = ids.into_iter().filter(|&id| ledger.job(id).is_none());
            of_queue
                .map(|id| Ok((id, JobQueue::of(machine).read(id)?.map_or(0, |queued| queued.job.quantity))))
                .collect()
        });
        match waiting {
            Ok::<Vec<(ShopJobId, u32)>, NumberedError>(waiting) => {
                let state = ShopJobState::Queued;
                let held = |(id, quantity)| held(id, root, name, state, (0, quantity));
                self.report.jobs.extend(waiting.into_iter().map(held));
            }
            Err(refusal) => self.fault(None, format!("machine {name}: {}", refusal.cause)),
        }
    }

    fn job(&mut self, root: &Path, machine: &MachineFolder, job: &LedgerJob) {
        let (id, state, good) = (job.job.id, job.state(), job.good_pieces_now());
        self.report.jobs.push(held(id, root, machine.name(), state, (good, job.job.quantity)));
        if good > job.job.quantity {
            self.fault(Some(id), format!("{good} pieces are good, and {} were ordered", job.job.quantity));
        }
        // a run that was sent to an old machine has no journal
        for run in job.runs.iter().filter(|run| !run.is_sent()) {
            self.runs.entry((run.journal.clone(), run.id.clone())).or_default().push(id);
            if run_state(run) == RunState::Unknown && !run.is_scrap {
                let folder = run.journal.display();
                self.fault(Some(id), format!("the journal of run {} in {folder} is missing or cannot be used", run.id));
            }
        }
        if !state.is_final()
            && let Err(refusal) = Inbox::of(machine).verify(job)
        {
            self.fault(Some(id), refusal.cause);
        }
    }

    /// Jobs that more than one machine has.
    fn holders(&mut self) {
        let mut holders = BTreeMap::<ShopJobId, Vec<String>>::new();
        for job in self.report.jobs.iter().filter(|job| job.state != ShopJobState::Returned) {
            holders.entry(job.id).or_default().push(format!("{} of {}", job.machine, job.root.display()));
        }
        for (id, machines) in holders.into_iter().filter(|(_, machines)| machines.len() > 1) {
            self.fault(Some(id), format!("{} machines have it: {}", machines.len(), machines.join(", ")));
        }
    }

    /// Runs that count for more than one piece.
    fn shared_runs(&mut self) {
        let shared: Vec<_> =
            self.runs.iter().filter(|(_, jobs)| jobs.len() > 1).map(|(run, jobs)| (run.1.clone(), jobs[0])).collect();
        for (run, id) in shared {
            self.fault(Some(id), format!("run {run} counts for more than one piece"));
        }
    }

    /// Runs of files of an inbox that no ledger knows.
    fn unknown_runs(&mut self, store: &JobStore) {
        for listed in store.list() {
            let Some(ProgramSource::File(path)) = listed.summary.map(|summary| summary.job.source) else { continue };
            let is_of_inbox = self.inboxes.iter().any(|inbox| Path::new(&path).starts_with(inbox));
            let run = (store.folder().to_owned(), listed.folder.id().to_owned());
            if is_of_inbox && !self.runs.contains_key(&run) {
                self.fault(None, format!("run {} is of {path}, and no ledger knows it", run.1));
            }
        }
    }
}

fn held(
    id: ShopJobId,
    root: &Path,
    machine: &MachineName,
    state: ShopJobState,
    (good_pieces, quantity): (u32, u32),
) -> HeldJob {
    HeldJob { id, machine: machine.clone(), root: root.to_owned(), state, good_pieces, quantity }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::content_hash::ContentHash;
    use crate::job::tests::job;
    use crate::ledger::OpenLedger;
    use crate::ledger::tests::taken;
    use crate::ledger_entry::{CheckSummary, LedgerEntry, RunOutcome};
    use retrace_journal::Timestamp;

    fn machine(root: &Path, name: &str) -> MachineFolder {
        let folder = MachineFolder::of(root, &MachineName::parse(name).expect("a name"));
        folder.create().expect("created");
        folder
    }

    fn append(machine: &MachineFolder, entries: Vec<LedgerEntry>) {
        let mut open = OpenLedger::open(&machine.ledger()).expect("a ledger");
        entries.into_iter().for_each(|entry| open.append(entry).expect("allowed"));
    }

    /// The entries of a job of one piece that has run so often.
    fn runs(number: u64, runs: u32) -> Vec<LedgerEntry> {
        let (when, id) = (Timestamp::from_ms(0), job(number, ContentHash::of(b"")).id);
        let mut entries = vec![taken(number), LedgerEntry::Checked { when, id, check: CheckSummary::default() }];
        for run in (0..runs).map(|run| format!("{number}-{run}")) {
            entries.push(LedgerEntry::Started { when, id, journal: "jobs".into(), run: run.clone() });
            entries.push(LedgerEntry::Ended { when, id, run, outcome: RunOutcome::Completed });
        }
        entries
    }

    fn causes(roots: &[&tempfile::TempDir]) -> Vec<String> {
        let roots: Vec<PathBuf> = roots.iter().map(|root| root.path().to_owned()).collect();
        audit_roots(&roots, &[]).faults.into_iter().map(|fault| fault.cause).collect()
    }

    #[test]
    fn a_job_that_two_machines_hold_and_a_piece_too_many_are_found() {
        let (first, second) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
        let (a, b) = (machine(first.path(), "a"), machine(second.path(), "b"));
        append(&a, runs(1, 1));
        assert_eq!(causes(&[&first, &second]), Vec::<String>::new());
        append(&b, runs(1, 1));
        let found = causes(&[&first, &second]);
        assert!(found.iter().any(|cause| cause.starts_with("2 machines have it: a of ")), "{found:?}");
        append(&b, runs(2, 2));
        let found = causes(&[&second]);
        assert_eq!(found, ["2 pieces are good, and 1 were ordered"]);
    }

    #[test]
    fn what_cannot_be_read_is_a_fault() {
        let root = tempfile::tempdir().expect("a folder");
        assert!(causes(&[&root])[0].ends_with("has no machine"));
        let a = machine(root.path(), "a");
        append(&a, runs(1, 1));
        // ready, and its files are not there
        append(&a, runs(2, 0));
        // started, and its journal is not there
        let id = job(2, ContentHash::of(b"")).id;
        let when = Timestamp::from_ms(0);
        append(&a, vec![LedgerEntry::Started { when, id, journal: "/no".into(), run: "x".into() }]);
        let found = causes(&[&root]);
        assert_eq!(found.len(), 2, "{found:?}");
        assert!(found[0].starts_with("the journal of run x in /no is missing"), "{found:?}");
        assert!(found[1].contains("bundle.json does not exist"), "{found:?}");
        let mut bytes = std::fs::read(a.ledger()).expect("a ledger");
        bytes[20] ^= 1;
        std::fs::write(a.ledger(), bytes).expect("written");
        assert!(causes(&[&root])[0].contains("is damaged in line 1"));
    }
}
