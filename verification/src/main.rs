//! Command line of the native engine: `list`, `check NAME …`, `replay NAME NUMBERS`. `cargo xtask verify` calls it.
//!
//! Invariant: every answer is one line of JSON on standard output; exit code 0 means that all of them are passes.
#![forbid(unsafe_code)]

#[cfg(not(kani))]
mod runner;

#[cfg(not(kani))]
fn main() -> std::process::ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    runner::run(&arguments.iter().map(String::as_str).collect::<Vec<_>>())
}

#[cfg(kani)]
fn main() {}
