//! The end-to-end tests of the command, in one binary: it links once, and tests that wait overlap.

mod any_program;
mod blending;
#[cfg(target_os = "linux")]
mod card;
mod check;
mod command;
mod cut;
mod cutter;
mod dnc;
mod drip;
mod drip_canon;
mod error_catalogue;
mod feed_override;
mod hand;
mod jumps;
mod kill;
mod limits;
mod long;
mod memory;
mod off;
#[cfg(unix)]
mod offsets;
mod operator;
#[cfg(target_os = "linux")]
mod output;
mod programs;
#[cfg(target_os = "linux")]
mod real_time;
mod refusals;
mod resume;
mod resume_files;
#[cfg(unix)]
mod screen;
mod serial;
#[cfg(unix)]
mod state_files;
#[cfg(unix)]
mod stop_signals;
mod stops;
mod streams;
mod tool_length;
