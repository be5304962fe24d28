//! The path as it was executed, for a program whose plan is not known as a whole: a stream, or a job that begins inside
//! its program.
//!
//! Invariant: it has the furthest place of each record once, whatever was retraced in between.

use crate::contour_records::ContourRecords;
use crate::planned_path::{PathKind, PathVertex, PlannedPath, Thinning};

/// Largest deviation from the positions that were observed, µm.
const TOLERANCE_UM: f64 = 5.0;

/// Maximum number of vertices; what is executed behind them is not recorded.
const MAX_VERTICES: usize = 2_000_000;

/// Recorder of an executed path.
#[derive(Clone, Debug)]
pub struct ExecutedPath {
    vertices: Vec<PathVertex>,
    lines: Vec<(u32, u32)>,
    contours: ContourRecords,
    thinning: Thinning,
    pending: Option<PathVertex>,
}

impl Default for ExecutedPath {
    fn default() -> Self {
        Self {
            vertices: Vec::new(),
            lines: Vec::new(),
            contours: ContourRecords::default(),
            thinning: Thinning::new(TOLERANCE_UM),
            pending: None,
        }
    }
}

impl ExecutedPath {
    /// Adds a position, in µm, with the number of records executed there, their line, and the number of their contour,
    /// 0 for none. One that is not further on the path than the last is left out.
    pub fn push(&mut self, at_um: [i32; 3], record: u32, kind: PathKind, line: u32, contour: u32) {
        let last = self.pending.map(|pending| pending.record);
        if last.is_some_and(|last| record <= last) || self.vertices.len() >= MAX_VERTICES {
            return;
        }
        if self.lines.last().is_none_or(|&(_, before)| before != line) {
            self.lines.push((last.unwrap_or(0), line));
        }
        self.contours.add(contour, [last.unwrap_or(record), record]);
        let vertex = PathVertex { at_um, record, kind };
        let before = self.pending.replace(vertex);
        if self.thinning.push(vertex, 0).is_some() {
            self.vertices.push(before.unwrap_or(vertex));
        }
    }

    /// Number of vertices so far.
    #[must_use]
    pub fn vertices(&self) -> usize {
        self.vertices.len()
    }

    /// The path so far.
    #[must_use]
    pub fn path(&self) -> PlannedPath {
        let records = self.pending.map_or(0, |pending| pending.record);
        let vertices = self.vertices.iter().copied().chain(self.pending);
        PlannedPath::from_parts(vertices.collect(), self.lines.clone(), records, self.contours.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_corner_is_kept_and_what_is_retraced_is_recorded_once() {
        let mut executed = ExecutedPath::default();
        for record in 0..=100 {
            executed.push([record as i32 * 50, 0, 0], record, PathKind::Feed, 3, 0);
        }
        // Back, and forward again.
        executed.push([2_000, 0, 0], 40, PathKind::Feed, 3, 0);
        for record in 40..=200 {
            let at_um = [5_000.min(record as i32 * 50), (record as i32 - 100).max(0) * 50, 0];
            executed.push(at_um, record, PathKind::Cutting, if record > 100 { 4 } else { 3 }, 7);
        }
        let path = executed.path();
        let places: Vec<_> = path.vertices().iter().map(|vertex| (vertex.record, vertex.at_um)).collect();
        assert_eq!(places, [(0, [0, 0, 0]), (100, [5_000, 0, 0]), (200, [5_000, 5_000, 0])]);
        assert_eq!((path.records(), path.line_of(50), path.line_of(150)), (200, Some(3), Some(4)));
        assert_eq!([6, 7].map(|number| path.records_of_contour(number)), [None, Some([100, 200])]);
    }
}
