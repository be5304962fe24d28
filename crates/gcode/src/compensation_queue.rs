//! The queue of cutter radius compensation: moves whose end the next corner may still change, and the functions after
//! them.
//!
//! Invariant: the first element is a move in the plane of compensation, so that an empty queue passes everything at
//! once. Elements leave in the order in which they entered. The queue allocates nothing once its buffer has grown.

use crate::angle::sweep;
use crate::block_number::BlockNumber;
use crate::canon::{Canon, CanonStep};
use crate::canon_modes::{LengthUnit, Plane};
use crate::compensation::{Point, UNSHIFTED};
use crate::diag::{BlockResult, Span, fault};
use crate::error_codes::ErrorCode;
use crate::pose::Pose;

/// N word of the block that releases an element. LinuxCNC prints that one, not the number of the originating block.
pub(crate) type Number = Option<BlockNumber>;

/// Angle in radians by which an arc may exceed its programmed sweep when its end is moved and the unit is the inch.
/// LinuxCNC converts it like a length.
const MORE_SWEEP: f64 = 0.001;

/// Maximum difference of the radii of an arc at its old and its new end, in program units.
const RADII_DIFFER: f64 = 0.01;

/// Effect on a queued canonical function when the end of the last move in the plane is moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum QueueRole {
    /// A straight move in this programmed direction; `None` is a move along other axes, which stays above the end.
    Straight(Point),
    /// An arc with this programmed sweep in radians.
    Arc(f64),
    /// A move that stays unchanged.
    Fixed,
    /// Not a move.
    Other,
}

/// Maximum number of queued functions: a streamed program may never reach its next corner.
const MAX_WAITING: usize = 10_000;

#[derive(Clone, Debug, PartialEq)]
struct QueuedFunction {
    line: u32,
    canon: Canon,
    role: QueueRole,
}

/// Functions that wait for the next corner.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct CompensationQueue {
    waiting: Vec<QueuedFunction>,
    plane: Plane,
    /// Position of the compensated path before the queued moves. `None` where it is unknown, and then nothing is
    /// checked.
    start: Option<Point>,
    /// Vector from the centre of the tool's tip to the controlled point, in the plane; not zero for lathe tools.
    shift: Point,
    /// Angle by which an arc may exceed its programmed sweep, in radians.
    more_sweep: f64,
}

impl Default for CompensationQueue {
    fn default() -> CompensationQueue {
        CompensationQueue {
            waiting: Vec::new(),
            plane: Plane::Xy,
            start: None,
            shift: UNSHIFTED,
            more_sweep: MORE_SWEEP,
        }
    }
}

impl CompensationQueue {
    /// Clears the queue and sets it up for a plane and a tool.
    pub(crate) fn begin(&mut self, plane: Plane, shift: Point, units: LengthUnit) {
        self.clear();
        (self.plane, self.shift) = (plane, shift);
        self.more_sweep = MORE_SWEEP * (LengthUnit::Inch.millimetres() / units.millimetres());
    }

    #[inline]
    pub(crate) fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Whether the queue has more elements than a program can reasonably have between two corners.
    pub(crate) fn is_full(&self) -> bool {
        self.waiting.len() >= MAX_WAITING
    }

    /// Whether the controlled point differs from the centre of the tool's tip.
    pub(crate) fn is_shifted(&self) -> bool {
        self.shift != UNSHIFTED
    }

    /// Whether a canonical function is queued behind a waiting move. Other functions overtake it, as in LinuxCNC; they
    /// do not depend on the position of the machine.
    pub(crate) fn must_wait(canon: &Canon) -> bool {
        if let Canon::Note(text) = canon {
            // The one note of a mode that overtakes.
            return !text.starts_with("interpreter: Lathe diameter mode");
        }
        matches!(
            canon,
            Canon::SetFeedRate(_)
                | Canon::SetFeedMode(_)
                | Canon::Dwell(_)
                | Canon::MistOn
                | Canon::MistOff
                | Canon::FloodOn
                | Canon::FloodOff
                | Canon::StartSpindleClockwise(_)
                | Canon::StartSpindleCounterclockwise(_)
                | Canon::StopSpindleTurning(_)
                | Canon::SelectMaterial(_)
                | Canon::SetCutting(..)
                | Canon::SetPierceValue { .. }
                | Canon::SetSpindleMode(_)
                | Canon::SetSpindleSpeed(_)
                | Canon::OrientSpindle { .. }
                | Canon::WaitSpindleOrientComplete(_)
                | Canon::UserCode { .. }
                | Canon::Comment(_)
        )
    }

    /// Queues a canonical function of this line.
    pub(crate) fn push(&mut self, line: u32, canon: Canon, role: QueueRole) {
        self.waiting.push(QueuedFunction { line, canon, role });
    }

    /// Returns the queued arc: its centre, its end, and its turns.
    pub(crate) fn arc(&self) -> Option<(Point, Point, i32)> {
        let [first, second, _] = self.plane.axes();
        let moving = self.waiting.iter().find(|waiting| waiting.role != QueueRole::Fixed)?;
        match &moving.canon {
            Canon::ArcFeed(arc) => {
                Some(((arc.first_centre, arc.second_centre), (arc.end[first], arc.end[second]), arc.turns))
            }
            _ => None,
        }
    }

    /// Sets the position of the compensated path before the moves queued next.
    pub(crate) fn set_start(&mut self, start: Point) {
        self.start = Some(start);
    }

    /// Moves the end of the last move in the plane, and of those along other axes after it, to `end`, and releases
    /// everything.
    ///
    /// # Errors
    /// E1658 when a move would reverse its direction; the queue is then empty.
    pub(crate) fn end_at(
        &mut self,
        end: Point,
        at: Span,
        steps: &mut Vec<CanonStep>,
        number: Number,
    ) -> BlockResult<()> {
        if self.is_empty() {
            return Ok(());
        }
        for index in 0..self.waiting.len() {
            if let Err(fault) = self.move_end(index, end, at) {
                self.clear();
                return Err(fault);
            }
        }
        self.release(steps, number);
        self.start = Some(end);
        Ok(())
    }

    fn move_end(&mut self, index: usize, end: Point, at: Span) -> BlockResult<()> {
        let (start, more_sweep, [first, second, _]) = (self.start, self.more_sweep, self.plane.axes());
        let QueuedFunction { canon, role, line } = &mut self.waiting[index];
        let gouge = |what: &str| {
            let message = format!("the {what} of line {line} is too short for the tool in the corners at its ends");
            fault(ErrorCode::CompensationGouge, at, message)
        };
        match (canon, *role) {
            (Canon::StraightFeed(pose) | Canon::StraightTraverse(pose), QueueRole::Straight(direction)) => {
                let runs_back = |start: Point| direction.0 * (end.0 - start.0) + direction.1 * (end.1 - start.1) < 0.0;
                if start.is_some_and(runs_back) {
                    return gouge("move");
                }
                (pose[first], pose[second]) = end;
                Ok(())
            }
            (Canon::ArcFeed(arc), QueueRole::Arc(programmed)) => {
                let centre = (arc.first_centre, arc.second_centre);
                let radius = |point: Point| (point.0 - centre.0).hypot(point.1 - centre.1);
                if (radius((arc.end[first], arc.end[second])) - radius(end)).abs() > RADII_DIFFER {
                    return fault(
                        ErrorCode::CompensationCorner,
                        at,
                        "the corner is not on the compensated arc before it",
                    );
                }
                let longer = |start| sweep(start, end, centre, arc.turns).abs() > programmed.abs() + more_sweep;
                if programmed != 0.0 && start.is_some_and(longer) {
                    return gouge("arc");
                }
                (arc.end[first], arc.end[second]) = end;
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// Discards all elements.
    pub(crate) fn clear(&mut self) {
        self.waiting.clear();
        self.start = None;
    }

    /// Releases all elements unchanged.
    pub(crate) fn release(&mut self, steps: &mut Vec<CanonStep>, number: Number) {
        self.start = None;
        let (plane, shift) = (self.plane, self.shift);
        for QueuedFunction { line, mut canon, role } in self.waiting.drain(..) {
            if role != QueueRole::Other {
                shift_canon(&mut canon, plane, shift);
            }
            steps.push(CanonStep { line, number, canon });
        }
    }

    /// Converts all elements to another unit of length.
    pub(crate) fn scale(&mut self, factor: f64) {
        let scaled = |point: Point| (point.0 * factor, point.1 * factor);
        self.start = self.start.map(scaled);
        self.shift = scaled(self.shift);
        self.more_sweep *= factor;
        for QueuedFunction { canon, .. } in &mut self.waiting {
            match canon {
                Canon::StraightFeed(pose) | Canon::StraightTraverse(pose) => *pose = pose.scaled_lengths(factor),
                Canon::ArcFeed(arc) => {
                    arc.end = arc.end.scaled_lengths(factor);
                    (arc.first_centre, arc.second_centre) = scaled((arc.first_centre, arc.second_centre));
                }
                // The new unit is emitted before this function.
                Canon::SetFeedRate(rate) => *rate *= factor,
                _ => {}
            }
        }
    }
}

/// Moves the centre of the tool's tip to the controlled point.
fn shift_canon(canon: &mut Canon, plane: Plane, shift: Point) {
    if shift == UNSHIFTED {
        return;
    }
    let [first, second, _] = plane.axes();
    let shifted = |pose: &mut Pose| {
        pose[first] += shift.0;
        pose[second] += shift.1;
    };
    match canon {
        Canon::StraightFeed(pose) | Canon::StraightTraverse(pose) => shifted(pose),
        Canon::ArcFeed(arc) => {
            shifted(&mut arc.end);
            arc.first_centre += shift.0;
            arc.second_centre += shift.1;
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn feed(x: f64, y: f64) -> Canon {
        Canon::StraightFeed(Pose::xyz(x, y, 0.0))
    }

    #[test]
    fn the_end_is_moved_for_all_that_stands_over_it_and_the_order_stays() {
        let mut queue = CompensationQueue::default();
        let mut steps = Vec::new();
        queue.begin(Plane::Xy, (1.0, -0.0), LengthUnit::Inch);
        queue.set_start((0.0, 0.0));
        queue.push(1, feed(10.0, 0.0), QueueRole::Straight((1.0, 0.0)));
        queue.push(2, Canon::FloodOn, QueueRole::Other);
        queue.push(3, Canon::StraightFeed(Pose::xyz(10.0, 0.0, 5.0)), QueueRole::Straight((0.0, 0.0)));
        queue.end_at((8.0, 0.0), Span::default(), &mut steps, None).expect("a forward move");
        let canons: Vec<_> = steps.drain(..).map(|step| (step.line, step.canon)).collect();
        // The controlled point of the tool is not the centre of its tip.
        let risen = Canon::StraightFeed(Pose::xyz(9.0, 0.0, 5.0));
        assert_eq!(canons, [(1, feed(9.0, 0.0)), (2, Canon::FloodOn), (3, risen)]);
        queue.push(4, feed(8.0, 1.0), QueueRole::Straight((0.0, 1.0)));
        let gouged = queue.end_at((8.0, -0.1), Span::default(), &mut steps, None);
        assert_eq!(gouged.map_err(|fault| fault.code), Err(ErrorCode::CompensationGouge));
        assert!(queue.is_empty() && steps.is_empty());
    }

    #[test]
    fn a_queue_that_has_grown_allocates_no_more() {
        let mut queue = CompensationQueue::default();
        let mut steps = Vec::new();
        let mut capacity = 0;
        for round in 0..50 {
            for line in 0..20 {
                queue.push(line, feed(f64::from(line), 0.0), QueueRole::Straight((1.0, 0.0)));
                queue.push(line, Canon::SetFeedRate(1.0), QueueRole::Other);
            }
            queue.release(&mut steps, None);
            // A block takes the queue out of the state.
            let taken = std::mem::take(&mut queue);
            queue = taken;
            assert!(round == 0 || queue.waiting.capacity() == capacity);
            capacity = queue.waiting.capacity();
        }
    }
}
