//! A model of the DMA stream that plays the buffers to the port, for tests (RM0090, 10.3: double-buffer mode).
//!
//! Invariant: it plays the very buffers that [`StepFiller`] fills, one word a slot, round and round: a buffer that was
//! not filled in time is played again.

use core::sync::atomic::Ordering::Relaxed;

use super::axis_edges::SlotTimes;
use super::period::BUFFER_SLOTS;
use super::pins::{FIRST_DIRECTION_PIN, FIRST_STEP_PIN};
use super::step_filler::{SlotBuffer, StepFiller, empty_buffer};
use super::step_mailbox::StepMailbox;
use crate::AXES;
use crate::step_batch::{StepBatch, StepShape};

/// The stream, its two buffers, and the interrupt at the end of each.
pub(super) struct Stream {
    buffers: [SlotBuffer; 2],
    /// Buffer that is played, and its next word.
    current: usize,
    at: usize,
    /// Slots until the interrupt of the buffer that has ended runs.
    interrupt: Option<usize>,
    pub(super) filler: StepFiller,
}

impl Stream {
    pub(super) fn new() -> Self {
        let buffers = [const { empty_buffer() }; 2];
        Self { buffers, current: 0, at: 0, interrupt: None, filler: StepFiller::new() }
    }

    /// Plays one word; the interrupt of a buffer that ends with it comes `latency` slots later.
    pub(super) fn tick(&mut self, mailbox: &StepMailbox<AXES>, latency: usize) -> u32 {
        match self.interrupt {
            Some(0) => {
                self.interrupt = None;
                self.filler.fill(&self.buffers[1 - self.current], mailbox);
            }
            Some(slots) => self.interrupt = Some(slots - 1),
            None => {}
        }
        let word = self.buffers[self.current][self.at].load(Relaxed);
        self.at += 1;
        if self.at == BUFFER_SLOTS {
            assert_eq!(self.interrupt, None, "the interrupt of the buffer before has run");
            (self.current, self.at, self.interrupt) = (1 - self.current, 0, Some(latency));
        }
        word
    }
}

/// Drives at the port: they check every time, and count.
pub(super) struct Drives {
    port: u32,
    now: u64,
    rose: [Option<u64>; AXES],
    fell: [Option<u64>; AXES],
    turned: [Option<u64>; AXES],
    pub(super) counts: [i32; AXES],
}

impl Drives {
    pub(super) fn new() -> Self {
        let never = [None; AXES];
        Self { port: 0, now: 0, rose: never, fell: never, turned: never, counts: [0; AXES] }
    }

    /// Sees the port after a word of the stream.
    pub(super) fn see(&mut self, word: u32, times: &SlotTimes, inverted: u16) {
        let before = self.port;
        self.port = (before & !(word >> 16)) | (word & 0xffff);
        for axis in 0..AXES {
            let level = |port: u32, first: u8| port >> (usize::from(first) + axis) & 1 == 1;
            let [was_high, is_high] = [before, self.port].map(|port| level(port, FIRST_STEP_PIN));
            let [was_up, is_up] = [before, self.port].map(|port| level(port, FIRST_DIRECTION_PIN));
            let long = |moment: Option<u64>, least: u32| moment.is_none_or(|at| self.now - at >= u64::from(least));
            if was_up != is_up {
                assert!(!was_high && !is_high && long(self.fell[axis], times.setup), "a direction turns too soon");
                self.turned[axis] = Some(self.now);
            }
            match (was_high, is_high) {
                (false, true) => {
                    assert!(long(self.turned[axis], times.setup), "a step too soon behind its direction");
                    assert!(long(self.fell[axis], times.pulse), "a step is low for too short a time");
                    self.rose[axis] = Some(self.now);
                    self.counts[axis] += if is_up != (inverted >> axis & 1 == 1) { 1 } else { -1 };
                }
                (true, false) => {
                    let length = self.rose[axis].map(|at| self.now - at);
                    assert_eq!(length, Some(u64::from(times.pulse)), "the length of a step");
                    self.fell[axis] = Some(self.now);
                }
                _ => {}
            }
        }
        self.now += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use retrace_card::StepTiming;

    /// Runs batches, as the main loop puts them: whenever there is room, but `lags` slots late.
    struct Rig {
        stream: Stream,
        drives: Drives,
        mailbox: StepMailbox<AXES>,
        /// Batches that were put, and the drives' counts at the end of each.
        put: usize,
    }

    impl Rig {
        fn new() -> Self {
            Self { stream: Stream::new(), drives: Drives::new(), mailbox: StepMailbox::new(), put: 0 }
        }

        fn run(&mut self, batches: &[StepBatch<AXES>], latency: usize, lag: usize) {
            let (mut waited, mut next) = (0, 0);
            let Some(shape) = batches.first().map(|batch| batch.shape) else { return };
            let times = SlotTimes::of(&shape);
            // every batch, what is in the buffers, and what the drives see of it
            let slots = batches.len() * (times.period as usize + lag) + 4 * BUFFER_SLOTS;
            for _ in 0..slots + batches.len() * BUFFER_SLOTS {
                if next < batches.len() && self.mailbox.is_free() {
                    waited += 1;
                    if waited > lag {
                        assert!(self.mailbox.put(&batches[next]));
                        (waited, next) = (0, next + 1);
                        self.put += 1;
                    }
                }
                let word = self.stream.tick(&self.mailbox, latency);
                self.drives.see(word, &times, shape.inverted);
            }
            assert_eq!(next, batches.len(), "all were put");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// Any batches of any shapes, with any latency of the interrupt below a buffer, and a main loop that is late:
        /// the drives have counted what was ordered.
        #[test]
        fn drives_count_what_was_ordered(
            runs in prop::collection::vec(
                (1u32..9, 1u16..6000, 1u16..25_000, 0u16..16, 0usize..BUFFER_SLOTS - 1, 0usize..3000,
                    prop::collection::vec(prop::array::uniform4(-100i32..=100), 0..9)),
                1..5,
            ),
        ) {
            let (mut rig, mut sum) = (Rig::new(), [0; AXES]);
            for (quarters, pulse_ns, setup_ns, inverted, latency, lag, shares) in runs {
                let period_us = quarters * 250 + u32::from(setup_ns % 7);
                let shape = StepShape { period_us, pulse_ns, setup_ns, inverted };
                let timing = StepTiming::of_clock(super::super::period::SLOT_HZ, period_us, pulse_ns, setup_ns);
                let Some(most) = timing.map(|timing| i32::from(timing.max_increment())) else { continue };
                // the directions of a new shape are stable before the first step: a period without pulses
                let mut batches = vec![StepBatch { increments: [0; AXES], shape }; 1 + usize::from(setup_ns) / 1000];
                for share in shares {
                    let increments = share.map(|share| share * most / 100);
                    for axis in 0..AXES { sum[axis] += increments[axis]; }
                    batches.push(StepBatch { increments, shape });
                }
                rig.run(&batches, latency, lag);
                prop_assert_eq!(rig.drives.counts, sum);
                prop_assert_eq!((rig.stream.filler.counted(), rig.stream.filler.refused()), (&sum, 0));
            }
        }
    }

    /// At the highest rate, with a main loop that is in time, no period is late.
    #[test]
    fn the_highest_rate_is_made_on_all_axes_without_a_late_period() {
        let shape = StepShape { pulse_ns: 1500, ..StepShape::INITIAL };
        let mut rig = Rig::new();
        let still = StepBatch { increments: [0; AXES], shape };
        let most = (super::super::period::MAX_PULSES_HZ / 1000) as i32;
        let moves =
            (0..40).map(|n| StepBatch { increments: [most, -most, if n % 2 == 0 { most } else { -most }, n], shape });
        let batches: Vec<_> = std::iter::repeat_n(still, 8).chain(moves).collect();
        rig.run(&batches, 400, 100);
        assert_eq!(rig.drives.counts, [40 * most, -40 * most, 0, (0..40).sum()]);
        // the last one ends without another: that is the only one
        assert_eq!((rig.stream.filler.late(), rig.stream.filler.refused()), (1, 0));
    }
}
