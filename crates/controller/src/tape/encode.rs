//! The text of a program as the bytes of a tape, for an old control (SHP-34).
//!
//! Invariant: a [`TapeReader`](super::TapeReader) with the same settings reads the text again; what a code does not
//! have is refused with its line, before anything is sent.

use std::fmt;

use retrace_config::{CharacterCode, Parity, SerialSettings};

use super::eia;

/// A character that cannot be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UnsendableCharacter {
    /// Line of the program, from 1.
    pub line: u32,
    /// The character, as its byte.
    pub byte: u8,
    /// Whether the code is EIA RS-244.
    pub is_eia: bool,
}

impl fmt::Display for UnsendableCharacter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let code = if self.is_eia { "EIA RS-244" } else { "ISO 646" };
        let character = self.byte.escape_ascii();
        write!(f, "line {}: {code} does not have the character `{character}`", self.line)
    }
}

impl std::error::Error for UnsendableCharacter {}

/// A program as a tape: leader, percent sign, the blocks, percent sign, EOT or ETX where the settings end a program so,
/// and the trailer. Percent signs and carriage returns of the text are not sent twice, empty lines not at all.
///
/// # Errors
/// A character that the code does not have.
pub fn tape_of(text: &[u8], settings: &SerialSettings) -> Result<Vec<u8>, UnsendableCharacter> {
    let is_eia = settings.code == CharacterCode::Eia;
    let leader = vec![0; settings.leader as usize];
    let mut tape = leader.clone();
    let mut push = |byte: u8, line: u32| -> Result<(), UnsendableCharacter> {
        let refused = UnsendableCharacter { line, byte, is_eia };
        tape.push(if is_eia {
            eia::code(byte.to_ascii_lowercase()).ok_or(refused)?
        } else {
            iso(byte, settings).ok_or(refused)?
        });
        Ok(())
    };
    push(b'%', 1)?;
    push(b'\n', 1)?;
    let mut number = 0;
    for line in text.split(|&byte| byte == b'\n') {
        number += 1;
        let line = line.strip_suffix(b"\r").unwrap_or(line).trim_ascii();
        match line {
            b"" => continue,
            b"%" if number == 1 => continue,
            b"%" => break,
            _ => {}
        }
        for &byte in line.iter().chain(b"\n") {
            push(byte, number)?;
        }
    }
    push(b'%', number)?;
    push(b'\n', number)?;
    // EIA has neither of them
    let ends = [(settings.end.eot, 0x04), (settings.end.etx, 0x03)];
    tape.extend(ends.iter().filter(|(is_sent, _)| *is_sent && !is_eia).filter_map(|(_, byte)| iso(*byte, settings)));
    tape.extend(leader);
    Ok(tape)
}

/// The bits of an ISO character: of seven bits with parity, the parity bit is the eighth.
fn iso(byte: u8, settings: &SerialSettings) -> Option<u8> {
    let is_odd = byte.count_ones() % 2 == 1;
    let has_parity_bit = match (settings.bits, settings.parity) {
        (7, Parity::Even) => is_odd,
        (7, Parity::Odd) => !is_odd,
        _ => false,
    };
    byte.is_ascii().then_some(if has_parity_bit { byte | 0x80 } else { byte })
}

#[cfg(test)]
mod tests {
    use super::super::{ReceivedByte, TapeReader};
    use super::*;
    use proptest::prelude::*;
    use retrace_config::ProgramEnds;

    fn settings(bits: u8, parity: Parity, code: CharacterCode) -> SerialSettings {
        let end = ProgramEnds { percent: true, ..ProgramEnds::default() };
        SerialSettings { bits, parity, code, end, leader: 20, ..SerialSettings::default() }
    }

    fn read(tape: &[u8], settings: SerialSettings) -> String {
        let (mut reader, mut text) = (TapeReader::new(settings), Vec::new());
        for &byte in tape.iter().take_while(|_| true) {
            if !reader.has_ended() {
                reader.push(ReceivedByte::Byte(byte), &mut text).expect("undamaged");
            }
        }
        assert!(reader.has_ended());
        String::from_utf8(text).expect("text")
    }

    proptest! {
        /// What is sent is what our own receiver reads, in every format and code.
        #[test]
        fn a_receiver_reads_what_is_sent(
            lines in prop::collection::vec("[A-Z][0-9.+-]{1,12}( [XYZ][0-9.-]{1,8}){0,3}", 1..40),
            (bits, parity) in prop::sample::select(vec![
                (7, Parity::Even), (7, Parity::Odd), (8, Parity::None), (7, Parity::None),
            ]),
            is_eia in any::<bool>(),
            newline in prop::sample::select(vec!["\n", "\r\n"]),
        ) {
            let code = if is_eia { CharacterCode::Eia } else { CharacterCode::Iso };
            let settings = settings(bits, parity, code);
            let text = lines.join(newline);
            let tape = tape_of(text.as_bytes(), &settings).expect("it can be sent");
            let expected = format!("%\n{}\n%\n", lines.join("\n"));
            let found = read(&tape, settings);
            let is_same = if is_eia { found.eq_ignore_ascii_case(&expected) } else { found == expected };
            prop_assert!(is_same, "{found:?} {expected:?}");
            let framed = format!("%{newline}{text}{newline}%{newline}behind it");
            prop_assert_eq!(tape_of(framed.as_bytes(), &settings).expect("it can be sent"), tape);
        }
    }

    #[test]
    fn what_a_code_does_not_have_is_refused_with_its_line() {
        let eia = settings(8, Parity::None, CharacterCode::Eia);
        let refused = tape_of(b"G0 X1\n#1 = 2\n", &eia).expect_err("EIA has no #");
        assert_eq!((refused.line, refused.byte), (2, b'#'));
        let iso = settings(7, Parity::Even, CharacterCode::Iso);
        assert_eq!(tape_of("G0\n(\u{e4})\n".as_bytes(), &iso).expect_err("no umlaut").line, 2);
        assert!(tape_of(b"#1 = [2 + 3]\n", &iso).is_ok());
    }
}
