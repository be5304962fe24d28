//! Words for the operator about an interrupted cut, and about the contours of the program.
//!
//! Invariant: they name only keys that work where they are shown.

use crate::model::{MAX_CONTOURS, ScreenModel};

/// Why the machine stands in a cut that ends in this line.
pub(crate) fn interrupted_text(model: &ScreenModel, line: u32) -> String {
    let lost = model.lost_cutter.map(|channel| format!("{} lost; ", model.facts.output_name(channel)));
    format!("{}the cut ends in line {line}; k goes back and cuts on", lost.unwrap_or_default())
}

/// What a confirmation of the outputs means for an interrupted cut: a lost cutter has cut nothing up to here.
pub(crate) const fn confirmation_text(model: &ScreenModel) -> &'static str {
    match model.lost_cutter {
        Some(_) => "y leaves a gap in the cut; k goes back and cuts on",
        None => "y starts the cutter here; k goes back and cuts on",
    }
}

/// How many contours were cut, behind the word *completed*; empty where the program cuts none.
pub(crate) fn contours_text(model: &ScreenModel) -> String {
    let (contours, not_whole) = &model.contours;
    let plural = if *contours == 1 { "" } else { "s" };
    match not_whole.len() {
        _ if *contours == 0 => String::new(),
        0 => format!(", {contours} contour{plural} cut"),
        MAX_CONTOURS.. => format!(", {MAX_CONTOURS} or more of {contours} contours NOT cut through"),
        count => format!(", {count} of {contours} contour{plural} NOT cut through"),
    }
}
