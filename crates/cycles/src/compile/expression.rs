//! Expressions: values, operators with the control's precedence, functions, system variables.
//!
//! Invariant: the code of an expression leaves exactly one value on the stack, of the type that is returned.

use super::Compiler;
use super::lex::{CompileResult, Kind, Sign, Span, fault};
use super::names::{R_PARAMETERS, Shape, Variable};
use crate::code::{Function, Op, Operator};
use crate::error_codes::ErrorCode;
use crate::parameter::Type;

/// Maximum nesting of parentheses and structures.
pub(super) const MAX_NESTING: usize = 40;

/// Type of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ty {
    Real,
    Int,
    Bool,
    Text,
}

impl From<Type> for Ty {
    fn from(of: Type) -> Self {
        match of {
            Type::Real => Self::Real,
            Type::Int => Self::Int,
            Type::Bool => Self::Bool,
            Type::Text(_) => Self::Text,
        }
    }
}

/// Precedence of operators; comparisons bind least of all, as on the control.
const COMPARISON: u8 = 1;
const OR: u8 = 3;
const XOR: u8 = 4;
const AND: u8 = 5;
const SUM: u8 = 6;
const PRODUCT: u8 = 7;
const NOT: u8 = 8;

/// Precedence of the parts of a message: everything that binds closer than `<<`.
const JOINED: u8 = OR;

impl Compiler<'_> {
    /// Compiles an expression of any type.
    pub(super) fn value(&mut self) -> CompileResult<Ty> {
        self.operators(0)
    }

    /// Compiles a part of a message.
    pub(super) fn message_part(&mut self) -> CompileResult<Ty> {
        self.operators(JOINED)
    }

    /// Compiles an expression that is a number.
    pub(super) fn number(&mut self) -> CompileResult {
        let start = self.here();
        match self.value()? {
            Ty::Text => fault(ErrorCode::TypeMismatch, self.since(start), "a number is needed, and this is a text"),
            _ => Ok(()),
        }
    }

    /// Compiles an expression for a destination of this type.
    pub(super) fn value_for(&mut self, of: Type) -> CompileResult {
        let start = self.here();
        let is_text = self.value()? == Ty::Text;
        match (is_text, of.is_text()) {
            (true, false) => {
                fault(ErrorCode::TypeMismatch, self.since(start), format!("{of} is needed, and this is a text"))
            }
            (false, true) => {
                fault(ErrorCode::TypeMismatch, self.since(start), format!("{of} is needed, and this is a number"))
            }
            _ => Ok(()),
        }
    }

    /// Returns the operator here, and its precedence.
    fn operator(&self) -> Option<(Operator, u8)> {
        let found = match self.peek()? {
            Kind::Sign(sign) => match sign {
                Sign::Plus => (Operator::Add, SUM),
                Sign::Minus => (Operator::Subtract, SUM),
                Sign::Star => (Operator::Multiply, PRODUCT),
                Sign::Slash => (Operator::Divide, PRODUCT),
                Sign::Equal => (Operator::Equal, COMPARISON),
                Sign::Unequal => (Operator::Unequal, COMPARISON),
                Sign::Less => (Operator::Less, COMPARISON),
                Sign::LessEqual => (Operator::LessEqual, COMPARISON),
                Sign::Greater => (Operator::Greater, COMPARISON),
                Sign::GreaterEqual => (Operator::GreaterEqual, COMPARISON),
                _ => return None,
            },
            Kind::Name => match Operator::named(&self.word_here().to_ascii_uppercase())? {
                Operator::Or => (Operator::Or, OR),
                Operator::Xor => (Operator::Xor, XOR),
                Operator::And => (Operator::And, AND),
                found @ (Operator::WholeDivide | Operator::Modulo) => (found, PRODUCT),
                _ => return None,
            },
            _ => return None,
        };
        Some(found)
    }

    /// Compiles operators with at least this precedence, and their operands.
    fn operators(&mut self, least: u8) -> CompileResult<Ty> {
        let start = self.here();
        let mut left = self.operand()?;
        let mut compared = false;
        while let Some((operator, closeness)) = self.operator() {
            if closeness < least {
                break;
            }
            let sign = self.here_span();
            self.skip();
            let right_start = self.here();
            let right = self.operators(closeness + 1)?;
            let left_span = Span { start, end: sign.start };
            let right_span = self.since(right_start);
            left = match closeness {
                COMPARISON if compared => {
                    return fault(
                        ErrorCode::ComparisonChained,
                        sign,
                        "one side of this comparison is itself a comparison",
                    );
                }
                COMPARISON => {
                    compared = true;
                    self.comparison(operator, left, right, sign)?
                }
                OR | XOR | AND => {
                    Self::truth(left, left_span)?;
                    Self::truth(right, right_span)?;
                    self.emit(Op::Operate(operator));
                    Ty::Bool
                }
                _ => self.arithmetic(operator, (left, left_span), (right, right_span))?,
            };
        }
        if least <= COMPARISON && self.peek() == Some(Kind::Sign(Sign::Join)) {
            return fault(ErrorCode::TextJoin, self.here_span(), "<< joins texts in MSG and SETAL only");
        }
        Ok(left)
    }

    fn comparison(&mut self, operator: Operator, left: Ty, right: Ty, sign: Span) -> CompileResult<Ty> {
        match (left == Ty::Text, right == Ty::Text) {
            (false, false) => self.emit(Op::Operate(operator)),
            (true, true) if matches!(operator, Operator::Equal | Operator::Unequal) => {
                self.emit(Op::CompareTexts(operator == Operator::Unequal));
            }
            (true, true) => {
                return fault(ErrorCode::TypeMismatch, sign, "texts can be compared with == and <> only");
            }
            _ => return fault(ErrorCode::TypeMismatch, sign, "a text cannot be compared with a number"),
        }
        Ok(Ty::Bool)
    }

    fn arithmetic(&mut self, operator: Operator, left: (Ty, Span), right: (Ty, Span)) -> CompileResult<Ty> {
        for (ty, span) in [left, right] {
            if ty == Ty::Text {
                return fault(ErrorCode::TypeMismatch, span, "a text cannot be used in a calculation");
            }
        }
        self.emit(Op::Operate(operator));
        Ok(match operator {
            Operator::WholeDivide => Ty::Int,
            Operator::Divide => Ty::Real,
            _ if left.0 == Ty::Real || right.0 == Ty::Real => Ty::Real,
            _ => Ty::Int,
        })
    }

    /// Checks a logical operand: BOOL or INT.
    fn truth(ty: Ty, span: Span) -> CompileResult {
        match ty {
            Ty::Bool | Ty::Int => Ok(()),
            Ty::Real => {
                fault(ErrorCode::ComparisonChained, span, "AND, OR, XOR and NOT need truth values, and this is a REAL")
            }
            Ty::Text => fault(ErrorCode::TypeMismatch, span, "a truth value is needed, and this is a text"),
        }
    }

    /// Compiles a value with the operators before it.
    fn operand(&mut self) -> CompileResult<Ty> {
        self.depth += 1;
        if self.depth > MAX_NESTING {
            return fault(ErrorCode::TooDeep, self.here_span(), "this expression is nested too deep");
        }
        let span = self.here_span();
        let ty = match self.peek() {
            Some(Kind::Sign(Sign::Minus)) => {
                self.skip();
                self.negated(span)?
            }
            Some(Kind::Sign(Sign::Plus)) => {
                self.skip();
                self.operators(NOT)?
            }
            Some(Kind::Name) if self.word_here().eq_ignore_ascii_case("NOT") => {
                self.skip();
                let start = self.here();
                let ty = self.operators(NOT)?;
                Self::truth(ty, self.since(start))?;
                self.emit(Op::Operate(Operator::Not));
                Ty::Bool
            }
            _ => self.primary()?,
        };
        self.depth -= 1;
        Ok(ty)
    }

    fn negated(&mut self, span: Span) -> CompileResult<Ty> {
        let before = self.unit.ops.len();
        let ty = self.operators(NOT)?;
        if ty == Ty::Text {
            return fault(ErrorCode::TypeMismatch, span, "a text cannot have a sign");
        }
        // A constant is negated at compile time.
        if let ([Op::Number(value)], true) = (&mut self.unit.ops[before..], self.folds) {
            *value = -*value;
        } else {
            self.emit(Op::Operate(Operator::Negate));
        }
        Ok(ty)
    }

    fn primary(&mut self) -> CompileResult<Ty> {
        let span = self.here_span();
        match self.peek() {
            Some(Kind::Number(value)) => {
                self.skip();
                self.emit(Op::Number(value));
                Ok(if value.fract() == 0.0 { Ty::Int } else { Ty::Real })
            }
            Some(Kind::Text) => {
                let text = self.text_here();
                self.skip();
                let index = self.constant_text(text, span)?;
                self.emit(Op::Text(index));
                Ok(Ty::Text)
            }
            Some(Kind::Sign(Sign::Open)) => {
                self.skip();
                let ty = self.value()?;
                self.close(Sign::Close, span)?;
                Ok(ty)
            }
            Some(Kind::Word { letter: b'R', value }) => {
                self.skip();
                let slot = self.r_parameter(value, span)?;
                self.emit(Op::Load(slot));
                Ok(Ty::Real)
            }
            Some(Kind::Name) => {
                let name = self.word_here().to_ascii_uppercase();
                self.skip();
                self.named_value(&name, span)
            }
            Some(Kind::Word { .. }) => {
                fault(ErrorCode::ValueMissing, span, "a word of a block is used where a value is needed")
            }
            _ => fault(ErrorCode::ValueMissing, span, "a value is missing here"),
        }
    }

    /// Returns the slot of `R5`.
    pub(super) fn r_parameter(&mut self, number: f64, span: Span) -> CompileResult<u16> {
        if number.fract() != 0.0 || number >= f64::from(R_PARAMETERS) {
            return fault(ErrorCode::NameUnknown, span, format!("R parameters go from R0 to R{}", R_PARAMETERS - 1));
        }
        match self.names.r_parameters() {
            Some(first) => Ok(first + number as u16),
            None => self.too_large(span, "variables"),
        }
    }

    fn named_value(&mut self, name: &str, span: Span) -> CompileResult<Ty> {
        if let Some(variable) = self.names.get(name) {
            return self.variable(variable, name, span);
        }
        match name {
            "TRUE" | "FALSE" => {
                self.emit(Op::Number(f64::from(name == "TRUE")));
                return Ok(Ty::Bool);
            }
            "$PI" => {
                self.emit(Op::Number(std::f64::consts::PI));
                return Ok(Ty::Real);
            }
            "R" if self.peek() == Some(Kind::Sign(Sign::OpenIndex)) => {
                let Some(first) = self.names.r_parameters() else { return self.too_large(span, "variables") };
                let shape = Shape::Row(R_PARAMETERS);
                return self.variable(Variable { slot: first, value_type: Type::Real, shape }, name, span);
            }
            "STOCKPATH" => return self.stock_path(span),
            _ => {}
        }
        if name.starts_with('$') {
            return self.system_value(name, span);
        }
        match Function::named(name) {
            Some(function) => self.function(function, span),
            None => fault(ErrorCode::NameUnknown, span, format!("{name} is neither a variable nor a function")),
        }
    }

    /// Compiles reading of a variable, with its indices.
    fn variable(&mut self, variable: Variable, name: &str, span: Span) -> CompileResult<Ty> {
        self.indices(variable, name, span)?;
        self.emit(match variable.shape {
            Shape::Simple => Op::Load(variable.slot),
            shape => Op::LoadAt(variable.slot, shape.slots() as u16),
        });
        Ok(variable.value_type.into())
    }

    /// Compiles the indices after a variable's name. They leave one number on the stack, or none for a simple variable.
    pub(super) fn indices(&mut self, variable: Variable, name: &str, span: Span) -> CompileResult {
        let wanted = variable.shape.indices();
        let mut found = 0;
        if self.peek() == Some(Kind::Sign(Sign::OpenIndex)) {
            let open = self.here_span();
            self.skip();
            loop {
                self.number()?;
                found += 1;
                if !self.eat(Sign::Comma) {
                    break;
                }
            }
            self.close(Sign::CloseIndex, open)?;
        }
        if found != wanted {
            let span = self.since(span.start);
            return fault(ErrorCode::ArrayIndex, span, format!("{name} has {wanted} indices, and {found} are given"));
        }
        if let Shape::Table(rows, columns) = variable.shape {
            self.emit(Op::Element(rows, columns));
        }
        Ok(())
    }
}
