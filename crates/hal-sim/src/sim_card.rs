//! A simulated card in this process, with a plant on it and no serial line, behind the trait of all cards.
//!
//! Invariant: it runs `retrace_card::Card`, the same code as the firmware; it is not a second card. An alarm is
//! reported in a period of its own, and is an error from the next one on, until it is cleared.

use std::fmt;
use std::io::{self, Write};

use retrace_card::{Card, InputLevels};
use retrace_core::RecordIndex;
use retrace_core::limits::RateLimits;
use retrace_link::{
    Alarm, CardCore, CardFailure, CardIdentity, CardSettings, CardStatus, CommandRefusal, HostCommand, MotionCard,
    Outputs, PathStart, ProbeLatch,
};

use crate::count_checker::CountChecker;
use crate::linked_card::{MEMORY, SimRecords, WINDOW, records};
use crate::pins::Pins;
use crate::trace::Trace;
use crate::{Clock, Plant, PlantSettings, PulseCounters, identity};

/// Ticks per second of a clock that is fine enough for every pulse rate.
const FINE_HZ: u32 = 4_000_000_000;

/// A trace of the card, and the wires that it shows.
struct Traced<const A: usize> {
    trace: Trace<Box<dyn Write + Send>, A>,
    pins: Pins<A>,
}

impl<const A: usize> fmt::Debug for Traced<A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Traced").field("pins", &self.pins).finish_non_exhaustive()
    }
}

/// A simulated card for `A` axes, and the plant on it.
#[derive(Debug)]
pub struct SimCard<const A: usize> {
    card: Box<Card<A, WINDOW, MEMORY, SimRecords<A>>>,
    machine: Plant<A>,
    counters: PulseCounters<A>,
    compared: CountChecker<A>,
    /// Counts of the axes where the counters' positions are 0, before any homing.
    initial_counts: [i64; A],
    settings: CardSettings<A>,
    /// Limits of a path on which a probe is armed.
    probing_limits: RateLimits<A>,
    /// Where the path began.
    start: PathStart,
    clock: Clock,
    late_periods: u64,
    traced: Option<Box<Traced<A>>>,
}

/// Error of a simulated card.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SimCardError {
    /// The card latched an alarm and is at rest. [`HostCommand::ClearAlarm`] may clear it.
    Alarm(Alarm),
    /// The increments have more pulses than the card can emit.
    TooManyPulses {
        /// The control period in which it happened.
        period: u64,
    },
    /// The counts differ from the counted pulses: a defect.
    CountMismatch {
        /// The control period in which it happened.
        period: u64,
    },
    /// The card did not begin an epoch.
    EpochRefused(CommandRefusal),
}

impl fmt::Display for SimCardError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Alarm(alarm) => alarm.fmt(f),
            Self::TooManyPulses { period } => {
                write!(f, "control period {period}: more pulses than the card can emit in a period")
            }
            Self::CountMismatch { period } => {
                write!(f, "control period {period}: the card's counts differ from the pulses counted at its outputs")
            }
            Self::EpochRefused(CommandRefusal::InMotion) => {
                write!(f, "the card is in motion and cannot begin a new path")
            }
            Self::EpochRefused(_) => write!(f, "the card cannot begin a new path with these settings"),
        }
    }
}

impl std::error::Error for SimCardError {}

impl CardFailure for SimCardError {
    fn number(&self) -> &'static str {
        match self {
            Self::Alarm(alarm) => alarm.number(),
            Self::TooManyPulses { .. } => "E3017",
            Self::CountMismatch { .. } => "E3004",
            Self::EpochRefused(_) => "E3008",
        }
    }

    fn remedy(&self) -> &'static str {
        match self {
            Self::Alarm(alarm) => alarm.remedy(),
            Self::TooManyPulses { .. } => {
                "lower pulses_per_mm or max_velocity_mm_per_s, or lengthen the control period"
            }
            Self::CountMismatch { .. } => "please report this",
            Self::EpochRefused(_) => "wait until the machine is at rest; please report this",
        }
    }
}

impl<const A: usize> SimCard<A> {
    /// A card at rest without a plant. Its first record has the number `start`; its control period is 1 ms in virtual
    /// time. `None` where the average of the rate law is too long for a card.
    #[must_use]
    pub fn new(start: RecordIndex, limits: RateLimits<A>, clock: Clock) -> Option<Self> {
        let settings = CardSettings::new(1, PathStart::at(start), clock.period_us().unwrap_or(1000), limits);
        Self::with_machine(settings, &PlantSettings::default(), clock).ok()
    }

    /// A card at rest with a plant. Its caller counts as the operator, so the watchdog never trips, and its clock is so
    /// fine that pulses are as short as they have to be. Otherwise it works by the settings; their epoch is ignored.
    ///
    /// # Errors
    /// As [`CardCore::open`].
    pub fn with_machine(
        settings: CardSettings<A>,
        machine: &PlantSettings,
        clock: Clock,
    ) -> Result<Self, CommandRefusal> {
        let identity = CardIdentity { tick_hz: FINE_HZ, max_pulses_hz: u32::MAX, ..identity::<A>(0, 0) };
        let settings = CardSettings { epoch: 1, pulse_ns: 0, direction_setup_ns: 0, ..settings };
        let mut card = Box::new(Card::with_records(identity, records()).ok_or(CommandRefusal::Unsupported)?);
        card.open(&settings)?;
        let mut compared = CountChecker::new([0; A]);
        compared.set_backlash(&settings.backlash_pulses, &[0; A], &[0; A]);
        compared.set_layer(settings.layer);
        Ok(Self {
            card,
            machine: Plant::new(machine),
            counters: PulseCounters::default(),
            compared,
            initial_counts: [0; A],
            settings,
            probing_limits: settings.limits,
            start: settings.start,
            clock,
            late_periods: 0,
            traced: None,
        })
    }

    /// The card with its axes at these counts and its outputs at these values, like a card that retained its position.
    /// The plant is at these positions too. To be called before anything has moved.
    #[must_use]
    pub fn with_position(mut self, counts: [i64; A], outputs: &Outputs) -> Self {
        self.card.restore_state(counts, outputs);
        self.compared = CountChecker::new(counts);
        self.compared.set_backlash(&self.settings.backlash_pulses, &counts, &[0; A]);
        self.compared.set_layer(self.settings.layer);
        self.initial_counts = counts;
        self.machine.outputs(0, outputs);
        self
    }

    /// The card with these limits of a path on which a probe is armed; every other one has those of the settings.
    #[must_use]
    pub fn with_probing_limits(mut self, limits: RateLimits<A>) -> Self {
        self.probing_limits = limits;
        self
    }

    /// Writes a trace for a wave viewer from now on, with these axis names. It ends where its file cannot be written
    /// any more.
    ///
    /// # Errors
    /// The error of the writer.
    pub fn trace(&mut self, out: Box<dyn Write + Send>, axes: &[String]) -> io::Result<()> {
        self.traced = Some(Box::new(Traced { trace: Trace::new(out, axes)?, pins: Pins::default() }));
        Ok(())
    }

    /// Traces the last period, which began at `now_us`.
    fn trace_period(&mut self, now_us: u64) {
        let (Some(traced), Some(terms)) = (&mut self.traced, self.card.settings()) else { return };
        // More pulses than fit are a fault of the card, which ends the run by itself.
        let _ = traced.pins.emit(terms.timing(), self.card.pulses());
        let edges = traced.pins.edges();
        if traced.trace.period(now_us * 1000, self.card.status(), edges, FINE_HZ).is_err() {
            self.traced = None;
        }
    }

    /// Control periods whose end was reached late in wall time, by more than a period: the computer was too slow, or
    /// busy.
    #[must_use]
    pub const fn late_periods(&self) -> u64 {
        self.late_periods
    }

    /// Counters of the emitted pulses.
    #[must_use]
    pub const fn counters(&self) -> &PulseCounters<A> {
        &self.counters
    }

    /// The plant, for changes by a test.
    pub const fn machine(&mut self) -> &mut Plant<A> {
        &mut self.machine
    }

    /// Levels of the card's inputs from the plant at the beginning of period `number`.
    fn inputs(&mut self, now_us: u64) -> InputLevels {
        let mut positions = *self.counters.positions();
        for (position, stood_at) in positions.iter_mut().zip(self.initial_counts) {
            *position += stood_at;
        }
        self.machine.inputs(now_us, &positions, self.card.pulses())
    }
}

impl<const A: usize> MotionCard<A> for SimCard<A> {
    type Fault = SimCardError;

    fn window(&self) -> u32 {
        WINDOW as u32
    }

    fn send(&mut self, command: HostCommand<A>) -> Result<(), CommandRefusal> {
        let is_idle = self.card.status().probe == ProbeLatch::Idle;
        if matches!(command, HostCommand::ArmProbe(_)) && is_idle && self.probing_limits != self.settings.limits {
            // The path begins again: nothing has moved on it yet.
            let start = PathStart { executed: self.card.status().executed, ..self.start };
            self.card.open(&CardSettings { start, limits: self.probing_limits, ..self.settings })?;
        }
        self.card.accept(command)
    }

    fn run_period(&mut self) -> Result<&CardStatus<A>, SimCardError> {
        let before = self.card.status();
        let (number, counts) = (before.period + 1, before.counts);
        let stood_under_alarm = before.alarm.is_some() && before.at_rest;
        self.late_periods += u64::from(self.clock.wait(number));
        let now_us = number * u64::from(self.settings.period_us);
        let inputs = self.inputs(now_us);
        self.card.keep_alive();
        self.card.run_period(inputs);
        let (status, pulses) = (self.card.status(), self.card.pulses());
        if !self.counters.emit(pulses) {
            return Err(SimCardError::TooManyPulses { period: number });
        }
        if !self.compared.counts_match(&counts, status, self.counters.positions()) {
            return Err(SimCardError::CountMismatch { period: number });
        }
        self.machine.outputs(now_us, &status.outputs);
        let alarm = status.alarm;
        self.trace_period(now_us);
        match alarm {
            Some(alarm) if stood_under_alarm => Err(SimCardError::Alarm(alarm)),
            _ => Ok(self.card.status()),
        }
    }

    fn begin_path(&mut self, start: PathStart) -> Result<(), SimCardError> {
        self.start = start;
        self.card.open(&CardSettings { start, ..self.settings }).map_err(SimCardError::EpochRefused)
    }

    fn status(&self) -> &CardStatus<A> {
        self.card.status()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use retrace_core::limits::PulseLimits;
    use retrace_core::{Flags, Rate, Record, RecordIndex};

    fn limits<const A: usize>() -> RateLimits<A> {
        let axis = PulseLimits { velocity: 100 << 32, acceleration: 8 << 32, jerk: 1 << 32 };
        RateLimits::new(13, 1 << 15, [axis; A]).expect("valid")
    }

    #[test]
    fn counts_every_pulse_of_a_walk_there_and_back() {
        let mut card = SimCard::<2>::new(RecordIndex::new(0), limits(), Clock::Virtual).expect("fits");
        for place in 0..100u32 {
            let flags = if place == 99 { Flags::REST } else { Flags::NONE };
            let record = Record { increments: [7, -(place as i16)], flags, ..Record::default() };
            card.send(HostCommand::Ahead { place: RecordIndex::new(place), record }).expect("room");
        }
        card.send(HostCommand::rate(Rate::ONE)).expect("a rate");
        for _ in 0..100 {
            card.run_period().expect("no fault");
        }
        assert_eq!(card.status().counts, [700, -4950]);
        card.send(HostCommand::rate(-Rate::ONE / 3)).expect("a rate");
        for _ in 0..310 {
            card.run_period().expect("no fault");
        }
        assert_eq!(card.status().counts, [0, 0]);
        assert_eq!(card.counters().pulses(), &[1400, 9900]);
    }

    #[test]
    fn wall_time_passes() {
        let begin = std::time::Instant::now();
        let mut card = SimCard::<1>::new(RecordIndex::new(0), limits(), Clock::wall(1000)).expect("fits");
        for _ in 0..20 {
            card.run_period().expect("no fault");
        }
        assert!(begin.elapsed() >= std::time::Duration::from_millis(20));
        // A caller that comes 5 ms too late catches up.
        let late = card.late_periods();
        std::thread::sleep(std::time::Duration::from_millis(5));
        for _ in 0..5 {
            card.run_period().expect("no fault");
        }
        assert!(card.late_periods() >= late + 3);
    }
}
