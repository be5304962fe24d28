//! Comments that are passed on: plain ones, messages, and those that show parameters.
//!
//! Invariant: a command at the beginning of a comment is either executed or refused by name.

use crate::bytes::shown;
use crate::canon::Canon;
use crate::diag::{BlockResult, Span, fault};
use crate::error_codes::ErrorCode;
use crate::eval::{EQUAL, Environment};
use crate::material_comment::MaterialComment;
use crate::params::Names;
use crate::params::Reference;
use std::fmt::Write as _;
use std::sync::Arc;

/// A comment of a block.
#[derive(Clone, Debug)]
pub(crate) enum Comment {
    Plain(Arc<str>),
    Message(Arc<str>),
    /// Shown to the operator while parameter 5599 is above 0.
    Debug(Arc<[CommentPart]>),
    /// Written to standard output.
    Print(Arc<[CommentPart]>),
    LogOpen {
        file: Arc<str>,
        append: bool,
    },
    /// Written to the log file.
    Log(Arc<[CommentPart]>),
    LogClose,
    /// Declares a material; only on a machine with a material table.
    Material(Arc<MaterialComment>),
    /// Ends the program with an error.
    Abort(Arc<[CommentPart]>),
}

/// A part of a comment that shows parameters.
#[derive(Clone, Debug)]
pub(crate) enum CommentPart {
    Text(Box<str>),
    Numbered(usize),
    Parameter(Reference),
    /// Sets the number of decimals for the values that follow.
    Decimals(usize),
}

/// Default number of decimals.
const DECIMALS: usize = 6;

/// Comments that run Python in LinuxCNC.
const PYTHON: [&str; 3] = ["py,", "pyrun,", "pyreload"];

impl Comment {
    /// Compiles the text between the parentheses of a comment.
    pub(crate) fn compile(text: &[u8], at: Span, names: &mut Names) -> BlockResult<Option<Comment>> {
        let text = shown(text);
        let text = text.trim_start();
        if text.is_empty() {
            return Ok(None);
        }
        if let Some(rest) = strip_command(text, "msg,") {
            return Ok(Some(Comment::Message(rest.into())));
        }
        if let Some(rest) = strip_command(text, "debug,") {
            return Ok(Some(Comment::Debug(pieces(rest, at, names)?.into())));
        }
        if let Some(rest) = strip_command(text, "print,") {
            return Ok(Some(Comment::Print(pieces(rest, at, names)?.into())));
        }
        if let Some(rest) = strip_command(text, "log,") {
            return Ok(Some(Comment::Log(pieces(rest, at, names)?.into())));
        }
        if let Some(rest) = strip_command(text, "abort,") {
            return Ok(Some(Comment::Abort(pieces(rest, at, names)?.into())));
        }
        for (word, append) in [("logopen,", false), ("logappend,", true)] {
            if let Some(file) = strip_command(text, word) {
                return Ok(Some(Comment::LogOpen { file: file.into(), append }));
            }
        }
        if text.eq_ignore_ascii_case("logclose") {
            return Ok(Some(Comment::LogClose));
        }
        refuse_python(text, at)?;
        Ok(Some(Comment::Plain(text.into())))
    }

    /// Returns the canonical function of the comment, with the present values of its parameters.
    ///
    /// # Errors
    /// ABORT is reported as an error.
    pub(crate) fn canon(&self, environment: &impl Environment, show_debug: bool) -> BlockResult<Option<Canon>> {
        Ok(Some(match self {
            Comment::Plain(text) => Canon::Comment(Arc::clone(text)),
            Comment::Material(material) => Canon::Comment(Arc::clone(&material.text)),
            Comment::Message(text) => Canon::Message(Arc::clone(text)),
            Comment::Debug(pieces) if show_debug => Canon::Message(expand(pieces, environment)),
            Comment::Debug(_) => return Ok(None),
            Comment::Print(pieces) => Canon::Print(expand(pieces, environment)),
            Comment::Log(pieces) => Canon::Log(expand(pieces, environment)),
            Comment::LogOpen { file, append } => Canon::LogOpen { file: Arc::clone(file), append: *append },
            Comment::LogClose => Canon::LogClose,
            Comment::Abort(pieces) => {
                return fault(ErrorCode::Aborted, Span::default(), expand(pieces, environment).trim_start());
            }
        }))
    }
}

/// Refuses a comment that would run Python, both in parentheses and after a semicolon.
pub(crate) fn refuse_python(text: &str, at: Span) -> BlockResult<()> {
    match PYTHON.iter().find(|word| strip_command(text.trim_start(), word).is_some()) {
        Some(word) => {
            let word = word.trim_end_matches(',').to_uppercase();
            fault(ErrorCode::PythonComment, at, format!("the comment {word} would run Python"))
        }
        None => Ok(()),
    }
}

/// Returns the text after a command word of either case.
fn strip_command<'a>(text: &'a str, word: &str) -> Option<&'a str> {
    let head = text.get(..word.len())?;
    head.eq_ignore_ascii_case(word).then(|| &text[word.len()..])
}

fn pieces(text: &str, at: Span, names: &mut Names) -> BlockResult<Vec<CommentPart>> {
    let mut pieces = Vec::new();
    let mut rest = text;
    while let Some(special) = rest.find(['#', '%']) {
        pieces.push(CommentPart::Text(rest[..special].into()));
        let is_format = rest.as_bytes()[special] == b'%';
        rest = &rest[special + 1..];
        let piece;
        (piece, rest) = if is_format { parse_format(rest) } else { parse_parameter(rest, at, names)? };
        pieces.push(piece);
    }
    pieces.push(CommentPart::Text(rest.into()));
    Ok(pieces)
}

/// Parses what begins with a percent sign, and returns it with the rest. %d, %f and %.0f to %.9f select the decimals.
fn parse_format(rest: &str) -> (CommentPart, &str) {
    match *rest.as_bytes() {
        [b'd', ..] => (CommentPart::Decimals(0), &rest[1..]),
        [b'f', ..] => (CommentPart::Decimals(4), &rest[1..]),
        [b'.', digit @ b'0'..=b'9', b'f', ..] => (CommentPart::Decimals(usize::from(digit - b'0')), &rest[3..]),
        [b'.', ..] => (CommentPart::Text("".into()), rest),
        _ => (CommentPart::Text("%".into()), rest),
    }
}

/// Parses what begins with a number sign, and returns it with the rest.
fn parse_parameter<'a>(rest: &'a str, at: Span, names: &mut Names) -> BlockResult<(CommentPart, &'a str)> {
    if let Some(named) = rest.strip_prefix('<') {
        // For a name without a closing `>`, LinuxCNC shows the memory behind it.
        let Some((name, rest)) = named.split_once('>') else {
            return fault(ErrorCode::NameNotClosed, at, ErrorCode::NameNotClosed.title());
        };
        return Ok((CommentPart::Parameter(names.resolve(name.as_bytes(), at)?), rest));
    }
    let digits = rest.len() - rest.trim_start_matches(|letter: char| letter.is_ascii_digit()).len();
    if digits == 0 {
        return Ok((CommentPart::Text("#".into()), rest));
    }
    Ok((CommentPart::Numbered(rest[..digits].parse().unwrap_or(usize::MAX)), &rest[digits..]))
}

fn expand(pieces: &[CommentPart], environment: &impl Environment) -> Arc<str> {
    let mut text = String::new();
    let mut decimals = DECIMALS;
    for piece in pieces {
        let value = match piece {
            CommentPart::Text(part) => {
                text.push_str(part);
                continue;
            }
            CommentPart::Decimals(wanted) => {
                decimals = *wanted;
                continue;
            }
            CommentPart::Numbered(0) => Some(0.0),
            CommentPart::Numbered(number) => environment.numbered(*number),
            CommentPart::Parameter(Reference::Named(name)) => environment.named(*name),
            CommentPart::Parameter(Reference::System(parameter)) => Some(environment.system(*parameter)),
            CommentPart::Parameter(Reference::Numbered) => None,
        };
        let from = text.len();
        if let Some(value) = value {
            // Writing to a string cannot fail. A value equal to zero is shown as zero.
            let _ = write!(text, "{:.decimals$}", if value.abs() < EQUAL { 0.0 } else { value });
        }
        // The field is 29 characters wide. A parameter without a value is shown as crosses.
        if text.len() == from || text.len() - from >= 30 {
            text.truncate(from);
            text.push_str("######");
        }
    }
    text.into()
}
