//! Outputs that the program expects along its path, shown next to their actual state where the machine has gone back.
//!
//! Invariant: only switching by the program counts, not by the operator, a restart or the card; the oldest changes are
//! dropped when the store is full.

use retrace_core::RecordIndex;
use std::collections::{BTreeMap, VecDeque};

/// Maximum number of stored changes.
const MAX_CHANGES: usize = 4096;

/// Change of an output by the program.
#[derive(Clone, Copy, Debug)]
struct ProgramChange {
    /// Record before which the change takes place.
    place: RecordIndex,
    channel: u8,
    from: i32,
    to: i32,
}

/// Outputs of the program at the cursor.
#[derive(Clone, Debug, Default)]
pub(crate) struct ProgramOutputs {
    changes: VecDeque<ProgramChange>,
    /// Number of changes behind the cursor.
    passed: usize,
    here: BTreeMap<u8, i32>,
    /// Whether an instruction of the program is in execution, or was completed in this period.
    is_switching: bool,
    is_complete: bool,
}

impl ProgramOutputs {
    /// Outputs at the start.
    #[must_use]
    pub(crate) fn from(outputs: &BTreeMap<u8, i32>) -> Self {
        Self { here: outputs.clone(), ..Self::default() }
    }

    /// An instruction of the program begins: changes until it is complete are the program's.
    pub(crate) fn begin_instruction(&mut self) {
        (self.is_switching, self.is_complete) = (true, false);
    }

    /// The instruction is complete; changes in this period still belong to it.
    pub(crate) fn complete_instruction(&mut self) {
        self.is_complete = true;
    }

    /// An output changed, for any reason, with the cursor at this record.
    pub(crate) fn output_changed(&mut self, place: RecordIndex, channel: u8, value: i32) {
        if self.is_switching {
            self.push_change(place, channel, value);
        }
    }

    /// The program switched an output before this record, which is the furthest.
    pub(crate) fn push_change(&mut self, place: RecordIndex, channel: u8, value: i32) {
        let from = self.here.insert(channel, value).unwrap_or(0);
        if self.changes.len() >= MAX_CHANGES {
            self.changes.pop_front();
            self.passed = self.passed.saturating_sub(1);
        }
        self.changes.push_back(ProgramChange { place, channel, from, to: value });
        self.passed = self.changes.len();
    }

    /// Ends a period with the cursor in this record. Returns the outputs there.
    pub(crate) fn outputs_at(&mut self, place: RecordIndex) -> &BTreeMap<u8, i32> {
        if self.is_complete {
            (self.is_switching, self.is_complete) = (false, false);
        }
        while let Some(change) = self.passed.checked_sub(1).and_then(|last| self.changes.get(last))
            && place.is_before(change.place)
        {
            self.here.insert(change.channel, change.from);
            self.passed -= 1;
        }
        while let Some(change) = self.changes.get(self.passed)
            && !place.is_before(change.place)
        {
            self.here.insert(change.channel, change.to);
            self.passed += 1;
        }
        &self.here
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_outputs_of_the_program_are_found_again_on_the_way_back() {
        let mut outputs = ProgramOutputs::from(&BTreeMap::from([(7, 1)]));
        outputs.begin_instruction();
        outputs.output_changed(RecordIndex::new(10), 3, 1);
        outputs.complete_instruction();
        outputs.outputs_at(RecordIndex::new(10));
        // The card or the operator switches it off and on: that is not the program.
        outputs.output_changed(RecordIndex::new(12), 3, 0);
        outputs.push_change(RecordIndex::new(20), 3, 0);
        let at = |outputs: &mut ProgramOutputs, place| outputs.outputs_at(place).get(&3).copied().unwrap_or(0);
        assert_eq!([25, 15, 5, 12, 20, 4].map(|place| at(&mut outputs, RecordIndex::new(place))), [0, 1, 0, 1, 0, 0]);
        assert_eq!(outputs.outputs_at(RecordIndex::new(30)).get(&7), Some(&1));
    }

    #[test]
    fn what_is_kept_is_bounded() {
        let mut outputs = ProgramOutputs::default();
        for place in 0..3 * MAX_CHANGES as u32 {
            outputs.push_change(RecordIndex::new(place), 1, i32::from(place % 2 == 0));
        }
        assert_eq!(outputs.changes.len(), MAX_CHANGES);
        outputs.outputs_at(RecordIndex::new(0));
        assert_eq!(outputs.outputs_at(RecordIndex::new(3 * MAX_CHANGES as u32)).get(&1), Some(&0));
    }
}
