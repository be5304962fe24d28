//! Random programs, call by call against LinuxCNC's `rs274 -g`.
//!
//! The number of programs is 120, or what RETRACE_DIFFERENTIAL says; a run of many takes the environment variable
//! RETRACE_DIFFERENTIAL_FIRST as its first seed; RETRACE_DIFFERENTIAL_PROGRAM names a file that is compared in place of them.
//!
//! Of five programs four are mended: a line that is refused is taken out, so that what follows it is compared. The fifth stays as it
//! was written, and ends where both refuse it.

mod common;
mod outline;
mod peer;
mod writer;

use outline::{Outline, TOOLS};
use peer::compare;
use writer::{Case, Writer};

/// Lines that are taken out of a program at most.
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
