//! The head of a source: PROC and DEF.
//!
//! Invariant: parameters have the first slots, in order.

use super::Compiler;
use super::lex::{CompileResult, Kind, Sign, Span, fault};
use super::names::{Names, Shape, Variable};
use crate::code::{Op, converted};
use crate::error_codes::ErrorCode;
use crate::parameter::{Parameter, Type};

/// Maximum number of parameters of a cycle.
const MAX_PARAMETERS: usize = 64;
/// Maximum length of a text.
const MAX_TEXT_LENGTH: f64 = 1000.0;
/// Maximum number of elements of an array.
const MAX_ARRAY: usize = 1000;

impl Compiler<'_> {
    /// Compiles `PROC NAME(REAL A, STRING[20] B, INT C=1) SAVE DISPLOF`.
    pub(super) fn proc(&mut self, span: Span) -> CompileResult {
        self.skip();
        if self.has_proc || self.has_begun || self.names.slots() > 0 {
            return fault(ErrorCode::ProcPlace, span, "PROC must be the first block of a source, and occur once");
        }
        self.has_proc = true;
        let name = self.new_name("PROC")?;
        if !name.eq_ignore_ascii_case(self.file_name) {
            let message = format!("the file is named {}, the cycle {name}", self.file_name);
            self.report(ErrorCode::NameDiffers, self.since(span.end), message);
        }
        self.unit.name = name;
        let open = self.here_span();
        if self.eat(Sign::Open) && !self.eat(Sign::Close) {
            loop {
                self.parameter()?;
                if !self.eat(Sign::Comma) {
                    break;
                }
            }
            self.close(Sign::Close, open)?;
        }
        while self.peek().is_some() {
            match self.word_here().to_ascii_uppercase().as_str() {
                "SAVE" => self.unit.saves = true,
                "PATTERN" => self.unit.is_pattern = true,
                // A cycle is always one block of its caller.
                "DISPLOF" | "DISPLON" | "SBLOF" => {}
                _ => return fault(ErrorCode::AttributeUnknown, self.here_span(), "this is not an attribute of PROC"),
            }
            self.skip();
        }
        Ok(())
    }

    fn parameter(&mut self) -> CompileResult {
        let span = self.here_span();
        let value_type = self.type_name()?;
        let name_span = self.here_span();
        let name = self.new_name(&value_type.to_string())?;
        if self.unit.parameters.len() >= MAX_PARAMETERS {
            return self.too_large(self.since(span.start), "parameters");
        }
        let default = if self.eat(Sign::Assign) { converted(value_type, self.constant_number()?) } else { 0.0 };
        self.define(&name, value_type, Shape::Simple, name_span)?;
        self.unit.parameters.push(Parameter { name, value_type, default });
        Ok(())
    }

    /// Compiles `DEF REAL A, B=5, C[10], D[2,3]=SET(1,2,3)`.
    pub(super) fn def(&mut self, span: Span) -> CompileResult {
        self.skip();
        if self.has_begun {
            return fault(
                ErrorCode::DefinitionPlace,
                span,
                "DEF must be at the beginning, before the first block with an effect",
            );
        }
        let value_type = self.type_name()?;
        loop {
            let name_span = self.here_span();
            let name = self.new_name(&value_type.to_string())?;
            let shape = self.shape()?;
            let variable = self.define(&name, value_type, shape, name_span)?;
            if self.eat(Sign::Assign) {
                self.initial(variable)?;
            } else if value_type.is_text() {
                self.clear_texts(variable, name_span)?;
            }
            if !self.eat(Sign::Comma) {
                return self.end_of_block();
            }
        }
    }

    fn type_name(&mut self) -> CompileResult<Type> {
        let span = self.here_span();
        let value_type = match self.word_here().to_ascii_uppercase().as_str() {
            "REAL" => Type::Real,
            "INT" => Type::Int,
            "BOOL" => Type::Bool,
            "STRING" => Type::Text(200),
            _ => return fault(ErrorCode::NotUnderstood, span, "a type is needed here: REAL, INT, BOOL or STRING[n]"),
        };
        self.skip();
        let open = self.here_span();
        if !(value_type.is_text() && self.eat(Sign::OpenIndex)) {
            return Ok(value_type);
        }
        let length = self.constant_number()?;
        self.close(Sign::CloseIndex, open)?;
        if length.fract() != 0.0 || !(1.0..=MAX_TEXT_LENGTH).contains(&length) {
            return fault(
                ErrorCode::ArraySize,
                self.since(open.start),
                format!("a text must have from 1 to {MAX_TEXT_LENGTH} bytes"),
            );
        }
        Ok(Type::Text(length as u16))
    }

    /// Parses a name to be defined, in capitals.
    fn new_name(&mut self, behind: &str) -> CompileResult<String> {
        if !matches!(self.peek(), Some(Kind::Name | Kind::Word { .. })) {
            return fault(ErrorCode::NotUnderstood, self.here_span(), format!("a name is needed after {behind}"));
        }
        let name = self.word_here().to_ascii_uppercase();
        self.skip();
        Ok(name)
    }

    fn define(&mut self, name: &str, value_type: Type, shape: Shape, span: Span) -> CompileResult<Variable> {
        if self.names.has(name) {
            return fault(ErrorCode::NameTaken, span, format!("{name} is defined already"));
        }
        if Names::is_word_of_the_language(name) || name.contains('.') {
            return fault(ErrorCode::NameTaken, span, format!("{name} cannot be the name of a variable"));
        }
        if matches!(name.as_bytes(), [letter] if super::block::is_address(*letter)) {
            self.report(ErrorCode::NameIsAddress, span, format!("{name} is also an address"));
        }
        match self.names.define(name, value_type, shape) {
            Some(variable) => Ok(variable),
            None => self.too_large(span, "variables"),
        }
    }

    /// Parses the sizes of an array, if there are any.
    fn shape(&mut self) -> CompileResult<Shape> {
        let open = self.here_span();
        if !self.eat(Sign::OpenIndex) {
            return Ok(Shape::Simple);
        }
        let mut sizes = [0_u16; 2];
        let mut count = 0;
        loop {
            let size = self.constant_number()?;
            let fits = size.fract() == 0.0 && (1.0..=MAX_ARRAY as f64).contains(&size);
            match sizes.get_mut(count) {
                Some(place) if fits => *place = size as u16,
                _ => {
                    return fault(
                        ErrorCode::ArraySize,
                        self.since(open.start),
                        "an array must have one or two sizes from 1 to 1000",
                    );
                }
            }
            count += 1;
            if !self.eat(Sign::Comma) {
                break;
            }
        }
        self.close(Sign::CloseIndex, open)?;
        let shape = if count == 1 { Shape::Row(sizes[0]) } else { Shape::Table(sizes[0], sizes[1]) };
        if shape.slots() > MAX_ARRAY {
            let message = format!("an array has at most {MAX_ARRAY} elements, not {}", shape.slots());
            return fault(ErrorCode::ArraySize, self.since(open.start), message);
        }
        Ok(shape)
    }

    /// Compiles the value after `=`, or the values of an array in parentheses.
    fn initial(&mut self, variable: Variable) -> CompileResult {
        if variable.shape == Shape::Simple {
            self.value_for(variable.value_type)?;
            self.emit(Op::Store(variable.slot, variable.value_type));
            return Ok(());
        }
        if self.word_here().eq_ignore_ascii_case("SET") {
            self.skip();
        }
        let open = self.here_span();
        self.expect(Sign::Open, "=")?;
        let mut count = 0;
        loop {
            if count >= variable.shape.slots() {
                return fault(ErrorCode::ArraySize, self.here_span(), "there are more values than elements");
            }
            self.value_for(variable.value_type)?;
            self.emit(Op::Store(variable.slot + count as u16, variable.value_type));
            count += 1;
            if !self.eat(Sign::Comma) {
                break;
            }
        }
        self.close(Sign::Close, open)
    }

    /// Clears a text variable, which is empty until something is assigned to it; slots are numbers by default.
    fn clear_texts(&mut self, variable: Variable, span: Span) -> CompileResult {
        let empty = self.constant_text("", span)?;
        for slot in 0..variable.shape.slots() as u16 {
            self.emit(Op::Text(empty));
            self.emit(Op::Store(variable.slot + slot, variable.value_type));
        }
        Ok(())
    }

    /// Parses a number with its sign.
    fn constant_number(&mut self) -> CompileResult<f64> {
        let is_negative = self.eat(Sign::Minus);
        let value = match self.peek() {
            Some(Kind::Number(value)) => value,
            Some(Kind::Name) if self.word_here().eq_ignore_ascii_case("TRUE") => 1.0,
            Some(Kind::Name) if self.word_here().eq_ignore_ascii_case("FALSE") => 0.0,
            _ => return fault(ErrorCode::NotUnderstood, self.here_span(), "a constant number is needed here"),
        };
        self.skip();
        Ok(if is_negative { -value } else { value })
    }
}
