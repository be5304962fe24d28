//! The path of the program as it will lie once the edge of the sheet is set (CUT-58).
//!
//! Invariant: it is that of the program, read with the offsets that will be set. What moves in other coordinates stays.

use retrace_config::MachineConfig;
use retrace_controller::{BlockDecoder, SheetPlacement};

use crate::preview::Preview;
use crate::trail::Trail;

/// Most moves that are compared. What a longer program does with the rest is not known.
const MAX_MOVES: usize = 4_000_000;
/// Greatest distance between places that count as the same, mm.
const SAME_PLACE_MM: f64 = 0.01;

/// Path as it will lie.
#[derive(Clone, Debug, Default)]
pub struct PlacedPath {
    /// The points on the edge of the sheet by which it lies so, mm of the machine.
    pub points: [[f64; 2]; 2],
    /// Path.
    pub path: Trail,
    /// Whether all of it is turned and moved with the work zero, from the first place that is.
    pub is_turned_whole: bool,
}

impl PlacedPath {
    /// Decodes a program as it is, and as it will be read, which places it so.
    #[must_use]
    pub fn of(
        machine: &MachineConfig,
        (now, then): (&mut impl BlockDecoder, &mut impl BlockDecoder),
        placement: &SheetPlacement,
        points: [[f64; 2]; 2],
    ) -> Self {
        let mut ends = Preview::with_ends(machine, now, MAX_MOVES).1;
        let (preview, placed) = Preview::with_ends(machine, then, MAX_MOVES);
        let is_known = ends.len() < MAX_MOVES && ends.len() == placed.len();
        ends.iter_mut().for_each(|end| *end = placement.place(end.map(f64::from)).map(|mm| mm as f32));
        let is_same = |(a, b): (&[f32; 2], &[f32; 2])| f64::from((a[0] - b[0]).hypot(a[1] - b[1])) < SAME_PLACE_MM;
        // It begins where the machine stands.
        let mut pairs = ends.iter().zip(&placed).skip_while(|&pair| !is_same(pair)).peekable();
        let is_turned_whole = is_known && (placed.is_empty() || pairs.peek().is_some()) && pairs.all(is_same);
        Self { points, path: preview.path, is_turned_whole }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fake_machine::Decoder;
    use retrace_controller::SheetEdge;

    /// What becomes of a program whose zero is at the origin, if the edge is set as G10 does it.
    fn placed(text: &str) -> PlacedPath {
        let machine = MachineConfig::built_in().expect("built in");
        let points = [[10.0, 20.0], [90.0, 80.0]];
        let edge = SheetEdge::through(points[0], points[1]).expect("an edge");
        let set = format!("G10 L2 P1 X10 Y20 R{:.9}\n{text}", edge.angle_deg);
        let [mut now, mut then] = [text, &set].map(|text| Decoder::new(&machine, text));
        PlacedPath::of(&machine, (&mut now, &mut then), &edge.placement([0.0; 2], 0.0), points)
    }

    #[test]
    fn a_program_in_the_coordinates_in_force_is_turned_whole() {
        for text in [
            "G21 G90\nG0 X10\nG0 Y5\nG1 X50 F900\nG3 X60 Y15 I0 J10\nG91 G1 X5\nG90 G0 X0 Y0\nM2\n",
            "G21 G90\nG53 G0 X100\nG0 X10 Y5\nG1 X50 F900\nG53 G0 Z0\nM2\n",
            "G21 G90\nM2\n",
        ] {
            assert!(placed(text).is_turned_whole, "{text}");
        }
    }

    #[test]
    fn what_moves_in_other_coordinates_is_not_turned() {
        for text in [
            "G21 G90\nG0 X10 Y5\nG1 X50 F900\nG53 G0 X100 Y0\nM2\n",
            "G21 G90\nG0 X10 Y5\nG55 G1 X50 Y5 F900\nM2\n",
            "G21 G90\nG0 X10 Y5\nG1 X50 F900\nG28\nM2\n",
        ] {
            assert!(!placed(text).is_turned_whole, "{text}");
        }
        // The drawing has the move of the second coordinate system where it is.
        let placed = placed("G21 G90\nG0 X10 Y5\nG55 G1 X50 Y5 F900\nM2\n");
        let last = placed.path.corners().last().expect("a corner").at;
        assert!((last[0] - 50.0).abs() < 1e-3 && (last[1] - 5.0).abs() < 1e-3, "{last:?}");
    }
}
