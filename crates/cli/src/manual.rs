//! `retrace home | jog | mdi`: manual operation from the shell.
//!
//! Invariant: nothing moves before machine file, tables and block have been read and checked; a parameter file is
//! written only after a block was executed.

use retrace_config::{MachineConfig, NumberedError};
use retrace_controller::{
    AnyCard, CommandSources, ManualTask, ManualTaskDone, ManualTaskError, ModalContext, Observer, RunMode,
    ScriptPlayer, Telemetry, interpreter_setup, perform_manual_task,
};
use retrace_core::RecordIndex;
use retrace_hal_sim::{Clock, SourceFaults};
use retrace_link::{MotionCard, PathStart};
use serde_json::{Map, Value, json};

use crate::command_failure::CommandFailure;
use crate::console::{Console, ConsoleOptions};
use crate::homing_notes::Homing;
use crate::machine_tables::{self, TableFiles};
use crate::probing_card::ProbingCard;
use crate::sim_wiring::simulated;
use crate::stop_signals::{StopPolicy, StopSignals};
use crate::{args, files, linked_card};

/// `retrace home`. Returns its exit code.
///
/// # Errors
/// Whatever prevents the task.
pub fn home(args: &args::Home) -> Result<u8, CommandFailure> {
    let machine = files::machine(args.manual.machine_file.path())?;
    let mut modal_context = ModalContext::new(interpreter_setup(&machine));
    on_machine(&args.manual, &machine, &ManualTask::Home(args.axis), &mut modal_context)
}

/// `retrace jog`. Returns its exit code.
///
/// # Errors
/// Whatever prevents the task.
pub fn jog(args: &args::Jog) -> Result<u8, CommandFailure> {
    let machine = files::machine(args.manual.machine_file.path())?;
    if !args.mm.is_finite() {
        return Err(NumberedError::new(
            "E2161",
            format!("{} is not a length", args.mm),
            "give mm (degrees), such as -12.5",
        )
        .into());
    }
    let mut modal_context = ModalContext::new(interpreter_setup(&machine));
    on_machine(&args.manual, &machine, &ManualTask::Jog { axis: args.axis, mm: args.mm }, &mut modal_context)
}

/// `retrace mdi`, and `retrace probe` with the call of a cycle as its block. Returns its exit code.
///
/// # Errors
/// Whatever prevents the task.
pub fn mdi(block: &str, args: &args::MdiOptions) -> Result<u8, CommandFailure> {
    let machine = files::machine(args.manual.machine_file.path())?;
    let of = &args.manual;
    let (params, tools) = (args.params.as_deref(), args.tools.as_deref());
    let own = machine_tables::of_machine(&of.port.card, of.machine_file.path(), params, tools);
    let files = TableFiles::choose(params, tools, own.as_ref());
    let began = files.read()?;
    let mut modal_context = ModalContext::new(interpreter_setup(&machine).with_start_tables(began.clone()));
    if args.dry_run {
        modal_context.block(&machine, block).map_err(print_diagnostics)?;
        say!("{block}: no errors; nothing was moved");
        return Ok(0);
    }
    let code = on_machine(&args.manual, &machine, &ManualTask::Mdi(block.to_owned()), &mut modal_context)?;
    if code == 0 {
        files.write_parameters(&began.parameters, modal_context.modal_snapshot().parameters())?;
        files.write_tools(&began.tools, modal_context.modal_snapshot().tools())?;
    }
    Ok(code)
}

/// Prints the diagnostics of a block.
fn print_diagnostics(lines: Vec<String>) -> CommandFailure {
    lines.iter().for_each(|line| eprintln!("{line}"));
    CommandFailure::Program
}

fn on_machine(
    args: &args::ManualOptions,
    machine: &MachineConfig,
    task: &ManualTask,
    modal_context: &mut ModalContext,
) -> Result<u8, CommandFailure> {
    match machine.axes.len() {
        0..=4 => on_card::<4>(args, machine, task, modal_context),
        _ => on_card::<9>(args, machine, task, modal_context),
    }
}

fn on_card<const A: usize>(
    args: &args::ManualOptions,
    machine: &MachineConfig,
    task: &ManualTask,
    modal_context: &mut ModalContext,
) -> Result<u8, CommandFailure> {
    if args.port.is_simulated() {
        let mut card = simulated::<A>(machine, (&SourceFaults::default(), None), Clock::Virtual)?;
        eprintln!(
            "note: the simulated card in this process does not keep its position; one served by `retrace card serve \
                --pty` does"
        );
        return perform_on(args, machine, task, modal_context, &mut AnyCard::new(&mut card), &Homing::simulated());
    }
    let mut card = linked_card::find::<A>(&args.port.card)?;
    card.wait_at_rest(linked_card::nonce()).map_err(|fault| linked_card::card_error(&args.port.card, &fault))?;
    let Some(greeting) = card.greeting().copied() else { return Ok(3) };
    linked_card::check_fit(&args.port.card, &greeting.identity, machine)?;
    let homing = Homing::of(&args.port.card, &greeting.identity);
    let stands = machine.clone().standing_at(&greeting.counts);
    if let ManualTask::Mdi(block) = task
        && modal_context.block(&stands, block).is_ok_and(|block| block.moves())
    {
        homing.check(machine)?;
    }
    let settings = machine.card_settings(PathStart::at(RecordIndex::new(0)));
    card.open(settings).map_err(|fault| linked_card::card_error(&args.port.card, &fault))?;
    let mut card = ProbingCard::new(card, settings, machine);
    let code = perform_on(args, machine, task, modal_context, &mut AnyCard::new(&mut card), &homing)?;
    // The card is at rest, or has an alarm that says more than an error here would.
    let _ = card.card().close();
    Ok(code)
}

/// Executes the task on a card, and prints the position.
fn perform_on<const A: usize>(
    args: &args::ManualOptions,
    machine: &MachineConfig,
    task: &ManualTask,
    modal_context: &mut ModalContext,
    card: &mut AnyCard<'_, A>,
    homing: &Homing,
) -> Result<u8, CommandFailure> {
    let show = if args.format.json { ConsoleOptions::Json } else { ConsoleOptions::Plain };
    let mut console = Console::<A>::new(show, machine, None, None)?;
    let (signals, stops) = StopSignals::watch(StopPolicy::Manual).unzip();
    let operators =
        CommandSources::from_script(ScriptPlayer::new(Vec::new(), machine.period_us)).with_stop_receiver(stops);
    if let Some(signals) = &signals {
        signals.listen();
    }
    let run_mode = RunMode { wall_time: !args.port.is_simulated(), operator: false, real_time: false };
    let mut shown_work = Stoppable { console: &mut console, signals: signals.as_ref() };
    let carry_out = || perform_manual_task(task, machine, modal_context, card, (operators, run_mode), &mut shown_work);
    let done = homing.perform_and_record(task, machine, carry_out);
    drop(signals);
    if let (.., Some(lost)) = console.finish() {
        return Err(lost.into());
    }
    let code = match done {
        Ok(ManualTaskDone::Completed { .. }) => 0,
        Ok(ManualTaskDone::Stopped) => 4,
        Err(ManualTaskError::Numbered(refusal)) => return Err(refusal.into()),
        Err(ManualTaskError::Block(lines)) => return Err(print_diagnostics(lines)),
        Err(ManualTaskError::Card(error)) => {
            let (number, cause, remedy) = error.parts();
            return Err(CommandFailure::Card(NumberedError::new(number, cause, remedy)));
        }
    };
    print_position(machine, &card.status().counts, code, args.format.json);
    Ok(code)
}

/// Observer of a manual task that signals can stop.
struct Stoppable<'c, 'm, const A: usize> {
    console: &'c mut Console<'m, A>,
    signals: Option<&'c StopSignals>,
}

impl<const A: usize> Observer<A> for Stoppable<'_, '_, A> {
    fn on_telemetry(&mut self, telemetry: &Telemetry<A>) {
        self.console.on_telemetry(telemetry);
        if let Some(signals) = self.signals {
            signals.observe(telemetry);
        }
    }
}

/// Prints the position of the machine.
fn print_position(machine: &MachineConfig, counts: &[i64], code: u8, json: bool) {
    let axes = || machine.axes.iter().zip(counts);
    let each = |value: fn(f64, i64) -> Value| {
        let all = axes().map(|(axis, &count)| (axis.name.to_string(), value(axis.pulses_per_mm, count)));
        Value::Object(all.collect::<Map<_, _>>())
    };
    if json {
        crate::out::line(json!({
            "event": "report",
            "outcome": if code == 0 { "completed" } else { "stopped" },
            "exit_code": code,
            "position_counts": each(|_, count| json!(count)),
            "position_mm": each(|pulses, count| json!(count as f64 / pulses)),
        }));
        return;
    }
    let telemetry = axes().map(|(axis, &count)| format!("{} {:.3}", axis.name.to_ascii_uppercase(), axis.mm_of(count)));
    say!("position {} (machine, mm)", telemetry.collect::<Vec<_>>().join("  "));
}
