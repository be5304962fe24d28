//! The terminal screen of retrace: a job on one page, with keys for every command of the operator.
//!
//! ```text
//!  telemetry ─> ModelObserver ─> ScreenModel ─> view ────> terminal
//!                                     └───────> key_state <─ keys, mouse
//!                                                   └─> UiCommand ─> the caller
//! ```
//!
//! The screen is a pure function from the model ([`ScreenModel`]) to terminal cells, and a second one from keys to
//! commands ([`UiCommand`]). The reporting thread updates the model ([`ModelObserver`]); the motion path does not know
//! the screen. [`Screen::run`] is the loop that connects them.
//!
//! The crate opens no program, card or journal: what it shows of them is passed as [`ProgramFacts`] and telemetry.
//!
//! Invariant: every model can be drawn on a terminal of any size; the terminal is restored, however the loop ends.
//!
//! # Examples
//!
//! ```
//! use std::sync::Arc;
//! use retrace_config::MachineConfig;
//! use retrace_tui::{ProgramFacts, ScreenModel, ScreenStage};
//! let machine = MachineConfig::built_in()?;
//! let model = ScreenModel::new(Arc::new(ProgramFacts::of(&machine, "part.ngc", "G0 X1\nM2\n")));
//! assert_eq!(model.stage, ScreenStage::Setup);
//! # Ok::<(), retrace_config::NumberedError>(())
//! ```
#![forbid(unsafe_code)]

mod contour_page;
mod cut_text;
mod diagnostic_text;
mod event_text;
#[cfg(test)]
mod fake_machine;
mod files;
mod frame_text;
mod geared_status;
mod height_text;
mod key_state;
mod keys;
mod layout;
mod message;
mod model;
mod model_observer;
mod operator_panel;
mod path_length;
mod pending_question;
mod placed_path;
mod preview;
mod program_facts;
mod program_outputs;
mod prompt_answer;
mod screen;
mod sheet_text;
mod shop_job_page;
mod shop_job_table;
mod status_hint;
mod status_line;
mod tool_touch;
mod trail;
mod ui_command;
mod view;
mod work_tables;

#[cfg(test)]
mod tests;

pub use cut_text::reported_contours_text;
pub use diagnostic_text::diagnostic_lines;
pub use frame_text::{extents_mm as cut_extents_mm, height_axis as frame_height};
pub use height_text::{HeightFigures, ToolHeight, over_sheet_mm};
pub use message::Message;
pub use model::{
    Active, AlarmShown, AxisHoming, MotionKind, Pause, Question, Redraw, Rejection, ScreenModel, ScreenStage,
    TimeRemaining,
};
pub use model_observer::{ModelObserver, lock_model};
pub use operator_panel::{PanelAction, PanelStatus, panel_actions, panel_status};
pub use path_length::PathLengths;
pub use placed_path::PlacedPath;
pub use preview::Preview;
pub use program_facts::{AxisFacts, CutterFacts, HeightFacts, Planned, ProgramCheck, ProgramFacts, Text, ToolFacts};
pub use screen::{Screen, restore_terminal};
pub use sheet_text::{
    of as sheet_text, placement as sheet_placement, placement_of_whole as sheet_placement_of_whole,
    travel_left as sheet_travel_left, travel_text as sheet_travel_text,
};
pub use shop_job_table::{ShopJobRow, ShopJobTable};
pub use tool_touch::length_touching as tool_length_touching;
pub use trail::{Trail, TrailPoint};
pub use ui_command::{HELD_JOG_TIMEOUT, UiCommand};
pub use work_tables::{TableChange, WORK_SYSTEMS, WorkSystem, WorkTables};
