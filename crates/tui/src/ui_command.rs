//! Commands of the operator at the screen.
//!
//! Invariant: whoever receives a command decides whether it is permitted; the screen asks only where keys need it.

use std::path::PathBuf;
use std::time::Duration;

use retrace_controller::{FrameShape, JogSpeed, ManualTask, OperatorCommand};

use crate::work_tables::TableChange;

/// Time without a sign that a jog is still held, after which it ends, at the terminal and on the page. The axis begins
/// to brake within 200 ms of the last one: what is left of them is for the way to the card.
pub const HELD_JOG_TIMEOUT: Duration = Duration::from_millis(160);

/// Command of the operator at the screen.
#[derive(Clone, Debug, PartialEq)]
pub enum UiCommand {
    /// Command to the running job.
    Job(OperatorCommand),
    /// Manual task while no job runs. A continuous motion ends with [`OperatorCommand::Hold`].
    Task(ManualTask),
    /// The key of a continuous jog is held down: it begins, or goes on. It ends [`crate::HELD_JOG_TIMEOUT`] after the
    /// last one of these, and with any other command.
    JogHeld {
        /// Axis letter, lower case.
        axis: char,
        /// Whether in the positive direction.
        up: bool,
        /// How fast.
        speed: JogSpeed,
    },
    /// The key of a continuous jog was released.
    JogReleased,
    /// The handwheel was turned by this number of counts.
    Turn(i32),
    /// Start the program.
    Start,
    /// Start the program at the contour of this number.
    StartContour(u32),
    /// Start the program at this line, with the modal state in force there.
    StartLine(u32),
    /// Start the next pieces of a job of the shop, one after the other, which the operator has confirmed.
    StartShopJob {
        /// Its name.
        id: String,
        /// Number of pieces, from 1.
        pieces: u32,
    },
    /// Start no further piece of a series; the piece that runs goes on.
    EndSeries,
    /// Skip a contour of the next job, or cut it after all.
    SkipContour {
        /// Its number.
        number: u32,
        /// Whether it is skipped.
        on: bool,
    },
    /// The consumables of the cutters are new; no job runs.
    ConsumablesChanged,
    /// Resume this interrupted job.
    ResumeJob(String),
    /// Return to setup after a job.
    SetUp,
    /// Load another program from this file.
    Load(PathBuf),
    /// Trace a frame around what the program cuts, with the pointer.
    Frame(FrameShape),
    /// Take the place of the tool, or of the pointer while it is on, as a point on the edge of the sheet.
    SheetPoint,
    /// Set origin and direction of the work coordinates by the edge of the sheet.
    AlignSheet,
    /// Forget the points on the edge of the sheet.
    ForgetSheet,
    /// Switch every cutter off.
    CutterOff,
    /// Switch optional stop (M1) on or off.
    OptionalStop(bool),
    /// Answer to the open question.
    Answer(bool),
    /// Close the box of a refused program.
    CloseRefusal,
    /// Switch dry run on or off.
    DryRun(bool),
    /// Replace offsets and tool data while no job runs.
    SetTables(Box<TableChange>),
    /// Close the screen; no job runs.
    Quit,
}
