//! Lines that control the flow of a program: O words, M98 and M99, calls of cycles.
//!
//! Invariant: two labels are equal where they name the same thing, in whatever case they are written.

use crate::diag::Span;

/// Maximum number of arguments of a call, which become parameters 1 … 30.
pub(crate) const MAX_ARGUMENTS: usize = 30;

/// Label after the O: a number, or a name in angle brackets, in lower case and without blanks.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Label {
    Number(u64),
    Name(Box<str>),
    /// A number that is calculated when the line is executed: the first of its values.
    Calculated,
}

/// Returns the label of a subprogram of this name.
pub(crate) fn subprogram_label(name: &str) -> Label {
    match name.parse() {
        Ok(number) => Label::Number(number),
        Err(_) => Label::Name(plain_name(name.as_bytes())),
    }
}

/// Prefix of the labels of Fanuc loops, before their number.
pub(crate) const MACRO_LOOP: &str = "DO ";

impl Label {
    /// Whether this is the number of a macro loop, which a later loop may reuse.
    pub(crate) fn is_of_macro_loop(&self) -> bool {
        matches!(self, Label::Name(name) if name.starts_with(MACRO_LOOP))
    }
}

impl std::fmt::Display for Label {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Label::Number(number) => write!(formatter, "O{number}"),
            // The number of a macro loop: no name of an O word has a blank.
            Label::Name(name) if name.starts_with(MACRO_LOOP) => formatter.write_str(name),
            Label::Name(name) => write!(formatter, "O<{name}>"),
            Label::Calculated => write!(formatter, "O[…]"),
        }
    }
}

/// Keyword of the line.
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
    /// An O number or name alone: the beginning of a subprogram for M98, or the program's own number or name.
    Start,
    /// M98: the values are P, the number, and L, the number of repeats.
    M98,
    M99,
    /// The call of a cycle.
    Cycle,
    /// MCALL with a cycle.
    ModalCall,
    /// MCALL alone.
    ModalEnd,
    /// GOTO of a Fanuc macro: the number is the label, or the first value.
    GoTo,
    /// IF \[condition\] GOTO: the values are the condition and the number.
    IfGoTo,
    /// IF \[condition\] THEN, with assignments.
    IfThen,
}

impl Keyword {
    /// Returns the keyword as written.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Keyword::Sub => "sub",
            Keyword::EndSub => "endsub",
            Keyword::Call => "call",
            Keyword::Return => "return",
            Keyword::If => "if",
            Keyword::ElseIf => "elseif",
            Keyword::Else => "else",
            Keyword::EndIf => "endif",
            Keyword::While => "while",
            Keyword::EndWhile => "endwhile",
            Keyword::Do => "do",
            Keyword::Repeat => "repeat",
            Keyword::EndRepeat => "endrepeat",
            Keyword::Break => "break",
            Keyword::Continue => "continue",
            Keyword::Start => "start",
            Keyword::M98 => "M98",
            Keyword::M99 => "M99",
            Keyword::Cycle => "cycle",
            Keyword::ModalCall | Keyword::ModalEnd => "MCALL",
            Keyword::GoTo => "GOTO",
            Keyword::IfGoTo => "IF GOTO",
            Keyword::IfThen => "IF THEN",
        }
    }

    /// Whether the keyword, with this label, belongs to Fanuc macros; `None` where both languages have it.
    pub(crate) fn is_of_macros(self, label: &Label) -> Option<bool> {
        match self {
            Keyword::GoTo | Keyword::IfGoTo | Keyword::IfThen => Some(true),
            Keyword::While | Keyword::EndWhile => Some(label.is_of_macro_loop()),
            Keyword::Sub
            | Keyword::EndSub
            | Keyword::Call
            | Keyword::Return
            | Keyword::If
            | Keyword::ElseIf
            | Keyword::Else
            | Keyword::EndIf
            | Keyword::Do
            | Keyword::Repeat
            | Keyword::EndRepeat
            | Keyword::Break
            | Keyword::Continue => Some(false),
            Keyword::Start | Keyword::M98 | Keyword::M99 | Keyword::Cycle | Keyword::ModalCall | Keyword::ModalEnd => {
                None
            }
        }
    }

    /// Whether the keyword opens a region that has an end keyword.
    pub(crate) const fn opens(self) -> bool {
        matches!(self, Keyword::Sub | Keyword::If | Keyword::While | Keyword::Do | Keyword::Repeat)
    }
}

/// The O word of a line, or its M98, M99 or cycle.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Control {
    pub(crate) label: Label,
    pub(crate) keyword: Keyword,
    pub(crate) at: Span,
}

/// Normalises a name for labels: lower case, without blanks.
pub(crate) fn plain_name(name: &[u8]) -> Box<str> {
    let name = String::from_utf8_lossy(name);
    name.chars().filter(|letter| !letter.is_whitespace()).collect::<String>().to_lowercase().into()
}
