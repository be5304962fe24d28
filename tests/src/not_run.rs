//! Tests whose peer is missing on this machine: reported and counted as NOT RUN, or failed where peers are required.
//!
//! Invariant: a test that compared nothing is never counted as passed by `cargo xtask test`.

use std::io::Write;

/// Names the file that collects the tests that did not run; `cargo xtask test` sets and reads it.
const LIST: &str = "RETRACE_NOT_RUN";
/// Set where a missing peer is a failure: `cargo xtask test --require peers`.
const REQUIRED: &str = "RETRACE_REQUIRE_PEERS";

/// Reports that `test` did not run because of `reason`.
///
/// # Panics
/// Where peers are required, and where the list cannot be written.
pub fn not_run(test: &str, reason: &str) {
    assert!(std::env::var_os(REQUIRED).is_none(), "{test}: required and NOT RUN: {reason}");
    println!("NOT RUN  {test}: {reason}");
    if let Some(path) = std::env::var_os(LIST) {
        let file = std::fs::OpenOptions::new().create(true).append(true).open(&path);
        let written = file.and_then(|mut file| writeln!(file, "{test}: {reason}"));
        assert!(written.is_ok(), "{} cannot be written", path.display());
    }
}
