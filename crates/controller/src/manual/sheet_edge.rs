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

    /// Where a job whose work zero is at `zero_mm` of the machine, and whose X is turned by `rotation_deg`, will lie.
    #[must_use]
    pub fn placement(&self, zero_mm: [f64; 2], rotation_deg: f64) -> SheetPlacement {
        SheetPlacement { from_mm: zero_mm, to_mm: self.first_mm, turn_deg: self.angle_deg - rotation_deg }
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

/// How an edge of the sheet would move a job: turned around its work zero, which moves to another place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SheetPlacement {
    /// Where the work zero is now, mm of the machine.
    pub from_mm: [f64; 2],
    /// Where it will be, mm of the machine.
    pub to_mm: [f64; 2],
    /// Angle by which the job will be turned further, degrees, counter-clockwise.
    pub turn_deg: f64,
}

impl SheetPlacement {
    /// Where a place of the job will be, mm of the machine.
    #[must_use]
    pub fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.turn_deg.to_radians().sin_cos();
        let (x, y) = (x - self.from_mm[0], y - self.from_mm[1]);
        [self.to_mm[0] + x * cos - y * sin, self.to_mm[1] + x * sin + y * cos]
    }

    /// Distances in X and in Y that places of the job will have from the lower and the upper end of the travel, mm;
    /// negative where a place will be beyond it. `None` without a place.
    #[must_use]
    pub fn travel_left(&self, places: &[[f64; 2]], travel_mm: [[f64; 2]; 2]) -> Option<[[f64; 2]; 2]> {
        let placed: Vec<[f64; 2]> = places.iter().map(|&place| self.place(place)).collect();
        let left = [0, 1].map(|axis| {
            let values = placed.iter().map(|place| place[axis]);
            let [low, high] = [values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max)];
            [low - travel_mm[axis][0], travel_mm[axis][1] - high]
        });
        (!placed.is_empty()).then_some(left)
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

    #[test]
    fn what_is_left_of_the_travel_is_that_of_the_turned_job() {
        let edge = SheetEdge::through([20.0, 10.0], [20.0, 110.0]).expect("an edge");
        // Along Y, the job is not turned; from a system that was, it is turned back.
        let placement = edge.placement([5.0, 5.0], 30.0);
        assert_eq!((edge.is_along_y, placement.turn_deg), (true, -30.0));
        let edge = SheetEdge::through([20.0, 10.0], [100.0, 70.0]).expect("an edge");
        let placement = edge.placement([5.0, 5.0], 0.0);
        let is_near = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]) < 1e-9;
        assert!(is_near(placement.place([5.0, 5.0]), [20.0, 10.0]), "the zero is the first point");
        assert!(is_near(placement.place([105.0, 5.0]), [100.0, 70.0]), "X goes through the second one");
        assert!(is_near(placement.place([5.0, 105.0]), [-40.0, 90.0]));
        let left =
            placement.travel_left(&[[5.0, 5.0], [105.0, 5.0], [5.0, 105.0]], [[-20.0, 300.0]; 2]).expect("places");
        assert!(is_near(left[0], [-20.0, 200.0]) && is_near(left[1], [30.0, 210.0]), "{left:?}");
        assert_eq!(placement.travel_left(&[], [[-20.0, 300.0]; 2]), None);
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
            // It is where the placement shows it.
            let placed = edge.placement([1.0, 2.0], 0.0).place([1.0 + length, 2.0]);
            let found = [x + length * cos, y + length * sin];
            prop_assert!((placed[0] - found[0]).hypot(placed[1] - found[1]) < 1e-5, "{placed:?} {found:?}");
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
