//! Properties of retrace's core that are proved: each is written once, over a source of arbitrary values, and run by
//! every engine.
//!
//! `choice` is that source, `region` names what every proof must reach, `harness` makes each engine's list, `native`
//! enumerates and draws, `ledger` has the rows.
//! The other modules are the properties, each next to the literal machine or model that it compares with.
#![cfg_attr(any(kani, verify_wasm), no_std)]
// a claim is written as comparisons: a call to `contains` or `clamp` adds work to the proof
#![allow(clippy::manual_range_contains, clippy::manual_clamp)]
#![cfg_attr(not(verify_wasm), forbid(unsafe_code))]

pub mod beam_power;
pub mod braking;
pub mod card_window;
pub mod choice;
pub mod drive;
pub mod filter_balance;
pub mod fine;
pub mod frames;
pub mod gates;
pub mod gear;
mod harness;
#[cfg(not(any(kani, verify_wasm)))]
pub mod ledger;
#[cfg(not(any(kani, verify_wasm)))]
pub mod literal_gates;
pub mod literal_ring;
pub mod modes;
#[cfg(not(any(kani, verify_wasm)))]
pub mod native;
pub mod permit;
pub mod playback;
pub mod probing;
pub mod protocol;
pub mod rate;
#[cfg(not(any(kani, verify_wasm)))]
pub mod rate_law;
pub mod region;
pub mod ring;
pub mod sequence;
#[cfg(not(any(kani, verify_wasm)))]
pub mod shipped_threads;
pub mod steps;
#[cfg(not(any(kani, verify_wasm)))]
pub mod stopping;
#[cfg(not(any(kani, verify_wasm)))]
pub mod threads;
