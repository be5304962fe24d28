//! Words for the operator about an interrupted cut, and about the contours of the program.
//!
//! Invariant: they name only keys that work where they are shown.

use retrace_controller::CutterState;

use crate::model::{ScreenModel, ScreenStage};

/// Why the machine stands in a cut that ends in this line.
pub(crate) fn interrupted_text(model: &ScreenModel, line: u32) -> String {
    let lost = model.lost_cutter.map(|channel| format!("{} went out", model.facts.output_name(channel)));
    let what = lost.unwrap_or_else(|| "the cut ends".into());
    let mut run_ins =
        model.facts.cutters.iter().filter(|cutter| model.lost_cutter.is_none_or(|lost| lost == cutter.fire));
    let back = match (run_ins.next(), run_ins.next()) {
        (Some(cutter), None) => format!("goes back to {} mm before", cutter.run_in_mm),
        // It is not known which one was cutting.
        _ => "goes back".into(),
    };
    format!("{what} in line {line}; k {back}, FIRES and cuts on")
}

/// What a start of the program does besides *cycle start*, on a machine at rest, the plainest words first; none where
/// it lights no cutter.
pub(crate) fn start_fires(model: &ScreenModel) -> Vec<String> {
    let facts = &model.facts;
    if model.stage != ScreenStage::Setup || model.dry_run || facts.cutters.is_empty() {
        return Vec::new();
    }
    let Some(contours) = &facts.contours else {
        // Not calculated, or a stream: it is not known.
        return vec!["cycle start, may FIRE".into(), "may FIRE".into()];
    };
    let mut starts = contours.starts.iter().filter(|(_, count)| **count > 0).map(|(name, _)| name);
    match (starts.next(), starts.next()) {
        (None, _) => Vec::new(),
        (Some(name), None) => {
            vec![format!("cycle start FIRES the {name}"), format!("FIRES the {name}"), "FIRES".into()]
        }
        _ => vec!["cycle start FIRES".into(), "FIRES".into()],
    }
}

/// Whether a cutter senses its sheet: in a feed hold it stays where it is on its way down.
pub(crate) fn is_sensing(model: &ScreenModel) -> bool {
    model.cutter_states.values().any(|(state, _)| *state == CutterState::Sensing)
}

/// What a cutter does whose start goes on to its end in a feed hold: one that waits for its sheet does not.
pub(crate) fn start_in_hold(model: &ScreenModel) -> Option<String> {
    let goes_on = |state: &CutterState| matches!(state, CutterState::Igniting | CutterState::Piercing);
    start_text(model).filter(|_| model.cutter_states.values().any(|(state, _)| goes_on(state)))
}

/// What a cutter does that is being started.
pub(crate) fn start_text(model: &ScreenModel) -> Option<String> {
    model.cutter_states.iter().find_map(|(&channel, &(state, _))| {
        let what = match state {
            CutterState::Sensing => "sensing the sheet",
            CutterState::Igniting if model.output(channel) == 0 => "waits, then FIRES",
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

/// How many contours were cut, and how often a cut was continued, behind the word *completed*; empty where the program
/// cuts none.
pub(crate) fn contours_text(model: &ScreenModel) -> String {
    let (contours, not_whole) = model.contours.ended();
    let plural = if contours == 1 { "" } else { "s" };
    let cut = match not_whole {
        _ if contours == 0 => return String::new(),
        0 if contours > 1 && is_all_cut(model) => format!("all {contours} contours cut"),
        0 => format!("{contours} contour{plural} cut"),
        count => format!("{count} of {contours} contour{plural} NOT cut through"),
    };
    format!(", {cut}{}", restarts_text(model))
}

/// How often a cut was continued; empty where it was not.
fn restarts_text(model: &ScreenModel) -> String {
    match model.restarts {
        0 => String::new(),
        1 => ", 1 restart".into(),
        count => format!(", {count} restarts"),
    }
}

/// Whether every contour of the program is known to be cut.
fn is_all_cut(model: &ScreenModel) -> bool {
    let planned = model.facts.contours.as_deref().map(|list| list.count);
    model.contours.skipped().next().is_none()
        && planned.is_some_and(|count| model.contours.ended() == (count as usize, 0))
}

/// What the report of a job says about its contours, with what the screen knows of them besides.
pub fn reported_contours_text(model: &ScreenModel, reported: &str) -> String {
    let (contours, _) = model.contours.ended();
    let all =
        if contours > 1 && is_all_cut(model) { format!(" · all {contours} contours cut") } else { reported.into() };
    all + &restarts_text(model)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ProgramFacts;
    use retrace_config::MachineConfig;
    use std::sync::Arc;

    #[test]
    fn how_far_a_recovery_goes_back_is_said_before() {
        let torch = "[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nrestart = { overlap_mm = 3 }\n";
        let second = "[[cutter]]\nname = \"second\"\nkind = \"torch\"\nfire = 1\n";
        let text = |machine: &str, lost| {
            let machine = MachineConfig::parse(machine, "test").expect("valid");
            let mut model = ScreenModel::new(Arc::new(ProgramFacts::of(&machine, "part.ngc", "M2\n")));
            model.lost_cutter = lost;
            interrupted_text(&model, 13)
        };
        assert!(text(torch, Some(64)).contains("; k goes back to 3 mm before, FIRES and cuts on"));
        assert!(text(torch, None).contains("; k goes back to 3 mm before, FIRES and cuts on"));
        let both = format!("{torch}{second}");
        assert!(text(&both, Some(64)).contains("; k goes back to 3 mm before,"));
        assert!(text(&both, None).contains("; k goes back, FIRES"), "it is not known which one was cutting");
    }
}
