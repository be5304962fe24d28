//! Values and modes that a check does not know: answers of the machine, and what depends on them (PRB-17).
//!
//! Invariant: an unknown value is a NaN. No calculation on known values gives one, because the evaluation refuses
//! results that are not finite. What is calculated from an unknown value is unknown.

/// A value that is not known.
pub(crate) const UNKNOWN: f64 = f64::NAN;

/// Bits of the value of a named parameter that only some of the followed branches have assigned: neither its value nor
/// its existence is known.
const UNKNOWN_EXISTENCE: u64 = 0x7ff8_0000_0000_0001;

/// Returns the value of a named parameter that may not exist.
pub(crate) const fn unknown_existence() -> f64 {
    f64::from_bits(UNKNOWN_EXISTENCE)
}

/// Whether it is not known that a named parameter of this value exists.
pub(crate) const fn has_unknown_existence(value: f64) -> bool {
    value.to_bits() == UNKNOWN_EXISTENCE
}

/// Joins a value with that of another branch: it stays known if both are the same to the bit.
pub(crate) fn join(value: &mut f64, other: f64) {
    if value.to_bits() != other.to_bits() && !has_unknown_existence(*value) {
        *value = if has_unknown_existence(other) { other } else { UNKNOWN };
    }
}

/// A set of modes whose value is not known: each bit is one mode or group of modes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct UnknownModes(u32);

impl UnknownModes {
    pub(crate) const NONE: UnknownModes = UnknownModes(0);
    pub(crate) const MOTION: UnknownModes = UnknownModes(1);
    pub(crate) const PLANE: UnknownModes = UnknownModes(1 << 1);
    pub(crate) const UNITS: UnknownModes = UnknownModes(1 << 2);
    pub(crate) const DISTANCE: UnknownModes = UnknownModes(1 << 3);
    pub(crate) const ARC_CENTRES: UnknownModes = UnknownModes(1 << 4);
    pub(crate) const FEED_MODE: UnknownModes = UnknownModes(1 << 5);
    pub(crate) const SYSTEM: UnknownModes = UnknownModes(1 << 6);
    pub(crate) const RETRACT: UnknownModes = UnknownModes(1 << 7);
    /// Direction of the spindle, and whether its surface speed is constant.
    pub(crate) const SPINDLE: UnknownModes = UnknownModes(1 << 8);
    /// Coolant and overrides.
    pub(crate) const SWITCHES: UnknownModes = UnknownModes(1 << 9);
    pub(crate) const SELECTED_TOOL: UnknownModes = UnknownModes(1 << 10);
    pub(crate) const CURRENT_TOOL: UnknownModes = UnknownModes(1 << 11);
    pub(crate) const COMPENSATION: UnknownModes = UnknownModes(1 << 12);
    pub(crate) const LATHE_DIAMETER: UnknownModes = UnknownModes(1 << 13);
    /// Whether the last subprogram has returned a value.
    pub(crate) const RETURNED: UnknownModes = UnknownModes(1 << 14);
    /// Retained words of a drilling cycle.
    pub(crate) const SERIES: UnknownModes = UnknownModes(1 << 15);
    /// Points and direction of a spline.
    pub(crate) const SPLINE: UnknownModes = UnknownModes(1 << 16);
    /// States that M70 and M73 have saved.
    pub(crate) const SAVED: UnknownModes = UnknownModes(1 << 17);
    /// State of the cut cycle, and the material.
    pub(crate) const CUTTING: UnknownModes = UnknownModes(1 << 18);
    /// Every mode.
    pub(crate) const ALL: UnknownModes = UnknownModes((1 << 19) - 1);

    /// Whether no mode is unknown.
    pub(crate) const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether any of these modes is unknown.
    pub(crate) const fn has(self, modes: UnknownModes) -> bool {
        self.0 & modes.0 != 0
    }

    /// Makes these modes unknown if `is_unknown`.
    pub(crate) fn add(&mut self, modes: UnknownModes, is_unknown: bool) {
        if is_unknown {
            self.0 |= modes.0;
        }
    }

    /// Makes these modes known: a code has set them.
    pub(crate) fn remove(&mut self, modes: UnknownModes) {
        self.0 &= !modes.0;
    }

    /// The modes that are unknown here or there.
    #[must_use]
    pub(crate) const fn union(self, other: UnknownModes) -> UnknownModes {
        UnknownModes(self.0 | other.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_stays_known_where_both_branches_have_the_same_bits() {
        let joined = |mut value: f64, other| {
            join(&mut value, other);
            value
        };
        assert_eq!(joined(2.0, 2.0), 2.0);
        assert!(joined(2.0, 3.0).is_nan() && joined(UNKNOWN, 3.0).is_nan() && joined(3.0, UNKNOWN).is_nan());
        assert!(joined(0.0, -0.0).is_nan(), "ATAN and a division distinguish them");
        assert!(has_unknown_existence(joined(2.0, unknown_existence())));
        assert!(has_unknown_existence(joined(unknown_existence(), 2.0)));
    }
}
