//! The operator's words, as the session takes them.
//!
//! Invariant: an order that does not apply changes nothing and is answered with the reason.

use retrace_core::mode::{Mode, ModeCommand};
use retrace_core::{ONE, Place, Travel};
use retrace_link::{MotionCard, OutputChange, channel};

use super::Session;
use super::back_target::BackTargetKind;
use super::restart::LeavingRun;
use crate::event::{CutterOffReason, EventKind};
use crate::operator::{CommandError, OperatorCommand};

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    pub(super) fn take_orders(&mut self) {
        let (period, line) = (self.card.status().period, self.card.status().line);
        while let Some(deed) = self.operators.next_word(period, line) {
            self.tell(EventKind::Operator(deed));
            // Somebody is there.
            self.still_periods = 0;
            let mode = self.operation.mode();
            if let Err(why) = self.order(deed) {
                self.tell(EventKind::CommandRejected(why));
            }
            if self.operation.mode() != mode {
                if mode == Mode::Run {
                    self.leaving_run = LeavingRun::Braking;
                }
                self.tell_mode();
            }
        }
        // the script's wheel, the screen's, and one that is wired to the card
        let counts = self.operators.wheel_counts(period).saturating_add(self.card.status().wheel);
        self.wheel.push_difference(counts);
    }

    fn order(&mut self, deed: OperatorCommand) -> Result<(), CommandError> {
        if let Some(taken) = self.order_interrupted(deed) {
            return taken;
        }
        match deed {
            OperatorCommand::Resume | OperatorCommand::CycleStart => return self.cycle_start(),
            // Taken above.
            OperatorCommand::Pause
            | OperatorCommand::SpindleStop
            | OperatorCommand::SpindleStart
            | OperatorCommand::Jog { .. }
            | OperatorCommand::ToolLength(_)
            | OperatorCommand::Online => {}
            OperatorCommand::BackBy(mm) => return self.go_back(BackTargetKind::By(mm)),
            OperatorCommand::BackToBlock => return self.go_back(BackTargetKind::Block),
            OperatorCommand::BackToPierce => return self.go_back(BackTargetKind::Pierce),
            OperatorCommand::Override(rate) => return self.ask_override(rate),
            OperatorCommand::RapidOverride(rate) => self.set_rapid_override(rate)?,
            OperatorCommand::Output { number, on } => return self.switch_output(number, on),
            OperatorCommand::CutterOff => self.cutter_off(),
            OperatorCommand::CutterOn => return self.cutter_on(),
            OperatorCommand::OptionalStop(on) => self.optional_stop = on,
            OperatorCommand::Recover => return self.recover(),
            OperatorCommand::Single => self.switch_single(),
            OperatorCommand::Hold => self.operation.apply(ModeCommand::Hold)?,
            OperatorCommand::Confirm => self.operation.apply(ModeCommand::Confirm)?,
            OperatorCommand::Stop => {
                self.stopping = true;
                self.operation.apply(ModeCommand::Hold)?;
            }
            OperatorCommand::Wheel { .. } if self.operation.mode() == Mode::Wheel => {}
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

    /// A word that changes the way the path is retraced: whatever reverse run was to end somewhere ends.
    fn retrace(&mut self, order: ModeCommand) -> Result<(), CommandError> {
        // Whoever goes back again from where the cutter was switched agrees to pass it.
        let boundary = self.cutter_boundary();
        let status = self.card.status();
        let stands_there = status.at_rest && boundary.is_some_and(|boundary| status.place == Place::start_of(boundary));
        self.operation.apply(order)?;
        if stands_there {
            self.passed_boundary = boundary;
        }
        self.back = None;
        if !matches!(order, ModeCommand::Leave { .. } | ModeCommand::Forward(_)) {
            self.cancel_restart();
        }
        Ok(())
    }

    /// Switches an output by hand; a cutter's as by *cutter off* and *cutter on*.
    fn switch_output(&mut self, number: u8, on: bool) -> Result<(), CommandError> {
        if self.cutting.contains(&number) {
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
        if !self.send_by_hand(change) {
            return Err(CommandError::NoOutput(number));
        }
        if number == channel::SPINDLE && self.supply.expected()[usize::from(channel::SPINDLE)] != 0 {
            // No feed into the work with a tool that does not turn.
            self.hold_program();
        }
        Ok(())
    }

    /// *Cutter off*: always, and at once. A program that cuts is held, as what it cuts from here on would not be cut.
    fn cutter_off(&mut self) {
        self.cancel_restart();
        let expected = self.supply.expected();
        let cuts = self.cutting.iter().any(|&c| expected.get(usize::from(c)).is_some_and(|&value| value != 0));
        self.switch_cutters_off(CutterOffReason::Operator);
        if cuts && self.hold_program() {
            self.cutter_is_out = true;
        }
    }

    /// Holds the program, where it is being executed; false where it is not.
    fn hold_program(&mut self) -> bool {
        let is_executed = self.operation.mode() == Mode::Run && !self.dnc.is_on();
        if is_executed {
            // never refused
            let _ = self.operation.apply(ModeCommand::Hold);
        }
        is_executed
    }

    /// *Cutter on*: the instructions that light it are carried out again, where the machine retraces and may cut; it goes out again where
    /// the machine does not move (CUT-9).
    fn cutter_on(&mut self) -> Result<(), CommandError> {
        if self.inhibits_outputs {
            return Err(CommandError::NotNow("this is a dry run: the cutter stays off"));
        }
        match self.operation.mode() {
            Mode::Run => {
                let why = "the cutter is started with the motion: `recover` starts it and goes on";
                return Err(CommandError::NotNow(why));
            }
            _ if !self.retrace_cuts => {
                let why = "only a jet whose [[cutter]] says retrace_cut = true can cut while the path is retraced";
                return Err(CommandError::NotNow(why));
            }
            _ => {}
        }
        if self.restart.is_active() {
            return Err(CommandError::NotNow("outputs are being restored"));
        }
        let channel = self.supply.last_lit().ok_or(CommandError::NoPierce)?;
        self.tell(EventKind::CutterOn(channel));
        if !self.card.status().at_rest {
            // a jet may be opened in passing
            let change = OutputChange { channel, value: 1 };
            return if self.send_by_hand(change) { Ok(()) } else { Err(CommandError::NoOutput(channel)) };
        }
        self.light(channel);
        Ok(())
    }

    /// *Recover*: the outputs are restored, the cutter last, and the program goes on.
    fn recover(&mut self) -> Result<(), CommandError> {
        self.operation.apply(ModeCommand::Recover)?;
        self.go_on_from_stop();
        Ok(())
    }

    /// Whatever the program stands at is over.
    fn go_on_from_stop(&mut self) {
        if self.program_stop {
            self.go_on = true;
        } else if self.single_stop {
            self.next_block();
        }
    }

    /// *Cycle start*: at a program stop, at the end of a block, after a hold.
    fn cycle_start(&mut self) -> Result<(), CommandError> {
        let stands = self.program_stop || self.single_stop;
        if self.operation.is_held() || !stands {
            self.operation.apply(ModeCommand::Resume)?;
        } else {
            self.operation.apply(ModeCommand::Restart { confirmed: false })?;
        }
        self.go_on_from_stop();
        Ok(())
    }

    fn ask_override(&mut self, rate: Travel) -> Result<(), CommandError> {
        let (most, stood) = (self.overrides.most(), self.operation.override_rate() == 0);
        let reached = self.dnc.reached().unwrap_or(self.card.status().reached);
        self.overrides.request(rate, reached).map_err(|_| CommandError::TooManyOverrides)?;
        self.override_rate();
        if stood && rate > 0 && !self.operation.is_held() {
            // a hold has its own way on
            let _ = self.operation.apply(ModeCommand::Restart { confirmed: false });
        }
        if rate > most { Err(CommandError::AboveMaxOverride(most)) } else { Ok(()) }
    }

    /// Rapid override, 0 … 100 %. Where rapid motion stood by it, the outputs are compared before it goes on.
    fn set_rapid_override(&mut self, rate: Travel) -> Result<(), CommandError> {
        let stood = self.operation.rapid_override() == 0 && self.card.status().at_rest;
        self.operation.apply(ModeCommand::RapidOverride(rate))?;
        if stood && rate > 0 && !self.operation.is_held() && self.operation.mode() == Mode::Run {
            let _ = self.operation.apply(ModeCommand::Restart { confirmed: false });
        }
        if rate > ONE { Err(CommandError::AboveMaxOverride(ONE)) } else { Ok(()) }
    }

    /// Sets the part of the override that the rate does.
    pub(super) fn override_rate(&mut self) {
        // Never refused.
        let _ = self.operation.apply(ModeCommand::Override(self.overrides.rate()));
    }

    fn switch_single(&mut self) {
        self.single = !self.single;
        if self.single {
            self.next_block();
        } else {
            self.supply.open_block();
        }
    }

    pub(super) fn next_block(&mut self) {
        self.single_stop = false;
        if self.single {
            // beyond what was executed already: retracing is not cut into blocks
            let after = self.card.status().reached;
            self.supply.end_block(&mut self.card, after);
        } else {
            self.supply.open_block();
        }
    }
}
