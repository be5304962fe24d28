//! Polar coordinates: `@` is the distance from the origin in the plane of X and Y, `^` the angle in degrees.
//!
//! Invariant: they stand for X and Y of a motion, and for nothing else.

use super::Core;
use super::check::MotionToBe;
use crate::block::Words;
use crate::canon::Plane;
use crate::codes::Code;
use crate::diag::{Outcome, fault};
use crate::groups::GroupG;
use crate::modal::{Distance, Motion, State};
use crate::pose::{Axis, Pose};

/// Whether a block's polar words may stand where they do.
pub(super) fn check(words: &Words, to_be: MotionToBe, state: &State) -> Outcome<()> {
    let Some(letter) = words.first_of(b"@^") else { return Ok(()) };
    let at = words.span(letter);
    if !matches!(to_be, MotionToBe::Move(_)) {
        return fault(Code::PolarWithoutMotion, at, "polar coordinates belong to a motion");
    }
    if to_be == MotionToBe::Move(Motion::ControlPoint) {
        return fault(Code::PolarWithoutMotion, at, "a control point is given with X and Y");
    }
    // The plane is the one before the block, as in the peer.
    if state.plane != Plane::Xy {
        return fault(Code::PolarWithoutMotion, at, "polar coordinates lie in the plane of G17, selected before");
    }
    if words.g(GroupG::NonModal) == Some(530) {
        return fault(Code::PolarWithoutMotion, at, "G53 takes no polar coordinates");
    }
    match words.first_of(b"xy") {
        Some(other) => {
            let message = format!("polar coordinates stand for {}", char::from(other.to_ascii_uppercase()));
            fault(Code::PolarMixed, words.span(other), message)
        }
        None => Ok(()),
    }
}

impl Core {
    /// At the origin polar words mean a point only with an angle and absolute.
    pub(super) fn check_polar_words(&self, words: &Words) -> Outcome<()> {
        let Some(letter) = words.first_of(b"@^") else { return Ok(()) };
        let at = words.span(letter);
        let position = self.state.path_position();
        if position[Axis::X] != 0.0 || position[Axis::Y] != 0.0 {
            return Ok(());
        }
        if self.state.distance == Distance::Incremental {
            return fault(Code::PolarWithoutMotion, at, "at the origin there is nothing to go on from: use G90");
        }
        if words.has(b'@') && !words.has(b'^') {
            return fault(Code::PolarWithoutMotion, at, "at the origin an angle (^) is needed too");
        }
        Ok(())
    }

    /// Changes X and Y of an end to what the polar words say; a word that is missing keeps its value.
    pub(super) fn polar_end(&self, words: &Words, end: &mut Pose) {
        let position = self.state.path_position();
        let (x, y) = (position[Axis::X], position[Axis::Y]);
        let is_incremental = self.state.distance == Distance::Incremental;
        let combine = |given: Option<f64>, now: f64| match given {
            Some(given) if is_incremental => now + given,
            Some(given) => given,
            None => now,
        };
        let distance = combine(words.get(b'@'), x.hypot(y));
        let angle = combine(words.get(b'^').map(f64::to_radians), y.atan2(x));
        (end[Axis::X], end[Axis::Y]) = (distance * angle.cos(), distance * angle.sin());
    }
}
