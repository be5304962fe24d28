//! Roughing: levels over a profile, each cut from where the path descends through it to where it ascends again.
//!
//! Invariant: the tool is always on the path or above it.

use super::frame::{Point, Segment, TINY};
use super::{Pockets, TurningMove, TurningTool};

/// Maximum number of levels of one profile; more indicates a mistake in the infeed.
pub(super) const MAX_LEVELS: f64 = 10_000.0;

/// Roughs a path from `start` in levels `infeed` apart, with a retreat after each.
pub(super) fn rough<O: FnMut(TurningMove)>(
    path: Vec<Segment>,
    start: Point,
    (pockets, infeed, retreat): (Pockets, f64, f64),
    tool: TurningTool<'_, O>,
) {
    let Some(first) = path.first().map(|segment| segment.from) else { return };
    let entry = Segment::line(start, first);
    let mut segments = vec![entry];
    for segment in path {
        split_at_extremes(segment, &mut segments);
    }
    let last = segments.last().map_or(start, |segment| segment.to);
    if last.h < start.h {
        segments.push(Segment::line(last, Point { a: last.a, h: start.h }));
    }
    let mut rougher = Rougher { segments: &segments, level: start.h, infeed, retreat, tool };
    rougher.tool.rapid(start);
    if pockets != Pockets::Only {
        rougher.go_down(0, true);
    }
    rougher.tool.rapid(first);
    match pockets {
        Pockets::Skipped => {
            let next = rougher.first_slope(true);
            rougher.climb_over(next);
        }
        Pockets::Included => rougher.follow(1, false),
        Pockets::Only => {
            let next = rougher.first_slope(false);
            rougher.level = rougher.tool.at.h;
            rougher.follow(next, true);
        }
    }
}

struct Rougher<'s, 'a, O> {
    segments: &'s [Segment],
    /// Next level to be cut.
    level: f64,
    infeed: f64,
    retreat: f64,
    tool: TurningTool<'a, O>,
}

impl<O: FnMut(TurningMove)> Rougher<'_, '_, O> {
    /// Cuts all levels that a segment descends through.
    fn go_down(&mut self, index: usize, is_entry: bool) {
        let segment = self.segments[index];
        while self.level > segment.to.h {
            let at = segment.at_height(self.level);
            if is_entry {
                self.tool.rapid(at);
            } else {
                self.tool.along(&segment, at);
            }
            self.cut(index, at, is_entry);
            self.level -= self.infeed;
        }
    }

    /// Cuts one level from a point of a segment, and returns to it.
    fn cut(&mut self, index: usize, at: Point, is_entry: bool) {
        let level = self.level;
        let Some(up) = self.segments[index + 1..].iter().find(|segment| segment.to.h >= level - TINY) else { return };
        let end = up.at_height(level.min(up.to.h));
        self.tool.feed(Point { h: level, ..end });
        let off = self.retreat.min((end.a - at.a).abs() / 2.0);
        self.tool.rapid(Point { a: end.a - off, h: level + off });
        self.tool.rapid(Point { a: at.a + off, h: level + off });
        if is_entry {
            self.tool.rapid(at);
        } else {
            self.tool.feed(at);
        }
    }

    /// Cuts along the part that descends right after the entry, with its levels or without. Returns the next segment.
    fn first_slope(&mut self, with_levels: bool) -> usize {
        let mut index = 1;
        while let Some(segment) = self.segments.get(index).copied()
            && segment.to.h < segment.from.h
        {
            if with_levels {
                self.go_down(index, false);
            }
            self.end_of(&segment);
            index += 1;
        }
        index
    }

    /// Cuts along the path from a segment, with the levels of each pocket. They keep the grid of the previous levels;
    /// with `from_brim`, a brim above all previous ones begins a new grid.
    fn follow(&mut self, from: usize, from_brim: bool) {
        let mut highest = self.tool.at.h;
        for index in from..self.segments.len() {
            let segment = self.segments[index];
            if segment.to.h < segment.from.h {
                while self.level + self.infeed <= segment.from.h + TINY {
                    self.level += self.infeed;
                }
                self.go_down(index, false);
            } else if from_brim && segment.to.h > highest {
                (self.level, highest) = (segment.to.h, segment.to.h);
            }
            self.end_of(&segment);
        }
    }

    fn end_of(&mut self, segment: &Segment) {
        if !segment.continues {
            self.tool.along(segment, segment.to);
        }
    }

    /// Cuts along the path where it rises above everything before, and straight over the pockets.
    fn climb_over(&mut self, from: usize) {
        for index in from..self.segments.len() {
            let segment = self.segments[index];
            if segment.to.h >= self.tool.at.h {
                let height = self.tool.at.h.max(segment.from.h);
                self.tool.feed(segment.at_height(height));
                self.tool.along(&segment, segment.to);
            } else if segment.begins_at_top()
                && self.segments[index - 1].arc != segment.arc
                && segment.from.h >= self.tool.at.h - TINY
            {
                // An arc that descends from its top has a rise of zero length, to which LinuxCNC moves.
                self.tool.feed(segment.from);
            }
        }
    }
}

/// Appends a segment; an arc with an inner highest or lowest point is split there.
fn split_at_extremes(segment: Segment, segments: &mut Vec<Segment>) {
    let Some(arc) = segment.arc else {
        segments.push(segment);
        return;
    };
    let radius = segment.from.distance(arc.centre);
    for (offset, goes_on) in [(radius, false), (-radius, true)] {
        let extreme = Point { a: arc.centre.a, h: arc.centre.h + offset };
        let inside = segment.sweep(extreme) < segment.sweep(segment.to) - 1e-9;
        if inside && segment.from.distance(extreme) > 1e-7 && segment.to.distance(extreme) > 1e-7 {
            segments.push(Segment { to: extreme, continues: goes_on, ..segment });
            segments.push(Segment { from: extreme, ..segment });
            return;
        }
    }
    segments.push(segment);
}
