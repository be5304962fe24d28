//! Bounds of the increments of the records that the cursor may reach (REV, *Rate law*).
//!
//! Increments are whole pulses, so neighbouring records differ by rounding even at constant speed. The bounds are taken
//! from sums of eight records, and from differences of such sums over strides of 8, 16 and 32 records: the longer the
//! stride, the finer the figure. What a short stride cannot tell from rounding moves no axis by more than rounding
//! does.
//!
//! Invariant: no figure is above what the plan may require of the axis at the lowest cap of these records. A record
//! that is not held and is not behind a planned stop counts as requiring all that it may.

use super::{DirectedWindow, RecordWindow};
use crate::limits::{PulseLimits, RateLimits};
use crate::{Distance, RecordIndex};

/// Records per block.
const BLOCK: u32 = 8;
/// Blocks examined on either side of the records that the cursor may reach.
const MARGIN: u32 = 2;
/// Blocks sums: the longest stride is four blocks, and a second difference takes two of them.
const STORED_BLOCKS: usize = 8;

/// The maximum that records ask of an axis at rate one, in units of 2⁻³² pulses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct AxisBounds {
    /// Largest increment |q′|, per period.
    pub(super) velocity: u64,
    /// Largest second difference |q″|, per period².
    pub(super) acceleration: u64,
    /// Largest third difference |q‴|, per period³.
    pub(super) jerk: u64,
}

/// Bounds of all axes over a span of records.
#[derive(Clone, Copy, Debug)]
pub(super) struct IncrementBounds<const A: usize> {
    pub(super) axes: [AxisBounds; A],
    /// Lowest and highest cap among the records, in sixteenths.
    pub(super) min_cap: u8,
    pub(super) max_cap: u8,
}

/// Largest differences of sums over 1, 2 and 4 blocks, in pulses.
#[derive(Clone, Copy, Default)]
struct IncrementDifferences {
    /// Sums over two blocks.
    first: u32,
    second: [u32; 3],
    third: [u32; 2],
}

impl<const A: usize> IncrementBounds<A> {
    /// Returns the bounds of the records within `reach` ahead of the cursor, and a few beyond.
    pub(super) fn over(
        limits: &RateLimits<A>,
        ahead: &DirectedWindow<'_, A, impl RecordWindow<A>>,
        reach: Distance,
    ) -> Self {
        let (first, count) = ahead.records_within(reach);
        let (mut min_cap, mut max_cap) = (u8::MAX, 16);
        for k in 0..count {
            let cap = ahead.window.cap(first + k).get();
            (min_cap, max_cap) = (min_cap.min(cap), max_cap.max(cap));
        }
        let min_cap = min_cap.clamp(16, max_cap);
        let start = RecordIndex::new(first.number() & !(BLOCK - 1)) - MARGIN * BLOCK;
        let blocks = (first + count).since(start).div_ceil(BLOCK) + MARGIN;
        let (differences, known) = max_differences(ahead, start, blocks);
        let mut axes = [AxisBounds::default(); A];
        for ((required, axis), differences_of_axis) in axes.iter_mut().zip(limits.axes()).zip(&differences) {
            let maximum = AxisBounds::plan_maximum(limits, axis, min_cap);
            *required = match known {
                KnownBounds::All => differences_of_axis.bounds(maximum),
                KnownBounds::Most => differences_of_axis.bounds(maximum).widened(maximum),
                KnownBounds::Few => maximum,
            };
        }
        Self { axes, min_cap, max_cap }
    }
}

/// How much of the span is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum KnownBounds {
    All,
    /// All but blocks at its ends.
    Most,
    Few,
}

/// Returns the largest differences of `blocks` blocks from record `start` on.
fn max_differences<const A: usize>(
    ahead: &DirectedWindow<'_, A, impl RecordWindow<A>>,
    start: RecordIndex,
    blocks: u32,
) -> ([IncrementDifferences; A], KnownBounds) {
    let mut differences = [IncrementDifferences::default(); A];
    let mut sums = [[0; A]; STORED_BLOCKS];
    let (mut held, mut missing) = (0, 0);
    for b in 0..blocks {
        let Some(sum) = ahead.sum_increments(start + b * BLOCK, BLOCK) else {
            // the records that are held follow one another, so blocks are missing at the ends alone
            missing += 1;
            continue;
        };
        sums[b as usize % STORED_BLOCKS] = sum;
        held += 1;
        for (axis, differences_of_axis) in differences.iter_mut().enumerate() {
            differences_of_axis.add_block(held, |back| sums[(b as usize + STORED_BLOCKS - back) % STORED_BLOCKS][axis]);
        }
    }
    let known = match missing {
        0 => KnownBounds::All,
        _ if blocks - missing >= 4 && missing <= 2 * (MARGIN + 1) => KnownBounds::Most,
        _ => KnownBounds::Few,
    };
    (differences, known)
}

impl IncrementDifferences {
    /// Adds a block; `sum` returns the sums of it and of the `held` − 1 blocks before it.
    fn add_block(&mut self, held: usize, sum: impl Fn(usize) -> i32) {
        let over = |from: usize, blocks: usize| (from..from + blocks).map(&sum).sum::<i32>();
        if held >= 2 {
            self.first = self.first.max(over(0, 2).unsigned_abs());
        }
        for (k, largest) in self.second.iter_mut().enumerate() {
            let stride = 1 << k;
            if held >= 2 * stride {
                *largest = (*largest).max((over(0, stride) - over(stride, stride)).unsigned_abs());
            }
        }
        for (k, largest) in self.third.iter_mut().enumerate() {
            let stride = 1 << k;
            if held >= 3 * stride {
                let third = over(0, stride) - 2 * over(stride, stride) + over(2 * stride, stride);
                *largest = (*largest).max(third.unsigned_abs());
            }
        }
    }

    /// Returns the bounds for these differences, at most `maximum`.
    ///
    /// A second difference of rounded positions has an error of up to 2 pulses, a third one of up to 4. Over short
    /// strides that error is subtracted, as it moves the axis by no more than rounding does; over the longest stride
    /// nothing is subtracted.
    ///
    /// A stride's figure is a mean with weights that fall on both sides of its middle, and a peak is up to half a block
    /// from the nearest middle. With the jerk that the plan may use on both sides of it, the peak of the acceleration
    /// is above the nearest mean by up to 4.32 times that jerk, a peak of the velocity by up to 19 times. A phase of
    /// jerk may be shorter than a stride, so the jerk that is seen would be too little here. Where nothing but rounding
    /// is seen, the path counts as straight, at constant speed.
    fn bounds(&self, maximum: AxisBounds) -> AxisBounds {
        let part = |pulses: u32, slack: u32, bits: u32| (u64::from(pulses.saturating_sub(slack)) << 32) >> bits;
        let jerk = part(self.third[0], 4, 9).max(part(self.third[1], 4, 12)).min(maximum.jerk);
        let [short, middle, long] = self.second;
        let steady = part(short, 2, 6).max(part(middle, 1, 8)).max(part(long, 0, 10));
        let is_straight = self.second.iter().all(|&pulses| pulses <= 2) && self.third.iter().all(|&pulses| pulses <= 4);
        let unseen = if is_straight { 0 } else { maximum.jerk };
        let acceleration = (steady + 4 * unseen + unseen.div_ceil(3)).min(maximum.acceleration);
        let velocity = (part(self.first + 1, 0, 4) + 19 * unseen).min(maximum.velocity);
        AxisBounds { velocity, acceleration, jerk }
    }
}

impl AxisBounds {
    /// Returns the maximum that the plan may require of an axis in records with caps from `cap` sixteenths on.
    fn plan_maximum<const A: usize>(limits: &RateLimits<A>, axis: &PulseLimits, cap: u8) -> Self {
        let per_cap = |figure: u64, power: u8| {
            if cap == 16 { figure } else { (0..power).fold(figure, |f, _| (f * 16).div_ceil(u64::from(cap))) }
        };
        Self {
            velocity: per_cap(axis.velocity, 1),
            acceleration: per_cap(limits.plan_acceleration(axis), 2),
            jerk: per_cap(limits.plan_jerk(axis), 3),
        }
    }

    /// Returns bounds widened for up to two unknown blocks at an end.
    fn widened(self, maximum: Self) -> Self {
        let unknown = u64::from(2 * BLOCK);
        let acceleration = (self.acceleration + unknown * maximum.jerk).min(maximum.acceleration);
        let velocity = (self.velocity + unknown * acceleration).min(maximum.velocity);
        Self { velocity, acceleration, jerk: maximum.jerk }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Place, RapidCap};
    use proptest::prelude::*;

    /// Records of one axis, from number `low` on.
    #[derive(Debug, Clone)]
    struct Strip {
        low: u32,
        records: Vec<(i16, u8)>,
    }

    impl RecordWindow<1> for Strip {
        fn low(&self) -> RecordIndex {
            RecordIndex::new(self.low)
        }
        fn high(&self) -> RecordIndex {
            RecordIndex::new(self.low) + self.records.len() as u32
        }
        fn rests_at(&self, _: RecordIndex) -> bool {
            false
        }
        fn cap(&self, place: RecordIndex) -> RapidCap {
            RapidCap::sixteenths(self.records[place.since(self.low()) as usize].1)
        }
        fn increments(&self, place: RecordIndex) -> [i16; 1] {
            [self.records[place.since(self.low()) as usize].0]
        }
        fn is_rapid(&self, _: RecordIndex) -> bool {
            false
        }
    }

    const AXIS: PulseLimits = PulseLimits { velocity: 30_000 << 32, acceleration: 3000 << 32, jerk: 300 << 32 };

    /// A peak of acceleration that the plan's jerk makes and takes back counts whole, however short it is and wherever
    /// the blocks are.
    #[test]
    fn a_short_peak_of_acceleration_counts_whole() {
        let limits = RateLimits::new(11, 58_982, [AXIS]).expect("valid");
        let jerk = (limits.plan_jerk(&AXIS) >> 32) as i16;
        for (length, offset) in (1..=10i16).flat_map(|length| (0..8).map(move |offset| (length, offset))) {
            let (mut speed, mut records) = (0, vec![(0i16, 16u8); 60 + offset]);
            for change in (1..=length).chain((0..length).rev()) {
                speed += change * jerk;
                records.push((speed, 16));
            }
            records.extend([(speed, 16); 60]);
            let strip = Strip { low: 0, records };
            let at = Place::start_of(RecordIndex::new(50));
            let ahead = DirectedWindow { at, sign: 1, window: &strip };
            let bounds = IncrementBounds::over(&limits, &ahead, Distance::records(60)).axes[0];
            let (peak, fastest) = (u64::from((length * jerk) as u16) << 32, u64::from(speed as u16) << 32);
            assert!(bounds.acceleration + (1 << 32) >= peak, "{length} {offset}: {bounds:?}");
            assert!(bounds.velocity + (1 << 32) >= fastest, "{length} {offset}: {bounds:?}");
        }
    }

    /// Constant speed is neither acceleration nor jerk, however many blocks are examined.
    #[test]
    fn a_straight_path_requires_its_speed_alone() {
        let limits = RateLimits::new(11, 58_982, [AXIS]).expect("valid");
        for (reach, speed) in (0..120).flat_map(|reach| [(reach, 100), (reach, -3000)]) {
            let strip = Strip { low: 0, records: vec![(speed, 16); 200] };
            let ahead = DirectedWindow { at: Place::start_of(RecordIndex::new(40)), sign: 1, window: &strip };
            let bounds = IncrementBounds::over(&limits, &ahead, Distance::records(reach)).axes[0];
            assert_eq!((bounds.acceleration, bounds.jerk), (0, 0), "{reach}");
            let pulses = u64::from(speed.unsigned_abs()) << 32;
            assert!((pulses..pulses + (1 << 32)).contains(&bounds.velocity), "{reach}: {bounds:?}");
        }
    }

    /// Where the window ends, what follows may accelerate as the plan may: four blocks that are held still count, three
    /// do not.
    #[test]
    fn the_end_of_the_window_hides_what_the_plan_may_use() {
        let soft = PulseLimits { velocity: 30_000 << 32, acceleration: 1000 << 32, jerk: 5 << 32 };
        let limits = RateLimits::new(201, 58_982, [soft]).expect("valid");
        let bounds = |records: u32, speed: i16, sign: i64| {
            let strip = Strip { low: 64, records: vec![(speed, 16); records as usize] };
            let at = Place::start_of(if sign > 0 { strip.low() } else { strip.high() });
            let ahead = DirectedWindow { at, sign, window: &strip };
            IncrementBounds::over(&limits, &ahead, Distance::records(i64::from(records))).axes[0]
        };
        for sign in [1, -1] {
            let (most, planned) = (bounds(32, 100, sign), limits.plan_jerk(&soft));
            // after sixteen records with that jerk, from a constant speed
            let reached = (16 * planned, (100 << 32) + 16 * 16 / 2 * planned);
            assert!(most.acceleration >= reached.0 && most.velocity >= reached.1, "{most:?}");
            assert!(most.acceleration < 2 * reached.0 && most.velocity < 3 * reached.1, "{most:?}");
            let few = bounds(24, 100, sign);
            assert!(few.acceleration == limits.plan_acceleration(&soft) && few.velocity == soft.velocity, "{few:?}");
        }
    }

    proptest! {
        /// Blocks are of eight records on a fixed grid: wherever in a block the cursor is, the same sums are taken.
        #[test]
        fn bounds_do_not_depend_on_the_place_within_a_block(
            increments in prop::collection::vec(-3000i16..3000, 160..=160), place in 1u32..8,
        ) {
            let strip = Strip { low: 0, records: increments.into_iter().map(|increment| (increment, 16)).collect() };
            let limits = RateLimits::new(11, 58_982, [AXIS]).expect("valid");
            // both see the records up to number 100
            let bounds = |at: u32| {
                let ahead = DirectedWindow { at: Place::start_of(RecordIndex::new(at)), sign: 1, window: &strip };
                IncrementBounds::over(&limits, &ahead, Distance::records(i64::from(98 - at))).axes[0]
            };
            prop_assert_eq!(bounds(64), bounds(64 + place));
        }

        /// The caps are those of the records that the cursor may reach, in either direction; velocity and acceleration
        /// are at least what these records show over sixteen of them, and at most what the plan may use at their lowest
        /// cap.
        #[test]
        fn every_record_that_is_reached_counts(
            low in any::<u32>(), records in prop::collection::vec((-3000i16..3000, 16u8..=128), 40..200),
            at in 0.0..1.0f64, fraction in any::<u32>(), reach in 0i64..60 << 32, forward in any::<bool>(),
        ) {
            let strip = Strip { low, records };
            let count = strip.records.len() as u32;
            let record = (f64::from(count - 1) * at) as u32;
            let at = Place { record: strip.low() + record, fraction };
            let ahead = DirectedWindow { at, sign: if forward { 1 } else { -1 }, window: &strip };
            let limits = RateLimits::new(11, 58_982, [AXIS]).expect("valid");
            let bounds = IncrementBounds::over(&limits, &ahead, Distance::from_units(reach));
            // the record under the cursor, and every one that begins within the reach
            let last = i64::from(count) - 1;
            let place = (i64::from(record) << 32) + i64::from(fraction);
            let (from, to) = if forward {
                (record, ((place + reach) >> 32).min(last) as u32)
            } else {
                (((place - reach) >> 32).max(0) as u32, record)
            };
            let caps = || strip.records[from as usize..=to as usize].iter().map(|record| record.1);
            let (least, most) = (caps().min().expect("some"), caps().max().expect("some"));
            prop_assert!(bounds.min_cap <= least && most <= bounds.max_cap, "{bounds:?}: {least} {most}");
            // and at most two records more on the far side, one on the near side
            let (from, to) = if forward { (from, to + 2) } else { (from.saturating_sub(2), to + 1) };
            let near = &strip.records[from as usize..=(to.min(count - 1)) as usize];
            let (least, most) = near.iter().fold((128, 16), |(least, most), r| (r.1.min(least), r.1.max(most)));
            prop_assert!(least <= bounds.min_cap && bounds.max_cap <= most, "{bounds:?}: {least} {most}");
        }
    }
}
