//! Preview of a program before it runs: its text, its path, and its duration from the plan itself.
//!
//! Invariant: slow work runs in a thread of its own; the screen shows "calculating" until it is done.

use retrace_core::RecordIndex;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use retrace_config::MachineConfig;
use retrace_controller::{BlockDecoder, DecodedBlock, PlannedPath, analyse_path};
use retrace_gcode::{CanonStep, Setup};
use retrace_tui::{
    PlacedPath, Planned, Preview, ProgramCheck, ProgramFacts, ScreenModel, ScreenStage, ToolFacts, diagnostic_lines,
    lock_model,
};

use crate::decoder::Decoder;
use crate::program::Program;

/// Facts that are known at once.
pub(super) fn facts(machine: &MachineConfig, program: &Program) -> ProgramFacts {
    let tools = program.tool_table().map_or_else(Vec::new, |table| {
        let tool = |tool: &retrace_gcode::Tool| ToolFacts {
            number: tool.number,
            diameter_mm: tool.diameter,
            length_mm: tool.offset.0[2],
            name: table.name(tool.number).unwrap_or_default().to_owned(),
        };
        table.tools().map(tool).collect()
    });
    let tool_names = program.tool_table().map_or_else(BTreeMap::new, |table| {
        let name =
            |tool: &retrace_gcode::Tool| Some((i32::try_from(tool.number).ok()?, table.name(tool.number)?.to_owned()));
        table.tools().filter_map(name).filter(|(_, name)| !name.is_empty()).collect()
    });
    let check = if program.is_loaded() { ProgramCheck::Checking } else { ProgramCheck::NotLoaded };
    let layer_axis = machine.tool_layer().map(|layer| layer.index);
    ProgramFacts {
        tools,
        tool_names,
        check,
        layer_axis,
        contours: program.planned_contours(),
        ..ProgramFacts::of(machine, &crate::files::last_name(program.name()), &program.text())
    }
}

/// Shows another program for the machine's position: its text now; its check, path and duration when they are known.
pub(super) fn show_program<const A: usize>(
    model: &Arc<Mutex<ScreenModel>>,
    machine: MachineConfig,
    program: &Arc<Program>,
) {
    let facts = Arc::new(facts(&machine, program));
    {
        let mut model = lock_model(model);
        (model.facts, model.line, model.reached_line) = (facts, 0, 0);
        model.changes += 1;
    }
    compute_preview::<A>(model, PreviewJob { machine, program: Arc::clone(program), setup: None, is_checked: false });
}

/// Shows that a job whose path starts at this record is about to be resumed.
pub(super) fn show_resuming(model: &Mutex<ScreenModel>, origin: RecordIndex) {
    let facts = ProgramFacts { first_place: origin, ..(*lock_model(model).facts).clone() };
    let mut model = lock_model(model);
    (model.facts, model.stage) = (Arc::new(facts), ScreenStage::Resuming);
    model.changes += 1;
}

/// Checks the program again with this setup and redraws its path, after the position or the offsets changed.
pub(super) fn check_again<const A: usize>(
    model: &Arc<Mutex<ScreenModel>>,
    machine: MachineConfig,
    program: &Arc<Program>,
    setup: Setup,
) {
    compute_preview::<A>(
        model,
        PreviewJob { machine, program: Arc::clone(program), setup: Some(setup), is_checked: false },
    );
}

/// Calculates the path as it will lie with this setup, which the edge of the sheet through these points gives.
pub(super) fn place_on_sheet<const A: usize>(
    model: &Arc<Mutex<ScreenModel>>,
    machine: MachineConfig,
    program: &Arc<Program>,
    (now, then): (Setup, Setup),
    points: [[f64; 2]; 2],
) {
    let Some(placement) = retrace_tui::sheet_placement(&lock_model(model)) else { return };
    if !program.is_loaded() || program.lines().is_none() {
        return;
    }
    let (model, program) = (Arc::clone(model), Arc::clone(program));
    let number = LATEST_CALCULATION.load(Ordering::Relaxed);
    thread::spawn(move || {
        lower_priority();
        let _alone = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
        let (Ok(now), Ok(then)) = (program.reopened(now), program.reopened(then)) else { return };
        let [mut now, mut then] = [now, then].map(|program| CancellableDecoder { decoder: program.decoder(), number });
        let placed = PlacedPath::of(&machine, (&mut now, &mut then), &placement, points);
        publish(&model, number, |facts| ProgramFacts { placed: Some(Arc::new(placed)), ..facts });
    });
}

/// Shows no path: the records of a job that begins inside the program are not those of the whole program.
pub(super) fn hide_path(model: &Mutex<ScreenModel>) {
    let number = LATEST_CALCULATION.fetch_add(1, Ordering::Relaxed) + 1;
    publish(model, number, |facts| ProgramFacts { planned_path: None, ..facts });
}

/// Updates the facts after the program was opened and checked again, for a position that may have changed.
pub(super) fn update_facts<const A: usize>(
    model: &Arc<Mutex<ScreenModel>>,
    machine: &MachineConfig,
    program: &Program,
) {
    let (new, old) = (facts(machine, program), Arc::clone(&lock_model(model).facts));
    let is_same = new.program == old.program
        && new.start_position_mm == old.start_position_mm
        && old.first_place == RecordIndex::new(0);
    if is_same && old.check == ProgramCheck::Ready {
        return;
    }
    lock_model(model).facts = Arc::new(new);
    let (machine, program) = (machine.clone(), Arc::new(program.clone()));
    compute_preview::<A>(model, PreviewJob { machine, program, setup: None, is_checked: true });
}
/// Number of the current calculation; a later one ends the earlier ones.
static LATEST_CALCULATION: AtomicU64 = AtomicU64::new(0);
/// Only one calculation runs at a time, so that they do not queue up while an axis is jogged step by step.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// Calculation request.
struct PreviewJob {
    /// Machine at its current position.
    machine: MachineConfig,
    program: Arc<Program>,
    /// Setup to read the program with, where it differs from the one it was read with.
    setup: Option<Setup>,
    /// Whether the program has been checked and may run.
    is_checked: bool,
}

/// Calculates check, path and duration of a program in a thread, and shows them as they become known.
fn compute_preview<const A: usize>(model: &Arc<Mutex<ScreenModel>>, job: PreviewJob) {
    let number = LATEST_CALCULATION.fetch_add(1, Ordering::Relaxed) + 1;
    let program = &job.program;
    if !program.is_loaded() {
        return publish(model, number, |facts| ProgramFacts { check: ProgramCheck::NotLoaded, ..facts });
    }
    if program.lines().is_none() {
        let check = ProgramCheck::CheckedAsItRuns;
        return publish(model, number, |facts| ProgramFacts { planned: Planned::Unknown, check, ..facts });
    }
    let model = Arc::clone(model);
    thread::spawn(move || {
        lower_priority();
        let _alone = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
        if LATEST_CALCULATION.load(Ordering::Relaxed) == number {
            calculate_preview::<A>(&model, number, job);
        }
    });
}

/// Lets everything else run first: the machine, its screens, and what draws them.
fn lower_priority() {
    // On Linux this is the priority of the calling thread alone. Where it is not permitted, nothing is lost.
    #[cfg(target_os = "linux")]
    let _ = rustix::process::setpriority_process(None, 10);
}

fn calculate_preview<const A: usize>(model: &Mutex<ScreenModel>, number: u64, job: PreviewJob) {
    let PreviewJob { machine, program, setup, is_checked } = job;
    let refused = |why: String| {
        let findings = diagnostic_lines(&why);
        let check = ProgramCheck::Failed(findings.clone());
        let is_known = lock_model(model).facts.check == check;
        publish(model, number, |facts| ProgramFacts { check, ..facts });
        if !is_known {
            let mut model = lock_model(model);
            let time_s = model.period as f64 * model.facts.period_s;
            findings.into_iter().for_each(|finding| model.add_message(time_s, 0, finding));
        }
    };
    let stands_at_mm = machine.stands_at_mm.clone();
    let program = match setup.map(|setup| program.reopened(setup)) {
        None => program,
        Some(Ok(program)) => Arc::new(program),
        Some(Err(why)) => return refused(why.to_string()),
    };
    if !is_checked && let Err(why) = program.check_silently(&machine) {
        refused(why);
    } else {
        let contours = program.planned_contours();
        publish(model, number, |facts| ProgramFacts { check: ProgramCheck::Ready, contours, ..facts });
    }
    let cancellable = |decoder| CancellableDecoder { decoder, number };
    let preview = Preview::of(&machine, &mut cancellable(program.decoder()));
    publish(model, number, |facts| ProgramFacts { preview, start_position_mm: stands_at_mm, ..facts });
    let show_part = |part: PlannedPath| {
        // A path that is shown stays until all of the new one is known, unless it is a shorter part of it.
        publish(model, number, |facts| match &facts.planned_path {
            Some(shown) if shown.records() >= part.records() => facts,
            _ => ProgramFacts { planned_path: Some(Arc::new(part)), ..facts },
        });
    };
    let analysed = analyse_path::<A>(&machine, &mut cancellable(program.decoder()), show_part);
    let (planned, path) = analysed.map_or((Planned::Unknown, None), |(analysis, path)| {
        (Planned::Known(analysis.motion_periods as f64 * machine.period_s()), Some(Arc::new(path)))
    });
    publish(model, number, |facts| ProgramFacts { planned, planned_path: path, ..facts });
}

/// Publishes changed facts. They are copied outside the lock of the model.
fn publish(model: &Mutex<ScreenModel>, number: u64, change: impl FnOnce(ProgramFacts) -> ProgramFacts) {
    let old = Arc::clone(&lock_model(model).facts);
    let new = Arc::new(change((*old).clone()));
    let mut model = lock_model(model);
    if LATEST_CALCULATION.load(Ordering::Relaxed) == number {
        model.facts = new;
        model.changes += 1;
    }
}

/// Program decoder that ends once a later calculation was requested.
struct CancellableDecoder {
    decoder: Decoder,
    number: u64,
}

impl BlockDecoder for CancellableDecoder {
    fn next_block(&mut self, steps: &mut Vec<CanonStep>) -> DecodedBlock {
        if LATEST_CALCULATION.load(Ordering::Relaxed) == self.number {
            self.decoder.next_block(steps)
        } else {
            DecodedBlock::End
        }
    }
}
