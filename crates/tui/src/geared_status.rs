//! Status while the motion follows the spindle, in a thread and in a tap: what a hold, a reverse run and a spindle that
//! is turned by hand do there (SPN-21 … SPN-23).
//!
//! Invariant: no key is named that is refused there.

use retrace_core::mode::Mode;
use retrace_journal::HoldReason;
use retrace_link::GearState;

use crate::keys::KeyAction;
use crate::model::ScreenModel;
use crate::status_hint::{HintLevel, StatusHint, hint};

/// Status in a thread or a tap; `None` elsewhere.
pub(crate) fn of(model: &ScreenModel) -> Option<StatusHint> {
    let modes = [Mode::Run, Mode::Reverse, Mode::Forward, Mode::Rejoin];
    if model.spindle.gear != GearState::Engaged || model.pause.is_some() || !modes.contains(&model.mode) {
        return None;
    }
    let is_held = model.hold_reason == HoldReason::Hold;
    match (is_held, model.mode) {
        (true, _) => Some(held(model)),
        (false, Mode::Run) if model.hold_reason != HoldReason::None => None,
        (false, mode) => Some(moving(model, mode)),
    }
}

/// Whether this is a tap, and whether it can be reversed.
fn kind(model: &ScreenModel) -> (bool, bool) {
    let is_tap = model.switching.is_some();
    let can_reverse = model.facts.encoder.is_some_and(|encoder| match is_tap {
        true => encoder.reverses_taps,
        false => encoder.holds_in_thread && encoder.is_reversible,
    });
    (is_tap, can_reverse)
}

fn moving(model: &ScreenModel, mode: Mode) -> StatusHint {
    let (is_tap, can_reverse) = kind(model);
    let (word, why) = match (mode, is_tap) {
        (Mode::Reverse, _) => ("REVERSE", "in a thread: the spindle turns back, and the tool with it"),
        (Mode::Forward, _) => ("FORWARD", "in a thread: follows the spindle"),
        (Mode::Rejoin, _) => ("RETURNING", "in a thread: follows the spindle"),
        (_, true) => ("RUNNING", "tapping: follows the spindle"),
        (_, false) => ("RUNNING", "in a thread: follows the spindle"),
    };
    let mut actions = vec![KeyAction::Hold];
    match mode {
        Mode::Reverse => actions.push(KeyAction::Forward),
        _ if can_reverse => actions.push(KeyAction::Reverse),
        _ => {}
    }
    if mode == Mode::Run {
        actions.push(KeyAction::Single);
    }
    actions.push(KeyAction::Quit);
    hint(HintLevel::Normal, word, why, &actions)
}

fn held(model: &ScreenModel) -> StatusHint {
    let (is_tap, can_reverse) = kind(model);
    let stays = is_tap || model.facts.encoder.is_some_and(|encoder| encoder.holds_in_thread);
    let why = match (model.at_rest, is_tap) {
        (false, true) => "feed hold: the spindle stops, the tap rests in the hole",
        (false, false) if stays => "feed hold: the spindle stops, the tool rests in the thread",
        (false, false) => "feed hold: finishing the thread",
        (true, true) => "the tap rests in the hole; cycle start goes on",
        (true, false) => "the tool rests in the thread; cycle start goes on",
    };
    let mut actions = vec![KeyAction::CycleStart];
    if can_reverse {
        actions.push(KeyAction::Reverse);
    }
    if stays && model.at_rest {
        actions.push(KeyAction::FollowSpindle);
    }
    actions.push(KeyAction::Quit);
    let word = match (model.at_rest, model.follows_spindle) {
        (false, false) => "STOPPING",
        (_, true) => "BY HAND",
        (true, false) => "FEED HOLD",
    };
    let why = if model.follows_spindle { "turn the spindle by hand: the axes follow it" } else { why };
    hint(HintLevel::Waiting, word, why, &actions)
}
