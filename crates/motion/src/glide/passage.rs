//! A glide in its place: what the machine does while one track dies away and the next one begins (SMO-7).
//!
//! Invariant: it begins where, and as fast as, the motion on the first track hands over, and ends so on the second.

use crate::blend::size;
use crate::curve::{Curve, Derivatives};
use crate::glide::ramp::{CELLS, HALF, Ramps};
use crate::glide::tracks::Tracks;
use crate::limits::AxisLimits;
use crate::profile::State;

/// A glide at a corner.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Passage<const A: usize> {
    /// Where the tracks meet, mm.
    pub(crate) corner: [f64; A],
    /// Directions of the tracks.
    pub(crate) directions: [[f64; A]; 2],
    /// Program lines of the tracks.
    pub(crate) tags: [u32; 2],
    pub(crate) ramps: Ramps,
    nodes: [[State; CELLS + 1]; 2],
    /// Tracks of which one is curved, each with the place of the corner on it.
    curves: Option<[(Curve<A>, f64); 2]>,
}

/// Samples of a cell in which a glide on curves is compared with its limits, and the share of them that it may take: what lies
/// between the samples is that near.
const SAMPLES: (u32, f64) = (6, 0.97);

/// Position and its derivatives by time, per axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moment<const A: usize> {
    pub(crate) position: [f64; A],
    pub(crate) by_time: Derivatives<A>,
}

impl<const A: usize> Passage<A> {
    pub(crate) fn new(corner: [f64; A], directions: [[f64; A]; 2], tags: [u32; 2], ramps: Ramps) -> Self {
        Self { corner, directions, tags, ramps, nodes: ramps.pair.map(|ramp| ramp.nodes(ramps.cell)), curves: None }
    }

    /// The same on curved tracks, each with the place of the corner on it.
    pub(crate) fn on(self, curves: [(Curve<A>, f64); 2]) -> Self {
        Self { curves: Some(curves), ..self }
    }

    /// The largest share of any limit that a glide on curves takes, by samples; above 1 it is illegal.
    pub(crate) fn taken(&self, tracks: &Tracks<A>, axes: &AxisLimits<A>) -> f64 {
        let (samples, allowed) = SAMPLES;
        let mut most = 0.0f64;
        for cell in 0..CELLS {
            for sample in 0..=samples {
                let t = (cell as f64 + f64::from(sample) / f64::from(samples)) * self.ramps.cell;
                let Moment { position, by_time } = self.at(cell, t);
                for i in 0..A {
                    most = most.max(by_time.first[i].abs() / axes.v[i]);
                    most = most.max(by_time.second[i].abs() / axes.a[i]).max(by_time.third[i].abs() / axes.j[i]);
                }
                let side = usize::from(cell >= HALF);
                most = most.max(size(&by_time.first) / tracks.pair[side].feed);
                most = most.max(self.distance(&position, side, cell, t) / tracks.tolerance);
            }
        }
        let middle = self.at(HALF, self.ramps.cell * HALF as f64).position;
        let missed = size(&std::array::from_fn::<f64, A, _>(|i| middle[i] - self.corner[i]));
        most.max(missed / tracks.tolerance) / allowed
    }

    /// Distance of `position` from track `side`, at time `t` in cell `cell`.
    fn distance(&self, position: &[f64; A], side: usize, cell: usize, t: f64) -> f64 {
        let Some(curves) = &self.curves else { return 0.0 };
        let (curve, corner) = &curves[side];
        let states = self.states(cell, t);
        let mut s = if side == 0 { corner - states[0].s } else { corner + states[1].s };
        let mut off = [0.0; A];
        for _ in 0..3 {
            let (at, direction) = (curve.at(s), curve.derivatives(s).first);
            off = std::array::from_fn(|i| position[i] - at[i]);
            s += off.iter().zip(direction).map(|(a, b)| a * b).sum::<f64>();
        }
        size(&off)
    }

    /// How far, how fast and how hard both ramps are from the corner, by time, `t` seconds after the start in cell `cell`.
    fn states(&self, cell: usize, t: f64) -> [State; 2] {
        let t = t - cell as f64 * self.ramps.cell;
        let [one, two] = &self.nodes;
        let (j_one, j_two) = (self.ramps.pair[0].0[CELLS - 1 - cell], self.ramps.pair[1].0[cell]);
        // The first ramp runs backward.
        let one = one[CELLS - cell];
        [State { s: one.s, v: -one.v, a: one.a }.after(-j_one, t), two[cell].after(j_two, t)]
    }

    /// Duration in s.
    pub(crate) fn duration(&self) -> f64 {
        self.ramps.duration()
    }

    /// Program line of the track that counts at time `t`.
    pub(crate) fn tag(&self, t: f64) -> u32 {
        self.tags[usize::from(t > HALF as f64 * self.ramps.cell)]
    }

    /// Number of the cell that holds time `t`.
    pub(crate) fn cell(&self, t: f64) -> usize {
        ((t / self.ramps.cell) as usize).min(CELLS - 1)
    }

    /// Where the machine is, and how it moves, `t` seconds after the start, by the jerks of cell `cell`.
    pub(crate) fn at(&self, cell: usize, t: f64) -> Moment<A> {
        let (j_one, j_two) = (self.ramps.pair[0].0[CELLS - 1 - cell], self.ramps.pair[1].0[cell]);
        let [back, two] = self.states(cell, t);
        if let Some(curves) = &self.curves {
            return self.on_curves(curves, back, -j_one, two, j_two);
        }
        let [u, w] = self.directions;
        let both = |p: f64, q: f64| -> [f64; A] { std::array::from_fn(|i| q * w[i] - p * u[i]) };
        let way = both(back.s, two.s);
        Moment {
            position: std::array::from_fn(|i| self.corner[i] + way[i]),
            by_time: Derivatives {
                first: both(back.v, two.v),
                second: both(back.a, two.a),
                third: both(-j_one, j_two),
            },
        }
    }

    /// The same on curves: what is left of the first, by time, and what is done of the second.
    fn on_curves(
        &self,
        curves: &[(Curve<A>, f64); 2],
        left: State,
        j_left: f64,
        done: State,
        j_done: f64,
    ) -> Moment<A> {
        let [(first, end), (second, start)] = curves;
        let to = (end - left.s, [-left.v, -left.a, -j_left]);
        let from = (start + done.s, [done.v, done.a, j_done]);
        let (one, two) = (along(first, to), along(second, from));
        let both = |a: [f64; A], b: [f64; A]| -> [f64; A] { std::array::from_fn(|i| a[i] + b[i]) };
        let position = both(one.position, two.position);
        Moment {
            position: std::array::from_fn(|i| position[i] - self.corner[i]),
            by_time: Derivatives {
                first: both(one.by_time.first, two.by_time.first),
                second: both(one.by_time.second, two.by_time.second),
                third: both(one.by_time.third, two.by_time.third),
            },
        }
    }
}

/// Motion along a curve at place `s`, with these speed, acceleration and jerk along it.
fn along<const A: usize>(curve: &Curve<A>, (s, [v, a, j]): (f64, [f64; 3])) -> Moment<A> {
    let Derivatives { first, second, third } = curve.derivatives(s);
    Moment {
        position: curve.at(s),
        by_time: Derivatives {
            first: first.map(|p| p * v),
            second: std::array::from_fn(|i| first[i] * a + second[i] * v * v),
            third: std::array::from_fn(|i| first[i] * j + 3.0 * second[i] * v * a + third[i] * v * v * v),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glide::ramp::Ramp;
    use proptest::prelude::*;

    proptest! {
        /// Position, velocity and acceleration are continuous through all cells and belong together.
        #[test]
        fn a_passage_is_smooth(jerks in prop::collection::vec(-1e4..1e4f64, 2 * CELLS), cell in 0.001..0.01f64) {
            let ramp = |from: usize| Ramp(std::array::from_fn(|k| jerks[from + k]));
            let ramps = Ramps { cell, pair: [ramp(0), ramp(CELLS)] };
            let passage = Passage::new([1.0, 2.0], [[1.0, 0.0], [0.6, 0.8]], [1, 2], ramps);
            let [out, into] = ramps.ends();
            let (start, end) = (passage.at(0, 0.0), passage.at(CELLS - 1, passage.duration()));
            prop_assert!((start.position[0] - (1.0 - out.s)).abs() < 1e-12 && (start.position[1] - 2.0).abs() < 1e-12);
            prop_assert!((start.by_time.first[0] - out.v).abs() < 1e-9 && (start.by_time.second[0] + out.a).abs() < 1e-9);
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
