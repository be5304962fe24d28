//! Runs the native engine: `list`, `check NAME …`, `replay NAME NUMBERS`. `cargo xtask verify` calls it.
#![forbid(unsafe_code)]

use retrace_verification::ledger;

fn main() {
    for h in ledger::harnesses() {
        let t = std::time::Instant::now();
        println!("{} {:?} {:.2?}", h.name, h.check(100_000, 1), t.elapsed());
    }
}
