//! Calls of cycles: `CYCLE81(10, 0, 2, -20)`, `MCALL HOLES1(…)`, `MCALL`, and labels `NAME:` (cycles, section 1.1 and
//! 6).
//!
//! Invariant: an accepted call names a known cycle, with no more arguments than it has parameters, and of their types.

use crate::block::{NcBlock, Slot};
use crate::control::{Control, Keyword, Label};
use crate::cycle_call::{CycleArgument, CycleCall};
use crate::diag::{BlockResult, fault};
use crate::error_codes::ErrorCode;
use crate::expr::Compiler;
use crate::lex::Cursor;
use crate::params::Names;
use retrace_cycles::{CycleLibrary, Type};

/// Maximum length of a name in bytes.
const MAX_NAME_LENGTH: usize = 32;

/// Whether the line begins with two letters, which no block of words does.
#[inline]
pub(crate) fn may_begin(cursor: &mut Cursor<'_>) -> bool {
    let first = cursor.peek();
    (first.is_ascii_lowercase() || first == b'_')
        && cursor.peek_next().is_some_and(|next| next.is_ascii_alphabetic() || next == b'_')
}

/// Whether a name begins here: two letters, or a letter and a digit where a cycle's name begins so. A block number and
/// an O word are not names.
#[inline]
pub(crate) fn begins_name(cursor: &mut Cursor<'_>, cycles: Option<&CycleLibrary>) -> bool {
    if may_begin(cursor) {
        return true;
    }
    let first = cursor.peek();
    cycles.is_some_and(CycleLibrary::has_early_digit)
        && first.is_ascii_lowercase()
        && !matches!(first, b'n' | b'o')
        && cursor.peek_next().is_some_and(|next| next.is_ascii_digit())
}

/// Parses a name, in lower case.
fn parse_name(cursor: &mut Cursor<'_>) -> ([u8; MAX_NAME_LENGTH], usize) {
    let (mut name, mut length) = ([0; MAX_NAME_LENGTH], 0);
    while let letter @ (b'a'..=b'z' | b'0'..=b'9' | b'_') = cursor.peek() {
        if let Some(place) = name.get_mut(length) {
            *place = letter;
            length += 1;
        }
        cursor.skip();
    }
    (name, length)
}

/// Parses a label at the beginning of a line, or consumes nothing.
pub(crate) fn parse_label(cursor: &mut Cursor<'_>) -> Option<Box<str>> {
    let before = cursor.clone();
    let (name, length) = parse_name(cursor);
    if cursor.eat(b':') {
        return Some(String::from_utf8_lossy(&name[..length]).into());
    }
    *cursor = before;
    None
}

/// Returns the label of a line, in lower case.
pub(crate) fn label_of(line: &[u8]) -> Option<Box<str>> {
    let mut cursor = Cursor::new(line);
    if !may_begin(&mut cursor) && cursor.eat(b'n') {
        cursor.digits();
    }
    if may_begin(&mut cursor) { parse_label(&mut cursor) } else { None }
}

/// Compiles a call if this line is one. Otherwise returns false and consumes nothing.
pub(crate) fn parse(
    cursor: &mut Cursor<'_>,
    names: &mut Names,
    cycles: Option<&CycleLibrary>,
    block: &mut NcBlock,
) -> BlockResult<bool> {
    let before = cursor.clone();
    let start = cursor.position();
    let (text, length) = parse_name(cursor);
    let is_modal = text.starts_with(b"mcall");
    if &text[..length] == b"mcall" {
        end_of_line(cursor)?;
        block.control =
            Some(Control { label: Label::Calculated, keyword: Keyword::ModalEnd, at: cursor.span_from(start) });
        return Ok(true);
    }
    // A blank between MCALL and the name is ignored, as everywhere.
    let text = if is_modal { &text[5..length] } else { &text[..length] };
    let open = cursor.peek() == b'(';
    let is_alone = matches!(cursor.peek(), 0 | b';');
    let has_early_digit = text.get(1).is_some_and(u8::is_ascii_digit);
    if !open && !is_alone && !is_modal {
        *cursor = before;
        return Ok(false);
    }
    let at = cursor.span_from(start);
    let shown = String::from_utf8_lossy(text).to_uppercase();
    let Some((id, cycle)) = cycles.and_then(|cycles| {
        let id = cycles.find(&shown)?;
        Some((id, cycles.get(id)?))
    }) else {
        // Not the name of a cycle: words of a block followed by a comment, or an invalid block.
        if !is_modal && (is_alone || has_early_digit) {
            *cursor = before;
            return Ok(false);
        }
        return fault(ErrorCode::NoSuchCycle, at, format!("there is no cycle {shown}"));
    };
    let mut arguments = Vec::new();
    if cursor.eat(b'(') {
        parse_arguments(cursor, names, block, &mut arguments, |cursor, index, is_text| {
            let Some(parameter) = cycle.parameters().get(index) else {
                let message = format!("{shown} has {} parameters", cycle.parameters().len());
                return fault(ErrorCode::BadCycleCall, cursor.next_span(), message);
            };
            if is_text.is_some_and(|is_text| is_text != matches!(parameter.value_type, Type::Text(_))) {
                let message = format!("{} of {shown} is {}", parameter.name, parameter.value_type);
                return fault(ErrorCode::BadCycleCall, cursor.next_span(), message);
            }
            Ok(())
        })?;
    }
    end_of_line(cursor)?;
    let keyword = if is_modal { Keyword::ModalCall } else { Keyword::Cycle };
    block.cycle = Some(CycleCall { id, name: shown.as_str().into(), arguments: arguments.into(), at });
    block.control = Some(Control { label: Label::Name(shown.into()), keyword, at });
    Ok(true)
}

/// Parses the arguments after the opening parenthesis. `check` is called for each, with whether it is a text.
fn parse_arguments(
    cursor: &mut Cursor<'_>,
    names: &mut Names,
    block: &mut NcBlock,
    arguments: &mut Vec<CycleArgument>,
    check: impl Fn(&mut Cursor<'_>, usize, Option<bool>) -> BlockResult<()>,
) -> BlockResult<()> {
    loop {
        let start = cursor.position();
        match cursor.peek() {
            b',' | b')' => arguments.push(CycleArgument::Missing),
            b'"' => {
                check(cursor, arguments.len(), Some(true))?;
                cursor.skip();
                let Some(text) = cursor.take_to(b'"') else {
                    cursor.finish();
                    return fault(ErrorCode::BadCycleCall, cursor.span_from(start), "a text is not closed by a quote");
                };
                arguments.push(CycleArgument::Text(String::from_utf8_lossy(text).into()));
            }
            _ => {
                check(cursor, arguments.len(), Some(false))?;
                let first_op = block.ops.len();
                Compiler::new(cursor, &mut block.ops, names).expression()?;
                block.add_deferred(Slot::Argument, first_op, cursor.span_from(start));
                arguments.push(CycleArgument::Number);
            }
        }
        if cursor.eat(b')') {
            if arguments.last() == Some(&CycleArgument::Missing) {
                arguments.pop();
            }
            return Ok(());
        }
        if !cursor.eat(b',') {
            return fault(
                ErrorCode::BadCycleCall,
                cursor.next_span(),
                "arguments are separated by commas and end with a parenthesis",
            );
        }
        check(cursor, arguments.len(), None)?;
    }
}

fn end_of_line(cursor: &mut Cursor<'_>) -> BlockResult<()> {
    loop {
        match cursor.peek() {
            0 | b';' => return Ok(()),
            b'(' if cursor.take_to(b')').is_some() => {}
            _ => {
                return fault(
                    ErrorCode::BadCycleCall,
                    cursor.next_span(),
                    "the call of a cycle must be alone in its block",
                );
            }
        }
    }
}
