//! Small holes and arcs of a cutting program: cut slowly, and over cut (CUT-14, CUT-24).
//!
//! Invariant: an arc is judged by the path that is executed, whatever expressions or subprograms it comes from. After
//! an over cut the program continues from the end of its own circle.

use super::interpreter_core::{Core, Emitter};
use crate::angle::sweep;
use crate::canon::{ArcFeed, Canon};
use crate::canon_modes::Plane;
use crate::compensation::Side;
use crate::cutting::{CuttingSwitch, OpenCircle};
use crate::pose::Axis;
use std::f64::consts::TAU;

/// Share of a turn that an arc may lack to be a full circle.
const CLOSED: f64 = 1e-6;
/// Greatest distance of two places that are the same for the arcs of a hole, mm: programs round their coordinates.
const SAME_PLACE_MM: f64 = 0.005;
/// Greatest difference of the angle of the arcs of a hole from a full turn, rad.
const NEARLY_CLOSED: f64 = 0.1;

impl Core {
    /// Whether a cutter is on that cuts.
    pub(super) fn is_cutting(&self) -> bool {
        let lit = self.state.cutting.lit;
        self.cutting.as_ref().is_some_and(|setup| setup.cutting_bits() & lit != 0)
    }

    /// Emits an arc of a cutting machine. A small one is slower, and a small hole ends with an over cut.
    #[cold]
    pub(super) fn cutting_arc(&mut self, start: (f64, f64), arc: ArcFeed, emit: &mut Emitter<'_>) {
        if std::mem::take(&mut self.state.cutting.is_displaced) {
            // The cutter is off, and the arc begins where the program believes to be.
            emit.call(Canon::StraightFeed(self.state.position));
        }
        let holes = self.state.cutting.holes;
        let centre = (arc.first_centre, arc.second_centre);
        let radius = (start.0 - centre.0).hypot(start.1 - centre.1);
        let is_small = 2.0 * radius * self.state.units.millimetres() <= holes.diameter_mm * (1.0 + CLOSED);
        let end = (arc.end[Axis::X], arc.end[Axis::Y]);
        let angle = sweep(start, end, centre, arc.turns);
        let is_circle = angle.abs() >= TAU * (1.0 - CLOSED);
        let closes = is_circle || self.closes_circle((start, end), centre, angle);
        let concerns = holes.mode > 0 && arc.plane == Plane::Xy && is_small && self.is_cutting();
        let is_slow = concerns && (is_circle || holes.mode >= 3);
        if is_slow {
            let percent = self.state.cutting.velocity_percent.min(holes.velocity_percent);
            emit.call(Canon::SetFeedRate(self.state.feed_rate * percent / 100.0));
        }
        emit.call(Canon::ArcFeed(arc));
        if concerns && closes && matches!(holes.mode, 2 | 4) {
            self.over_cut(&arc, radius, emit);
        }
        if is_slow {
            emit.call(Canon::SetFeedRate(self.shared_rate()));
        }
    }

    /// Whether an arc completes a circle that the arcs directly before it have begun.
    fn closes_circle(&mut self, (start, end): ((f64, f64), (f64, f64)), centre: (f64, f64), angle: f64) -> bool {
        let tolerance = SAME_PLACE_MM / self.state.units.millimetres();
        let is_at = |one: (f64, f64), other: (f64, f64)| (one.0 - other.0).hypot(one.1 - other.1) <= tolerance;
        let open = &mut self.state.cutting.open_circle;
        let is_continued = |open: &OpenCircle| {
            is_at(open.centre, centre) && is_at(open.end, start) && (open.sweep > 0.0) == (angle > 0.0)
        };
        let begun = open.filter(is_continued).unwrap_or(OpenCircle { centre, start, end: start, sweep: 0.0 });
        let whole = OpenCircle { end, sweep: begun.sweep + angle, ..begun };
        let closes = is_at(whole.start, end) && (whole.sweep.abs() - TAU).abs() < NEARLY_CLOSED;
        *open = (!closes).then_some(whole);
        closes
    }

    /// The feed rate of a small hole or arc under cutter compensation, if it is one: the path that is executed decides,
    /// which is that of the radius less that of the tool where the tool is inside.
    pub(super) fn compensated_hole_rate(
        &self,
        (start, end): ((f64, f64), (f64, f64)),
        centre: (f64, f64),
        turns: i32,
    ) -> Option<f64> {
        let (holes, compensation) = (self.state.cutting.holes, self.state.compensation?);
        if holes.mode == 0 || self.state.plane != Plane::Xy || !self.is_cutting() {
            return None;
        }
        let is_inside = (compensation.side == Side::Left) == (turns > 0);
        let tool = if is_inside { -compensation.radius } else { compensation.radius };
        let radius = (start.0 - centre.0).hypot(start.1 - centre.1) + tool;
        let is_small = 2.0 * radius * self.state.units.millimetres() <= holes.diameter_mm * (1.0 + CLOSED);
        let is_circle = sweep(start, end, centre, turns).abs() >= TAU * (1.0 - CLOSED);
        let percent = self.state.cutting.velocity_percent.min(holes.velocity_percent);
        (is_small && (is_circle || holes.mode >= 3)).then_some(self.state.feed_rate * percent / 100.0)
    }

    /// Goes on along a circle with the cutter off.
    fn over_cut(&mut self, hole: &ArcFeed, radius: f64, emit: &mut Emitter<'_>) {
        let angle = self.state.cutting.holes.over_cut_mm / self.state.units.millimetres() / radius;
        if angle.is_nan() || angle <= 0.0 {
            return;
        }
        let angle = angle.min(0.75 * TAU);
        let direction = f64::from(hole.turns.signum());
        let (sine, cosine) = (direction * angle).sin_cos();
        let (x, y) = (hole.end[Axis::X] - hole.first_centre, hole.end[Axis::Y] - hole.second_centre);
        let mut end = hole.end;
        end[Axis::X] = hole.first_centre + x * cosine - y * sine;
        end[Axis::Y] = hole.second_centre + x * sine + y * cosine;
        emit.call(Canon::SetCutting(CuttingSwitch::Cutter, false));
        emit.call(Canon::ArcFeed(ArcFeed { end, turns: hole.turns.signum(), ..*hole }));
        let state = &mut self.state.cutting;
        (state.is_displaced, state.is_off_in_passing) = (true, true);
    }
}
