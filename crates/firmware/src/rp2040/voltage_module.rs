//! The reading of a voltage module at UART0, as the reading of an analog input.
//!
//! Invariant: a reading is that of the last sentence, which began to arrive at most [`MAX_AGE_US`] ago. A sentence that
//! is damaged or states no voltage ends it at once.

use super::voltage_sentence::{SentenceParser, SentenceResult};

/// Greatest age of a reading, in microseconds.
pub const MAX_AGE_US: u32 = 20_000;

/// What was received of the module.
///
/// The bytes wait in a ring until they are taken. How long they have waited is not known, so the age of a sentence is
/// counted from when the ring was found empty before its first byte: it is never taken for younger than it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VoltageModule {
    parser: SentenceParser,
    /// When no byte was waiting the last time, in microseconds of a clock that wraps around.
    emptied_us: Option<u32>,
    /// Earliest time at which the sentence can have begun.
    began_us: Option<u32>,
    /// Voltage in units of 0.01 V, and the earliest time at which its sentence can have begun.
    reading: Option<(u16, u32)>,
}

impl VoltageModule {
    /// Creates the state in which nothing is known.
    #[must_use]
    pub const fn new() -> Self {
        Self { parser: SentenceParser::new(), emptied_us: None, began_us: None, reading: None }
    }

    /// Takes all bytes that wait, at `now_us` microseconds or later, once in a control period. Returns the reading, in
    /// units of 0.01 V.
    pub fn read(&mut self, waiting: impl Iterator<Item = u8>, now_us: u32) -> Option<u16> {
        for byte in waiting {
            if byte == b'$' {
                self.began_us = self.emptied_us;
            }
            match self.parser.push(byte) {
                Some(SentenceResult::Centivolts(value)) => self.reading = self.began_us.map(|began| (value, began)),
                Some(SentenceResult::NoVoltage) => self.reading = None,
                None => {}
            }
        }
        self.emptied_us = Some(now_us);
        // for good: the clock wraps around
        self.reading = self.reading.filter(|&(_, began)| now_us.wrapping_sub(began) <= MAX_AGE_US);
        self.reading.map(|(value, _)| value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sentence(value: u16) -> Vec<u8> {
        let covered = format!("PRTV,{}.{:02}", value / 100, value % 100);
        let sum = covered.bytes().fold(0, |sum, byte| sum ^ byte);
        format!("${covered}*{sum:02X}\r\n").into_bytes()
    }

    #[test]
    fn a_reading_ends_with_its_age_and_with_a_sentence_without_one() {
        let mut module = VoltageModule::new();
        let start = u32::MAX - 3_000;
        let mut read = |bytes: &[u8], us: u32| module.read(bytes.iter().copied(), start.wrapping_add(us));
        assert_eq!(read(&sentence(9_999), 0), None, "its bytes may have waited for any time");
        assert_eq!(read(&sentence(12_345), 1_000), Some(12_345));
        assert_eq!(read(b"", MAX_AGE_US), Some(12_345));
        assert_eq!(read(b"", MAX_AGE_US + 1), None);
        assert_eq!(read(b"", 0), None, "and not again when the clock has wrapped around");
        assert_eq!(read(b"", 29_000), None);
        assert_eq!(read(&sentence(1), 30_000), Some(1));
        assert_eq!(read(b"noise \xff\x00\r\n$GP", 31_000), Some(1), "no sentence of the module");
        assert_eq!(read(b"$PRTV,123.4", 32_000), Some(1), "the next sentence is on its way");
        assert_eq!(read(b"5*34\r\n", 33_000), None, "its checksum is another one");
        assert_eq!(read(&[sentence(2), sentence(3)].concat(), 50_000), Some(3), "the last one");
        let mut us = 50_000;
        for none in [&b"$PRTV,*2C\r\n"[..], b"$PRTV,655.36*31\r\n", b"$PRTV,12 V*59\r\n"] {
            us += 1_000;
            assert_eq!(read(&sentence(4), us), Some(4));
            assert_eq!(read(none, us + 500), None, "the module states that it knows no voltage");
        }
    }

    /// A sentence that pauses is as old as its first byte.
    #[test]
    fn a_sentence_that_pauses_is_old() {
        let whole = sentence(12_345);
        for pause_us in [MAX_AGE_US, MAX_AGE_US + 1, 1_000_000] {
            let mut module = VoltageModule::new();
            let mut read = |bytes: &[u8], us: u32| module.read(bytes.iter().copied(), us);
            assert_eq!(read(b"", 0), None);
            assert_eq!(read(&whole[..9], 1_000), None);
            assert_eq!(read(b"", pause_us - 500), None);
            assert_eq!(read(&whole[9..], pause_us), (pause_us <= MAX_AGE_US).then_some(12_345));
        }
    }

    /// What the module sends: how long it waits behind the sentence before, its voltage, and whether it is damaged on
    /// the line (0) or without a voltage (1).
    type Sent = (u32, u16, u8);

    proptest! {
        /// Sentences at any times, and a card that looks at them at any times: the reading is that of the last whole
        /// sentence, which began at most the greatest age ago; and one that is younger by two control periods is read.
        #[test]
        fn no_reading_is_old_and_none_is_missing(
            sent in prop::collection::vec((0..40_000u32, any::<u16>(), 0..8u8), 1..40),
            periods in prop::collection::vec(500..6_000u32, 1..200),
            start: u32,
        ) {
            let mut line: Vec<(u32, u8)> = Vec::new();
            let mut sentences: Vec<(u32, u32, Option<u16>)> = Vec::new();
            let mut at = 0;
            for (pause, value, kind) in sent as Vec<Sent> {
                at += pause + 10;
                let began = at;
                let mut bytes = if kind == 1 { b"$PRTV,*2C\r\n".to_vec() } else { sentence(value) };
                let check_digit = bytes.len() - 3;
                bytes[check_digit] ^= u8::from(kind == 0);
                line.extend(bytes.iter().zip(0..).map(|(&byte, n)| (began + 10 * n, byte)));
                at += 10 * bytes.len() as u32;
                // it states something with this byte
                let byte_us = [30, 50, 10][usize::from(kind.min(2))];
                sentences.push((began, at - byte_us, (kind > 1).then_some(value)));
            }
            let (mut module, mut taken, mut now, mut longest) = (VoltageModule::new(), 0, 0, 0);
            module.read([].into_iter(), start);
            for period in periods {
                (now, longest) = (now + period, period.max(longest));
                let waiting = line[taken..].iter().take_while(|&&(at, _)| at <= now).count();
                let bytes = line[taken..taken + waiting].iter().map(|&(_, byte)| byte);
                let reading = module.read(bytes, start.wrapping_add(now));
                taken += waiting;
                let last = sentences.iter().rfind(|&&(_, ended, _)| ended <= now);
                let stated = last.and_then(|&(began, _, value)| Some((now - began, value?)));
                match (reading, stated) {
                    (Some(value), stated) => {
                        let age = stated.filter(|&(_, last)| last == value).map(|(age, _)| age);
                        prop_assert!(age.is_some_and(|age| age <= MAX_AGE_US), "{} of {:?}", value, stated);
                    }
                    (None, Some((age, _))) => prop_assert!(age + longest > MAX_AGE_US, "{} µs", age),
                    (None, None) => {}
                }
            }
        }
    }
}
