//! `retrace resume --from-line`: a new job of the program of an earlier one; and the options that both are read with.
//!
//! Invariant: the new job has the options of the earlier one, except those that the command line gives.

use std::path::{Path, PathBuf};

use retrace_config::{NumberedError, machine_changes};
use retrace_journal::{FileHash, JobCard, JobHeader, JobRecord, ProgramSource};

use crate::args::{self, CardPort, CycleFolders, MachineFile, Planning, Reading};
use crate::command_failure::CommandFailure;
use crate::{files, run};

/// Options that the job's program is read with; a file may be elsewhere now.
pub fn reading(job: &JobHeader, program: Option<&Path>) -> Reading {
    let path = |path: &Option<String>| path.as_ref().map(PathBuf::from);
    let program = match (&job.source, program) {
        (ProgramSource::File(_), Some(elsewhere)) => elsewhere.to_owned(),
        (ProgramSource::File(file), None) => file.into(),
        (ProgramSource::StandardInput, _) => "-".into(),
        (ProgramSource::Socket(address), _) => format!("tcp://{address}").into(),
        (ProgramSource::Serial(address), _) => format!("serial:{address}").into(),
        (ProgramSource::Device(path), _) => path.into(),
    };
    let of = &job.arguments;
    Reading {
        program,
        block_delete: of.block_delete,
        subs: of.subs.iter().map(PathBuf::from).collect(),
        cycle_folders: CycleFolders { cycles: path(&of.cycles), compiled: None },
        tools: path(&of.tools),
        params: path(&of.params),
        ini: path(&of.ini),
        max_loop_blocks: args::MAX_CHECKED_LOOP_BLOCKS,
        machine_tables: of.machine_tables.clone(),
    }
}

/// Runs the same program as a new job, from a line.
///
/// # Errors
/// `E2218`, and whatever prevents that job from starting.
pub fn from_line(args: &args::Resume, record: &JobRecord, line: u32) -> Result<u8, CommandFailure> {
    let job = &record.job;
    if !record.lengths().is_empty() && !args.yes {
        let what = "a tool length was entered in a pause of this job; a start at a line uses the tool table instead"
            .to_owned();
        let remedy =
            "enter the tool length in the tool table if that tool is in use there, then repeat the command with --yes";
        return Err(NumberedError::new("E2218", what, remedy).into());
    }

    let run = args::Run { start_line: Some(line), contour: None, ..run_args(args, job) };
    let machine = run.planning.apply_to(files::machine(run.machine_file.path())?);
    if let Some(changes) = changed_machine(job) {
        eprintln!(
            "note: the machine file has changed since the job started; the new one is used\n{}",
            changes.join("\n")
        );
    }
    let text = files::machine_text(run.machine_file.path())?;
    run::run_on(&run, machine, text, args.is_at_screen())
}

/// Arguments of `retrace run` for the program of a job.
pub fn run_args(args: &args::Resume, job: &JobHeader) -> args::Run {
    let card = match (&args.card, &job.card) {
        (Some(named), _) => named.clone(),
        (None, JobCard::Sim) => "sim".into(),
        (None, JobCard::Wired(card)) => card.address.clone(),
    };
    let program = args.program.as_deref();
    let mut reading = reading(job, program);
    if let (Some(program), false) = (program, matches!(job.source, ProgramSource::File(_))) {
        reading.program = program.to_owned();
    }
    args::Run {
        page: args.page.clone(),
        vcd: None,
        source: args::SimulatedSource::default(),
        work: args::SimulatedWork::default(),
        planning: Planning::of_job(&job.arguments),
        dry_run: false,
        save_materials: false,
        reading,
        port: CardPort { card },
        machine_file: MachineFile { machine: job.machine.path.as_ref().map(PathBuf::from) },
        operation: args.operation.clone(),
        no_tui: !args.operation.tui,
        format: args.format,
        start_line: None,
        contour: None,
        jobs: args.jobs.clone(),
        no_journal: false,
        #[cfg(feature = "shop")]
        shop: args::ShopJobOptions::default(),
    }
}

/// Differences of the machine file from the job's copy, one per line; `None` where it is unchanged.
pub fn changed_machine(job: &JobHeader) -> Option<Vec<String>> {
    let path = job.machine.path.as_ref()?;
    match files::text(Path::new(path), "machine file") {
        Ok(text) if FileHash::of(text.as_bytes()) == job.machine.hash => None,
        Ok(text) => Some(machine_changes(&job.machine.text, &text)),
        Err(refusal) => Some(vec![refusal.cause]),
    }
}
