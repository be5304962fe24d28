//! Straight moves and arcs.
//!
//! Invariant: a move is emitted with its end in program coordinates, and the position follows it.

use super::arc::{ArcShape, Radii, from_centre, from_radius};
use super::check::turns_of;
use super::interpreter_core::{Core, Emitter};
use crate::angle::rotate;
use crate::block::{Words, letters};
use crate::canon::{ArcFeed, Canon};
use crate::canon_modes::{FeedMode, Plane};
use crate::diag::{BlockResult, Span, fault};
use crate::error_codes::ErrorCode;
use crate::groups::GroupG;
use crate::modal_groups::{ArcCentres, DistanceMode, MotionMode};
use crate::pose::{Axis, Pose};

/// Maximum duration of a feed move in minutes: one day.
const MAX_MOVE_MINUTES: f64 = 1440.0;

/// Radius of an arc times its turns above which its duration is checked at any feed.
const LONG_ARC_REACH: f64 = 1000.0;

/// Maximum distance on the linear axes that counts as zero.
const TINY_DISTANCE: f64 = 1e-7;

impl Core {
    /// Executes the block's motion.
    #[inline]
    pub(super) fn move_along(&mut self, motion: MotionMode, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        if self.state.tool_shift.is_some() {
            self.state.tool_shift = None;
        }
        // A cycle has its own rules at the origin.
        if !matches!(motion, MotionMode::Cycle(_)) {
            self.check_polar_words(words)?;
        }
        match motion {
            MotionMode::Traverse => {
                (self.state.motion, self.state.series) = (Some(motion), None);
                let end = self.end_of(words);
                self.straight(motion, end, words, emit)
            }
            MotionMode::Feed => {
                self.check_feed(words)?;
                (self.state.motion, self.state.series) = (Some(motion), None);
                let end = self.end_of(words);
                if self.state.feed_mode == FeedMode::InverseTime {
                    let length = straight_length(self.state.path_position(), &end);
                    self.set_inverse_time_rate(length, words, emit);
                }
                self.straight(motion, end, words, emit)
            }
            MotionMode::ArcClockwise | MotionMode::ArcCounterclockwise => {
                self.state.series = None;
                self.arc(motion, words, emit)
            }
            MotionMode::Cycle(cycle) => self.canned_cycle(cycle, words, emit),
            MotionMode::SpindleFeed | MotionMode::RigidTap => {
                self.state.series = None;
                self.synchronised_move(motion, words, emit)
            }
            MotionMode::ThreadingCycle => {
                self.state.series = None;
                self.threading_cycle(words, emit)
            }
            MotionMode::CubicSpline | MotionMode::QuadraticSpline => self.spline(motion, words, emit),
            MotionMode::ControlPoint => self.control_point(words),
            MotionMode::EndOfPoints => self.end_of_points(words, emit),
            MotionMode::Probe(probing) => self.probe(probing, words, emit),
        }
    }

    #[inline]
    fn straight(&mut self, motion: MotionMode, end: Pose, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        // At higher feeds no machine is large enough for a move to take that long.
        if motion == MotionMode::Feed && self.state.feed_rate < 10.0 {
            self.check_duration(straight_length(self.state.path_position(), &end), words)?;
        }
        self.state.has_left_compensation = false;
        if self.state.compensation.is_some_and(|compensation| compensation.radius > 0.0) {
            return self.compensated_straight(motion, end, words, emit);
        }
        if words.g(GroupG::NonModal) == Some(530) {
            emit.call(Canon::MachineCoordinates);
        }
        emit.call(straight_canon(motion, end));
        self.state.position = end;
        (self.state.cutting.is_displaced, self.state.cutting.open_circle) = (false, None);
        Ok(())
    }

    pub(super) fn check_feed(&self, words: &Words) -> BlockResult<()> {
        let at = || match words.first_of(b"xyzabcuvwijkr") {
            _ if words.g(GroupG::Motion).is_some() => words.g_span(GroupG::Motion),
            Some(letter) => words.span(letter),
            None => Span::default(),
        };
        match self.state.feed_mode {
            FeedMode::UnitsPerMinute | FeedMode::UnitsPerRevolution if self.state.feed_rate == 0.0 => {
                fault(ErrorCode::ZeroFeed, at(), "a feed move needs a feed rate, and none is set")
            }
            FeedMode::UnitsPerRevolution if self.state.spindle_speed == 0.0 => {
                fault(ErrorCode::ZeroSpindleSpeed, at(), ErrorCode::ZeroSpindleSpeed.title())
            }
            FeedMode::InverseTime if !words.has(b'f') => {
                fault(ErrorCode::InverseTimeFeed, at(), ErrorCode::InverseTimeFeed.title())
            }
            _ => Ok(()),
        }
    }

    /// Refuses a feed move that takes longer than a day, which indicates a mistake in its feed or its length.
    #[cold]
    fn check_duration(&self, length: f64, words: &Words) -> BlockResult<()> {
        let minutes = length / self.state.feed_rate;
        if self.state.feed_mode == FeedMode::UnitsPerRevolution || minutes.is_nan() || minutes <= MAX_MOVE_MINUTES {
            return Ok(());
        }
        let at = match words.first_of(b"fxyzabcuvwijkr@^") {
            Some(letter) => words.span(letter),
            None => words.g_span(GroupG::Motion),
        };
        let feed = self.state.feed_rate;
        fault(
            ErrorCode::MoveTooLong,
            at,
            format!("{length:.3} at a feed of {feed} would take {:.1} hours", minutes / 60.0),
        )
    }

    fn set_inverse_time_rate(&mut self, length: f64, words: &Words, emit: &mut Emitter<'_>) {
        let rate = length * words.get(b'f').unwrap_or_default();
        self.state.feed_rate = rate;
        emit.call(Canon::SetFeedRate(self.shared_rate()));
    }

    /// Returns the end that the axis words give. An axis without a word keeps its position.
    #[inline]
    pub(super) fn end_of(&self, words: &Words) -> Pose {
        let state = &self.state;
        if words.g(GroupG::NonModal) == Some(530) {
            return self.end_in_machine_coordinates(words);
        }
        let mut end = *state.path_position();
        let incremental = state.distance == DistanceMode::Incremental;
        const OTHERS: u32 = letters(b"abcuvw");
        let count = if words.has_any_of(OTHERS) { 9 } else { 3 };
        for (axis, letter) in end.0.iter_mut().zip(*b"xyzabcuvw").take(count) {
            if let Some(given) = words.get(letter) {
                *axis = if incremental { *axis + given } else { given };
            }
        }
        if words.has_any(b"@^") {
            self.polar_end(words, &mut end);
        }
        end
    }

    /// Returns the end of a G53 move, whose axis words are machine coordinates.
    fn end_in_machine_coordinates(&self, words: &Words) -> Pose {
        let state = &self.state;
        let mut end = state.position;
        let mut x = state.position[Axis::X] + state.g92_offset[Axis::X];
        let mut y = state.position[Axis::Y] + state.g92_offset[Axis::Y];
        (x, y) = rotate(x, y, state.rotation_degrees);
        if let Some(given) = words.get(b'x') {
            x = given - state.origin[Axis::X] - state.tool_offset[Axis::X];
        }
        if let Some(given) = words.get(b'y') {
            y = given - state.origin[Axis::Y] - state.tool_offset[Axis::Y];
        }
        (x, y) = rotate(x, y, -state.rotation_degrees);
        end[Axis::X] = x - state.g92_offset[Axis::X];
        end[Axis::Y] = y - state.g92_offset[Axis::Y];
        for axis in &Axis::ALL[2..] {
            if let Some(given) = words.get(axis.letter().to_ascii_lowercase()) {
                let tool = if axis.is_rotary() { 0.0 } else { state.tool_offset[*axis] };
                end[*axis] = given - state.origin[*axis] - state.g92_offset[*axis] - tool;
            }
        }
        end
    }

    fn arc(&mut self, motion: MotionMode, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let at =
            words.first_of(b"rijkxyzabcuvw").map_or_else(|| words.g_span(GroupG::Motion), |letter| words.span(letter));
        if self.state.has_left_compensation {
            return fault(ErrorCode::CompensationExit, at, ErrorCode::CompensationExit.title());
        }
        let has_centre = words.has_any(b"ijk");
        if words.has(b'r') && has_centre {
            return fault(ErrorCode::ArcMixed, at, ErrorCode::ArcMixed.title());
        }
        if !words.has(b'r') && !has_centre {
            return fault(ErrorCode::ArcWordsMissing, at, ErrorCode::ArcWordsMissing.title());
        }
        self.check_feed(words)?;
        if !self.state.plane.has_arcs() {
            return fault(ErrorCode::ArcPlane, at, ErrorCode::ArcPlane.title());
        }
        let centre = self.centre_words(words, at)?;
        let [first, second, normal] = self.state.plane.axes();
        let letter = |axis: Axis| axis.letter().to_ascii_lowercase();
        let is_polar = self.state.plane == Plane::Xy && words.has_any(b"@^");
        if centre.is_none() && !words.has(letter(first)) && !words.has(letter(second)) && !is_polar {
            return fault(ErrorCode::ArcNoEnd, at, ErrorCode::ArcNoEnd.title());
        }
        self.state.motion = Some(motion);
        let (start, end) = (*self.state.path_position(), self.end_of(words));
        let turns = match words.get(b'p') {
            Some(turns) => turns_of(turns, words)?,
            None => 1,
        };
        let shape = ArcShape {
            start: (start[first], start[second]),
            end: (end[first], end[second]),
            turns: if motion == MotionMode::ArcClockwise { -turns } else { turns },
            radii: Radii::for_units(self.state.units),
            at,
        };
        let (first_centre, second_centre) = match (centre, words.get(b'r')) {
            (None, Some(radius)) => from_radius(&shape, radius)?,
            (offset, _) => from_centre(&shape, offset.unwrap_or_default(), self.state.arc_centres)?,
        };
        let is_compensated = self.state.compensation.is_some_and(|compensation| compensation.radius > 0.0);
        if is_compensated {
            self.check_entry_arc(&shape, (first_centre, second_centre))?;
        }
        if self.state.feed_mode == FeedMode::InverseTime {
            let length = shape.length((first_centre, second_centre), end[normal] - start[normal]);
            self.set_inverse_time_rate(length, words, emit);
        }
        let centre = (first_centre, second_centre);
        let reach = (shape.start.0 - centre.0).hypot(shape.start.1 - centre.1) * f64::from(turns);
        if self.state.feed_rate < 10.0 || reach > LONG_ARC_REACH {
            self.check_duration(shape.length(centre, end[normal] - start[normal]), words)?;
        }
        if is_compensated {
            let ends = (shape.start, shape.end);
            let slow =
                if self.cutting.is_some() { self.compensated_hole_rate(ends, centre, shape.turns) } else { None };
            if let Some(rate) = slow {
                emit.call(Canon::SetFeedRate(rate));
            }
            self.compensated_arc(&shape, centre, end, emit)?;
            if slow.is_some() {
                emit.call(Canon::SetFeedRate(self.shared_rate()));
            }
            return Ok(());
        }
        let plane = self.state.plane;
        let feed = ArcFeed { plane, end, first_centre, second_centre, turns: shape.turns };
        if self.cutting.is_some() {
            self.cutting_arc(shape.start, feed, emit);
        } else {
            emit.call(Canon::ArcFeed(feed));
        }
        self.state.position = end;
        Ok(())
    }

    /// Returns the centre words of the plane, in the order of its axes; `None` for an arc with R.
    fn centre_words(&self, words: &Words, at: Span) -> BlockResult<Option<(f64, f64)>> {
        if words.has(b'r') {
            return Ok(None);
        }
        let [first, second, normal] = self.state.plane.axes().map(|axis| b"ijk"[axis as usize]);
        let name = |letter: u8| char::from(letter.to_ascii_uppercase());
        if words.has(normal) {
            let message = format!("{} does not belong to the selected plane", name(normal));
            return fault(ErrorCode::ArcWrongWord, words.span(normal), message);
        }
        if self.state.arc_centres == ArcCentres::Absolute {
            for letter in [first, second] {
                if !words.has(letter) {
                    let message = format!("{} is missing: with G90.1 both centre words are needed", name(letter));
                    return fault(ErrorCode::ArcAbsoluteCentre, at, message);
                }
            }
        }
        Ok(Some((words.get(first).unwrap_or_default(), words.get(second).unwrap_or_default())))
    }
}

/// Returns a straight move of this mode.
#[inline]
pub(super) fn straight_canon(motion: MotionMode, end: Pose) -> Canon {
    if motion == MotionMode::Traverse { Canon::StraightTraverse(end) } else { Canon::StraightFeed(end) }
}

/// Returns the distance between two points for inverse time feed: along X Y Z; if they stay, along U V W; if those stay
/// too, the rotation of A B C.
fn straight_length(start: &Pose, end: &Pose) -> f64 {
    let distance = |axes: [Axis; 3]| {
        let [p, q, r] = axes.map(|axis| end[axis] - start[axis]);
        let moved = p.abs() > TINY_DISTANCE || q.abs() > TINY_DISTANCE || r.abs() > TINY_DISTANCE;
        (moved, (p * p + q * q + r * r).sqrt())
    };
    match (distance([Axis::X, Axis::Y, Axis::Z]), distance([Axis::U, Axis::V, Axis::W])) {
        ((true, length), _) | (_, (true, length)) => length,
        _ => distance([Axis::A, Axis::B, Axis::C]).1,
    }
}
