//! From program to card: decoding and planning ahead in one thread, the motion path in another.
//!
//! Invariant: nothing of a program reaches the card before it has been checked, and the motion path neither waits for the planner
//! nor allocates.
#![forbid(unsafe_code)]

pub mod event;
pub mod feed;
pub mod item;
pub mod job;
pub mod judge;
pub mod law;
pub mod machine;
pub mod operator;
pub mod refusal;
pub mod report;
pub mod scan;
pub mod script;
pub mod session;
pub mod sink;
pub mod start;
pub mod supply;
pub mod switching;
pub mod tally;
pub mod track;
