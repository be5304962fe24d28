//! The test pulse of a cutter (CUT-9): on at rest for a short time, to check the source, the gas or the water.
//!
//! Invariant: while a pulse is on nothing else is requested of the card but its end; the card switches it off by itself
//! after the time of the machine file.

use retrace_core::RateTarget;
use retrace_link::{CardStatus, HostCommand, MAX_CHANGES, MotionCard, OutputChange, RepeatedInstruction};

use super::{ProgramStop, Session};
use crate::operator::{CommandError, OperatorCommand};

/// A test pulse that the card has not reported as complete.
#[derive(Clone, Copy, Debug)]
pub(super) struct TestPulse {
    channel: u8,
    /// Number of its repeated instruction.
    number: u32,
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// *Test pulse*: switches the first cutter of the machine on for its `pulse_s`.
    pub(super) fn test_pulse(&mut self) -> Result<(), CommandError> {
        let (Some(&channel), Some(&periods)) = (self.config.fire_channels.first(), self.config.pulse_periods.first())
        else {
            return Err(CommandError::NotNow("the machine has no torch, jet or beam"));
        };
        self.require_test_pulse_permitted()?;
        let number = self.card.status().repeated.wrapping_add(1);
        if self.card.send(pulse_command(number, channel, periods)).is_err() {
            return Err(CommandError::NoOutput(channel));
        }
        self.test_pulse = Some(TestPulse { channel, number });
        Ok(())
    }

    /// Checks that the machine is at rest and nothing else is in progress; otherwise `why` is the reason.
    pub(super) fn require_rest_for_test(&self, why: &'static str) -> Result<(), CommandError> {
        let waits = self.program_stop != ProgramStop::No || self.single_stop || self.dnc.is_on();
        let rests = self.card.status().at_rest && (waits || self.target == Some(RateTarget::ZERO));
        let is_busy = self.executing.is_some() || self.restart.is_active() || self.is_lifting();
        if !rests || is_busy { Err(CommandError::NotNow(why)) } else { Ok(()) }
    }

    fn require_test_pulse_permitted(&self) -> Result<(), CommandError> {
        let status = self.card.status();
        let refuse = |why| Err(CommandError::NotNow(why));
        if self.config.inhibits_outputs {
            return refuse("this is a dry run: the cutter stays off");
        }
        self.require_rest_for_test("a test pulse needs the machine at rest, with the program held or paused")?;
        if status.inputs & self.config.collision_inputs != 0 {
            return refuse("a collision input of the cutter is active");
        }
        Ok(())
    }

    /// Ends the pulse, where one is on, before a command that stops; refuses every other one until it has ended.
    pub(super) fn end_test_pulse_by(&mut self, command: OperatorCommand) -> Result<(), CommandError> {
        let Some(TestPulse { channel, .. }) = self.test_pulse else { return Ok(()) };
        match command {
            OperatorCommand::CutterOff | OperatorCommand::Hold | OperatorCommand::Stop => {
                // never refused
                let _ = self.card.send(HostCommand::ManualOutput(OutputChange { channel, value: 0 }));
                Ok(())
            }
            _ => Err(CommandError::NotNow("a test pulse is on: wait for its end")),
        }
    }

    /// Whether the cutter of this channel is on for a test.
    pub(super) fn is_test_pulse(&self, channel: u8) -> bool {
        self.test_pulse.is_some_and(|pulse| pulse.channel == channel)
    }

    /// Notes the end of the pulse.
    pub(super) fn watch_test_pulse(&mut self, status: &CardStatus<A>) {
        let is_over = |pulse: TestPulse| status.repeated == pulse.number || status.alarm.is_some();
        self.test_pulse = self.test_pulse.filter(|&pulse| !is_over(pulse));
    }
}

/// The command that switches this channel on for so many control periods.
pub(crate) fn pulse_command<const A: usize>(number: u32, channel: u8, periods: u32) -> HostCommand<A> {
    let mut changes = [OutputChange::default(); MAX_CHANGES];
    changes[0] = OutputChange { channel, value: 1 };
    let rest = RepeatedInstruction::default();
    HostCommand::Repeat(RepeatedInstruction { number, changes, count: 1, periods, is_pulse: true, ..rest })
}
