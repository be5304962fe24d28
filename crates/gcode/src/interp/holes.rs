//! Small holes and arcs of a cutting program: cut slowly, and over cut (CUT-14, CUT-24).
//!
//! Invariant: an arc is judged by the path that is executed, whatever expressions or subprograms it comes from. After
//! an over cut the program continues from the end of its own circle.

use super::interpreter_core::{Core, Emitter};
use crate::angle::sweep;
use crate::canon::{ArcFeed, Canon};
use crate::canon_modes::Plane;
use crate::cutting::CuttingSwitch;
use crate::pose::Axis;
use std::f64::consts::TAU;

/// Share of a turn that an arc may lack to be a full circle.
const CLOSED: f64 = 1e-6;

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
        let is_hole = sweep(start, end, centre, arc.turns).abs() >= TAU * (1.0 - CLOSED);
        let concerns = holes.mode > 0 && arc.plane == Plane::Xy && is_small && (is_hole || holes.mode >= 3);
        if !concerns || !self.is_cutting() {
            emit.call(Canon::ArcFeed(arc));
            return;
        }
        let percent = self.state.cutting.velocity_percent.min(holes.velocity_percent);
        emit.call(Canon::SetFeedRate(self.state.feed_rate * percent / 100.0));
        emit.call(Canon::ArcFeed(arc));
        if is_hole && matches!(holes.mode, 2 | 4) {
            self.over_cut(&arc, radius, emit);
        }
        emit.call(Canon::SetFeedRate(self.shared_rate()));
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
