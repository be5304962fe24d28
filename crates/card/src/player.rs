//! The player: window, drive, pulses and switching put together; one call a control period.
//!
//! Invariant: `counts` is `P(place)` at all times, P being the sum of the records before a place (core, `playback`).

use retrace_core::drive::{Drive, Road};
use retrace_core::limits::RateLimits;
use retrace_core::place::before;
use retrace_core::playback::emission;
use retrace_core::{Place, Travel};
use retrace_link::{Change, Refusal, Status, Word, channel};

use crate::{ActionTable, Switching, Window};

/// Most output actions that a card holds at a time.
const ACTIONS: usize = 256;

/// A card's player for `A` axes, a window of `W` records, and an average of the rate law of up to `M` periods.
#[derive(Clone, Debug)]
pub struct Player<const A: usize, const W: usize, const M: usize> {
    window: Window<A, W>,
    drive: Drive<A, M>,
    actions: ActionTable<ACTIONS>,
    switching: Switching,
    target: Travel,
    replay: bool,
    status: Status<A>,
}

impl<const A: usize, const W: usize, const M: usize> Player<A, W, M> {
    /// A card at rest at record `start`, all counts and outputs zero. `None` where the rate law's average is longer than
    /// the card's memory, or the machine brakes too slowly.
    #[must_use]
    pub fn new(start: u32, limits: RateLimits<A>) -> Option<Self> {
        let switching = Switching::default();
        let status = Status {
            period: 0,
            place: Place::start_of(start),
            reached: start,
            low: start,
            high: start,
            rate: 0,
            at_rest: true,
            short: false,
            line: 0,
            increments: [0; A],
            counts: [0; A],
            executed: 0,
            outputs: *switching.outputs(),
        };
        Some(Self {
            window: Window::new(start),
            drive: Drive::new(limits)?,
            actions: ActionTable::default(),
            switching,
            target: 0,
            replay: false,
            status,
        })
    }

    /// The last period's report.
    #[must_use]
    pub fn status(&self) -> &Status<A> {
        &self.status
    }

    /// Takes a word from the host.
    ///
    /// # Errors
    /// A [`Refusal`]; nothing has changed then.
    pub fn take(&mut self, word: Word<A>) -> Result<(), Refusal> {
        let place = self.status.place;
        match word {
            Word::Ahead { place: n, record } => self.window.push_ahead(n, record, place)?,
            Word::Behind { place: n, record, rests } => self.window.push_behind(n, record, rests, self.bound())?,
            Word::Trim { high } => self.window.trim(high, self.bound())?,
            Word::Forget { low } => self.window.forget(low, self.bound_behind())?,
            Word::Action(action) if usize::from(action.channel) >= channel::COUNT => {
                return Err(Refusal::NoSuchChannel);
            }
            Word::Action(action) => self.actions.insert(action, self.window.low(), self.window.high())?,
            Word::Rate { target } => self.target = target,
            Word::Replay { on } => self.replay = on,
            Word::Instruction(instruction) => {
                if !self.drive.at_rest() {
                    return Err(Refusal::InMotion);
                }
                self.switching.begin(instruction)?;
            }
            Word::ByHand(change) => self.switching.set(change)?,
        }
        self.mirror();
        Ok(())
    }

    /// The furthest place ahead that the cursor stands at or is bound to run to.
    fn bound(&self) -> Place {
        self.status.place.moved(self.drive.stopping().max(0))
    }

    /// The furthest place behind that the cursor stands at or is bound to run to.
    fn bound_behind(&self) -> Place {
        self.status.place.moved(self.drive.stopping().min(0))
    }

    /// Lets one control period pass. While an instruction is executed the motion stands.
    pub fn period(&mut self) -> &Status<A> {
        let from = self.status.place;
        let target = if self.switching.busy() { 0 } else { self.target };
        self.switching.period();
        let step = self.drive.step(from, target, &self.window);
        // The drive never leaves the window, so the records are there; were one missing, the card would stand still.
        let (to, increments) = match emission(from, step.to, |n| self.window.record(n)) {
            // at most eight records a period, so they fit 32 bits by far
            Some(increments) => (step.to, increments.map(|pulses| pulses as i32)),
            None => (from, [0; A]),
        };
        self.switch_in_passing(from, to);
        let status = &mut self.status;
        status.period += 1;
        status.place = to;
        status.rate = from.to(to);
        status.short = step.short;
        status.increments = increments;
        for (count, &increment) in status.counts.iter_mut().zip(&increments) {
            *count += i64::from(increment);
        }
        let under = if status.rate < 0 { to.record } else { to.boundary_ahead().wrapping_sub(1) };
        if let Some(record) = self.window.record(under) {
            status.line = record.line;
        }
        let boundary = to.boundary_ahead();
        if before(status.reached, boundary) {
            status.reached = boundary;
        }
        self.mirror();
        &self.status
    }

    /// Output actions between two places: always where they are passed for the first time, else where they are replayed.
    fn switch_in_passing(&mut self, from: Place, to: Place) {
        let reached = self.status.reached;
        if from.to(to) > 0 {
            for action in self.actions.left_forward(from, to) {
                let first_time = !before(action.place, reached);
                if first_time || self.replay {
                    let change = Change { channel: action.channel, value: action.after };
                    // The table holds only channels that were checked when they were taken in.
                    let _ = self.switching.set(change);
                }
            }
        } else if self.replay {
            for action in self.actions.undone_backward(from, to) {
                let change = Change { channel: action.channel, value: action.before };
                let _ = self.switching.set(change);
            }
        }
    }

    fn mirror(&mut self) {
        let status = &mut self.status;
        status.low = self.window.low();
        status.high = self.window.high();
        status.at_rest = self.drive.at_rest();
        status.executed = self.switching.executed();
        status.outputs = *self.switching.outputs();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use retrace_core::limits::AxisLimits;
    use retrace_core::{Flags, ONE, Record};
    use retrace_link::{Action, Instruction};

    fn player() -> Player<1, 64, 32> {
        let axis = AxisLimits { velocity: 30 << 32, acceleration: 8 << 32, jerk: 1 << 32 };
        Player::new(0, RateLimits::new(13, 1 << 15, [axis]).expect("valid")).expect("fits")
    }

    fn fill(player: &mut Player<1, 64, 32>, records: impl IntoIterator<Item = (i16, Flags)>) {
        for (increment, flags) in records {
            let place = player.status().high;
            let record = Record { increments: [increment], flags, line: place + 1, ..Record::default() };
            player.take(Word::Ahead { place, record }).expect("room");
        }
    }

    #[test]
    fn runs_to_the_planned_stop_in_as_many_periods_as_there_are_records() {
        let mut player = player();
        fill(&mut player, (1..=20).map(|n| (n, if n == 20 { Flags::REST } else { Flags::NONE })));
        player.take(Word::Rate { target: ONE }).expect("a rate");
        for n in 1..=20u32 {
            let status = player.period();
            assert_eq!((status.increments[0], status.line), (n as i32, n));
        }
        assert!(player.status().at_rest);
        assert_eq!(player.status().counts, [210]);
        player.take(Word::Rate { target: -ONE }).expect("a rate");
        for _ in 0..20 {
            player.period();
        }
        assert_eq!(
            (player.status().counts, player.status().place, player.status().reached),
            ([0], Place::start_of(0), 20)
        );
    }

    #[test]
    fn an_instruction_waits_for_the_motion_and_holds_it() {
        let mut player = player();
        fill(&mut player, [(5, Flags::NONE), (5, Flags::REST), (5, Flags::REST)]);
        player.take(Word::Rate { target: ONE / 2 }).expect("a rate");
        player.period();
        let instruction = Instruction { number: 1, periods: 3, ..Instruction::default() };
        assert_eq!(player.take(Word::Instruction(instruction)), Err(Refusal::InMotion));
        while !player.period().at_rest {}
        player.take(Word::Instruction(instruction)).expect("at rest");
        for done in [0, 0, 1] {
            let status = player.period();
            assert_eq!((status.executed, status.increments), (done, [0]));
        }
    }

    #[test]
    fn actions_fire_once_and_are_replayed_only_where_wanted() {
        let mut player = player();
        let action = Action { place: 2, channel: 3, before: 0, after: 1 };
        player.take(Word::Action(action)).expect("room");
        assert_eq!(player.take(Word::Action(Action { channel: 200, ..action })), Err(Refusal::NoSuchChannel));
        fill(&mut player, (0..4).map(|n| (1, if n == 3 { Flags::REST } else { Flags::NONE })));
        player.take(Word::Rate { target: ONE }).expect("a rate");
        let outputs = |p: &mut Player<1, 64, 32>| -> Vec<i32> { (0..4).map(|_| p.period().outputs[3]).collect() };
        assert_eq!(outputs(&mut player), [0, 0, 1, 1]);
        player.take(Word::Rate { target: -ONE }).expect("a rate");
        assert_eq!(outputs(&mut player), [1, 1, 1, 1]);
        player.take(Word::ByHand(Change { channel: 3, value: 0 })).expect("a channel");
        player.take(Word::Rate { target: ONE }).expect("a rate");
        assert_eq!(outputs(&mut player), [0, 0, 0, 0]);
        player.take(Word::Replay { on: true }).expect("a switch");
        player.take(Word::ByHand(Change { channel: 3, value: 1 })).expect("a channel");
        player.take(Word::Rate { target: -ONE }).expect("a rate");
        assert_eq!(outputs(&mut player), [1, 0, 0, 0]);
        player.take(Word::Rate { target: ONE }).expect("a rate");
        assert_eq!(outputs(&mut player), [0, 0, 1, 1]);
    }

    proptest! {
        /// Any rates, any sliding of the window: the counts are the sum of the records before the place, always.
        #[test]
        fn counts_are_a_function_of_the_place(
            increments in prop::collection::vec(-30i16..30, 300),
            words in prop::collection::vec((-2 * ONE..2 * ONE, 1u32..60), 1..40),
        ) {
            let mut player = player();
            let mut sums = vec![0i64];
            for &i in &increments { sums.push(sums[sums.len() - 1] + i64::from(i)); }
            for (target, periods) in words {
                player.take(Word::Rate { target }).expect("a rate");
                for _ in 0..periods {
                    let status = *player.status();
                    let record = |n: u32| Record { increments: [increments[n as usize]], ..Record::default() };
                    if target > 0 && (status.high as usize) < increments.len() {
                        let _ = player.take(Word::Ahead { place: status.high, record: record(status.high) });
                    } else if target < 0 && status.low > 0 {
                        let place = status.low - 1;
                        let _ = player.take(Word::Behind { place, record: record(place), rests: place == 0 });
                    }
                    player.period();
                    let status = player.status();
                    let n = status.place.record as usize;
                    let under = increments.get(n).map_or(0, |&i| retrace_core::playback::part(i, status.place.fraction));
                    prop_assert_eq!(status.counts[0], sums[n] + i64::from(under));
                }
            }
        }
    }
}
