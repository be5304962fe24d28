//! View of the plan that is committed and not emitted, for measurements: the path between stops and glides, its limits
//! and the speed along it.
//!
//! Invariant: the view is a copy; it has no part in planning or emission.

use crate::curve::Curve;
use crate::emitter::{Emitter, PlanItem};
use crate::limits::AxisLimits;
use crate::piece::PathPiece;
use crate::profile::Profile;

/// Piece of the planned path.
#[derive(Clone, Copy, Debug)]
pub struct PlannedPiece<const A: usize> {
    curve: Curve<A>,
    /// Length, mm.
    pub length_mm: f64,
    /// Highest speed that the feed and the velocities of the axes allow, mm/s.
    pub speed_mm_s: f64,
    /// Highest speed at its end, mm/s.
    pub exit_speed_mm_s: f64,
    /// Acceleration of each axis that the plan may use, mm/s².
    pub acceleration_mm_s2: [f64; A],
    /// Jerk of each axis that the plan may use, mm/s³.
    pub jerk_mm_s3: [f64; A],
}

impl<const A: usize> PlannedPiece<A> {
    fn new(piece: &PathPiece<A>, axes: &AxisLimits<A>, factor: f64) -> Self {
        let (speed_mm_s, acceleration_mm_s2, jerk_mm_s3) = piece.axis_limits(axes, factor);
        let PathPiece { curve, length, exit_v, .. } = *piece;
        Self { curve, length_mm: length, speed_mm_s, exit_speed_mm_s: exit_v, acceleration_mm_s2, jerk_mm_s3 }
    }

    /// First, second and third derivative of the position by the place, `s` mm from the start of the piece.
    #[must_use]
    pub fn derivatives(&self, s: f64) -> [[f64; A]; 3] {
        let derivatives = self.curve.derivatives(s);
        [derivatives.first, derivatives.second, derivatives.third]
    }

    /// Whether the piece is a straight line.
    #[must_use]
    pub fn is_line(&self) -> bool {
        self.curve.is_line()
    }
}

/// Section of the committed plan between two stops or glides.
#[derive(Clone, Debug)]
pub struct PlannedSection<const A: usize> {
    /// Path of the section.
    pub pieces: Vec<PlannedPiece<A>>,
    /// Speed along the path: profiles that follow one another, each with its length in mm.
    pub profiles: Vec<(Profile, f64)>,
}

/// Sections of what `emitter` has not emitted, with feeds multiplied by `factor`.
pub(crate) fn sections<const A: usize>(
    emitter: &Emitter<A>,
    axes: &AxisLimits<A>,
    factor: f64,
) -> Vec<PlannedSection<A>> {
    let (mut all, mut profiles) = (Vec::new(), Vec::new());
    let (mut first, _) = emitter.front();
    for item in emitter.items() {
        match *item {
            PlanItem::Span { profile, length, .. } => profiles.push((profile, length)),
            PlanItem::Glide { piece } | PlanItem::Stop { piece, .. } => {
                let pieces = (first..piece).filter_map(|number| emitter.piece(number));
                let pieces: Vec<_> = pieces.map(|piece| PlannedPiece::new(piece, axes, factor)).collect();
                let profiles = std::mem::take(&mut profiles);
                if !profiles.is_empty() {
                    all.push(PlannedSection { pieces, profiles });
                }
                first = piece;
            }
        }
    }
    all
}
