//! Lines that control the flow of a program: O words, M98 and M99, calls of cycles.
//!
//! Invariant: such a line holds its label, one keyword, values in brackets, and comments; nothing else.

use crate::block::{NcBlock, Slot};
use crate::cycle_call;
use crate::diag::{BlockResult, Span, fault};
use crate::error_codes::ErrorCode;
use crate::expr::{Compiler, OpKind};
use crate::lex::Cursor;
use crate::params::Names;
use retrace_cycles::CycleLibrary;

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

/// Keywords as written. A longer one comes before one that is its prefix.
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

/// The O word of a line, or its M98, M99 or cycle.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Control {
    pub(crate) label: Label,
    pub(crate) keyword: Keyword,
    pub(crate) at: Span,
}

/// Whether a line may be a control line, judging by its first characters alone.
#[inline]
pub(crate) fn may_be(text: &[u8], cycles: Option<&CycleLibrary>) -> bool {
    let mut cursor = Cursor::new(text);
    if matches!(cursor.peek(), b'n' | b'/') {
        skip_line_prefix(&mut cursor);
    }
    match cursor.peek() {
        b'o' => true,
        b'm' if eat_m98_m99(&mut cursor).is_some() => true,
        _ => cycle_call::begins_name(&mut cursor, cycles),
    }
}

/// Skips a slash and an N word.
fn skip_line_prefix(cursor: &mut Cursor<'_>) {
    cursor.eat(b'/');
    if cursor.eat(b'n') {
        cursor.digits();
        if cursor.eat(b'.') {
            cursor.digits();
        }
    }
}

/// Parses M98 or M99, or consumes nothing.
pub(crate) fn eat_m98_m99(cursor: &mut Cursor<'_>) -> Option<Keyword> {
    let before = cursor.clone();
    if cursor.eat(b'm') {
        let digits = cursor.digits();
        if cursor.peek() != b'.' {
            match digits.1 {
                98 if digits.0 > 0 => return Some(Keyword::M98),
                99 => return Some(Keyword::M99),
                _ => {}
            }
        }
    }
    *cursor = before;
    None
}

/// Compiles the rest of a line after its O.
pub(crate) fn parse(cursor: &mut Cursor<'_>, names: &mut Names, block: &mut NcBlock) -> BlockResult<()> {
    let control = parse_head(cursor, names, block)?;
    let given = usize::from(control.label == Label::Calculated);
    let arguments = parse_values(cursor, names, block, &control, given)?;
    let needs_one =
        matches!(control.keyword, Keyword::If | Keyword::ElseIf | Keyword::While | Keyword::Repeat) && arguments == 0;
    if needs_one {
        return fault(ErrorCode::BadControl, control.at, "a condition or count in brackets is missing");
    }
    block.control = Some(control);
    Ok(())
}

/// Parses the values in brackets after a keyword, of which `given` are parsed already. Returns their number.
fn parse_values(
    cursor: &mut Cursor<'_>,
    names: &mut Names,
    block: &mut NcBlock,
    control: &Control,
    given: usize,
) -> BlockResult<usize> {
    let mut arguments = given;
    loop {
        let start = cursor.position();
        match cursor.peek() {
            b'[' => {
                let first_op = block.ops.len();
                Compiler::new(cursor, &mut block.ops, names).bracket()?;
                arguments += 1;
                if arguments > given + max_arguments(control.keyword) {
                    let message = format!("{} accepts no more values", control.label);
                    return fault(ErrorCode::BadControl, cursor.span_from(start), message);
                }
                block.add_deferred(Slot::Argument, first_op, cursor.span_from(start));
            }
            b'(' => comment(cursor, start)?,
            0 | b';' => return Ok(arguments),
            _ => {
                return fault(
                    ErrorCode::BadControl,
                    cursor.next_span(),
                    "nothing else is allowed in a line with an O word",
                );
            }
        }
    }
}

pub(crate) fn comment(cursor: &mut Cursor<'_>, start: usize) -> BlockResult<()> {
    if cursor.take_to(b')').is_some() {
        return Ok(());
    }
    cursor.finish();
    fault(ErrorCode::UnclosedComment, cursor.span_from(start), ErrorCode::UnclosedComment.title())
}

/// Compiles the rest of a line after its M98 or M99.
pub(crate) fn parse_fanuc(
    keyword: Keyword,
    cursor: &mut Cursor<'_>,
    names: &mut Names,
    block: &mut NcBlock,
) -> BlockResult<()> {
    let at = cursor.span_from(0);
    let mut label = None;
    let mut repeats = None;
    loop {
        let start = cursor.position();
        let letter = cursor.peek();
        match letter {
            0 | b';' => break,
            b'(' => comment(cursor, start)?,
            b'p' | b'l' if keyword == Keyword::M98 => {
                cursor.skip();
                let first_op = block.ops.len();
                Compiler::new(cursor, &mut block.ops, names).value()?;
                let place = if letter == b'p' { &mut label } else { &mut repeats };
                if place.replace((first_op, block.ops.len(), cursor.span_from(start))).is_some() {
                    return fault(ErrorCode::WordTwice, cursor.span_from(start), "M98 takes one P word and one L word");
                }
            }
            _ => {
                let message = format!("nothing else is allowed in a line with {}", keyword.name());
                return fault(ErrorCode::BadControl, cursor.next_span(), message);
            }
        }
    }
    if keyword == Keyword::M99 {
        block.control = Some(Control { label: Label::Calculated, keyword, at });
        return Ok(());
    }
    let Some((first, end, place)) = label else {
        return fault(ErrorCode::WordMissing, at, "M98 needs a P word: the number of the subprogram");
    };
    let label = match block.ops.get(first..end) {
        Some([one]) => match one.kind {
            OpKind::Constant(number) if number >= 0.0 && number.fract() == 0.0 => Label::Number(number as u64),
            _ => Label::Calculated,
        },
        _ => Label::Calculated,
    };
    block.add_deferred_range(Slot::Argument, first, end, place);
    if let Some((first, end, place)) = repeats {
        block.add_deferred_range(Slot::Argument, first, end, place);
    }
    block.control = Some(Control { label, keyword, at });
    Ok(())
}

const fn max_arguments(keyword: Keyword) -> usize {
    match keyword {
        Keyword::Call => MAX_ARGUMENTS,
        Keyword::If | Keyword::ElseIf | Keyword::While | Keyword::Repeat | Keyword::Return | Keyword::EndSub => 1,
        _ => 0,
    }
}

/// Parses label and keyword.
fn parse_head(cursor: &mut Cursor<'_>, names: &mut Names, block: &mut NcBlock) -> BlockResult<Control> {
    let next = cursor.peek();
    let start = cursor.position().saturating_sub(1);
    let label = match next {
        b'<' => {
            cursor.skip();
            let Some(name) = cursor.take_to(b'>') else {
                cursor.finish();
                return fault(
                    ErrorCode::BadControl,
                    cursor.span_from(start),
                    "the name after O< has no >; write O<name> call",
                );
            };
            Label::Name(plain_name(name))
        }
        b'[' | b'#' => {
            let (first_op, from) = (block.ops.len(), cursor.position());
            Compiler::new(cursor, &mut block.ops, names).value()?;
            block.add_deferred(Slot::Argument, first_op, cursor.span_from(from));
            Label::Calculated
        }
        _ => match cursor.digits() {
            (1..=18, number) => {
                // A decimal point followed by zeros only is ignored.
                if cursor.eat(b'.') && cursor.digits().1 != 0 {
                    return fault(
                        ErrorCode::BadControl,
                        cursor.span_from(start),
                        "O must be followed by a whole number",
                    );
                }
                Label::Number(number)
            }
            _ => {
                let message = "O is followed by a number, a name in angle brackets or a value";
                return fault(ErrorCode::BadControl, cursor.span_from(start), message);
            }
        },
    };
    let keyword = match KEYWORDS.iter().find(|(text, _)| cursor.eat_word(text)) {
        Some((_, keyword)) => *keyword,
        None if label != Label::Calculated && matches!(cursor.peek(), 0 | b'(' | b';') => Keyword::Start,
        None => {
            let message = format!("{label} is not followed by a keyword such as sub or if");
            return fault(ErrorCode::BadControl, cursor.next_span(), message);
        }
    };
    if label == Label::Calculated && keyword != Keyword::Call {
        let message = format!("only a call may calculate its number, not {}", keyword.name());
        return fault(ErrorCode::BadControl, cursor.span_from(start), message);
    }
    Ok(Control { label, keyword, at: cursor.span_from(start) })
}

/// Normalises a name for labels: lower case, without blanks.
pub(crate) fn plain_name(name: &[u8]) -> Box<str> {
    let name = String::from_utf8_lossy(name);
    name.chars().filter(|letter| !letter.is_whitespace()).collect::<String>().to_lowercase().into()
}
