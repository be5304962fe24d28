//! A program from a file, and as it arrives: what must hold is written down beside the tests.
//!
//! Invariant: the same function as in `tests/harm`, fed by libFuzzer.
#![no_main]

#[allow(dead_code)] // each target has one way in
#[path = "../../tests/harm/mod.rs"]
mod harm;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| harm::program(bytes));
