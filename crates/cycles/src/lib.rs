//! Machining cycles: the geometry of stock removal along a contour.
//!
//! Invariant: this crate knows no program, no motion and no port; whatever the input, the answer is a path or a fault, never a panic.
#![forbid(unsafe_code)]

pub mod stock;
