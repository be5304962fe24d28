//! The planner: moves go in, records come out, look-ahead in between.
//!
//! Invariant: what comes out depends on the moves, their modes and the stops, in their order, on after which record the feed
//! override was changed, and on nothing else: never on when records are asked for. A committed record never changes, and what is committed can always be followed by a stop.

use retrace_core::{Flags, Record};

use crate::blend::{PathSegment, size};
use crate::curve::{Arc, Curve};
use crate::emitter::SetPoint;
use crate::error::{LimitError, MoveError};
use crate::glide::Blending;
use crate::limits::MachineLimits;
use crate::merge::{LineMark, LinearMove, Merger, merging};
use crate::path_planner::PathPlanner;
use crate::piece::RAPID;
use crate::pulses::counts_of;

/// The most that an override may raise feeds to, as a factor: 200 %.
pub const MAX_OVERRIDE: f64 = 2.0;

/// How fast a move goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FeedRate {
    /// Along the path, mm/s (G94); degrees/s where only rotary axes move.
    PerSecond(f64),
    /// The whole move takes this long at least, s (G93).
    Duration(f64),
    /// As fast as the machine can (G0).
    Rapid,
}

/// How a move goes over into the next one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PathMode {
    /// Full stop at the end of the move (G61.1).
    ExactStop,
    /// Exactly along the path; full stops only where it is not smooth (G61).
    ExactPath,
    /// Corners may be cut by up to the tolerance (G64 P), and lines that are nearly collinear become one (G64 Q).
    Blend {
        /// Largest distance from the programmed path, mm; the rounding to whole pulses is within it.
        tolerance_mm: f64,
        /// How far lines at one feed may be from the line that they are merged into, mm. It is taken out of the tolerance, of
        /// which at most half goes there; 0 merges nothing, `None` leaves it to the planner.
        merge_mm: Option<f64>,
    },
}

impl PathMode {
    /// Blending within `tolerance_mm`; how much of it goes into merging is the planner's choice.
    #[must_use]
    pub const fn blend(tolerance_mm: f64) -> Self {
        Self::Blend { tolerance_mm, merge_mm: None }
    }

    /// The tolerances in mm, of the path and of merging; where nothing is blended, none.
    fn tolerances(self) -> (f64, Option<f64>) {
        match self {
            Self::Blend { tolerance_mm, merge_mm } => (tolerance_mm, merge_mm),
            Self::ExactStop | Self::ExactPath => (0.0, None),
        }
    }
}

/// Plans moves and emits one record a control period.
#[derive(Debug)]
pub struct Planner<const A: usize> {
    pulses_per_mm: [f64; A],
    merger: Merger<A>,
    road: PathPlanner<A>,
    /// Marks of the line that comes out of the merger.
    marks: Vec<LineMark>,
    /// Where the last move ends.
    at: [f64; A],
    /// Program line of the last move.
    tag: u32,
    /// Where the last stop is, and the flags its record carries.
    rest: ([f64; A], Flags),
}

impl<const A: usize> Planner<A> {
    /// A planner at rest at `start_mm`.
    ///
    /// # Errors
    /// E41xx: a limit is out of its range.
    pub fn new(limits: MachineLimits<A>, start_mm: [f64; A]) -> Result<Self, LimitError> {
        limits.validate()?;
        Ok(Self {
            pulses_per_mm: limits.pulses_per_mm,
            merger: Merger::new(),
            road: PathPlanner::new(limits, start_mm),
            marks: Vec::new(),
            at: start_mm,
            tag: 0,
            rest: (start_mm, Flags::NONE),
        })
    }

    /// A planner that looks ahead over that many blocks of the road instead of as far as it needs to stop: up to them are planned
    /// together, and half of them are then committed. A block of the road is a move, or a part of a blended one. At least 2;
    /// `usize::MAX` plans every run whole.
    ///
    /// # Errors
    /// E41xx: a limit is out of its range.
    pub fn with_look_ahead(limits: MachineLimits<A>, start_mm: [f64; A], blocks: usize) -> Result<Self, LimitError> {
        let mut planner = Self::new(limits, start_mm)?;
        planner.road.look_over(blocks);
        Ok(planner)
    }

    /// The same planner, which passes corners by `method`.
    #[must_use]
    pub fn blending_by(mut self, method: Blending) -> Self {
        self.road.blend_by(method);
        self
    }

    /// Where the last move ends, mm.
    #[must_use]
    pub fn commanded_mm(&self) -> [f64; A] {
        self.at
    }

    /// A straight move to `end_mm`; `tag` is its program line.
    ///
    /// # Errors
    /// E4001, E4002; nothing is changed then.
    pub fn line(&mut self, end_mm: [f64; A], feed: FeedRate, mode: PathMode, tag: u32) -> Result<(), MoveError> {
        check(&end_mm, feed, mode)?;
        let (curve, length) = Curve::line(self.at, end_mm);
        self.add(curve, length, end_mm, feed, mode, tag);
        Ok(())
    }

    /// An arc or helix; `tag` is its program line.
    ///
    /// # Errors
    /// E4001 … E4004; nothing is changed then.
    pub fn arc(&mut self, arc: &Arc<A>, feed: FeedRate, mode: PathMode, tag: u32) -> Result<(), MoveError> {
        check(&arc.end_mm, feed, mode)?;
        check(&arc.centre_mm, feed, mode)?;
        let (curve, length) = Curve::arc(self.at, arc)?;
        self.add(curve, length, arc.end_mm, feed, mode, tag);
        Ok(())
    }

    /// A planned stop here: the motion is at rest at the end of the last record, which carries [`Flags::REST`] and `flags`.
    ///
    /// Where nothing has moved since the last stop, and `flags` asks for what that one's record does not carry, the stop
    /// takes one record without motion.
    pub fn stop(&mut self, flags: Flags) {
        let flags = flags.with(Flags::REST);
        let (end, held) = self.rest;
        let moves = self.road.moves() || !self.merger.is_empty();
        let counts = |at: &[f64; A]| counts_of(at, &self.pulses_per_mm);
        let elsewhere = counts(&end) != counts(&self.at);
        if moves || elsewhere || !held.contains(flags) && flags != Flags::REST {
            self.pass_merged();
            self.road.stop(self.at, self.tag, flags);
            self.rest = (self.at, flags);
        }
    }

    /// The machine stands elsewhere than was planned, by so many whole pulses of each axis: what follows is planned from there.
    ///
    /// False, with nothing changed, where the motion is not at rest: after [`Planner::stop`], with every record taken out, it is.
    pub fn displace(&mut self, pulses: [i64; A]) -> bool {
        if !self.merger.is_empty() || !self.road.displace(pulses, &self.pulses_per_mm) {
            return false;
        }
        for (axis, &pulses) in pulses.iter().enumerate() {
            self.at[axis] += pulses as f64 / self.pulses_per_mm[axis];
        }
        self.rest.0 = self.at;
        true
    }

    /// The feed override above 100 %: from the next record on, feeds of programmed moves count times `factor`, which is held within
    /// 1 … [`MAX_OVERRIDE`]; gives the factor that is in force. Rapid moves, and what the axes and the path velocity allow,
    /// stay as they are. Records that came out before never change; what was planned of the road ahead is planned anew.
    ///
    /// The path does not depend on it: corners are cut as at the programmed feeds, and glides are passed as fast as these allow. One
    /// thing may: where no plan leads into a glide, the motion stops in the corner, and that can be so for one factor and not
    /// for another.
    /// Where the motion is faster than a lower factor allows, it brakes at once, as fast as the axes allow; where no plan
    /// does that, the old one is kept as far as the first place from which one does.
    pub fn set_feed_override(&mut self, factor: f64) -> f64 {
        let factor = if factor >= 1.0 { factor.min(MAX_OVERRIDE) } else { 1.0 };
        self.road.override_feeds(factor);
        factor
    }

    /// The next control period's record; `None` where more input, or a stop, is needed first. Where records are taken out until
    /// `None` before the next move goes in, memory stays bounded however long the program is.
    ///
    /// Every full stop, also that in a corner which is not smooth, takes whole periods and its last record carries
    /// [`Flags::REST`].
    pub fn next_record(&mut self) -> Option<Record<A>> {
        self.road.next_record()
    }

    /// The un-rounded set-point at the end of the last record.
    #[must_use]
    pub fn set_point(&self) -> &SetPoint<A> {
        self.road.point()
    }

    fn add(&mut self, curve: Curve<A>, length: f64, end: [f64; A], feed: FeedRate, mode: PathMode, tag: u32) {
        let start = std::mem::replace(&mut self.at, end);
        self.tag = tag;
        if length < 1e-9 {
            return; // no motion; should it end on another pulse, the next stop sees to it
        }
        let feed = match feed {
            FeedRate::PerSecond(v) => v,
            FeedRate::Duration(t) => length / t,
            FeedRate::Rapid => RAPID,
        };
        let (tolerance, merging) = self.tolerance(mode);
        if tolerance > 0.0 && curve.is_line() {
            let line = LinearMove { start, end, feed, tag, tolerance, merging };
            if !self.merger.offer(&line) {
                self.pass_merged();
                self.merger.offer(&line);
            }
        } else {
            self.pass_merged();
            let segment = PathSegment { curve, length, feed, tag, tolerance, marks: 0 };
            self.road.accept(segment, mode == PathMode::ExactStop, &mut self.marks);
        }
    }

    /// The line that is being merged is complete.
    fn pass_merged(&mut self) {
        if let Some(segment) = self.merger.take(&mut self.marks) {
            self.road.accept(segment, false, &mut self.marks);
        }
    }

    /// How far the path may be cut, with room for the rounding to whole pulses, and how much of that merging may use; 0 where it
    /// leaves nothing worth it.
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
