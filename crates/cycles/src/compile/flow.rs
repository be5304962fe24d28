//! Structures, labels and jumps.
//!
//! Invariant: every jump of a unit without errors leads to an instruction of that unit.

use super::Compiler;
use super::expression::MAX_NESTING;
use super::lex::{CompileResult, Kind, Sign, Span, fault};
use super::names::{Shape, Variable};
use crate::code::{Op, Operator};
use crate::error_codes::ErrorCode;
use crate::parameter::Type;

/// A structure that is not closed yet.
#[derive(Debug)]
pub(super) struct Open {
    pub(super) line: u32,
    pub(super) span: Span,
    pub(super) shape: Structure,
}

/// Instructions, by number, that are completed at the end of a structure. An exit is a jump whose target is known at
/// the end only; it is absent where the condition had an error.
#[derive(Debug)]
pub(super) enum Structure {
    If { exit: Option<usize> },
    Else { exit: usize },
    While { top: usize, exit: Option<usize> },
    For { top: usize, exit: Option<usize>, variable: Option<u16>, of: Type },
    Loop { top: usize },
    Repeat { top: usize },
}

impl Structure {
    pub(super) const fn name(&self) -> &'static str {
        match self {
            Self::If { .. } => "IF",
            Self::Else { .. } => "ELSE",
            Self::While { .. } => "WHILE",
            Self::For { .. } => "FOR",
            Self::Loop { .. } => "LOOP",
            Self::Repeat { .. } => "REPEAT",
        }
    }
}

/// A jump to a label.
#[derive(Debug)]
pub(super) struct Jump {
    label: String,
    /// Number of its instruction.
    at: usize,
    direction: Direction,
    line: u32,
    span: Span,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Direction {
    Forward,
    Backward,
    /// Forward first, then backward.
    Either,
}

impl Compiler<'_> {
    pub(super) fn structure(&mut self, word: &str, span: Span) -> CompileResult {
        self.skip();
        let top = self.unit.ops.len();
        match word {
            "IF" => self.if_block(span),
            "WHILE" => {
                self.open(Structure::While { top, exit: None }, span)?;
                let jump = self.condition()?;
                self.set_exit(jump);
                Ok(())
            }
            "FOR" => self.for_block(span),
            "LOOP" => self.open(Structure::Loop { top }, span),
            "REPEAT" => self.open(Structure::Repeat { top }, span),
            "ELSE" => {
                let Structure::If { exit } = self.closes("ELSE", &["IF"], span)? else { return Ok(()) };
                let jump = self.emit_pending_jump(Op::Jump(0));
                self.set_jump_target(exit);
                self.open(Structure::Else { exit: jump }, span)
            }
            "UNTIL" => {
                let Structure::Repeat { top } = self.closes("UNTIL", &["REPEAT"], span)? else { return Ok(()) };
                self.number()?;
                self.emit(Op::JumpIfNot(top as u32));
                Ok(())
            }
            _ => self.end_structure(word, span),
        }
    }

    fn end_structure(&mut self, word: &str, span: Span) -> CompileResult {
        let begins: &[&str] = match word {
            "ENDIF" => &["IF", "ELSE"],
            "ENDWHILE" => &["WHILE"],
            "ENDFOR" => &["FOR"],
            _ => &["LOOP"],
        };
        match self.closes(word, begins, span)? {
            Structure::If { exit } => self.set_jump_target(exit),
            Structure::Else { exit } => self.set_jump_target(Some(exit)),
            Structure::Loop { top } | Structure::Repeat { top } => self.emit(Op::Jump(top as u32)),
            Structure::While { top, exit } => {
                self.emit(Op::Jump(top as u32));
                self.set_jump_target(exit);
            }
            Structure::For { top, exit, variable, of } => {
                if let Some(slot) = variable {
                    for op in [Op::Load(slot), Op::Number(1.0), Op::Operate(Operator::Add), Op::Store(slot, of)] {
                        self.emit(op);
                    }
                }
                self.emit(Op::Jump(top as u32));
                self.set_jump_target(exit);
            }
        }
        Ok(())
    }

    /// Compiles `IF condition`, or `IF condition GOTOF label`.
    fn if_block(&mut self, span: Span) -> CompileResult {
        // A jump in the block makes it a block of its own, without ENDIF.
        let jumps = self.tokens.iter().any(|token| {
            let word = &self.text[token.span.start..token.span.end];
            token.kind == Kind::Name && ["GOTO", "GOTOF", "GOTOB"].iter().any(|jump| word.eq_ignore_ascii_case(jump))
        });
        if jumps {
            self.number()?;
            let word = self.word_here().to_ascii_uppercase();
            return self.go_to(&word, Some(Op::JumpIf(0)));
        }
        self.open(Structure::If { exit: None }, span)?;
        let jump = self.condition()?;
        self.set_exit(jump);
        Ok(())
    }

    /// Compiles `FOR variable = first TO last`: the last value is calculated once.
    fn for_block(&mut self, span: Span) -> CompileResult {
        let top = self.unit.ops.len();
        self.open(Structure::For { top, exit: None, variable: None, of: Type::Real }, span)?;
        let variable = self.counter()?;
        self.expect(Sign::Assign, "the variable of FOR")?;
        self.number()?;
        self.emit(Op::Store(variable.slot, variable.value_type));
        if !self.word_here().eq_ignore_ascii_case("TO") {
            return fault(ErrorCode::NotUnderstood, self.here_span(), "TO is missing: FOR variable = first TO last");
        }
        self.skip();
        self.number()?;
        let Some(last) = self.names.reserve(1) else { return self.too_large(span, "variables") };
        self.emit(Op::Store(last, Type::Real));
        let top = self.unit.ops.len();
        for op in [Op::Load(variable.slot), Op::Load(last), Op::Operate(Operator::Greater)] {
            self.emit(op);
        }
        let exit = Some(self.emit_pending_jump(Op::JumpIf(0)));
        if let Some(open) = self.structures.last_mut() {
            open.shape = Structure::For { top, exit, variable: Some(variable.slot), of: variable.value_type };
        }
        Ok(())
    }

    /// Parses the variable that FOR counts with.
    fn counter(&mut self) -> CompileResult<Variable> {
        let span = self.here_span();
        let variable = match self.peek() {
            Some(Kind::Word { letter: b'R', value }) => {
                let slot = self.r_parameter(value, span)?;
                Some(Variable { slot, value_type: Type::Real, shape: Shape::Simple })
            }
            Some(Kind::Name) => self.names.get(self.word_here()),
            _ => None,
        };
        match variable {
            Some(variable) if variable.shape == Shape::Simple && !variable.value_type.is_text() => {
                self.skip();
                Ok(variable)
            }
            _ => fault(ErrorCode::NameUnknown, span, "FOR needs a simple variable that is a number"),
        }
    }

    /// Compiles a condition, and the jump that is taken where it is false.
    fn condition(&mut self) -> CompileResult<usize> {
        self.number()?;
        Ok(self.emit_pending_jump(Op::JumpIfNot(0)))
    }

    fn open(&mut self, shape: Structure, span: Span) -> CompileResult {
        self.structures.push(Open { line: self.line, span, shape });
        if self.structures.len() > MAX_NESTING {
            return fault(ErrorCode::TooDeep, span, "structures are nested too deep");
        }
        Ok(())
    }

    fn set_exit(&mut self, jump: usize) {
        if let Some(Open { shape: Structure::If { exit } | Structure::While { exit, .. }, .. }) =
            self.structures.last_mut()
        {
            *exit = Some(jump);
        }
    }

    /// Closes the innermost structure, which must be one of these.
    fn closes(&mut self, word: &str, begins: &[&str], span: Span) -> CompileResult<Structure> {
        match self.structures.pop_if(|open| begins.contains(&open.shape.name())) {
            Some(open) => Ok(open.shape),
            None => {
                let message = match self.structures.last() {
                    Some(open) => format!("{word} does not end {} of line {}", open.shape.name(), open.line),
                    None => format!("{word} has no {}", begins.first().copied().unwrap_or_default()),
                };
                fault(ErrorCode::NotOpen, span, message)
            }
        }
    }

    /// Emits a jump whose target is not known yet, and returns its number.
    fn emit_pending_jump(&mut self, op: Op) -> usize {
        self.emit(op);
        self.unit.ops.len() - 1
    }

    /// Sets the target of a jump to the next instruction.
    fn set_jump_target(&mut self, jump: Option<usize>) {
        let here = self.unit.ops.len();
        if let Some(jump) = jump {
            self.aim(jump, here);
        }
    }

    fn aim(&mut self, jump: usize, target: usize) {
        if let Some(Op::Jump(to) | Op::JumpIf(to) | Op::JumpIfNot(to)) = self.unit.ops.get_mut(jump) {
            *to = target as u32;
        }
    }

    /// Compiles `GOTOF label`, as a jump of this kind.
    pub(super) fn go_to(&mut self, word: &str, jump: Option<Op>) -> CompileResult {
        let direction = match word {
            "GOTO" => Direction::Either,
            "GOTOF" => Direction::Forward,
            "GOTOB" => Direction::Backward,
            _ => return fault(ErrorCode::NotUnderstood, self.here_span(), "GOTOF, GOTOB or GOTO is needed here"),
        };
        self.skip();
        let span = self.here_span();
        let label = match self.peek() {
            Some(Kind::Word { letter: b'N', value }) => format!("N{value}"),
            Some(Kind::Name | Kind::Word { .. }) => self.word_here().to_ascii_uppercase(),
            _ => return fault(ErrorCode::NotUnderstood, span, format!("a label is needed after {word}")),
        };
        self.skip();
        let at = self.emit_pending_jump(jump.unwrap_or(Op::Jump(0)));
        self.jumps.push(Jump { label, at, direction, line: self.line, span });
        Ok(())
    }

    /// Sets the target of every jump to a label.
    pub(super) fn resolve_jumps(&mut self) {
        for jump in std::mem::take(&mut self.jumps) {
            self.line = jump.line;
            let places = self.labels.get(&jump.label).map_or(&[][..], Vec::as_slice);
            // Positions are in the order of the source, so that a binary search finds the nearest of several equal
            // block numbers.
            let split = places.partition_point(|place| place.0 <= jump.at);
            let (forward, backward) = (places.get(split), split.checked_sub(1).and_then(|last| places.get(last)));
            let found = match jump.direction {
                Direction::Forward => forward,
                Direction::Backward => backward,
                Direction::Either => forward.or(backward),
            };
            match (found, places.first()) {
                (Some(&(target, _)), _) => self.aim(jump.at, target),
                (None, Some(&(_, line))) => {
                    let message = format!("{} is in line {line}, in the other direction", jump.label);
                    self.report(ErrorCode::LabelDirection, jump.span, message);
                }
                (None, None) => {
                    self.report(ErrorCode::LabelMissing, jump.span, format!("there is no label {}", jump.label))
                }
            }
        }
    }
}
