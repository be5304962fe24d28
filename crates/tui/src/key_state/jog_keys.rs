//! Keys that jog an axis.
//!
//! Invariant: where a continuous jog moves the machine, any key of a jog stops it.

use retrace_controller::{ManualTask, OperatorCommand};

use super::{KeyState, REPEATED_MS, STEPS_MM};
use crate::keys::Key;
use crate::model::{ScreenModel, ScreenStage};
use crate::ui_command::UiCommand;

impl KeyState {
    /// Command of a key that jogs.
    pub(super) fn jog(&mut self, key: Key, now_ms: u64, model: &ScreenModel) -> Option<UiCommand> {
        let letters: Vec<char> = model.facts.axes.iter().map(|axis| axis.letter).collect();
        // A lathe has no Y: there ↑ ↓ are X, and ← → are Z.
        let is_lathe = !letters.contains(&'y');
        let (letter, up) = match key {
            Key::Left | Key::Right => (if is_lathe { 'z' } else { 'x' }, key == Key::Right),
            Key::Up | Key::Down => (if is_lathe { 'x' } else { 'y' }, key == Key::Up),
            Key::PageUp | Key::PageDown => ('z', key == Key::PageUp),
            _ => (*letters.get(self.axis)?, key == Key::Char(']')),
        };
        if !letters.contains(&letter) {
            self.show_notice(format!("this machine has no axis {}", letter.to_ascii_uppercase()), now_ms);
            return None;
        }
        let step = STEPS_MM.get(self.step).copied().flatten();
        let is_paused = model.stage == ScreenStage::Job;
        Some(match step {
            // Jogs of a paused program are steps, each of which is recorded.
            _ if is_paused => {
                let mm = step.unwrap_or(10.0);
                UiCommand::Job(OperatorCommand::Jog { axis: letter, mm: if up { mm } else { -mm } })
            }
            Some(mm) => UiCommand::Task(ManualTask::Jog { axis: letter, mm: if up { mm } else { -mm } }),
            None => {
                let before_ms = self.jogged_at_ms.replace(now_ms);
                match before_ms {
                    _ if !model.at_rest => UiCommand::Job(OperatorCommand::Hold),
                    // A key that is held down repeats itself, and must not begin again what it has stopped.
                    Some(before_ms) if now_ms.saturating_sub(before_ms) < REPEATED_MS => return None,
                    _ => UiCommand::Task(ManualTask::JogOn { axis: letter, up }),
                }
            }
        })
    }
}
