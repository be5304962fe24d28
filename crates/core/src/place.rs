//! Places on the recorded path: a record number and a fraction of that record.
//!
//! Invariant: record numbers wrap at 2³² and are compared by wrapping difference only. Two places on one path must
//! therefore be less than 2³¹ records apart. A ring is far smaller.

use crate::Distance;

/// Place on the recorded path (REV, *Exactness*): `fraction`/2³² of record `record` is behind it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Place {
    /// Number of the record under the place; wraps at 2³².
    pub record: u32,
    /// Fraction of that record that is behind the place, in units of 2⁻³².
    pub fraction: u32,
}

impl Place {
    /// Returns the place between record `record` − 1 and record `record`.
    #[must_use]
    pub const fn start_of(record: u32) -> Self {
        Self { record, fraction: 0 }
    }

    /// Returns the place `distance` further along the path, backward if negative. |distance| must be below 2³¹ records.
    #[must_use]
    pub const fn moved(self, distance: Distance) -> Self {
        let sum = self.fraction as i64 + distance.units();
        Self { record: self.record.wrapping_add((sum >> 32) as u32), fraction: sum as u32 }
    }

    /// Returns the signed distance from this place to `to`: positive if `to` is ahead.
    #[must_use]
    pub const fn distance_to(self, to: Self) -> Distance {
        let records = to.record.wrapping_sub(self.record) as i32 as i64;
        Distance::from_units((records << 32) + to.fraction as i64 - self.fraction as i64)
    }

    /// Returns the share of the record that is behind the place, from 0 up to 1, for displays.
    #[must_use]
    pub fn fraction_of_record(self) -> f64 {
        f64::from(self.fraction) / 4_294_967_296.0
    }

    /// Returns the first record boundary that is not behind this place.
    #[must_use]
    pub const fn boundary_ahead(self) -> u32 {
        if self.fraction == 0 { self.record } else { self.record.wrapping_add(1) }
    }
}

/// Whether record number `a` is before `b`, by wrapping difference.
#[must_use]
pub const fn is_before(a: u32, b: u32) -> bool {
    (a.wrapping_sub(b) as i32) < 0
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
                    let (from, distance) = (Place { record, fraction }, Distance::from_units(units));
                    let to = from.moved(distance);
                    assert_eq!(from.distance_to(to), distance);
                    assert_eq!(to.moved(-distance), from);
                }
            }
        }
    }

    #[test]
    fn the_boundary_ahead_is_the_place_itself_where_the_fraction_is_zero() {
        assert_eq!(Place::start_of(7).boundary_ahead(), 7);
        assert_eq!(Place { record: u32::MAX, fraction: 1 }.boundary_ahead(), 0);
        assert!(is_before(u32::MAX, 0) && !is_before(0, u32::MAX) && !is_before(3, 3));
    }
}
