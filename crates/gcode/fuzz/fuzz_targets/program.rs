//! Fuzzes a program from a file, and streamed.
//!
//! Invariant: the same function as in `tests/harm`, fed by libFuzzer.
#![no_main]

#[allow(dead_code)] // each target has one entry point
#[path = "../../tests/harm/mod.rs"]
mod harm;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| harm::program(bytes));
