//! One control period's increments, and what belongs to them (REV-1).
//!
//! Invariant: the size of a record never varies; for up to four axes it is 16 bytes.

/// What the planner says of a record beside its increments.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Flags(u8);

impl Flags {
    /// Nothing special.
    pub const NONE: Self = Self(0);
    /// Planned stop: the motion is at rest, with zero acceleration, at the END of this record. An end here is an end and
    /// not starvation, and the rate may change at will at that place.
    pub const REST: Self = Self(1);
    /// An exclusive instruction (GMC-3) stands behind this record. Always together with [`Flags::REST`].
    pub const MARKER: Self = Self(2);
    /// All of the record's motion is rapid motion (G0): the rapid override applies, not the feed override.
    pub const RAPID: Self = Self(4);

    /// Both sets of flags.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Are all of `other` set?
    #[must_use]
    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Those of them that the next record has as well, as a rule.
    #[must_use]
    pub const fn lasting(self) -> Self {
        Self(self.0 & Self::RAPID.0)
    }

    /// The bits, for the wire.
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// From the bits on the wire; unknown bits are dropped.
    #[must_use]
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits & 7)
    }
}

/// The highest |rate| at which a record may be retraced with the cutting outputs off, in sixteenths (1/16 … 8).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct RapidCap(
    /// Sixteenths above [`RapidCap::PLANNED`], so that a record without motion is all zeros.
    u8,
);

const PLANNED_SIXTEENTHS: u8 = 16;

impl RapidCap {
    /// As recorded: no faster than planned.
    pub const PLANNED: Self = Self(0);
    /// The largest cap there is: eight times as planned.
    pub const MAX: Self = Self(128 - PLANNED_SIXTEENTHS);

    /// A cap of `n` sixteenths, held within 1 … 8.
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

    /// The cap in sixteenths.
    #[must_use]
    pub const fn get(self) -> u8 {
        self.0 + PLANNED_SIXTEENTHS
    }
}

impl Default for RapidCap {
    fn default() -> Self {
        Self::PLANNED
    }
}

/// One control period's increments for `A` axes, and what belongs to them (REV-1).
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Record<const A: usize> {
    /// Signed whole pulses of each axis in this control period.
    pub increments: [i16; A],
    /// The program line that this motion belongs to; 0 where there is none.
    pub line: u32,
    /// What the planner says of this record.
    pub flags: Flags,
    /// How fast it may be retraced.
    pub cap: RapidCap,
    /// Reserved; zero.
    pub spare: u16,
}

impl<const A: usize> Record<A> {
    /// A control period without motion.
    pub const STILL: Self = Self { increments: [0; A], line: 0, flags: Flags::NONE, cap: RapidCap::PLANNED, spare: 0 };
}

impl<const A: usize> Default for Record<A> {
    fn default() -> Self {
        Self::STILL
    }
}

const _: () = assert!(size_of::<Record<4>>() == 16 && size_of::<Record<3>>() <= 16);
