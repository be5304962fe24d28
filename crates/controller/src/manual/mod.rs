//! Work at the machine while no program runs, and while one is paused: homing, jogging, a block by hand, work zero.
//!
//! Invariant: every task begins and ends at rest, and moves within the soft limits.

pub mod jog_planner;
pub(crate) mod manual_move;
mod perform;

pub use perform::{ManualTaskDone, ManualTaskError, perform};

/// What the operator wants done.
#[derive(Clone, Debug, PartialEq)]
pub enum ManualTask {
    /// Home this axis, or all in the machine file's order.
    Home(Option<char>),
    /// Move an axis by so many mm (degrees), at the jog speed, cut short at the soft limit.
    Jog {
        /// Its letter, lower case.
        axis: char,
        /// How far, signed.
        mm: f64,
    },
    /// Move an axis until the operator stops it, at the soft limit at the latest.
    JogOn {
        /// Its letter, lower case.
        axis: char,
        /// Upward?
        up: bool,
    },
    /// A block, as it would stand in a program.
    Mdi(String),
    /// The work position of this axis, or of all, is zero here (G10 L20).
    WorkZero(Option<char>),
    /// Clear the card's alarm.
    ClearAlarm,
    /// Switch an output by hand: channel and value.
    Output(u8, i32),
}
