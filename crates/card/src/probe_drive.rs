//! The latch of the probe: it keeps the counts at the first edge, and tells when that edge counts (PRB-1 … PRB-3).
//!
//! Invariant: only the first edge since the latch was armed is kept, through any bounce; once it counts, nothing
//! changes it until the latch is disarmed.

use retrace_link::{ProbeArming, ProbeLatch, counts_at_edge};

/// The latch for the counts of `A` axes.
#[derive(Clone, Copy, Debug, Default)]
pub struct ProbeDrive<const A: usize> {
    arming: ProbeArming,
    latch: ProbeLatch<A>,
    /// Consecutive periods with the awaited level, and without it, since the edge.
    with_level: u16,
    without_level: u16,
    /// Part of the last period in which the edge that is kept was seen.
    edge: Option<u16>,
}

impl<const A: usize> ProbeDrive<A> {
    /// Creates a latch that is not armed.
    #[must_use]
    pub const fn new() -> Self {
        let arming = ProbeArming { input: 0, active: false, filter_periods: 0 };
        Self { arming, latch: ProbeLatch::Idle, with_level: 0, without_level: 0, edge: None }
    }

    /// Arms the latch.
    pub const fn arm(&mut self, arming: ProbeArming) {
        *self = Self { arming, latch: ProbeLatch::Armed, ..Self::new() };
    }

    /// Returns what the latch holds.
    #[must_use]
    pub const fn latch(&self) -> ProbeLatch<A> {
        self.latch
    }

    /// Returns the part of the period before the last observation in which the edge was that is kept since then, in
    /// units of 2⁻¹⁶.
    #[must_use]
    pub const fn edge(&self) -> Option<u16> {
        self.edge
    }

    /// Whether the latch is armed: a probing move.
    #[must_use]
    pub const fn is_armed(&self) -> bool {
        !matches!(self.latch, ProbeLatch::Idle)
    }

    /// Whether the probe has touched, so that the machine stays at rest.
    #[must_use]
    pub const fn has_touched(&self) -> bool {
        matches!(self.latch, ProbeLatch::Touched(_))
    }

    /// Observes the inputs at the end of the period with these increments, which ended at `counts`. `first_change`: the
    /// part of the period in which the probe's level changed first, where the hardware captures that; otherwise an edge
    /// counts as being at the end of the period.
    pub fn observe(&mut self, active: u16, first_change: Option<u16>, counts: &[i64; A], increments: &[i32; A]) {
        self.edge = None;
        let ProbeArming { input, active: awaited, filter_periods } = self.arming;
        let has_level = (active >> (input & 15) & 1 == 1) == awaited;
        if self.latch == ProbeLatch::Armed && (has_level || first_change.is_some()) {
            let part = first_change.unwrap_or(u16::MAX);
            self.latch = ProbeLatch::Edge(counts_at_edge(counts, increments, part));
            (self.edge, self.with_level, self.without_level) = (Some(part), 0, 0);
        }
        let ProbeLatch::Edge(touch) = self.latch else { return };
        if has_level {
            (self.with_level, self.without_level) = (self.with_level.saturating_add(1), 0);
        } else {
            (self.with_level, self.without_level) = (0, self.without_level.saturating_add(1));
        }
        if filter_periods == 0 || self.with_level > filter_periods {
            self.latch = ProbeLatch::Touched(touch);
        } else if self.without_level > filter_periods {
            self.latch = ProbeLatch::Armed;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROBE: u16 = 1 << 3;

    fn armed(filter_periods: u16) -> ProbeDrive<1> {
        let mut latch = ProbeDrive::new();
        latch.arm(ProbeArming { input: 3, active: true, filter_periods });
        latch
    }

    /// Observes levels of periods of ten pulses each, with the part in which each changed first.
    fn observed(latch: &mut ProbeDrive<1>, levels: &[(bool, Option<u16>)]) -> Vec<ProbeLatch<1>> {
        let observe = |(period, &(level, change)): (usize, &(bool, Option<u16>))| {
            let active = if level { PROBE } else { 0 };
            latch.observe(active, change, &[10 * (period as i64 + 1)], &[10]);
            latch.latch()
        };
        levels.iter().enumerate().map(observe).collect()
    }

    #[test]
    fn the_touch_is_what_was_emitted_by_the_edge() {
        let levels = [(false, None), (true, Some(1 << 15))];
        assert_eq!(observed(&mut armed(0), &levels), [ProbeLatch::Armed, ProbeLatch::Touched([15])]);
        assert_eq!(observed(&mut armed(0), &[(true, None)]), [ProbeLatch::Touched([10])], "not captured: sampled");
        let mut back = ProbeDrive::<1>::new();
        back.arm(ProbeArming { input: 3, active: false, filter_periods: 0 });
        back.observe(0, Some(1 << 15), &[-10], &[-10]);
        assert_eq!(back.latch(), ProbeLatch::Touched([-5]));
    }

    #[test]
    fn the_first_edge_is_kept_through_a_bounce_and_dropped_where_the_level_does_not_stay() {
        let [first, none] = [Some(0), None];
        let bounce = [(true, first), (false, first), (true, first), (true, none), (true, none), (true, none)];
        let touched = observed(&mut armed(2), &bounce);
        assert_eq!(touched[4..], [ProbeLatch::Touched([0]); 2]);
        assert_eq!(touched[3], ProbeLatch::Edge([0]));
        let glitch = [(true, first), (false, none), (false, none), (false, none), (true, first)];
        let dropped = observed(&mut armed(2), &glitch);
        assert_eq!(dropped[3..], [ProbeLatch::Armed, ProbeLatch::Edge([40])]);
    }

    #[test]
    fn nothing_is_kept_without_arming() {
        let mut latch = ProbeDrive::<1>::new();
        latch.observe(u16::MAX, Some(3), &[10], &[10]);
        assert_eq!((latch.latch(), latch.edge()), (ProbeLatch::Idle, None));
    }
}
