//! The card's window and the requested rate.
//!
//! Invariant: where the mode ends the window, it ends before anything moves; a request that was accepted is not sent
//! again.

use retrace_core::mode::{Mode, ModeOutput};
use retrace_core::{Place, Rate, RateTarget, RecordIndex};
use retrace_link::{CardStatus, HostCommand, MotionCard};

use super::Session;
use super::back_target::BackTarget;
use crate::event::EventKind;
use crate::record_streamer::SendHorizon;

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Oldest place that reverse run can reach, or the target of a reverse run.
    pub(super) fn oldest(&self) -> RecordIndex {
        let oldest = self.streamer.oldest();
        let there = self.back_target.as_ref().and_then(BackTarget::place);
        [there, self.cutter_boundary()].into_iter().flatten().fold(oldest, RecordIndex::later)
    }

    /// The last place at which the program switched the cutter, where the path is retraced with the cutter manually on.
    /// Backward beyond it, material would be cut that the program does not cut, so the operator has to confirm there.
    pub(super) fn cutter_boundary(&self) -> Option<RecordIndex> {
        let status = self.card.status();
        let lit = self
            .config
            .fire_channels
            .iter()
            .any(|&c| status.outputs.get(usize::from(c)).is_some_and(|&value| value != 0));
        let backward = matches!(self.mode_controller.mode(), Mode::Reverse | Mode::Wheel);
        if !backward || self.config.replays_outputs {
            return None;
        }
        if self.asked_boundary.is_some() && self.mode_controller.mode() == Mode::Reverse {
            return self.asked_boundary;
        }
        if !lit {
            return None;
        }
        self.streamer.cut_change_before(status.place, self.passed_boundary)
    }

    /// Slides the window. In a mode that retraces, the window is cut at the furthest place or before, and at the oldest
    /// place before anything moves. A card at the end of a serial line may need the
    /// command more than once.
    pub(super) fn slide_window(&mut self, demand: ModeOutput) {
        self.close_passed_threads();
        let CardStatus { low, high, .. } = *self.card.status();
        let reached = self.end_of_retrace();
        // A thread is armed before its records are sent.
        let horizon = match self.end_of_armed() {
            None if demand.look_ahead => SendHorizon::LookAhead,
            Some(end) if demand.look_ahead => SendHorizon::Until(end),
            _ => SendHorizon::Until(reached),
        };
        if !demand.look_ahead {
            let oldest = self.oldest();
            self.window_is_trimmed = !reached.is_before(high);
            if reached.is_before(high) {
                self.window_is_trimmed = self.card.send(HostCommand::Trim { high: reached }).is_ok();
            }
            if low.is_before(oldest) && oldest.is_before(high) {
                self.window_is_trimmed &= self.card.send(HostCommand::Forget { low: oldest }).is_ok();
            }
        } else {
            self.window_is_trimmed = true;
        }
        // Where a path is resumed inside a record, that record comes first.
        let CardStatus { place, high, .. } = *self.card.status();
        let stands_inside = place.fraction != 0 && high == place.record;
        if demand.target.faster() < Rate::ZERO && !stands_inside {
            let oldest = self.oldest();
            if self.takes_records_behind() {
                self.streamer.fill_behind(&mut self.card, oldest);
            }
        } else {
            self.streamer.fill_ahead(&mut self.card, horizon);
        }
    }

    pub(super) fn set_rate(&mut self, demand: ModeOutput) {
        let outputs = &self.card.status().outputs;
        let cutting = self.config.fire_channels.iter().any(|&c| outputs.get(usize::from(c)).is_some_and(|&v| v != 0));
        // Rapid retrace only with the cutting outputs off.
        let RateTarget { feed, rapid } = demand.target;
        let within = |rate: Rate| if cutting { rate.clamp(-Rate::ONE, Rate::ONE) } else { rate };
        let most = self.lead_in_rate();
        let target = RateTarget { feed: within(feed).min(most), rapid: within(rapid).min(most) };
        let target = if self.waits_for_records() || !self.window_is_trimmed { RateTarget::ZERO } else { target };
        if self.target != Some(target) && self.card.send(HostCommand::Rate(target)).is_ok() {
            self.target = Some(target);
        }
    }

    /// Whether motion has to wait for records. It begins when enough records are planned and on the card to run at full
    /// rate, or when nothing more has arrived for as long as the look-ahead lasts.
    fn waits_for_records(&mut self) -> bool {
        let status = self.card.status();
        let stands = status.at_rest && self.mode_controller.mode() == Mode::Run;
        // A lit cutter burns where the machine is at rest: what has arrived is enough to begin with.
        let lit = self
            .config
            .fire_channels
            .iter()
            .any(|&c| status.outputs.get(usize::from(c)).is_some_and(|&value| value != 0));
        if !stands
            || lit
            || status.place.boundary_ahead() != status.reached
            || self.still_periods >= self.config.max_wait_periods
        {
            return false;
        }
        let wanted = status.place.record + self.config.look_ahead_records;
        let wanted = if status.high.is_before(wanted) { status.high } else { wanted };
        self.card.acknowledged_high().is_before(wanted)
            || self.config.run_mode.wall_time && !self.streamer.has_lookahead(status, self.config.look_ahead_records)
    }

    /// Reports underruns, and the end of a single block.
    pub(super) fn watch_streamer(&mut self, status: &CardStatus<A>, mode: Mode) {
        if self.single_block && self.streamer.block_end().is_some_and(|end| end.is_before(self.card.status().high)) {
            // The card could not stop there any more: at the next end of a block, then.
            self.next_block();
        }
        let at_block_end = self.single_block && self.streamer.block_end() == Some(status.high);
        // a machine at rest does not run dry: either there was nothing to run, or it was reported while braking
        let ends_early = at_block_end || self.streamer.lead_in().is_some();
        let dry = status.starved && status.rate != Rate::ZERO && mode == Mode::Run && !ends_early;
        if dry && !self.dry {
            self.stats.underruns += 1;
            self.emit(EventKind::Underrun);
        }
        self.dry = dry;
        if at_block_end
            && mode == Mode::Run
            && !self.single_stop
            && status.at_rest
            && status.place == Place::start_of(status.high)
            && !self.streamer.is_contour_open()
        {
            self.single_stop = true;
            self.emit(EventKind::SingleBlock);
        }
    }
}
