//! The planner: moves go in, records come out, look-ahead in between.
//!
//! Invariant: what comes out depends on the moves, their modes and the stops, in their order, and on nothing else: never on
//! when records are asked for. A committed record never changes, and what is committed can always be followed by a stop.

use retrace_core::{Flags, Record};

use crate::blend::{Blender, Entry, Segment, size};
use crate::curve::{Arc, Curve};
use crate::emitter::{Emitter, Item, SetPoint, counts_of};
use crate::error::{LimitError, MoveError};
use crate::glide::book::Book;
use crate::glide::optimum::gentle;
use crate::glide::passage::Passage;
use crate::glide::ramp::Ramps;
use crate::glide::tracks::{FarEnd, Track, Tracks};
use crate::joining::{glide_pays, join};
use crate::limits::{AxisLimits, Limits};
use crate::piece::{Joint, Piece};
use crate::profile::{State, fastest, stopping_distance};
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

/// A move that waits for the next one, which decides how it is joined to the one before.
#[derive(Clone, Copy, Debug)]
struct Held<const A: usize> {
    segment: Segment<A>,
    start: [f64; A],
    /// It ends with a full stop.
    stops: bool,
}

/// The first segment of a run, as long as it is the only one.
#[derive(Clone, Copy, Debug)]
struct Lead {
    /// In which state the run begins, its place counted from the start of the whole segment.
    start: State,
    /// Length of the whole segment, mm.
    length: f64,
}

/// Plans moves and emits one record a control period.
#[derive(Debug)]
pub struct Planner<const A: usize> {
    axes: AxisLimits<A>,
    pulses_per_mm: [f64; A],
    emitter: Emitter<A>,
    blender: Blender<A>,
    run: Run<A>,
    /// Pieces on their way from the blender to the run, kept for their memory.
    pieces: Vec<(Piece<A>, Joint)>,
    book: Book,
    held: Option<Held<A>>,
    lead: Option<Lead>,
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
            blender: Blender::new(reach),
            run: Run::new(axes),
            pieces: Vec::new(),
            book: Book::default(),
            held: None,
            lead: None,
            at: start_mm,
            tag: 0,
            stops: false,
            rest: (start_mm, Flags::NONE),
        })
    }

    /// A planner that looks ahead over that many blocks of the road instead of as far as it needs to stop: up to them are planned
    /// together, and half of them are then committed. A block of the road is a move, or a part of a blended one. At least 2;
    /// `usize::MAX` plans every run whole.
    ///
    /// # Errors
    /// E41xx: a limit is out of its range.
    pub fn with_look_ahead(limits: Limits<A>, start_mm: [f64; A], blocks: usize) -> Result<Self, LimitError> {
        let mut planner = Self::new(limits, start_mm)?;
        planner.run.look_over(blocks);
        Ok(planner)
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
        if let Some(held) = self.held.take() {
            self.place(&held, None);
        }
        let flags = flags.with(Flags::REST);
        let (end, held) = self.rest;
        let moves = self.blender.last().is_some();
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
        let segment = Segment { curve, length, feed, tag, tolerance: self.tolerance(mode) };
        let stops = mode == PathMode::ExactStop;
        if let Some(before) = self.held.replace(Held { segment, start, stops }) {
            self.place(&before, Some(&segment));
        }
    }

    /// Joins a move to what there is; `next` follows it, or a stop.
    fn place(&mut self, held: &Held<A>, next: Option<&Segment<A>>) {
        let Held { segment, start, .. } = held;
        let mut entry = Entry::Rough(Joint::STOP);
        if let Some(last) = self.blender.last().copied() {
            let stops = self.stops;
            let joined = join(&last, segment, &self.axes).filter(|_| !stops);
            let glide = if stops { None } else { self.find_glide(&last, held, next, joined.as_ref()) };
            if let Some((tracks, ramps)) = glide
                && self.pass(&tracks, &ramps, &last, held)
            {
                return;
            }
            match joined {
                Some(joined) => entry = joined,
                None => self.finish_run(*start, last.tag, Flags::REST),
            }
        }
        self.stops = held.stops;
        self.lead = self.blender.last().is_none().then_some(Lead { start: State::default(), length: segment.length });
        self.blender.push(*segment, entry);
        if self.blender.is_ready() {
            self.hand_on(false);
        }
    }

    /// A glide from `last` into the held move, if it is faster than any other way.
    fn find_glide(
        &mut self,
        last: &Segment<A>,
        held: &Held<A>,
        next: Option<&Segment<A>>,
        joined: Option<&Entry<A>>,
    ) -> Option<(Tracks<A>, Ramps)> {
        let segment = &held.segment;
        let tolerance = last.tolerance.min(segment.tolerance);
        if tolerance <= 0.0 || !last.curve.is_line() || !segment.curve.is_line() {
            return None;
        }
        let (u, w) = (last.curve.derivatives(0.0).first, segment.curve.derivatives(0.0).first);
        if u[A.min(3)..].iter().chain(&w[A.min(3)..]).any(|x| *x != 0.0) {
            return None;
        }
        let moves_on = |stops: bool, next: Option<&Segment<A>>| {
            if stops || next.is_none_or(|next| next.tolerance.min(segment.tolerance) <= 0.0) {
                FarEnd::Rest
            } else {
                FarEnd::Moving
            }
        };
        let (length, from) = match self.lead {
            Some(Lead { start, length }) if start == State::default() => (length, FarEnd::Rest),
            Some(Lead { length, .. }) => (length, FarEnd::Moving),
            None => (last.length, FarEnd::Moving),
        };
        let to = moves_on(held.stops, next);
        if !glide_pays([(last, from), (segment, to)], joined, tolerance, &self.axes) {
            return None;
        }
        let tracks = Tracks {
            pair: [
                Track::new(u, length, from, last.feed, &self.axes),
                Track::new(w, segment.length, to, segment.feed, &self.axes),
            ],
            tolerance,
        };
        if tracks.sine() < 1e-3 {
            return None;
        }
        let ramps = self.book.glide(&tracks, &self.axes)?;
        self.fitted(&tracks, ramps)
    }

    /// The glide as large as the way before it allows.
    fn fitted(&self, tracks: &Tracks<A>, ramps: Ramps) -> Option<(Tracks<A>, Ramps)> {
        let before = &tracks.pair[0];
        let free = self.blender.free_end();
        [1.0, 0.7, 0.5, 0.3].into_iter().map(|factor| ramps.scaled(factor)).find_map(|ramps| {
            let [out, _] = ramps.ends();
            if out.s > free {
                return None;
            }
            let Some(Lead { start, length }) = self.lead else { return Some((*tracks, ramps)) };
            let (from, to) = (State::moving(start.v, start.a), State::moving(out.v, -out.a));
            fastest(from, to, length - start.s - out.s, before.limits).ok().map(|_| (*tracks, ramps))
        })
    }

    /// Goes over into the held move by a glide; false where the motion before it could not be brought into it.
    fn pass(&mut self, tracks: &Tracks<A>, ramps: &Ramps, last: &Segment<A>, held: &Held<A>) -> bool {
        let [out, into] = ramps.ends();
        let Held { segment, start, stops, .. } = held;
        self.blender.shorten(out.s);
        self.hand_on(true);
        let (piece, reached) = self.run.finish_moving(State::moving(out.v, -out.a), &mut self.emitter);
        if !reached {
            // At rest a little before the corner; the rest of the way is a move of its own.
            let from = last.length - out.s;
            let end = last.curve.at(from);
            self.emitter.commit(Item::Stop { piece, end, flags: Flags::NONE, tag: last.tag });
            self.blender
                .push(Segment { curve: last.curve.from(from), length: out.s, ..*last }, Entry::Rough(Joint::STOP));
            self.lead = None;
            self.finish_run(*start, last.tag, Flags::REST);
            return false;
        }
        let directions = tracks.pair.map(|track| track.direction);
        self.emitter.commit_glide(Passage::new(*start, directions, [last.tag, segment.tag], *ramps), piece);
        self.run.begin(State::moving(into.v, into.a));
        self.stops = *stops;
        self.lead = Some(Lead { start: into, length: segment.length });
        let rest = Segment { curve: segment.curve.from(into.s), length: segment.length - into.s, ..*segment };
        self.blender.push(rest, Entry::Rough(Joint::STOP));
        self.blender.keep_clear(stopping_distance(into, gentle(tracks.pair[1].limits, into)));
        true
    }

    /// How far the path may be cut, with room for the rounding to whole pulses; 0 where that leaves nothing worth it.
    fn tolerance(&self, mode: PathMode) -> f64 {
        let PathMode::Blend { tolerance_mm } = mode else { return 0.0 };
        let rounding = 0.5 * size(&self.pulses_per_mm.map(f64::recip));
        let left = tolerance_mm - rounding;
        if left > 0.1 * tolerance_mm { left } else { 0.0 }
    }

    fn hand_on(&mut self, ended: bool) {
        self.blender.hand_on(ended, &mut self.pieces);
        for (piece, entry) in self.pieces.drain(..) {
            self.run.push(piece, entry, &mut self.emitter);
        }
    }

    fn finish_run(&mut self, end: [f64; A], tag: u32, flags: Flags) {
        self.hand_on(true);
        self.lead = None;
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
