//! What is traced by *frame*, in words, before the machine moves (CUT-59).
//!
//! Invariant: the extents are those of what the program cuts with the offsets in force, in machine coordinates; while
//! it is checked, and where the check has found an error, they are not known.

use retrace_controller::FrameShape;

use crate::model::ScreenModel;
use crate::program_facts::ProgramCheck;

/// Extents in X and in Y of what the program cuts, mm, where they are known.
#[must_use]
pub fn extents_mm(model: &ScreenModel) -> Option<[[f64; 2]; 2]> {
    // Those of another place or of other offsets are not of what would be cut.
    let facts = Some(&model.facts).filter(|facts| facts.check == ProgramCheck::Ready)?;
    let extents = facts.contours.as_ref()?.extents_mm?;
    let [x, y, _] = model.facts.space();
    let extents = [*extents.get(x?)?, *extents.get(y?)?];
    extents.as_flattened().iter().all(|mm| mm.is_finite()).then_some(extents)
}

/// Index of the axis that is raised to the safe height before the tool goes round, and that height in mm of the
/// machine, if it has one.
#[must_use]
pub fn height_axis(model: &ScreenModel) -> Option<(usize, Option<f64>)> {
    let facts = &model.facts;
    Some((facts.tool_axis.or(facts.space()[2])?, facts.frame_height_mm))
}

/// The height at which the tool goes round.
fn height(model: &ScreenModel) -> Option<String> {
    let (axis, safe_mm) = height_axis(model)?;
    let (letter, mm) = (model.facts.axes.get(axis)?.letter.to_ascii_uppercase(), model.machine_mm(axis));
    Some(match safe_mm {
        Some(safe) if safe > mm => format!("First up to {letter} {safe:.3} of the machine (safe height)."),
        Some(safe) => format!("{letter} stays at {mm:.3} of the machine: the safe height is {safe:.3}."),
        None => format!("{letter} STAYS at {mm:.3} of the machine: no safe height is set."),
    })
}

/// The question before a frame is traced.
pub(crate) fn question(model: &ScreenModel, shape: FrameShape) -> Vec<String> {
    let what = match shape {
        FrameShape::Rectangle => "the rectangle around what is cut, along X and Y of the machine",
        FrameShape::Outline => "the tight outline of what is cut, lead-ins included, straight across hollows",
    };
    let mut lines = vec![format!("The tool GOES ROUND {what}, cutters off.")];
    if let Some([x, y]) = extents_mm(model) {
        let place = format!("X{:.1} to X{:.1}, Y{:.1} to Y{:.1} of the machine", x[0], x[1], y[0], y[1]);
        lines.push(format!("It lies within {place}."));
    }
    lines.extend(height(model));
    lines.push("It goes straight to a corner, at the jog speed.".into());
    lines.push("y go round · Space stops it · any other key: cancel".into());
    lines
}
