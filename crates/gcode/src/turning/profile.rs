//! A profile: the first point, and the lines and arcs after it.
//!
//! Invariant: each element begins where the previous one ends.

use super::RoughingError;
use super::frame::{Frame, Segment, SegmentArc, XzPoint};
use crate::canon::{Canon, CanonStep};
use crate::canon_modes::Plane;
use crate::pose::{Axis, Pose};

/// A line or an arc of a profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Element {
    Line {
        end: XzPoint,
    },
    /// Counter-clockwise as G3 in G18.
    Arc {
        end: XzPoint,
        centre: XzPoint,
        counterclockwise: bool,
    },
}

impl Element {
    pub(super) fn end(&self) -> XzPoint {
        match *self {
            Element::Line { end } | Element::Arc { end, .. } => end,
        }
    }
}

/// A profile as drawn by the program.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Profile {
    /// End of its first move.
    pub(crate) first: XzPoint,
    pub(crate) elements: Vec<Element>,
    /// Line of each element.
    lines: Vec<u32>,
}

impl Profile {
    /// Creates the profile that the canonical functions of a subprogram draw: the end of its first move, and the lines
    /// and arcs of the moves after it. Functions that do not move are skipped.
    pub(crate) fn of_steps(steps: &[CanonStep]) -> Profile {
        let mut profile = Profile::default();
        let mut is_begun = false;
        for step in steps {
            let element = match &step.canon {
                Canon::StraightTraverse(end) | Canon::StraightFeed(end) => Element::Line { end: place(end) },
                Canon::ArcFeed(arc) if arc.plane == Plane::Zx => Element::Arc {
                    end: place(&arc.end),
                    centre: XzPoint { x: arc.second_centre, z: arc.first_centre },
                    counterclockwise: arc.turns > 0,
                },
                _ => continue,
            };
            if is_begun {
                profile.elements.push(element);
                profile.lines.push(step.line);
            } else {
                profile.first = element.end();
                is_begun = true;
            }
        }
        profile
    }

    /// Returns the program line of an element.
    pub(crate) fn line_of(&self, element: usize) -> Option<u32> {
        self.lines.get(element).copied()
    }

    /// Returns the segments in the frame; a line without length is left out.
    pub(super) fn segments(&self, frame: &Frame) -> Vec<Segment> {
        let mut from = frame.point(self.first);
        let mut segments = Vec::with_capacity(self.elements.len());
        for (index, element) in self.elements.iter().enumerate() {
            let to = frame.point(element.end());
            let arc = match *element {
                Element::Line { .. } => None,
                Element::Arc { centre, counterclockwise, .. } => Some(SegmentArc {
                    centre: frame.point(centre),
                    counterclockwise: counterclockwise != frame.mirrors(),
                }),
            };
            if arc.is_some() || from != to {
                segments.push(Segment { from, to, arc, continues: false, element: index });
            }
            from = to;
        }
        segments
    }
}

fn place(pose: &Pose) -> XzPoint {
    XzPoint { x: pose[Axis::X], z: pose[Axis::Z] }
}

impl Frame {
    /// Creates the frame of a profile that is turned from `start`.
    pub(super) fn new(profile: &Profile, start: XzPoint, facing: bool) -> Result<Frame, RoughingError> {
        let Some(last) = profile.elements.last() else { return Err(RoughingError::Empty) };
        let plain = Frame { facing, along: 1.0, above: 1.0 };
        let (start, first, last) = (plain.point(start), plain.point(profile.first), plain.point(last.end()));
        let along = if last.a < first.a { -1.0 } else { 1.0 };
        let above = if start.h < first.h { -1.0 } else { 1.0 };
        Ok(Frame { facing, along, above })
    }
}
