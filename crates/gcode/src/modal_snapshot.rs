//! State that blocks leave for the blocks after them: from one MDI block to the next, and from all of them to a
//! program.
//!
//! Invariant: the receiver is between two blocks and outside of all calls: no compensated path, no collected points and
//! no cycle of MCALL is passed on. A program receives only the parameters that a parameter file stores, the tool table,
//! and the tool in the spindle, so that its meaning never depends on modes that are not visible in it.

use crate::block::NcBlock;
use crate::canon::{Canon, FeedMode, PathControl, Plane};
use crate::control::Keyword;
use crate::diag::{BlockError, BlockResult, Diagnostic, Span, fault};
use crate::error_codes::ErrorCode;
use crate::groups::GroupG;
use crate::interp::{CompensationQueue, Interpreter, Setup};
use crate::modal::ModalState;
use crate::params::{Names, Parameters};
use crate::parse::LineReader;
use crate::pose::Pose;
use crate::tool::ToolTable;
use std::sync::Arc;

/// Modal state, parameters and tools between two blocks.
#[derive(Clone, Debug)]
pub struct ModalSnapshot {
    pub(crate) state: ModalState,
    pub(crate) parameters: Parameters,
    pub(crate) tools: ToolTable,
    pub(crate) names: Names,
}

impl ModalSnapshot {
    pub(crate) fn new(
        mut state: ModalState,
        parameters: &Parameters,
        tools: &ToolTable,
        names: &Names,
    ) -> ModalSnapshot {
        (state.compensation, state.has_left_compensation, state.waiting) = (None, false, CompensationQueue::default());
        state.tool_shift = None;
        (state.call_level, state.returned_value) = (0, None);
        state.saved_states.clear();
        state.control_points.clear();
        ModalSnapshot { state, parameters: parameters.clone(), tools: tools.clone(), names: names.clone() }
    }

    /// Returns the modal state.
    #[must_use]
    pub fn state(&self) -> &ModalState {
        &self.state
    }

    /// Returns the parameters.
    #[must_use]
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// Returns the tools.
    #[must_use]
    pub fn tools(&self) -> &ToolTable {
        &self.tools
    }

    /// Replaces parameters and tools. The offsets in force are derived from them when the next block is read.
    #[must_use]
    pub fn with_tables(mut self, parameters: Parameters, tools: ToolTable) -> Self {
        (self.parameters, self.tools) = (parameters, tools);
        self.state.g92_offset = Pose::ZERO;
        self
    }

    /// Emits the canonical functions that lead from the state at program start to this state. Units, coordinate systems
    /// and the offset of G92 have been emitted already.
    pub(crate) fn announce(state: &ModalState, initial: &ModalState, mut tell: impl FnMut(Canon)) {
        if state.plane != Plane::Xy {
            tell(Canon::SelectPlane(state.plane));
        }
        if state.tool_offset != Pose::ZERO {
            tell(Canon::UseToolLengthOffset(state.tool_offset));
        }
        if state.path_control != initial.path_control || state.naivecam_tolerance != initial.naivecam_tolerance {
            tell(Canon::SetMotionControlMode(state.path_control));
            if matches!(state.path_control, PathControl::Continuous { .. }) {
                tell(Canon::SetNaivecamTolerance(state.naivecam_tolerance));
            }
        }
        if state.feed_mode != FeedMode::UnitsPerMinute {
            tell(Canon::SetFeedMode(state.feed_mode));
        }
        if state.feed_rate != 0.0 {
            tell(Canon::SetFeedRate(state.feed_rate));
        }
    }
}

/// Initial data of a program that are not in its text: parameters, tools, and the tool in the spindle.
#[derive(Clone, Debug, PartialEq)]
pub struct StartTables {
    /// Parameters, offsets among them.
    pub parameters: Parameters,
    /// Tool table.
    pub tools: ToolTable,
    /// Tool in the spindle; 0 is none.
    pub current_tool: u32,
    /// Tool of the last T word; 0 is none.
    pub selected_tool: u32,
}

impl Setup {
    /// Returns the initial data of an interpreter with this setup.
    #[must_use]
    pub fn start_tables(&self) -> StartTables {
        let (parameters, tools) = match &self.snapshot {
            Some(snapshot) => (&snapshot.parameters, &snapshot.tools),
            None => (&self.parameters, &self.tools),
        };
        let (current_tool, selected_tool) = self
            .snapshot
            .as_ref()
            .map_or((0, 0), |snapshot| (snapshot.state.current_tool, snapshot.state.selected_tool));
        StartTables { parameters: parameters.clone(), tools: tools.clone(), current_tool, selected_tool }
    }

    /// Returns this setup for a program that begins with these tables.
    #[must_use]
    pub fn with_start_tables(self, tables: StartTables) -> Setup {
        let StartTables { parameters, tools, current_tool, selected_tool } = tables;
        let setup = Setup { parameters, tools, snapshot: None, ..self };
        if (current_tool, selected_tool) == (0, 0) {
            return setup;
        }
        let state = ModalState { current_tool, selected_tool, ..ModalState::initial(setup.program_units) };
        let (parameters, tools) = (setup.parameters.clone(), setup.tools.clone());
        setup.continuing(&ModalSnapshot { state, parameters, tools, names: Names::default() })
    }

    /// Returns this setup for an MDI block that continues from `carried`.
    #[must_use]
    pub fn continuing(self, snapshot: &ModalSnapshot) -> Setup {
        Setup { snapshot: Some(Arc::new(snapshot.clone())), ..self }
    }

    /// Returns this setup for a program that follows: with the persistent parameters, the tool table and the tool in
    /// the spindle.
    #[must_use]
    pub fn following(self, snapshot: &ModalSnapshot) -> Setup {
        let state = ModalState {
            current_tool: snapshot.state.current_tool,
            selected_tool: snapshot.state.selected_tool,
            ..ModalState::initial(self.program_units)
        };
        let parameters = snapshot.parameters.persistent();
        let snapshot = ModalSnapshot { state, parameters, tools: snapshot.tools.clone(), names: Names::default() };
        self.continuing(&snapshot)
    }
}

/// Checks that this text can be executed as an MDI block: one line that needs no other line and leaves nothing open.
pub(crate) fn check_mdi(text: &str, setup: &Setup) -> Result<(), Vec<Diagnostic>> {
    let mut reader = LineReader::of(setup);
    let BlockError { code, span, message } = match check_mdi_block(text, &mut reader) {
        Ok(()) => return Ok(()),
        Err(fault) => *fault,
    };
    Err(vec![Diagnostic { code, file: 0, line: 1, span, message }])
}

fn check_mdi_block(text: &str, reader: &mut LineReader) -> BlockResult<()> {
    let whole = Span::new(0, text.len());
    if text.trim().is_empty() {
        return Err(Box::new(BlockError::plain(ErrorCode::EmptyProgram, whole)));
    }
    if text.contains(['\n', '\r']) {
        return fault(ErrorCode::NotMdi, whole, "an MDI block is one line");
    }
    if text.trim() == "%" {
        return fault(ErrorCode::NotMdi, whole, "a percent sign is allowed in a file only");
    }
    if !reader.read(text.as_bytes())? {
        return Ok(());
    }
    let block: &NcBlock = &reader.block;
    if let Some(control) = &block.control
        && !matches!(control.keyword, Keyword::Call | Keyword::M98 | Keyword::Cycle)
    {
        let message = format!("{} is allowed in a program only", control.keyword.name());
        return fault(ErrorCode::NotMdi, control.at, message);
    }
    if block.words.g(GroupG::CutterCompensation).is_some_and(|code| code != 400) {
        let at = block.words.g_span(GroupG::CutterCompensation);
        return fault(ErrorCode::NotMdi, at, "cutter compensation needs the next block, and none follows an MDI block");
    }
    Ok(())
}

impl Interpreter {
    /// Returns the state for the blocks after these.
    #[must_use]
    pub fn modal_snapshot(&self) -> ModalSnapshot {
        ModalSnapshot::new(self.state().clone(), self.parameters(), self.tools(), self.names())
    }
}
