//! From program to card: reading, decoding and planning ahead, the motion path, and the report, each in a thread of its own.
//!
//! Invariant: a program that is a file is checked whole before anything of it reaches the card, one that is fed block by block as it
//! comes. In wall time the motion path never waits for the planner; it never allocates, locks, formats or touches a file from its first
//! control period to its last.
#![forbid(unsafe_code)]

pub mod approach;
pub mod by_hand;
pub mod card;
mod cutter_track;
mod decoding;
pub mod dnc;
pub mod event;
pub mod feed;
pub mod fingerprint;
pub mod homed;
pub mod index;
pub mod item;
pub mod job;
pub mod jobs;
pub mod journal;
pub mod judge;
pub mod law;
pub mod machine;
pub mod machine_changes;
pub mod manual;
pub mod operator;
pub mod orders;
pub mod overrides;
mod planning;
pub mod program_end;
pub mod reading;
pub mod real_time;
pub mod refusal;
pub mod report;
pub mod restart;
pub mod resume;
pub mod scan;
pub mod script;
pub mod session;
pub mod sink;
pub mod spline;
pub mod start;
pub mod state_file;
pub mod stream;
pub mod supply;
pub mod survey;
pub mod switching;
pub mod tally;
pub mod tape;
pub mod tool_length;
pub mod track;
