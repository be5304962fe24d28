//! Fills buffers with the words that the DMA plays to the port of the axes, one word a slot.
//!
//! Invariant: every pulse of every batch that was taken is in the buffers once, in the slots of that batch's period. If
//! a period has no batch yet, it waits, and nothing moves meanwhile; a late main loop stretches time and loses no
//! pulse.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use super::axis_edges::{AxisEdges, EdgeWords, SlotTimes, add};
use super::period::BUFFER_SLOTS;
use super::pins::{direction_word, step_word};
use super::step_mailbox::StepMailbox;
use crate::AXES;
use crate::step_batch::{StepBatch, StepShape};

/// A buffer: one word for the bit set/reset register a slot; 0 changes nothing. The DMA reads it while another one is
/// filled.
pub type SlotBuffer = [AtomicU32; BUFFER_SLOTS];

/// Creates an empty buffer.
#[must_use]
pub const fn empty_buffer() -> SlotBuffer {
    [const { AtomicU32::new(0) }; BUFFER_SLOTS]
}

/// The axes, and the position within the period.
pub struct StepFiller {
    axes: [AxisEdges; AXES],
    shape: StepShape,
    times: SlotTimes,
    /// First slot of the next buffer, in slots since the start, which wrap around.
    buffer_begins: u32,
    /// Next slot of the period; at its end the next one is due.
    at: u32,
    /// Whether the directions have to be set, whatever they are.
    sets_directions: bool,
    /// Whether a period was in progress at the end of the last buffer.
    running: bool,
    /// Pulses forward minus pulses backward of each axis in the buffers, wrapping around.
    counted: [i32; AXES],
    refused: u32,
    late: u32,
}

impl StepFiller {
    /// Creates an idle state.
    #[must_use]
    pub const fn new() -> Self {
        let times = SlotTimes::of(&StepShape::INITIAL);
        Self {
            axes: [const { AxisEdges::new() }; AXES],
            shape: StepShape::INITIAL,
            times,
            // the first buffers are played empty
            buffer_begins: 2 * BUFFER_SLOTS as u32,
            at: times.period,
            sets_directions: true,
            running: false,
            counted: [0; AXES],
            refused: 0,
            late: 0,
        }
    }

    /// Fills a buffer.
    pub fn fill(&mut self, buffer: &SlotBuffer, orders: &StepMailbox<AXES>) {
        for word in buffer {
            word.store(0, Relaxed);
        }
        let buffer_begins = self.buffer_begins;
        self.buffer_begins = buffer_begins.wrapping_add(BUFFER_SLOTS as u32);
        let mut from = 0;
        while from < BUFFER_SLOTS {
            if self.at == self.times.period {
                let Some(order) = orders.take(buffer_begins.wrapping_add(from as u32)) else {
                    self.late += u32::from(core::mem::take(&mut self.running));
                    return;
                };
                self.begin_period(&order);
                self.running = true;
            }
            let count = (BUFFER_SLOTS - from).min((self.times.period - self.at) as usize);
            self.fill_part(&buffer[from..from + count]);
            from += count;
        }
    }

    /// Fills words with the next slots of the period.
    fn fill_part(&mut self, cells: &[AtomicU32]) {
        let (from, until) = (self.at, self.at + cells.len() as u32);
        if core::mem::take(&mut self.sets_directions) {
            for (axis, edges) in self.axes.iter().enumerate() {
                add(&cells[0], direction_word(axis, edges.is_backward(), self.shape.inverted));
            }
        }
        for (axis, (edges, count)) in self.axes.iter_mut().zip(&mut self.counted).enumerate() {
            let direction = direction_word(axis, edges.is_backward(), self.shape.inverted);
            let words = EdgeWords { rise: step_word(axis, true), fall: step_word(axis, false), direction };
            let begun = edges.emit(&self.times, from, cells, &words);
            *count = if edges.is_backward() {
                count.wrapping_sub_unsigned(begun)
            } else {
                count.wrapping_add_unsigned(begun)
            };
        }
        self.at = until;
    }

    fn begin_period(&mut self, order: &StepBatch<AXES>) {
        if order.shape != self.shape {
            // the directions become forward with it: such a batch has no pulses
            self.axes = [const { AxisEdges::new() }; AXES];
            (self.shape, self.times, self.sets_directions) = (order.shape, SlotTimes::of(&order.shape), true);
        }
        for (edges, &increment) in self.axes.iter_mut().zip(&order.increments) {
            self.refused = self.refused.wrapping_add(u32::from(edges.begin_period(&self.times, increment).is_err()));
        }
        self.at = 0;
    }

    /// Returns the net pulses of each axis in the buffers since the start; they wrap around.
    #[must_use]
    pub const fn counted(&self) -> &[i32; AXES] {
        &self.counted
    }

    /// Returns the axes whose direction output is inverted, one bit each.
    #[must_use]
    pub const fn inverted(&self) -> u16 {
        self.shape.inverted
    }

    /// Returns the number of batches whose pulses did not fit their period: a defect.
    #[must_use]
    pub const fn refused(&self) -> u32 {
        self.refused
    }

    /// Returns the number of periods that began late because there was no batch.
    #[must_use]
    pub const fn late(&self) -> u32 {
        self.late
    }
}

impl Default for StepFiller {
    fn default() -> Self {
        Self::new()
    }
}
