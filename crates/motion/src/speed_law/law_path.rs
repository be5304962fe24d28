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
    /// Parts of segment `i`.
    pub(crate) fn parts_of(&self, i: usize) -> &[LawPart<A>] {
        let first = if i == 0 { 0 } else { self.segments[i - 1].parts_end };
        &self.parts[first..self.segments[i].parts_end]
    }
}
