//! Blending: the programmed moves of one run become pieces whose direction and curvature are continuous, within the
//! tolerance (G64 P; SMO-2 … SMO-7 in our form).
//!
//! Each junction gets a [`Correction`], as wide as tolerance, machine and path allow. Sparse corners are rounded one by
//! one; in dense chains of short lines the corrections overlap and smooth the whole chain.
//!
//! Invariant: the sum of all corrections never exceeds the tolerance of the move it is on, no correction extends into a
//! move that is to be exact or beyond a stop, and pieces that were released never change. Only the order and length of
//! moves decide what is released when.

use std::collections::VecDeque;

use crate::correction::{Correction, CorrectionEvent, CorrectionSum, MAX_G};
use crate::curve::Curve;
use crate::line_mark::LineMark;
use crate::piece::{PathPiece, PieceJunction};

/// A programmed move.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PathSegment<const A: usize> {
    pub(crate) curve: Curve<A>,
    /// Length, mm, above 0.
    pub(crate) length: f64,
    /// Feed, mm/s.
    pub(crate) feed: f64,
    pub(crate) tag: u32,
    /// Largest distance of the path from the move, mm; 0 where it is exact.
    pub(crate) tolerance: f64,
    /// Number of marks of further program lines that belong to it.
    pub(crate) marks: u32,
}

/// How a segment is entered from the one before.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Junction<const A: usize> {
    /// With its jumps unchanged, no faster than the junction allows.
    Kink(PieceJunction),
    /// Smoothed: the jumps of the first and second derivative.
    Smooth { turn: [f64; A], bend: [f64; A] },
}

/// A corner and the part of the path that its correction may use.
#[derive(Clone, Copy, Debug)]
struct CorrectionCandidate<const A: usize> {
    corner: Correction<A>,
    tolerance: f64,
    /// The correction must stay between these places.
    low: f64,
    high: f64,
}

/// Segments that are not released yet. All places are counted from the start of the first of them.
#[derive(Debug)]
pub(crate) struct Blender<const A: usize> {
    segments: VecDeque<(PathSegment<A>, f64, Option<PieceJunction>)>,
    total: f64,
    /// Total length at which some are released.
    release_length: f64,
    /// Number of segments at which some are released.
    release_count: usize,
    /// Marks of all segments, each from the start of its segment.
    marks: VecDeque<LineMark>,
    /// Corners in order of place; the first `decided` have their width.
    corners: Vec<CorrectionCandidate<A>>,
    decided: usize,
    /// End of the last exact segment, or start of the run.
    barrier: f64,
    /// Half width of the widest correction, mm: wider ones gain no speed.
    reach: f64,
    moments: Vec<[[f64; A]; 4]>,
    events: Vec<CorrectionEvent>,
    /// Intervals where the tolerance is exceeded, and by which factor.
    excess: Vec<(f64, f64, f64)>,
}

/// Number of segments after which some are released even if they are short.
const MAX_SEGMENTS: usize = 4096;
/// Length of path, in widest corrections, after which segments are released again.
const STEP: f64 = 8.0;
/// Number of segments after which some are released again; where many more must be retained, half as many as those.
const BATCH: usize = 64;
/// Rounds of narrowing before corrections are separated from each other, which always succeeds.
const ROUNDS: usize = 24;

impl<const A: usize> Blender<A> {
    /// Creates a blender with corrections of up to `reach` mm to each side.
    pub(crate) fn new(reach: f64) -> Self {
        Self {
            segments: VecDeque::new(),
            total: 0.0,
            marks: VecDeque::new(),
            release_length: STEP * reach,
            release_count: BATCH,
            corners: Vec::new(),
            decided: 0,
            barrier: 0.0,
            reach,
            moments: Vec::new(),
            events: Vec::new(),
            excess: Vec::new(),
        }
    }

    /// The segment that was pushed last.
    pub(crate) fn last(&self) -> Option<&PathSegment<A>> {
        self.segments.back().map(|(segment, ..)| segment)
    }

    /// Program line at the end of the segment that was pushed last.
    pub(crate) fn last_tag(&self) -> u32 {
        let marked = self.marks.back().map(|mark| mark.tag);
        self.last().map_or(0, |last| if last.marks > 0 { marked.unwrap_or(last.tag) } else { last.tag })
    }

    /// Appends a segment with its marks.
    pub(crate) fn push(&mut self, segment: PathSegment<A>, entry: Junction<A>, marks: &[LineMark]) {
        self.marks.extend(marks);
        let s = self.total;
        let mut joint = None;
        match entry {
            Junction::Kink(rough) => {
                joint = Some(rough);
                self.close(s);
            }
            Junction::Smooth { turn, bend } => {
                let tolerance = segment.tolerance.min(self.last().map_or(0.0, |last| last.tolerance));
                if turn != [0.0; A] || bend != [0.0; A] {
                    let corner = Correction { s, turn, bend, h: 0.0 };
                    self.corners.push(CorrectionCandidate { corner, tolerance, low: self.barrier, high: f64::MAX });
                }
            }
        }
        self.total += segment.length;
        self.segments.push_back((segment, s, joint));
    }

    /// Forbids corrections nearer than `distance` to the start of the first segment, which has just been pushed.
    pub(crate) fn forbid_near_start(&mut self, distance: f64) {
        self.barrier = distance;
    }

    /// Length at the end of the last segment that no decided correction reaches.
    pub(crate) fn free_end(&self) -> f64 {
        let reached = self.corners[..self.decided].iter().map(|c| c.corner.s + c.corner.h).fold(0.0, f64::max);
        self.total - reached
    }

    /// Forbids corrections nearer than `distance` to the end of the last segment, as far as they are not decided.
    pub(crate) fn forbid_near_end(&mut self, distance: f64) {
        self.close(self.total - distance);
    }

    /// Removes the last `distance` of the last segment.
    pub(crate) fn shorten(&mut self, distance: f64) {
        if let Some((segment, ..)) = self.segments.back_mut() {
            segment.length -= distance;
            self.total -= distance;
        }
    }

    /// Forbids corrections across place `s`.
    fn close(&mut self, s: f64) {
        self.barrier = s;
        for candidate in self.corners.iter_mut().rev().take_while(|c| c.high == f64::MAX) {
            candidate.high = s;
        }
    }

    /// Whether there is enough to release some of it.
    pub(crate) fn is_ready(&self) -> bool {
        self.total > self.release_length || self.segments.len() >= self.release_count.min(MAX_SEGMENTS)
    }

    /// Releases pieces, each with the junction at its start, and their marks, each from the start of its piece: all of
    /// them where the run has `ended`, otherwise those that later moves cannot change.
    pub(crate) fn release_pieces(
        &mut self,
        ended: bool,
        out: &mut VecDeque<(PathPiece<A>, PieceJunction)>,
        lines: &mut Vec<LineMark>,
    ) {
        if ended {
            self.close(self.total);
        }
        let end = if ended {
            self.corners.len()
        } else {
            let far = self.corners.partition_point(|c| c.corner.s <= self.total - 2.0 * self.reach);
            let many = if self.segments.len() >= MAX_SEGMENTS { self.corners.len() / 2 } else { 0 };
            far.max(many).max(self.decided)
        };
        self.widen(end);
        self.narrow_to_tolerance(end);
        self.decided = end;
        let done = if ended {
            self.segments.len()
        } else {
            // A corner that is not known yet may reach this far back.
            let open = self.corners.get(end).map_or(self.total, |c| c.corner.s);
            let before = |place: f64| self.segments.partition_point(|(_, s, _)| *s <= place);
            let many = if self.segments.len() >= MAX_SEGMENTS { before(open) / 2 } else { 0 };
            before(open - self.reach).saturating_sub(1).max(many)
        };
        self.cut(done, out, lines);
        self.release_length = self.total + STEP * self.reach;
        self.release_count = self.segments.len() + BATCH.max(self.segments.len() / 2);
    }

    /// Gives the corners up to `end` their first width: the largest at which a chain of corrections of that width
    /// around it stays within the tolerance.
    fn widen(&mut self, end: usize) {
        self.sum_moments();
        for k in self.decided..end {
            let CorrectionCandidate { corner, tolerance, low, high } = self.corners[k];
            let room = (corner.s - low.max(0.0)).min(high.min(self.total) - corner.s).min(self.reach);
            let turn = size(&corner.turn);
            let mut h = room.min(tolerance / (MAX_G * turn).max(1e-12));
            for _ in 0..12 {
                let off = self.deviation(corner.s, h);
                if off <= tolerance {
                    break;
                }
                h *= (0.95 * (tolerance / off).sqrt()).max(0.3);
            }
            self.corners[k].corner.h = h;
        }
    }

    /// Computes the sums of Δ·sⁿ, n = 0 … 3, over the corners before each.
    fn sum_moments(&mut self) {
        self.moments.clear();
        let mut sums = [[0.0; A]; 4];
        self.moments.push(sums);
        for CorrectionCandidate { corner, .. } in &self.corners {
            let mut power = 1.0;
            for sum in &mut sums {
                for (sum, turn) in sum.iter_mut().zip(&corner.turn) {
                    *sum += turn * power;
                }
                power *= corner.s;
            }
            self.moments.push(sums);
        }
    }

    /// Distance by which corrections of equal half width `h` would move the path at place `s`.
    fn deviation(&self, s: f64, h: f64) -> f64 {
        let index = |at: f64| self.corners.partition_point(|c| c.corner.s < at);
        let (from, middle, to) = (index(s - h), index(s), index(s + h));
        let mut off = [0.0; A];
        // Σ Δ·(1 − |x|)³·h/6 with 1 − |x| = ±(place − edge)/h.
        for (first, last, edge, sign) in [(from, middle, s - h, 1.0), (middle, to, s + h, -1.0)] {
            let (a, b) = (&self.moments[first], &self.moments[last]);
            for i in 0..A {
                let m = |n: usize| b[n][i] - a[n][i];
                let cubes = m(3) - edge * (3.0 * m(2) - edge * (3.0 * m(1) - edge * m(0)));
                off[i] += sign * cubes / (6.0 * h * h);
            }
        }
        size(&off)
    }

    /// Narrows the corrections of the undecided corners up to `end` until their sum, with those decided before, is
    /// within the tolerance everywhere.
    fn narrow_to_tolerance(&mut self, end: usize) {
        for _ in 0..ROUNDS {
            self.measure(end);
            if self.excess.is_empty() {
                return;
            }
            let excess = &self.excess;
            for CorrectionCandidate { corner, .. } in &mut self.corners[self.decided..end] {
                let first = excess.partition_point(|&(_, to, _)| to <= corner.s - corner.h);
                let worst = excess[first..]
                    .iter()
                    .take_while(|(from, ..)| *from < corner.s + corner.h)
                    .fold(1.0f64, |worst, &(_, _, factor)| worst.max(factor));
                corner.h *= if worst > 1.0 { (0.95 / worst.sqrt()).max(0.3) } else { 1.0 };
            }
        }
        self.separate(end);
        self.measure(end);
        if !self.excess.is_empty() {
            // What was decided before is within the tolerance by itself; next to nothing is added to it.
            for CorrectionCandidate { corner, tolerance, .. } in &mut self.corners[self.decided..end] {
                corner.h = corner.h.min(1e-4 * *tolerance);
            }
            self.measure(end);
        }
    }

    /// Makes the corrections so narrow that no two of the undecided ones overlap.
    fn separate(&mut self, end: usize) {
        for k in self.decided..end {
            let s = self.corners[k].corner.s;
            let before = if k > 0 { s - self.corners[k - 1].corner.s } else { f64::MAX };
            let after = self.corners.get(k + 1).map_or(f64::MAX, |next| next.corner.s - s);
            let CorrectionCandidate { corner, .. } = &mut self.corners[k];
            corner.h = corner.h.min(0.25 * before.min(after));
        }
    }

    /// Collects the events of the corners up to `end`, and the intervals where their sum exceeds the tolerance.
    fn measure(&mut self, end: usize) {
        self.events.clear();
        for (number, CorrectionCandidate { corner, .. }) in self.corners[..end].iter().enumerate() {
            let ahead = corner.knots().filter(|(s, _)| *s > 0.0);
            self.events.extend(ahead.map(|(s, knot)| CorrectionEvent { s, corner: number as u32, knot }));
        }
        sort(&mut self.events);
        self.excess.clear();
        let mut sum = CorrectionSum::of(self.corners[..end].iter().map(|c| &c.corner), 0.0);
        let mut at = 0;
        for event in &self.events {
            while at + 1 < self.segments.len() && self.segments[at + 1].1 <= sum.s {
                at += 1;
            }
            let mut tolerance = self.segments[at].0.tolerance;
            let mut next = at + 1;
            while next < self.segments.len() && self.segments[next].1 < event.s {
                tolerance = tolerance.min(self.segments[next].0.tolerance);
                next += 1;
            }
            let most = sum.size_bound(event.s - sum.s);
            if most > tolerance + 1e-9 {
                self.excess.push((sum.s, event.s, most / tolerance.max(1e-9)));
            }
            sum.advance(event.s);
            sum.jump(&self.corners[event.corner as usize].corner, event.knot, event.s);
        }
    }

    /// Releases the first `done` segments, cut where the correction changes its form.
    fn cut(&mut self, done: usize, out: &mut VecDeque<(PathPiece<A>, PieceJunction)>, lines: &mut Vec<LineMark>) {
        if done == 0 {
            return;
        }
        let mut sum = self.sum_at(0.0);
        let (mut anchor, mut largest) = (0.0, sum.size());
        let mut events = self.events.iter().peekable();
        let mut marks = std::mem::take(&mut self.marks);
        for (segment, start, joint) in self.segments.range(..done) {
            let end = start + segment.length;
            let mut entry = joint.unwrap_or(PieceJunction::SMOOTH);
            let (mut tag, mut left) = (segment.tag, segment.marks);
            loop {
                // All jumps at this place, within rounding.
                while let Some(event) = events.next_if(|event| event.s <= sum.s + SLIVER) {
                    sum.jump(&self.corners[event.corner as usize].corner, event.knot, event.s);
                    largest = larger(largest, sum.size());
                }
                let next = events.peek().map_or(end, |event| event.s.min(end));
                let next = if next > end - SLIVER { end } else { next };
                if rounding(largest, next - anchor) > ROUNDING {
                    let s = sum.s;
                    sum = self.sum_at(s + SLIVER);
                    sum.advance(s);
                    (anchor, largest) = (s, sum.size());
                }
                let curve = segment.curve.corrected(sum.s - start, &sum.cubic());
                let mut piece = PathPiece::new(curve, next - sum.s, segment.feed, tag);
                while left > 0
                    && let Some(&mark) = marks.front()
                    && (next == end || mark.place < next - start)
                {
                    marks.pop_front();
                    lines.push(LineMark { place: mark.place - (sum.s - start), ..mark });
                    (tag, left, piece.marks) = (mark.tag, left - 1, piece.marks + 1);
                }
                out.push_back((piece, entry));
                entry = PieceJunction::SMOOTH;
                sum.advance(next);
                if next == end {
                    break;
                }
            }
        }
        self.marks = marks;
        self.remove_released(done, sum.s);
    }

    /// Sum of the decided corrections at place `s`, computed from each of them again.
    fn sum_at(&self, s: f64) -> CorrectionSum<A> {
        let decided = &self.corners[..self.decided];
        let from = decided.partition_point(|c| c.corner.s < s - self.reach);
        let near = decided[from..].iter().take_while(|c| c.corner.s <= s + self.reach);
        CorrectionSum::of(near.map(|c| &c.corner), s)
    }

    /// Removes the first `done` segments, which end at place `s` and are released.
    fn remove_released(&mut self, done: usize, s: f64) {
        self.segments.drain(..done);
        for (_, start, _) in &mut self.segments {
            *start -= s;
        }
        self.total -= s;
        self.barrier -= s;
        let (mut index, decided) = (0, self.decided);
        self.corners.retain(|c| {
            index += 1;
            let open = index > decided;
            let retained = open || c.corner.s + c.corner.h > s;
            self.decided -= usize::from(!retained);
            retained
        });
        for CorrectionCandidate { corner, low, high, .. } in &mut self.corners {
            corner.s -= s;
            *low -= s;
            *high -= s;
        }
        if self.segments.is_empty() {
            (self.total, self.barrier, self.decided) = (0.0, 0.0, 0);
            self.corners.clear();
        }
    }
}

/// Sorts by place what is nearly sorted: each event moves back past those that it overlaps.
fn sort(events: &mut [CorrectionEvent]) {
    for k in 1..events.len() {
        let event = events[k];
        let mut at = k;
        while at > 0 && events[at - 1].s > event.s {
            events[at] = events[at - 1];
            at -= 1;
        }
        events[at] = event;
    }
}

/// Pieces shorter than this, in mm, are not made.
const SLIVER: f64 = 1e-9;

/// Rounding in mm that a running sum of corrections may accumulate before it is computed again.
const ROUNDING: f64 = 2e-15;

/// Rounding of the given second and third derivatives after `length`.
fn rounding((second, third): (f64, f64), length: f64) -> f64 {
    f64::EPSILON * length * length * (0.5 * second + length * third / 6.0)
}

fn larger(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    (a.0.max(b.0), a.1.max(b.1))
}

/// Size of a vector over all axes. A rotary axis counts like a linear one, so that a tolerance bounds its deviation
/// too.
pub(crate) fn size(vector: &[f64]) -> f64 {
    vector.iter().map(|x| x * x).sum::<f64>().sqrt()
}
