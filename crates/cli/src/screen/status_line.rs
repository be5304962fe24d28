//! Status line: what the machine is doing, why it waits, and which keys apply, in words for an untrained operator.
//!
//! Invariant: every key that the line names has a function in this situation.

use retrace_controller::telemetry::HoldReason;
use retrace_core::Place;
use retrace_core::mode::Mode;

use super::event_text::tool_change_words;
use super::key_state::KeyState;
use super::keys::KeyAction;
use super::model::{Pause, ScreenModel, ScreenStage};
use super::program_facts::ProgramCheck;

/// Severity of a status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HintLevel {
    /// Normal operation.
    Well,
    /// Waits for the operator.
    Waits,
    /// Alarm.
    Alarm,
}

/// Status of the machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StatusHint {
    /// Status in a word or two.
    pub word: &'static str,
    /// Reason, in one line.
    pub why: String,
    /// Severity.
    pub grade: HintLevel,
    /// Actions that apply, the most useful first.
    pub acts: Vec<KeyAction>,
}

fn guide(grade: HintLevel, word: &'static str, why: impl Into<String>, acts: &[KeyAction]) -> StatusHint {
    StatusHint { word, why: why.into(), grade, acts: acts.to_vec() }
}

/// Returns the status of the machine.
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
        return guide(HintLevel::Well, "MOVING", "manual motion; Space stops it", &[KeyAction::Hold]);
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
        return guide(HintLevel::Waits, "NOT HOMED", "the machine position is not known", &acts);
    }
    let name = &model.facts.program.name;
    match &model.facts.check {
        ProgramCheck::NotLoaded => {
            acts[0] = KeyAction::OpenProgram;
            return guide(HintLevel::Waits, "NO PROGRAM", "load a program, or set up the machine", &acts);
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
            guide(HintLevel::Waits, "FEED HOLD", "the cutter is off; c asks before it restarts, k restarts it", &acts)
        }
        HoldReason::Hold => guide(HintLevel::Waits, "FEED HOLD", "held by the operator", &held),
        HoldReason::ProgramStop => match model.tool_change {
            Some(tool) => guide(HintLevel::Waits, "TOOL CHANGE", tool_change_words(model, tool), &held),
            None => guide(HintLevel::Waits, "PROGRAM STOP", "stopped by the program", &held),
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
            Some(code) => guide(HintLevel::Well, "RUNNING", format!("waiting for {code} to complete"), &running),
            None => match model.waits_for() {
                Some((source, seconds)) if model.at_rest => {
                    let why = format!("waiting for {source}, {seconds:.0} s so far");
                    guide(HintLevel::Waits, "WAITING", why, &running)
                }
                _ if model.short => {
                    guide(HintLevel::Well, "RUNNING", "slowed down: the program arrives too slowly", &running)
                }
                _ if model.at_rest => guide(HintLevel::Well, "RUNNING", "at rest until more path is planned", &running),
                _ => guide(HintLevel::Well, "RUNNING", "executing the program", &running),
            },
        },
    }
}

fn retracing(model: &ScreenModel, mode: Mode) -> StatusHint {
    if !model.differ.is_empty() {
        let acts = [KeyAction::Agree, KeyAction::Reverse, KeyAction::Wheel, KeyAction::Output, KeyAction::Quit];
        return guide(HintLevel::Waits, "OUTPUTS DIFFER", "from the state that the program expects here", &acts);
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
                (true, _) => "at the start of the history".into(),
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
            format!("{back}, then the program resumes"),
            &[KeyAction::Hold, KeyAction::Reverse],
        ),
        Mode::Rejoin | Mode::AwaitOutputs => {
            let acts = [KeyAction::Leave, KeyAction::Reverse, KeyAction::Wheel, KeyAction::Quit];
            guide(HintLevel::Waits, "RETURNING", format!("at rest; {back}"), &acts)
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
            guide(HintLevel::Waits, "CUTTER ON", "the program switched the cutter here; it is still on", &acts)
        }
        Mode::Reverse if at_oldest => {
            guide(HintLevel::Waits, "REVERSE", format!("at the start of the history, {back}"), &standing)
        }
        Mode::Forward if at_reached => guide(HintLevel::Waits, "FORWARD", "at the furthest place", &standing),
        _ if model.at_rest => guide(HintLevel::Waits, "AT REST", back, &standing),
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

/// Steps of a pause (DNC-1 … DNC-6): text, action, and whether the step is done.
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
    steps.push(("back to on-line mode", KeyAction::Online, pause.online));
    steps.push(("return and resume", KeyAction::CycleStart, false));
    steps
}

fn paused(model: &ScreenModel, pause: Pause) -> StatusHint {
    if model.standing != HoldReason::Paused {
        return guide(
            HintLevel::Well,
            "APPROACHING",
            "returning to the breakpoint",
            &[KeyAction::Hold, KeyAction::Quit],
        );
    }
    let steps = steps(pause);
    let next = steps.iter().position(|&(_, _, done)| !done).unwrap_or(0);
    let (what, act, _) = steps.get(next).copied().unwrap_or(("resume", KeyAction::CycleStart, false));
    let why = format!("step {} of {}: {what}", next + 1, steps.len());
    let mut acts = vec![act];
    // While the tool is free, the following step is available too.
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
