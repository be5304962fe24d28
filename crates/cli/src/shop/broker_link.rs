//! The agent's side of the broker: jobs from it, events and states to it, beside the local work of the agent.
//!
//! Invariant: the local work of the agent never waits for the broker.

use std::path::PathBuf;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use retrace_config::NumberedError;
use retrace_journal::{JobStore, Timestamp};
use retrace_shop::{
    BrokerConnection, BrokerNews, EventSender, JobReceiver, Ledger, LedgerJob, MachineFolder, MachineReport,
    MachineState, ShopFile, ShopJobState, StateSender,
};

/// Time between two passes.
const INTERVAL: Duration = Duration::from_millis(500);
/// Time between two looks at the machine.
const STATE_INTERVAL: Duration = Duration::from_millis(200);
/// Time between two looks at the ledger for the figures of the state.
const FIGURES_INTERVAL: Duration = Duration::from_secs(3);
/// Longest wait for the connection of `agent --once`.
const CONNECT_LIMIT: Duration = Duration::from_secs(5);
/// Longest lines that are retained of refusals, so that each is printed once.
const MAX_PRINTED: usize = 100;

/// The agent's connection to the broker.
pub struct BrokerLink {
    connection: Arc<BrokerConnection>,
    jobs: JobReceiver,
    events: EventSender,
    /// What was refused lately.
    printed: Vec<String>,
}

impl BrokerLink {
    /// Begins to connect; `None` where the shop file has no broker.
    ///
    /// # Errors
    /// `E5035`, `E5036`
    pub fn begin(file: &ShopFile, machine: &MachineFolder) -> Result<Option<Self>, NumberedError> {
        let Some(settings) = &file.broker else { return Ok(None) };
        if settings.is_insecure {
            eprintln!("note: the connection to the broker is not encrypted; everyone on its network can read programs");
        }
        let connection = Arc::new(BrokerConnection::begin(settings, file.name.as_str())?);
        Ok(Some(Self {
            connection,
            jobs: JobReceiver::new(machine.clone(), settings.clone(), file.limits),
            events: EventSender::new(machine.clone()),
            printed: Vec::new(),
        }))
    }

    /// Receives and sends what there is now, and returns whether jobs were received.
    ///
    /// # Errors
    /// Those of the broker.
    pub fn once(&mut self) -> Result<bool, NumberedError> {
        self.connection.wait(CONNECT_LIMIT)?;
        self.pass()
    }

    fn pass(&mut self) -> Result<bool, NumberedError> {
        let mut news = Vec::new();
        let received = self.jobs.pass(&self.connection, &mut news);
        let has_jobs = news.iter().any(|one| matches!(one, BrokerNews::Received(..)));
        news.into_iter().for_each(|one| self.print(one));
        received?;
        self.events.pass(&self.connection)?;
        Ok(has_jobs)
    }

    fn print(&mut self, news: BrokerNews) {
        match news {
            BrokerNews::Received(id, from) => say!("job {id}: received from {}", crate::escape::name(&from)),
            BrokerNews::GivenBack(id, from) => say!("job {id}: given back, recalled by {}", crate::escape::name(&from)),
            BrokerNews::Text(from, text) => {
                say!("{}: {}", crate::escape::name(&from), crate::escape::lines(&text));
            }
            BrokerNews::Refused(error) => self.print_error(&error),
        }
    }

    fn print_error(&mut self, error: &NumberedError) {
        let text = error.to_string();
        if self.printed.contains(&text) {
            return;
        }
        eprintln!("{}", crate::escape::lines(&text));
        if self.printed.len() == MAX_PRINTED {
            self.printed.remove(0);
        }
        self.printed.push(text);
    }

    /// Runs until the process ends, in threads of its own.
    pub fn run(mut self, file: &ShopFile) {
        let connection = Arc::clone(&self.connection);
        let machine = file.machine_folder();
        thread::spawn(move || report_states(&connection, &machine));
        thread::spawn(move || {
            let mut was_connected = false;
            loop {
                let is_connected = self.connection.is_connected();
                if is_connected != was_connected {
                    say!("broker: {}", if is_connected { "connected" } else { "away; it is tried again" });
                    was_connected = is_connected;
                }
                if is_connected {
                    match self.pass() {
                        Ok(_) => {}
                        Err(error) => self.print_error(&error),
                    }
                }
                thread::sleep(INTERVAL);
            }
        });
    }
}

/// Sends the state of the machine until the process ends.
fn report_states(connection: &BrokerConnection, machine: &MachineFolder) {
    let mut sender = StateSender::new(machine.name().clone());
    let mut source = StateSource::new();
    let (mut figures, mut read_at) = (Figures::default(), None::<Instant>);
    loop {
        if read_at.is_none_or(|at| at.elapsed() >= FIGURES_INTERVAL) {
            (figures, read_at) = (Figures::read(machine), Some(Instant::now()));
        }
        let report = source.read();
        let now = MachineState::of(report, Timestamp::now());
        let now = if figures.is_alone { now } else { MachineState::not_known(now.when) };
        let (job, trouble) = (figures.running_job.clone(), figures.trouble.clone());
        let state = MachineState { job, pieces: figures.pieces, jobs: figures.jobs, trouble, ..now };
        if connection.is_connected() {
            // it is sent again
            let _ = sender.pass(connection, &state);
        }
        thread::sleep(STATE_INTERVAL);
    }
}

/// What the ledger says of the machine.
#[derive(Clone, Debug, Default)]
struct Figures {
    /// Name of the job that is running.
    running_job: Option<String>,
    pieces: Option<[u64; 2]>,
    jobs: [u64; 2],
    trouble: Option<String>,
    /// Whether what a command reports is of this machine.
    is_alone: bool,
}

impl Figures {
    fn read(machine: &MachineFolder) -> Self {
        let is_alone = machine.is_alone();
        let ledger = match Ledger::read(&machine.ledger()) {
            Ok(ledger) => ledger,
            Err(error) => return Self { trouble: Some(error.number.to_owned()), is_alone, ..Self::default() },
        };
        let good = ledger.jobs().iter().map(|job| u64::from(job.good_pieces_now())).sum();
        let scrap = ledger.jobs().iter().flat_map(|job| &job.runs).filter(|run| run.is_scrap).count() as u64;
        let states: Vec<ShopJobState> = ledger.jobs().iter().map(LedgerJob::state).collect();
        let is_running = |(_, state): &(&LedgerJob, &ShopJobState)| **state == ShopJobState::Running;
        let running = ledger.jobs().iter().zip(&states).find(is_running);
        let count = |state| states.iter().filter(|&&found| found == state).count() as u64;
        Self {
            running_job: running.map(|(job, _)| job.job.id.to_string()),
            pieces: Some([good, scrap]),
            jobs: [count(ShopJobState::Ready), count(ShopJobState::Interrupted)],
            trouble: None,
            is_alone,
        }
    }
}

/// Where the state of the machine is read.
struct StateSource {
    #[cfg(unix)]
    reader: Option<retrace_shop::StateReader>,
    report: MachineReport,
}

impl StateSource {
    fn new() -> Self {
        let folder: Option<PathBuf> = JobStore::state_folder();
        #[cfg(not(unix))]
        let _ = folder;
        Self {
            #[cfg(unix)]
            reader: folder.map(|folder| retrace_shop::StateReader::new(folder.join("running"))),
            report: MachineReport::default(),
        }
    }

    fn read(&mut self) -> &MachineReport {
        #[cfg(unix)]
        if let Some(reader) = &mut self.reader {
            reader.read(&mut self.report);
        }
        &self.report
    }
}
