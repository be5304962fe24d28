//! The card on a microcontroller: a line, step and direction of four axes, outputs and inputs (GMC-1, the card's side).
//!
//! The main loop computes a control period whenever the step generator has taken the last one. Between these periods it
//! passes received bytes to the card and sends its bytes. A board is a module of `board`.
//!
//! Invariant: nothing allocates and nothing waits for the line. A panic or fault stops the firmware here, with steps
//! and outputs low.
#![cfg_attr(target_os = "none", no_std, no_main)]
#![deny(unsafe_code)]

#[cfg(target_os = "none")]
mod board;
#[cfg(target_os = "none")]
mod diagnostics;
#[cfg(target_os = "none")]
mod main_loop;

#[cfg(target_os = "none")]
use main_loop::halt;

/// On a development host there is nothing to run.
#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this is the firmware of a microcontroller: cargo xtask firmware build");
}
