//! The concurrent parts under shuttle: many random schedules of larger cases than loom can take.
//!
//! `ring.rs` and `ring_indices.rs` are the files of `retrace-core`, compiled again over shuttle's atomics (`sync`); the
//! models are those of `verification/concurrent`, which loom runs too. Shuttle runs every atomic operation in one order
//! that all threads see alike: it finds logic errors, not orderings that are too weak. Those are found by loom.
//!
//! Invariant: nothing here has an unsafe line of its own; the keyword stands in the ring's file alone.
#![deny(unsafe_code)]

use retrace_core::RecordIndex;

#[path = "../../concurrent/coordination.rs"]
pub mod coordination;
pub mod explore;
#[allow(unsafe_code)]
#[path = "../../../crates/core/src/ring.rs"]
pub mod ring;
#[path = "../../../crates/core/src/ring_indices.rs"]
pub mod ring_indices;
mod sync;
#[path = "../../concurrent/tape.rs"]
pub mod tape;
