//! Tool lengths that are entered in a pause, as far as the planning thread decides and keeps them.
//!
//! Invariant: what is kept holds from behind the block in hand on, so that planning again comes to the same; a path that was moved ends
//! at rest.

use std::collections::VecDeque;

use retrace_core::place::is_before;

use super::{Cancelled, PlanWriter};
use crate::limit_check::passed_limit;
use crate::machine::MachineConfig;
use crate::place_index::IndexEntry;
use crate::tool_length::{
    EnteredLength, LengthAnswer, LengthChange, LengthOffer, LengthOffers, LengthProposal, ToolLengthError,
};

/// Where a path that was moved along the tool axis had to end last, moved or not.
#[derive(Clone, Copy, Debug)]
pub(super) enum Planned {
    /// No record behind the move with that serial number is in the ring.
    Waiting {
        /// The move to machine coordinates, or the last one before another tool or offset.
        serial: u32,
    },
    /// The moves behind it begin at this place.
    Until(u32),
}

/// Tool lengths that are entered in a pause.
#[derive(Debug, Default)]
pub(super) struct Lengths {
    pub(super) offers: Option<LengthOffers>,
    /// What was entered when the job ran before, in the order of the blocks.
    pub(super) again: VecDeque<LengthChange>,
    /// The path is moved by so many pulses along the tool axis from here on, and no move says so yet.
    pub(super) moved_by: i64,
    /// The tool length offset in force, mm.
    pub(super) length_mm: Option<f64>,
    /// Where a moved path had to end last.
    pub(super) last_end: Option<Planned>,
    /// The block in hand has such a move.
    pub(super) in_block: bool,
}

impl<const A: usize> PlanWriter<'_, A> {
    /// How far along the tool axis the machine stands from where the program believes, because of tool lengths that were entered: axis and mm.
    #[must_use]
    pub fn moved_by(&self) -> Option<(usize, f64)> {
        let machine = self.machine?;
        let tool = machine.tool_axis().filter(|&tool| tool < A)?;
        (self.lengths.moved_by != 0).then(|| (tool, self.lengths.moved_by as f64 / machine.axes[tool].pulses_per_mm))
    }

    /// The tool length offset that is in force for the moves to come, mm along the tool axis.
    pub fn set_tool_length(&mut self, length_mm: Option<f64>) {
        self.lengths.length_mm = length_mm;
    }

    /// Does the block in hand have a move before which a path that was moved along the tool axis ends?
    pub fn has_end_of_length(&mut self, has: bool) {
        self.lengths.in_block = has;
    }

    /// A path that was moved along the tool axis ends here: it rests, and is planned on from where the machine then stands. By how much it
    /// was moved: axis and mm. `is_move`: the next move goes to machine coordinates.
    ///
    /// # Errors
    /// [`Cancelled`]
    pub fn end_length(&mut self, is_move: bool) -> Result<Option<(usize, f64)>, Cancelled> {
        let moved = self.moved_by();
        if let Some((tool, _)) = moved {
            self.rest()?;
            let mut pulses = [0; A];
            pulses[tool] = std::mem::take(&mut self.lengths.moved_by);
            let is_at_rest = self.planner.displace(pulses);
            debug_assert!(is_at_rest, "rest() takes every record out");
        }
        self.lengths.last_end = Some(Planned::Waiting { serial: self.serial.wrapping_add(is_move.into()) });
        Ok(moved)
    }

    /// Answers whoever wants to enter a tool length.
    pub(super) fn take_length(&mut self) -> Result<(), Cancelled> {
        let Some(mut offers) = self.lengths.offers.take() else { return Ok(()) };
        let taken = match offers.proposal() {
            None => Ok(()),
            Some(proposal) => match self.offer(&proposal) {
                Err(why) => {
                    offers.answer(LengthAnswer::No(why));
                    Ok(())
                }
                Ok(offer) => self.keep_length(&mut offers, offer),
            },
        };
        self.lengths.offers = Some(offers);
        taken
    }

    /// Waits for the decision; what is taken is kept before anything is said of it.
    fn keep_length(&mut self, offers: &mut LengthOffers, offer: LengthOffer) -> Result<(), Cancelled> {
        offers.answer(LengthAnswer::Offer(offer));
        let is_taken = self.wait_for(|_| offers.decision())?;
        if is_taken {
            self.lengths.moved_by += offer.pulses;
            self.index.note(IndexEntry::Length(LengthChange { block: self.block, pulses: offer.pulses }));
            self.wait_for(|feeder| feeder.index.is_durable().then_some(()))?;
            offers.answer(LengthAnswer::Kept);
        }
        Ok(())
    }

    /// What entering a length would come to, as far as the plan goes.
    fn offer(&self, proposal: &LengthProposal) -> Result<LengthOffer, ToolLengthError> {
        let tool = |machine: &MachineConfig| machine.tool_axis().filter(|&tool| tool < A);
        let (machine, tool) = self.machine.and_then(|m| Some((m, tool(m)?))).ok_or(ToolLengthError::NoToolAxis)?;
        let axis = &machine.axes[tool];
        let further_mm = self.lengths.moved_by as f64 / axis.pulses_per_mm;
        let length_mm = self.lengths.length_mm.map(|length_mm| length_mm + further_mm);
        let by_mm = match proposal.length {
            EnteredLength::By(mm) => mm,
            EnteredLength::To(mm) => mm - length_mm.ok_or(ToolLengthError::NoOffset)?,
        };
        let is_planned = match self.lengths.last_end {
            _ if self.lengths.in_block => true,
            None => false,
            // Where everything is planned that there is, the place behind it is where the ring ends.
            Some(Planned::Waiting { .. }) => !self.origins.is_empty() || is_before(proposal.place, self.ring.write()),
            Some(Planned::Until(place)) => is_before(proposal.place, place),
        };
        if is_planned {
            return Err(ToolLengthError::Planned);
        }
        let pulses = (by_mm * axis.pulses_per_mm).round() as i64;
        let moved_mm = further_mm + pulses as f64 / axis.pulses_per_mm;
        let leaves = |mm: &f64| passed_limit(axis, mm + moved_mm).is_some();
        if self.origins.iter().any(|origin| origin.reach_mm.iter().any(leaves)) {
            return Err(ToolLengthError::BeyondLimit(axis.name));
        }
        Ok(LengthOffer { pulses, planned: self.ring.write(), length_mm: length_mm.map(|length_mm| length_mm + by_mm) })
    }
}
