//! The four decoding modes that `cargo xtask bench pre9` measures give the same canonical functions.

use crate::decoding;

use decoding::{DECODING_MODES, DecodingMode, decode, program};
use retrace_gcode::Canon;
use std::path::Path;

fn decoded(way: DecodingMode, text: &str) -> Vec<Canon> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../cycles/cycles/CYCLE81.SPF");
    let mut calls = Vec::new();
    // Line 0 has the functions before and after any program, which a reader of single lines does not have.
    decode(way, text, &source, &mut |step| calls.extend((step.line > 0).then(|| step.canon.clone())));
    calls
}

#[test]
fn all_ways_give_the_same_canonical_functions() {
    for (cycles, calls) in [(0, 0), (50, 0), (0, 50), (20, 30), (50, 50)] {
        let text = program(400, cycles, calls);
        let expected = decoded(DecodingMode::Both, &text);
        // A cycle is three moves, a subprogram two.
        let least = 400 + 8 * cycles + 4 * calls;
        assert!(expected.len() >= least as usize, "{} calls", expected.len());
        for way in DECODING_MODES {
            let found = decoded(way, &text);
            assert!(found == expected, "{way:?} with {cycles} % cycles and {calls} % calls differs");
        }
    }
}

#[test]
fn a_program_has_the_shares_that_were_asked_for() {
    let text = program(1000, 20, 30);
    let count = |what: &str| text.lines().filter(|line| line.contains(what)).count();
    assert_eq!((count("CYCLE81("), count(" call [")), (200, 300));
}
