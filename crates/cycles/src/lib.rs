//! Machining cycles: routines in a subset of the SINUMERIK language, compiled once and run at every call.
//!
//! Invariant: text and arguments of any kind never panic here; whatever is wrong is a [`Diagnostic`] or an [`Alarm`].
//!
//! A [`Library`] holds the shipped cycles and those of a folder of the user's, compiled. A [`Machine`] runs one of them over a
//! [`Host`]: the interpreter of the calling program, which answers what the cycle asks and carries out its blocks.
#![forbid(unsafe_code)]

mod alarm;
mod code;
mod codes;
mod compile;
mod cycle;
mod diag;
mod host;
mod library;
mod machine;
mod shipped;
mod stored;

pub use alarm::{Alarm, AlarmText, Halt, alarm_text};
pub use codes::Code;
pub use cycle::{Cycle, CycleId, Given, Kind, Origin, Parameter, Type};
pub use diag::{Diagnostic, Severity};
pub use host::{Block, Host, Message, Query, StockCall, StockFault, StockFeed, StockMove, Stopped, Word};
pub use library::{Finding, Folders, Library};
pub use machine::{Argument, Limits, Machine};
pub use shipped::shipped_source;
