//! The edge of the sheet in words: which points are taken, and what they would set (CUT-58).
//!
//! Invariant: what is shown is what is set when the operator accepts.

use retrace_controller::{SheetEdge, SheetPlacement};

use crate::model::ScreenModel;
use crate::placed_path::PlacedPath;

/// Greatest deviation from the outline of the contours, mm.
const OUTLINE_TOLERANCE_MM: f64 = 0.01;

/// The question before the first point is taken.
pub(crate) const FIRST_POINT: [&str; 4] = [
    "Two points on the edge of the sheet set zero and direction of the job.",
    "Is the tool over the edge, where the zero of the job is to be?",
    "(Or the pointer, while it is on.)  Nothing moves, and nothing is set yet.",
    "y take the 1st point here · any other key: cancel, then jog there and E again",
];

/// The turn of the work coordinates, where they have one.
pub(crate) fn turned(model: &ScreenModel) -> Option<String> {
    let degrees = Some(model.work_rotation_deg).filter(|&degrees| degrees != 0.0)?;
    Some(format!("The work coordinates are TURNED by {degrees:+.3}°, set before."))
}

/// The points at the screen, with the keys.
pub(crate) fn with_keys(model: &ScreenModel) -> String {
    match model.sheet_points[..] {
        [first] => {
            let [x, y] = first;
            format!("1st point X{x:.1} Y{y:.1}: jog 50 mm or more along the edge, E; Esc forgets it")
        }
        [_, _, ..] => format!("{}; E asks, y sets it, Esc forgets it", of(model)),
        [] => of(model),
    }
}

/// The points that are taken, and what comes next.
#[must_use]
pub fn of(model: &ScreenModel) -> String {
    match model.sheet_points[..] {
        [] => "jog to the zero of the job on the edge of the sheet, then take the first point".into(),
        [first] => {
            format!("first point at {}; jog 50 mm or more along the edge, then take the second one", place(first))
        }
        [first, second, ..] => match SheetEdge::through(first, second) {
            Ok(edge) => format!(
                "NOT SET YET: work zero to {}, turned by {:+.3}°, measured over {:.1} mm of the edge, which becomes {}",
                place(first),
                edge.angle_deg,
                edge.length_mm,
                if edge.is_along_y { "Y" } else { "X" }
            ),
            Err(refusal) => refusal.cause,
        },
    }
}

/// How the edge would move the job, once both points are taken.
#[must_use]
pub fn placement(model: &ScreenModel) -> Option<SheetPlacement> {
    let [first, second] = model.sheet_points[..] else { return None };
    let [x, y, _] = model.facts.space();
    let zero_mm = [*model.work_zero_mm.get(x?)?, *model.work_zero_mm.get(y?)?];
    Some(SheetEdge::through(first, second).ok()?.placement(zero_mm, model.work_rotation_deg))
}

/// The path as it will lie, where it is calculated for the points that are taken.
#[must_use]
pub(crate) fn placed(model: &ScreenModel) -> Option<&PlacedPath> {
    let [first, second] = model.sheet_points[..] else { return None };
    model.facts.placed.as_deref().filter(|placed| placed.points == [first, second])
}

/// How the edge would move the job, where it moves all of it.
#[must_use]
pub fn placement_of_whole(model: &ScreenModel) -> Option<SheetPlacement> {
    placed(model).filter(|placed| placed.is_turned_whole)?;
    placement(model)
}

/// Distances in X and in Y that the contours would have from the lower and the upper soft limit, mm, where both points
/// are taken, the contours are known, and all of the program lies on the sheet.
#[must_use]
pub fn travel_left(model: &ScreenModel) -> Option<[[f64; 2]; 2]> {
    let outline = model.facts.contours.as_ref()?.outline.vertices(OUTLINE_TOLERANCE_MM)?;
    let [x, y, _] = model.facts.space();
    let travel_mm = [model.facts.axes.get(x?)?.travel_mm, model.facts.axes.get(y?)?.travel_mm];
    placement_of_whole(model)?.travel_left(&outline, travel_mm)
}

/// How much of the travel is left around the contours.
#[must_use]
pub fn travel_text(model: &ScreenModel) -> Option<String> {
    if placed(model).is_some_and(|placed| !placed.is_turned_whole) {
        return Some(
            "The program also moves in coordinates that the edge does not turn: G53, or another coordinate system. \
             What it leaves of the travel is known once the edge is set"
                .into(),
        );
    }
    let [x, y] = travel_left(model)?;
    let sides = [("X-", x[0]), ("X+", x[1]), ("Y-", y[0]), ("Y+", y[1])];
    let beyond: Vec<_> =
        sides.iter().filter(|(_, mm)| *mm < 0.0).map(|(side, mm)| format!("{side} by {:.1} mm", -mm)).collect();
    Some(if beyond.is_empty() {
        let left = sides.map(|(side, mm)| format!("{side} {mm:.1}"));
        format!("Free between the contours and the soft limits: {} mm", left.join(", "))
    } else {
        format!("The contours would be BEYOND THE TRAVEL: {}", beyond.join(", "))
    })
}

fn place([x, y]: [f64; 2]) -> String {
    format!("X{x:.3} Y{y:.3} of the machine")
}
