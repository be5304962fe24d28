//! Execution of cutter radius compensation: G40, G41, G42, G41.1, G42.1, and compensated moves.
//!
//! Invariant: the position is that of the tool; the position on the programmed path is stored with the compensation.
//! The last move in the plane waits in the queue until the next corner determines its end.

use super::arc::ArcShape;
use super::compensation_corner::{
    CompensationCorner, CornerKind, Cutter, PriorArc, ProgrammedArc, check_arc, check_entry, entry_arc, entry_line,
    to_arc, to_line,
};
use super::interpreter_core::{Core, Emitter};
use super::motion::straight_canon;
use crate::angle::{sweep, turned_xy};
use crate::block::{Words, name_of_g};
use crate::canon::{ArcFeed, Canon};
use crate::canon_modes::Plane;
use crate::compensation::Point;
use crate::compensation::{Compensation, Side, tip_shift};
use crate::compensation_queue::QueueRole;
use crate::diag::{BlockResult, Span, fault};
use crate::error_codes::ErrorCode;
use crate::eval::to_whole_number;
use crate::groups::GroupG;
use crate::modal_groups::MotionMode;
use crate::pose::Pose;

/// The move after a corner, as programmed.
struct NextMove {
    cutter: Cutter,
    motion: MotionMode,
    corner: Point,
    end: Pose,
    at: Span,
}

impl Core {
    /// Executes G40, G41, G42, G41.1 and G42.1.
    pub(super) fn set_compensation(&mut self, code: u16, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let at = words.g_span(GroupG::CutterCompensation);
        if code == 400 {
            let finished = self.finish_path(at, emit);
            if let Some(programmed) = self.state.compensation.and_then(|compensation| compensation.programmed) {
                let shift = self.state.position.minus(&programmed);
                self.state.tool_shift = Some(turned_xy(shift, self.state.rotation_degrees));
                self.state.position = programmed;
                self.state.has_left_compensation = true;
            }
            self.state.compensation = None;
            finished?;
            emit.call(Canon::Note("interpreter: cutter radius compensation off"));
            return Ok(());
        }
        if self.is_cutter_unknown(words) {
            self.state.forget_compensation();
            return Ok(());
        }
        if !matches!(self.state.plane, Plane::Xy | Plane::Zx) {
            return fault(ErrorCode::CompensationPlane, at, ErrorCode::CompensationPlane.title());
        }
        if self.state.compensation.is_some() {
            return fault(ErrorCode::CompensationTwice, at, ErrorCode::CompensationTwice.title());
        }
        let (diameter, orientation) =
            if code % 10 == 1 { self.given_cutter(code, words)? } else { self.cutter_of_table(code, words)? };
        let side = if code < 420 { Side::Left } else { Side::Right };
        let side = if diameter < 0.0 { side.other() } else { side };
        let radius = (diameter / 2.0).abs();
        emit.call(Canon::Note(match side {
            Side::Left => "interpreter: cutter radius compensation on left",
            Side::Right => "interpreter: cutter radius compensation on right",
        }));
        self.state.compensation = Some(Compensation { side, radius, programmed: None });
        let plane = self.state.plane;
        emit.waiting.begin(plane, tip_shift(plane, orientation, radius), self.state.units);
        Ok(())
    }

    /// Returns diameter in program units and orientation from D and L.
    fn given_cutter(&self, code: u16, words: &Words) -> BlockResult<(f64, i32)> {
        let Some(diameter) = words.get(b'd') else {
            let at = words.g_span(GroupG::CutterCompensation);
            return fault(ErrorCode::WordMissing, at, format!("{} needs a D word: the diameter", name_of_g(code)));
        };
        let orientation = match words.get(b'l') {
            Some(_) if self.state.plane != Plane::Zx => {
                let message = "only a lathe tool has an orientation, and it can be compensated in G18 only";
                return fault(ErrorCode::CompensationLathe, words.span(b'l'), message);
            }
            Some(orientation) => to_whole_number(orientation, words.span(b'l'), "L")?,
            None => 0,
        };
        Ok((diameter, orientation))
    }

    /// Returns diameter in program units and orientation of the tool that D names, or of the one in the spindle.
    fn cutter_of_table(&self, code: u16, words: &Words) -> BlockResult<(f64, i32)> {
        let number = match words.get(b'd').unwrap_or_default() {
            0.0 => f64::from(self.state.current_tool),
            number if number < 0.0 => {
                return fault(
                    ErrorCode::NegativeValue,
                    words.span(b'd'),
                    "D must not be negative here: it is a tool's number",
                );
            }
            number => number,
        };
        let tool = self.tool(number, words, b'd')?;
        let orientation = tool.orientation as i32;
        if self.state.plane != Plane::Zx && !matches!(orientation, 0 | 9) {
            let message = format!(
                "tool {} is a lathe tool of orientation {orientation}: {} needs G18 for it",
                tool.number,
                name_of_g(code)
            );
            return fault(ErrorCode::CompensationLathe, words.g_span(GroupG::CutterCompensation), message);
        }
        Ok((self.to_program_unit(crate::pose::Axis::X, tool.diameter), orientation))
    }

    /// Releases the queued moves unchanged: the path ends here for now.
    pub(super) fn finish_path(&mut self, at: Span, emit: &mut Emitter<'_>) -> BlockResult<()> {
        if emit.waiting.is_empty() {
            return Ok(());
        }
        let here = self.in_plane(&self.state.position);
        emit.waiting.end_at(here, at, emit.steps, emit.number)
    }

    fn in_plane(&self, pose: &Pose) -> Point {
        let [first, second, _] = self.state.plane.axes();
        (pose[first], pose[second])
    }

    fn with_plane(&self, pose: &Pose, point: Point) -> Pose {
        let [first, second, _] = self.state.plane.axes();
        let mut pose = *pose;
        (pose[first], pose[second]) = point;
        pose
    }

    /// Returns the cutter in force and the programmed position. Both are `None` without compensation, the latter also
    /// before the first move.
    fn cutter(&self) -> Option<(Cutter, Option<Pose>)> {
        let Compensation { side, radius, programmed } = self.state.compensation?;
        Some((Cutter { side, radius }, programmed))
    }

    fn corner(&self, programmed: Point, emit: &Emitter<'_>) -> CompensationCorner {
        let arc = emit.waiting.arc().map(|(centre, end, turns)| PriorArc {
            centre,
            radius: (centre.0 - end.0).hypot(centre.1 - end.1),
            turns,
        });
        CompensationCorner { programmed, centre: self.in_plane(&self.state.position), arc }
    }

    /// Emits a compensated straight move, whose programmed end is `end`.
    ///
    /// # Errors
    /// The move, or the one before, is too short for the tool. The next move then leads to the path again.
    pub(super) fn compensated_straight(
        &mut self,
        motion: MotionMode,
        end: Pose,
        words: &Words,
        emit: &mut Emitter<'_>,
    ) -> BlockResult<()> {
        let done = self.straight_on(motion, end, words, emit);
        if done.is_err() {
            self.lose_path(end, emit);
        }
        done
    }

    fn straight_on(&mut self, motion: MotionMode, end: Pose, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let Some((cutter, programmed)) = self.cutter() else { return Ok(()) };
        let at = move_span(words);
        let (here, to) = (self.in_plane(&self.state.position), self.in_plane(&end));
        let (to_centre, direction) = match programmed.map(|programmed| self.in_plane(&programmed)) {
            None => {
                let (to_centre, normal) = entry_line(cutter, here, to, at)?;
                emit.waiting.set_start(here);
                (to_centre, (normal.cos(), normal.sin()))
            }
            Some(from) if from == to => (here, (0.0, 0.0)),
            Some(from) => {
                let (to_centre, kind) = to_line(cutter, &self.corner(from, emit), to, at)?;
                // LinuxCNC checks here that the previous move is long enough; before an arc it does not.
                if let CornerKind::Convex(_) = kind {
                    emit.waiting.end_at(here, at, emit.steps, emit.number)?;
                }
                self.connect(kind, &NextMove { cutter, motion, corner: from, end, at }, emit)?;
                (to_centre, (to.0 - from.0, to.1 - from.1))
            }
        };
        let tool_end = self.with_plane(&end, to_centre);
        emit.waiting.push(emit.line, straight_canon(motion, tool_end), QueueRole::Straight(direction));
        self.store_end(end, tool_end);
        Ok(())
    }

    /// Checks an arc as the move that leads to the compensated path; any other arc passes.
    pub(super) fn check_entry_arc(&self, shape: &ArcShape, centre: Point) -> BlockResult<()> {
        let Some((cutter, None)) = self.cutter() else { return Ok(()) };
        check_entry(cutter, shape.start, shape.end, shape.at)?;
        let radius = (centre.0 - shape.start.0).hypot(centre.1 - shape.start.1);
        check_arc(cutter, radius, shape.turns, shape.at)
    }

    /// Emits the compensated arc of this programmed arc.
    ///
    /// # Errors
    /// The arc, or the move before, is too short or too small for the tool. The next move then leads to the path again.
    pub(super) fn compensated_arc(
        &mut self,
        shape: &ArcShape,
        centre: Point,
        end: Pose,
        emit: &mut Emitter<'_>,
    ) -> BlockResult<()> {
        let done = self.arc_on(shape, centre, end, emit);
        if done.is_err() {
            self.lose_path(end, emit);
        }
        done
    }

    fn arc_on(&mut self, shape: &ArcShape, centre: Point, end: Pose, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let Some((cutter, programmed)) = self.cutter() else { return Ok(()) };
        let (at, turns) = (shape.at, shape.turns);
        let arc = ProgrammedArc { centre, end: shape.end, turns };
        let here = self.in_plane(&self.state.position);
        let (to_centre, centre, angle) = match programmed {
            None => {
                let (to_centre, centre) = entry_arc(cutter, here, &arc, at)?;
                if emit.waiting.is_shifted() {
                    // The arc begins with the tip's centre at the former controlled point, so the tool first moves
                    // there.
                    let start = self.with_normal(&end, here);
                    emit.waiting.push(emit.line, Canon::StraightFeed(start), QueueRole::Fixed);
                    emit.waiting.set_start(here);
                }
                (to_centre, centre, sweep(here, to_centre, centre, turns))
            }
            Some(_) => {
                let (to_centre, kind) = to_arc(cutter, &self.corner(shape.start, emit), &arc, at)?;
                let motion = if turns > 0 { MotionMode::ArcCounterclockwise } else { MotionMode::ArcClockwise };
                self.connect(kind, &NextMove { cutter, motion, corner: shape.start, end, at }, emit)?;
                (to_centre, centre, sweep(shape.start, shape.end, centre, turns))
            }
        };
        let tool_end = self.with_plane(&end, to_centre);
        let feed =
            ArcFeed { plane: self.state.plane, end: tool_end, first_centre: centre.0, second_centre: centre.1, turns };
        emit.waiting.push(emit.line, Canon::ArcFeed(feed), QueueRole::Arc(angle));
        self.store_end(end, tool_end);
        Ok(())
    }

    /// Returns this end with a point of the plane, at the height of the current position: a corner is rounded before
    /// the tool rises.
    fn with_normal(&self, end: &Pose, point: Point) -> Pose {
        let [_, _, normal] = self.state.plane.axes();
        let mut pose = self.with_plane(end, point);
        pose[normal] = self.state.position[normal];
        pose
    }

    /// Ends the previous move at the corner, and moves about an outer corner; a rapid move does so on a straight line.
    fn connect(&mut self, kind: CornerKind, next: &NextMove, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let start = match kind {
            CornerKind::Smooth => self.in_plane(&self.state.position),
            CornerKind::Concave(_) if emit.waiting.is_empty() => {
                return fault(ErrorCode::CompensationLate, next.at, ErrorCode::CompensationLate.title());
            }
            CornerKind::Concave(point) => return emit.waiting.end_at(point, next.at, emit.steps, emit.number),
            CornerKind::Convex(point) => {
                let end = self.with_normal(&next.end, point);
                let canon = match next.motion {
                    MotionMode::Traverse => Canon::StraightTraverse(end),
                    _ => Canon::ArcFeed(ArcFeed {
                        plane: self.state.plane,
                        end,
                        first_centre: next.corner.0,
                        second_centre: next.corner.1,
                        turns: next.cutter.corner_turns(),
                    }),
                };
                emit.waiting.push(emit.line, canon, QueueRole::Arc(0.0));
                point
            }
        };
        emit.waiting.release(emit.steps, emit.number);
        emit.waiting.set_start(start);
        Ok(())
    }

    /// Continues at the programmed end after an error, so that errors of later moves are their own.
    fn lose_path(&mut self, end: Pose, emit: &mut Emitter<'_>) {
        emit.waiting.clear();
        self.state.position = end;
        if let Some(compensation) = &mut self.state.compensation {
            compensation.programmed = None;
        }
    }

    /// Refuses another block when too much is queued.
    ///
    /// # Errors
    /// E1662; the queue is then empty, and the next move leads to the path again.
    pub(super) fn check_waiting(&mut self, emit: &mut Emitter<'_>) -> BlockResult<()> {
        if !emit.waiting.is_full() {
            return Ok(());
        }
        self.lose_path(*self.state.path_position(), emit);
        fault(ErrorCode::CompensationWaits, Span::default(), ErrorCode::CompensationWaits.title())
    }

    /// Stores the end of a move in the state.
    fn store_end(&mut self, programmed: Pose, tool: Pose) {
        self.state.position = tool;
        if let Some(compensation) = &mut self.state.compensation {
            compensation.programmed = Some(programmed);
        }
    }
}

fn move_span(words: &Words) -> Span {
    match words.first_of(super::block_motion::AXES) {
        Some(letter) => words.span(letter),
        None => words.g_span(GroupG::Motion),
    }
}
