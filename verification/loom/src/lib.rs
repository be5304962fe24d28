//! The concurrent parts under loom: every interleaving of the real ring and of the gates' two threads, up to a bound.
//!
//! These are files of the crates that ship, compiled again over loom's atomics, cells and locks (`sync`): `ring.rs` and
//! `ring_indices.rs` of `retrace-core`, `journal_queue.rs` and `durable_place.rs` of `retrace-journal`,
//! `batch_channel.rs`, `jog_mailbox.rs` and `command_channel.rs` of `retrace-controller`. The models of the
//! ring and of the gates are those of `verification/concurrent`, which shuttle runs too; the others are in `models`.
//!
//! Invariant: nothing here has an unsafe line of its own; the keyword stands in the ring's file alone.
#![deny(unsafe_code)]

use retrace_core::RecordIndex;
use retrace_journal as entry;

#[allow(dead_code)]
#[path = "../../../crates/controller/src/batch_channel.rs"]
pub mod batch_channel;
#[allow(dead_code)]
#[path = "../../../crates/controller/src/command_channel.rs"]
pub mod command_channel;
#[path = "../../concurrent/coordination.rs"]
pub mod coordination;
#[path = "../../../crates/journal/src/durable_place.rs"]
pub mod durable_place;
pub mod explore;
#[allow(dead_code)]
#[path = "../../../crates/controller/src/jog_mailbox.rs"]
pub mod jog_mailbox;
#[allow(dead_code)]
#[path = "../../../crates/journal/src/journal_queue.rs"]
pub mod journal_queue;
pub mod models;
/// Stands for the commands of `retrace-controller`, whose content the channel does not look at.
mod operator {
    pub(crate) type OperatorCommand = u32;
}
#[allow(unsafe_code)]
#[path = "../../../crates/core/src/ring.rs"]
pub mod ring;
#[path = "../../../crates/core/src/ring_indices.rs"]
pub mod ring_indices;
mod sync;
#[path = "../../concurrent/tape.rs"]
pub mod tape;
