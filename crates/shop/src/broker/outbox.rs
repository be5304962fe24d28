//! The jobs that this computer has submitted, until a machine has taken them (SHP-5).
//!
//! A server's acknowledgement means that it has a job in memory, not on its disk. So a job stays here, whole, until the
//! claim of a machine says that the machine's ledger has it, and is sent again to a server that has lost it.
//!
//! Invariant: a job leaves the outbox only when a machine has it, has refused it, or it was recalled.

use std::path::Path;

use async_nats::header::HeaderMap;
use retrace_config::NumberedError;
use retrace_journal::Timestamp;
use retrace_journal::state_file::{self, FileAccess};
use serde::{Deserialize, Serialize};

use super::broker_connection::{ANSWER_LIMIT, BrokerConnection};
use super::claim::{Claim, ClaimState, Claiming, Claims};
use super::program_store::ProgramStore;
use super::signed_message::{ShopMessage, sign};
use super::stores::{JOBS, job_subject};
use crate::bundle::{Bundle, SourceFile};
use crate::checked_log::{self, OpenLog};
use crate::inbox_limits::InboxLimits;
use crate::job::{JobTarget, ShopJob};
use crate::job_id::ShopJobId;
use crate::machine_folder::unusable;
use crate::queue::{JobQueue, QueuedJob, StagedFiles};

/// The outbox of a submitter.
#[derive(Debug)]
pub struct Outbox {
    queue: JobQueue,
}

/// A job that was submitted here, in the order of submission.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SubmittedJob {
    /// The job.
    pub id: ShopJobId,
    /// For whom it is.
    pub target: JobTarget,
    /// Time, by this computer's clock, in UTC.
    pub when: Timestamp,
}

/// Where a job was stored at the broker.
#[derive(Serialize, Deserialize, PartialEq)]
struct SentMark {
    /// Time at which the stream was made.
    stream: String,
    sequence: u64,
}

/// What became of a job of the outbox.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Delivery {
    /// It was sent now.
    Sent,
    /// The broker has it; no machine has taken it yet.
    Waits,
    /// A machine has it, or it was given back or refused: it has left the outbox.
    Settled(Claim),
}

impl Outbox {
    /// The outbox below a root.
    ///
    /// # Errors
    /// `E5010`
    pub fn open(root: &Path) -> Result<Self, NumberedError> {
        Ok(Self { queue: JobQueue::outbox(root)? })
    }

    /// Copies the files of a job that is to be submitted.
    ///
    /// # Errors
    /// As [`JobQueue::stage`].
    pub fn stage(&self, sources: &[SourceFile], limits: InboxLimits) -> Result<StagedFiles, NumberedError> {
        self.queue.stage(sources, limits)
    }

    /// Puts a job into the outbox, durably.
    ///
    /// # Errors
    /// `E5006` for a job with wrong texts or of another bundle; `E5009`, `E5010`.
    pub fn submit(&self, staged: StagedFiles, job: &ShopJob) -> Result<(), NumberedError> {
        let (mut log, _) = OpenLog::open::<SubmittedJob>(&self.queue.path("submitted"))?;
        log.append(&SubmittedJob { id: job.id, target: job.target.clone(), when: Timestamp::now() })?;
        drop(log);
        staged.submit(job)
    }

    /// The jobs that were submitted here, the oldest first.
    ///
    /// # Errors
    /// `E5009`, `E5010`
    pub fn submitted(&self) -> Result<Vec<SubmittedJob>, NumberedError> {
        Ok(checked_log::read(&self.queue.path("submitted"))?.entries)
    }

    /// The jobs that no machine has taken yet, the oldest first.
    ///
    /// # Errors
    /// `E5010`
    pub fn ids(&self) -> Result<Vec<ShopJobId>, NumberedError> {
        self.queue.ids()
    }

    /// Sends a job where the broker does not have it, and removes it where a machine has it.
    ///
    /// # Errors
    /// `E5006` where its files are damaged; `E5010`; `E5035`, `E5038`.
    pub fn deliver(&self, broker: &BrokerConnection, id: ShopJobId) -> Result<Option<Delivery>, NumberedError> {
        let Some(queued) = self.queue.read(id)? else { return Ok(None) };
        let claims = Claims::open(broker)?;
        match claims.get(&queued.job.target, id)? {
            Some((claim, _)) if claim.state != ClaimState::Claimed => {
                self.queue.remove(id)?;
                return Ok(Some(Delivery::Settled(claim)));
            }
            _ => {}
        }
        let mark = queued.folder.join("sent");
        let message = sign(&ShopMessage::Job { job: Box::new(queued.job.clone()) }, broker.key())?;
        if is_there(broker, &mark, &message)? {
            return Ok(Some(Delivery::Waits));
        }
        send_files(broker, &queued)?;
        let sequence = publish(broker, &ShopMessage::Job { job: Box::new(queued.job) })?;
        let sent = SentMark { stream: created(broker)?, sequence };
        let text = serde_json::to_vec(&sent).unwrap_or_default();
        state_file::replace(&mark, &text, FileAccess::Private).map_err(|error| unusable(&mark, &error))?;
        Ok(Some(Delivery::Sent))
    }

    /// Asks the machines to give a job back (SHP-14). One that no machine has claimed is recalled at once.
    ///
    /// # Errors
    /// `E5035`, `E5038`
    pub fn recall(
        &self,
        broker: &BrokerConnection,
        target: &JobTarget,
        job: ShopJobId,
    ) -> Result<Claiming, NumberedError> {
        let claims = Claims::open(broker)?;
        let claiming = claims.claim(target, job, None, ClaimState::Returned)?;
        if let Claiming::Others(Claim { state: ClaimState::Claimed | ClaimState::Taken, machine }) = &claiming {
            // to the machine itself: what is for its groups it reads only when it has nothing to do
            let holder = machine.clone().map_or_else(|| target.clone(), JobTarget::Machine);
            let (id, job_target) = (ShopJobId::new_now()?, target.clone());
            publish(broker, &ShopMessage::Recall { target: holder, id, job, job_target })?;
        }
        Ok(claiming)
    }
}

/// Publishes a signed message. Returns its sequence number.
///
/// # Errors
/// `E5006` for its texts; `E5035`, `E5038`.
pub fn publish(broker: &BrokerConnection, message: &ShopMessage) -> Result<u64, NumberedError> {
    let signed = sign(message, broker.key())?;
    let mut headers = HeaderMap::new();
    headers.insert("Nats-Msg-Id", message.message_id().as_str());
    let subject = job_subject(&message.target());
    let published = async {
        let sent = broker.context().publish_with_headers(subject, headers, signed.into()).await?;
        sent.await
    };
    broker.run(2 * ANSWER_LIMIT, "a message", published).map(|ack| ack.sequence)
}

fn send_files(broker: &BrokerConnection, queued: &QueuedJob) -> Result<(), NumberedError> {
    let bundle = Bundle::read(&queued.folder.join("bundle.json"), queued.job.bundle)?;
    ProgramStore::open(broker)?.send(&bundle, &queued.folder.join("files"))
}

fn created(broker: &BrokerConnection) -> Result<String, NumberedError> {
    Ok(broker.stream(JOBS)?.cached_info().created.to_string())
}

/// Whether the broker has a job where it was stored.
fn is_there(broker: &BrokerConnection, mark: &Path, message: &str) -> Result<bool, NumberedError> {
    let mark = std::fs::read(mark).ok().and_then(|text| serde_json::from_slice::<SentMark>(&text).ok());
    let Some(SentMark { stream, sequence }) = mark else { return Ok(false) };
    let jobs = broker.stream(JOBS)?;
    if jobs.cached_info().created.to_string() != stream {
        return Ok(false);
    }
    let found = broker.run_found("a message", jobs.direct_get(sequence))?;
    Ok(found.is_some_and(|found| found.payload == message.as_bytes()))
}
