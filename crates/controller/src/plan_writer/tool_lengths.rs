//! Tool lengths that are entered in a pause: what the planning thread decides and stores.
//!
//! Invariant: a stored length applies from behind the current block on, so that planning again gives the same path; a
//! path that was moved ends at rest.

use retrace_core::RecordIndex;
use std::collections::VecDeque;

use retrace_config::MachineConfig;
use retrace_journal::{IndexEntry, LengthChange};

use super::{Cancelled, PlanWriter};
use crate::soft_limits::passed_limit;
use crate::tool_length::{EnteredLength, LengthAnswer, LengthOffer, LengthOffers, LengthProposal, ToolLengthError};

/// Place at which a path that was moved along the tool axis had to end last, moved or not.
#[derive(Clone, Copy, Debug)]
pub(super) enum Planned {
    /// No record behind the move with that serial number is in the ring yet.
    Waiting {
        /// The move to machine coordinates, or the last one before another tool or offset.
        serial: u32,
    },
    /// The moves behind it begin at this place.
    Until(RecordIndex),
}

/// Tool lengths that are entered in a pause.
#[derive(Debug, Default)]
pub(super) struct Lengths {
    pub(super) offers: Option<LengthOffers>,
    /// Lengths that were entered when the job ran before, in the order of the blocks.
    pub(super) replayed_changes: VecDeque<LengthChange>,
    /// The path is moved by this number of pulses along the tool axis from here on; no move includes it yet.
    pub(super) moved_by: i64,
    /// The tool length offset in force, mm.
    pub(super) length_mm: Option<f64>,
    /// Place at which a moved path had to end last.
    pub(super) last_end: Option<Planned>,
    /// Whether the current block has such a move.
    pub(super) block_has_end: bool,
}

impl<const A: usize> PlanWriter<'_, A> {
    /// Distance along the tool axis between the machine and the program's position, because of tool lengths that were
    /// entered: axis and mm.
    #[must_use]
    pub fn moved_by(&self) -> Option<(usize, f64)> {
        let machine = self.machine?;
        let tool = machine.tool_axis().filter(|&tool| tool < A)?;
        (self.lengths.moved_by != 0).then(|| (tool, machine.axes[tool].mm_of(self.lengths.moved_by)))
    }

    /// Sets the tool length offset that is in force for the moves to come, mm along the tool axis.
    pub fn set_tool_length(&mut self, length_mm: Option<f64>) {
        self.lengths.length_mm = length_mm;
    }

    /// Sets whether the current block has a move before which a path that was moved along the tool axis ends.
    pub fn set_block_has_end(&mut self, has: bool) {
        self.lengths.block_has_end = has;
    }

    /// Ends a path that was moved along the tool axis: it rests, and planning continues from the machine's position
    /// then. Returns by how much it was moved: axis and mm. `is_move`: the next move goes to machine coordinates.
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

    /// Answers a proposal of a tool length.
    pub(super) fn answer_proposal(&mut self) -> Result<(), Cancelled> {
        let Some(mut offers) = self.lengths.offers.take() else { return Ok(()) };
        let taken = match offers.proposal() {
            None => Ok(()),
            Some(proposal) => match self.make_offer(&proposal) {
                Err(why) => {
                    offers.answer(LengthAnswer::No(why));
                    Ok(())
                }
                Ok(offer) => self.store_length(&mut offers, offer),
            },
        };
        self.lengths.offers = Some(offers);
        taken
    }

    /// Waits for the decision. A length that is accepted is stored before it is confirmed.
    fn store_length(&mut self, offers: &mut LengthOffers, offer: LengthOffer) -> Result<(), Cancelled> {
        offers.answer(LengthAnswer::Offer(offer));
        let is_taken = self.wait_for(|_| offers.decision())?;
        if is_taken {
            self.lengths.moved_by += offer.pulses;
            self.index.write(IndexEntry::Length(LengthChange { block: self.block, pulses: offer.pulses }));
            self.wait_for(|feeder| feeder.index.is_durable().then_some(()))?;
            offers.answer(LengthAnswer::Stored);
        }
        Ok(())
    }

    /// Effect of entering a length, as far as the plan goes.
    fn make_offer(&self, proposal: &LengthProposal) -> Result<LengthOffer, ToolLengthError> {
        let tool = |machine: &MachineConfig| machine.tool_axis().filter(|&tool| tool < A);
        let (machine, tool) = self.machine.and_then(|m| Some((m, tool(m)?))).ok_or(ToolLengthError::NoToolAxis)?;
        let axis = &machine.axes[tool];
        let further_mm = axis.mm_of(self.lengths.moved_by);
        let length_mm = self.lengths.length_mm.map(|length_mm| length_mm + further_mm);
        let by_mm = match proposal.length {
            EnteredLength::By(mm) => mm,
            EnteredLength::To(mm) => mm - length_mm.ok_or(ToolLengthError::NoOffset)?,
        };
        let is_planned = match self.lengths.last_end {
            _ if self.lengths.block_has_end => true,
            None => false,
            // Where everything that exists is planned, the place behind it is the end of the ring.
            Some(Planned::Waiting { .. }) => !self.origins.is_empty() || proposal.place.is_before(self.ring.write()),
            Some(Planned::Until(place)) => proposal.place.is_before(place),
        };
        if is_planned {
            return Err(ToolLengthError::Planned);
        }
        let pulses = axis.pulses_of(by_mm);
        let moved_mm = further_mm + axis.mm_of(pulses);
        let leaves = |mm: &f64| passed_limit(axis, mm + moved_mm).is_some();
        if self.origins.iter().any(|origin| origin.reach_mm.iter().any(leaves)) {
            return Err(ToolLengthError::BeyondLimit(axis.name));
        }
        Ok(LengthOffer { pulses, planned: self.ring.write(), length_mm: length_mm.map(|length_mm| length_mm + by_mm) })
    }
}
