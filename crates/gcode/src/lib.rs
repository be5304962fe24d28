//! NC programs in RS274/NGC: from text to canonical functions, as LinuxCNC 2.9 reads them.
//!
//! Invariant: a line is compiled once into a block; carrying out a block allocates nothing but the text of its comments and
//! the points of its splines. Whatever the input, the answer is canonical functions or numbered diagnostics, never a panic. This crate
//! knows no motion and no port.
//!
//! ```
//! use retrace_gcode::{Program, Setup, CanonText};
//!
//! let program = Program::new("G21 G1 X10 F100\nM2\n".as_bytes(), Setup::rs274());
//! let mut text = CanonText::new(Vec::new());
//! for step in program {
//!     text.write(&step)?;
//! }
//! let text = String::from_utf8_lossy(&text.into_inner()?).into_owned();
//! assert!(text.contains("    9 N..... STRAIGHT_FEED(10.0000, 0.0000, 0.0000, 0.0000, 0.0000, 0.0000)"));
//! # Ok::<(), std::io::Error>(())
//! ```
//!
//! The rooms, in the order in which a line passes through them: `lex` (characters and numbers), `expr` (expressions), `parse` (words),
//! `block` (the compiled line), `interp` (carrying it out: `check`, then `execute`), [`Canon`] (what comes out).
#![forbid(unsafe_code)]

mod active;
mod angle;
mod arriving;
mod block;
mod branch;
mod bytes;
mod call;
mod canon;
mod canon_text;
mod carried;
mod code;
mod codes;
mod compensation;
mod contour;
mod control;
mod cycle;
mod diag;
mod digits;
mod eval;
mod expr;
mod file_scan;
mod flow;
mod groups;
mod ini;
mod interp;
mod lex;
mod line_numbers;
mod lines;
mod macro_words;
mod modal;
mod nearest;
mod nest;
mod params;
mod parse;
mod pose;
mod prescan;
mod program;
mod remark;
mod rounds;
mod spindle;
mod spline;
mod system;
mod text;
mod tool;
mod turning;
mod whereabouts;

pub use active::{Active, system_name};
pub use block::BlockNumber;
pub use branch::{Branch, Target};
pub use canon::{ArcFeed, Canon, FeedMode, Input, LengthUnit, PathControl, Plane, Probing, Step, Wait, WaitFor};
pub use canon_text::CanonText;
pub use carried::{CarriedOver, StartTables};
pub use codes::Code;
pub use compensation::{Compensation, Side};
pub use cycle::{Cycle, CycleWords, Series};
pub use diag::{Diagnostic, Severity, Span};
pub use ini::Ini;
pub use interp::{BlockRefused, Flow, Interpreter, Setup, UserCodes};
pub use lines::is_program_end;
pub use modal::{ArcCentres, Distance, Motion, Spindle, State};
pub use params::Parameters;
pub use pose::{Axis, AxisSet, Pose};
pub use prescan::{Prescan, SubFile, SubFiles};
pub use program::{Program, Progress, Steps, check};
pub use retrace_cycles as cycles;
pub use spindle::SpindleTurn;
pub use spline::{ControlPoint, Nurbs};
pub use text::Text;
pub use tool::{Tool, ToolTable};
pub use whereabouts::{LoopKind, Whereabouts, Within};
