//! Cache of glides that were found before.
//!
//! A glide depends on the tracks' directions, lengths and feeds and on the tolerance. Similar tracks share one: they
//! are rounded, and brought into one order of axes, signs and sides, before the lookup. The glide that is found for
//! them is scaled down until it is legal on the tracks themselves, which costs little, as they are nearly the same.
//!
//! Invariant: a cached glide equals the one that a search would find, so that the path depends on the program alone.
//! The cache is bounded.

use std::collections::HashMap;

use crate::glide::optimum::{Effort, Optimiser, OptimiserOutcome, rest_time, stopping_time};
use crate::glide::ramp_pair::RampPair;
use crate::glide::tracks::{FarEnd, Track, Tracks};
use crate::limits::AxisLimits;
use crate::profile::KinematicState;

/// Glides by their tracks; it retains the memory of the search.
#[derive(Debug, Default)]
pub(crate) struct GlideCache {
    found: HashMap<Vec<i64>, Option<RampPair>>,
    optimiser: Optimiser,
}

/// Number of entries after which the cache is cleared: as many as fit into 2¹⁴ places of a hash map, which is full at
/// seven eighths. One more would double its memory.
const MAX_ENTRIES: usize = 7 << 11;
/// Lengths are rounded down to steps of this ratio: of tracks that continue, and of tracks that end at rest.
const LENGTHS: (f64, f64) = (1.25, 1.02);
/// A track counts as no longer than this many times the stopping distance from its speed, …
const LONG: f64 = 2.2;
/// … nor, if it continues, than this many times the other one.
const UNEQUAL: f64 = 3.0;
/// Tolerances are rounded down to steps of this ratio: merged lines have a little less than the others.
const TOLERANCES: f64 = 1.02;
/// Directions are rounded to this part of the turn, or a little less.
const DIRECTIONS: f64 = 12.0;
/// Duration that is tried, as a share of the longest …
const SHARE: f64 = 0.48;
/// … and those for two tracks from rest to rest, of which a program has few: first these, then around the best of them.
const SHARES_FROM_REST: [f64; 9] = [0.4, 0.5, 0.58, 0.64, 0.7, 0.77, 0.84, 0.92, 1.0];
const AROUND: [f64; 4] = [0.94, 0.97, 1.03, 1.06];

impl GlideCache {
    /// The glide for these tracks; `None` where stopping is faster.
    pub(crate) fn glide<const A: usize>(&mut self, tracks: &Tracks<A>, axes: &AxisLimits<A>) -> Option<RampPair> {
        let common = CanonicalTracks::of(tracks, axes);
        let found = match self.found.get(&common.key) {
            Some(found) => *found,
            None => {
                if self.found.len() >= MAX_ENTRIES {
                    self.found.clear();
                }
                let found = search(&mut self.optimiser, &common.tracks, &common.axes);
                self.found.insert(common.key, found);
                found
            }
        };
        let mut ramps = found?;
        if common.swapped {
            ramps.pair.swap(0, 1);
        }
        let taken = ramps.used_share(tracks, axes);
        Some(if taken > 1.0 { ramps.scaled((1.0 - 1e-12) / taken) } else { ramps })
    }
}

/// Tracks in the form that all similar tracks share.
struct CanonicalTracks<const A: usize> {
    tracks: Tracks<A>,
    axes: AxisLimits<A>,
    /// Whether the track before the junction stands for the one after it: the glide is run backward.
    swapped: bool,
    key: Vec<i64>,
}

impl<const A: usize> CanonicalTracks<A> {
    fn of(tracks: &Tracks<A>, axes: &AxisLimits<A>) -> Self {
        let [one, two] = &tracks.pair;
        let turn = one.direction.iter().zip(two.direction).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
        let grid = (turn / DIRECTIONS).log2().floor().exp2();
        let steps = |track: &Track<A>| track.direction.map(|x| (x / grid).round() as i64);
        let mut pairs: [_; A] = {
            let (u, w) = (steps(one), steps(two));
            std::array::from_fn(|i| (axes.limits_of(i), u[i], w[i]))
        };
        let lengths = [rounded(one, two.length), rounded(two, one.length)];
        let swapped =
            (lengths[1].0, lengths[1].1, two.feed.to_bits()) < (lengths[0].0, lengths[0].1, one.feed.to_bits());
        for (_, u, w) in &mut pairs {
            if swapped {
                std::mem::swap(u, w);
            }
            if (*u, *w) < (0, 0) {
                (*u, *w) = (-*u, -*w);
            }
        }
        pairs.sort_unstable();
        let sides = if swapped { [1, 0] } else { [0, 1] };
        let axes = axes.with(|i| pairs[i].0);
        let pair = [0, 1].map(|side| {
            let own = &tracks.pair[sides[side]];
            let steps: [i64; A] = std::array::from_fn(|i| if side == 0 { pairs[i].1 } else { pairs[i].2 });
            let size = steps.iter().map(|x| (x * x) as f64).sum::<f64>().sqrt();
            let (_, rest, length) = lengths[sides[side]];
            let far_end = if rest { FarEnd::Rest } else { FarEnd::Moving };
            Track::new(steps.map(|x| x as f64 / size), length, far_end, own.feed, &axes)
        });
        let tolerance = (tracks.tolerance.ln() / TOLERANCES.ln()).floor();
        let mut key = vec![tolerance as i64, grid.to_bits() as i64];
        key.extend(pairs.iter().flat_map(|(_, u, w)| [*u, *w]));
        for side in sides {
            key.extend([lengths[side].0, i64::from(lengths[side].1), tracks.pair[side].feed.to_bits() as i64]);
        }
        let tolerance = (tolerance * TOLERANCES.ln()).exp();
        Self { tracks: Tracks { pair, tolerance }, axes, swapped, key }
    }
}

/// Length of a track for the lookup, in steps and in mm, and whether it counts as ending at rest.
fn rounded<const A: usize>(track: &Track<A>, other: f64) -> (i64, bool, f64) {
    let limits = track.limits;
    let long = LONG * limits.v * (limits.v / limits.a + limits.a / limits.j);
    let (longest, ratio) = match track.far_end {
        FarEnd::Rest => (long, LENGTHS.1),
        FarEnd::Moving => (long.min(UNEQUAL * other), LENGTHS.0),
    };
    let steps = (track.length.min(longest).ln() / f64::ln(ratio)).floor();
    (steps as i64, track.far_end == FarEnd::Rest, (steps * f64::ln(ratio)).exp())
}

/// The best of several durations.
fn search<const A: usize>(optimiser: &mut Optimiser, tracks: &Tracks<A>, axes: &AxisLimits<A>) -> Option<RampPair> {
    let stop = stopping_time(tracks)?;
    let [one, two] = tracks.pair.map(|track| track.limits);
    let (v, a, j) = (one.v.max(two.v), one.a.min(two.a), one.j.min(two.j));
    // Time that the shorter track takes with stops; half of a track that continues counted as half of its time.
    let shorter = [0, 1].map(|side| {
        let half = if tracks.pair[side].far_end == FarEnd::Moving { 2.0 } else { 1.0 };
        half * rest_time(KinematicState::default(), tracks, side).unwrap_or(f64::MAX)
    });
    let longest = (2.8 * a / j).min(0.84 * shorter[0].min(shorter[1])).min(2.5 * (v / j).sqrt());
    let mut best: Option<OptimiserOutcome> = None;
    let mut attempt = |duration: f64, effort: Effort| {
        if let Some(found) = optimiser.find(tracks, axes, duration, effort)
            && best.is_none_or(|best| found.time < best.time)
        {
            best = Some(found);
        }
        best
    };
    let mut found = None;
    if tracks.pair.iter().all(|track| track.far_end == FarEnd::Rest) {
        for share in SHARES_FROM_REST {
            found = attempt(share * longest, Effort::THOROUGH);
        }
        let around = found?.ramps.duration();
        for share in AROUND {
            found = attempt(share * around, Effort::THOROUGH);
        }
    } else {
        found = attempt(SHARE * longest, Effort::QUICK);
    }
    found.filter(|best| best.time < stop * (1.0 - 1e-6)).map(|best| best.ramps)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::MachineLimits;
    use proptest::prelude::*;

    fn tracks(axes: &AxisLimits<3>, angles: [f64; 2], lengths: [f64; 2], rest: [bool; 2], tolerance: f64) -> Tracks<3> {
        let pair = [0, 1].map(|k| {
            let far_end = if rest[k] { FarEnd::Rest } else { FarEnd::Moving };
            Track::new([angles[k].cos(), angles[k].sin(), 0.0], lengths[k], far_end, 100.0, axes)
        });
        Tracks { pair, tolerance }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// A glide is legal and begins and ends where its tracks have space; turned by a right angle, mirrored or run
        /// backward the same tracks have the same glide.
        #[test]
        fn glides_are_legal_and_the_same_from_every_side(
            heading in -3.0..3.0f64, turn in 0.1..2.6f64, sizes in [-1.0..1.3f64, -1.0..1.3f64],
                rest in any::<[bool; 2]>(),
            tolerance in 0.003..0.1f64,
        ) {
            let axes = MachineLimits::built_in().planned();
            let lengths = sizes.map(|x| 10f64.powf(x));
            let own = tracks(&axes, [heading, heading + turn], lengths, rest, tolerance);
            let mut cache = GlideCache::default();
            let Some(ramps) = cache.glide(&own, &axes) else { return Ok(()) };
            prop_assert!(ramps.used_share(&own, &axes) <= 1.0);
            for (end, track) in ramps.ends().iter().zip(&own.pair) {
                prop_assert!(end.s > 0.0 && end.s <= track.length && end.v >= 0.0);
            }
            let quarter = std::f64::consts::FRAC_PI_2;
            let turned = tracks(&axes, [heading + quarter, heading + turn + quarter], lengths, rest, tolerance);
            prop_assert_eq!(cache.glide(&turned, &axes).map(|r| r.cell), Some(ramps.cell));
            let mirrored = tracks(&axes, [-heading, -heading - turn], lengths, rest, tolerance);
            prop_assert_eq!(cache.glide(&mirrored, &axes).map(|r| r.cell), Some(ramps.cell));
            let [one, two] = own.pair;
            let back = |track: Track<3>| Track { direction: track.direction.map(|x| -x), ..track };
            let backward = Tracks { pair: [back(two), back(one)], ..own };
            let reversed = cache.glide(&backward, &axes);
            if (lengths[0] - lengths[1]).abs() > 0.3 * lengths[0] {
                prop_assert_eq!(reversed.map(|r| r.cell), Some(ramps.cell));
            }
            prop_assert!(cache.found.len() <= 2);
        }
    }
}
