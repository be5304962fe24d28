//! Adaptive frame size: on a line that loses many frames, short ones get through more often.
//!
//! Invariant: the size is between the minimum and the maximum payload.

/// Maximum payload of commands and reports; an opening may be longer.
const MOST: usize = 200;
/// Minimum payload: a header, and an entry or two.
const LEAST: usize = 40;
/// Increment of the size after a frame that arrived.
const GROWTH: usize = 8;

/// Payload size that is currently worth sending.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FrameSize(usize);

impl FrameSize {
    /// Starts with the maximum size.
    pub(crate) const fn new() -> Self {
        Self(MOST)
    }

    /// Returns the current maximum payload, in bytes.
    pub(crate) const fn max_payload(self) -> usize {
        self.0
    }

    /// Records that a frame had to be retransmitted.
    pub(crate) fn record_loss(&mut self) {
        self.0 = (self.0 / 2).max(LEAST);
    }

    /// Records that a frame was acknowledged.
    pub(crate) fn record_arrival(&mut self) {
        self.0 = (self.0 + GROWTH).min(MOST);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_size_halves_after_a_loss_and_grows_after_an_arrival() {
        let mut size = FrameSize::new();
        let losses = [100, 50, 40, 40].map(|_| {
            size.record_loss();
            size.max_payload()
        });
        assert_eq!((FrameSize::new().max_payload(), losses), (200, [100, 50, 40, 40]));
        let arrivals = [(); 21].map(|()| {
            size.record_arrival();
            size.max_payload()
        });
        assert_eq!((arrivals[0], arrivals[1], arrivals[19], arrivals[20]), (48, 56, 200, 200));
    }
}
