//! A whole program: lines from any reader, percent signs, and its end.
//!
//! Invariant: lines outside of subprograms, loops and branches are read, executed and discarded. The others are
//! compiled once, by the pre-scan or as they arrive.

use crate::active::ActiveCodes;
use crate::bytes::shown;
use crate::canon::{Canon, CanonStep};
use crate::contour::{self, ContourReader};
use crate::control::{Control, Keyword, Label};
use crate::cycle_call::CycleCall;
use crate::diag::{BlockError, BlockResult, Diagnostic, Span, fault};
use crate::error_codes::ErrorCode;
use crate::flow_controller::{FlowController, LineOutcome};
use crate::interp;
use crate::interp::{Interpreter, LineRead};
use crate::line_numbers::{GotoError, parse_n_word};
use crate::lines::Lines;
use crate::lines::{is_percent, unreadable};
use crate::mdi_check::check_mdi;
use crate::prescan::Prescan;
use crate::probing_cycles::TOOL_CHANGE;
use crate::program_location::ProgramLocation;
use crate::setup::{Answers, Setup};
use crate::stream_compiler::StreamCompiler;
use crate::text::Text;
use retrace_cycles::Kind;
use std::borrow::Cow;
use std::io::BufRead;
use std::sync::Arc;

/// Maximum number of consecutive blocks in loops and calls without a motion, a dwell, a wait or a stop.
const MAX_BLOCKS_WITHOUT_MOTION: u32 = 10_000_000;

/// Number of such blocks that exceeds what a loop with motion has between two moves.
const LONG_WITHOUT_MOTION: u32 = 100_000;

/// Maximum number of blocks in loops and calls that a check executes.
const MAX_CHECKED_LOOP_BLOCKS: u64 = 10_000_000;

/// Result of one line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// The line was executed; more may follow.
    Line,
    /// The line was refused; a diagnostic has the reason. The program may continue with the next line.
    BlockError,
    /// No line is left: the program has ended, with or without an error in its diagnostics.
    End,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Opening,
    Running,
    Closed,
}

/// A program being interpreted.
#[derive(Debug)]
pub struct Program<R> {
    lines: Lines<R>,
    interpreter: Interpreter,
    flow: FlowController,
    /// Result of the pre-scan; `None` for a streamed program.
    prescan: Option<Arc<Prescan>>,
    /// Index of the first region that may follow.
    region: usize,
    arriving: StreamCompiler,
    phase: Phase,
    /// Whether it opened with a percent sign, so that it may close with one.
    percent: bool,
    /// Whether a line was read ahead to find the beginning of the program and is still to be executed.
    is_read_ahead: bool,
    /// Whether it is one MDI block, which needs no end.
    is_mdi: bool,
    /// Whether M6 calls the subprogram that changes the tool.
    calls_tool_change: bool,
    /// Whether it could not be read to its end, and that has been reported.
    is_unreadable: bool,
    /// Target of a GOTO in a streamed program: the next line with this number; line and span of the GOTO.
    goto_ahead: Option<(u64, u32, Span)>,
    /// Number of blocks executed in loops and calls.
    loop_blocks: u64,
    /// Number of the last of them without a motion, a dwell, a wait or a stop.
    blocks_without_motion: u32,
}

impl<R: BufRead> Program<R> {
    /// Creates a streamed program before its first line; jumps reach only lines that have arrived.
    pub fn new(input: R, setup: Setup) -> Program<R> {
        Program::over(Lines::new(input), setup)
    }

    fn over(lines: Lines<R>, setup: Setup) -> Program<R> {
        Program {
            lines,
            calls_tool_change: setup.calls_tool_change,
            interpreter: Interpreter::new(setup),
            flow: FlowController::default(),
            prescan: None,
            region: 0,
            arriving: StreamCompiler::default(),
            phase: Phase::Opening,
            percent: false,
            is_read_ahead: false,
            is_mdi: false,
            is_unreadable: false,
            goto_ahead: None,
            loop_blocks: 0,
            blocks_without_motion: 0,
        }
    }

    /// Creates one MDI block, which may call a subprogram in a file of its own, or a cycle. It continues from the state
    /// given to [`Setup::continuing`] and leaves the state [`Interpreter::modal_snapshot`]. As for any program, its
    /// effect is determined by executing it; nothing is in force before that snapshot is taken over.
    ///
    /// # Errors
    /// The text is not valid as an MDI block, or its pre-scan has found an error.
    pub fn mdi(text: &str, setup: Setup) -> Result<Program<R>, Vec<Diagnostic>> {
        check_mdi(text, &setup)?;
        let prescan = Prescan::scan("MDI", text.into(), &setup);
        if prescan.diagnostics().is_empty() {
            Ok(Program { is_mdi: true, ..Program::prescanned(Arc::new(prescan), setup) })
        } else {
            Err(prescan.diagnostics().to_vec())
        }
    }

    /// Creates a pre-scanned program before its first line. `setup` must be the one of the pre-scan.
    #[must_use]
    pub fn prescanned(prescan: Arc<Prescan>, setup: Setup) -> Program<R> {
        let answers = setup.answers;
        let mut program = Program::over(Lines::of_text(prescan.text()), setup);
        *program.interpreter.reader_mut() = prescan.reader.clone();
        for diagnostic in prescan.diagnostics() {
            program.interpreter.record(diagnostic.clone());
        }
        program.flow.codes.clone_from(&prescan.codes);
        program.flow.subs.clone_from(&prescan.subs);
        program.flow.is_prescanned = true;
        program.prescan = Some(prescan);
        if answers == Answers::Unknown {
            program.flow.explore();
        }
        program
    }

    /// Executes the next line and appends its canonical functions to `steps`. The first call appends those that precede
    /// any program, the last those that follow it.
    pub fn advance(&mut self, steps: &mut Vec<CanonStep>) -> Progress {
        match self.phase {
            Phase::Closed => return Progress::End,
            Phase::Opening => {
                self.interpreter.begin(steps);
                if !self.open() {
                    self.phase = Phase::Closed;
                    return Progress::End;
                }
                emit(steps, Canon::OnReset);
                self.phase = Phase::Running;
            }
            Phase::Running => {}
        }
        let outcome = if self.flow.is_open() {
            let first = steps.len();
            let outcome = self.execute_compiled_line(steps);
            if self.phase == Phase::Running && !self.flow.settle(&mut self.interpreter, steps) {
                self.flow.end_path(&mut self.interpreter, steps);
                return self.close(steps);
            }
            if self.flow.explorer.is_some() {
                self.interpreter.set_path_certain(!self.flow.is_path_uncertain());
            }
            if self.count_loop_block(steps.get(first..).unwrap_or_default()) {
                self.interpreter.report(BlockError::plain(ErrorCode::EndlessProgram, Span::default()));
                return self.close(steps);
            }
            outcome
        } else {
            self.execute_own_line(steps)
        };
        match outcome {
            Ok(progress) => progress,
            // Where the machine's answer decides, an ABORT is how the program means to end, and no error of a check.
            Err(fault) if fault.code == ErrorCode::Aborted && self.flow.is_path_uncertain() => {
                let is_alive = self.flow.abort_path(&mut self.interpreter, steps);
                if is_alive { Progress::Line } else { self.end_of_program(steps) }
            }
            Err(fault) => {
                // Nothing behind an ABORT is executed.
                let is_last = fault.code == ErrorCode::Aborted;
                self.interpreter.report(*fault);
                if is_last || self.interpreter.has_too_many_errors() { self.close(steps) } else { Progress::BlockError }
            }
        }
    }

    /// Counts a block of a loop or a call with these steps. Returns whether too many were without a motion.
    #[inline]
    fn count_loop_block(&mut self, steps: &[CanonStep]) -> bool {
        self.loop_blocks += 1;
        self.blocks_without_motion += 1;
        if steps.iter().any(|step| step.canon.takes_time()) {
            self.blocks_without_motion = 0;
        }
        self.blocks_without_motion > MAX_BLOCKS_WITHOUT_MOTION
    }

    /// Returns the number of lines of the program itself that have been read.
    #[must_use]
    pub fn lines_read(&self) -> u64 {
        u64::from(self.lines.number())
    }

    /// Returns the number of blocks executed in loops and calls.
    #[must_use]
    pub fn loop_blocks(&self) -> u64 {
        self.loop_blocks
    }

    /// Whether it is in a loop that has not moved the machine for long. Checking it ends with E1806, or it moves again.
    #[must_use]
    pub fn is_without_motion(&self) -> bool {
        self.blocks_without_motion >= LONG_WITHOUT_MOTION
    }

    /// Records that the check does not continue after the current line (W1004).
    pub fn report_check_stopped(&mut self) {
        let message = format!("checking stopped here after {} blocks in loops and calls", self.loop_blocks);
        self.interpreter.report(BlockError::new(ErrorCode::CheckStopped, Span::default(), message));
    }

    /// Executes the next compiled line.
    fn execute_compiled_line(&mut self, steps: &mut Vec<CanonStep>) -> BlockResult<Progress> {
        match self.flow.step(&mut self.interpreter, steps)? {
            LineOutcome::Block => match self.block(steps)? {
                interp::ProgramFlow::Continue => Ok(Progress::Line),
                interp::ProgramFlow::ProgramEnd => Ok(self.end_of_path(steps)),
            },
            LineOutcome::PathEnd => Ok(self.end_of_path(steps)),
            LineOutcome::Cycle(call) => {
                self.cycle(&call, steps)?;
                Ok(Progress::Line)
            }
            LineOutcome::Jumped => Ok(Progress::Line),
            LineOutcome::Faulty => Ok(Progress::BlockError),
            LineOutcome::Idle => self.execute_own_line(steps),
            LineOutcome::ProgramEnd => self.end_by_m99(steps),
            LineOutcome::Ahead(number, at) => {
                if self.arriving.has_seen(number) {
                    let message = format!("N{number} has been executed, and a streamed program cannot jump backward");
                    return fault(ErrorCode::GoToBackward, at, message);
                }
                self.goto_ahead = Some((number, self.interpreter.current_line().1, at));
                Ok(Progress::Line)
            }
        }
    }

    /// Skips a line before the target of a GOTO; false where the line is the target.
    fn skip_to_goto_target(&mut self, (number, line, at): (u64, u32, Span)) -> BlockResult<bool> {
        if is_percent(self.lines.text()) {
            self.goto_ahead = None;
            self.interpreter.set_line(0, line);
            return Err(Box::new(GotoError::Missing(number).fault(at)));
        }
        let found = parse_n_word(self.lines.text());
        self.arriving.record_line(found);
        if found == Some(number) {
            self.goto_ahead = None;
        }
        Ok(found != Some(number))
    }

    /// Executes the block that was read. For a turning cycle, the subprogram with its profile is run before.
    #[inline]
    fn block(&mut self, steps: &mut Vec<CanonStep>) -> BlockResult<interp::ProgramFlow> {
        if self.interpreter.is_turning() && self.interpreter.is_state_unknown() {
            // Its profile may depend on unknown values.
            self.interpreter.forget_series();
        } else if self.interpreter.is_turning() {
            self.draw_profile()?;
        }
        let is_call = self.calls_tool_change && !self.flow.is_in(&Label::Name(TOOL_CHANGE.into()));
        self.interpreter.set_calls_tool_change(is_call);
        let calls = is_call && self.interpreter.reader_mut().block.take_tool_change()?;
        let flow = self.interpreter.execute_block(steps)?;
        if calls {
            self.flow.call_tool_change(&mut self.interpreter)?;
        }
        Ok(flow)
    }

    #[cold]
    fn draw_profile(&mut self) -> BlockResult<()> {
        if let Some((number, mut scratch)) = self.interpreter.turning()? {
            let drawn = contour::profile_steps(&self.flow, number, &mut scratch)?;
            self.interpreter.set_profile(&drawn);
        }
        Ok(())
    }

    /// Runs a cycle; one of the third kind reads its contour from the program.
    fn cycle(&mut self, call: &CycleCall, steps: &mut Vec<CanonStep>) -> BlockResult<()> {
        let reader = &self.interpreter.reader_mut();
        let cycle = reader.cycles.as_deref().and_then(|cycles| cycles.get(call.id));
        if !cycle.is_some_and(|cycle| matches!(cycle.kind(), Kind::Contour(_))) {
            return self.interpreter.call_cycle(call, &interp::NoContours, steps);
        }
        let reader = (*reader).clone();
        if self.interpreter.is_state_unknown() {
            self.interpreter.move_unknown(steps);
            return Ok(());
        }
        let contours = ContourReader { flow: &self.flow, prescan: self.prescan.as_deref(), reader };
        self.interpreter.call_cycle(call, &contours, steps)
    }

    /// Executes the next line outside of all regions.
    fn execute_own_line(&mut self, steps: &mut Vec<CanonStep>) -> BlockResult<Progress> {
        if !std::mem::take(&mut self.is_read_ahead) && !self.read_line() {
            if let Some((number, line, at)) = self.goto_ahead.take() {
                self.interpreter.set_line(0, line);
                self.interpreter.report(GotoError::Missing(number).fault(at));
            }
            if self.is_mdi {
                self.interpreter.release(steps);
                return Ok(self.close(steps));
            }
            self.report_no_end(if self.percent { ErrorCode::NoClosingPercent } else { ErrorCode::NoProgramEnd });
            return Ok(self.close(steps));
        }
        if self.enter_region() {
            return Ok(Progress::Line);
        }
        if let Some(ahead) = self.goto_ahead
            && self.skip_to_goto_target(ahead)?
        {
            return Ok(Progress::Line);
        }
        if self.percent && is_percent(self.lines.text()) {
            self.interpreter.release(steps);
            emit(steps, Canon::Finish);
            return Ok(self.close(steps));
        }
        let read = self.interpreter.read(self.lines.number(), self.lines.text())?;
        if self.prescan.is_none() {
            self.arriving.record_line(self.interpreter.block_number());
        }
        match read {
            LineRead::Deleted => Ok(Progress::Line),
            LineRead::Block => match self.block(steps)? {
                interp::ProgramFlow::Continue => Ok(Progress::Line),
                interp::ProgramFlow::ProgramEnd => Ok(self.end_of_path(steps)),
            },
            LineRead::Control(control) => self.control(control, steps),
        }
    }

    /// Enters the region that the pre-scan has compiled from this line, if one exists.
    #[inline]
    fn enter_region(&mut self) -> bool {
        let Some(prescan) = &self.prescan else { return false };
        let line = self.lines.number();
        while let Some(region) = prescan.regions.get(self.region) {
            if region.line > line {
                return false;
            }
            self.region += 1;
            if region.line == line {
                let (region, code) = (*region, prescan.codes.first().map(Arc::clone));
                if let Err(error) = self.lines.skip_to(region.end_line) {
                    self.report_unreadable(&error);
                }
                if let Some(code) = code {
                    self.flow.begin(code, region.start, region.end);
                }
                return true;
            }
        }
        false
    }

    /// Executes a line with an O word that the pre-scan has not compiled, or that has just arrived.
    fn control(&mut self, control: Control, steps: &mut Vec<CanonStep>) -> BlockResult<Progress> {
        match control.keyword {
            Keyword::Start => return Ok(Progress::Line),
            Keyword::M99 => return self.end_by_m99(steps),
            // The pre-scan has found no end, or no subprogram, and reported it.
            _ if self.prescan.is_some() && (control.keyword.opens() || control.keyword == Keyword::Call) => {
                return Ok(Progress::BlockError);
            }
            _ => {}
        }
        let (start, end) = self.arriving.compile(control, &mut self.lines, &mut self.interpreter, &mut self.flow)?;
        if let Some(code) = self.arriving.code() {
            self.flow.begin(code, start, end);
        }
        Ok(Progress::Line)
    }

    /// Ends the program, or only the path of a check that is followed.
    fn end_of_path(&mut self, steps: &mut Vec<CanonStep>) -> Progress {
        if self.flow.end_path(&mut self.interpreter, steps) { Progress::Line } else { self.end_of_program(steps) }
    }

    fn end_of_program(&mut self, steps: &mut Vec<CanonStep>) -> Progress {
        if self.percent && !self.find_closing_percent() {
            emit(steps, Canon::Note("interpreter: percent sign missing from end of file"));
        }
        self.close(steps)
    }

    /// Ends the program at an M99 in the program itself, as M2 does.
    fn end_by_m99(&mut self, steps: &mut Vec<CanonStep>) -> BlockResult<Progress> {
        self.interpreter.end_program(steps)?;
        Ok(self.end_of_path(steps))
    }

    /// Ends the program here and appends the canonical functions that follow any program.
    pub fn close(&mut self, steps: &mut Vec<CanonStep>) -> Progress {
        if self.phase == Phase::Running {
            emit(steps, Canon::OnReset);
            emit(steps, Canon::OnReset);
        }
        self.phase = Phase::Closed;
        Progress::End
    }

    /// Reports, after the end, lines behind it that are neither a subprogram nor another target of a jump.
    pub fn check_after_end(&mut self) {
        // An endless loop has prevented it from reaching its end.
        if self.blocks_without_motion > MAX_BLOCKS_WITHOUT_MOTION {
            return;
        }
        if self.interpreter.has_too_many_errors() {
            return;
        }
        while self.read_line() {
            let is_contour = |prescan: &Arc<Prescan>| prescan.is_contour(self.lines.number());
            if self.prescan.as_ref().is_some_and(is_contour) || self.enter_region() {
                continue;
            }
            let text = self.lines.text();
            if !text.trim_ascii().is_empty() && !is_percent(text) {
                let at = Span::new(0, text.len());
                return self.report(BlockError::plain(ErrorCode::TextAfterEnd, at));
            }
        }
    }

    /// Returns the current line.
    #[must_use]
    pub fn line_text(&self) -> Cow<'_, str> {
        shown(match self.flow.current_line() {
            Some((code, line)) => code.text(line),
            None => self.lines.text(),
        })
    }

    /// Returns the text of a diagnostic's line, if it is still available.
    #[must_use]
    pub fn text_of(&self, diagnostic: &Diagnostic) -> Cow<'_, str> {
        match &self.prescan {
            Some(prescan) => {
                let line = prescan.line_text(diagnostic.file, diagnostic.line);
                Cow::Owned(shown(&line).into_owned())
            }
            None => self.line_text(),
        }
    }

    /// Returns a diagnostic with the line that it is about, if that is still available. `name` is that of the program.
    #[must_use]
    pub fn render(&self, diagnostic: &Diagnostic, name: &str) -> String {
        let file = self.prescan.as_ref().filter(|_| diagnostic.file > 0);
        diagnostic.render(file.map_or(name, |prescan| prescan.file_name(diagnostic.file)), &self.text_of(diagnostic))
    }

    /// Returns the modal codes in force; valid between two lines.
    #[must_use]
    pub fn active(&self) -> ActiveCodes {
        self.interpreter.state().into()
    }

    /// Returns the location of the program: the current line, and the calls and loops around it. It allocates, so it
    /// should not be called for every line.
    #[must_use]
    pub fn location(&self) -> ProgramLocation {
        let name = |file| self.prescan.as_ref().map_or(String::new(), |prescan| prescan.file_name(file).to_owned());
        let (file, line) = self.interpreter.current_line();
        let cycle = self.flow.cycle((file, line)).or_else(|| self.interpreter.cycle());
        let cycle = cycle.map(str::to_owned);
        ProgramLocation { file: name(file), line, frames: self.flow.frames(name), cycle }
    }

    /// Returns the interpreter, to read its state and its diagnostics.
    #[must_use]
    pub fn interpreter(&self) -> &Interpreter {
        &self.interpreter
    }

    /// Returns the interpreter, to change its state between two lines.
    pub fn interpreter_mut(&mut self) -> &mut Interpreter {
        &mut self.interpreter
    }

    /// Finds the first line that is not blank; false when there is none.
    fn open(&mut self) -> bool {
        loop {
            if !self.read_line() {
                self.report_no_end(ErrorCode::EmptyProgram);
                return false;
            }
            if is_percent(self.lines.text()) {
                self.percent = true;
                return true;
            }
            if self.lines.text().iter().any(|byte| !byte.is_ascii_whitespace()) {
                self.is_read_ahead = true;
                return true;
            }
        }
    }

    fn find_closing_percent(&mut self) -> bool {
        while self.read_line() {
            if is_percent(self.lines.text()) {
                return true;
            }
        }
        false
    }

    /// Reads the next line; false at the end of the program.
    fn read_line(&mut self) -> bool {
        match self.lines.advance() {
            Ok(found) => found,
            Err(error) => {
                self.report_unreadable(&error);
                false
            }
        }
    }

    /// Reports that the program ends too early: inside a line, or otherwise with `code`.
    #[cold]
    fn report_no_end(&mut self, code: ErrorCode) {
        match self.lines.cut_off_fault() {
            // The reason why no more lines follow has been reported.
            _ if self.is_unreadable => {}
            Some(cut_off) => self.report_next(*cut_off),
            None => self.report(BlockError::plain(code, Span::default())),
        }
    }

    #[cold]
    fn report_unreadable(&mut self, error: &std::io::Error) {
        self.is_unreadable = true;
        self.report_next(unreadable(error));
    }

    /// Records an error for the line after the current one.
    fn report_next(&mut self, fault: BlockError) {
        self.interpreter.set_line(0, self.lines.number().saturating_add(1));
        self.interpreter.report(fault);
    }

    /// Records an error for the current line.
    fn report(&mut self, fault: BlockError) {
        self.interpreter.set_line(0, self.lines.number());
        self.interpreter.report(fault);
    }
}

fn emit(steps: &mut Vec<CanonStep>, canon: Canon) {
    steps.push(CanonStep { line: 0, number: None, canon });
}

/// Checks a whole program and returns everything that is wrong with it; nothing moves.
#[must_use]
pub fn check(text: impl Into<Text>, setup: Setup) -> Vec<Diagnostic> {
    let prescan = Arc::new(Prescan::scan("program", text.into(), &setup));
    let mut program = Program::<&[u8]>::prescanned(prescan, setup);
    let mut steps = Vec::new();
    while program.advance(&mut steps) != Progress::End {
        steps.clear();
        if program.loop_blocks() >= MAX_CHECKED_LOOP_BLOCKS && !program.is_without_motion() {
            program.report_check_stopped();
            return program.interpreter.take_diagnostics();
        }
    }
    program.check_after_end();
    program.interpreter.take_diagnostics()
}
