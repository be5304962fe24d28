//! What the machine is doing, in words for somebody who has never seen it: why it stands, and which key goes on.
//!
//! Invariant: every key that is named does something in this situation.

use retrace_controller::telemetry::HoldReason;
use retrace_core::Place;
use retrace_core::mode::Mode;

use super::event_text::tool_change_words;
use super::key_state::KeyState;
use super::keys::KeyAction;
use super::model::{Pause, ScreenModel, ScreenStage};
use super::program_facts::ProgramCheck;

/// How grave it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HintLevel {
    /// It goes its way.
    Well,
    /// It waits for the operator.
    Waits,
    /// An alarm.
    Alarm,
}

/// What the machine is doing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StatusHint {
    /// In a word or two.
    pub word: &'static str,
    /// In a line.
    pub why: String,
    /// How grave it is.
    pub grade: HintLevel,
    /// What goes on from here, the most useful first.
    pub acts: Vec<KeyAction>,
}

fn guide(grade: HintLevel, word: &'static str, why: impl Into<String>, acts: &[KeyAction]) -> StatusHint {
    StatusHint { word, why: why.into(), grade, acts: acts.to_vec() }
}

/// Says what the machine is doing.
#[must_use]
pub fn of(model: &ScreenModel, hand: &KeyState) -> StatusHint {
    if let Some(alarm) = &model.alarm {
        if alarm.is_refusal {
            return guide(
                HintLevel::Waits,
                "REFUSED",
                alarm.cause.as_str(),
                &[KeyAction::ClearAlarm, KeyAction::Messages, KeyAction::Quit],
            );
        }
        let why = format!("{}: {}", alarm.number, alarm.cause);
        return guide(HintLevel::Alarm, "ALARM", why, &[KeyAction::ClearAlarm, KeyAction::Messages, KeyAction::Quit]);
    }
    match &model.stage {
        ScreenStage::Setup => setup(model, hand),
        ScreenStage::Resuming => resuming(model),
        ScreenStage::Ended(how) => {
            let acts = [
                KeyAction::Quit,
                KeyAction::CycleStart,
                KeyAction::SetUp,
                KeyAction::OpenProgram,
                KeyAction::Messages,
                KeyAction::View,
                KeyAction::Tools,
            ];
            guide(HintLevel::Waits, "ENDED", how, &acts)
        }
        ScreenStage::Job => match (model.pause, model.mode) {
            (Some(pause), _) => paused(model, pause),
            (None, Mode::Run) => normal(model),
            (None, mode) => retracing(model, mode),
        },
    }
}

fn setup(model: &ScreenModel, hand: &KeyState) -> StatusHint {
    if !model.at_rest {
        return guide(HintLevel::Well, "MOVING", "by hand; Space stops it", &[KeyAction::Hold]);
    }
    let rest = [
        KeyAction::Jog,
        KeyAction::Step,
        KeyAction::Mdi,
        KeyAction::WorkZero,
        KeyAction::DryRun,
        KeyAction::OpenProgram,
        KeyAction::Tools,
        KeyAction::Output,
        KeyAction::Quit,
    ];
    let mut acts = if model.homed { vec![KeyAction::CycleStart, KeyAction::Home] } else { vec![KeyAction::Home] };
    acts.extend(rest);
    if !model.homed {
        return guide(HintLevel::Waits, "NOT HOMED", "the machine does not know where it is", &acts);
    }
    let name = &model.facts.program.name;
    match &model.facts.check {
        ProgramCheck::NotLoaded => {
            acts[0] = KeyAction::OpenProgram;
            return guide(HintLevel::Waits, "NO PROGRAM", "the machine can be set up", &acts);
        }
        ProgramCheck::Refused(why) => {
            let first = why.first().map_or("", String::as_str);
            acts = vec![
                KeyAction::Messages,
                KeyAction::WorkZero,
                KeyAction::Jog,
                KeyAction::Step,
                KeyAction::Mdi,
                KeyAction::OpenProgram,
                KeyAction::CycleStart,
            ];
            acts.extend([KeyAction::Home, KeyAction::Output, KeyAction::Quit]);
            return guide(HintLevel::Waits, "NOT READY", first, &acts);
        }
        _ => {}
    }
    let why = match (hand.dry, &model.facts.check) {
        (true, _) => format!("{name}, DRY RUN: the cutter stays off"),
        (false, ProgramCheck::Checking) => format!("{name} is being checked"),
        (false, _) => format!("{name} is ready"),
    };
    guide(HintLevel::Waits, "READY", why, &acts)
}

fn resuming(model: &ScreenModel) -> StatusHint {
    match &model.question {
        Some(question) => {
            let acts = [KeyAction::Agree, KeyAction::Decline, KeyAction::View, KeyAction::Quit];
            guide(HintLevel::Waits, "RESUME", question.title.as_str(), &acts)
        }
        None => guide(HintLevel::Well, "RESUMING", "planning up to the breakpoint; nothing moves", &[KeyAction::Quit]),
    }
}

fn normal(model: &ScreenModel) -> StatusHint {
    let held = [
        KeyAction::CycleStart,
        KeyAction::Reverse,
        KeyAction::Wheel,
        KeyAction::BackBy,
        KeyAction::Pause,
        KeyAction::Output,
        KeyAction::Quit,
    ];
    let running = [
        KeyAction::Hold,
        KeyAction::Reverse,
        KeyAction::Wheel,
        KeyAction::Slower,
        KeyAction::Faster,
        KeyAction::Single,
        KeyAction::BackBy,
        KeyAction::Pause,
        KeyAction::Quit,
    ];
    match model.standing {
        HoldReason::Hold if !model.at_rest => {
            guide(HintLevel::Waits, "STOPPING", "feed hold: braking on the path", &held)
        }
        HoldReason::Hold if model.cutter_is_out => {
            let acts = [
                KeyAction::CycleStart,
                KeyAction::Recover,
                KeyAction::Reverse,
                KeyAction::Wheel,
                KeyAction::BackBy,
                KeyAction::Quit,
            ];
            guide(HintLevel::Waits, "FEED HOLD", "the cutter is off; c asks before it starts again, k does not", &acts)
        }
        HoldReason::Hold => guide(HintLevel::Waits, "FEED HOLD", "held by the operator", &held),
        HoldReason::ProgramStop => match model.tool_change {
            Some(tool) => guide(HintLevel::Waits, "TOOL CHANGE", tool_change_words(model, tool), &held),
            None => guide(HintLevel::Waits, "PROGRAM STOP", "the program asked for a stop", &held),
        },
        HoldReason::SingleBlock => guide(HintLevel::Waits, "SINGLE BLOCK", "at the end of a block", &held),
        HoldReason::Ended => {
            let acts = [
                KeyAction::Quit,
                KeyAction::Reverse,
                KeyAction::SetUp,
                KeyAction::Wheel,
                KeyAction::BackBy,
                KeyAction::BackJet,
                KeyAction::CycleStart,
                KeyAction::OpenProgram,
                KeyAction::Output,
            ];
            guide(HintLevel::Waits, "ENDED", "program completed; reverse run is still possible", &acts)
        }
        HoldReason::Paused => {
            guide(HintLevel::Waits, "PAUSED", "at the breakpoint", &[KeyAction::CycleStart, KeyAction::Quit])
        }
        HoldReason::None => match model.switching {
            Some(code) => guide(HintLevel::Well, "RUNNING", format!("waits until {code} is done"), &running),
            None => match model.waits_for() {
                Some((source, seconds)) if model.at_rest => {
                    let why = format!("waiting for {source} since {seconds:.0} s");
                    guide(HintLevel::Waits, "WAITING", why, &running)
                }
                _ if model.short => {
                    guide(HintLevel::Well, "RUNNING", "slowed down: the program comes too slowly", &running)
                }
                _ if model.at_rest => guide(HintLevel::Well, "RUNNING", "stands until more is planned", &running),
                _ => guide(HintLevel::Well, "RUNNING", "along the program", &running),
            },
        },
    }
}

fn retracing(model: &ScreenModel, mode: Mode) -> StatusHint {
    if !model.differ.is_empty() {
        let acts = [KeyAction::Agree, KeyAction::Reverse, KeyAction::Wheel, KeyAction::Output, KeyAction::Quit];
        return guide(HintLevel::Waits, "OUTPUTS DIFFER", "from what the program had here", &acts);
    }
    let back = format!("{:.1} mm back", model.back_mm());
    let at_oldest = model.at_rest && model.place == Place::start_of(model.oldest);
    let at_reached = model.at_rest && model.place == Place::start_of(model.reached);
    let standing = [
        KeyAction::Leave,
        KeyAction::LeaveAsk,
        KeyAction::Forward,
        KeyAction::Reverse,
        KeyAction::Wheel,
        KeyAction::BackBy,
        KeyAction::Output,
        KeyAction::Quit,
    ];
    match mode {
        _ if model.standing == HoldReason::Hold => {
            let acts = [
                KeyAction::CycleStart,
                KeyAction::Leave,
                KeyAction::Forward,
                KeyAction::Reverse,
                KeyAction::Wheel,
                KeyAction::Output,
                KeyAction::Quit,
            ];
            let word = if model.at_rest { "FEED HOLD" } else { "STOPPING" };
            guide(HintLevel::Waits, word, format!("held while retracing, {back}"), &acts)
        }
        Mode::Wheel => {
            let why = match (at_oldest, at_reached) {
                (true, _) => "at the oldest place: no further back".into(),
                (_, true) => "arrows or mouse wheel; at the furthest place".into(),
                _ => format!("arrows or mouse wheel; {back}"),
            };
            let acts = [
                KeyAction::Turn,
                KeyAction::Leave,
                KeyAction::LeaveAsk,
                KeyAction::Forward,
                KeyAction::Reverse,
                KeyAction::Output,
                KeyAction::Quit,
            ];
            guide(HintLevel::Waits, "HANDWHEEL", why, &acts)
        }
        Mode::Rejoin if !model.at_rest => guide(
            HintLevel::Well,
            "RETURNING",
            format!("{back}, then on with the program"),
            &[KeyAction::Hold, KeyAction::Reverse],
        ),
        Mode::Rejoin | Mode::AwaitOutputs => {
            let acts = [KeyAction::Leave, KeyAction::Reverse, KeyAction::Wheel, KeyAction::Quit];
            guide(HintLevel::Waits, "RETURNING", format!("stands; {back}"), &acts)
        }
        Mode::Reverse if model.at_cutter_boundary => {
            let acts = [
                KeyAction::CutterOff,
                KeyAction::Reverse,
                KeyAction::Forward,
                KeyAction::Leave,
                KeyAction::Wheel,
                KeyAction::Quit,
            ];
            guide(HintLevel::Waits, "CUTTER ON", "the program switched the cutter here, and it is on", &acts)
        }
        Mode::Reverse if at_oldest => {
            guide(HintLevel::Waits, "REVERSE", format!("at the oldest place, {back}: no further"), &standing)
        }
        Mode::Forward if at_reached => guide(HintLevel::Waits, "FORWARD", "at the furthest place", &standing),
        _ if model.at_rest => guide(HintLevel::Waits, "STANDING", back, &standing),
        Mode::Forward => {
            let acts = [
                KeyAction::Hold,
                KeyAction::Reverse,
                KeyAction::Leave,
                KeyAction::Wheel,
                KeyAction::ForwardRapid,
                KeyAction::Output,
                KeyAction::Quit,
            ];
            guide(HintLevel::Well, "FORWARD", back, &acts)
        }
        _ => {
            let acts = [
                KeyAction::Hold,
                KeyAction::Forward,
                KeyAction::Leave,
                KeyAction::Wheel,
                KeyAction::ReverseRapid,
                KeyAction::Output,
                KeyAction::BackJet,
                KeyAction::Quit,
            ];
            guide(HintLevel::Well, "REVERSE", back, &acts)
        }
    }
}

/// The steps of a pause, and which of them comes next (DNC-1 … DNC-6): what it is called, its act, is it done?
#[must_use]
pub fn steps(pause: Pause) -> Vec<(&'static str, KeyAction, bool)> {
    let mut steps = Vec::new();
    if pause.spindle != 0 {
        steps.push(("stop the spindle", KeyAction::Spindle, pause.stopped));
    }
    steps.push(("move away, do the work", KeyAction::Jog, pause.started && pause.spindle != 0 || pause.online));
    if pause.spindle != 0 {
        steps.push(("start the spindle", KeyAction::Spindle, pause.started));
    }
    steps.push(("back on line", KeyAction::Online, pause.online));
    steps.push(("to the breakpoint, on", KeyAction::CycleStart, false));
    steps
}

fn paused(model: &ScreenModel, pause: Pause) -> StatusHint {
    if model.standing != HoldReason::Paused {
        return guide(
            HintLevel::Well,
            "APPROACHING",
            "on the way back to the breakpoint",
            &[KeyAction::Hold, KeyAction::Quit],
        );
    }
    let steps = steps(pause);
    let next = steps.iter().position(|&(_, _, done)| !done).unwrap_or(0);
    let (what, act, _) = steps.get(next).copied().unwrap_or(("go on", KeyAction::CycleStart, false));
    let why = format!("step {} of {}: {what}", next + 1, steps.len());
    let mut acts = vec![act];
    // Where the tool is free, what comes after is open as well.
    if act == KeyAction::Jog {
        acts.push(if pause.spindle != 0 { KeyAction::Spindle } else { KeyAction::Online });
    }
    for act in
        [KeyAction::Jog, KeyAction::Step, KeyAction::Spindle, KeyAction::Online, KeyAction::Output, KeyAction::Quit]
    {
        if !acts.contains(&act) && (act != KeyAction::Spindle || pause.spindle != 0) {
            acts.push(act);
        }
    }
    guide(HintLevel::Waits, "PAUSED", why, &acts)
}
