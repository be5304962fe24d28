//! Lines with an O word: subprograms, branches and loops.
//!
//! Invariant: such a line holds its label, one keyword and values in brackets, and nothing else but comments.

use crate::block::{Block, Slot};
use crate::codes::Code;
use crate::diag::{Outcome, Span, fault};
use crate::expr::Compiler;
use crate::lex::Cursor;
use crate::params::Names;

/// Most arguments of a call: parameters 1 … 30 take them.
pub(crate) const MOST_ARGUMENTS: usize = 30;

/// What follows the O: a number, or a name in angle brackets, in lower case and without blanks.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Label {
    Number(u64),
    Name(Box<str>),
}

impl std::fmt::Display for Label {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Label::Number(number) => write!(formatter, "O{number}"),
            Label::Name(name) => write!(formatter, "O<{name}>"),
        }
    }
}

/// What an O word asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Keyword {
    Sub,
    EndSub,
    Call,
    Return,
    If,
    ElseIf,
    Else,
    EndIf,
    While,
    EndWhile,
    Do,
    Repeat,
    EndRepeat,
    Break,
    Continue,
}

/// Keywords by how they are written; a longer one stands before one that it begins with.
const KEYWORDS: [(&[u8], Keyword); 15] = [
    (b"sub", Keyword::Sub),
    (b"endsub", Keyword::EndSub),
    (b"call", Keyword::Call),
    (b"return", Keyword::Return),
    (b"if", Keyword::If),
    (b"elseif", Keyword::ElseIf),
    (b"else", Keyword::Else),
    (b"endif", Keyword::EndIf),
    (b"while", Keyword::While),
    (b"endwhile", Keyword::EndWhile),
    (b"do", Keyword::Do),
    (b"repeat", Keyword::Repeat),
    (b"endrepeat", Keyword::EndRepeat),
    (b"break", Keyword::Break),
    (b"continue", Keyword::Continue),
];

/// The O word of a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Control {
    pub(crate) label: Label,
    pub(crate) keyword: Keyword,
    pub(crate) at: Span,
}

/// The O word of a line that is passed over, or `None`; what follows it is not looked at.
pub(crate) fn scan(text: &[u8]) -> Option<Control> {
    let mut cursor = Cursor::new(text);
    cursor.eat(b'/');
    if cursor.eat(b'n') {
        cursor.digits();
        if cursor.eat(b'.') {
            cursor.digits();
        }
    }
    if cursor.eat(b'o') { head(&mut cursor).ok() } else { None }
}

/// Compiles the rest of a line whose O has been taken.
pub(crate) fn parse(cursor: &mut Cursor<'_>, names: &mut Names, block: &mut Block) -> Outcome<()> {
    let control = head(cursor)?;
    let mut arguments = 0;
    loop {
        let start = cursor.at();
        match cursor.peek() {
            b'[' => {
                let first_op = block.ops.len();
                Compiler::new(cursor, &mut block.ops, names).bracket()?;
                arguments += 1;
                if arguments > most_arguments(control.keyword) {
                    let message = format!("{} takes no more values", control.label);
                    return fault(Code::BadControl, cursor.since(start), message);
                }
                block.add_late(Slot::Argument, first_op, cursor.since(start));
            }
            b'(' => {
                if cursor.take_to(b')').is_none() {
                    cursor.finish();
                    return fault(Code::UnclosedComment, cursor.since(start), Code::UnclosedComment.title());
                }
            }
            0 | b';' => break,
            _ => return fault(Code::BadControl, cursor.here(), "nothing else may stand in a line with an O word"),
        }
    }
    let needs_one =
        matches!(control.keyword, Keyword::If | Keyword::ElseIf | Keyword::While | Keyword::Repeat) && arguments == 0;
    if needs_one {
        return fault(Code::BadControl, control.at, "a condition or count in brackets is missing");
    }
    block.control = Some(control);
    Ok(())
}

const fn most_arguments(keyword: Keyword) -> usize {
    match keyword {
        Keyword::Call => MOST_ARGUMENTS,
        Keyword::If | Keyword::ElseIf | Keyword::While | Keyword::Repeat | Keyword::Return | Keyword::EndSub => 1,
        _ => 0,
    }
}

/// Label and keyword.
fn head(cursor: &mut Cursor<'_>) -> Outcome<Control> {
    cursor.peek();
    let start = cursor.at().saturating_sub(1);
    let label = if cursor.eat(b'<') {
        let Some(name) = cursor.take_to(b'>') else {
            cursor.finish();
            return fault(Code::NameNotClosed, cursor.since(start), "O< is not followed by a name and >");
        };
        let name = String::from_utf8_lossy(name);
        Label::Name(name.chars().filter(|letter| !letter.is_whitespace()).collect::<String>().to_lowercase().into())
    } else {
        match cursor.digits() {
            (1..=18, number) => Label::Number(number),
            _ => {
                let message = "O is followed by a number or a name in angle brackets; others are not supported yet";
                return fault(Code::BadControl, cursor.since(start), message);
            }
        }
    };
    let Some((_, keyword)) = KEYWORDS.iter().find(|(text, _)| cursor.eat_word(text)) else {
        return fault(
            Code::BadControl,
            cursor.here(),
            format!("{label} is not followed by a keyword such as sub or if"),
        );
    };
    Ok(Control { label, keyword: *keyword, at: cursor.since(start) })
}
