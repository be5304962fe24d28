//! The motion record: the increments of one control period with line number, flags and rate cap (REV-1).
//!
//! Invariant: the size of a record is fixed; for up to four axes it is 16 bytes.

use crate::Rate;

/// Flags that the planner sets on a record.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Flags(u8);

impl Flags {
    /// No flag.
    pub const NONE: Self = Self(0);
    /// Planned stop: the motion is at rest, with zero acceleration, at the END of this record. Records that end here
    /// end as planned, without starvation, and the rate may change to any value at that place.
    pub const REST: Self = Self(1);
    /// An exclusive instruction (GMC-3) follows this record. Always set together with [`Flags::REST`].
    pub const MARKER: Self = Self(2);
    /// All of the record's motion is rapid motion (G0): the rapid override applies, not the feed override.
    pub const RAPID: Self = Self(4);
    /// The record belongs to a probing move: the probe may respond in it (PRB-10).
    pub const PROBING: Self = Self(8);
    /// The feed of the record's motion is per turn of the spindle: it follows the measured speed (SPN-8).
    pub const PER_TURN: Self = Self(16);
    /// The record belongs to a geared stretch: its place follows the spindle's angle (SPN-11).
    pub const GEARED: Self = Self(32);

    /// Returns the union of both sets of flags.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether all flags of `other` are set.
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Returns the flags that the next record usually has as well.
    #[must_use]
    pub const fn lasting(self) -> Self {
        Self(self.0 & (Self::RAPID.0 | Self::PROBING.0 | Self::PER_TURN.0 | Self::GEARED.0))
    }

    /// Returns the flags as the bits sent on the wire.
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// Returns the flags for the bits received on the wire; unknown bits are dropped.
    #[must_use]
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits & 63)
    }
}

/// Maximum |rate| at which a record may be retraced with the cutting outputs off, in sixteenths (1/16 … 8).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct RapidCap(
    /// Sixteenths above [`RapidCap::PLANNED`], so that a record without motion is all zeros.
    u8,
);

const PLANNED_SIXTEENTHS: u8 = 16;

impl RapidCap {
    /// The planned rate: as recorded, and no faster.
    pub const PLANNED: Self = Self(0);
    /// Maximum cap: eight times the planned rate.
    pub const MAX: Self = Self(128 - PLANNED_SIXTEENTHS);

    /// Returns a cap of `n` sixteenths, clamped to 1 … 8.
    #[must_use]
    pub const fn sixteenths(n: u8) -> Self {
        if n < PLANNED_SIXTEENTHS {
            Self::PLANNED
        } else if n > Self::MAX.get() {
            Self::MAX
        } else {
            Self(n - PLANNED_SIXTEENTHS)
        }
    }

    /// Returns the cap in sixteenths.
    #[must_use]
    pub const fn get(self) -> u8 {
        self.0 + PLANNED_SIXTEENTHS
    }

    /// Returns the cap as a rate.
    #[must_use]
    pub const fn rate(self) -> Rate {
        Rate::from_units((self.get() as i64) << 28)
    }
}

impl Default for RapidCap {
    fn default() -> Self {
        Self::PLANNED
    }
}

/// Speed along the path in a record at the recorded rate, as a share of the programmed feed: units of 2⁻¹⁵ (CUT-20).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct FeedShare(u16);

impl FeedShare {
    /// No feed motion: a rapid move, or no motion at all.
    pub const NONE: Self = Self(0);
    /// The programmed feed.
    pub const FEED: Self = Self(1 << 15);

    /// Returns the share of `units` of 2⁻¹⁵.
    #[must_use]
    pub const fn from_units(units: u16) -> Self {
        Self(units)
    }

    /// Returns the share in units of 2⁻¹⁵.
    #[must_use]
    pub const fn units(self) -> u16 {
        self.0
    }
}

/// Motion record of one control period for `A` axes (REV-1).
///
/// # Examples
///
/// ```
/// use retrace_core::{Flags, Record};
///
/// // one period of motion of three axes, at the end of which the path is at rest
/// let record = Record { increments: [12, -3, 0], line: 7, flags: Flags::REST, ..Record::default() };
/// assert!(record.flags.contains(Flags::REST));
/// ```
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Record<const A: usize> {
    /// Signed whole pulses of each axis in this control period.
    pub increments: [i16; A],
    /// Number of the program line that this motion belongs to; 0 if there is none.
    pub line: u32,
    /// Flags set by the planner.
    pub flags: Flags,
    /// Maximum rate at which the record may be retraced.
    pub cap: RapidCap,
    /// Speed along the path as a share of the programmed feed; zero where no power follows it.
    pub feed_share: FeedShare,
}

impl<const A: usize> Record<A> {
    /// Record of a control period without motion.
    pub const ZERO: Self =
        Self { increments: [0; A], line: 0, flags: Flags::NONE, cap: RapidCap::PLANNED, feed_share: FeedShare::NONE };
}

impl<const A: usize> Default for Record<A> {
    fn default() -> Self {
        Self::ZERO
    }
}

const _: () = assert!(size_of::<Record<4>>() == 16 && size_of::<Record<3>>() <= 16);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_feed_has_a_share_of_one() {
        assert_eq!(FeedShare::from_units(FeedShare::FEED.units()), FeedShare::FEED);
        assert_eq!(u32::from(FeedShare::FEED.units()) << 1, 1 << 16);
        assert_eq!(Record::<2>::ZERO.feed_share, FeedShare::default());
    }

    #[test]
    fn caps_are_clamped_to_one_and_eight() {
        for sixteenths in 0..=u8::MAX {
            let cap = RapidCap::sixteenths(sixteenths);
            assert_eq!(cap.get(), sixteenths.clamp(16, 128));
            assert!(Rate::ONE <= cap.rate() && cap.rate() <= Rate::MAX);
        }
    }

    #[test]
    fn flags_are_contained_whatever_others_are_set() {
        let flags = [Flags::REST, Flags::MARKER, Flags::RAPID];
        for set in (0..8).map(Flags::from_bits) {
            for (bit, flag) in flags.into_iter().enumerate() {
                assert_eq!(set.contains(flag), set.bits() >> bit & 1 == 1, "{set:?} {flag:?}");
            }
        }
    }
}
