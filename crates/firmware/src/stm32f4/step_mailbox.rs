//! Mailbox for the increments of a control period, from the main loop to the step interrupt.
//!
//! Invariant: each step batch that was put is taken exactly once, completely, in the order in which they were put.

use core::sync::atomic::{AtomicBool, AtomicI32, AtomicU32, Ordering};

use crate::step_batch::{StepBatch, StepShape};

/// Mailbox for one step batch: one context puts, one takes.
pub struct StepMailbox<const A: usize> {
    /// Whether it holds a batch. Set by the putting side, cleared by the taking side; the flag tells which side owns
    /// the other fields.
    full: AtomicBool,
    increments: [AtomicI32; A],
    period_us: AtomicU32,
    /// Length of a pulse in the lower half, direction set-up in the upper.
    times: AtomicU32,
    inverted: AtomicU32,
    /// Slot at which the period of the batch begins that was taken last.
    begins: AtomicU32,
}

impl<const A: usize> StepMailbox<A> {
    /// Creates an empty mailbox.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            full: AtomicBool::new(false),
            increments: [const { AtomicI32::new(0) }; A],
            period_us: AtomicU32::new(0),
            times: AtomicU32::new(0),
            inverted: AtomicU32::new(0),
            begins: AtomicU32::new(0),
        }
    }

    /// Whether the next batch may be put. For the putting side only.
    #[must_use]
    pub fn is_free(&self) -> bool {
        !self.full.load(Ordering::Acquire)
    }

    /// Puts a batch. Returns false and changes nothing if the last one was not taken yet. For the putting side only.
    pub fn put(&self, order: &StepBatch<A>) -> bool {
        if !self.is_free() {
            return false;
        }
        for (cell, &increment) in self.increments.iter().zip(&order.increments) {
            cell.store(increment, Ordering::Relaxed);
        }
        let StepShape { period_us, pulse_ns, setup_ns, inverted } = order.shape;
        self.period_us.store(period_us, Ordering::Relaxed);
        self.times.store(u32::from(pulse_ns) | u32::from(setup_ns) << 16, Ordering::Relaxed);
        self.inverted.store(u32::from(inverted), Ordering::Relaxed);
        self.full.store(true, Ordering::Release);
        true
    }

    /// Returns the slot at which the period begins whose batch was taken last, in slots since the start, which wrap
    /// around. Valid while the next batch may be put; for the putting side only.
    #[must_use]
    pub fn begins(&self) -> u32 {
        self.begins.load(Ordering::Relaxed)
    }

    /// Takes the batch, if there is one; its period begins at slot `begins`. For the taking side only.
    pub fn take(&self, begins: u32) -> Option<StepBatch<A>> {
        if !self.full.load(Ordering::Acquire) {
            return None;
        }
        let mut increments = [0; A];
        for (increment, cell) in increments.iter_mut().zip(&self.increments) {
            *increment = cell.load(Ordering::Relaxed);
        }
        let times = self.times.load(Ordering::Relaxed);
        let shape = StepShape {
            period_us: self.period_us.load(Ordering::Relaxed),
            pulse_ns: times as u16,
            setup_ns: (times >> 16) as u16,
            inverted: self.inverted.load(Ordering::Relaxed) as u16,
        };
        self.begins.store(begins, Ordering::Relaxed);
        self.full.store(false, Ordering::Release);
        Some(StepBatch { increments, shape })
    }
}

impl<const A: usize> Default for StepMailbox<A> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(n: u32) -> StepBatch<2> {
        let shape = StepShape {
            period_us: n.rotate_left(9),
            pulse_ns: n as u16,
            setup_ns: !n as u16,
            inverted: (n >> 3) as u16,
        };
        StepBatch { increments: [n as i32, -(n as i32)], shape }
    }

    #[test]
    fn every_order_arrives_whole_and_once_between_threads() {
        static HANDOVER: StepMailbox<2> = StepMailbox::new();
        const COUNT: u32 = 20_000;
        let putting = std::thread::spawn(|| {
            for n in 0..COUNT {
                while !HANDOVER.put(&order(n)) {
                    std::thread::yield_now();
                }
            }
        });
        for n in 0..COUNT {
            let taken = loop {
                match HANDOVER.take(n) {
                    Some(taken) => break taken,
                    None => std::thread::yield_now(),
                }
            };
            assert_eq!(taken, order(n));
        }
        putting.join().expect("the putting side");
        assert_eq!(HANDOVER.take(0), None);
    }

    #[test]
    fn an_order_that_was_not_taken_is_not_overwritten() {
        let mailbox = StepMailbox::new();
        assert!(mailbox.is_free() && mailbox.put(&order(1)));
        assert!(!mailbox.is_free() && !mailbox.put(&order(2)));
        assert_eq!((mailbox.take(77), mailbox.begins()), (Some(order(1)), 77));
    }
}
