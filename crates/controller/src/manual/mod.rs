//! Manual work at the machine while no program runs, and while one is paused: homing, jogging, MDI, work zero.
//!
//! Invariant: every task begins and ends at rest, and moves within the soft limits.

mod frame;
mod perform;
mod sense_test;
mod sheet_edge;

pub use frame::{CutFrame, FrameShape};
pub use perform::{ManualTaskDone, ManualTaskError, perform_manual_task};
pub use sheet_edge::{SheetEdge, SheetPlacement};

use crate::jog_speed::JogSpeed;

/// A task of the operator.
#[derive(Clone, Debug, PartialEq)]
pub enum ManualTask {
    /// Home this axis, or all axes in the machine file's order.
    Home(Option<char>),
    /// Jog an axis by a distance in mm (degrees) at the jog speed, shortened at the soft limit.
    Jog {
        /// Axis letter, lower case.
        axis: char,
        /// Distance, signed.
        mm: f64,
    },
    /// Jog an axis until the operator stops it, at most to the soft limit.
    JogOn {
        /// Axis letter, lower case.
        axis: char,
        /// Whether in the positive direction.
        up: bool,
        /// How fast.
        speed: JogSpeed,
    },
    /// Execute one MDI block, as it would be in a program.
    Mdi(String),
    /// Set the work position of this axis, or of all, to zero (G10 L20).
    WorkZero(Option<char>),
    /// Clear the card's alarm.
    ClearAlarm,
    /// Switch an output manually: channel and value.
    Output(u8, i32),
    /// Switch the first torch, jet or beam on for its test pulse (CUT-9).
    TestPulse,
    /// Sense the sheet with the cutter off, and return the tool (CUT-57).
    SenseTest,
    /// Trace a frame around what the program cuts, with the pointer (CUT-59).
    Frame(CutFrame),
}

impl ManualTask {
    /// A probing cycle in an operator's words, such as `surface z- 20 g54`, as the MDI block that calls it (PRB-20).
    ///
    /// # Errors
    /// What the words should be.
    pub fn probing_cycle(words: &str) -> Result<Self, String> {
        retrace_gcode::probing_block(words).map(Self::Mdi)
    }

    /// The forms of these words, such as `surface z- TRAVEL`.
    #[must_use]
    pub fn probing_forms() -> Vec<&'static str> {
        retrace_gcode::PROBING_FORMS.iter().map(|call| call.form).collect()
    }
}
