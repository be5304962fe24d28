//! The outline of what a program cuts: the convex hull of its places in X and Y (CUT-59).
//!
//! Invariant: its memory is bounded however much is cut, and no place lies farther than rounding outside of it.

use std::f64::consts::TAU;

/// Points that are collected before the hull is taken.
const MAX_POINTS: usize = 4096;

/// Greatest distance of an arc from its chords, mm: less than a pulse.
const SAGITTA_MM: f64 = 0.002;

/// The convex hull of places, mm.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CutOutline {
    /// The hull of earlier places, and those since.
    points: Vec<[f64; 2]>,
    /// Whether a place depends on answers of the machine.
    is_unknown: bool,
}

impl CutOutline {
    /// Adds a place.
    pub(crate) fn add(&mut self, point: [f64; 2]) {
        self.is_unknown |= point.iter().any(|mm| mm.is_nan());
        if self.is_unknown {
            self.points.clear();
            return;
        }
        if self.points.len() == MAX_POINTS {
            self.points = hull(std::mem::take(&mut self.points));
            if self.points.len() > MAX_POINTS / 2 {
                // A circle has this many vertices only in steps far below a pulse.
                self.points = simplified(&self.points, 1e-4);
            }
        }
        self.points.push(point);
    }

    /// Adds an arc that begins in this direction from the centre and turns by this angle, in radians.
    pub(crate) fn add_arc(&mut self, [x, y]: [f64; 2], radius: f64, (from, sweep): (f64, f64)) {
        let sweep = sweep.clamp(-TAU, TAU);
        let steps = (sweep.abs() / (2.0 * (1.0 - (SAGITTA_MM / radius).min(1.0)).acos())).ceil();
        if !steps.is_finite() {
            return;
        }
        for step in 1..steps as u32 {
            let (sin, cos) = (from + sweep * f64::from(step) / steps).sin_cos();
            self.add([x + radius * cos, y + radius * sin]);
        }
    }

    /// Vertices of the hull, counterclockwise, without those that are nearer than `tolerance_mm` to the rest of it;
    /// `None` where a place is not known.
    #[must_use]
    pub fn vertices(&self, tolerance_mm: f64) -> Option<Vec<[f64; 2]>> {
        (!self.is_unknown).then(|| simplified(&hull(self.points.clone()), tolerance_mm))
    }
}

/// Twice the area of a triangle, positive where it is counterclockwise.
fn turn([ax, ay]: [f64; 2], [bx, by]: [f64; 2], [cx, cy]: [f64; 2]) -> f64 {
    (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
}

/// The convex hull, counterclockwise from the point with the least X: the monotone chain of Andrew (1979).
fn hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let chain = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for point in points {
            while let [.., a, b] = chain[..]
                && turn(a, b, point) <= 0.0
            {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut hull = chain(&mut points.iter().copied());
    hull.extend(chain(&mut points.iter().rev().copied()));
    hull
}

/// The polygon without vertices that lie within the tolerance of the chord between those that stay.
fn simplified(polygon: &[[f64; 2]], tolerance_mm: f64) -> Vec<[f64; 2]> {
    let Some((&first, rest)) = polygon.split_first() else { return Vec::new() };
    let (mut kept, mut skipped) = (vec![first], Vec::new());
    for (index, &point) in rest.iter().enumerate() {
        let next = rest.get(index + 1).copied().unwrap_or(first);
        let from = kept[kept.len() - 1];
        skipped.push(point);
        let length = (next[0] - from[0]).hypot(next[1] - from[1]);
        let is_near = |of: &[f64; 2]| length > 0.0 && turn(from, next, *of).abs() <= tolerance_mm * length;
        if !skipped.iter().all(is_near) {
            kept.push(point);
            skipped.clear();
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn outline(points: &[[f64; 2]]) -> CutOutline {
        let mut outline = CutOutline::default();
        points.iter().for_each(|&point| outline.add(point));
        outline
    }

    proptest! {
        #[test]
        fn every_place_lies_within_the_outline(
            points in proptest::collection::vec([-500.0..500.0_f64, -500.0..500.0], 3..300),
            tolerance_mm in 0.0..5.0_f64,
        ) {
            let vertices = outline(&points).vertices(tolerance_mm).expect("known");
            prop_assert!(vertices.iter().all(|vertex| points.contains(vertex)));
            for (index, &from) in vertices.iter().enumerate() {
                let to = vertices[(index + 1) % vertices.len()];
                let length = (to[0] - from[0]).hypot(to[1] - from[1]);
                for &point in &points {
                    prop_assert!(vertices.len() < 3 || turn(from, to, point) >= -(tolerance_mm + 1e-9) * length);
                }
            }
        }
    }

    #[test]
    fn memory_is_bounded_and_what_is_unknown_has_no_outline() {
        let mut circle = CutOutline::default();
        for step in 0..100_000 {
            let angle = f64::from(step) * 0.001;
            circle.add([30.0 * angle.cos(), 30.0 * angle.sin()]);
            assert!(circle.points.len() <= MAX_POINTS);
        }
        let vertices = circle.vertices(0.2).expect("known");
        assert!((20..40).contains(&vertices.len()), "{}", vertices.len());
        assert!(vertices.iter().all(|[x, y]| (x.hypot(*y) - 30.0).abs() < 1e-9));
        circle.add([f64::NAN, 0.0]);
        circle.add([1.0, 0.0]);
        assert_eq!(circle.vertices(0.2), None);
        assert_eq!(outline(&[]).vertices(0.2), Some(Vec::new()));
        assert_eq!(outline(&[[1.0, 2.0], [3.0, 2.0], [2.0, 2.0]]).vertices(0.2), Some(vec![[1.0, 2.0], [3.0, 2.0]]));
    }
}
