//! Assignments, and the words of a motion block.
//!
//! Invariant: assignments are executed in order, before the block in their line.

use super::Compiler;
use super::lex::{CompileResult, Kind, Sign, Span, fault};
use super::names::{Shape, Variable};
use crate::code::Op;
use crate::error_codes::ErrorCode;
use crate::host::{MAX_G, MAX_M, MAX_WORDS};
use crate::parameter::Type;

/// First letters of the words of a block.
const ADDRESSES: &[u8] = b"GMSFXYZABCUVWIJKD";

pub(super) fn is_address(letter: u8) -> bool {
    ADDRESSES.contains(&letter)
}

/// G codes that a cycle may use, in tenths, and their equivalents in RS274/NGC.
const KNOWN_G: &[(u16, u16)] = &[
    (0, 0),
    (10, 10),
    (20, 20),
    (30, 30),
    (40, 40),
    (170, 170),
    (180, 180),
    (190, 190),
    (330, 330),
    (331, 331),
    (400, 400),
    (410, 410),
    (420, 420),
    // Exact stop is G60 on the control.
    (600, 610),
    (640, 640),
    (900, 900),
    (910, 910),
    (940, 940),
    (950, 950),
    (960, 960),
    (970, 970),
];

/// Words of the block so far.
#[derive(Debug, Default)]
struct Words {
    g: usize,
    m: usize,
    letters: Vec<u8>,
    dwells: bool,
    has_begun: bool,
}

impl Compiler<'_> {
    /// Compiles assignments and words to the end of the block.
    pub(super) fn items(&mut self) -> CompileResult {
        let mut words = Words::default();
        while let Some(kind) = self.peek() {
            let span = self.here_span();
            match kind {
                Kind::Word { letter: b'R', value } => {
                    self.skip();
                    let slot = self.r_parameter(value, span)?;
                    self.assign(Variable { slot, value_type: Type::Real, shape: Shape::Simple }, "R", span)?;
                }
                Kind::Word { letter, value } => {
                    self.skip();
                    if self.peek() == Some(Kind::Sign(Sign::Assign)) {
                        return fault(
                            ErrorCode::WordUnknown,
                            span,
                            "this is not a variable, and an address has no number before =",
                        );
                    }
                    self.word(&mut words, letter, Some(value), span)?;
                }
                Kind::Name => self.name_item(&mut words, span)?,
                _ => return fault(ErrorCode::NotUnderstood, span, "a word, an assignment or a call is needed here"),
            }
        }
        if words.has_begun {
            self.emit(Op::Emit);
        }
        Ok(())
    }

    fn name_item(&mut self, words: &mut Words, span: Span) -> CompileResult {
        let name = self.word_here().to_ascii_uppercase();
        self.skip();
        if let Some(variable) = self.names.get(&name) {
            return self.assign(variable, &name, span);
        }
        match name.as_str() {
            "R" => {
                let Some(slot) = self.names.r_parameters() else { return self.too_large(span, "variables") };
                let shape = Shape::Row(super::names::R_PARAMETERS);
                self.assign(Variable { slot, value_type: Type::Real, shape }, "R", span)
            }
            "AX" | "IP" => {
                self.begin(words, span)?;
                self.index_in_brackets()?;
                self.expect(Sign::Assign, &name)?;
                self.number()?;
                self.emit(if name == "AX" { Op::AxisWord } else { Op::CentreWord });
                Ok(())
            }
            "CR" => self.equals_word(words, b'R', Op::Word(b'R'), span),
            "SPOS" => self.equals_word(words, b'R', Op::Orient, span),
            // Diameter programming is G7 and G8 in RS274/NGC.
            "DIAMON" => self.code_g(words, 70, span),
            "DIAMOF" => self.code_g(words, 80, span),
            _ => match name.as_bytes() {
                [letter] if is_address(*letter) => self.word(words, *letter, None, span),
                [_] => fault(ErrorCode::WordUnknown, span, format!("{name} is not an address of a cycle's block")),
                _ => fault(
                    ErrorCode::NameUnknown,
                    span,
                    format!("{name} is not a variable, and a call must be alone in its block"),
                ),
            },
        }
    }

    /// Compiles `=` and a value, for a variable whose name was just parsed.
    fn assign(&mut self, variable: Variable, name: &str, span: Span) -> CompileResult {
        self.indices(variable, name, span)?;
        self.expect(Sign::Assign, name)?;
        self.value_for(variable.value_type)?;
        self.emit(match variable.shape {
            Shape::Simple => Op::Store(variable.slot, variable.value_type),
            shape => Op::StoreAt(variable.slot, shape.slots() as u16, variable.value_type),
        });
        Ok(())
    }

    /// Begins the block with its first word, and counts the words.
    fn begin(&mut self, words: &mut Words, span: Span) -> CompileResult {
        if !words.has_begun {
            words.has_begun = true;
            self.emit(Op::Begin);
        }
        words.letters.push(0);
        if words.letters.len() > MAX_WORDS {
            return fault(ErrorCode::WordTwice, span, format!("a block has at most {MAX_WORDS} words"));
        }
        Ok(())
    }

    fn once(&mut self, words: &mut Words, letter: u8, span: Span) -> CompileResult {
        if words.letters.contains(&letter) {
            return fault(ErrorCode::WordTwice, span, format!("{} is in this block twice", char::from(letter)));
        }
        self.begin(words, span)?;
        if let Some(last) = words.letters.last_mut() {
            *last = letter;
        }
        Ok(())
    }

    fn equals_word(&mut self, words: &mut Words, letter: u8, op: Op, span: Span) -> CompileResult {
        self.once(words, letter, span)?;
        self.expect(Sign::Assign, "this word")?;
        self.number()?;
        self.emit(op);
        Ok(())
    }

    /// Compiles a word of one letter; its value was read with it, or follows.
    fn word(&mut self, words: &mut Words, letter: u8, value: Option<f64>, span: Span) -> CompileResult {
        if letter == b'G' {
            // 33.1 is not an exact number; its tenths are.
            return match value.map(|value| (value * 10.0, (value * 10.0).round())) {
                Some((exact, tenths)) if (exact - tenths).abs() < 1e-9 && tenths < 10_000.0 => {
                    let known = KNOWN_G.iter().find(|(here, _)| f64::from(*here) == tenths);
                    match known {
                        Some((_, there)) => self.code_g(words, *there, span),
                        None => self.unknown_code("G", tenths / 10.0, span),
                    }
                }
                Some((exact, _)) => self.unknown_code("G", exact / 10.0, span),
                None => fault(ErrorCode::CodeUnknown, span, "a G code of a cycle must be a constant"),
            };
        }
        if !is_address(letter) {
            let message = format!("{} is not an address of a cycle's block", char::from(letter));
            return fault(ErrorCode::WordUnknown, span, message);
        }
        if letter == b'M' {
            return self.code_m(words, value, span);
        }
        self.once(words, letter, span)?;
        self.value_of_word(value)?;
        self.emit(match letter {
            // A dwell, in seconds or in revolutions.
            b'F' if words.dwells => Op::Word(b'P'),
            b'S' if words.dwells => Op::DwellTurns,
            _ => Op::Word(letter),
        });
        Ok(())
    }

    /// Compiles `=value`, a number that follows, or the one read with the letter.
    fn value_of_word(&mut self, value: Option<f64>) -> CompileResult {
        if let Some(value) = value {
            self.emit(Op::Number(value));
            return Ok(());
        }
        if self.eat(Sign::Assign) {
            return self.number();
        }
        let is_negative = self.eat(Sign::Minus);
        if !is_negative {
            self.eat(Sign::Plus);
        }
        match self.peek() {
            Some(Kind::Number(value)) => {
                self.skip();
                self.emit(Op::Number(if is_negative { -value } else { value }));
                Ok(())
            }
            _ => fault(ErrorCode::ValueMissing, self.here_span(), "a number is missing, or = before an expression"),
        }
    }

    fn code_g(&mut self, words: &mut Words, code: u16, span: Span) -> CompileResult {
        if code == 40 {
            if words.letters.iter().any(|letter| b"FS".contains(letter)) {
                return fault(ErrorCode::NotUnderstood, span, "G4 must be before its F or S");
            }
            words.dwells = true;
        }
        words.g += 1;
        if words.g > MAX_G {
            return fault(ErrorCode::WordTwice, span, format!("a block has at most {MAX_G} G codes"));
        }
        if !words.has_begun {
            words.has_begun = true;
            self.emit(Op::Begin);
        }
        self.emit(Op::CodeG(code));
        Ok(())
    }

    fn code_m(&mut self, words: &mut Words, value: Option<f64>, span: Span) -> CompileResult {
        if value.is_some_and(|value| matches!(value, 2.0 | 17.0 | 30.0)) {
            if value != Some(17.0) {
                return fault(ErrorCode::CodeUnknown, span, "M2 and M30 end a program; a cycle ends with M17 or RET");
            }
            if words.has_begun {
                return fault(ErrorCode::NotUnderstood, span, "M17 must be alone in its block");
            }
            self.emit(Op::Return);
            return Ok(());
        }
        if let Some(value) = value.filter(|value| !crate::host::is_known_m(*value)) {
            return self.unknown_code("M", value, span);
        }
        words.m += 1;
        if words.m > MAX_M {
            return fault(ErrorCode::WordTwice, span, format!("a block has at most {MAX_M} M codes"));
        }
        if !words.has_begun {
            words.has_begun = true;
            self.emit(Op::Begin);
        }
        self.value_of_word(value)?;
        self.emit(Op::CodeM);
        Ok(())
    }

    fn unknown_code(&self, letter: &str, value: f64, span: Span) -> CompileResult {
        fault(ErrorCode::CodeUnknown, span, format!("{letter}{value} is not allowed in a cycle"))
    }
}
