//! Ratio setting and pre-computation (SMO-2, SMO-3): the size of a glide.
//!
//! Invariant: a ratio that exists is above 0 and at most 1.

use crate::error::LimitError;
use crate::glide::source::track::{Parameters, peak};
use crate::glide::tracks::Track;
use crate::profile::SearchTrack as Ramped;

/// Quantity of which a glide ratio is a ratio.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RatioOf {
    /// Length of the glide on a track over the whole length of that track.
    Length,
    /// Speed at the end of the glide over the highest speed of the track from rest to rest.
    Speed,
}

/// Size of a glide as a share of its tracks, above 0 and at most 1 (SMO-2).
///
/// # Examples
///
/// ```
/// use retrace_motion::{GlideRatio, RatioOf};
/// assert!(GlideRatio::new(0.2, RatioOf::Length).is_ok());
/// assert!(GlideRatio::new(0.0, RatioOf::Speed).is_err());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlideRatio {
    value: f64,
    of: RatioOf,
}

impl GlideRatio {
    /// Creates a ratio; `value` is above 0 and at most 1.
    ///
    /// # Errors
    /// E4106: `value` is out of its range.
    pub fn new(value: f64, of: RatioOf) -> Result<Self, LimitError> {
        if value > 0.0 && value <= 1.0 { Ok(Self { value, of }) } else { Err(LimitError::GlideRatio { value }) }
    }

    /// Speed and length of the glide on a track, as the ratio alone gives them.
    pub(super) fn end<const A: usize>(self, track: &Track<A>, planned: Parameters) -> Option<End> {
        match self.of {
            RatioOf::Length => {
                let length = self.value * planned.length;
                // The speed that the track's own ramp reaches over that length: over two of them it rises and falls
                // again.
                Some(End { speed: peak(2.0 * length, track.limits)?, length })
            }
            RatioOf::Speed => {
                let speed = self.value * planned.speed;
                let ramps = Ramped { length: planned.length, start: 0.0, end: 0.0, limits: track.limits }.ramps(speed);
                Some(End { speed, length: f64::min(planned.length, ramps) })
            }
        }
    }
}

/// State at which a glide meets one of its tracks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct End {
    /// Speed along the track, mm/s.
    pub(super) speed: f64,
    /// Greatest length of the glide on the track, mm.
    pub(super) length: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glide::tracks::FarEnd;
    use crate::limits::MachineLimits;
    use proptest::prelude::*;

    proptest! {
        /// The pre-computed end has its ratio, and the track's own ramp from rest reaches its speed within its length.
        #[test]
        fn an_end_has_its_ratio(value in 1e-3..1.0f64, length in -2.0..2.5f64, feed in 1.0..200.0f64) {
            let axes = MachineLimits::<3>::built_in().planned();
            let track = Track::new([0.6, 0.8, 0.0], 10f64.powf(length), FarEnd::Rest, feed, &axes);
            let planned = Parameters::of(&track).expect("from rest to rest there is a plan");
            let end = |of| GlideRatio::new(value, of).expect("in range").end(&track, planned).expect("there is one");
            let (by_length, by_speed) = (end(RatioOf::Length), end(RatioOf::Speed));
            prop_assert!((by_length.length - value * track.length).abs() < 1e-9);
            prop_assert!((by_speed.speed - value * planned.speed).abs() < 1e-9);
            for end in [by_length, by_speed] {
                let ramps = Ramped { length: 0.0, start: 0.0, end: 0.0, limits: track.limits }.ramps(end.speed);
                prop_assert!(0.5 * ramps <= end.length * (1.0 + 1e-9), "{} mm for {:?}", 0.5 * ramps, end);
            }
        }
    }

    #[test]
    fn ratios_out_of_range_are_refused() {
        for value in [0.0, -0.1, 1.001, f64::NAN, f64::INFINITY] {
            let refused = GlideRatio::new(value, RatioOf::Speed).expect_err("out of range");
            assert_eq!(refused.number(), "E4106");
        }
        assert!(GlideRatio::new(1.0, RatioOf::Length).is_ok());
    }
}
