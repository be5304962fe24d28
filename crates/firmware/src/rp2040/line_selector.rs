//! Which of the two lines is the card's: the one that the host uses.
//!
//! Invariant: the line in use changes only after a second of silence at it, so that a disturbance at a line without a
//! host does not shut out the host.

/// Silence of the line in use after which the other one can take over, in microseconds.
pub const SILENCE_US: u32 = 1_000_000;

/// A line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineKind {
    /// UART0.
    Uart,
    /// The USB line.
    Usb,
}

/// The line in use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineSelector {
    /// It, and when its last byte was taken, in microseconds of a clock that wraps around.
    used: Option<(LineKind, u32)>,
}

impl LineSelector {
    /// Creates a selector without a line in use.
    #[must_use]
    pub const fn new() -> Self {
        Self { used: None }
    }

    /// Returns the line in use.
    #[must_use]
    pub fn used(&self) -> Option<LineKind> {
        self.used.map(|(kind, _)| kind)
    }

    /// Returns the line from which a byte is to be taken now, at `now_us` microseconds, of those that have one.
    pub fn select(&mut self, uart_has_byte: bool, usb_has_byte: bool, now_us: u32) -> Option<LineKind> {
        let kind = match (uart_has_byte, usb_has_byte) {
            (false, false) => return None,
            (true, false) => LineKind::Uart,
            (false, true) => LineKind::Usb,
            (true, true) => self.used().unwrap_or(LineKind::Usb),
        };
        if self.used.is_some_and(|(used, last)| used != kind && now_us.wrapping_sub(last) < SILENCE_US) {
            return None;
        }
        self.used = Some((kind, now_us));
        Some(kind)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use LineKind::{Uart, Usb};
    use proptest::prelude::*;

    #[test]
    fn the_other_line_takes_over_after_a_second_of_silence() {
        let mut selector = LineSelector::new();
        let start = u32::MAX - 500_000;
        let at = |us: u32| start.wrapping_add(us);
        assert_eq!((selector.used(), selector.select(false, false, at(0))), (None, None));
        assert_eq!(selector.select(true, false, at(0)), Some(Uart));
        assert_eq!(selector.select(true, true, at(10)), Some(Uart), "the line in use goes on");
        assert_eq!(selector.select(false, true, at(SILENCE_US + 9)), None);
        assert_eq!(selector.used(), Some(Uart));
        assert_eq!(selector.select(false, true, at(SILENCE_US + 10)), Some(Usb));
        assert_eq!(selector.select(true, false, at(SILENCE_US + 20)), None);
    }

    proptest! {
        /// Bytes of two lines are never mixed: between bytes of different lines is a second without one of the first.
        #[test]
        fn lines_are_not_mixed(steps in prop::collection::vec((any::<bool>(), any::<bool>(), 0u32..1_500_000), 1..60)) {
            let (mut selector, mut now) = (LineSelector::new(), 0u32);
            let mut last: Option<(LineKind, u32)> = None;
            for (uart, usb, pause) in steps {
                now = now.wrapping_add(pause);
                let Some(kind) = selector.select(uart, usb, now) else { continue };
                prop_assert!(usb && kind == Usb || uart && kind == Uart);
                if let Some((before, at)) = last {
                    prop_assert!(before == kind || now.wrapping_sub(at) >= SILENCE_US);
                }
                last = Some((kind, now));
            }
        }
    }
}
