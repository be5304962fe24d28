//! What the end-to-end tests share: running the `retrace` command, reading what it says, and judging it afresh.
//!
//! Invariant: nothing of retrace itself is used here; what is judged is the command's output alone.
#![forbid(unsafe_code)]

pub mod command;
pub mod cutter_observer;
pub mod json_page;
pub mod limits;
pub mod pins;
pub mod programs;
pub mod records;
pub mod run;
pub mod sender;
pub mod served;
pub mod terminal;
pub mod trace;
