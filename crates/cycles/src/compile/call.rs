//! Calls of other cycles and of STOCKPATH, and messages: MSG and SETAL.
//!
//! Invariant: a call pushes as many values onto the stack as it has arguments that are not empty.

use super::Compiler;
use super::expression::Ty;
use super::lex::{CompileResult, Kind, Sign, Span, fault};
use crate::code::{CallSite, Op, Passed};
use crate::error_codes::ErrorCode;
use crate::parameter::Type;

/// Number of arguments of STOCKPATH after the contour: MID, FALZ, FALX, FAL, VARI, DAM, _VRT.
const STOCK_NUMBERS: usize = 7;

impl Compiler<'_> {
    /// Compiles `NAME(a, , "text")`, or `NAME` alone.
    pub(super) fn call(&mut self, name: &str, span: Span) -> CompileResult {
        self.skip();
        let mut arguments = Vec::new();
        let open = self.here_span();
        if self.eat(Sign::Open) && !self.eat(Sign::Close) {
            loop {
                arguments.push(self.argument()?);
                if !self.eat(Sign::Comma) {
                    break;
                }
            }
            self.close(Sign::Close, open)?;
        }
        let Ok(site) = u16::try_from(self.unit.calls.len()) else { return self.too_large(span, "calls") };
        let (start, end) = (span.start as u32, span.end as u32);
        self.unit.calls.push(CallSite { name: name.to_owned(), line: self.line, start, end, arguments });
        self.emit(Op::CallCycle(site));
        Ok(())
    }

    fn argument(&mut self) -> CompileResult<Passed> {
        if matches!(self.peek(), Some(Kind::Sign(Sign::Comma | Sign::Close))) {
            return Ok(Passed::Nothing);
        }
        let parameter = self.handed_on();
        Ok(match self.value()? {
            Ty::Text => parameter.map_or(Passed::Text, Passed::Parameter),
            _ => Passed::Number,
        })
    }

    /// Returns the text parameter that is here alone as an argument.
    fn handed_on(&self) -> Option<u16> {
        let ends = matches!(self.kind_at(1), Some(Kind::Sign(Sign::Comma | Sign::Close)));
        let variable = if ends && self.peek() == Some(Kind::Name) { self.names.get(self.word_here()) } else { None };
        let slot = variable.filter(|variable| variable.value_type.is_text())?.slot;
        (usize::from(slot) < self.unit.parameters.len()).then_some(slot)
    }

    /// Compiles `STOCKPATH(NPP, MID, FALZ, FALX, FAL, VARI, DAM, _VRT)`, whose value is the number of moves.
    pub(super) fn stock_path(&mut self, span: Span) -> CompileResult<Ty> {
        let open = self.here_span();
        self.expect(Sign::Open, "STOCKPATH")?;
        if let Some(parameter) = self.handed_on() {
            self.unit.contour = Some(parameter);
        }
        self.value_for(Type::Text(0))?;
        let mut count = 0;
        while self.eat(Sign::Comma) {
            self.number()?;
            count += 1;
        }
        self.close(Sign::Close, open)?;
        if count != STOCK_NUMBERS {
            let message = format!("STOCKPATH needs a contour and {STOCK_NUMBERS} numbers, not {count}");
            return fault(ErrorCode::FunctionArguments, self.since(span.start), message);
        }
        self.emit(Op::StockPath);
        Ok(Ty::Int)
    }

    /// Compiles `MSG("text" << value)` and `SETAL(61101, "text" << value)`.
    pub(super) fn message_call(&mut self, word: &str) -> CompileResult {
        self.skip();
        let open = self.here_span();
        self.expect(Sign::Open, word)?;
        let raises = word == "SETAL";
        if raises {
            self.number()?;
        }
        self.emit(Op::Clear);
        let has_text = if raises { self.eat(Sign::Comma) } else { self.peek() != Some(Kind::Sign(Sign::Close)) };
        if has_text {
            loop {
                self.message_part()?;
                self.emit(Op::Join);
                if !self.eat(Sign::Join) {
                    break;
                }
            }
        }
        self.close(Sign::Close, open)?;
        self.emit(if raises { Op::Raise } else { Op::Show });
        Ok(())
    }
}
