//! The contacts that sense the sheet, as inputs of the card.
//!
//! Invariant: at most one cutter senses the sheet, over contacts that have no other use and within the travel.

use retrace_link::InputUse;

use crate::axis::AxisConfig;
use crate::card_config::CardConfig;
use crate::cutter::{CutterConfig, ZWords};
use crate::numbered_error::NumberedError;

/// Gives the contacts of the sheet their meaning on the card, and checks that the sheet is within the travel.
///
/// # Errors
/// `E2112`
pub(crate) fn declare_contacts(
    cutters: &[CutterConfig],
    axes: &[AxisConfig],
    tool_axis: Option<usize>,
    card: &mut CardConfig,
) -> Result<(), NumberedError> {
    let sensing = cutters.iter().filter(|cutter| cutter.sense.is_used());
    for (at, cutter) in sensing.enumerate() {
        let refuse = |what: &str, remedy: &str| {
            Err(NumberedError::new("E2112", format!("[[cutter]] {}: sense: {what}", cutter.name), remedy.to_owned()))
        };
        if at > 0 {
            return refuse("another cutter senses the sheet, too", "one cutter senses the sheet");
        }
        if cutter.z_words == ZWords::Obeyed || cutter.materials.is_none() {
            return refuse(
                "the program sets the height",
                "`materials`, whose table has the heights, and z_words = \"ignored\"",
            );
        }
        let Some(axis) = tool_axis.and_then(|index| axes.get(index)) else {
            return refuse("the machine has no tool axis", "an axis z, or `tool_axis`");
        };
        let sense = &cutter.sense;
        let [lowest, highest] = axis.travel_mm;
        let (top, bottom) = (sense.sheet_mm + sense.start_mm, sense.sheet_mm - sense.below_mm - sense.float_travel_mm);
        if top > highest || bottom < lowest {
            let what = format!("from {top} to {bottom} mm, beyond the travel of {lowest} to {highest} mm");
            return refuse(&what, "`sheet_mm` in machine coordinates; smaller `start_mm` and `below_mm`");
        }
        if !sense.ohmic.is_empty() && sense.float_travel_mm + sense.ohmic_offset_mm < 0.0 {
            return refuse("ohmic_offset_mm is below the travel of the float switch", "a greater `ohmic_offset_mm`");
        }
        for (key, number) in sense.inputs() {
            let is_proof = cutters.iter().any(|other| other.proof.is_some_and(|proof| proof.input == number));
            match card.inputs.get_mut(usize::from(number)) {
                Some(input) if input.used_for == InputUse::Plain && !is_proof => {
                    input.used_for = InputUse::Collision { only_lit: true };
                }
                _ => {
                    let what = format!("{key} = [{number}]: there is no such input, or it has another use");
                    return refuse(&what, "an input from 0 to 15 with `use = \"plain\"`, for this use only");
                }
            }
        }
    }
    Ok(())
}
