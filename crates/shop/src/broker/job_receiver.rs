//! The jobs that come from the broker: they are claimed, loaded and put into the local queue of the machine.
//!
//! The subjects of the machine and of its groups are read from the beginning after each connection; nothing is
//! acknowledged at the server. What the ledger or the queue has is not taken again. The order makes that safe against
//! an end of any process at any moment: the claim, the files, the queue, then (by the agent) the ledger, and at last
//! `taken` in the claim, which lets the submitter forget the job.
//!
//! Invariant: only what a submitter of the shop file has signed for this machine or its groups reaches the queue.
//! Nothing that arrives does anything else than that, a recall, or a text for the operator.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use async_nats::jetstream::stream::Stream;
use retrace_config::NumberedError;
use retrace_journal::Timestamp;

use super::broker_connection::BrokerConnection;
use super::broker_settings::BrokerSettings;
use super::claim::{ClaimState, Claiming, Claims};
use super::program_store::ProgramStore;
use super::signed_message::{ShopMessage, verify};
use super::stores::{JOBS, job_subject};
use crate::inbox_limits::InboxLimits;
use crate::job::{JobTarget, ShopJob};
use crate::job_id::ShopJobId;
use crate::ledger::{Ledger, LedgerJob, OpenLedger};
use crate::ledger_entry::{CheckSummary, LedgerEntry};
use crate::machine_folder::MachineFolder;
use crate::message_log::{self, HandledContent, HandledMessage};
use crate::queue::JobQueue;
use crate::recall::give_back;

/// Time before a job is tried again whose files are not there.
const RETRY_INTERVAL: Duration = Duration::from_secs(30);
/// Number of times that a job is tried whose files are not there.
const MAX_ATTEMPTS: u32 = 5;
/// Most jobs that wait to be tried again; beyond them no further message is read.
const MAX_WAITING: usize = 1000;
/// Most jobs in the queue of the machine: its inbox may have no room for them.
const MAX_QUEUED: usize = 20;
/// Most messages that are read in one pass.
const MAX_PER_PASS: usize = 10_000;

/// What the receiver has done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BrokerNews {
    /// A job is in the queue of the machine.
    Received(ShopJobId, String),
    /// A job was given back.
    GivenBack(ShopJobId, String),
    /// A text for the operator.
    Text(String, String),
    /// A message was refused, or a job cannot be had now.
    Refused(NumberedError),
}

/// Receiver of a machine's jobs.
#[derive(Debug)]
pub struct JobReceiver {
    machine: MachineFolder,
    settings: BrokerSettings,
    limits: InboxLimits,
    /// Time before a job is tried again.
    retry_interval: Duration,
    /// Connection of what is known of the broker.
    connection: u64,
    /// Next sequence number of each subject.
    feeds: Vec<(JobTarget, u64)>,
    /// Jobs that are tried again.
    waiting: BTreeMap<ShopJobId, WaitingJob>,
    /// States of the claims that were set over this connection.
    claims: BTreeMap<ShopJobId, ClaimState>,
    /// Jobs that are in the ledger: a job that is there once stays there.
    known: BTreeSet<ShopJobId>,
}

#[derive(Debug)]
struct WaitingJob {
    job: ShopJob,
    from: String,
    attempts: u32,
    next: Instant,
}

impl JobReceiver {
    /// Receiver of this machine.
    #[must_use]
    pub fn new(machine: MachineFolder, settings: BrokerSettings, limits: InboxLimits) -> Self {
        Self {
            machine,
            settings,
            limits,
            retry_interval: RETRY_INTERVAL,
            connection: 0,
            feeds: Vec::new(),
            waiting: BTreeMap::new(),
            claims: BTreeMap::new(),
            known: BTreeSet::new(),
        }
    }

    /// Reads what has come, and brings the claims in line with the ledger. Returns what was done.
    ///
    /// # Errors
    /// `E5009`, `E5010` for the ledger; `E5035`, `E5038` for the broker, after which the next pass goes on.
    pub fn pass(&mut self, broker: &BrokerConnection, news: &mut Vec<BrokerNews>) -> Result<(), NumberedError> {
        let connection = broker.connections();
        if connection != self.connection || self.feeds.is_empty() {
            let own = JobTarget::Machine(self.machine.name().clone());
            let groups = self.settings.groups.iter().cloned().map(JobTarget::Group);
            self.feeds = std::iter::once(own).chain(groups).map(|target| (target, 1)).collect();
            self.claims.clear();
            self.connection = connection;
        }
        self.set_claims(broker, news)?;
        let stream = broker.stream(JOBS)?;
        self.retry_waiting(broker, news)?;
        for feed in 0..self.feeds.len() {
            self.read_feed(broker, &stream, feed, news)?;
        }
        self.set_claims(broker, news)
    }

    fn read_feed(
        &mut self,
        broker: &BrokerConnection,
        stream: &Stream,
        feed: usize,
        news: &mut Vec<BrokerNews>,
    ) -> Result<(), NumberedError> {
        for _ in 0..MAX_PER_PASS {
            let (target, next) = self.feeds[feed].clone();
            let is_group = matches!(target, JobTarget::Group(_));
            let is_full = self.waiting.len() >= MAX_WAITING || JobQueue::of(&self.machine).ids()?.len() >= MAX_QUEUED;
            if is_full || (is_group && !self.is_idle()?) {
                return Ok(());
            }
            let request = stream.direct_get_builder().sequence(next).next_by_subject(job_subject(&target)).send();
            let Some(message) = broker.run_found("a message", request)? else { return Ok(()) };
            match verify(&message.payload, &self.settings.submitters) {
                Ok((message, from)) if message.target() == target => self.handle(broker, message, from, news)?,
                Ok((message, from)) => {
                    let what =
                        format!("{from} has signed a message for {}, and it was sent to {target}", message.target());
                    let error = NumberedError::new("E5037", what, "look for who has sent it again; it is ignored");
                    news.push(BrokerNews::Refused(error));
                }
                Err(refusal) => news.push(BrokerNews::Refused(refusal)),
            }
            // behind the handling: after an error it is read again
            self.feeds[feed].1 = message.sequence + 1;
        }
        Ok(())
    }

    /// Whether the machine has nothing to do: only then it takes a job of a group.
    fn is_idle(&self) -> Result<bool, NumberedError> {
        let is_queue_empty = JobQueue::of(&self.machine).ids()?.is_empty();
        let ledger = Ledger::read(&self.machine.ledger())?;
        Ok(is_queue_empty && ledger.jobs().iter().all(|job| job.is_returned || job.state().is_final()))
    }

    fn handle(
        &mut self,
        broker: &BrokerConnection,
        message: ShopMessage,
        from: String,
        news: &mut Vec<BrokerNews>,
    ) -> Result<(), NumberedError> {
        match message {
            ShopMessage::Job { job } => self.receive(broker, *job, from, 0, news),
            ShopMessage::Recall { id, job, job_target, .. } => self.recall(broker, (&job_target, id, job), from, news),
            ShopMessage::Say { id, text, .. } => {
                if self.is_handled(id)? {
                    return Ok(());
                }
                news.push(BrokerNews::Text(from.clone(), text.clone()));
                self.append_handled(id, from, HandledContent::Text { text })
            }
        }
    }

    fn is_handled(&self, id: ShopJobId) -> Result<bool, NumberedError> {
        Ok(message_log::read(&self.machine.messages())?.iter().any(|message| message.id == id))
    }

    fn append_handled(&self, id: ShopJobId, from: String, content: HandledContent) -> Result<(), NumberedError> {
        let handled = HandledMessage { id, when: Timestamp::now(), from, content };
        message_log::append(&self.machine.messages(), &handled)
    }

    fn recall(
        &mut self,
        broker: &BrokerConnection,
        (target, id, job): (&JobTarget, ShopJobId, ShopJobId),
        from: String,
        news: &mut Vec<BrokerNews>,
    ) -> Result<(), NumberedError> {
        if self.is_handled(id)? {
            return Ok(());
        }
        let claims = Claims::open(broker)?;
        let name = self.machine.name().clone();
        let ledger = Ledger::read(&self.machine.ledger())?;
        let held = ledger.job(job).map(|held| &held.job.target);
        // what is not for this machine or its groups it may not claim: asking would be refused again and again
        let is_mine = self.feeds.iter().any(|(of, _)| of == target);
        // a job that no machine has is not taken any more; one of another machine is that machine's matter
        let is_elsewhere = held.is_none()
            && (!is_mine
                || matches!(claims.claim(target, job, Some(&name), ClaimState::Returned)?, Claiming::Others(_)));
        if is_elsewhere {
            return self.append_handled(id, from, HandledContent::Recall { job, refused: Some("not here".into()) });
        }
        let refused = give_back(&self.machine, job)?;
        if refused.is_none() {
            self.waiting.remove(&job);
            // the claim of a job of the ledger follows with the others
            if held.is_none() {
                claims.set(target, job, &name, ClaimState::Returned)?;
            }
            news.push(BrokerNews::GivenBack(job, from.clone()));
        }
        let refused = refused.map(|state| state.word().to_owned());
        self.append_handled(id, from, HandledContent::Recall { job, refused })
    }

    fn retry_waiting(&mut self, broker: &BrokerConnection, news: &mut Vec<BrokerNews>) -> Result<(), NumberedError> {
        let now = Instant::now();
        let due: Vec<ShopJobId> =
            self.waiting.iter().filter(|(_, waiting)| waiting.next <= now).map(|(id, _)| *id).collect();
        for id in due {
            let Some(WaitingJob { job, from, attempts, .. }) = self.waiting.remove(&id) else { continue };
            if let Err(error) = self.receive(broker, job.clone(), from.clone(), attempts, news) {
                // its message was read: only here it is still known
                self.waiting.insert(id, WaitingJob { job, from, attempts, next: now + self.retry_interval });
                return Err(error);
            }
        }
        Ok(())
    }

    /// Claims a job and loads it.
    fn receive(
        &mut self,
        broker: &BrokerConnection,
        job: ShopJob,
        from: String,
        attempts: u32,
        news: &mut Vec<BrokerNews>,
    ) -> Result<(), NumberedError> {
        let (id, queue) = (job.id, JobQueue::of(&self.machine));
        if self.known.contains(&id) || queue.contains(id) {
            return Ok(());
        }
        // the queue first: what is taken meanwhile is in the ledger then
        if Ledger::read(&self.machine.ledger())?.job(id).is_some() {
            self.known.insert(id);
            return Ok(());
        }
        // before the claim: another machine of the group may have room
        if let Err(refusal) = queue.check_room(0, self.limits) {
            news.push(BrokerNews::Refused(refusal));
            let next = Instant::now() + 2 * self.retry_interval;
            self.waiting.insert(id, WaitingJob { job, from, attempts, next });
            return Ok(());
        }
        let name = self.machine.name().clone();
        match Claims::open(broker)?.claim(&job.target, id, Some(&name), ClaimState::Claimed)? {
            Claiming::Ours(ClaimState::Claimed) => {}
            Claiming::Ours(ClaimState::Taken) => {
                let what = format!("machine {name} had job {id} already, and its ledger does not have it");
                let remedy = "look at the machine whether it was cut; if it was not, recall it and submit it again";
                news.push(BrokerNews::Refused(NumberedError::new("E5039", what, remedy)));
                return Ok(());
            }
            Claiming::Ours(ClaimState::Returned | ClaimState::Refused) | Claiming::Others(_) => return Ok(()),
        }
        match self.load(broker, &job, &from) {
            Ok(true) => {
                news.push(BrokerNews::Received(id, from));
                Ok(())
            }
            Ok(false) if attempts + 1 >= MAX_ATTEMPTS => {
                let what = format!("the files of job {id} are not at the broker");
                self.refuse(job, &NumberedError::new("E5006", what, "submit the job again"), news)
            }
            Ok(false) => {
                let next = Instant::now() + self.retry_interval;
                self.waiting.insert(id, WaitingJob { job, from, attempts: attempts + 1, next });
                Ok(())
            }
            Err(refusal) if refusal.number == "E5008" => {
                news.push(BrokerNews::Refused(refusal));
                let next = Instant::now() + 2 * self.retry_interval;
                self.waiting.insert(id, WaitingJob { job, from, attempts, next });
                Ok(())
            }
            Err(refusal) if matches!(refusal.number, "E5005" | "E5006" | "E5007") => self.refuse(job, &refusal, news),
            Err(error) => Err(error),
        }
    }

    /// Loads a job into the queue. Returns whether the broker has all of its files.
    fn load(&self, broker: &BrokerConnection, job: &ShopJob, from: &str) -> Result<bool, NumberedError> {
        let store = ProgramStore::open(broker)?;
        let Some(bundle) = store.bundle(job.bundle)? else { return Ok(false) };
        let mut is_whole = false;
        let bytes = bundle.bytes();
        let staged = JobQueue::of(&self.machine).stage_by(bytes, self.limits, |files| {
            is_whole = store.load_files(&bundle, files)?;
            Ok(bundle)
        })?;
        if is_whole {
            // who has signed it is known; the name in the job is the sender's own word
            staged.submit(&ShopJob { submitter: from.to_owned(), ..job.clone() })?;
        }
        Ok(is_whole)
    }

    fn refuse(&self, job: ShopJob, refusal: &NumberedError, news: &mut Vec<BrokerNews>) -> Result<(), NumberedError> {
        let (when, id) = (Timestamp::now(), job.id);
        let check = CheckSummary::of_refusal(refusal);
        let mut open = OpenLedger::open(&self.machine.ledger())?;
        if open.ledger().job(id).is_none() {
            open.append(LedgerEntry::Refused { when, id, check, not_taken: Some(Box::new(job)) })?;
        }
        news.push(BrokerNews::Refused(refusal.clone()));
        Ok(())
    }

    /// Sets the claims of the jobs in the ledger.
    fn set_claims(&mut self, broker: &BrokerConnection, news: &mut Vec<BrokerNews>) -> Result<(), NumberedError> {
        let ledger = Ledger::read(&self.machine.ledger())?;
        self.known = ledger.jobs().iter().map(|job| job.job.id).collect();
        let is_old = |job: &LedgerJob| self.claims.get(&job.job.id) != Some(&claim_state(job));
        let due: Vec<&LedgerJob> = ledger.jobs().iter().filter(|job| is_old(job)).collect();
        if due.is_empty() {
            return Ok(());
        }
        let claims = Claims::open(broker)?;
        for job in due {
            let (id, state) = (job.job.id, claim_state(job));
            match claims.set(&job.job.target, id, self.machine.name(), state) {
                Ok(()) => {}
                // what was given back may be anybody's
                Err(error) if error.number == "E5039" && state != ClaimState::Taken => {}
                // a machine that has left a group may not change its claims: that holds up nothing
                Err(error) if matches!(error.number, "E5038" | "E5039") => news.push(BrokerNews::Refused(error)),
                Err(error) => return Err(error),
            }
            self.claims.insert(id, state);
        }
        Ok(())
    }
}

fn claim_state(job: &LedgerJob) -> ClaimState {
    match job {
        LedgerJob { is_returned: true, .. } => ClaimState::Returned,
        LedgerJob { is_refused: true, .. } => ClaimState::Refused,
        _ => ClaimState::Taken,
    }
}

#[cfg(test)]
mod tests;
