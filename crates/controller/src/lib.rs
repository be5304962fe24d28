//! The controller: executes an NC program on a motion card. Reading, decoding, planning, the motion path and the report
//! each run in their own thread ([`job`]).
//!
//! ```text
//!  program ─> decoding ─> canon_executor ─> plan_writer ─> ring ─> record_streamer ─> card
//!  (read_ahead) (decoding) (planning) (core::ring) (session)
//! ```
//!
//! The operator's commands ([`operator`]) reach the motion path through [`command_queue`]; what happens leaves it as
//! [`telemetry`]. The [`journal_recorder`] records what is needed to resume an interrupted job ([`resume`]).
//!
//! Invariant: a program from a file is checked whole before anything of it reaches the card; a streamed program is
//! checked block by block. In wall time the motion path never waits for the planner; it never allocates, locks, formats
//! or accesses a file from its first control period to its last.
#![forbid(unsafe_code)]

pub mod approach;
pub mod canon_executor;
pub mod command_queue;
mod cutter_track;
mod decoding;
pub mod dnc_events;
pub mod event;
pub mod fingerprint;
pub mod job;
pub mod journal_recorder;
pub mod limit_check;
pub mod limit_monitor;
pub mod manual;
pub mod mdi;
pub mod motion_sink;
pub mod operator;
pub mod overrides;
pub mod plan_item;
pub mod plan_writer;
mod planning;
pub mod program_analysis;
pub mod read_ahead;
pub mod record_streamer;
pub mod report;
pub mod restart;
pub mod resume;
pub mod run_stats;
pub mod script;
pub mod session;
pub mod spline;
pub mod start_line;
pub mod tape;
pub mod telemetry;
pub mod tool_length;
