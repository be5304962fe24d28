//! The edge of a sheet: two points on it give the origin and the direction of the work coordinates (CUT-58).
//!
//! Invariant: the first point becomes the origin. The direction from it to the second point becomes that of X or of Y,
//! whichever is within 45°.

use retrace_config::NumberedError;
use retrace_gcode::{ActiveCodes, Axis, Pose};

/// The points must be at least so far apart, mm: nearer ones would turn a large sheet by what a hand errs.
const SHORTEST_MM: f64 = 50.0;
/// Largest angle between the edge and its axis, degrees.
const STEEPEST_DEG: f64 = 45.0;

/// An edge of the sheet, in mm of the machine's X and Y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SheetEdge {
    first_mm: [f64; 2],
    /// Distance of the points, mm.
    pub length_mm: f64,
    /// Angle by which the sheet is turned, degrees, counter-clockwise.
    pub angle_deg: f64,
    /// Whether the edge is the one along Y.
    pub is_along_y: bool,
}

impl SheetEdge {
    /// The edge through two points.
    ///
    /// # Errors
    /// `E2163` where they are too near to each other, or the direction is that of no axis.
    pub fn through(first_mm: [f64; 2], second_mm: [f64; 2]) -> Result<Self, NumberedError> {
        let [x, y] = [second_mm[0] - first_mm[0], second_mm[1] - first_mm[1]];
        let (length_mm, direction_deg) = (x.hypot(y), y.atan2(x).to_degrees());
        // Also where it is no number.
        if length_mm.is_nan() || length_mm < SHORTEST_MM {
            let cause = format!("the points of the edge are {length_mm:.1} mm apart");
            return Err(NumberedError::new(
                "E2163",
                cause,
                format!("at least {SHORTEST_MM:.0} mm, the more the better"),
            ));
        }
        let edge = |angle_deg, is_along_y| Self { first_mm, length_mm, angle_deg, is_along_y };
        match (direction_deg, direction_deg - 90.0) {
            (angle, _) if angle.abs() <= STEEPEST_DEG => Ok(edge(angle, false)),
            (_, angle) if angle.abs() < STEEPEST_DEG => Ok(edge(angle, true)),
            _ => {
                let cause = format!("from the first point to the second one the edge goes to {direction_deg:.1}°");
                let remedy = "first the point at the zero of the job, then the one along its X or its Y from there";
                Err(NumberedError::new("E2163", cause, remedy))
            }
        }
    }

    /// The block that sets origin and direction of the coordinate system in force: with the offsets of G92 and of the
    /// tool that are in force as well, the first point is its zero.
    #[must_use]
    pub fn block(&self, active: &ActiveCodes) -> String {
        let (sin, cos) = self.angle_deg.to_radians().sin_cos();
        let unit_mm = active.units.millimetres();
        let of = |offset: &Pose| [offset[Axis::X], offset[Axis::Y]];
        let ([x, y], [tool_x, tool_y]) = (of(&active.g92_offset), of(&active.tool_offset));
        let turned = [x * cos - y * sin + tool_x, x * sin + y * cos + tool_y];
        let [x, y] = [0, 1].map(|axis| self.first_mm[axis] / unit_mm - turned[axis]);
        format!("G10 L2 P0 X{x:.9} Y{y:.9} R{:.12}", self.angle_deg)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block_decoder::{BlockDecoder, DecodedBlock};
    use crate::mdi::{ModalContext, interpreter_setup};
    use proptest::prelude::*;
    use retrace_config::MachineConfig;

    #[test]
    fn points_that_are_near_or_go_along_no_axis_are_refused() {
        for (second, angle, is_along_y) in
            [([50.0, 0.0], 0.0, false), ([100.0, -100.0], -45.0, false), ([0.0, 80.0], 0.0, true)]
        {
            let edge = SheetEdge::through([10.0, 5.0], [10.0 + second[0], 5.0 + second[1]]).expect("an edge");
            assert!((edge.angle_deg - angle).abs() < 1e-12 && edge.is_along_y == is_along_y, "{edge:?}");
        }
        for second in [[49.9, 0.0], [-100.0, 3.0], [3.0, -100.0], [-100.0, 100.0], [f64::NAN, 0.0]] {
            let refused = SheetEdge::through([0.0; 2], second).expect_err("no edge");
            assert_eq!(refused.number, "E2163", "{second:?}");
        }
    }

    proptest! {
        /// A program that goes to the zero and along its axis comes to the first point, and through the second one.
        #[test]
        fn the_job_lies_on_the_edge(
            first in [-200.0..200.0f64, -200.0..200.0f64], length in 50.0..900.0f64, degrees in -44.9..44.9f64,
            is_along_y in any::<bool>(), g92 in [-50.0..50.0f64, -50.0..50.0f64], is_inch in any::<bool>(),
        ) {
            let direction = (degrees + if is_along_y { 90.0 } else { 0.0 }).to_radians();
            let second = [first[0] + length * direction.cos(), first[1] + length * direction.sin()];
            let edge = SheetEdge::through(first, second).expect("an edge");
            prop_assert!((edge.angle_deg - degrees).to_radians().abs() < 1e-9 && edge.is_along_y == is_along_y);
            let machine = MachineConfig::built_in().expect("built in");
            let mut context = ModalContext::new(interpreter_setup(&machine));
            let mut executed = |block: &str| {
                let mut block = context.block(&machine, block).expect("a block");
                let mut steps = Vec::new();
                while block.next_block(&mut steps) == DecodedBlock::Block {}
                context.finish_block(&block);
                context.active()
            };
            let unit = if is_inch { "G20" } else { "G21" };
            let active = executed(&format!("{unit} G92 X{:.3} Y{:.3}", g92[0] / 9.0, g92[1] / 9.0));
            let active = executed(&edge.block(&active));
            // Where the zero is, with the offset of G92, which is one in the turned coordinates.
            let unit_mm = active.units.millimetres();
            let (sin, cos) = active.rotation_degrees.to_radians().sin_cos();
            let [gx, gy] = [active.g92_offset[Axis::X], active.g92_offset[Axis::Y]];
            let x = (active.origin[Axis::X] + gx * cos - gy * sin) * unit_mm;
            let y = (active.origin[Axis::Y] + gx * sin + gy * cos) * unit_mm;
            let turned = active.rotation_degrees;
            prop_assert!((x - first[0]).abs() < 1e-6 && (y - first[1]).abs() < 1e-6, "{x} {y} for {first:?}");
            prop_assert!((turned - degrees).to_radians().abs() < 1e-9);
            // The second point is on that axis.
            let off = if is_along_y {
                (second[0] - x) * cos + (second[1] - y) * sin
            } else {
                (second[1] - y) * cos - (second[0] - x) * sin
            };
            prop_assert!(off.abs() < 1e-5, "{off}");
        }
    }
}
