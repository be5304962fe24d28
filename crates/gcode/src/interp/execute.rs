//! Execution of a block, in the order that RS274/NGC defines.
//!
//! Invariant: comment, feed mode, F, S, T, M codes, then G codes with the motion last, and the stops after everything.
//! The order does not depend on the order of the words in the line.

use super::block_motion::BlockMotion;
use super::interpreter_core::{Core, Emitter};
use super::{ProgramFlow, unsupported};
use crate::angle::turned_xy;
use crate::block::Words;
use crate::canon::Canon;
use crate::canon_modes::FeedMode;
use crate::cutting::SpindleUse;
use crate::diag::{BlockError, BlockResult, Span, fault};
use crate::error_codes::ErrorCode;
use crate::eval::to_whole_number;
use crate::groups::{GroupG, GroupM};
use crate::modal_groups::SpindleRotation;
use crate::tool::Tool;

impl Core {
    /// Executes a checked block. Its comment has been emitted already.
    pub(super) fn execute(
        &mut self,
        words: &Words,
        motion: BlockMotion,
        emit: &mut Emitter<'_>,
    ) -> BlockResult<ProgramFlow> {
        if let Some(code) = words.g(GroupG::FeedMode) {
            self.set_feed_mode(code, emit);
        }
        if let Some(feed) = words.get(b'f')
            && self.state.feed_mode != FeedMode::InverseTime
        {
            self.state.feed_rate = feed;
            emit.call(Canon::SetFeedRate(self.shared_rate()));
            if self.cutting.is_some() && self.state.feed_mode == FeedMode::UnitsPerMinute {
                self.compare_feed(feed, words.span(b'f'), emit);
            }
        }
        if let Some(code) = words.g(GroupG::SpindleMode) {
            self.set_spindle_mode(code, words, emit);
        }
        if let Some(speed) = words.get(b's')
            && !self.ignores_speed(words)
        {
            self.state.spindle_speed = speed;
            emit.call(Canon::SetSpindleSpeed(speed));
        }
        if let Some(number) = words.get(b't') {
            let tool = self.tool(number, words, b't')?;
            self.state.selected_tool = tool.number;
            emit.call(Canon::SelectTool(tool.number));
        }
        if self.state.compensation.is_some() {
            self.check_waiting(emit)?;
            unsupported::switches(words, &self.state)?;
        }
        if words.has_m() {
            self.m_codes(words, emit)?;
        }
        self.g_codes(words, emit)?;
        match motion {
            BlockMotion::None => {}
            BlockMotion::Cancel => {
                emit.call(Canon::Note("interpreter: motion mode set to none"));
                (self.state.motion, self.state.series) = (None, None);
            }
            BlockMotion::Turn(code) => {
                if self.state.compensation.is_some() {
                    unsupported::turning(words)?;
                }
                self.turning_cycle(code, words, emit)?;
            }
            BlockMotion::Move(motion) => {
                if self.state.compensation.is_some() {
                    unsupported::motion(motion, words)?;
                }
                self.move_along(motion, words, emit)?;
            }
        }
        match words.m(GroupM::Stop) {
            Some(code) => self.stop(code, words.m_span(GroupM::Stop), emit),
            None => Ok(ProgramFlow::Continue),
        }
    }

    /// Returns the tool whose number a word gives.
    pub(super) fn tool(&self, number: f64, words: &Words, letter: u8) -> BlockResult<Tool> {
        let at = words.span(letter);
        let number = to_whole_number(number, at, "the word")?;
        match u32::try_from(number).ok().and_then(|number| self.tools.get(number)) {
            Some(tool) => Ok(tool),
            None => fault(ErrorCode::ToolUnknown, at, format!("tool {number} is not in the tool table")),
        }
    }

    /// Returns parameter 5401 + `index`, from 5410: the data of the tool in the spindle.
    pub(super) fn tool_parameter(&self, index: usize) -> Option<f64> {
        let tool = self.tools.get(self.state.current_tool)?;
        Some(match index {
            9 => tool.diameter,
            10 => tool.front_angle,
            11 => tool.back_angle,
            _ => tool.orientation,
        })
    }

    fn m_codes(&mut self, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        if let Some(code) = words.m(GroupM::Output) {
            self.port(code, words, emit)?;
        }
        match words.m(GroupM::Tool) {
            Some(6) if self.calls_tool_change => {
                return fault(
                    ErrorCode::ToolChangeNotAlone,
                    words.m_span(GroupM::Tool),
                    "the number of M6 is calculated",
                );
            }
            Some(6) => self.change_tool(emit),
            Some(_) => self.rename_tool(words, emit)?,
            None => {}
        }
        match words.m(GroupM::Spindle) {
            Some(19) => self.orient_spindle(words, emit)?,
            Some(code @ 70..=73) => self.context(code, words, emit)?,
            Some(code) => self.spindle(code, words, emit),
            None => {}
        }
        if let Some(code) = words.m(GroupM::Coolant) {
            self.coolant(code, emit);
        }
        if let Some(code) = words.m(GroupM::Override) {
            self.overrides(code, words.get(b'p'), emit);
        }
        if let Some(code) = words.m(GroupM::User) {
            self.user_code(code, words, emit)?;
        }
        Ok(())
    }

    fn change_tool(&mut self, emit: &mut Emitter<'_>) {
        emit.call(Canon::StartChange);
        emit.call(Canon::StopSpindleTurning(0));
        self.state.spindle = SpindleRotation::Stopped;
        self.state.cutting.lit &= !1;
        let was = std::mem::replace(&mut self.state.current_tool, self.state.selected_tool);
        let tool = self.state.current_tool;
        let comment = self.tools.name(tool).map(Into::into);
        emit.call(Canon::ChangeTool { tool, was, index: self.tools.index_of(tool), comment });
        self.restore_actual_position();
    }

    /// After G40 the position is the end of the programmed path until a move goes there. A tool change uses the actual
    /// position of the machine.
    fn restore_actual_position(&mut self) {
        if let Some(shift) = self.state.tool_shift.take() {
            let shift = turned_xy(shift, -self.state.rotation_degrees);
            self.state.position = self.state.position.plus(&shift);
        }
    }

    /// Executes M61: declares another tool in the spindle.
    fn rename_tool(&mut self, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let Some(number) = words.get(b'q') else {
            return fault(ErrorCode::WordMissing, words.m_span(GroupM::Tool), "M61 needs a Q word: the tool number");
        };
        let tool = self.tool(number, words, b'q')?;
        self.state.current_tool = tool.number;
        emit.call(Canon::ChangeToolNumber { tool: tool.number, index: self.tools.index_of(tool.number) });
        self.restore_actual_position();
        Ok(())
    }

    fn spindle(&mut self, code: u8, words: &Words, emit: &mut Emitter<'_>) {
        let needs_none = self.spindle_use == SpindleUse::NoSpeed || self.ignores_speed(words);
        let has_speed = self.state.spindle_speed != 0.0 || needs_none;
        if code != 5 && !has_speed {
            emit.warning =
                Some(Box::new(BlockError::plain(ErrorCode::SpindleWithoutSpeed, words.m_span(GroupM::Spindle))));
        }
        self.check_speed_of_start(code, words, emit);
        if self.switch_cutter(code, words, emit) {
            return;
        }
        self.state.spindle = match code {
            3 => SpindleRotation::Clockwise,
            4 => SpindleRotation::Counterclockwise,
            _ => SpindleRotation::Stopped,
        };
        emit.call(self.state.spindle.canon(0));
    }

    fn coolant(&mut self, code: u8, emit: &mut Emitter<'_>) {
        match code {
            7 => {
                self.state.mist = true;
                emit.call(Canon::MistOn);
            }
            8 => {
                self.state.flood = true;
                emit.call(Canon::FloodOn);
            }
            _ => {
                (self.state.mist, self.state.flood) = (false, false);
                emit.call(Canon::MistOff);
                emit.call(Canon::FloodOff);
            }
        }
    }

    /// Executes M48 … M53. For M50 to M53, P0 switches off; any other P, or none, switches on.
    fn overrides(&mut self, code: u8, p: Option<f64>, emit: &mut Emitter<'_>) {
        let on = match code {
            48 => true,
            49 => false,
            _ => p != Some(0.0),
        };
        if !on && code == 53 {
            emit.warn(ErrorCode::FeedHoldStays, Span::default(), "M53 P0: the feed hold stays enabled".to_owned());
        }
        let state = &mut self.state;
        if matches!(code, 48..=50) {
            state.feed_override = on;
            emit.call(if on { Canon::EnableFeedOverride } else { Canon::DisableFeedOverride });
        }
        if matches!(code, 48 | 49 | 51) {
            state.speed_override = on;
            emit.call(if on { Canon::EnableSpeedOverride } else { Canon::DisableSpeedOverride });
        }
        if code == 52 {
            state.adaptive_feed = on;
            emit.call(if on { Canon::EnableAdaptiveFeed } else { Canon::DisableAdaptiveFeed });
        }
        if code == 53 {
            state.feed_hold = on;
            emit.call(if on { Canon::EnableFeedHold } else { Canon::DisableFeedHold });
        }
    }
}
