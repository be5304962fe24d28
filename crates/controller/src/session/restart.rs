//! The restart of the outputs before motion resumes: the instructions that switched them are executed again, one after
//! the other, while the card blocks motion (CUT-17, DNC-9).
//!
//! Invariant: motion resumes only when the last instruction of a restart is reported complete. The card itself holds it
//! until then, so that no late report and no overtaking rate can start it.

use retrace_core::mode::Mode;
use retrace_link::{
    CardStatus, CutterOff, CutterOffCause, HostCommand, LayerMove, MotionCard, OutputChange, Outputs,
    RepeatedInstruction, channel,
};

use super::{ProgramStop, Session};
use crate::cutter_off_reason::CutterOffReason;
use crate::event::{CardError, EventKind};
use crate::plan_item::HEIGHT;
use crate::restart::{RestartStep, await_spindle};

/// Progress of a restart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum RestartStage {
    /// No restart is active.
    Idle,
    /// The card is to be requested to block motion.
    Asking,
    /// The request was sent, and the card has not reported it yet.
    Blocking,
    /// Motion is blocked; the instructions are being executed.
    Repeating,
    /// Cancelled; the card has not reported the end of the instruction that was sent last.
    Ending,
}

/// A restart of the outputs.
#[derive(Debug)]
pub(super) struct OutputRestart {
    stage: RestartStage,
    /// The instructions to execute, in this order.
    pub(super) steps: Vec<RestartStep>,
    /// The card's number of the repeat before the first one.
    before: u32,
    /// Number of steps that were sent.
    sent: usize,
    /// Number of steps that were reported complete.
    done: usize,
    /// Whether the tool was lifted off the sheet for the instruction that is due.
    has_lifted: bool,
}

impl OutputRestart {
    pub(super) fn new() -> Self {
        Self {
            stage: RestartStage::Idle,
            steps: Vec::with_capacity(channel::COUNT + 1),
            before: 0,
            sent: 0,
            done: 0,
            has_lifted: false,
        }
    }

    /// Whether a restart is active.
    pub(super) fn is_active(&self) -> bool {
        self.stage != RestartStage::Idle
    }

    /// Whether a rate may be sent. Not before the card is known to block motion, and not after that block is no use any
    /// more.
    pub(super) fn permits_rate(&self) -> bool {
        matches!(self.stage, RestartStage::Idle | RestartStage::Repeating)
    }

    /// Whether the restart was cancelled, and is not over yet.
    pub(super) fn is_ending(&self) -> bool {
        self.stage == RestartStage::Ending
    }

    /// Whether an instruction switches this channel on that is executed or still to be sent.
    pub(super) fn switches_on(&self, channel: u8) -> bool {
        let switches = |step: &RestartStep| step.changes().iter().any(|c| c.channel == channel && c.value != 0);
        self.is_active() && self.steps[self.done.min(self.steps.len())..].iter().any(switches)
    }

    /// Moves of the layer of the step that is executed or to be sent next.
    pub(super) fn layer(&self) -> Option<LayerMove> {
        if self.is_active() { self.steps.get(self.done)?.layer } else { None }
    }

    fn end(&mut self) {
        (self.stage, self.sent, self.done) = (RestartStage::Idle, 0, 0);
    }

    /// The card's number of the last repeat.
    fn last(&self) -> u32 {
        self.before.wrapping_add(self.steps.len() as u32)
    }
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Begins to restore the outputs that the program expects, of the channels selected by `concerned`. Does nothing
    /// where none differs.
    pub(super) fn begin_restart(&mut self, concerned: impl Fn(u8) -> bool) {
        let wants = self.wanted_outputs();
        self.begin_restart_to(&wants, concerned);
    }

    /// Begins to restore the outputs `wants`, of the channels selected by `concerned`.
    pub(super) fn begin_restart_to(&mut self, wants: &Outputs, concerned: impl Fn(u8) -> bool) {
        let outputs = self.outputs_compared_with(wants);
        self.streamer.restart_steps(&outputs, wants, concerned, &mut self.restart.steps);
        // in a thread the card turns the spindle, once motion is requested
        if let Some(ready) = self.recovery.machine().spindle.ready.filter(|_| !self.is_engaged()) {
            await_spindle(&mut self.restart.steps, wants, ready);
        }
        if self.restart.steps.iter().any(|step| matches!(step.layer, Some(LayerMove::Start { .. })))
            && let Some(lift) = self.lift_off_contact()
        {
            self.restart.steps.insert(0, lift);
        }
        (self.restart.before, self.restart.sent, self.restart.done) = (self.card.status().repeated, 0, 0);
        self.restart.stage = if self.restart.steps.is_empty() { RestartStage::Idle } else { RestartStage::Asking };
        self.prepare_cutter_start();
        if !self.restart.is_active() {
            self.emit(EventKind::OutputsRestored);
        }
    }

    /// Lifts the tool before a start of the program, where it still touches the sheet. Returns false where it does not,
    /// or where that has not helped.
    pub(super) fn lifts_before_start(&mut self, layer: Option<LayerMove>) -> bool {
        let lift = self.lift_off_contact().filter(|_| matches!(layer, Some(LayerMove::Start { .. })));
        let Some(lift) = lift.filter(|_| !self.restart.has_lifted) else {
            self.restart.has_lifted = false;
            return false;
        };
        self.restart.steps.clear();
        self.restart.steps.push(lift);
        (self.restart.before, self.restart.sent, self.restart.done) = (self.card.status().repeated, 0, 0);
        (self.restart.stage, self.restart.has_lifted) = (RestartStage::Asking, true);
        true
    }

    /// A step that lifts the tool, if a contact of the sheet is closed: a start that was ended by an alarm leaves the
    /// tool on the sheet, where no start begins.
    fn lift_off_contact(&self) -> Option<RestartStep> {
        let (status, machine) = (self.card.status(), self.recovery.machine());
        let layer = machine.tool_layer()?;
        let touches = layer.contacts().any(|input| status.inputs >> (input & 15) & 1 == 1);
        let path_mm = machine.axes[layer.index].mm_of(status.counts[layer.index]);
        let step = RestartStep { code: HEIGHT, layer: Some(layer.lift(path_mm)), ..RestartStep::default() };
        touches.then_some(step)
    }

    /// Executes again what lit the cutter of this channel, even where the program does not expect it to be on at the
    /// furthest place.
    pub(super) fn restart_cutter(&mut self, channel: u8) {
        let mut wants = self.card.status().outputs;
        if let Some(value) = wants.get_mut(usize::from(channel)) {
            *value = 1;
        }
        self.begin_restart_to(&wants, |concerned| concerned == channel);
    }

    /// Cancels a restart: its remaining steps are dropped. Motion is not blocked any more once the instruction has
    /// ended that the card is executing.
    pub(super) fn cancel_restart(&mut self) {
        if self.restart.sent > self.restart.done {
            self.restart.steps.truncate(self.restart.sent);
            self.restart.stage = RestartStage::Ending;
        } else if self.restart.is_active() {
            self.restart.stage = RestartStage::Idle;
            self.release_block();
        }
    }

    /// Lets motion resume without a restart.
    pub(super) fn release_block(&mut self) {
        let last = self.card.status().repeated;
        // Where the card cannot accept the command, it is sent again in the next period: the card still reports that it
        // blocks.
        let _ = self.card.send(HostCommand::Restart { last });
    }

    /// Advances an active restart. Called before every control period.
    pub(super) fn advance_restart(&mut self) {
        if self.restart.stage == RestartStage::Ending
            && self.card.status().repeated.wrapping_sub(self.restart.before) as usize >= self.restart.sent
        {
            self.restart.end();
            self.release_block();
        }
        if self.restart.stage == RestartStage::Asking
            && self.card.send(HostCommand::Restart { last: self.restart.last() }).is_ok()
        {
            self.restart.stage = RestartStage::Blocking;
        }
        if self.restart.stage == RestartStage::Blocking && self.card.status().blocked {
            self.restart.stage = RestartStage::Repeating;
        }
        if self.restart.stage != RestartStage::Repeating {
            return;
        }
        loop {
            let complete = self.card.status().repeated.wrapping_sub(self.restart.before) as usize;
            while self.restart.done < complete.min(self.restart.sent) {
                let step = self.restart.steps[self.restart.done];
                self.restart.done += 1;
                self.emit_at(step.line, EventKind::RestartSwitched(step.code));
            }
            if self.restart.done == self.restart.steps.len() {
                self.restart.end();
                self.emit(EventKind::OutputsRestored);
                return;
            }
            if self.restart.sent > self.restart.done || !self.card.status().at_rest {
                return;
            }
            let RestartStep { code, line, changes, count, periods, until, layer } =
                self.restart.steps[self.restart.sent];
            let number = self.restart.before.wrapping_add(self.restart.sent as u32 + 1);
            let repeated = RepeatedInstruction { number, changes, count, periods, until, is_pulse: false, layer };
            if self.card.send(HostCommand::Repeat(repeated)).is_err() {
                return;
            }
            changes[..usize::from(count)].iter().for_each(|change| self.manual_outputs.remove_channel(change.channel));
            self.restart.sent += 1;
            self.emit_at(line, EventKind::RestartSwitching(code));
        }
    }

    /// Handles a cutting output that the card has switched off by itself. Where the machine was at rest, and where the
    /// cutter was lost or not started, the job is interrupted.
    pub(super) fn cutter_went_off(&mut self, off: CutterOff) {
        if off.channels == 0 && self.sense_test_went_off(off) {
            return;
        }
        for at in (0..self.config.cutter_channels.len()).filter(|at| off.channels >> at & 1 != 0) {
            let channel = self.config.cutter_channels[at];
            self.emit(EventKind::CutterOff { channel, reason: CutterOffReason::Card(off.cause) });
            self.stop_flow(channel, CutterOffReason::Card(off.cause));
        }
        let is_off_the_sheet =
            matches!(off.cause, CutterOffCause::NoSheet | CutterOffCause::SheetContact | CutterOffCause::Collision);
        if is_off_the_sheet {
            self.recorded_layers.forget();
        }
        if matches!(off.cause, CutterOffCause::NoSheet | CutterOffCause::SheetContact)
            && let Some(channel) = self.recovery.machine().tool_layer().map(|layer| layer.fire)
        {
            // It was not on.
            self.emit(EventKind::CutterOff { channel, reason: CutterOffReason::Card(off.cause) });
        }
        // An instruction that was late: the card does not leave a cutter on until it arrives.
        let is_cut_to_its_end = off.cause == CutterOffCause::Standing
            && self.cutters_of(off.channels).all(|channel| self.ends_cut_at(channel, off.place));
        if !is_cut_to_its_end {
            self.record_cut_end(off);
        }
        let interrupts = match off.cause {
            // At a stop of the program, *recover* continues a program that is held.
            CutterOffCause::Standing => !is_cut_to_its_end || self.program_stop != ProgramStop::No || self.single_stop,
            cause => cause.cancels_start() || cause.ends_cut(),
        };
        if off.cause.cancels_start() {
            // The card has cancelled what it was executing: an instruction, or a step of a restart.
            self.restart.end();
            if self.executing.take().is_some() {
                self.streamer.mark_cancelled();
            }
        }
        if interrupts && self.mode_controller.mode() == Mode::Run {
            // never rejected
            let _ = self.mode_controller.apply(retrace_core::mode::ModeCommand::Hold);
        }
    }

    /// The channels with these indices in the card's settings, one bit each.
    pub(super) fn cutters_of(&self, channels: u8) -> impl Iterator<Item = u8> {
        let cutters = self.config.cutter_channels.iter().enumerate();
        cutters.filter(move |&(at, _)| channels >> at & 1 != 0).map(|(_, &channel)| channel)
    }

    /// Whether a cutter on this channel is being lit, by an instruction of the program or by a restart. Between two
    /// attempts its output is off.
    pub(super) fn is_starting(&self, channel: u8) -> bool {
        let executing = self.executing.and_then(|_| self.streamer.sent_instruction());
        executing.is_some_and(|instruction| instruction.switches_on(channel)) || self.restart.switches_on(channel)
    }

    /// Whether any cutter is being lit.
    pub(super) fn is_starting_cutter(&self) -> bool {
        self.config.fire_channels.iter().any(|&channel| self.is_starting(channel))
    }

    /// Switches every cutting output off immediately, and cancels the start of those that are being lit.
    pub(super) fn switch_cutters_off(&mut self, reason: CutterOffReason) {
        for at in 0..self.config.fire_channels.len() {
            let channel = self.config.fire_channels[at];
            if self.is_starting(channel) {
                self.switch_off_now(channel, reason);
            } else {
                self.switch_off(channel, reason);
            }
            self.stop_flow(channel, reason);
        }
        if self.config.fire_channels.iter().any(|&channel| self.restart.switches_on(channel)) {
            self.cancel_restart();
        }
    }

    /// Stops what belongs to a jet that is off: its abrasive, which would clog the mixing tube without water, and its
    /// pressure, as the next start may pierce at a low one (CUT-18, CUT-19).
    fn stop_flow(&mut self, fire: u8, reason: CutterOffReason) {
        let Some(cutter) = self.recovery.cutter(fire) else { return };
        let (abrasive, pressure) = (cutter.abrasive, cutter.pressure.filter(|_| cutter.jet.is_some()));
        for channel in [abrasive, pressure].into_iter().flatten() {
            self.switch_off(channel, reason);
        }
    }

    /// Stops an abrasive that is on before its water where the machine is held in between.
    pub(super) fn watch_leading_abrasive(&mut self, status: &CardStatus<A>) {
        let is_busy = self.executing.is_some() || self.restart.is_active();
        // The end of the job switches off everything.
        if !self.mode_controller.is_held() || is_busy || self.phase.is_stopping() {
            return;
        }
        let is_on = |channel: u8| status.outputs.get(usize::from(channel)).is_some_and(|&value| value != 0);
        for at in 0..self.config.fire_channels.len() {
            let fire = self.config.fire_channels[at];
            let abrasive = self.recovery.cutter(fire).filter(|cutter| cutter.jet.is_some()).and_then(|of| of.abrasive);
            if abrasive.is_some_and(is_on) && !is_on(fire) {
                self.stop_flow(fire, CutterOffReason::Card(CutterOffCause::Standing));
            }
        }
    }

    fn switch_off(&mut self, channel: u8, reason: CutterOffReason) {
        if self.card.status().outputs.get(usize::from(channel)).is_some_and(|&value| value != 0) {
            self.switch_off_now(channel, reason);
        }
    }

    fn switch_off_now(&mut self, channel: u8, reason: CutterOffReason) {
        // a card accepts every channel that its settings name
        self.send_manual_output(OutputChange { channel, value: 0 });
        self.emit(EventKind::CutterOff { channel, reason });
    }

    /// Switches off immediately what the end of a program switches off.
    pub(super) fn switch_off_at_end(&mut self, reason: CutterOffReason) {
        for at in 0..self.config.off_at_end.len() {
            self.switch_off(self.config.off_at_end[at], reason);
        }
    }

    /// The end of a job: switches every channel of a cutter and the spindle off (CUT-4, CUT-10), and waits until the
    /// card has reported it.
    ///
    /// # Errors
    /// E3026 where the card goes on reporting one of them on (CUT-7).
    pub(super) fn end_with_outputs_off(&mut self, reason: CutterOffReason) -> Result<(), CardError> {
        // It is off at the pins once a period has passed.
        let mut on = self.output_on_at_end();
        self.switch_off_at_end(reason);
        // Something else may have switched it off in this period.
        let mut was_switched = self.manual_outputs.has_unreported();
        for _ in 0..MAX_PERIODS_TO_REPORT {
            if on.is_none() && !std::mem::take(&mut was_switched) {
                return Ok(());
            }
            // What a card that fails reports is not known.
            let Ok(status) = self.card.run_period() else { return Ok(()) };
            let status = *status;
            if self.dnc.is_off_path() || self.probing.is_active() {
                self.account_off_path_period(&status);
            } else {
                self.account_period(&status);
            }
            on = self.output_on_at_end();
        }
        on.map_or(Ok(()), |channel| Err(self.stays_on(channel)))
    }

    /// A channel that the end of a job switches off and the card reports on.
    fn output_on_at_end(&self) -> Option<u8> {
        let outputs = &self.card.status().outputs;
        let is_on = |channel: &u8| outputs.get(usize::from(*channel)).is_some_and(|&value| value != 0);
        self.config.off_at_end.iter().copied().find(is_on)
    }

    fn stays_on(&self, channel: u8) -> CardError {
        CardError::Fault {
            number: "E3026",
            cause: format!(
                "the card reports {} on, although the end of the job has switched it off",
                self.recovery.machine().channel_name(channel)
            ),
            remedy: "switch off the source of the cutter at its own switch; check the card, and the line to it".into(),
        }
    }

    /// At the end of the program the outputs of the cutters are off as the card reports them (CUT-7).
    ///
    /// # Errors
    /// E3026
    pub(super) fn watch_outputs_at_end(&mut self) -> Result<(), CardError> {
        let on = self.output_on_at_end().filter(|_| self.phase.program_has_ended() && !self.restart.is_active());
        let Some(channel) = on.filter(|_| self.mode_controller.mode() == Mode::Run) else {
            self.on_at_end_periods = 0;
            return Ok(());
        };
        self.on_at_end_periods += 1;
        if self.on_at_end_periods < MAX_PERIODS_TO_REPORT { Ok(()) } else { Err(self.stays_on(channel)) }
    }
}

/// Progress of switching the cutters off before the path is retraced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LeavingRun {
    /// They are off, or there is nothing to do.
    No,
    /// The machine comes to rest, cutting up to the place of rest.
    Braking,
    /// It is at rest; the outputs are not reported off yet.
    SwitchingOff,
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Switches the cutters off once the machine is at rest after normal run. Returns false until that is done (CUT-4).
    pub(super) fn has_left_run(&mut self) -> bool {
        let status = self.card.status();
        if self.leaving_run == LeavingRun::Braking && status.at_rest {
            // The kerf ends where the way back begins.
            for at in 0..self.config.fire_channels.len() {
                self.record_cut_end_by_hand(self.config.fire_channels[at]);
            }
            self.leaving_run = LeavingRun::SwitchingOff;
            self.switch_cutters_off(CutterOffReason::Retrace);
        }
        let outputs = self.card.status().outputs;
        let lit = |&channel: &u8| outputs.get(usize::from(channel)).is_some_and(|&value| value != 0);
        if self.leaving_run == LeavingRun::SwitchingOff && !self.config.fire_channels.iter().any(lit) {
            self.leaving_run = LeavingRun::No;
        }
        self.leaving_run == LeavingRun::No
    }
}

/// Periods that the card may take to report an output off: longer than any watchdog.
const MAX_PERIODS_TO_REPORT: u32 = 4000;
