//! The path under a speed law: segments between knots, and the parts of pieces that they cover.
//!
//! Invariant: parts follow one another without gaps, each within one piece and one segment.

use crate::curve::Curve;

/// Part of a piece under one segment.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LawPart<const A: usize> {
    /// Curve of the piece from the start of the part on.
    pub(crate) curve: Curve<A>,
    /// Length, mm, above 0.
    pub(crate) length: f64,
    /// Acceleration and jerk of each axis that the speed law may use.
    pub(crate) a: [f64; A],
    pub(crate) j: [f64; A],
}

/// Part of the path between two knots.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LawSegment {
    /// Length, mm, above 0.
    pub(crate) length: f64,
    /// Highest speed in it, mm/s, and at its end.
    pub(crate) v: f64,
    pub(crate) exit_v: f64,
    /// Whether it is straight.
    pub(crate) is_line: bool,
    /// Number of the part behind its last one.
    pub(crate) parts_end: usize,
}

/// A path of segments; it retains its memory.
#[derive(Debug)]
pub(crate) struct LawPath<const A: usize> {
    pub(crate) segments: Vec<LawSegment>,
    pub(crate) parts: Vec<LawPart<A>>,
}

impl<const A: usize> Default for LawPath<A> {
    fn default() -> Self {
        Self { segments: Vec::new(), parts: Vec::new() }
    }
}

impl<const A: usize> LawPath<A> {
    /// The segments from number `first` up to before `last`.
    pub(crate) fn window(&self, first: usize, last: usize) -> LawWindow<'_, A> {
        let first_part = if first == 0 { 0 } else { self.segments[first - 1].parts_end };
        LawWindow { segments: &self.segments[first..last], parts: &self.parts, first_part }
    }
}

/// Consecutive segments of a path.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LawWindow<'a, const A: usize> {
    pub(crate) segments: &'a [LawSegment],
    parts: &'a [LawPart<A>],
    /// Number of the first part of the first segment.
    first_part: usize,
}

impl<const A: usize> LawWindow<'_, A> {
    /// Parts of segment `i` of the window.
    pub(crate) fn parts_of(&self, i: usize) -> &[LawPart<A>] {
        let first = if i == 0 { self.first_part } else { self.segments[i - 1].parts_end };
        &self.parts[first..self.segments[i].parts_end]
    }
}
