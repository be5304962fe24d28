//! Gives a job back that this machine has (SHP-14).
//!
//! Invariant: state and entry belong together: the ledger is locked from the look at the state to the entry. What is
//! running or interrupted is never given back.

use retrace_config::NumberedError;
use retrace_journal::Timestamp;

use crate::inbox::Inbox;
use crate::job_id::ShopJobId;
use crate::job_state::ShopJobState;
use crate::ledger::OpenLedger;
use crate::ledger_entry::LedgerEntry;
use crate::machine_folder::MachineFolder;
use crate::queue::JobQueue;

/// Gives a job back that is in the ledger or in the queue of a machine. Returns the state that forbids it, if one does;
/// `None` where it was given back.
///
/// # Errors
/// `E5009` where the ledger is damaged; `E5010`; `E5006` for a job of the queue that cannot be read.
pub fn give_back(machine: &MachineFolder, id: ShopJobId) -> Result<Option<ShopJobState>, NumberedError> {
    let queue = JobQueue::of(machine);
    let when = Timestamp::now();
    let mut open = OpenLedger::open(&machine.ledger())?;
    let not_taken = match open.ledger().job(id).map(super::ledger::LedgerJob::state) {
        Some(ShopJobState::Taken | ShopJobState::Ready) => None,
        Some(state) => return Ok(Some(state)),
        None => queue.read(id)?.map(|queued| Box::new(queued.job)),
    };
    if not_taken.is_some() || open.ledger().job(id).is_some() {
        open.append(LedgerEntry::Returned { when, id, not_taken })?;
    }
    drop(open);
    queue.remove(id)?;
    Inbox::of(machine).delete(id)?;
    Ok(None)
}
