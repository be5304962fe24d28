//! Takes the jobs that wait in the queue of a machine (SHP-9).
//!
//! The order makes taking safe against an end of the process at any moment: files, then the ledger, then the queue. A
//! job that is in the ledger already is only removed from the queue.
//!
//! Invariant: a job leaves the queue only when the ledger has it.

use retrace_config::NumberedError;
use retrace_journal::Timestamp;

use crate::inbox::Inbox;
use crate::inbox_limits::InboxLimits;
use crate::job::JobTarget;
use crate::job_id::ShopJobId;
use crate::ledger::{Ledger, OpenLedger};
use crate::ledger_entry::{CheckSummary, LedgerEntry};
use crate::machine_folder::MachineFolder;
use crate::queue::{JobQueue, QueuedJob};

/// What became of a job in the queue.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Taking {
    /// The machine has taken it.
    Taken,
    /// The ledger had it already.
    Known,
    /// Its files are not those that were submitted, or may not be stored.
    Refused(NumberedError),
    /// It stays in the queue.
    Waits(NumberedError),
}

/// Takes every job in the queue of a machine, whose agent is locked. Returns what became of each.
///
/// # Errors
/// `E5009` where the ledger is damaged, `E5010` where it or the queue cannot be read.
pub fn take_waiting(machine: &MachineFolder, limits: InboxLimits) -> Result<Vec<(ShopJobId, Taking)>, NumberedError> {
    let queue = JobQueue::of(machine);
    let mut taken = Vec::new();
    for id in queue.ids()? {
        let ledger = Ledger::read(&machine.ledger())?;
        if ledger.job(id).is_some() {
            queue.remove(id)?;
            taken.push((id, Taking::Known));
            continue;
        }
        match queue.read(id) {
            Ok(None) => {}
            Ok(Some(queued)) => taken.push((id, take(machine, &queue, &queued, &ledger, limits)?)),
            Err(refusal) => taken.push((id, Taking::Waits(refusal))),
        }
    }
    Ok(taken)
}

fn take(
    machine: &MachineFolder,
    queue: &JobQueue,
    queued: &QueuedJob,
    ledger: &Ledger,
    limits: InboxLimits,
) -> Result<Taking, NumberedError> {
    let (inbox, job, when) = (Inbox::of(machine), queued.job.clone(), Timestamp::now());
    let id = job.id;
    // what is for a group was claimed before it was put into the queue
    let is_mine = !matches!(&job.target, JobTarget::Machine(name) if name != machine.name());
    let stored = if is_mine {
        inbox.store(queued, ledger, limits)
    } else {
        let what = format!("job {id} is for {}, and lies in the queue of {}", job.target, machine.name());
        Err(NumberedError::new("E5003", what, "submit it again for the right machine"))
    };
    let (entry, taking) = match stored {
        Ok(bundle) => {
            let (program, bytes) = (bundle.program().to_owned(), bundle.bytes());
            (LedgerEntry::Taken { when, job, program, bytes }, Taking::Taken)
        }
        Err(refusal) if matches!(refusal.number, "E5008" | "E5010") => return Ok(Taking::Waits(refusal)),
        Err(refusal) => {
            let check = CheckSummary::of_refusal(&refusal);
            (LedgerEntry::Refused { when, id, check, not_taken: Some(Box::new(job)) }, Taking::Refused(refusal))
        }
    };
    let mut open = OpenLedger::open(&machine.ledger())?;
    // it may have been recalled meanwhile
    let is_known = open.ledger().job(id).is_some();
    if is_known {
        inbox.delete(id)?;
    } else {
        open.append(entry)?;
    }
    drop(open);
    queue.remove(id)?;
    Ok(if is_known { Taking::Known } else { taking })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bundle::SourceFile;
    use crate::job::ShopJob;
    use crate::job::tests::job;
    use crate::job_state::ShopJobState;
    use crate::machine_name::MachineName;
    use std::fs;
    use std::path::PathBuf;

    const LIMITS: InboxLimits = InboxLimits { max_bytes: 1 << 20, disk_reserve_bytes: 0 };

    /// A machine with one job in its queue.
    fn queued() -> (tempfile::TempDir, MachineFolder, ShopJob) {
        let root = tempfile::tempdir().expect("a folder");
        let machine = MachineFolder::of(root.path(), &MachineName::local());
        machine.create().expect("created");
        let job = submit(&root, &machine, 1);
        (root, machine, job)
    }

    fn submit(root: &tempfile::TempDir, machine: &MachineFolder, number: u64) -> ShopJob {
        let path = root.path().join("part.ngc");
        fs::write(&path, "G0 X1\nM2\n").expect("a file");
        let sources = SourceFile::of_paths(&[path]).expect("names");
        let staged = JobQueue::of(machine).stage(&sources, LIMITS).expect("staged");
        let job = job(number, staged.bundle().hash());
        staged.submit(&job).expect("submitted");
        job
    }

    fn stored(machine: &MachineFolder, job: &ShopJob) -> PathBuf {
        let files = machine.queue().join(job.id.to_string()).join("files");
        fs::read_dir(files).expect("files").next().expect("one").expect("read").path()
    }

    #[test]
    fn a_job_is_taken_once_though_it_comes_again() {
        let (root, machine, first) = queued();
        assert_eq!(take_waiting(&machine, LIMITS), Ok(vec![(first.id, Taking::Taken)]));
        assert_eq!(take_waiting(&machine, LIMITS), Ok(vec![]));
        assert_eq!(submit(&root, &machine, 1), first);
        assert_eq!(take_waiting(&machine, LIMITS), Ok(vec![(first.id, Taking::Known)]));
        let ledger = Ledger::read(&machine.ledger()).expect("whole");
        assert_eq!(ledger.jobs().len(), 1);
        let job = &ledger.jobs()[0];
        assert_eq!((job.state(), job.program.as_str(), job.bytes), (ShopJobState::Taken, "part.ngc", 9));
        Inbox::of(&machine).verify(job).expect("whole");
        fs::write(Inbox::of(&machine).program(job), "G0 X2\nM2\n").expect("written");
        assert_eq!(Inbox::of(&machine).verify(job).expect_err("changed").number, "E5006");
    }

    #[test]
    fn a_job_with_other_files_is_refused_and_one_that_is_not_readable_waits() {
        let (root, machine, first) = queued();
        fs::write(stored(&machine, &first), "G0 X9\nM2\n").expect("written");
        let taken = take_waiting(&machine, LIMITS).expect("a ledger");
        assert!(matches!(&taken[..], [(_, Taking::Refused(refusal))] if refusal.number == "E5006"), "{taken:?}");
        let ledger = Ledger::read(&machine.ledger()).expect("whole");
        assert_eq!(ledger.jobs()[0].state(), ShopJobState::Refused);
        assert!(!Inbox::of(&machine).files(first.id).exists());

        let other = submit(&root, &machine, 2);
        let path = machine.queue().join(other.id.to_string()).join("job.json");
        fs::write(&path, serde_json::to_string(&first).expect("json")).expect("written");
        let taken = take_waiting(&machine, LIMITS).expect("a ledger");
        assert!(matches!(&taken[..], [(_, Taking::Waits(refusal))] if refusal.number == "E5006"), "{taken:?}");
        let foreign =
            ShopJob { target: JobTarget::Machine(MachineName::parse("mill").expect("a name")), ..other.clone() };
        fs::write(&path, serde_json::to_string(&foreign).expect("json")).expect("written");
        let taken = take_waiting(&machine, LIMITS).expect("a ledger");
        assert!(matches!(&taken[..], [(_, Taking::Refused(refusal))] if refusal.number == "E5003"), "{taken:?}");
    }

    #[test]
    fn a_full_inbox_and_a_full_disk_take_nothing_and_what_is_finished_makes_room() {
        let (root, machine, first) = queued();
        let waits = |limits| match &take_waiting(&machine, limits).expect("a ledger")[..] {
            [(_, Taking::Waits(refusal))] => refusal.number,
            other => panic!("{other:?}"),
        };
        assert_eq!(waits(InboxLimits { max_bytes: 8, ..LIMITS }), "E5008");
        assert_eq!(waits(InboxLimits { disk_reserve_bytes: u64::MAX / 2, ..LIMITS }), "E5008");
        let sources = SourceFile::of_paths(&[root.path().join("part.ngc")]).expect("names");
        let staged = JobQueue::of(&machine).stage(&sources, InboxLimits { disk_reserve_bytes: u64::MAX, ..LIMITS });
        assert_eq!(staged.expect_err("full").number, "E5008");
        let tight = InboxLimits { max_bytes: 9, ..LIMITS };
        assert_eq!(take_waiting(&machine, tight), Ok(vec![(first.id, Taking::Taken)]));
        let second = submit(&root, &machine, 2);
        assert_eq!(waits(tight), "E5008");
        let mut open = OpenLedger::open(&machine.ledger()).expect("a ledger");
        open.append(LedgerEntry::GivenUp { when: Timestamp::now(), id: first.id }).expect("allowed");
        drop(open);
        assert_eq!(take_waiting(&machine, tight), Ok(vec![(second.id, Taking::Taken)]));
        assert!(!Inbox::of(&machine).files(first.id).exists());
    }

    #[test]
    fn half_written_folders_are_deleted_and_the_job_is_taken() {
        let (_root, machine, first) = queued();
        let inbox = Inbox::of(&machine);
        fs::create_dir_all(inbox.files(first.id)).expect("a folder");
        fs::write(inbox.files(first.id).join("part.ngc"), "G0").expect("a file");
        assert_eq!(take_waiting(&machine, LIMITS), Ok(vec![(first.id, Taking::Taken)]));
        let ledger = Ledger::read(&machine.ledger()).expect("whole");
        inbox.verify(&ledger.jobs()[0]).expect("whole");
        let unheld = job(5, first.bundle).id;
        fs::create_dir_all(inbox.files(unheld)).expect("a folder");
        inbox.delete_unheld(&ledger).expect("deleted");
        assert!(!inbox.files(unheld).exists() && inbox.files(first.id).exists());
    }
}
