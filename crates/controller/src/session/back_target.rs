//! Reverse work as a job: back by a length, to the beginning of a block, to where the jet came on, and there the machine stands.
//!
//! The place is searched backward through the records, some of them a control period, while the machine comes to rest. The road then ends
//! there, as it would at the oldest record.
//!
//! Invariant: the machine does not go back before the place is known; a length is run whole, to the first record boundary at or beyond it.

use retrace_core::mode::{Mode, ModeCommand};
use retrace_core::place::is_before;
use retrace_core::{ONE, Place};
use retrace_link::MotionCard;

use super::Session;
use crate::event::EventKind;
use crate::operator::CommandError;

/// Records looked at in a control period.
const RECORDS_A_PERIOD: u32 = 4096;

/// Where to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum BackTargetKind {
    /// So many mm of path back.
    By(f64),
    /// To the beginning of the block; from there, to that of the block before.
    Block,
    /// To where a cutting output was switched on last.
    Pierce,
}

/// A reverse run that ends at a place.
#[derive(Clone, Copy, Debug)]
pub(super) struct BackTarget {
    wanted: BackTargetKind,
    search: TargetSearch,
}

/// How far the place is known.
#[derive(Clone, Copy, Debug)]
enum TargetSearch {
    /// It is counted from where the machine comes to rest.
    AtRest,
    /// Nothing before this record boundary was looked at; the rest of the length in mm, or the line of the block.
    On { from: u32, left_mm: f64, line: u32 },
    /// Found.
    There(u32),
    /// History ends first.
    Beyond,
}

impl BackTarget {
    /// Is it still looked for?
    pub(super) fn is_looked_for(&self) -> bool {
        matches!(self.search, TargetSearch::AtRest | TargetSearch::On { .. })
    }

    /// The place, once it is found; history may end first, and that is where the run ends then.
    pub(super) fn place(&self) -> Option<u32> {
        match self.search {
            TargetSearch::There(place) => Some(place),
            _ => None,
        }
    }

    /// Is `place` where it was to go?
    pub(super) fn is_there(&self, place: u32) -> bool {
        matches!(self.search, TargetSearch::There(there) if there == place)
    }
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Begins to go back: comes to rest, looks for the place, and runs there, as fast as it may.
    pub(super) fn go_back(&mut self, wanted: BackTargetKind) -> Result<(), CommandError> {
        let status = *self.card.status();
        if status.place == Place::start_of(self.supply.oldest()) {
            return Err(CommandError::NothingBehind);
        }
        // Whoever goes back already may come by a place that is near before he rests: it counts from there then.
        let counts_from_here = status.at_rest || self.operation.mode() == Mode::Run;
        let search =
            if counts_from_here { self.begin_search(wanted, status.place) } else { Some(TargetSearch::AtRest) };
        let search = search.ok_or(CommandError::NoPierce)?;
        // The records' own caps, and 100 % while something cuts, are what limits it.
        self.operation.apply(ModeCommand::Reverse(8 * ONE))?;
        self.back = Some(BackTarget { wanted, search });
        Ok(())
    }

    /// The search from a place on; `None` where there is no jet.
    fn begin_search(&self, wanted: BackTargetKind, place: Place) -> Option<TargetSearch> {
        let on = |left_mm, line| TargetSearch::On { from: place.boundary_ahead(), left_mm, line };
        Some(match wanted {
            BackTargetKind::Pierce => TargetSearch::There(self.supply.pierce_before(place)?),
            BackTargetKind::By(mm) => {
                // What lies ahead of the cursor in its own record is not gone back over.
                let share = f64::from(place.fraction) / ONE as f64;
                let part = self.length(place.record).filter(|_| place.fraction != 0);
                on(mm + part.map_or(0.0, |length| length * (1.0 - share)), 0)
            }
            BackTargetKind::Block => {
                let last = self.supply.record(place.boundary_ahead().wrapping_sub(1));
                on(0.0, last.map_or(0, |record| record.line))
            }
        })
    }

    /// Length of a record in mm.
    fn length(&self, place: u32) -> Option<f64> {
        let record = self.supply.record(place)?;
        let axes = record.increments.iter().zip(&self.mm_per_pulse);
        Some(axes.map(|(&pulses, mm)| (f64::from(pulses) * mm).powi(2)).sum::<f64>().sqrt())
    }

    /// Looks for the place, if one is looked for: at some records, so that a control period is never long.
    pub(super) fn search_back(&mut self) {
        let Some(mut back) = self.back else { return };
        if matches!(back.search, TargetSearch::AtRest) && self.card.status().at_rest {
            match self.begin_search(back.wanted, self.card.status().place) {
                Some(search) => back.search = search,
                None => {
                    self.back = None;
                    self.tell(EventKind::CommandRejected(CommandError::NoPierce));
                    // It stands, and in this mode it would go on to the oldest record.
                    let _ = self.operation.apply(ModeCommand::Hold);
                    return;
                }
            }
        }
        if let TargetSearch::On { from, left_mm, line } = back.search {
            back.search = self.search_on(back.wanted, from, left_mm, line);
        }
        self.back = Some(back);
    }

    fn search_on(&self, wanted: BackTargetKind, from: u32, left_mm: f64, line: u32) -> TargetSearch {
        let (mut from, mut left_mm, oldest) = (from, left_mm, self.supply.oldest());
        for _ in 0..RECORDS_A_PERIOD {
            let last = from.wrapping_sub(1);
            let found = match wanted {
                // Sums of lengths are exact to a few of the last digits.
                BackTargetKind::By(mm) => left_mm <= 1e-9 * mm,
                _ => !is_before(last, oldest) && self.supply.record(last).is_none_or(|record| record.line != line),
            };
            if found {
                return TargetSearch::There(from);
            }
            if !is_before(oldest, from) {
                return TargetSearch::Beyond;
            }
            left_mm -= self.length(last).unwrap_or(0.0);
            from = last;
        }
        TargetSearch::On { from, left_mm, line }
    }
}
