//! What the screen is told of a program before it runs: its text, its path, and from the plan itself how long it takes.
//!
//! Invariant: whatever takes time is done in a thread of its own; the picture says "reckoning" until it is there.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;

use retrace_controller::job::{Decode, Decoded};
use retrace_controller::machine::Machine;
use retrace_controller::survey;
use retrace_gcode::Step;

use crate::program::{Decoder, Program};
use crate::screen::facts::{Facts, Planned};
use crate::screen::live::locked;
use crate::screen::model::Model;
use crate::screen::preview::Preview;

/// What is known at once.
pub(super) fn facts(machine: &Machine, program: &Program) -> Facts {
    let tools = program.tool_table().map_or_else(Vec::new, |table| {
        let tool = |tool: &retrace_gcode::Tool| {
            let name = table.name(tool.number).unwrap_or_default();
            format!("T{:<4} D {:>8.3}  Z {:>9.3}  {name}", tool.number, tool.diameter, tool.offset.0[2])
        };
        table.tools().map(tool).collect()
    });
    Facts { tools, ..Facts::of(machine, &file_name(program.name()), &program.text()) }
}

/// The program has been opened again, for a machine that may stand elsewhere now: what changed is reckoned again.
pub(super) fn look_again<const A: usize>(model: &Arc<Mutex<Model>>, machine: &Machine, program: &Program) {
    let (new, old) = (facts(machine, program), Arc::clone(&locked(model).facts));
    if new.program == old.program && new.stands_at_mm == old.stands_at_mm {
        return;
    }
    locked(model).facts = Arc::new(new);
    reckon::<A>(model, machine, &Arc::new(program.clone()));
}

/// The last part of a path: what has room on a screen.
fn file_name(name: &str) -> String {
    let last = std::path::Path::new(name).file_name();
    last.map_or_else(|| name.to_owned(), |last| last.to_string_lossy().into_owned())
}

/// The reckoning that counts: a later one makes the earlier ones end.
static LATEST: AtomicU64 = AtomicU64::new(0);

/// Reckons path and time of a program on a machine that stands where it does, and has them shown when they are known.
pub(super) fn reckon<const A: usize>(model: &Arc<Mutex<Model>>, machine: &Machine, program: &Arc<Program>) {
    let number = LATEST.fetch_add(1, Ordering::Relaxed) + 1;
    if program.lines().is_none() {
        return publish(model, number, |facts| Facts { planned: Planned::Unknown, ..facts });
    }
    let (model, machine, program) = (Arc::clone(model), machine.clone(), Arc::clone(program));
    thread::spawn(move || {
        let wanted = |decoder| Wanted { decoder, number };
        let preview = Preview::of(&machine, &mut wanted(program.decoder()));
        publish(&model, number, |facts| Facts { preview, ..facts });
        let surveyed = survey::survey::<A>(&machine, &mut wanted(program.decoder()));
        let planned = surveyed.map_or(Planned::Unknown, |(_, _, survey)| {
            Planned::Known(survey.motion_periods as f64 * machine.period_s())
        });
        publish(&model, number, |facts| Facts { planned, ..facts });
    });
}

/// Has the picture show facts that are changed like that. They are copied outside of the picture's lock.
fn publish(model: &Mutex<Model>, number: u64, change: impl FnOnce(Facts) -> Facts) {
    let old = Arc::clone(&locked(model).facts);
    let new = Arc::new(change((*old).clone()));
    let mut model = locked(model);
    if LATEST.load(Ordering::Relaxed) == number {
        model.facts = new;
        model.changes += 1;
    }
}

/// A program that comes to its end when nobody wants to know any more.
struct Wanted {
    decoder: Decoder,
    number: u64,
}

impl Decode for Wanted {
    fn next_block(&mut self, steps: &mut Vec<Step>) -> Decoded {
        if LATEST.load(Ordering::Relaxed) == self.number { self.decoder.next_block(steps) } else { Decoded::End }
    }
}
