//! Execution of operator commands.
//!
//! Invariant: a command that does not apply changes nothing and is answered with the reason.

use retrace_core::mode::{Mode, ModeCommand, ModeController, ModeState};
use retrace_core::{Place, Rate};
use retrace_link::{MotionCard, OutputChange, channel};

use super::back_target::BackTargetKind;
use super::restart::LeavingRun;
use super::{ProgramStop, Session};
use crate::cutter_off_reason::CutterOffReason;
use crate::cutter_state::CutterState;
use crate::event::EventKind;
use crate::operator::{CommandError, CutStart, OperatorCommand};

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    pub(super) fn apply_commands(&mut self) {
        let (period, line) = (self.card.status().period, self.card.status().line);
        while let Some(command) = self.commands.next_command(period, line) {
            self.emit(EventKind::Operator(command));
            // An operator is present.
            self.still_periods = 0;
            let mode = self.mode_controller.mode();
            if let Err(why) = self.apply_command(command) {
                self.emit(EventKind::CommandRejected(why));
            }
            if self.mode_controller.mode() != mode {
                if mode == Mode::Run {
                    self.leaving_run = LeavingRun::Braking;
                    self.cancel_cutter_start(CutterOffReason::Retrace);
                }
                self.emit_mode();
            }
        }
        // handwheel counts of the script, the screen, and a wheel wired to the card
        let counts = self.commands.wheel_counts(period).saturating_add(self.card.status().wheel);
        self.wheel.push_difference(counts);
    }

    fn apply_command(&mut self, command: OperatorCommand) -> Result<(), CommandError> {
        if matches!(command, OperatorCommand::Contours | OperatorCommand::ConsumablesChanged) {
            // The observers do it.
            return Ok(());
        }
        if let Some(taken) = self.apply_command_in_gear(command) {
            return taken;
        }
        self.end_test_pulse_by(command)?;
        self.end_sense_test_by(command)?;
        if !matches!(command, OperatorCommand::CutFromHere(_) | OperatorCommand::CutAll | OperatorCommand::CutAsk) {
            // A refused *cut* is confirmed by the very next word only.
            self.recovery.refused_at = None;
        }
        if retraces(&command) {
            self.require_path()?;
        }
        if let Some(taken) = self.apply_command_in_pause(command) {
            return taken;
        }
        match command {
            OperatorCommand::Resume | OperatorCommand::CycleStart => return self.cycle_start(),
            // Handled above.
            OperatorCommand::Pause
            | OperatorCommand::SpindleStop
            | OperatorCommand::SpindleStart
            | OperatorCommand::Jog { .. }
            | OperatorCommand::ToolLength(_)
            | OperatorCommand::Park
            | OperatorCommand::Pointer
            | OperatorCommand::ChangeDone
            | OperatorCommand::Online => {}
            OperatorCommand::BackBy(mm) => return self.go_back(BackTargetKind::By(mm)),
            OperatorCommand::BackToBlock => return self.go_back(BackTargetKind::Block),
            OperatorCommand::BackToPierce => return self.go_back(BackTargetKind::Pierce),
            OperatorCommand::BackToCutEnd => return self.back_to_cut_end(),
            OperatorCommand::BackToContour(number) => return self.back_to_contour(number),
            OperatorCommand::CutFromHere(start) => return self.cut_from_here(start, false),
            OperatorCommand::CutAll => return self.cut_from_here(CutStart::Usual, true),
            OperatorCommand::CutAsk => {
                self.cut_from_here(CutStart::Usual, false)?;
                self.recovery.asks = true;
            }
            OperatorCommand::Shift(by) => return self.shift(by),
            OperatorCommand::Lead(shape) => self.set_lead(shape),
            OperatorCommand::Override(rate) => return self.request_override(rate),
            OperatorCommand::RapidOverride(rate) => self.set_rapid_override(rate)?,
            OperatorCommand::SpeedOverride(rate) => return self.set_speed_override(rate),
            OperatorCommand::Output { number, on } => return self.switch_output(number, on),
            OperatorCommand::CutterOff => self.cutter_off(),
            OperatorCommand::CutterOn => return self.cutter_on(),
            OperatorCommand::TestPulse => return self.test_pulse(),
            OperatorCommand::SenseTest => return self.sense_test(),
            OperatorCommand::OptionalStop(on) => self.optional_stop = on,
            OperatorCommand::Height(command) => return self.change_height(command),
            OperatorCommand::Recover => return self.recover(),
            OperatorCommand::SkipContour => return self.skip_contour(),
            OperatorCommand::SkipContourAhead { number, on } => return self.skip_contour_ahead(number, on),
            // Handled above.
            OperatorCommand::Contours
            | OperatorCommand::ConsumablesChanged
            | OperatorCommand::FollowSpindle(_)
            | OperatorCommand::ToolFree => {}
            OperatorCommand::Single => self.toggle_single_block(),
            OperatorCommand::Hold => {
                if self.restart.is_active() && self.cutter_states.contains(&CutterState::Sensing) {
                    // What the hold stops is the tool axis: the card ends a start that is cancelled.
                    self.cutter_off();
                }
                if self.is_due_here() {
                    self.recovery.cancel_return();
                }
                self.mode_controller.apply(ModeCommand::Hold)?;
            }
            OperatorCommand::Confirm => self.mode_controller.apply(ModeCommand::Confirm)?,
            OperatorCommand::Stop => {
                self.phase.stop();
                self.recovery.cancel_return();
                self.mode_controller.apply(ModeCommand::Hold)?;
                self.cancel_restart();
                self.cancel_cutter_start(CutterOffReason::JobStopped);
            }
            OperatorCommand::Wheel { .. }
                if self.mode_controller.mode() == Mode::Wheel && !self.mode_controller.is_held() => {}
            OperatorCommand::Wheel { .. } => {
                self.wheel.reset();
                self.retrace(ModeCommand::Wheel)?;
            }
            OperatorCommand::Reverse(rate) => self.retrace(ModeCommand::Reverse(rate))?,
            OperatorCommand::Forward(rate) => self.retrace(ModeCommand::Forward(rate))?,
            OperatorCommand::Leave { ask } => self.retrace(ModeCommand::Leave { ask })?,
        }
        Ok(())
    }

    /// Applies a command that changes how the path is retraced. A reverse run to a target ends.
    pub(super) fn retrace(&mut self, order: ModeCommand) -> Result<(), CommandError> {
        // Reversing again from where the cutter was switched confirms that the boundary may be passed.
        let boundary = self.cutter_boundary();
        let status = self.card.status();
        let stands_there = status.at_rest && boundary.is_some_and(|boundary| status.place == Place::start_of(boundary));
        self.mode_controller.apply(order)?;
        self.asked_boundary = None;
        self.recovery.cancel_return();
        if stands_there {
            self.passed_boundary = boundary;
        }
        self.back_target = None;
        if !matches!(order, ModeCommand::Leave { .. } | ModeCommand::Forward(_)) {
            self.cancel_restart();
        }
        Ok(())
    }

    /// Switches an output manually. An output of a cutter is switched as by *cutter off* and *cutter on*.
    fn switch_output(&mut self, number: u8, on: bool) -> Result<(), CommandError> {
        if self.config.fire_channels.contains(&number) {
            return if on {
                self.cutter_on()
            } else {
                self.cutter_off();
                Ok(())
            };
        }
        if number == channel::SPINDLE && on {
            let why = "the spindle is started by M3, or by `spindle start` in a pause";
            return Err(CommandError::NotNow(why));
        }
        let change = OutputChange { channel: number, value: i32::from(on) };
        if !self.send_manual_output(change) {
            return Err(CommandError::NoOutput(number));
        }
        if number == channel::SPINDLE && self.streamer.expected()[usize::from(channel::SPINDLE)] != 0 {
            // No feed into the work with a tool that does not turn.
            self.hold_program();
        }
        Ok(())
    }

    /// *Cutter off*: always, and immediately. A program in normal run is held: the path from here on would not be cut,
    /// or the next M3 would light what was just switched off.
    fn cutter_off(&mut self) {
        let expected = self.streamer.expected();
        let cuts =
            self.config.fire_channels.iter().any(|&c| expected.get(usize::from(c)).is_some_and(|&value| value != 0));
        if cuts && !self.restart.is_active() && self.executing.is_none() {
            for at in 0..self.config.fire_channels.len() {
                self.record_cut_end_by_hand(self.config.fire_channels[at]);
            }
        }
        self.switch_cutters_off(CutterOffReason::Operator);
        self.cancel_restart();
        // Nor is the cutter lit at the end of a way that goes on: there the operator is asked.
        self.recovery.cancel_return();
        let state = self.mode_controller.state();
        self.mode_controller = ModeController::with_state(ModeState { confirmed: false, ..state });
        self.hold_program();
    }

    /// Cancels the start of a cutter that the program does not go on to use.
    fn cancel_cutter_start(&mut self, reason: CutterOffReason) {
        if self.is_starting_cutter() {
            self.switch_cutters_off(reason);
        }
    }

    /// Holds the program. Returns false where no program is being executed.
    fn hold_program(&mut self) -> bool {
        let is_executed = self.mode_controller.mode() == Mode::Run && !self.dnc.is_on();
        if is_executed {
            // never rejected
            let _ = self.mode_controller.apply(ModeCommand::Hold);
        }
        is_executed
    }

    /// *Cutter on*: executes again the instructions that light the cutter, where the machine retraces and may cut. It
    /// goes out again where the machine does not move (CUT-9).
    fn cutter_on(&mut self) -> Result<(), CommandError> {
        if self.config.inhibits_outputs {
            return Err(CommandError::NotNow("this is a dry run: the cutter stays off"));
        }
        match self.mode_controller.mode() {
            Mode::Run => {
                let why = "the cutter is started with the motion: `recover` starts it and resumes";
                return Err(CommandError::NotNow(why));
            }
            _ if !self.config.retrace_cuts => {
                let why = "only a cutter whose [[cutter]] has retrace_cut = true can cut while the path is retraced";
                return Err(CommandError::NotNow(why));
            }
            _ => {}
        }
        if self.restart.is_active() || self.is_lifting() {
            return Err(CommandError::NotNow("outputs are being restored, or the tool is being lifted"));
        }
        let channel = self.streamer.last_fired_channel().ok_or(CommandError::NoPierce)?;
        self.emit(EventKind::CutterOn(channel));
        if !self.card.status().at_rest {
            // a jet may be opened while the machine moves; a beam follows the speed as the program has it
            let value = match self.streamer.expected()[usize::from(channel)] {
                0 => 1,
                value => value,
            };
            let change = OutputChange { channel, value };
            return if self.send_manual_output(change) { Ok(()) } else { Err(CommandError::NoOutput(channel)) };
        }
        self.restart_cutter(channel);
        Ok(())
    }

    /// *Recover*: continues an interrupted cut. Where there is none, restores the outputs, the cutter last, and resumes
    /// the program; from a place behind, once the machine is back at the furthest one.
    fn recover(&mut self) -> Result<(), CommandError> {
        if self.begin_recovery()? {
            return Ok(());
        }
        self.decide_on_kerf();
        let is_behind =
            matches!(self.mode_controller.mode(), Mode::Rejoin | Mode::Reverse | Mode::Forward | Mode::Wheel);
        self.mode_controller.apply(if is_behind { ModeCommand::Leave { ask: false } } else { ModeCommand::Recover })?;
        self.continue_from_stop();
        Ok(())
    }

    /// Continues from a program stop or the end of a block.
    fn continue_from_stop(&mut self) {
        if self.program_stop != ProgramStop::No {
            self.program_stop = ProgramStop::Continued;
        } else if self.single_stop {
            self.next_block();
        }
    }

    /// *Cycle start*: at a program stop, at the end of a block, after a hold.
    fn cycle_start(&mut self) -> Result<(), CommandError> {
        let stands = self.program_stop != ProgramStop::No || self.single_stop;
        if self.mode_controller.is_held() || !stands {
            self.mode_controller.apply(ModeCommand::Resume)?;
        } else {
            self.mode_controller.apply(ModeCommand::Restart { confirmed: false })?;
        }
        self.continue_from_stop();
        Ok(())
    }

    fn request_override(&mut self, rate: Rate) -> Result<(), CommandError> {
        let stood = self.override_applies() && self.mode_controller.override_rate() == Rate::ZERO;
        let most = self.overrides.max_override();
        let reached = self.dnc.reached().unwrap_or(self.card.status().reached);
        self.overrides.request(rate, reached).map_err(|_| CommandError::TooManyOverrides)?;
        self.apply_rate_override();
        if stood && rate > Rate::ZERO && !self.mode_controller.is_held() {
            // a hold is resumed separately
            let _ = self.mode_controller.apply(ModeCommand::Restart { confirmed: false });
        }
        if rate > most { Err(CommandError::AboveMaxOverride(most)) } else { Ok(()) }
    }

    /// Sets the rapid override, 0 … 100 %. Where it held rapid motion at rest, the outputs are compared before motion
    /// resumes.
    fn set_rapid_override(&mut self, rate: Rate) -> Result<(), CommandError> {
        let stood = self.override_applies()
            && self.mode_controller.rapid_override() == Rate::ZERO
            && self.card.status().at_rest;
        self.mode_controller.apply(ModeCommand::RapidOverride(rate))?;
        if stood && rate > Rate::ZERO && !self.mode_controller.is_held() && self.mode_controller.mode() == Mode::Run {
            let _ = self.mode_controller.apply(ModeCommand::Restart { confirmed: false });
        }
        if rate > Rate::ONE { Err(CommandError::AboveMaxOverride(Rate::ONE)) } else { Ok(()) }
    }

    /// Applies the part of the override that is executed by the rate.
    pub(super) fn apply_rate_override(&mut self) {
        // Never rejected.
        let _ = self.mode_controller.apply(ModeCommand::Override(self.overrides.rate()));
    }

    fn toggle_single_block(&mut self) {
        self.single_block = !self.single_block;
        if self.single_block {
            self.next_block();
        } else {
            self.streamer.clear_block_end();
        }
    }

    pub(super) fn next_block(&mut self) {
        self.single_stop = false;
        if self.single_block {
            // beyond what was executed already: retracing is not divided into blocks
            let after = self.card.status().reached;
            self.step_begin = after;
            self.streamer.trim_at_block_end(&mut self.card, after);
        } else {
            self.streamer.clear_block_end();
        }
    }
}

/// Whether a command leaves the lead-in of a shifted restart.
fn retraces(command: &OperatorCommand) -> bool {
    matches!(
        command,
        OperatorCommand::Reverse(_)
            | OperatorCommand::Forward(_)
            | OperatorCommand::Wheel { .. }
            | OperatorCommand::Leave { .. }
            | OperatorCommand::BackBy(_)
            | OperatorCommand::BackToBlock
            | OperatorCommand::BackToPierce
            | OperatorCommand::BackToCutEnd
            | OperatorCommand::BackToContour(_)
            | OperatorCommand::CutterOn
            | OperatorCommand::Pause
            | OperatorCommand::Park
            | OperatorCommand::Pointer
            | OperatorCommand::Single
    )
}
