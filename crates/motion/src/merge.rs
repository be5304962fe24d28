//! Merging: nearly collinear lines that follow one another become one line (G64 Q), before anything is blended.
//!
//! A line that was cut into parts then costs no more than one line, and the rounding of coordinates to whole
//! micrometres is removed from a dense chain before it can slow the chain down. The program lines of the parts are
//! stored with the merged one.
//!
//! Lines are merged while their chord stays in the cone of all directions from its start that pass every end between
//! near enough. The cone is represented by one ball of directions inside the intersection of the balls of all ends, so
//! a further line costs the same however many there are; in a plane the ball is the whole intersection.
//!
//! Invariant: a merged line is nowhere further from the programmed lines than its tolerance is less than theirs, and
//! that is at most what [`merging`] allows of it; so merging and blending together stay within the tolerance. It
//! depends on the lines alone, in their order.

use crate::blend::{PathSegment, size};
use crate::curve::Curve;
use crate::line_mark::LineMark;

/// Share of the tolerance that merging uses where the program gives none: the rest makes corners fast.
const SHARE: f64 = 0.05;
/// Largest share of the tolerance that merging may use: with nothing left, the corners between merged lines would be
/// stops.
const MAX_SHARE: f64 = 0.5;
/// Largest number of lines that are merged: a bound on the memory.
const MAX_LINES: usize = 4096;

/// A line that may be merged.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LinearMove<const A: usize> {
    pub(crate) start: [f64; A],
    pub(crate) end: [f64; A],
    /// Feed, mm/s.
    pub(crate) feed: f64,
    pub(crate) tag: u32,
    /// Largest distance of the path from the line, mm; above 0.
    pub(crate) tolerance: f64,
    /// Largest distance from the line that it is merged into, mm: a part of the tolerance.
    pub(crate) merging: f64,
}

/// Part of `tolerance` that merging may use, mm, where the program requests `asked`.
pub(crate) fn merging(tolerance: f64, requested: Option<f64>) -> f64 {
    requested.map_or(SHARE * tolerance, |asked| asked.min(MAX_SHARE * tolerance))
}

/// A place on a chain of lines, with the program line that begins there.
#[derive(Clone, Copy, Debug)]
struct LineBegin<const A: usize> {
    at: [f64; A],
    tag: u32,
    /// Whether it is a mark on a line, which has no effect on the path.
    is_mark: bool,
}

/// Lines that are merged so far.
#[derive(Debug)]
pub(crate) struct Merger<const A: usize> {
    /// All lines from the start of the first to the end of the last.
    chord: Option<LinearMove<A>>,
    /// Start of each line but the first, and the marks on the lines, in their order.
    begins: Vec<LineBegin<A>>,
    /// Number of lines.
    lines: usize,
    /// Directions that a chord may have: those within `radius` of this one.
    axis: [f64; A],
    radius: f64,
}

impl<const A: usize> Merger<A> {
    pub(crate) fn new() -> Self {
        Self { chord: None, begins: Vec::new(), lines: 0, axis: [0.0; A], radius: 0.0 }
    }

    /// Whether there is no line to take out.
    pub(crate) fn is_empty(&self) -> bool {
        self.chord.is_none()
    }

    /// Merges `line` with those before it; false where it cannot be merged, and these are to be taken out first.
    pub(crate) fn try_merge(&mut self, line: &LinearMove<A>) -> bool {
        let Some(chord) = &mut self.chord else {
            self.chord = Some(*line);
            self.begins.clear();
            self.lines = 1;
            (self.axis, self.radius) = ([0.0; A], f64::MAX);
            return true;
        };
        let alike = (line.feed, line.tolerance, line.merging) == (chord.feed, chord.tolerance, chord.merging)
            && line.merging > 0.0;
        if !alike || self.lines > MAX_LINES {
            return false;
        }
        let (to, on) = (difference(&line.start, &chord.start), difference(&line.end, &line.start));
        let whole = difference(&line.end, &chord.start);
        let (far, step, length) = (size(&to), size(&on), size(&whole));
        let (before, direction) = (to.map(|x| x / far), whole.map(|x| x / length));
        // No reversal along the chord; the rotary axes retain their share of the motion.
        let ahead: f64 = on.iter().zip(&direction).map(|(a, b)| a * b).sum();
        let forward = ahead > 0.5 * step;
        if !forward || (linear_share(&on, step) - linear_share(&to, far)).abs() > 0.01 {
            return false;
        }
        let (axis, radius) = ball_within((self.axis, self.radius), (before, chord.merging / far));
        let near = size(&difference(&direction, &axis)) <= radius;
        if !near {
            return false;
        }
        (self.axis, self.radius) = (axis, radius);
        chord.end = line.end;
        self.begins.push(LineBegin { at: line.start, tag: line.tag, is_mark: false });
        self.lines += 1;
        true
    }

    /// Marks the last line: from `at` on, a place on it behind its other marks, its program line is `tag`.
    pub(crate) fn mark(&mut self, at: [f64; A], tag: u32) {
        self.begins.push(LineBegin { at, tag, is_mark: true });
    }

    /// Takes the line out, as a segment. The program lines after its first are appended to `marks`.
    pub(crate) fn take_merged(&mut self, marks: &mut Vec<LineMark>) -> Option<PathSegment<A>> {
        let chord = self.chord.take()?;
        let (curve, length) = Curve::line(chord.start, chord.end);
        let displacement = difference(&chord.end, &chord.start);
        let squared: f64 = displacement.iter().map(|x| x * x).sum();
        let (mut off, mut place) = (0.0f64, 0.0f64);
        for LineBegin { at, tag, is_mark } in &self.begins {
            let to = difference(at, &chord.start);
            let share = to.iter().zip(&displacement).map(|(a, b)| a * b).sum::<f64>() / squared;
            let aside: [f64; A] = std::array::from_fn(|i| to[i] - share * displacement[i]);
            if !is_mark {
                off = off.max(aside.iter().map(|x| x * x).sum());
            }
            place = place.max(share * length);
            marks.push(LineMark { place, tag: *tag });
        }
        let tolerance = chord.tolerance - off.sqrt();
        let marks = self.begins.len() as u32;
        Some(PathSegment { curve, length, feed: chord.feed, tag: chord.tag, tolerance, marks })
    }
}

/// Largest ball within two balls, each a centre and a radius; negative where they are apart.
fn ball_within<const A: usize>(a: ([f64; A], f64), b: ([f64; A], f64)) -> ([f64; A], f64) {
    let ((a_centre, a_radius), (b_centre, b_radius)) = (a, b);
    let displacement = difference(&b_centre, &a_centre);
    let apart = size(&displacement);
    if apart + b_radius <= a_radius {
        return b;
    }
    if apart + a_radius <= b_radius {
        return a;
    }
    // On the line from a's centre to b's, their lens extends from the near side of b to the far side of a.
    let middle = 0.5 * (apart - b_radius + a_radius) / apart;
    (std::array::from_fn(|i| a_centre[i] + middle * displacement[i]), 0.5 * (a_radius + b_radius - apart))
}

fn difference<const A: usize>(to: &[f64; A], from: &[f64; A]) -> [f64; A] {
    std::array::from_fn(|i| to[i] - from[i])
}

/// Share of the linear axes in a distance of this size.
fn linear_share(displacement: &[f64], all: f64) -> f64 {
    if displacement.len() <= 3 { 1.0 } else { size(&displacement[..3]) / all }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn line(start: [f64; 3], end: [f64; 3], tag: u32) -> LinearMove<3> {
        LinearMove { start, end, feed: 10.0, tag, tolerance: 0.05, merging: merging(0.05, None) }
    }

    /// Distance of `p` from the infinite line through `a` and `b`.
    fn distance(p: [f64; 3], a: [f64; 3], b: [f64; 3]) -> f64 {
        let (to, displacement) = (difference(&p, &a), difference(&b, &a));
        let squared: f64 = displacement.iter().map(|x| x * x).sum();
        let share = to.iter().zip(&displacement).map(|(a, b)| a * b).sum::<f64>() / squared;
        size(&std::array::from_fn::<f64, 3, _>(|i| to[i] - share * displacement[i]))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(1000))]

        /// Any chain: every end is on its merged line, within the distance that the line's tolerance gives, in order
        /// and under its tag.
        #[test]
        fn merged_lines_are_near_the_programmed_ones(
            steps in prop::collection::vec((-3.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64), 1..200), bend in -5.0..0.5f64,
            asked in prop::option::of(0.0..0.1f64),
        ) {
            let most = merging(0.05, asked);
            prop_assert!(most <= 0.025);
            let (mut merger, mut at, mut points, mut merged) = (Merger::new(), [0.0; 3], vec![[0.0; 3]], Vec::new());
            let mut take = |merger: &mut Merger<3>| {
                let mut marks = Vec::new();
                if let Some(segment) = merger.take_merged(&mut marks) {
                    assert_eq!(segment.marks as usize, marks.len());
                    merged.push((segment, marks));
                }
            };
            for (k, (length, y, z)) in steps.into_iter().enumerate() {
                let (length, bend) = (10f64.powf(length), 10f64.powf(bend));
                let next = [at[0] + length, at[1] + length * bend * y, at[2] + length * bend * z];
                let line = LinearMove { merging: most, ..line(at, next, k as u32) };
                if !merger.try_merge(&line) {
                    take(&mut merger);
                    assert!(merger.try_merge(&line));
                }
                at = next;
                points.push(at);
            }
            take(&mut merger);
            let mut first = 0;
            for (segment, marks) in &merged {
                let (start, end) = (segment.curve.at(0.0), segment.curve.at(segment.length));
                prop_assert_eq!(segment.tag as usize, first);
                prop_assert!(size(&difference(&start, &points[first])) < 1e-12);
                let mut before = 0.0;
                for (mark, k) in marks.iter().zip(first + 1..) {
                    let off = distance(points[k], start, end);
                    prop_assert!(off <= 0.05 - segment.tolerance + 1e-12 && off <= most, "{} mm", off);
                    prop_assert!(size(&difference(&segment.curve.at(mark.place), &points[k])) <= 2.0 * most);
                    prop_assert!(mark.tag as usize == k && mark.place >= before && mark.place <= segment.length);
                    before = mark.place;
                }
                first += marks.len() + 1;
            }
            prop_assert_eq!(first, points.len() - 1);
        }
    }

    #[test]
    fn a_line_in_many_parts_is_one_and_a_circle_has_as_few_chords_as_the_share_allows() {
        let (mut merger, mut chords) = (Merger::new(), 0);
        let mut run = |points: &mut dyn Iterator<Item = [f64; 3]>| {
            let (mut at, mut marks) = ([0.0; 3], Vec::new());
            chords = 1;
            for point in points {
                if !merger.try_merge(&line(at, point, 1)) {
                    merger.take_merged(&mut marks);
                    chords += 1;
                    merger.try_merge(&line(at, point, 1));
                }
                at = point;
            }
            merger.take_merged(&mut marks);
            chords
        };
        assert_eq!(run(&mut (1..=1000).map(|k| [0.003 * f64::from(k), 0.004 * f64::from(k), 0.0])), 1);
        // A chord of 0.775 mm is 0.0025 mm off a circle of 30 mm.
        let on = |k: i32| (f64::from(k) * 0.001).sin_cos();
        let chords = run(&mut (1..=1000).map(|k| [30.0 * on(k).0, 30.0 * (1.0 - on(k).1), 0.0]));
        assert!((39..=40).contains(&chords), "{chords}");
    }

    /// Chords around a circle: the more may be merged, the fewer they are, down to none merged at Q 0.
    #[test]
    fn a_larger_merging_tolerance_leaves_fewer_lines() {
        let on = |k: u32| (f64::from(k) * 0.001).sin_cos();
        let lines = |asked: f64| {
            let (mut merger, mut at, mut count) = (Merger::new(), [0.0; 3], 1);
            for k in 1..=1000 {
                let next = LinearMove {
                    merging: merging(0.05, Some(asked)),
                    ..line(at, [30.0 * on(k).0, 30.0 * (1.0 - on(k).1), 0.0], k)
                };
                if !merger.try_merge(&next) {
                    merger.take_merged(&mut Vec::new());
                    count += 1;
                    assert!(merger.try_merge(&next));
                }
                at = next.end;
            }
            count
        };
        let counts = [0.0, 0.001, 0.0025, 0.01, 0.025, 0.05].map(lines);
        // A chord of a circle of 30 mm is √(240·q) long; half of the tolerance is the most.
        assert_eq!(counts[0], 1000);
        assert!(
            counts.windows(2).all(|pair| pair[1] <= pair[0]) && counts[4] == counts[5] && counts[4] < 14,
            "{counts:?}"
        );
    }

    #[test]
    fn corners_reversals_and_other_feeds_are_not_merged() {
        let merges = |next: LinearMove<3>| {
            let mut merger = Merger::new();
            merger.try_merge(&line([0.0; 3], [1.0, 0.0, 0.0], 1)) && merger.try_merge(&next)
        };
        let next = line([1.0, 0.0, 0.0], [2.0, 0.0, 0.0], 2);
        assert!(merges(next));
        assert!(!merges(LinearMove { feed: 11.0, ..next }) && !merges(LinearMove { tolerance: 0.04, ..next }));
        assert!(!merges(LinearMove { merging: 0.01, ..next }));
        assert!(!merges(line([1.0, 0.0, 0.0], [1.0, 0.1, 0.0], 2)));
        assert!(!merges(line([1.0, 0.0, 0.0], [0.999, 0.0, 0.0], 2)));
    }
}
