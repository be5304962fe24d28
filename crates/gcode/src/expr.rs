//! Expressions, compiled once into postfix operations.
//!
//! Invariant: an expression that needs more than [`STACK`] values at once is refused. Operators of equal rank are
//! evaluated from left to right. A sign binds more tightly than any operator.

use crate::diag::{BlockResult, Span, fault};
use crate::error_codes::ErrorCode;
use crate::lex::Cursor;
use crate::nearest::nearest;
use crate::params::Reference;
use crate::params::{NameId, Names};
use crate::system::SystemParameter;

/// Maximum number of values on the stack.
pub(crate) const STACK: usize = 40;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Op {
    pub(crate) kind: OpKind,
    /// First byte and byte after the last; a line is shorter than 256 bytes.
    at: (u8, u8),
}

impl Op {
    pub(crate) fn span(self) -> Span {
        Span::new(self.at.0.into(), self.at.1.into())
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum OpKind {
    Constant(f64),
    /// The numbered parameter whose number is on the stack.
    Numbered,
    Named(NameId),
    System(SystemParameter),
    Exists(NameId),
    /// Whether a numbered parameter of this number exists.
    ExistsNumbered,
    Negate,
    Function(Function),
    /// ATAN\[y\]/\[x\].
    Atan,
    Binary(Operator),
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum Function {
    Abs,
    Acos,
    Asin,
    Cos,
    Exp,
    Fix,
    Fup,
    Ln,
    Round,
    Sin,
    Sqrt,
    Tan,
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum Operator {
    And,
    Or,
    Xor,
    Equal,
    NotEqual,
    Greater,
    GreaterOrEqual,
    Less,
    LessOrEqual,
    Add,
    Subtract,
    Multiply,
    Divide,
    Modulo,
    Power,
}

/// Operators as written. A longer one comes before one that is its prefix.
const OPERATORS: [(&[u8], Operator, u8); 15] = [
    (b"**", Operator::Power, 6),
    (b"*", Operator::Multiply, 5),
    (b"/", Operator::Divide, 5),
    (b"mod", Operator::Modulo, 5),
    (b"+", Operator::Add, 4),
    (b"-", Operator::Subtract, 4),
    (b"eq", Operator::Equal, 3),
    (b"ne", Operator::NotEqual, 3),
    (b"gt", Operator::Greater, 3),
    (b"ge", Operator::GreaterOrEqual, 3),
    (b"lt", Operator::Less, 3),
    (b"le", Operator::LessOrEqual, 3),
    (b"and", Operator::And, 2),
    (b"or", Operator::Or, 2),
    (b"xor", Operator::Xor, 2),
];

const FUNCTIONS: [(&[u8], Function); 12] = [
    (b"abs", Function::Abs),
    (b"acos", Function::Acos),
    (b"asin", Function::Asin),
    (b"cos", Function::Cos),
    (b"exp", Function::Exp),
    (b"fix", Function::Fix),
    (b"fup", Function::Fup),
    (b"ln", Function::Ln),
    (b"round", Function::Round),
    (b"sin", Function::Sin),
    (b"sqrt", Function::Sqrt),
    (b"tan", Function::Tan),
];

/// A value as the program gives it.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Operand {
    Constant(f64),
    /// Calculated by the operations that have been added.
    Calculated,
}

/// Compiler for the values of one line, which appends operations to a pool.
pub(crate) struct Compiler<'a, 'b> {
    pub(crate) cursor: &'b mut Cursor<'a>,
    pub(crate) ops: &'b mut Vec<Op>,
    pub(crate) names: &'b mut Names,
    held: usize,
}

impl<'a, 'b> Compiler<'a, 'b> {
    pub(crate) fn new(cursor: &'b mut Cursor<'a>, ops: &'b mut Vec<Op>, names: &'b mut Names) -> Compiler<'a, 'b> {
        Compiler { cursor, ops, names, held: 0 }
    }

    /// Compiles the value after a word letter. A plain number needs no operation.
    #[inline]
    pub(crate) fn operand(&mut self) -> BlockResult<Operand> {
        match self.cursor.peek() {
            b'0'..=b'9' | b'.' => Ok(Operand::Constant(self.cursor.number()?)),
            b'-' => {
                self.cursor.skip();
                match self.cursor.peek() {
                    b'0'..=b'9' | b'.' => Ok(Operand::Constant(-self.cursor.number()?)),
                    _ => {
                        let start = self.cursor.position().saturating_sub(1);
                        self.value()?;
                        self.push(OpKind::Negate, start)?;
                        Ok(Operand::Calculated)
                    }
                }
            }
            _ => {
                self.value()?;
                Ok(Operand::Calculated)
            }
        }
    }

    /// Compiles one value: number, parameter, function or bracket, with or without signs.
    pub(crate) fn value(&mut self) -> BlockResult<()> {
        let next = self.cursor.peek();
        let start = self.cursor.position();
        match next {
            b'[' => self.bracket(),
            b'#' => self.parameter_value(),
            b'+' => {
                self.cursor.skip();
                self.value()
            }
            b'-' => {
                self.cursor.skip();
                self.value()?;
                self.push(OpKind::Negate, start)
            }
            b'a'..=b'z' => self.function(),
            b'0'..=b'9' | b'.' => {
                let number = self.cursor.number()?;
                self.push(OpKind::Constant(number), start)
            }
            _ => fault(ErrorCode::NumberMissing, self.cursor.next_span(), "a value is missing here"),
        }
    }

    /// Compiles `[expression]`.
    pub(crate) fn bracket(&mut self) -> BlockResult<()> {
        let open = self.cursor.next_span();
        if !self.cursor.eat(b'[') {
            return fault(ErrorCode::BracketMissing, open, "an opening bracket is missing here");
        }
        self.binary(0)?;
        if self.cursor.eat(b']') { Ok(()) } else { self.bad_operator(open) }
    }

    /// Compiles a value, or several with operators between them, without enclosing brackets.
    pub(crate) fn expression(&mut self) -> BlockResult<()> {
        self.binary(0)
    }

    /// Compiles a chain of operators of at least this rank.
    fn binary(&mut self, rank: u8) -> BlockResult<()> {
        let start = self.cursor.position();
        self.value()?;
        loop {
            let before = self.cursor.clone();
            let Some((operator, its_rank)) = self.operator() else { return Ok(()) };
            if its_rank < rank {
                *self.cursor = before;
                return Ok(());
            }
            self.binary(its_rank + 1)?;
            self.push(OpKind::Binary(operator), start)?;
        }
    }

    fn operator(&mut self) -> Option<(Operator, u8)> {
        let first = self.cursor.peek();
        if first == b']' {
            return None;
        }
        let begins = |text: &[u8]| text.first() == Some(&first);
        let (_, operator, rank) = OPERATORS.iter().find(|(text, ..)| begins(text) && self.cursor.eat_word(text))?;
        Some((*operator, *rank))
    }

    #[cold]
    fn bad_operator(&mut self, open: Span) -> BlockResult<()> {
        if self.cursor.peek() == 0 {
            return fault(ErrorCode::UnclosedBracket, open, "this bracket is not closed");
        }
        if self.cursor.peek() == b'=' {
            return fault(ErrorCode::EqualsCompares, self.cursor.next_span(), "= does not compare; use EQ");
        }
        if self.cursor.peek() == b',' {
            return fault(ErrorCode::DecimalComma, self.cursor.next_span(), "a comma is not a decimal point");
        }
        fault(ErrorCode::UnknownFunction, self.cursor.next_span(), "no operator begins here")
    }

    fn function(&mut self) -> BlockResult<()> {
        let (first, start) = (self.cursor.peek(), self.cursor.position());
        let begins = |text: &[u8]| text.first() == Some(&first);
        if first == b'a' && self.cursor.eat_word(b"atan") {
            self.bracket()?;
            if !self.cursor.eat(b'/') {
                return fault(
                    ErrorCode::BracketMissing,
                    self.cursor.next_span(),
                    "ATAN needs a slash and a second argument",
                );
            }
            self.bracket()?;
            return self.push(OpKind::Atan, start);
        }
        if first == b'e' && self.cursor.eat_word(b"exists") {
            return self.exists(start);
        }
        let before = self.cursor.clone();
        let Some((_, function)) = FUNCTIONS.iter().find(|(text, _)| begins(text) && self.cursor.eat_word(text)) else {
            return self.unknown_function();
        };
        if self.cursor.peek().is_ascii_lowercase() {
            *self.cursor = before;
            return self.unknown_function();
        }
        self.bracket()?;
        self.push(OpKind::Function(*function), start)
    }

    /// Reports that no function begins here, with the most similar function name.
    #[cold]
    fn unknown_function(&mut self) -> BlockResult<()> {
        let (at, mut name) = (self.cursor.next_span(), String::new());
        let mut cursor = self.cursor.clone();
        let mut whole = at;
        while let letter @ b'a'..=b'z' = cursor.peek() {
            cursor.skip();
            name.push(char::from(letter).to_ascii_uppercase());
            whole = cursor.span_from(at.start as usize);
        }
        const NAMES: [&str; 14] =
            ["ABS", "ACOS", "ASIN", "ATAN", "COS", "EXISTS", "EXP", "FIX", "FUP", "LN", "ROUND", "SIN", "SQRT", "TAN"];
        // A word of another letter is not a misspelt function.
        let near = if name.len() > 1 { nearest(&name, NAMES.into_iter()) } else { None };
        match near {
            Some(near) => {
                fault(ErrorCode::UnknownFunction, whole, format!("there is no function {name}; did you mean {near}?"))
            }
            None if name.len() > 1 && self.cursor.follows(b'[') => {
                let written = name.to_lowercase();
                let message = format!("there is no function {name}; a named parameter is written #<{written}>");
                fault(ErrorCode::UnknownFunction, whole, message)
            }
            None => fault(ErrorCode::UnknownFunction, at, "no function begins here"),
        }
    }

    /// Compiles `EXISTS[#<name>]`, which tests whether the parameter has a value. A numbered parameter has a value if
    /// its number exists.
    fn exists(&mut self, start: usize) -> BlockResult<()> {
        let open = self.cursor.next_span();
        if !self.cursor.eat(b'[') || self.cursor.peek() != b'#' {
            return fault(ErrorCode::BracketMissing, open, "EXISTS needs a parameter in brackets");
        }
        let reference = self.reference()?;
        if !self.cursor.eat(b']') {
            return self.bad_operator(open);
        }
        match reference {
            Reference::Named(name) => self.push(OpKind::Exists(name), start),
            Reference::Numbered => self.push(OpKind::ExistsNumbered, start),
            Reference::System(_) => self.push(OpKind::Constant(1.0), start),
        }
    }

    fn parameter_value(&mut self) -> BlockResult<()> {
        let start = self.cursor.position();
        match self.reference()? {
            Reference::Numbered => self.push(OpKind::Numbered, start),
            Reference::Named(name) => self.push(OpKind::Named(name), start),
            Reference::System(parameter) => self.push(OpKind::System(parameter), start),
        }
    }

    /// Compiles `#` and the parameter that it names. A calculated number is left to the operations.
    pub(crate) fn reference(&mut self) -> BlockResult<Reference> {
        let start = self.cursor.position();
        self.cursor.skip();
        if !self.cursor.eat(b'<') {
            self.value()?;
            return Ok(Reference::Numbered);
        }
        let Some(text) = self.cursor.take_to(b'>') else {
            self.cursor.finish();
            return fault(ErrorCode::NameNotClosed, self.cursor.span_from(start), ErrorCode::NameNotClosed.title());
        };
        self.names.resolve(text, self.cursor.span_from(start))
    }

    fn push(&mut self, kind: OpKind, start: usize) -> BlockResult<()> {
        let span = self.cursor.span_from(start);
        match kind {
            OpKind::Constant(_) | OpKind::Named(_) | OpKind::System(_) | OpKind::Exists(_) => self.held += 1,
            OpKind::Atan | OpKind::Binary(_) => self.held = self.held.saturating_sub(1),
            OpKind::Numbered | OpKind::ExistsNumbered | OpKind::Negate | OpKind::Function(_) => {}
        }
        if self.held > STACK {
            return fault(ErrorCode::TooDeep, span, ErrorCode::TooDeep.title());
        }
        self.ops.push(Op { kind, at: (span.start.min(255) as u8, span.end.min(255) as u8) });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::{Environment, evaluate};

    struct Nothing;

    impl Environment for Nothing {
        fn numbered(&self, number: usize) -> Option<f64> {
            Some(number as f64 * 10.0)
        }

        fn named(&self, _: NameId) -> Option<f64> {
            None
        }

        fn name(&self, _: NameId) -> &str {
            "gone"
        }

        fn system(&self, _: SystemParameter) -> f64 {
            0.0
        }
    }

    fn value(text: &str) -> Result<f64, ErrorCode> {
        let (mut ops, mut names) = (Vec::new(), Names::default());
        let mut cursor = Cursor::new(text.as_bytes());
        let result = Compiler::new(&mut cursor, &mut ops, &mut names).value();
        let result = result.and_then(|()| evaluate(&ops, &Nothing));
        result.map(|(_, value)| value).map_err(|fault| fault.code)
    }

    #[test]
    fn operators_bind_by_rank_and_from_left_to_right() {
        for (text, wanted) in [
            ("[2**3**2]", 64.0),
            ("[-2**2]", 4.0),
            ("[2+3*4-1]", 13.0),
            ("[10-4-3]", 3.0),
            ("[1 OR 0 AND 0]", 0.0),
            ("[1 LT 2 AND 3 GT 4]", 0.0),
            ("[1 + 2 EQ 3]", 1.0),
            ("[- 7 MOD 3]", 2.0),
            ("[10 MOD -3]", 1.0),
            ("-SIN[30]", -0.5),
            ("ATAN[1]/[-1]", 135.0),
            ("ROUND[-2.5]", -3.0),
            ("FIX[-2.5]", -3.0),
            ("FUP[-2.5]", -2.0),
            ("#[#2]", 200.0),
            ("EXISTS[#<gone>]", 0.0),
            ("EXISTS[#5]", 1.0),
            ("EXISTS[#[2+3]]", 1.0),
            ("EXISTS[##5]", 1.0),
        ] {
            assert_eq!(value(text), Ok(wanted), "{text}");
        }
    }

    #[test]
    fn values_nearer_than_a_millionth_are_equal_and_gt_and_lt_are_exact() {
        for (text, wanted) in [
            ("[1 EQ 1.0000009]", 1.0),
            ("[1 EQ 1.0000011]", 0.0),
            ("[1 NE 1.0000009]", 0.0),
            ("[1 NE 1.0000011]", 1.0),
            ("[1.0000009 LE 1]", 1.0),
            ("[1.0000011 LE 1]", 0.0),
            ("[1 GE 1.0000009]", 1.0),
            ("[1 GE 1.0000011]", 0.0),
            ("[1 LT 1.0000001]", 1.0),
            ("[1 GT .9999999]", 1.0),
            ("[.1+.1+.1 LE .3]", 1.0),
            ("[.1+.1+.1 GT .3]", 1.0),
        ] {
            assert_eq!(value(text), Ok(wanted), "{text}");
        }
    }
}
