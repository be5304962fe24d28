//! Entry of a tool length in a pause: the breakpoint and the path are moved along the tool axis.
//!
//! Invariant: the breakpoint is moved only when the planning thread has stored the length durably. No planned record
//! leaves the soft limits because of it; history that would leave them is barred.

use std::thread;
use std::time::Duration;

use retrace_config::MachineConfig;
use retrace_core::playback::partial_increment;
use retrace_core::{Place, RecordIndex};
use retrace_link::MotionCard;

use super::Session;
use crate::dnc_events::DncStep;
use crate::event::EventKind;
use crate::operator::CommandError;
use crate::tool_length::{EnteredLength, LengthAnswer, LengthEntry, LengthOffer, LengthProposal, ToolLengthError};

/// Progress of entering a tool length.
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
    soft_limits: [i64; 2],
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum EntryStage {
    Idle,
    /// A length is proposed to the planning thread.
    Proposed,
    /// The offer was accepted and is being stored.
    Decided(LengthOffer),
}

impl ToolLengthEntry {
    pub(super) fn new(machine: &MachineConfig) -> Self {
        let axis = machine.tool_axis().map(|index| {
            let axis = &machine.axes[index];
            let travel = axis.travel_mm.map(|mm| machine.counts_of(index, mm));
            ToolAxis { index, letter: axis.name, pulses_per_mm: axis.pulses_per_mm, soft_limits: travel }
        });
        Self { entry: None, axis, stage: EntryStage::Idle }
    }

    /// Whether a length is being entered.
    pub(super) fn is_open(&self) -> bool {
        self.stage != EntryStage::Idle
    }
}

impl<'r, const A: usize, C: MotionCard<A>> Session<'r, A, C> {
    /// Enables the entry of tool lengths.
    #[must_use]
    pub(crate) fn with_length_entry(mut self, entry: LengthEntry) -> Self {
        self.tool_length.entry = Some(entry);
        self
    }

    /// Requests from the planning thread what the length would change.
    pub(super) fn propose_tool_length(&mut self, length: EnteredLength) -> Result<(), CommandError> {
        // Checks whether a length may be entered at all.
        self.dnc.shift_breakpoint([0; A])?;
        if self.tool_length.axis.is_none_or(|axis| axis.index >= A) {
            return Err(CommandError::ToolLength(ToolLengthError::NoToolAxis));
        }
        let here = self.card.status().place;
        let place = self.dnc.breakpoint(here).map_or(here, |(_, place)| place).record;
        let entry = self.tool_length.entry.as_mut();
        let entry = entry.ok_or(CommandError::NotNow("a tool length cannot be entered here"))?;
        entry.propose(LengthProposal { length, place });
        self.tool_length.stage = EntryStage::Proposed;
        Ok(())
    }

    /// Advances the entry of a length.
    pub(super) fn watch_tool_length(&mut self) {
        while self.tool_length.is_open() {
            let answer = self.tool_length.entry.as_mut().and_then(LengthEntry::answer);
            match (answer, self.tool_length.stage) {
                (Some(LengthAnswer::Offer(offer)), EntryStage::Proposed) => self.decide_on_tool_length(offer),
                (Some(LengthAnswer::Stored), EntryStage::Decided(offer)) => {
                    self.tool_length.stage = EntryStage::Idle;
                    self.apply_tool_length(offer);
                }
                (Some(LengthAnswer::No(why)), _) => self.reject_tool_length(why),
                // In virtual time the result must not depend on how long that takes. A planner that is gone does not
                // answer.
                (None, _) if !self.config.run_mode.wall_time && !self.streamer.planner_is_gone() => {
                    self.streamer.poll_planner();
                    thread::sleep(Duration::from_micros(20));
                }
                _ => {
                    // While items wait for space, planning does not continue.
                    self.streamer.poll_planner();
                    return;
                }
            }
        }
    }

    fn reject_tool_length(&mut self, why: ToolLengthError) {
        self.tool_length.stage = EntryStage::Idle;
        self.emit(EventKind::CommandRejected(CommandError::ToolLength(why)));
    }

    /// Accepts an offer where no record of the ring that would be moved leaves the soft limits.
    fn decide_on_tool_length(&mut self, offer: LengthOffer) {
        let Some(axis) = self.tool_length.axis else { return };
        let fits =
            |count: i64| (axis.soft_limits[0]..=axis.soft_limits[1]).contains(&count.saturating_add(offer.pulses));
        let here = self.card.status().place;
        let all_fit = self.dnc.breakpoint(here).is_some_and(|(counts, place)| {
            fits(counts[axis.index]) && self.counts_ahead(axis.index, counts, place, offer.planned).all(fits)
        });
        if let Some(entry) = &mut self.tool_length.entry {
            entry.decide(all_fit);
        }
        if all_fit {
            self.tool_length.stage = EntryStage::Decided(offer);
        } else {
            self.reject_tool_length(ToolLengthError::BeyondLimit(axis.letter));
        }
    }

    /// Moves the breakpoint. History that would leave the soft limits is barred.
    fn apply_tool_length(&mut self, offer: LengthOffer) {
        let Some(axis) = self.tool_length.axis else { return };
        let here = self.card.status().place;
        let Some((counts, place)) = self.dnc.breakpoint(here) else { return };
        let mut moved = [0; A];
        moved[axis.index] = offer.pulses;
        // The length was permitted when it was proposed, and commands have waited since.
        if self.dnc.shift_breakpoint(moved).is_err() {
            return;
        }
        self.bar_beyond_limits(counts[axis.index].saturating_add(offer.pulses), place);
        self.emit_dnc_step(DncStep::ToolLength {
            axis: axis.letter,
            by_mm: offer.pulses as f64 / axis.pulses_per_mm,
            by_counts: offer.pulses,
            length_mm: offer.length_mm,
        });
    }

    /// Bars the history before a place from where the tool axis would leave its soft limits; the axis has this count at
    /// the place.
    pub(super) fn bar_beyond_limits(&mut self, count: i64, place: Place) {
        let Some(axis) = self.tool_length.axis.filter(|axis| axis.index < A) else { return };
        let is_within = |count: i64| (axis.soft_limits[0]..=axis.soft_limits[1]).contains(&count);
        let mut count = count.saturating_sub(self.pulses_into_record(axis.index, place));
        let mut barred = place.record;
        while is_within(count)
            && self.streamer.oldest().is_before(barred)
            && let Some(record) = self.streamer.record(barred - 1)
        {
            count -= i64::from(record.increments[axis.index]);
            barred -= 1;
        }
        if !is_within(count) {
            self.streamer.barrier_before(barred + 1, "the soft limit with the new tool length");
        }
    }

    /// Index of the tool axis.
    pub(super) fn tool_axis(&self) -> Option<usize> {
        self.tool_length.axis.map(|axis| axis.index).filter(|&index| index < A)
    }

    /// Pulses of an axis that are executed in the record of a place.
    fn pulses_into_record(&self, axis: usize, place: Place) -> i64 {
        let record = self.streamer.record(place.record);
        record.map_or(0, |record| i64::from(partial_increment(record.increments[axis], place.fraction)))
    }

    /// Counts of an axis behind each record from `place` up to `end`, where it has `counts` at `place`.
    fn counts_ahead(&self, axis: usize, counts: [i64; A], place: Place, end: RecordIndex) -> impl Iterator<Item = i64> {
        let mut count = counts[axis] - self.pulses_into_record(axis, place);
        let mut at = place.record;
        std::iter::from_fn(move || {
            let record = at.is_before(end).then(|| self.streamer.record(at))??;
            at += 1;
            count += i64::from(record.increments[axis]);
            Some(count)
        })
    }
}
