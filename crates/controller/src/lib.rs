//! From program to card: decoding and planning ahead in one thread, the motion path in another.
//!
//! Invariant: a program that is a file is checked whole before anything of it reaches the card, one that is fed block by block as it
//! comes. In wall time the motion path never waits for the planner, and it allocates only where something happens (an
//! instruction, an action, an event), not in a plain period.
#![forbid(unsafe_code)]

pub mod approach;
pub mod by_hand;
pub mod card;
pub mod event;
pub mod feed;
pub mod index;
pub mod item;
pub mod job;
pub mod journal;
pub mod judge;
pub mod law;
pub mod machine;
pub mod manual;
pub mod operator;
pub mod orders;
pub mod overrides;
pub mod refusal;
pub mod report;
pub mod scan;
pub mod script;
pub mod session;
pub mod sink;
pub mod spline;
pub mod start;
pub mod stream;
pub mod supply;
pub mod survey;
pub mod switching;
pub mod tally;
pub mod track;
