//! Homing: an axis finds its home switch (LinuxCNC and grbl use the same term).
//!
//! The axis moves fast toward the switch and comes to rest after it closes. It moves slowly back until the switch opens
//! again, which is the place that the count refers to, and comes to rest. The speed changes by the same amount per
//! period everywhere. Positions are whole pulses and a fraction of 2⁻³², so that a slow search emits exactly the pulses
//! that its speed requires.
//!
//! Invariant: the increments of a search sum to the axis' displacement, none of them exceeds the faster of the
//! command's two speeds rounded up, and a search ends at rest.

use retrace_link::HomingCommand;

/// One pulse per period, in the units of a speed.
const PULSE: i64 = 1 << 32;

/// Phase of a search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum HomingPhase {
    /// Fast toward the switch.
    Toward,
    /// The switch has closed: brake to rest.
    Overrun,
    /// Slowly back; `turned` is the displacement where the search reversed.
    Back { turned: i64 },
    /// The switch has opened at displacement `edge`: brake to rest.
    Settle { edge: i64 },
    /// Brake to rest and end with this result.
    Ending(HomingEnd),
}

/// Result of a search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HomingEnd {
    /// The switch was found; this is the axis' count.
    Found(i64),
    /// The switch did not close, or did not open again, within the maximum distance.
    NotFound,
    /// The search was stopped.
    Stopped,
}

/// Search of one axis for its switch.
#[derive(Clone, Debug)]
pub struct HomingSearch {
    command: HomingCommand,
    phase: HomingPhase,
    /// Speed toward the switch, in 2⁻³² pulses a period.
    speed: i64,
    /// Fraction of a pulse still to be emitted, in 2⁻³².
    fraction: i64,
    /// Whole pulses emitted, toward the switch.
    moved: i64,
}

impl HomingSearch {
    /// Creates a search at rest. Returns `None` if the command's speeds are not above 0, or faster than `most` pulses
    /// per period, or its count is beyond 2⁴⁸, which no axis reaches.
    #[must_use]
    pub fn new(order: HomingCommand, most: u16) -> Option<Self> {
        let limit = i64::from(most) * PULSE;
        let legal = |speed: i64| 0 < speed && speed <= limit;
        let near = order.count.unsigned_abs() <= 1 << 48;
        let valid = near && legal(order.search_speed) && legal(order.latch_speed) && order.acceleration > 0;
        valid.then_some(Self { command: order, phase: HomingPhase::Toward, speed: 0, fraction: 0, moved: 0 })
    }

    /// Returns the axis, and whether its upper end is searched.
    #[must_use]
    pub const fn target_switch(&self) -> (u8, bool) {
        (self.command.axis, self.command.upper)
    }

    /// Brings the axis to rest; the search then ends as [`HomingEnd::Stopped`], unless it has failed already.
    pub fn stop(&mut self) {
        if !matches!(self.phase, HomingPhase::Ending(_)) {
            self.phase = HomingPhase::Ending(HomingEnd::Stopped);
        }
    }

    /// Runs one control period with the switch `closed` at its beginning. Returns the axis' increment, and the result
    /// if this was the last period.
    pub fn run_period(&mut self, closed: bool) -> (i32, Option<HomingEnd>) {
        self.observe_switch(closed);
        if let (0, Some(ending)) = (self.speed, self.end_at_rest()) {
            return (0, Some(ending));
        }
        let wanted = match self.phase {
            HomingPhase::Toward => self.command.search_speed,
            HomingPhase::Back { .. } => -self.command.latch_speed,
            HomingPhase::Overrun | HomingPhase::Settle { .. } | HomingPhase::Ending(_) => 0,
        };
        let most = self.command.acceleration;
        self.speed += (wanted - self.speed).clamp(-most, most);
        self.fraction += self.speed;
        let pulses = self.fraction.div_euclid(PULSE);
        self.fraction = self.fraction.rem_euclid(PULSE);
        self.moved += pulses;
        // At most `most` pulses per period, which is a 32-bit number.
        let increment = pulses as i32;
        (if self.command.upper { increment } else { -increment }, None)
    }

    /// Updates the phase from the switch and the displacement.
    fn observe_switch(&mut self, closed: bool) {
        let max_travel = i64::from(self.command.max_travel);
        self.phase = match self.phase {
            HomingPhase::Toward if closed => HomingPhase::Overrun,
            HomingPhase::Toward if self.moved >= max_travel => HomingPhase::Ending(HomingEnd::NotFound),
            HomingPhase::Back { .. } if !closed => HomingPhase::Settle { edge: self.moved },
            HomingPhase::Back { turned } if turned - self.moved >= max_travel => {
                HomingPhase::Ending(HomingEnd::NotFound)
            }
            phase => phase,
        };
        if self.phase == HomingPhase::Overrun && self.speed == 0 {
            self.phase = HomingPhase::Back { turned: self.moved };
        }
    }

    fn end_at_rest(&self) -> Option<HomingEnd> {
        match self.phase {
            HomingPhase::Settle { edge } => {
                let beyond = if self.command.upper { self.moved - edge } else { edge - self.moved };
                Some(HomingEnd::Found(self.command.count + beyond))
            }
            HomingPhase::Ending(ending) => Some(ending),
            HomingPhase::Toward | HomingPhase::Overrun | HomingPhase::Back { .. } => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A switch that is closed from position `at` on, seen from the axis; ends with the position, what ended it, and
    /// the periods.
    fn run(order: HomingCommand, at: i64, stop: Option<u32>) -> (i64, HomingEnd, u32) {
        let mut search = HomingSearch::new(order, 100).expect("valid");
        let (mut position, mut speed) = (0i64, 0i64);
        for n in 0..1_000_000 {
            if stop == Some(n) {
                search.stop();
            }
            let closed = if order.upper { position >= at } else { position <= -at };
            let (increment, ending) = search.run_period(closed);
            position += i64::from(increment);
            let fastest = order.search_speed.max(order.latch_speed);
            assert!(i64::from(increment.abs()) <= (fastest + PULSE - 1) / PULSE);
            assert!((search.speed - speed).abs() <= order.acceleration, "a jump of the speed");
            speed = search.speed;
            if let Some(ending) = ending {
                assert_eq!((increment, search.speed), (0, 0));
                return (position, ending, n);
            }
        }
        panic!("it has no end");
    }

    fn order(upper: bool, fast: i64, slow: i64, acceleration: i64) -> HomingCommand {
        HomingCommand {
            axis: 1,
            upper,
            search_speed: fast,
            latch_speed: slow,
            acceleration,
            max_travel: 2000,
            count: -500,
        }
    }

    #[test]
    fn a_search_without_speed_is_refused() {
        let good = order(true, PULSE, PULSE, PULSE);
        assert!(HomingSearch::new(good, 1).is_some());
        let bad = [
            HomingCommand { search_speed: 0, ..good },
            HomingCommand { latch_speed: -1, ..good },
            HomingCommand { acceleration: 0, ..good },
            HomingCommand { search_speed: PULSE + 1, ..good },
        ];
        assert!(bad.iter().all(|&order| HomingSearch::new(order, 1).is_none()));
        let hostile = HomingCommand { search_speed: i64::MAX, acceleration: i64::MAX, ..good };
        assert!(
            HomingSearch::new(hostile, u16::MAX).is_none()
                && HomingSearch::new(HomingCommand { count: i64::MIN, ..good }, 1).is_none()
        );
    }

    #[test]
    fn a_switch_out_of_reach_is_not_found_and_a_switch_that_stays_closed_neither() {
        let (position, ending, _) = run(order(true, 3 * PULSE, PULSE / 4, PULSE / 8), 5000, None);
        assert!(ending == HomingEnd::NotFound && (2000..2050).contains(&position), "{position}");
        let mut search = HomingSearch::new(order(false, 3 * PULSE, PULSE / 4, PULSE / 8), 100).expect("valid");
        let (mut position, mut ending) = (0, None);
        while ending.is_none() {
            let increment;
            (increment, ending) = search.run_period(true);
            position += increment;
        }
        assert!(ending == Some(HomingEnd::NotFound) && (2000..2003).contains(&position), "{position}");
    }

    proptest! {
        /// Wherever the switch is and however fast the order: the count says where the axis stands, as seen from the
        /// edge of the switch, to within the way of one slow period.
        #[test]
        fn the_count_refers_to_the_edge(
            upper in any::<bool>(), at in -300i64..1900, fast in 1..40 * PULSE, slow in PULSE / 50..3 * PULSE,
                acceleration in PULSE / 200..PULSE,
        ) {
            let order = order(upper, fast, slow, acceleration);
            // slow enough searches take for ever
            prop_assume!(fast > PULSE / 50);
            let (position, ending, _) = run(order, at, None);
            let HomingEnd::Found(count) = ending else { panic!("{ending:?}") };
            let from_edge = if upper { position - at } else { position + at };
            let error = (count - order.count) - from_edge;
            // the switch opens on the first pulse on the far side of its edge, and is seen at the end of that period
            let far = if upper { error } else { -error };
            prop_assert!((0..=slow / PULSE + 2).contains(&far), "{far}");
        }

        /// Stopped at any moment it comes to rest within its ramp.
        #[test]
        fn a_stop_is_a_ramp(stop in 0u32..3000, fast in PULSE / 10..40 * PULSE, acceleration in PULSE / 50..PULSE) {
            let order = order(true, fast, PULSE / 2, acceleration);
            let (_, ending, periods) = run(order, 1500, Some(stop));
            let ramp = (fast / acceleration + 2) as u32;
            prop_assert!(ending != HomingEnd::Stopped || (stop..=stop + ramp).contains(&periods));
            prop_assert!(ending != HomingEnd::NotFound);
        }
    }
}
