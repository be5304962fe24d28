//! The modes of operation: normal run, reverse run, forward run, handwheel, and the way back (REV-5 … REV-11).
//!
//! One call of [`Operation::demand`] a control period turns the operator's words and the card's report into the rate that is
//! asked for and the road that is open.
//!
//! Invariant: look-ahead is on the road in normal run only. Every other mode first brings the cursor to rest, then has the
//! road end at `reached`, and only then moves. Normal run is entered again at the furthest place, at rest, with the outputs as
//! the program expects them; and it goes on after a stop only with such outputs (CUT-17, DNC-9).

use crate::{ONE, Place, RateTarget, Travel};

/// What the machine is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Mode {
    /// Normal run: records are executed for the first time.
    Run,
    /// Reverse run: back over recorded motion.
    Reverse,
    /// Forward run: forward again over recorded motion, up to `reached`.
    Forward,
    /// The handwheel gives speed and direction.
    Wheel,
    /// On the way to `reached` by itself (REV-9).
    Rejoin,
    /// At the furthest place, with outputs that differ from what the program expects there.
    AwaitOutputs,
}

/// A word of the operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModeCommand {
    /// Feed hold: bring the rate to zero, keep the position.
    Hold,
    /// Cycle start after a hold. In normal run the outputs are compared first, and [`Order::Agree`] is waited for where they differ.
    Resume,
    /// The same, which agrees to the outputs that are to be restored; also in place of [`Order::Agree`].
    Recover,
    /// Motion is to go on from a stop that was no hold: the outputs are compared as after [`Order::Resume`].
    Restart {
        /// Outputs that differ may be restored without asking.
        agreed: bool,
    },
    /// Feed override for normal run and the way back, 0 … 1; more counts as 1. Rapid motion is not slowed by it, but at 0 all motion stands.
    Override(Travel),
    /// Rapid override for normal run and the way back, 0 … 1; more counts as 1.
    RapidOverride(Travel),
    /// Reverse run at this rate, above 0 and up to 8; above 1 is rapid retrace.
    Reverse(Travel),
    /// Forward run at this rate, above 0 and up to 8.
    Forward(Travel),
    /// The handwheel takes over.
    Wheel,
    /// Leave reverse, forward or handwheel: forward to `reached`, then on.
    Leave {
        /// Stop at `reached` and wait for [`Order::Agree`] where outputs differ.
        ask: bool,
    },
    /// The outputs may be brought to what the program expects.
    Agree,
}

/// Why an order was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModeError {
    /// Nothing to leave: the machine is in normal run.
    NotRetracing,
    /// Nothing to agree to.
    NothingAsked,
    /// No hold to resume from.
    NotHeld,
    /// A rate that is zero or negative.
    NoRate,
}

/// What the card reports, as far as the mode depends on it.
#[derive(Clone, Copy, Debug)]
pub struct MotionFacts {
    /// Where the cursor stands.
    pub place: Place,
    /// Is the cursor at rest?
    pub at_rest: bool,
    /// Furthest place ever executed, as a record boundary.
    pub reached: u32,
    /// The oldest record that can be gone back to.
    pub oldest: u32,
    /// Are all outputs as the program expects them at `reached`?
    pub outputs_agree: bool,
    /// The rate that the handwheel asks for.
    pub wheel: Travel,
}

/// Something that the operator should be told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OperatorNotice {
    /// Reverse run stands at the oldest record (REV-8).
    Oldest,
    /// The machine stands at the furthest place and the outputs differ: it waits for [`Order::Agree`].
    OutputsDiffer,
    /// Normal run goes on from `reached`.
    GoesOn,
}

/// What the next control period is to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ModeOutput {
    /// The rates to run at, along feed motion and along rapid motion.
    pub target: RateTarget,
    /// May records beyond `reached` be on the road?
    pub look_ahead: bool,
    /// The outputs are to be brought to what the program expects, now.
    pub restore_outputs: bool,
    /// News for the operator.
    pub notice: Option<OperatorNotice>,
}

/// Is normal run to go on after a stop, and what of outputs that differ then?
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Resuming {
    /// It is going on, or not to go on.
    No,
    /// The operator is asked.
    Asking,
    /// They may be restored.
    Agreed,
}

/// The state of operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ModeController {
    mode: Mode,
    held: bool,
    /// Has the cursor come to rest since the mode was entered from normal run?
    turned: bool,
    /// What to do at `reached` where outputs differ: restore them without asking.
    agreed: bool,
    override_rate: Travel,
    rapid_override: Travel,
    retrace_rate: Travel,
    /// Has the operator been told of the end that the cursor stands at?
    told: bool,
    resuming: Resuming,
}

impl Default for ModeController {
    fn default() -> Self {
        Self {
            mode: Mode::Run,
            held: false,
            turned: true,
            agreed: false,
            override_rate: ONE,
            rapid_override: ONE,
            retrace_rate: ONE,
            told: false,
            resuming: Resuming::No,
        }
    }
}

impl ModeController {
    /// On the way to `reached`, as after leaving reverse run with a question: an interrupted job is taken up so.
    #[must_use]
    pub fn returning() -> Self {
        Self { mode: Mode::Rejoin, ..Self::default() }
    }

    /// The mode.
    #[must_use]
    pub const fn mode(&self) -> Mode {
        self.mode
    }

    /// Is a feed hold in force?
    #[must_use]
    pub const fn held(&self) -> bool {
        self.held
    }

    /// The feed override in force.
    #[must_use]
    pub const fn override_rate(&self) -> Travel {
        self.override_rate
    }

    /// The rapid override in force.
    #[must_use]
    pub const fn rapid_override(&self) -> Travel {
        self.rapid_override
    }

    /// Takes an operator's order.
    ///
    /// # Errors
    /// [`Refused`] says why it does not apply; nothing has changed then.
    pub fn order(&mut self, order: ModeCommand) -> Result<(), ModeError> {
        match order {
            ModeCommand::Hold => (self.held, self.resuming) = (true, Resuming::No),
            ModeCommand::Resume if self.held => self.restart(Resuming::Asking),
            ModeCommand::Resume => return Err(ModeError::NotHeld),
            ModeCommand::Recover if self.mode == Mode::AwaitOutputs => (self.held, self.agreed) = (false, true),
            ModeCommand::Recover if self.held => self.restart(Resuming::Agreed),
            ModeCommand::Recover => return Err(ModeError::NothingAsked),
            ModeCommand::Restart { agreed } => self.restart(if agreed { Resuming::Agreed } else { Resuming::Asking }),
            ModeCommand::Override(rate) => self.override_rate = rate.clamp(0, ONE),
            ModeCommand::RapidOverride(rate) => self.rapid_override = rate.clamp(0, ONE),
            ModeCommand::Reverse(rate) | ModeCommand::Forward(rate) if rate <= 0 => return Err(ModeError::NoRate),
            ModeCommand::Reverse(rate) => self.enter(Mode::Reverse, rate),
            ModeCommand::Forward(rate) => self.enter(Mode::Forward, rate),
            ModeCommand::Wheel => self.enter(Mode::Wheel, ONE),
            ModeCommand::Leave { ask } => match self.mode {
                Mode::Run => return Err(ModeError::NotRetracing),
                _ => {
                    self.enter(Mode::Rejoin, ONE);
                    self.agreed = !ask;
                }
            },
            ModeCommand::Agree if self.mode == Mode::AwaitOutputs => self.agreed = true,
            ModeCommand::Agree => return Err(ModeError::NothingAsked),
        }
        Ok(())
    }

    /// What was held goes on; normal run once the outputs agree.
    fn restart(&mut self, resuming: Resuming) {
        self.held = false;
        if self.mode == Mode::Run {
            self.resuming = resuming;
        }
    }

    fn enter(&mut self, mode: Mode, rate: Travel) {
        self.resuming = Resuming::No;
        self.turned &= self.mode != Mode::Run;
        self.mode = mode;
        self.held = false;
        self.agreed = false;
        self.told = false;
        self.retrace_rate = rate.min(8 * ONE);
    }

    /// What the next control period is to do.
    pub fn demand(&mut self, facts: &MotionFacts) -> ModeOutput {
        let mut demand =
            ModeOutput { target: RateTarget::ZERO, look_ahead: false, restore_outputs: false, notice: None };
        if self.mode != Mode::Run && !self.turned {
            // The road must not be cut short under a moving cursor: rest first.
            if !facts.at_rest {
                demand.look_ahead = true;
                return demand;
            }
            self.turned = true;
        }
        let at_reached = facts.at_rest && facts.place == Place::start_of(facts.reached);
        // A stop in normal run may be inside of the record that `reached` lies behind.
        let at_furthest = facts.at_rest && facts.place.boundary_ahead() == facts.reached;
        match self.mode {
            Mode::Run if self.resuming != Resuming::No && facts.outputs_agree => self.resuming = Resuming::No,
            Mode::Run if self.resuming != Resuming::No && at_furthest => {
                self.agreed = self.resuming == Resuming::Agreed;
                (self.mode, self.resuming, self.told) = (Mode::AwaitOutputs, Resuming::No, false);
            }
            Mode::Forward | Mode::Rejoin if at_reached => {
                self.mode = Mode::AwaitOutputs;
                self.told = false;
            }
            // whatever brought the cursor off it, normal run begins at `reached` only
            Mode::AwaitOutputs if !at_furthest => self.mode = Mode::Rejoin,
            Mode::Reverse if facts.at_rest && facts.place == Place::start_of(facts.oldest) && !self.told => {
                self.told = true;
                demand.notice = Some(OperatorNotice::Oldest);
            }
            _ => {}
        }
        if self.mode == Mode::AwaitOutputs && !self.held {
            self.settle(facts, &mut demand);
        }
        demand.look_ahead = self.mode == Mode::Run;
        demand.target = match self.mode {
            _ if self.held || self.resuming != Resuming::No => RateTarget::ZERO,
            Mode::Run | Mode::Rejoin if self.override_rate == 0 => RateTarget::ZERO,
            Mode::Run | Mode::Rejoin => RateTarget { feed: self.override_rate, rapid: self.rapid_override },
            Mode::Reverse => RateTarget::both(-self.retrace_rate),
            Mode::Forward => RateTarget::both(self.retrace_rate),
            Mode::Wheel => RateTarget::both(facts.wheel),
            Mode::AwaitOutputs => RateTarget::ZERO,
        };
        demand
    }

    /// At the furthest place: on with normal run if the outputs agree or may be restored, else wait.
    fn settle(&mut self, facts: &MotionFacts, demand: &mut ModeOutput) {
        if facts.outputs_agree || self.agreed {
            demand.restore_outputs = !facts.outputs_agree;
            demand.notice = Some(OperatorNotice::GoesOn);
            self.mode = Mode::Run;
            self.agreed = false;
            self.told = false;
        } else if !self.told {
            self.told = true;
            demand.notice = Some(OperatorNotice::OutputsDiffer);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn facts(record: u32, reached: u32, at_rest: bool) -> MotionFacts {
        MotionFacts { place: Place::start_of(record), at_rest, reached, oldest: 10, outputs_agree: true, wheel: 0 }
    }

    #[test]
    fn reverse_run_rests_before_the_road_is_cut_and_tells_the_end_once() {
        let mut operation = ModeController::default();
        operation.order(ModeCommand::Reverse(ONE)).expect("a rate");
        let braking = operation.demand(&facts(100, 100, false));
        assert_eq!((braking.target.feed, braking.look_ahead), (0, true));
        let turned = operation.demand(&facts(101, 101, true));
        assert_eq!((turned.target.feed, turned.look_ahead), (-ONE, false));
        assert_eq!(operation.demand(&facts(10, 101, true)).notice, Some(OperatorNotice::Oldest));
        assert_eq!(operation.demand(&facts(10, 101, true)).notice, None);
        operation.order(ModeCommand::Forward(ONE / 2)).expect("a rate");
        // already turned: no need to rest again before the rate changes sign, the drive sees to that
        assert_eq!(operation.demand(&facts(50, 101, false)).target.feed, ONE / 2);
    }

    #[test]
    fn leaving_goes_forward_to_reached_and_on() {
        let mut operation = ModeController::default();
        assert_eq!(operation.order(ModeCommand::Leave { ask: false }), Err(ModeError::NotRetracing));
        operation.order(ModeCommand::Reverse(ONE)).expect("a rate");
        operation.demand(&facts(50, 100, true));
        operation.order(ModeCommand::Leave { ask: false }).expect("retracing");
        let back = operation.demand(&facts(50, 100, false));
        assert_eq!((back.target.feed, back.look_ahead, operation.mode()), (ONE, false, Mode::Rejoin));
        let on = operation.demand(&facts(100, 100, true));
        assert_eq!((on.target.feed, on.look_ahead, on.notice), (ONE, true, Some(OperatorNotice::GoesOn)));
    }

    #[test]
    fn forward_run_ends_at_reached_and_at_rest_and_nowhere_else() {
        let mut operation = ModeController::default();
        operation.order(ModeCommand::Forward(8 * ONE)).expect("a rate");
        assert_eq!(operation.demand(&facts(50, 100, true)).target.feed, 8 * ONE);
        assert_eq!(operation.demand(&facts(100, 100, false)).target.feed, 8 * ONE);
        assert_eq!(operation.mode(), Mode::Forward);
        assert_eq!(operation.demand(&facts(100, 100, true)).notice, Some(OperatorNotice::GoesOn));
        assert_eq!(operation.mode(), Mode::Run);
    }

    #[test]
    fn different_outputs_stop_at_reached_until_the_operator_agrees() {
        let mut operation = ModeController::default();
        operation.order(ModeCommand::Wheel).expect("always");
        operation.demand(&facts(50, 100, true));
        operation.order(ModeCommand::Leave { ask: true }).expect("retracing");
        let differ = MotionFacts { outputs_agree: false, ..facts(100, 100, true) };
        assert_eq!(operation.order(ModeCommand::Agree), Err(ModeError::NothingAsked));
        assert_eq!(operation.demand(&differ).notice, Some(OperatorNotice::OutputsDiffer));
        let waits = operation.demand(&differ);
        assert_eq!((waits.notice, waits.target.feed, waits.look_ahead), (None, 0, false));
        operation.order(ModeCommand::Agree).expect("asked");
        let on = operation.demand(&differ);
        assert_eq!((on.restore_outputs, on.target.feed, on.look_ahead), (true, ONE, true));
    }

    #[test]
    fn normal_run_goes_on_after_a_stop_only_with_outputs_that_agree() {
        let mut operation = ModeController::default();
        operation.order(ModeCommand::Hold).expect("always");
        // inside of a record
        let inside = Place { record: 99, fraction: 5 };
        let differ = MotionFacts { place: inside, outputs_agree: false, ..facts(99, 100, true) };
        operation.order(ModeCommand::Resume).expect("held");
        let braking = operation.demand(&MotionFacts { at_rest: false, ..differ });
        assert_eq!((braking.target.feed, braking.look_ahead, operation.mode()), (0, true, Mode::Run));
        let asks = operation.demand(&differ);
        assert_eq!(
            (asks.target.feed, asks.notice, operation.mode()),
            (0, Some(OperatorNotice::OutputsDiffer), Mode::AwaitOutputs)
        );
        assert_eq!(operation.demand(&differ).notice, None);
        operation.order(ModeCommand::Recover).expect("asked");
        let on = operation.demand(&differ);
        assert_eq!((on.restore_outputs, on.target.feed, operation.mode()), (true, ONE, Mode::Run));
        // agreed at once
        operation.order(ModeCommand::Hold).expect("always");
        operation.order(ModeCommand::Recover).expect("held");
        let on = operation.demand(&differ);
        assert_eq!((on.restore_outputs, on.target.feed, operation.mode()), (true, ONE, Mode::Run));
        // nothing to ask, nothing to say
        for order in [ModeCommand::Restart { agreed: false }, ModeCommand::Restart { agreed: true }] {
            operation.order(order).expect("always");
            let on = operation.demand(&MotionFacts { outputs_agree: true, ..differ });
            assert_eq!((on.restore_outputs, on.target.feed, on.notice), (false, ONE, None));
        }
        assert_eq!(operation.order(ModeCommand::Recover), Err(ModeError::NothingAsked));
    }

    #[test]
    fn rapid_motion_has_an_override_of_its_own_and_stands_at_a_feed_override_of_zero() {
        let mut operation = ModeController::default();
        operation.order(ModeCommand::Override(ONE / 2)).expect("always");
        operation.order(ModeCommand::RapidOverride(ONE / 4)).expect("always");
        let target = |operation: &mut ModeController| operation.demand(&facts(50, 50, true)).target;
        assert_eq!(target(&mut operation), RateTarget { feed: ONE / 2, rapid: ONE / 4 });
        operation.order(ModeCommand::RapidOverride(9 * ONE)).expect("always");
        assert_eq!(target(&mut operation), RateTarget { feed: ONE / 2, rapid: ONE });
        operation.order(ModeCommand::RapidOverride(0)).expect("always");
        assert_eq!(target(&mut operation), RateTarget { feed: ONE / 2, rapid: 0 });
        operation.order(ModeCommand::RapidOverride(ONE)).expect("always");
        operation.order(ModeCommand::Override(0)).expect("always");
        assert_eq!(target(&mut operation), RateTarget::ZERO);
        operation.order(ModeCommand::Reverse(ONE)).expect("a rate");
        assert_eq!(target(&mut operation), RateTarget::both(-ONE));
    }

    #[test]
    fn hold_keeps_every_mode_standing() {
        let mut operation = ModeController::default();
        assert_eq!(operation.order(ModeCommand::Resume), Err(ModeError::NotHeld));
        for order in
            [ModeCommand::Override(ONE), ModeCommand::Wheel, ModeCommand::Reverse(ONE), ModeCommand::Forward(ONE)]
        {
            operation.order(order).expect("always");
            operation.order(ModeCommand::Hold).expect("always");
            let wheel = MotionFacts { wheel: ONE, ..facts(50, 100, true) };
            assert_eq!((operation.demand(&wheel).target.feed, operation.held()), (0, true));
            operation.order(ModeCommand::Resume).expect("held");
            assert!(!operation.held());
            assert_ne!(operation.demand(&wheel).target.feed, 0);
        }
        assert_eq!(operation.order(ModeCommand::Reverse(0)), Err(ModeError::NoRate));
    }
}
