//! Which machine holds a job (SHP-10).
//!
//! A claim is made once, by the machine that takes the job, and only that machine changes it. It is made before the
//! files are stored: `claimed`; then `taken`, with the entry of the ledger, or `refused`; `returned` where the job was
//! given back. A submitter that recalls a job that nobody has claimed makes the claim itself.
//!
//! Invariant: of two machines that claim a job, one gets it, whatever fails in between.

use async_nats::jetstream::kv::{Entry, Operation, Store};
use retrace_config::NumberedError;
use serde::{Deserialize, Serialize};

use super::broker_connection::{ANSWER_LIMIT, BrokerConnection};
use super::stores::{CLAIMS, claim_key};
use crate::job::JobTarget;
use crate::job_id::ShopJobId;
use crate::machine_name::MachineName;

/// State of a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ClaimState {
    /// The machine loads the files.
    Claimed,
    /// The job is in the ledger of the machine.
    Taken,
    /// The job was given back, or was recalled before a machine had it; no machine takes it any more.
    Returned,
    /// The machine has refused it.
    Refused,
}

/// A claim.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Claim {
    /// Machine that holds the job; `None` where its submitter has recalled it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub machine: Option<MachineName>,
    /// State.
    pub state: ClaimState,
}

/// What came of a claim.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Claiming {
    /// It is ours, in this state.
    Ours(ClaimState),
    /// It is not.
    Others(Claim),
}

/// The claims at the broker.
#[derive(Debug)]
pub(crate) struct Claims<'a> {
    connection: &'a BrokerConnection,
    bucket: Store,
}

impl<'a> Claims<'a> {
    /// The claims of this connection.
    ///
    /// # Errors
    /// `E5035`, `E5038`
    pub(crate) fn open(connection: &'a BrokerConnection) -> Result<Self, NumberedError> {
        Ok(Self { connection, bucket: connection.bucket(CLAIMS)? })
    }

    /// The claim of a job with its revision. One that cannot be read counts as one of somebody else.
    ///
    /// # Errors
    /// `E5035`, `E5038`
    pub(crate) fn get(&self, target: &JobTarget, id: ShopJobId) -> Result<Option<(Claim, u64)>, NumberedError> {
        let entry = self.connection.run(ANSWER_LIMIT, "a claim", self.bucket.entry(claim_key(target, id)))?;
        Ok(entry.filter(|entry| entry.operation == Operation::Put).map(|entry| (read(&entry), entry.revision)))
    }

    /// Claims a job for a machine.
    ///
    /// # Errors
    /// `E5035` where it is not known whether it was claimed: it is asked again; `E5038`.
    pub(crate) fn claim(
        &self,
        target: &JobTarget,
        id: ShopJobId,
        machine: Option<&MachineName>,
        state: ClaimState,
    ) -> Result<Claiming, NumberedError> {
        let claim = Claim { machine: machine.cloned(), state };
        let made = self.bucket.create(claim_key(target, id), bytes(&claim));
        // An error may be that of an answer that was lost, so that what is there decides.
        if let Some(Ok(_)) = self.connection.try_run(ANSWER_LIMIT, made) {
            return Ok(Claiming::Ours(state));
        }
        match self.get(target, id)? {
            Some((found, _)) if found.machine.as_ref() == machine => Ok(Claiming::Ours(found.state)),
            Some((found, _)) => Ok(Claiming::Others(found)),
            None => Err(NumberedError::new(
                "E5035",
                format!("the broker has not answered (the claim of job {id})"),
                "it is tried again",
            )),
        }
    }

    /// Changes the state of a claim that is this machine's; makes it where it is not there, for example because the
    /// broker has lost its disk.
    ///
    /// # Errors
    /// `E5039` where the claim is another machine's; `E5035`, `E5038`.
    pub(crate) fn set(
        &self,
        target: &JobTarget,
        id: ShopJobId,
        machine: &MachineName,
        state: ClaimState,
    ) -> Result<(), NumberedError> {
        let claim = Claim { machine: Some(machine.clone()), state };
        let other = |found: &Claim| {
            let holder = found.machine.as_ref().map_or("its submitter".to_owned(), |name| format!("machine {name}"));
            let what = format!("job {id} is in the ledger of {machine}, and {holder} has its claim");
            NumberedError::new("E5039", what, "start it at neither machine before it is clear which one is to cut it")
        };
        match self.get(target, id)? {
            Some((found, _)) if found == claim => Ok(()),
            Some((found, revision)) if found.machine.as_ref() == Some(machine) => {
                let update = self.bucket.update(claim_key(target, id), bytes(&claim), revision);
                self.connection.run(ANSWER_LIMIT, "the change of a claim", update).map(|_| ())
            }
            Some((found, _)) => Err(other(&found)),
            None => match self.claim(target, id, Some(machine), state)? {
                Claiming::Ours(_) => Ok(()),
                Claiming::Others(found) => Err(other(&found)),
            },
        }
    }
}

fn read(entry: &Entry) -> Claim {
    serde_json::from_slice(&entry.value).unwrap_or(Claim { machine: None, state: ClaimState::Refused })
}

fn bytes(claim: &Claim) -> bytes::Bytes {
    // neither the name nor the state can fail
    serde_json::to_vec(claim).unwrap_or_default().into()
}
