//! The control words of Fanuc's custom macros: `WHILE [condition] DO1` … `END1`, `GOTO 100`, `IF [condition] GOTO 100`
//! and `IF [condition] THEN #1=2`.
//!
//! Invariant: a condition is the first value of its line, and the number of a GOTO the last, so that both can be
//! calculated.

use crate::assignment::assignment;
use crate::block::{NcBlock, Slot};
use crate::control::{Control, Keyword, Label, MACRO_LOOP};
use crate::control_parser::comment;
use crate::diag::{BlockResult, fault};
use crate::error_codes::ErrorCode;
use crate::expr::Compiler;
use crate::lex::Cursor;
use crate::params::Names;

/// Compiles a line that begins with one of these words. Otherwise returns false and consumes nothing.
pub(crate) fn parse(cursor: &mut Cursor<'_>, names: &mut Names, block: &mut NcBlock) -> BlockResult<bool> {
    let (start, before) = (cursor.position(), cursor.clone());
    let opens_bracket = |cursor: &mut Cursor<'_>| cursor.peek() == b'[';
    if cursor.eat_word(b"while") && opens_bracket(cursor) {
        parse_condition(cursor, names, block)?;
        if !cursor.eat_word(b"do") {
            return wrong(cursor, start, "WHILE is followed by a condition in brackets and DO");
        }
        return parse_loop_number(cursor, start, Keyword::While, block);
    }
    cursor.clone_from(&before);
    if cursor.eat_word(b"end") && cursor.peek().is_ascii_digit() {
        return parse_loop_number(cursor, start, Keyword::EndWhile, block);
    }
    cursor.clone_from(&before);
    if cursor.eat_word(b"goto") && matches!(cursor.peek(), b'0'..=b'9' | b'#' | b'[') {
        return parse_goto_target(cursor, names, start, Keyword::GoTo, block);
    }
    cursor.clone_from(&before);
    if cursor.eat_word(b"if") && opens_bracket(cursor) {
        parse_condition(cursor, names, block)?;
        if cursor.eat_word(b"goto") {
            return parse_goto_target(cursor, names, start, Keyword::IfGoTo, block);
        }
        if !cursor.eat_word(b"then") {
            return wrong(cursor, start, "IF is followed by a condition in brackets and GOTO or THEN");
        }
        return parse_then(cursor, names, start, block);
    }
    cursor.clone_from(&before);
    let stands_alone = |cursor: &mut Cursor<'_>| cursor.digits().0 == 1 && cursor.peek() == 0;
    if cursor.eat_word(b"do") && matches!(cursor.peek(), b'1'..=b'3') && stands_alone(cursor) {
        return wrong(cursor, start, "DO must follow WHILE and its condition");
    }
    *cursor = before;
    Ok(false)
}

fn wrong<T>(cursor: &Cursor<'_>, start: usize, message: &str) -> BlockResult<T> {
    fault(ErrorCode::MacroControl, cursor.span_from(start), message)
}

/// Compiles a condition in brackets: the first value of the line.
fn parse_condition(cursor: &mut Cursor<'_>, names: &mut Names, block: &mut NcBlock) -> BlockResult<()> {
    let (first_op, from) = (block.ops.len(), cursor.position());
    Compiler::new(cursor, &mut block.ops, names).bracket()?;
    block.add_deferred(Slot::Argument, first_op, cursor.span_from(from));
    Ok(())
}

/// Parses the number after DO or END.
fn parse_loop_number(
    cursor: &mut Cursor<'_>,
    start: usize,
    keyword: Keyword,
    block: &mut NcBlock,
) -> BlockResult<bool> {
    let number = match cursor.digits() {
        (1, number @ 1..=3) => number,
        _ => return wrong(cursor, start, "DO and END are followed by 1, 2 or 3"),
    };
    let at = cursor.span_from(start);
    parse_end_of_line(cursor)?;
    block.control = Some(Control { label: Label::Name(format!("{MACRO_LOOP}{number}").into()), keyword, at });
    Ok(true)
}

/// Compiles the line number after GOTO: written, or calculated.
fn parse_goto_target(
    cursor: &mut Cursor<'_>,
    names: &mut Names,
    start: usize,
    keyword: Keyword,
    block: &mut NcBlock,
) -> BlockResult<bool> {
    let (first_op, from) = (block.ops.len(), cursor.position());
    let mut ahead = cursor.clone();
    let written = match ahead.digits() {
        (1..=18, number) if ahead.peek() != b'.' => Some(number),
        _ => None,
    };
    match cursor.peek() {
        b'0'..=b'9' | b'#' | b'[' => Compiler::new(cursor, &mut block.ops, names).value()?,
        _ => return wrong(cursor, start, "GOTO is followed by the number of a line, as in GOTO 100"),
    }
    block.add_deferred(Slot::Argument, first_op, cursor.span_from(from));
    let at = cursor.span_from(start);
    parse_end_of_line(cursor)?;
    block.control = Some(Control { label: written.map_or(Label::Calculated, Label::Number), keyword, at });
    Ok(true)
}

/// Compiles the assignments after THEN.
fn parse_then(cursor: &mut Cursor<'_>, names: &mut Names, start: usize, block: &mut NcBlock) -> BlockResult<bool> {
    if cursor.peek() != b'#' {
        return wrong(cursor, start, "THEN is followed by an assignment, as in IF [#1 GT 5] THEN #1=5");
    }
    while cursor.peek() == b'#' {
        assignment(cursor, names, block)?;
    }
    let at = cursor.span_from(start);
    parse_end_of_line(cursor)?;
    block.control = Some(Control { label: Label::Calculated, keyword: Keyword::IfThen, at });
    Ok(true)
}

/// Parses comments up to the end of the line.
fn parse_end_of_line(cursor: &mut Cursor<'_>) -> BlockResult<()> {
    loop {
        let start = cursor.position();
        match cursor.peek() {
            b'(' => comment(cursor, start)?,
            0 | b';' => return Ok(()),
            _ => return fault(ErrorCode::MacroControl, cursor.next_span(), "nothing else is allowed in this line"),
        }
    }
}
