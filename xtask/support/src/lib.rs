//! What the developer tasks share: the files of the checkout, programs that are run, and where they are found.
//!
//! `xtask`, `verification/engines` and `bench` use it.
#![forbid(unsafe_code)]

pub mod process;
pub mod tools;
pub mod tree;
