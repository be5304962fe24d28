//! Motion that follows the spindle: what the operator can do in a thread and in a tap (SPN-20 … SPN-23).
//!
//! Invariant: while the motion follows the spindle, nothing but the spindle moves it, and the card's window ends at no
//! place inside of the thread.

use retrace_core::mode::{Mode, ModeCommand, ModeOutput, Resuming};
use retrace_core::{Distance, Place, Rate, RateTarget, RecordIndex};
use retrace_link::{CardStatus, GearState, HostCommand, MotionCard, Outputs, channel};

mod arming;

use super::Session;
use crate::entered_threads::{EnteredThread, EnteredThreads};
use crate::operator::{CommandError, OperatorCommand};

/// Control periods at rest after which the card is told again to follow the spindle: it refuses where the spindle was
/// turned too far, and follows once it is turned back.
const FOLLOW_PERIODS: u32 = 200;

/// Speed in thousandths of a revolution per minute below which a spindle counts as at rest.
const RESTING_SPEED: u32 = 10_000;

const IN_THREAD: CommandError =
    CommandError::NotNow("the tool is in a thread: `reverse` or `cycle start` turns the spindle and leaves it");
const NOT_REVERSIBLE: CommandError =
    CommandError::NotNow("the machine file has `reversible = false`: the spindle cannot be turned the other way");
const NOT_RETAINED: CommandError = CommandError::NotNow("the beginning of this thread is not retained any more");
const TAP_IS_BARRIER: CommandError =
    CommandError::NotNow("a tap is reversed only with `tap_retrace = true` in the machine file: hold or stop it");
const TAP_HAS_TURNED: CommandError = CommandError::NotNow("the tap is on its way out: `cycle start` goes on");
const NOT_IN_THREAD: CommandError = CommandError::NotNow(
    "the tool is neither held in a thread nor at rest behind one that reverse run has come back to",
);
const SPINDLE_TURNS: CommandError =
    CommandError::NotNow("the spindle is on, or turns: `output 64 off`, and wait until it rests");
const NOT_FREED: CommandError =
    CommandError::NotNow("the card has not taken the gear off: `tool free` again with the spindle at rest");
const THREAD_NOT_CUT: CommandError =
    CommandError::NotNow("this thread is not cut to its end: `reverse` to its beginning, and cut it again from there");
const NOT_HELD: CommandError = CommandError::NotNow("only a thread or tap that is held follows a spindle by hand");

/// Threads of the motion path, and motion that follows a spindle that is turned by hand.
#[derive(Clone, Debug, Default)]
pub(super) struct GearedMotion {
    threads: EnteredThreads,
    /// The thread in which the motion followed the spindle in the last period.
    was_engaged: Option<EnteredThread>,
    /// Whether it followed it in a tap.
    is_tapping: bool,
    /// Whether it is to follow the spindle by hand, and the periods at rest since the card was told so.
    follows: Option<u32>,
    /// Whether the tap in progress is reversed out of its hole.
    reverses_tap: bool,
    /// Whether the card was told that the tool is free of the thread, and has not reported it.
    awaits_freed: bool,
    /// Where the card was told to arm a thread again: its count once it has, and the control periods since.
    unreported: Option<(u8, u32)>,
}

impl GearedMotion {
    /// Whether a place lies in a thread that the motion path entered, or one begins there.
    pub(super) fn is_in_thread(&self, place: RecordIndex) -> bool {
        self.threads.with_record(place).is_some()
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
        if command == OperatorCommand::ToolFree {
            return Some(self.free_tool());
        }
        if let Err(refused) = self.check_freed(command) {
            return Some(Err(refused));
        }
        if !self.is_engaged() {
            return self.open_thread(command).err().map(Err);
        }
        if self.probing.is_active() {
            return self.apply_command_in_tap(command);
        }
        let thread = self.geared.threads.armed().filter(EnteredThread::is_held)?;
        match command {
            OperatorCommand::Reverse(_) if !thread.is_reversible() => Some(Err(NOT_REVERSIBLE)),
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

    /// Takes the gear off the thread in which the tool is held, or behind which reverse run rests. The machine stays
    /// held, in reverse run.
    fn free_tool(&mut self) -> Result<(), CommandError> {
        let status = *self.card.status();
        let is_held = self.is_engaged() && !self.probing.is_active() && self.mode_controller.is_held();
        let inside = self.geared.threads.armed().filter(|thread| is_held && status.at_rest && thread.is_held());
        let Some(thread) = inside.or(self.thread_behind()) else { return Err(NOT_IN_THREAD) };
        self.geared.awaits_freed = false;
        let turns = status.spindle.speed.is_some_and(|speed| speed.unsigned_abs() >= RESTING_SPEED);
        if status.outputs[usize::from(channel::SPINDLE)] != 0 || turns {
            return Err(SPINDLE_TURNS);
        }
        if inside.is_none() {
            self.open_end(&thread)?;
        } else if thread.first.is_before(self.streamer.oldest()) {
            return Err(NOT_RETAINED);
        }
        if !self.is_armed(&thread) {
            self.arm_thread(&thread, true).map_err(|_| NOT_FREED)?;
        }
        self.card.send(HostCommand::FreeTool).map_err(|_| NOT_FREED)?;
        (self.geared.awaits_freed, self.geared.follows) = (true, None);
        self.mode_controller.apply(ModeCommand::Reverse(Rate::ONE))?;
        self.mode_controller.apply(ModeCommand::Hold)?;
        Ok(())
    }

    /// Checks a command where the tool is free of a thread, or the card has not reported it yet.
    fn check_freed(&self, command: OperatorCommand) -> Result<(), CommandError> {
        let is_freed = self.card.status().spindle.gear == GearState::Freed;
        let goes_on = matches!(
            command,
            OperatorCommand::Forward(_)
                | OperatorCommand::Leave { .. }
                | OperatorCommand::Resume
                | OperatorCommand::CycleStart
                | OperatorCommand::Recover
                | OperatorCommand::CutFromHere(_)
                | OperatorCommand::CutAll
                | OperatorCommand::CutAsk
                | OperatorCommand::SkipContour
                | OperatorCommand::Pause
                | OperatorCommand::Park
                | OperatorCommand::Pointer
        );
        let moves = goes_on || matches!(command, OperatorCommand::Reverse(_) | OperatorCommand::Wheel { .. });
        let reached = self.card.status().reached;
        match self.geared.threads.armed() {
            _ if self.geared.awaits_freed && !is_freed && moves => Err(NOT_FREED),
            Some(thread) if is_freed && goes_on && reached.is_before(thread.end()) => Err(THREAD_NOT_CUT),
            _ => Ok(()),
        }
    }

    /// Opens the thread that reverse run rests behind, where the operator reverses again: the card turns its spindle
    /// the other way.
    fn open_thread(&mut self, command: OperatorCommand) -> Result<(), CommandError> {
        let Some(thread) = self.thread_behind().filter(|_| matches!(command, OperatorCommand::Reverse(_))) else {
            return Ok(());
        };
        if !thread.is_reversible() {
            return Err(NOT_REVERSIBLE);
        }
        self.open_end(&thread)
    }

    /// Opens the end of the thread at which reverse run rests, if all of the thread is retained.
    fn open_end(&mut self, thread: &EnteredThread) -> Result<(), CommandError> {
        if !self.streamer.open_barrier() {
            return Err(NOT_RETAINED);
        }
        if thread.first.is_before(self.streamer.oldest()) {
            self.streamer.close_barrier();
            return Err(NOT_RETAINED);
        }
        Ok(())
    }

    /// The thread behind whose end reverse run rests.
    pub(super) fn thread_behind(&self) -> Option<EnteredThread> {
        let status = self.card.status();
        let is_reversed = self.mode_controller.mode() == Mode::Reverse && self.streamer.barrier().is_some();
        let rests = |thread: &EnteredThread| status.at_rest && self.streamer.oldest() == thread.end();
        self.geared.threads.ending_at(status.place).filter(|thread| is_reversed && thread.is_held() && rests(thread))
    }

    /// Closes the threads that were opened, where the motion path is behind them again and is not reversed.
    pub(super) fn close_passed_threads(&mut self) {
        let CardStatus { place, spindle, .. } = *self.card.status();
        let is_free = spindle.gear != GearState::Freed && !self.is_engaged();
        if is_free && self.mode_controller.mode() != Mode::Reverse {
            self.streamer.close_barriers_until(place.record);
        }
    }

    fn apply_command_in_tap(&mut self, command: OperatorCommand) -> Option<Result<(), CommandError>> {
        match command {
            OperatorCommand::Reverse(_) => Some(self.reverse_tap()),
            // A resumed job runs on by itself behind its tap.
            OperatorCommand::Leave { .. } if self.probing.is_resumed_tap() => Some(Ok(())),
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
        self.geared.awaits_freed &= gear != GearState::Freed;
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
        let place = self.card.status().place;
        let is_before = |thread: EnteredThread| place.distance_to(Place::start_of(thread.first)) >= Distance::ZERO;
        let is_tapping = is_engaged && self.probing.is_active();
        // A tap that has turned is complete: no gear waits then.
        let was_tapping = std::mem::replace(&mut self.geared.is_tapping, is_tapping);
        let is_left_backward =
            gear == GearState::Waiting && (was_tapping || self.geared.was_engaged.is_some_and(is_before));
        self.geared.was_engaged = self.geared.threads.armed().filter(|_| is_engaged && !is_tapping);
        self.watch_arming();
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
        let waits_here = self.geared.threads.begins_at(place);
        match spindle.gear {
            GearState::Engaged => Rate::ZERO,
            GearState::Waiting if waits_here => self.wheel.rate().min(Rate::ZERO),
            GearState::Waiting | GearState::Off | GearState::Freed => self.wheel.rate(),
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
