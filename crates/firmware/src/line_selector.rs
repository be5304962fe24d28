//! Which of the two lines is the card's: the one that the host uses.
//!
//! A voltage module may be connected to UART0 while the host uses USB, and sends all the time. So a byte at USB makes
//! that the line in use, but at UART0 only the end of a frame does, which no sentence of a module contains.
//!
//! Invariant: the line in use changes only after a second of silence at it, so that a disturbance at a line without a
//! host does not shut out the host. Between bytes of different lines the end of a frame is passed on.

use retrace_link::frame::OVERHEAD;

/// Silence of the line in use after which the other one can take over, in microseconds: without a byte at USB, without
/// the end of a frame at UART0.
pub const SILENCE_US: u32 = 1_000_000;

/// A line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineKind {
    /// UART0.
    Uart,
    /// The USB line.
    Usb,
}

/// What the card receives next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NextByte {
    /// A zero, which ends what the other line has left of a frame.
    FrameEnd,
    /// The next byte of this line.
    Of(LineKind),
}

/// The line in use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineSelector {
    /// It, and when its last byte or frame was received, in microseconds of a clock that wraps around.
    used: Option<(LineKind, u32)>,
    /// Line of the last byte.
    source: Option<LineKind>,
    /// Bytes of UART0 since the last zero.
    uart_frame: FrameShape,
}

impl LineSelector {
    /// Creates a selector without a line in use.
    #[must_use]
    pub const fn new() -> Self {
        Self { used: None, source: None, uart_frame: FrameShape::new() }
    }

    /// Returns the line in use.
    #[must_use]
    pub fn used(&self) -> Option<LineKind> {
        self.used.map(|(kind, _)| kind)
    }

    /// Whether this line is in use and not silent, at `now_us` microseconds.
    fn is_busy(&self, kind: LineKind, now_us: u32) -> bool {
        self.used.is_some_and(|(used, last)| used == kind && now_us.wrapping_sub(last) < SILENCE_US)
    }

    /// Whether the bytes at UART0 are those of a voltage module, at `now_us` microseconds: the host uses USB.
    #[must_use]
    pub fn is_uart_free(&self, now_us: u32) -> bool {
        self.is_busy(LineKind::Usb, now_us)
    }

    /// Returns what the card receives now, at `now_us` microseconds, from the lines that have a byte.
    pub fn select(&mut self, uart_has_byte: bool, usb_has_byte: bool, now_us: u32) -> Option<NextByte> {
        let kind = if usb_has_byte && !self.is_busy(LineKind::Uart, now_us) {
            self.used = Some((LineKind::Usb, now_us));
            LineKind::Usb
        } else if uart_has_byte && !self.is_busy(LineKind::Usb, now_us) {
            LineKind::Uart
        } else {
            return None;
        };
        if self.source.replace(kind).is_some_and(|source| source != kind) {
            self.uart_frame = FrameShape::new();
            return Some(NextByte::FrameEnd);
        }
        Some(NextByte::Of(kind))
    }

    /// Records a byte of UART0 that the card receives, at `now_us` microseconds.
    pub const fn record_uart_byte(&mut self, byte: u8, now_us: u32) {
        if self.uart_frame.push(byte) {
            self.used = Some((LineKind::Uart, now_us));
        }
    }
}

/// The shape of the bytes since the last zero: that of a frame is known without its payload and its key.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct FrameShape {
    /// Number of the bytes.
    count: u16,
    /// The first byte: in a frame the number of bytes in its body.
    first: u8,
    /// The last byte: in a frame the last one of its check.
    last: u8,
    /// Top bits of the last eight bytes; those of the check are set.
    top_bits: u8,
}

impl FrameShape {
    const fn new() -> Self {
        Self { count: 0, first: 0, last: 0, top_bits: 0 }
    }

    /// Takes the next byte. Returns whether it is the zero that ends a frame.
    const fn push(&mut self, byte: u8) -> bool {
        if byte == 0 {
            // all but the payload's own bytes, and without the zero; the body has one byte more than the payload
            let count = self.first as u16 + OVERHEAD as u16 - 2;
            let is_frame = self.first >= 2
                && self.count == count
                && self.top_bits & 0b1_1111 == 0b1_1111
                && self.last & 0b0111_0000 == 0;
            *self = Self::new();
            return is_frame;
        }
        if self.count == 0 {
            self.first = byte;
        }
        self.count = self.count.saturating_add(1);
        self.last = byte;
        self.top_bits = self.top_bits << 1 | byte >> 7;
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use LineKind::{Uart, Usb};
    use NextByte::{FrameEnd, Of};
    use proptest::prelude::*;
    use retrace_link::frame::{MAX_PAYLOAD, MAX_WIRE, encode_with_key};

    /// Gives the selector what the lines have: bytes of UART0, and whether USB has one. Returns what the card receives.
    fn pass(selector: &mut LineSelector, uart: &[u8], has_usb: bool, now_us: u32) -> Vec<NextByte> {
        let mut passed = Vec::new();
        let mut uart = uart.iter();
        while let Some(next) = selector.select(!uart.as_slice().is_empty(), has_usb, now_us) {
            passed.push(next);
            if next == Of(Uart) {
                uart.next().into_iter().for_each(|&byte| selector.record_uart_byte(byte, now_us));
            } else if next == Of(Usb) {
                break;
            }
        }
        passed
    }

    fn frame(payload: &[u8], key: u32) -> Vec<u8> {
        encode_with_key(payload, &mut [0; MAX_WIRE], key).expect("it fits").to_vec()
    }

    #[test]
    fn the_other_line_takes_over_after_a_second_of_silence() {
        let mut selector = LineSelector::new();
        let start = u32::MAX - 500_000;
        let at = |us: u32| start.wrapping_add(us);
        let hello = frame(&[1, 2, 3], 0);
        assert_eq!((selector.used(), selector.select(false, false, at(0))), (None, None));
        assert_eq!(pass(&mut selector, &hello, false, at(0)), vec![Of(Uart); hello.len()]);
        assert_eq!(selector.used(), Some(Uart), "the card can answer");
        assert_eq!(selector.select(true, true, at(10)), Some(Of(Uart)), "the line in use goes on");
        assert_eq!(selector.select(false, true, at(SILENCE_US - 1)), None);
        assert_eq!(selector.used(), Some(Uart));
        assert_eq!(pass(&mut selector, &[], true, at(SILENCE_US)), [FrameEnd, Of(Usb)]);
        assert_eq!(selector.select(true, false, at(SILENCE_US + 20)), None);
        assert!(selector.is_uart_free(at(2 * SILENCE_US - 1)));
        assert!(!selector.is_uart_free(at(2 * SILENCE_US)), "the host at USB is gone");
        assert_eq!(pass(&mut selector, &[7], false, at(2 * SILENCE_US)), [FrameEnd, Of(Uart)]);
    }

    /// A module that sends all the time has no line, before and after any host; a host has it with its first frame.
    #[test]
    fn a_module_is_no_host() {
        let mut selector = LineSelector::new();
        let module = b"$PRTV,123.45*33\r\n";
        for ms in 0..3_000 {
            assert_eq!(pass(&mut selector, module, false, ms * 1_000).len(), module.len());
            assert_eq!((selector.used(), selector.is_uart_free(ms * 1_000)), (None, false));
        }
        assert_eq!(pass(&mut selector, module, true, 3_000_000), [FrameEnd, Of(Usb)], "at once");
        assert_eq!(pass(&mut selector, module, false, 3_000_001), [], "they are for the module's reading");
        // an hour later the host at USB is gone, and one is at UART0, with bytes of the module before
        let later = 3_600_000_000;
        let sent = [&module[..], &frame(&[1], 0), &frame(&[4, 0, 9], 0x1234_5677)].concat();
        assert_eq!(pass(&mut selector, &sent[..module.len() + 9], false, later).last(), Some(&Of(Uart)));
        assert_eq!(selector.used(), Some(Usb), "the first frame is joined to the module's bytes");
        pass(&mut selector, &sent[module.len() + 9..], false, later);
        assert_eq!(selector.used(), Some(Uart));
        // that host is gone, and the module is there again
        let usb_passes =
            |selector: &mut LineSelector, us: u32| pass(selector, module, true, later + us).contains(&Of(Usb));
        assert!(!usb_passes(&mut selector, SILENCE_US - 1));
        assert!(usb_passes(&mut selector, SILENCE_US));
    }

    #[test]
    fn bytes_of_another_shape_are_no_frame() {
        let is_frame = |bytes: &[u8]| {
            let mut shape = FrameShape::new();
            bytes.iter().map(|&byte| shape.push(byte)).collect::<Vec<bool>>()[bytes.len() - 1]
        };
        let whole = [2, 1, 7, 0x81, 0x82, 0x83, 0x84, 0x8f, 0];
        assert!(is_frame(&whole));
        for at in 3..8 {
            let mut other = whole;
            other[at] ^= 0x80;
            assert!(!is_frame(&other), "a byte of the check without its top bit");
        }
        for bit in 4..7 {
            let mut other = whole;
            other[7] |= 1 << bit;
            assert!(!is_frame(&other), "the check has 32 bits");
        }
        assert!(!is_frame(&[1, 1, 0x81, 0x82, 0x83, 0x84, 0x85, 0]), "no payload");
        assert!(!is_frame(&[0]));
        assert!(!is_frame(&[&[7][..], &[0x80; 256 + 7 + 5], &[0]].concat()), "longer than any frame");
    }

    proptest! {
        /// Every frame ends with a zero that shows it, with any key.
        #[test]
        fn every_frame_is_one(payload in prop::collection::vec(any::<u8>(), 1..=MAX_PAYLOAD), key: u32) {
            let mut shape = FrameShape::new();
            let frame = frame(&payload, key);
            let ends: Vec<bool> = frame.iter().map(|&byte| shape.push(byte)).collect();
            prop_assert_eq!(ends.iter().filter(|&&end| end).count(), 1);
            prop_assert_eq!(ends.last(), Some(&true));
        }

        /// A frame without one of its bytes, or with one more, is none.
        #[test]
        fn another_length_is_no_frame(payload in prop::collection::vec(any::<u8>(), 1..40), at: usize, more: bool) {
            let mut bytes = frame(&payload, 0);
            let at = 1 + at % (bytes.len() - 2);
            bytes.splice(at..=at, if more { vec![0x80, 0x80] } else { vec![] });
            let mut shape = FrameShape::new();
            prop_assert!(!bytes.iter().any(|&byte| shape.push(byte)));
        }

        /// Whatever the lines have, and when: a byte of UART0 is passed on only a second after the last one of USB, one
        /// of USB only a second after the last frame of UART0, and the end of a frame is between them.
        #[test]
        fn lines_are_not_mixed(
            steps in prop::collection::vec((0..4u8, any::<bool>(), prop_oneof![0u32..3_000, 0u32..1_500_000]), 1..60),
        ) {
            let (mut selector, mut now) = (LineSelector::new(), 0u32);
            let (mut last_usb, mut last_frame, mut last) = (None, None, None);
            let is_silent = |since: Option<u32>, now: u32| since.is_none_or(|at| now.wrapping_sub(at) >= SILENCE_US);
            for (uart, has_usb, pause) in steps {
                now = now.wrapping_add(pause);
                let bytes = match uart {
                    0 => vec![],
                    1 => b"$PRTV,1.00*33\r\n".to_vec(),
                    2 => vec![0x80, 0, 0, 7],
                    _ => [vec![0], frame(&[4, 0, 9], 0x1234_5677)].concat(),
                };
                let usb_may = has_usb && is_silent(last_frame, now);
                let passed = pass(&mut selector, &bytes, has_usb, now);
                prop_assert_eq!(passed.contains(&Of(Usb)), usb_may, "a host at USB is not shut out");
                prop_assert!(!passed.contains(&Of(Uart)) || !has_usb || !usb_may);
                for next in passed {
                    match next {
                        FrameEnd => last = None,
                        Of(kind) => {
                            prop_assert!(last.is_none_or(|last| last == kind));
                            prop_assert!(kind == Usb || is_silent(last_usb, now));
                            last = Some(kind);
                        }
                    }
                }
                if usb_may {
                    (last_usb, last_frame) = (Some(now), None);
                    prop_assert_eq!(selector.used(), Some(Usb));
                } else if uart == 3 && is_silent(last_usb, now) {
                    (last_frame, last_usb) = (Some(now), None);
                    prop_assert_eq!(selector.used(), Some(Uart));
                }
            }
        }
    }
}
