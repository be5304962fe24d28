//! What the screen is told of a program before it runs: its text, its path, and from the plan itself how long it takes.
//!
//! Invariant: whatever takes time is done in a thread of its own; the picture says "reckoning" until it is there.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use retrace_controller::job::{BlockDecoder, DecodedBlock};
use retrace_controller::machine::MachineConfig;
use retrace_controller::program_analysis;
use retrace_gcode::{CanonStep, Setup};

use crate::program::{Decoder, Program};
use crate::screen::diagnostic_text;
use crate::screen::model::{ScreenModel, ScreenStage};
use crate::screen::model_observer::locked;
use crate::screen::preview::Preview;
use crate::screen::program_facts::{Planned, ProgramCheck, ProgramFacts};

/// What is known at once.
pub(super) fn facts(machine: &MachineConfig, program: &Program) -> ProgramFacts {
    let tools = program.tool_table().map_or_else(Vec::new, |table| {
        let tool = |tool: &retrace_gcode::Tool| {
            let name = table.name(tool.number).unwrap_or_default();
            format!("T{:<4} D {:>8.3}  Z {:>9.3}  {name}", tool.number, tool.diameter, tool.offset.0[2])
        };
        table.tools().map(tool).collect()
    });
    let tool_names = program.tool_table().map_or_else(BTreeMap::new, |table| {
        let name =
            |tool: &retrace_gcode::Tool| Some((i32::try_from(tool.number).ok()?, table.name(tool.number)?.to_owned()));
        table.tools().filter_map(name).filter(|(_, name)| !name.is_empty()).collect()
    });
    let check = if program.is_loaded() { ProgramCheck::Checking } else { ProgramCheck::NotLoaded };
    ProgramFacts { tools, tool_names, check, ..ProgramFacts::of(machine, &file_name(program.name()), &program.text()) }
}

/// Shows another program on a machine that stands there: its text now, and its check, path and time when they are known.
pub(super) fn show_program<const A: usize>(
    model: &Arc<Mutex<ScreenModel>>,
    machine: MachineConfig,
    program: &Arc<Program>,
) {
    let facts = Arc::new(facts(&machine, program));
    {
        let mut model = locked(model);
        (model.facts, model.line, model.reached_line) = (facts, 0, 0);
        model.changes += 1;
    }
    compute_preview::<A>(
        model,
        PreviewThread { machine, program: Arc::clone(program), setup: None, is_checked: false },
    );
}

/// A job is about to be resumed, whose path began at this place.
pub(super) fn show_resuming(model: &Mutex<ScreenModel>, origin: u32) {
    let facts = ProgramFacts { first_place: origin, ..(*locked(model).facts).clone() };
    let mut model = locked(model);
    (model.facts, model.stage) = (Arc::new(facts), ScreenStage::Resuming);
    model.changes += 1;
}

/// The machine stands elsewhere now, or its offsets are others: the program is checked again with this setup, and drawn where it would go.
pub(super) fn check_again<const A: usize>(
    model: &Arc<Mutex<ScreenModel>>,
    machine: MachineConfig,
    program: &Arc<Program>,
    setup: Setup,
) {
    compute_preview::<A>(
        model,
        PreviewThread { machine, program: Arc::clone(program), setup: Some(setup), is_checked: false },
    );
}

/// The program has been opened and checked again, for a machine that may stand elsewhere now: what changed is reckoned again.
pub(super) fn look_again<const A: usize>(model: &Arc<Mutex<ScreenModel>>, machine: &MachineConfig, program: &Program) {
    let (new, old) = (facts(machine, program), Arc::clone(&locked(model).facts));
    let is_same = new.program == old.program && new.stands_at_mm == old.stands_at_mm && old.first_place == 0;
    if is_same && old.check == ProgramCheck::Ready {
        return;
    }
    locked(model).facts = Arc::new(new);
    let (machine, program) = (machine.clone(), Arc::new(program.clone()));
    compute_preview::<A>(model, PreviewThread { machine, program, setup: None, is_checked: true });
}

/// The last part of a path: what has room on a screen.
fn file_name(name: &str) -> String {
    let last = std::path::Path::new(name).file_name();
    last.map_or_else(|| name.to_owned(), |last| last.to_string_lossy().into_owned())
}

/// The reckoning that counts: a later one makes the earlier ones end.
static LATEST: AtomicU64 = AtomicU64::new(0);
/// One is at work at a time, so that they do not heap up while an axis is jogged step by step.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// What is to be reckoned.
struct PreviewThread {
    /// Where it stands.
    machine: MachineConfig,
    program: Arc<Program>,
    /// What the program is to be read with, where that is not what it was read with.
    setup: Option<Setup>,
    /// It has been checked already, and may be run.
    is_checked: bool,
}

/// Reckons check, path and time of a program, and has them shown when they are known.
fn compute_preview<const A: usize>(model: &Arc<Mutex<ScreenModel>>, reckoning: PreviewThread) {
    let number = LATEST.fetch_add(1, Ordering::Relaxed) + 1;
    let program = &reckoning.program;
    if !program.is_loaded() {
        return publish(model, number, |facts| ProgramFacts { check: ProgramCheck::NotLoaded, ..facts });
    }
    if program.lines().is_none() {
        let check = ProgramCheck::CheckedAsItRuns;
        return publish(model, number, |facts| ProgramFacts { planned: Planned::Unknown, check, ..facts });
    }
    let model = Arc::clone(model);
    thread::spawn(move || {
        let _alone = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
        if LATEST.load(Ordering::Relaxed) == number {
            reckoned::<A>(&model, number, reckoning);
        }
    });
}

fn reckoned<const A: usize>(model: &Mutex<ScreenModel>, number: u64, reckoning: PreviewThread) {
    let PreviewThread { machine, program, setup, is_checked } = reckoning;
    let refused = |why: String| {
        let findings = diagnostic_text::in_words(&why);
        let check = ProgramCheck::Refused(findings.clone());
        let is_known = locked(model).facts.check == check;
        publish(model, number, |facts| ProgramFacts { check, ..facts });
        if !is_known {
            let mut model = locked(model);
            let time_s = model.period as f64 * model.facts.period_s;
            findings.into_iter().for_each(|finding| model.say(time_s, 0, finding));
        }
    };
    let stands_at_mm = machine.stands_at_mm.clone();
    let program = match setup.map(|setup| program.anew(setup)) {
        None => program,
        Some(Ok(program)) => Arc::new(program),
        Some(Err(why)) => return refused(why.to_string()),
    };
    if !is_checked && let Err(why) = program.faults(&machine) {
        refused(why);
    } else {
        publish(model, number, |facts| ProgramFacts { check: ProgramCheck::Ready, ..facts });
    }
    let wanted = |decoder| PreviewRequest { decoder, number };
    let preview = Preview::of(&machine, &mut wanted(program.decoder()));
    publish(model, number, |facts| ProgramFacts { preview, stands_at_mm, ..facts });
    let surveyed = program_analysis::analyse_program::<A>(&machine, &mut wanted(program.decoder()));
    let planned = surveyed
        .map_or(Planned::Unknown, |(_, _, survey)| Planned::Known(survey.motion_periods as f64 * machine.period_s()));
    publish(model, number, |facts| ProgramFacts { planned, ..facts });
}

/// Has the picture show facts that are changed like that. They are copied outside of the picture's lock.
fn publish(model: &Mutex<ScreenModel>, number: u64, change: impl FnOnce(ProgramFacts) -> ProgramFacts) {
    let old = Arc::clone(&locked(model).facts);
    let new = Arc::new(change((*old).clone()));
    let mut model = locked(model);
    if LATEST.load(Ordering::Relaxed) == number {
        model.facts = new;
        model.changes += 1;
    }
}

/// A program that comes to its end when nobody wants to know any more.
struct PreviewRequest {
    decoder: Decoder,
    number: u64,
}

impl BlockDecoder for PreviewRequest {
    fn next_block(&mut self, steps: &mut Vec<CanonStep>) -> DecodedBlock {
        if LATEST.load(Ordering::Relaxed) == self.number { self.decoder.next_block(steps) } else { DecodedBlock::End }
    }
}
