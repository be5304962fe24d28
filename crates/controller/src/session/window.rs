//! The card's window and the rate it is asked for.
//!
//! Invariant: a road that the mode has end somewhere ends there before anything moves; what was asked for and taken is not asked for again.

use retrace_core::mode::{Mode, ModeOutput};
use retrace_core::place::is_before;
use retrace_core::{ONE, Place, RateTarget, Travel};
use retrace_link::{CardStatus, HostCommand, MotionCard};

use super::Session;
use super::back_target::BackTarget;
use crate::event::EventKind;
use crate::record_streamer::SendHorizon;

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// The oldest place that can be gone back to, or that a reverse run of its own is to end at.
    pub(super) fn oldest(&self) -> u32 {
        let oldest = self.supply.oldest();
        let there = self.back.as_ref().and_then(BackTarget::place);
        let later = |oldest, other: Option<u32>| other.filter(|&place| is_before(oldest, place)).unwrap_or(oldest);
        later(later(oldest, there), self.cutter_boundary())
    }

    /// Where the path is retraced with the cutter on by hand: the last place at which the program switched it. Backward beyond it the
    /// sheet would be cut where the program does not, so that the operator is asked there.
    pub(super) fn cutter_boundary(&self) -> Option<u32> {
        let status = self.card.status();
        let lit = self.cutting.iter().any(|&c| status.outputs.get(usize::from(c)).is_some_and(|&value| value != 0));
        let backward = matches!(self.operation.mode(), Mode::Reverse | Mode::Wheel);
        if !lit || !backward || self.replays {
            return None;
        }
        self.supply.cut_change_before(status.place, self.passed_boundary)
    }

    /// Slides the window. In a mode that retraces the road is cut at `reached`, and at the oldest place, before anything moves; a card
    /// at the end of a line may have to be told more than once.
    pub(super) fn slide(&mut self, demand: ModeOutput) {
        let road = if demand.look_ahead { SendHorizon::LookAhead } else { SendHorizon::Reached };
        if road == SendHorizon::Reached {
            let CardStatus { reached, low, high, .. } = *self.card.status();
            let oldest = self.oldest();
            self.road_cut = !is_before(reached, high);
            if is_before(reached, high) {
                self.road_cut = self.card.send(HostCommand::Trim { high: reached }).is_ok();
            }
            if is_before(low, oldest) && is_before(oldest, high) {
                self.road_cut &= self.card.send(HostCommand::Forget { low: oldest }).is_ok();
            }
        } else {
            self.road_cut = true;
        }
        // Where a path is taken up inside of a record, that one comes first.
        let CardStatus { place, high, .. } = *self.card.status();
        let stands_inside = place.fraction != 0 && high == place.record;
        if demand.target.faster() < 0 && !stands_inside {
            let oldest = self.oldest();
            self.supply.fill_behind(&mut self.card, oldest);
        } else {
            self.supply.fill_ahead(&mut self.card, road);
        }
    }

    pub(super) fn set_rate(&mut self, demand: ModeOutput) {
        let outputs = &self.card.status().outputs;
        let cutting = self.cutting.iter().any(|&c| outputs.get(usize::from(c)).is_some_and(|&v| v != 0));
        // Rapid retrace only with the cutting outputs off.
        let RateTarget { feed, rapid } = demand.target;
        let within = |rate: Travel| if cutting { rate.clamp(-ONE, ONE) } else { rate };
        let target = RateTarget { feed: within(feed), rapid: within(rapid) };
        let target = if self.waits_for_records() || !self.road_cut { RateTarget::ZERO } else { target };
        if self.target != Some(target) && self.card.send(HostCommand::Rate(target)).is_ok() {
            self.target = Some(target);
        }
    }

    /// Motion begins when enough is planned, and enough of it has come to the card, to go on at full rate; or when nothing more has come
    /// for as long as the look-ahead lasts.
    fn waits_for_records(&mut self) -> bool {
        let status = self.card.status();
        let stands = status.at_rest && self.operation.mode() == Mode::Run;
        // A cutter that is lit burns where the machine stands: what has come is enough to begin with.
        let lit = self.cutting.iter().any(|&c| status.outputs.get(usize::from(c)).is_some_and(|&value| value != 0));
        if !stands || lit || status.place.boundary_ahead() != status.reached || self.still_periods >= self.patience {
            return false;
        }
        let wanted = status.place.record.wrapping_add(self.enough);
        let wanted = if is_before(status.high, wanted) { status.high } else { wanted };
        is_before(self.card.acknowledged_high(), wanted)
            || self.manner.wall_time && !self.supply.has_lookahead(status, self.enough)
    }

    /// Underruns, and the end of a single block.
    pub(super) fn watch_supply(&mut self, status: &CardStatus<A>, mode: Mode) {
        if self.single && self.supply.block_end().is_some_and(|end| is_before(end, self.card.status().high)) {
            // The card could not stop there any more: at the next end of a block, then.
            self.next_block();
        }
        let at_block_end = self.single && self.supply.block_end() == Some(status.high);
        // who stands does not run dry: either there was nothing to run, or it was told on the way to rest
        let dry = status.starved && status.rate != 0 && mode == Mode::Run && !at_block_end;
        if dry && !self.dry {
            self.tally.underruns += 1;
            self.tell(EventKind::Underrun);
        }
        self.dry = dry;
        if at_block_end
            && mode == Mode::Run
            && !self.single_stop
            && status.at_rest
            && status.place == Place::start_of(status.high)
        {
            self.single_stop = true;
            self.tell(EventKind::SingleBlock);
        }
    }
}
