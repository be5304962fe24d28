//! The regions that a property must reach, so that no proof is about less than it says.
//!
//! Invariant: a region counts as reached only by a run that is within all assumptions to its end.

macro_rules! regions {
    ($($(#[doc = $words:literal])* $region:ident,)*) => {
        /// A region of the states or choices of a property.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Region {
            $($(#[doc = $words])* $region,)*
        }

        impl Region {
            /// Every region, in the order of their bits.
            pub const ALL: &[Self] = &[$(Self::$region,)*];

            /// Its name in the ledger.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$region => stringify!($region),)*
                }
            }
        }
    };
}

regions! {
    /// Nothing is held, retained or sent.
    Empty,
    /// There is no room for more.
    Full,
    /// Numbers in use continue at 0 after 2³² − 1.
    Wrapped,
    /// The cursor is at an end: of what is retained, of the window, of what is planned.
    AtEnd,
    /// Nothing moves.
    AtRest,
    /// Motion along the path.
    Forward,
    /// Motion against the path, or in the negative direction of an axis.
    Backward,
    /// A rate or an increment grows.
    Rising,
    /// A rate or an increment becomes smaller.
    Falling,
    /// A planned stop takes part.
    PlannedStop,
    /// A record is split by the place of the cursor.
    Split,
    /// A value is limited by its bound.
    Limited,
    /// The code under test accepts what is requested.
    Accepted,
    /// The code under test refuses what is requested.
    Refused,
    /// A payload with a byte that is zero.
    ZeroByte,
    /// The error strikes length or body of a frame.
    InBody,
    /// The error strikes the check of a frame.
    InCheck,
    /// Normal run.
    NormalRun,
    /// Normal run was left, and the cursor has not been at rest since.
    Leaving,
    /// Normal run is entered again.
    Rejoined,
    /// A hold is in force.
    Held,
    /// Outputs differ from those of the place.
    OutputsDiffer,
    /// A cutting output is on.
    Lit,
    /// A cutting output was switched off by the card.
    PutOut,
    /// The input that proves a cutter has been inactive for too long.
    Lost,
    /// The spindle turns.
    SpindleTurns,
}

impl Region {
    /// Its bit in a set of regions.
    #[must_use]
    pub const fn bit(self) -> u64 {
        1 << self as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_region_has_a_bit_of_its_own() {
        assert!(Region::ALL.len() <= 64);
        for (at, region) in Region::ALL.iter().enumerate() {
            assert_eq!(region.bit(), 1 << at);
        }
    }
}
