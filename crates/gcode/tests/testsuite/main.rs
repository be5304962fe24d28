//! The integration tests of `retrace-gcode`, in one binary, which links once.

mod arriving;
mod common;
mod compensation;
mod contour_ends;
mod control;
mod cutting;
mod cycles;
mod cycles_golden;
mod decoding;
mod decoding_modes;
mod differential;
mod fuzz;
mod harm;
mod hostile;
mod killers;
mod language;
mod macro_words;
mod mdi;
#[path = "../../../../tests/src/not_run.rs"]
#[expect(unreachable_pub, reason = "shared with the library of the end-to-end tests")]
mod not_run;
mod offsets;
mod outline;
mod peer;
mod plasma_samples;
mod probing_cycles;
mod program_location;
mod stock_golden;
mod turning;
mod unknown;
mod writer;
