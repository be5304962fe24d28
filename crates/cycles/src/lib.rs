//! Machining cycles: routines in a subset of the SINUMERIK language, compiled once and run at every call.
//!
//! Invariant: text and arguments of any kind never panic here; whatever is wrong is a [`Diagnostic`] or an [`Alarm`].
//!
//! A [`Library`] holds the shipped cycles and those of a folder of the user's, compiled. A [`Machine`] runs one of them over a
//! [`Host`]: the interpreter of the calling program, which answers what the cycle asks and carries out its blocks.
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
pub mod stock;
mod stored;
mod vm;

pub use alarm::{Alarm, AlarmText, Halt, alarm_text};
pub use builtin::shipped_source;
pub use cycle::{Cycle, CycleId, Given, Kind, Origin, Parameter, Type};
pub use diag::{Diagnostic, Severity};
pub use error_codes::ErrorCode;
pub use host::{
    CycleBlock, CycleStopped, CycleWord, Host, Message, Query, StockCall, StockFailure, StockFeed, StockMove,
};
pub use library::{CycleLibrary, Folders, LibraryFinding};
pub use vm::{Argument, Vm, VmLimits};
