//! Tool path for a drawing: strokes of points in mm, each of one kind.
//!
//! Invariant: points that are not finite are skipped, whatever their source.

/// Kind of motion along a stroke.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StrokeKind {
    /// Positioning (G0).
    Rapid,
    /// Machining (G1, G2, G3).
    Feed,
    /// Executed motion of any kind.
    Executed,
    /// Motion that was run backward or repeated forward; it lies under the stroke that it repeats.
    Retraced,
}

/// Sequence of points, X Y Z in mm.
#[derive(Clone, Debug, PartialEq)]
pub struct Stroke {
    /// Kind of motion.
    pub kind: StrokeKind,
    /// Points, X Y Z in mm.
    pub points: Vec<[f64; 3]>,
}

/// Tool path with its name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ToolPath {
    /// Title: the program's name.
    pub title: String,
    /// Strokes, in the order of execution.
    pub strokes: Vec<Stroke>,
}

/// Minimum and maximum on each axis, in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Extents {
    pub(crate) low: [f64; 3],
    pub(crate) high: [f64; 3],
}

impl Extents {
    /// Extents of these points; `None` without points.
    fn of<'a>(points: impl Iterator<Item = &'a [f64; 3]>) -> Option<Self> {
        let mut extents: Option<Self> = None;
        for point in points.filter(|point| is_finite(point)) {
            let known = extents.get_or_insert(Self { low: *point, high: *point });
            for (axis, value) in point.iter().enumerate() {
                known.low[axis] = known.low[axis].min(*value);
                known.high[axis] = known.high[axis].max(*value);
            }
        }
        extents
    }
}

impl ToolPath {
    /// Strokes of one kind.
    pub(crate) fn of_kind(&self, kind: StrokeKind) -> impl Iterator<Item = &Stroke> {
        self.strokes.iter().filter(move |stroke| stroke.kind == kind)
    }

    /// Extents of everything.
    pub(crate) fn extents(&self) -> Option<Extents> {
        Extents::of(self.strokes.iter().flat_map(|stroke| &stroke.points))
    }

    /// Extents of the program itself, without retraced motion, which is the machine's path with its blends.
    pub(crate) fn program_extents(&self) -> Option<Extents> {
        let own = self.strokes.iter().filter(|stroke| stroke.kind != StrokeKind::Retraced);
        Extents::of(own.flat_map(|stroke| &stroke.points))
    }

    /// Extents of the machining strokes.
    pub(crate) fn feed_extents(&self) -> Option<Extents> {
        Extents::of(self.of_kind(StrokeKind::Feed).flat_map(|stroke| &stroke.points))
    }

    /// Length of all strokes of one kind, in mm.
    pub(crate) fn length_mm(&self, kind: StrokeKind) -> f64 {
        self.of_kind(kind)
            .flat_map(|stroke| stroke.points.windows(2))
            .map(|pair| pair[0].iter().zip(pair[1]).map(|(from, to)| (to - from).powi(2)).sum::<f64>().sqrt())
            .filter(|length| length.is_finite())
            .sum()
    }

    /// Start and end of the program's own motion.
    pub(crate) fn ends(&self) -> Option<[[f64; 3]; 2]> {
        let own = || {
            self.strokes
                .iter()
                .filter(|stroke| stroke.kind != StrokeKind::Retraced)
                .flat_map(|stroke| &stroke.points)
                .filter(|point| is_finite(point))
        };
        Some([*own().next()?, *own().next_back()?])
    }
}

/// Whether this point can be drawn.
pub(crate) fn is_finite(point: &[f64; 3]) -> bool {
    point.iter().all(|value| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extents_lengths_and_ends_pass_over_what_is_not_finite() {
        let stroke = |kind, points: &[[f64; 3]]| Stroke { kind, points: points.to_vec() };
        let path = ToolPath {
            title: String::new(),
            strokes: vec![
                stroke(StrokeKind::Retraced, &[[-9.0, 0.0, 0.0], [0.0, 0.0, 0.0]]),
                stroke(StrokeKind::Rapid, &[[f64::NAN, 0.0, 0.0], [1.0, 2.0, 3.0], [1.0, 2.0, 5.0]]),
                stroke(StrokeKind::Feed, &[[1.0, 2.0, 5.0], [4.0, 6.0, 5.0], [0.0, f64::INFINITY, 0.0]]),
            ],
        };
        assert_eq!(path.extents(), Some(Extents { low: [-9.0, 0.0, 0.0], high: [4.0, 6.0, 5.0] }));
        assert_eq!(path.program_extents(), Some(Extents { low: [1.0, 2.0, 3.0], high: [4.0, 6.0, 5.0] }));
        assert_eq!(path.feed_extents(), Some(Extents { low: [1.0, 2.0, 5.0], high: [4.0, 6.0, 5.0] }));
        assert!((path.length_mm(StrokeKind::Rapid) - 2.0).abs() < 1e-12);
        assert!((path.length_mm(StrokeKind::Feed) - 5.0).abs() < 1e-12);
        assert_eq!(path.ends(), Some([[1.0, 2.0, 3.0], [4.0, 6.0, 5.0]]));
    }
}
