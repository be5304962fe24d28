//! Drawings of a job: its tool path, its velocity, acceleration and jerk over time, and its history, as SVG or PNG.
//!
//! Invariant: a drawing depends only on the data and the size. Both formats are written from one display list, and the
//! letters are strokes of our own, so that a drawing needs no fonts and looks the same everywhere.
//!
//! ```text
//!  ToolPath ──> draw_path ─────┐
//!  Profile ───> draw_profile ──┼─> DisplayList ─> to_svg, to_png
//!  History ───> draw_history ──┘
//! ```
//!
//! The crate knows nothing of programs, machines or files: the caller gives points in mm and times in s.
//!
//! # Examples
//!
//! ```
//! use retrace_plot::{Size, Stroke, StrokeKind, ToolPath, View, draw_path};
//! let stroke = Stroke { kind: StrokeKind::Feed, points: vec![[0.0, 0.0, 0.0], [10.0, 5.0, 0.0]] };
//! let path = ToolPath { title: "part".to_owned(), strokes: vec![stroke] };
//! let svg = draw_path(&path, View::Xy, Size::pixels(800, 600)?).to_svg();
//! assert!(svg.starts_with("<svg"));
//! # Ok::<(), retrace_plot::SizeError>(())
//! ```
#![forbid(unsafe_code)]

mod decimate;
mod draw_history;
mod draw_path;
mod draw_profile;
mod font;
mod history;
mod picture;
mod png;
mod profile;
mod scale;
mod sheet;
mod style;
mod svg;
mod tool_path;
mod view;

pub use draw_history::draw_history;
pub use draw_path::draw_path;
pub use draw_profile::draw_profile;
pub use history::{Activity, History, HistoryEvent, HistorySample, Priority};
pub use picture::{DisplayList, Size, SizeError};
pub use png::PngError;
pub use profile::{AxisTrack, Derivatives, Profile};
pub use tool_path::{Stroke, StrokeKind, ToolPath};
pub use view::View;
