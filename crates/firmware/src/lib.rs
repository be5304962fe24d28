//! The part of the firmware that accesses no register, and is therefore tested on the development host.
//!
//! Invariant: nothing here blocks or allocates; data shared by an interrupt and the main loop is atomic, and each word
//! is stored by only one of them.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

pub mod boot;
#[cfg(test)]
mod host_boards;
pub mod line_selector;
pub mod output_level;
pub mod probe_capture;
pub mod ring;
pub mod rp2040;
pub mod step_batch;
pub mod stm32f4;
pub mod usb_control;

/// Axes of this card.
pub const AXES: usize = 4;
/// Number of records that it holds.
pub const WINDOW: usize = 1024;
/// Maximum average of its rate law, in periods.
pub const MEMORY: usize = 256;
/// Maximum number of report entries that the host has not acknowledged.
pub const ENTRIES: usize = 256;
