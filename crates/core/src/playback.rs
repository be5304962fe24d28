//! Playback: the position is a function of the place (design, idea 1; REV, *Exactness*).
//!
//! Invariant: moving from place x to place x′ emits `P(x′) − P(x)`. P(x) is the sum of the records before x plus the
//! share of the record under x given by its fraction, rounded half away from zero. The sums telescope: a return to a
//! place means zero net pulses on every axis, at any rate, in any direction.

use crate::{Distance, Place, Record, RecordIndex};

/// Returns the whole pulses of `increment` in the first `fraction`/2³² of its record, rounded half away from zero.
#[must_use]
pub const fn partial_increment(increment: i16, fraction: u32) -> i32 {
    let product = (increment as i64).unsigned_abs() * fraction as u64;
    let rounded = ((product + (1 << 31)) >> 32) as i32;
    if increment < 0 { -rounded } else { rounded }
}

/// Returns the net pulses of each axis between two places; `record` returns the record of a number.
///
/// Returns `None` if a record between the places is missing; a place with fraction 0 does not need the record under it.
/// The sums do not overflow for any history that fits into a ring.
///
/// # Examples
///
/// ```
/// use retrace_core::playback::emission;
/// use retrace_core::{Distance, Place, Record, RecordIndex};
///
/// let records = [4, 10].map(|pulses| Record { increments: [pulses], ..Record::default() });
/// let record = |index: RecordIndex| records.get(index.number() as usize);
/// let start = Place::start_of(RecordIndex::new(0));
/// let middle = start.moved(Distance::RECORD * 3 / 2);
/// assert_eq!(emission(start, middle, record), Some([4 + 5]));
/// assert_eq!(emission(middle, start, record), Some([-9]), "backward, exact to the pulse");
/// ```
pub fn emission<'a, const A: usize>(
    from: Place,
    to: Place,
    mut record: impl FnMut(RecordIndex) -> Option<&'a Record<A>>,
) -> Option<[i64; A]> {
    let mut sum = [0; A];
    let mut within = |place: Place, sign: i64, sum: &mut [i64; A]| -> Option<()> {
        if place.fraction != 0 {
            let under = record(place.record)?;
            for (s, &i) in sum.iter_mut().zip(&under.increments) {
                *s += sign * i64::from(partial_increment(i, place.fraction));
            }
        }
        Some(())
    };
    within(to, 1, &mut sum)?;
    within(from, -1, &mut sum)?;
    let crossed = from.record.records_to(to.record);
    let (first, sign) = if crossed >= 0 { (from.record, 1) } else { (to.record, -1) };
    for k in 0..crossed.unsigned_abs() {
        let whole = record(first + k)?;
        for (s, &i) in sum.iter_mut().zip(&whole.increments) {
            *s += sign * i64::from(i);
        }
    }
    Some(sum)
}

/// Returns the pulses of a control period in which the cursor moved between two places, as increments of one record of
/// the path that was executed. Returns `None` if a record is missing, or an axis has more pulses than a record holds.
///
/// Period by period, the sum of these records is the position at the place reached, exactly: nothing that was executed
/// changes where the rest of the planned path is cut off (PRB-6).
pub fn executed_increments<'a, const A: usize>(
    from: Place,
    to: Place,
    record: impl FnMut(RecordIndex) -> Option<&'a Record<A>>,
) -> Option<[i16; A]> {
    let mut increments = [0; A];
    for (increment, pulses) in increments.iter_mut().zip(emission(from, to, record)?) {
        *increment = i16::try_from(pulses).ok()?;
    }
    Some(increments)
}

/// Returns the speed along the path while the cursor moves between two places in one control period, as a share of the
/// programmed feed in units of 2⁻⁴⁷, not negative; `record` returns the record of a number.
///
/// Returns `None` if a record between the places is missing.
///
/// # Examples
///
/// ```
/// use retrace_core::playback::feed_share_between;
/// use retrace_core::{Distance, FeedShare, Place, Record, RecordIndex};
///
/// let records = [FeedShare::FEED, FeedShare::NONE].map(|feed_share| Record::<2> { feed_share, ..Record::default() });
/// let record = |index: RecordIndex| records.get(index.number() as usize);
/// let start = Place::start_of(RecordIndex::new(0));
/// let (half, end) = (start.moved(Distance::RECORD / 2), start.moved(Distance::RECORD * 2));
/// assert_eq!(feed_share_between(start, half, record), Some(1 << 46), "half of the feed");
/// assert_eq!(feed_share_between(end, half, record), Some(1 << 46), "backward as well");
/// ```
pub fn feed_share_between<'a, const A: usize>(
    from: Place,
    to: Place,
    mut record: impl FnMut(RecordIndex) -> Option<&'a Record<A>>,
) -> Option<u64> {
    let mut share = |index: RecordIndex| record(index).map(|record| u64::from(record.feed_share.units()));
    let (first, last) = if from.distance_to(to) < Distance::ZERO { (to, from) } else { (from, to) };
    let mut sum = 0;
    for crossed in 0..first.record.records_to(last.record).unsigned_abs() {
        sum += share(first.record + crossed)? << 32;
    }
    if last.fraction != 0 {
        sum += share(last.record)? * u64::from(last.fraction);
    }
    if first.fraction != 0 {
        sum -= share(first.record)? * u64::from(first.fraction);
    }
    Some(sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FeedShare;
    use proptest::prelude::*;

    #[test]
    fn halves_round_away_from_zero() {
        assert_eq!(partial_increment(1, 1 << 31), 1);
        assert_eq!(partial_increment(-1, 1 << 31), -1);
        assert_eq!(partial_increment(1, (1 << 31) - 1), 0);
        assert_eq!(partial_increment(i16::MIN, u32::MAX), -32768);
        assert_eq!(partial_increment(i16::MAX, u32::MAX), 32767);
    }

    #[test]
    fn a_stretch_emits_its_whole_records_and_the_parts_at_its_ends() {
        let records: Vec<Record<2>> =
            [[10, -4], [7, 7], [-30, 3]].map(|increments| Record { increments, ..Record::default() }).into();
        let at = |record, share: u32| Place { record, fraction: share << 30 };
        let emitted = |from, to| emission(from, to, |n| records.get(n.number() as usize));
        assert_eq!(emitted(at(RecordIndex::new(0), 0), at(RecordIndex::new(3), 0)), Some([-13, 6]));
        assert_eq!(emitted(at(RecordIndex::new(0), 2), at(RecordIndex::new(2), 1)), Some([5 + 7 - 8, -2 + 7 + 1]));
        assert_eq!(emitted(at(RecordIndex::new(2), 1), at(RecordIndex::new(0), 2)), Some([-4, -6]));
        assert_eq!(emitted(at(RecordIndex::new(1), 1), at(RecordIndex::new(1), 3)), Some([5 - 2, 5 - 2]));
        assert_eq!(emitted(at(RecordIndex::new(2), 0), at(RecordIndex::new(3), 1)), None);
    }

    proptest! {
        /// The share is the mean of those of the records, weighted with the way in each, in both directions.
        #[test]
        fn the_feed_share_is_that_of_the_way(
            shares in prop::collection::vec(any::<u16>(), 10),
            base in any::<u32>(),
            places in [0..(10u64 << 32), 0..(10u64 << 32)],
        ) {
            let records: Vec<Record<1>> = shares
                .iter()
                .map(|&units| Record { feed_share: FeedShare::from_units(units), ..Record::default() })
                .collect();
            let base = RecordIndex::new(base);
            let get = |n: RecordIndex| records.get(n.since(base) as usize);
            let [from, to] = places.map(|units| Place { record: base + (units >> 32) as u32, fraction: units as u32 });
            let upto = |units: u64| -> u128 {
                let (before, under) = shares.split_at((units >> 32) as usize);
                let whole: u128 = before.iter().map(|&share| u128::from(share) << 32).sum();
                whole + under.first().map_or(0, |&share| u128::from(share) * u128::from(units as u32))
            };
            let expected = upto(places[0]).abs_diff(upto(places[1]));
            prop_assert_eq!(feed_share_between(from, to, get).map(u128::from), Some(expected));
        }

        /// For a walk of any steps over any records, the sums telescope and equal places have equal positions.
        #[test]
        fn sums_telescope(
            increments in prop::collection::vec(any::<[i16; 2]>(), 40),
            base in any::<u32>(),
            steps in prop::collection::vec(-(9i64 << 32)..(9i64 << 32), 1..60),
        ) {
            let records: Vec<Record<2>> =
                increments.iter().map(|&increments| Record { increments, ..Record::default() }).collect();
            let base = RecordIndex::new(base);
            let get = |n: RecordIndex| records.get(n.since(base) as usize);
            let [start, low, high] = [20, 0, 40].map(|records| Place::start_of(base + records));
            let (mut at, mut sum) = (start, [0i64; 2]);
            for step in steps {
                let step = Distance::from_units(step).clamp(at.distance_to(low), at.distance_to(high));
                let to = at.moved(step);
                let e = emission(at, to, get).expect("inside the window");
                sum = [sum[0] + e[0], sum[1] + e[1]];
                at = to;
                // the direct move gives the same position as the walk
                prop_assert_eq!(emission(start, at, get), Some(sum));
            }
            let back = emission(at, start, get).expect("inside the window");
            prop_assert_eq!([sum[0] + back[0], sum[1] + back[1]], [0, 0]);
        }
    }
}
