//! The power of a beam in each control period (CUT-20).
//!
//! Invariant: the power is 0 unless the beam is on and pierces or moves along feed motion; it is never above S.

use retrace_core::FeedShare;
use retrace_link::{BeamPower, LINEAR_POWER};

/// Bits of a feed share between two places below those of a [`FeedShare`].
const FRACTION_BITS: u32 = 32;
/// Bits of [`FeedShare::FEED`] below its only one.
const SHARE_BITS: u32 = FeedShare::FEED.units().trailing_zeros();

/// Bits of a root of a share, below its only one where the share is 1.
const ROOT_BITS: u32 = 31;

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
        Some(share) if power.exponent == LINEAR_POWER => share >> FRACTION_BITS,
        Some(share) => raised(share, power.exponent),
    };
    let share = share.max(u64::from(power.least.units()));
    let share = share.min(u64::from(FeedShare::FEED.units()));
    // a share of 1 is 2¹⁵, so that the product of both fits and is at most `full` behind the shift
    ((u64::from(full.unsigned_abs()) * share) >> SHARE_BITS) as i32
}

/// Returns a share of the feed, in units of 2⁻⁴⁷, raised to this number of quarters, in units of 2⁻¹⁵. Above the feed
/// it is 1.
fn raised(share: u64, quarters: u8) -> u64 {
    // A square root of a number in units of 2⁻ⁿ, times 2ᵐ, is in units of 2^(−(n + m) / 2): both are in units of 2⁻³¹.
    let half = (share.min(1 << (FRACTION_BITS + SHARE_BITS)) << 15).isqrt();
    let quarter = (half << ROOT_BITS).isqrt();
    let power = (0..quarters).fold(1 << ROOT_BITS, |power, _| (power * quarter) >> ROOT_BITS);
    // rounded, since the roots of most shares are not whole
    (power + (1 << (ROOT_BITS - SHARE_BITS - 1))) >> (ROOT_BITS - SHARE_BITS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const S: i32 = 1_000_000;
    const FEED: u64 = (1 << 15) << FRACTION_BITS;

    fn beam(least: u16) -> BeamPower {
        BeamPower { channel: 64, least: FeedShare::from_units(least), exponent: LINEAR_POWER }
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

    #[test]
    fn the_exponent_bends_the_law_between_rest_and_feed() {
        let at = |exponent, share| power_of(BeamPower { exponent, ..beam(0) }, -1, S, Some(share));
        assert_eq!([2, 4, 8, 16].map(|exponent| at(exponent, FEED / 4)), [500_000, 250_000, 62_500, 3_906]);
        for exponent in 1..=16 {
            assert_eq!((at(exponent, FEED), at(exponent, 2 * FEED), at(exponent, 0)), (S, S, 0), "{exponent}");
        }
    }

    proptest! {
        /// Any exponent: half a step of the share above the law at most, and one below.
        #[test]
        fn a_power_with_an_exponent_is_within_a_step_of_the_law(
            least in 0..=1u16 << 15, exponent in 1..=16u8, full in 0..i32::MAX,
            share in prop_oneof![1..2 * FEED, 1..1u64 << 20],
        ) {
            let power = power_of(BeamPower { exponent, ..beam(least) }, -1, full, Some(share));
            let full = f64::from(full);
            let law = (share as f64 / FEED as f64).min(1.0).powf(f64::from(exponent) / 4.0);
            let law = full * law.max(f64::from(least) / 32_768.0);
            let below = law - f64::from(power);
            prop_assert!((-full / 65_000.0 - 1e-6..1.0 + full / 32_768.0).contains(&below), "{} {}", power, law);
        }

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
