//! The planned path of a program for a drawing: the positions of its records, thinned, each with its record number.
//!
//! Invariant: every position that is left out lies within the tolerance, in each axis, of a point on the line between
//! the vertices around it. A vertex keeps its record number in every level of detail, so that what is executed,
//! retraced or to come is a comparison of numbers.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use retrace_config::MachineConfig;
use retrace_core::{Flags, Record};

use crate::contour_records::ContourRecords;
use crate::path_profile::PathProfile;

/// Largest deviation of the full path from the positions of the records, µm.
const TOLERANCE_UM: f64 = 2.0;

/// Time after which the first part of a long path is shown.
const FIRST_PART: Duration = Duration::from_millis(200);

/// Maximum number of vertices; a longer path is thinned to a larger tolerance, so that its memory is bounded.
const MAX_VERTICES: usize = 8_000_000;

/// Kind of the motion that ends at a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum PathKind {
    /// A rapid move.
    Rapid = 0,
    /// A move at feed with no cutter on.
    Feed = 1,
    /// A move at feed with a cutter on.
    Cutting = 2,
}

/// A point of the planned path, and the motion that ends there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PathVertex {
    /// Machine position in X, Y and Z, µm; 0 for an axis that the machine does not have.
    pub at_um: [i32; 3],
    /// Number of records executed when the machine is there, from the beginning of the program.
    pub record: u32,
    /// Kind of the motion from the vertex before.
    pub kind: PathKind,
}

/// The planned path of a program.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlannedPath {
    vertices: Vec<PathVertex>,
    /// First record of each run of records of one line, with the line.
    lines: Vec<(u32, u32)>,
    records: u32,
    contours: ContourRecords,
    profile: PathProfile,
}

impl PlannedPath {
    /// Path of these vertices, lines and contours, without a profile.
    pub(crate) fn from_parts(
        vertices: Vec<PathVertex>,
        lines: Vec<(u32, u32)>,
        records: u32,
        contours: ContourRecords,
    ) -> Self {
        Self { vertices, lines, records, contours, profile: PathProfile::default() }
    }

    /// Vertices in the order of the path. The first one is where the machine is before the program.
    #[must_use]
    pub fn vertices(&self) -> &[PathVertex] {
        &self.vertices
    }

    /// Number of records of the path.
    #[must_use]
    pub fn records(&self) -> u32 {
        self.records
    }

    /// Speed along the path over time.
    #[must_use]
    pub fn profile(&self) -> &PathProfile {
        &self.profile
    }

    /// Least and greatest position in X, Y and Z, µm; all 0 for an empty path.
    #[must_use]
    pub fn bounds_um(&self) -> [[i32; 3]; 2] {
        let Some(first) = self.vertices.first() else { return [[0; 3]; 2] };
        self.vertices.iter().fold([first.at_um; 2], |[low, high], vertex| {
            let at = vertex.at_um;
            [std::array::from_fn(|i| low[i].min(at[i])), std::array::from_fn(|i| high[i].max(at[i]))]
        })
    }

    /// Program line of a record.
    #[must_use]
    pub fn line_of(&self, record: u32) -> Option<u32> {
        let behind = self.lines.partition_point(|&(first, _)| first <= record);
        (record < self.records).then(|| self.lines.get(behind.checked_sub(1)?).map(|&(_, line)| line))?
    }

    /// Records of the run of one line that has this record: the first one, and the one after the last.
    #[must_use]
    pub fn run_of(&self, record: u32) -> Option<[u32; 2]> {
        let behind = self.lines.partition_point(|&(first, _)| first <= record);
        let end = self.lines.get(behind).map_or(self.records, |&(next, _)| next);
        (record < self.records).then(|| self.lines.get(behind.checked_sub(1)?).map(|&(first, _)| [first, end]))?
    }

    /// Records of the first pass through a program line: the first one, and the one after the last.
    #[must_use]
    pub fn records_of(&self, line: u32) -> Option<[u32; 2]> {
        let index = self.lines.iter().position(|&(_, it)| it == line)?;
        let end = self.lines.get(index + 1).map_or(self.records, |&(next, _)| next);
        Some([self.lines[index].0, end])
    }

    /// Records in which a contour is cut: the first one, and the one after the last.
    #[must_use]
    pub fn records_of_contour(&self, number: u32) -> Option<[u32; 2]> {
        self.contours.records_of(number)
    }

    /// Indices of the vertices to keep so that all others lie within this tolerance of the lines between them, µm.
    #[must_use]
    pub fn thinned(&self, tolerance_um: f64) -> Vec<u32> {
        let mut kept = Vec::new();
        let mut thinning = Thinning::new(tolerance_um);
        for (index, vertex) in (0u32..).zip(&self.vertices) {
            if let Some(before) = thinning.push(*vertex, index) {
                kept.push(before);
            }
        }
        kept.extend(thinning.last());
        kept
    }
}

/// Thinning of a path in one pass: it keeps a vertex where the next one leaves the wedge of directions that pass all
/// since the last kept one within the tolerance.
#[derive(Clone, Debug)]
pub(crate) struct Thinning {
    tolerance_um: f64,
    /// Last vertex that was kept.
    anchor: Option<PathVertex>,
    /// Last vertex, with its index, which is kept where the next one leaves the wedge.
    pending: Option<(PathVertex, u32)>,
    wedge: Option<Wedge>,
}

/// Directions from the anchor: the slopes of the other two axes over the axis of the longest distance.
#[derive(Clone, Copy, Debug)]
struct Wedge {
    major: usize,
    /// Distance along that axis that was reached, signed, µm.
    reached: f64,
    slopes: [[f64; 2]; 2],
}

impl Thinning {
    pub(crate) const fn new(tolerance_um: f64) -> Self {
        Self { tolerance_um, anchor: None, pending: None, wedge: None }
    }

    /// Adds the next vertex. Returns the index of one to be kept, if that is certain now.
    pub(crate) fn push(&mut self, vertex: PathVertex, index: u32) -> Option<u32> {
        let Some(anchor) = self.anchor else {
            self.anchor = Some(vertex);
            return Some(index);
        };
        let Some((pending, pending_index)) = self.pending else {
            self.wedge = self.narrowed(None, &anchor, &vertex).unwrap_or(None);
            self.pending = Some((vertex, index));
            return None;
        };
        let goes_on = pending.kind == vertex.kind;
        if let Some(wedge) = self.narrowed(self.wedge, &anchor, &vertex).filter(|_| goes_on) {
            (self.wedge, self.pending) = (wedge, Some((vertex, index)));
            return None;
        }
        self.anchor = Some(pending);
        self.wedge = self.narrowed(None, &pending, &vertex).unwrap_or(None);
        self.pending = Some((vertex, index));
        Some(pending_index)
    }

    /// Index of the last vertex.
    fn last(&self) -> Option<u32> {
        self.pending.map(|(_, index)| index)
    }

    /// The wedge narrowed so that its lines pass this vertex within the tolerance; none where that is impossible.
    #[allow(clippy::option_option)]
    fn narrowed(&self, wedge: Option<Wedge>, anchor: &PathVertex, vertex: &PathVertex) -> Option<Option<Wedge>> {
        let by: [f64; 3] = std::array::from_fn(|i| f64::from(vertex.at_um[i]) - f64::from(anchor.at_um[i]));
        let mut wedge = match wedge {
            Some(wedge) => wedge,
            None => {
                let major = (0..3).max_by(|&a, &b| by[a].abs().total_cmp(&by[b].abs())).unwrap_or(0);
                if by[major].abs() <= self.tolerance_um {
                    return Some(None);
                }
                Wedge { major, reached: 0.0, slopes: [[f64::NEG_INFINITY, f64::INFINITY]; 2] }
            }
        };
        let along = by[wedge.major];
        let is_ahead = along.abs() >= wedge.reached.abs() && along * wedge.reached >= 0.0;
        if !is_ahead {
            return None;
        }
        for (offset, slopes) in (1..).zip(&mut wedge.slopes) {
            let across = by[(wedge.major + offset) % 3];
            let (slope, half) = (across / along, self.tolerance_um / along.abs());
            if slope < slopes[0] || slope > slopes[1] {
                return None;
            }
            *slopes = [slopes[0].max(slope - half), slopes[1].min(slope + half)];
        }
        wedge.reached = along;
        Some(Some(wedge))
    }
}

/// What the moves of a path cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct CutState {
    /// Whether a cutter is on.
    pub(crate) is_cutting: bool,
    /// Number of the contour, 0 for none.
    pub(crate) contour: u32,
}

/// Builds the planned path from the records of a plan.
#[derive(Debug)]
pub(crate) struct PathRecorder {
    path: PlannedPath,
    thinning: Thinning,
    /// Axes that are X, Y and Z, with µm for each pulse.
    space: [Option<(usize, f64)>; 3],
    counts: [i64; 3],
    pending: Option<PathVertex>,
    /// What is cut, with the serial number of the move from whose records on that applies.
    cuts: VecDeque<(u32, CutState)>,
    cut: CutState,
    begun: Instant,
    /// Time after the beginning at which a part of the path is shown next.
    next_part: Duration,
}

impl PathRecorder {
    /// Recorder for a path that begins at the machine's position.
    pub(crate) fn new(machine: &MachineConfig) -> Self {
        let axis = |letter| {
            let index = machine.axes.iter().position(|axis| axis.name == letter)?;
            Some((index, 1000.0 / machine.axes[index].pulses_per_mm))
        };
        let start: [f64; 9] = machine.start_mm();
        let space = ['x', 'y', 'z'].map(axis);
        let counts = space.map(|it| it.map_or(0, |(index, um)| (start[index] * 1000.0 / um).round() as i64));
        let mut recorder = Self {
            path: PlannedPath::default(),
            thinning: Thinning::new(TOLERANCE_UM),
            space,
            counts,
            pending: None,
            cuts: VecDeque::new(),
            cut: CutState { is_cutting: machine.cutting_outputs.is_empty(), contour: 0 },
            begun: Instant::now(),
            next_part: FIRST_PART,
        };
        recorder.push(PathVertex { at_um: recorder.at_um(), record: 0, kind: PathKind::Rapid });
        recorder
    }

    fn at_um(&self) -> [i32; 3] {
        std::array::from_fn(|i| self.space[i].map_or(0, |(_, um)| (self.counts[i] as f64 * um).round() as i32))
    }

    /// States what is cut from the move of this serial number on.
    pub(crate) fn set_cut(&mut self, cut: CutState, serial: u32) {
        if self.cuts.back().map_or(self.cut, |&(_, last)| last) != cut {
            self.cuts.push_back((serial, cut));
        }
    }

    /// Adds a record of the move of this serial number; 0 is that of no move. A move may have no records.
    pub(crate) fn add<const A: usize>(&mut self, record: &Record<A>, serial: u32) {
        if self.path.lines.last().is_none_or(|&(_, line)| line != record.line) {
            self.path.lines.push((self.path.records, record.line));
        }
        while let Some(&(from, cut)) = self.cuts.front()
            && serial != 0
            && serial.wrapping_sub(from) < 1 << 31
        {
            self.cuts.pop_front();
            self.cut = cut;
        }
        let mut squared_um = 0.0;
        for (count, axis) in self.counts.iter_mut().zip(self.space) {
            let Some((index, um)) = axis else { continue };
            *count += i64::from(record.increments[index]);
            squared_um += (f64::from(record.increments[index]) * um).powi(2);
        }
        self.path.profile.push(squared_um.sqrt() / 1000.0);
        let first = self.path.records;
        self.path.records = first.saturating_add(1);
        self.path.contours.add(self.cut.contour, [first, self.path.records]);
        let kind = match (record.flags.contains(Flags::RAPID), self.cut.is_cutting) {
            (true, _) => PathKind::Rapid,
            (false, true) => PathKind::Cutting,
            (false, false) => PathKind::Feed,
        };
        self.push(PathVertex { at_um: self.at_um(), record: self.path.records, kind });
    }

    fn push(&mut self, vertex: PathVertex) {
        if self.thinning.push(vertex, 0).is_some() {
            self.path.vertices.extend(self.pending.or(Some(vertex)));
            if self.path.vertices.len() >= MAX_VERTICES {
                self.thin_again();
            }
        }
        self.pending = Some(vertex);
    }

    /// Thins what there is to four times the tolerance.
    fn thin_again(&mut self) {
        let tolerance_um = self.thinning.tolerance_um * 4.0;
        let kept = self.path.thinned(tolerance_um);
        self.path.vertices = kept.into_iter().map(|index| self.path.vertices[index as usize]).collect();
        self.thinning.tolerance_um = tolerance_um;
    }

    /// The path as far as it is planned, if this is the time to show it: after a moment, and then at times that
    /// double, so that showing it takes a bounded share of the time.
    pub(crate) fn part_to_show(&mut self) -> Option<PlannedPath> {
        if self.begun.elapsed() < self.next_part {
            return None;
        }
        self.next_part = self.begun.elapsed() * 2;
        let last = self.path.vertices.last().map(|vertex| vertex.record);
        let mut part = self.path.clone();
        part.vertices.extend(self.pending.filter(|vertex| last != Some(vertex.record)));
        Some(part)
    }

    /// Ends the path.
    pub(crate) fn finish(mut self) -> PlannedPath {
        let last = self.path.vertices.last().map(|vertex| vertex.record);
        self.path.vertices.extend(self.pending.filter(|vertex| last != Some(vertex.record)));
        self.path
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vertex(at_um: [i32; 3], record: u32) -> PathVertex {
        PathVertex { at_um, record, kind: PathKind::Feed }
    }

    /// Distance of a point from a segment, µm.
    fn distance(point: [i32; 3], from: [i32; 3], to: [i32; 3]) -> f64 {
        let d = |a: [i32; 3], b: [i32; 3]| -> [f64; 3] { std::array::from_fn(|i| f64::from(a[i]) - f64::from(b[i])) };
        let (along, at) = (d(to, from), d(point, from));
        let dot = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let share = if dot(along, along) > 0.0 { (dot(at, along) / dot(along, along)).clamp(0.0, 1.0) } else { 0.0 };
        (0..3).map(|i| (at[i] - along[i] * share).powi(2)).sum::<f64>().sqrt()
    }

    proptest! {
        /// A path of random steps, with runs along an axis and back: what is left out lies within the tolerance.
        #[test]
        fn vertices_that_are_left_out_lie_within_the_tolerance(
            steps in prop::collection::vec((prop::array::uniform3(-30i32..30), 1usize..20), 1..80),
            tolerance_um in 1.0f64..200.0,
        ) {
            let mut at = [0; 3];
            let mut vertices = vec![vertex(at, 0)];
            for (step, times) in steps {
                for _ in 0..times {
                    at = std::array::from_fn(|i| at[i] + step[i]);
                    vertices.push(vertex(at, vertices.len() as u32));
                }
            }
            let records = vertices.len() as u32 - 1;
            let path = PlannedPath { records, vertices, lines: vec![(0, 1)], ..PlannedPath::default() };
            let kept = path.thinned(tolerance_um);
            prop_assert_eq!(kept[0], 0);
            prop_assert_eq!(kept.last().copied(), Some(path.vertices.len() as u32 - 1));
            for pair in kept.windows(2) {
                let [from, to] = [pair[0] as usize, pair[1] as usize];
                prop_assert!(from < to);
                for left_out in &path.vertices[from..to] {
                    let off = distance(left_out.at_um, path.vertices[from].at_um, path.vertices[to].at_um);
                    // The tolerance is one of each axis: the corner of a cube is the farthest.
                    prop_assert!(off <= tolerance_um * 3f64.sqrt() * 1.001, "{off} of {tolerance_um}");
                }
            }
        }
    }

    #[test]
    fn a_long_straight_line_is_two_vertices() {
        let vertices: Vec<_> = (0..10_000).map(|n| vertex([n * 7, n * 3, -n], n as u32)).collect();
        let path = PlannedPath { records: 9_999, vertices, lines: vec![(0, 1)], ..PlannedPath::default() };
        assert_eq!(path.thinned(2.0), [0, 9_999]);
    }

    /// Contours that follow each other at once, and one whose first move has no records, have their own records.
    #[test]
    fn each_contour_has_its_records() {
        let mut recorder = PathRecorder::new(&MachineConfig::built_in().expect("built in"));
        let cut = |contour| CutState { is_cutting: contour > 0, contour };
        let record = Record { increments: [1, 0, 0], ..Record::ZERO };
        // Serial number of each move with the contour and the number of records.
        for (serial, contour, records) in [(1, 0, 4), (2, 1, 6), (3, 1, 2), (4, 2, 5), (5, 0, 3), (6, 3, 0), (7, 3, 2)]
        {
            recorder.set_cut(cut(contour), serial);
            for _ in 0..records {
                recorder.add(&record, serial);
            }
        }
        recorder.set_cut(cut(0), 8);
        recorder.add(&record, 0);
        recorder.add(&record, 8);
        let path = recorder.finish();
        let found = [0, 1, 2, 3, 4].map(|number| path.records_of_contour(number));
        assert_eq!(found, [None, Some([4, 12]), Some([12, 17]), Some([20, 23]), None]);
        assert_eq!(path.vertices().iter().map(|vertex| vertex.kind).next_back(), Some(PathKind::Feed));
    }

    #[test]
    fn lines_and_records_are_found_from_each_other() {
        let lines = vec![(0, 2), (10, 5), (30, 2)];
        let path = PlannedPath { lines, records: 40, ..PlannedPath::default() };
        assert_eq!(
            [0, 9, 10, 29, 30, 39, 40].map(|n| path.line_of(n)),
            [Some(2), Some(2), Some(5), Some(5), Some(2), Some(2), None]
        );
        assert_eq!([2, 5, 3].map(|line| path.records_of(line)), [Some([0, 10]), Some([10, 30]), None]);
    }
}
