//! Which thread the card has armed: the one whose instruction was executed last, or the one that the path comes back to
//! (SPN-22).
//!
//! Invariant: the card is told again wherever it may have forgotten it, and records of a thread are sent once it has
//! reported that the thread is armed.

use retrace_core::RecordIndex;
use retrace_core::mode::Mode;
use retrace_link::{CardStatus, CommandRefusal, GearStart, GearState, HostCommand, MotionCard, PathStart};

use super::FOLLOW_PERIODS;
use crate::entered_threads::EnteredThread;
use crate::event::CardError;
use crate::resume::{ResumeError, ResumePlan};
use crate::session::Session;
use crate::session::probing::fault;

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Enters the thread that begins here.
    pub(in crate::session) fn enter_thread(&mut self, first: RecordIndex, start: GearStart, line: u32) {
        let thread = EnteredThread::new(first, start, line, self.streamer.expected());
        self.geared.threads.enter(thread);
        self.geared.unreported = None;
    }

    /// Begins the path where a job is resumed; inside of a thread only where the card has kept it.
    pub(in crate::session) fn begin_resumed_path(&mut self, prepared: &ResumePlan<A>) -> Result<(), CardError> {
        for thread in prepared.threads() {
            self.geared.threads.enter(*thread);
        }
        self.begin_program_path(*prepared.start())?;
        match prepared.thread() {
            Some(thread) if self.is_engaged() => self.geared.threads.set_armed(Some(thread.first)),
            Some(EnteredThread { line, .. }) => {
                let what = ResumeError::InThread { line }.to_string();
                return Err(fault("E2219", &what, "`retrace resume JOB --from-line N` with a line before the thread"));
            }
            None => {}
        }
        Ok(())
    }

    /// Begins a path of the program anew: whatever thread the card had armed, it is told again.
    pub(in crate::session) fn begin_program_path(&mut self, start: PathStart) -> Result<(), CardError> {
        self.card.begin_path(start)?;
        self.geared.threads.set_armed(None);
        self.geared.unreported = None;
        Ok(())
    }

    /// Records ahead that have to be planned so that the motion does not depend on the planner's speed: a thread awaits
    /// more than a path does.
    pub(in crate::session) fn records_to_plan(&self) -> u32 {
        let is_free = matches!(self.card.status().spindle.gear, GearState::Off | GearState::Freed);
        let ahead = self.geared.threads.armed().filter(|_| !is_free).map_or(0, |thread| u32::from(thread.start.ahead));
        self.config.look_ahead_records.max(ahead)
    }

    /// Whether the card has armed this thread, as far as it has reported.
    pub(super) fn is_armed(&self, thread: &EnteredThread) -> bool {
        let armed = self.geared.threads.armed().filter(|_| self.geared.unreported.is_none());
        armed.is_some_and(|armed| armed.first == thread.first)
    }

    /// Tells the card to arm a thread again.
    pub(super) fn arm_thread(&mut self, thread: &EnteredThread, is_passed: bool) -> Result<(), CommandRefusal> {
        let awaited = self.card.status().spindle.armed_again.wrapping_add(1);
        self.card.send(HostCommand::ArmStretch(self.geared.threads.arming(thread, is_passed)))?;
        self.geared.threads.set_armed(Some(thread.first));
        self.geared.unreported = Some((awaited, 0));
        Ok(())
    }

    /// The thread that the card has to have armed here, and whether that is passed: the one whose end is open to
    /// reverse run, otherwise the next one ahead.
    fn thread_to_arm(&self) -> Option<(EnteredThread, bool)> {
        let CardStatus { place, spindle, .. } = *self.card.status();
        let is_elsewhere = self.probing.is_active() || self.streamer.lead_in().is_some();
        if is_elsewhere || matches!(spindle.gear, GearState::Engaged | GearState::Freed) {
            return None;
        }
        let is_reversed = self.mode_controller.mode() == Mode::Reverse;
        let is_open = |thread: &EnteredThread| is_reversed && self.streamer.is_open(thread.end());
        let behind = self.geared.threads.ending_at(place).filter(is_open);
        behind.map(|thread| (thread, true)).or(self.geared.threads.ahead(place).next().map(|thread| (*thread, false)))
    }

    /// Where a thread begins whose records the card does not take yet, or is to hold no more: it is not the one that
    /// has to be armed here, or that is not reported yet.
    pub(in crate::session) fn end_of_armed(&self) -> Option<RecordIndex> {
        let armed = match self.thread_to_arm() {
            Some((thread, is_passed)) => Some(thread).filter(|thread| !is_passed && self.is_armed(thread)),
            None => self.geared.threads.armed(),
        };
        let place = self.card.status().place;
        let mut firsts = self.geared.threads.ahead(place).map(|thread| thread.first);
        firsts.find(|&first| armed.is_none_or(|armed| armed.first != first))
    }

    /// Where records ahead end while the path is retraced: the furthest place, or the end of the thread around it, but
    /// before a thread that the card has not armed. A thread whose tool is free goes no further than it was cut.
    pub(in crate::session) fn end_of_retraced_thread(&self) -> RecordIndex {
        let CardStatus { reached, spindle, .. } = *self.card.status();
        let thread = self.geared.threads.with_record(reached).filter(|thread| thread.first.is_before(reached));
        let end = thread.filter(|_| spindle.gear != GearState::Freed).map_or(reached, |thread| thread.end());
        self.end_of_armed().filter(|place| place.is_before(end)).unwrap_or(end)
    }

    /// Whether the card takes the records behind the place: those of a thread that it is to have armed there only once
    /// it has.
    pub(in crate::session) fn takes_records_behind(&self) -> bool {
        self.thread_to_arm().is_none_or(|(thread, is_passed)| !is_passed || self.is_armed(&thread))
    }

    /// Has the card arm the thread that the path comes back to.
    pub(super) fn watch_arming(&mut self) {
        let Some((thread, is_passed)) = self.thread_to_arm() else { return };
        if self.geared.threads.armed().is_none_or(|armed| armed.first != thread.first) {
            // Refused where something else has to be done first: it is told again.
            let _ = self.arm_thread(&thread, is_passed);
            return;
        }
        let count = self.card.status().spindle.armed_again;
        match &mut self.geared.unreported {
            Some((awaited, _)) if *awaited == count => self.geared.unreported = None,
            Some((_, periods)) if *periods < FOLLOW_PERIODS => *periods += 1,
            Some(_) => self.geared.threads.set_armed(None),
            None => {}
        }
    }
}
