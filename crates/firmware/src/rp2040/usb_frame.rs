//! When a packet to the host may be offered: not in the last part of a frame of the bus, where a host that breaks it
//! off can hang the controller of an RP2040 (erratum RP2040-E15).
//!
//! Invariant: a frame is taken to have begun no later than it did, so a main loop that was away errs to the safe side.

/// Part of a frame of 1 ms in which a packet may be offered, in microseconds.
pub const OFFER_US: u32 = 800;
/// Time without a new frame after which the bus is idle: nothing is fetched from it.
pub const NO_FRAMES_US: u32 = 3000;

/// The frame of the bus as the main loop sees it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UsbFrame {
    number: u32,
    /// When it began at the earliest, when it was seen first, and when it was looked at last, in microseconds of a
    /// clock that wraps around.
    began: u32,
    new: u32,
    looked: u32,
}

impl UsbFrame {
    /// Creates a frame of which nothing is known yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { number: 0, began: 0, new: 0, looked: 0 }
    }

    /// Looks at the number of the frame at `now_us`, and returns whether a packet may be offered.
    pub const fn may_offer(&mut self, number: u32, now_us: u32) -> bool {
        if number != self.number {
            // somewhere between the last look and this one
            (self.number, self.began, self.new) = (number, self.looked, now_us);
        }
        self.looked = now_us;
        now_us.wrapping_sub(self.began) < OFFER_US || now_us.wrapping_sub(self.new) > NO_FRAMES_US
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn an_idle_bus_refuses_nothing() {
        let mut frame = UsbFrame::new();
        frame.may_offer(7, 5000);
        assert!((1..100).all(|n| frame.may_offer(7, 5000 + NO_FRAMES_US + 100 * n)));
    }

    proptest! {
        /// However rarely the main loop looks: nothing is offered in the last part of a frame, and something at the
        /// first look at a frame that follows another one soon.
        #[test]
        fn nothing_is_offered_in_the_last_part_of_a_frame(
            start: u32, pauses in prop::collection::vec(prop_oneof![9 => 1u32..100, 1 => 1u32..5000], 1..400),
        ) {
            let (mut frame, mut at, mut number) = (UsbFrame::new(), 0u32, 0);
            for pause in pauses {
                at += pause;
                let is_new = at / 1000 != number;
                number = at / 1000;
                let may_offer = frame.may_offer(number & 0x7ff, start.wrapping_add(at));
                // the first frames are not known as such
                if at < 2000 {
                    continue;
                }
                prop_assert!(!may_offer || at % 1000 < OFFER_US, "{}", at % 1000);
                prop_assert!(may_offer || !is_new || pause >= OFFER_US, "{at} is {pause} behind the last look");
            }
        }
    }
}
