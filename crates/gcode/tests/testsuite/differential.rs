//! Random programs, compared call by call with LinuxCNC's `rs274 -g`.
//!
//! The number of programs is 120, or the value of RETRACE_DIFFERENTIAL. The environment variable
//! RETRACE_DIFFERENTIAL_FIRST sets the first seed of a long run; RETRACE_DIFFERENTIAL_PROGRAM names a file that is
//! compared instead.
//!
//! Four of five programs are repaired: a refused line is removed, so that the lines after it are compared. The fifth
//! stays as written, and ends where both interpreters refuse it.

use crate::outline;
use crate::peer;
use crate::writer;

use outline::{Outline, TOOLS};
use peer::compare;
use writer::{Case, Writer};

/// Maximum number of lines removed from a program.
const MAX_MENDED: u32 = 12;

fn mended(seed: u64, case: Case) -> Case {
    if seed.is_multiple_of(5) { case } else { case.without_refused_lines(MAX_MENDED) }
}

#[test]
fn random_programs_give_the_canonical_functions_of_rs274() {
    let given = std::env::var("RETRACE_DIFFERENTIAL_PROGRAM").ok();
    let given = given.map(|file| std::fs::read_to_string(file).expect("a program"));
    compare("programs", |seed| match &given {
        Some(program) => Case { program: program.clone(), ..Case::default() },
        None => mended(seed, Writer::case(seed)),
    });
}

#[test]
fn random_outlines_are_compensated_as_by_rs274() {
    compare("outlines", |seed| {
        mended(seed, Case { program: Outline::program(seed), tools: Some(TOOLS), ..Case::default() })
    });
}
