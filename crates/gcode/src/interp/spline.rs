//! Splines: G5 (cubic), G5.1 (quadratic), G5.2 and G5.3 (control points one by one).
//!
//! Invariant: a spline begins at the position, ends at its last control point, and stays in the plane of X and Y.

use super::interpreter_core::{Core, Emitter};
use crate::block::Words;
use crate::canon::Canon;
use crate::canon_modes::{FeedMode, Plane};
use crate::diag::{BlockResult, fault};
use crate::error_codes::ErrorCode;
use crate::groups::GroupG;
use crate::modal_groups::MotionMode;
use crate::pose::Axis;
use crate::spline::{ControlPoint, Nurbs};

/// Order of a G5.2 without an L word, and minimum order.
const MIN_ORDER: u32 = 3;
/// Maximum number of collected control points.
const MAX_POINTS: usize = 50_000;

impl Core {
    /// Executes G5 and G5.1. They do not change the motion mode.
    pub(super) fn spline(&mut self, motion: MotionMode, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        self.check_spline_feed(words)?;
        let at = words.g_span(GroupG::Motion);
        if self.state.plane != Plane::Xy {
            return fault(ErrorCode::SplinePlane, at, ErrorCode::SplinePlane.title());
        }
        if let Some(letter) = words.first_of(b"zabcuvw") {
            let name = char::from(letter.to_ascii_uppercase());
            return fault(ErrorCode::SplineAxis, words.span(letter), format!("{name} is not allowed in a spline"));
        }
        let (start, end) = (self.state.position, self.end_of(words));
        let first = ControlPoint::plain(start[Axis::X], start[Axis::Y]);
        let last = ControlPoint::plain(end[Axis::X], end[Axis::Y]);
        let away = match (words.get(b'i'), words.get(b'j')) {
            (Some(i), Some(j)) => Some((i, j)),
            (None, None) => None,
            _ => return fault(ErrorCode::SplineWords, at, "a spline has both I and J, or neither"),
        };
        let along = |(x, y): (f64, f64)| ControlPoint::plain(first.x + x, first.y + y);
        let points = if motion == MotionMode::QuadraticSpline {
            let Some(away) = away else { return fault(ErrorCode::SplineWords, at, "G5.1 needs I and J") };
            [first, along(away), last].into()
        } else {
            let (Some(p), Some(q)) = (words.get(b'p'), words.get(b'q')) else {
                return fault(ErrorCode::SplineWords, at, "G5 needs P and Q");
            };
            // Without I and J it continues in the direction in which the last one ended.
            let second = along(away.unwrap_or(self.state.spline_direction));
            self.state.spline_direction = (-p, -q);
            [first, second, ControlPoint::plain(last.x + p, last.y + q), last].into()
        };
        let order = if motion == MotionMode::QuadraticSpline { 3 } else { 4 };
        emit.call(Canon::NurbsFeed(Nurbs { order, points }));
        self.state.position = end;
        Ok(())
    }

    fn check_spline_feed(&self, words: &Words) -> BlockResult<()> {
        let at = words.g_span(GroupG::Motion);
        match self.state.feed_mode {
            FeedMode::InverseTime if !words.has(b'f') => {
                fault(ErrorCode::InverseTimeFeed, at, ErrorCode::InverseTimeFeed.title())
            }
            FeedMode::InverseTime => Ok(()),
            _ if self.state.feed_rate == 0.0 => {
                fault(ErrorCode::ZeroFeed, at, "a feed move needs a feed rate, and none is set")
            }
            _ => Ok(()),
        }
    }

    /// Executes G5.2: adds a control point; the first one is the position.
    pub(super) fn control_point(&mut self, words: &Words) -> BlockResult<()> {
        let is_first = self.state.motion != Some(MotionMode::ControlPoint);
        let at = words.first_of(b"xy").map_or_else(|| words.g_span(GroupG::Motion), |letter| words.span(letter));
        if words.has(b'x') != words.has(b'y') {
            return fault(ErrorCode::SplineWords, at, "a control point has both X and Y");
        }
        let has_point = words.has(b'x');
        let weight = words.get(b'p');
        if !is_first && has_point != weight.is_some() {
            return fault(ErrorCode::SplineWords, at, "a control point has X, Y and a weight P");
        }
        if let Some(weight) = weight.filter(|weight| *weight <= 0.0) {
            let message = format!("the weight of a control point must be above 0, not {weight}");
            return fault(ErrorCode::SplineWords, words.span(b'p'), message);
        }
        self.check_spline_feed_of_points(words)?;
        let end = self.end_of(words);
        let state = &mut self.state;
        if is_first {
            let start = ControlPoint::plain(state.position[Axis::X], state.position[Axis::Y]);
            state.control_points = vec![start];
            state.spline_order = MIN_ORDER;
        }
        if let Some(order) = words.get(b'l') {
            state.spline_order = (order as u32).max(MIN_ORDER);
        }
        if has_point && state.control_points.len() >= MAX_POINTS {
            let message = format!("a spline has at most {MAX_POINTS} control points");
            return fault(ErrorCode::SplineWords, at, message);
        }
        if has_point {
            let weight = weight.unwrap_or(1.0);
            state.control_points.push(ControlPoint { x: end[Axis::X], y: end[Axis::Y], weight });
        }
        state.motion = Some(MotionMode::ControlPoint);
        Ok(())
    }

    fn check_spline_feed_of_points(&self, words: &Words) -> BlockResult<()> {
        if self.state.feed_mode == FeedMode::InverseTime || self.state.feed_rate > 0.0 {
            return Ok(());
        }
        let at = words.g_span(GroupG::Motion);
        fault(ErrorCode::ZeroFeed, at, "a feed move needs a feed rate, and none is set")
    }

    /// Executes G5.3: emits the spline through the points of G5.2. No motion mode is in force after it.
    pub(super) fn end_of_points(&mut self, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let at = words.g_span(GroupG::Motion);
        let state = &mut self.state;
        if state.motion != Some(MotionMode::ControlPoint) {
            return fault(ErrorCode::SplineNotBegun, at, ErrorCode::SplineNotBegun.title());
        }
        let (order, count) = (state.spline_order, state.control_points.len());
        if count < order as usize {
            let message = format!("a spline of order {order} needs {order} control points, and there are {count}");
            return fault(ErrorCode::SplineTooShort, at, message);
        }
        let points = std::mem::take(&mut state.control_points);
        if let Some(last) = points.last() {
            (state.position[Axis::X], state.position[Axis::Y]) = (last.x, last.y);
        }
        emit.call(Canon::NurbsFeed(Nurbs { order, points: points.into() }));
        state.motion = None;
        Ok(())
    }
}
