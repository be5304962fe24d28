//! An axis' increment of a control period, as words for the program [`super::pio_programs::STEPS`].
//!
//! Invariant: the words of a period of `p` pulses make exactly `|p|` rising edges and are done before the period ends;
//! the direction is stable for its set-up time before every rising edge and after every falling edge; the intervals
//! between the pulses of a period differ by at most [`JOINT`] + 1 ticks. Whatever the card accepts fits.

use super::pio_programs::high_ticks;
use super::{CHIP, CLOCK_HZ, Chip};
use crate::step_batch::StepShape;

/// Additional ticks of a word, before its first pulse.
pub const JOINT: u32 = 6;
/// Ticks before a rising edge besides the delay.
const PULSE: u32 = 3;
/// Ticks of a pause without a delay.
const PAUSE: u32 = 9;
/// Ticks that are left free at the end of a period: the joints of four words, and the way back to the gate.
const GUARD: u32 = 4 * JOINT + 16;
/// Largest delay and largest number of pulses of a word.
const MAX_DELAY: u32 = (1 << 20) - 1;
const MAX_PULSES: u32 = (1 << 10) - 1;
const LAST: u32 = 1 << 31;
/// Least time that a step is low, in cycles, where the pulses are longer than that: 1.4 µs, and 1 µs at the higher rate
/// of the RP2350.
const LOW_CYCLES: u32 = match CHIP {
    Chip::Rp2040 => 175,
    Chip::Rp2350 => 150,
};
/// Dividers of the state machines' clock, so that every period of whole microseconds is a whole number of ticks.
const DIVIDERS: [u32; 3] = [1, 5, 25];
/// Words of a period at most.
const MAX_WORDS: usize = 4;

/// Step timing in ticks of the state machines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepTicks {
    /// Cycles of the chip's clock in a tick.
    pub divider: u32,
    /// A control period.
    pub period: u32,
    /// Loops of the program while a step is high.
    pub high_loops: u32,
    /// Least time that a step is low.
    low: u32,
    /// Time that the direction is stable before a rising and after a falling edge.
    setup: u32,
}

impl StepTicks {
    /// Returns the ticks of a step timing: no time is shorter than requested.
    #[must_use]
    pub const fn of(shape: &StepShape) -> Self {
        let pulse = cycles(shape.pulse_ns);
        let mut n = 0;
        while n + 1 < DIVIDERS.len() && pulse.div_ceil(DIVIDERS[n]) > high_ticks(31) {
            n += 1;
        }
        let divider = DIVIDERS[n];
        let high_loops = pulse.div_ceil(divider).saturating_sub(1).div_ceil(16).saturating_sub(1);
        let low = if pulse < LOW_CYCLES { pulse } else { LOW_CYCLES };
        Self {
            divider,
            period: shape.period_us * (CLOCK_HZ / 1_000_000) / divider,
            high_loops,
            low: low.div_ceil(divider),
            setup: cycles(shape.setup_ns).div_ceil(divider),
        }
    }

    /// Ticks that a step is high.
    #[must_use]
    pub const fn high(&self) -> u32 {
        high_ticks(self.high_loops)
    }
}

/// Returns the cycles that last at least `ns`, and at least one.
const fn cycles(ns: u16) -> u32 {
    let cycles = (ns as u32 * (CLOCK_HZ / 1_000_000)).div_ceil(1000);
    if cycles == 0 { 1 } else { cycles }
}

/// The words of one axis in one control period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepWords {
    words: [u32; MAX_WORDS],
    count: usize,
}

impl StepWords {
    const NONE: Self = Self { words: [0; MAX_WORDS], count: 0 };

    /// Returns the words, in the order in which they are executed.
    #[must_use]
    pub fn as_slice(&self) -> &[u32] {
        &self.words[..self.count]
    }

    const fn push(&mut self, direction: u32, pulses: u32, delay: u32) {
        self.words[self.count] = direction | pulses << 1 | delay << 11;
        self.count += 1;
    }

    const fn close(mut self) -> Self {
        self.words[self.count - 1] |= LAST;
        self
    }
}

/// Error: the increment has more pulses than fit the control period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepWordsError;

impl core::fmt::Display for StepWordsError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("more pulses than fit the control period")
    }
}

impl core::error::Error for StepWordsError {}

/// An axis from period to period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepAxis {
    backward: bool,
    /// Ticks from the last falling edge to the end of the last period, at least.
    idle: u32,
}

impl StepAxis {
    /// Creates an axis that has been at rest in forward direction for long.
    #[must_use]
    pub const fn new() -> Self {
        Self { backward: false, idle: u32::MAX }
    }

    /// Returns the words of a period without pulses. `inverted`: the direction is high for backward.
    pub const fn rest(&mut self, ticks: &StepTicks, inverted: bool) -> StepWords {
        self.idle = self.idle.saturating_add(ticks.period);
        let mut words = StepWords::NONE;
        words.push(level(self.backward, inverted), 0, 0);
        words.close()
    }

    /// Returns the words of the next period.
    ///
    /// # Errors
    /// The pulses do not fit the period; the axis is unchanged.
    pub const fn begin_period(
        &mut self,
        ticks: &StepTicks,
        increment: i32,
        inverted: bool,
    ) -> Result<StepWords, StepWordsError> {
        let pulses = increment.unsigned_abs();
        if pulses == 0 {
            return Ok(self.rest(ticks, inverted));
        }
        let turns = (increment < 0) != self.backward;
        let turn = if turns { ticks.setup.saturating_sub(self.idle) } else { 0 };
        let first = if turns { turn + ticks.setup } else { 0 };
        let room = ticks.period.saturating_sub(first + GUARD);
        let (interval, longer) = (room / pulses, room % pulses);
        let high = ticks.high();
        if interval < high + ticks.low || interval < high + PULSE || pulses > MAX_PULSES || room > MAX_DELAY {
            return Err(StepWordsError);
        }
        let mut words = StepWords::NONE;
        if turn > 0 {
            words.push(level(self.backward, inverted), 0, turn.saturating_sub(PAUSE));
        }
        self.backward = increment < 0;
        let direction = level(self.backward, inverted);
        // half an interval to the first rising edge, less where the last pulse would outlast the period
        let half = if interval / 2 < interval - high { interval / 2 } else { interval - high };
        words.push(direction, 1, (first - turn + half).saturating_sub(JOINT + PULSE));
        // the longer intervals, by one tick, and then the others
        let longer = if longer < pulses - 1 { longer } else { pulses - 1 };
        if longer > 0 {
            words.push(direction, longer, interval + 1 - high - PULSE);
        }
        if pulses - 1 - longer > 0 {
            words.push(direction, pulses - 1 - longer, interval - high - PULSE);
        }
        self.idle = interval - half - high;
        Ok(words.close())
    }
}

impl Default for StepAxis {
    fn default() -> Self {
        Self::new()
    }
}

/// Level of the direction pin: high is forward, unless it is inverted.
const fn level(backward: bool, inverted: bool) -> u32 {
    (backward == inverted) as u32
}

#[cfg(test)]
mod tests {
    use super::super::pio_model::StateMachine;
    use super::super::pio_programs::{GATE_TICKS, SET_HIGH_LOOPS_AT, STEPS, set_high_loops};
    use super::super::{IDENTITY, MAX_PERIOD_US, MAX_PULSES_HZ, MIN_PERIOD_US};
    use super::*;
    use proptest::prelude::*;
    use retrace_card::StepTiming;

    /// A drive at the pins: checks every time, and counts.
    struct Drive {
        machine: StateMachine,
        ticks: StepTicks,
        now: u64,
        rose: Option<u64>,
        fell: Option<u64>,
        turned: Option<u64>,
        inverted: bool,
    }

    impl Drive {
        fn new(ticks: StepTicks, inverted: bool) -> Self {
            let mut program = STEPS;
            program[SET_HIGH_LOOPS_AT] = set_high_loops(ticks.high_loops as u16);
            let mut machine = StateMachine::new(&program);
            machine.pin = !inverted;
            Self { machine, ticks, now: 0, rose: None, fell: None, turned: None, inverted }
        }

        /// Runs one control period and returns the net pulses and the rising edges.
        fn run_period(&mut self, words: &StepWords) -> (i32, Vec<u64>) {
            assert!(self.machine.is_idle(), "the last period is over");
            self.machine.queue.extend(words.as_slice());
            let (mut net, mut rises) = (0, Vec::new());
            let since = |from: Option<u64>, now: u64| from.map_or(u64::MAX, |from| now - from);
            for tick in 0..self.ticks.period {
                let (side, pin) = (self.machine.side, self.machine.pin);
                self.machine.tick(tick < GATE_TICKS);
                let (high, setup) = (u64::from(self.ticks.high()), u64::from(self.ticks.setup));
                if pin != self.machine.pin {
                    assert!(!self.machine.side && since(self.fell, self.now) >= setup, "direction after a fall");
                    self.turned = Some(self.now);
                }
                if self.machine.side && !side {
                    assert!(since(self.fell, self.now) >= u64::from(self.ticks.low), "low long enough");
                    assert!(since(self.turned, self.now) >= setup, "direction before a rise");
                    net += if self.machine.pin != self.inverted { 1 } else { -1 };
                    rises.push(self.now);
                    self.rose = Some(self.now);
                }
                if side && !self.machine.side {
                    assert_eq!(since(self.rose, self.now), high);
                    self.fell = Some(self.now);
                }
                self.now += 1;
            }
            assert!(!self.machine.side, "no step lasts beyond its period");
            (net, rises)
        }
    }

    fn shape(period_us: u32, pulse_ns: u16, setup_ns: u16) -> StepShape {
        StepShape { period_us, pulse_ns, setup_ns, inverted: 0 }
    }

    /// Most pulses of a period that the card accepts (`CheckedSettings`); `None`: it refuses the settings.
    fn most_pulses(shape: &StepShape) -> Option<i32> {
        let timing = StepTiming::of_clock(IDENTITY.tick_hz, shape.period_us, shape.pulse_ns, shape.setup_ns)?;
        let by_rate = u64::from(MAX_PULSES_HZ) * u64::from(shape.period_us) / 1_000_000;
        Some(i32::from(timing.max_increment()).min(by_rate as i32))
    }

    /// An axis whose last period had as many pulses as fit.
    fn after_full_period(ticks: &StepTicks, most: i32) -> StepAxis {
        let mut axis = StepAxis::new();
        axis.begin_period(ticks, most, false).expect("it fits straight on");
        axis
    }

    #[test]
    fn whatever_the_card_accepts_fits_also_where_the_direction_reverses() {
        let times: Vec<u16> = (1..=64).map(|n| n * 1023).chain([1, 8, 100, 136, 1300, 1400, 1401, 1500]).collect();
        for period_us in [MIN_PERIOD_US, 1001, 1999, MAX_PERIOD_US] {
            for &pulse_ns in &times {
                for &setup_ns in &times {
                    let shape = shape(period_us, pulse_ns, setup_ns);
                    let ticks = StepTicks::of(&shape);
                    let Some(most) = most_pulses(&shape) else { continue };
                    let high = u64::from(ticks.high() * ticks.divider) * 1_000_000_000 / u64::from(CLOCK_HZ);
                    assert!(high + 1 >= u64::from(pulse_ns));
                    assert_eq!(ticks.period * ticks.divider, period_us * (CLOCK_HZ / 1_000_000));
                    let axis = after_full_period(&ticks, most);
                    for pulses in [1, 2, most / 2, most - 1, most].into_iter().filter(|&pulses| pulses > 0) {
                        let words = axis.clone().begin_period(&ticks, -pulses, false);
                        assert!(words.is_ok(), "{pulses} of {most}: {shape:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn every_count_of_a_period_is_made_evenly_and_in_both_directions() {
        for (pulse_ns, setup_ns) in [(2500, 5000), (1000, 100), (10_000, 20_000)] {
            let shape = shape(1000, pulse_ns, setup_ns);
            let ticks = StepTicks::of(&shape);
            let most = most_pulses(&shape).expect("accepted");
            let (mut drive, mut axis) = (Drive::new(ticks, false), StepAxis::new());
            for pulses in 0..=most {
                for increment in [pulses, -pulses] {
                    let words = axis.begin_period(&ticks, increment, false).expect("it fits");
                    let (net, rises) = drive.run_period(&words);
                    assert_eq!((net, rises.len()), (increment, pulses as usize));
                    let gaps: Vec<u64> = rises.windows(2).map(|pair| pair[1] - pair[0]).collect();
                    let (least, most) = (gaps.iter().min().unwrap_or(&0), gaps.iter().max().unwrap_or(&0));
                    assert!(most - least <= u64::from(JOINT) + 1, "{increment}: {least} … {most}");
                }
            }
        }
    }

    #[test]
    fn long_pulses_divide_the_clock() {
        let longest = |divider: u32| (high_ticks(31) * divider * 1000 / (CLOCK_HZ / 1_000_000)) as u16;
        let [one, five] = [longest(1), longest(5)];
        for (pulse_ns, divider) in [(one, 1), (one + 1, 5), (five, 5), (five + 1, 25), (u16::MAX, 25)] {
            let ticks = StepTicks::of(&shape(1000, pulse_ns, 1000));
            assert_eq!(ticks.divider, divider, "{pulse_ns} ns");
            assert!(ticks.high_loops <= 31);
        }
    }

    #[test]
    fn hostile_increments_are_refused() {
        let ticks = StepTicks::of(&StepShape::INITIAL);
        for increment in [i32::MIN, i32::MAX, 1024, -5000, 400] {
            let mut axis = StepAxis::new();
            assert_eq!(axis.begin_period(&ticks, increment, false), Err(StepWordsError));
            assert_eq!(axis, StepAxis::new());
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// Any sequence of periods: each makes its own pulses, in time.
        #[test]
        fn any_sequence_is_made_period_by_period(
            pulse_ns in 1u16.., setup_ns in 1u16.., period_us in MIN_PERIOD_US..=1200, inverted: bool,
            shares in prop::collection::vec(-100i32..=100, 1..12),
        ) {
            let shape = shape(period_us, pulse_ns, setup_ns);
            let ticks = StepTicks::of(&shape);
            if let Some(most) = most_pulses(&shape) {
                let (mut drive, mut axis) = (Drive::new(ticks, inverted), StepAxis::new());
                for share in shares {
                    let increment = if share.abs() < 5 { share.min(most) } else { share * most / 100 };
                    let words = axis.begin_period(&ticks, increment, inverted).expect("it fits");
                    prop_assert!(words.as_slice().len() <= 4);
                    let (net, rises) = drive.run_period(&words);
                    prop_assert_eq!((net, rises.len()), (increment, increment.unsigned_abs() as usize));
                }
            }
        }
    }
}
