//! View of a tool path.

use crate::tool_path::{Extents, ToolPath};

/// View of a tool path; lengths are true along every visible axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// From above: X to the right, Y upward.
    Xy,
    /// From the front: X to the right, Z upward.
    Xz,
    /// From the right: Y to the right, Z upward.
    Yz,
    /// Isometric, from the front right and above.
    Iso,
}

/// Maximum extent that counts as flat, in mm.
const FLAT_MM: f64 = 1e-6;
const COS_30: f64 = 0.866_025_403_784_438_6;

impl View {
    /// View from above, unless the program is flat in another plane.
    #[must_use]
    pub fn fitting(path: &ToolPath) -> Self {
        let Some(Extents { low, high }) = path.feed_extents().or_else(|| path.extents()) else { return Self::Xy };
        let is_flat = |axis: usize| high[axis] - low[axis] < FLAT_MM;
        match [is_flat(0), is_flat(1), is_flat(2)] {
            [false, true, false] | [true, true, false] => Self::Xz,
            [true, false, false] => Self::Yz,
            _ => Self::Xy,
        }
    }

    /// Position of a point on the drawing in mm: to the right, and upward.
    pub(crate) fn project(self, [x, y, z]: [f64; 3]) -> [f64; 2] {
        match self {
            Self::Xy => [x, y],
            Self::Xz => [x, z],
            Self::Yz => [y, z],
            Self::Iso => [(x + y) * COS_30, z + (y - x) / 2.0],
        }
    }

    /// Names of the axes to the right and upward, where the view has such axes.
    pub(crate) fn axes(self) -> Option<[&'static str; 2]> {
        match self {
            Self::Xy => Some(["X", "Y"]),
            Self::Xz => Some(["X", "Z"]),
            Self::Yz => Some(["Y", "Z"]),
            Self::Iso => None,
        }
    }

    /// Name of the view.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Xy => "plan XY",
            Self::Xz => "front XZ",
            Self::Yz => "side YZ",
            Self::Iso => "isometric",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tool_path::{Stroke, StrokeKind};

    #[test]
    fn the_view_is_the_plane_that_the_program_lies_in() {
        let of = |points: [[f64; 3]; 3]| {
            let approach = Stroke { kind: StrokeKind::Rapid, points: vec![[-9.0, -9.0, 9.0], points[0]] };
            let feed = Stroke { kind: StrokeKind::Feed, points: points.to_vec() };
            View::fitting(&ToolPath { title: String::new(), strokes: vec![approach, feed] })
        };
        assert_eq!(of([[0.0, 0.0, 1.0], [5.0, 0.0, 1.0], [5.0, 5.0, 1.0]]), View::Xy);
        assert_eq!(of([[0.0, 2.0, 1.0], [5.0, 2.0, 1.0], [5.0, 2.0, 8.0]]), View::Xz);
        assert_eq!(of([[3.0, 0.0, 1.0], [3.0, 4.0, 1.0], [3.0, 4.0, 8.0]]), View::Yz);
        assert_eq!(of([[0.0, 0.0, 1.0], [5.0, 0.0, 2.0], [5.0, 5.0, 3.0]]), View::Xy);
        assert_eq!(View::fitting(&ToolPath { title: String::new(), strokes: Vec::new() }), View::Xy);
    }

    #[test]
    fn isometric_axes_are_of_true_length_and_z_points_up() {
        for unit in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
            let [right, up] = View::Iso.project(unit);
            assert!((right.hypot(up) - 1.0).abs() < 1e-12);
        }
        assert_eq!(View::Iso.project([0.0, 0.0, 1.0]), [0.0, 1.0]);
    }
}
