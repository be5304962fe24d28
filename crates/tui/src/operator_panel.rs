//! The operator's functions for screens of other kinds: the same key table and the same status line.
//!
//! Invariant: what is possible and what is suggested comes from the tables of the terminal screen, so that no two
//! screens differ.

use crate::keys::{Key, KeyAction, Situation, TABLE};
use crate::model::ScreenModel;
use crate::status_hint::HintLevel;
use crate::status_line;

/// Function of the operator, as a row of the key table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PanelAction {
    /// Identifier: `cycle-start`, `hold`, `reverse` …
    pub id: String,
    /// Keys, as browsers name them.
    pub keys: Vec<String>,
    /// Name in a word or two.
    pub label: &'static str,
    /// What it does, in one line.
    pub help: &'static str,
}

/// Status of the machine, and what the operator can do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PanelStatus {
    /// Status in a word or two.
    pub word: &'static str,
    /// Reason, in one line.
    pub reason: String,
    /// `normal`, `waiting` or `alarm`.
    pub level: &'static str,
    /// Situation that selects what is possible, as an identifier.
    pub situation: &'static str,
    /// Identifiers of the functions that are possible.
    pub possible: Vec<String>,
    /// Identifiers of the functions that apply, the most useful first.
    pub suggested: Vec<String>,
}

/// All functions, in the order of the key table.
#[must_use]
pub fn panel_actions() -> Vec<PanelAction> {
    let action = |row: &crate::keys::Row| PanelAction {
        id: identifier(row.action),
        keys: row.keys.iter().map(|&key| browser_key(key)).collect(),
        label: row.short,
        help: row.long,
    };
    TABLE.iter().map(action).collect()
}

/// Status of the machine that this model shows.
#[must_use]
pub fn panel_status(model: &ScreenModel) -> PanelStatus {
    let hint = status_line::of(model);
    let situation = Situation::of(model);
    let possible = TABLE.iter().filter(|row| row.situations & situation as u8 != 0);
    PanelStatus {
        word: hint.status,
        reason: hint.reason,
        level: match hint.level {
            HintLevel::Normal => "normal",
            HintLevel::Waiting => "waiting",
            HintLevel::Alarm => "alarm",
        },
        situation: situation_name(situation),
        possible: possible.map(|row| identifier(row.action)).collect(),
        suggested: hint.actions.into_iter().map(identifier).collect(),
    }
}

const fn situation_name(situation: Situation) -> &'static str {
    match situation {
        Situation::Setup => "setup",
        Situation::Run => "run",
        Situation::Retrace => "retrace",
        Situation::Wheel => "wheel",
        Situation::Paused => "paused",
        Situation::Ended => "ended",
        Situation::ProgramEnd => "program_end",
        Situation::Resuming => "resuming",
    }
}

/// Identifier of a function: its name in lower case, with hyphens.
fn identifier(action: KeyAction) -> String {
    let name = format!("{action:?}");
    let mut identifier = String::with_capacity(name.len() + 2);
    for letter in name.chars() {
        if letter.is_ascii_uppercase() && !identifier.is_empty() {
            identifier.push('-');
        }
        identifier.push(letter.to_ascii_lowercase());
    }
    identifier
}

/// Name of a key in a browser (`KeyboardEvent.key`); with Shift and Control before it where they are needed.
fn browser_key(key: Key) -> String {
    match key {
        Key::Char(letter) => letter.to_string(),
        Key::Up => "ArrowUp".into(),
        Key::Down => "ArrowDown".into(),
        Key::Left => "ArrowLeft".into(),
        Key::Right => "ArrowRight".into(),
        Key::ShiftUp => "Shift+ArrowUp".into(),
        Key::ShiftDown => "Shift+ArrowDown".into(),
        Key::ShiftLeft => "Shift+ArrowLeft".into(),
        Key::ShiftRight => "Shift+ArrowRight".into(),
        Key::PageUp => "PageUp".into(),
        Key::PageDown => "PageDown".into(),
        Key::Tab => "Tab".into(),
        Key::Enter => "Enter".into(),
        Key::Esc => "Escape".into(),
        Key::Backspace => "Backspace".into(),
        Key::Interrupt => "Control+c".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::program_facts::ProgramFacts;
    use std::collections::HashSet;
    use std::sync::Arc;

    #[test]
    fn every_function_has_an_identifier_of_its_own_and_what_is_suggested_is_known() {
        let actions = panel_actions();
        let known: HashSet<&str> = actions.iter().map(|action| action.id.as_str()).collect();
        assert_eq!(known.len(), actions.len());
        assert!(known.contains("cycle-start") && known.contains("back-to-cut-end"));
        let machine = retrace_config::MachineConfig::built_in().expect("valid");
        let status = panel_status(&ScreenModel::new(Arc::new(ProgramFacts::of(&machine, "part.ngc", "M2\n"))));
        assert_eq!(status.situation, "setup");
        assert!(status.possible.iter().chain(&status.suggested).all(|id| known.contains(id.as_str())), "{status:?}");
    }
}
