//! What drives count at the port of the axes, from the words that are played to it.
//!
//! Invariant: it knows levels alone; a rising edge of a step counts by the level of its direction.

use core::sync::atomic::Ordering::Relaxed;

use super::pins::{FIRST_DIRECTION_PIN, FIRST_STEP_PIN};
use super::step_filler::SlotBuffer;
use crate::AXES;

/// The port's levels, and the counts.
pub struct PortCounter {
    port: u32,
    counts: [i32; AXES],
}

impl PortCounter {
    /// Creates a counter at 0 of a port whose pins are low.
    #[must_use]
    pub const fn new() -> Self {
        Self { port: 0, counts: [0; AXES] }
    }

    /// Plays a buffer; `inverted`: axes for which a high direction is backward, one bit each.
    pub fn play(&mut self, buffer: &SlotBuffer, inverted: u16) {
        for word in buffer.iter().map(|word| word.load(Relaxed)).filter(|&word| word != 0) {
            let before = self.port;
            self.port = (before & !(word >> 16)) | (word & 0xffff);
            let rises = (!before & self.port) >> FIRST_STEP_PIN;
            let forward = self.port >> FIRST_DIRECTION_PIN ^ u32::from(inverted);
            for (axis, count) in self.counts.iter_mut().enumerate().filter(|(axis, _)| rises >> axis & 1 == 1) {
                *count = count.wrapping_add(if forward >> axis & 1 == 1 { 1 } else { -1 });
            }
        }
    }

    /// Returns the net pulses of each axis; they wrap around.
    #[must_use]
    pub const fn counts(&self) -> &[i32; AXES] {
        &self.counts
    }
}

impl Default for PortCounter {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::super::pins::{direction_word, step_word};
    use super::super::step_filler::empty_buffer;
    use super::*;

    #[test]
    fn rising_edges_count_by_their_direction() {
        let (buffer, mut counter) = (empty_buffer(), PortCounter::new());
        let words = [direction_word(0, false, 0), step_word(0, true), step_word(0, true), step_word(0, false)];
        let more = [direction_word(0, true, 0) | direction_word(2, true, 4), step_word(0, true) | step_word(2, true)];
        for (slot, word) in buffer.iter().zip(words.into_iter().chain(more)) {
            slot.store(word, Relaxed);
        }
        counter.play(&buffer, 4);
        assert_eq!(counter.counts(), &[0, 0, -1, 0]);
    }
}
