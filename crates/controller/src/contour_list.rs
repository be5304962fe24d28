//! The contours of a program and the figures of each material, from the plan and before the run (CUT-27, CUT-60).
//!
//! Invariant: contours have the numbers that the run reports; of a program with very many of them the first are listed,
//! and all are counted.

use std::collections::BTreeMap;
use std::sync::Arc;

use retrace_config::MachineConfig;
use retrace_gcode::{Material, ProgramLocation};

use crate::cut_outline::CutOutline;

/// Maximum number of contours that are listed.
const MAX_CONTOURS: usize = 100_000;

/// A contour: from the place where the program lights a cutter to that where it switches it off.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedContour<const A: usize> {
    /// Number in the program, from 1.
    pub number: u64,
    /// Program line that lights the cutter; of a subprogram in another file, that of the call.
    pub line: u32,
    /// File and line, with the calls and loops around it, where the program is known.
    pub location: Option<ProgramLocation>,
    /// Name of the cutter.
    pub cutter: String,
    /// Material in force, if any.
    pub material: Option<Arc<Material>>,
    /// Length of the feed path with the cutter on, over the linear axes, mm.
    pub length_mm: f64,
    /// Machine position where the cutter is lit, mm.
    pub pierce_mm: [f64; A],
    /// Machine position where it is switched off, mm.
    pub end_mm: [f64; A],
}

impl<const A: usize> PlannedContour<A> {
    /// Label of the innermost subprogram that lights the cutter, if one does.
    #[must_use]
    pub fn subprogram(&self) -> Option<&str> {
        self.location.as_ref()?.subprogram()
    }
}

/// What a program cuts of a material.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MaterialSummary {
    /// The material; `None` without a material table.
    pub material: Option<Arc<Material>>,
    /// Number of contours; each of them begins with a pierce.
    pub contours: u64,
    /// Length of the feed path with a cutter on, mm.
    pub cut_mm: f64,
    /// Length of the rapids while the material is selected, mm.
    pub rapid_mm: f64,
}

/// The contours of a program, in its order.
#[derive(Clone, Debug, PartialEq)]
pub struct ContourList<const A: usize> {
    /// The contours, as many as are listed.
    pub contours: Vec<PlannedContour<A>>,
    /// Number of contours.
    pub count: u64,
    /// Number of starts of each cutter, by its name.
    pub starts: BTreeMap<String, u64>,
    /// Least and greatest machine coordinate of each axis in what is cut, places where a cutter is lit included, mm;
    /// NaN where one depends on answers of the machine.
    pub extents_mm: Option<[[f64; 2]; A]>,
    /// Convex hull of the same places in X and Y.
    pub outline: CutOutline,
    /// Indices of X and Y.
    plane: Option<[usize; 2]>,
    /// Each material with its figures, in the order of their first use.
    pub materials: Vec<MaterialSummary>,
    /// Channels that are on, each with the index of its contour.
    open: Vec<(u8, usize)>,
    /// Index of the material in force in `materials`, once it has figures.
    in_force: Option<usize>,
    material: Option<Arc<Material>>,
    /// First contour whose location is not known yet.
    unlocated: usize,
    /// Maximum number of contours that are listed.
    max_contours: usize,
}

impl<const A: usize> Default for ContourList<A> {
    fn default() -> Self {
        Self {
            contours: Vec::new(),
            count: 0,
            starts: BTreeMap::new(),
            extents_mm: None,
            outline: CutOutline::default(),
            plane: None,
            materials: Vec::new(),
            open: Vec::new(),
            in_force: None,
            material: None,
            unlocated: 0,
            max_contours: MAX_CONTOURS,
        }
    }
}

impl<const A: usize> ContourList<A> {
    /// With the outline of what is cut on this machine.
    pub(crate) fn on_machine(mut self, machine: &MachineConfig) -> Self {
        self.plane = machine.axis_of('x').zip(machine.axis_of('y')).map(<[usize; 2]>::from);
        self
    }

    /// An empty list, which lists at most this number of contours.
    pub(crate) fn limited_to(max_contours: usize) -> Self {
        Self { max_contours, ..Self::default() }
    }

    /// The contour of this number, if it is listed.
    #[must_use]
    pub fn contour(&self, number: u32) -> Option<&PlannedContour<A>> {
        self.contours.get(usize::try_from(number).ok()?.checked_sub(1)?)
    }

    /// Length of all contours, listed or not, mm.
    #[must_use]
    pub fn cut_mm(&self) -> f64 {
        self.materials.iter().map(|summary| summary.cut_mm).sum()
    }

    /// Material in force.
    pub(crate) fn material(&self) -> Option<&Material> {
        self.material.as_deref()
    }

    /// Sets the material in force.
    pub(crate) fn set_material(&mut self, material: Option<&Arc<Material>>) {
        let is_same = match (material, &self.material) {
            (Some(new), Some(old)) => Arc::ptr_eq(new, old),
            (new, old) => new.is_none() && old.is_none(),
        };
        if !is_same {
            (self.material, self.in_force) = (material.cloned(), None);
        }
    }

    /// Figures of the material in force.
    fn summary(&mut self) -> &mut MaterialSummary {
        let material = &self.material;
        let index = *self.in_force.get_or_insert_with(|| {
            self.materials.iter().position(|summary| summary.material == *material).unwrap_or(self.materials.len())
        });
        if index == self.materials.len() {
            self.materials.push(MaterialSummary { material: self.material.clone(), ..MaterialSummary::default() });
        }
        &mut self.materials[index]
    }

    /// The program lights the cutter of this channel at `at`.
    pub(crate) fn begin(&mut self, channel: u8, cutter: &str, line: u32, at: [f64; A]) {
        self.count += 1;
        self.cover(&at);
        match self.starts.get_mut(cutter) {
            Some(starts) => *starts += 1,
            None => drop(self.starts.insert(cutter.to_owned(), 1)),
        }
        self.summary().contours += 1;
        let number = self.count;
        self.open.push((channel, self.contours.len()));
        if self.contours.len() < self.max_contours {
            let (cutter, material) = (cutter.to_owned(), self.material.clone());
            let location = None;
            let [pierce_mm, end_mm] = [at; 2];
            let length_mm = 0.0;
            self.contours.push(PlannedContour {
                number,
                line,
                location,
                cutter,
                material,
                length_mm,
                pierce_mm,
                end_mm,
            });
        }
    }

    /// Sets the location of the contours that were begun since the last call.
    pub(crate) fn locate(&mut self, location: impl FnOnce() -> Option<ProgramLocation>) {
        if self.unlocated == self.contours.len() {
            return;
        }
        let location = location();
        for contour in &mut self.contours[self.unlocated..] {
            contour.location.clone_from(&location);
        }
        self.unlocated = self.contours.len();
    }

    /// The program switches the cutter of this channel off at `at`.
    pub(crate) fn end(&mut self, channel: u8, at: [f64; A]) {
        let contours = &mut self.contours;
        self.open.retain(|&(open, index)| {
            if open != channel {
                return true;
            }
            if let Some(contour) = contours.get_mut(index) {
                contour.end_mm = at;
            }
            false
        });
    }

    /// Whether the cutter of this channel is on.
    pub(crate) fn is_open(&self, channel: u8) -> bool {
        self.open.iter().any(|&(open, _)| open == channel)
    }

    /// Whether a cutter is on.
    pub(crate) fn is_cutting(&self) -> bool {
        !self.open.is_empty()
    }

    /// A feed move of this length ends at `at`; where no cutter is on, nothing is cut.
    pub(crate) fn cut(&mut self, length_mm: f64, at: [f64; A]) {
        if self.open.is_empty() {
            return;
        }
        self.cover(&at);
        for &(_, index) in &self.open {
            if let Some(contour) = self.contours.get_mut(index) {
                contour.length_mm += length_mm;
                contour.end_mm = at;
            }
        }
        self.summary().cut_mm += length_mm;
    }

    /// What is cut reaches to this point; where no cutter is on, nothing is cut.
    pub(crate) fn reach(&mut self, point: &[f64; A]) {
        if self.is_cutting() {
            self.cover(point);
        }
    }

    fn cover(&mut self, point: &[f64; A]) {
        for (range, &mm) in self.extents_mm.get_or_insert_with(|| point.map(|mm| [mm; 2])).iter_mut().zip(point) {
            let is_known = !(mm.is_nan() || range[0].is_nan());
            *range = if is_known { [range[0].min(mm), range[1].max(mm)] } else { [f64::NAN; 2] };
        }
        if let Some([x, y]) = self.plane {
            self.outline.add([point[x], point[y]]);
        }
    }

    /// What is cut reaches along an arc from this point; where no cutter is on, nothing is cut.
    pub(crate) fn reach_arc(&mut self, from: &[f64; A], arc: &retrace_motion::Arc<A>) {
        let [p, q] = arc.plane;
        if self.is_cutting() && self.plane == Some([p, q]) {
            let radius = (from[p] - arc.centre_mm[0]).hypot(from[q] - arc.centre_mm[1]);
            self.outline.add_arc(arc.centre_mm, radius, arc.sweep(from));
        }
    }

    /// A rapid move of this length.
    pub(crate) fn rapid(&mut self, length_mm: f64) {
        self.summary().rapid_mm += length_mm;
    }
}

/// A contour that was begun before the job was resumed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestoredContour {
    /// Its number in the program, from 1.
    pub number: u32,
    /// Program line that lights the cutter.
    pub line: u32,
    /// Length that is cut, mm.
    pub cut_mm: f64,
    /// Length that is not cut, mm; `None` where it has not ended.
    pub not_cut_mm: Option<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contours_are_numbered_and_summed_by_material() {
        let [steel, other] = [1, 2].map(|number| Arc::new(Material { number, ..Material::default() }));
        let mut list = ContourList::<1>::default();
        list.set_material(Some(&steel));
        list.rapid(5.0);
        list.begin(64, "torch", 3, [5.0]);
        list.locate(|| Some(ProgramLocation { line: 3, ..ProgramLocation::default() }));
        list.cut(2.0, [7.0]);
        list.cut(1.0, [8.0]);
        list.reach(&[7.5]);
        assert!(list.is_cutting() && list.is_open(64) && !list.is_open(3));
        list.end(64, [8.0]);
        list.cut(4.0, [12.0]);
        assert!(!list.is_cutting(), "the cutter is off");
        list.locate(|| panic!("nothing was begun"));
        list.set_material(Some(&other));
        list.begin(64, "torch", 7, [12.0]);
        list.end(64, [12.0]);
        list.begin(3, "jet", 9, [12.0]);
        list.end(3, [12.0]);
        list.set_material(Some(&steel));
        list.rapid(12.0);
        let found: Vec<_> =
            list.contours.iter().map(|c| (c.number, c.line, c.length_mm, c.pierce_mm, c.end_mm)).collect();
        assert_eq!(found, [(1, 3, 3.0, [5.0], [8.0]), (2, 7, 0.0, [12.0], [12.0]), (3, 9, 0.0, [12.0], [12.0])]);
        list.reach(&[99.0]);
        assert_eq!(list.extents_mm, Some([[5.0, 12.0]]), "what is cut, and no rapid");
        assert_eq!(list.starts, BTreeMap::from([("jet".to_owned(), 1), ("torch".to_owned(), 2)]));
        assert_eq!(list.contours.iter().map(|c| c.location.is_some()).collect::<Vec<_>>(), [true, false, false]);
        let sums: Vec<_> = list.materials.iter().map(|sum| (sum.contours, sum.cut_mm, sum.rapid_mm)).collect();
        assert_eq!((list.count, sums), (3, vec![(1, 3.0, 17.0), (2, 0.0, 0.0)]));
    }
}
