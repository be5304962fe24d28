//! `retrace run`: runs a program.
//!
//! Invariant: nothing moves before machine file, script and program have been read and checked, and the job's journal
//! exists.

use retrace_config::{MachineConfig, NumberedError};
use retrace_controller::{AnyCard, JobStart, ScriptInstruction};
use retrace_core::RecordIndex;
use retrace_hal_sim::{Clock, SimCard};
use retrace_journal::JobCard;
use retrace_link::{MotionCard, PathStart};

use crate::args::{self, OnOff};
use crate::command_failure::CommandFailure;
use crate::files;
use crate::homing_notes::Homing;
use crate::job_runner::{JobRunner, OutputOptions, prepare_real_time};
use crate::job_spec::begin_journal;
use crate::journaled_job::JournaledJob;
use crate::linked_card;
use crate::machine_tables::{self, TableFiles};
use crate::operate;
use crate::probing_card::ProbingCard;
use crate::program::Program;
use crate::program_stream::ProgramStream;
use crate::saved_materials;
use crate::sim_wiring::{parsed_source_faults, simulated, traced};
use crate::simulated_work::parsed_work;

/// Runs the command. Returns its exit code.
///
/// # Errors
/// Whatever prevents the job from starting.
pub fn run(mut args: args::Run) -> Result<u8, CommandFailure> {
    let (params, tools) = (args.reading.params.as_deref(), args.reading.tools.as_deref());
    args.reading.machine_tables = machine_tables::of_machine(&args.port.card, args.machine_file.path(), params, tools);
    let args = &args;
    let at_screen = operate::Screens::of(args)?.any() && !args.save_materials;
    let mut machine = args.planning.apply_to(files::machine(args.machine_file.path())?);
    machine.inhibits_outputs = args.dry_run;
    run_on(args, machine, files::machine_text(args.machine_file.path())?, at_screen)
}

/// Runs the program on this machine; `text` is the text of the machine file.
///
/// # Errors
/// See [`run`].
pub fn run_on(args: &args::Run, machine: MachineConfig, text: String, at_screen: bool) -> Result<u8, CommandFailure> {
    let script = files::script(args.operation.operator.as_deref())?;
    let with = RunContext { args, text, script, at_screen };
    match machine.axes.len() {
        0..=4 => with.on_card::<4>(machine),
        _ => with.on_card::<9>(machine),
    }
}

/// Clock of the simulated card.
pub fn clock(machine: &MachineConfig, realtime: bool) -> Clock {
    if realtime { Clock::wall(machine.period_us) } else { Clock::Virtual }
}

/// Prints how often the computer was late in wall time, if it was.
fn report_late_periods<const A: usize>(card: &SimCard<A>) {
    let (late, all) = (card.late_periods(), card.status().period);
    if late > 0 {
        eprintln!("note: the computer was late in {late} of {all} control periods; the simulated card caught up");
    }
}

/// Inputs of a job.
struct RunContext<'a> {
    args: &'a args::Run,
    /// Text of the machine file.
    text: String,
    script: Vec<ScriptInstruction>,
    at_screen: bool,
}

impl RunContext<'_> {
    /// Connects the card and runs the job on it.
    fn on_card<const A: usize>(self, machine: MachineConfig) -> Result<u8, CommandFailure> {
        let args = self.args;
        if args.port.is_simulated() {
            let faults = parsed_source_faults(args.source.source_faults.as_deref())?;
            let work = parsed_work(args.work.work.as_deref(), &machine)?;
            let program = self.open::<A>(&machine)?;
            let card =
                simulated::<A>(&machine, (&faults, work), clock(&machine, args.operation.realtime || self.at_screen))?;
            if self.at_screen {
                let mut card = traced(card, &machine, args.vcd.as_deref())?;
                let (work, homing) = ((self.script, (self.text, JobCard::Sim)), Homing::simulated());
                let code =
                    operate::operate(args, &machine, program, work, &mut AnyCard::new(&mut card), &homing, None)?;
                report_late_periods(&card);
                return Ok(code);
            }
            let mut card = traced(card, &machine, args.vcd.as_deref())?;
            let (journal, input) = begin_journal(args, &program, &machine, (&self.text, JobCard::Sim), card.status())?;
            let job = self.job_runner(&machine, &program, journal, input);
            let code = job.run(&mut AnyCard::new(&mut card), Box::new(|_, _| Ok(())))?;
            if args.operation.realtime {
                report_late_periods(&card);
            }
            return saved(args, &program, &machine, code);
        }
        if args.vcd.is_some() {
            let what = "--vcd: only the simulated card in this process can write a trace of its pins";
            return Err(NumberedError::new(
                "E2152",
                what,
                "`retrace card serve --vcd FILE` writes the trace of a served card",
            )
            .into());
        }
        // Everything that can be refused without the card is checked before the card is contacted.
        self.open::<A>(&machine)?;
        let mut card = linked_card::find::<A>(&args.port.card)?;
        card.wait_at_rest(linked_card::nonce()).map_err(|fault| linked_card::card_error(&args.port.card, &fault))?;
        let Some(greeting) = card.greeting().copied() else { return Ok(3) };
        linked_card::check_fit(&args.port.card, &greeting.identity, &machine)?;
        let (counts, named) = (greeting.counts, crate::journaled_job::linked_card(&args.port.card, &greeting.identity));
        let homing = Homing::of(&args.port.card, &greeting.identity);
        if !self.at_screen {
            homing.check(&machine)?;
        }
        let machine = machine.standing_at(&counts);
        let program = self.open::<A>(&machine)?;
        let settings = machine.card_settings(PathStart::at(RecordIndex::new(0)));
        if self.at_screen {
            card.open(settings).map_err(|fault| linked_card::card_error(&args.port.card, &fault))?;
            let mut card = ProbingCard::new(card, settings, &machine);
            let (homing, work) = (homing.at_screen(), (self.script, (self.text, named)));
            let code = operate::operate(args, &machine, program, work, &mut AnyCard::new(&mut card), &homing, None)?;
            let _ = card.card().close();
            return Ok(code);
        }
        let status = linked_card::read_status(&mut card, &args.port.card, settings)?;
        let (journal, input) = begin_journal(args, &program, &machine, (&self.text, named), &status)?;
        // From here on the card's watchdog expects messages from the host.
        prepare_real_time();
        card.open(settings).map_err(|fault| linked_card::card_error(&args.port.card, &fault))?;
        let mut card = ProbingCard::new(card, settings, &machine);
        let job = self.job_runner(&machine, &program, journal, input);
        let code = job.run(&mut AnyCard::new(&mut card), Box::new(|_, _| Ok(())))?;
        // The card is at rest, or has an alarm that says more than an error here would.
        let _ = card.card().close();
        saved(args, &program, &machine, code)
    }

    /// Opens the program and checks it completely. At the screen the check runs there, where its errors can be
    /// corrected.
    fn open<const A: usize>(&self, machine: &MachineConfig) -> Result<Program, CommandFailure> {
        let program = Program::open(&self.args.reading, machine)?;
        if !self.at_screen {
            program.check(machine)?;
        }
        if self.args.save_materials {
            saved_materials::check(&program, machine)?;
        }
        if let (Some(line), Some(lines)) = (self.args.start_line, program.lines())
            && u64::from(line) > lines
        {
            let what = format!("--start-line {line}: {} has {lines} lines", program.name());
            return Err(NumberedError::new("E2151", what, "give a line of the program").into());
        }
        program.require_contour(machine, self.args.contour)?;
        Ok(program)
    }

    fn job_runner<'m>(
        self,
        machine: &'m MachineConfig,
        program: &'m Program,
        journal: Option<JournaledJob>,
        input: Option<ProgramStream>,
    ) -> JobRunner<'m>
    where
        Self: 'm,
    {
        let args = self.args;
        let options = OutputOptions {
            json: args.format.json,
            records: args.operation.records.as_deref(),
            script: self.script,
            operator: args.operation.operator.is_some(),
            wall_time: args.operation.realtime || !args.port.is_simulated(),
            optional_stop: args.operation.optional_stop.map(OnOff::is_on),
            real_time: !args.port.is_simulated(),
            tables: TableFiles::of(&args.reading),
        };
        let start = args.start_point().map_or(JobStart::First, JobStart::Within);
        JobRunner { options, machine, program, input, start, journal, at_screen: None }
    }
}

/// Saves the materials of a program that has completed, if that was asked for. Returns the exit code.
fn saved(args: &args::Run, program: &Program, machine: &MachineConfig, code: u8) -> Result<u8, CommandFailure> {
    if args.save_materials && code == 0 {
        saved_materials::save(program, machine)?;
    }
    Ok(code)
}
