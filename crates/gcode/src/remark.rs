//! Comments that are passed on: plain ones, messages, and those that show parameters.
//!
//! Invariant: what the first word of a comment asks for is either done or refused by its name.

use crate::canon::Canon;
use crate::codes::Code;
use crate::diag::{Outcome, Span, fault};
use crate::eval::{EQUAL, Environment};
use crate::expr::Reference;
use crate::params::Names;
use std::fmt::Write as _;
use std::sync::Arc;

/// A comment of a block.
#[derive(Clone, Debug)]
pub(crate) enum Remark {
    Comment(Arc<str>),
    Message(Arc<str>),
    /// Shown to the operator, while parameter 5599 is above 0.
    Debug(Arc<[Piece]>),
    /// Goes to standard output.
    Print(Arc<[Piece]>),
}

/// A part of a comment that shows parameters.
#[derive(Clone, Debug)]
pub(crate) enum Piece {
    Text(Box<str>),
    Numbered(usize),
    Parameter(Reference),
}

/// Comments of LinuxCNC that would do something that is not done here.
const REFUSED: [&str; 8] = ["log,", "logopen,", "logappend,", "logclose", "py,", "pyrun,", "pyreload", "abort,"];

impl Remark {
    /// The comment whose text stands between its parentheses.
    pub(crate) fn of(text: &[u8], at: Span, names: &mut Names) -> Outcome<Option<Remark>> {
        let text = String::from_utf8_lossy(text);
        let text = text.trim_start();
        if text.is_empty() {
            return Ok(None);
        }
        if let Some(rest) = after(text, "msg,") {
            return Ok(Some(Remark::Message(rest.into())));
        }
        if let Some(rest) = after(text, "debug,") {
            return Ok(Some(Remark::Debug(pieces(rest, at, names)?.into())));
        }
        if let Some(rest) = after(text, "print,") {
            return Ok(Some(Remark::Print(pieces(rest, at, names)?.into())));
        }
        if let Some(word) = REFUSED.iter().find(|word| after(text, word).is_some()) {
            let word = word.trim_end_matches(',').to_uppercase();
            return fault(Code::UnsupportedWord, at, format!("the comment {word} is not supported yet"));
        }
        Ok(Some(Remark::Comment(text.into())))
    }

    /// What is passed on, with the values that parameters have now.
    pub(crate) fn canon(&self, environment: &impl Environment, show_debug: bool) -> Option<Canon> {
        Some(match self {
            Remark::Comment(text) => Canon::Comment(Arc::clone(text)),
            Remark::Message(text) => Canon::Message(Arc::clone(text)),
            Remark::Debug(pieces) if show_debug => Canon::Message(expand(pieces, environment)),
            Remark::Debug(_) => return None,
            Remark::Print(pieces) => Canon::Print(expand(pieces, environment)),
        })
    }
}

/// What follows a word at the beginning, of either case.
fn after<'a>(text: &'a str, word: &str) -> Option<&'a str> {
    let head = text.get(..word.len())?;
    head.eq_ignore_ascii_case(word).then(|| &text[word.len()..])
}

fn pieces(text: &str, at: Span, names: &mut Names) -> Outcome<Vec<Piece>> {
    let mut pieces = Vec::new();
    let mut parts = text.split('#');
    pieces.push(Piece::Text(parts.next().unwrap_or_default().into()));
    for part in parts {
        let digits = part.len() - part.trim_start_matches(|letter: char| letter.is_ascii_digit()).len();
        let rest = if let Some(named) = part.strip_prefix('<') {
            let Some((name, rest)) = named.split_once('>') else {
                return fault(Code::NameNotClosed, at, Code::NameNotClosed.title());
            };
            pieces.push(Piece::Parameter(names.resolve(name.as_bytes())));
            rest
        } else if digits > 0 {
            pieces.push(Piece::Numbered(part[..digits].parse().unwrap_or(usize::MAX)));
            &part[digits..]
        } else {
            pieces.push(Piece::Text("#".into()));
            part
        };
        pieces.push(Piece::Text(rest.into()));
    }
    Ok(pieces)
}

fn expand(pieces: &[Piece], environment: &impl Environment) -> Arc<str> {
    let mut text = String::new();
    for piece in pieces {
        let value = match piece {
            Piece::Text(part) => {
                text.push_str(part);
                continue;
            }
            Piece::Numbered(number) => environment.numbered(*number),
            Piece::Parameter(Reference::Named(name)) => environment.named(*name),
            Piece::Parameter(Reference::System(parameter)) => Some(environment.system(*parameter)),
            Piece::Parameter(Reference::Numbered) => None,
        };
        let from = text.len();
        if let Some(value) = value {
            // Writing to a string cannot fail; a value that is equal to zero shows as zero.
            let _ = write!(text, "{:.6}", if value.abs() < EQUAL { 0.0 } else { value });
        }
        // The field is 29 characters wide; a parameter without a value shows as crosses.
        if text.len() == from || text.len() - from >= 30 {
            text.truncate(from);
            text.push_str("######");
        }
    }
    text.into()
}
