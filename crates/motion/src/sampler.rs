//! The part of the plan that emission samples: a phase of a span, or a cell of a glide, with all values that a sample
//! needs.
//!
//! Invariant: within it motion is one cubic of time, and a sample up to `until` needs nothing else.

use crate::curve::Derivatives;
use crate::glide::glide_segment::GlideSample;
use crate::profile::KinematicState;

/// Phase of the front span that contains the last sample.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PhaseSampler {
    pub(crate) number: usize,
    /// Samples up to this time after the start of the span are in the phase, s; below any time where no span is in
    /// front.
    pub(crate) until: f64,
    /// Start of the phase, s.
    pub(crate) since: f64,
    /// State at its start.
    pub(crate) start: KinematicState,
    pub(crate) jerk: f64,
    /// A sixth of the jerk: saves a division.
    pub(crate) sixth: f64,
    /// Jerk over the speed where that is constant instead of the jerk, 1/s²; otherwise 0.
    pub(crate) growth: f64,
    /// Number of the piece in which the span ends.
    pub(crate) last: u64,
}

impl PhaseSampler {
    pub(crate) const NONE: Self = Self {
        number: 0,
        until: f64::MIN,
        since: 0.0,
        start: KinematicState::moving(0.0, 0.0),
        jerk: 0.0,
        sixth: 0.0,
        growth: 0.0,
        last: 0,
    };

    /// State at time `t` after the start of the span.
    #[inline]
    pub(crate) fn at(&self, t: f64) -> KinematicState {
        let (t, KinematicState { s, v, a }) = (t - self.since, self.start);
        if self.growth != 0.0 {
            return self.start.after_growth(self.growth, t);
        }
        KinematicState {
            s: s + t * (v + t * (0.5 * a + t * self.sixth)),
            v: v + t * (a + 0.5 * t * self.jerk),
            a: a + t * self.jerk,
        }
    }
}

/// Cell of the front glide that contains the last sample.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CellSampler<const A: usize> {
    pub(crate) number: usize,
    /// Samples up to this time after the start of the glide are in the cell, s; below any time where no glide is in
    /// front.
    pub(crate) until: f64,
    /// Start of the cell, s.
    pub(crate) since: f64,
    /// Position and its derivatives by time at its start.
    pub(crate) start: GlideSample<A>,
    pub(crate) tag: u32,
}

impl<const A: usize> CellSampler<A> {
    pub(crate) const NONE: Self = Self {
        number: 0,
        until: f64::MIN,
        since: 0.0,
        start: GlideSample {
            position: [0.0; A],
            by_time: Derivatives { first: [0.0; A], second: [0.0; A], third: [0.0; A] },
        },
        tag: 0,
    };

    /// Sample at time `t` after the start of the glide.
    #[inline]
    pub(crate) fn at(&self, t: f64) -> GlideSample<A> {
        let (t, GlideSample { position, by_time: Derivatives { first, second, third } }) =
            (t - self.since, &self.start);
        let sixth = t * (1.0 / 6.0);
        GlideSample {
            position: std::array::from_fn(|i| position[i] + t * (first[i] + t * (0.5 * second[i] + sixth * third[i]))),
            by_time: Derivatives {
                first: std::array::from_fn(|i| first[i] + t * (second[i] + 0.5 * t * third[i])),
                second: std::array::from_fn(|i| second[i] + t * third[i]),
                third: *third,
            },
        }
    }
}
