//! The latch of the probe: it keeps the counts at the first edge, and tells when that edge counts (PRB-1 … PRB-3).
//!
//! Invariant: only the first edge since the latch was armed is kept, through any bounce; once it counts, nothing
//! changes it until the latch is disarmed.

use retrace_link::{ProbeArming, ProbeEdge, ProbeLatch};

/// The edge that an armed latch awaits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AwaitedProbe {
    /// Number of the input.
    pub input: u8,
    /// Level at the pin behind the edge.
    pub is_high: bool,
}

/// What a board reads of the probe besides its level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProbeReading {
    /// Part of a period, in units of 2⁻¹⁶, in which the level changed first, on hardware that captures it; otherwise an
    /// edge counts as being at the end of the period.
    pub first_change: Option<u16>,
    /// Whether that period, at whose end the level is read, is the one before the last: a step generator that plays a
    /// period while the next one is computed.
    pub is_period_behind: bool,
}

/// State of the latch.
#[derive(Clone, Copy, Debug)]
enum State<const A: usize> {
    Idle,
    /// The edge is awaited. `earlier`: increments of the last period; at the next observation, those of the one before.
    Armed {
        earlier: [i32; A],
    },
    Edge([i64; A]),
    Touched([i64; A]),
}

/// The latch for the counts of `A` axes.
#[derive(Clone, Copy, Debug)]
pub struct ProbeDrive<const A: usize> {
    arming: ProbeArming,
    state: State<A>,
    /// Consecutive periods with the awaited level, and without it, since the edge.
    with_level: u16,
    without_level: u16,
    /// The edge that is kept, where it was seen in the last observation.
    edge: Option<ProbeEdge>,
}

impl<const A: usize> ProbeDrive<A> {
    /// Creates a latch that is not armed.
    #[must_use]
    pub const fn new() -> Self {
        let arming = ProbeArming { input: 0, active: false, filter_periods: 0 };
        Self { arming, state: State::Idle, with_level: 0, without_level: 0, edge: None }
    }

    /// Arms the latch. The machine is at rest.
    pub const fn arm(&mut self, arming: ProbeArming) {
        *self = Self { arming, state: State::Armed { earlier: [0; A] }, ..Self::new() };
    }

    /// Returns what the latch holds.
    #[must_use]
    pub const fn latch(&self) -> ProbeLatch<A> {
        match self.state {
            State::Idle => ProbeLatch::Idle,
            State::Armed { .. } => ProbeLatch::Armed,
            State::Edge(touch) => ProbeLatch::Edge(touch),
            State::Touched(touch) => ProbeLatch::Touched(touch),
        }
    }

    /// Returns the edge that is kept since the last observation, as seen from the end of its period.
    #[must_use]
    pub const fn edge(&self) -> Option<ProbeEdge> {
        self.edge
    }

    /// Whether the latch is armed: a probing move.
    #[must_use]
    pub const fn is_armed(&self) -> bool {
        !matches!(self.state, State::Idle)
    }

    /// Returns the arming, until the probe has touched.
    #[must_use]
    pub const fn awaited(&self) -> Option<ProbeArming> {
        if self.is_armed() && !self.has_touched() { Some(self.arming) } else { None }
    }

    /// Whether the probe has touched, so that the machine stays at rest.
    #[must_use]
    pub const fn has_touched(&self) -> bool {
        matches!(self.state, State::Touched(_))
    }

    /// Observes the inputs, `probe`, at the end of the period with these increments, which ended at `counts`.
    pub fn observe(&mut self, active: u16, probe: ProbeReading, counts: &[i64; A], increments: &[i32; A]) {
        self.edge = None;
        let ProbeArming { input, active: awaited, filter_periods } = self.arming;
        let has_level = (active >> (input & 15) & 1 == 1) == awaited;
        if let State::Armed { earlier } = &mut self.state {
            let earlier = core::mem::replace(earlier, *increments);
            if has_level || probe.first_change.is_some() {
                let part = probe.first_change.unwrap_or(u16::MAX);
                let edge = ProbeEdge { is_period_earlier: probe.is_period_behind, part };
                self.state = State::Edge(edge.touch(counts, increments, &earlier));
                (self.edge, self.with_level, self.without_level) = (Some(edge), 0, 0);
            }
        }
        let State::Edge(touch) = self.state else { return };
        if has_level {
            (self.with_level, self.without_level) = (self.with_level.saturating_add(1), 0);
        } else {
            (self.with_level, self.without_level) = (0, self.without_level.saturating_add(1));
        }
        if filter_periods == 0 || self.with_level > filter_periods {
            self.state = State::Touched(touch);
        } else if self.without_level > filter_periods {
            self.state = State::Armed { earlier: *increments };
        }
    }
}

impl<const A: usize> Default for ProbeDrive<A> {
    fn default() -> Self {
        Self::new()
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

    fn now(first_change: Option<u16>) -> ProbeReading {
        ProbeReading { first_change, is_period_behind: false }
    }

    /// Where the pins are a period behind, the touch is what they had made, not what has been counted meanwhile.
    #[test]
    fn a_reading_of_the_period_before_counts_what_was_emitted_in_that() {
        let behind = |first_change| ProbeReading { first_change, is_period_behind: true };
        for (change, touch) in [(Some(0), 0), (Some(1 << 15), 5), (None, 10)] {
            let mut latch = armed(0);
            latch.observe(0, behind(None), &[10], &[10]);
            latch.observe(PROBE, behind(change), &[30], &[20]);
            assert_eq!(latch.latch(), ProbeLatch::Touched([touch]));
            let edge = latch.edge().expect("it was seen now");
            assert_eq!((edge.is_period_earlier, edge.touch(&[30], &[20], &[10])), (true, [touch]));
        }
    }

    /// Observes levels of periods of ten pulses each, with the part in which each changed first.
    fn observed(latch: &mut ProbeDrive<1>, levels: &[(bool, Option<u16>)]) -> Vec<ProbeLatch<1>> {
        let observe = |(period, &(level, change)): (usize, &(bool, Option<u16>))| {
            let active = if level { PROBE } else { 0 };
            latch.observe(active, now(change), &[10 * (period as i64 + 1)], &[10]);
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
        back.observe(0, now(Some(1 << 15)), &[-10], &[-10]);
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
        latch.observe(u16::MAX, now(Some(3)), &[10], &[10]);
        assert_eq!((latch.latch(), latch.edge()), (ProbeLatch::Idle, None));
    }
}
