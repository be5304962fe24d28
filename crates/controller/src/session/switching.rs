//! Exclusive instructions, one after the other, where the motion has come to their place (GMC-4 … GMC-6).
//!
//! Invariant: an instruction goes to the card in normal run only, with the cursor at rest on its marker; the next one when the
//! card has reported it complete.

use retrace_core::mode::{Mode, ModeCommand, ModeOutput};
use retrace_link::{HostCommand, Instruction, MotionCard, OutputChange, channel};

use super::Session;
use crate::event::{CardError, EventKind};
use crate::plan_item::ExclusiveKind;

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// The instruction whose place the motion has come to, if there is one and it may be executed now (GMC-5). False where there is
    /// nothing to do, and where the rate is to be zero: the card would keep it until there is one.
    pub(super) fn switch_what_is_due(&mut self, demand: ModeOutput) -> Result<bool, CardError> {
        let stands = self.operation.is_held() || self.restart.is_active();
        if self.operation.mode() != Mode::Run || stands || demand.target.faster() <= 0 {
            return Ok(false);
        }
        let Some(exclusive) = self.supply.due(self.card.status()) else { return Ok(false) };
        let (kind, code, line) = (exclusive.kind, exclusive.code, exclusive.line);
        let stops = match kind {
            ExclusiveKind::ProgramStop | ExclusiveKind::ToolChange => true,
            ExclusiveKind::OptionalStop => self.optional_stop,
            ExclusiveKind::Switch | ExclusiveKind::Dwell => false,
        };
        if stops && !self.go_on && self.manner.operator {
            if !self.program_stop {
                self.program_stop = true;
                let tool = exclusive.changes.iter().find(|change| change.channel == channel::TOOL);
                let happening = match (kind, tool) {
                    (ExclusiveKind::ToolChange, Some(change)) => EventKind::ToolChange(change.value),
                    _ => EventKind::ProgramStop(code),
                };
                self.tell_at(line, happening);
            }
            return Ok(false);
        }
        let (changes, count, periods) = (exclusive.changes, exclusive.count, exclusive.periods);
        let (number, place, until) = (self.supply.number(), exclusive.place, exclusive.until);
        let fires = |change: &OutputChange| self.cutting.contains(&change.channel);
        let keeps_cutter = kind == ExclusiveKind::Dwell || changes[..usize::from(count)].iter().any(fires);
        let instruction = Instruction { number, place, changes, count, periods, until, keeps_cutter };
        // First the rate: where that is zero still, the card would keep the instruction for a period.
        self.set_rate(demand);
        self.card.send(HostCommand::Instruction(instruction)).map_err(|refusal| CardError::Fault {
            number: "E3001",
            cause: format!("the card did not take {code}: {refusal:?}"),
            remedy: "the machine stands where the card says; check the card, then resume".into(),
        })?;
        (self.program_stop, self.go_on) = (false, false);
        self.supply.sent();
        self.executing = Some(kind);
        self.tally.switch_events += u64::from(kind == ExclusiveKind::Switch);
        self.tell_at(line, EventKind::Switching(code));
        self.acknowledge();
        Ok(true)
    }

    pub(super) fn acknowledge(&mut self) {
        if let Some(done) = self.supply.acknowledge(self.card.status().executed) {
            self.executing = None;
            self.tell_at(done.line, EventKind::Switched(done.code));
            let want = self.supply.expected();
            let are = self.outputs_compared_with(want);
            let differs = |change: &OutputChange| are[usize::from(change.channel)] != want[usize::from(change.channel)];
            let switched_by_hand = done.changes[..usize::from(done.count)].iter().any(differs);
            if switched_by_hand && self.operation.mode() == Mode::Run && !self.operation.is_held() {
                // While it was carried out somebody has switched it back: motion does not begin without a question.
                let _ = self.operation.apply(ModeCommand::Restart { confirmed: false });
            }
        }
    }
}
