//! Motion planning: geometry and feed become one record of whole increments a control period.
//!
//! Lines, arcs and helices go into a [`Planner`], with their feed and path mode; records come out. In between lie exact
//! geometry (`curve`), the limits of every axis along it (`piece`), a jerk-limited plan over runs of blocks with the
//! acceleration carried across joints (`envelope`, `lookahead`, `profile`), and emission (`emitter`). The crate knows no text
//! and no port.
//!
//! Invariant: every axis keeps its velocity, and the plan's share α of its acceleration and jerk, everywhere; the sum of the
//! increments is never further than half a pulse from the plan; the end is exact.
//!
//! ```
//! use retrace_motion::{Feed, Limits, PathMode, Planner};
//! let mut planner = Planner::<3>::new(Limits::built_in(), [0.0; 3])?;
//! planner.line([10.0, 5.0, 0.0], Feed::PerSecond(50.0), PathMode::ExactStop, 1)?;
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

mod blend;
mod corner;
mod curve;
mod emitter;
mod envelope;
mod error;
mod joining;
mod limits;
mod lookahead;
mod piece;
mod planner;
mod profile;
mod run;
mod stepwise;

pub use curve::Arc;
pub use emitter::SetPoint;
pub use error::{LimitError, MoveError};
pub use limits::Limits;
pub use planner::{Feed, PathMode, Planner};
