//! The drive on paths that are chosen for one term of its law.
//!
//! Invariant: the rate is taken from the places of the cursor. With an average of one period, it is the commanded one.

use retrace_core::drive::{Braking, Drive, RecordWindow};
use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Distance, Place, RapidCap, Rate, RateTarget, RecordIndex};

/// Records of one axis, at rest nowhere; slow ones may be retraced at a higher rate.
struct Increments(Vec<i16>);

impl RecordWindow<1> for Increments {
    fn low(&self) -> RecordIndex {
        RecordIndex::new(0)
    }
    fn high(&self) -> RecordIndex {
        RecordIndex::new(self.0.len() as u32)
    }
    fn rests_at(&self, _: RecordIndex) -> bool {
        false
    }
    fn cap(&self, index: RecordIndex) -> RapidCap {
        if self.increments(index)[0].abs() <= 10 { RapidCap::MAX } else { RapidCap::PLANNED }
    }
    fn increments(&self, index: RecordIndex) -> [i16; 1] {
        [self.0[index.number() as usize]]
    }
    fn is_rapid(&self, _: RecordIndex) -> bool {
        false
    }
}

/// Limits of one axis whose average is one period.
fn unsmoothed_limits(share: u16, velocity: u64, acceleration: u64) -> RateLimits<1> {
    let axis = PulseLimits { velocity: velocity << 32, acceleration: acceleration << 32, jerk: acceleration << 32 };
    RateLimits::new(1, share, [axis]).expect("valid")
}

/// A drive whose cursor is the commanded place.
fn unsmoothed(share: u16, velocity: u64, acceleration: u64) -> Drive<1, 1> {
    Drive::new(unsmoothed_limits(share, velocity, acceleration)).expect("fits")
}

/// Advances by a period and returns the rate in it.
fn advance(drive: &mut Drive<1, 1>, at: &mut Place, target: Rate, window: &Increments) -> Rate {
    let to = drive.step(*at, target, window).to;
    let rate = at.distance_to(to).per_period();
    *at = to;
    rate
}

/// From a rate below those that are blended, and any place in a record, the rate rises to one and does not fall on the
/// way, although it becomes one at a boundary of the records.
#[test]
fn the_rate_does_not_fall_on_its_way_to_one() {
    for (share, sixteenths) in [1000, 30_000, 60_000].into_iter().flat_map(|share| (1..=12).map(move |n| (share, n))) {
        let window = Increments(vec![90; 4000]);
        let mut drive = unsmoothed(share, 100, 3);
        let (mut at, mut rate) =
            (Place { record: RecordIndex::new(300), fraction: 0x1234_5678 * sixteenths }, Rate::ZERO);
        for _ in 0..400 {
            rate = advance(&mut drive, &mut at, Rate::ONE / 16 * i64::from(sixteenths), &window);
        }
        for _ in 0..400 {
            let last = core::mem::replace(&mut rate, advance(&mut drive, &mut at, Rate::ONE, &window));
            assert!(rate + Rate::from_units(2) >= last, "{last:?} {rate:?} at {at:?}, from {sixteenths}/16");
        }
        assert_eq!((rate, at.fraction), (Rate::ONE, 0));
    }
}

/// The fewest periods in which a deficit of the rate becomes zero at a boundary of the records, from `passed` behind a
/// boundary, if the deficit changes by at most `slope` per period and stays within 0 … `largest`: its sum is then
/// `passed` and whole records.
fn fewest_periods_to_one(deficit: Rate, passed: u32, slope: Rate, largest: Rate) -> i64 {
    let [deficit, passed, slope, largest] =
        [deficit.units(), i64::from(passed), slope.units(), largest.units()].map(i128::from);
    let record = i128::from(Rate::ONE.units());
    let sums_reach_a_boundary = |periods: &i64| {
        let falling = |k| deficit - i128::from(k) * slope;
        let least: i128 = (1..=*periods).map(|k| falling(k).max(0)).sum();
        let highest = |k| (deficit + i128::from(k) * slope).min(largest).min(i128::from(periods - k) * slope);
        let most: i128 = (1..=*periods).map(highest).sum();
        falling(*periods) <= 0 && (most - passed).div_euclid(record) * record >= least - passed
    };
    (0..).find(sums_reach_a_boundary).expect("a long sum reaches one")
}

/// Rate one is blended in as few periods as its slope allows, from every deficit and every place in a record.
#[test]
fn rate_one_is_reached_in_the_fewest_periods() {
    for (share, offset) in [1000, 30_000, 60_000].into_iter().flat_map(|share| (0..24).map(move |k| (share, k))) {
        let window = Increments(vec![90; 4000]);
        let slope = Braking::<32>::new(&unsmoothed_limits(share, 100, 3)).expect("fast enough").min_slope();
        let largest = Rate::from_units((2 * slope.units() as u64 * Rate::ONE.units() as u64).isqrt() as i64);
        for part in 1..=12 {
            let deficit = largest * part / 12;
            let reach_deficit = |fraction| {
                let (mut drive, mut rate) = (unsmoothed(share, 100, 3), Rate::ZERO);
                let mut at = Place { record: RecordIndex::new(300), fraction };
                while rate != Rate::ONE - deficit {
                    rate = advance(&mut drive, &mut at, Rate::ONE - deficit, &window);
                }
                (drive, at)
            };
            // so that it begins exactly at a boundary, too
            let place_in_record = 0x0ABC_DEF1 * offset;
            let (mut drive, mut at) = reach_deficit(u32::wrapping_sub(place_in_record, reach_deficit(0).1.fraction));
            assert_eq!(at.fraction, place_in_record);
            let mut rate = Rate::ONE - deficit;
            let fewest = fewest_periods_to_one(deficit, at.fraction, slope, largest);
            let mut periods = 0;
            while (rate, at.fraction) != (Rate::ONE, 0) {
                rate = advance(&mut drive, &mut at, Rate::ONE, &window);
                periods += 1;
                assert!(periods <= fewest, "{fewest} periods are enough for {deficit:?}, share {share}, at {at:?}");
            }
            assert_eq!(periods, fewest, "{deficit:?} is not blended as {slope:?} allows");
        }
    }
}

/// The rate does not rise above the cap of a record that the cursor crosses before the rate can have fallen again,
/// wherever the cursor is in a record: the last record that is held counts like the others.
#[test]
fn a_rate_above_one_observes_the_caps_of_all_held_records() {
    let stiff = PulseLimits { velocity: 1 << 32, acceleration: 1 << 40, jerk: 1 << 40 };
    let limits = RateLimits::new(1, 1 << 15, [stiff]).expect("valid");
    let periods = i64::from(Braking::<32>::new(&limits).expect("fast enough").periods() + 1 + 3);
    let mut fast = 0;
    for (length, quarter) in (8u32..64).flat_map(|length| (0..4u32).map(move |quarter| (length, quarter))) {
        let mut increments = vec![10; length as usize];
        increments[length as usize - 1] = 11;
        let window = Increments(increments);
        let mut drive = Drive::<1, 1>::new(limits).expect("fits");
        let (mut at, mut rate) = (Place { record: RecordIndex::new(1), fraction: quarter << 30 }, Rate::ZERO);
        while at.record.number() < length {
            let from = at;
            let last = core::mem::replace(&mut rate, advance(&mut drive, &mut at, Rate::MAX, &window));
            if rate < last || rate <= Rate::ONE {
                continue;
            }
            fast += 1;
            let reached = from.moved(rate.over(periods)).boundary_ahead().number().min(length);
            for record in from.record.number()..reached {
                let cap = window.cap(RecordIndex::new(record)).rate();
                assert!(rate <= cap, "{rate:?} at {from:?}, {cap:?} at record {record} of {length}");
            }
        }
    }
    assert!(fast > 100, "{fast} periods above rate one");
}

/// A slow record does not limit the rate where the cursor does not come to it before the rate can have fallen again,
/// whatever part of a record the rate is.
#[test]
fn a_slow_record_far_ahead_does_not_limit_the_rate() {
    let stiff = PulseLimits { velocity: 1 << 32, acceleration: 1 << 40, jerk: 1 << 40 };
    let limits = RateLimits::new(1, 1 << 15, [stiff]).expect("valid");
    let periods = i64::from(Braking::<32>::new(&limits).expect("fast enough").periods() + 1 + 3);
    for tenths in 11..80 {
        let target = Rate::ONE * tenths / 10;
        let mut increments = vec![10; 2000];
        increments[1000] = 11;
        let window = Increments(increments);
        let mut drive = Drive::<1, 1>::new(limits).expect("fits");
        let (mut at, mut rate) = (Place { record: RecordIndex::new(1), fraction: 0x1234_5678 }, Rate::ZERO);
        // the bounds cover two records more
        let reach = target.over(periods) + target.over(1) + Distance::records(3);
        while at.moved(reach).record.number() < 1000 {
            let last = core::mem::replace(&mut rate, advance(&mut drive, &mut at, target, &window));
            assert!(rate == target || rate >= last + Rate::ONE / 2, "{last:?} {rate:?} of {target:?} at {at:?}");
        }
        assert_eq!(rate, target);
    }
}

/// A rise along a path that accelerates is nearly as steep as acceleration and jerk allow at the increments.
#[test]
fn a_rise_uses_what_the_records_leave() {
    let (acceleration, axis_acceleration) = (1.0, 3.0);
    for start in [100, 140, 180] {
        let window = Increments((0..4000).map(|record: i16| 40 + record.min(400)).collect());
        let mut drive = unsmoothed(1 << 15, 2000, 3);
        let (mut at, mut rate) = (Place::start_of(RecordIndex::new(start)), Rate::ZERO);
        let mut rises = 0;
        while rate < Rate::ONE / 10 * 8 {
            let last = core::mem::replace(&mut rate, advance(&mut drive, &mut at, Rate::ONE / 10 * 9, &window));
            // within two blocks of the places that the cursor reaches
            let velocity = f64::from(window.0[at.record.number() as usize + 24]);
            let by_acceleration = (axis_acceleration - acceleration * f64::from(rate).powi(2)) / velocity;
            // an average of one period: the jerk is as large as the acceleration
            let by_jerk = 2.0 * axis_acceleration / (3.0 * acceleration + 2.0 * velocity);
            let (rise, allowed) = (f64::from(rate - last), by_acceleration.min(by_jerk));
            assert!(rise >= 0.75 * allowed, "{rise} of {allowed} at {at:?}, {rate:?}");
            rises += 1;
        }
        assert!(rises > 20, "{rises} periods");
    }
}

/// Where rapid retrace ends and rate one goes on, records are not split for long, wherever one is reached.
#[test]
fn records_are_not_split_after_rapid_retrace() {
    let window = Increments(vec![10; 8000]);
    for (share, tenths) in [1000, 30_000].into_iter().flat_map(|share| (11..40).map(move |tenths| (share, tenths))) {
        let mut drive = unsmoothed(share, 100, 3);
        let mut at = Place { record: RecordIndex::new(300), fraction: 0x1234_5678 };
        let mut rate = Rate::ZERO;
        for _ in 0..300 {
            rate = advance(&mut drive, &mut at, Rate::ONE * tenths / 10, &window);
        }
        assert_eq!(rate, Rate::ONE * tenths / 10);
        for _ in 0..300 {
            rate = advance(&mut drive, &mut at, Rate::ONE, &window);
        }
        assert_eq!((rate, at.fraction), (Rate::ONE, 0), "from {tenths}/10");
    }
}

/// A hold in a short peak of the velocity accelerates the axis by no more than its limit, although sixteen records
/// show hardly half of that peak, and wherever their grid is.
#[test]
fn a_hold_in_a_peak_of_velocity_keeps_the_acceleration() {
    let (acceleration, planned) = (20, 19);
    for offset in 0..8 {
        let rise = (0..=8).map(|k| k * planned);
        let mut increments = vec![0; 200 + offset];
        increments.extend(rise.clone().chain(rise.rev()));
        increments.extend([0; 200]);
        let window = Increments(increments);
        for tenths in 1..=10 {
            let mut drive = unsmoothed(62_259, 2000, acceleration);
            let (target, mut at) = (Rate::ONE / 10 * tenths, Place::start_of(RecordIndex::new(100)));
            let (mut rate, mut held) = (Rate::ZERO, 0);
            while at.record.number() < 220 + offset as u32 {
                let (mut holding, mut place) = (drive.clone(), at);
                let fall = rate - advance(&mut holding, &mut place, Rate::ZERO, &window);
                let speed = i64::from(window.0[at.record.number() as usize])
                    .min(window.0[place.record.number() as usize].into());
                let used = speed as f64 * f64::from(fall);
                assert!(used <= acceleration as f64, "{used} of {acceleration} at {at:?}, from {rate:?}");
                held += u32::from(speed > 100);
                rate = advance(&mut drive, &mut at, target, &window);
            }
            assert!(held > 3, "{held} holds in the peak");
        }
    }
}

/// A hold on a path whose velocity grows by a pulse in 32 records keeps the acceleration, although sixteen records show
/// no more than rounding does. Records of up to ten pulses are left out: they have another cap.
#[test]
fn a_hold_on_a_gentle_acceleration_keeps_the_limit() {
    let (planned, limit) = (1.0 / 32.0, 0.05);
    let units = (limit * f64::from(1 << 16)) as u64 * (1 << 16);
    let axis = PulseLimits { velocity: 200 << 32, acceleration: units, jerk: units };
    let limits = RateLimits::new(1, 45_000, [axis]).expect("valid");
    let mut increments = vec![0; 200];
    increments.extend((0..4800i32).map(|k| (((k + 1) * (k + 1) + 32) / 64 - (k * k + 32) / 64) as i16));
    increments.resize(25_000, 150);
    let window = Increments(increments);
    let mut drive = Drive::<1, 1>::new(limits).expect("fits");
    let (mut at, mut rate, mut most) = (Place::start_of(RecordIndex::new(50)), Rate::ZERO, 0.0f64);
    while at.record.number() < 4800 {
        let (mut holding, mut place) = (drive.clone(), at);
        let fall = rate - advance(&mut holding, &mut place, Rate::ZERO, &window);
        if at.record.number() > 600 {
            assert_eq!(rate, Rate::ONE);
            let velocity = f64::from(at.record.number() - 200) * planned;
            let used = velocity * f64::from(fall) + planned;
            assert!(used <= limit, "{used} of {limit} at {at:?}");
            most = most.max(used);
        }
        rate = advance(&mut drive, &mut at, Rate::ONE, &window);
    }
    assert!(most >= 0.8 * limit, "{most} of {limit} is used");
}

/// A hold with a long average keeps the acceleration of the axis, although the cursor comes to records that are faster
/// than those at which the rate began to fall.
#[test]
fn a_hold_before_faster_records_keeps_the_acceleration() {
    let (limit, rise, planned) = (1.5, 51i32, 1.35);
    let axis = PulseLimits { velocity: 1000 << 32, acceleration: 3 << 31, jerk: (3 << 31) / 51 + 1 };
    let limits = RateLimits::new(255, 59_000, [axis]).expect("valid");
    // the acceleration grows and falls with the jerk that the plan may use
    let planned_acceleration = |record: i32| {
        let from_end = (record - 1000).min(1300 - record).clamp(0, rise);
        planned * f64::from(from_end) / f64::from(rise)
    };
    let mut positions = vec![0.0];
    let mut velocity = 380.0;
    for record in 0..15_000 {
        velocity += planned_acceleration(record);
        positions.push(positions[positions.len() - 1] + velocity);
    }
    let window = Increments(positions.windows(2).map(|p| (p[1].round() - p[0].round()) as i16).collect());
    let position = |at: Place| {
        let record = at.record.number() as usize;
        positions[record] + (positions[record + 1] - positions[record]) * f64::from(at.fraction) / 4_294_967_296.0
    };
    let mut drive = Drive::<1, 256>::new(limits).expect("fits");
    let (mut at, mut most) = (Place::start_of(RecordIndex::new(0)), 0.0f64);
    while at.record.number() < 1200 {
        if at.record.number() > 800 && at.record.number().is_multiple_of(4) {
            let (mut holding, mut place) = (drive.clone(), at);
            let mut played = vec![position(at)];
            while !holding.at_rest() {
                place = holding.step(place, Rate::ZERO, &window).to;
                played.push(position(place));
            }
            let bends = played.windows(3).map(|p| (p[2] - 2.0 * p[1] + p[0]).abs());
            most = bends.fold(most, f64::max);
        }
        at = drive.step(at, Rate::ONE, &window).to;
    }
    assert!(most <= 1.01 * limit && most >= 0.9 * limit, "{most} of {limit} is used");
}

/// A rise uses the slope of the rate that it reaches, in proportion to the caps of the records.
#[test]
fn a_rise_is_braked_from_the_rate_that_it_reaches() {
    let soft = PulseLimits { velocity: 100 << 32, acceleration: 3 << 32, jerk: 1 << 32 };
    let braking = Braking::<32>::new(&RateLimits::new(51, 50_000, [soft]).expect("valid")).expect("fast enough");
    let slopes: Vec<Rate> = (1..=32).map(|k| braking.slope(Rate::ONE / 32 * k, 16)).collect();
    assert!(slopes.is_sorted_by(|slower, faster| slower > faster), "each interval has a slope of its own");
    for cap in [16, 24, 64, 128] {
        for k in 0..32 {
            let middle = Rate::ONE / 64 * (2 * k as i64 + 1) / 16 * i64::from(cap);
            let reached = slopes[(k + 1).min(31)];
            assert_eq!(braking.rising_slope(middle, cap), reached * i64::from(cap) / 16, "{k} at {cap}");
        }
    }
}

/// Rates of different signs request no motion; a rate of zero for one kind of motion leaves the other its own.
#[test]
fn a_target_of_zero_has_no_direction() {
    for (feed, rapid, faster, slower) in [(0, 1, 1, 0), (1, 0, 1, 0), (0, -1, -1, 0), (-1, 0, -1, 0), (-1, 1, 0, 0)] {
        let [feed, rapid, faster, slower] = [feed, rapid, faster, slower].map(|rate| Rate::ONE * rate);
        let target = RateTarget { feed, rapid };
        assert_eq!((target.faster(), target.slower()), (faster, slower), "{target:?}");
    }
}
