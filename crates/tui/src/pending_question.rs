//! Questions of prompts.
//!
//! Invariant: a question takes a text, or one key.

use retrace_controller::FrameShape;

/// Question of a prompt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PendingQuestion {
    /// Distance to go back, mm.
    BackBy,
    /// Distance of the start of the cut from the path.
    Shift,
    /// Number or name of an output.
    Output,
    /// MDI block.
    Mdi,
    /// Probing cycle with its arguments.
    Probe,
    /// Axis letter, or all.
    WorkZero,
    /// Tool length.
    ToolLength,
    /// Whether to fire the cutter for a test pulse.
    TestPulse,
    /// Whether to sense the sheet.
    SenseTest,
    /// Whether the consumables are new.
    ConsumablesChanged,
    /// Whether to start the program at this contour.
    StartContour(u32),
    /// Whether to start the program although a turn of an earlier job is in force.
    StartTurned,
    /// Whether to take the first point on the edge of the sheet.
    SheetPoint,
    /// Whether to set the work coordinates by the edge of the sheet.
    AlignSheet,
    /// Whether to trace a frame.
    Frame(FrameShape),
    /// Whether to stop the job.
    Stop,
    /// Path of another program.
    Program,
}

impl PendingQuestion {
    /// Whether the answer is a text, and not a key.
    pub(crate) const fn takes_text(self) -> bool {
        matches!(
            self,
            Self::BackBy
                | Self::Shift
                | Self::Output
                | Self::Mdi
                | Self::Probe
                | Self::WorkZero
                | Self::ToolLength
                | Self::Program
        )
    }
}
