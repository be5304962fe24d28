//! A glide at its corner: the motion of the machine while one track fades out and the next one fades in (SMO-7).
//!
//! Invariant: it begins with the place and velocity of the motion on the first track, and ends with those on the
//! second.

use crate::curve::Derivatives;
use crate::glide::ramp_pair::{CELLS, HALF, RampPair};
use crate::piece::RAPID;
use crate::profile::KinematicState;

/// A glide at a corner.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GlideSegment<const A: usize> {
    /// Position where the tracks meet, mm.
    pub(crate) corner: [f64; A],
    /// Directions of the tracks.
    pub(crate) directions: [[f64; A]; 2],
    /// Program lines of the tracks.
    pub(crate) tags: [u32; 2],
    /// Requested speeds of the tracks, mm/s.
    feeds: [f64; 2],
    pub(crate) ramps: RampPair,
    nodes: [[KinematicState; CELLS + 1]; 2],
}

/// Position and its derivatives by time, for each axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GlideSample<const A: usize> {
    pub(crate) position: [f64; A],
    pub(crate) by_time: Derivatives<A>,
}

impl<const A: usize> GlideSegment<A> {
    pub(crate) fn new(
        corner: [f64; A],
        directions: [[f64; A]; 2],
        tags: [u32; 2],
        feeds: [f64; 2],
        ramps: RampPair,
    ) -> Self {
        Self { corner, directions, tags, feeds, ramps, nodes: ramps.pair.map(|ramp| ramp.nodes(ramps.cell)) }
    }

    /// Duration, s.
    pub(crate) fn duration(&self) -> f64 {
        self.ramps.duration()
    }

    /// Program line of the track in force at time `t`.
    pub(crate) fn tag(&self, t: f64) -> u32 {
        self.tags[self.track(t)]
    }

    /// Requested speed on the track in force at time `t`, mm/s.
    pub(crate) fn feed(&self, t: f64) -> f64 {
        self.feeds[self.track(t)]
    }

    /// Whether the motion on both sides is rapid.
    pub(crate) fn is_rapid(&self) -> bool {
        self.feeds == [RAPID; 2]
    }

    /// Number of the track in force at time `t`.
    fn track(&self, t: f64) -> usize {
        usize::from(t > HALF as f64 * self.ramps.cell)
    }

    /// Position and motion `t` seconds after the start, by the jerks of cell `cell`.
    pub(crate) fn at(&self, cell: usize, t: f64) -> GlideSample<A> {
        let t = t - cell as f64 * self.ramps.cell;
        let [one, two] = &self.nodes;
        let (j_one, j_two) = (self.ramps.pair[0].0[CELLS - 1 - cell], self.ramps.pair[1].0[cell]);
        // The first ramp runs backward.
        let one = one[CELLS - cell];
        let back = KinematicState { s: one.s, v: -one.v, a: one.a }.after(-j_one, t);
        let (two, [u, w]) = (two[cell].after(j_two, t), self.directions);
        let both = |p: f64, q: f64| -> [f64; A] { std::array::from_fn(|i| q * w[i] - p * u[i]) };
        let place = both(back.s, two.s);
        GlideSample {
            position: std::array::from_fn(|i| self.corner[i] + place[i]),
            by_time: Derivatives {
                first: both(back.v, two.v),
                second: both(back.a, two.a),
                third: both(-j_one, j_two),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glide::ramp_pair::Ramp;
    use proptest::prelude::*;

    proptest! {
        /// Position, velocity and acceleration are continuous through all cells and consistent.
        #[test]
        fn a_passage_is_smooth(jerks in prop::collection::vec(-1e4..1e4f64, 2 * CELLS), cell in 0.001..0.01f64) {
            let ramp = |from: usize| Ramp(std::array::from_fn(|k| jerks[from + k]));
            let ramps = RampPair { cell, pair: [ramp(0), ramp(CELLS)] };
            let passage = GlideSegment::new([1.0, 2.0], [[1.0, 0.0], [0.6, 0.8]], [1, 2], [10.0; 2], ramps);
            let [out, into] = ramps.ends();
            let (start, end) = (passage.at(0, 0.0), passage.at(CELLS - 1, passage.duration()));
            prop_assert!((start.position[0] - (1.0 - out.s)).abs() < 1e-12 && (start.position[1] - 2.0).abs() < 1e-12);
            prop_assert!((start.by_time.first[0] - out.v).abs() < 1e-9
                && (start.by_time.second[0] + out.a).abs() < 1e-9);
            prop_assert!((end.position[1] - (2.0 + 0.8 * into.s)).abs() < 1e-9);
            prop_assert!((end.by_time.first[0] - 0.6 * into.v).abs() < 1e-9);
            prop_assert!((end.by_time.second[1] - 0.8 * into.a).abs() < 1e-8);
            for k in 1..CELLS {
                let t = k as f64 * cell;
                let (a, b) = (passage.at(k - 1, t), passage.at(k, t));
                for i in 0..2 {
                    prop_assert!((a.position[i] - b.position[i]).abs() < 1e-12);
                    prop_assert!((a.by_time.first[i] - b.by_time.first[i]).abs() < 1e-9);
                    prop_assert!((a.by_time.second[i] - b.by_time.second[i]).abs() < 1e-8);
                    let h = 1e-3 * cell;
                    let slope = (passage.at(k, t + 2.0 * h).position[i] - b.position[i]) / (2.0 * h);
                    prop_assert!((slope - passage.at(k, t + h).by_time.first[i]).abs() < 1e-5);
                }
            }
        }
    }
}
