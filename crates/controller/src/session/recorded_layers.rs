//! The layer at each record at which a cutter burnt: a start in motion there needs no sensing (CUT-54, CUT-55).
//!
//! Invariant: a record that was not cut since it was planned, or before the sheet or the tool may have moved, has no
//! layer. Nothing allocates after the start.

use retrace_config::MachineConfig;
use retrace_core::RecordIndex;
use retrace_core::size::ring_cells;

/// No layer: beyond any that a card has.
const NONE: i32 = i32::MIN;

/// Most records between two control periods of a job; a job that is resumed begins elsewhere.
const MAX_STEP: usize = 1024;

/// Layers beside the ring, 4 bytes a record.
#[derive(Clone, Debug)]
pub(super) struct RecordedLayers {
    /// As many as the ring has cells; none where every start senses the sheet.
    layers: Box<[i32]>,
    /// First record that was not reached yet.
    next: RecordIndex,
    /// First record whose layer counts.
    valid_from: RecordIndex,
}

impl RecordedLayers {
    /// Creates them for a job that begins at this record.
    pub(super) fn new(machine: &MachineConfig, begin: RecordIndex) -> Self {
        let skips_sensing = machine.tool_layer().is_some_and(|layer| layer.sensing().skip_mm > 0.0);
        let cells = ring_cells(machine.history_records, machine.look_ahead_records).filter(|_| skips_sensing);
        Self { layers: vec![NONE; cells.unwrap_or(0) as usize].into(), next: begin, valid_from: begin }
    }

    /// Records that the machine was at the record `here`, and that a cutter burnt with this layer since `cut_from`.
    pub(super) fn record(&mut self, here: RecordIndex, cut_from: Option<RecordIndex>, layer: i32) {
        if self.layers.is_empty() {
            return;
        }
        if here.since(self.next) as usize >= MAX_STEP.min(self.layers.len()) && !here.is_before(self.next) {
            (self.next, self.valid_from) = (here, here);
        }
        while !here.is_before(self.next) {
            *self.cell(self.next) = NONE;
            self.next += 1;
        }
        let mut record = cut_from.unwrap_or(here);
        while cut_from.is_some() && !here.is_before(record) {
            *self.cell(record) = layer;
            record += 1;
        }
    }

    /// Forgets all of them: the sheet or the tool may have moved.
    pub(super) fn forget(&mut self) {
        self.valid_from = self.next;
    }

    /// Returns the layer with which this record was cut.
    pub(super) fn at(&self, record: RecordIndex) -> Option<i32> {
        let is_kept = record.is_before(self.next) && self.next.since(record) as usize <= self.layers.len();
        let cell = self.layers.get(record.number() as usize & self.layers.len().wrapping_sub(1));
        cell.copied().filter(|&layer| is_kept && !record.is_before(self.valid_from) && layer != NONE)
    }

    fn cell(&mut self, record: RecordIndex) -> &mut i32 {
        let mask = self.layers.len() - 1;
        &mut self.layers[record.number() as usize & mask]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layers(cells: usize, begin: u32) -> RecordedLayers {
        let begin = RecordIndex::new(begin);
        RecordedLayers { layers: vec![NONE; cells].into(), next: begin, valid_from: begin }
    }

    #[test]
    fn a_record_has_the_layer_with_which_it_was_cut_last() {
        // The numbers of the records wrap around.
        let begin = u32::MAX - 3;
        let at = |n: u32| RecordIndex::new(begin.wrapping_add(n));
        let mut of = layers(16, begin);
        of.record(at(2), None, 7);
        of.record(at(4), Some(at(2)), 8);
        of.record(at(6), Some(at(5)), 9);
        let all = |of: &RecordedLayers| [0, 1, 2, 3, 4, 5, 6, 7].map(|n| of.at(at(n)));
        assert_eq!(all(&of), [None, None, Some(8), Some(8), Some(8), Some(9), Some(9), None]);
        // Back, and cut again from within: what is beyond keeps its layer.
        of.record(at(3), None, 0);
        of.record(at(4), Some(at(3)), 5);
        assert_eq!(all(&of), [None, None, Some(8), Some(5), Some(5), Some(9), Some(9), None]);
        // A round of the ring later the old ones are gone, cut or not.
        of.record(at(19), Some(at(18)), 4);
        assert_eq!([3, 4, 5, 17, 18, 19].map(|n| of.at(at(n))), [None, Some(5), Some(9), None, Some(4), Some(4)]);
        of.record(at(30), None, 0);
        assert_eq!((5..18).find(|&n| of.at(at(n)).is_some()), None);
        assert_eq!(of.at(at(18)), Some(4));
        of.forget();
        assert_eq!(of.at(at(18)), None);
        of.record(at(18), Some(at(18)), 3);
        assert_eq!(of.at(at(18)), None, "it was planned before");
        of.record(at(31), Some(at(31)), 2);
        assert_eq!(of.at(at(31)), Some(2));
    }

    #[test]
    fn where_every_start_senses_nothing_is_recorded() {
        let mut of = layers(0, 0);
        of.record(RecordIndex::new(5), Some(RecordIndex::new(0)), 1);
        assert_eq!(of.at(RecordIndex::new(3)), None);
    }
}
