//! Compilation of the text of one line to its block.
//!
//! Invariant: every character of an accepted line has a meaning. A refused line is reported with the position of the
//! first character that has none.

use crate::assignment::assignment;
use crate::block::{NcBlock, Slot, Words};
use crate::block_number::BlockNumber;
use crate::bytes::{byte_order_mark, is_plain, shown};
use crate::comment::{Comment, refuse_python};
use crate::control::Keyword;
use crate::control_parser;
use crate::cycle_call_parser;
use crate::diag::{BlockResult, Span, fault};
use crate::error_codes::ErrorCode;
use crate::expr::{Compiler, Operand};
use crate::lex::Cursor;
use crate::line_split::MAX_LINE_LENGTH;
use crate::macro_words;
use crate::material_comment::MaterialComment;
use crate::params::Names;
use crate::pose::{Axis, AxisSet};
use crate::setup::Setup;
use retrace_cycles::CycleLibrary;
use std::sync::Arc;

/// Compiler of lines, one after another.
#[derive(Clone, Debug)]
pub(crate) struct LineReader {
    pub(crate) axes: AxisSet,
    pub(crate) block_delete: bool,
    pub(crate) names: Names,
    /// Cycles that a program may call.
    pub(crate) cycles: Option<Arc<CycleLibrary>>,
    /// Whether M98, M99 and an O number alone are refused.
    pub(crate) disable_fanuc_subs: bool,
    /// Whether the machine has a material table, so that comments may declare materials.
    pub(crate) has_materials: bool,
    /// Line compiled last.
    pub(crate) block: NcBlock,
}

impl LineReader {
    pub(crate) fn new(axes: AxisSet, block_delete: bool, cycles: Option<Arc<CycleLibrary>>) -> LineReader {
        let (names, block) = (Names::default(), NcBlock::default());
        LineReader { axes, block_delete, names, cycles, disable_fanuc_subs: false, has_materials: false, block }
    }

    /// Creates the compiler for an interpreter with this setup, with the parameter names known so far.
    pub(crate) fn of(setup: &Setup) -> LineReader {
        let known = setup.snapshot.as_ref().map(|snapshot| snapshot.names.clone()).unwrap_or_default();
        let names = known.with_fixed(&setup.fixed_values).with_hal(setup.cutting.is_some());
        let reader = LineReader::new(setup.axes, setup.block_delete, setup.cycles.clone());
        let has_materials = setup.cutting.is_some();
        LineReader { names, disable_fanuc_subs: setup.disable_fanuc_subs, has_materials, ..reader }
    }

    /// Compiles a line; false when it is deleted.
    ///
    /// # Errors
    /// The line has an error; the block must not be used then.
    #[inline]
    pub(crate) fn read(&mut self, text: &[u8]) -> BlockResult<bool> {
        if self.block_delete && has_delete_mark(text) {
            self.block.clear();
            return Ok(false);
        }
        parse(text, self.axes, &mut self.names, self.cycles.as_deref(), &mut self.block)?;
        if self.has_materials {
            self.compile_material_comment(text)?;
        }
        if self.disable_fanuc_subs
            && let Some(control) = &self.block.control
            && matches!(control.keyword, Keyword::M98 | Keyword::M99 | Keyword::Start)
        {
            return fault(ErrorCode::FanucSubsDisabled, control.at, ErrorCode::FanucSubsDisabled.title());
        }
        Ok(true)
    }
}

impl LineReader {
    /// Replaces a comment that declares a material.
    #[cold]
    fn compile_material_comment(&mut self, text: &[u8]) -> BlockResult<()> {
        let Some(Comment::Plain(comment)) = &self.block.comment else { return Ok(()) };
        let start = text.iter().rposition(|byte| *byte == b'(').unwrap_or_default();
        let end = text.iter().rposition(|byte| *byte == b')').map_or(text.len(), |end| end + 1);
        if let Some(material) = MaterialComment::compile(comment, Span::new(start, end.max(start)))? {
            self.block.comment = Some(Comment::Material(Arc::new(material)));
        }
        Ok(())
    }

    /// Refuses U and W words of axes that the machine does not have.
    #[cold]
    pub(crate) fn check_increments(&self, words: &Words) -> BlockResult<()> {
        for axis in [Axis::U, Axis::W] {
            let letter = axis.letter().to_ascii_lowercase();
            if words.has(letter) && !self.axes.has(axis) {
                let message = format!("the machine has no axis {}", char::from(axis.letter()));
                return fault(ErrorCode::AxisMissing, words.span(letter), message);
            }
        }
        Ok(())
    }
}

/// Compiles a line into `block`, which is cleared first.
fn parse(
    text: &[u8],
    axes: AxisSet,
    names: &mut Names,
    cycles: Option<&CycleLibrary>,
    block: &mut NcBlock,
) -> BlockResult<()> {
    block.clear();
    check_text(text)?;
    let mut cursor = Cursor::new(text);
    cursor.eat(b'/');
    if !cycle_call_parser::begins_name(&mut cursor, cycles) {
        block_number(&mut cursor, block)?;
    }
    if cycle_call_parser::begins_name(&mut cursor, cycles) {
        if macro_words::parse(&mut cursor, names, block)? {
            return Ok(());
        }
        cycle_call_parser::parse_label(&mut cursor);
        if cycle_call_parser::begins_name(&mut cursor, cycles)
            && cycle_call_parser::parse(&mut cursor, names, cycles, block)?
        {
            return Ok(());
        }
        block_number(&mut cursor, block)?;
    }
    if cursor.eat(b'o') {
        return control_parser::parse(&mut cursor, names, block);
    }
    if cursor.peek() == b'm'
        && let Some(keyword) = control_parser::eat_m98_m99(&mut cursor)
    {
        return control_parser::parse_fanuc(keyword, &mut cursor, names, block);
    }
    loop {
        let letter = cursor.peek();
        let start = cursor.position();
        match letter {
            0 => return Ok(()),
            b'a'..=b'z' | b'@' | b'^' | b'$' => word(letter, &mut cursor, axes, names, block)?,
            b'#' => assignment(&mut cursor, names, block)?,
            b'(' => comment(&mut cursor, names, block)?,
            b';' => {
                let rest = text.get(start + 1..).unwrap_or_default();
                return refuse_python(&shown(rest), Span::new(start, text.len()));
            }
            _ => return bad_character(&mut cursor, start),
        }
    }
}

/// Message of the expression compiler where neither a function nor a similar name begins.
const NO_FUNCTION: &str = "no function begins here";

/// Whether block delete applies to a line: its first character is a slash.
fn has_delete_mark(text: &[u8]) -> bool {
    Cursor::new(text).peek() == b'/'
}

#[inline]
fn check_text(text: &[u8]) -> BlockResult<()> {
    if text.len() > MAX_LINE_LENGTH {
        let message = format!("the line has more than {MAX_LINE_LENGTH} bytes");
        return fault(ErrorCode::LineTooLong, Span::new(MAX_LINE_LENGTH, MAX_LINE_LENGTH + 1), message);
    }
    if is_plain(text) { Ok(()) } else { check_unusual(text) }
}

#[cold]
fn check_unusual(text: &[u8]) -> BlockResult<()> {
    if std::str::from_utf8(text).is_err()
        && let Some(at) = first_high_byte_outside_comments(text)
    {
        return fault(
            ErrorCode::NotText,
            Span::new(at, at + 1),
            format!("byte {:#04x} is not valid UTF-8 here", text[at]),
        );
    }
    match text.iter().position(|byte| byte.is_ascii_control() && !matches!(byte, b'\t' | b'\r')) {
        Some(at) => fault(ErrorCode::NotText, Span::new(at, at + 1), format!("control character {:#04x}", text[at])),
        None => Ok(()),
    }
}

/// Returns the first byte of 0x80 and above outside of comments. Comments may be in any 8-bit character set.
fn first_high_byte_outside_comments(text: &[u8]) -> Option<usize> {
    let mut is_open = false;
    for (at, byte) in text.iter().enumerate().skip(byte_order_mark(text)) {
        match byte {
            b';' if !is_open => return None,
            b'(' => is_open = true,
            b')' => is_open = false,
            0x80.. if !is_open => return Some(at),
            _ => {}
        }
    }
    None
}

#[cold]
fn bad_character(cursor: &mut Cursor<'_>, start: usize) -> BlockResult<()> {
    let at = cursor.next_span();
    if cursor.peek() == b',' && follows_digit(cursor, start) {
        return fault(ErrorCode::DecimalComma, at, "a comma is not a decimal point");
    }
    // U+FEFF, U+200B to U+200F, and the no-break space.
    let rest = cursor.remaining();
    if rest.starts_with(b"\xef\xbb\xbf") || rest.starts_with(b"\xe2\x80") || rest.starts_with(b"\xc2\xa0") {
        return fault(ErrorCode::HiddenMark, at, ErrorCode::HiddenMark.title());
    }
    let what = match cursor.peek() {
        b'/' => "a slash deletes a block only at its beginning",
        b'%' => "a percent sign must be alone in its line, at the beginning and the end of a program",
        b'=' => "an equals sign must follow a parameter at the beginning of an assignment",
        b')' => "this parenthesis closes no comment",
        _ => ErrorCode::BadCharacter.title(),
    };
    fault(ErrorCode::BadCharacter, Span::new(start, at.end as usize), what)
}

/// Parses the N word at the beginning of the line. A fraction is allowed and ignored.
fn block_number(cursor: &mut Cursor<'_>, block: &mut NcBlock) -> BlockResult<()> {
    if !cursor.eat(b'n') {
        return Ok(());
    }
    let start = cursor.position() - 1;
    let (digits, value) = cursor.digits();
    if digits == 0 || digits > 18 {
        let at = cursor.span_from(start);
        return fault(ErrorCode::BadBlockNumber, at, "N is followed by 1 to 18 digits");
    }
    if cursor.eat(b'.') {
        cursor.digits();
    }
    block.number = Some(BlockNumber::new(value, digits as u8));
    Ok(())
}

fn word(letter: u8, cursor: &mut Cursor<'_>, axes: AxisSet, names: &mut Names, block: &mut NcBlock) -> BlockResult<()> {
    let start = cursor.position();
    cursor.skip();
    match letter {
        b'n' => {
            return fault(
                ErrorCode::BadBlockNumber,
                cursor.span_from(start),
                "N is allowed once, at the beginning of the block",
            );
        }
        b'o' if follows_digit(cursor, start) => {
            return fault(ErrorCode::LetterO, cursor.span_from(start), "the letter O follows a digit; did you mean 0?");
        }
        b'o' => {
            return fault(
                ErrorCode::BadControl,
                cursor.span_from(start),
                "an O word must be at the beginning of its line",
            );
        }
        _ => {}
    }
    let first_op = block.ops.len();
    let value_at = cursor.next_span().start;
    let operand = match Compiler::new(cursor, &mut block.ops, names).operand() {
        Ok(operand) => operand,
        Err(found) => return Err(named(found, letter, start, value_at, cursor)),
    };
    let at = cursor.span_from(start);
    // U and W are increments in a profile of turning, whatever axes exist; executing the block checks them.
    if let Some(axis) = Axis::of_letter(letter)
        && !axes.has(axis)
        && !matches!(axis, Axis::U | Axis::W)
    {
        let name = char::from(axis.letter());
        return fault(ErrorCode::AxisMissing, at, format!("the machine has no axis {name}"));
    }
    let slot = match letter {
        b'g' => Slot::G,
        b'm' => Slot::M,
        _ => {
            block.words.claim(letter, at)?;
            Slot::Word(letter)
        }
    };
    match (operand, slot) {
        (Operand::Constant(value), Slot::G) => block.words.add_g(value, at),
        (Operand::Constant(value), Slot::M) => block.words.add_m(value, at),
        (Operand::Constant(value), _) => block.words.fill(letter, value, at),
        (Operand::Calculated, slot) => {
            block.add_deferred(slot, first_op, at);
            Ok(())
        }
    }
}

/// Adds to the error of a missing number the word letter that it belongs to.
#[cold]
fn named(
    mut found: Box<crate::diag::BlockError>,
    letter: u8,
    start: usize,
    value_at: u32,
    cursor: &mut Cursor<'_>,
) -> Box<crate::diag::BlockError> {
    let is_at_value = value_at == found.span.start && found.code == ErrorCode::UnknownFunction;
    if is_at_value && found.message == NO_FUNCTION {
        let name = char::from(letter.to_ascii_uppercase());
        if cursor.peek() == b'o' {
            found.code = ErrorCode::LetterO;
            found.message = format!("{name} is followed by the letter O; did you mean 0?");
        } else {
            found.code = ErrorCode::NumberMissing;
            found.message = format!("{name} is not followed by a value");
        }
        found.span.start = start as u32;
        return found;
    }
    if found.code == ErrorCode::NumberMissing && found.span.start as usize <= start + 1 {
        found.message = format!("{} is not followed by a value", char::from(letter.to_ascii_uppercase()));
        found.span.start = start as u32;
    }
    found
}

/// Whether the character before this position is a digit.
fn follows_digit(cursor: &Cursor<'_>, at: usize) -> bool {
    cursor.byte(at.wrapping_sub(1)).is_some_and(|byte| byte.is_ascii_digit())
}

/// Compiles `(comment)`; of several in one block the last is passed on.
fn comment(cursor: &mut Cursor<'_>, names: &mut Names, block: &mut NcBlock) -> BlockResult<()> {
    let start = cursor.position();
    cursor.skip();
    let Some(text) = cursor.take_to(b')') else {
        cursor.finish();
        return fault(ErrorCode::UnclosedComment, cursor.span_from(start), ErrorCode::UnclosedComment.title());
    };
    if let Some(inner) = text.iter().position(|byte| *byte == b'(') {
        let at = Span::new(start + 1 + inner, start + 2 + inner);
        return fault(ErrorCode::NestedComment, at, ErrorCode::NestedComment.title());
    }
    block.comment = Comment::compile(text, cursor.span_from(start), names)?;
    Ok(())
}
