//! Every harness and every search natively, in a size for `cargo test`; `cargo xtask verify` runs more of each.

use retrace_verification::ledger::{Size, harnesses, rows};

/// Runs of each harness, enumerated, and as many drawn where that does not end.
const RUNS: u64 = 50_000;

#[test]
fn every_harness_holds_and_reaches_its_regions() {
    for harness in harnesses() {
        let seen = harness.check(RUNS, 2);
        assert!(seen.is_ok(), "{}: {seen:?}", harness.name);
        assert!(!harness.covers.is_empty(), "{} lists no region that it must reach", harness.name);
    }
}

#[test]
fn every_search_passes() {
    for search in rows().iter().flat_map(|row| row.searches) {
        println!("{}: {}", search.name, (search.run)(Size { full: false, seed: 2 }));
    }
}
