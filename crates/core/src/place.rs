//! Places on the recorded path: a record number and a fraction of that record.
//!
//! Invariant: record indices wrap at 2³² and are compared by wrapping difference only. Two places on one path must
//! therefore be less than 2³¹ records apart. A ring is far smaller.

use crate::Distance;
use core::fmt;
use core::ops::{Add, AddAssign, Sub, SubAssign};

/// Index of a record on the recorded path. It wraps at 2³²; sums and differences wrap with it.
///
/// # Examples
///
/// ```
/// use retrace_core::RecordIndex;
///
/// let last = RecordIndex::new(u32::MAX);
/// let next = last + 2;
/// assert!(last.is_before(next));
/// assert_eq!((next.number(), next.since(last)), (1, 2));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct RecordIndex(u32);

impl RecordIndex {
    /// Returns the index with this number.
    #[must_use]
    pub const fn new(number: u32) -> Self {
        Self(number)
    }

    /// Returns the number of the index.
    #[must_use]
    pub const fn number(self) -> u32 {
        self.0
    }

    /// Returns the number of records from `earlier` to this one, which must not be before it.
    #[must_use]
    pub const fn since(self, earlier: Self) -> u32 {
        self.0.wrapping_sub(earlier.0)
    }

    /// Returns the number of records to `other`: negative if it is before this one.
    #[must_use]
    pub const fn records_to(self, other: Self) -> i32 {
        other.0.wrapping_sub(self.0) as i32
    }

    /// Whether this record is before `other`.
    #[must_use]
    pub const fn is_before(self, other: Self) -> bool {
        number_is_before(self.0, other.0)
    }

    /// Returns the later of the two.
    #[must_use]
    pub const fn later(self, other: Self) -> Self {
        if self.is_before(other) { other } else { self }
    }
}

/// Whether the number `a` is before `b`, where numbers count up and wrap at 2³², as those of instructions do.
#[must_use]
pub const fn number_is_before(a: u32, b: u32) -> bool {
    (a.wrapping_sub(b) as i32) < 0
}

impl fmt::Display for RecordIndex {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl Add<u32> for RecordIndex {
    type Output = Self;
    fn add(self, records: u32) -> Self {
        Self(self.0.wrapping_add(records))
    }
}

impl AddAssign<u32> for RecordIndex {
    fn add_assign(&mut self, records: u32) {
        *self = *self + records;
    }
}

impl SubAssign<u32> for RecordIndex {
    fn sub_assign(&mut self, records: u32) {
        *self = *self - records;
    }
}

impl Sub<u32> for RecordIndex {
    type Output = Self;
    fn sub(self, records: u32) -> Self {
        Self(self.0.wrapping_sub(records))
    }
}

/// Place on the recorded path (REV, *Exactness*): `fraction`/2³² of record `record` is behind it.
///
/// # Examples
///
/// ```
/// use retrace_core::{Distance, Place, RecordIndex};
///
/// let start = Place::start_of(RecordIndex::new(7));
/// let place = start.moved(Distance::RECORD * 5 / 2);
/// assert_eq!((place.record, place.fraction), (RecordIndex::new(9), 1 << 31));
/// assert_eq!(place.moved(place.distance_to(start)), start);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Place {
    /// Index of the record under the place.
    pub record: RecordIndex,
    /// Fraction of that record that is behind the place, in units of 2⁻³².
    pub fraction: u32,
}

impl Place {
    /// Returns the place between record `record` − 1 and record `record`.
    #[must_use]
    pub const fn start_of(record: RecordIndex) -> Self {
        Self { record, fraction: 0 }
    }

    /// Returns the place `distance` further along the path, backward if negative. |distance| must be below 2³¹ records.
    #[must_use]
    pub const fn moved(self, distance: Distance) -> Self {
        let sum = self.fraction as i64 + distance.units();
        Self { record: RecordIndex(self.record.0.wrapping_add((sum >> 32) as u32)), fraction: sum as u32 }
    }

    /// Returns the signed distance from this place to `to`: positive if `to` is ahead.
    #[must_use]
    pub const fn distance_to(self, to: Self) -> Distance {
        let records = self.record.records_to(to.record) as i64;
        Distance::from_units((records << 32) + to.fraction as i64 - self.fraction as i64)
    }

    /// Returns the share of the record that is behind the place, from 0 up to 1, for displays.
    #[must_use]
    pub fn fraction_of_record(self) -> f64 {
        f64::from(self.fraction) / 4_294_967_296.0
    }

    /// Returns the first record boundary that is not behind this place.
    #[must_use]
    pub const fn boundary_ahead(self) -> RecordIndex {
        if self.fraction == 0 { self.record } else { RecordIndex(self.record.0.wrapping_add(1)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moving_there_and_back_is_the_identity_over_the_wrap() {
        for record in [0, 1, u32::MAX, u32::MAX - 1, 1 << 31] {
            for fraction in [0, 1, 1 << 31, u32::MAX] {
                const RECORD: i64 = 1 << 32;
                for units in [0, 1, -1, RECORD, -RECORD, RECORD / 3, -RECORD * 7 - 5, RECORD * 1000 + 1] {
                    let (from, distance) =
                        (Place { record: RecordIndex(record), fraction }, Distance::from_units(units));
                    let to = from.moved(distance);
                    assert_eq!(from.distance_to(to), distance);
                    assert_eq!(to.moved(-distance), from);
                }
            }
        }
    }

    #[test]
    fn the_boundary_ahead_is_the_place_itself_where_the_fraction_is_zero() {
        assert_eq!(Place::start_of(RecordIndex(7)).boundary_ahead(), RecordIndex(7));
        assert_eq!(Place { record: RecordIndex(u32::MAX), fraction: 1 }.boundary_ahead(), RecordIndex(0));
    }

    #[test]
    fn indices_are_compared_over_the_wrap() {
        let (last, first) = (RecordIndex(u32::MAX), RecordIndex(0));
        assert!(last.is_before(first) && !first.is_before(last) && !first.is_before(first));
        assert_eq!(
            (last + 3, first - 2, first.since(last), first.records_to(last)),
            (RecordIndex(2), RecordIndex(u32::MAX - 1), 1, -1)
        );
        assert_eq!(last.later(first), first);
    }

    #[test]
    fn the_fraction_is_the_share_of_the_record() {
        for (fraction, share) in [(0, 0.0), (1 << 30, 0.25), (1 << 31, 0.5), (3 << 30, 0.75)] {
            let place = Place { record: RecordIndex(9), fraction };
            assert!((place.fraction_of_record() - share).abs() < f64::EPSILON, "{fraction}");
        }
        assert!(Place { record: RecordIndex(9), fraction: u32::MAX }.fraction_of_record() < 1.0);
    }
}
