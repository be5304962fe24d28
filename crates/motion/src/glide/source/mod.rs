//! The source's own glide: as large as a set ratio, not as fast as possible (SMO-2 … SMO-7, with the parts of SMO-10).
//!
//! | part | where |
//! |---|---|
//! | ratio setting, pre-computation | `ratio` |
//! | planning, parameter, track adjustment | `track` |
//! | glide adjustment | `adjusted`, here |
//! | glide acceleration | `pace` |
//! | interpolation | `glide_segment`, outside this folder: one for both methods |
//!
//! Invariant: a glide stays within every limit and the tolerance, is no larger than its ratio, and both tracks can be
//! planned to its ends. It may be slower than another way through the corner; that is what the ratio requests.

mod pace;
mod ratio;
mod track;

pub use ratio::{GlideRatio, RatioOf};

use crate::glide::ramp_pair::RampPair;
use crate::glide::tracks::Tracks;
use crate::limits::AxisLimits;
use pace::Pace;
use ratio::End;
use track::{Parameters, are_planned};

/// Rounds of adjusting the glide to the tracks and the tracks to the glide.
const ROUNDS: usize = 24;
/// Factor of the speed from round to round.
const SLOWER: f64 = 0.8;
/// Glides slower than this, in mm/s, are left to the other kinds of junction.
const SLOWEST: f64 = 0.2;

/// The glide of this ratio between two tracks; `None` where there is no space for one.
pub(crate) fn glide<const A: usize>(tracks: &Tracks<A>, axes: &AxisLimits<A>, ratio: GlideRatio) -> Option<RampPair> {
    let [one, two] = &tracks.pair;
    let planned = [Parameters::of(one)?, Parameters::of(two)?];
    let ends = [ratio.end(one, planned[0])?, ratio.end(two, planned[1])?];
    let mut share = 1.0;
    for _ in 0..ROUNDS {
        let ramps = adjusted(ends, planned, share, tracks, axes);
        if ramps.ends().iter().any(|end| end.v < SLOWEST) {
            return None;
        }
        if are_planned(tracks, ramps.ends()) {
            return Some(ramps);
        }
        share *= SLOWER;
    }
    None
}

/// The glide with this `share` of the speeds of `ends`, adjusted to lengths and speeds of the planned tracks, the
/// tolerance and the limits (SMO-4).
fn adjusted<const A: usize>(
    ends: [End; 2],
    planned: [Parameters; 2],
    share: f64,
    tracks: &Tracks<A>,
    axes: &AxisLimits<A>,
) -> RampPair {
    let with = |share: f64| {
        let speeds = [0, 1].map(|side| share * ends[side].speed.min(planned[side].speed));
        Pace::shortest(speeds, tracks, axes).ramps(speeds)
    };
    let ramps = with(share);
    let lengths = ramps.ends();
    let beyond = (0..2).fold(ramps.used_tolerance(tracks), |most, side| {
        most.max(lengths[side].s / ends[side].length.min(planned[side].length))
    });
    // Lengths grow with the speed's power of 3/2 at least.
    let ramps = if beyond > 1.0 { with(share * beyond.powf(-2.0 / 3.0)) } else { ramps };
    // The feed of one track may be too much for the other one.
    let taken = ramps.used_share(tracks, axes);
    if taken > 1.0 { ramps.scaled((1.0 - 1e-12) / taken) } else { ramps }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glide::tracks::{FarEnd, Track};
    use crate::limits::MachineLimits;
    use proptest::prelude::*;

    fn tracks(turn: f64, lengths: [f64; 2], feeds: [f64; 2], rest: [bool; 2], axes: &AxisLimits<3>) -> Tracks<3> {
        let pair = [0, 1].map(|k| {
            let heading = 0.3 + k as f64 * turn;
            let far_end = if rest[k] { FarEnd::Rest } else { FarEnd::Moving };
            Track::new([heading.cos(), heading.sin(), 0.0], lengths[k], far_end, feeds[k], axes)
        });
        Tracks { pair, tolerance: 0.05 }
    }

    proptest! {
        /// A glide is legal, no larger than its ratio, and both tracks can be planned to it.
        #[test]
        fn a_glide_is_legal_and_within_its_ratio(
            turn in 0.05..3.0f64, sizes in [-1.0..2.0f64, -1.0..2.0f64], feeds in [5.0..100.0f64, 5.0..100.0f64],
            rest in any::<[bool; 2]>(), value in 0.01..1.0f64, tolerance in 0.002..5.0f64,
        ) {
            let axes = MachineLimits::built_in().planned();
            let tracks = Tracks { tolerance, ..tracks(turn, sizes.map(|x| 10f64.powf(x)), feeds, rest, &axes) };
            for of in [RatioOf::Length, RatioOf::Speed] {
                let ratio = GlideRatio::new(value, of).expect("in range");
                let Some(ramps) = glide(&tracks, &axes, ratio) else { continue };
                prop_assert!(ramps.used_share(&tracks, &axes) <= 1.0 + 1e-9);
                prop_assert!(are_planned(&tracks, ramps.ends()));
                for (end, track) in ramps.ends().iter().zip(&tracks.pair) {
                    let planned = Parameters::of(track).expect("a plan");
                    let part = if of == RatioOf::Length { end.s / track.length } else { end.v / planned.speed };
                    prop_assert!(part <= value * (1.0 + 1e-9), "{part} of {value}");
                    prop_assert!(end.v <= planned.speed * (1.0 + 1e-9));
                }
            }
        }
    }

    /// With space and tolerance the ratio is fully used; with less tolerance the glide is what the tolerance allows.
    #[test]
    fn the_ratio_counts_where_the_tolerance_is_wide_and_the_tolerance_where_it_is_not() {
        let axes = MachineLimits::built_in().planned();
        let square = Tracks { tolerance: 2.0, ..tracks(1.5, [20.0; 2], [100.0; 2], [true; 2], &axes) };
        let speed = |value: f64, tracks: &Tracks<3>| {
            let ratio = GlideRatio::new(value, RatioOf::Speed).expect("in range");
            glide(tracks, &axes, ratio).expect("there is room").ends()[0].v
        };
        for value in [0.05, 0.1, 0.2, 0.3] {
            let most = Parameters::of(&square.pair[0]).expect("a plan").speed;
            assert!((speed(value, &square) - value * most).abs() < 1e-9 * most, "{value}");
        }
        let near = Tracks { tolerance: 0.02, ..square };
        assert!(speed(0.3, &near) < 0.9 * speed(0.3, &square));
        let ratio = GlideRatio::new(0.3, RatioOf::Speed).expect("in range");
        let ramps = glide(&near, &axes, ratio).expect("there is room");
        let taken = ramps.used_tolerance(&near);
        assert!(taken <= 1.0 && taken > 0.7, "{taken}");
        // Slower, and as short as that speed allows.
        let shortest = Pace::shortest(ramps.ends().map(|end| end.v), &near, &axes).ramps([1.0; 2]);
        assert!((ramps.cell - shortest.cell).abs() < 1e-9 * ramps.cell);
    }
}
