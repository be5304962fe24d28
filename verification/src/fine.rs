//! Fine interpolation and sizes: exactly p pulses in S slots, and REV-4's arithmetic.
//!
//! Invariant: the accumulator of [`PulseSlots`] is compared with positions that are computed here by multiplication.

use crate::choice::Choice;
use crate::harness::{built, cover, harnesses, holds};
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
    cover!(c, Empty, pulses == 0);
    cover!(c, Full, pulses == slots);
    cover!(c, Split, count > 1 && most != least);
    holds!(count == pulses && (count < 2 || most - least <= 1));
    Some(())
}

/// The size never panics or wraps: it equals the result in 128 bits, or there is none.
fn sizes_do_not_wrap(c: &mut impl Choice) -> Option<()> {
    let (axis, axes, period) = (c.word(), c.word(), 2_500);
    let history = u64::from(c.word()) << 32 | u64::from(c.word());
    // before the computation, so that the compiler sees both products side by side
    cover!(c, Accepted, history <= u64::MAX / 1000);
    cover!(c, Refused, history > u64::MAX / 1000);
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

/// Control periods in microseconds for which the number of records is proved.
const PERIODS: [u64; 6] = [125, 250, 500, 1000, 2500, 10_000];

/// The number of records is ⌈h/T⌉: as many periods are at least as long as the history, one less is shorter.
fn records_fill_the_history(c: &mut impl Choice) -> Option<()> {
    let history = u64::from(c.upto(4095));
    cover!(c, Empty, history == 0);
    cover!(c, Full, history == 4095);
    let mut n = 0;
    while n < PERIODS.len() {
        let (period, us) = (PERIODS[n], history * 1000);
        let records = built!(history_records(history, period));
        let (long, short) = (records * period, records.saturating_sub(1) * period);
        holds!(us <= long && (short < us || records == 0));
        n += 1;
    }
    Some(())
}

/// Drawn histories and periods of any size, compared with ⌈h/T⌉ in 128 bits, and bytes with the product.
#[cfg(not(any(kani, verify_wasm)))]
fn sizes_of_any_period(size: Size) -> String {
    let mut draw = crate::native::Draw::new(size.seed);
    let (runs, mut refused) = (if size.full { 10_000_000 } else { 1_000_000 }, 0u64);
    let any_long =
        |draw: &mut crate::native::Draw| (u64::from(draw.word()) << 32 | u64::from(draw.word())) >> draw.below(64);
    for _ in 0..runs {
        let (history, period) = (any_long(&mut draw), any_long(&mut draw));
        let (axis, axes) = (draw.word(), draw.word());
        let us = u128::from(history) * 1000;
        let fits = |number: u128| u64::try_from(number).ok();
        let records = if period == 0 { None } else { fits(us).map(|_| us.div_ceil(u128::from(period))) };
        assert_eq!(history_records(history, period).map(u128::from), records);
        let bytes =
            records.and_then(|records| fits(records.checked_mul(u128::from(axis))?.checked_mul(u128::from(axes))?));
        let exact = history_bytes(axis, axes, history, period);
        // a product that would fit again after a factor 0 may be refused
        assert!(exact == bytes || exact.is_none() && axes == 0, "{history} {period} {axis} {axes}");
        refused += u64::from(exact.is_none());
    }
    assert!(0 < refused && refused < runs);
    format!("{runs} drawn histories and periods, {refused} of them refused")
}

/// The number of cells is a power of two that is sufficient, and the least one.
fn cells_are_enough(c: &mut impl Choice) -> Option<()> {
    let (keep, look_ahead) = (c.word(), c.word());
    let asked = u64::from(keep) + u64::from(look_ahead);
    cover!(c, Empty, asked == 0);
    cover!(c, Accepted, 0 < asked && asked <= 1 << 30);
    cover!(c, Refused, asked > 1 << 30);
    match ring_cells(keep, look_ahead) {
        None => holds!(asked == 0 || asked > 1 << 30),
        Some(cells) => {
            holds!(cells & (cells - 1) == 0 && u64::from(cells) >= asked && u64::from(cells / 2) < asked);
        }
    }
    Some(())
}

harnesses! {
    fine_8, unwind 10, covers [Empty, Full, Split] => |c| evenly_spaced::<8>(c);
    fine_16, unwind 18, covers [Empty, Full, Split] => |c| evenly_spaced::<16>(c);
    size_cells, unwind 2, covers [Empty, Accepted, Refused] => |c| cells_are_enough(c);
    size_records, unwind 7, covers [Empty, Full] => |c| records_fill_the_history(c);
    size_bytes, unwind 2, covers [Accepted, Refused] => |c| sizes_do_not_wrap(c);
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
        says: "The records of a history are ⌈h/T⌉, the sizes of REV-4 never wrap and give the source's example, and \
            the number of the ring's cells is the least sufficient power of two",
        requirement: "REV-4",
        bound: "records: any history up to 4095 ms at six periods from 125 µs to 10 ms; bytes: any bytes, axes \
            and history at T = 2.5 ms, from the number of records; any keep and look-ahead; natively drawn histories \
            and periods of 64 bits",
        assumes: "nothing",
        suffices: "the period enters by one division, which is the hardware's",
        harnesses: &["size_cells", "size_records", "size_bytes"],
        searches: &[Search { name: "size-drawn", run: sizes_of_any_period }],
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
                name: "a history that is not a whole number of periods is cut short",
                file: "crates/core/src/size.rs",
                find: "Some(us.div_ceil(period_us))",
                put: "Some(us / period_us)",
                killer: "size_records",
            },
            Mutant {
                name: "one record more than the history has",
                file: "crates/core/src/size.rs",
                find: "Some(us) => Some(us.div_ceil(period_us)),",
                put: "Some(us) => Some(us / period_us + 1),",
                killer: "size-drawn",
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
