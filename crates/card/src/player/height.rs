//! The height of a cutter over the sheet: how the player drives the layer.
//!
//! Invariant: the layer moves only in an instruction, while the path is at rest, or beside the path, while a cutter is
//! on; otherwise it comes to rest and stays.

use retrace_core::{Place, Rate};
use retrace_link::{CardSettings, CutterOffCause};

use super::{MotionBlock, Player};
use crate::window::RecordStorage;

impl<const A: usize, const W: usize, const M: usize, S: RecordStorage<A>> Player<A, W, M, S> {
    /// Begins an epoch for the layer: one that is not kept becomes part of the counts.
    pub(super) fn open_layer(&mut self, settings: &CardSettings<A>, most: u16) {
        let axis = settings.layer.map_or(0, |layer| usize::from(layer.axis));
        let limits = settings.limits.axes().get(axis).copied().unwrap_or_default();
        if let Some((axis, layer)) = self.layer.configure(settings.layer, &limits, most, settings.start.keeps_layer)
            && let Some(count) = self.status.counts.get_mut(usize::from(axis))
        {
            *count += i64::from(layer);
        }
    }

    /// Runs one control period of the layer, with these inputs active. Where the requested rate is 0, an instruction of
    /// the program waits with its moves, and with what it switches behind them; not with a cutter that is on.
    pub(super) fn run_layer(&mut self, active: u16) {
        let is_lit = self.is_lit();
        if !(self.switching.is_busy() || self.layer.is_beside() && is_lit) {
            self.layer.stop();
        }
        // Whatever the operator does while the machine waits for him, the sheet may lie elsewhere then.
        if self.target.faster() == Rate::ZERO {
            self.layer.forget_kept_sheet();
        }
        let waits = self.switching.is_program_running() && self.target.faster() == Rate::ZERO && !is_lit;
        // The path has its axis for itself.
        let yields = self.layer.is_beside() && self.path_moves_layer_axis();
        self.layer.run_period(active, waits || yields);
    }

    /// Whether the record under the cursor moves the axis of the layer.
    fn path_moves_layer_axis(&self) -> bool {
        let record = self.window.record(self.status.place.record);
        let increment =
            record.zip(self.layer.axis()).and_then(|(of, axis)| of.increments.get(usize::from(axis)).copied());
        increment.is_some_and(|increment| increment != 0)
    }

    /// Whether the layer moves and the path must rest.
    pub(super) fn layer_holds_path(&self) -> bool {
        !self.layer.at_rest() && !self.layer.is_beside()
    }

    /// The cutter was not started: motion is blocked until a restart.
    pub(super) fn block_start(&mut self, cause: CutterOffCause, place: Place) {
        self.permit.report_off(self.outputs.values(), cause, place);
        self.block = MotionBlock::CutterOff;
    }

    /// Returns the increment of the layer in the last period, and its axis.
    pub(crate) fn layer_increment(&self) -> (usize, i32) {
        (self.layer.axis().map_or(0, usize::from), self.layer.increment())
    }

    /// Whether the layer is 0.
    pub(crate) const fn is_layer_zero(&self) -> bool {
        self.layer.layer() == 0
    }
}
