//! Probing moves: the latch is armed at rest, and what it keeps ends the move (PRB-2 … PRB-4).
//!
//! Invariant: while the latch is armed the cursor never moves backward, nor faster than planned; once the probe has
//! touched, no rate moves it until a new epoch begins.

use retrace_core::{Flags, Rate, RateTarget};
use retrace_link::{CardStatus, CommandRefusal, ProbeArming};

use super::Player;
use crate::ProbeReading;
use crate::window::RecordStorage;

impl<const A: usize, const W: usize, const M: usize, S: RecordStorage<A>> Player<A, W, M, S> {
    /// Arms the latch. Only at rest, and once in an epoch.
    pub(super) fn arm_probe(&mut self, arming: ProbeArming) -> Result<(), CommandRefusal> {
        if !self.is_at_rest() {
            return Err(CommandRefusal::InMotion);
        }
        if self.probe.is_armed() {
            return Err(CommandRefusal::Busy);
        }
        self.probe.arm(arming);
        Ok(())
    }

    /// Returns what the latch awaits.
    pub(crate) const fn awaited_probe(&self) -> Option<ProbeArming> {
        self.probe.awaited()
    }

    /// Observes the probe at the end of the last period.
    pub(crate) fn observe_probe(&mut self, active: u16, probe: ProbeReading) {
        let status = &self.status;
        self.probe.observe(active, probe, &status.counts, &status.increments);
        (self.status.probe, self.status.probe_edge) = (self.probe.latch(), self.probe.edge());
    }

    /// Whether a probe that responds now is a collision: in motion on records that belong to no probing move. Where the
    /// path is retraced, the contact closes where it opened before.
    pub(crate) fn is_probe_guarded(&self) -> bool {
        let CardStatus { place, reached, rate, .. } = self.status;
        let is_probing = |record| self.window.record(record).is_some_and(|of| of.flags.contains(Flags::PROBING));
        let is_new = rate > Rate::ZERO && !place.boundary_ahead().is_before(reached);
        (is_new || self.off_path)
            && !self.probe.is_armed()
            && !is_probing(place.record)
            && !is_probing(place.record - 1)
    }

    /// The target rates, limited while the latch is armed.
    pub(super) fn probing_target(&self, target: RateTarget) -> RateTarget {
        if !self.probe.is_armed() {
            return target;
        }
        let within = |rate: Rate| rate.clamp(Rate::ZERO, Rate::ONE);
        RateTarget { feed: within(target.feed), rapid: within(target.rapid) }
    }
}
