//! The queue of cutter radius compensation: moves whose end the next corner may still change, and what came after them.
//!
//! Invariant: the first that waits is a move in the plane of compensation, so an empty queue lets everything pass at once. What waits
//! goes out in the order in which it came. Once its buffer has grown, the queue allocates nothing.

use crate::angle::sweep;
use crate::block::BlockNumber;
use crate::canon::{Canon, CanonStep, LengthUnit, Plane};
use crate::diag::{BlockResult, Span, fault};
use crate::error_codes::ErrorCode;
use crate::pose::Pose;

/// A point of the plane of compensation: its first and its second axis.
pub(crate) type Point = (f64, f64);

/// The N word of the block that lets something out: the peer prints that one, not the number of the block it comes from.
pub(crate) type Number = Option<BlockNumber>;

/// An arc may sweep more than it was programmed to by this, radians, when its end is moved and the unit is the inch. The peer
/// converts it like a length.
const MORE_SWEEP: f64 = 0.001;

/// The radii of an arc at its old and its new end may differ by this, program units.
const RADII_DIFFER: f64 = 0.01;

/// How a waiting canonical function takes part when the end of the last move in the plane is moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum QueueRole {
    /// A straight move in this programmed direction; none is a move along other axes, which stays over the end.
    Straight(Point),
    /// An arc that was programmed to sweep this angle, radians.
    Arc(f64),
    /// A move that stays as it is.
    Fixed,
    /// No move.
    Other,
}

/// So many functions may wait; a program that is fed line by line may never come to its next corner.
const MAX_WAITING: usize = 10_000;

/// No shift: unlike zero, −0 leaves the sign of a zero alone.
pub(crate) const UNSHIFTED: Point = (-0.0, -0.0);

#[derive(Clone, Debug, PartialEq)]
struct CompensationQueue {
    line: u32,
    canon: Canon,
    course: QueueRole,
}

/// What waits for the next corner.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Queue {
    waiting: Vec<CompensationQueue>,
    plane: Plane,
    /// Where the compensated path stands before what waits; none where that is not known, and then nothing is checked.
    start: Option<Point>,
    /// From the centre of the tool's tip to the controlled point, in the plane: not zero for lathe tools.
    shift: Point,
    /// By how much an arc may sweep more than it was programmed to, radians.
    more_sweep: f64,
}

impl Default for Queue {
    fn default() -> Queue {
        Queue { waiting: Vec::new(), plane: Plane::Xy, start: None, shift: UNSHIFTED, more_sweep: MORE_SWEEP }
    }
}

impl Queue {
    /// Empties it and sets it up for a plane and a tool.
    pub(crate) fn begin(&mut self, plane: Plane, shift: Point, units: LengthUnit) {
        self.clear();
        (self.plane, self.shift) = (plane, shift);
        self.more_sweep = MORE_SWEEP * (LengthUnit::Inch.millimetres() / units.millimetres());
    }

    #[inline]
    pub(crate) fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Whether more waits than a program can mean to have between two corners.
    pub(crate) fn is_full(&self) -> bool {
        self.waiting.len() >= MAX_WAITING
    }

    /// Whether the controlled point is not the centre of the tool's tip.
    pub(crate) fn is_shifted(&self) -> bool {
        self.shift != UNSHIFTED
    }

    /// Whether a canonical function waits its turn behind a waiting move. Others pass it by: the peer has it so, and nothing of
    /// theirs depends on where the machine is.
    pub(crate) fn holds(canon: &Canon) -> bool {
        if let Canon::Note(text) = canon {
            // The one note of a mode that passes.
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
                | Canon::StartSpindleClockwise
                | Canon::StartSpindleCounterclockwise
                | Canon::StopSpindleTurning
                | Canon::SetSpindleMode(_)
                | Canon::SetSpindleSpeed(_)
                | Canon::OrientSpindle { .. }
                | Canon::WaitSpindleOrientComplete(_)
                | Canon::UserCode { .. }
                | Canon::Comment(_)
        )
    }

    /// Lets a canonical function of this line wait.
    pub(crate) fn push(&mut self, line: u32, canon: Canon, course: QueueRole) {
        self.waiting.push(CompensationQueue { line, canon, course });
    }

    /// The arc that waits: its centre, where it ends, and its turns.
    pub(crate) fn arc(&self) -> Option<(Point, Point, i32)> {
        let [first, second, _] = self.plane.axes();
        let moving = self.waiting.iter().find(|waiting| waiting.course != QueueRole::Fixed)?;
        match &moving.canon {
            Canon::ArcFeed(arc) => {
                Some(((arc.first_centre, arc.second_centre), (arc.end[first], arc.end[second]), arc.turns))
            }
            _ => None,
        }
    }

    /// Tells where the compensated path stands before what will wait next.
    pub(crate) fn set_start(&mut self, start: Point) {
        self.start = Some(start);
    }

    /// Moves the end of the last move in the plane, and of those along other axes after it, to `end`, and lets everything out.
    ///
    /// # Errors
    /// E1658 when a move would run against its direction; nothing waits then.
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
        let CompensationQueue { canon, course, line } = &mut self.waiting[index];
        let gouge = |what: &str| {
            let message = format!("the {what} of line {line} is too short for the tool in the corners at its ends");
            fault(ErrorCode::CompensationGouge, at, message)
        };
        match (canon, *course) {
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
                        "the corner does not lie on the compensated arc before it",
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

    /// Drops everything.
    pub(crate) fn clear(&mut self) {
        self.waiting.clear();
        self.start = None;
    }

    /// Lets everything out as it is.
    pub(crate) fn release(&mut self, steps: &mut Vec<CanonStep>, number: Number) {
        self.start = None;
        let (plane, shift) = (self.plane, self.shift);
        for CompensationQueue { line, mut canon, course } in self.waiting.drain(..) {
            if course != QueueRole::Other {
                shift_canon(&mut canon, plane, shift);
            }
            steps.push(CanonStep { line, number, canon });
        }
    }

    /// Converts everything to another unit of length.
    pub(crate) fn scale(&mut self, factor: f64) {
        let scaled = |point: Point| (point.0 * factor, point.1 * factor);
        self.start = self.start.map(scaled);
        self.shift = scaled(self.shift);
        self.more_sweep *= factor;
        for CompensationQueue { canon, .. } in &mut self.waiting {
            match canon {
                Canon::StraightFeed(pose) | Canon::StraightTraverse(pose) => *pose = pose.scaled_lengths(factor),
                Canon::ArcFeed(arc) => {
                    arc.end = arc.end.scaled_lengths(factor);
                    (arc.first_centre, arc.second_centre) = scaled((arc.first_centre, arc.second_centre));
                }
                // The new unit goes out before it does.
                Canon::SetFeedRate(rate) => *rate *= factor,
                _ => {}
            }
        }
    }
}

/// From the centre of the tool's tip to the controlled point.
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
        let mut queue = Queue::default();
        let mut steps = Vec::new();
        queue.begin(Plane::Xy, (1.0, -0.0), LengthUnit::Inch);
        queue.set_start((0.0, 0.0));
        queue.push(1, feed(10.0, 0.0), QueueRole::Straight((1.0, 0.0)));
        queue.push(2, Canon::FloodOn, QueueRole::Other);
        queue.push(3, Canon::StraightFeed(Pose::xyz(10.0, 0.0, 5.0)), QueueRole::Straight((0.0, 0.0)));
        queue.end_at((8.0, 0.0), Span::default(), &mut steps, None).expect("a forward move");
        let canons: Vec<_> = steps.drain(..).map(|step| (step.line, step.canon)).collect();
        // The controlled point of the tool is beside the centre of its tip.
        let risen = Canon::StraightFeed(Pose::xyz(9.0, 0.0, 5.0));
        assert_eq!(canons, [(1, feed(9.0, 0.0)), (2, Canon::FloodOn), (3, risen)]);
        queue.push(4, feed(8.0, 1.0), QueueRole::Straight((0.0, 1.0)));
        let gouged = queue.end_at((8.0, -0.1), Span::default(), &mut steps, None);
        assert_eq!(gouged.map_err(|fault| fault.code), Err(ErrorCode::CompensationGouge));
        assert!(queue.is_empty() && steps.is_empty());
    }

    #[test]
    fn a_queue_that_has_grown_allocates_no_more() {
        let mut queue = Queue::default();
        let mut steps = Vec::new();
        let mut room = 0;
        for round in 0..50 {
            for line in 0..20 {
                queue.push(line, feed(f64::from(line), 0.0), QueueRole::Straight((1.0, 0.0)));
                queue.push(line, Canon::SetFeedRate(1.0), QueueRole::Other);
            }
            queue.release(&mut steps, None);
            // What a block does with the queue of the state.
            let taken = std::mem::take(&mut queue);
            queue = taken;
            assert!(round == 0 || queue.waiting.capacity() == room);
            room = queue.waiting.capacity();
        }
    }
}
