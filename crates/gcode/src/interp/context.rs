//! Modal states that a program saves and restores: M70 to M73.
//!
//! Invariant: each level of calls has one saved state. Restoring it emits the canonical functions of the codes that a
//! program would need. The motion mode, the offsets of G52 and G92, and the tool in the spindle stay unchanged.

use super::block_motion::BlockMotion;
use super::interpreter_core::{Core, Emitter};
use crate::block::Words;
use crate::canon::Canon;
use crate::canon_modes::{FeedMode, PathControl};
use crate::compensation::Side;
use crate::diag::{BlockResult, fault};
use crate::error_codes::ErrorCode;
use crate::groups::GroupM;
use crate::modal::ModalState;
use crate::modal_groups::{ArcCentres, DistanceMode, SpindleRotation};
use crate::pose::Axis;
use crate::saved_state::SavedState;
use crate::unknown::UnknownModes;

/// Whether two values differ. A change of units and back changes the last digits.
fn differs(saved: f64, now: f64) -> bool {
    (saved - now).abs() > 1e-9 * saved.abs().max(1.0)
}

impl SavedState {
    fn save(state: &ModalState, on_return: bool) -> SavedState {
        SavedState {
            units: state.units,
            plane: state.plane,
            distance: state.distance,
            arc_centres: state.arc_centres,
            feed_mode: state.feed_mode,
            feed_rate: state.feed_rate,
            coordinate_system: state.coordinate_system,
            tool_offset: state.tool_offset,
            path_control: state.path_control,
            naivecam_tolerance: state.naivecam_tolerance,
            retract_to_r: state.retract_to_r,
            lathe_diameter: state.lathe_diameter,
            spindle: state.spindle,
            spindle_speed: state.spindle_speed,
            constant_surface_speed: state.constant_surface_speed,
            max_spindle_speed: state.max_spindle_speed,
            compensation: state.compensation.map(|compensation| (compensation.side, compensation.radius)),
            mist: state.mist,
            flood: state.flood,
            feed_override: state.feed_override,
            speed_override: state.speed_override,
            adaptive_feed: state.adaptive_feed,
            feed_hold: state.feed_hold,
            on_return,
        }
    }

    /// Returns a block that restores what one block can. The units are restored already.
    fn block(&self, state: &ModalState) -> BlockResult<Words> {
        let mut words = Words::default();
        self.add_feed_and_spindle(state, &mut words)?;
        let mut code = |differs: bool, code: f64| if differs { words.add_g(code, <_>::default()) } else { Ok(()) };
        code(self.plane != state.plane, self.plane.g_code())?;
        code(self.lathe_diameter != state.lathe_diameter, if self.lathe_diameter { 7.0 } else { 8.0 })?;
        let system = match self.coordinate_system {
            system @ 0..=6 => 53.0 + f64::from(system),
            system => 59.0 + f64::from(system - 6) / 10.0,
        };
        code(self.coordinate_system != state.coordinate_system, system)?;
        code(self.distance != state.distance, if self.distance == DistanceMode::Absolute { 90.0 } else { 91.0 })?;
        let absolute = self.arc_centres == ArcCentres::Absolute;
        code(self.arc_centres != state.arc_centres, if absolute { 90.1 } else { 91.1 })?;
        code(self.retract_to_r != state.retract_to_r, if self.retract_to_r { 99.0 } else { 98.0 })?;
        code(self.compensation.is_none() && state.compensation.is_some(), 40.0)?;
        code(self.tool_offset != state.tool_offset, 43.1)?;
        for axis in Axis::ALL {
            words.put(axis.letter().to_ascii_lowercase(), self.tool_offset[axis]);
        }
        self.add_path_control(state, &mut words)?;
        Ok(words)
    }

    /// Returns a block that switches cutter compensation on again, where needed. Its D is not that of G96.
    fn compensation_block(&self, state: &ModalState) -> BlockResult<Option<Words>> {
        let (Some((side, radius)), None) = (self.compensation, state.compensation) else { return Ok(None) };
        let mut words = Words::default();
        words.add_g(if side == Side::Left { 41.1 } else { 42.1 }, <_>::default())?;
        words.put(b'd', 2.0 * radius);
        Ok(Some(words))
    }

    fn add_feed_and_spindle(&self, state: &ModalState, words: &mut Words) -> BlockResult<()> {
        if self.feed_mode != state.feed_mode {
            let code = match self.feed_mode {
                FeedMode::InverseTime => 93.0,
                FeedMode::UnitsPerMinute => 94.0,
                FeedMode::UnitsPerRevolution => 95.0,
            };
            words.add_g(code, <_>::default())?;
        }
        // F and S are emitted even if they have not changed, as in LinuxCNC.
        words.put(b'f', self.feed_rate);
        words.put(b's', self.spindle_speed);
        let mode = |surface: bool, highest: f64| (surface, if surface { highest } else { 0.0 });
        let is_same_mode = mode(self.constant_surface_speed, self.max_spindle_speed)
            == mode(state.constant_surface_speed, state.max_spindle_speed);
        if !is_same_mode {
            words.add_g(if self.constant_surface_speed { 96.0 } else { 97.0 }, <_>::default())?;
            if self.constant_surface_speed {
                words.put(b'd', self.max_spindle_speed);
            }
        }
        if self.spindle != state.spindle {
            let code = match self.spindle {
                SpindleRotation::Clockwise => 3.0,
                SpindleRotation::Counterclockwise => 4.0,
                SpindleRotation::Stopped => 5.0,
            };
            return words.add_m(code, <_>::default());
        }
        // Of the codes that switch something, the first comes with this block and the others follow it, as in LinuxCNC.
        let is_off = !self.mist && !self.flood;
        match () {
            () if is_off && (state.mist || state.flood) => words.add_m(9.0, <_>::default()),
            () if self.mist && !state.mist => words.add_m(7.0, <_>::default()),
            () if self.flood && !state.flood => words.add_m(8.0, <_>::default()),
            () => Ok(()),
        }
    }

    /// Whether the path mode in force is the saved one.
    fn has_same_path_control(&self, state: &ModalState) -> bool {
        match (self.path_control, state.path_control) {
            (PathControl::Continuous { tolerance: saved }, PathControl::Continuous { tolerance: now }) => {
                !differs(saved, now) && !differs(self.naivecam_tolerance, state.naivecam_tolerance)
            }
            (saved, now) => saved == now,
        }
    }

    fn add_path_control(&self, state: &ModalState, words: &mut Words) -> BlockResult<()> {
        if self.has_same_path_control(state) {
            return Ok(());
        }
        let code = match self.path_control {
            PathControl::ExactPath => 61.0,
            PathControl::ExactStop => 61.1,
            PathControl::Continuous { tolerance } => {
                words.put(b'p', tolerance);
                words.put(b'q', self.naivecam_tolerance);
                64.0
            }
        };
        words.add_g(code, <_>::default())
    }
}

impl Core {
    /// Executes M70 … M73.
    pub(super) fn context(&mut self, code: u8, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let level = self.state.call_level as usize;
        match code {
            70 | 73 => {
                let saved = SavedState::save(&self.state, code == 73);
                if self.state.saved_states.len() <= level {
                    self.state.saved_states.resize(level + 1, None);
                }
                self.state.saved_states[level] = Some(saved);
                Ok(())
            }
            71 => {
                self.clear_context();
                Ok(())
            }
            _ => match self.state.saved_states.get(level).copied().flatten() {
                Some(saved) => self.restore(&saved, emit),
                None => fault(ErrorCode::NothingSaved, words.m_span(GroupM::Spindle), ErrorCode::NothingSaved.title()),
            },
        }
    }

    /// Clears the saved state of this level of calls.
    pub(super) fn clear_context(&mut self) {
        if let Some(place) = self.state.saved_states.get_mut(self.state.call_level as usize) {
            *place = None;
        }
    }

    /// Restores the state that M73 has saved for the end of this subprogram.
    pub(super) fn restore_on_return(&mut self, emit: &mut Emitter<'_>) -> BlockResult<()> {
        match self.state.saved_states.get(self.state.call_level as usize).copied().flatten() {
            Some(_) if self.state.unknown.has(UnknownModes::SAVED) => {
                self.state.forget_all();
                Ok(())
            }
            Some(saved) if saved.on_return && self.state.call_level > 0 => self.restore(&saved, emit),
            _ => Ok(()),
        }
    }

    fn restore(&mut self, saved: &SavedState, emit: &mut Emitter<'_>) -> BlockResult<()> {
        // These functions belong to no N word, as in LinuxCNC.
        let number = emit.number.take();
        if saved.units != self.state.units {
            self.set_units(saved.units, emit);
        }
        let block = saved.block(&self.state)?;
        let has_same_path_control = saved.has_same_path_control(&self.state);
        let mut outcome = self.execute(&block, BlockMotion::None, emit);
        if let (Ok(_), Some(block)) = (&outcome, saved.compensation_block(&self.state)?) {
            outcome = self.execute(&block, BlockMotion::None, emit);
        }
        if has_same_path_control {
            // It is emitted again, as F and S are. A code is not used, because cutter compensation would refuse it.
            emit.call(Canon::SetMotionControlMode(self.state.path_control));
            if let PathControl::Continuous { .. } = self.state.path_control {
                emit.call(Canon::SetNaivecamTolerance(self.state.naivecam_tolerance));
            }
        }
        self.restore_switches(saved, emit);
        emit.number = number;
        outcome.map(|_| ())
    }

    fn restore_switches(&mut self, saved: &SavedState, emit: &mut Emitter<'_>) {
        let state = &mut self.state;
        let mut switch = |now: &mut bool, saved: bool, canon: [Canon; 2]| {
            if std::mem::replace(now, saved) != saved {
                let [off, on] = canon;
                emit.call(if saved { on } else { off });
            }
        };
        if !saved.mist && !saved.flood && (state.mist || state.flood) {
            // M9 switches both off.
            switch(&mut true, false, [Canon::MistOff, Canon::MistOn]);
            switch(&mut true, false, [Canon::FloodOff, Canon::FloodOn]);
            (state.mist, state.flood) = (false, false);
        }
        switch(&mut state.mist, saved.mist, [Canon::MistOff, Canon::MistOn]);
        switch(&mut state.flood, saved.flood, [Canon::FloodOff, Canon::FloodOn]);
        let feed = [Canon::DisableFeedOverride, Canon::EnableFeedOverride];
        switch(&mut state.feed_override, saved.feed_override, feed);
        let speed = [Canon::DisableSpeedOverride, Canon::EnableSpeedOverride];
        switch(&mut state.speed_override, saved.speed_override, speed);
        let adaptive = [Canon::DisableAdaptiveFeed, Canon::EnableAdaptiveFeed];
        switch(&mut state.adaptive_feed, saved.adaptive_feed, adaptive);
        switch(&mut state.feed_hold, saved.feed_hold, [Canon::DisableFeedHold, Canon::EnableFeedHold]);
    }
}
