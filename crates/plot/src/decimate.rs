//! Drops points that no pixel can show.
//!
//! Invariant: no point of the full line is farther than 0.3 pixels from the thinned one; ends always stay.

use crate::picture::Point;

/// Maximum distance of a dropped point from the drawn line, and beyond its end, in pixels.
const DEVIATION_PX: f32 = 0.15;

/// Path in pixels without the points that a straight line between two others passes closely enough.
pub(crate) fn path(points: impl IntoIterator<Item = Point>) -> Vec<Point> {
    let mut points = points.into_iter();
    let Some(first) = points.next() else { return Vec::new() };
    let mut kept = vec![first];
    let mut sleeve = Corridor::from(first);
    let mut last = first;
    for point in points {
        if !sleeve.accepts(point) {
            kept.push(last);
            sleeve = Corridor::from(last);
            // Nothing constrains a new corridor, so that it accepts any point.
            sleeve.accepts(point);
        }
        last = point;
    }
    if kept.len() > 1 || last != first {
        kept.push(last);
    }
    kept
}

/// Directions from a retained point in which a straight line passes close to every point dropped since.
struct Corridor {
    from: Point,
    /// Bounds of those directions, as vectors; `None` where none bounds them.
    bounds: Option<[Point; 2]>,
    /// Distance of the farthest point; a point that turns back is not on the line.
    reach: f32,
}

fn cross(a: Point, b: Point) -> f32 {
    a[0] * b[1] - a[1] * b[0]
}

impl Corridor {
    fn from(from: Point) -> Self {
        Self { from, bounds: None, reach: 0.0 }
    }

    /// Whether the line can end in this point. If so, the point is added to those that the line must pass closely.
    fn accepts(&mut self, point: Point) -> bool {
        let along = [point[0] - self.from[0], point[1] - self.from[1]];
        let distance = along[0].hypot(along[1]);
        if distance + DEVIATION_PX < self.reach {
            return false;
        }
        if distance <= DEVIATION_PX {
            return true;
        }
        if self.bounds.is_some_and(|[right, left]| cross(right, along) < 0.0 || cross(left, along) > 0.0) {
            return false;
        }
        self.reach = self.reach.max(distance);
        let sin = DEVIATION_PX / distance;
        let cos = (1.0 - sin * sin).sqrt();
        let turned = |sin: f32| [along[0] * cos - along[1] * sin, along[0] * sin + along[1] * cos];
        let (right, left) = (turned(-sin), turned(sin));
        self.bounds = Some(match self.bounds {
            None => [right, left],
            Some([known_right, known_left]) => [
                if cross(known_right, right) > 0.0 { right } else { known_right },
                if cross(known_left, left) < 0.0 { left } else { known_left },
            ],
        });
        true
    }
}

/// Curve over growing x as it looks in columns of one pixel: the first, lowest, highest and last point of each.
pub(crate) fn curve(points: impl IntoIterator<Item = Point>) -> Vec<Point> {
    let mut kept = Vec::new();
    let mut column: Option<Column> = None;
    for point in points {
        match &mut column {
            Some(open) if open.first[0].floor() == point[0].floor() => open.push(point),
            _ => {
                if let Some(full) = column.replace(Column::of(point)) {
                    full.append_to(&mut kept);
                }
            }
        }
    }
    if let Some(full) = column {
        full.append_to(&mut kept);
    }
    kept
}

struct Column {
    first: Point,
    low: Point,
    high: Point,
    last: Point,
}

impl Column {
    fn of(point: Point) -> Self {
        Self { first: point, low: point, high: point, last: point }
    }

    fn push(&mut self, point: Point) {
        if point[1] < self.low[1] {
            self.low = point;
        }
        if point[1] > self.high[1] {
            self.high = point;
        }
        self.last = point;
    }

    fn append_to(self, kept: &mut Vec<Point>) {
        let (early, late) = if self.low[0] <= self.high[0] { (self.low, self.high) } else { (self.high, self.low) };
        for point in [self.first, early, late, self.last] {
            if kept.last() != Some(&point) {
                kept.push(point);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Distance of a point from a straight line between two others.
    fn distance(point: Point, from: Point, to: Point) -> f32 {
        let along = [to[0] - from[0], to[1] - from[1]];
        let off = [point[0] - from[0], point[1] - from[1]];
        let square = along[0] * along[0] + along[1] * along[1];
        let share = if square > 0.0 { ((off[0] * along[0] + off[1] * along[1]) / square).clamp(0.0, 1.0) } else { 0.0 };
        (off[0] - share * along[0]).hypot(off[1] - share * along[1])
    }

    #[test]
    fn a_straight_line_keeps_its_ends_alone_and_one_that_doubles_back_its_turning_point() {
        let straight = (0..1000).map(|at| [at as f32 * 0.37, at as f32 * 0.11]);
        assert_eq!(path(straight).len(), 2);
        let back = (0..=100).chain((0..100).rev()).map(|at| [at as f32, 0.0]);
        assert_eq!(path(back), [[0.0, 0.0], [100.0, 0.0], [0.0, 0.0]]);
        assert_eq!(path([[1.0, 1.0]]), [[1.0, 1.0]]);
    }

    proptest! {
        #[test]
        fn a_thinned_path_stays_close_and_keeps_its_ends(
            steps in prop::collection::vec((-0.6_f32..0.6, -3.0_f32..3.0, 0.0_f32..3.0), 1..200),
        ) {
            let (mut at, mut heading) = ([0.0_f32; 2], 0.0_f32);
            let walk = steps.iter().map(|&(turn, jump, length)| {
                heading += if length < 0.2 { jump } else { turn };
                at = [at[0] + length * heading.cos(), at[1] + length * heading.sin()];
                at
            });
            let points: Vec<Point> = walk.collect();
            let kept = path(points.iter().copied());
            prop_assert_eq!(kept.first(), points.first());
            prop_assert_eq!(kept.last(), points.last());
            for point in &points {
                let nearest = kept.windows(2).map(|pair| distance(*point, pair[0], pair[1])).fold(f32::MAX, f32::min);
                prop_assert!(kept.len() < 2 || nearest < 2.0 * DEVIATION_PX, "{nearest}");
            }
        }

        #[test]
        fn a_thinned_curve_has_the_same_peaks(values in prop::collection::vec(-100.0_f32..100.0, 1..500)) {
            let points: Vec<Point> = values.iter().enumerate().map(|(at, &y)| [at as f32 * 0.07, y]).collect();
            let kept = curve(points.iter().copied());
            let peak = |line: &[Point]| line.iter().map(|point| point[1]).fold(f32::MIN, f32::max);
            prop_assert_eq!(peak(&kept), peak(&points));
            prop_assert!(kept.len() <= 4 * (points.len() * 7 / 100 + 1));
            prop_assert!(kept.windows(2).all(|pair| pair[0][0] <= pair[1][0]));
        }
    }
}
