//! Conversion of lines with O words to jumps: matches every end with its beginning.
//!
//! Invariant: every jump of a closed region has its target. Lines that do not nest are reported, and refused when the
//! program reaches them.

use crate::block::NcBlock;
use crate::compiled_code::{BY_NUMBER, CallSite, CompiledCode, Jump};
use crate::control::{Control, Keyword, Label};
use crate::diag::{BlockError, BlockResult, Span, fault};
use crate::error_codes::ErrorCode as Number;
use crate::line_numbers::{GotoError, LineNumbers};
use std::collections::HashSet;

/// A subprogram that has been found.
#[derive(Clone, Debug)]
pub(crate) struct FlowTarget {
    pub(crate) label: Label,
    /// First line after the one with the label.
    pub(crate) entry: u32,
    pub(crate) for_m98: bool,
    pub(crate) line: u32,
}

/// A block of O words whose end has not been read.
#[derive(Debug)]
pub(crate) struct OpenBlock {
    pub(crate) control: Control,
    /// Beginning, counted in compiled lines, and in lines of the file.
    begin: u32,
    pub(crate) line: u32,
    /// Last if or elseif: a false condition jumps to the next line that decides.
    decider: Option<u32>,
    /// Lines that jump to the end, and to the line that ends the iteration.
    to_end: Vec<u32>,
    to_round: Vec<u32>,
    /// Index of the enclosing sub among the open blocks, or of this one if it is a sub.
    sub: Option<usize>,
}

/// Blocks that are open while lines are compiled.
#[derive(Debug, Default)]
pub(crate) struct ControlFlowBuilder {
    open: Vec<OpenBlock>,
    /// Labels by their subprogram: one label has one block.
    labels: HashSet<(Option<Label>, Label)>,
    /// Subprograms found since the list was last drained.
    pub(crate) found: Vec<FlowTarget>,
    /// Errors, with their line in the file.
    pub(crate) faults: Vec<(u32, Box<BlockError>)>,
    /// Lines with a GOTO: compiled line, line in the file, number, span.
    gotos: Vec<(u32, u32, u64, Span)>,
    /// Whether the file has a GOTO, including one whose number is calculated.
    pub(crate) has_goto: bool,
    style: ControlStyle,
}

/// Which of the two control languages the file uses.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ControlStyle {
    /// Whether it is that of Fanuc macros, and the first line that shows it.
    first: Option<(bool, u32)>,
    is_reported: bool,
}

impl ControlFlowBuilder {
    /// Whether every opened block has its end.
    pub(crate) fn is_closed(&self) -> bool {
        self.open.is_empty()
    }

    /// Discards the open blocks, and returns the first of them.
    pub(crate) fn abandon(&mut self) -> Option<OpenBlock> {
        self.open.drain(..).next()
    }

    /// Appends line `line` of the file, which has been compiled to `block`.
    pub(crate) fn push(&mut self, code: &mut CompiledCode, line: u32, text: &[u8], block: &NcBlock) {
        let Some(control) = &block.control else {
            code.push(line, text, block, Jump::None);
            return;
        };
        let at = code.len();
        code.push(line, text, block, Jump::Faulty);
        if let Err(fault) = self.check_style(line, control) {
            self.faults.push((line, fault));
        }
        if let Some(cycle) = &block.cycle {
            let call = code.cycles.len() as u32;
            code.cycles.push((line, cycle.clone()));
            let is_modal = control.keyword == Keyword::ModalCall;
            code.set_jump(at, if is_modal { Jump::ModalCall { call } } else { Jump::Cycle { call } });
            return;
        }
        match self.jump(code, at, line, control) {
            Ok(jump) => code.set_jump(at, jump),
            Err(fault) => self.faults.push((line, fault)),
        }
    }

    /// Refuses the first line that mixes O words and macro words.
    fn check_style(&mut self, line: u32, control: &Control) -> BlockResult<()> {
        let Some(is_of_macros) = control.keyword.is_of_macros(&control.label) else { return Ok(()) };
        let (first, first_line) = *self.style.first.get_or_insert((is_of_macros, line));
        if first == is_of_macros || std::mem::replace(&mut self.style.is_reported, true) {
            return Ok(());
        }
        let (here, there) = if is_of_macros { ("a macro word", "O words") } else { ("an O word", "macro words") };
        let message = format!("{here} is in a file with {there}, as in line {first_line}");
        fault(Number::MixedMacros, control.at, message)
    }

    /// Creates a builder with no open blocks, for a file whose lines so far were in this style.
    pub(crate) fn in_style(style: ControlStyle) -> ControlFlowBuilder {
        ControlFlowBuilder { style, ..ControlFlowBuilder::default() }
    }

    pub(crate) fn style(&self) -> ControlStyle {
        self.style
    }

    /// Resolves each GOTO to its line, among all lines appended so far. A number that is calculated, or one that `code`
    /// lacks while `is_whole` is false, is looked up when the program reaches it.
    pub(crate) fn find_lines(&mut self, code: &mut CompiledCode, is_whole: bool) {
        let mut starts: Vec<u32> = self.found.iter().filter(|sub| sub.for_m98).map(|sub| sub.entry - 1).collect();
        starts.sort_unstable();
        code.line_numbers = LineNumbers::collect(code, starts);
        for (at, line, number, place) in self.gotos.drain(..) {
            match (code.line_numbers.find(at, number), code.jump(at)) {
                (Ok(to), Some(Jump::GoTo { is_conditional, .. })) => {
                    code.set_jump(at, Jump::GoTo { to, is_conditional })
                }
                (Err(GotoError::Missing(_)), _) if !is_whole => {}
                (Err(error), _) => {
                    code.set_jump(at, Jump::Faulty);
                    self.faults.push((line, Box::new(error.fault(place))));
                }
                _ => {}
            }
        }
    }

    fn jump(&mut self, code: &mut CompiledCode, at: u32, line: u32, control: &Control) -> BlockResult<Jump> {
        Ok(match control.keyword {
            Keyword::Sub | Keyword::If | Keyword::While | Keyword::Do | Keyword::Repeat => {
                return self.begin(code, at, line, control);
            }
            Keyword::ElseIf | Keyword::Else => {
                let open = self.innermost(control, &[Keyword::If])?;
                if let Some(decider) = open.decider.take() {
                    set_otherwise(code, decider, at);
                }
                open.to_end.push(at);
                if control.keyword == Keyword::Else {
                    Jump::Else { end: 0 }
                } else {
                    open.decider = Some(at);
                    Jump::ElseIf { otherwise: 0, end: 0 }
                }
            }
            Keyword::EndIf => {
                let open = self.close(control, &[Keyword::If])?;
                if let Some(decider) = open.decider {
                    set_otherwise(code, decider, at);
                }
                open.patch(code, at, at);
                Jump::Pass
            }
            Keyword::EndSub => {
                let open = self.close(control, &[Keyword::Sub])?;
                code.set_jump(open.begin, Jump::Over { to: at + 1 });
                let label = control.label.clone();
                self.found.push(FlowTarget { label, entry: open.begin + 1, for_m98: false, line: open.line });
                Jump::Return
            }
            Keyword::EndWhile => {
                let open = self.close(control, &[Keyword::While])?;
                code.set_jump(open.begin, Jump::While { end: at + 1 });
                open.patch(code, at + 1, open.begin);
                Jump::Leave { to: open.begin }
            }
            Keyword::EndRepeat => {
                let open = self.close(control, &[Keyword::Repeat])?;
                code.set_jump(open.begin, Jump::Repeat { end: at + 1 });
                open.patch(code, at + 1, at);
                Jump::EndRepeat { begin: open.begin + 1 }
            }
            Keyword::Break | Keyword::Continue => self.leave(at, control)?,
            Keyword::Call | Keyword::M98 => {
                let call = code.calls.len() as u32;
                let is_m98 = control.keyword == Keyword::M98;
                code.calls.push(CallSite { label: control.label.clone(), is_m98, sub: None, line, at: control.at });
                Jump::Call { call }
            }
            // A return leaves the enclosing subprogram, whatever its label.
            Keyword::Return => match self.sub() {
                Some(_) => Jump::Return,
                None => return nothing_open(control),
            },
            Keyword::M99 => Jump::Return,
            Keyword::IfThen => Jump::IfThen,
            Keyword::GoTo | Keyword::IfGoTo => {
                self.has_goto = true;
                if let Label::Number(number) = control.label {
                    self.gotos.push((at, line, number, control.at));
                }
                Jump::GoTo { to: BY_NUMBER, is_conditional: control.keyword == Keyword::IfGoTo }
            }
            Keyword::Cycle | Keyword::ModalCall | Keyword::ModalEnd => Jump::ModalEnd,
            Keyword::Start => {
                self.found.push(FlowTarget { label: control.label.clone(), entry: at + 1, for_m98: true, line });
                Jump::Pass
            }
        })
    }

    fn begin(&mut self, code: &mut CompiledCode, at: u32, line: u32, control: &Control) -> BlockResult<Jump> {
        if control.keyword == Keyword::While
            && self.open.last().is_some_and(|open| open.is(control, &[Keyword::Do]))
            && let Some(open) = self.open.pop()
        {
            open.patch(code, at + 1, at);
            return Ok(Jump::WhileOfDo { begin: open.begin + 1 });
        }
        let scope = self.sub().cloned();
        if control.keyword == Keyword::Sub && scope.is_some() {
            let message = format!("{} begins inside another subprogram", control.label);
            return fault(Number::SubInSub, control.at, message);
        }
        let is_sub = control.keyword == Keyword::Sub;
        let sub = if is_sub { Some(self.open.len()) } else { self.open.last().and_then(|open| open.sub) };
        self.open.push(OpenBlock {
            control: control.clone(),
            begin: at,
            line,
            decider: (control.keyword == Keyword::If).then_some(at),
            to_end: Vec::new(),
            to_round: Vec::new(),
            sub,
        });
        if control.keyword != Keyword::Sub
            && !control.label.is_of_macro_loop()
            && !self.labels.insert((scope, control.label.clone()))
        {
            let message = format!("{} is the label of another block already", control.label);
            self.faults.push((line, Box::new(BlockError::new(Number::LabelTwice, control.at, message))));
        }
        Ok(match control.keyword {
            Keyword::Sub => Jump::Over { to: 0 },
            Keyword::If => Jump::If { otherwise: 0 },
            Keyword::While => Jump::While { end: 0 },
            Keyword::Repeat => Jump::Repeat { end: 0 },
            _ => Jump::Pass,
        })
    }

    /// Returns the label of the enclosing subprogram.
    fn sub(&self) -> Option<&Label> {
        let sub = self.open.last()?.sub?;
        self.open.get(sub).map(|open| &open.control.label)
    }

    fn innermost(&mut self, control: &Control, kinds: &[Keyword]) -> BlockResult<&mut OpenBlock> {
        match self.open.last_mut() {
            Some(open) if open.is(control, kinds) => Ok(open),
            _ => nothing_open(control),
        }
    }

    /// Closes the block that a line ends. Blocks opened inside of it without an end are reported.
    fn close(&mut self, control: &Control, kinds: &[Keyword]) -> BlockResult<OpenBlock> {
        let Some(index) = self.open.iter().rposition(|open| open.is(control, kinds)) else {
            return nothing_open(control);
        };
        while self.open.len() > index + 1 {
            if let Some(inner) = self.open.pop() {
                self.faults.push((inner.line, inner.missing_end_error()));
            }
        }
        match self.open.pop() {
            Some(open) => Ok(open),
            None => nothing_open(control),
        }
    }

    /// Compiles break and continue, which also leave inner loops.
    fn leave(&mut self, at: u32, control: &Control) -> BlockResult<Jump> {
        let loops = [Keyword::While, Keyword::Do, Keyword::Repeat];
        let within = self.open.last().and_then(|open| open.sub).map_or(0, |sub| sub + 1);
        let Some(open) = self.open[within..].iter_mut().rev().find(|open| open.is(control, &loops)) else {
            return nothing_open(control);
        };
        let lines = if control.keyword == Keyword::Break { &mut open.to_end } else { &mut open.to_round };
        lines.push(at);
        Ok(Jump::Leave { to: 0 })
    }
}

impl OpenBlock {
    fn is(&self, control: &Control, kinds: &[Keyword]) -> bool {
        kinds.contains(&self.control.keyword) && self.control.label == control.label
    }

    /// Sets the targets of the lines that leave the block.
    fn patch(&self, code: &mut CompiledCode, end: u32, round: u32) {
        for (lines, target) in [(&self.to_end, end), (&self.to_round, round)] {
            for line in lines {
                let jump = match code.jump(*line) {
                    Some(Jump::Else { .. }) => Jump::Else { end: target },
                    Some(Jump::ElseIf { otherwise, .. }) => Jump::ElseIf { otherwise, end: target },
                    Some(Jump::Leave { .. }) => Jump::Leave { to: target },
                    Some(other) => other,
                    None => continue,
                };
                code.set_jump(*line, jump);
            }
        }
    }

    /// Returns the error for a block without an end.
    pub(crate) fn missing_end_error(&self) -> Box<BlockError> {
        let message = format!("{} has no end", self.control.label);
        Box::new(BlockError::new(Number::ControlWithoutEnd, self.control.at, message))
    }
}

fn set_otherwise(code: &mut CompiledCode, decider: u32, target: u32) {
    let jump = match code.jump(decider) {
        Some(Jump::ElseIf { end, .. }) => Jump::ElseIf { otherwise: target, end },
        _ => Jump::If { otherwise: target },
    };
    code.set_jump(decider, jump);
}

fn nothing_open<T>(control: &Control) -> BlockResult<T> {
    if control.keyword == Keyword::Return {
        return fault(Number::ControlWithoutBegin, control.at, "return is outside of every subprogram (sub … endsub)");
    }
    let what = match control.keyword {
        Keyword::EndSub => "no subprogram",
        Keyword::Else | Keyword::ElseIf | Keyword::EndIf => "no if",
        _ => "no loop",
    };
    fault(Number::ControlWithoutBegin, control.at, format!("{what} of {} is open here", control.label))
}
