//! Places on the recorded path: a record number and a fraction of that record.
//!
//! Invariant: place numbers wrap at 2³²; they are compared by wrapping difference only, so that two places on one path
//! must lie less than 2³¹ records apart. A ring is far smaller.

/// A distance along the recorded path, or a rate in records a control period: signed, in units of 2⁻³² records.
pub type Travel = i64;

/// One whole record, as [`Travel`].
pub const ONE: Travel = 1 << 32;

/// A place on the recorded path (REV, *Exactness*): `fraction`/2³² of record `record` lies behind it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Place {
    /// Number of the record under the place; wraps.
    pub record: u32,
    /// Share of that record that lies behind the place, in 2⁻³².
    pub fraction: u32,
}

impl Place {
    /// The place between record `record` − 1 and record `record`.
    #[must_use]
    pub const fn start_of(record: u32) -> Self {
        Self { record, fraction: 0 }
    }

    /// The place `travel` further along the path (backward where negative). |travel| < 2³¹ records.
    #[must_use]
    pub const fn moved(self, travel: Travel) -> Self {
        let sum = self.fraction as i64 + travel;
        Self { record: self.record.wrapping_add((sum >> 32) as u32), fraction: sum as u32 }
    }

    /// How far `to` lies ahead of this place; negative where it lies behind.
    #[must_use]
    pub const fn to(self, to: Self) -> Travel {
        ((to.record.wrapping_sub(self.record) as i32 as i64) << 32) + to.fraction as i64 - self.fraction as i64
    }

    /// The first record boundary that is not behind this place.
    #[must_use]
    pub const fn boundary_ahead(self) -> u32 {
        if self.fraction == 0 { self.record } else { self.record.wrapping_add(1) }
    }
}

/// Does record number `a` come before `b`? By wrapping difference.
#[must_use]
pub const fn before(a: u32, b: u32) -> bool {
    (a.wrapping_sub(b) as i32) < 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moving_there_and_back_is_the_identity_over_the_wrap() {
        for record in [0, 1, u32::MAX, u32::MAX - 1, 1 << 31] {
            for fraction in [0, 1, 1 << 31, u32::MAX] {
                for travel in [0, 1, -1, ONE, -ONE, ONE / 3, -ONE * 7 - 5, ONE * 1000 + 1] {
                    let from = Place { record, fraction };
                    let to = from.moved(travel);
                    assert_eq!(from.to(to), travel);
                    assert_eq!(to.moved(-travel), from);
                }
            }
        }
    }

    #[test]
    fn the_boundary_ahead_is_the_place_itself_where_the_fraction_is_zero() {
        assert_eq!(Place::start_of(7).boundary_ahead(), 7);
        assert_eq!(Place { record: u32::MAX, fraction: 1 }.boundary_ahead(), 0);
        assert!(before(u32::MAX, 0) && !before(0, u32::MAX) && !before(3, 3));
    }
}
