//! A job that is resumed where it was left (DNC-6, SPN-25).
//!
//! Invariant: nothing is sent to the card before the place is found and the caller has agreed.

use retrace_core::mode::{ModeCommand, ModeController};
use retrace_link::MotionCard;

use super::{Outcome, Session};
use crate::event::CardError;
use crate::resume::{ResumeError, ResumePlan, ResumePoint};
use crate::run_stats::RunStats;

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Resumes the job where it was left, its origin having had these counts: finds the place, calls `confirm`, moves
    /// the axes to the counts of the place in the order of DNC-6 where they are elsewhere, and runs forward to
    /// `reached` automatically. Where `confirm` returns false, the job is stopped immediately.
    ///
    /// # Errors
    /// [`ResumeError`]; nothing has been sent to the card then.
    pub fn resume(
        mut self,
        at: &ResumePoint,
        counts: [i64; A],
        agree: impl FnOnce(&ResumePlan<A>) -> bool,
    ) -> Result<(Outcome, RunStats, C), ResumeError> {
        let prepared = self.replay(at, counts)?;
        if !agree(&prepared) {
            return Ok((Outcome::Stopped, self.stats, self.card));
        }
        if let (Some(axis), false) = (self.tool_axis(), at.lengths.is_empty()) {
            self.bar_beyond_limits(prepared.counts()[axis], prepared.start().place);
        }
        match self.begin_where_left(&prepared) {
            Ok(None) => {}
            Ok(Some(outcome)) => return Ok((outcome, self.stats, self.card)),
            Err(error) => {
                let outcome = self.end_with_error(error);
                return Ok((outcome, self.stats, self.card));
            }
        }
        self.mode_controller = ModeController::rejoining();
        self.stats = RunStats::new(at.start.reached);
        self.restore_cut_end(&at.cut_ends, at.start.reached);
        self.recovery.pierces_first = at.begun_start.is_some();
        match prepared.tap() {
            // The operator decides what becomes of it. Other outputs are restored behind it.
            Some(_) => drop(self.mode_controller.apply(ModeCommand::Hold)),
            None => self.restart_without_cutters(),
        }
        Ok(self.run())
    }

    /// Begins the path where the job was left, behind the moves that bring the axes there; in a tap that the card has
    /// kept, where the tool is. Returns how the job has ended, if it has.
    fn begin_where_left(&mut self, prepared: &ResumePlan<A>) -> Result<Option<Outcome>, CardError> {
        self.check_collision()?;
        if let Some(kept) = prepared.tap() {
            return self.take_up_tap(&kept, prepared).map(|()| None);
        }
        let ended = self.go_to_breakpoint(prepared.counts())?;
        if ended.is_none() {
            self.begin_resumed_path(prepared)?;
        }
        Ok(ended)
    }

    /// Begins to restore the outputs: before anything moves in the work, its tool has to turn; cutters are lit only at
    /// the furthest place.
    pub(super) fn restart_without_cutters(&mut self) {
        let cutting = std::mem::take(&mut self.config.fire_channels);
        self.begin_restart(|channel| !cutting.contains(&channel));
        self.config.fire_channels = cutting;
    }
}
