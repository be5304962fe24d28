//! The restart of the outputs before motion goes on: the instructions that switched them, carried out again one after the other, while the
//! card blocks motion (CUT-17, DNC-9).
//!
//! Invariant: motion goes on only when the last instruction of a restart is reported complete; the card itself holds it until then, so that no
//! late report and no overtaking rate can start it.

use retrace_core::mode::Mode;
use retrace_link::{
    CutterOff, CutterOffCause, HostCommand, MotionCard, OutputChange, Outputs, RepeatedInstruction, channel,
};

use super::Session;
use crate::event::{CutterOffReason, EventKind};
use crate::restart::RestartStep;

/// How far a restart is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum RestartStage {
    /// None is under way.
    Idle,
    /// The card is to be asked to block motion.
    Asking,
    /// It was asked, and has not reported it yet.
    Blocking,
    /// Motion is blocked; the instructions are carried out.
    Repeating,
}

/// A restart of the outputs.
#[derive(Debug)]
pub(super) struct OutputRestart {
    stage: RestartStage,
    /// What is to be carried out, in this order.
    steps: Vec<RestartStep>,
    /// The card's number of the repeat before the first.
    before: u32,
    /// How many steps were sent.
    sent: usize,
    /// How many steps were reported complete.
    done: usize,
}

impl OutputRestart {
    pub(super) fn new() -> Self {
        Self { stage: RestartStage::Idle, steps: Vec::with_capacity(channel::COUNT), before: 0, sent: 0, done: 0 }
    }

    /// Is one under way?
    pub(super) fn is_active(&self) -> bool {
        self.stage != RestartStage::Idle
    }

    /// May a rate be asked for? Not before the card is known to block motion.
    pub(super) fn lets_rate_pass(&self) -> bool {
        !matches!(self.stage, RestartStage::Asking | RestartStage::Blocking)
    }

    /// The card's number of the last repeat.
    fn last(&self) -> u32 {
        self.before.wrapping_add(self.steps.len() as u32)
    }
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Begins to bring outputs to what the program expects, of the channels that `concerned` names. Where none of them differs, nothing is done.
    pub(super) fn begin_restart(&mut self, concerned: impl Fn(u8) -> bool) {
        let wants = *self.supply.expected();
        self.begin_restart_to(&wants, concerned);
    }

    /// The same, to these outputs.
    pub(super) fn begin_restart_to(&mut self, wants: &Outputs, concerned: impl Fn(u8) -> bool) {
        let outputs = self.outputs_compared_with(wants);
        self.supply.restart_steps(&outputs, wants, concerned, &mut self.restart.steps);
        (self.restart.before, self.restart.sent, self.restart.done) = (self.card.status().repeated, 0, 0);
        self.restart.stage = if self.restart.steps.is_empty() { RestartStage::Idle } else { RestartStage::Asking };
        if !self.restart.is_active() {
            self.tell(EventKind::OutputsRestored);
        }
    }

    /// Carries out again what lit the cutter of this channel, also where the program does not expect it to be on at the furthest place.
    pub(super) fn light(&mut self, channel: u8) {
        let mut wants = self.card.status().outputs;
        if let Some(value) = wants.get_mut(usize::from(channel)) {
            *value = 1;
        }
        self.begin_restart_to(&wants, |concerned| concerned == channel);
    }

    /// Gives a restart up: what was not begun of it is left, and motion is not blocked any more.
    pub(super) fn cancel_restart(&mut self) {
        if self.restart.is_active() {
            self.restart.stage = RestartStage::Idle;
            self.release_block();
        }
    }

    /// Motion may go on without a restart.
    pub(super) fn release_block(&mut self) {
        let last = self.card.status().repeated;
        // Where the card has no room for the word, it is asked again in the next period: it reports that it blocks still.
        let _ = self.card.send(HostCommand::Restart { last });
    }

    /// Goes on with a restart that is under way. To be called before every control period.
    pub(super) fn advance_restart(&mut self) {
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
                self.tell_at(step.line, EventKind::RestartSwitched(step.code));
            }
            if self.restart.done == self.restart.steps.len() {
                self.restart.stage = RestartStage::Idle;
                self.tell(EventKind::OutputsRestored);
                return;
            }
            if self.restart.sent > self.restart.done || !self.card.status().at_rest {
                return;
            }
            let RestartStep { code, line, changes, count, periods, until } = self.restart.steps[self.restart.sent];
            let number = self.restart.before.wrapping_add(self.restart.sent as u32 + 1);
            let repeated = RepeatedInstruction { number, changes, count, periods, until };
            if self.card.send(HostCommand::Repeat(repeated)).is_err() {
                return;
            }
            changes[..usize::from(count)].iter().for_each(|change| self.by_hand.superseded(change.channel));
            self.restart.sent += 1;
            self.tell_at(line, EventKind::RestartSwitching(code));
        }
    }

    /// The card has switched cutting outputs off by itself. Where that was because the machine stood, the job is interrupted.
    pub(super) fn cutter_went_off(&mut self, off: CutterOff) {
        for at in (0..self.cutting_channels.len()).filter(|at| off.channels >> at & 1 != 0) {
            let channel = self.cutting_channels[at];
            self.tell(EventKind::CutterOff { channel, reason: CutterOffReason::Card(off.cause) });
        }
        if off.cause == CutterOffCause::Standing && self.operation.mode() == Mode::Run {
            // never refused
            let _ = self.operation.apply(retrace_core::mode::ModeCommand::Hold);
            self.cutter_is_out = true;
        }
    }

    /// Switches every cutting output off, now.
    pub(super) fn switch_cutters_off(&mut self, reason: CutterOffReason) {
        for at in 0..self.cutting.len() {
            self.switch_off(self.cutting[at], reason);
        }
    }

    fn switch_off(&mut self, channel: u8, reason: CutterOffReason) {
        if self.card.status().outputs.get(usize::from(channel)).is_some_and(|&value| value != 0) {
            // a card takes every channel that its settings name
            self.send_by_hand(OutputChange { channel, value: 0 });
            self.tell(EventKind::CutterOff { channel, reason });
        }
    }

    /// Switches off what the end of a program switches off, now.
    pub(super) fn switch_off_at_end(&mut self, reason: CutterOffReason) {
        for at in 0..self.off_at_end.len() {
            self.switch_off(self.off_at_end[at], reason);
        }
    }

    /// The end of a job: every channel of a cutter goes off, and the spindle (CUT-4, CUT-10); waits until the card has reported it.
    pub(super) fn end_switched_off(&mut self, reason: CutterOffReason) {
        let is_on =
            |outputs: &Outputs, channel: &u8| outputs.get(usize::from(*channel)).is_some_and(|&value| value != 0);
        let mut outputs = self.card.status().outputs;
        self.switch_off_at_end(reason);
        for _ in 0..MAX_PERIODS_TO_REPORT {
            if !self.off_at_end.iter().any(|channel| is_on(&outputs, channel)) {
                return;
            }
            let Ok(status) = self.card.run_period() else { return };
            let status = *status;
            outputs = status.outputs;
            if self.dnc.is_off_path() {
                self.book_off_path(&status);
            } else {
                self.account_period(&status);
            }
        }
    }
}

/// How far a cutter is put out where the path is to be retraced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LeavingRun {
    /// It is, or there is nothing to do.
    No,
    /// The machine comes to rest, cutting to the place of rest.
    Braking,
    /// It rests; the outputs are not reported off yet.
    SwitchingOff,
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Puts the cutters out once the machine rests, where normal run was left; false where that is not done yet (CUT-4).
    pub(super) fn has_left_run(&mut self) -> bool {
        let status = self.card.status();
        if self.leaving_run == LeavingRun::Braking && status.at_rest {
            self.leaving_run = LeavingRun::SwitchingOff;
            self.switch_cutters_off(CutterOffReason::Retrace);
        }
        let outputs = self.card.status().outputs;
        let lit = |&channel: &u8| outputs.get(usize::from(channel)).is_some_and(|&value| value != 0);
        if self.leaving_run == LeavingRun::SwitchingOff && !self.cutting.iter().any(lit) {
            self.leaving_run = LeavingRun::No;
        }
        self.leaving_run == LeavingRun::No
    }
}

/// So long the card may take to report that an output is off: longer than any watchdog.
const MAX_PERIODS_TO_REPORT: u32 = 4000;
