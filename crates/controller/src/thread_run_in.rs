//! The run-in of a thread along Z, which a program reads as `#<_thread_run_in>` (SPN-13).
//!
//! Invariant: no thread of that pitch and speed needs more, wherever it begins and however long it is: it is the figure
//! of the planner that plans the thread itself, and the distance of one record more, by which a thread may differ.

use std::sync::Arc;

use retrace_config::MachineConfig;
use retrace_gcode::ThreadRunIn;
use retrace_motion::PathMode;

use crate::thread_plan::{ThreadCheck, ThreadError, ThreadPiece, ThreadStretch};

/// Turns of the first attempt; each further one has twice as many.
const FIRST_TURNS: f64 = 16.0;
/// Maximum number of attempts.
const ATTEMPTS: u32 = 8;

/// A machine that cuts threads.
#[derive(Debug)]
struct ThreadMachine(MachineConfig);

/// What gives programs the run-in; `None` on a machine without an encoder.
pub(crate) fn source(machine: &MachineConfig) -> Option<Arc<dyn ThreadRunIn>> {
    machine.encoder.as_ref()?;
    Some(Arc::new(ThreadMachine(machine.clone())))
}

impl ThreadRunIn for ThreadMachine {
    fn run_in_mm(&self, pitch_mm: f64, rpm: f64) -> Option<f64> {
        let encoder = self.0.encoder.as_ref()?;
        let z = self.0.axes.iter().position(|axis| axis.name == 'z')?;
        let is_thread = pitch_mm > 0.0 && rpm > 0.0 && pitch_mm.is_finite() && rpm.is_finite();
        let mut turns = FIRST_TURNS;
        for _ in (0..ATTEMPTS).filter(|_| is_thread) {
            let mut end_mm = [0.0; 9];
            end_mm[z] = -turns * pitch_mm;
            let piece = ThreadPiece { end_mm, pitch_mm, mode: PathMode::ExactStop, line: 0 };
            let stretch = ThreadStretch { pieces: vec![piece], rpm, start_degrees: 0.0 };
            match ThreadCheck::default().run_mm(&stretch, &self.0, encoder, [0.0; 9]) {
                Ok([run_in, run_out]) => {
                    let records = 60.0 / (rpm * encoder.thread_margin * self.0.period_s());
                    return Some(run_in.max(run_out) + pitch_mm / records.floor().max(1.0));
                }
                Err(ThreadError::TooShort { .. }) => turns *= 2.0,
                Err(_) => return None,
            }
        }
        None
    }
}
