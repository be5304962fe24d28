//! Delay before the next attempt to reach the broker: 0.2 to 30 s, at random (SHP-18).
//!
//! Invariant: each delay is within its bounds, so that neither a broker nor an operator waits for long.

use std::time::Duration;

/// Shortest delay.
const MIN_DELAY: Duration = Duration::from_millis(200);
/// Longest delay.
const MAX_DELAY: Duration = Duration::from_secs(30);

/// Delays that double from one failure to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct ReconnectionDelay {
    failures: u32,
}

impl ReconnectionDelay {
    /// A connection was good: the next delay is short again.
    pub(super) fn reset(&mut self) {
        self.failures = 0;
    }

    /// The next delay: at least half of its bound, which doubles each time. `random` is any number.
    pub(super) fn next(&mut self, random: u32) -> Duration {
        let bound = (2 * MIN_DELAY).saturating_mul(1 << self.failures.min(16)).min(MAX_DELAY);
        self.failures = self.failures.saturating_add(1);
        bound / 2 + (bound / 2).mul_f64(f64::from(random) / f64::from(u32::MAX))
    }
}

/// A random number; 0 where the system has none to give.
pub(super) fn random() -> u32 {
    getrandom::u32().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delays_grow_within_their_bounds() {
        let mut delay = ReconnectionDelay::default();
        assert_eq!(delay.next(0), MIN_DELAY);
        assert_eq!(delay.next(u32::MAX), Duration::from_millis(800));
        for _ in 0..40 {
            let (low, high) = (delay.clone().next(0), delay.next(u32::MAX));
            assert!(low >= MIN_DELAY && high <= MAX_DELAY && low <= high, "{low:?} {high:?}");
        }
        assert_eq!(delay.next(u32::MAX), MAX_DELAY);
        delay.reset();
        assert_eq!(delay.next(0), MIN_DELAY);
    }
}
