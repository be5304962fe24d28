//! The height of a cutter over the sheet: how the player drives the layer.
//!
//! Invariant: the layer moves only in an instruction, while the path is at rest, or beside the path, while a cutter is
//! on; otherwise it comes to rest and stays.

use retrace_core::{Place, Rate};
use retrace_link::{
    AnalogInputs, CardSettings, CutterOffCause, HeightControlSettings, HeightSource, LayerMove, OutputChange, channel,
};

use super::{MotionBlock, Player};
use crate::window::RecordStorage;
use crate::{HeightConditions, HeightOrder};

impl<const A: usize, const W: usize, const M: usize, S: RecordStorage<A>> Player<A, W, M, S> {
    /// Begins an epoch for the layer: one that is not kept becomes part of the counts. The height is not held: that is
    /// part of the path before.
    pub(super) fn open_layer(&mut self, settings: &CardSettings<A>, most: u16) {
        for control in &mut self.height {
            control.external().into_iter().for_each(|change| self.outputs.set(OutputChange { value: 0, ..change }));
            control.configure(&HeightControlSettings::NONE);
            self.outputs.set(OutputChange { channel: channel::HEIGHT_HOLD, value: 0 });
        }
        let axis = settings.layer.map_or(0, |layer| usize::from(layer.axis));
        let limits = settings.limits.axes().get(axis).copied().unwrap_or_default();
        if let Some((axis, layer)) = self.layer.configure(settings.layer, &limits, most, settings.start.keeps_state)
            && let Some(count) = self.status.counts.get_mut(usize::from(axis))
        {
            *count += i64::from(layer);
        }
    }

    /// Runs one control period of the layer, with these inputs active. Where the requested rate is 0, an instruction of
    /// the program waits with its moves, and with what it switches behind them; not with a cutter that is on.
    pub(super) fn run_layer(&mut self, active: u16, analog: &AnalogInputs) {
        let is_lit = self.is_lit();
        let axis = self.layer.axis().map_or(0, usize::from);
        self.layer.shift_bounds(self.status.increments.get(axis).copied().unwrap_or_default());
        self.control_height(active, analog);
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

    /// Whether the height is controlled while a cutter is on.
    pub(super) fn controls_height(&self) -> bool {
        self.height.first().is_some_and(|control| control.settings().source != HeightSource::None)
    }

    /// Runs the control of the height for one control period, which moves the layer beside the path.
    fn control_height(&mut self, active: u16, analog: &AnalogInputs) {
        if !self.controls_height() {
            return;
        }
        let outputs = self.outputs.values();
        let value = |channel: u8| outputs.get(usize::from(channel)).copied().unwrap_or(0);
        let offset = value(channel::HEIGHT_OFFSET);
        let is_busy = self.switching.is_busy();
        let proven = self.permit.proven(outputs);
        let (is_proven, is_steady) = proven.unwrap_or((false, false));
        let path_moves = self.path_moves_layer_axis();
        let axis = self.layer.axis().map_or(0, usize::from);
        let moved = self.status.increments.get(axis).copied().unwrap_or_default();
        let mut now = HeightConditions {
            is_cutting: is_proven && !is_busy && self.status.rate >= Rate::ZERO,
            is_free: self.layer.is_free() && !path_moves,
            feed_share: u32::try_from(self.feed_share >> 32).unwrap_or(u32::MAX),
            is_slow_ahead: false,
            is_held: !is_steady || value(channel::HEIGHT_HOLD) != 0 || offset == channel::HEIGHT_STAYS,
            inputs: active,
            reading: None,
            offset: if offset == channel::HEIGHT_STAYS { 0 } else { offset },
            layer: self.layer.layer(),
            bounds: self.layer.bounds(),
        };
        let (here, window) = (self.status.place.record, &self.window);
        let Some(control) = self.height.first_mut() else { return };
        if proven.is_none() && !is_busy {
            // The cut is over: what is lit next may be another cutter.
            control.external().into_iter().for_each(|change| self.outputs.set(OutputChange { value: 0, ..change }));
            control.configure(&HeightControlSettings::NONE);
        }
        if let HeightSource::Volts { input } = control.settings().source {
            now.reading = analog.get(usize::from(input)).copied().flatten();
        }
        control.shift_range(moved);
        now.is_slow_ahead = now.is_cutting && control.look_ahead(here, |n| window.record(n));
        match control.run_period(&now) {
            HeightOrder::None => self.layer.end_steering(),
            HeightOrder::Stay => self.layer.stop(),
            HeightOrder::Toward { end, speed } => self.layer.steer(end, speed),
        }
        control.external().into_iter().for_each(|change| self.outputs.set(change));
        if control.has_failed() {
            self.switch_cutters_off(CutterOffCause::HeightLimit);
            self.block = MotionBlock::CutterOff;
        }
    }

    /// Sets how the height of a cut is controlled, where these moves begin one.
    pub(super) fn begin_height_control(&mut self, moves: Option<LayerMove>) {
        let Some(LayerMove::Start { control: settings, .. }) = moves else { return };
        for (control, settings) in self.height.iter_mut().zip(&settings) {
            control.configure(settings);
        }
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
