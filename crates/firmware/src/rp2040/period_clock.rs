//! The moments at which the control periods begin, in microseconds of the chip's timer.
//!
//! Invariant: a period that had its words in time begins where the one before has ended; any other begins when they are
//! put. A moment is never later than the one at which it is asked for, nor more than a period before it.

/// The clock of the control periods.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PeriodClock {
    /// Begin of the period whose words were put last.
    begins_us: u32,
}

impl PeriodClock {
    /// Creates a clock that knows no period.
    #[must_use]
    pub const fn new() -> Self {
        Self { begins_us: 0 }
    }

    /// Takes a period whose words are put now. `is_waited_for`: the one before has ended. `last_us`: its length.
    pub const fn put(&mut self, now_us: u32, is_waited_for: bool, last_us: u32) {
        self.begins_us = if is_waited_for { now_us } else { self.begins_us.wrapping_add(last_us) };
    }

    /// Returns the moment from which the next period ends two periods later: that at which the period has begun whose
    /// words were put last. If the words of the next one are late, since more than a period has passed, it is a period
    /// ago: that one begins now.
    pub const fn begun_us(&mut self, now_us: u32, period_us: u32) -> u32 {
        let since = now_us.wrapping_sub(self.begins_us);
        if since > u32::MAX / 2 {
            self.begins_us = now_us;
        }
        if since <= period_us || since > u32::MAX / 2 { self.begins_us } else { now_us.wrapping_sub(period_us) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn periods_follow_each_other_whenever_they_are_asked_for() {
        let mut clock = PeriodClock::new();
        clock.put(u32::MAX - 1_499, true, 1000);
        assert_eq!(clock.begun_us(u32::MAX - 1_400, 1000), u32::MAX - 1_499);
        clock.put(u32::MAX - 900, false, 1000);
        assert_eq!(clock.begun_us(u32::MAX - 300, 1000), u32::MAX - 499, "the next has begun");
        clock.put(u32::MAX - 200, false, 1000);
        assert_eq!(clock.begun_us(507, 1000), 500, "over the wrap");
    }

    #[test]
    fn a_late_period_begins_when_it_is_put() {
        let mut clock = PeriodClock::new();
        clock.put(10_000, true, 1000);
        clock.put(13_700, true, 1000);
        assert_eq!(clock.begun_us(13_710, 1000), 13_700);
        clock.put(13_800, false, 1000);
        assert_eq!(clock.begun_us(14_705, 1000), 14_700);
    }

    #[test]
    fn a_period_has_begun_now_at_the_latest_and_a_period_ago_at_the_earliest() {
        let mut clock = PeriodClock::new();
        clock.put(10_000, true, 1000);
        clock.put(10_100, false, 1000);
        assert_eq!(clock.begun_us(10_990, 1000), 10_990, "the chip's clocks differ");
        clock.put(11_000, false, 1000);
        assert_eq!(clock.begun_us(15_000, 1000), 14_000, "the next period is late");
    }
}
