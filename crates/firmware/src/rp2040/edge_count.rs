//! The part of a control period in which the probe's edge was, from the count of a state machine
//! ([`super::pio_programs`]).
//!
//! Invariant: a period that was longer than planned has an edge at its end.

/// Cycles from the edge to the count, besides two for each count: `mov`, and the loop is left in its second half or its
/// first.
const CYCLES_OF_CAPTURE: u32 = 2;

/// Returns the part of the last period in which the edge was, in units of 2⁻¹⁶. `counts`: from the edge to the
/// beginning of this period; `period`: planned cycles of the last one; `is_late`: it was longer than that.
#[must_use]
pub fn edge_part(counts: u32, period: u32, is_late: bool) -> u16 {
    let period = period.max(1);
    let until_end = counts.saturating_mul(2).saturating_add(CYCLES_OF_CAPTURE).min(period);
    let part = (u64::from(period - until_end) << 16) / u64::from(period);
    if is_late { u16::MAX } else { part.min(u64::from(u16::MAX)) as u16 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edge_is_in_the_part_of_its_period() {
        for (counts, part) in [(0, 65_534), (31_249, 32_768), (62_499, 0), (u32::MAX, 0)] {
            assert_eq!(edge_part(counts, 125_000, false), part, "{counts}");
        }
        assert_eq!(edge_part(5, 125_000, true), u16::MAX, "at the end of a late period");
    }
}
