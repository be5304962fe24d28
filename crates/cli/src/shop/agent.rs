//! `retrace shop agent`: takes the jobs of this machine and checks them, beside the runs of the machine (SHP-2).
//!
//! Invariant: the agent writes to the machine's inbox, queue and watched folder only. It may be killed at any moment:
//! what it has not written to the ledger it does again.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use retrace_config::NumberedError;
use retrace_journal::Timestamp;
use retrace_shop::{
    FolderWatch, Inbox, JobQueue, Ledger, LedgerEntry, MachineFolder, OpenLedger, ShopFile, ShopJobId, ShopJobState,
    Taking, WatchOutcome, take_waiting,
};

use super::broker_link::BrokerLink;
use super::job_check::{self, Checked};

/// Time between two looks at queue and folder.
const POLL_INTERVAL: Duration = Duration::from_secs(1);
/// Time between two looks where files wait until they count as whole.
const STANDING_INTERVAL: Duration = Duration::from_millis(250);
/// Longest time that `--once` waits for files that are still being written.
const MAX_STANDING_WAIT: Duration = Duration::from_secs(30);
/// Time after which a check that could not be run is tried again.
const CHECK_RETRY_INTERVAL: Duration = Duration::from_secs(60);

/// The agent of a machine.
struct Agent<'a> {
    file: &'a ShopFile,
    machine: MachineFolder,
    watch: Option<FolderWatch>,
    /// Last error of each job or file, which is printed once.
    printed: BTreeMap<String, String>,
    /// Jobs whose check could not be run, and when.
    unchecked: BTreeMap<ShopJobId, Instant>,
    /// The last check that could not be run.
    check_error: Option<NumberedError>,
}

/// Runs the agent, until it is ended or, with `once`, until nothing is left to be done.
///
/// # Errors
/// `E5011` where another agent runs; `E5009`, `E5010` where the ledger cannot be used; with `once` also `E5016`.
pub fn run(file: &ShopFile, once: bool) -> Result<(), NumberedError> {
    let machine = file.machine_folder();
    machine.create()?;
    let _lock = machine.lock_agent()?;
    lower_priority();
    Inbox::of(&machine).delete_unheld(&Ledger::read(&machine.ledger())?)?;
    JobQueue::of(&machine).delete_abandoned()?;
    let watch = watch(file)?;
    let mut agent =
        Agent { file, machine, watch, printed: BTreeMap::new(), unchecked: BTreeMap::new(), check_error: None };
    let began = Instant::now();
    let mut link = BrokerLink::begin(file, &agent.machine)?;
    if !once && let Some(link) = link.take() {
        link.run(file);
    }
    let mut receive = || link.as_mut().map_or(Ok(false), BrokerLink::once);
    receive()?;
    loop {
        agent.submit_watched()?;
        agent.take()?;
        agent.check()?;
        OpenLedger::open(&agent.machine.ledger())?.record_ended_runs()?;
        let is_standing = agent.watch.as_ref().is_some_and(FolderWatch::has_standing_files);
        // what was taken and checked is told, and there may be room for more
        let has_received = receive()?;
        if once && !has_received && (!is_standing || began.elapsed() > MAX_STANDING_WAIT) {
            return agent.check_error.map_or(Ok(()), Err);
        }
        std::thread::sleep(if is_standing { STANDING_INTERVAL } else { POLL_INTERVAL });
    }
}

fn watch(file: &ShopFile) -> Result<Option<FolderWatch>, NumberedError> {
    let Some(config) = &file.watch else { return Ok(None) };
    let folder = file.folder_of(&config.machine)?;
    Ok(Some(FolderWatch::new(config.clone(), folder, file.limits)))
}

/// Lowers the priority of this process and of the checks that it starts: the runs of the machine come first.
fn lower_priority() {
    // where it cannot be lowered, the agent works as well
    #[cfg(unix)]
    let _ = rustix::process::nice(10);
}

impl Agent<'_> {
    /// Prints an error once for a job or a file.
    fn print_error(&mut self, of: &str, error: &NumberedError) {
        let text = error.to_string();
        if self.printed.get(of) != Some(&text) {
            eprintln!("{}", crate::escape::lines(&text));
            self.printed.insert(of.to_owned(), text);
        }
    }

    fn submit_watched(&mut self) -> Result<(), NumberedError> {
        let Some(watch) = &mut self.watch else { return Ok(()) };
        let outcomes = match watch.poll(Instant::now()) {
            Ok(outcomes) => outcomes,
            // a share that is away comes back
            Err(refusal) => {
                self.print_error("[watch]", &refusal);
                return Ok(());
            }
        };
        for outcome in outcomes {
            match outcome {
                WatchOutcome::Submitted { name, id } => say!("{}: submitted as job {id}", crate::escape::name(&name)),
                WatchOutcome::Failed { name, error } | WatchOutcome::Stays { name, error } => {
                    self.print_error(&name, &error);
                }
            }
        }
        Ok(())
    }

    fn take(&mut self) -> Result<(), NumberedError> {
        for (id, taking) in take_waiting(&self.machine, self.file.limits)? {
            match taking {
                Taking::Taken => say!("job {id}: taken"),
                Taking::Known => {}
                Taking::Refused(refusal) => {
                    say!("job {id}: refused");
                    self.print_error(&id.to_string(), &refusal);
                }
                Taking::Waits(refusal) => self.print_error(&id.to_string(), &refusal),
            }
        }
        Ok(())
    }

    /// Checks every job that was taken and not checked.
    fn check(&mut self) -> Result<(), NumberedError> {
        self.unchecked.retain(|_, at| at.elapsed() < CHECK_RETRY_INTERVAL);
        let ledger = Ledger::read(&self.machine.ledger())?;
        let unchecked = ledger.jobs().iter().filter(|job| job.check.is_none() && job.state() == ShopJobState::Taken);
        for job in unchecked {
            let id = job.job.id;
            if self.unchecked.contains_key(&id) {
                continue;
            }
            match job_check::check(self.file, &Inbox::of(&self.machine), job) {
                Ok(checked) => self.append_check(id, checked)?,
                Err(refusal) => {
                    self.print_error(&id.to_string(), &refusal);
                    self.unchecked.insert(id, Instant::now());
                    self.check_error = Some(refusal);
                }
            }
        }
        Ok(())
    }

    fn append_check(&self, id: ShopJobId, checked: Checked) -> Result<(), NumberedError> {
        let mut open = OpenLedger::open(&self.machine.ledger())?;
        // it may have been recalled meanwhile
        let is_taken = open.ledger().job(id).is_some_and(|job| job.state() == ShopJobState::Taken);
        if !is_taken {
            return Ok(());
        }
        let when = Timestamp::now();
        match checked {
            Checked::Ready(check) => {
                say!("job {id}: ready, {}", super::job_list::check_text(&check));
                open.append(LedgerEntry::Checked { when, id, check })
            }
            Checked::Errors(check) => {
                say!("job {id}: refused, {}", super::job_list::check_text(&check));
                open.append(LedgerEntry::Refused { when, id, check, not_taken: None })
            }
        }
    }
}
