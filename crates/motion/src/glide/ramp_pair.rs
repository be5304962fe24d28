//! The two ramps that make a glide: how the motion on one track fades out while that on the next one fades in.
//!
//! A glide is interpolated as a vector (SMO-7): during it, the place is C − e₁(t)·u₁ + e₂(t)·u₂, with the corner C, the
//! directions u of the tracks, what remains of the first track e₁ and what is done of the second e₂. Both are the same
//! kind of function, one of them run backward in time: first at rest at 0, then moving away from the corner faster and
//! faster. Time counts from the middle of the glide; before it the first track's tolerance applies, after it the
//! second's.
//!
//! Invariant: a ramp begins at rest at place 0; its jerk is constant in each cell. Everything about a glide is linear
//! in its jerks, so a glide that is scaled down stays within every limit that it was within.

use crate::glide::tracks::{Track, Tracks};
use crate::limits::AxisLimits;
use crate::profile::KinematicState;

/// Cells of constant jerk in a ramp, half of them on each side of the middle.
pub(crate) const CELLS: usize = 12;
/// Places of each cell at which the distance from the nearer track is checked. Between four of them a glide was seen to
/// be 1.4 % further away; that share falls with the square of their number.
const CHECKED: usize = 8;
/// Share of the tolerance that may be used where it is checked, to cover the places between.
const BETWEEN: f64 = 0.995;
/// Cells before the middle.
pub(crate) const HALF: usize = CELLS / 2;

/// Share of the jerk that a track has next to a glide, where it is the end of a rounding.
const JERK_OUTSIDE: f64 = 0.9;

/// One track's share of a glide, from rest outward: jerk along the track in each cell, mm/s³.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Ramp(pub(crate) [f64; CELLS]);

impl Ramp {
    /// States at the borders of the cells.
    pub(crate) fn nodes(&self, cell: f64) -> [KinematicState; CELLS + 1] {
        let mut nodes = [KinematicState::default(); CELLS + 1];
        for k in 0..CELLS {
            nodes[k + 1] = nodes[k].after(self.0[k], cell);
        }
        nodes
    }
}

/// A glide: both ramps and their common time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct RampPair {
    /// Duration of a cell, s.
    pub(crate) cell: f64,
    /// Ramps of the track before the junction, run backward, and of the one after it.
    pub(crate) pair: [Ramp; 2],
}

impl RampPair {
    /// Duration of the glide, s.
    pub(crate) fn duration(&self) -> f64 {
        CELLS as f64 * self.cell
    }

    /// State in which the glide leaves the corner on each track: place, speed and acceleration away from it.
    pub(crate) fn ends(&self) -> [KinematicState; 2] {
        self.pair.map(|ramp| ramp.nodes(self.cell)[CELLS])
    }

    /// Both ramps with every jerk multiplied by `factor`.
    pub(crate) fn scaled(&self, factor: f64) -> Self {
        Self { cell: self.cell, pair: self.pair.map(|ramp| Ramp(ramp.0.map(|jerk| jerk * factor))) }
    }

    /// Largest share of any limit that the glide uses; above 1 it is illegal.
    pub(crate) fn used_share<const A: usize>(&self, tracks: &Tracks<A>, axes: &AxisLimits<A>) -> f64 {
        let nodes = self.pair.map(|ramp| ramp.nodes(self.cell));
        let motion = (0..=CELLS).fold(0.0, |most: f64, k| {
            let (p, q) = (nodes[0][CELLS - k], nodes[1][k]);
            let most = most.max(self.used_at(p, q, tracks, axes));
            if k == CELLS { most } else { most.max(self.used_within(k, p, q, tracks, axes)) }
        });
        motion.max(self.used_of_tolerance(&nodes, tracks)).max(self.used_outside(&nodes, tracks))
    }

    /// Share of each track's speed limit that is used next to the glide. The acceleration with which the glide leaves
    /// the corner comes from, and leads to, a speed that is higher than its own. If that were above the limit, no plan
    /// would lead into the glide.
    fn used_outside<const A: usize>(&self, nodes: &[[KinematicState; CELLS + 1]; 2], tracks: &Tracks<A>) -> f64 {
        nodes.iter().zip(&tracks.pair).fold(0.0, |most: f64, (nodes, Track { limits, .. })| {
            let KinematicState { v, a, .. } = nodes[CELLS];
            most.max((v + 0.5 * a.max(0.0) * a / (JERK_OUTSIDE * limits.j)) / limits.v)
        })
    }

    /// Share of the tolerance that the glide uses.
    pub(crate) fn used_tolerance<const A: usize>(&self, tracks: &Tracks<A>) -> f64 {
        self.used_of_tolerance(&self.pair.map(|ramp| ramp.nodes(self.cell)), tracks)
    }

    /// Share of velocity and acceleration that is used where both ramps are in these states.
    fn used_at<const A: usize>(
        &self,
        p: KinematicState,
        q: KinematicState,
        tracks: &Tracks<A>,
        axes: &AxisLimits<A>,
    ) -> f64 {
        let [u, w] = tracks.pair.map(|track| track.direction);
        (0..A).fold(0.0, |most: f64, i| {
            let acceleration = (q.a * w[i] - p.a * u[i]).abs() / axes.a[i];
            let velocity = (p.v * u[i] + q.v * w[i]).abs() / axes.v[i];
            most.max(acceleration).max(velocity)
        })
    }

    /// Share of velocity, jerk and feed that is used within cell `k`, which the ramps enter in these states.
    fn used_within<const A: usize>(
        &self,
        k: usize,
        p: KinematicState,
        q: KinematicState,
        tracks: &Tracks<A>,
        axes: &AxisLimits<A>,
    ) -> f64 {
        let [u, w] = tracks.pair.map(|track| track.direction);
        let (j_p, j_q) = (self.pair[0].0[CELLS - 1 - k], self.pair[1].0[k]);
        let mut most = 0.0f64;
        for i in 0..A {
            let (j, a) = (j_p * u[i] + j_q * w[i], q.a * w[i] - p.a * u[i]);
            most = most.max(j.abs() / axes.j[i]);
            // The velocity turns inside the cell.
            let t = -a / j;
            if t > 0.0 && t < self.cell {
                most = most.max((p.v * u[i] + q.v * w[i] + 0.5 * t * a).abs() / axes.v[i]);
            }
        }
        let feed = tracks.pair[usize::from(k >= HALF)].feed;
        for part in [0.0, 0.25, 0.5, 0.75] {
            let t = self.cell * part;
            // The first ramp is run backward.
            let (back, q) = (KinematicState { a: -p.a, ..p }.after(j_p, t), q.after(j_q, t));
            let speed = (0..A).map(|i| (back.v * u[i] + q.v * w[i]).powi(2)).sum::<f64>().sqrt();
            most = most.max(speed / feed);
        }
        most
    }

    /// Share of the tolerance that is used: before the middle by the second track, after it by the first, and at the
    /// corner itself, which the path must pass within the tolerance.
    fn used_of_tolerance<const A: usize>(&self, nodes: &[[KinematicState; CELLS + 1]; 2], tracks: &Tracks<A>) -> f64 {
        let [u, w] = tracks.pair.map(|track| track.direction);
        let (p, q) = (nodes[0][HALF].s, nodes[1][HALF].s);
        let missed = (0..A).map(|i| (q * w[i] - p * u[i]).powi(2)).sum::<f64>().sqrt();
        let away = self.pair.iter().zip(nodes).fold(0.0, |most: f64, (ramp, nodes)| {
            nodes.iter().zip(&nodes[1..]).zip(&ramp.0).take(HALF).fold(most, |most, ((from, to), jerk)| {
                most.max(to.s.abs()).max(turning_places(*from, *jerk, self.cell))
            })
        });
        (missed / tracks.tolerance).max(away / tracks.band()).max(self.used_beyond_corner(nodes, tracks))
    }

    /// Share of the tolerance that the distance from the nearer track uses, each track ending in the corner: in a sharp
    /// corner the swing of one ramp may lead beyond the end of the other's track.
    fn used_beyond_corner<const A: usize>(&self, nodes: &[[KinematicState; CELLS + 1]; 2], tracks: &Tracks<A>) -> f64 {
        let [u, w] = tracks.pair.map(|track| track.direction);
        let mut most = 0.0f64;
        for k in 0..CELLS {
            let (j_p, j_q) = (self.pair[0].0[CELLS - 1 - k], self.pair[1].0[k]);
            let p = nodes[0][CELLS - k];
            for part in 1..=CHECKED {
                let t = self.cell * part as f64 / CHECKED as f64;
                let p = KinematicState { v: -p.v, ..p }.after(-j_p, t).s;
                let q = nodes[1][k].after(j_q, t).s;
                let offset: [f64; A] = std::array::from_fn(|i| q * w[i] - p * u[i]);
                let before = u.iter().zip(offset).map(|(u, x)| u * x).sum::<f64>().min(0.0);
                let after = w.iter().zip(offset).map(|(w, x)| w * x).sum::<f64>().max(0.0);
                let off = |direction: [f64; A], along: f64| {
                    offset.iter().zip(direction).map(|(x, d)| (x - along * d).powi(2)).sum::<f64>()
                };
                most = most.max(off(u, before).min(off(w, after)));
            }
        }
        most.sqrt() / (BETWEEN * tracks.tolerance)
    }
}

/// Largest distance from 0 at which the motion turns within a cell.
fn turning_places(from: KinematicState, jerk: f64, cell: f64) -> f64 {
    let root = (from.a * from.a - 2.0 * jerk * from.v).max(0.0).sqrt();
    [(-from.a - root) / jerk, (-from.a + root) / jerk]
        .into_iter()
        .filter(|t| *t > 0.0 && *t < cell)
        .fold(0.0, |most, t| most.max(from.after(jerk, t).s.abs()))
}
