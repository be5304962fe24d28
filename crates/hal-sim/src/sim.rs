//! A simulated card behind the trait that every card stands behind.
//!
//! Invariant: it runs `retrace_card::Player`, the same code as the firmware; it is no second card.

use core::fmt;

use retrace_card::Player;
use retrace_core::limits::RateLimits;
use retrace_link::{CardFault, MotionCard, Refusal, Start, Status, Word};

use crate::{Clock, PulseCounters};

/// Records that the simulated card holds.
pub const WINDOW: usize = 4096;

/// Longest average of its rate law, in periods.
pub(crate) const MEMORY: usize = 1023;

/// A simulated card for `A` axes.
#[derive(Debug)]
pub struct SimCard<const A: usize> {
    player: Box<Player<A, WINDOW, MEMORY>>,
    clock: Clock,
    counters: PulseCounters<A>,
    status: Status<A>,
}

/// What can go wrong with a simulated card.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooManyPulses {
    /// The control period in which it happened.
    pub period: u64,
}

impl fmt::Display for TooManyPulses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "control period {}: more pulses than the card can emit in a period", self.period)
    }
}

impl CardFault for TooManyPulses {
    fn number(&self) -> &'static str {
        "E3017"
    }

    fn remedy(&self) -> &'static str {
        "lower pulses_per_mm or max_velocity_mm_per_s, or lengthen the control period"
    }
}

impl<const A: usize> SimCard<A> {
    /// A card at rest, its first record to have the number `start`. `None` where the rate law's average is too long for a card.
    #[must_use]
    pub fn new(start: u32, limits: RateLimits<A>, clock: Clock) -> Option<Self> {
        let player = Box::new(Player::new(start, limits)?);
        let status = *player.status();
        Some(Self { player, clock, counters: PulseCounters::default(), status })
    }

    /// The pulses that came out.
    #[must_use]
    pub fn counters(&self) -> &PulseCounters<A> {
        &self.counters
    }
}

impl<const A: usize> MotionCard<A> for SimCard<A> {
    type Fault = TooManyPulses;

    fn window(&self) -> u32 {
        WINDOW as u32
    }

    fn send(&mut self, word: Word<A>) -> Result<(), Refusal> {
        self.player.take(word)?;
        let counts = self.status.counts;
        self.status = *self.player.status();
        self.status.counts = counts;
        Ok(())
    }

    fn period(&mut self) -> Result<&Status<A>, TooManyPulses> {
        self.clock.wait(self.status.period + 1);
        self.status = *self.player.period();
        if !self.counters.emit(&self.status.increments) {
            return Err(TooManyPulses { period: self.status.period });
        }
        self.status.counts = *self.counters.positions();
        Ok(&self.status)
    }

    fn begin(&mut self, _: Start) -> Result<(), TooManyPulses> {
        todo!("the player's epochs")
    }

    fn status(&self) -> &Status<A> {
        &self.status
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use retrace_core::limits::AxisLimits;
    use retrace_core::{Flags, ONE, Record};

    fn limits<const A: usize>() -> RateLimits<A> {
        let axis = AxisLimits { velocity: 100 << 32, acceleration: 8 << 32, jerk: 1 << 32 };
        RateLimits::new(13, 1 << 15, [axis; A]).expect("valid")
    }

    #[test]
    fn counts_every_pulse_of_a_walk_there_and_back() {
        let mut card = SimCard::<2>::new(0, limits(), Clock::Virtual).expect("fits");
        for place in 0..100u32 {
            let flags = if place == 99 { Flags::REST } else { Flags::NONE };
            let record = Record { increments: [7, -(place as i16)], flags, ..Record::default() };
            card.send(Word::Ahead { place, record }).expect("room");
        }
        card.send(Word::Rate { target: ONE }).expect("a rate");
        for _ in 0..100 {
            card.period().expect("no fault");
        }
        assert_eq!(card.status().counts, [700, -4950]);
        card.send(Word::Rate { target: -ONE / 3 }).expect("a rate");
        for _ in 0..310 {
            card.period().expect("no fault");
        }
        assert_eq!(card.status().counts, [0, 0]);
        assert_eq!(card.counters().pulses(), &[1400, 9900]);
    }

    #[test]
    fn wall_time_passes() {
        let begin = std::time::Instant::now();
        let mut card = SimCard::<1>::new(0, limits(), Clock::wall(1000)).expect("fits");
        for _ in 0..20 {
            card.period().expect("no fault");
        }
        assert!(begin.elapsed() >= std::time::Duration::from_millis(20));
    }
}
