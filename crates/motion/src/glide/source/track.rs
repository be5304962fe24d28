//! Planning, parameters and track adjustment (SMO-1, SMO-4, SMO-5): what a track reaches by itself, and next to a
//! glide.
//!
//! Invariant: parameters are those of a plan that exists.

use crate::glide::optimum::rest_time;
use crate::glide::tracks::{Track, Tracks};
use crate::profile::{KinematicState, PathLimits, fastest};

/// Length in mm and highest speed in mm/s of a planned track: L and Vm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Parameters {
    pub(super) length: f64,
    pub(super) speed: f64,
}

impl Parameters {
    /// Parameters of the whole track from rest to rest: the first planning.
    pub(super) fn of<const A: usize>(track: &Track<A>) -> Option<Self> {
        Some(Self { length: track.length, speed: peak(track.length, track.limits)? })
    }
}

/// Highest speed in mm/s from rest to rest over `length` mm.
pub(super) fn peak(length: f64, limits: PathLimits) -> Option<f64> {
    fastest(KinematicState::default(), KinematicState::default(), length, limits).ok().map(|plan| plan.crest().0)
}

/// Whether both tracks, shortened by what the glide uses of them, can be planned to its ends: the second planning.
pub(super) fn are_planned<const A: usize>(tracks: &Tracks<A>, ends: [KinematicState; 2]) -> bool {
    (0..2).all(|side| ends[side].s < tracks.pair[side].length && rest_time(ends[side], tracks, side).is_some())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glide::tracks::FarEnd;
    use crate::limits::MachineLimits;
    use crate::profile::{SearchStep, SearchTrack as Ramped, SearchVariant, SpeedSearch};
    use proptest::prelude::*;

    proptest! {
        /// The highest speed of the closed form is the one that the speed search of SMO-8 converges to.
        #[test]
        fn the_search_finds_the_same_highest_speed(length in -2.0..3.0f64, feed in 1.0..200.0f64) {
            let axes = MachineLimits::<3>::built_in().planned();
            let track = Track::new([0.6, 0.8, 0.0], 10f64.powf(length), FarEnd::Rest, feed, &axes);
            let Parameters { length, speed } = Parameters::of(&track).expect("from rest to rest there is a plan");
            let search = SpeedSearch { first: track.limits.v, step: SearchStep::Geometric(1e-3),
                variant: SearchVariant::Fill(1.0), rounds: 20_000 };
            let found = search.find(&Ramped { length, start: 0.0, end: 0.0, limits: track.limits }).expect("there is \
                a speed");
            prop_assert!((found.v - speed).abs() <= 1.1e-3 * speed, "{} mm/s, {} mm/s", found.v, speed);
        }

        /// A glide that leaves space for the tracks' ramps can be planned to, one that does not cannot.
        #[test]
        fn a_second_planning_needs_the_room(length in 0.5..50.0f64, share in 0.01..0.99f64, turn in 0.1..3.0f64) {
            let axes = MachineLimits::<3>::built_in().planned();
            let track = |heading: f64| {
                Track::new([heading.cos(), heading.sin(), 0.0], length, FarEnd::Rest, 100.0, &axes)
            };
            let tracks = Tracks { pair: [track(0.0), track(turn)], tolerance: 0.05 };
            let distance = share * length;
            let [fits, too_fast] = [0.999, 1.001].map(|part| {
                tracks.pair.map(|track| {
                    // From rest the rest of the track reaches this speed.
                    let v = peak(2.0 * (length - distance), PathLimits { v: 1e9, ..track.limits }).expect("a plan");
                    KinematicState { s: distance, ..KinematicState::moving(part * v, 0.0) }
                })
            });
            let allowed = (0..2).all(|side| fits[side].v <= tracks.pair[side].limits.v);
            prop_assert_eq!(are_planned(&tracks, fits), allowed);
            prop_assert!(!are_planned(&tracks, too_fast));
        }
    }
}
