//! Motion planning: programmed moves in, one record of whole increments per control period out.
//!
//! Lines, arcs and helices go into a [`Planner`], each with a feed rate and a path mode. Records come out.
//!
//! ```text
//!  moves ─> merge ─> junction, blend, glide ─> piece ─> run, lookahead ─> emitter ─> records
//!  mm, mm/s  G64 Q    stop, round or glide      limits   jerk-limited plan  one per T   pulses
//! ```
//!
//! - `curve`: exact geometry of a move; `junction`: how two moves meet, by a stop, unchanged or blended.
//! - `merge`: merging of nearly collinear lines.
//! - `blend`, `correction`, `glide`: blending within the tolerance; the result has continuous direction and curvature.
//! - `piece`: the speed, acceleration and jerk that every axis allows along a piece of path; `accel_split`: how much of
//!   them is for changes of speed.
//! - `run`: the path between two stops; `envelope`, `lookahead`, `profile`: the jerk-limited plan over many blocks with
//!   the acceleration carried across junctions; `rest_to_rest`: a simpler plan for the case that there is no other.
//! - `run::refine`, `speed_law`: the plan made faster within the exact limits of the axes on curves.
//! - `emitter`: sampling, one record per control period.
//! - `run::replan`: planning again what is not emitted when the feed override changes.
//!
//! The crate handles neither text nor ports. Lengths are in mm (degrees on rotary axes), times in s.
//!
//! Invariant: every axis stays within its velocity limit, and within the plan's share α of its acceleration and jerk
//! limits, at all times; the sum of the increments is never further than half a pulse from the plan; the end position
//! is exact.
//!
//! # Examples
//!
//! ```
//! use retrace_motion::{FeedRate, MachineLimits, PathMode, Planner};
//! let mut planner = Planner::<3>::new(MachineLimits::built_in(), [0.0; 3])?;
//! planner.line([10.0, 5.0, 0.0], FeedRate::PerSecond(50.0), PathMode::ExactStop, 1)?;
//! planner.stop(retrace_core::Flags::NONE);
//! let mut counts = [0i64; 3];
//! while let Some(record) = planner.next_record() {
//!     for (count, increment) in counts.iter_mut().zip(record.increments) {
//!         *count += i64::from(increment);
//!     }
//! }
//! assert_eq!(counts, [10_000, 5_000, 0]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

mod accel_split;
mod blend;
mod correction;
mod curve;
mod emitter;
mod envelope;
mod error;
mod glide;
mod junction;
mod limits;
mod line_mark;
mod lookahead;
mod merge;
mod path_planner;
mod piece;
mod planned_section;
mod planner;
pub mod profile;
mod pulses;
mod rapid_cap;
mod rest_to_rest;
mod run;
mod sampler;
mod span;
mod speed_law;

pub use curve::Arc;
pub use emitter::SetPoint;
pub use error::{LimitError, MoveError};
pub use glide::Blending;
pub use glide::source::{GlideRatio, RatioOf};
pub use limits::{MAX_OVERRIDE, MachineLimits};
pub use planned_section::{PlannedPiece, PlannedSection};
pub use planner::{FeedRate, MoveMark, PathMode, Planner};
pub use run::{PlanFallbacks, PlanMode};
