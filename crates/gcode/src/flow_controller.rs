//! Execution of calls, branches and loops over compiled lines.
//!
//! Invariant: a jump reads the compiled line once. The loops of a call end with it. Nothing is allocated once the
//! maximum depth of calls has been reached.

use crate::canon::CanonStep;
use crate::compiled_code::{BY_NUMBER, CompiledCode, Jump, SubId};
use crate::control::Label;
use crate::cycle_call::CycleCall;
use crate::diag::{BlockError, BlockResult, Span, fault};
use crate::error_codes::ErrorCode as Number;
use crate::interp::Interpreter;
use crate::line_numbers::GotoError;
use crate::loop_stack::LoopStack;
use crate::params::Frame;
use crate::path_explorer::{PathExplorer, RETURN};
use crate::probing_cycles::TOOL_CHANGE;
use crate::program_location::{CallFrame, LoopKind};
use crate::subs::{Sub, Subs, wrong_call};
use std::sync::Arc;

/// Maximum number of nested calls, as in LinuxCNC.
const MAX_CALLS: usize = 9;

/// State of the caller that a call saves.
#[derive(Debug)]
pub(crate) struct OpenCall {
    sub: Sub,
    /// File and line of the block before, which is the call where no compiled line calls.
    from: (u16, u32),
    /// Local parameters of the caller.
    frame: Frame,
    /// Number of repeats of M98, and how many of them remain.
    of: u32,
    rounds: u32,
}

/// A region of compiled lines being executed.
#[derive(Debug)]
pub(crate) struct CallLevel {
    pub(crate) code: Arc<CompiledCode>,
    /// Next line.
    pub(crate) next: u32,
    /// Line after the region.
    end: u32,
    /// Number of loops that were open before.
    pub(crate) loops: usize,
    /// State of its call; `None` for a region of the program itself.
    pub(crate) call: Option<OpenCall>,
}

/// Result of a compiled line.
#[derive(Debug)]
pub(crate) enum LineOutcome {
    /// A block, to be executed now.
    Block,
    /// The call of a cycle, to be run now.
    Cycle(CycleCall),
    /// A jump only.
    Jumped,
    /// Refused when it was compiled.
    Faulty,
    /// Nothing is open: the program's own next line follows.
    Idle,
    /// M99 in the program itself ends the program.
    ProgramEnd,
    /// It is unknown what follows on this path.
    PathEnd,
    /// A streamed program continues at the next line with this number; span of the GOTO.
    Ahead(u64, Span),
}

/// Open regions, and the known subprograms.
#[derive(Debug, Default)]
pub(crate) struct FlowController {
    pub(crate) levels: Vec<CallLevel>,
    /// Open loops, with their iterations.
    pub(crate) loops: LoopStack,
    /// Whether a condition was false and the next line reached decides.
    pub(crate) is_undecided: bool,
    pub(crate) calls: usize,
    /// The other paths behind branches on unknown values; `None` where no value is unknown, as in a run.
    pub(crate) explorer: Option<Box<PathExplorer>>,
    /// Number of levels and line before the line executed last.
    pub(crate) executed: (usize, u32),
    /// Whether M98 repeats the subprogram that has just ended.
    pub(crate) repeats_call: bool,
    /// Compiled lines by file.
    pub(crate) codes: Vec<Arc<CompiledCode>>,
    pub(crate) subs: Subs,
    /// Whether the program was pre-scanned, so that all of its subprograms are known. Otherwise they arrive with it.
    pub(crate) is_prescanned: bool,
}

impl FlowController {
    /// Whether compiled lines are being executed.
    #[inline]
    pub(crate) fn is_open(&self) -> bool {
        !self.levels.is_empty()
    }

    /// Returns the current compiled line.
    pub(crate) fn current_line(&self) -> Option<(&CompiledCode, u32)> {
        self.levels.last().map(|level| (&*level.code, level.next.saturating_sub(1)))
    }

    /// Returns the calls and loops around the current line, from inside to outside. `name` names a file.
    pub(crate) fn frames(&self, name: impl Fn(u16) -> String) -> Vec<CallFrame> {
        let mut frames = Vec::new();
        let mut open = self.loops.open_count();
        for (index, level) in self.levels.iter().enumerate().rev() {
            self.loops.push_frames(&level.code, level.next.saturating_sub(1), level.loops..open, &mut frames);
            open = level.loops;
            let Some(call) = &level.call else { continue };
            let from = index.checked_sub(1).and_then(|below| self.levels.get(below));
            let from = from.map_or((name(call.from.0), call.from.1), |below| {
                (name(below.code.file), below.code.line_number(below.next.saturating_sub(1)))
            });
            let label = self.subs.label(&call.sub).map_or_else(String::new, ToString::to_string);
            frames.push(CallFrame::Sub { name: label, from, repeat: call.of - call.rounds, repeats: call.of });
        }
        frames
    }

    /// Whether a subprogram of this label is being executed.
    pub(crate) fn is_in(&self, label: &Label) -> bool {
        self.levels.iter().filter_map(|level| level.call.as_ref()).any(|call| self.subs.label(&call.sub) == Some(label))
    }

    /// Calls the subprogram that changes the tool, behind the block that was executed last.
    pub(crate) fn call_tool_change(&mut self, interpreter: &mut Interpreter) -> BlockResult<()> {
        let label = Label::Name(TOOL_CHANGE.into());
        let id = self.subs.find(0, &label).ok_or_else(|| self.no_such_sub_error(&label, Span::default()))?;
        self.enter(id, &label, false, 0, Span::default(), interpreter).map(|_| ())
    }

    /// Returns the cycle that is called in this line, if it is the current one.
    pub(crate) fn cycle(&self, (file, number): (u16, u32)) -> Option<&str> {
        let (code, line) = self.current_line()?;
        if (code.file, code.line_number(line)) != (file, number) {
            return None;
        }
        match code.jump(line)? {
            Jump::Cycle { call } => code.cycles.get(call as usize).map(|(_, call)| &*call.name),
            _ => None,
        }
    }

    /// Enters a region of the program itself.
    pub(crate) fn begin(&mut self, code: Arc<CompiledCode>, start: u32, end: u32) {
        self.levels.push(CallLevel { code, next: start, end, loops: self.loops.open_count(), call: None });
    }

    /// Executes the next compiled line.
    #[inline]
    pub(crate) fn step(
        &mut self,
        interpreter: &mut Interpreter,
        steps: &mut Vec<CanonStep>,
    ) -> BlockResult<LineOutcome> {
        let depth = self.levels.len();
        let Some(level) = self.levels.last_mut() else { return Ok(LineOutcome::Idle) };
        let line = level.next;
        self.executed = (depth, line);
        if line == RETURN {
            let value = interpreter.state().returned_value;
            return self.leave_with(value, interpreter, steps);
        }
        if line >= level.end {
            self.loops.truncate(level.loops);
            self.levels.pop();
            return Ok(if self.levels.is_empty() { LineOutcome::Idle } else { LineOutcome::Jumped });
        }
        level.next = line + 1;
        let Some(jump) = level.code.jump(line) else { return Ok(LineOutcome::Idle) };
        if let Jump::None = jump {
            interpreter.load(&level.code, line);
            return Ok(LineOutcome::Block);
        }
        self.jump(jump, line, interpreter, steps)
    }

    fn jump(
        &mut self,
        jump: Jump,
        line: u32,
        interpreter: &mut Interpreter,
        steps: &mut Vec<CanonStep>,
    ) -> BlockResult<LineOutcome> {
        let undecided = std::mem::take(&mut self.is_undecided);
        let Some(level) = self.levels.last_mut() else { return Ok(LineOutcome::Idle) };
        interpreter.load(&level.code, line);
        match jump {
            Jump::None => return Ok(LineOutcome::Block),
            Jump::Faulty => return Ok(LineOutcome::Faulty),
            Jump::Pass => {}
            Jump::Over { to } => level.next = to,
            Jump::Call { call } => return self.call(call, interpreter, steps),
            Jump::If { otherwise } => {
                let condition = interpreter.control_value()?;
                if condition.is_nan() {
                    self.fork(otherwise, true, interpreter, steps);
                } else if condition == 0.0 {
                    (level.next, self.is_undecided) = (otherwise, true);
                }
            }
            Jump::ElseIf { otherwise, end } => {
                if !undecided {
                    level.next = end;
                    return Ok(LineOutcome::Jumped);
                }
                let condition = interpreter.control_value()?;
                if condition.is_nan() {
                    self.fork(otherwise, true, interpreter, steps);
                } else if condition == 0.0 {
                    (level.next, self.is_undecided) = (otherwise, true);
                }
            }
            Jump::Else { end } => {
                if !undecided {
                    level.next = end;
                }
            }
            Jump::While { end } => {
                let condition = interpreter.control_value()?;
                let below = level.loops;
                self.with_explorer(|explorer, depth| {
                    if explorer.entered.take() != Some((depth, line)) {
                        explorer.begin_loop(depth, line);
                    }
                });
                if condition.is_nan() {
                    self.fork(end, false, interpreter, steps);
                    self.begin_joined_loop(line, interpreter);
                    self.loops.decide(LoopKind::While, line..end, below, true);
                    return Ok(LineOutcome::Jumped);
                }
                let goes_on = condition != 0.0;
                let Some(level) = self.levels.last_mut() else { return Ok(LineOutcome::Idle) };
                if !self.loops.decide(LoopKind::While, line..end, level.loops, goes_on) {
                    level.next = end;
                }
            }
            Jump::WhileOfDo { begin } => {
                let condition = interpreter.control_value()?;
                if condition.is_nan() {
                    self.fork(line + 1, false, interpreter, steps);
                    self.with_explorer(|explorer, depth| explorer.set_unknown(depth, begin - 1));
                }
                let Some(level) = self.levels.last_mut() else { return Ok(LineOutcome::Idle) };
                let goes_on = condition != 0.0;
                if self.loops.decide(LoopKind::Do, begin..line + 1, level.loops, goes_on) {
                    level.next = begin;
                }
            }
            Jump::Repeat { end } => {
                let rounds = interpreter.control_value()?.round();
                self.with_explorer(|explorer, depth| explorer.begin_loop(depth, line));
                if rounds.is_nan() {
                    self.fork(end, false, interpreter, steps);
                    self.loops.begin_repeat(line..end, u64::MAX);
                    self.begin_joined_loop(line, interpreter);
                    return Ok(LineOutcome::Jumped);
                }
                let Some(level) = self.levels.last_mut() else { return Ok(LineOutcome::Idle) };
                let rounds = rounds as i64;
                if rounds < 1 {
                    level.next = end;
                } else {
                    self.loops.begin_repeat(line..end, rounds as u64);
                }
            }
            Jump::EndRepeat { begin } => {
                if self.is_joined_loop(begin - 1) {
                    self.fork(line + 1, false, interpreter, steps);
                    if let Some(level) = self.levels.last_mut() {
                        level.next = begin;
                    }
                    return Ok(LineOutcome::Jumped);
                }
                let Some(level) = self.levels.last_mut() else { return Ok(LineOutcome::Idle) };
                if self.loops.end_iteration(line + 1, level.loops) {
                    level.next = begin;
                }
            }
            Jump::Leave { to } => {
                // A continue goes to the end of its loop, so that all paths of the round meet before the next.
                let to = match level.code.jump(to) {
                    Some(Jump::While { end }) if self.explorer.is_some() && to < line && line + 1 < end => end - 1,
                    _ => to,
                };
                self.loops.leave(to, level.loops);
                level.next = to;
            }
            Jump::Return => return self.leave(interpreter, steps),
            Jump::Cycle { call } => {
                if let Some((_, call)) = level.code.cycles.get(call as usize) {
                    return Ok(LineOutcome::Cycle(call.clone()));
                }
            }
            Jump::ModalCall { call } => {
                if let Some((_, call)) = level.code.cycles.get(call as usize) {
                    interpreter.begin_modal(call)?;
                }
            }
            Jump::ModalEnd => interpreter.end_modal(),
            Jump::IfThen => {
                let condition = interpreter.condition()?;
                if condition.is_nan() {
                    self.fork(line + 1, false, interpreter, steps);
                }
                return Ok(if condition == 0.0 { LineOutcome::Jumped } else { LineOutcome::Block });
            }
            Jump::GoTo { to, is_conditional } => {
                let condition = if is_conditional { interpreter.condition()? } else { 1.0 };
                if condition == 0.0 {
                    return Ok(LineOutcome::Jumped);
                }
                if condition.is_nan() {
                    self.fork(line + 1, false, interpreter, steps);
                }
                return self.go_to(to, line, condition.is_nan(), interpreter, steps);
            }
        }
        Ok(LineOutcome::Jumped)
    }

    /// Jumps to another line of the level: to `to`, or to the line number that is the block's last value.
    fn go_to(
        &mut self,
        to: u32,
        from: u32,
        is_unknown: bool,
        interpreter: &mut Interpreter,
        steps: &mut Vec<CanonStep>,
    ) -> BlockResult<LineOutcome> {
        let Some(level) = self.levels.last_mut() else { return Ok(LineOutcome::Idle) };
        let to = if to == BY_NUMBER {
            let (value, at) = interpreter.last_value()?;
            if value.is_nan() {
                interpreter.forget_effects("the number of the line", at, steps);
                return Ok(LineOutcome::PathEnd);
            }
            let number = crate::eval::to_whole_number(value, at, "the number of a line")?;
            let line = match u64::try_from(number) {
                Ok(number) => level.code.line_numbers.find(from, number),
                Err(_) => return fault(Number::NoSuchLineNumber, at, format!("there is no line N{number}")),
            };
            match line {
                Ok(line) => line,
                // Only this region of a streamed program is known.
                Err(GotoError::Missing(number)) if !self.is_prescanned && self.calls == 0 => {
                    self.levels.clear();
                    self.loops.truncate(0);
                    return Ok(LineOutcome::Ahead(number, at));
                }
                Err(error) => return Err(Box::new(error.fault(at))),
            }
        } else {
            to
        };
        self.loops.leave(to, level.loops);
        level.next = to;
        if is_unknown && to <= from {
            self.with_explorer(|explorer, depth| explorer.set_unknown(depth, to));
        }
        Ok(LineOutcome::Jumped)
    }

    fn call(
        &mut self,
        call: u32,
        interpreter: &mut Interpreter,
        steps: &mut Vec<CanonStep>,
    ) -> BlockResult<LineOutcome> {
        let Some(level) = self.levels.last() else { return Ok(LineOutcome::Idle) };
        let code = Arc::clone(&level.code);
        let Some(site) = code.calls.get(call as usize) else { return Ok(LineOutcome::Idle) };
        let first = interpreter.control_value()?;
        let is_counted = site.is_m98 && interpreter.argument(1).is_some_and(f64::is_nan);
        if is_counted || site.label == Label::Calculated && first.is_nan() {
            interpreter.forget_effects("the call", site.at, steps);
            interpreter.forget_all();
            return Ok(LineOutcome::Jumped);
        }
        let id = match (site.sub, &site.label) {
            (Some(id), _) => id,
            (None, Label::Calculated) => self.calculated(&code, first, site.at)?,
            (None, label) => match self.subs.find(code.file, label) {
                Some(id) => id,
                None => return Err(self.no_such_sub_error(label, site.at)),
            },
        };
        let given = usize::from(site.label == Label::Calculated);
        self.enter(id, &site.label, site.is_m98, given, site.at, interpreter)
    }

    fn calculated(&self, code: &CompiledCode, number: f64, at: Span) -> BlockResult<SubId> {
        let number = crate::eval::to_whole_number(number, at, "the number of a subprogram")?;
        let label = u64::try_from(number).ok().map(Label::Number);
        match &label {
            Some(label) => self.subs.find(code.file, label).ok_or_else(|| self.no_such_sub_error(label, at)),
            None => fault(Number::NoSuchSub, at, format!("there is no subprogram O{number}")),
        }
    }

    /// Returns the error for a called subprogram that does not exist, or not yet.
    fn no_such_sub_error(&self, label: &Label, at: Span) -> Box<BlockError> {
        if self.is_prescanned {
            Box::new(BlockError::new(Number::NoSuchSub, at, format!("there is no subprogram {label}")))
        } else {
            FlowController::not_arrived_error(label, at)
        }
    }

    /// Enters a subprogram with the values of the line evaluated last. The first `given` of them are not arguments.
    fn enter(
        &mut self,
        id: SubId,
        label: &Label,
        is_m98: bool,
        given: usize,
        at: Span,
        interpreter: &mut Interpreter,
    ) -> BlockResult<LineOutcome> {
        let Some(sub) = self.subs.get(id).cloned() else { return Ok(LineOutcome::Idle) };
        if sub.for_m98 != is_m98 {
            return Err(Box::new(wrong_call(label, is_m98, at)));
        }
        if self.calls >= MAX_CALLS {
            return fault(Number::TooManyCalls, at, Number::TooManyCalls.title());
        }
        let rounds = match interpreter.argument(1) {
            Some(rounds) if is_m98 => rounds.round().clamp(0.0, f64::from(u32::MAX)) as u32,
            _ => 1,
        };
        let Some(code) = self.codes.get(sub.code as usize).map(Arc::clone) else { return Ok(LineOutcome::Idle) };
        if rounds == 0 {
            return Ok(LineOutcome::Jumped);
        }
        self.calls += 1;
        let from = interpreter.current_line();
        let frame = if is_m98 { interpreter.enter_shared() } else { interpreter.enter_sub(given) };
        let (next, end) = (sub.entry, code.len());
        let call = Some(OpenCall { sub, from, frame, of: rounds, rounds: rounds - 1 });
        self.levels.push(CallLevel { code, next, end, loops: self.loops.open_count(), call });
        Ok(LineOutcome::Jumped)
    }

    /// Executes return, endsub and M99.
    fn leave(&mut self, interpreter: &mut Interpreter, steps: &mut Vec<CanonStep>) -> BlockResult<LineOutcome> {
        let value = interpreter.control_value()?;
        let value = interpreter.has_control_value().then_some(value);
        if self.has_waiting() {
            // The level is left once all its paths have come here.
            interpreter.set_returned_value(value);
            if let Some(level) = self.levels.last_mut() {
                self.loops.truncate(level.loops);
                level.next = RETURN;
            }
            return Ok(LineOutcome::Jumped);
        }
        self.leave_with(value, interpreter, steps)
    }

    /// Leaves the subprogram with its return value.
    fn leave_with(
        &mut self,
        value: Option<f64>,
        interpreter: &mut Interpreter,
        steps: &mut Vec<CanonStep>,
    ) -> BlockResult<LineOutcome> {
        // Regions of the program itself are below all calls.
        let Some(level) = self.levels.last_mut() else { return Ok(LineOutcome::Idle) };
        self.loops.truncate(level.loops);
        let Some(mut call) = level.call.take() else { return Ok(LineOutcome::ProgramEnd) };
        let taken_up = interpreter.restore_on_return(steps);
        interpreter.leave_sub(call.frame, value);
        if call.rounds > 0 {
            call.rounds -= 1;
            call.frame = interpreter.enter_shared();
            self.repeats_call = true;
            level.next = call.sub.entry;
            level.call = Some(call);
        } else {
            self.calls -= 1;
            self.levels.pop();
        }
        taken_up?;
        Ok(LineOutcome::Jumped)
    }

    /// Creates a controller that runs one subprogram, without a caller.
    pub(crate) fn for_subprogram(&self, id: SubId) -> Option<FlowController> {
        let sub = self.subs.get(id)?;
        let code = Arc::clone(self.codes.get(sub.code as usize)?);
        let (next, end) = (sub.entry, code.len());
        let (codes, subs) = (self.codes.clone(), self.subs.clone());
        let mut flow = FlowController { codes, subs, is_prescanned: self.is_prescanned, ..FlowController::default() };
        flow.levels.push(CallLevel { code, next, end, loops: 0, call: None });
        Some(flow)
    }

    /// Returns the error for a call whose subprogram has not arrived yet.
    pub(crate) fn not_arrived_error(label: &Label, at: Span) -> Box<BlockError> {
        Box::new(BlockError::new(Number::SubNotArrived, at, format!("subprogram {label} has not arrived yet")))
    }
}
