//! Parser of the lines that control the flow of a program: O words, M98 and M99, calls of cycles.
//!
//! Invariant: such a line holds its label, one keyword, values in brackets, and comments; nothing else.

use crate::block::{NcBlock, Slot};
use crate::control::{Control, Keyword, Label, MAX_ARGUMENTS, plain_name};
use crate::cycle_call_parser;
use crate::diag::{BlockResult, fault};
use crate::error_codes::ErrorCode;
use crate::expr::{Compiler, OpKind};
use crate::lex::Cursor;
use crate::params::Names;
use retrace_cycles::CycleLibrary;

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
        _ => cycle_call_parser::begins_name(&mut cursor, cycles),
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
