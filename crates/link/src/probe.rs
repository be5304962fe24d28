//! The probe: arming its latch, and what the latch holds (PRB-1, PRB-2).
//!
//! Invariant: the touch is a number of whole pulses of each axis, between the counts at both ends of the control period
//! in which the edge occurred.

use retrace_core::fine::emitted_pulses;

/// Arms the latch for the move that begins at this place, while the machine is at rest. A new epoch disarms it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ProbeArming {
    /// The input of the probe.
    pub input: u8,
    /// Whether the move ends where the input becomes active, otherwise where it becomes inactive.
    pub active: bool,
    /// Control periods for which the level has to stay. 0: the first edge counts at once.
    pub filter_periods: u16,
}

/// State of the latch. While it is armed, the cursor moves forward only, and at most at the planned rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ProbeLatch<const A: usize> {
    /// No probing move.
    #[default]
    Idle,
    /// The edge is awaited.
    Armed,
    /// There was an edge with these counts; the level has not stayed for long enough yet.
    Edge([i64; A]),
    /// The counts at the edge. The card brakes and stays at rest until a new epoch.
    Touched([i64; A]),
}

/// When the probe's first edge was, as a card reports it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ProbeEdge {
    /// Whether it was in the control period before the last one: a step generator that plays a period while the next
    /// one is computed has the pins one period behind the counts.
    pub is_period_earlier: bool,
    /// Part of that period, in units of 2⁻¹⁶.
    pub part: u16,
}

impl ProbeEdge {
    /// Returns the counts at this edge. `counts`, `increments`: of the last control period; `earlier`: the increments
    /// of the one before.
    #[must_use]
    pub fn touch<const A: usize>(self, counts: &[i64; A], increments: &[i32; A], earlier: &[i32; A]) -> [i64; A] {
        if !self.is_period_earlier {
            return counts_at_edge(counts, increments, self.part);
        }
        let mut before = *counts;
        before.iter_mut().zip(increments).for_each(|(count, &increment)| *count -= i64::from(increment));
        counts_at_edge(&before, earlier, self.part)
    }
}

/// Returns the counts at an edge in the control period that ended with `counts` and had these increments. `part`: the
/// part of the period, in units of 2⁻¹⁶; a pulse of the same part counts as emitted.
#[must_use]
pub fn counts_at_edge<const A: usize>(counts: &[i64; A], increments: &[i32; A], part: u16) -> [i64; A] {
    let mut at_edge = *counts;
    for (count, &increment) in at_edge.iter_mut().zip(increments) {
        let pulses = increment.unsigned_abs().min(u32::from(u16::MAX)) as u16;
        let missing = i64::from(pulses - emitted_pulses(pulses, part));
        *count -= if increment < 0 { -missing } else { missing };
    }
    at_edge
}
