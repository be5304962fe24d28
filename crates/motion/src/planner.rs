//! The planner: moves go in, records come out, look-ahead in between.
//!
//! Invariant: what comes out depends on the moves, their modes and the stops, in their order, and on nothing else: never on
//! when records are asked for. A committed record never changes, and what is committed can always be followed by a stop.

use retrace_core::{Flags, Record};

use crate::blend::{Blender, Entry, Segment, size};
use crate::curve::{Arc, Curve};
use crate::emitter::{Emitter, Item, SetPoint, counts_of};
use crate::error::{LimitError, MoveError};
use crate::joining::join;
use crate::limits::{AxisLimits, Limits};
use crate::merge::{Line, Mark, Merger};
use crate::piece::{Joint, Piece};
use crate::run::{Run, least};

/// How fast a move goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Feed {
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
    /// Corners may be cut by up to the tolerance (G64 P).
    Blend {
        /// Largest distance from the programmed path, mm; the rounding to whole pulses is within it.
        tolerance_mm: f64,
    },
}

/// Plans moves and emits one record a control period.
#[derive(Debug)]
pub struct Planner<const A: usize> {
    axes: AxisLimits<A>,
    pulses_per_mm: [f64; A],
    emitter: Emitter<A>,
    merger: Merger<A>,
    blender: Blender<A>,
    run: Run<A>,
    /// Pieces on their way from the blender to the run, kept for their memory.
    pieces: Vec<(Piece<A>, Joint)>,
    /// Marks on their way to the blender, and to the emitter.
    marks: Vec<Mark>,
    lines: Vec<Mark>,
    /// Where the last move ends.
    at: [f64; A],
    /// Program line of the last move.
    tag: u32,
    /// The last move ends with a full stop.
    stops: bool,
    /// Where the last stop is, and the flags its record carries.
    rest: ([f64; A], Flags),
}

impl<const A: usize> Planner<A> {
    /// A planner at rest at `start_mm`.
    ///
    /// # Errors
    /// E41xx: a limit is out of its range.
    pub fn new(limits: Limits<A>, start_mm: [f64; A]) -> Result<Self, LimitError> {
        limits.validate()?;
        let axes = limits.planned();
        // A turn of 1/8 rad rounded this widely takes half the jerk at full speed; sharper ones are slower in any case.
        let reach = 0.5 * (axes.path_v.powi(3) / least(axes.j)).sqrt();
        Ok(Self {
            axes,
            pulses_per_mm: limits.pulses_per_mm,
            emitter: Emitter::new(limits, start_mm),
            merger: Merger::new(),
            blender: Blender::new(reach),
            run: Run::new(axes),
            pieces: Vec::new(),
            marks: Vec::new(),
            lines: Vec::new(),
            at: start_mm,
            tag: 0,
            stops: false,
            rest: (start_mm, Flags::NONE),
        })
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
    pub fn line(&mut self, end_mm: [f64; A], feed: Feed, mode: PathMode, tag: u32) -> Result<(), MoveError> {
        check(&end_mm, feed, mode)?;
        let (curve, length) = Curve::line(self.at, end_mm);
        self.add(curve, length, end_mm, feed, mode, tag);
        Ok(())
    }

    /// An arc or helix; `tag` is its program line.
    ///
    /// # Errors
    /// E4001 … E4004; nothing is changed then.
    pub fn arc(&mut self, arc: &Arc<A>, feed: Feed, mode: PathMode, tag: u32) -> Result<(), MoveError> {
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
        let moves = self.blender.last().is_some() || !self.merger.is_empty();
        let counts = |at: &[f64; A]| counts_of(at, &self.pulses_per_mm);
        let elsewhere = counts(&end) != counts(&self.at);
        if moves || elsewhere || !held.has(flags) && flags != Flags::REST {
            self.finish_run(self.at, self.tag, flags);
        }
    }

    /// The next control period's record; `None` where more input, or a stop, is needed first. Where records are taken out until
    /// `None` before the next move goes in, memory stays bounded however long the program is.
    ///
    /// Every full stop, also that in a corner which is not smooth, takes whole periods and its last record carries
    /// [`Flags::REST`].
    pub fn next_record(&mut self) -> Option<Record<A>> {
        self.emitter.next_record()
    }

    /// The un-rounded set-point at the end of the last record.
    #[must_use]
    pub fn set_point(&self) -> &SetPoint<A> {
        self.emitter.point()
    }

    fn add(&mut self, curve: Curve<A>, length: f64, end: [f64; A], feed: Feed, mode: PathMode, tag: u32) {
        let start = std::mem::replace(&mut self.at, end);
        self.tag = tag;
        if length < 1e-9 {
            return; // no motion; should it end on another pulse, the next stop sees to it
        }
        let feed = match feed {
            Feed::PerSecond(v) => v,
            Feed::Duration(t) => length / t,
            Feed::Rapid => f64::MAX,
        };
        let tolerance = self.tolerance(mode);
        if tolerance > 0.0 && curve.is_line() {
            let line = Line { start, end, feed, tag, tolerance };
            if !self.merger.offer(&line) {
                self.pass_merged();
                self.merger.offer(&line);
            }
        } else {
            self.pass_merged();
            self.pass(Segment { curve, length, feed, tag, tolerance, marks: 0 }, mode == PathMode::ExactStop);
        }
    }

    /// The line that is being merged is complete.
    fn pass_merged(&mut self) {
        if let Some(segment) = self.merger.take(&mut self.marks) {
            self.pass(segment, false);
        }
    }

    /// Gives `segment`, whose marks are at hand, to the blender; does it end with a full stop?
    fn pass(&mut self, segment: Segment<A>, stops: bool) {
        let mut entry = Entry::Rough(Joint::STOP);
        if let Some(last) = self.blender.last() {
            let passes = !self.stops;
            match join(last, &segment, &self.axes) {
                Some(joined) if passes => entry = joined,
                _ => self.stop_at(segment.curve.at(0.0), self.blender.last_tag(), Flags::REST),
            }
        }
        self.stops = stops;
        self.blender.push(segment, entry, &self.marks);
        self.marks.clear();
        if self.blender.is_ready() {
            self.hand_on(false);
        }
    }

    /// How far the path may be cut, with room for the rounding to whole pulses; 0 where that leaves nothing worth it.
    fn tolerance(&self, mode: PathMode) -> f64 {
        let PathMode::Blend { tolerance_mm } = mode else { return 0.0 };
        let rounding = 0.5 * size(&self.pulses_per_mm.map(f64::recip));
        let left = tolerance_mm - rounding;
        if left > 0.1 * tolerance_mm { left } else { 0.0 }
    }

    fn hand_on(&mut self, ended: bool) {
        self.blender.hand_on(ended, &mut self.pieces, &mut self.lines);
        self.emitter.mark(&self.lines);
        self.lines.clear();
        for (piece, entry) in self.pieces.drain(..) {
            self.run.push(piece, entry, &mut self.emitter);
        }
    }

    fn finish_run(&mut self, end: [f64; A], tag: u32, flags: Flags) {
        self.pass_merged();
        self.stop_at(end, tag, flags);
    }

    /// Everything that the blender holds comes to rest at `end`.
    fn stop_at(&mut self, end: [f64; A], tag: u32, flags: Flags) {
        self.hand_on(true);
        let piece = self.run.finish(&mut self.emitter);
        self.emitter.commit(Item::Stop { piece, end, flags, tag });
        self.rest = (end, flags);
    }
}

fn check(numbers: &[f64], feed: Feed, mode: PathMode) -> Result<(), MoveError> {
    let sound = |x: &f64| x.abs() <= 1e6;
    let tolerance = if let PathMode::Blend { tolerance_mm } = mode { tolerance_mm } else { 0.0 };
    if !numbers.iter().all(sound) || !(0.0..=1e6).contains(&tolerance) {
        return Err(MoveError::NotFinite);
    }
    match feed {
        Feed::PerSecond(value) | Feed::Duration(value) if !(value.is_finite() && value > 0.0) => {
            Err(MoveError::Feed { value })
        }
        _ => Ok(()),
    }
}
