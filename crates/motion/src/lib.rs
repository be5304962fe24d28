//! Motion planning: geometry and feed become one record of whole increments a control period.
//!
//! Lines, arcs and helices go into a [`Planner`], with their feed and path mode; records come out. On the way lie
//!
//! - exact geometry (`curve`) and how two moves are joined (`joining`): by a stop, as they are, or blended;
//! - merging of nearly collinear lines (`merge`);
//! - blending (`blend`, `corner`): what is handed on has continuous direction and curvature, within the tolerance;
//! - what every axis allows along a piece of path (`piece`), how much of it is for going faster (`shares`), and the road of one run between two stops (`run`);
//! - the jerk-limited plan over many blocks with the acceleration carried across joints (`envelope`, `lookahead`, `profile`),
//!   with a plainer one where there is none (`stepwise`);
//! - emission (`emitter`), one record a control period;
//! - planning again what is not emitted when the feed override changes (`run::replan`).
//!
//! The crate knows no text and no port.
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
mod lookahead;
mod merge;
mod path_planner;
mod piece;
mod planner;
pub mod profile;
mod pulses;
mod rapid_cap;
mod rest_to_rest;
mod run;
mod sampler;

pub use curve::Arc;
pub use emitter::SetPoint;
pub use error::{LimitError, MoveError};
pub use glide::Blending;
pub use glide::source::{GlideRatio, RatioOf};
pub use limits::MachineLimits;
pub use planner::{FeedRate, MAX_OVERRIDE, PathMode, Planner};
