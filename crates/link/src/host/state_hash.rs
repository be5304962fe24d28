//! A hash of the state for models that search all reachable states.
//!
//! Invariant: two endpoints with equal hashes behave alike from then on, except by chance.

use core::hash::{Hash, Hasher};

use super::{HostEndpoint, HostTimes};
use crate::CardStatus;

/// Time after which every interval of the endpoint is over, in microseconds.
const LONGEST_US: u64 = 100_000;

impl<const A: usize, const CELLS: usize, const ENTRIES: usize, const COMMANDS: usize>
    HostEndpoint<A, CELLS, ENTRIES, COMMANDS>
{
    /// Hashes what decides about the endpoint's later behaviour at the time `now_us`: times count from then, and what
    /// arrays held before does not count.
    ///
    /// The adaptive size of frames, the counters of the line and the period's number are left out. The size makes no
    /// difference while every frame with commands fits the shortest one. A model that uses this has to check that.
    #[doc(hidden)]
    pub fn hash_state(&self, now_us: u64, state: &mut impl Hasher) {
        #[rustfmt::skip] // no `..`: a new field has to be decided about here
        let Self {
            first_numbers, phase, nonce, greeting, boot, opening, key, probe, probing, settings, decoder, queue, base,
            count, sent, predicted, reported_high, target, sent_rate, rate_seq, acked_rate_seq, entries, first_waiting,
            waiting, period_emitted, next_entry, entry_received, newest_place, status, earlier, reported_crc,
            report_missing, off_path, refusals, fault, alarm, clearing, times, counts: _, frames: _, stage, staged,
            staged_kind,
        } = self;
        (first_numbers, phase, nonce, greeting, boot, opening, key, probe, probing, settings).hash(state);
        decoder.hash_state(state);
        (0..*count).for_each(|k| queue[usize::from(base.wrapping_add(k)) % COMMANDS].hash(state));
        (base, count, sent, reported_high, target, sent_rate, rate_seq, acked_rate_seq).hash(state);
        predicted.hash_state(state);
        (0..*waiting).for_each(|k| entries[usize::from(first_waiting.wrapping_add(k)) % ENTRIES].hash(state));
        (first_waiting, waiting, period_emitted, next_entry, entry_received, newest_place).hash(state);
        CardStatus { period: 0, ..*status }.hash(state);
        (earlier, reported_crc, report_missing, off_path, refusals, fault, alarm, clearing).hash(state);
        times.hash_state(now_us, state);
        (&stage[staged.0..staged.1], staged_kind).hash(state);
    }

    /// Returns the number of commands that are not acknowledged.
    #[doc(hidden)]
    #[must_use]
    pub fn unacknowledged_commands(&self) -> u16 {
        self.count
    }
}

impl HostTimes {
    fn hash_state(&self, now_us: u64, state: &mut impl Hasher) {
        // 0 for `hello` means that a greeting is due
        let Self { now, hello, rate, number, frame, received, progress, queued, gap, nak } = self;
        (number, *hello == 0).hash(state);
        for time in [now, hello, rate, frame, received, progress, queued, gap, nak] {
            now_us.saturating_sub(*time).min(LONGEST_US).hash(state);
        }
    }
}
