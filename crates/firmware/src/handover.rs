//! The hand-over of a control period's increments from the main loop to the step interrupt.
//!
//! Invariant: each order that was put is taken exactly once, whole, in the order in which they were put.

use core::sync::atomic::{AtomicBool, AtomicI32, AtomicU32, Ordering};

use crate::period::Period;

/// Net pulses of each axis in a control period, and what must be known to make them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Order<const A: usize> {
    /// Net pulses of each axis.
    pub increments: [i32; A],
    /// The period that they are spread over.
    pub period: Period,
    /// Slots that a step pulse is long at least, and as many that it is away, at least 1.
    pub pulse_slots: u16,
    /// Slots that the direction stands before the first step, at least 1.
    pub setup_slots: u16,
    /// Axes whose direction output is the other way round, one bit each.
    pub inverted: u16,
}

/// Room for one order: one context puts, one takes.
pub struct Handover<const A: usize> {
    /// Is there an order? Set by the putting side, cleared by the taking side; the rest belongs to whom it says.
    full: AtomicBool,
    increments: [AtomicI32; A],
    slots: AtomicU32,
    ticks_per_slot: AtomicU32,
    /// Length of a pulse in the lower half, direction set-up in the upper.
    times: AtomicU32,
    inverted: AtomicU32,
}

impl<const A: usize> Handover<A> {
    /// No order.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            full: AtomicBool::new(false),
            increments: [const { AtomicI32::new(0) }; A],
            slots: AtomicU32::new(0),
            ticks_per_slot: AtomicU32::new(0),
            times: AtomicU32::new(0),
            inverted: AtomicU32::new(0),
        }
    }

    /// May the next order be put? The putting side's.
    #[must_use]
    pub fn is_free(&self) -> bool {
        !self.full.load(Ordering::Acquire)
    }

    /// Puts an order; false where the last one was not taken yet, and nothing has changed then. The putting side's.
    pub fn put(&self, order: &Order<A>) -> bool {
        if !self.is_free() {
            return false;
        }
        for (cell, &increment) in self.increments.iter().zip(&order.increments) {
            cell.store(increment, Ordering::Relaxed);
        }
        self.slots.store(order.period.slots, Ordering::Relaxed);
        self.ticks_per_slot.store(order.period.ticks_per_slot, Ordering::Relaxed);
        self.times.store(u32::from(order.pulse_slots) | u32::from(order.setup_slots) << 16, Ordering::Relaxed);
        self.inverted.store(u32::from(order.inverted), Ordering::Relaxed);
        self.full.store(true, Ordering::Release);
        true
    }

    /// Takes the order, if there is one. The taking side's.
    pub fn take(&self) -> Option<Order<A>> {
        if !self.full.load(Ordering::Acquire) {
            return None;
        }
        let mut increments = [0; A];
        for (increment, cell) in increments.iter_mut().zip(&self.increments) {
            *increment = cell.load(Ordering::Relaxed);
        }
        let times = self.times.load(Ordering::Relaxed);
        let order = Order {
            increments,
            period: Period {
                slots: self.slots.load(Ordering::Relaxed),
                ticks_per_slot: self.ticks_per_slot.load(Ordering::Relaxed),
            },
            pulse_slots: times as u16,
            setup_slots: (times >> 16) as u16,
            inverted: self.inverted.load(Ordering::Relaxed) as u16,
        };
        self.full.store(false, Ordering::Release);
        Some(order)
    }
}

impl<const A: usize> Default for Handover<A> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(n: u32) -> Order<2> {
        Order {
            increments: [n as i32, -(n as i32)],
            period: Period { slots: n ^ 5, ticks_per_slot: n.rotate_left(9) },
            pulse_slots: n as u16,
            setup_slots: !n as u16,
            inverted: (n >> 3) as u16,
        }
    }

    #[test]
    fn every_order_arrives_whole_and_once_between_threads() {
        static HANDOVER: Handover<2> = Handover::new();
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
                match HANDOVER.take() {
                    Some(taken) => break taken,
                    None => std::thread::yield_now(),
                }
            };
            assert_eq!(taken, order(n));
        }
        putting.join().expect("the putting side");
        assert_eq!(HANDOVER.take(), None);
    }

    #[test]
    fn an_order_that_was_not_taken_is_not_overwritten() {
        let handover = Handover::new();
        assert!(handover.is_free() && handover.put(&order(1)));
        assert!(!handover.is_free() && !handover.put(&order(2)));
        assert_eq!(handover.take(), Some(order(1)));
    }
}
