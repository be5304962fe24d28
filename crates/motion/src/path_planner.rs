//! The path planner: how each move meets the next one, by a stop, unchanged, rounded, or in a glide.
//!
//! Invariant: a move waits until the next one, or a stop, is known, since that decides how it meets the one before.
//! What is released to be planned never changes, and depends on the moves and stops alone.

use std::collections::VecDeque;

use retrace_core::{Flags, Record};

use crate::blend::{Blender, Junction, PathSegment};
use crate::curve::Curve;
use crate::emitter::{Emitter, PlanItem, SetPoint};
use crate::glide::glide_cache::GlideCache;
use crate::glide::glide_segment::GlideSegment;
use crate::glide::optimum::{gentle, rest_time};
use crate::glide::ramp_pair::RampPair;
use crate::glide::tracks::{FarEnd, Track, Tracks};
use crate::glide::{Blending, source};
use crate::junction::{glide_is_faster, join};
use crate::limits::{AxisLimits, MachineLimits};
use crate::line_mark::LineMark;
use crate::piece::{PathPiece, PieceJunction};
use crate::planned_section::PlannedSection;
use crate::profile::{KinematicState, fastest, stopping_distance};
use crate::run::{PlanFallbacks, PlanMode, PlanRun, smallest};

/// A move that waits for the next one, which decides how it meets the one before.
#[derive(Clone, Copy, Debug)]
struct PendingMove<const A: usize> {
    segment: PathSegment<A>,
    start: [f64; A],
    /// Whether it ends with a full stop.
    stops: bool,
}

/// The first segment of a run, while it is the only one.
#[derive(Clone, Copy, Debug)]
struct FirstSegment {
    /// State in which the run begins, its place counted from the start of the whole segment.
    start: KinematicState,
    /// Length of the whole segment, mm.
    length: f64,
}

/// Planner of the path ahead, from moves to the plan.
#[derive(Debug)]
pub(crate) struct PathPlanner<const A: usize> {
    axes: AxisLimits<A>,
    emitter: Emitter<A>,
    blender: Blender<A>,
    run: PlanRun<A>,
    blending: Blending,
    glide_cache: GlideCache,
    pending: Option<PendingMove<A>>,
    /// Marks of the pending move.
    marks: Vec<LineMark>,
    lead: Option<FirstSegment>,
    /// Whether the last move in the blender ends with a full stop.
    stops: bool,
    /// Pieces that wait to be planned, and marks from the blender, retained for their memory.
    pieces: VecDeque<(PathPiece<A>, PieceJunction)>,
    lines: Vec<LineMark>,
}

/// Straight path before a glide, over the distance in which the state at its start could come from rest: so a plan into
/// the glide exists. With more, roundings before it get narrower than is needed; with less, plans are not found.
const STRAIGHT_LEAD_IN: f64 = 0.8;
/// Largest number of pieces that are planned when a move is accepted, so that no move waits for everything that the
/// blender releases together; more than a move is ever cut into.
const MAX_PIECES: usize = 24;

impl<const A: usize> PathPlanner<A> {
    /// Creates a planner at rest at `start_mm`.
    pub(crate) fn new(limits: MachineLimits<A>, start_mm: [f64; A]) -> Self {
        let axes = limits.planned();
        // A turn of 1/8 rad rounded this widely takes half the jerk at full speed; sharper ones are slower in any case.
        let reach = 0.5 * (axes.path_v.powi(3) / smallest(axes.j)).sqrt();
        Self {
            axes,
            emitter: Emitter::new(limits, start_mm),
            blender: Blender::new(reach),
            run: PlanRun::new(axes),
            blending: Blending::default(),
            glide_cache: GlideCache::default(),
            pending: None,
            marks: Vec::new(),
            lead: None,
            stops: false,
            pieces: VecDeque::new(),
            lines: Vec::new(),
        }
    }

    /// Plans over `blocks` blocks at a time.
    pub(crate) fn set_look_ahead(&mut self, blocks: usize) {
        self.run.set_look_ahead(blocks);
    }

    /// Multiplies programmed feeds by `factor` from the next record on. Which junctions are blended, and how, does not
    /// depend on it.
    pub(crate) fn set_feed_factor(&mut self, factor: f64) {
        self.run.set_feed_factor(factor, &mut self.emitter);
    }

    /// See [`crate::Planner::with_glides_of`].
    pub(crate) fn take_glides_of(&mut self, earlier: Self) {
        if earlier.axes == self.axes {
            self.glide_cache = earlier.glide_cache;
        }
    }

    /// Sets the method by which the corners that follow are blended.
    pub(crate) fn set_blending(&mut self, blending: Blending) {
        self.blending = blending;
    }

    /// Whether anything has moved since the last stop.
    pub(crate) fn has_motion(&self) -> bool {
        self.pending.is_some() || self.blender.last().is_some()
    }

    /// Sets how the speed along the path is planned.
    pub(crate) fn set_mode(&mut self, mode: PlanMode) {
        self.run.set_mode(mode);
    }

    /// See [`crate::Planner::with_exact_feed`].
    pub(crate) fn keep_feed(&mut self) {
        self.run.keep_feed();
    }

    /// See [`crate::Planner::fallbacks`].
    pub(crate) fn fallbacks(&self) -> PlanFallbacks {
        self.run.fallbacks()
    }

    /// See [`crate::Planner::planned_sections`].
    pub(crate) fn sections(&self) -> Vec<PlannedSection<A>> {
        self.run.sections(&self.emitter)
    }

    /// Record of the next control period, if it is planned.
    pub(crate) fn next_record(&mut self) -> Option<Record<A>> {
        self.emitter.next_record()
    }

    /// See [`crate::Planner::count_records`].
    pub(crate) fn count_records(&mut self) -> u64 {
        let mut count = 0;
        loop {
            count += self.emitter.skip_records();
            if self.emitter.next_record().is_none() {
                return count;
            }
            count += 1;
        }
    }

    /// See [`crate::Planner::displace`].
    pub(crate) fn displace(&mut self, pulses: [i64; A], pulses_per_mm: &[f64; A]) -> bool {
        !self.has_motion() && self.emitter.displace(pulses, pulses_per_mm)
    }

    /// The last set-point.
    pub(crate) fn point(&self) -> &SetPoint<A> {
        self.emitter.point()
    }

    /// Adds a stop at `end`, whose record has `flags` and program line `tag`.
    pub(crate) fn stop(&mut self, end: [f64; A], tag: u32, flags: Flags) {
        if let Some(pending) = self.pending.take() {
            self.connect(&pending, None);
        }
        self.come_to_rest(end, tag, flags);
    }

    /// Accepts `segment`, whose `marks` are taken out, and connects the one before it. `stops`: the segment ends with a
    /// full stop.
    pub(crate) fn accept(&mut self, segment: PathSegment<A>, stops: bool, marks: &mut Vec<LineMark>) {
        let start = segment.curve.at(0.0);
        let before = self.pending.replace(PendingMove { segment, start, stops });
        if let Some(before) = before {
            self.connect(&before, Some(&segment));
        }
        std::mem::swap(marks, &mut self.marks);
        marks.clear();
    }

    /// Connects a move to those before it; `next` follows it, or a stop.
    fn connect(&mut self, pending: &PendingMove<A>, next: Option<&PathSegment<A>>) {
        let PendingMove { segment, start, .. } = pending;
        let mut entry = Junction::Kink(PieceJunction::STOP);
        if let Some(last) = self.blender.last().copied() {
            let stops = self.stops;
            let joined = join(&last, segment, &self.axes).filter(|_| !stops);
            let glide = if stops { None } else { self.find_glide(&last, pending, next, joined.as_ref()) };
            match (glide, joined) {
                (Some((tracks, ramps)), _) => {
                    if self.pass_by_glide(&tracks, &ramps, &last, pending) {
                        return;
                    }
                }
                (None, Some(joined)) => entry = joined,
                (None, None) => self.come_to_rest(*start, self.blender.last_tag(), Flags::REST),
            }
        }
        self.stops = pending.stops;
        self.lead = self
            .blender
            .last()
            .is_none()
            .then_some(FirstSegment { start: KinematicState::default(), length: segment.length });
        self.blender.push(*segment, entry, &self.marks);
        if self.blender.is_ready() {
            self.flush_pieces(false);
        } else {
            self.plan_pieces(MAX_PIECES);
        }
    }

    /// A glide from `last` into the pending move, if the method has one: the optimum only where it is faster than any
    /// other way.
    fn find_glide(
        &mut self,
        last: &PathSegment<A>,
        pending: &PendingMove<A>,
        next: Option<&PathSegment<A>>,
        joined: Option<&Junction<A>>,
    ) -> Option<(Tracks<A>, RampPair)> {
        let segment = &pending.segment;
        let tolerance = last.tolerance.min(segment.tolerance);
        if tolerance <= 0.0 {
            return None;
        }
        // On arcs roundings are faster than glides, which use only what the arc allows throughout.
        if !last.curve.is_line() || !segment.curve.is_line() {
            return None;
        }
        let (u, w) = (last.curve.derivatives(last.length).first, segment.curve.derivatives(0.0).first);
        if u[A.min(3)..].iter().chain(&w[A.min(3)..]).any(|x| *x != 0.0) {
            return None;
        }
        let far_end_of = |stops: bool, next: Option<&PathSegment<A>>| {
            if stops || next.is_none_or(|next| next.tolerance.min(segment.tolerance) <= 0.0) {
                FarEnd::Rest
            } else {
                FarEnd::Moving
            }
        };
        let (length, from) = match self.lead {
            Some(FirstSegment { start, length }) if start == KinematicState::default() => (length, FarEnd::Rest),
            Some(FirstSegment { length, .. }) => (length, FarEnd::Moving),
            None => (last.length, FarEnd::Moving),
        };
        let to = far_end_of(pending.stops, next);
        if self.blending == Blending::Optimum
            && !glide_is_faster([(last, from), (segment, to)], joined, tolerance, &self.axes)
        {
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
        let ramps = match self.blending {
            Blending::Optimum => self.glide_cache.glide(&tracks, &self.axes)?,
            Blending::Source(ratio) => source::glide(&tracks, &self.axes, ratio)?,
        };
        self.fit_glide(&tracks, ramps)
    }

    /// The glide, as large as the path before it allows.
    fn fit_glide(&self, tracks: &Tracks<A>, ramps: RampPair) -> Option<(Tracks<A>, RampPair)> {
        let before = &tracks.pair[0];
        let free = self.blender.free_end();
        [1.0, 0.97, 0.9, 0.7, 0.5, 0.3].into_iter().map(|factor| ramps.scaled(factor)).find_map(|ramps| {
            let [out, into] = ramps.ends();
            // It was found for tracks that are only nearly these.
            rest_time(out, tracks, 0).and(rest_time(into, tracks, 1))?;
            if out.s > free {
                return None;
            }
            let Some(FirstSegment { start, length }) = self.lead else { return Some((*tracks, ramps)) };
            let (from, to) = (KinematicState::moving(start.v, start.a), KinematicState::moving(out.v, -out.a));
            fastest(from, to, length - start.s - out.s, before.limits).ok().map(|_| (*tracks, ramps))
        })
    }

    /// Passes into the pending move by a glide; false where the motion before it could not be brought into it.
    fn pass_by_glide(
        &mut self,
        tracks: &Tracks<A>,
        ramps: &RampPair,
        last: &PathSegment<A>,
        pending: &PendingMove<A>,
    ) -> bool {
        let [out, into] = ramps.ends();
        let PendingMove { segment, start, stops } = pending;
        let tag = self.blender.last_tag();
        self.blender.shorten(out.s);
        let limits = tracks.pair[0].limits;
        self.blender.forbid_near_end(STRAIGHT_LEAD_IN * stopping_distance(out, gentle(limits, out)));
        self.flush_pieces(true);
        let (piece, reached) = self.run.finish_moving(KinematicState::moving(out.v, -out.a), &mut self.emitter);
        if !reached {
            // At rest a little before the corner, or beyond a sharp one, over which glides swing out. The rest of the
            // way, there or back, is a move of its own.
            let from = last.length - out.s;
            let end = last.curve.at(from);
            self.emitter.commit(PlanItem::Stop { piece, end, flags: Flags::NONE, tag });
            let (curve, length) = if out.s > 0.0 { (last.curve.from(from), out.s) } else { Curve::line(end, *start) };
            if length > 0.0 {
                let rest = PathSegment { curve, length, tag, marks: 0, ..*last };
                self.blender.push(rest, Junction::Kink(PieceJunction::STOP), &[]);
            }
            self.come_to_rest(*start, tag, Flags::REST);
            return false;
        }
        let directions = tracks.pair.map(|track| track.direction);
        let glide = GlideSegment::new(*start, directions, [tag, segment.tag], [last.feed, segment.feed], *ramps);
        self.emitter.commit_glide(glide, piece);
        self.run.begin(KinematicState::moving(into.v, into.a), tracks.pair[1].limits, ramps.duration());
        self.stops = *stops;
        self.lead = Some(FirstSegment { start: into, length: segment.length });
        // Program lines that begin within the glide are skipped.
        let passed = self.marks.partition_point(|mark| mark.place <= into.s);
        let tag = self.marks.drain(..passed).next_back().map_or(segment.tag, |mark| mark.tag);
        for mark in &mut self.marks {
            mark.place -= into.s;
        }
        let rest = PathSegment {
            curve: segment.curve.from(into.s),
            length: segment.length - into.s,
            tag,
            marks: self.marks.len() as u32,
            ..*segment
        };
        self.blender.push(rest, Junction::Kink(PieceJunction::STOP), &self.marks);
        self.blender.forbid_near_start(stopping_distance(into, gentle(tracks.pair[1].limits, into)));
        true
    }

    fn flush_pieces(&mut self, ended: bool) {
        self.blender.release_pieces(ended, &mut self.pieces, &mut self.lines);
        self.emitter.mark(&self.lines);
        self.lines.clear();
        if ended {
            self.plan_pieces(usize::MAX);
        }
    }

    /// Plans up to `max_pieces` of the pieces that wait.
    fn plan_pieces(&mut self, max_pieces: usize) {
        let most = max_pieces.min(self.pieces.len());
        for (piece, entry) in self.pieces.drain(..most) {
            self.run.push(piece, entry, &mut self.emitter);
        }
    }

    /// Releases everything that the blender holds and comes to rest at `end`.
    fn come_to_rest(&mut self, end: [f64; A], tag: u32, flags: Flags) {
        self.flush_pieces(true);
        self.lead = None;
        let piece = self.run.finish(&mut self.emitter);
        self.emitter.commit(PlanItem::Stop { piece, end, flags, tag });
    }
}
