//! Pacing of writes: the number of bytes that may wait in the operating system.
//!
//! An operator command must not queue behind bytes that were written long before: they cannot be withdrawn. So only
//! what the line sends in some milliseconds is written ahead. The queue length that a driver reports excludes the
//! adapter's own memory, and a pseudo-terminal reports nothing. Therefore bytes are also counted out as fast as the
//! line can send them (a token bucket).
//!
//! Invariant: in any time t no more bytes are granted than the line sends in t, and what it sends in [`AHEAD_NS`].

/// How far ahead bytes are written, in nanoseconds of transmission time.
pub(crate) const AHEAD_NS: u64 = 4_000_000;

/// Bytes that are not sent yet, in nanoseconds of transmission time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WritePacing {
    byte_ns: u64,
    free_at_ns: u64,
}

impl WritePacing {
    /// Pacing for a line that takes `byte_ns` nanoseconds, at least 1, per byte, with nothing pending.
    #[must_use]
    pub(crate) const fn new(byte_ns: u64) -> Self {
        Self { byte_ns: if byte_ns == 0 { 1 } else { byte_ns }, free_at_ns: 0 }
    }

    /// Number of bytes that may be written at `now_ns`, where the driver reports `queued` waiting: always at least one
    /// when none are.
    #[must_use]
    pub(crate) const fn writable_bytes(&self, now_ns: u64, queued: u64) -> usize {
        let counted = self.free_at_ns.saturating_sub(now_ns);
        let told = queued.saturating_mul(self.byte_ns);
        let waiting = if told > counted { told } else { counted };
        if waiting == 0 && AHEAD_NS < self.byte_ns {
            return 1;
        }
        (AHEAD_NS.saturating_sub(waiting) / self.byte_ns) as usize
    }

    /// Records that `bytes` bytes were written at `now_ns`.
    pub(crate) const fn spend(&mut self, now_ns: u64, bytes: usize) {
        let from = if self.free_at_ns > now_ns { self.free_at_ns } else { now_ns };
        self.free_at_ns = from + bytes as u64 * self.byte_ns;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// A writer as greedy as possible, calling at any times, with drivers that report anything.
        #[test]
        fn no_more_than_the_line_sends(
            byte_ns in prop::sample::select(vec![833u64, 10_000, 43_402, 86_805, 1_041_666]),
            asks in prop::collection::vec((0u64..20_000_000, 0u64..600), 1..200),
        ) {
            let mut budget = WritePacing::new(byte_ns);
            let (mut now, mut given) = (0, 0u64);
            for (pause, queued) in asks {
                now += pause;
                let room = budget.writable_bytes(now, queued);
                budget.spend(now, room);
                given += room as u64;
                prop_assert!(given * byte_ns <= now + AHEAD_NS);
                prop_assert!(queued * byte_ns <= AHEAD_NS || room == 0);
                prop_assert_eq!(budget.writable_bytes(now, 0) as u64, (AHEAD_NS - (budget.free_at_ns - now)) / byte_ns);
            }
        }
    }

    #[test]
    fn four_milliseconds_of_common_lines() {
        let room = |byte_ns| WritePacing::new(byte_ns).writable_bytes(7, 0);
        assert_eq!([room(10_000), room(43_402), room(86_805)], [400, 92, 46]);
        assert_eq!(
            WritePacing::new(5_000_000).writable_bytes(7, 0),
            1,
            "a line slower than that still takes a byte at a time"
        );
    }
}
