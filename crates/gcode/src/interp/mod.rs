//! The interpreter: converts lines to canonical functions.
//!
//! Invariant: a line is read, checked as a whole and only then executed, in the order that RS274/NGC defines. A faulty
//! block leaves a diagnostic, and the next line is executed from the state that holds then.

mod arc;
mod block_motion;
mod canned;
mod check;
mod compensation_corner;
mod context;
mod contour_ends;
mod contours;
mod cutter_compensation;
mod cutting;
mod cycle_host;
mod diagnostics;
mod execute;
mod holes;
mod interpreter_core;
mod modes;
mod motion;
mod offsets;
mod polar;
mod ports;
mod probe;
mod spindle;
mod spline;
mod stop;
mod thread;
mod tool_data;
mod turning;
mod unknown_block;
mod unsupported;

pub(crate) use self::contours::{Contours, NoContours};
pub(crate) use self::interpreter_core::Core;
use self::interpreter_core::{BlockEnvironment, Emitter};
use crate::block::{Assignment, Words, letters};
use crate::block_number::BlockNumber;
use crate::canon::{Canon, CanonStep};
use crate::compensation_queue::CompensationQueue;
use crate::compiled_code::CompiledCode as CompiledLines;
use crate::control::{Control, Keyword, MAX_ARGUMENTS};
use crate::cutting::CuttingSetting;
use crate::diag::{BlockError, BlockResult, Diagnostic, Span, fault};
use crate::error_codes::ErrorCode;
use crate::groups::GroupG;
use crate::modal::ModalState;
use crate::modal_groups::MotionMode;
use crate::modal_snapshot::ModalSnapshot;
use crate::params::{Frame, Names, Parameters};
use crate::parse::LineReader;
use crate::pose::Pose;
use crate::setup::{Answers, Setup};
use crate::tool::ToolTable;
use crate::turning::Profile;
use std::fmt;
use std::sync::Arc;

/// Number of errors after which checking stops, and maximum number of stored warnings.
pub(crate) const MAX_ERRORS: usize = 100;

/// Whether a program continues after a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProgramFlow {
    /// Execution continues with the next line.
    Continue,
    /// M2 or M30 was executed.
    ProgramEnd,
}

/// Kind of a line that was read.
#[derive(Debug)]
pub(crate) enum LineRead {
    /// A block to be executed.
    Block,
    /// Deleted by its slash.
    Deleted,
    /// A line with an O word, whose values are not evaluated yet.
    Control(Control),
}

/// A block was refused; the diagnostics have the reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockRefusedError;

impl fmt::Display for BlockRefusedError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the block is refused; see the diagnostics")
    }
}

impl std::error::Error for BlockRefusedError {}

/// Interpreter that reads and executes a program line by line. It stores no text, so a program may be of any length.
#[derive(Clone, Debug)]
pub struct Interpreter {
    core: Core,
    reader: LineReader,
    /// Cycles, once the program has called one.
    cycles: Option<Box<cycle_host::Cycles>>,
    words: Words,
    assignments: Vec<Assignment>,
    file: u16,
    line: u32,
    /// Line of the program itself that steps belong to; in a subprogram in another file, the line of the call.
    step_line: u32,
    /// Whether it draws the profile of a turning cycle, in which U and W are increments of X and Z.
    draws_profile: bool,
    /// Whether the program comes here whatever the machine answers; see [`Self::forget_effects`].
    is_path_certain: bool,
    /// Whether Z words without effect have been reported.
    has_reported_z: bool,
    diagnostics: Vec<Diagnostic>,
    /// Number of times that each of them was found again.
    more_rounds: Vec<u32>,
    errors: usize,
    warnings: usize,
}

impl Interpreter {
    /// Creates an interpreter before its first line.
    #[must_use]
    pub fn new(setup: Setup) -> Interpreter {
        let reader = LineReader::of(&setup);
        let (state, parameters, tools) = match setup.snapshot {
            Some(snapshot) => (snapshot.state.clone(), snapshot.parameters.clone(), snapshot.tools.clone()),
            None => (ModalState::initial(setup.program_units), setup.parameters, setup.tools),
        };
        let (machine_units, user_codes) = (setup.machine_units, setup.user_codes);
        let (orient_offset_degrees, rigid_tapping) = (setup.orient_offset_degrees, setup.rigid_tapping);
        let (cutting, spindle_use) = (setup.cutting, setup.spindle_use);
        let follows_unknown = setup.answers == Answers::Unknown;
        let mut core = Core {
            machine_units,
            state,
            parameters,
            tools,
            user_codes,
            orient_offset_degrees,
            rigid_tapping,
            cutting,
            spindle_use,
            follows_unknown,
            calls_tool_change: false,
            threads: setup.threads,
            profile: None,
        };
        if follows_unknown {
            core.parameters.record_changes();
        }
        core.load_parameters(&setup.position);
        core.begin_cutting();
        Interpreter {
            core,
            reader,
            cycles: None,
            words: Words::default(),
            assignments: Vec::new(),
            file: 0,
            line: 0,
            step_line: 0,
            draws_profile: false,
            is_path_certain: true,
            has_reported_z: false,
            diagnostics: Vec::new(),
            more_rounds: Vec::new(),
            errors: 0,
            warnings: 0,
        }
    }

    /// Creates an interpreter that continues from a state, to determine the moves of a contour.
    pub(crate) fn scratch(core: Core, reader: LineReader) -> Interpreter {
        let setup = Setup::default();
        Interpreter { core, reader, ..Interpreter::new(setup) }
    }

    /// Returns the words of the block executed last.
    pub(crate) fn last_words(&self) -> &Words {
        if self.reader.block.is_constant() { &self.reader.block.words } else { &self.words }
    }

    /// Appends the canonical functions that precede those of any program: units and offsets in force.
    pub fn begin(&mut self, steps: &mut Vec<CanonStep>) {
        let state = &self.core.state;
        let mut waiting = CompensationQueue::default();
        let mut emit = Emitter { line: 0, number: None, steps, waiting: &mut waiting, warning: None };
        emit.call(Canon::UseLengthUnits(state.units));
        emit.call(Canon::SetG5xOffset { system: state.coordinate_system, offset: state.origin });
        emit.call(Canon::SetG92Offset(state.g92_offset));
        emit.call(Canon::SetXyRotation(state.rotation_degrees));
        emit.call(Canon::SetFeedReference);
        if let Some(material) = &state.cutting.material {
            emit.call(Canon::SelectMaterial(Arc::clone(material)));
        }
        ModalSnapshot::announce(state, &ModalState::initial(state.units), |canon| emit.call(canon));
    }

    /// Executes the next line of the program, given without its end, and appends its canonical functions to `steps`.
    ///
    /// # Errors
    /// The block was refused. The functions emitted before the error was found stay in `steps`.
    pub fn line(&mut self, text: &[u8], steps: &mut Vec<CanonStep>) -> Result<ProgramFlow, BlockRefusedError> {
        let outcome = self.read(self.line.saturating_add(1), text).and_then(|read| match read {
            LineRead::Block => self.execute_block(steps),
            LineRead::Deleted => Ok(ProgramFlow::Continue),
            LineRead::Control(control) => self.line_with_control(&control, steps),
        });
        outcome.map_err(|fault| {
            self.report(*fault);
            BlockRefusedError
        })
    }

    /// Of the lines that are not blocks, the call of a cycle needs nothing but the cycle.
    fn line_with_control(&mut self, control: &Control, steps: &mut Vec<CanonStep>) -> BlockResult<ProgramFlow> {
        match self.reader.block.cycle.take() {
            Some(call) if control.keyword == Keyword::Cycle => {
                self.call_cycle(&call, &NoContours, steps)?;
                Ok(ProgramFlow::Continue)
            }
            _ => fault(ErrorCode::BadControl, control.at, "an O word cannot be executed without the whole program"),
        }
    }

    /// Sets the current line.
    pub(crate) fn set_line(&mut self, file: u16, line: u32) {
        (self.file, self.line) = (file, line);
        if file == 0 {
            self.step_line = line;
        }
    }

    /// Reads a line of the program itself.
    #[inline]
    pub(crate) fn read(&mut self, line: u32, text: &[u8]) -> BlockResult<LineRead> {
        self.set_line(0, line);
        if !self.reader.read(text)? {
            return Ok(LineRead::Deleted);
        }
        Ok(match self.reader.block.control.take() {
            Some(control) => LineRead::Control(control),
            None => LineRead::Block,
        })
    }

    /// Returns the N word of the line read last.
    pub(crate) fn block_number(&self) -> Option<u64> {
        self.reader.block.number.map(BlockNumber::value)
    }

    /// Returns the compiler of lines.
    pub(crate) fn reader_mut(&mut self) -> &mut LineReader {
        &mut self.reader
    }

    /// Loads a compiled line for [`Interpreter::execute_block`] and [`Interpreter::control_value`].
    #[inline]
    pub(crate) fn load(&mut self, code: &CompiledLines, line: u32) {
        self.set_line(code.file, code.line_number(line));
        code.load(line, &mut self.reader.block);
    }

    /// Evaluates all values of the current O word, and returns the first; 0 without any.
    pub(crate) fn control_value(&mut self) -> BlockResult<f64> {
        if self.reader.block.is_constant() {
            self.assignments.clear();
            return Ok(0.0);
        }
        let environment = BlockEnvironment { core: &self.core, names: &self.reader.names, line: self.line };
        self.reader.block.calculate(&environment, &mut self.words, &mut self.assignments)?;
        Ok(self.arguments().next().unwrap_or(0.0))
    }

    /// Evaluates and returns the first value of the block only.
    pub(crate) fn condition(&mut self) -> BlockResult<f64> {
        let environment = BlockEnvironment { core: &self.core, names: &self.reader.names, line: self.line };
        self.reader.block.first_value(&environment)
    }

    /// Evaluates all values of the block, and returns the last with its span.
    pub(crate) fn last_value(&mut self) -> BlockResult<(f64, Span)> {
        self.control_value()?;
        let value = self.arguments().last().unwrap_or(0.0);
        Ok((value, self.reader.block.last_span()))
    }

    /// Whether the O word has a value in brackets; valid after its evaluation.
    pub(crate) fn has_control_value(&self) -> bool {
        self.arguments().next().is_some()
    }

    fn arguments(&self) -> impl Iterator<Item = f64> {
        self.assignments.iter().filter_map(|assignment| match assignment {
            Assignment::Argument(value) => Some(*value),
            _ => None,
        })
    }

    /// Returns the value in brackets at this index, of the O word evaluated last.
    pub(crate) fn argument(&self, index: usize) -> Option<f64> {
        self.arguments().nth(index)
    }

    /// Enters a subprogram with the values of the O word evaluated last, without the first `given` of them.
    pub(crate) fn enter_sub(&mut self, given: usize) -> Frame {
        let mut arguments = [0.0; MAX_ARGUMENTS];
        for (place, value) in arguments.iter_mut().zip(self.arguments().skip(given)) {
            *place = value;
        }
        self.enter_level();
        self.core.parameters.enter(Some(&arguments))
    }

    /// Enters a subprogram that shares its caller's numbered parameters, as M98 does.
    pub(crate) fn enter_shared(&mut self) -> Frame {
        self.enter_level();
        self.core.parameters.enter(None)
    }

    fn enter_level(&mut self) {
        self.core.state.call_level += 1;
        self.core.clear_context();
    }

    /// Restores the state that M73 has saved; to be called before the subprogram ends.
    pub(crate) fn restore_on_return(&mut self, steps: &mut Vec<CanonStep>) -> BlockResult<()> {
        let mut waiting = std::mem::take(&mut self.core.state.waiting);
        let mut emit = Emitter { line: self.step_line, number: None, steps, waiting: &mut waiting, warning: None };
        let outcome = self.core.restore_on_return(&mut emit);
        self.core.state.waiting = waiting;
        outcome
    }

    /// Leaves a subprogram; `value` is its return value.
    pub(crate) fn leave_sub(&mut self, frame: Frame, value: Option<f64>) {
        self.core.state.call_level = self.core.state.call_level.saturating_sub(1);
        self.core.state.returned_value = value;
        self.core.parameters.leave(frame);
    }

    /// Executes the compiled block.
    pub(crate) fn execute_block(&mut self, steps: &mut Vec<CanonStep>) -> BlockResult<ProgramFlow> {
        let environment = BlockEnvironment { core: &self.core, names: &self.reader.names, line: self.line };
        let is_constant = self.reader.block.is_constant();
        let mut unknown_number = None;
        if !is_constant {
            self.reader.block.calculate(&environment, &mut self.words, &mut self.assignments)?;
            for assignment in &self.assignments {
                match *assignment {
                    Assignment::Numbered(number, value) => self.core.parameters.set(number, value),
                    Assignment::Named(name, value) => {
                        self.core.parameters.set_named(name, value);
                        if self.core.cutting.is_some()
                            && let Some(setting) = CuttingSetting::of_name(self.reader.names.text(name))
                        {
                            self.core.set_cutting(setting, value);
                        }
                    }
                    Assignment::AnyNumbered(at) => unknown_number = Some(at),
                    Assignment::Argument(_) => {}
                }
            }
            if let Some(at) = unknown_number {
                self.forget_numbered(at);
            }
        }
        if self.is_block_unknown() {
            return self.execute_unknown_block(steps);
        }
        let given = if is_constant { &self.reader.block.words } else { &self.words };
        let is_diameter = given.has(b'x') && self.core.uses_diameters(given);
        const INCREMENTS: u32 = letters(b"uw");
        let has_increments = given.has_any_of(INCREMENTS);
        if has_increments && !self.draws_profile {
            self.reader.check_increments(given)?;
        }
        let is_changed = is_diameter || (has_increments && self.draws_profile);
        if is_changed {
            if is_constant {
                self.words.clone_from(&self.reader.block.words);
            }
            if is_diameter {
                self.words.halve_x();
            }
            if has_increments && self.draws_profile {
                self.core.add_increments(&mut self.words)?;
            }
        }
        let words = if is_constant && !is_changed { &self.reader.block.words } else { &self.words };
        let mut motion = check::determine_motion(words, &self.core.state)?;
        check::words_have_uses(words, motion)?;
        self.core.check_spindle(words)?;
        let changed;
        let mut ignored_z = None;
        let words = match self.core.without_z(words, motion) {
            Some((without, remaining)) => {
                ignored_z = Some(words.span(b'z'));
                (changed, motion) = (without, remaining);
                &changed
            }
            None => words,
        };
        // Taken out of the state for the block: the block's functions are either queued there or emitted.
        let mut waiting = std::mem::take(&mut self.core.state.waiting);
        let (line, number) = (self.step_line, self.reader.block.number);
        let mut emit = Emitter { line, number, steps: &mut *steps, waiting: &mut waiting, warning: None };
        self.core.emit_comment(&self.reader, self.line, &mut emit)?;
        let moves = matches!(motion, block_motion::BlockMotion::Move(_)) && words.has_any(b"xyz@^");
        let first = emit.steps.len();
        let before = self.core.state.position;
        let flow = self.core.execute(words, motion, &mut emit);
        let warning = emit.warning;
        self.core.state.waiting = waiting;
        if self.core.state.cutting.pierces_only {
            self.core.keep_pierces(first, steps);
        }
        if self.core.cutting.is_some() {
            self.core.shape_contours(before, first, steps);
            if flow.is_err() {
                self.core.release_contour(steps);
            }
        }
        if let Some(warning) = warning {
            self.report(*warning);
        }
        if let Some(at) = ignored_z
            && !std::mem::replace(&mut self.has_reported_z, true)
        {
            self.report(BlockError::plain(ErrorCode::ZIgnored, at));
        }
        if moves && self.has_modal() && flow.is_ok() {
            self.modal_cycle(steps)?;
        }
        flow
    }

    /// Releases the functions that wait for the next corner of a compensated path: the program has ended without M2 or
    /// M30.
    pub(crate) fn release(&mut self, steps: &mut Vec<CanonStep>) {
        self.core.state.waiting.release(steps, None);
        self.core.release_contour(steps);
    }

    /// Ends the program, as M2 does.
    ///
    /// # Errors
    /// The functions that wait for the next corner of a compensated path cannot be released unchanged.
    pub(crate) fn end_program(&mut self, steps: &mut Vec<CanonStep>) -> BlockResult<ProgramFlow> {
        let mut waiting = std::mem::take(&mut self.core.state.waiting);
        let (first, before) = (steps.len(), self.core.state.position);
        let mut emit = Emitter { line: self.step_line, number: None, steps, waiting: &mut waiting, warning: None };
        let ended = self.core.stop(2, Span::default(), &mut emit);
        self.core.state.waiting = waiting;
        self.core.shape_contours(before, first, steps);
        self.core.release_contour(steps);
        ended
    }

    /// Returns the modal state between two blocks. With the parameters, it is everything that the next block depends
    /// on.
    #[must_use]
    pub fn state(&self) -> &ModalState {
        &self.core.state
    }

    /// Sets the modal state, such as that of a breakpoint.
    pub fn set_state(&mut self, state: ModalState) {
        self.core.state = state;
    }

    /// Returns the tools, with the changes of G10.
    #[must_use]
    pub fn tools(&self) -> &ToolTable {
        &self.core.tools
    }

    /// Sets the profile for the turning cycle in the next block. `steps` are the calls of its subprogram Q; only the
    /// moves count.
    pub fn set_profile(&mut self, steps: &[CanonStep]) {
        self.core.profile = Some(Profile::of_steps(steps));
    }

    /// Whether the block read last is a turning cycle.
    #[inline]
    pub(crate) fn is_turning(&self) -> bool {
        self.reader.block.words.g(GroupG::Motion).is_some_and(|code| (700..730).contains(&code))
    }

    /// Returns the subprogram number of the profile of the turning cycle read last, if it has one, and an interpreter
    /// to run it with. That interpreter is positioned where the cycle begins.
    pub(crate) fn turning(&mut self) -> BlockResult<Option<(f64, Interpreter)>> {
        let environment = BlockEnvironment { core: &self.core, names: &self.reader.names, line: self.line };
        self.reader.block.calculate(&environment, &mut self.words, &mut self.assignments)?;
        let Some(number) = self.words.get(b'q') else { return Ok(None) };
        let mut scratch = Interpreter::scratch(self.core.clone(), self.reader.clone());
        if self.core.uses_diameters(&self.words) {
            self.words.halve_x();
        }
        scratch.core.state.position = self.core.end_of(&self.words);
        // The cycle has moved to its start with G0, so the profile may begin with axis words alone.
        scratch.core.state.motion = Some(MotionMode::Traverse);
        scratch.draws_profile = true;
        Ok(Some((number, scratch)))
    }

    /// Returns all parameters.
    #[must_use]
    pub fn parameters(&self) -> &Parameters {
        &self.core.parameters
    }

    /// Replaces the assumed result of the last probing move by the machine's (PRB-8): the touch and where the machine
    /// came to rest, in program coordinates and units, and whether the probe has responded.
    pub fn resolve_probe(&mut self, touch: &Pose, rest: &Pose, touched: bool) {
        self.core.resolve_probe(touch, rest, touched);
    }

    /// Replaces the assumed result of the last M66 by the machine's: the level of the input, 1 or 0, or −1 where the
    /// time was over.
    pub fn resolve_input(&mut self, value: f64) {
        self.core.resolve_input(value);
    }

    /// Returns the number of the current line, counted from 1.
    #[must_use]
    pub fn line_number(&self) -> u32 {
        self.line
    }

    /// Returns file and line of the current line.
    pub(crate) fn current_line(&self) -> (u16, u32) {
        (self.file, self.line)
    }

    /// Sets whether M6 is the call of a subprogram: one whose number is calculated is refused then.
    pub(crate) fn set_calls_tool_change(&mut self, calls: bool) {
        self.core.calls_tool_change = calls;
    }

    /// Returns the names of parameters.
    pub(crate) fn names(&self) -> &Names {
        &self.reader.names
    }
}

impl Interpreter {
    /// Returns the state for the blocks after these.
    #[must_use]
    pub fn modal_snapshot(&self) -> ModalSnapshot {
        ModalSnapshot::new(self.state().clone(), self.parameters(), self.tools(), self.names())
    }
}
