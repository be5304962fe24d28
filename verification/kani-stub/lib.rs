//! A stub of the `kani` crate with what the harnesses use, so that they compile in every test run where Kani is not
//! installed.
//!
//! Invariant: it proves nothing. `any` draws, `assume` ends a run outside the assumptions, and a driver runs each proof
//! so often that one that panics anyway is noticed.
#![forbid(unsafe_code)]

pub use kani_macros::{proof, unwind};

use std::cell::{Cell, RefCell};
use std::panic::{catch_unwind, panic_any};

thread_local! {
    /// State of the generator.
    static STATE: Cell<u64> = const { Cell::new(0) };
    /// Numbers drawn in this run, and how many of them were requested again.
    static DRAWN: RefCell<(Vec<u64>, usize)> = const { RefCell::new((Vec::new(), 0)) };
}

/// A type of which values can be drawn.
pub trait Arbitrary {
    /// Any value.
    fn any() -> Self;
}

/// Any value. Half of them are small or near the wrap, so that assumptions are met often enough.
pub fn any<T: Arbitrary>() -> T {
    T::any()
}

/// Continues only where `holds`.
pub fn assume(holds: bool) {
    if !holds {
        panic_any(Outside);
    }
}

/// States what some run must reach; here it is only evaluated.
#[macro_export]
macro_rules! cover {
    ($condition:expr) => {
        let _: bool = $condition;
    };
}

/// Panic payload of a run outside the assumptions.
struct Outside;

/// SplitMix64 (Steele, Lea, Flood 2014).
fn draw_new() -> u64 {
    STATE.with(|state| {
        state.set(state.get().wrapping_add(0x9E37_79B9_7F4A_7C15));
        let mut z = state.get();
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    })
}

/// The number drawn here in the run before, as far as that one is repeated, or a new one.
fn draw() -> u64 {
    DRAWN.with_borrow_mut(|(drawn, at)| {
        if *at == drawn.len() {
            drawn.push(draw_new());
        }
        *at += 1;
        drawn[*at - 1]
    })
}

/// How far a run came before it left the assumptions.
fn far() -> usize {
    DRAWN.with_borrow(|(drawn, _)| drawn.len())
}

/// Draws the last `many` numbers of the run again in the next one.
fn forget(many: usize) {
    DRAWN.with_borrow_mut(|(drawn, at)| {
        drawn.truncate(drawn.len().saturating_sub(many));
        *at = 0;
    });
}

macro_rules! numbers {
    ($($number:ty)*) => { $(
        impl Arbitrary for $number {
            fn any() -> Self {
                let drawn = draw();
                match drawn & 7 {
                    0 => (drawn >> 60) as Self,
                    1 => (drawn >> 62) as Self,
                    2 => ((drawn >> 60) as Self).wrapping_neg(),
                    3 => (drawn >> 32) as u8 as Self,
                    _ => drawn.rotate_left(16) as Self,
                }
            }
        }
    )* };
}
numbers! { u8 u16 u32 u64 usize i8 i16 i32 i64 isize }

impl Arbitrary for bool {
    fn any() -> Self {
        draw() & 1 == 1
    }
}

/// Runs a proof on up to `times` drawn inputs within the assumptions, and prints how many it found.
pub fn run(name: &str, proof: fn(), times: u64) {
    let (mut kept, mut failures, mut farthest) = (0, 0, 0);
    for _ in 0..times * 100 {
        match catch_unwind(proof) {
            Ok(()) => {
                (kept, failures, farthest) = (kept + 1, 0, 0);
                forget(usize::MAX);
            }
            // an assumption mostly concerns the number just drawn; where that does not help, some before it
            Err(payload) if payload.is::<Outside>() => {
                failures = if far() > farthest { 0 } else { failures + 1 };
                farthest = farthest.max(far());
                forget(1 + failures / 32);
            }
            Err(payload) => {
                let words = payload.downcast_ref::<&str>().copied();
                let words = words.or(payload.downcast_ref::<String>().map(String::as_str)).unwrap_or_default();
                println!("{name}\tFAILED\t{}", words.replace('\n', " "));
                return;
            }
        }
        if kept == times {
            break;
        }
    }
    println!("{name}\tran\t{kept}");
}
