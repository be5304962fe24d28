//! The audit of what the broker has: events and claims (SHP-17).
//!
//! Invariant: the audit only reads.

use std::collections::{BTreeMap, BTreeSet};

use retrace_config::NumberedError;

use super::broker_connection::BrokerConnection;
use super::claim::{ClaimState, Claims};
use super::event_sender::ShopEvent;
use super::stores::EVENTS;
use crate::audit::AuditFault;
use crate::job::{JobTarget, ShopJob};
use crate::job_id::ShopJobId;
use crate::machine_name::MachineName;

/// What the events say of a job.
#[derive(Debug, Default)]
struct EventJob {
    target: Option<JobTarget>,
    quantity: u32,
    /// Machines that have it.
    holders: BTreeSet<MachineName>,
    /// Runs that came to their end.
    completed: BTreeSet<String>,
    scrap: BTreeSet<String>,
}

/// What the events say.
#[derive(Debug, Default)]
struct EventAudit {
    jobs: BTreeMap<ShopJobId, EventJob>,
    /// Number of the last event of each machine.
    last: BTreeMap<MachineName, u64>,
    faults: Vec<AuditFault>,
}

/// Audits events and claims. Returns the number of jobs, and the faults.
///
/// # Errors
/// `E5035`, `E5038`
pub fn audit_broker(broker: &BrokerConnection) -> Result<(usize, Vec<AuditFault>), NumberedError> {
    let stream = broker.stream(EVENTS)?;
    let (mut audit, mut next) = (EventAudit::default(), 1);
    loop {
        let request = stream.direct_get_builder().sequence(next).next_by_subject("shop.event.*").send();
        let Some(message) = broker.run_found("an event", request)? else { break };
        next = message.sequence + 1;
        let from = message.subject.to_string();
        match serde_json::from_slice::<ShopEvent>(&message.payload) {
            Ok(event) if from == format!("shop.event.{}", event.machine) => audit.take(&event),
            _ => audit.fault(None, format!("event {} of {from} is not one of that machine", message.sequence)),
        }
    }
    let claims = Claims::open(broker)?;
    for (id, job) in &audit.jobs {
        if let (Some(target), Some(holder)) = (&job.target, job.holders.first()) {
            let cause = match claims.get(target, *id)? {
                Some((claim, _)) if claim.machine.as_ref() == Some(holder) && claim.state != ClaimState::Returned => {
                    continue;
                }
                Some((claim, _)) => format!("machine {holder} has it, and its claim is {claim:?}"),
                None => format!("machine {holder} has it, and it has no claim"),
            };
            audit.faults.push(AuditFault { id: Some(*id), cause });
        }
    }
    Ok((audit.jobs.len(), audit.finish()))
}

impl EventAudit {
    fn fault(&mut self, id: Option<ShopJobId>, cause: String) {
        self.faults.push(AuditFault { id, cause });
    }

    fn take(&mut self, event: &ShopEvent) {
        let ShopEvent { machine, number, event } = event;
        if let Some(last) = self.last.insert(machine.clone(), *number)
            && *number != last + 1
        {
            self.fault(None, format!("machine {machine}: event {number} follows event {last}"));
        }
        let name = |key: &str| event[key].as_str().unwrap_or_default().to_owned();
        let entry = name("entry");
        let job: Option<ShopJob> = serde_json::from_value(event["job"].clone()).ok();
        let id = job.as_ref().map(|job| job.id).or_else(|| name("id").parse().ok());
        let Some(id) = id else { return self.fault(None, format!("machine {machine}: event {number} names no job")) };
        let known = self.jobs.entry(id).or_default();
        match entry.as_str() {
            "taken" => {
                if let Some(job) = job {
                    (known.target, known.quantity) = (Some(job.target), job.quantity);
                }
                known.holders.insert(machine.clone());
            }
            "returned" => drop(known.holders.remove(machine)),
            "ended" if event["outcome"] == "completed" => drop(known.completed.insert(name("run"))),
            "scrap" => drop(known.scrap.insert(name("run"))),
            _ => {}
        }
    }

    fn finish(self) -> Vec<AuditFault> {
        let mut faults = self.faults;
        for (id, job) in self.jobs {
            let mut fault = |cause: String| faults.push(AuditFault { id: Some(id), cause });
            if job.holders.len() > 1 {
                let names: Vec<&str> = job.holders.iter().map(MachineName::as_str).collect();
                fault(format!("{} machines have it: {}", names.len(), names.join(", ")));
            }
            let good = job.completed.difference(&job.scrap).count();
            if job.target.is_some() && good > job.quantity as usize {
                fault(format!("{good} pieces are good, and {} were ordered", job.quantity));
            }
        }
        faults
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::content_hash::ContentHash;
    use crate::job::tests::job;
    use crate::ledger_entry::{LedgerEntry, RunOutcome};
    use retrace_journal::Timestamp;

    fn event(machine: &str, number: u64, entry: &LedgerEntry) -> ShopEvent {
        let machine = MachineName::parse(machine).expect("a name");
        ShopEvent { machine, number, event: serde_json::to_value(entry).expect("JSON") }
    }

    fn faults(events: &[ShopEvent]) -> usize {
        let mut audit = EventAudit::default();
        events.iter().for_each(|event| audit.take(event));
        audit.finish().len()
    }

    #[test]
    fn two_holders_a_piece_too_many_and_a_missing_event_are_found() {
        let (when, job) = (Timestamp::now(), job(1, ContentHash::of(b"")));
        let id = job.id;
        let taken = LedgerEntry::Taken { when, job, program: "part.ngc".into(), bytes: 1 };
        let ended = |run: &str| LedgerEntry::Ended { when, id, run: run.into(), outcome: RunOutcome::Completed };
        let returned = LedgerEntry::Returned { when, id, not_taken: None };
        assert_eq!(faults(&[event("a", 0, &taken), event("a", 1, &ended("r"))]), 0);
        assert_eq!(faults(&[event("a", 0, &taken), event("b", 0, &taken)]), 1);
        assert_eq!(faults(&[event("a", 0, &taken), event("a", 1, &returned), event("b", 0, &taken)]), 0);
        assert_eq!(faults(&[event("a", 0, &taken), event("a", 2, &returned)]), 1);
        let two = [event("a", 0, &taken), event("a", 1, &ended("r")), event("a", 2, &ended("s"))];
        assert_eq!(faults(&two), 1);
        let scrap = LedgerEntry::Scrap { when, id, run: "r".into() };
        assert_eq!(faults(&[&two[..], &[event("a", 3, &scrap)]].concat()), 0);
    }
}
