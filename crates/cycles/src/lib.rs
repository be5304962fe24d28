//! Machining cycles: routines in a subset of the SINUMERIK language, compiled once and run at every call.
//!
//! Invariant: no text and no argument causes a panic here; every error is a [`Diagnostic`] or an [`Alarm`].
//!
//! A [`CycleLibrary`] holds the shipped cycles and those of a user's folder, compiled. A [`Vm`] runs one of them over a
//! [`Host`]: the interpreter of the calling program, which provides the state that the cycle reads and executes its
//! blocks.
//!
//! ```text
//! source ─► compile ─► CycleLibrary ─► Vm ──blocks, messages──► Host
//!                                        ◄──state, contours────
//! ```
//!
//! # Examples
//!
//! ```
//! use retrace_cycles::{CycleLibrary, Kind};
//!
//! let library = CycleLibrary::shipped();
//! let id = library.find("cycle81").and_then(|id| library.get(id));
//! let cycle = id.expect("CYCLE81 is shipped");
//! assert_eq!(cycle.kind(), Kind::Parameters);
//! assert_eq!(cycle.parameters()[0].name, "RTP");
//! ```
#![forbid(unsafe_code)]

mod alarm;
mod builtin;
mod code;
mod compile;
mod cycle;
mod diag;
mod error_codes;
mod host;
mod library;
mod parameter;
pub mod stock;
mod stored;
mod vm;

pub use alarm::{Alarm, AlarmText, CycleRunError, alarm_text};
pub use builtin::shipped_source;
pub use cycle::{ArgumentKind, Cycle, CycleId, Kind, Origin};
pub use diag::Diagnostic;
pub use error_codes::{ErrorCode, Severity};
pub use host::{
    CycleBlock, CycleStoppedError, CycleWord, Host, Message, Query, StockCall, StockFeed, StockMove, StockPathError,
};
pub use library::{CycleLibrary, Folders, LibraryFinding};
pub use parameter::{Parameter, Type};
pub use vm::{Argument, Vm, VmLimits};
