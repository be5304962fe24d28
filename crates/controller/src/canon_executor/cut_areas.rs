//! The areas that contours have enclosed so far: a part of the sheet in them may have tipped up (CUT-14).
//!
//! Invariant: a place in an area counts as inside; where more contours were cut than are kept, every place does.

/// Number of corners that are kept at most.
const MAX_CORNERS: usize = 1_000_000;
/// Angle between two corners of an arc, in radians.
const STEP_RAD: f64 = 0.1;

/// Areas in the plane of X and Y, in mm of machine coordinates.
#[derive(Clone, Debug, Default)]
pub(super) struct CutAreas {
    /// Corners of the areas; each area is closed by a line from its last corner to its first one.
    areas: Vec<Vec<[f64; 2]>>,
    /// Corners of the contour that is being cut.
    open: Option<Vec<[f64; 2]>>,
    corners: usize,
}

impl CutAreas {
    /// Begins a contour at this place.
    pub(super) fn begin(&mut self, at: [f64; 2]) {
        self.open = Some(vec![at]);
    }

    /// Follows the contour, if one is open, along a line to this place.
    pub(super) fn follow(&mut self, to: [f64; 2]) {
        if let Some(open) = self.open.as_mut().filter(|open| open.len() <= MAX_CORNERS) {
            open.push(to);
        }
    }

    /// Follows the contour along an arc about this centre to its end, with these turns: positive counter-clockwise, 1
    /// for a part of a circle or a whole one.
    pub(super) fn follow_arc(&mut self, [x, y]: [f64; 2], turns: i32, end: [f64; 2]) {
        let Some(&[from_x, from_y]) = self.open.as_ref().and_then(|open| open.last()) else { return };
        let radius = (from_x - x).hypot(from_y - y);
        let [begins, ends] = [(from_x, from_y), (end[0], end[1])].map(|(at_x, at_y)| (at_y - y).atan2(at_x - x));
        let sign = f64::from(turns.signum());
        let mut sweep = (ends - begins) * sign;
        while sweep <= 1e-9 {
            sweep += std::f64::consts::TAU;
        }
        let steps = (sweep / STEP_RAD).ceil().max(1.0) as u32;
        for step in 1..steps {
            let angle = begins + sign * sweep * f64::from(step) / f64::from(steps);
            self.follow([x + radius * angle.cos(), y + radius * angle.sin()]);
        }
        self.follow(end);
    }

    /// Ends the contour, if one is open. Returns whether its end is in an area that was cut before.
    pub(super) fn end(&mut self) -> bool {
        let Some(open) = self.open.take() else { return false };
        let is_inside = open.last().is_some_and(|&at| self.contain(at));
        self.corners = self.corners.saturating_add(open.len());
        if self.corners <= MAX_CORNERS && open.len() > 2 {
            self.areas.push(open);
        }
        is_inside
    }

    fn contain(&self, [x, y]: [f64; 2]) -> bool {
        let crosses =
            |[a, b]: [[f64; 2]; 2]| (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) * (b[0] - a[0]) / (b[1] - a[1]);
        let contains = |area: &Vec<[f64; 2]>| {
            let next = area.iter().cycle().skip(1);
            area.iter().zip(next).filter(|&(&a, &b)| crosses([a, b])).count() % 2 == 1
        };
        self.corners > MAX_CORNERS || self.areas.iter().any(contains)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(areas: &mut CutAreas, from: f64, to: f64) -> bool {
        areas.begin([from, from]);
        for at in [[to, from], [to, to], [from, to], [from, from]] {
            areas.follow(at);
        }
        areas.end()
    }

    #[test]
    fn a_contour_ends_inside_an_area_that_was_cut_before_and_not_in_its_own() {
        let mut areas = CutAreas::default();
        assert!(!square(&mut areas, 0.0, 10.0), "its own area does not count");
        assert!(square(&mut areas, 4.0, 6.0));
        assert!(!square(&mut areas, 20.0, 30.0));
        assert!(!areas.end(), "none is open");
        // A circle about (50, 0), with a line that leads in.
        areas.begin([50.0, 0.0]);
        areas.follow([60.0, 0.0]);
        areas.follow_arc([50.0, 0.0], 1, [60.0, 0.0]);
        assert!(!areas.end());
        for (at, is_inside) in [([50.0, 9.0], true), ([43.0, -6.0], true), ([58.0, 8.0], false), ([61.0, 0.0], false)] {
            assert_eq!(areas.contain(at), is_inside, "{at:?}");
        }
        areas.begin([70.0, 0.0]);
        areas.follow_arc([80.0, 0.0], -1, [90.0, 0.0]);
        assert!(!areas.end());
        assert!(areas.contain([80.0, 5.0]) && !areas.contain([80.0, -5.0]), "a clockwise half above its centre");
    }

    #[test]
    fn beyond_its_memory_every_place_counts_as_inside() {
        let mut areas = CutAreas { corners: MAX_CORNERS, ..CutAreas::default() };
        assert!(!square(&mut areas, 0.0, 1.0) && square(&mut areas, 90.0, 91.0));
    }
}
