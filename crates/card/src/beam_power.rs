//! The power of a beam in each control period (CUT-20).
//!
//! Invariant: the power is 0 unless the beam is on and pierces or moves along feed motion; it is never above S.

use retrace_core::FeedShare;
use retrace_link::BeamPower;

/// Bits of a feed share between two places below those of a [`FeedShare`].
const FRACTION_BITS: u32 = 32;
/// Bits of [`FeedShare::FEED`] below its only one.
const SHARE_BITS: u32 = FeedShare::FEED.units().trailing_zeros();

/// Returns the power of a beam whose channel has the value `on`, in the unit of `full`, which is S. `feed_share` is the
/// speed as a share of the programmed feed, in units of 2⁻⁴⁷; `None` while the beam pierces.
#[must_use]
pub fn power_of(power: BeamPower, on: i32, full: i32, feed_share: Option<u64>) -> i32 {
    let full = full.max(0);
    let share = match feed_share {
        _ if on == 0 => return 0,
        None => return full,
        Some(0) => return 0,
        Some(_) if on > 0 => return full,
        Some(share) => (share >> FRACTION_BITS).max(u64::from(power.least.units())),
    };
    let share = share.min(u64::from(FeedShare::FEED.units()));
    // a share of 1 is 2¹⁵, so that the product of both fits and is at most `full` behind the shift
    ((u64::from(full.unsigned_abs()) * share) >> SHARE_BITS) as i32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const S: i32 = 1_000_000;
    const FEED: u64 = (1 << 15) << FRACTION_BITS;

    fn beam(least: u16) -> BeamPower {
        BeamPower { channel: 64, least: FeedShare::from_units(least) }
    }

    #[test]
    fn m3_is_constant_in_motion_and_m4_follows_the_speed() {
        let at = |on, feed_share| power_of(beam(0), on, S, feed_share);
        assert_eq!(
            (at(1, Some(FEED / 2)), at(1, Some(1)), at(1, Some(0)), at(1, None)),
            (1_000_000, 1_000_000, 0, 1_000_000)
        );
        assert_eq!((at(-1, Some(FEED / 2)), at(-1, Some(FEED)), at(-1, Some(0))), (500_000, 1_000_000, 0));
        assert_eq!(
            (at(-1, Some(2 * FEED)), at(-1, None), at(0, None), at(0, Some(FEED))),
            (1_000_000, 1_000_000, 0, 0)
        );
        assert_eq!(power_of(beam(1 << 13), -1, 1_000, Some(FEED / 100)), 250, "the least power");
        assert_eq!(power_of(beam(1 << 13), -1, 1_000, Some(0)), 0, "at rest");
    }

    proptest! {
        /// Whatever the settings and words: never below 0 or above S, 0 with the beam off, and no more than one step
        /// from the law.
        #[test]
        fn the_power_is_within_a_step_of_the_law(
            least: u16, on in prop_oneof![Just(0), Just(1), Just(-1), any::<i32>()], full: i32,
            share in prop_oneof![Just(0), 0..2 * FEED, any::<u64>()],
        ) {
            let power = power_of(beam(least), on, full, Some(share));
            let full = f64::from(full.max(0));
            let lowest = f64::from(least) / 32_768.0;
            let law = match on.signum() {
                0 => 0.0,
                _ if share == 0 => 0.0,
                1 => full,
                _ => full * (share as f64 / FEED as f64).max(lowest).min(1.0),
            };
            // the share has steps of 2⁻¹⁵
            let below = law - f64::from(power);
            prop_assert!((-1e-6..1.0 + full / 32_768.0).contains(&below), "{} {}", power, law);
        }
    }
}
