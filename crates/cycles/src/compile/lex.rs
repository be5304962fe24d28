//! Splitting of a line of a cycle source into tokens.
//!
//! Invariant: tokens are in order and never overlap; a comment has none.

use crate::error_codes::ErrorCode;
use std::fmt;

/// A range of the line, in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Span {
    pub(super) start: usize,
    pub(super) end: usize,
}

/// An error in a line; the line number is added where it is recorded.
#[derive(Debug)]
pub(super) struct CompileError {
    pub(super) code: ErrorCode,
    pub(super) span: Span,
    pub(super) message: String,
}

impl fmt::Display for CompileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.code.number(), self.message)
    }
}

impl std::error::Error for CompileError {}

/// Result of reading a part of a block.
pub(super) type CompileResult<T = ()> = Result<T, Box<CompileError>>;

#[cold]
pub(super) fn fault<T>(code: ErrorCode, span: Span, message: impl Into<String>) -> CompileResult<T> {
    Err(Box::new(CompileError { code, span, message: message.into() }))
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    /// A name: `WHILE`, `_DEPTH`, `$P_F`; also a letter alone.
    Name,
    /// A letter followed immediately by a number: `G33.1`, `X10`, `R5`.
    Word {
        letter: u8,
        value: f64,
    },
    Number(f64),
    /// In quotes; the span includes them.
    Text,
    Sign(Sign),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sign {
    Plus,
    Minus,
    Star,
    Slash,
    Open,
    Close,
    OpenIndex,
    CloseIndex,
    Comma,
    Assign,
    Colon,
    Join,
    Equal,
    Unequal,
    Less,
    LessEqual,
    Greater,
    GreaterEqual,
}

/// Signs by their spelling, the longer ones first.
const SIGNS: &[(&str, Sign)] = &[
    ("<<", Sign::Join),
    ("==", Sign::Equal),
    ("<>", Sign::Unequal),
    ("<=", Sign::LessEqual),
    (">=", Sign::GreaterEqual),
    ("<", Sign::Less),
    (">", Sign::Greater),
    ("+", Sign::Plus),
    ("-", Sign::Minus),
    ("*", Sign::Star),
    ("/", Sign::Slash),
    ("(", Sign::Open),
    (")", Sign::Close),
    ("[", Sign::OpenIndex),
    ("]", Sign::CloseIndex),
    (",", Sign::Comma),
    ("=", Sign::Assign),
    (":", Sign::Colon),
];

impl Sign {
    pub(super) fn spelling(self) -> &'static str {
        SIGNS.iter().find(|(_, sign)| *sign == self).map_or("", |(spelling, _)| spelling)
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Token {
    pub(super) kind: Kind,
    pub(super) span: Span,
}

/// Splits a line. `is_variable` distinguishes defined names: `A1` is one of them, or the word A with the value 1.
pub(super) fn tokens(line: &str, is_variable: impl Fn(&str) -> bool, out: &mut Vec<Token>) -> CompileResult {
    out.clear();
    let bytes = line.as_bytes();
    let mut at = 0;
    while let Some(&byte) = bytes.get(at) {
        let start = at;
        let kind = match byte {
            b' ' | b'\t' => {
                at += 1;
                continue;
            }
            b';' => break,
            b'"' => {
                let Some(length) = bytes[at + 1..].iter().position(|byte| *byte == b'"') else {
                    let span = Span { start, end: bytes.len() };
                    return fault(ErrorCode::TextNotClosed, span, "this text has no closing quotation mark");
                };
                at += length + 2;
                Kind::Text
            }
            b'0'..=b'9' | b'.' => Kind::Number(number(line, &mut at)?),
            b'$' | b'_' | b'a'..=b'z' | b'A'..=b'Z' => name_or_word(line, &is_variable, &mut at)?,
            _ => {
                let Some((spelling, sign)) = SIGNS.iter().find(|(spelling, _)| line[at..].starts_with(spelling)) else {
                    let letter = line[at..].chars().next().unwrap_or('?');
                    let span = Span { start, end: start + letter.len_utf8() };
                    return fault(ErrorCode::BadCharacter, span, format!("nothing begins with `{letter}`"));
                };
                at += spelling.len();
                Kind::Sign(*sign)
            }
        };
        out.push(Token { kind, span: Span { start, end: at } });
    }
    Ok(())
}

fn name_or_word(line: &str, is_variable: &impl Fn(&str) -> bool, at: &mut usize) -> CompileResult<Kind> {
    let bytes = line.as_bytes();
    let start = *at;
    let is_part = |byte: &u8| byte.is_ascii_alphanumeric() || *byte == b'_';
    let length = 1 + bytes[start + 1..].iter().take_while(|byte| is_part(byte)).count();
    let is_letter_and_digit =
        bytes[start].is_ascii_alphabetic() && bytes.get(start + 1).is_some_and(u8::is_ascii_digit);
    // The name of the cycle follows PROC, whatever it means elsewhere.
    let is_name_of_cycle = line[..start].trim().eq_ignore_ascii_case("PROC");
    if is_letter_and_digit && !is_name_of_cycle && !is_variable(&line[start..start + length]) {
        *at = start + 1;
        let value = number(line, at)?;
        return Ok(Kind::Word { letter: bytes[start].to_ascii_uppercase(), value });
    }
    *at = start + length;
    Ok(Kind::Name)
}

/// Reads digits with at most one point, and an exponent as in `1.5EX-3`.
fn number(line: &str, at: &mut usize) -> CompileResult<f64> {
    let bytes = line.as_bytes();
    let start = *at;
    let digits = |from: usize| bytes[from..].iter().take_while(|byte| byte.is_ascii_digit()).count();
    *at += digits(*at);
    if bytes.get(*at) == Some(&b'.') {
        *at += 1;
        *at += digits(*at);
    }
    let mantissa = &line[start..*at];
    let mut exponent = 0_i32;
    if line[*at..].get(..2).is_some_and(|mark| mark.eq_ignore_ascii_case("EX")) {
        let signed = *at + 2;
        let first_digit = signed + usize::from(matches!(bytes.get(signed), Some(b'+' | b'-')));
        let count = digits(first_digit);
        if count > 0 {
            *at = first_digit + count;
            exponent = line[signed..*at].parse().unwrap_or(i32::MAX);
        }
    }
    let value = format!("{mantissa}e{exponent}").parse::<f64>().unwrap_or(f64::NAN);
    if mantissa == "." || !value.is_finite() || bytes.get(*at) == Some(&b'.') {
        return fault(ErrorCode::BadNumber, Span { start, end: *at }, "this is not a number");
    }
    Ok(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kinds(line: &str) -> Vec<Kind> {
        let mut out = Vec::new();
        tokens(line, |name| name == "a1", &mut out).expect("tokens");
        out.into_iter().map(|token| token.kind).collect()
    }

    #[test]
    fn a_letter_with_a_number_is_a_word_unless_it_is_a_variable() {
        let word = |letter, value| Kind::Word { letter, value };
        assert_eq!(kinds("G1X10.5z2 ; X3"), [word(b'G', 1.0), word(b'X', 10.5), word(b'Z', 2.0)]);
        assert_eq!(kinds("g33.1"), [word(b'G', 33.1)]);
        assert_eq!(kinds("a1=A2"), [Kind::Name, Kind::Sign(Sign::Assign), word(b'A', 2.0)]);
        assert_eq!(kinds("X-.5"), [Kind::Name, Kind::Sign(Sign::Minus), Kind::Number(0.5)]);
    }

    #[test]
    fn numbers_have_exponents_with_ex() {
        assert_eq!(kinds("1.5EX-3 2EX2 .5 7."), [1.5e-3, 200.0, 0.5, 7.0].map(Kind::Number));
        assert_eq!(kinds("1EX"), [Kind::Number(1.0), Kind::Name]);
        let mut out = Vec::new();
        for wrong in ["1.2.3", ".", "1EX999", "1EX99999999999"] {
            assert_eq!(tokens(wrong, |_| false, &mut out).expect_err(wrong).code, ErrorCode::BadNumber, "{wrong}");
        }
    }
}
