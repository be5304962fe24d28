//! Tests of the crate from outside.
#![cfg(unix)]

mod mtconnect;
#[path = "../../../../tests/src/shdr_checker.rs"]
mod shdr_checker;
