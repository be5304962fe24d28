//! The distance in which the axes come to the pitch of a thread, as programs read it: `#<_thread_run_in>` (SPN-13).
//!
//! Invariant: it has a value only where the machine can cut such a thread.

use std::fmt::Debug;

use crate::modal::ModalState;
use crate::unknown::UNKNOWN;

/// Name of the parameter.
pub(crate) const NAME: &str = "_thread_run_in";
/// Name of the parameter that the program sets before: the distance in a turn of the spindle, in program units.
pub(crate) const PITCH: &str = "_thread_pitch";

/// Source of run-ins: the machine, which plans its threads.
pub trait ThreadRunIn: Debug + Send + Sync {
    /// Returns the longer of run-in and run-out, in mm, of a thread with this distance in a turn, in mm, at this speed
    /// in turns per minute; `None` where the machine cannot cut it.
    fn run_in_mm(&self, pitch_mm: f64, rpm: f64) -> Option<f64>;
}

/// Value of the parameter in this state, in program units, for a pitch in them. `None`: it has none.
pub(crate) fn value(source: &dyn ThreadRunIn, state: &ModalState, pitch: f64) -> Option<f64> {
    if state.constant_surface_speed {
        return None;
    }
    if pitch.is_nan() || state.spindle_speed.is_nan() {
        return Some(UNKNOWN);
    }
    let unit_mm = state.units.millimetres();
    let run_in_mm = source.run_in_mm(pitch.abs() * unit_mm, state.spindle_speed)?;
    Some(run_in_mm / unit_mm)
}
