//! Measures the time that precompiled cycles and the pre-scan save (PRE-9): `cargo run --release --example pre9`
//! (package retrace-gcode).
//!
//! Prints one line for each program: its name, the share of its lines in percent, and the milliseconds of each of the
//! four decoding modes.

#[path = "../tests/testsuite/decoding/mod.rs"]
mod decoding;

use decoding::{DECODING_MODES, decode, program};
use retrace_gcode::CanonText;
use std::path::Path;
use std::time::Instant;

const LINES: u32 = 10_000;
const ROUNDS: usize = 7;

fn main() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../cycles/cycles/CYCLE81.SPF");
    for (name, cycles, calls) in [("cycles", 1, 0), ("jumps", 0, 1), ("both", 1, 1)] {
        for share in (0..=50).step_by(10) {
            let text = program(LINES, share * cycles, share * calls);
            let mut taken = DECODING_MODES.map(|_| Vec::new());
            for _ in 0..ROUNDS {
                for (way, taken) in DECODING_MODES.into_iter().zip(&mut taken) {
                    let mut out = CanonText::new(std::io::sink());
                    let start = Instant::now();
                    decode(way, &text, &source, &mut |step| out.write(step).expect("a sink"));
                    taken.push(start.elapsed().as_secs_f64() * 1e3);
                }
            }
            let medians = taken.map(|mut times| {
                times.sort_by(f64::total_cmp);
                times[ROUNDS / 2]
            });
            let [plain, cycles, prescan, both] = medians;
            println!("{name} {share} {plain:.3} {cycles:.3} {prescan:.3} {both:.3}");
        }
    }
}
