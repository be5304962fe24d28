//! Execution of exclusive instructions, one after the other, where the motion has reached their place (GMC-4 … GMC-6).
//!
//! Invariant: an instruction goes to the card in normal run only, with the cursor at rest on its marker; the next one
//! when the card has reported it complete.

use retrace_core::Rate;
use retrace_core::mode::{Mode, ModeCommand, ModeOutput};
use retrace_link::{
    CardStatus, CommandRefusal, HostCommand, Instruction, LayerMove, MotionCard, OutputChange, SpindleTask, channel,
};

use super::probing::OffPathMove;
use super::{ProgramStop, Session};
use crate::event::{CardError, EventKind};
use crate::plan_item::ExclusiveKind;
use crate::question::Question;

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Sends the instruction whose place the motion has reached, if it may be executed now (GMC-5). Returns false where
    /// there is nothing to do, and where the rate is to be zero: the card would keep the instruction until there is a
    /// rate.
    pub(super) fn send_due_instruction(&mut self, demand: ModeOutput) -> Result<bool, CardError> {
        let stands = self.mode_controller.is_held() || self.restart.is_active();
        if self.mode_controller.mode() != Mode::Run || stands || demand.target.faster() <= Rate::ZERO {
            return Ok(false);
        }
        let Some(exclusive) = self.streamer.due_instruction(self.card.status()) else { return Ok(false) };
        let (kind, code, line) = (exclusive.kind, exclusive.code, exclusive.line);
        let stops = match kind {
            ExclusiveKind::ProgramStop | ExclusiveKind::ToolChange => true,
            ExclusiveKind::OptionalStop => self.optional_stop,
            ExclusiveKind::Switch
            | ExclusiveKind::Dwell
            | ExclusiveKind::OffPath
            | ExclusiveKind::Input
            | ExclusiveKind::FeedOverride { .. } => false,
        };
        let (place, question) = (exclusive.place, exclusive.question.as_deref().copied());
        match question {
            Some(Question::Probe(question)) => {
                self.begin_off_path(OffPathMove::Probe(question), place, line)?;
                return Ok(false);
            }
            Some(Question::Tap(question)) => {
                self.begin_off_path(OffPathMove::Tap(question), place, line)?;
                return Ok(false);
            }
            Some(Question::Input(question)) if !self.has_read_input(question, place, line)? => return Ok(false),
            _ => {}
        }
        let Some(exclusive) = self.streamer.due_instruction(self.card.status()) else { return Ok(false) };
        if stops && self.program_stop != ProgramStop::Continued && self.config.run_mode.operator {
            if self.program_stop == ProgramStop::No {
                self.program_stop = ProgramStop::Waiting;
                let tool = exclusive.changes.iter().find(|change| change.channel == channel::TOOL);
                let kind = match (kind, tool) {
                    (ExclusiveKind::ToolChange, Some(change)) => EventKind::ToolChange(change.value),
                    _ => EventKind::ProgramStop(code),
                };
                self.emit_at(line, kind);
            }
            return Ok(false);
        }
        let ends_step = self.single_block && self.step_begin != exclusive.place;
        if ends_step && self.streamer.begins_contour(exclusive) {
            // The step ends before the cutter is lit, also where the motion behind is not planned yet.
            self.single_stop = true;
            self.emit(EventKind::SingleBlock);
            return Ok(false);
        }
        let (mut changes, count, mut periods) = (exclusive.changes, exclusive.count, exclusive.periods);
        let (number, place, mut until) = (self.streamer.instruction_number(), exclusive.place, exclusive.until);
        let (mut layer, spindle) = (exclusive.layer, exclusive.spindle);
        let switches_cutter = self.streamer.switches_cutter(&changes[..usize::from(count)]);
        let keeps_cutter = kind == ExclusiveKind::Dwell || switches_cutter || layer.is_some();
        if self.cuts_rest_before(place, &changes[..usize::from(count)]) {
            return Ok(false);
        }
        if self.lights_dark(place, &mut changes[..usize::from(count)]) {
            (periods, until, layer) = (0, None, self.dark_move(layer));
        } else if self.contour_pass.is_dark && count == 0 && layer.is_some() {
            // The heights behind a start that lit nothing.
            (periods, layer) = (0, self.dark_move(layer));
        }
        if self.lifts_before_start(layer) {
            return Ok(false);
        }
        if switches_cutter {
            self.streamer.mark_dark(place, self.contour_pass.is_dark);
        }
        self.scale_speed(&mut changes[..usize::from(count)]);
        let instruction = Instruction { number, place, changes, count, periods, until, keeps_cutter, layer, spindle };
        // The rate comes first: while it is still zero, the card would keep the instruction for a period.
        self.set_rate(demand);
        match self.card.send(HostCommand::Instruction(instruction)) {
            Ok(()) => {}
            // What waits on the line leaves no room where the computer was late: it is sent in a later period. The card
            // waits at its place.
            Err(CommandRefusal::Full) => return Ok(false),
            Err(refusal) => {
                return Err(CardError::Fault {
                    number: "E3001",
                    cause: format!("the card rejected {code}: {refusal:?}"),
                    remedy: "the machine is at the position that the card reports; check the card, then resume".into(),
                });
            }
        }
        if let Some(SpindleTask::Gear(start)) = &spindle {
            self.enter_thread(place, *start, line);
        }
        self.program_stop = ProgramStop::No;
        self.streamer.mark_sent();
        self.executing = Some(kind);
        if kind == ExclusiveKind::Dwell {
            self.stats.begin_dwell(periods);
        }
        self.stats.switch_events += u64::from(kind == ExclusiveKind::Switch);
        if !matches!(kind, ExclusiveKind::Input | ExclusiveKind::FeedOverride { .. }) {
            self.emit_at(line, EventKind::Switching(code));
        }
        if let ExclusiveKind::FeedOverride { .. } = kind {
            // The rate of this period is that before the switch: nothing may be sent behind it yet.
            return Ok(false);
        }
        self.acknowledge_instruction();
        Ok(true)
    }

    /// Whether an instruction is not being executed any more: the blocked card keeps it, a hold has stopped the tool on
    /// its way to the height of a start, or the job ends in a dwell, which is executed whole when it is resumed.
    pub(super) fn rests_in_instruction(&self, status: &CardStatus<A>) -> bool {
        let is_lit = |&channel: &u8| status.outputs[usize::from(channel)] != 0;
        let senses = self.recovery.machine().tool_layer().is_some() && !self.config.fire_channels.iter().any(is_lit);
        let ends_in_dwell = self.phase.is_stopping() && self.executing == Some(ExclusiveKind::Dwell);
        status.blocked || ends_in_dwell || self.mode_controller.is_held() && status.at_rest && senses
    }

    /// Moves of the layer of a start that lights nothing: the contour is passed at the safe height.
    fn dark_move(&self, layer: Option<LayerMove>) -> Option<LayerMove> {
        let machine = self.recovery.machine();
        let of = layer.and_then(|_| machine.tool_layer())?;
        Some(of.lift(machine.axes[of.index].mm_of(self.card.status().counts[of.index])))
    }

    pub(super) fn acknowledge_instruction(&mut self) {
        if let Some(done) = self.streamer.acknowledge(self.card.status().executed) {
            self.executing = None;
            if !matches!(done.kind, ExclusiveKind::FeedOverride { .. }) {
                self.emit_at(done.line, EventKind::Switched(done.code));
            }
            self.record_layer_move(done.layer, &done.changes[..usize::from(done.count)]);
            if let Some(kerf_um) = done.kerf_um {
                self.cut_map.kerfs.begin_contour(kerf_um);
            }
            self.map_switching(done.place, done.line, &done.changes[..usize::from(done.count)]);
            let want = self.streamer.expected();
            let are = self.outputs_compared_with(want);
            let differs = |change: &OutputChange| are[usize::from(change.channel)] != want[usize::from(change.channel)];
            let switched_by_hand = done.changes[..usize::from(done.count)].iter().any(differs);
            if switched_by_hand && self.mode_controller.mode() == Mode::Run && !self.mode_controller.is_held() {
                // While the instruction was executed, an operator has switched it back: motion does not begin without a
                // confirmation.
                let _ = self.mode_controller.apply(ModeCommand::Restart { confirmed: false });
            }
        }
    }
}
