//! The length of a tool that the operator has jogged down to the work by eye, without a probe (PRB-21, PRB-22).
//!
//! Invariant: with the length that is returned, the place where the tip stands has the Z of the work that was named.

use retrace_controller::EnteredLength;

use crate::model::ScreenModel;

/// Length of the new tool if its tip, where the machine stands now, is at this coordinate of the work along the tool
/// axis, mm.
///
/// # Errors
/// The machine moves, has no tool axis, or the coordinate is not a number.
pub fn length_touching(model: &ScreenModel, at_mm: f64) -> Result<EnteredLength, String> {
    let axis = model.facts.tool_axis.ok_or("the machine has no tool axis")?;
    if !model.at_rest {
        return Err("the machine moves: wait until it stands".into());
    }
    // The old tool would be shown at `at_mm` here; the difference to what is shown is what the new one is longer.
    let longer_mm = model.work_mm(axis) - at_mm;
    if longer_mm.is_nan() || longer_mm.abs() > 10_000.0 {
        return Err("enter the Z of the work that the tip touches, in mm, such as at 0".into());
    }
    Ok(EnteredLength::By((longer_mm * 1e6).round() / 1e6))
}
