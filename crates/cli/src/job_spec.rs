//! A job that is started at a screen, and the journal that a job begins.
//!
//! Invariant: the journal of a job exists before the job moves anything.

use retrace_config::MachineConfig;
use retrace_controller::{AnyCard, JobStart, ScriptInstruction};
use retrace_journal::{Durability, JobCard};
use retrace_link::CardStatus;

use crate::args;
use crate::command_failure::CommandFailure;
use crate::job_runner::{JobRunner, OutputOptions, TuiOptions};
use crate::journaled_job::{JobHeaderBuilder, JournaledJob, ReservedJobFolder};
use crate::machine_tables::TableFiles;
use crate::program::Program;
use crate::program_stream::ProgramStream;

/// Text of the machine file, and the card, for the job's journal.
pub type MachineAndCard = (String, JobCard);

/// Job that is started at a screen, on a card that is open already.
pub struct JobSpec<'a> {
    args: &'a args::Run,
    machine: &'a MachineConfig,
    script: Vec<ScriptInstruction>,
    program: Program,
    at: &'a MachineAndCard,
}

impl<'a> JobSpec<'a> {
    /// Job of a program that was opened and checked for this machine.
    pub fn of(
        args: &'a args::Run,
        machine: &'a MachineConfig,
        script: Vec<ScriptInstruction>,
        program: Program,
        at: &'a MachineAndCard,
    ) -> Self {
        Self { args, machine, script, program, at }
    }

    /// Creates the job's journal, for a card with this status. Returns it with the source of a streamed program. It
    /// takes as long as the disk takes.
    ///
    /// # Errors
    /// The journal cannot be written, or the program cannot be read.
    pub fn keep<const A: usize>(
        &self,
        status: &CardStatus<A>,
    ) -> Result<(Option<JournaledJob>, Option<ProgramStream>), CommandFailure> {
        let (text, named) = self.at;
        begin_journal(self.args, &self.program, self.machine, (text, named.clone()), status)
    }

    /// Runs the job on a card. Returns its exit code; `at_screen` is the operator's screen.
    ///
    /// # Errors
    /// Whatever prevents it from starting; a file that cannot be written at its end.
    pub fn run<const A: usize>(
        self,
        card: &mut AnyCard<'_, A>,
        (journal, input): (Option<JournaledJob>, Option<ProgramStream>),
        at_screen: Option<TuiOptions<'_>>,
    ) -> Result<u8, CommandFailure> {
        let Self { args, machine, script, program, .. } = self;
        let options = OutputOptions {
            json: args.format.json,
            records: args.operation.records.as_deref(),
            script,
            operator: args.operation.operator.is_some(),
            wall_time: true,
            // The screen's script sets it.
            optional_stop: None,
            real_time: !args.port.is_simulated(),
            tables: TableFiles::of(&args.reading),
        };
        let start = args.start_point().map_or(JobStart::First, JobStart::Within);
        let runner = JobRunner { options, machine, program: &program, input, start, journal, at_screen };
        runner.run(card, Box::new(|_, _| Ok(())))
    }
}

/// Creates the job's journal, for a card with this status. Returns it with the source of a streamed program.
pub fn begin_journal<const A: usize>(
    args: &args::Run,
    program: &Program,
    machine: &MachineConfig,
    (text, card): (&str, JobCard),
    status: &CardStatus<A>,
) -> Result<(Option<JournaledJob>, Option<ProgramStream>), CommandFailure> {
    let input = program.open_stream()?;
    // A dry run cannot be resumed: its outputs were inhibited.
    if args.no_journal || machine.inhibits_outputs {
        return Ok((None, input));
    }
    let claimed = ReservedJobFolder::new(args.jobs.path(), program.name())?;
    #[cfg(feature = "shop")]
    if let Some(recorder) = &args.shop.recorder {
        recorder.record_started(program.name(), claimed.store(), claimed.id())?;
    }
    let (input, progress) = input.map(|input| claimed.spool(input, machine.stream_quota_bytes)).transpose()?.unzip();
    let care = if card == JobCard::Sim { Durability::Written } else { Durability::Synced };
    let machine_file = (args.machine_file.path(), text.to_owned());
    let (reading, start) = (&args.reading, args.start_point());
    let job = JobHeaderBuilder { program, reading, planning: args.planning, start, machine, machine_file, card }
        .job(status)?;
    Ok((Some(claimed.begin(care, job, progress)?), input))
}
