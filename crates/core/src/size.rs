//! Ring sizes (REV-4).
//!
//! Invariant: no overflow; a size that does not fit is `None`.

/// Returns the bytes that REV-4 requires: `L = n · a · (history) / T`, with the number of control periods rounded up.
///
/// `bytes_per_axis` (n): bytes of one axis' pulse count and direction; `axes` (a); `history_ms`: required length of the
/// reverse run, in milliseconds; `period_us`: control period *T*, in microseconds. `None` if the period is zero or the
/// size does not fit 64 bits.
///
/// ```
/// // The source's example: n = 2, a = 3, h = 0.5, T = 2.5 ms
/// assert_eq!(retrace_core::size::history_bytes(2, 3, 1_800_000, 2_500), Some(4_320_000));
/// ```
#[must_use]
pub const fn history_bytes(bytes_per_axis: u32, axes: u32, history_ms: u64, period_us: u64) -> Option<u64> {
    let Some(records) = history_records(history_ms, period_us) else { return None };
    match records.checked_mul(bytes_per_axis as u64) {
        Some(bytes) => bytes.checked_mul(axes as u64),
        None => None,
    }
}

/// Returns the records in `history_ms` milliseconds of motion at a control period of `period_us` microseconds, rounded
/// up.
///
/// Returns `None` if the period is zero or the product does not fit 64 bits.
#[must_use]
pub const fn history_records(history_ms: u64, period_us: u64) -> Option<u64> {
    if period_us == 0 {
        return None;
    }
    match history_ms.checked_mul(1000) {
        Some(us) => Some(us.div_ceil(period_us)),
        None => None,
    }
}

/// Returns the number of cells of a ring that retains `keep` records behind `reached` and plans `look_ahead` records
/// beyond it: the next power of two.
///
/// Returns `None` for zero, and above 2³⁰ cells, where differences of record numbers would approach the wrap.
#[must_use]
pub const fn ring_cells(keep: u32, look_ahead: u32) -> Option<u32> {
    let cells = keep as u64 + look_ahead as u64;
    if cells == 0 || cells > 1 << 30 { None } else { Some((cells as u32).next_power_of_two()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_round_up_and_never_overflow() {
        assert_eq!(history_records(1, 3), Some(334));
        assert_eq!(history_bytes(u32::MAX, u32::MAX, u64::MAX / 1000, 1), None);
        assert_eq!(history_bytes(2, 3, u64::MAX, 1), None);
        assert_eq!(history_bytes(2, 3, 1, 0), None);
        assert_eq!(ring_cells(1_800_000, 500), Some(1 << 21));
        assert_eq!(ring_cells(u32::MAX, 1), None);
        assert_eq!(ring_cells(0, 0), None);
    }
}
