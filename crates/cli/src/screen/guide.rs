//! What the machine is doing, in words for somebody who has never seen it: why it stands, and which key goes on.
//!
//! Invariant: every key that is named does something in this situation.

use retrace_controller::telemetry::HoldReason;
use retrace_core::Place;
use retrace_core::mode::Mode;

use super::event_text::tool_change_words;
use super::facts::ProgramCheck;
use super::hand::Hand;
use super::keys::Act;
use super::model::{Model, Pause, Stage};

/// How grave it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grade {
    /// It goes its way.
    Well,
    /// It waits for the operator.
    Waits,
    /// An alarm.
    Alarm,
}

/// What the machine is doing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Guide {
    /// In a word or two.
    pub word: &'static str,
    /// In a line.
    pub why: String,
    /// How grave it is.
    pub grade: Grade,
    /// What goes on from here, the most useful first.
    pub acts: Vec<Act>,
}

fn guide(grade: Grade, word: &'static str, why: impl Into<String>, acts: &[Act]) -> Guide {
    Guide { word, why: why.into(), grade, acts: acts.to_vec() }
}

/// Says what the machine is doing.
#[must_use]
pub fn of(model: &Model, hand: &Hand) -> Guide {
    if let Some(alarm) = &model.alarm {
        if alarm.is_refusal {
            return guide(Grade::Waits, "REFUSED", alarm.cause.as_str(), &[Act::ClearAlarm, Act::Messages, Act::Quit]);
        }
        let why = format!("{}: {}", alarm.number, alarm.cause);
        return guide(Grade::Alarm, "ALARM", why, &[Act::ClearAlarm, Act::Messages, Act::Quit]);
    }
    match &model.stage {
        Stage::Setup => setup(model, hand),
        Stage::Resuming => resuming(model),
        Stage::Ended(how) => {
            let acts = [Act::Quit, Act::CycleStart, Act::SetUp, Act::OpenProgram, Act::Messages, Act::View, Act::Tools];
            guide(Grade::Waits, "ENDED", how, &acts)
        }
        Stage::Job => match (model.pause, model.mode) {
            (Some(pause), _) => paused(model, pause),
            (None, Mode::Run) => normal(model),
            (None, mode) => retracing(model, mode),
        },
    }
}

fn setup(model: &Model, hand: &Hand) -> Guide {
    if !model.at_rest {
        return guide(Grade::Well, "MOVING", "by hand; Space stops it", &[Act::Hold]);
    }
    let rest = [
        Act::Jog,
        Act::Step,
        Act::Mdi,
        Act::WorkZero,
        Act::DryRun,
        Act::OpenProgram,
        Act::Tools,
        Act::Output,
        Act::Quit,
    ];
    let mut acts = if model.homed { vec![Act::CycleStart, Act::Home] } else { vec![Act::Home] };
    acts.extend(rest);
    if !model.homed {
        return guide(Grade::Waits, "NOT HOMED", "the machine does not know where it is", &acts);
    }
    let name = &model.facts.program.name;
    match &model.facts.check {
        ProgramCheck::NotLoaded => {
            acts[0] = Act::OpenProgram;
            return guide(Grade::Waits, "NO PROGRAM", "the machine can be set up", &acts);
        }
        ProgramCheck::Refused(why) => {
            let first = why.first().map_or("", String::as_str);
            acts = vec![Act::Messages, Act::WorkZero, Act::Jog, Act::Step, Act::Mdi, Act::OpenProgram, Act::CycleStart];
            acts.extend([Act::Home, Act::Output, Act::Quit]);
            return guide(Grade::Waits, "NOT READY", first, &acts);
        }
        _ => {}
    }
    let why = match (hand.dry, &model.facts.check) {
        (true, _) => format!("{name}, DRY RUN: the cutter stays off"),
        (false, ProgramCheck::Checking) => format!("{name} is being checked"),
        (false, _) => format!("{name} is ready"),
    };
    guide(Grade::Waits, "READY", why, &acts)
}

fn resuming(model: &Model) -> Guide {
    match &model.question {
        Some(question) => {
            let acts = [Act::Agree, Act::Decline, Act::View, Act::Quit];
            guide(Grade::Waits, "RESUME", question.title.as_str(), &acts)
        }
        None => guide(Grade::Well, "RESUMING", "planning up to the breakpoint; nothing moves", &[Act::Quit]),
    }
}

fn normal(model: &Model) -> Guide {
    let held = [Act::CycleStart, Act::Reverse, Act::Wheel, Act::BackBy, Act::Pause, Act::Output, Act::Quit];
    let running = [
        Act::Hold,
        Act::Reverse,
        Act::Wheel,
        Act::Slower,
        Act::Faster,
        Act::Single,
        Act::BackBy,
        Act::Pause,
        Act::Quit,
    ];
    match model.standing {
        HoldReason::Hold if !model.at_rest => guide(Grade::Waits, "STOPPING", "feed hold: braking on the path", &held),
        HoldReason::Hold if model.cutter_is_out => {
            let acts = [Act::CycleStart, Act::Recover, Act::Reverse, Act::Wheel, Act::BackBy, Act::Quit];
            guide(Grade::Waits, "FEED HOLD", "the cutter is off; c asks before it starts again, k does not", &acts)
        }
        HoldReason::Hold => guide(Grade::Waits, "FEED HOLD", "held by the operator", &held),
        HoldReason::ProgramStop => match model.tool_change {
            Some(tool) => guide(Grade::Waits, "TOOL CHANGE", tool_change_words(model, tool), &held),
            None => guide(Grade::Waits, "PROGRAM STOP", "the program asked for a stop", &held),
        },
        HoldReason::SingleBlock => guide(Grade::Waits, "SINGLE BLOCK", "at the end of a block", &held),
        HoldReason::Ended => {
            let acts = [
                Act::Quit,
                Act::Reverse,
                Act::SetUp,
                Act::Wheel,
                Act::BackBy,
                Act::BackJet,
                Act::CycleStart,
                Act::OpenProgram,
                Act::Output,
            ];
            guide(Grade::Waits, "ENDED", "program completed; reverse run is still possible", &acts)
        }
        HoldReason::Paused => guide(Grade::Waits, "PAUSED", "at the breakpoint", &[Act::CycleStart, Act::Quit]),
        HoldReason::None => match model.switching {
            Some(code) => guide(Grade::Well, "RUNNING", format!("waits until {code} is done"), &running),
            None => match model.waits_for() {
                Some((source, seconds)) if model.at_rest => {
                    let why = format!("waiting for {source} since {seconds:.0} s");
                    guide(Grade::Waits, "WAITING", why, &running)
                }
                _ if model.short => {
                    guide(Grade::Well, "RUNNING", "slowed down: the program comes too slowly", &running)
                }
                _ if model.at_rest => guide(Grade::Well, "RUNNING", "stands until more is planned", &running),
                _ => guide(Grade::Well, "RUNNING", "along the program", &running),
            },
        },
    }
}

fn retracing(model: &Model, mode: Mode) -> Guide {
    if !model.differ.is_empty() {
        let acts = [Act::Agree, Act::Reverse, Act::Wheel, Act::Output, Act::Quit];
        return guide(Grade::Waits, "OUTPUTS DIFFER", "from what the program had here", &acts);
    }
    let back = format!("{:.1} mm back", model.back_mm());
    let at_oldest = model.at_rest && model.place == Place::start_of(model.oldest);
    let at_reached = model.at_rest && model.place == Place::start_of(model.reached);
    let standing =
        [Act::Leave, Act::LeaveAsk, Act::Forward, Act::Reverse, Act::Wheel, Act::BackBy, Act::Output, Act::Quit];
    match mode {
        _ if model.standing == HoldReason::Hold => {
            let acts = [Act::CycleStart, Act::Leave, Act::Forward, Act::Reverse, Act::Wheel, Act::Output, Act::Quit];
            let word = if model.at_rest { "FEED HOLD" } else { "STOPPING" };
            guide(Grade::Waits, word, format!("held while retracing, {back}"), &acts)
        }
        Mode::Wheel => {
            let why = match (at_oldest, at_reached) {
                (true, _) => "at the oldest place: no further back".into(),
                (_, true) => "arrows or mouse wheel; at the furthest place".into(),
                _ => format!("arrows or mouse wheel; {back}"),
            };
            let acts = [Act::Turn, Act::Leave, Act::LeaveAsk, Act::Forward, Act::Reverse, Act::Output, Act::Quit];
            guide(Grade::Waits, "HANDWHEEL", why, &acts)
        }
        Mode::Rejoin if !model.at_rest => {
            guide(Grade::Well, "RETURNING", format!("{back}, then on with the program"), &[Act::Hold, Act::Reverse])
        }
        Mode::Rejoin | Mode::AwaitOutputs => {
            let acts = [Act::Leave, Act::Reverse, Act::Wheel, Act::Quit];
            guide(Grade::Waits, "RETURNING", format!("stands; {back}"), &acts)
        }
        Mode::Reverse if model.at_cutter_boundary => {
            let acts = [Act::CutterOff, Act::Reverse, Act::Forward, Act::Leave, Act::Wheel, Act::Quit];
            guide(Grade::Waits, "CUTTER ON", "the program switched the cutter here, and it is on", &acts)
        }
        Mode::Reverse if at_oldest => {
            guide(Grade::Waits, "REVERSE", format!("at the oldest place, {back}: no further"), &standing)
        }
        Mode::Forward if at_reached => guide(Grade::Waits, "FORWARD", "at the furthest place", &standing),
        _ if model.at_rest => guide(Grade::Waits, "STANDING", back, &standing),
        Mode::Forward => {
            let acts = [Act::Hold, Act::Reverse, Act::Leave, Act::Wheel, Act::ForwardRapid, Act::Output, Act::Quit];
            guide(Grade::Well, "FORWARD", back, &acts)
        }
        _ => {
            let acts = [
                Act::Hold,
                Act::Forward,
                Act::Leave,
                Act::Wheel,
                Act::ReverseRapid,
                Act::Output,
                Act::BackJet,
                Act::Quit,
            ];
            guide(Grade::Well, "REVERSE", back, &acts)
        }
    }
}

/// The steps of a pause, and which of them comes next (DNC-1 … DNC-6): what it is called, its act, is it done?
#[must_use]
pub fn steps(pause: Pause) -> Vec<(&'static str, Act, bool)> {
    let mut steps = Vec::new();
    if pause.spindle != 0 {
        steps.push(("stop the spindle", Act::Spindle, pause.stopped));
    }
    steps.push(("move away, do the work", Act::Jog, pause.started && pause.spindle != 0 || pause.online));
    if pause.spindle != 0 {
        steps.push(("start the spindle", Act::Spindle, pause.started));
    }
    steps.push(("back on line", Act::Online, pause.online));
    steps.push(("to the breakpoint, on", Act::CycleStart, false));
    steps
}

fn paused(model: &Model, pause: Pause) -> Guide {
    if model.standing != HoldReason::Paused {
        return guide(Grade::Well, "APPROACHING", "on the way back to the breakpoint", &[Act::Hold, Act::Quit]);
    }
    let steps = steps(pause);
    let next = steps.iter().position(|&(_, _, done)| !done).unwrap_or(0);
    let (what, act, _) = steps.get(next).copied().unwrap_or(("go on", Act::CycleStart, false));
    let why = format!("step {} of {}: {what}", next + 1, steps.len());
    let mut acts = vec![act];
    // Where the tool is free, what comes after is open as well.
    if act == Act::Jog {
        acts.push(if pause.spindle != 0 { Act::Spindle } else { Act::Online });
    }
    for act in [Act::Jog, Act::Step, Act::Spindle, Act::Online, Act::Output, Act::Quit] {
        if !acts.contains(&act) && (act != Act::Spindle || pause.spindle != 0) {
            acts.push(act);
        }
    }
    guide(Grade::Waits, "PAUSED", why, &acts)
}
