//! Knots: the places at which the plan is cut before it is refined.
//!
//! Invariant: knots follow one another, each in the state that the plan has there; one is at the start of each span,
//! and one wherever a junction limits the speed.

use super::super::PlanRun;
use super::SHORTEST;
use crate::emitter::Emitter;
use crate::profile::{Profile, ProfileCursor};
use crate::speed_law::law_path::{LawPart, LawPath, LawSegment};

/// Longest and shortest time between two knots, s.
const SPACING: (f64, f64) = (2.5e-3, 1e-3);
/// Two knots less than this apart, s, are too close together: the law bends hard between them for little.
const CLOSE: f64 = 0.5e-3;
/// A remainder of a piece or of a span that is shorter than this, mm, counts as zero.
pub(super) const SLIVER: f64 = 1e-9;

/// Start of a segment.
#[derive(Clone, Copy, Debug)]
pub(super) struct Knot {
    /// Place, mm from the start of the run.
    pub(super) s: f64,
    /// State of the plan.
    pub(super) v: f64,
    pub(super) a: f64,
    /// Time in the plan, s from the first knot.
    pub(super) clock: f64,
    /// Span of the plan, and time in it.
    pub(super) span: usize,
    pub(super) t: f64,
    /// Number of the piece, and place on it.
    pub(super) piece: u64,
    pub(super) on: f64,
    /// Whether it has to be there: a span of the plan begins, or a speed is limited at this place.
    pub(super) is_fixed: bool,
}

/// Adds a knot; of two that are too close together one that need not be there is left out.
fn push_apart(knots: &mut Vec<Knot>, knot: Knot) {
    while let Some(last) = knots.last()
        && (knot.s - last.s < SHORTEST || knot.clock - last.clock < CLOSE)
    {
        if !knot.is_fixed {
            return;
        }
        if last.is_fixed {
            break;
        }
        knots.pop();
    }
    knots.push(knot);
}

/// Cursor along the plan and the pieces.
struct PlanCursor {
    /// Place from the start of the run.
    at: f64,
    span: usize,
    /// Place of the start of the span, and time since the first knot there.
    span_start: f64,
    span_clock: f64,
    profile: ProfileCursor,
    /// Time in the span.
    t: f64,
    piece: u64,
    on: f64,
    /// Time since the last knot, s; infinite where one must be here.
    since: f64,
}

impl PlanCursor {
    /// Enters span number `span`, which begins at place `start` and is `profile`.
    fn enter_span(&mut self, span: usize, start: f64, profile: &Profile) {
        self.span_clock += self.t;
        (self.span, self.span_start, self.t) = (span, start, 0.0);
        self.profile = ProfileCursor::new(profile);
    }

    /// Knot at time `t` in the span, at which `place` of the run is passed where that is known better.
    fn knot(&mut self, t: f64, place: Option<f64>, is_fixed: bool) -> Knot {
        let state = self.profile.seek_time(t);
        let s = place.unwrap_or(self.span_start + state.s);
        Knot {
            s,
            v: state.v,
            a: state.a,
            clock: self.span_clock + t,
            span: self.span,
            t,
            piece: self.piece,
            on: self.on + (s - self.at).max(0.0),
            is_fixed,
        }
    }

    /// Adds the knots up to before time `end` in the span, all on one piece.
    fn cut(&mut self, knots: &mut Vec<Knot>, end: f64) {
        let (from, seconds) = (self.t, (end - self.t).max(0.0));
        let begins_span = from == 0.0;
        if begins_span || self.since >= SPACING.1 {
            let place = self.at;
            push_apart(knots, self.knot(from, Some(place), begins_span || self.since == f64::INFINITY));
            self.since = 0.0;
        }
        let cuts = (seconds / SPACING.0).ceil().clamp(1.0, 1e5) as usize;
        for k in 1..cuts {
            push_apart(knots, self.knot(from + seconds * k as f64 / cuts as f64, None, false));
        }
        self.since = if cuts > 1 { seconds / cuts as f64 } else { self.since + seconds };
    }
}

impl<const A: usize> PlanRun<A> {
    /// Cuts the plan from block `first` to place `until` at knots. False where that is not possible, or where nothing
    /// on the way is curved.
    pub(super) fn lay_knots(
        &self,
        knots: &mut Vec<Knot>,
        (first, until): (usize, f64),
        s: &[f64],
        emitter: &Emitter<A>,
    ) -> bool {
        knots.clear();
        let end = s[self.plan[self.plan.len() - 1].last].min(until);
        let span = self.plan.partition_point(|span| span.last <= first);
        if span >= self.plan.len() || s[first] >= end - SLIVER {
            return false;
        }
        let mut cursor = self.cursor_at(s[first], span, s, emitter);
        let mut curved = false;
        while cursor.at < end - SLIVER && cursor.piece < self.next_piece {
            let Some(here) = emitter.piece(cursor.piece) else { return false };
            let span = &self.plan[cursor.span];
            let span_end = s[span.last];
            let left = (here.length - cursor.on).min(end - cursor.at).min(span_end - cursor.at);
            let (at_end, ends_span) = (left >= here.length - cursor.on - SLIVER, cursor.at + left >= span_end - SLIVER);
            let t_end = if ends_span {
                span.profile.duration()
            } else {
                let mut ahead = cursor.profile;
                ahead.seek_place(cursor.at + left - cursor.span_start)
            };
            if left > SLIVER {
                cursor.cut(knots, t_end);
                curved |= !here.curve.is_line();
                if at_end && here.exit_v < f64::MAX {
                    cursor.since = f64::INFINITY;
                }
            }
            (cursor.at, cursor.t) = (if ends_span { span_end } else { cursor.at + left }, t_end);
            (cursor.piece, cursor.on) = if at_end { (cursor.piece + 1, 0.0) } else { (cursor.piece, cursor.on + left) };
            let next = cursor.span + 1;
            if ends_span && next < self.plan.len() && cursor.at < end - SLIVER {
                cursor.enter_span(next, span_end, &self.plan[next].profile);
            }
        }
        if knots.is_empty() {
            return false;
        }
        let t = cursor.t;
        push_apart(knots, cursor.knot(t, Some(end), true));
        curved
    }

    /// Cursor at `place`, which is in span number `span`; `s` holds the places of the junctions.
    fn cursor_at(&self, place: f64, span: usize, s: &[f64], emitter: &Emitter<A>) -> PlanCursor {
        let (piece, on) = self.piece_at(place, emitter);
        let span_start = s[self.plan[span].first];
        let mut profile = ProfileCursor::new(&self.plan[span].profile);
        let t = if place > span_start { profile.seek_place(place - span_start) } else { 0.0 };
        PlanCursor { at: place, span, span_start, span_clock: -t, profile, t, piece, on, since: f64::INFINITY }
    }

    /// Number of the piece at place `s` of the run, and the place on it.
    fn piece_at(&self, s: f64, emitter: &Emitter<A>) -> (u64, f64) {
        let (mut first, mut skip) = (self.next_piece, s - self.length);
        while skip < -1e-12
            && let Some(piece) = first.checked_sub(1).and_then(|before| emitter.piece(before))
        {
            (first, skip) = (first - 1, skip + piece.length);
        }
        let skip = skip.max(0.0);
        match emitter.piece(first) {
            Some(piece) if skip >= piece.length - SLIVER => (first + 1, 0.0),
            _ => (first, skip),
        }
    }

    /// Lays the path between the knots; false where a junction that limits the speed has no knot.
    pub(super) fn lay_path(&self, knots: &[Knot], path: &mut LawPath<A>, emitter: &Emitter<A>) -> bool {
        path.segments.clear();
        path.parts.clear();
        for pair in knots.windows(2) {
            let (from, to) = (&pair[0], &pair[1]);
            let length = to.s - from.s;
            let (mut v, mut exit_v, mut covered) = (f64::MAX, f64::MAX, 0.0);
            let (mut piece, mut on) = (from.piece, from.on);
            let mut is_line = true;
            while covered < length - SLIVER {
                let Some(here) = emitter.piece(piece) else { return false };
                let part = (here.length - on).min(length - covered);
                let (limit, a, j) = here.axis_limits(&self.axes, self.factor);
                v = v.min(limit);
                if part > 1e-12 {
                    path.parts.push(LawPart { curve: here.curve.from(on), length: part, a, j });
                    is_line &= here.curve.is_line();
                }
                covered += part;
                exit_v = if on + part >= here.length - SLIVER { here.exit_v } else { f64::MAX };
                if exit_v < f64::MAX && covered < length - SLIVER {
                    return false;
                }
                (piece, on) = (piece + 1, 0.0);
            }
            path.segments.push(LawSegment { length, v, exit_v, is_line, parts_end: path.parts.len() });
        }
        true
    }
}
