//! Step and direction: an axis' increment of one control period as edges on two signals (GMC-1, *fine interpolation*).
//!
//! The pulses are spaced by `core::fine`, tick by tick of the card's clock. If the direction reverses, it changes no
//! sooner than its set-up time after the last falling edge, and the pulses are spread over the part of the period that
//! remains after its set-up time. The next period need not be known: [`StepTiming::max_increment`] pulses fit after any
//! previous period.
//!
//! Invariant: a period with an increment of p pulses has exactly |p| rising edges, all edges inside the period. A pulse
//! is high for exactly its length and low for at least as long, also across the end of a period. The direction is
//! stable for its set-up time before every rising edge and after every falling edge. Edges and ticks are two views of
//! the same plan.

use core::fmt;
use retrace_core::fine::{PulseSlots, pulse_slots};

/// Timing of a step and direction output, in ticks of the card's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepTiming {
    period: u32,
    pulse: u32,
    setup: u32,
}

impl StepTiming {
    /// Creates a timing from the control period (below 2³¹), the pulse length (at least 1) and the set-up time of the
    /// direction (at least 1), in ticks. Returns `None` if not even one pulse fits a period in which the direction
    /// reverses.
    #[must_use]
    pub const fn new(period: u32, pulse: u32, setup: u32) -> Option<Self> {
        let timing = Self { period, pulse, setup };
        let valid = period < 1 << 31 && pulse >= 1 && setup >= 1;
        // Both are u16 in the settings; no clock makes them as long as this.
        let short = pulse < 1 << 28 && setup < 1 << 28;
        if valid && short && timing.max_increment() >= 1 { Some(timing) } else { None }
    }

    /// Creates a timing for a clock of `tick_hz` ticks per second: a period of whole ticks, and a pulse and a set-up
    /// time at least as long as requested, and at least one tick. Returns `None` as [`StepTiming::new`] does.
    #[must_use]
    pub const fn of_clock(tick_hz: u32, period_us: u32, pulse_ns: u16, setup_ns: u16) -> Option<Self> {
        let period = period_us as u64 * tick_hz as u64 / 1_000_000;
        if period >= 1 << 31 {
            return None;
        }
        Self::new(period as u32, ticks(pulse_ns, tick_hz), ticks(setup_ns, tick_hz))
    }

    /// Returns the ticks of a control period.
    #[must_use]
    pub const fn period(self) -> u32 {
        self.period
    }

    /// Returns the maximum number of pulses that fit a period after any previous period, also if the direction reverses
    /// in it.
    #[must_use]
    pub const fn max_increment(self) -> u16 {
        // The last falling edge is at least one tick before the end of its period: the direction may change at `setup`
        // − 1.
        let before = 2 * self.setup as u64 - 1;
        let room = (self.period as u64).saturating_sub(before);
        let most = room / (2 * self.pulse as u64);
        if most > u16::MAX as u64 { u16::MAX } else { most as u16 }
    }
}

/// Returns the ticks that last at least `ns`, and at least one.
const fn ticks(ns: u16, tick_hz: u32) -> u32 {
    let ticks = (ns as u64 * tick_hz as u64).div_ceil(1_000_000_000);
    if ticks == 0 { 1 } else { ticks as u32 }
}

/// Error: the increment has more pulses than fit the period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PulsePlanError;

impl fmt::Display for PulsePlanError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("more pulses than fit the control period; lower the speed, or lengthen the period")
    }
}

impl core::error::Error for PulsePlanError {}

/// Edge on one of the two signals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edge {
    /// The direction changes to `backward`.
    Direction {
        /// Whether the axis counts down.
        backward: bool,
    },
    /// A pulse begins.
    Rise,
    /// A pulse ends.
    Fall,
}

/// Levels of an axis' signals in one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Levels {
    /// Whether a pulse is on.
    pub step: bool,
    /// Whether the axis counts down. An inverted output is the pin's concern.
    pub backward: bool,
}

/// Step and direction output of one axis.
#[derive(Clone, Debug)]
pub struct StepDirection {
    timing: StepTiming,
    /// Direction at the end of the current period.
    backward: bool,
    /// Ticks from the last falling edge to the end of that period.
    ticks_since_fall: u32,
    /// Number of its pulses.
    count: u16,
    /// Tick in which the direction changes.
    turn: Option<u32>,
    /// Tick from which pulses are spread.
    first: u32,
    now: u32,
    pulses: PulseSlots,
    high: u32,
    level: bool,
}

impl StepDirection {
    /// Creates an output that has been at rest in forward direction for long.
    #[must_use]
    pub const fn new(timing: StepTiming) -> Self {
        Self {
            timing,
            backward: false,
            ticks_since_fall: u32::MAX,
            count: 0,
            turn: None,
            first: 0,
            now: 0,
            pulses: PulseSlots::new(0, timing.period),
            high: 0,
            level: false,
        }
    }

    /// Begins a control period with `increment` pulses. To be called every `period` ticks, also with an increment of
    /// zero.
    ///
    /// # Errors
    /// Returns an error if the pulses do not fit, which is never the case up to [`StepTiming::max_increment`]: the
    /// period begins without any pulses then.
    pub const fn begin_period(&mut self, increment: i32) -> Result<(), PulsePlanError> {
        let StepTiming { period, pulse, setup } = self.timing;
        let count = increment.unsigned_abs();
        (self.count, self.turn, self.first, self.now, self.high) = (0, None, 0, 0, 0);
        self.level = self.backward;
        self.pulses = PulseSlots::new(0, period);
        let turns = count > 0 && (increment < 0) != self.backward;
        let turn = setup.saturating_sub(self.ticks_since_fall);
        let first = if turns { turn + setup } else { 0 };
        let room = period.saturating_sub(first);
        if count as u64 * 2 * pulse as u64 > room as u64 || count > u16::MAX as u32 {
            self.ticks_since_fall = self.ticks_since_fall.saturating_add(period);
            return Err(PulsePlanError);
        }
        if count == 0 {
            self.ticks_since_fall = self.ticks_since_fall.saturating_add(period);
            return Ok(());
        }
        if turns {
            self.turn = Some(turn);
            self.backward = !self.backward;
        }
        (self.count, self.first) = (count as u16, first);
        self.pulses = PulseSlots::new(self.count, room);
        // The last pulse begins where half of its share of the time is still to come (core, `pulse_slots`).
        self.ticks_since_fall = room / 2 / count + 1 - pulse;
        Ok(())
    }

    /// Returns the edges of the current period in order, each with its tick, from 0.
    pub fn edges(&self) -> impl Iterator<Item = (u32, Edge)> {
        let (first, pulse, backward) = (self.first, self.timing.pulse, self.backward);
        let turn = self.turn.map(|tick| (tick, Edge::Direction { backward }));
        let slots = pulse_slots(self.count, self.timing.period - first);
        let pulses = slots.flat_map(move |slot| [(first + slot, Edge::Rise), (first + slot + pulse, Edge::Fall)]);
        turn.into_iter().chain(pulses)
    }

    /// Advances by one tick and returns the levels from its beginning: what a timer interrupt writes to the pins.
    ///
    /// After the end of the period both signals are unchanged.
    pub const fn tick(&mut self) -> Levels {
        if self.now < self.timing.period {
            if let Some(turn) = self.turn
                && turn == self.now
            {
                self.level = self.backward;
            }
            if self.now >= self.first && self.pulses.next_slot() {
                self.high = self.timing.pulse;
            }
            self.now += 1;
        }
        let step = self.high > 0;
        self.high = self.high.saturating_sub(1);
        Levels { step, backward: self.level }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Watches two wires tick by tick and knows nothing of periods.
    struct Scope {
        timing: StepTiming,
        now: u64,
        levels: Levels,
        rose: Option<u64>,
        fell: Option<u64>,
        turned: Option<u64>,
        position: i64,
    }

    impl Scope {
        fn new(timing: StepTiming) -> Self {
            Self { timing, now: 0, levels: Levels::default(), rose: None, fell: None, turned: None, position: 0 }
        }

        fn see(&mut self, levels: Levels) {
            let (pulse, setup) = (u64::from(self.timing.pulse), u64::from(self.timing.setup));
            let since = |moment: Option<u64>, now: u64| moment.map_or(u64::MAX, |m| now - m);
            if levels.backward != self.levels.backward {
                assert!(!levels.step && !self.levels.step, "the direction turns beside a pulse");
                assert!(since(self.fell, self.now) >= setup, "the direction turns too soon");
                self.turned = Some(self.now);
            }
            match (self.levels.step, levels.step) {
                (false, true) => {
                    assert!(since(self.turned, self.now) >= setup, "a step too soon behind the direction");
                    assert!(since(self.fell, self.now) >= pulse, "low for too short a time");
                    self.rose = Some(self.now);
                    self.position += if levels.backward { -1 } else { 1 };
                }
                (true, false) => {
                    assert_eq!(since(self.rose, self.now), pulse);
                    self.fell = Some(self.now);
                }
                _ => {}
            }
            (self.levels, self.now) = (levels, self.now + 1);
        }
    }

    /// One period through both views: the levels of every tick are those that the edges say.
    fn run(output: &mut StepDirection, scope: &mut Scope, increment: i32) -> Result<(), PulsePlanError> {
        let mut expected = Levels { step: false, backward: output.backward };
        let begun = output.begin_period(increment);
        let before = scope.position;
        let (twin, mut last) = (output.clone(), None);
        let mut edges = twin.edges().peekable();
        for tick in 0..output.timing.period {
            while let Some((_, edge)) = edges.next_if(|(at, _)| *at == tick) {
                match edge {
                    Edge::Direction { backward } => expected.backward = backward,
                    Edge::Rise => expected.step = true,
                    Edge::Fall => (expected.step, last) = (false, Some(tick)),
                }
            }
            let levels = output.tick();
            assert_eq!(levels, expected, "tick {tick}");
            scope.see(levels);
        }
        assert_eq!(edges.next(), None, "every edge lies inside its period");
        if let Some(last) = last {
            assert_eq!(twin.ticks_since_fall, output.timing.period - last);
        }
        assert_eq!(output.tick(), Levels { step: false, ..expected }, "the wires stay as they are");
        let emitted = if begun.is_ok() { i64::from(increment) } else { 0 };
        assert_eq!(scope.position - before, emitted);
        begun
    }

    /// Every small timing, every pair of increments with a pause between them or not.
    #[test]
    fn every_short_period_keeps_its_times_and_its_count() {
        let mut cases = 0u32;
        for (period, pulse, setup) in
            (1..=26u32).flat_map(|p| (1..=3).flat_map(move |w| (1..=5).map(move |s| (p, w, s))))
        {
            let Some(timing) = StepTiming::new(period, pulse, setup) else { continue };
            let (most, beyond) = (i32::from(timing.max_increment()), (period / pulse / 2) as i32);
            for first in -beyond..=beyond {
                for (second, pause) in (-beyond - 1..=beyond + 1).flat_map(|s| [(s, false), (s, true)]) {
                    let (mut output, mut scope) = (StepDirection::new(timing), Scope::new(timing));
                    let begun = run(&mut output, &mut scope, first);
                    assert!(begun.is_ok() || first.abs() > most);
                    if pause {
                        run(&mut output, &mut scope, 0).expect("nothing fits everywhere");
                    }
                    let begun = run(&mut output, &mut scope, second);
                    assert!(begun.is_ok() || second.abs() > most);
                    assert!(begun.is_err() || second.abs() <= beyond);
                    cases += 1;
                }
            }
        }
        assert!(cases > 20_000, "{cases}");
    }

    /// The bound is not only enough: at least one pair of periods needs it.
    #[test]
    fn one_pulse_more_than_the_most_does_not_always_fit() {
        let timing = StepTiming::new(40, 2, 3).expect("fits");
        assert_eq!(timing.max_increment(), 8);
        let mut output = StepDirection::new(timing);
        output.begin_period(10).expect("straight on");
        assert_eq!(output.begin_period(-9), Err(PulsePlanError));
        assert_eq!(output.edges().count(), 0);
        output.begin_period(10).expect("the direction has not turned");
        output.begin_period(-8).expect("the most");
    }

    #[test]
    fn a_clock_gives_whole_ticks_and_no_shorter_times_than_asked_for() {
        assert_eq!(StepTiming::of_clock(84_000_000, 1000, 2000, 5000), StepTiming::new(84_000, 168, 420));
        assert_eq!(StepTiming::of_clock(100_000, 1000, 2000, 5000), StepTiming::new(100, 1, 1));
        assert_eq!(StepTiming::of_clock(100_000, 1000, 10_001, 0), StepTiming::new(100, 2, 1));
        assert_eq!(StepTiming::of_clock(100_000, 1000, 2000, 5000).map(StepTiming::max_increment), Some(49));
        assert_eq!(StepTiming::of_clock(100_000, 20, 2000, 5000), None);
        for hostile in [(u32::MAX, u32::MAX), (u32::MAX, 1), (0, 1000), (1, 1)] {
            assert_eq!(StepTiming::of_clock(hostile.0, hostile.1, u16::MAX, u16::MAX), None);
        }
        assert_eq!(StepTiming::new(u32::MAX, 1, 1), None);
        assert_eq!(StepTiming::new(100, u32::MAX, u32::MAX), None);
    }

    proptest! {
        /// Long sequences: the net position is the sum of the increments, and up to the most everything fits.
        #[test]
        fn any_sequence_is_emitted_to_the_pulse(
            period in 8u32..900, pulse in 1u32..6, setup in 1u32..12,
                seed in prop::collection::vec(any::<i32>(), 1..60),
        ) {
            let timing = StepTiming::new(period, pulse, setup);
            prop_assume!(timing.is_some());
            let Some(timing) = timing else { return Ok(()) };
            let most = i32::from(timing.max_increment());
            let (mut output, mut scope, mut sum) = (StepDirection::new(timing), Scope::new(timing), 0i64);
            for number in seed {
                // often slow, often as fast as can be
                let increment = match number & 3 { 0 => 0, 1 => most * (number >> 2).signum(),
                    _ => (number >> 2) % (most + 1) };
                prop_assert_eq!(run(&mut output, &mut scope, increment), Ok(()));
                sum += i64::from(increment);
            }
            prop_assert_eq!(scope.position, sum);
        }

        /// No increment panics.
        #[test]
        fn hostile_increments_are_refused(increment in any::<i32>(), period in 1u32..1 << 31, pulse in 1u32..99,
            setup in 1u32..99) {
            if let Some(timing) = StepTiming::new(period, pulse, setup) {
                let mut output = StepDirection::new(timing);
                let fits = output.begin_period(increment).is_ok();
                prop_assert!(fits || increment.unsigned_abs() > u32::from(timing.max_increment()));
                prop_assert_eq!(output.edges().take(1).count(), usize::from(fits && increment != 0));
            }
        }
    }
}
