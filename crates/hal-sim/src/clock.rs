//! The clock of a simulated card.
//!
//! Invariant: period n ends n control periods after the start, however late the ones before it were.

use std::time::{Duration, Instant};

/// Virtual time (as fast as possible) or wall time.
#[derive(Clone, Copy, Debug)]
pub enum Clock {
    /// A period takes no time.
    Virtual,
    /// Periods are counted on the monotonic clock; a late one is caught up.
    Wall {
        /// Start of period 0.
        start: Instant,
        /// Length of a control period.
        period: Duration,
    },
}

impl Clock {
    /// Wall time from now on, with `period_us` microseconds per control period.
    #[must_use]
    pub fn wall(period_us: u32) -> Self {
        Self::Wall { start: Instant::now(), period: Duration::from_micros(u64::from(period_us)) }
    }

    /// Length of a control period in microseconds, or `None` in virtual time.
    #[must_use]
    pub fn period_us(&self) -> Option<u32> {
        match self {
            Self::Virtual => None,
            Self::Wall { period, .. } => u32::try_from(period.as_micros()).ok(),
        }
    }

    /// Waits for the end of period `number`. Returns whether it is reached late, by more than a control period.
    pub fn wait(&self, number: u64) -> bool {
        let Self::Wall { start, period } = self else { return false };
        let nanos = u64::try_from(period.as_nanos()).unwrap_or(u64::MAX).saturating_mul(number);
        let due = *start + Duration::from_nanos(nanos);
        if let Some(rest) = due.checked_duration_since(Instant::now()) {
            std::thread::sleep(rest);
        }
        due.elapsed() > *period
    }
}
