//! Polar coordinates: `@` is the distance from the origin in the plane of X and Y, `^` the angle in degrees.
//!
//! Invariant: they replace X and Y of a motion, and nothing else.

use super::block_motion::BlockMotion;
use super::interpreter_core::Core;
use crate::block::{Words, letters};
use crate::canon_modes::Plane;
use crate::diag::{BlockResult, Span, fault};
use crate::error_codes::ErrorCode;
use crate::groups::GroupG;
use crate::modal::ModalState;
use crate::modal_groups::{DistanceMode, MotionMode};
use crate::pose::{Axis, Pose};

/// Checks that a block may have its polar words.
pub(super) fn check(words: &Words, to_be: BlockMotion, state: &ModalState) -> BlockResult<()> {
    let Some(letter) = words.first_of(b"@^") else { return Ok(()) };
    let at = words.span(letter);
    if !matches!(to_be, BlockMotion::Move(_)) {
        return fault(ErrorCode::PolarWithoutMotion, at, "polar coordinates need a motion");
    }
    if to_be == BlockMotion::Move(MotionMode::ControlPoint) {
        return fault(ErrorCode::PolarWithoutMotion, at, "a control point must be given with X and Y");
    }
    // The plane is the one before the block, as in LinuxCNC.
    if state.plane != Plane::Xy {
        return fault(
            ErrorCode::PolarWithoutMotion,
            at,
            "polar coordinates need the plane of G17, selected in an earlier block",
        );
    }
    if words.g(GroupG::NonModal) == Some(530) {
        return fault(ErrorCode::PolarWithoutMotion, at, "G53 does not accept polar coordinates");
    }
    match words.first_of(b"xy") {
        Some(other) => {
            let message = format!("polar coordinates replace {}", char::from(other.to_ascii_uppercase()));
            fault(ErrorCode::PolarMixed, words.span(other), message)
        }
        None => Ok(()),
    }
}

/// The polar words of a drilling cycle.
pub(super) struct PolarWords {
    /// `@`, in program units.
    distance: Option<f64>,
    /// `^`, in radians.
    angle: Option<f64>,
    at: Span,
}

impl PolarWords {
    /// Returns the polar words of a block, if it has any.
    pub(super) fn of(words: &Words) -> Option<PolarWords> {
        let letter = words.first_of(b"@^")?;
        let angle = words.get(b'^').map(f64::to_radians);
        Some(PolarWords { distance: words.get(b'@'), angle, at: words.span(letter) })
    }

    /// Returns the hole of G90, for the current position `(x, y)`. A missing word keeps its value; the origin has angle
    /// 0.
    pub(super) fn absolute(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let distance = self.distance.unwrap_or_else(|| x.hypot(y));
        let angle = self.angle.unwrap_or_else(|| y.atan2(x));
        (distance * angle.cos(), distance * angle.sin())
    }

    /// Returns the next hole of G91: first farther from the origin, then rotated about it.
    ///
    /// # Errors
    /// E1711 where the previous hole is at the origin, which has no direction.
    pub(super) fn step_from(&self, (mut x, mut y): (f64, f64)) -> BlockResult<(f64, f64)> {
        let steps = [(self.distance, 1.0, 0.0), (self.angle, 0.0, 1.0)];
        for (step, farther, turned) in steps {
            let Some(step) = step.filter(|step| *step != 0.0) else { continue };
            if x == 0.0 && y == 0.0 {
                let message = "in G91 polar coordinates need a direction, and the previous hole is at the origin";
                return fault(ErrorCode::PolarWithoutMotion, self.at, message);
            }
            let (distance, angle) = (x.hypot(y) + farther * step, y.atan2(x) + turned * step);
            (x, y) = (distance * angle.cos(), distance * angle.sin());
        }
        Ok((x, y))
    }
}

impl Core {
    /// Checks that polar words define a point: at the origin there is no direction to keep or to rotate.
    #[inline]
    pub(super) fn check_polar_words(&self, words: &Words) -> BlockResult<()> {
        const POLAR: u32 = letters(b"@^");
        let Some(letter) = words.has_any_of(POLAR).then(|| words.first_of(b"@^")).flatten() else { return Ok(()) };
        match self.polar_point(words) {
            Some(_) => Ok(()),
            None => {
                let message = "at the origin polar coordinates need @ and ^ both, and G90";
                fault(ErrorCode::PolarWithoutMotion, words.span(letter), message)
            }
        }
    }

    /// Sets X and Y of an end from the polar words.
    pub(super) fn polar_end(&self, words: &Words, end: &mut Pose) {
        if let Some((x, y)) = self.polar_point(words) {
            (end[Axis::X], end[Axis::Y]) = (x, y);
        }
    }

    /// Returns the point that the polar words define. A missing word keeps its value.
    fn polar_point(&self, words: &Words) -> Option<(f64, f64)> {
        let position = self.state.path_position();
        let (x, y) = (position[Axis::X], position[Axis::Y]);
        let (distance, angle) = (words.get(b'@'), words.get(b'^').map(f64::to_radians));
        let at = |distance: f64, angle: f64| (distance * angle.cos(), distance * angle.sin());
        let is_origin = |(x, y): (f64, f64)| x == 0.0 && y == 0.0;
        if self.state.distance == DistanceMode::Absolute {
            if is_origin((x, y)) && distance.is_some() && angle.is_none() {
                return None;
            }
            return Some(at(distance.unwrap_or_else(|| x.hypot(y)), angle.unwrap_or_else(|| y.atan2(x))));
        }
        // First farther along the direction, then rotated: both need a direction.
        let mut point = (x, y);
        if let Some(distance) = distance {
            if is_origin(point) {
                return None;
            }
            point = at(point.0.hypot(point.1) + distance, point.1.atan2(point.0));
        }
        if let Some(angle) = angle {
            if is_origin(point) {
                return None;
            }
            point = at(point.0.hypot(point.1), point.1.atan2(point.0) + angle);
        }
        Some(point)
    }
}
