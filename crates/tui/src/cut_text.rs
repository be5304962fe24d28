//! Words for the operator about an interrupted cut, and about the contours of the program.
//!
//! Invariant: they name only keys that work where they are shown.

use retrace_controller::CutterState;

use crate::model::ScreenModel;

/// Why the machine stands in a cut that ends in this line.
pub(crate) fn interrupted_text(model: &ScreenModel, line: u32) -> String {
    let lost = model.lost_cutter.map(|channel| format!("{} went out", model.facts.output_name(channel)));
    let what = lost.unwrap_or_else(|| "the cut ends".into());
    format!("{what} in line {line}; k goes back, FIRES and cuts on; c asks, and fires here")
}

/// What a cutter does that is being started.
pub(crate) fn start_text(model: &ScreenModel) -> Option<String> {
    model.cutter_states.iter().find_map(|(&channel, &(state, _))| {
        let what = match state {
            CutterState::Sensing => "sensing the sheet",
            CutterState::Igniting => "igniting",
            CutterState::Piercing => "piercing",
            _ => return None,
        };
        Some(format!("{}: {what}", model.facts.output_name(channel)))
    })
}

/// What a confirmation of the outputs means for an interrupted cut: a lost cutter has cut nothing up to here.
pub(crate) const fn confirmation_text(model: &ScreenModel) -> &'static str {
    match model.lost_cutter {
        Some(_) => "y leaves a gap in the cut; k goes back, FIRES and cuts on",
        None => "y starts the cutter here; k goes back, FIRES and cuts on",
    }
}

/// How many contours were cut, behind the word *completed*; empty where the program cuts none.
pub(crate) fn contours_text(model: &ScreenModel) -> String {
    let (contours, not_whole) = model.contours.ended();
    let plural = if contours == 1 { "" } else { "s" };
    match not_whole {
        _ if contours == 0 => String::new(),
        0 => format!(", {contours} contour{plural} cut"),
        count => format!(", {count} of {contours} contour{plural} NOT cut through"),
    }
}

/// The contour that is being cut, of how many, and how much of it and of the job is cut; `?` for what is not known.
pub(crate) fn progress_text(model: &ScreenModel) -> Option<String> {
    let (number, cut_mm) = model.contours.current()?;
    let planned = model.facts.contours.as_deref();
    let known = |text: Option<String>| text.unwrap_or_else(|| "?".into());
    let count = known(planned.map(|list| list.count.to_string()));
    let length = known(planned.and_then(|list| list.contour(number)).map(|contour| tenths(contour.length_mm)));
    let of_job = known(planned.map(|list| tenths(list.cut_mm())));
    let (cut, job) = (tenths(cut_mm), tenths(model.contours.cut_mm()));
    Some(format!("contour {number} of {count}: {cut} of {length} mm · job {job} of {of_job} mm"))
}

/// A length in mm with one decimal.
fn tenths(mm: f64) -> String {
    format!("{mm:.1}")
}
