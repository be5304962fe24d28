//! The part of the firmware that knows no register, and is therefore tested on the developer's machine.
//!
//! Invariant: nothing here blocks or allocates; what the interrupt and the main loop share is atomic, each word stored by one of them.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

pub mod boot;
pub mod period;
pub mod pins;
pub mod ring;
pub mod step_mailbox;
pub mod steps;

/// Axes of this card.
pub const AXES: usize = 4;
/// Records that it holds.
pub const WINDOW: usize = 1024;
/// Longest average of its rate law, in periods.
pub const MEMORY: usize = 256;
/// Entries of reports that the host has not confirmed.
pub const ENTRIES: usize = 256;
