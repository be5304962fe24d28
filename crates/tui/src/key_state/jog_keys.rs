//! Keys that jog an axis.
//!
//! Invariant: a jog that goes on is held: its key was pressed at rest and has repeated itself since, without another
//! key in between. Behind another key, its repeats move nothing, not even by a step, until it was let go.

use retrace_controller::{JogSpeed, ManualTask, OperatorCommand};

use super::KeyState;
use crate::HELD_JOG_TIMEOUT;
use crate::keys::Key;
use crate::model::{ScreenModel, ScreenStage};
use crate::ui_command::UiCommand;

/// What a jog key does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum JogStep {
    /// A step of so many mm (degrees).
    Mm(f64),
    /// A motion for as long as it is held, and a step where it is tapped.
    Held(JogSpeed),
}

/// What is selected one after the other.
pub(super) const JOG_STEPS: [JogStep; 6] = [
    JogStep::Mm(0.01),
    JogStep::Mm(0.1),
    JogStep::Mm(1.0),
    JogStep::Mm(10.0),
    JogStep::Held(JogSpeed::Full),
    JogStep::Held(JogSpeed::Slow),
];

impl JogStep {
    /// Step of a tap, mm (degrees).
    pub(crate) const fn tap_mm(self) -> f64 {
        match self {
            Self::Mm(mm) => mm,
            Self::Held(JogSpeed::Full) => 1.0,
            Self::Held(JogSpeed::Slow) => 0.1,
        }
    }
}

/// Maximum time between two presses that may be repeats of a key that is held down, ms: no finger taps that fast.
const MAX_REPEAT_MS: u64 = 120;
/// Presses that follow each other faster were delayed on their way, and count as one.
const MIN_REPEAT_MS: u64 = 10;
/// Number of repeats in a row by which a key is known to be held, where the terminal does not report that.
const HELD_REPEATS: u32 = 2;

/// What a press of a jog key is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum KeyPress {
    /// A tap, or the beginning of a held key.
    Tap,
    /// The key is held down.
    Held,
    /// A press that was delayed on its way, behind a tap.
    Delayed,
    /// A repeat of a key that no longer holds a jog.
    Over,
}

/// A jog key that was pressed, and whose release was not reported.
#[derive(Clone, Copy, Debug)]
struct PressedKey {
    key: Key,
    /// Time of its last press or repeat, ms.
    at_ms: u64,
    repeats: u32,
    /// Whether another key was pressed since: until it is let go, it moves nothing.
    is_over: bool,
}

impl PressedKey {
    const fn holds_jog(&self) -> bool {
        self.repeats >= HELD_REPEATS && !self.is_over
    }
}

/// The jog keys that were pressed.
#[derive(Clone, Debug, Default)]
pub(super) struct HeldKeys {
    /// One entry for each key; there are few.
    pressed: Vec<PressedKey>,
    /// Whether the terminal reports this press as a repeat.
    is_reported: bool,
}

impl HeldKeys {
    /// Another key was pressed: what the others hold ends. Returns whether one of them held a jog a moment ago.
    pub(super) fn interrupt(&mut self, now_ms: u64) -> bool {
        let is_recent = |of: &PressedKey| now_ms.saturating_sub(of.at_ms) < HELD_JOG_TIMEOUT.as_millis() as u64;
        let held = self.pressed.iter().any(|of| of.holds_jog() && is_recent(of));
        self.pressed.iter_mut().for_each(|of| of.is_over = true);
        held
    }

    fn press(&mut self, key: Key, now_ms: u64) -> KeyPress {
        let is_reported = std::mem::take(&mut self.is_reported);
        let before = self.pressed.iter().position(|of| of.key == key).map(|index| self.pressed.swap_remove(index));
        let mut pressed = PressedKey { key, at_ms: now_ms, repeats: 0, is_over: false };
        if let Some(before) = before {
            let most_ms = if before.repeats >= HELD_REPEATS || before.is_over {
                HELD_JOG_TIMEOUT.as_millis() as u64
            } else {
                MAX_REPEAT_MS
            };
            let since_ms = now_ms.saturating_sub(before.at_ms);
            if is_reported {
                pressed = PressedKey { repeats: HELD_REPEATS, is_over: before.is_over, ..pressed };
            } else if since_ms < MIN_REPEAT_MS && !before.is_over {
                self.pressed.push(before);
                return if before.holds_jog() { KeyPress::Held } else { KeyPress::Delayed };
            } else if since_ms < most_ms {
                pressed = PressedKey { repeats: before.repeats + 1, is_over: before.is_over, ..pressed };
            }
        } else if is_reported {
            // A repeat of a key whose press did not jog.
            return KeyPress::Over;
        }
        // A repeat that moves nothing ends nothing.
        if !pressed.is_over {
            self.interrupt(now_ms);
        }
        self.pressed.push(pressed);
        match pressed.repeats {
            _ if pressed.is_over => KeyPress::Over,
            HELD_REPEATS.. => KeyPress::Held,
            _ => KeyPress::Tap,
        }
    }
}

impl KeyState {
    /// Handles a key that the terminal reports as held down.
    #[must_use]
    pub(crate) fn repeat(&mut self, key: Key, now_ms: u64, model: &ScreenModel) -> Option<UiCommand> {
        self.held_keys.is_reported = true;
        let command = self.key(key, now_ms, model);
        self.held_keys.is_reported = false;
        command
    }

    /// Handles the release of a key, which some terminals report: it ends the jog that the key holds.
    #[must_use]
    pub(crate) fn release(&mut self, key: Key) -> Option<UiCommand> {
        let pressed = &mut self.held_keys.pressed;
        let released = pressed.iter().position(|of| of.key == key).map(|index| pressed.swap_remove(index))?;
        (!released.is_over).then_some(UiCommand::JogReleased)
    }

    /// What a jog key does.
    pub(crate) fn jog_step(&self) -> JogStep {
        JOG_STEPS[self.step % JOG_STEPS.len()]
    }

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
        let step = self.jog_step();
        let mm = if up { step.tap_mm() } else { -step.tap_mm() };
        if model.stage == ScreenStage::Job {
            // Jogs of a paused program are steps, each of which is recorded.
            return Some(UiCommand::Job(OperatorCommand::Jog { axis: letter, mm }));
        }
        match (self.held_keys.press(key, now_ms), step) {
            (KeyPress::Over, _) | (KeyPress::Delayed, JogStep::Held(_)) => None,
            (KeyPress::Held, JogStep::Held(speed)) => Some(UiCommand::JogHeld { axis: letter, up, speed }),
            _ => Some(UiCommand::Task(ManualTask::Jog { axis: letter, mm })),
        }
    }
}
