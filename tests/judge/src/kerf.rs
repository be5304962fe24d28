//! What a trace cuts: cells of the sheet, and places of the path.
//!
//! Invariant: the cutter burns while its output is on and its input is active; the judge has no other knowledge of it.

use crate::place_ranges::PlaceRanges;
use crate::vcd::Sample;
use std::collections::HashSet;

/// Width of a cell of the sheet in mm.
pub(crate) const CELL_MM: f64 = 0.05;

/// What was cut of the sheet.
#[derive(Debug, Default)]
pub(crate) struct Kerf {
    /// Cells that the middle of the kerf touches.
    cells: HashSet<[i32; 2]>,
    /// Cells that lead-ins touch.
    lead_in_cells: HashSet<[i32; 2]>,
    /// Where the cutter burnt for certain: from a proven sample to the next one.
    pub(crate) places: PlaceRanges,
    /// Where it may have burnt: it begins and ends somewhere between two samples.
    pub(crate) possible_places: PlaceRanges,
    /// Where the cutter was on in motion, from its ignition until it burnt or went off.
    tried_places: PlaceRanges,
    /// Whether it is on and has not burnt since its ignition.
    is_trying: bool,
    /// Length in mm, with what was cut twice.
    pub(crate) length_mm: f64,
}

impl Kerf {
    /// Adds the way between two samples.
    pub(crate) fn add(&mut self, from: &Sample, to: &Sample, plane: [usize; 2], pulses_per_mm: f64) {
        let [burns, will_burn] = [from, to].map(|sample| sample.is_lit && sample.is_proven);
        if burns || will_burn {
            self.possible_places.insert(from.place, to.place);
        }
        self.follow_ignition(from, to);
        if self.is_trying && from.is_lit {
            self.tried_places.insert(from.place, to.place);
        }
        if !from.is_lit || !from.is_proven || !to.is_proven {
            return;
        }
        self.places.insert(from.place, to.place);
        self.length_mm += add_cells(&mut self.cells, from, to, plane, pulses_per_mm);
    }

    /// Adds the way between two samples on a lead-in.
    pub(crate) fn add_lead_in(&mut self, from: &Sample, to: &Sample, plane: [usize; 2], pulses_per_mm: f64) {
        self.follow_ignition(from, to);
        if from.is_lit && from.is_proven && to.is_proven {
            self.length_mm += add_cells(&mut self.lead_in_cells, from, to, plane, pulses_per_mm);
        }
    }

    /// Follows whether the cutter was ignited and has not burnt since.
    fn follow_ignition(&mut self, from: &Sample, to: &Sample) {
        self.is_trying = from.is_lit && self.is_trying && !from.is_proven || !from.is_lit && to.is_lit;
    }

    /// Whether the cutter was on all along this stretch without burning, since it was ignited before it.
    pub(crate) fn is_tried(&self, [from, to]: [f64; 2]) -> bool {
        let mut stretch = PlaceRanges::default();
        stretch.insert(from, to);
        stretch.missing_in(&self.tried_places).is_empty()
    }

    /// Number of cells that have no cell of the other kerf at or beside them: where a job is slower, other cells are
    /// touched at their corners.
    pub(crate) fn cells_beside(&self, other: &Self) -> usize {
        let is_cut = |cell: &[i32; 2]| other.cells.contains(cell) || other.lead_in_cells.contains(cell);
        let is_near = |[x, y]: [i32; 2]| (-1..=1).any(|dx| (-1..=1).any(|dy| is_cut(&[x + dx, y + dy])));
        self.cells.iter().filter(|&&cell| !is_near(cell)).count()
    }
}

/// Adds the cells between two samples, and returns the length in mm.
fn add_cells(cells: &mut HashSet<[i32; 2]>, from: &Sample, to: &Sample, plane: [usize; 2], pulses_per_mm: f64) -> f64 {
    // in pulses, so that a place on the edge of a cell is always in the same one
    let cell = CELL_MM * pulses_per_mm;
    let [x, y] = plane.map(|axis| from.counts[axis] as f64);
    let [dx, dy] = plane.map(|axis| (to.counts[axis] - from.counts[axis]) as f64);
    let length = dx.hypot(dy);
    let steps = (length / cell * 4.0).ceil().max(1.0);
    for step in 0..=steps as u32 {
        let share = f64::from(step) / steps;
        cells.insert([x + share * dx, y + share * dy].map(|pulses| (pulses / cell).floor() as i32));
    }
    length / pulses_per_mm
}
