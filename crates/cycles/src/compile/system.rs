//! Functions and system variables within expressions.
//!
//! Invariant: as in `expression`, the code leaves one value on the stack, of the type that is returned.

use super::Compiler;
use super::expression::Ty;
use super::lex::{CompileResult, Kind, Sign, Span, fault};
use crate::code::{Function, Op, System};
use crate::error_codes::ErrorCode;

impl Compiler<'_> {
    pub(super) fn function(&mut self, function: Function, span: Span) -> CompileResult<Ty> {
        let open = self.here_span();
        self.expect(Sign::Open, function.name())?;
        let mut count = 0;
        loop {
            self.number()?;
            count += 1;
            if !self.eat(Sign::Comma) {
                break;
            }
        }
        self.close(Sign::Close, open)?;
        if count != function.arguments() {
            let message = format!("{} needs {} arguments, not {count}", function.name(), function.arguments());
            return fault(ErrorCode::FunctionArguments, self.since(span.start), message);
        }
        self.emit(Op::Call1(function));
        Ok(match function {
            Function::Trunc | Function::Round => Ty::Int,
            _ => Ty::Real,
        })
    }

    /// Compiles `$P_F`, `$P_AD[24]`, `$P_EP[1]`, `$P_SUBPAR[2]`, `$PATH[i,k]`.
    pub(super) fn system_value(&mut self, name: &str, span: Span) -> CompileResult<Ty> {
        match name {
            "$P_SUBPAR" => {
                self.index_in_brackets()?;
                self.emit(Op::Programmed);
                return Ok(Ty::Bool);
            }
            "$PATH" => {
                let open = self.here_span();
                self.expect(Sign::OpenIndex, name)?;
                self.number()?;
                self.expect(Sign::Comma, name)?;
                self.number()?;
                self.close(Sign::CloseIndex, open)?;
                self.emit(Op::StockRead);
                return Ok(Ty::Real);
            }
            "$P_EP" => return self.position(),
            "$P_AD" | "$P_GG" => {
                self.expect(Sign::OpenIndex, name)?;
                let index = self.peek();
                self.skip();
                self.close(Sign::CloseIndex, span)?;
                let known = match index {
                    Some(Kind::Number(value)) => System::named(&format!("{name}[{value}]")),
                    _ => None,
                };
                return match known {
                    Some(system) => self.system(system),
                    None => fault(
                        ErrorCode::NameUnknown,
                        self.since(span.start),
                        format!("{name} is not known with this index"),
                    ),
                };
            }
            _ => {}
        }
        match System::named(name) {
            Some(system) => self.system(system),
            None => fault(ErrorCode::NameUnknown, span, format!("{name} is not a known system variable")),
        }
    }

    fn system(&mut self, system: System) -> CompileResult<Ty> {
        self.emit(Op::Ask(system));
        Ok(match system {
            System::Feed | System::Speed | System::ToolRadius | System::Radius | System::ClearanceAngle => Ty::Real,
            System::ModalCycle => Ty::Bool,
            _ => Ty::Int,
        })
    }

    /// Compiles `$P_EP[X]` by the axis' letter, `$P_EP[n]` as the n-th axis of the plane.
    fn position(&mut self) -> CompileResult<Ty> {
        let word = if self.kind_at(1) == Some(Kind::Name) { self.text_at(1) } else { "" };
        let letter = match word.as_bytes() {
            [letter] if !self.names.has(word) => letter.to_ascii_uppercase(),
            _ => 0,
        };
        if b"XYZABCUVW".contains(&letter) {
            let open = self.here_span();
            self.expect(Sign::OpenIndex, "$P_EP")?;
            self.skip();
            self.close(Sign::CloseIndex, open)?;
            self.emit(Op::PositionOf(letter));
        } else {
            self.index_in_brackets()?;
            self.emit(Op::PositionAt);
        }
        Ok(Ty::Real)
    }

    /// Compiles `[` number `]`.
    pub(super) fn index_in_brackets(&mut self) -> CompileResult {
        let open = self.here_span();
        self.expect(Sign::OpenIndex, "this")?;
        self.number()?;
        self.close(Sign::CloseIndex, open)
    }
}
