//! The planner: moves go in, records come out, with look-ahead in between.
//!
//! Invariant: the records depend on the moves, their modes and the stops, in their order, on the record after which the
//! feed override was changed, and on nothing else: never on when records are requested. A committed record never
//! changes, and what is committed can always be followed by a stop.

use retrace_core::{Flags, Record};

use crate::blend::{PathSegment, size};
use crate::curve::{Arc, Curve};
use crate::emitter::SetPoint;
use crate::error::{LimitError, MoveError};
use crate::glide::Blending;
use crate::limits::MAX_OVERRIDE;
use crate::limits::MachineLimits;
use crate::line_mark::LineMark;
use crate::merge::{LinearMove, Merger, merging};
use crate::path_planner::PathPlanner;
use crate::piece::RAPID;
use crate::planned_section::PlannedSection;
use crate::pulses::counts_of;
use crate::run::{PlanFallbacks, PlanMode};

/// Speed of a move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FeedRate {
    /// Speed along the path, mm/s, above 0 (G94); degrees/s where only rotary axes move.
    PerSecond(f64),
    /// Least duration of the whole move, s, above 0 (G93).
    Duration(f64),
    /// As fast as the machine can (G0).
    Rapid,
}

/// How a move meets the next one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PathMode {
    /// Full stop at the end of the move (G61.1).
    ExactStop,
    /// Exactly along the path, with full stops only where it is not smooth (G61).
    ExactPath,
    /// Corners may be cut by up to the tolerance (G64 P), and nearly collinear lines are merged (G64 Q).
    Blend {
        /// Largest distance from the programmed path, mm, 0 … 10⁶. It includes the rounding to whole pulses.
        tolerance_mm: f64,
        /// Largest distance of lines with equal feed from the line that they are merged into, mm, 0 … 10⁶. It is part
        /// of the tolerance, at most half of it. 0 merges nothing; `None` leaves the choice to the planner.
        merge_mm: Option<f64>,
    },
}

impl PathMode {
    /// Blending within `tolerance_mm`, mm, 0 … 10⁶. The planner chooses how much of it merging uses.
    #[must_use]
    pub const fn blend(tolerance_mm: f64) -> Self {
        Self::Blend { tolerance_mm, merge_mm: None }
    }

    /// Tolerances of the path and of merging, mm; 0 where nothing is blended.
    fn tolerances(self) -> (f64, Option<f64>) {
        match self {
            Self::Blend { tolerance_mm, merge_mm } => (tolerance_mm, merge_mm),
            Self::ExactStop | Self::ExactPath => (0.0, None),
        }
    }
}

/// A place within a move from which on its records have another tag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MoveMark {
    /// The place, as a share of the move's length: 0 … 1, in ascending order.
    pub share: f64,
    /// Tag of the records behind it.
    pub tag: u32,
}

/// Planner of moves, which emits one record per control period.
///
/// # Examples
///
/// ```
/// use retrace_motion::{FeedRate, MachineLimits, PathMode, Planner};
/// let mut planner = Planner::<2>::new(MachineLimits::built_in(), [0.0; 2])?;
/// let mode = PathMode::blend(0.05);
/// planner.line([20.0, 0.0], FeedRate::PerSecond(50.0), mode, 1)?;
/// planner.line([20.0, 20.0], FeedRate::PerSecond(50.0), mode, 2)?;
/// planner.stop(retrace_core::Flags::NONE);
/// let mut periods = 0;
/// while let Some(record) = planner.next_record() {
///     assert!(record.increments[0].abs() <= 100, "100 mm/s is 100 pulses per millisecond");
///     periods += 1;
/// }
/// assert!(periods > 800, "40 mm at 50 mm/s");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Planner<const A: usize> {
    pulses_per_mm: [f64; A],
    merger: Merger<A>,
    path: PathPlanner<A>,
    /// Marks of the line that comes out of the merger.
    marks: Vec<LineMark>,
    /// End of the last move.
    commanded: [f64; A],
    /// Program line of the last move.
    tag: u32,
    /// Position of the last stop, and the flags of its record.
    rest: ([f64; A], Flags),
}

impl<const A: usize> Planner<A> {
    /// Creates a planner at rest at `start_mm`, in mm or degrees.
    ///
    /// # Errors
    /// E41xx: a limit is out of its range.
    pub fn new(limits: MachineLimits<A>, start_mm: [f64; A]) -> Result<Self, LimitError> {
        limits.validate()?;
        Ok(Self {
            pulses_per_mm: limits.pulses_per_mm,
            merger: Merger::new(),
            path: PathPlanner::new(limits, start_mm),
            marks: Vec::new(),
            commanded: start_mm,
            tag: 0,
            rest: (start_mm, Flags::NONE),
        })
    }

    /// Creates a planner with a look-ahead of `blocks` blocks of the path, instead of as far as it needs to stop.
    ///
    /// That many blocks are planned together at most, and half of them are then committed. A block is a move, or a part
    /// of a blended one. `blocks` is at least 2; `usize::MAX` plans every run as a whole.
    ///
    /// # Errors
    /// E41xx: a limit is out of its range.
    pub fn with_look_ahead(limits: MachineLimits<A>, start_mm: [f64; A], blocks: usize) -> Result<Self, LimitError> {
        let mut planner = Self::new(limits, start_mm)?;
        planner.path.set_look_ahead(blocks);
        Ok(planner)
    }

    /// Sets the method by which corners are blended.
    #[must_use]
    pub fn with_blending(mut self, method: Blending) -> Self {
        self.path.set_blending(method);
        self
    }

    /// Sets how the speed along the path is planned.
    #[must_use]
    pub fn with_plan_mode(mut self, mode: PlanMode) -> Self {
        self.path.set_mode(mode);
        self
    }

    /// Keeps the feed exactly as it is wherever the axes can: a run is not slowed down so that it takes whole control
    /// periods, and ends within its last one. For paths whose distance per period must not change, as a thread's.
    #[must_use]
    pub fn with_exact_feed(mut self) -> Self {
        self.path.keep_feed();
        self
    }

    /// Takes over the glides that `earlier` found, if it has the same limits: a corner like one of its is not searched
    /// again. The path does not depend on it.
    #[must_use]
    pub fn with_glides_of(mut self, earlier: Self) -> Self {
        self.path.take_glides_of(earlier.path);
        self
    }

    /// End of the last move, mm or degrees.
    #[must_use]
    pub fn commanded_mm(&self) -> [f64; A] {
        self.commanded
    }

    /// Adds a straight move to `end_mm`, absolute, mm or degrees, at most ±10⁶. `tag` is its program line.
    ///
    /// # Errors
    /// E4001, E4002. Nothing is changed then.
    pub fn line(&mut self, end_mm: [f64; A], feed: FeedRate, mode: PathMode, tag: u32) -> Result<(), MoveError> {
        self.marked_line(end_mm, feed, mode, tag, &[])
    }

    /// Adds a straight move, as [`Planner::line`] does, with marks along it. They do not change the path, nor its plan.
    ///
    /// # Errors
    /// E4001, E4002. Nothing is changed then.
    pub fn marked_line(
        &mut self,
        end_mm: [f64; A],
        feed: FeedRate,
        mode: PathMode,
        tag: u32,
        marks: &[MoveMark],
    ) -> Result<(), MoveError> {
        check(&end_mm, feed, mode)?;
        self.add(Curve::line(self.commanded, end_mm), end_mm, feed, mode, tag, marks);
        Ok(())
    }

    /// Adds an arc or helix, with coordinates of at most ±10⁶ mm. `tag` is its program line.
    ///
    /// # Errors
    /// E4001 … E4004. Nothing is changed then.
    pub fn arc(&mut self, arc: &Arc<A>, feed: FeedRate, mode: PathMode, tag: u32) -> Result<(), MoveError> {
        self.marked_arc(arc, feed, mode, tag, &[])
    }

    /// Adds an arc or helix, as [`Planner::arc`] does, with marks along it. They do not change the path, nor its plan.
    ///
    /// # Errors
    /// E4001 … E4004. Nothing is changed then.
    pub fn marked_arc(
        &mut self,
        arc: &Arc<A>,
        feed: FeedRate,
        mode: PathMode,
        tag: u32,
        marks: &[MoveMark],
    ) -> Result<(), MoveError> {
        check(&arc.end_mm, feed, mode)?;
        check(&arc.centre_mm, feed, mode)?;
        self.add(Curve::arc(self.commanded, arc)?, arc.end_mm, feed, mode, tag, marks);
        Ok(())
    }

    /// Adds a planned stop at the end of the last move. The motion is at rest at the end of the last record, which has
    /// [`Flags::REST`] and `flags`.
    ///
    /// Where nothing has moved since the last stop, and `flags` contains a flag that the record of that stop does not
    /// have, the stop takes one record without motion.
    pub fn stop(&mut self, flags: Flags) {
        let flags = flags.with(Flags::REST);
        let (end, rest_flags) = self.rest;
        let moves = self.path.has_motion() || !self.merger.is_empty();
        let counts = |at: &[f64; A]| counts_of(at, &self.pulses_per_mm);
        let elsewhere = counts(&end) != counts(&self.commanded);
        if moves || elsewhere || !rest_flags.contains(flags) && flags != Flags::REST {
            self.pass_merged();
            self.path.stop(self.commanded, self.tag, flags);
            self.rest = (self.commanded, flags);
        }
    }

    /// Moves the machine position by whole pulses of each axis, without motion. What follows is planned from there.
    ///
    /// Returns false, with nothing changed, where the motion is not at rest. It is at rest after [`Planner::stop`],
    /// once every record has been taken out.
    pub fn displace(&mut self, pulses: [i64; A]) -> bool {
        if !self.merger.is_empty() || !self.path.displace(pulses, &self.pulses_per_mm) {
            return false;
        }
        for (axis, &pulses) in pulses.iter().enumerate() {
            self.commanded[axis] += pulses as f64 / self.pulses_per_mm[axis];
        }
        self.rest.0 = self.commanded;
        true
    }

    /// Sets the feed override above 100 %, from the next record on, and returns the factor that is in force.
    ///
    /// Feeds of programmed moves are multiplied by `factor`, which is clamped to 1 … [`MAX_OVERRIDE`]. Rapid moves and
    /// the limits of the axes and of the path velocity do not change. Records that were emitted never change; the rest
    /// of the plan is planned again.
    ///
    /// The path does not depend on the factor: corners are cut as at the programmed feeds, and glides are passed as
    /// fast as these allow. There is one exception: where no plan leads into a glide, the motion stops in the corner,
    /// and that can be so for one factor and not for another.
    ///
    /// Where the motion is faster than a lower factor allows, it brakes at once, as fast as the axes allow. Where no
    /// plan does that, the old plan stays in force up to the first place from which one does.
    pub fn set_feed_override(&mut self, factor: f64) -> f64 {
        let factor = if factor >= 1.0 { factor.min(MAX_OVERRIDE) } else { 1.0 };
        self.path.set_feed_factor(factor);
        factor
    }

    /// Takes out the record of the next control period; `None` where more moves, or a stop, are needed first.
    ///
    /// Memory stays bounded, however long the program is, where records are taken out until `None` before the next move
    /// goes in.
    ///
    /// Every full stop, including one in a corner that is not smooth, takes whole periods, and its last record has
    /// [`Flags::REST`].
    pub fn next_record(&mut self) -> Option<Record<A>> {
        self.path.next_record()
    }

    /// Takes out all records that [`Planner::next_record`] would, and returns their number. Most of them are not made:
    /// that takes a small part of the time. [`Planner::set_point`] and the increments of later records up to the next
    /// stop are without meaning then.
    pub fn count_records(&mut self) -> u64 {
        self.path.count_records()
    }

    /// How often the search for a plan has failed so far, and a slower plan was made instead. Best is 0 of each.
    #[must_use]
    pub fn fallbacks(&self) -> PlanFallbacks {
        self.path.fallbacks()
    }

    /// Copies the committed plan that is not emitted, for measurements: its sections from stop to stop, or to a glide,
    /// without the last one where the motion is not planned to its end. The first one begins where the last record
    /// ends, or with the plan where none is emitted.
    #[must_use]
    pub fn planned_sections(&self) -> Vec<PlannedSection<A>> {
        self.path.sections()
    }

    /// Unrounded set-point at the end of the last record.
    #[must_use]
    pub fn set_point(&self) -> &SetPoint<A> {
        self.path.point()
    }

    fn add(
        &mut self,
        (curve, length): (Curve<A>, f64),
        end: [f64; A],
        feed: FeedRate,
        mode: PathMode,
        tag: u32,
        marks: &[MoveMark],
    ) {
        let start = std::mem::replace(&mut self.commanded, end);
        self.tag = marks.last().map_or(tag, |mark| mark.tag);
        if length < 1e-9 {
            return; // no motion; where it ends on another pulse, the next stop covers the difference
        }
        let feed = match feed {
            FeedRate::PerSecond(v) => v,
            FeedRate::Duration(t) => length / t,
            FeedRate::Rapid => RAPID,
        };
        let (tolerance, merging) = self.tolerance(mode);
        if tolerance > 0.0 && curve.is_line() {
            let line = LinearMove { start, end, feed, tag, tolerance, merging };
            if !self.merger.try_merge(&line) {
                self.pass_merged();
                self.merger.try_merge(&line);
            }
            for &MoveMark { share, tag } in marks {
                self.merger.mark(std::array::from_fn(|i| start[i] + share * (end[i] - start[i])), tag);
            }
        } else {
            self.pass_merged();
            let places = marks.iter().map(|mark| LineMark { place: mark.share * length, tag: mark.tag });
            self.marks.extend(places);
            let segment = PathSegment { curve, length, feed, tag, tolerance, marks: marks.len() as u32 };
            self.path.accept(segment, mode == PathMode::ExactStop, &mut self.marks);
        }
    }

    /// Passes the merged line on to the path planner.
    fn pass_merged(&mut self) {
        if let Some(segment) = self.merger.take_merged(&mut self.marks) {
            self.path.accept(segment, false, &mut self.marks);
        }
    }

    /// Largest distance by which the path may be cut, with allowance for the rounding to whole pulses, and the part of
    /// it that merging may use; both 0 where too little remains to be useful. mm.
    fn tolerance(&self, mode: PathMode) -> (f64, f64) {
        let (tolerance_mm, merge_mm) = mode.tolerances();
        let rounding = 0.5 * size(&self.pulses_per_mm.map(f64::recip));
        let left = tolerance_mm - rounding;
        if left > 0.1 * tolerance_mm { (left, merging(left, merge_mm)) } else { (0.0, 0.0) }
    }
}

fn check(numbers: &[f64], feed: FeedRate, mode: PathMode) -> Result<(), MoveError> {
    let sound = |x: &f64| x.abs() <= 1e6;
    let (tolerance, merge) = mode.tolerances();
    let tolerances = [tolerance, merge.unwrap_or(0.0)];
    if !numbers.iter().all(sound) || !tolerances.iter().all(|mm| (0.0..=1e6).contains(mm)) {
        return Err(MoveError::NotFinite);
    }
    match feed {
        FeedRate::PerSecond(value) | FeedRate::Duration(value) if !(value.is_finite() && value > 0.0) => {
            Err(MoveError::Feed { value })
        }
        _ => Ok(()),
    }
}
