//! The concurrent parts under loom: every interleaving of the real ring and of the gates' two threads, up to a bound.
//!
//! `ring.rs` and `ring_indices.rs` are the files of `retrace-core`, compiled again over loom's atomics and cells
//! (`sync`); the models are those of `verification/concurrent`, which shuttle runs too.
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
