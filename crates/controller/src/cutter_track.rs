//! Tracks the machine's cutters between a program's moves: a beam goes off for a rapid, a torch or a jet must be off
//! (CUT-4), and none may be on in a long dwell (CUT-6).
//!
//! Invariant: no rapid move is given to a sink with a cutter on, unless the machine file permits it.

use retrace_config::{CutterKind, MachineConfig};
use retrace_link::OutputChange;

use crate::canon_error::CanonError;
use crate::motion_sink::MotionSink;

/// State of the machine's cutters as the program has switched them, in the order of the machine file.
#[derive(Clone, Debug)]
pub(crate) struct CutterTrack {
    /// Whether each of them is on.
    lit: Vec<bool>,
    /// Whether each of them is off only for rapid moves.
    interrupted: Vec<bool>,
}

impl CutterTrack {
    /// Creates the state with all cutters off.
    pub(crate) fn new(machine: &MachineConfig) -> Self {
        let count = machine.cutters.len();
        Self { lit: vec![false; count], interrupted: vec![false; count] }
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
        let lit = |at: usize| self.lit[at] && machine.cutters[at].kind.cuts_at_rest() && !machine.cutters[at].rapid_lit;
        let torch = (0..self.lit.len()).find(|&at| lit(at) && machine.cutters[at].kind != CutterKind::Beam);
        if let Some(at) = torch {
            return Err(CanonError::RapidWhileLit(machine.cutters[at].name.clone()));
        }
        for at in 0..self.lit.len() {
            let cutter = &machine.cutters[at];
            let goes_off = self.lit[at] && cutter.kind == CutterKind::Beam && !cutter.rapid_lit;
            if goes_off && !std::mem::replace(&mut self.interrupted[at], true) {
                sink.action(OutputChange { channel: cutter.fire, value: 0 }, line);
            }
        }
        Ok(())
    }

    /// To be called before a feed move: beams that were off only for rapid moves are on again where it begins.
    pub(crate) fn before_feed<const A: usize>(
        &mut self,
        machine: &MachineConfig,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) {
        for (cutter, interrupted) in machine.cutters.iter().zip(&mut self.interrupted) {
            if std::mem::take(interrupted) {
                sink.action(OutputChange { channel: cutter.fire, value: 1 }, line);
            }
        }
    }

    /// Whether the program has any cutter on.
    pub(crate) fn is_any_lit(&self) -> bool {
        self.lit.contains(&true)
    }

    /// To be called before a dwell: a cutter burns at one place as long as it lasts (CUT-6).
    ///
    /// # Errors
    /// [`CanonError::LitDwell`] where it is too long for a cutter that is on.
    pub(crate) fn before_dwell(&self, machine: &MachineConfig, seconds: f64) -> Result<(), CanonError> {
        let lit = machine.cutters.iter().zip(&self.lit).filter(|(cutter, lit)| **lit && cutter.kind.cuts_at_rest());
        match lit.map(|(cutter, _)| cutter).find(|cutter| seconds > cutter.dwell_lit_s) {
            None => Ok(()),
            Some(cutter) => Err(CanonError::LitDwell(cutter.name.clone(), cutter.dwell_lit_s)),
        }
    }

    /// Whether the program has switched the cutter of this channel on.
    pub(crate) fn is_lit(&self, machine: &MachineConfig, channel: u8) -> bool {
        machine.cutters.iter().zip(&self.lit).any(|(cutter, &lit)| cutter.fire == channel && lit)
    }

    /// Records that the program switches these outputs.
    pub(crate) fn record_switching(&mut self, machine: &MachineConfig, changes: &[OutputChange]) {
        for (at, cutter) in machine.cutters.iter().enumerate() {
            for change in changes.iter().filter(|change| change.channel == cutter.fire) {
                self.lit[at] = change.value != 0;
                self.interrupted[at] = false;
            }
        }
    }
}
