//! Operating modes: normal run, reverse run, forward run, handwheel, and the return to normal run (REV-5 … REV-11).
//!
//! One call of [`ModeController::advance_period`] per control period derives the target rate and the end of the open
//! record window from the operator's commands and the card's report.
//!
//! Invariant: look-ahead is open in normal run only. Every other mode first brings the cursor to rest, then ends the
//! window at `reached`, and only then moves. Normal run is entered again at the furthest place, at rest, with the
//! outputs in the state that the program expects; after a stop, normal run is resumed only with such outputs (CUT-17,
//! DNC-9).

use crate::{Place, Rate, RateTarget, RecordIndex};

/// Operating mode of the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Mode {
    /// Normal run: records are executed for the first time.
    Run,
    /// Reverse run: backward over recorded motion.
    Reverse,
    /// Forward run: forward again over recorded motion, up to `reached`.
    Forward,
    /// Handwheel: it sets speed and direction.
    Wheel,
    /// Automatic motion to `reached` (REV-9).
    Rejoin,
    /// At the furthest place, with outputs that differ from the state that the program expects there.
    AwaitOutputs,
}

impl Mode {
    /// Every mode.
    pub const ALL: [Self; 6] = [Self::Run, Self::Reverse, Self::Forward, Self::Wheel, Self::Rejoin, Self::AwaitOutputs];

    /// Name of the mode as an identifier: `run`, `reverse`, `forward`, `wheel`, `rejoin` or `await_outputs`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Run => "run",
            Self::Reverse => "reverse",
            Self::Forward => "forward",
            Self::Wheel => "wheel",
            Self::Rejoin => "rejoin",
            Self::AwaitOutputs => "await_outputs",
        }
    }
}

/// Command of the operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModeCommand {
    /// Feed hold: bring the rate to zero, keep the position.
    Hold,
    /// Cycle start after a hold. In normal run the outputs are compared first; if they differ, [`ModeCommand::Confirm`]
    /// is awaited.
    Resume,
    /// Cycle start after a hold with confirmation of the outputs to restore; also accepted in place of
    /// [`ModeCommand::Confirm`].
    Recover,
    /// Resumes motion after a stop other than a hold: the outputs are compared as after [`ModeCommand::Resume`].
    Restart {
        /// Whether outputs that differ may be restored without asking.
        confirmed: bool,
    },
    /// Feed override for normal run and the return to it, 0 … 1; larger values count as 1. Rapid motion is not slowed
    /// by it, but at 0 all motion is stopped.
    Override(Rate),
    /// Rapid override for normal run and the return to it, 0 … 1; larger values count as 1.
    RapidOverride(Rate),
    /// Reverse run at this rate, above 0 and up to 8; above 1 is rapid retrace.
    Reverse(Rate),
    /// Forward run at this rate, above 0 and up to 8.
    Forward(Rate),
    /// Handwheel mode.
    Wheel,
    /// Leaves reverse run, forward run or handwheel: forward to `reached`, then normal run.
    Leave {
        /// Whether to stop at `reached` and await [`ModeCommand::Confirm`] if outputs differ.
        ask: bool,
    },
    /// Confirms that the outputs may be set to the state that the program expects.
    Confirm,
}

/// Reason why a command is rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModeError {
    /// The machine is in normal run; there is no retracing to leave.
    NotRetracing,
    /// No confirmation is awaited.
    NothingToConfirm,
    /// No hold is active.
    NotHeld,
    /// The rate is zero or negative.
    RateNotPositive,
}

impl core::fmt::Display for ModeError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::NotRetracing => "the machine is in normal run; there is no retracing to leave",
            Self::NothingToConfirm => "no confirmation is awaited",
            Self::NotHeld => "no feed hold is active",
            Self::RateNotPositive => "the rate must be above 0",
        })
    }
}

impl core::error::Error for ModeError {}

/// State reported by the card, as far as the mode depends on it.
#[derive(Clone, Copy, Debug)]
pub struct MotionFacts {
    /// Place of the cursor.
    pub place: Place,
    /// Whether the cursor is at rest.
    pub at_rest: bool,
    /// Furthest place ever executed, as a record boundary.
    pub reached: RecordIndex,
    /// Oldest record that reverse run can reach.
    pub oldest: RecordIndex,
    /// Whether all outputs are in the state that the program expects at `reached`.
    pub outputs_agree: bool,
    /// Rate that the handwheel commands.
    pub wheel: Rate,
}

/// Notice to the operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OperatorNotice {
    /// Reverse run is at rest at the oldest record (REV-8).
    HistoryStart,
    /// The machine is at rest at the furthest place and the outputs differ: [`ModeCommand::Confirm`] is awaited.
    OutputsDiffer,
    /// Normal run is resumed at `reached`.
    RunResumed,
}

/// Output for the next control period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ModeOutput {
    /// Target rates along feed motion and along rapid motion.
    pub target: RateTarget,
    /// Whether records beyond `reached` may be in the window.
    pub look_ahead: bool,
    /// Whether to set the outputs now to the state that the program expects.
    pub restore_outputs: bool,
    /// Notice to the operator, if any.
    pub notice: Option<OperatorNotice>,
}

/// Whether normal run is to be resumed after a stop, and what happens to outputs that differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Resuming {
    /// Normal run is active, or is not to be resumed.
    No,
    /// The operator is asked about outputs that differ.
    Ask,
    /// Outputs that differ may be restored without asking.
    Confirmed,
}

/// Complete state of a [`ModeController`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ModeState {
    /// Operating mode.
    pub mode: Mode,
    /// Whether a feed hold is active.
    pub held: bool,
    /// Whether the cursor has come to rest since the mode was entered from normal run.
    pub rested_since_run: bool,
    /// Whether outputs that differ at `reached` are restored without asking.
    pub confirmed: bool,
    /// Feed override, 0 … 1.
    pub override_rate: Rate,
    /// Rapid override, 0 … 1.
    pub rapid_override: Rate,
    /// Rate of reverse run and forward run, above 0 and up to [`Rate::MAX`].
    pub retrace_rate: Rate,
    /// Whether the operator has been notified of the end at which the cursor is at rest.
    pub notified: bool,
    /// Whether normal run is to be resumed after a stop.
    pub resuming: Resuming,
}

/// Controller of the operating mode.
///
/// # Examples
///
/// ```
/// use retrace_core::mode::{Mode, ModeCommand, ModeController, MotionFacts};
/// use retrace_core::{Place, Rate, RecordIndex};
///
/// let facts = MotionFacts {
///     place: Place::start_of(RecordIndex::new(50)),
///     at_rest: true,
///     reached: RecordIndex::new(50),
///     oldest: RecordIndex::new(0),
///     outputs_agree: true,
///     wheel: Rate::ZERO,
/// };
/// let mut modes = ModeController::default();
/// modes.apply(ModeCommand::Reverse(Rate::ONE / 2))?;
/// let output = modes.advance_period(&facts);
/// assert_eq!((modes.mode(), output.target.feed), (Mode::Reverse, -Rate::ONE / 2));
/// # Ok::<(), retrace_core::mode::ModeError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ModeController {
    state: ModeState,
}

impl Default for ModeController {
    fn default() -> Self {
        Self::with_state(ModeState {
            mode: Mode::Run,
            held: false,
            rested_since_run: true,
            confirmed: false,
            override_rate: Rate::ONE,
            rapid_override: Rate::ONE,
            retrace_rate: Rate::ONE,
            notified: false,
            resuming: Resuming::No,
        })
    }
}

impl ModeController {
    /// Returns a controller in this state, so that a proof can begin in any.
    #[must_use]
    pub const fn with_state(state: ModeState) -> Self {
        Self { state }
    }

    /// Returns the complete state.
    #[must_use]
    pub const fn state(&self) -> ModeState {
        self.state
    }

    /// Returns a controller that moves to `reached` and asks about outputs that differ, for the resumption of an
    /// interrupted job.
    #[must_use]
    pub fn rejoining() -> Self {
        Self::with_state(ModeState { mode: Mode::Rejoin, ..Self::default().state })
    }

    /// Returns the operating mode.
    #[must_use]
    pub const fn mode(&self) -> Mode {
        self.state.mode
    }

    /// Whether a feed hold is active.
    #[must_use]
    pub const fn is_held(&self) -> bool {
        self.state.held
    }

    /// Returns the active feed override.
    #[must_use]
    pub const fn override_rate(&self) -> Rate {
        self.state.override_rate
    }

    /// Returns the active rapid override.
    #[must_use]
    pub const fn rapid_override(&self) -> Rate {
        self.state.rapid_override
    }

    /// Applies a command of the operator.
    ///
    /// # Errors
    /// Returns the reason why the command does not apply; the state is unchanged then.
    pub fn apply(&mut self, command: ModeCommand) -> Result<(), ModeError> {
        match command {
            ModeCommand::Hold => (self.state.held, self.state.resuming) = (true, Resuming::No),
            ModeCommand::Resume if self.state.held => self.resume_motion(Resuming::Ask),
            ModeCommand::Resume => return Err(ModeError::NotHeld),
            ModeCommand::Recover if self.state.mode == Mode::AwaitOutputs => {
                (self.state.held, self.state.confirmed) = (false, true)
            }
            ModeCommand::Recover if self.state.held => self.resume_motion(Resuming::Confirmed),
            ModeCommand::Recover => return Err(ModeError::NothingToConfirm),
            ModeCommand::Restart { confirmed } => {
                self.resume_motion(if confirmed { Resuming::Confirmed } else { Resuming::Ask })
            }
            ModeCommand::Override(rate) => self.state.override_rate = rate.clamp(Rate::ZERO, Rate::ONE),
            ModeCommand::RapidOverride(rate) => self.state.rapid_override = rate.clamp(Rate::ZERO, Rate::ONE),
            ModeCommand::Reverse(rate) | ModeCommand::Forward(rate) if rate <= Rate::ZERO => {
                return Err(ModeError::RateNotPositive);
            }
            ModeCommand::Reverse(rate) => self.enter(Mode::Reverse, rate),
            ModeCommand::Forward(rate) => self.enter(Mode::Forward, rate),
            ModeCommand::Wheel => self.enter(Mode::Wheel, Rate::ONE),
            ModeCommand::Leave { ask } => match self.state.mode {
                Mode::Run => return Err(ModeError::NotRetracing),
                _ => {
                    self.enter(Mode::Rejoin, Rate::ONE);
                    self.state.confirmed = !ask;
                }
            },
            ModeCommand::Confirm if self.state.mode == Mode::AwaitOutputs => self.state.confirmed = true,
            ModeCommand::Confirm => return Err(ModeError::NothingToConfirm),
        }
        Ok(())
    }

    /// Ends the hold; in normal run motion is resumed once the outputs agree.
    fn resume_motion(&mut self, resuming: Resuming) {
        self.state.held = false;
        if self.state.mode == Mode::Run {
            self.state.resuming = resuming;
        }
    }

    fn enter(&mut self, mode: Mode, rate: Rate) {
        self.state.resuming = Resuming::No;
        self.state.rested_since_run &= self.state.mode != Mode::Run;
        self.state.mode = mode;
        self.state.held = false;
        self.state.confirmed = false;
        self.state.notified = false;
        self.state.retrace_rate = rate.min(Rate::MAX);
    }

    /// Advances by one control period and returns its output.
    pub fn advance_period(&mut self, facts: &MotionFacts) -> ModeOutput {
        let mut output =
            ModeOutput { target: RateTarget::ZERO, look_ahead: false, restore_outputs: false, notice: None };
        if self.state.mode != Mode::Run && !self.state.rested_since_run {
            // The window must not be cut short under a moving cursor: rest first.
            if !facts.at_rest {
                output.look_ahead = true;
                return output;
            }
            self.state.rested_since_run = true;
        }
        let at_reached = facts.at_rest && facts.place == Place::start_of(facts.reached);
        // A stop in normal run may be inside the record that ends at `reached`.
        let at_furthest = facts.at_rest && facts.place.boundary_ahead() == facts.reached;
        match self.state.mode {
            Mode::Run if self.state.resuming != Resuming::No && facts.outputs_agree => {
                self.state.resuming = Resuming::No
            }
            Mode::Run if self.state.resuming != Resuming::No && at_furthest => {
                self.state.confirmed = self.state.resuming == Resuming::Confirmed;
                (self.state.mode, self.state.resuming, self.state.notified) = (Mode::AwaitOutputs, Resuming::No, false);
            }
            Mode::Forward | Mode::Rejoin if at_reached => {
                self.state.mode = Mode::AwaitOutputs;
                self.state.notified = false;
            }
            // whatever moved the cursor away, normal run begins only at `reached`
            Mode::AwaitOutputs if !at_furthest => self.state.mode = Mode::Rejoin,
            Mode::Reverse if facts.at_rest && facts.place == Place::start_of(facts.oldest) && !self.state.notified => {
                self.state.notified = true;
                output.notice = Some(OperatorNotice::HistoryStart);
            }
            _ => {}
        }
        if self.state.mode == Mode::AwaitOutputs && !self.state.held {
            self.await_outputs(facts, &mut output);
        }
        output.look_ahead = self.state.mode == Mode::Run;
        output.target = match self.state.mode {
            _ if self.state.held || self.state.resuming != Resuming::No => RateTarget::ZERO,
            Mode::Run | Mode::Rejoin if self.state.override_rate == Rate::ZERO => RateTarget::ZERO,
            Mode::Run | Mode::Rejoin => RateTarget { feed: self.state.override_rate, rapid: self.state.rapid_override },
            Mode::Reverse => RateTarget::both(-self.state.retrace_rate),
            Mode::Forward => RateTarget::both(self.state.retrace_rate),
            Mode::Wheel => RateTarget::both(facts.wheel),
            Mode::AwaitOutputs => RateTarget::ZERO,
        };
        output
    }

    /// At the furthest place: resumes normal run if the outputs agree or may be restored, else waits.
    fn await_outputs(&mut self, facts: &MotionFacts, output: &mut ModeOutput) {
        if facts.outputs_agree || self.state.confirmed {
            output.restore_outputs = !facts.outputs_agree;
            output.notice = Some(OperatorNotice::RunResumed);
            self.state.mode = Mode::Run;
            self.state.confirmed = false;
            self.state.notified = false;
        } else if !self.state.notified {
            self.state.notified = true;
            output.notice = Some(OperatorNotice::OutputsDiffer);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn facts(record: u32, reached: u32, at_rest: bool) -> MotionFacts {
        MotionFacts {
            place: Place::start_of(RecordIndex::new(record)),
            at_rest,
            reached: RecordIndex::new(reached),
            oldest: RecordIndex::new(10),
            outputs_agree: true,
            wheel: Rate::ZERO,
        }
    }

    #[test]
    fn reverse_run_rests_before_the_window_is_cut_and_reports_the_end_once() {
        let mut controller = ModeController::default();
        controller.apply(ModeCommand::Reverse(Rate::ONE)).expect("a rate");
        let braking = controller.advance_period(&facts(100, 100, false));
        assert_eq!((braking.target.feed, braking.look_ahead), (Rate::ZERO, true));
        let turned = controller.advance_period(&facts(101, 101, true));
        assert_eq!((turned.target.feed, turned.look_ahead), (-Rate::ONE, false));
        assert_eq!(controller.advance_period(&facts(10, 101, true)).notice, Some(OperatorNotice::HistoryStart));
        assert_eq!(controller.advance_period(&facts(10, 101, true)).notice, None);
        controller.apply(ModeCommand::Forward(Rate::ONE / 2)).expect("a rate");
        // already at rest since normal run: no second rest before the sign changes, the drive ensures that
        assert_eq!(controller.advance_period(&facts(50, 101, false)).target.feed, Rate::ONE / 2);
    }

    #[test]
    fn leaving_goes_forward_to_reached_and_on() {
        let mut controller = ModeController::default();
        assert_eq!(controller.apply(ModeCommand::Leave { ask: false }), Err(ModeError::NotRetracing));
        controller.apply(ModeCommand::Reverse(Rate::ONE)).expect("a rate");
        controller.advance_period(&facts(50, 100, true));
        controller.apply(ModeCommand::Leave { ask: false }).expect("retracing");
        let back = controller.advance_period(&facts(50, 100, false));
        assert_eq!((back.target.feed, back.look_ahead, controller.mode()), (Rate::ONE, false, Mode::Rejoin));
        let on = controller.advance_period(&facts(100, 100, true));
        assert_eq!((on.target.feed, on.look_ahead, on.notice), (Rate::ONE, true, Some(OperatorNotice::RunResumed)));
    }

    #[test]
    fn forward_run_ends_at_reached_and_at_rest_and_nowhere_else() {
        let mut controller = ModeController::default();
        controller.apply(ModeCommand::Forward(Rate::MAX)).expect("a rate");
        assert_eq!(controller.advance_period(&facts(50, 100, true)).target.feed, Rate::MAX);
        assert_eq!(controller.advance_period(&facts(100, 100, false)).target.feed, Rate::MAX);
        assert_eq!(controller.mode(), Mode::Forward);
        assert_eq!(controller.advance_period(&facts(100, 100, true)).notice, Some(OperatorNotice::RunResumed));
        assert_eq!(controller.mode(), Mode::Run);
    }

    #[test]
    fn different_outputs_stop_at_reached_until_the_operator_agrees() {
        let mut controller = ModeController::default();
        controller.apply(ModeCommand::Wheel).expect("always");
        controller.advance_period(&facts(50, 100, true));
        controller.apply(ModeCommand::Leave { ask: true }).expect("retracing");
        let differ = MotionFacts { outputs_agree: false, ..facts(100, 100, true) };
        assert_eq!(controller.apply(ModeCommand::Confirm), Err(ModeError::NothingToConfirm));
        assert_eq!(controller.advance_period(&differ).notice, Some(OperatorNotice::OutputsDiffer));
        let waits = controller.advance_period(&differ);
        assert_eq!((waits.notice, waits.target.feed, waits.look_ahead), (None, Rate::ZERO, false));
        controller.apply(ModeCommand::Confirm).expect("asked");
        let on = controller.advance_period(&differ);
        assert_eq!((on.restore_outputs, on.target.feed, on.look_ahead), (true, Rate::ONE, true));
    }

    #[test]
    fn normal_run_goes_on_after_a_stop_only_with_outputs_that_agree() {
        let mut controller = ModeController::default();
        controller.apply(ModeCommand::Hold).expect("always");
        // inside a record
        let inside = Place { record: RecordIndex::new(99), fraction: 5 };
        let differ = MotionFacts { place: inside, outputs_agree: false, ..facts(99, 100, true) };
        controller.apply(ModeCommand::Resume).expect("held");
        let braking = controller.advance_period(&MotionFacts { at_rest: false, ..differ });
        assert_eq!((braking.target.feed, braking.look_ahead, controller.mode()), (Rate::ZERO, true, Mode::Run));
        let asks = controller.advance_period(&differ);
        assert_eq!(
            (asks.target.feed, asks.notice, controller.mode()),
            (Rate::ZERO, Some(OperatorNotice::OutputsDiffer), Mode::AwaitOutputs)
        );
        assert_eq!(controller.advance_period(&differ).notice, None);
        controller.apply(ModeCommand::Recover).expect("asked");
        let on = controller.advance_period(&differ);
        assert_eq!((on.restore_outputs, on.target.feed, controller.mode()), (true, Rate::ONE, Mode::Run));
        // confirmed at once
        controller.apply(ModeCommand::Hold).expect("always");
        controller.apply(ModeCommand::Recover).expect("held");
        let on = controller.advance_period(&differ);
        assert_eq!((on.restore_outputs, on.target.feed, controller.mode()), (true, Rate::ONE, Mode::Run));
        // nothing to ask, nothing to report
        for command in [ModeCommand::Restart { confirmed: false }, ModeCommand::Restart { confirmed: true }] {
            controller.apply(command).expect("always");
            let on = controller.advance_period(&MotionFacts { outputs_agree: true, ..differ });
            assert_eq!((on.restore_outputs, on.target.feed, on.notice), (false, Rate::ONE, None));
        }
        assert_eq!(controller.apply(ModeCommand::Recover), Err(ModeError::NothingToConfirm));
    }

    #[test]
    fn rapid_motion_has_an_override_of_its_own_and_stands_at_a_feed_override_of_zero() {
        let mut controller = ModeController::default();
        controller.apply(ModeCommand::Override(Rate::ONE / 2)).expect("always");
        controller.apply(ModeCommand::RapidOverride(Rate::ONE / 4)).expect("always");
        let target = |controller: &mut ModeController| controller.advance_period(&facts(50, 50, true)).target;
        assert_eq!(target(&mut controller), RateTarget { feed: Rate::ONE / 2, rapid: Rate::ONE / 4 });
        controller.apply(ModeCommand::RapidOverride(Rate::ONE * 9)).expect("always");
        assert_eq!(target(&mut controller), RateTarget { feed: Rate::ONE / 2, rapid: Rate::ONE });
        controller.apply(ModeCommand::RapidOverride(Rate::ZERO)).expect("always");
        assert_eq!(target(&mut controller), RateTarget { feed: Rate::ONE / 2, rapid: Rate::ZERO });
        controller.apply(ModeCommand::RapidOverride(Rate::ONE)).expect("always");
        controller.apply(ModeCommand::Override(Rate::ZERO)).expect("always");
        assert_eq!(target(&mut controller), RateTarget::ZERO);
        controller.apply(ModeCommand::Reverse(Rate::ONE)).expect("a rate");
        assert_eq!(target(&mut controller), RateTarget::both(-Rate::ONE));
    }

    #[test]
    fn hold_keeps_every_mode_standing() {
        let mut controller = ModeController::default();
        assert_eq!(controller.apply(ModeCommand::Resume), Err(ModeError::NotHeld));
        for command in [
            ModeCommand::Override(Rate::ONE),
            ModeCommand::Wheel,
            ModeCommand::Reverse(Rate::ONE),
            ModeCommand::Forward(Rate::ONE),
        ] {
            controller.apply(command).expect("always");
            controller.apply(ModeCommand::Hold).expect("always");
            let wheel = MotionFacts { wheel: Rate::ONE, ..facts(50, 100, true) };
            assert_eq!((controller.advance_period(&wheel).target.feed, controller.is_held()), (Rate::ZERO, true));
            controller.apply(ModeCommand::Resume).expect("held");
            assert!(!controller.is_held());
            assert_ne!(controller.advance_period(&wheel).target.feed, Rate::ZERO);
        }
        assert_eq!(controller.apply(ModeCommand::Reverse(Rate::ZERO)), Err(ModeError::RateNotPositive));
    }

    /// An operator can tell the reasons apart.
    #[test]
    fn every_reason_has_words_of_its_own() {
        use ModeError::{NotHeld, NotRetracing, NothingToConfirm, RateNotPositive};
        let words = [NotRetracing, NothingToConfirm, NotHeld, RateNotPositive].map(|reason| reason.to_string());
        for (n, reason) in words.iter().enumerate() {
            assert!(!reason.is_empty() && !words[..n].contains(reason), "{reason}");
        }
    }
}
