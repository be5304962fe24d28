//! A tool length that the operator enters in a pause: the breakpoint and the path are moved along the tool axis.
//!
//! Invariant: the breakpoint is moved only when the planning thread has kept the length, durably; no record that is planned leaves the soft
//! limits by it, and what lies behind the breakpoint is barred from where it would.

use std::thread;
use std::time::Duration;

use retrace_core::Place;
use retrace_core::place::is_before;
use retrace_core::playback::partial_increment;
use retrace_link::MotionCard;

use super::Session;
use crate::dnc_events::DncStep;
use crate::event::EventKind;
use crate::machine::MachineConfig;
use crate::operator::CommandError;
use crate::tool_length::{EnteredLength, LengthAnswer, LengthEntry, LengthOffer, LengthProposal, ToolLengthError};

/// How far entering a tool length is.
#[derive(Debug)]
pub(super) struct ToolLengthEntry {
    entry: Option<LengthEntry>,
    axis: Option<ToolAxis>,
    stage: EntryStage,
}

/// The tool axis.
#[derive(Clone, Copy, Debug)]
struct ToolAxis {
    index: usize,
    letter: char,
    pulses_per_mm: f64,
    /// Soft limits in counts.
    travel: [i64; 2],
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum EntryStage {
    Idle,
    /// A length is proposed.
    Proposed,
    /// This was decided for, and is being kept.
    Decided(LengthOffer),
}

impl ToolLengthEntry {
    pub(super) fn new(machine: &MachineConfig) -> Self {
        let axis = machine.tool_axis().map(|index| {
            let axis = &machine.axes[index];
            let travel = axis.travel_mm.map(|mm| machine.counts_of(index, mm));
            ToolAxis { index, letter: axis.name, pulses_per_mm: axis.pulses_per_mm, travel }
        });
        Self { entry: None, axis, stage: EntryStage::Idle }
    }

    /// Is a length being entered?
    pub(super) fn is_open(&self) -> bool {
        self.stage != EntryStage::Idle
    }
}

impl<'r, const A: usize, C: MotionCard<A>> Session<'r, A, C> {
    /// The same, with somebody who keeps tool lengths that are entered.
    #[must_use]
    pub(crate) fn entering_lengths(mut self, entry: LengthEntry) -> Self {
        self.tool_length.entry = Some(entry);
        self
    }

    /// Asks the planning thread what the length would come to.
    pub(super) fn propose_tool_length(&mut self, length: EnteredLength) -> Result<(), CommandError> {
        // Whether it may be entered at all.
        self.dnc.displace([0; A])?;
        if self.tool_length.axis.is_none_or(|axis| axis.index >= A) {
            return Err(CommandError::ToolLength(ToolLengthError::NoToolAxis));
        }
        let here = self.card.status().place;
        let place = self.dnc.breakpoint(here).map_or(here, |(_, place)| place).record;
        let entry = self.tool_length.entry.as_mut();
        let entry = entry.ok_or(CommandError::NotNow("nobody is there to plan with another tool length"))?;
        entry.propose(LengthProposal { length, place });
        self.tool_length.stage = EntryStage::Proposed;
        Ok(())
    }

    /// Goes on with a length that is being entered.
    pub(super) fn watch_tool_length(&mut self) {
        while self.tool_length.is_open() {
            let answer = self.tool_length.entry.as_mut().and_then(LengthEntry::answer);
            match (answer, self.tool_length.stage) {
                (Some(LengthAnswer::Offer(offer)), EntryStage::Proposed) => self.decide_tool_length(offer),
                (Some(LengthAnswer::Kept), EntryStage::Decided(offer)) => {
                    self.tool_length.stage = EntryStage::Idle;
                    self.take_tool_length(offer);
                }
                (Some(LengthAnswer::No(why)), _) => self.refuse_tool_length(why),
                // In virtual time it must not depend on how long that takes; a planner that is gone answers no more.
                (None, _) if !self.manner.wall_time && !self.supply.planner_gone() => {
                    self.supply.poll_planner();
                    thread::sleep(Duration::from_micros(20));
                }
                _ => {
                    // What waits for room among the items is planned no further.
                    self.supply.poll_planner();
                    return;
                }
            }
        }
    }

    fn refuse_tool_length(&mut self, why: ToolLengthError) {
        self.tool_length.stage = EntryStage::Idle;
        self.tell(EventKind::CommandRejected(CommandError::ToolLength(why)));
    }

    /// Takes an offer where nothing of the ring that would be moved leaves the soft limits.
    fn decide_tool_length(&mut self, offer: LengthOffer) {
        let Some(axis) = self.tool_length.axis else { return };
        let fits = |count: i64| (axis.travel[0]..=axis.travel[1]).contains(&count.saturating_add(offer.pulses));
        let here = self.card.status().place;
        let all_fit = self.dnc.breakpoint(here).is_some_and(|(counts, place)| {
            fits(counts[axis.index]) && self.ahead(axis.index, counts, place, offer.planned).all(fits)
        });
        if let Some(entry) = &mut self.tool_length.entry {
            entry.decide(all_fit);
        }
        if all_fit {
            self.tool_length.stage = EntryStage::Decided(offer);
        } else {
            self.refuse_tool_length(ToolLengthError::BeyondLimit(axis.letter));
        }
    }

    /// The breakpoint is moved; what lies so far behind that it would leave the soft limits is barred.
    fn take_tool_length(&mut self, offer: LengthOffer) {
        let Some(axis) = self.tool_length.axis else { return };
        let here = self.card.status().place;
        let Some((counts, place)) = self.dnc.breakpoint(here) else { return };
        let mut moved = [0; A];
        moved[axis.index] = offer.pulses;
        // It was allowed when it was proposed, and words wait since.
        if self.dnc.displace(moved).is_err() {
            return;
        }
        self.bar_beyond_limits(counts[axis.index].saturating_add(offer.pulses), place);
        self.tell_step(DncStep::ToolLength {
            axis: axis.letter,
            by_mm: offer.pulses as f64 / axis.pulses_per_mm,
            by_counts: offer.pulses,
            length_mm: offer.length_mm,
        });
    }

    /// Bars what lies so far behind a place that the tool axis would leave its soft limits there; it has this count at the place.
    pub(super) fn bar_beyond_limits(&mut self, count: i64, place: Place) {
        let Some(axis) = self.tool_length.axis.filter(|axis| axis.index < A) else { return };
        let is_within = |count: i64| (axis.travel[0]..=axis.travel[1]).contains(&count);
        let mut count = count.saturating_sub(self.gone_into(axis.index, place));
        let mut barred = place.record;
        while is_within(count)
            && is_before(self.supply.oldest(), barred)
            && let Some(record) = self.supply.record(barred.wrapping_sub(1))
        {
            count -= i64::from(record.increments[axis.index]);
            barred = barred.wrapping_sub(1);
        }
        if !is_within(count) {
            self.supply.barrier_before(barred.wrapping_add(1), "the soft limit with the new tool length");
        }
    }

    /// The index of the tool axis.
    pub(super) fn tool_axis(&self) -> Option<usize> {
        self.tool_length.axis.map(|axis| axis.index).filter(|&index| index < A)
    }

    /// How far an axis has gone in the record of a place.
    fn gone_into(&self, axis: usize, place: Place) -> i64 {
        let record = self.supply.record(place.record);
        record.map_or(0, |record| i64::from(partial_increment(record.increments[axis], place.fraction)))
    }

    /// The counts of an axis behind each record from `place` up to `end`, where it has `counts` at `place`.
    fn ahead(&self, axis: usize, counts: [i64; A], place: Place, end: u32) -> impl Iterator<Item = i64> {
        let mut count = counts[axis] - self.gone_into(axis, place);
        let mut at = place.record;
        std::iter::from_fn(move || {
            let record = is_before(at, end).then(|| self.supply.record(at))??;
            at = at.wrapping_add(1);
            count += i64::from(record.increments[axis]);
            Some(count)
        })
    }
}
