//! The glide's acceleration (SMO-6): how fast the velocity may change from that of one track to that of the other.
//!
//! Both tracks' parts follow one S-curve in time: the acceleration rises, is constant and falls again, and what the
//! first track loses the second gains. So the velocity changes along a straight line from v₀·u₁ to v₁·u₂, and each axis
//! has the S-curve times its own change.
//!
//! Invariant: no axis uses more than its acceleration and jerk, and of all paces on the cells of a ramp it is the
//! shortest.

use crate::glide::ramp_pair::{CELLS, HALF, Ramp, RampPair};
use crate::glide::tracks::Tracks;
use crate::limits::AxisLimits;

/// An S-curve in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pace {
    /// Duration of a cell, s.
    cell: f64,
    /// Number of cells in which the acceleration rises, and in which it falls.
    rising: usize,
}

impl Pace {
    /// The shortest pace for these speeds at the ends of the glide, mm/s.
    pub(super) fn shortest<const A: usize>(speeds: [f64; 2], tracks: &Tracks<A>, axes: &AxisLimits<A>) -> Self {
        let [u, w] = tracks.pair.map(|track| track.direction);
        let change: [f64; A] = std::array::from_fn(|i| (speeds[1] * w[i] - speeds[0] * u[i]).abs());
        let with = |rising: usize| {
            // Acceleration and jerk for a change by 1 in cells of 1 s.
            let acceleration = 1.0 / (CELLS - rising) as f64;
            let jerk = acceleration / rising as f64;
            let cell = (0..A).fold(0.0, |cell: f64, i| {
                cell.max(change[i] * acceleration / axes.a[i]).max((change[i] * jerk / axes.j[i]).sqrt())
            });
            Self { cell, rising }
        };
        (2..=HALF).map(with).fold(with(1), |best, pace| if pace.cell < best.cell { pace } else { best })
    }

    /// Ramps between rest and these speeds.
    pub(super) fn ramps(self, speeds: [f64; 2]) -> RampPair {
        let Self { cell, rising } = self;
        let pair = speeds.map(|speed| {
            let jerk = speed / (rising * (CELLS - rising)) as f64 / (cell * cell);
            Ramp(std::array::from_fn(|k| match k {
                k if k < rising => jerk,
                k if k >= CELLS - rising => -jerk,
                _ => 0.0,
            }))
        });
        RampPair { cell, pair }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glide::tracks::{FarEnd, Track};
    use crate::limits::MachineLimits;
    use proptest::prelude::*;

    proptest! {
        /// The velocity changes from one end's to the other's, with zero acceleration at both; the limits hold, and one
        /// of them is fully used.
        #[test]
        fn a_pace_keeps_the_limits_and_wastes_none(
            headings in [-3.0..3.0f64, 0.2..2.9f64], speeds in [0.1..90.0f64, 0.1..90.0f64], a in 100.0..1e4f64,
                j in 1e3..1e6f64,
        ) {
            let mut limits = MachineLimits::<3>::built_in();
            limits.acceleration_mm_s2[1] = a;
            limits.jerk_mm_s3[0] = j;
            let axes = limits.planned();
            let track = |heading: f64| Track::new([heading.cos(), heading.sin(), 0.0], 1e3, FarEnd::Rest, 1e6, &axes);
            let tracks = Tracks { pair: [track(headings[0]), track(headings[0] + headings[1])], tolerance: 1e6 };
            let ramps = Pace::shortest(speeds, &tracks, &axes).ramps(speeds);
            for (end, speed) in ramps.ends().into_iter().zip(speeds) {
                prop_assert!((end.v - speed).abs() < 1e-9 * speed && end.a.abs() < 1e-6);
                prop_assert!((end.s - 0.5 * speed * ramps.duration()).abs() < 1e-9 * end.s);
            }
            let (max_a, max_j) = (0..3).fold((0.0f64, 0.0f64), |(max_a, max_j), i| {
                let [u, w] = tracks.pair.map(|track| track.direction[i]);
                let nodes = ramps.pair.map(|ramp| ramp.nodes(ramps.cell));
                (0..CELLS).fold((max_a, max_j), |(max_a, max_j), k| {
                    let a = (nodes[1][k].a * w - nodes[0][CELLS - k].a * u).abs() / axes.a[i];
                    let j = (ramps.pair[1].0[k] * w + ramps.pair[0].0[CELLS - 1 - k] * u).abs() / axes.j[i];
                    (max_a.max(a), max_j.max(j))
                })
            });
            prop_assert!(max_a <= 1.0 + 1e-9 && max_j <= 1.0 + 1e-9);
            prop_assert!(max_a.max(max_j) >= 1.0 - 1e-9);
        }
    }
}
