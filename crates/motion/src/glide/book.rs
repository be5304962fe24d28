//! Glides that were found already.
//!
//! Invariant: what is looked up is what would be found anew, so that the path depends on the program alone. The book is bounded.

use std::collections::HashMap;

use crate::glide::optimum::{Found, Optimiser, stopping_time};
use crate::glide::ramp::Ramps;
use crate::glide::tracks::{FarEnd, Tracks};
use crate::limits::AxisLimits;

/// Glides by the tracks they belong to; it keeps the memory of the search.
#[derive(Debug, Default)]
pub(crate) struct Book {
    found: HashMap<Vec<u64>, Option<Ramps>>,
    optimiser: Optimiser,
}

/// Entries after which the book is begun anew.
const MOST: usize = 1 << 14;
/// Tracks are looked up with lengths rounded down to this ratio …
const LENGTHS: f64 = 1.1;
/// … and counted as this many times the way that their speed takes to stop, if they are longer.
const LONG: f64 = 2.2;
/// Directions are looked up to this.
const DIRECTIONS: f64 = 1e-6;
/// Durations that are tried, as shares of the longest.
const SHARES: [f64; 4] = [1.0, 0.84, 0.7, 0.5];

impl Book {
    /// The glide for these tracks; `None` where stopping is faster.
    pub(crate) fn glide<const A: usize>(&mut self, tracks: &Tracks<A>, axes: &AxisLimits<A>) -> Option<Ramps> {
        let rounded = rounded(tracks);
        let key = key(&rounded);
        let found = match self.found.get(&key) {
            Some(found) => *found,
            None => {
                if self.found.len() >= MOST {
                    self.found.clear();
                }
                let found = search(&mut self.optimiser, &rounded, axes);
                self.found.insert(key, found);
                found
            }
        };
        let ramps = found?;
        // Rounding of directions may have taken a little too much.
        let taken = ramps.taken(tracks, axes);
        Some(if taken > 1.0 { ramps.scaled((1.0 - 1e-12) / taken) } else { ramps })
    }
}

/// The tracks as they are looked up.
fn rounded<const A: usize>(tracks: &Tracks<A>) -> Tracks<A> {
    let mut rounded = *tracks;
    for track in &mut rounded.pair {
        let limits = track.limits;
        let long = LONG * limits.v * (limits.v / limits.a + limits.a / limits.j);
        let steps = (track.length.min(long).ln() / LENGTHS.ln()).floor();
        track.length = (steps * LENGTHS.ln()).exp();
        if track.length > 0.9 * long / LENGTHS {
            track.far_end = FarEnd::Rest;
        }
        track.direction = track.direction.map(|x| (x / DIRECTIONS).round() * DIRECTIONS);
    }
    rounded
}

fn key<const A: usize>(tracks: &Tracks<A>) -> Vec<u64> {
    let mut key = Vec::with_capacity(2 * A + 7);
    key.push(tracks.tolerance.to_bits());
    for track in &tracks.pair {
        key.extend(track.direction.map(|x| (x / DIRECTIONS).round() as i64 as u64));
        key.push(track.length.to_bits());
        key.push(track.feed.to_bits());
        key.push(u64::from(track.far_end == FarEnd::Rest));
    }
    key
}

/// The best of several durations.
fn search<const A: usize>(optimiser: &mut Optimiser, tracks: &Tracks<A>, axes: &AxisLimits<A>) -> Option<Ramps> {
    let stop = stopping_time(tracks)?;
    let [one, two] = tracks.pair.map(|track| track.limits);
    let (v, a, j) = (one.v.max(two.v), one.a.min(two.a), one.j.min(two.j));
    let longest = (2.8 * a / j).min(0.42 * stop).min(2.5 * (v / j).sqrt());
    let mut best: Option<Found> = None;
    for share in SHARES {
        let found = optimiser.find(tracks, axes, share * longest, None);
        if let Some(found) = found
            && best.is_none_or(|best| found.time < best.time)
        {
            best = Some(found);
        }
    }
    best.filter(|best| best.time < stop * (1.0 - 1e-6)).map(|best| best.ramps)
}
