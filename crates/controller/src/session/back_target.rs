//! Reverse run to a target: by a length, to the beginning of a block, or to the last pierce. The machine rests there.
//!
//! The target is searched backward through the records, some of them in each control period, while the machine comes to
//! rest. The window then ends at the target as it would at the oldest record.
//!
//! Invariant: the machine does not reverse before the target is known; a length is run whole, to the first record
//! boundary at or beyond it.

use retrace_core::mode::{Mode, ModeCommand};
use retrace_core::{Distance, Place, Rate, RecordIndex};
use retrace_link::MotionCard;

use super::Session;
use crate::event::EventKind;
use crate::operator::CommandError;

/// Records searched per control period.
const RECORDS_A_PERIOD: u32 = 4096;

const AT_PIERCE: CommandError = CommandError::NotNow(
    "the machine is at the pierce of the contour: `recover` starts the cutter again; `back 5 mm` goes back further",
);

const AHEAD: CommandError =
    CommandError::NotNow("the place is ahead of the machine: `forward` goes there; `recover` goes there and cuts on");

/// Kind of target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum BackTargetKind {
    /// This length of path in mm.
    By(f64),
    /// The beginning of the current block; from there, that of the block before.
    Block,
    /// The last place where a cutting output was switched on.
    Pierce,
    /// The place where this contour begins.
    Contour(RecordIndex),
    /// This length in mm before the end of the cut, and not before its pierce.
    CutEnd(f64),
}

/// A reverse run that ends at a target.
#[derive(Clone, Copy, Debug)]
pub(super) struct BackTarget {
    kind: BackTargetKind,
    search: TargetSearch,
    /// Whether the estimate of its time was begun.
    is_estimated: bool,
}

/// Progress of the search for the target.
#[derive(Clone, Copy, Debug)]
enum TargetSearch {
    /// The search begins where the machine comes to rest.
    AtRest,
    /// No record before this boundary has been searched yet; with the remaining length in mm, or the line of the block.
    From { from: RecordIndex, remaining_mm: f64, line: u32 },
    /// The target.
    Found(RecordIndex),
    /// The history starts before the target.
    Beyond,
}

impl BackTarget {
    /// Whether the search is still in progress.
    pub(super) fn is_searching(&self) -> bool {
        matches!(self.search, TargetSearch::AtRest | TargetSearch::From { .. })
    }

    /// Target, once it is found. `None` also where the history starts before it: the run ends at the history start
    /// then.
    pub(super) fn place(&self) -> Option<RecordIndex> {
        match self.search {
            TargetSearch::Found(place) => Some(place),
            _ => None,
        }
    }

    /// Whether `place` is the target.
    pub(super) fn is_reached_at(&self, place: RecordIndex) -> bool {
        matches!(self.search, TargetSearch::Found(there) if there == place)
    }
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Begins a reverse run to a target: comes to rest, searches the target, and runs there as fast as permitted.
    pub(super) fn go_back(&mut self, wanted: BackTargetKind) -> Result<(), CommandError> {
        let status = *self.card.status();
        if status.place == Place::start_of(self.streamer.oldest()) {
            return Err(CommandError::NothingBehind);
        }
        // Nothing is cut yet of the contour that begins here: the cutter went out while it started.
        if matches!(wanted, BackTargetKind::Pierce) && status.at_rest && self.lights_cutter_here() {
            return Err(AT_PIERCE);
        }
        // While reversing, a near target may be passed before the machine stops. The search begins from rest then.
        let counts_from_here = status.at_rest || self.mode_controller.mode() == Mode::Run;
        let search =
            if counts_from_here { self.begin_search(wanted, status.place) } else { Some(TargetSearch::AtRest) };
        let missing =
            if matches!(wanted, BackTargetKind::CutEnd(_)) { CommandError::NoCutEnd } else { CommandError::NoPierce };
        let search = search.ok_or(missing)?;
        // The rate is limited by the records' own caps, and to 100 % while a cutter is on.
        self.mode_controller.apply(ModeCommand::Reverse(Rate::MAX))?;
        self.asked_boundary = None;
        self.back_target = Some(BackTarget { kind: wanted, search, is_estimated: false });
        Ok(())
    }

    /// Begins the search at a place. `None` where nothing was pierced.
    fn begin_search(&self, wanted: BackTargetKind, place: Place) -> Option<TargetSearch> {
        let on = |left_mm, line| TargetSearch::From { from: place.boundary_ahead(), remaining_mm: left_mm, line };
        Some(match wanted {
            BackTargetKind::Pierce => TargetSearch::Found(self.streamer.pierce_before(place)?),
            BackTargetKind::Contour(pierce) => {
                TargetSearch::Found(Some(pierce).filter(|pierce| !pierce.is_before(self.streamer.oldest()))?)
            }
            BackTargetKind::By(mm) => on(mm + self.rest_of_record_mm(place), 0),
            BackTargetKind::CutEnd(mm) => {
                let cut_end = self.recovery.cut_end()?;
                let remaining_mm = mm + self.rest_of_record_mm(cut_end);
                TargetSearch::From { from: cut_end.boundary_ahead(), remaining_mm, line: 0 }
            }
            BackTargetKind::Block => {
                let last = self.streamer.record(place.boundary_ahead() - 1);
                on(0.0, last.map_or(0, |record| record.line))
            }
        })
    }

    /// Length in mm of the part of the record at `place` that is ahead of it.
    fn rest_of_record_mm(&self, place: Place) -> f64 {
        let length_mm = self.record_length_mm(place.record).filter(|_| place.fraction != 0);
        length_mm.map_or(0.0, |length_mm| length_mm * (1.0 - place.fraction_of_record()))
    }

    /// Tells what reverse run stands at, which goes back no further: its target, a place where a cutter was switched,
    /// an instruction that is not undone, or the start of the history.
    pub(super) fn emit_end_of_reverse_run(&mut self, oldest: RecordIndex) {
        let there = self.back_target.as_ref().is_some_and(|back| back.is_reached_at(oldest));
        let reached = match self.streamer.barrier() {
            _ if there => EventKind::BackTargetReached,
            _ if self.cutter_boundary() == Some(oldest) => {
                self.asked_boundary = Some(oldest);
                EventKind::CutterBoundary
            }
            Some(code) => {
                let is_passed_again = self.thread_behind().is_some_and(|thread| thread.is_reversible());
                EventKind::RetraceBarrier { code, is_passed_again }
            }
            None => EventKind::HistoryStartReached,
        };
        self.emit(reached);
    }

    /// Length of a record in mm.
    pub(super) fn record_length_mm(&self, place: RecordIndex) -> Option<f64> {
        let record = self.streamer.record(place)?;
        let axes = record.increments.iter().zip(&self.config.mm_per_pulse);
        Some(axes.map(|(&pulses, mm)| (f64::from(pulses) * mm).powi(2)).sum::<f64>().sqrt())
    }

    /// Continues the search, if one is in progress. The number of records per control period is bounded.
    pub(super) fn search_back(&mut self) {
        let Some(mut back) = self.back_target else { return };
        if matches!(back.search, TargetSearch::AtRest) && self.card.status().at_rest {
            match self.begin_search(back.kind, self.card.status().place) {
                Some(search) => back.search = search,
                None => {
                    self.back_target = None;
                    self.emit(EventKind::CommandRejected(CommandError::NoPierce));
                    // The machine is at rest; in this mode it would run on to the oldest record.
                    let _ = self.mode_controller.apply(ModeCommand::Hold);
                    return;
                }
            }
        }
        if let TargetSearch::From { from, remaining_mm: left_mm, line } = back.search {
            back.search = self.continue_search(back.kind, from, left_mm, line);
        }
        self.back_target = Some(back);
        if let TargetSearch::Found(target) = back.search
            && self.card.status().place.distance_to(Place::start_of(target)) > Distance::ZERO
        {
            self.back_target = None;
            self.recovery.cancel_return();
            self.emit(EventKind::CommandRejected(AHEAD));
            let _ = self.mode_controller.apply(ModeCommand::Hold);
            return;
        }
        if let (TargetSearch::Found(target), false) = (back.search, back.is_estimated) {
            self.back_target = Some(BackTarget { is_estimated: true, ..back });
            if matches!(back.kind, BackTargetKind::Contour(_) | BackTargetKind::CutEnd(_)) {
                self.begin_retrace_estimate(target);
            }
        }
    }

    fn continue_search(&self, wanted: BackTargetKind, from: RecordIndex, left_mm: f64, line: u32) -> TargetSearch {
        let (mut from, mut left_mm, oldest) = (from, left_mm, self.streamer.oldest());
        let pierce = self.recovery.cut_end().and_then(|cut_end| self.streamer.pierce_before(cut_end));
        for _ in 0..RECORDS_A_PERIOD {
            let last = from - 1;
            let found = match wanted {
                // Sums of lengths are exact except for a few of the last digits.
                BackTargetKind::By(mm) => left_mm <= 1e-9 * mm,
                BackTargetKind::CutEnd(mm) => left_mm <= 1e-9 * mm || pierce == Some(from),
                _ => !last.is_before(oldest) && self.streamer.record(last).is_none_or(|record| record.line != line),
            };
            if found {
                return TargetSearch::Found(from);
            }
            if !oldest.is_before(from) {
                return TargetSearch::Beyond;
            }
            left_mm -= self.record_length_mm(last).unwrap_or(0.0);
            from = last;
        }
        TargetSearch::From { from, remaining_mm: left_mm, line }
    }
}
