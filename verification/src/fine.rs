//! Fine interpolation and sizes: exactly p pulses in S slots, and REV-4's arithmetic.
//!
//! Invariant: the accumulator of [`PulseSlots`] is compared with positions that are computed here by multiplication.

use crate::choice::Choice;
use crate::harness::{harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row, Search, Size};
use retrace_core::fine::PulseSlots;
use retrace_core::size::{history_bytes, history_records, ring_cells};

/// p pulses in up to `MOST` slots: exactly p, spacings that differ by at most one, and slot 0 empty while the pulses
/// fill less than half of the slots.
fn evenly_spaced<const MOST: u32>(c: &mut impl Choice) -> Option<()> {
    let slots = 1 + c.below(MOST);
    let pulses = c.below(slots + 1);
    let mut fine = PulseSlots::new(pulses as u16, slots);
    let (mut count, mut last, mut least, mut most) = (0, MOST, MOST, 0);
    let mut slot = 0;
    while slot < MOST {
        if slot < slots && fine.next_slot() {
            if count > 0 {
                let gap = slot - last;
                least = if gap < least { gap } else { least };
                most = if gap > most { gap } else { most };
            } else {
                holds!(slot > 0 || 2 * pulses >= slots);
            }
            (count, last) = (count + 1, slot);
        }
        slot += 1;
    }
    holds!(count == pulses && (count < 2 || most - least <= 1));
    Some(())
}

/// The size never panics or wraps: it equals the result in 128 bits, or there is none.
fn sizes_do_not_wrap(c: &mut impl Choice) -> Option<()> {
    let (axis, axes, period) = (c.word(), c.word(), 2_500);
    let history = u64::from(c.word()) << 32 | u64::from(c.word());
    let bytes = history_bytes(axis, axes, history, period);
    match history_records(history, period) {
        None => holds!(history > u64::MAX / 1000 && bytes.is_none()),
        Some(records) => {
            let product = records.checked_mul(u64::from(axis));
            holds!(bytes == product.and_then(|product| product.checked_mul(u64::from(axes))));
        }
    }
    holds!(history_bytes(axis, axes, history, 0).is_none());
    holds!(history_bytes(2, 3, 1_800_000, 2_500) == Some(4_320_000));
    Some(())
}

/// The number of cells is a power of two that is sufficient, and the least one.
fn cells_are_enough(c: &mut impl Choice) -> Option<()> {
    let (keep, look_ahead) = (c.word(), c.word());
    let asked = u64::from(keep) + u64::from(look_ahead);
    match ring_cells(keep, look_ahead) {
        None => holds!(asked == 0 || asked > 1 << 30),
        Some(cells) => {
            holds!(cells & (cells - 1) == 0 && u64::from(cells) >= asked && u64::from(cells / 2) < asked);
        }
    }
    Some(())
}

harnesses! {
    fine_8, unwind 9 => |c| evenly_spaced::<8>(c);
    fine_16, unwind 17 => |c| evenly_spaced::<16>(c);
    size_cells, unwind 1 => |c| cells_are_enough(c);
    [without kani]
    size_bytes, unwind 1 => |c| sizes_do_not_wrap(c);
}

/// Every number of pulses in every period up to 400 slots, compared with the closed form.
#[cfg(not(any(kani, verify_wasm)))]
fn every_period(size: Size) -> String {
    let most = if size.full { 1000 } else { 300 };
    for slots in 1..=most {
        for pulses in 0..=slots {
            let mut fine = PulseSlots::new(pulses as u16, slots);
            let walked: Vec<u32> = (0..slots).filter(|_| fine.next_slot()).collect();
            let closed: Vec<u32> = retrace_core::fine::pulse_slots(pulses as u16, slots).collect();
            assert_eq!(walked.len(), pulses as usize);
            assert_eq!(walked, closed);
        }
    }
    format!("every count in every period of up to {most} slots")
}

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[
    Row {
        name: "fine-pulses",
        says: "A period of S slots yields exactly p pulses at spacings that differ by at most one slot; slot 0 stays \
            empty for the direction to be set up while p < S/2",
        requirement: "GMC-1 (fine interpolation), design idea 1",
        bound: "periods of up to 16 slots, any p ≤ S; natively up to 300 (full: 1 000) slots, compared with the \
            closed form",
        assumes: "p ≤ S, which holds for the machine file's fastest axis",
        suffices: "the accumulator is a remainder modulo S; S enters by comparison and subtraction only",
        harnesses: &["fine_8", "fine_16"],
        searches: &[Search { name: "fine-every", run: every_period }],
        models: &[],
        mutants: &[
            Mutant {
                name: "the remainder is dropped at each pulse",
                file: "crates/core/src/fine.rs",
                find: "self.accumulator -= self.slots;",
                put: "self.accumulator = 0;",
                killer: "fine_8",
            },
            Mutant {
                name: "the first pulse comes at once",
                file: "crates/core/src/fine.rs",
                find: "accumulator: slots / 2 }",
                put: "accumulator: slots - 1 }",
                killer: "fine_16",
            },
        ],
    },
    Row {
        name: "size",
        says: "The sizes of REV-4 never wrap, give the source's example, and the number of the ring's cells is the \
            least sufficient power of two",
        requirement: "REV-4",
        bound: "any bytes, axes and history at T = 2.5 ms; any keep and look-ahead",
        assumes: "nothing",
        suffices: "the period enters by one division whose divisor only has to be other than zero",
        harnesses: &["size_cells", "size_bytes"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "bytes that wrap",
                file: "crates/core/src/size.rs",
                find: "Some(bytes) => bytes.checked_mul(axes as u64),",
                put: "Some(bytes) => Some(bytes.wrapping_mul(axes as u64)),",
                killer: "size_bytes",
            },
            Mutant {
                name: "cells one size too small",
                file: "crates/core/src/size.rs",
                find: "Some((cells as u32).next_power_of_two())",
                put: "Some((cells as u32 / 2 + 1).next_power_of_two())",
                killer: "size_cells",
            },
        ],
    },
];
