//! Job folder while the job runs: locked against other processes, with its journal being written.
//!
//! Invariant: nothing moves before the first entry of the job is stored. A job that was refused before that leaves only
//! an empty folder.

use retrace_core::RecordIndex;
use std::path::Path;

use retrace_config::{ChannelNames, MachineConfig, NumberedError, PierceMode};
use retrace_controller::{JournalRecorder, Outcome, StartPoint};
use retrace_journal::state_file::FileAccess;
use retrace_journal::{
    CommandArguments, Durability, EndEntry, FORMAT, FileHash, JobCard, JobEnding, JobFolder, JobHeader, JobLock,
    JobRecord, JobStore, JournalConfig, JournalWriter, MachineFileCopy, PlannedOverride, ProgramSource, ResumeEntry,
    SpoolProgress, SpoolWriter, Timestamp, WiredCard, state_file,
};
use retrace_link::{CardIdentity, CardStatus, Outputs};
use serde_json::Value;

use crate::args::{Planning, Reading};
use crate::files;
use crate::files::unwritable;
use crate::machine_tables;
use crate::program::Program;
use crate::program_stream::{ProgramStream, StreamSource};

/// Folder of a job that has not started.
#[derive(Debug)]
pub struct ReservedJobFolder {
    jobs: JobStore,
    folder: JobFolder,
    held: JobLock,
    when: Timestamp,
}

impl ReservedJobFolder {
    /// Creates and locks a folder for a job of this program.
    ///
    /// # Errors
    /// `E2201`, `E2105`: the jobs folder is missing or cannot be written.
    pub fn new(journal: Option<&Path>, program: &str) -> Result<Self, NumberedError> {
        let (jobs, when) = (JobStore::open_or_default(journal)?, Timestamp::now());
        let folder = jobs.create(program, when)?;
        let held = folder.lock()?;
        Ok(Self { jobs, folder, held, when })
    }

    /// Name of the job.
    #[cfg(feature = "shop")]
    #[must_use]
    pub fn id(&self) -> &str {
        self.folder.id()
    }

    /// The jobs that it belongs to.
    #[cfg(feature = "shop")]
    #[must_use]
    pub fn store(&self) -> &JobStore {
        &self.jobs
    }

    /// Stores a streamed program in the folder while it is read, up to `quota` bytes.
    ///
    /// # Errors
    /// `E2105`
    pub fn spool(&self, from: ProgramStream, quota: u64) -> Result<(ProgramStream, SpoolProgress), NumberedError> {
        let path = self.folder.stream();
        let (spooling, progress) =
            SpoolWriter::create(&path, from).map_err(|error| unwritable(&path.display().to_string(), &error))?;
        Ok((Box::new(spooling.with_quota(quota)), progress))
    }

    /// Starts the journal.
    ///
    /// # Errors
    /// `E2105`, `E2207`: it cannot be written.
    pub fn begin(
        self,
        care: Durability,
        job: JobHeader,
        spool: Option<SpoolProgress>,
    ) -> Result<JournaledJob, NumberedError> {
        let Self { jobs, folder, held, when } = self;
        let job = JobHeader { id: folder.id().into(), when, ..job };
        let writer = JournalWriter::begin(folder.create_journal()?, care, job, spool)?;
        Ok(JournaledJob { jobs, folder, _lock: held, writer, known: None, overrides: Vec::new() })
    }
}

/// Job whose journal is being written.
#[derive(Debug)]
pub struct JournaledJob {
    jobs: JobStore,
    folder: JobFolder,
    _lock: JobLock,
    writer: JournalWriter,
    /// Record of the last mark that the journal has already.
    known: Option<RecordIndex>,
    /// Override changes that the journal has already.
    overrides: Vec<PlannedOverride>,
}

impl JournaledJob {
    /// Job that may be resumed; its journal is unchanged until [`JournaledJob::resume_journal`].
    #[must_use]
    pub fn awaiting_resume(
        jobs: JobStore,
        folder: JobFolder,
        held: JobLock,
        care: Durability,
        record: &JobRecord,
    ) -> Self {
        let writer = JournalWriter::queueing(care, record.durable_place());
        let (known, overrides) = (record.last_mark.map(|mark| mark.place), record.overrides());
        Self { jobs, folder, _lock: held, writer, known, overrides }
    }

    /// Continues the journal.
    ///
    /// # Errors
    /// `E2105`, `E2207`: it cannot be written.
    pub fn resume_journal(
        &mut self,
        record: &JobRecord,
        resumed: ResumeEntry,
        spool: Option<SpoolProgress>,
    ) -> Result<(), NumberedError> {
        self.writer.resume(self.folder.open_journal()?, record.tail, resumed, spool)
    }

    /// Name of the job.
    #[must_use]
    pub fn id(&self) -> &str {
        self.folder.id()
    }

    /// Configuration of the index writer.
    #[must_use]
    pub fn journal_config(&self) -> JournalConfig {
        let notes = self.writer.index_writer(self.known, &self.overrides);
        JournalConfig { index: Box::new(notes), durable: self.writer.durable_place() }
    }

    /// Recorder of events and positions.
    #[must_use]
    pub fn recorder<const A: usize>(&self, machine: &MachineConfig) -> JournalRecorder<A> {
        JournalRecorder::new(&self.writer, machine.axes.len(), machine.period_us)
            .with_names(ChannelNames::of_machine(machine))
    }

    /// Writes the end of the job; its recorder has ended. Returns the lines to print. A write error changes nothing of
    /// the result.
    pub fn end(self, outcome: &Outcome, report: &Value) -> Vec<String> {
        let mut result = Vec::new();
        let ending = match outcome {
            Outcome::Completed => JobEnding::Completed,
            Outcome::Stopped | Outcome::BlockError(_) => JobEnding::Stopped,
            Outcome::Alarm(..) => JobEnding::Alarm,
        };
        let exit_code = report["exit_code"].as_u64().map_or(outcome.exit_code(), |code| code as u8);
        let end = EndEntry { when: Timestamp::now(), outcome: ending, exit_code, report: report.clone() };
        if let Err(refusal) = self.writer.end(end) {
            result.push(refusal.to_string());
        }
        let path = self.folder.report();
        if let Err(error) = state_file::replace(&path, format!("{report:#}\n").as_bytes(), FileAccess::Private) {
            result.push(format!("note: {} cannot be written: {error}", path.display()));
        }
        if let Outcome::BlockError(_) = outcome
            && self.folder.stream().exists()
        {
            result.push(format!(
                "breakpoint saved: `retrace resume {} --program FILE` continues with the whole program",
                self.folder.id()
            ));
        }
        if matches!(outcome.exit_code(), 3 | 4) {
            result.push(format!("breakpoint saved: `retrace resume {}` resumes the job there", self.folder.id()));
        }
        self.jobs.prune();
        result
    }
}

/// Data for the first journal entry of a job.
#[derive(Debug)]
pub struct JobHeaderBuilder<'a> {
    /// The program.
    pub program: &'a Program,
    /// Options that it is read with.
    pub reading: &'a Reading,
    /// How it is planned.
    pub planning: Planning,
    /// Line to start at.
    pub start: Option<StartPoint>,
    /// The machine.
    pub machine: &'a MachineConfig,
    /// Path and text of the machine file.
    pub machine_file: (Option<&'a Path>, String),
    /// Card.
    pub card: JobCard,
}

impl JobHeaderBuilder<'_> {
    /// First entry of the journal, for a card with this status.
    ///
    /// # Errors
    /// None in practice, see [`retrace_controller::planning_fingerprint`].
    pub fn job<const A: usize>(self, status: &CardStatus<A>) -> Result<JobHeader, NumberedError> {
        let (path, text) = self.machine_file;
        let name = self.program.name();
        let source = match self.program.stream_source() {
            None => ProgramSource::File(files::absolute(&self.reading.program)),
            Some(StreamSource::Socket(address)) => ProgramSource::Socket(address.clone()),
            Some(StreamSource::Serial(address)) => ProgramSource::Serial(address.clone()),
            Some(StreamSource::Device(path)) => ProgramSource::Device(files::absolute(path)),
            Some(StreamSource::StandardInput | StreamSource::File(_)) => ProgramSource::StandardInput,
        };
        let axes = self.machine.axes.len().min(A);
        Ok(JobHeader {
            format: FORMAT,
            id: String::new(),
            when: Timestamp::now(),
            retrace_version: env!("CARGO_PKG_VERSION").into(),
            planner: retrace_controller::planning_fingerprint(self.machine.plan_mode)?,
            program: name.into(),
            source,
            lines: self.program.lines(),
            files: self.program.files_read(),
            machine: MachineFileCopy { path: path.map(files::absolute), hash: FileHash::of(text.as_bytes()), text },
            arguments: arguments(self.reading, self.planning, self.start),
            tables: Some(machine_tables::latched(&self.program.setup().start_tables())),
            card: self.card,
            period_us: self.machine.period_us,
            origin: status.place.record,
            counts: status.counts[..axes].to_vec(),
            outputs: nonzero_outputs(&status.outputs),
            executed: status.executed,
        })
    }
}

/// Where in its program a job began, if not at the first block.
#[must_use]
pub fn start_point(arguments: &CommandArguments) -> Option<StartPoint> {
    arguments.start_line.map(StartPoint::Line).or(arguments.start_contour.map(StartPoint::Contour))
}

fn arguments(reading: &Reading, planning: Planning, start: Option<StartPoint>) -> CommandArguments {
    let (start_line, start_contour) = match start {
        None => (None, None),
        Some(StartPoint::Line(line)) => (Some(line), None),
        Some(StartPoint::Contour(number)) => (None, Some(number)),
    };
    let absolute = |path: &Option<std::path::PathBuf>| path.as_deref().map(files::absolute);
    CommandArguments {
        block_delete: reading.block_delete,
        start_line,
        start_contour,
        subs: reading.subs.iter().map(|folder| files::absolute(folder)).collect(),
        cycles: absolute(&reading.cycle_folders.cycles),
        tools: absolute(&reading.tools),
        params: absolute(&reading.params),
        ini: absolute(&reading.ini),
        plan: planning.plan,
        pierces: Some(planning.pierces).filter(|&mode| mode != PierceMode::Usual),
        machine_tables: reading.machine_tables.clone(),
    }
}

/// Linked card, as the journal names it.
#[must_use]
pub fn linked_card(address: &str, identity: &CardIdentity) -> JobCard {
    let name = String::from_utf8_lossy(&identity.name).trim_end_matches('\0').to_owned();
    JobCard::Wired(WiredCard { address: address.into(), name, serial: identity.serial, boot: identity.boot })
}

/// Outputs that are not 0, as (channel, value).
fn nonzero_outputs(outputs: &Outputs) -> Vec<(u8, i32)> {
    outputs.iter().enumerate().filter(|(_, value)| **value != 0).map(|(n, &value)| (n as u8, value)).collect()
}
