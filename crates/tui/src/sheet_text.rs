//! The edge of the sheet in words: which points are taken, and what they would set (CUT-58).
//!
//! Invariant: what is shown is what is set when the operator accepts.

use retrace_controller::SheetEdge;

use crate::model::ScreenModel;

/// The same at the screen, with the key.
pub(crate) fn with_keys(model: &ScreenModel) -> String {
    match model.sheet_points[..] {
        [first] => {
            format!("1st point {}; jog along the edge, E takes the 2nd (E here: forget it)", place(first))
        }
        [_, _, ..] => format!("E, then y sets it: {}", of(model)),
        [] => of(model),
    }
}

/// The points that are taken, and what comes next.
#[must_use]
pub fn of(model: &ScreenModel) -> String {
    match model.sheet_points[..] {
        [] => "jog to the zero of the job on the edge of the sheet, then take the first point".into(),
        [first] => format!(
            "first point at {}; jog along the edge, then take the second one; here again it is forgotten",
            place(first)
        ),
        [first, second, ..] => match SheetEdge::through(first, second) {
            Ok(edge) => format!(
                "NOT SET YET: {:.1} mm of the edge along {}: zero at {}, turned by {:+.3}°",
                edge.length_mm,
                if edge.is_along_y { "Y" } else { "X" },
                place(first),
                edge.angle_deg
            ),
            Err(refusal) => refusal.cause,
        },
    }
}

fn place([x, y]: [f64; 2]) -> String {
    format!("X{x:.3} Y{y:.3} of the machine")
}
