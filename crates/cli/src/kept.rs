//! A job's folder while the job runs: held against other processes, its journal being written.
//!
//! Invariant: nothing moves before the job's first entry is kept; of a job that was refused before, nothing but an empty folder is left.

use std::path::Path;

use retrace_controller::event::ChannelNames;
use retrace_controller::index::Keeping;
use retrace_controller::jobs::{Held, JobFolder, Jobs};
use retrace_controller::journal::entry::{
    self, Arguments, End, Ending, FORMAT, Job, MachineFile, Override, Resumed, Source, WiredCard,
};
use retrace_controller::journal::hash::Hash;
use retrace_controller::journal::keeper::Keeper;
use retrace_controller::journal::logbook::{Care, Logbook};
use retrace_controller::journal::record::JobRecord;
use retrace_controller::journal::spool::{Progress, Spooling};
use retrace_controller::journal::stamp::Stamp;
use retrace_controller::machine::Machine;
use retrace_controller::refusal::Refusal;
use retrace_controller::session::Outcome;
use retrace_controller::state_file::{self, Access};
use retrace_link::{CardIdentity, CardStatus, Outputs};
use serde_json::Value;

use crate::args::Reading;
use crate::console::unwritable;
use crate::files;
use crate::machine_tables;
use crate::program::{Arrives, Arriving, Program};

/// The folder of a job that has not begun.
#[derive(Debug)]
pub struct Claimed {
    jobs: Jobs,
    folder: JobFolder,
    held: Held,
    when: Stamp,
}

impl Claimed {
    /// Makes a folder for a job of this program, and holds it.
    ///
    /// # Errors
    /// `E2201`, `E2105`: there is no folder for jobs, or it cannot be written.
    pub fn new(journal: Option<&Path>, program: &str) -> Result<Self, Refusal> {
        let (jobs, when) = (Jobs::named(journal)?, Stamp::now());
        let folder = jobs.create(program, when)?;
        let held = folder.hold()?;
        Ok(Self { jobs, folder, held, when })
    }

    /// Keeps a program that arrives in the folder, up to `quota` bytes.
    ///
    /// # Errors
    /// `E2105`
    pub fn spool(&self, from: Arriving, quota: u64) -> Result<(Arriving, Progress), Refusal> {
        let path = self.folder.stream();
        let (spooling, progress) =
            Spooling::create(&path, from).map_err(|error| unwritable(&path.display().to_string(), &error))?;
        Ok((Box::new(spooling.limited_to(quota)), progress))
    }

    /// Begins the journal.
    ///
    /// # Errors
    /// `E2105`, `E2207`: it cannot be written.
    pub fn begin(self, care: Care, job: Job, spool: Option<Progress>) -> Result<Kept, Refusal> {
        let Self { jobs, folder, held, when } = self;
        let job = Job { id: folder.id().into(), when, ..job };
        let logbook = Logbook::begin(folder.new_journal()?, care, job, spool)?;
        Ok(Kept { jobs, folder, _held: held, logbook, known: None, overrides: Vec::new() })
    }
}

/// A job whose journal is being written.
#[derive(Debug)]
pub struct Kept {
    jobs: Jobs,
    folder: JobFolder,
    _held: Held,
    logbook: Logbook,
    /// Place of the last mark that the journal has already.
    known: Option<u32>,
    /// The overrides that it has already.
    overrides: Vec<Override>,
}

impl Kept {
    /// A job that may be taken up again; its journal is as it was until [`Kept::take_up`].
    #[must_use]
    pub fn waiting(jobs: Jobs, folder: JobFolder, held: Held, care: Care, record: &JobRecord) -> Self {
        let logbook = Logbook::waiting(care, record.durable());
        let (known, overrides) = (record.last_mark.map(|mark| mark.place), record.overrides());
        Self { jobs, folder, _held: held, logbook, known, overrides }
    }

    /// Goes on with the journal.
    ///
    /// # Errors
    /// `E2105`, `E2207`: it cannot be written.
    pub fn take_up(&mut self, record: &JobRecord, resumed: Resumed, spool: Option<Progress>) -> Result<(), Refusal> {
        self.logbook.take_up(self.folder.old_journal()?, record.tail, resumed, spool)
    }

    /// The job's name.
    #[must_use]
    pub fn id(&self) -> &str {
        self.folder.id()
    }

    /// Who keeps the index.
    #[must_use]
    pub fn keeping(&self) -> Keeping {
        let notes = self.logbook.notes(self.known, &self.overrides);
        Keeping { index: Box::new(notes), durable: self.logbook.durable() }
    }

    /// Who keeps events and positions.
    #[must_use]
    pub fn keeper<const A: usize>(&self, machine: &Machine) -> Keeper<A> {
        Keeper::new(&self.logbook, machine.axes.len(), machine.period_us).naming(ChannelNames::of_machine(machine))
    }

    /// Keeps how the job ended; its keeper is gone. What there is to say of it comes back, a line each; what cannot be kept changes nothing
    /// of what has been done.
    pub fn end(self, outcome: &Outcome, report: &Value) -> Vec<String> {
        let mut said = Vec::new();
        let ending = match outcome {
            Outcome::Completed => Ending::Completed,
            Outcome::Stopped | Outcome::Refused(_) => Ending::Stopped,
            Outcome::Alarm(..) => Ending::Alarm,
        };
        let exit_code = report["exit_code"].as_u64().map_or(outcome.exit_code(), |code| code as u8);
        let end = End { when: Stamp::now(), outcome: ending, exit_code, report: report.clone() };
        if let Err(refusal) = self.logbook.end(end) {
            said.push(refusal.to_string());
        }
        let path = self.folder.report();
        if let Err(error) = state_file::replace(&path, format!("{report:#}\n").as_bytes(), Access::Private) {
            said.push(format!("note: {} cannot be written: {error}", path.display()));
        }
        if let Outcome::Refused(_) = outcome
            && self.folder.stream().exists()
        {
            said.push(format!(
                "the breakpoint is kept: `retrace resume {} --program FILE` continues with the whole program",
                self.folder.id()
            ));
        }
        if matches!(outcome.exit_code(), 3 | 4) {
            said.push(format!("the breakpoint is kept: `retrace resume {}` takes the job up there", self.folder.id()));
        }
        self.jobs.prune();
        said
    }
}

/// What a job is told to be, when it begins.
#[derive(Debug)]
pub struct Beginning<'a> {
    /// The program.
    pub program: &'a Program,
    /// What it is read with.
    pub reading: &'a Reading,
    /// The line to begin at.
    pub start_line: Option<u32>,
    /// The machine.
    pub machine: &'a Machine,
    /// Its file, and what was in it.
    pub machine_file: (Option<&'a Path>, String),
    /// The card.
    pub card: entry::Card,
}

impl Beginning<'_> {
    /// The first entry of its journal, for a card of this status.
    ///
    /// # Errors
    /// None in practice, see [`retrace_controller::fingerprint::of_planning`].
    pub fn job<const A: usize>(self, status: &CardStatus<A>) -> Result<Job, Refusal> {
        let (path, text) = self.machine_file;
        let name = self.program.name();
        let source = match self.program.arrives() {
            None => Source::File(files::absolute(&self.reading.program)),
            Some(Arrives::Socket(address)) => Source::Socket(address.clone()),
            Some(Arrives::Serial(address)) => Source::Serial(address.clone()),
            Some(Arrives::Device(path)) => Source::Device(files::absolute(path)),
            Some(Arrives::StandardInput | Arrives::File(_)) => Source::StandardInput,
        };
        let axes = self.machine.axes.len().min(A);
        Ok(Job {
            format: FORMAT,
            id: String::new(),
            when: Stamp::now(),
            retrace_version: env!("CARGO_PKG_VERSION").into(),
            planner: retrace_controller::fingerprint::of_planning()?,
            program: name.into(),
            source,
            lines: self.program.lines(),
            files: self.program.files_read(),
            machine: MachineFile { path: path.map(files::absolute), hash: Hash::of(text.as_bytes()), text },
            arguments: arguments(self.reading, self.start_line),
            tables: Some(machine_tables::latched(&self.program.setup().start_tables())),
            card: self.card,
            period_us: self.machine.period_us,
            origin: status.place.record,
            counts: status.counts[..axes].to_vec(),
            outputs: written(&status.outputs),
            executed: status.executed,
        })
    }
}

fn arguments(reading: &Reading, start_line: Option<u32>) -> Arguments {
    let absolute = |path: &Option<std::path::PathBuf>| path.as_deref().map(files::absolute);
    Arguments {
        block_delete: reading.block_delete,
        start_line,
        subs: reading.subs.iter().map(|folder| files::absolute(folder)).collect(),
        cycles: absolute(&reading.cycle_folders.cycles),
        tools: absolute(&reading.tools),
        params: absolute(&reading.params),
        ini: absolute(&reading.ini),
        machine_tables: reading.machine_tables.clone(),
    }
}

/// A card at the end of a line, as the journal names it.
#[must_use]
pub fn wired(address: &str, identity: &CardIdentity) -> entry::Card {
    let name = String::from_utf8_lossy(&identity.name).trim_end_matches('\0').to_owned();
    entry::Card::Wired(WiredCard { address: address.into(), name, serial: identity.serial, boot: identity.boot })
}

/// Outputs that are not 0.
fn written(outputs: &Outputs) -> Vec<(u8, i32)> {
    outputs.iter().enumerate().filter(|(_, value)| **value != 0).map(|(n, &value)| (n as u8, value)).collect()
}
