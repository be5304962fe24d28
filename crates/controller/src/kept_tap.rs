//! A rigid tap in which the card still holds the tool, where its job is resumed (SPN-25).
//!
//! Invariant: the tool is where the tap's records have it at the card's place, to the pulse.

use retrace_config::MachineConfig;
use retrace_core::RecordIndex;
use retrace_core::playback::partial_increment;
use retrace_link::{CardStatus, GearState, channel};

use crate::tap_move::TapQuestion;

/// A tap that the card has kept: it follows the spindle there, which is switched off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KeptTap {
    /// The tap.
    pub question: TapQuestion,
    /// Where it begins on the card's path of manual moves.
    pub first: RecordIndex,
    /// Line of the program.
    pub line: u32,
}

impl KeptTap {
    /// The tap that begins with this record of the card's path, at these counts. `None` where the card does not hold
    /// the tool in it any more.
    pub(crate) fn of_card<const A: usize>(
        question: TapQuestion,
        (first, begins): (RecordIndex, [i64; A]),
        machine: &MachineConfig,
        card: &CardStatus<A>,
        line: u32,
    ) -> Option<Self> {
        let encoder = machine.encoder.as_ref()?;
        let plan = question.tap.plan::<A>(machine, encoder).ok().filter(|plan| plan.gear == question.gear)?;
        let within = usize::try_from(first.records_to(card.place.record)).ok()?;
        let (before, under) = (plan.records.get(..within)?, plan.records.get(within));
        let counts: [i64; A] = std::array::from_fn(|axis| {
            let whole: i64 = before.iter().map(|record| i64::from(record.increments[axis])).sum();
            let part = under.map_or(0, |record| partial_increment(record.increments[axis], card.place.fraction));
            begins[axis] + whole + i64::from(part)
        });
        let is_off = card.outputs[usize::from(channel::SPINDLE)] == 0;
        let is_kept = card.spindle.gear == GearState::Engaged && card.at_rest && is_off && card.counts == counts;
        is_kept.then_some(Self { question, first, line })
    }
}
