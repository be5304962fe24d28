//! Braking by slopes that are legal anywhere: what may be commanded with how much room, and how long a stop is.
//!
//! Invariant: figures are compared with sums of the rates themselves, and with the two inequalities of the rate law.

use retrace_core::drive::Braking;
use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Distance, RapidCap, Rate};

/// Machines from soft to stiff.
fn machines() -> impl Iterator<Item = Braking> {
    let figures = [(100u64, 3u64, 51u16), (100, 40, 13), (1000, 5, 255), (8, 4, 3)];
    figures.into_iter().map(|(velocity, acceleration, average)| {
        let axis = PulseLimits {
            velocity: velocity << 32,
            acceleration: acceleration << 32,
            jerk: (acceleration << 32).div_ceil(u64::from(average)),
        };
        Braking::new(&RateLimits::new(average, 50_000, [axis]).expect("valid")).expect("fast enough")
    })
}

/// A rate above one needs room for a period at one and the ramp from it; with less room, one period and the ramp from
/// what may be commanded fit.
#[test]
fn a_rate_above_one_needs_the_ramp_from_one() {
    for braking in machines() {
        let needed = Distance::RECORD + braking.length(Rate::ONE);
        for rate in [Rate::ONE + Rate::from_units(1), Rate::ONE * 3 / 2, Rate::MAX] {
            assert_eq!(braking.max_rate_within(rate, needed), rate);
            for part in 0..64 {
                let room = needed * part / 64;
                let slower = braking.max_rate_within(rate, room);
                assert!(slower <= Rate::ONE, "{slower:?} with {room:?} of {needed:?}");
                let ends_in = slower.over(1) + braking.length(slower);
                assert!(ends_in <= room + Distance::from_units(3), "{slower:?} ends in {ends_in:?}, not in {room:?}");
            }
        }
    }
}

/// A stop is as long as the fall from its rate to one, by the slopes of its cap, and the ramp from one, and not much
/// longer.
#[test]
fn a_stop_is_as_long_as_its_fall() {
    for braking in machines() {
        for cap in 17..=128 {
            let from = RapidCap::sixteenths(cap).rate();
            let (mut rate, mut fall) = (from, Distance::ZERO);
            while rate > Rate::ONE {
                rate = (rate - braking.slope(rate, cap)).max(Rate::ONE);
                fall += rate.over(1);
            }
            let stop = fall + braking.length(Rate::ONE);
            let found = braking.stop_length(from);
            let is_as_long = stop <= found + Distance::RECORD && found <= stop + stop / 16;
            assert!(is_as_long, "{found:?} for {stop:?} at cap {cap}");
        }
    }
}

/// The slopes leave what a path may use that is as rough as its velocity allows: increments of alternating sign have
/// second differences of twice and third differences of four times the velocity.
#[test]
fn slopes_leave_what_the_roughest_path_uses() {
    // in pulses: velocity, acceleration and jerk; an average of one period
    for (velocity, limit, share) in
        [(1.0, 1.5, 0.9), (1.0, 3.0, 0.9), (1.0, 2.5, 0.5), (2.0, 3.0, 0.8), (1.0, 1.2, 0.6)]
    {
        let units = |pulses: f64| (pulses * f64::from(1 << 16)) as u64 * (1 << 16);
        let axis = PulseLimits { velocity: units(velocity), acceleration: units(limit), jerk: units(limit) };
        let limits = RateLimits::new(1, (share * 65_536.0) as u16, [axis]).expect("valid");
        let share = f64::from(limits.share()) / 65_536.0;
        let braking = Braking::<1>::new(&limits).expect("fast enough");
        let slope = f64::from(braking.slope(Rate::ONE, 16));
        let (second, third) = ((share * limit).min(2.0 * velocity), (share * limit).min(4.0 * velocity));
        let accelerated = second + velocity * slope;
        let jerked = third + (3.0 * second + 2.0 * velocity) * slope;
        let used = (accelerated / limit).max(jerked / (2.0 * limit));
        assert!((0.999..=1.000_001).contains(&used), "{used} of {axis:?} at {slope}");
    }
}

/// The rounding of the figures is on the safe side: exact for limits of a few units.
#[test]
fn slopes_of_the_smallest_limits_are_rounded_down() {
    for (velocity, limit) in [(256u64, 1100u64), (257, 1200), (300, 1500), (256, 1024)] {
        let axis = PulseLimits { velocity, acceleration: limit, jerk: limit };
        let limits = RateLimits::new(1, 62_000, [axis]).expect("valid");
        // the plan may use less than the velocity permits, or all of it
        let part = limit * 62_000;
        let (second, third) = (part.min((2 * velocity) << 16), part.min((4 * velocity) << 16));
        let slope = Braking::<1>::new(&limits).expect("fast enough").slope(Rate::ONE, 16).units() as u128;
        let bend = u128::from(3 * second + ((2 * velocity) << 16));
        let jerked = (u128::from(third) << 32) + bend * slope;
        let whole = u128::from(2 * limit) << 48;
        assert!(jerked <= whole, "{jerked} of {whole}");
        assert!(jerked + (whole >> 8) >= whole || slope == 1 << 32, "{jerked} of {whole} is too timid");
    }
}
