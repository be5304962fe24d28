//! The page of contours: which one is marked, what is shown of each, and where Enter goes (CUT-27, CUT-45, CUT-47).
//!
//! Invariant: a contour that is not listed is never marked; what is not known is shown as `?`.

use retrace_controller::{ContourRow, ContourState, OperatorCommand};
use retrace_gcode::{FIRST_TEMPORARY_MATERIAL, Material};

use crate::keys::Key;
use crate::model::{ScreenModel, ScreenStage};
use crate::ui_command::UiCommand;

/// Number of contours that a page key skips.
const PAGE: usize = 10;

/// What Enter does with the marked contour.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum ContourChoice {
    /// Sends this command.
    Send(UiCommand),
    /// Starts the program at the contour of this number, after a question.
    Start(u32),
    /// Nothing, for this reason.
    Refuse(&'static str),
}

/// Numbers of the contours on the page.
pub(crate) fn numbers(model: &ScreenModel) -> Vec<u32> {
    model.contours.numbers(model.facts.contours.as_deref())
}

/// Index of the marked contour: the chosen one, or that which is being cut or was last, or the first.
pub(crate) fn marked(model: &ScreenModel, numbers: &[u32], chosen: Option<u32>) -> Option<usize> {
    let wanted = chosen.or(model.contours.last()).unwrap_or(1);
    let at = numbers.partition_point(|&number| number < wanted);
    (!numbers.is_empty()).then(|| at.min(numbers.len() - 1))
}

/// Which contour the operator has marked, and the number that he types.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ContourMark {
    /// The marked contour; `None` before a key has moved the mark.
    pub(crate) chosen: Option<u32>,
    /// The digits typed one after the other.
    pub(crate) typed: u32,
}

/// The mark after this key, if it moves it. A number that is longer than any contour's begins anew.
pub(crate) fn moved(model: &ScreenModel, mark: ContourMark, key: Key) -> Option<ContourMark> {
    let numbers = numbers(model);
    let (at, last) = (marked(model, &numbers, mark.chosen)?, numbers.len() - 1);
    let to = match key {
        Key::Up => at.saturating_sub(1),
        Key::Down => (at + 1).min(last),
        Key::PageUp => at.saturating_sub(PAGE),
        Key::PageDown => (at + PAGE).min(last),
        Key::Char(digit) => {
            let digit = digit.to_digit(10)?;
            let longer = mark.typed.saturating_mul(10).saturating_add(digit);
            let typed = if numbers.last().is_some_and(|&most| longer <= most) { longer } else { digit };
            return Some(ContourMark { chosen: Some(typed), typed });
        }
        _ => return None,
    };
    Some(ContourMark { chosen: numbers.get(to).copied(), typed: 0 })
}

/// What Enter does.
pub(crate) fn choice(model: &ScreenModel, chosen: Option<u32>) -> ContourChoice {
    let numbers = numbers(model);
    let Some(&number) = marked(model, &numbers, chosen).and_then(|at| numbers.get(at)) else {
        return ContourChoice::Refuse("no contour is listed");
    };
    match &model.stage {
        ScreenStage::Job => ContourChoice::Send(UiCommand::Job(OperatorCommand::BackToContour(number))),
        ScreenStage::Setup | ScreenStage::Ended(_) => ContourChoice::Start(number),
        ScreenStage::Resuming => ContourChoice::Refuse("confirm or cancel the resumption first"),
    }
}

/// What the key does that skips the marked contour, or cuts it after all.
pub(crate) fn skip(model: &ScreenModel, chosen: Option<u32>) -> ContourChoice {
    let numbers = numbers(model);
    let marked = marked(model, &numbers, chosen).and_then(|at| numbers.get(at));
    let Some(row) = marked.and_then(|&number| model.contours.row(number, model.facts.contours.as_deref())) else {
        return ContourChoice::Refuse("no contour is listed");
    };
    let (number, on) = (row.number, row.state != ContourState::Skipped);
    match &model.stage {
        ScreenStage::Resuming => ContourChoice::Refuse("confirm or cancel the resumption first"),
        ScreenStage::Job if !model.is_at_program_end() => {
            ContourChoice::Send(UiCommand::Job(OperatorCommand::SkipContourAhead { number, on }))
        }
        _ => ContourChoice::Send(UiCommand::SkipContour { number, on }),
    }
}

/// Title of the page.
pub(crate) fn title(model: &ScreenModel) -> String {
    let count = match (&model.facts.contours, model.contours.current()) {
        (Some(list), Some((number, _))) => format!("contour {number} of {}", list.count),
        (Some(list), None) => format!("{} contours", list.count),
        (None, Some((number, _))) => format!("contour {number} of ?"),
        (None, None) => "contours".into(),
    };
    let go = if model.stage == ScreenStage::Job { "back to it" } else { "begin there" };
    format!("{count} · ↑↓ 0-9 mark · Enter {go} · N skip or cut it · Esc close")
}

/// Why the page is empty.
pub(crate) fn empty_text(model: &ScreenModel) -> &'static str {
    match &model.facts.contours {
        Some(_) => "The program has no contours.",
        None => "No contour is known: of a stream, each is listed once it is begun.",
    }
}

/// Heading of the columns.
pub(crate) const HEADING: &str = "  contour    line  subprogram  material               mm  state";

/// Line of a contour.
pub(crate) fn row_text(row: &ContourRow<'_>, is_marked: bool) -> String {
    let planned = row.planned;
    let subprogram = planned.map_or("?", |planned| planned.subprogram().unwrap_or("-"));
    let material = match planned.map(|planned| planned.material.as_deref()) {
        None => "?".into(),
        Some(material) => material.map_or("-".into(), material_text),
    };
    let length = planned.map_or("?".into(), |planned| format!("{:.1}", planned.length_mm));
    let mark = if is_marked { '>' } else { ' ' };
    let short = |text: &str, width: usize| text.chars().take(width).collect::<String>();
    format!(
        "{mark} {:>7} {:>7}  {:<10}  {:<14} {length:>9}  {}",
        row.number,
        row.line,
        short(subprogram, 10),
        short(&material, 14),
        row.state_text(1)
    )
}

fn material_text(material: &Material) -> String {
    let number = match material.number {
        FIRST_TEMPORARY_MATERIAL.. => "temporary".into(),
        number => number.to_string(),
    };
    if material.name.is_empty() { number } else { format!("{number} {}", material.name) }
}

/// What else is known of the marked contour: its cutter, and where it begins and ends.
pub(crate) fn detail_text(model: &ScreenModel, row: &ContourRow<'_>) -> String {
    let Some(planned) = row.planned else { return format!("contour {}: its plan is not known", row.number) };
    let place = |at: &[f64; 9]| {
        let axes = model.facts.axes.iter().zip(at).filter(|(axis, _)| matches!(axis.letter, 'x' | 'y'));
        let each = axes.map(|(axis, mm)| format!("{} {mm:.3}", axis.letter.to_ascii_uppercase()));
        each.collect::<Vec<_>>().join(" ")
    };
    format!("{}, from {} to {} of the machine", planned.cutter, place(&planned.pierce_mm), place(&planned.end_mm))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::program_facts::ProgramFacts;
    use retrace_config::MachineConfig;
    use retrace_controller::{Event, EventKind, Telemetry};
    use retrace_core::Place;
    use std::sync::Arc;

    /// A model in which these contours were cut.
    fn model(cut: &[u32]) -> ScreenModel {
        let machine = MachineConfig::built_in().expect("valid");
        let mut model = ScreenModel::new(Arc::new(ProgramFacts::of(&machine, "part.ngc", "M2\n")));
        for &number in cut {
            let kind = EventKind::Contour { number, cut_mm: 1.0, not_cut_mm: 0.0 };
            let event = Event { period: 1, time_s: 0.0, place: Place::default(), line: 4, kind };
            model.contours.observe::<9>(&Telemetry::Event(event));
        }
        model
    }

    #[test]
    fn keys_move_the_mark_within_the_list() {
        let model = model(&[3, 4, 5, 9]);
        let keys = [(Key::Down, 4), (Key::PageDown, 9), (Key::Down, 9), (Key::Up, 5), (Key::PageUp, 3), (Key::Up, 3)];
        let mut mark = ContourMark::default();
        for (key, number) in keys {
            mark = moved(&model, mark, key).expect("it moves the mark");
            assert_eq!(mark.chosen, Some(number), "{key:?}");
        }
        assert_eq!(moved(&model, mark, Key::Enter), None);
        assert_eq!(moved(&self::model(&[]), ContourMark::default(), Key::Down), None, "an empty list");
    }

    #[test]
    fn a_typed_number_marks_its_contour() {
        let model = model(&[3, 4, 5, 12, 35]);
        let typed = |keys: &str| {
            let mark = keys.chars().fold(ContourMark::default(), |mark, key| {
                let key = if key == '+' { Key::Down } else { Key::Char(key) };
                moved(&model, mark, key).expect("it moves the mark")
            });
            let numbers = numbers(&model);
            marked(&model, &numbers, mark.chosen).map(|at| numbers[at])
        };
        let found = ["4", "12", "35", "355", "3+5", "7", "99999999999"].map(typed);
        assert_eq!(found, [4, 12, 35, 5, 5, 12, 12].map(Some));
        assert_eq!(moved(&model, ContourMark::default(), Key::Char('q')), None);
    }

    #[test]
    fn enter_goes_back_in_a_job_and_asks_before_one_begins() {
        let mut model = model(&[3, 4]);
        let ask = ContourChoice::Start(4);
        assert_eq!(choice(&model, Some(4)), ask);
        model.stage = ScreenStage::Ended("completed".into());
        assert_eq!(choice(&model, Some(4)), ask);
        model.stage = ScreenStage::Job;
        let back = UiCommand::Job(OperatorCommand::BackToContour(4));
        assert_eq!(choice(&model, Some(4)), ContourChoice::Send(back));
        model.stage = ScreenStage::Resuming;
        assert!(matches!(choice(&model, Some(4)), ContourChoice::Refuse(_)));
        assert!(matches!(choice(&self::model(&[]), None), ContourChoice::Refuse(_)));
    }
}
