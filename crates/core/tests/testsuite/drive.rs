//! The drive on paths that are chosen for one term of its law.
//!
//! Invariant: the rate is taken from the places of the cursor. With an average of one period, it is the commanded one.

use retrace_core::drive::{Braking, Drive, RecordWindow};
use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Place, RapidCap, Rate, RateTarget, RecordIndex};

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

/// A drive whose cursor is the commanded place.
fn unsmoothed(share: u16, velocity: u64, acceleration: u64) -> Drive<1, 1> {
    let axis = PulseLimits { velocity: velocity << 32, acceleration: acceleration << 32, jerk: acceleration << 32 };
    Drive::new(RateLimits::new(1, share, [axis]).expect("valid")).expect("fits")
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
