//! Tracks the machine's cutters between a program's moves: a beam goes off for a rapid, a torch or a jet must be off
//! (CUT-4), and none may be on in a long dwell (CUT-6).
//!
//! Invariant: no rapid move is given to a sink with a cutter on, unless the machine file permits it.

use retrace_config::{CutterKind, MachineConfig};
use retrace_link::{OutputChange, channel};

use crate::canon_error::CanonError;
use crate::motion_sink::MotionSink;

/// State of the machine's cutters as the program has switched them, in the order of the machine file.
#[derive(Clone, Debug)]
pub(crate) struct CutterTrack {
    /// Value of the output of each of them.
    values: Vec<i32>,
    /// Whether each of them is off only for rapid moves.
    interrupted: Vec<bool>,
    /// S as the program has set it last; `None` before its first S.
    speed: Option<i32>,
    /// Feed in mm/min of the move behind which the power of a beam changes in passing.
    changed_behind_feed: Option<f64>,
    /// Feed in mm/min of the last feed move; `None` behind a rapid move.
    last_feed: Option<f64>,
}

/// Greatest distance in mm between the place at which a program changes the power of a beam and the one at which it
/// changes (CUT-20): it changes at the beginning of the control period.
const POWER_CHANGE_MM: f64 = 0.05;

impl CutterTrack {
    /// Creates the state with all cutters off.
    pub(crate) fn new(machine: &MachineConfig) -> Self {
        let count = machine.cutters.len();
        Self {
            values: vec![0; count],
            interrupted: vec![false; count],
            speed: None,
            changed_behind_feed: None,
            last_feed: None,
        }
    }

    /// To be called before a rapid move: beams go off where it begins.
    ///
    /// # Errors
    /// [`CanonError::RapidWhileLit`] where a torch or a jet is on.
    pub(crate) fn before_rapid<const A: usize>(
        &mut self,
        machine: &MachineConfig,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        (self.changed_behind_feed, self.last_feed) = (None, None);
        let lit = |at: usize| {
            self.values[at] != 0 && machine.cutters[at].kind.cuts_at_rest() && !machine.cutters[at].rapid_lit
        };
        let torch = (0..self.values.len()).find(|&at| lit(at) && machine.cutters[at].kind != CutterKind::Beam);
        if let Some(at) = torch {
            return Err(CanonError::RapidWhileLit(machine.cutters[at].name.clone()));
        }
        for at in 0..self.values.len() {
            let cutter = &machine.cutters[at];
            let goes_off = self.values[at] != 0 && cutter.kind == CutterKind::Beam && !cutter.rapid_lit;
            if goes_off && !std::mem::replace(&mut self.interrupted[at], true) {
                sink.action(OutputChange { channel: cutter.fire, value: 0 }, line);
            }
        }
        Ok(())
    }

    /// To be called before a feed move of this feed in mm/min: beams that were off only for rapid moves are on again
    /// where it begins.
    ///
    /// # Errors
    /// [`CanonError::PowerTooFast`] where the power of a beam changes in passing and the place cannot be kept.
    pub(crate) fn before_feed<const A: usize>(
        &mut self,
        machine: &MachineConfig,
        feed_mm_min: f64,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        self.last_feed = Some(feed_mm_min);
        if let Some(behind) = self.changed_behind_feed.take() {
            let most_mm_min = POWER_CHANGE_MM / machine.period_s() * 60.0;
            if behind.max(feed_mm_min) > most_mm_min * (1.0 + 1e-9) {
                return Err(CanonError::PowerTooFast { most_mm_min });
            }
        }
        for ((cutter, &value), interrupted) in machine.cutters.iter().zip(&self.values).zip(&mut self.interrupted) {
            if std::mem::take(interrupted) {
                sink.action(OutputChange { channel: cutter.fire, value }, line);
            }
        }
        Ok(())
    }

    /// To be called where S is set while a beam is on whose power it is. Returns whether it changes: many programs
    /// repeat S in every block.
    pub(crate) fn record_power(&mut self, value: i32) -> bool {
        let changes = self.speed.replace(value) != Some(value);
        if changes {
            self.changed_behind_feed = self.last_feed;
        }
        changes
    }

    /// Whether the program has any cutter on.
    pub(crate) fn is_any_lit(&self) -> bool {
        self.values.iter().any(|&value| value != 0)
    }

    /// To be called before a dwell: a cutter burns at one place as long as it lasts (CUT-6).
    ///
    /// # Errors
    /// [`CanonError::LitDwell`] where it is too long for a cutter that is on.
    pub(crate) fn before_dwell(&self, machine: &MachineConfig, seconds: f64) -> Result<(), CanonError> {
        let lit = machine
            .cutters
            .iter()
            .zip(&self.values)
            .filter(|(cutter, value)| **value != 0 && cutter.kind.cuts_at_rest());
        match lit.map(|(cutter, _)| cutter).find(|cutter| seconds > cutter.dwell_lit_s) {
            None => Ok(()),
            Some(cutter) => Err(CanonError::LitDwell(cutter.name.clone(), cutter.dwell_lit_s)),
        }
    }

    /// Whether the program has switched the cutter of this channel on.
    pub(crate) fn is_lit(&self, machine: &MachineConfig, channel: u8) -> bool {
        machine.cutters.iter().zip(&self.values).any(|(cutter, &value)| cutter.fire == channel && value != 0)
    }

    /// Records that the program switches these outputs.
    pub(crate) fn record_switching(&mut self, machine: &MachineConfig, changes: &[OutputChange]) {
        if let Some(change) = changes.iter().rfind(|change| change.channel == channel::SPEED) {
            self.speed = Some(change.value);
        }
        for (at, cutter) in machine.cutters.iter().enumerate() {
            for change in changes.iter().filter(|change| change.channel == cutter.fire) {
                self.values[at] = change.value;
                self.interrupted[at] = false;
                self.changed_behind_feed = None;
            }
        }
    }
}
