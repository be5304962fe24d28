//! Compiled forms as files, in a flat, versioned format.
//!
//! Invariant: a form is loaded only if it is complete, of this compiler version, and of exactly this source. Otherwise
//! the source is compiled again.
//!
//! A file is: 8 bytes of magic, the version (`u32`), the key (`u128`), the length of what follows (`u32`), the unit and
//! its warnings, and the hash of all bytes before it (`u128`). Numbers are little-endian.

use crate::code::{CallSite, Input, Op, Operand, Passed, Unit};
use crate::compile::VERSION;
use crate::diag::Diagnostic;
use crate::error_codes::ErrorCode;
use crate::parameter::{Parameter, Type};
use std::fmt;

const MAGIC: &[u8; 8] = b"RETRCYC\x1a";
const HEAD: usize = 8 + 4 + 16 + 4;
const HASH: usize = 16;

/// Fowler-Noll-Vo hash, variant 1a, of 128 bits. It distinguishes sources; it does not protect against forgery.
pub(crate) fn hash(parts: &[&[u8]]) -> u128 {
    const BASIS: u128 = 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d;
    const PRIME: u128 = 0x0000_0000_0100_0000_0000_0000_0000_013b;
    let mut hash = BASIS;
    for part in parts {
        // The length distinguishes "ab" + "c" from "a" + "bc".
        let length = (part.len() as u64).to_le_bytes();
        for byte in length.iter().chain(*part) {
            hash = (hash ^ u128::from(*byte)).wrapping_mul(PRIME);
        }
    }
    hash
}

/// Returns the key of a source: content, name of the file, version of the compiler.
pub(crate) fn key(source: &[u8], file_name: &str) -> u128 {
    hash(&[source, file_name.as_bytes(), &VERSION.to_le_bytes()])
}

/// Reason why a file has no usable form.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FormError {
    /// Of another source, or of another version: expected after a change.
    Stale,
    /// Damaged, or not a compiled form.
    Torn,
}

impl fmt::Display for FormError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Stale => "it was compiled from another source, or by another version; it is compiled again",
            Self::Torn => "it is damaged, or not a compiled cycle; it is compiled again",
        })
    }
}

impl std::error::Error for FormError {}

/// Serialises a unit and the warnings of its source.
pub(crate) fn write(unit: &Unit, warnings: &[Diagnostic], key: u128) -> Vec<u8> {
    let mut body = Vec::new();
    put_unit(unit, &mut body);
    (warnings.len() as u32).put(&mut body);
    for warning in warnings {
        let code = ErrorCode::ALL.iter().position(|code| *code == warning.code).unwrap_or_default();
        (code as u32).put(&mut body);
        for place in [warning.line, warning.start, warning.end] {
            place.put(&mut body);
        }
        put_text(&warning.message, &mut body);
    }
    let mut out = MAGIC.to_vec();
    VERSION.put(&mut out);
    out.extend_from_slice(&key.to_le_bytes());
    (body.len() as u32).put(&mut out);
    out.append(&mut body);
    let sum = hash(&[&out]);
    out.extend_from_slice(&sum.to_le_bytes());
    out
}

/// Parses the bytes of [`write`] for this key.
pub(crate) fn read(bytes: &[u8], key: u128) -> Result<(Unit, Vec<Diagnostic>), FormError> {
    let whole = bytes.len().checked_sub(HASH).filter(|length| *length >= HEAD).ok_or(FormError::Torn)?;
    let (content, sum) = bytes.split_at(whole);
    if !content.starts_with(MAGIC) || hash(&[content]).to_le_bytes() != sum {
        return Err(FormError::Torn);
    }
    let mut input = Input(&content[MAGIC.len()..]);
    let version = u32::take(&mut input).ok_or(FormError::Torn)?;
    let found = input.bytes(16).and_then(|bytes| bytes.try_into().ok()).map(u128::from_le_bytes);
    if version != VERSION || found != Some(key) {
        return Err(FormError::Stale);
    }
    let length = u32::take(&mut input).ok_or(FormError::Torn)?;
    if length as usize != input.0.len() {
        return Err(FormError::Torn);
    }
    read_form(&mut input).filter(|_| input.0.is_empty()).ok_or(FormError::Torn)
}

fn read_form(input: &mut Input<'_>) -> Option<(Unit, Vec<Diagnostic>)> {
    let unit = read_unit(input)?;
    let warnings = read_list(input, |input| {
        Some(Diagnostic {
            code: *ErrorCode::ALL.get(u32::take(input)? as usize)?,
            line: u32::take(input)?,
            start: u32::take(input)?,
            end: u32::take(input)?,
            message: read_text(input)?,
        })
    })?;
    Some((unit, warnings))
}

fn put_unit(unit: &Unit, out: &mut Vec<u8>) {
    put_text(&unit.name, out);
    unit.saves.put(out);
    unit.is_pattern.put(out);
    unit.slots.put(out);
    unit.contour.is_some().put(out);
    unit.contour.unwrap_or_default().put(out);
    (unit.parameters.len() as u32).put(out);
    for parameter in &unit.parameters {
        put_text(&parameter.name, out);
        parameter.value_type.put(out);
        parameter.default.put(out);
    }
    (unit.texts.len() as u32).put(out);
    for text in &unit.texts {
        put_text(text, out);
    }
    (unit.calls.len() as u32).put(out);
    for call in &unit.calls {
        put_text(&call.name, out);
        for place in [call.line, call.start, call.end] {
            place.put(out);
        }
        (call.arguments.len() as u32).put(out);
        for passed in &call.arguments {
            let (tag, parameter) = match passed {
                Passed::Nothing => (0_u8, 0),
                Passed::Number => (1, 0),
                Passed::Text => (2, 0),
                Passed::Parameter(parameter) => (3, *parameter),
            };
            tag.put(out);
            parameter.put(out);
        }
    }
    (unit.ops.len() as u32).put(out);
    for (op, line) in unit.ops.iter().zip(&unit.lines) {
        op.put(out);
        line.put(out);
    }
}

fn read_unit(input: &mut Input<'_>) -> Option<Unit> {
    let mut unit = Unit {
        name: read_text(input)?,
        saves: bool::take(input)?,
        is_pattern: bool::take(input)?,
        slots: u16::take(input)?,
        ..Unit::default()
    };
    let (has_contour, contour) = (bool::take(input)?, u16::take(input)?);
    unit.contour = has_contour.then_some(contour);
    unit.parameters = read_list(input, |input| {
        Some(Parameter { name: read_text(input)?, value_type: Type::take(input)?, default: f64::take(input)? })
    })?;
    unit.texts = read_list(input, read_text)?;
    unit.calls = read_list(input, |input| {
        Some(CallSite {
            name: read_text(input)?,
            line: u32::take(input)?,
            start: u32::take(input)?,
            end: u32::take(input)?,
            arguments: read_list(input, read_passed)?,
        })
    })?;
    (unit.ops, unit.lines) = read_list(input, |input| Some((Op::take(input)?, u32::take(input)?)))?.into_iter().unzip();
    Some(unit)
}

fn read_passed(input: &mut Input<'_>) -> Option<Passed> {
    let (tag, parameter) = (u8::take(input)?, u16::take(input)?);
    match tag {
        0 => Some(Passed::Nothing),
        1 => Some(Passed::Number),
        2 => Some(Passed::Text),
        3 => Some(Passed::Parameter(parameter)),
        _ => None,
    }
}

fn put_text(text: &str, out: &mut Vec<u8>) {
    (text.len() as u32).put(out);
    out.extend_from_slice(text.as_bytes());
}

fn read_text(input: &mut Input<'_>) -> Option<String> {
    let length = u32::take(input)? as usize;
    String::from_utf8(input.bytes(length)?.to_vec()).ok()
}

/// Reads a count and as many items. No memory is reserved for the count, which may be anything in a damaged file.
fn read_list<T>(input: &mut Input<'_>, item: impl Fn(&mut Input<'_>) -> Option<T>) -> Option<Vec<T>> {
    let count = u32::take(input)?;
    (0..count).map(|_| item(input)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compile::compile;

    const SOURCE: &str = "PROC CY(REAL AA, STRING[9] BB, INT CC=-3) SAVE PATTERN\nDEF REAL DD[2,2]=(1,2,3,4), X\nIF \
        AA>0\n\
        MSG(\"aa\" << AA)\nELSE\nOTHER(AA,,BB)\nENDIF\nDD[1,1]=STOCKPATH(BB,1,2,3,4,5,6,7)\nG1 AX[3]=$P_AD[24] \
        SPOS=5\nM17\n";

    fn form() -> (Unit, Vec<Diagnostic>) {
        let compiled = compile(SOURCE.as_bytes(), "CY");
        (compiled.unit.unwrap_or_else(|| panic!("{:?}", compiled.diagnostics)), compiled.diagnostics)
    }

    #[test]
    fn what_was_written_is_read_again() {
        let (unit, warnings) = form();
        assert_eq!(warnings.len(), 1, "X is an address");
        let bytes = write(&unit, &warnings, 7);
        assert_eq!(read(&bytes, 7), Ok((unit, warnings)));
        assert_eq!(read(&bytes, 8), Err(FormError::Stale));
    }

    #[test]
    fn no_byte_can_be_lost_added_or_changed() {
        let (unit, warnings) = form();
        let bytes = write(&unit, &warnings, 7);
        for length in 0..bytes.len() {
            assert_eq!(read(&bytes[..length], 7), Err(FormError::Torn), "cut to {length}");
        }
        for at in 0..bytes.len() {
            let mut changed = bytes.clone();
            changed[at] ^= 0x10;
            assert_eq!(read(&changed, 7), Err(FormError::Torn), "byte {at}");
        }
        let mut longer = bytes;
        longer.push(0);
        assert_eq!(read(&longer, 7), Err(FormError::Torn));
    }

    #[test]
    fn the_hash_is_the_published_one_for_a_single_part() {
        // FNV-1a of the eight bytes of the length and the part itself; checked against the definition, one step per
        // line.
        let mut expected: u128 = 0x6c62272e07bb014262b821756295c58d;
        for byte in [1_u8, 0, 0, 0, 0, 0, 0, 0, b'a'] {
            expected ^= u128::from(byte);
            expected = expected.wrapping_mul((1 << 88) + 0x13b);
        }
        assert_eq!(hash(&[b"a"]), expected);
        assert_ne!(hash(&[b"ab", b"c"]), hash(&[b"a", b"bc"]));
    }
}
