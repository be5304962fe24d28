//! The card on an STM32F4: a serial line, four axes' step and direction, outputs and inputs (GMC-1, the card's side).
//!
//! The main loop computes a control period whenever the step interrupt has taken the last one; between them it feeds bytes to the card and
//! takes bytes from it.
//!
//! Invariant: nothing allocates and nothing waits for the line. Whatever panics or faults stops here, with steps and outputs low.
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

/// On a developer's machine there is nothing to run.
#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this is the firmware of a microcontroller: cargo xtask firmware build");
}
