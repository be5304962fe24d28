//! Kerfs that the program has cut: height control holds the height before the torch crosses one (CUT-53).
//!
//! Invariant: the map depends on the program alone, so that a job that is resumed holds at the same places. A kerf that
//! is held too long costs nothing but the correction; beyond the greatest number of cells, new ones are not known.

use std::collections::HashMap;
use std::f64::consts::TAU;

use retrace_gcode::{Axis, Plane, Pose};
use retrace_link::{OutputChange, channel};

use super::CanonExecutor;
use crate::motion_sink::MotionSink;

/// Maximum number of cells.
const MAX_CELLS: usize = 2_000_000;
/// Widths of a kerf along the path, behind which the same contour counts as cut before.
const APART: f64 = 4.0;
/// Length in mm between two contours, as far as the map is concerned.
const NEXT_CONTOUR_MM: f64 = 1e6;

/// The cells that the program has cut, each half a kerf wide, with the length of all cuts at which it was cut first.
#[derive(Clone, Debug)]
pub(super) struct KerfMap {
    kerf_mm: f64,
    /// Length in mm that the torch cuts while its height comes to rest.
    rest_mm: f64,
    cells: HashMap<[i32; 2], f64>,
    /// Length of all cuts so far, mm.
    length_mm: f64,
    /// Length since a kerf was last near, mm.
    since_near_mm: f64,
    /// Whether the height is held.
    holds: bool,
}

/// A move in X and Y, mm.
#[derive(Clone, Copy, Debug)]
pub(super) enum FlatMove {
    /// A line.
    Line([f64; 2], [f64; 2]),
    /// An arc from a place about a centre, by an angle in radians.
    Arc([f64; 2], [f64; 2], f64),
}

impl FlatMove {
    /// The arc from a place to another about a centre, with these turns: positive counter-clockwise.
    fn arc(from: [f64; 2], to: [f64; 2], centre: [f64; 2], turns: i32) -> Self {
        let angle = |at: [f64; 2]| (at[1] - centre[1]).atan2(at[0] - centre[0]);
        let sign = f64::from(turns.signum());
        let part = (sign * (angle(to) - angle(from))).rem_euclid(TAU);
        // An arc without an angle is a whole circle.
        let part = if part < 1e-9 { TAU } else { part };
        Self::Arc(from, centre, sign * (part + TAU * f64::from(turns.abs() - 1)))
    }

    fn length_mm(&self) -> f64 {
        match *self {
            Self::Line(from, to) => distance(from, to),
            Self::Arc(from, centre, angle) => distance(from, centre) * angle.abs(),
        }
    }

    /// The place at a share of its length; beyond 1, on its continuation.
    fn at(&self, share: f64) -> [f64; 2] {
        match *self {
            Self::Line(from, to) => [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis])),
            Self::Arc(from, [x, y], angle) => {
                let (sin, cos) = (share * angle).sin_cos();
                let (dx, dy) = (from[0] - x, from[1] - y);
                [x + dx * cos - dy * sin, y + dx * sin + dy * cos]
            }
        }
    }
}

fn distance(from: [f64; 2], to: [f64; 2]) -> f64 {
    (to[0] - from[0]).hypot(to[1] - from[1])
}

impl KerfMap {
    /// The map of a program with kerfs of this width, mm, and a height that comes to rest within this length of a cut,
    /// mm.
    fn new(kerf_mm: f64, rest_mm: f64) -> Self {
        Self { kerf_mm, rest_mm, cells: HashMap::new(), length_mm: 0.0, since_near_mm: f64::INFINITY, holds: false }
    }

    fn cell(&self, at: [f64; 2]) -> [i32; 2] {
        at.map(|mm| (mm / self.kerf_mm * 2.0).floor() as i32)
    }

    /// Whether a kerf that was cut before the length `cut_mm` is closer than one kerf to a place.
    fn is_near(&self, at: [f64; 2], cut_mm: f64) -> bool {
        let [x, y] = self.cell(at);
        let before = cut_mm - APART * self.kerf_mm;
        let around = (-2..=2).flat_map(|dx| (-2..=2).map(move |dy| [x + dx, y + dy]));
        around.filter_map(|cell| self.cells.get(&cell)).any(|&first| first < before)
    }

    /// Begins a contour.
    fn begin(&mut self) {
        self.length_mm += NEXT_CONTOUR_MM;
        (self.since_near_mm, self.holds) = (f64::INFINITY, false);
    }

    /// Follows a move of the contour: the shares of its length at which the height begins or ceases to be held, from
    /// one kerf before, and the length in which it comes to rest, to one behind. What comes behind the move is not
    /// known yet: it is taken to continue.
    fn follow(&mut self, flat: FlatMove) -> Vec<(f64, bool)> {
        let length_mm = flat.length_mm();
        if length_mm <= 0.0 {
            return Vec::new();
        }
        let steps = (2.0 * length_mm / self.kerf_mm).ceil().clamp(1.0, 1e6) as usize;
        let step_mm = length_mm / steps as f64;
        let share = |step: usize| step as f64 / steps as f64;
        let is_near = |share: f64| self.is_near(flat.at(share), self.length_mm + length_mm * share.min(1.0));
        let near: Vec<bool> = (0..=steps).map(|step| is_near(share(step))).collect();
        let ahead_mm = self.kerf_mm + self.rest_mm;
        let halves = (1..).map(|n| f64::from(n) * self.kerf_mm / 2.0).take_while(|mm| *mm <= ahead_mm);
        let mut next_mm = halves.map(|mm| (mm, is_near(1.0 + mm / length_mm))).find(|of| of.1).map_or(1e9, |of| of.0);
        // Length from each step to the next place that is near a kerf.
        let mut to_near_mm = vec![0.0; steps + 1];
        for (to_near_mm, &near) in to_near_mm.iter_mut().zip(&near).rev() {
            *to_near_mm = if near { 0.0 } else { next_mm };
            next_mm = *to_near_mm + step_mm;
        }
        let mut changes = Vec::new();
        for step in 0..=steps {
            self.since_near_mm = if near[step] { 0.0 } else { self.since_near_mm + step_mm };
            let holds = self.since_near_mm <= self.kerf_mm || to_near_mm[step] <= ahead_mm + step_mm;
            if holds != std::mem::replace(&mut self.holds, holds) {
                changes.push((share(step), holds));
            }
        }
        for step in 0..=steps {
            let (cell, cut_mm) = (self.cell(flat.at(share(step))), self.length_mm + step_mm * step as f64);
            if self.cells.len() < MAX_CELLS {
                self.cells.entry(cell).or_insert(cut_mm);
            }
        }
        self.length_mm += length_mm;
        changes
    }
}

impl CanonExecutor<'_> {
    /// The map of the kerfs that height control has to know; `None` where it does not act.
    fn controlled_kerfs(&self) -> Option<KerfMap> {
        let control = self.machine.height_control()?;
        let of = self.material.as_ref().filter(|of| of.height_control && of.kerf_mm > 0.0)?;
        Some(KerfMap::new(of.kerf_mm, of.feed_mm_per_min / 60.0 * control.rest_s()))
    }

    /// Begins a contour for the map of kerfs.
    pub(super) fn begin_kerf(&mut self) {
        if let Some(kerfs) = self.controlled_kerfs() {
            self.kerfs.get_or_insert(kerfs).begin();
        }
    }

    /// Holds the height where a move to this place crosses a kerf. `arc`: its centre in X and Y, and its turns.
    pub(super) fn hold_over_kerfs<const A: usize>(
        &mut self,
        end: &Pose,
        arc: Option<([f64; 2], i32)>,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) {
        let is_lit = self.machine.tool_layer().is_some_and(|layer| self.cutters.is_lit(self.machine, layer.fire));
        let Some(mut kerfs) = self.kerfs.take_if(|_| is_lit) else { return };
        let [from, to] = [&self.actual_position(), end].map(|at| [at[Axis::X], at[Axis::Y]]);
        let flat = match arc {
            Some((centre, turns)) => FlatMove::arc(from, to, centre, turns),
            None => FlatMove::Line(from, to),
        };
        for (share, holds) in kerfs.follow(flat) {
            let change = OutputChange { channel: channel::HEIGHT_HOLD, value: i32::from(holds) };
            match share {
                // The program holds it anyway.
                _ if self.is_height_held => {}
                0.0 => sink.action(change, line),
                share => sink.action_within(share, change, line),
            }
        }
        self.kerfs = Some(kerfs);
    }

    /// Whether the height is held over a kerf.
    pub(super) fn holds_over_kerf(&self) -> bool {
        self.kerfs.as_ref().is_some_and(|kerfs| kerfs.holds)
    }

    /// Ends what a kerf holds, at the end of a contour.
    pub(super) fn end_kerf_hold<const A: usize>(&mut self, line: u32, sink: &mut impl MotionSink<A>) {
        let holds = self.kerfs.as_mut().is_some_and(|kerfs| std::mem::take(&mut kerfs.holds));
        if holds && !self.is_height_held {
            sink.action(OutputChange { channel: channel::HEIGHT_HOLD, value: 0 }, line);
        }
    }

    /// The centre of an arc in X and Y, and its turns.
    pub(super) fn flat_arc(arc: &retrace_gcode::ArcFeed, centre: &Pose) -> Option<([f64; 2], i32)> {
        (arc.plane == Plane::Xy).then(|| ([centre[Axis::X], centre[Axis::Y]], arc.turns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Lengths of the path at which the height is held.
    fn held(map: &mut KerfMap, moves: &[FlatMove]) -> Vec<[f64; 2]> {
        let (mut at, mut spans, mut open) = (0.0, Vec::new(), None);
        map.begin();
        for flat in moves {
            for (share, holds) in map.follow(*flat) {
                let place = at + share * flat.length_mm();
                match open.take() {
                    Some(from) if !holds => spans.push([from, place]),
                    _ => open = Some(place),
                }
            }
            at += flat.length_mm();
        }
        spans.extend(open.map(|from| [from, at]));
        spans
    }

    #[test]
    fn a_kerf_that_is_crossed_is_held_from_before_to_behind() {
        let mut map = KerfMap::new(1.5, 0.0);
        assert_eq!(held(&mut map, &[FlatMove::Line([50.0, -50.0], [50.0, 50.0])]), [[0.0; 2]; 0]);
        let [[from, to]] = held(&mut map, &[FlatMove::Line([0.0, 0.0], [100.0, 0.0])])[..] else { panic!("one kerf") };
        // The kerf is near within 1.5 mm and a cell; one kerf more is held before and behind.
        assert!((45.5..=47.0).contains(&from) && (53.0..=54.5).contains(&to), "{from} {to}");
        // A contour beside it, at a distance of three kerfs, is not held.
        assert!(held(&mut map, &[FlatMove::Line([54.5, 10.0], [54.5, 50.0])]).is_empty());
    }

    #[test]
    fn a_contour_meets_its_own_beginning() {
        let mut map = KerfMap::new(1.5, 0.0);
        let circle = FlatMove::arc([20.0, 0.0], [20.0, 0.0], [0.0, 0.0], 1);
        let spans = held(&mut map, &[FlatMove::Line([15.0, 0.0], [20.0, 0.0]), circle]);
        let around = 40.0 * TAU / 2.0;
        assert!(spans.len() == 1 && spans[0][0] > around - 5.0 && spans[0][1] > around + 4.9, "{spans:?}");
    }

    proptest! {
        /// However the path is divided: near a crossing it is held, far from one it is not.
        #[test]
        fn crossings_are_held_however_the_path_is_divided(
            parts in prop::collection::vec(0.05..20.0f64, 1..40), kerf in 0.5..3.0f64, rest in 0.0..4.0f64,
            x in 5.0..60.0f64,
        ) {
            let mut map = KerfMap::new(kerf, rest);
            held(&mut map, &[FlatMove::Line([x, -30.0], [x, 30.0])]);
            let mut at = 0.0;
            let moves: Vec<FlatMove> = parts
                .iter()
                .map(|part| {
                    let from = at;
                    at += part;
                    FlatMove::Line([from, 0.0], [at, 0.0])
                })
                .collect();
            let spans = held(&mut map, &moves);
            let is_held = |mm: f64| spans.iter().any(|span| (span[0]..=span[1]).contains(&mm));
            for step in 0..(at * 4.0) as u32 {
                let mm = f64::from(step) / 4.0;
                if (x - mm) < 0.9 * kerf + rest && (mm - x) < 0.9 * kerf {
                    prop_assert!(is_held(mm), "{} {:?}", mm, spans);
                } else if x - mm > 3.5 * kerf + rest + 0.5 || mm - x > 3.5 * kerf + 0.5 {
                    prop_assert!(!is_held(mm), "{} {:?}", mm, spans);
                }
            }
        }
    }
}
