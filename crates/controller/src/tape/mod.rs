//! Programs as serial senders transmit them: punched-tape framing and codes (SHP-32, SHP-33).
//!
//! Invariant: the output is the text of one program, in lines that end with a line feed, from its first percent sign
//! on; behind a damaged character there is no output.

mod eia;
mod encode;

pub use encode::{UnsendableCharacter, tape_of};

use std::fmt;

use retrace_config::{CharacterCode, Parity, SerialSettings};
use retrace_gcode::program_end_of;

/// Bytes within which the first end of block has to occur.
const MAX_LEADER: usize = 1 << 16;

/// A character from a serial port, or an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReceivedByte {
    /// A character, as its bits arrived.
    Byte(u8),
    /// A character with a parity or framing error.
    Damaged,
}

/// Reason why a program cannot be read any further.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TapeError {
    /// A character has a parity or framing error.
    Damaged,
    /// A code that EIA RS-244 does not have.
    UnknownEiaCode(u8),
    /// No end of block at the beginning.
    NoEndOfBlock,
}

impl fmt::Display for TapeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Damaged => write!(
                f,
                "E2305: a character with wrong parity or framing arrived; check the cable, and baud and format on \
                    both sides"
            ),
            Self::UnknownEiaCode(code) => write!(
                f,
                "E2307: code {code:02X}h has no meaning in EIA RS-244, which has no brackets and no #: send macros in \
                    ISO code"
            ),
            Self::NoEndOfBlock => {
                write!(
                    f,
                    "E2308: no end of block in the first {MAX_LEADER} characters; check baud, format and code on both \
                        sides"
                )
            }
        }
    }
}

impl std::error::Error for TapeError {}

/// Conversion from bits to characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TapeCode {
    /// Not known yet: the first end of block decides.
    Undecided,
    /// Eight bits.
    Plain,
    /// Seven bits; the eighth is ignored.
    SevenBits,
    /// Seven bits and a parity bit that makes the number of ones even or odd.
    Parity {
        /// Whether the number of ones is odd.
        odd: bool,
    },
    /// EIA RS-244.
    Eia,
}

/// End of the line before, as far as the next characters may belong to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LineEnd {
    /// A character of the next line has arrived.
    None,
    /// By CR; a LF belongs to it.
    Return,
    /// By LF or CR LF; CRs belong to it.
    Feed,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TapePhase {
    Leader,
    Program,
    Ended,
}

/// Reads one program.
#[derive(Clone, Debug)]
pub struct TapeReader {
    settings: SerialSettings,
    decoding: TapeCode,
    phase: TapePhase,
    /// What was received before the code was known.
    held: Vec<ReceivedByte>,
    line_end: LineEnd,
    /// The line so far; a line longer than any block is stored in part.
    line: Vec<u8>,
    /// Whether a character of the program has arrived.
    has_begun: bool,
}

impl TapeReader {
    /// Creates a reader before the leader.
    #[must_use]
    pub fn new(settings: SerialSettings) -> Self {
        let decoding = match (settings.code, settings.bits, settings.parity) {
            (CharacterCode::Eia, ..) => TapeCode::Eia,
            (CharacterCode::Auto, ..) | (CharacterCode::Iso, 8, Parity::None) => TapeCode::Undecided,
            (CharacterCode::Iso, bits, parity) => seven_bits(bits, parity),
        };
        let (phase, line_end) = (TapePhase::Leader, LineEnd::None);
        Self { settings, decoding, phase, held: Vec::new(), line_end, line: Vec::new(), has_begun: false }
    }

    /// Whether the end of the program has arrived.
    #[must_use]
    pub fn has_ended(&self) -> bool {
        self.phase == TapePhase::Ended
    }

    /// Processes a received character and appends the resulting text to `text`.
    ///
    /// # Errors
    /// The program cannot be read any further; the contents of `text` are valid.
    pub fn push(&mut self, received: ReceivedByte, text: &mut Vec<u8>) -> Result<(), TapeError> {
        if self.decoding != TapeCode::Undecided {
            return self.decode(received, text);
        }
        self.held.push(received);
        let ReceivedByte::Byte(byte) = received else { return Ok(()) };
        let is_eia = byte == 0x80 && self.settings.code == CharacterCode::Auto && self.settings.parity != Parity::Odd;
        if is_eia {
            self.decoding = TapeCode::Eia;
        } else if matches!(byte & 0x7F, b'\n' | b'\r') {
            self.decoding = self.iso();
        } else if self.held.len() > MAX_LEADER {
            return Err(TapeError::NoEndOfBlock);
        } else {
            return Ok(());
        }
        for received in std::mem::take(&mut self.held) {
            self.decode(received, text)?;
        }
        Ok(())
    }

    /// The form of ISO code that the settings define or, with eight bits without parity, that the received bytes show
    /// consistently.
    fn iso(&self) -> TapeCode {
        if (self.settings.bits, self.settings.parity) != (8, Parity::None) {
            return seven_bits(self.settings.bits, self.settings.parity);
        }
        let bytes =
            || self.held.iter().filter_map(|one| if let ReceivedByte::Byte(byte) = one { Some(*byte) } else { None });
        if bytes().all(|byte| byte < 0x80) {
            return TapeCode::Plain;
        }
        // Of the leader only characters other than NUL show anything.
        let shown = || bytes().filter(|byte| byte & 0x7F != 0);
        if shown().all(|byte| byte.count_ones().is_multiple_of(2)) {
            TapeCode::Parity { odd: false }
        } else if shown().all(|byte| !byte.count_ones().is_multiple_of(2)) {
            TapeCode::Parity { odd: true }
        } else if shown().all(|byte| byte >= 0x80) {
            TapeCode::SevenBits
        } else {
            TapeCode::Plain
        }
    }

    fn decode(&mut self, received: ReceivedByte, text: &mut Vec<u8>) -> Result<(), TapeError> {
        let is_leader = self.phase == TapePhase::Leader;
        let character = match (received, self.decoding) {
            (ReceivedByte::Damaged, _) => Err(TapeError::Damaged),
            (ReceivedByte::Byte(byte), TapeCode::Parity { odd }) if byte.count_ones().is_multiple_of(2) == odd => {
                Err(TapeError::Damaged)
            }
            (ReceivedByte::Byte(byte), TapeCode::Parity { .. } | TapeCode::SevenBits) => Ok(byte & 0x7F),
            (ReceivedByte::Byte(byte), TapeCode::Eia) => eia::character(byte),
            (ReceivedByte::Byte(byte), TapeCode::Plain | TapeCode::Undecided) => Ok(byte),
        };
        match character {
            Ok(character) => self.append_character(character, text),
            // The leader is ignored.
            Err(_) if is_leader || self.phase == TapePhase::Ended => {}
            Err(error) => return Err(error),
        }
        Ok(())
    }

    fn append_character(&mut self, character: u8, text: &mut Vec<u8>) {
        let ends = self.settings.end;
        match (self.phase, character) {
            // NUL, DEL and DC1 … DC4 belong to the tape.
            (TapePhase::Ended, _) | (_, 0 | 0x7F | 0x11..=0x14) => {}
            (TapePhase::Program, 0x04) if ends.eot => self.phase = TapePhase::Ended,
            (TapePhase::Program, 0x03) if ends.etx => self.phase = TapePhase::Ended,
            (TapePhase::Leader, b'%') => self.begin(LineEnd::Feed, text),
            (TapePhase::Leader, b'\r') => self.begin(LineEnd::Return, text),
            (TapePhase::Leader, b'\n') => self.begin(LineEnd::Feed, text),
            (TapePhase::Leader, _) => {}
            (TapePhase::Program, b'\r' | b'\n') => self.end_line(character, text),
            (TapePhase::Program, b'%') if self.line.is_empty() && !self.has_begun => {}
            (TapePhase::Program, b'%') if self.line.is_empty() && ends.percent => {
                text.extend_from_slice(b"%\n");
                self.phase = TapePhase::Ended;
            }
            (TapePhase::Program, _) => {
                (self.line_end, self.has_begun) = (LineEnd::None, true);
                if self.line.len() < 512 {
                    self.line.push(character);
                }
                text.push(character);
            }
        }
    }

    /// Begins the program behind the leader with a percent sign, whether or not one was sent.
    fn begin(&mut self, line_end: LineEnd, text: &mut Vec<u8>) {
        text.extend_from_slice(b"%\n");
        (self.phase, self.line_end) = (TapePhase::Program, line_end);
    }

    fn end_line(&mut self, character: u8, text: &mut Vec<u8>) {
        let (is_more_of_the_end, next) = match (self.line_end, character) {
            (LineEnd::None, b'\r') => (false, LineEnd::Return),
            (LineEnd::None, _) => (false, LineEnd::Feed),
            (LineEnd::Return, b'\n') => (true, LineEnd::Feed),
            (LineEnd::Feed, b'\n') => (!self.has_begun, LineEnd::Feed),
            (end, _) => (true, end),
        };
        self.line_end = next;
        if is_more_of_the_end {
            return;
        }
        text.push(b'\n');
        let end = program_end_of(&std::mem::take(&mut self.line));
        if end == Some(2) && self.settings.end.m02 || end == Some(30) && self.settings.end.m30 {
            self.phase = TapePhase::Ended;
        }
    }
}

/// The form of seven bits with this parity in a byte; with eight bits the port checks the parity.
fn seven_bits(bits: u8, parity: Parity) -> TapeCode {
    match (bits, parity) {
        (7, Parity::Even) => TapeCode::Parity { odd: false },
        (7, Parity::Odd) => TapeCode::Parity { odd: true },
        (7, Parity::None) => TapeCode::SevenBits,
        _ => TapeCode::Plain,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use retrace_config::ProgramEnds;

    fn read(settings: SerialSettings, bytes: impl IntoIterator<Item = u8>) -> (String, Result<bool, TapeError>) {
        let (mut reader, mut text) = (TapeReader::new(settings), Vec::new());
        let mut result = Ok(());
        for byte in bytes {
            result = result.and_then(|()| reader.push(ReceivedByte::Byte(byte), &mut text));
        }
        (String::from_utf8(text).expect("text"), result.map(|()| reader.has_ended()))
    }

    fn settings(format: &str, code: CharacterCode) -> SerialSettings {
        let mut settings = SerialSettings { code, ..SerialSettings::default() };
        settings.set("format", format).expect("a format");
        settings
    }

    /// A character with a parity bit.
    fn with_parity(byte: u8, odd: bool) -> u8 {
        if byte.count_ones().is_multiple_of(2) == odd { byte | 0x80 } else { byte }
    }

    const PROGRAM: &str = "%\nG21 G1 X10 (50%)\nM30\n%\n";

    #[test]
    fn every_form_of_iso_code_gives_the_same_text() {
        let tape = b"\0\0\x7Fpart 12\0\x11%\r\nG21 G1 X10 (50%)\n\r\rM3\x7F0\r%\n\0\0";
        for (format, code) in [("7e2", CharacterCode::Iso), ("7e1", CharacterCode::Auto), ("8n1", CharacterCode::Auto)]
        {
            let bytes = tape.iter().map(|&byte| with_parity(byte, false));
            assert_eq!(read(settings(format, code), bytes), (PROGRAM.into(), Ok(true)), "{format}");
        }
        for (format, code) in [("7o1", CharacterCode::Iso), ("7o1", CharacterCode::Auto), ("8n1", CharacterCode::Iso)] {
            let bytes = tape.iter().map(|&byte| with_parity(byte, true));
            assert_eq!(read(settings(format, code), bytes), (PROGRAM.into(), Ok(true)), "{format}");
        }
        for format in ["8n1", "8e1", "7n2"] {
            assert_eq!(read(settings(format, CharacterCode::Iso), *tape), (PROGRAM.into(), Ok(true)), "{format}");
        }
        let marked = tape.iter().map(|&byte| byte | 0x80);
        assert_eq!(read(settings("8n1", CharacterCode::Iso), marked), (PROGRAM.into(), Ok(true)));
    }

    #[test]
    fn eia_code_is_recognized_by_its_first_end_of_block() {
        let tape: Vec<u8> =
            "leader\n%\ng21 g1 x10\nm30\n%\n".bytes().map(|byte| eia::code(byte).expect("in the table")).collect();
        for code in [CharacterCode::Eia, CharacterCode::Auto] {
            assert_eq!(read(settings("8n1", code), tape.clone()).0, "%\ng21 g1 x10\nm30\n%\n");
        }
        let mut macros = tape;
        macros.splice(10..10, [0x0E]);
        let (text, result) = read(settings("8n1", CharacterCode::Eia), macros);
        assert_eq!((text.as_str(), result), ("%\ng", Err(TapeError::UnknownEiaCode(0x0E))));
    }

    #[test]
    fn a_program_without_percent_signs_begins_behind_the_first_end_of_block() {
        let ends = ProgramEnds { m30: true, eot: true, ..ProgramEnds::default() };
        let settings = SerialSettings { end: ends, ..settings("8n1", CharacterCode::Iso) };
        assert_eq!(read(settings, *b"O12\nG0 X1\nM30\nG0 X9\n"), ("%\nG0 X1\nM30\n".into(), Ok(true)));
        assert_eq!(read(settings, *b"\n\nG0 X1\n\x04G0 X9\n"), ("%\nG0 X1\n".into(), Ok(true)));
        assert_eq!(read(settings, *b"\r\n%\r\nG0 X1\r\n").0, "%\nG0 X1\n");
    }

    #[test]
    fn a_stream_that_never_ends_a_block_is_refused() {
        let zeros = std::iter::repeat_n(0, MAX_LEADER + 10);
        assert_eq!(read(settings("8n1", CharacterCode::Iso), zeros), (String::new(), Err(TapeError::NoEndOfBlock)));
    }

    proptest! {
        #[test]
        fn a_damaged_character_lets_nothing_behind_it_through(at in 2_usize..24, bit in 0..8) {
            let mut tape: Vec<u8> = PROGRAM.bytes().map(|byte| with_parity(byte, false)).collect();
            tape[at] ^= 1_u8 << bit;
            let (text, result) = read(settings("7e2", CharacterCode::Iso), tape);
            prop_assert_eq!(text.as_str(), &PROGRAM[..at]);
            prop_assert_eq!(result, Err(TapeError::Damaged));
        }

        #[test]
        fn nothing_that_arrives_panics(bytes in prop::collection::vec(any::<u8>(), 0..200), eia in any::<bool>()) {
            let code = if eia { CharacterCode::Eia } else { CharacterCode::Auto };
            let (mut reader, mut text) = (TapeReader::new(settings("8n1", code)), Vec::new());
            for byte in bytes {
                let _ = reader.push(ReceivedByte::Byte(byte), &mut text);
            }
        }
    }
}
