//! Motion that follows the spindle: what the operator can do in a thread and in a tap (SPN-20 … SPN-23).
//!
//! Invariant: while the motion follows the spindle, nothing but the spindle moves it, and the card's window ends at no
//! place inside of the thread.

use retrace_core::mode::{Mode, ModeCommand, ModeOutput, Resuming};
use retrace_core::{Place, Rate, RateTarget, RecordIndex};
use retrace_link::{CardStatus, GearStart, GearState, HostCommand, MotionCard, Outputs, SpindleControl, channel};

use super::Session;
use crate::operator::{CommandError, OperatorCommand};

/// Control periods at rest after which the card is told again to follow the spindle: it refuses where the spindle was
/// turned too far, and follows once it is turned back.
const FOLLOW_PERIODS: u32 = 200;

const IN_THREAD: CommandError =
    CommandError::NotNow("the tool is in a thread: `reverse` or `cycle start` turns the spindle and leaves it");
const NOT_REVERSIBLE: CommandError =
    CommandError::NotNow("the machine file has `reversible = false`: the spindle cannot be turned the other way");
const NOT_RETAINED: CommandError = CommandError::NotNow("the beginning of this thread is not retained any more");
const TAP_IS_BARRIER: CommandError =
    CommandError::NotNow("a tap is reversed only with `tap_retrace = true` in the machine file: hold or stop it");
const TAP_HAS_TURNED: CommandError = CommandError::NotNow("the tap is on its way out: `cycle start` goes on");
const NOT_HELD: CommandError = CommandError::NotNow("only a thread or tap that is held follows a spindle by hand");

/// The thread that the motion path entered last.
#[derive(Clone, Copy, Debug)]
struct EnteredThread {
    first: RecordIndex,
    end: RecordIndex,
    /// Whether the requested rate acts on the spindle; otherwise the thread is finished whatever is requested.
    is_held: bool,
    is_reversible: bool,
}

/// Threads of the motion path, and motion that follows a spindle that is turned by hand.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct GearedMotion {
    thread: Option<EnteredThread>,
    /// Whether the motion followed the spindle in the last period.
    was_engaged: bool,
    /// Whether it is to follow the spindle by hand, and the periods at rest since the card was told so.
    follows: Option<u32>,
    /// Whether the tap in progress is reversed out of its hole.
    reverses_tap: bool,
}

impl GearedMotion {
    /// Enters the thread that begins here.
    pub(super) fn enter(&mut self, first: RecordIndex, start: &GearStart) {
        let (is_held, is_reversible) = (start.control == SpindleControl::Held, start.reverse_share > 0);
        self.thread = Some(EnteredThread { first, end: first + start.length, is_held, is_reversible });
    }

    /// Where records ahead end while the path is retraced: the furthest place, or the end of the thread around it.
    pub(super) fn end_of_retrace(&self, reached: RecordIndex) -> RecordIndex {
        match self.thread {
            Some(thread) if thread.first.is_before(reached) && reached.is_before(thread.end) => thread.end,
            _ => reached,
        }
    }

    /// Whether a place lies in the thread that the motion path entered last, or it begins there.
    pub(super) fn is_in_thread(&self, place: RecordIndex) -> bool {
        self.thread.is_some_and(|thread| !place.is_before(thread.first) && place.is_before(thread.end))
    }

    /// Whether the tap in progress is reversed out of its hole.
    pub(super) const fn reverses_tap(&self) -> bool {
        self.reverses_tap
    }
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Whether the motion follows the spindle.
    pub(super) fn is_engaged(&self) -> bool {
        self.card.status().spindle.gear == GearState::Engaged
    }

    /// Applies a command that has its own meaning while the motion follows the spindle, or none. `None`: it is applied
    /// as always.
    pub(super) fn apply_command_in_gear(&mut self, command: OperatorCommand) -> Option<Result<(), CommandError>> {
        if let OperatorCommand::FollowSpindle(on) = command {
            return Some(self.follow_spindle(on));
        }
        if !self.is_engaged() {
            return None;
        }
        if self.probing.is_active() {
            return self.apply_command_in_tap(command);
        }
        let thread = self.geared.thread.filter(|thread| thread.is_held)?;
        match command {
            OperatorCommand::Reverse(_) if !thread.is_reversible => Some(Err(NOT_REVERSIBLE)),
            OperatorCommand::Reverse(_) if thread.first.is_before(self.streamer.oldest()) => Some(Err(NOT_RETAINED)),
            OperatorCommand::Wheel { .. }
            | OperatorCommand::BackBy(_)
            | OperatorCommand::BackToBlock
            | OperatorCommand::BackToPierce
            | OperatorCommand::BackToCutEnd
            | OperatorCommand::BackToContour(_)
            | OperatorCommand::CutFromHere(_)
            | OperatorCommand::CutAll
            | OperatorCommand::CutAsk
            | OperatorCommand::SkipContour
            | OperatorCommand::Pause
            | OperatorCommand::Park
            | OperatorCommand::Pointer => Some(Err(IN_THREAD)),
            _ => None,
        }
    }

    fn apply_command_in_tap(&mut self, command: OperatorCommand) -> Option<Result<(), CommandError>> {
        match command {
            OperatorCommand::Reverse(_) => Some(self.reverse_tap()),
            OperatorCommand::CycleStart | OperatorCommand::Resume if self.geared.reverses_tap => {
                self.geared.reverses_tap = false;
                Some(self.release_hold())
            }
            _ => None,
        }
    }

    /// Turns the spindle of a tap the other way, out of the hole.
    fn reverse_tap(&mut self) -> Result<(), CommandError> {
        let is_allowed = self.recovery.machine().encoder.is_some_and(|encoder| encoder.reverses_taps);
        match self.probing.has_tap_turned() {
            _ if !is_allowed => Err(TAP_IS_BARRIER),
            true => Err(TAP_HAS_TURNED),
            false => {
                self.geared.reverses_tap = true;
                self.release_hold()
            }
        }
    }

    fn release_hold(&mut self) -> Result<(), CommandError> {
        if self.mode_controller.is_held() {
            self.mode_controller.apply(ModeCommand::Resume)?;
        }
        Ok(())
    }

    /// Sets whether the motion follows the spindle while it is switched off and turned by hand.
    fn follow_spindle(&mut self, on: bool) -> Result<(), CommandError> {
        let is_held = self.mode_controller.is_held() && self.is_engaged();
        if on && !is_held {
            return Err(NOT_HELD);
        }
        self.geared.follows = on.then_some(FOLLOW_PERIODS);
        // Refused where nothing follows it.
        let _ = self.card.send(HostCommand::FollowSpindle { on });
        Ok(())
    }

    /// Tells the card again to follow the spindle by hand, and ends a thread or tap that was left at its beginning.
    pub(super) fn watch_gear(&mut self) {
        let (is_engaged, gear) = (self.is_engaged(), self.card.status().spindle.gear);
        if !is_engaged || !self.mode_controller.is_held() {
            self.geared.follows = None;
        }
        if let Some(periods) = &mut self.geared.follows {
            *periods = if self.card.status().at_rest { *periods + 1 } else { 0 };
            if *periods >= FOLLOW_PERIODS {
                *periods = 0;
                let _ = self.card.send(HostCommand::FollowSpindle { on: true });
            }
        }
        // A tap that turns before its spindle has stopped is on its way out: that goes on.
        self.geared.reverses_tap &= !self.probing.has_tap_turned();
        // Behind its end a thread is passed, and a tap that has turned is complete: no other gear waits then.
        let is_left_backward = self.geared.was_engaged && gear == GearState::Waiting;
        self.geared.was_engaged = is_engaged;
        if !is_left_backward {
            return;
        }
        let mode = self.mode_controller.mode();
        if self.probing.is_active() {
            self.geared.reverses_tap = false;
            self.probing.forget_tap_begun();
            let _ = self.mode_controller.apply(ModeCommand::Hold);
        } else if mode == Mode::Run {
            // Turned by hand out of the thread: the machine is behind the furthest place, and held.
            let _ = self.mode_controller.apply(ModeCommand::Reverse(Rate::ONE));
            let _ = self.mode_controller.apply(ModeCommand::Hold);
            self.emit_mode();
        }
    }

    /// The rate of the handwheel: it moves nothing while the motion follows the spindle, and begins no thread.
    pub(super) fn wheel_rate(&self) -> Rate {
        let CardStatus { place, spindle, .. } = *self.card.status();
        let waits_here = self.geared.thread.is_some_and(|thread| place == Place::start_of(thread.first));
        match spindle.gear {
            GearState::Engaged => Rate::ZERO,
            GearState::Waiting if waits_here => self.wheel.rate().min(Rate::ZERO),
            GearState::Waiting | GearState::Off => self.wheel.rate(),
        }
    }

    /// The output of the mode while the motion follows the spindle: an override of 0 is no hold (SPN-20).
    pub(super) fn in_gear(&self, demand: ModeOutput) -> ModeOutput {
        let state = self.mode_controller.state();
        let is_stopped_by_override = state.override_rate == Rate::ZERO || state.rapid_override == Rate::ZERO;
        let moves = matches!(state.mode, Mode::Run | Mode::Rejoin) && !state.held && state.resuming == Resuming::No;
        if moves && is_stopped_by_override && self.is_engaged() {
            return ModeOutput { target: RateTarget::both(Rate::ONE), ..demand };
        }
        demand
    }

    /// These outputs, with the spindle as wanted while the motion follows it: there the card switches it.
    pub(super) fn without_geared_spindle(&self, mut outputs: Outputs, wants: &Outputs) -> Outputs {
        if self.is_engaged() {
            for channel in [channel::SPINDLE, channel::SPEED].map(usize::from) {
                outputs[channel] = wants[channel];
            }
        }
        outputs
    }
}
