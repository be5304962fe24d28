//! Two adjacent tracks and the limits of a glide between them (SMO-1, SMO-3).
//!
//! Invariant: tracks are straight where they meet, their directions have length 1 over the linear axes, and they are
//! not parallel.

use crate::limits::AxisLimits;
use crate::profile::PathLimits;

/// How a track continues at its far end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FarEnd {
    /// At rest there.
    Rest,
    /// Into another track: half of the length belongs to that junction.
    Moving,
}

/// One of the two tracks, seen from the junction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Track<const A: usize> {
    /// Direction of motion.
    pub(crate) direction: [f64; A],
    /// Length, mm.
    pub(crate) length: f64,
    /// How it continues.
    pub(crate) far_end: FarEnd,
    /// Requested speed, mm/s.
    pub(crate) feed: f64,
    /// Limits of motion along it alone.
    pub(crate) limits: PathLimits,
}

impl<const A: usize> Track<A> {
    /// A track in `direction`; its limits are those of the axes.
    pub(crate) fn new(direction: [f64; A], length: f64, far_end: FarEnd, feed: f64, axes: &AxisLimits<A>) -> Self {
        let mut limits = PathLimits { v: feed.min(axes.path_v), a: f64::MAX, j: f64::MAX };
        for (i, part) in direction.map(|part| part.abs().max(1e-12)).into_iter().enumerate() {
            limits.v = limits.v.min(axes.v[i] / part);
            limits.a = limits.a.min(axes.a[i] / part);
            limits.j = limits.j.min(axes.j[i] / part);
        }
        Self { direction, length, far_end, feed: feed.min(axes.path_v), limits }
    }
}

/// The two tracks of a junction, before and after it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tracks<const A: usize> {
    /// Before and after the junction.
    pub(crate) pair: [Track<A>; 2],
    /// Largest distance of the motion from the tracks, mm.
    pub(crate) tolerance: f64,
}

impl<const A: usize> Tracks<A> {
    /// Sine of the angle between the directions.
    pub(crate) fn sine(&self) -> f64 {
        let [one, two] = self.pair.map(|track| track.direction);
        let dot: f64 = one.iter().zip(two).map(|(a, b)| a * b).sum();
        one.iter().zip(two).map(|(a, b)| (b - dot * a) * (b - dot * a)).sum::<f64>().sqrt()
    }

    /// Largest distance of one track's part while the other one's tolerance applies, mm.
    pub(crate) fn band(&self) -> f64 {
        self.tolerance / self.sine()
    }
}
