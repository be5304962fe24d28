//! The sentence of a voltage module: `$PRTV,` volts `*` checksum, carriage return and line feed, framed as NMEA 0183
//! has it.
//!
//! Invariant: a voltage is returned only for a whole sentence whose every byte is as it should be. Any bytes are
//! accepted, and a sentence is found behind any of them.

/// Bytes of a sentence before its voltage, without the dollar sign.
const HEADER: &[u8; 5] = b"PRTV,";
/// Largest number of digits before the decimal point.
const MAX_WHOLE_DIGITS: u8 = 3;
/// Digits behind the decimal point.
const FRACTION_DIGITS: u8 = 2;
/// Largest voltage, in units of 0.01 V.
pub const MAX_CENTIVOLTS: u16 = u16::MAX;

/// What a sentence of the voltage module states.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SentenceResult {
    /// Voltage in units of 0.01 V, from 0 to [`MAX_CENTIVOLTS`].
    Centivolts(u16),
    /// No voltage: the field is empty, has another form or is out of range, or the sentence has another checksum or was
    /// cut short.
    NoVoltage,
}

/// What the next byte is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Expected {
    /// The dollar sign.
    Start,
    /// This byte of the header.
    Header(u8),
    /// A digit before the decimal point, of which there were so many, or the point.
    Whole { digits: u8, value: u32 },
    /// A digit behind the decimal point, of which there were so many, or the asterisk.
    Fraction { digits: u8, value: u32 },
    /// The first digit of the checksum.
    CheckHigh(u16),
    /// The second digit of the checksum, whose first one was right.
    CheckLow(u16),
    /// The carriage return.
    Return(u16),
    /// The line feed.
    LineFeed(u16),
}

/// Reader of the sentences in a stream of bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SentenceParser {
    expected: Expected,
    /// Exclusive or of the bytes between the dollar sign and the asterisk.
    sum: u8,
}

impl Default for SentenceParser {
    fn default() -> Self {
        Self::new()
    }
}

impl SentenceParser {
    /// Creates a parser that waits for a sentence.
    #[must_use]
    pub const fn new() -> Self {
        Self { expected: Expected::Start, sum: 0 }
    }

    /// Takes the next byte. Returns the voltage of a sentence with its last byte, or that it has none with the first
    /// byte that is not as it should be; sentences of another kind state nothing.
    pub const fn push(&mut self, byte: u8) -> Option<SentenceResult> {
        let has_header = !matches!(self.expected, Expected::Start | Expected::Header(_));
        if byte == b'$' {
            *self = Self { expected: Expected::Header(0), sum: 0 };
        } else if let (Expected::LineFeed(value), b'\n') = (self.expected, byte) {
            *self = Self::new();
            return Some(SentenceResult::Centivolts(value));
        } else if let Some(next) = self.after(byte) {
            // the checksum covers what is before the asterisk
            if matches!(next, Expected::Header(_) | Expected::Whole { .. } | Expected::Fraction { .. }) {
                self.sum ^= byte;
            }
            self.expected = next;
            return None;
        } else {
            *self = Self::new();
        }
        if has_header { Some(SentenceResult::NoVoltage) } else { None }
    }

    /// Returns what follows this byte; `None` if it is not the expected one.
    const fn after(&self, byte: u8) -> Option<Expected> {
        let digit = byte.wrapping_sub(b'0') as u32;
        Some(match self.expected {
            Expected::Header(at) if byte == HEADER[at as usize] => {
                if at as usize + 1 < HEADER.len() {
                    Expected::Header(at + 1)
                } else {
                    Expected::Whole { digits: 0, value: 0 }
                }
            }
            Expected::Whole { digits: 1.., value } if byte == b'.' => Expected::Fraction { digits: 0, value },
            Expected::Whole { digits, value } if digits < MAX_WHOLE_DIGITS && digit < 10 => {
                Expected::Whole { digits: digits + 1, value: value * 10 + digit }
            }
            Expected::Fraction { digits, value } if digits < FRACTION_DIGITS && digit < 10 => {
                Expected::Fraction { digits: digits + 1, value: value * 10 + digit }
            }
            Expected::Fraction { digits: FRACTION_DIGITS, value } if byte == b'*' && value <= MAX_CENTIVOLTS as u32 => {
                Expected::CheckHigh(value as u16)
            }
            Expected::CheckHigh(value) if is_digit(byte, self.sum >> 4) => Expected::CheckLow(value),
            Expected::CheckLow(value) if is_digit(byte, self.sum & 15) => Expected::Return(value),
            Expected::Return(value) if byte == b'\r' => Expected::LineFeed(value),
            _ => return None,
        })
    }
}

/// Whether the byte is this hexadecimal digit (0 … 15), in upper or lower case.
const fn is_digit(byte: u8, digit: u8) -> bool {
    byte.to_ascii_uppercase() == b"0123456789ABCDEF"[digit as usize & 15]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A sentence with this text as its voltage.
    fn sentence(field: &str) -> Vec<u8> {
        let covered = format!("PRTV,{field}");
        let sum = covered.bytes().fold(0, |sum, byte| sum ^ byte);
        format!("${covered}*{sum:02X}\r\n").into_bytes()
    }

    fn results(bytes: &[u8]) -> Vec<SentenceResult> {
        let mut parser = SentenceParser::new();
        bytes.iter().filter_map(|&byte| parser.push(byte)).collect()
    }

    use SentenceResult::{Centivolts, NoVoltage};

    /// The example of the documentation, whose checksum was calculated by hand: 50 ^ 52 ^ 54 ^ 56 = 00 for `PRTV`, then
    /// the comma 2C, 31 ^ 32 ^ 33 = 30, the point 2E, 34 ^ 35 = 01; together 33.
    #[test]
    fn the_sentence_of_the_documentation_is_read() {
        assert_eq!(results(b"$PRTV,123.45*33\r\n"), [Centivolts(12_345)]);
        assert_eq!(sentence("123.45"), b"$PRTV,123.45*33\r\n");
    }

    #[test]
    fn the_range_and_the_form_of_a_voltage() {
        for (field, wanted) in [
            ("0.00", Centivolts(0)),
            ("007.50", Centivolts(750)),
            ("655.35", Centivolts(65_535)),
            ("655.36", NoVoltage),
            ("999.99", NoVoltage),
            ("1000.00", NoVoltage),
            ("0007.50", NoVoltage),
            ("", NoVoltage),
            (".50", NoVoltage),
            ("7", NoVoltage),
            ("7.5", NoVoltage),
            ("7.500", NoVoltage),
            ("-7.50", NoVoltage),
            ("+7.50", NoVoltage),
            ("7,50", NoVoltage),
            (" 7.50", NoVoltage),
            ("7.5:", NoVoltage),
            ("7.5/", NoVoltage),
            ("7.50,V", NoVoltage),
            ("1e2.00", NoVoltage),
        ] {
            assert_eq!(results(&sentence(field)), [wanted], "{field}");
        }
    }

    #[test]
    fn a_sentence_that_is_cut_short_states_no_voltage_and_the_next_one_is_read() {
        let whole = sentence("87.65");
        for cut in 0..whole.len() {
            let wanted: &[_] = if cut > HEADER.len() { &[NoVoltage, Centivolts(8_765)] } else { &[Centivolts(8_765)] };
            assert_eq!(results(&[&whole[..cut], &whole].concat()), wanted, "{cut} bytes");
        }
    }

    #[test]
    fn other_sentences_and_other_ends_of_a_line() {
        // a sentence of another device, and others that differ in their beginning alone
        assert_eq!(results(b"$GPGLL,4916.45,N,12311.12,W*71\r\n$PRTI,1.00*10\r\n!PRTV,1.00*03\r\n"), []);
        assert_eq!(results(b"$PRTV,123.45*33\n"), [NoVoltage]);
        assert_eq!(results(b"$PRTV,123.45*33\r\r\n"), [NoVoltage]);
        assert_eq!(results(b"$PRTV,123.45\r\n"), [NoVoltage], "the checksum is not optional");
        assert_eq!(results(b"$PRTV,9.70*3c\r\n$PRTV,9.70*3C\r\n"), [Centivolts(970); 2], "in both cases");
    }

    /// The checksum reveals every error within a byte; only the case of a hexadecimal digit is no error.
    #[test]
    fn no_byte_of_a_sentence_can_be_another_one() {
        let whole = sentence("109.15");
        assert_eq!(whole, b"$PRTV,109.15*3E\r\n");
        for at in 0..whole.len() {
            for byte in 0..=255 {
                let mut other = whole.clone();
                other[at] = byte;
                let is_same = byte == whole[at] || at > 12 && byte.eq_ignore_ascii_case(&whole[at]);
                let wanted: &[_] = match at {
                    _ if is_same => &[Centivolts(10_915)],
                    0..6 => &[],
                    _ => &[NoVoltage],
                };
                assert_eq!(results(&other), wanted, "byte {at} is {byte}");
            }
        }
    }

    /// Bytes like those of sentences, so that many are almost right.
    fn noise() -> impl Strategy<Value = Vec<u8>> {
        let piece = prop_oneof![
            (0..=u16::MAX).prop_map(|value| sentence(&format!("{}.{:02}", value / 100, value % 100))),
            "[$PRTV,.*0-9A-F\r\n]{0,20}".prop_map(String::into_bytes),
            "[0-9.,V-]{0,8}".prop_map(|field| sentence(&field)),
            Just(b"$PRTV,".to_vec()),
            prop::collection::vec(any::<u8>(), 0..12),
            (0..18usize).prop_map(|cut| sentence("100.00")[..cut.min(17)].to_vec()),
        ];
        prop::collection::vec(piece, 0..12).prop_map(|pieces| pieces.concat())
    }

    proptest! {
        /// Whatever arrives: a voltage is returned exactly where the bytes that end there are a sentence with it.
        #[test]
        fn a_voltage_is_read_where_a_sentence_ends_and_nowhere_else(bytes in noise()) {
            let mut parser = SentenceParser::new();
            for end in 1..=bytes.len() {
                let read = parser.push(bytes[end - 1]).filter(|&of| of != NoVoltage);
                let start = bytes[..end].iter().rposition(|&byte| byte == b'$').unwrap_or(0);
                let text = String::from_utf8_lossy(&bytes[start..end]).into_owned();
                let field = text.strip_prefix("$PRTV,").and_then(|text| text.split_once('*')).map(|of| of.0);
                let field = field.filter(|field| sentence(field).eq_ignore_ascii_case(&bytes[start..end]));
                let field = field.filter(|field| field.split_once('.').is_some_and(|(whole, fraction)| {
                    let digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
                    (1..=3).contains(&whole.len()) && fraction.len() == 2 && digits(whole) && digits(fraction)
                }));
                let volts = field.and_then(|field| field.parse::<f64>().ok()).filter(|&volts| volts < 655.355);
                prop_assert_eq!(read, volts.map(|volts| Centivolts((volts * 100.0).round() as u16)), "{:?}", text);
            }
        }

        /// Once the header has arrived, a sentence states a voltage or none, once, before anything follows it.
        #[test]
        fn every_sentence_states_something_once(bytes in noise()) {
            let (mut parser, mut headers, mut stated) = (SentenceParser::new(), 0, 0);
            for end in 1..=bytes.len() {
                stated += usize::from(parser.push(bytes[end - 1]).is_some());
                headers += usize::from(bytes[..end].ends_with(b"$PRTV,"));
                prop_assert!(headers == stated || headers == stated + 1);
            }
            let has_begun = headers > stated;
            prop_assert_eq!(parser.push(b'$'), has_begun.then_some(NoVoltage));
        }

        /// A sentence is found behind anything that does not end within it.
        #[test]
        fn every_voltage_is_read_behind_any_bytes(before in noise(), value: u16) {
            let whole = sentence(&format!("{}.{:02}", value / 100, value % 100));
            prop_assert_eq!(results(&[before, whole].concat()).last().copied(), Some(Centivolts(value)));
        }
    }
}
