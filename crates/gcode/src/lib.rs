//! NC programs in RS274/NGC: converts text to canonical functions, with the same results as LinuxCNC 2.9.
//!
//! Invariant: a line is compiled once into a block. Executing a block allocates nothing but the text of its comments
//! and the points of its splines. Any input results in canonical functions or numbered diagnostics, never in a panic.
//! This crate does not depend on motion or ports.
//!
//! A line passes through these modules:
//!
//! ```text
//! line ─► lex ─► expr ─► parse ─► block ─► interp: check, execute ─► Canon
//!         characters,    words    compiled                           canonical
//!         expressions             line                               functions
//! ```
//!
//! # Examples
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
#![forbid(unsafe_code)]

mod active;
mod angle;
mod assignment;
mod block;
mod block_number;
mod branch;
mod bytes;
mod canon;
mod canon_modes;
mod canon_text;
mod comment;
mod compensation;
mod compensation_queue;
mod compiled_code;
mod contour;
mod control;
mod control_flow;
mod control_parser;
mod cutting;
mod cycle_call;
mod cycle_call_parser;
mod diag;
mod drilling_cycle;
mod error_codes;
mod eval;
mod expr;
mod file_scan;
mod flow_controller;
mod flow_paths;
mod groups;
mod ini;
mod interp;
mod lex;
mod line_numbers;
mod line_split;
mod lines;
mod loop_stack;
mod macro_words;
mod material;
mod material_comment;
mod mdi_check;
mod modal;
mod modal_groups;
mod modal_snapshot;
mod move_split;
mod nearest;
mod number_range;
mod open_contour;
mod output_text;
mod params;
mod parse;
mod path_cache;
mod path_explorer;
mod path_state;
mod pierce_figures;
mod pose;
mod prescan;
mod probing_call;
mod probing_cycles;
mod program;
mod program_end;
mod program_location;
mod program_steps;
mod saved_state;
mod setup;
mod spindle;
mod spline;
mod stream_compiler;
mod sub_files;
mod subs;
mod system;
mod text;
mod thread_run_in;
mod tool;
mod turning;
mod unknown;
mod user_codes;

pub use active::{ActiveCodes, system_name};
pub use block_number::BlockNumber;
pub use branch::{Branch, BranchDestination};
pub use canon::{ArcFeed, BranchStart, BranchState, Canon, CanonStep, WaitFor, WaitForInput, WaitInput};
pub use canon_modes::{FeedMode, LengthUnit, PathControl, Plane, Probing};
pub use canon_text::CanonText;
pub use compensation::{Compensation, Side};
pub use cutting::{CuttingSetup, CuttingState, CuttingSwitch, CuttingTool, SpindleUse};
pub use diag::{Diagnostic, Severity, Span};
pub use drilling_cycle::{CycleWords, DrillingCycle, DrillingSeries};
pub use error_codes::ErrorCode;
pub use ini::Ini;
pub use interp::{BlockRefusedError, Interpreter, ProgramFlow};
pub use material::{FIRST_TEMPORARY_MATERIAL, Material, MaterialList};
pub use modal::ModalState;
pub use modal_groups::{ArcCentres, DistanceMode, MotionMode, SpindleRotation};
pub use modal_snapshot::{ModalSnapshot, StartTables};
pub use params::Parameters;
pub use pose::{Axis, AxisSet, Pose};
pub use prescan::Prescan;
pub use probing_call::{PROBING_FORMS, ProbingForm, probing_block};
pub use probing_cycles::{ProbingFigures, ToolChangeFigures, probing_cycles, shipped_subprograms};
pub use program::{Program, Progress, check};
pub use program_end::{ProgramEndDetector, program_end_of};
pub use program_location::{CallFrame, LoopKind, ProgramLocation};
pub use program_steps::Steps;
pub use retrace_cycles as cycles;
pub use setup::{Answers, Setup};
pub use spindle::SpindleTurn;
pub use spline::{ControlPoint, Nurbs};
pub use sub_files::{SubFile, SubFiles};
pub use text::Text;
pub use thread_run_in::ThreadRunIn;
pub use tool::{Tool, ToolTable};
pub use user_codes::UserCodes;
