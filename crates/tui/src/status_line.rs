//! Status line: what the machine is doing, why it waits, and which keys apply, in words for an untrained operator.
//!
//! Invariant: every key that the line names has a function in this situation.

use retrace_core::Place;
use retrace_core::mode::Mode;
use retrace_journal::HoldReason;

use crate::cut_text::{confirmation_text, contours_text, interrupted_text, is_sensing, start_in_hold, start_text};
use crate::event_text::tool_change_text;
use crate::geared_status;
use crate::keys::KeyAction;
use crate::model::{AxisHoming, Pause, ScreenModel, ScreenStage};
use crate::program_facts::ProgramCheck;
use crate::sheet_text;
use crate::status_hint::{HintLevel, StatusHint, hint};

/// Returns the status of the machine.
#[must_use]
pub(crate) fn of(model: &ScreenModel) -> StatusHint {
    if let Some(alarm) = &model.alarm {
        if alarm.is_refusal {
            return hint(
                HintLevel::Waiting,
                "REFUSED",
                alarm.cause.as_str(),
                &[KeyAction::ClearAlarm, KeyAction::Messages, KeyAction::Quit],
            );
        }
        let why = format!("{}: {}", alarm.number, alarm.cause);
        return hint(HintLevel::Alarm, "ALARM", why, &[KeyAction::ClearAlarm, KeyAction::Messages, KeyAction::Quit]);
    }
    match &model.stage {
        ScreenStage::Setup => setup(model),
        ScreenStage::Resuming => resuming(model),
        ScreenStage::Ended(how) => {
            let actions = [
                KeyAction::Quit,
                KeyAction::CycleStart,
                KeyAction::SetUp,
                KeyAction::OpenProgram,
                KeyAction::Messages,
                KeyAction::View,
                KeyAction::Tools,
            ];
            hint(HintLevel::Waiting, "ENDED", how, &actions)
        }
        ScreenStage::Job if model.is_stopping => {
            hint(HintLevel::Normal, "STOPPING", "the job is being stopped and recorded", &[KeyAction::Messages])
        }
        ScreenStage::Job => geared_status::of(model).unwrap_or_else(|| match (model.pause, model.mode) {
            (Some(pause), _) => paused(model, pause),
            (None, Mode::Run) => normal(model),
            (None, mode) => retracing(model, mode),
        }),
    }
}

fn setup(model: &ScreenModel) -> StatusHint {
    if !model.at_rest {
        let what = model.manual_task.unwrap_or("manual motion");
        return hint(HintLevel::Normal, "MOVING", format!("{what}; Space stops it"), &[KeyAction::Hold]);
    }
    // An order is carried out without motion, or its end is being recorded: the next one is refused until then.
    if let Some(what) = model.manual_task {
        return hint(HintLevel::Normal, "BUSY", format!("{what}; Space stops it"), &[KeyAction::Hold]);
    }
    let rest = [
        KeyAction::Jog,
        KeyAction::Step,
        KeyAction::Mdi,
        KeyAction::WorkZero,
        KeyAction::DryRun,
        KeyAction::Probe,
        KeyAction::OpenProgram,
        KeyAction::Tools,
        KeyAction::Output,
        KeyAction::Quit,
    ];
    let of_cutter = [KeyAction::SheetEdge, KeyAction::Frame, KeyAction::Outline, KeyAction::Contours];
    let mut actions = if model.homed { vec![KeyAction::CycleStart] } else { Vec::new() };
    if !model.homed || model.homing.iter().any(|of| *of != AxisHoming::NotNeeded) {
        actions.push(KeyAction::Home);
    }
    if model.homed && !model.facts.cutters.is_empty() {
        let (first, last) = rest.split_at(3);
        actions.extend(first.iter().chain(&of_cutter).chain(last));
    } else {
        actions.extend(rest);
    }
    if !model.homed {
        return hint(HintLevel::Waiting, "NOT HOMED", "the machine position is not known", &actions);
    }
    if !model.sheet_points.is_empty() {
        let actions = [KeyAction::SheetEdge, KeyAction::Jog, KeyAction::Step, KeyAction::Output, KeyAction::Quit];
        return hint(HintLevel::Waiting, "SHEET EDGE", sheet_text::with_keys(model), &actions);
    }
    let name = &model.facts.program.name;
    match &model.facts.check {
        ProgramCheck::NotLoaded => {
            actions[0] = KeyAction::OpenProgram;
            return hint(HintLevel::Waiting, "NO PROGRAM", "load a program, or set up the machine", &actions);
        }
        ProgramCheck::Failed(why) => {
            let first = why.first().map_or("", String::as_str);
            actions = vec![
                KeyAction::Messages,
                KeyAction::WorkZero,
                KeyAction::Jog,
                KeyAction::Step,
                KeyAction::Mdi,
                KeyAction::OpenProgram,
                KeyAction::CycleStart,
            ];
            actions.extend([KeyAction::Home, KeyAction::Output, KeyAction::Quit]);
            return hint(HintLevel::Waiting, "NOT READY", first, &actions);
        }
        _ => {}
    }
    let why = match (model.dry_run, &model.facts.check) {
        (true, _) => format!("{name}, DRY RUN: the cutter stays off"),
        (false, ProgramCheck::Checking) => format!("{name} is being checked"),
        (false, _) => format!("{name} is ready"),
    };
    let why = match model.contours.skipped().count() {
        0 => why,
        1 => format!("{why}, 1 contour will be skipped"),
        count => format!("{why}, {count} contours will be skipped"),
    };
    let why = match model.work_rotation_deg {
        0.0 => why,
        degrees => format!("{why}, TURNED by {degrees:+.3}° about the work zero"),
    };
    let why = if model.tool_is_down { format!("the tool is DOWN: PgUp raises it; {why}") } else { why };
    let why = if model.manual_result.is_empty() { why } else { format!("{}; {why}", model.manual_result) };
    hint(HintLevel::Waiting, "READY", why, &actions)
}

fn resuming(model: &ScreenModel) -> StatusHint {
    match &model.question {
        Some(question) => {
            let actions = [KeyAction::Agree, KeyAction::Decline, KeyAction::View, KeyAction::Quit];
            hint(HintLevel::Waiting, "RESUME", question.title.as_str(), &actions)
        }
        None => hint(HintLevel::Normal, "RESUMING", "planning up to the breakpoint; nothing moves", &[KeyAction::Quit]),
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
    match model.hold_reason {
        HoldReason::Hold if !model.at_rest && model.lost_cutter.is_some() => {
            let name = model.lost_cutter.map(|channel| model.facts.output_name(channel)).unwrap_or_default();
            hint(HintLevel::Waiting, "STOPPING", format!("{name} went out: braking on the path, then k"), &[])
        }
        HoldReason::Hold if !model.at_rest => {
            hint(HintLevel::Waiting, "STOPPING", "feed hold: braking on the path", &held)
        }
        HoldReason::Hold if model.cutter_is_off => {
            let actions = [
                KeyAction::Recover,
                KeyAction::CycleStart,
                KeyAction::BackToCutEnd,
                KeyAction::Shift,
                KeyAction::Reverse,
                KeyAction::Wheel,
                KeyAction::BackBy,
                KeyAction::Quit,
            ];
            match model.cut_end_line {
                Some(line) => hint(HintLevel::Waiting, "CUT INTERRUPTED", interrupted_text(model, line), &actions),
                None => {
                    let text = "the cutter is off; c asks before it restarts, k restarts it";
                    hint(HintLevel::Waiting, "FEED HOLD", text, &actions)
                }
            }
        }
        HoldReason::Hold if is_sensing(model) => {
            let text = "held on the way DOWN to the sheet: c goes on to sense it and FIRES; q stops";
            hint(HintLevel::Waiting, "FEED HOLD", text, &held)
        }
        HoldReason::Hold => match start_in_hold(model) {
            // The start is one instruction, which ends before the hold puts the cutter out.
            Some(start) => {
                let mut actions = vec![KeyAction::CutterOff];
                actions.extend(held);
                hint(
                    HintLevel::Waiting,
                    "FEED HOLD",
                    format!("{start}: its start GOES ON to its end; x ends it"),
                    &actions,
                )
            }
            None => hint(HintLevel::Waiting, "FEED HOLD", "held by the operator", &held),
        },
        HoldReason::ProgramStop => match model.tool_change {
            Some(tool) => hint(HintLevel::Waiting, "TOOL CHANGE", tool_change_text(model, tool), &held),
            None => hint(HintLevel::Waiting, "PROGRAM STOP", "stopped by the program", &held),
        },
        HoldReason::SingleBlock => hint(HintLevel::Waiting, "SINGLE BLOCK", "at the end of a block", &held),
        HoldReason::Ended => {
            let actions = [
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
            let text = format!("program completed{}; c RUNS IT AGAIN", contours_text(model));
            hint(HintLevel::Waiting, "ENDED", text, &actions)
        }
        HoldReason::Paused => {
            hint(HintLevel::Waiting, "PAUSED", "at the breakpoint", &[KeyAction::CycleStart, KeyAction::Quit])
        }
        HoldReason::None => match model.switching.or(model.restarting) {
            Some(code) => {
                let start = start_text(model);
                let why = start.unwrap_or_else(|| format!("waiting for {code} to complete"));
                hint(HintLevel::Normal, "RUNNING", why, &running)
            }
            None => match model.stalled_source() {
                Some((source, seconds)) if model.at_rest => {
                    let why = format!("waiting for {source}, {seconds:.0} s so far");
                    hint(HintLevel::Waiting, "WAITING", why, &running)
                }
                _ if model.starved => {
                    hint(HintLevel::Normal, "RUNNING", "slowed down: the program arrives too slowly", &running)
                }
                _ if model.at_rest => {
                    hint(HintLevel::Normal, "RUNNING", "at rest until more path is planned", &running)
                }
                _ => {
                    // A start in motion, over the kerf that was cut.
                    let why = start_text(model).map(|start| format!("{start} in motion"));
                    hint(HintLevel::Normal, "RUNNING", why.unwrap_or_else(|| "executing the program".into()), &running)
                }
            },
        },
    }
}

fn retracing(model: &ScreenModel, mode: Mode) -> StatusHint {
    if !model.differing_outputs.is_empty() {
        let mut actions =
            vec![KeyAction::Agree, KeyAction::Reverse, KeyAction::Wheel, KeyAction::Output, KeyAction::Quit];
        let mut why = "from the state that the program expects here";
        if model.cut_end_line.is_some() {
            why = confirmation_text(model);
            actions.insert(0, KeyAction::Recover);
        }
        return hint(HintLevel::Waiting, "OUTPUTS DIFFER", why, &actions);
    }
    let back = format!("{:.1} mm back", model.back_mm());
    let at_oldest = model.at_rest && model.place == Place::start_of(model.oldest);
    let at_reached = model.at_rest && model.place == Place::start_of(model.reached);
    let mut at_rest = vec![
        KeyAction::Leave,
        KeyAction::LeaveAsk,
        KeyAction::Forward,
        KeyAction::Reverse,
        KeyAction::Wheel,
        KeyAction::BackBy,
        KeyAction::Output,
        KeyAction::Quit,
    ];
    let stands = match model.cut_end_line {
        Some(line) => {
            at_rest.insert(0, KeyAction::CutFromHere);
            format!("{back}; the cut ends in line {line}, K FIRES and cuts on")
        }
        None => {
            if !model.facts.cutters.is_empty() {
                at_rest.insert(3, KeyAction::CutFromHere);
            }
            back.clone()
        }
    };
    match mode {
        _ if model.hold_reason == HoldReason::Hold => {
            let actions = [
                KeyAction::CycleStart,
                KeyAction::Leave,
                KeyAction::Forward,
                KeyAction::Reverse,
                KeyAction::Wheel,
                KeyAction::Output,
                KeyAction::Quit,
            ];
            let word = if model.at_rest { "FEED HOLD" } else { "STOPPING" };
            hint(HintLevel::Waiting, word, format!("held while retracing, {back}"), &actions)
        }
        Mode::Wheel => {
            let why = match (at_oldest, at_reached) {
                (true, _) => "at the start of the history".into(),
                (_, true) => "arrows or mouse wheel; at the furthest place".into(),
                _ => format!("arrows or mouse wheel; {back}"),
            };
            let actions = [
                KeyAction::Turn,
                KeyAction::Leave,
                KeyAction::LeaveAsk,
                KeyAction::Forward,
                KeyAction::Reverse,
                KeyAction::Output,
                KeyAction::Quit,
            ];
            hint(HintLevel::Waiting, "HANDWHEEL", why, &actions)
        }
        Mode::Rejoin if !model.at_rest => hint(
            HintLevel::Normal,
            "RETURNING",
            format!("{back}, then the program resumes"),
            &[KeyAction::Hold, KeyAction::Reverse],
        ),
        Mode::Rejoin | Mode::AwaitOutputs => {
            let actions = [KeyAction::Leave, KeyAction::Reverse, KeyAction::Wheel, KeyAction::Quit];
            let why = model
                .restarting
                .map(|code| start_text(model).unwrap_or_else(|| format!("waiting for {code} to complete")));
            hint(HintLevel::Waiting, "RETURNING", why.unwrap_or_else(|| format!("at rest; {back}")), &actions)
        }
        Mode::Reverse if model.at_cutter_boundary => {
            let actions = [
                KeyAction::CutterOff,
                KeyAction::Reverse,
                KeyAction::Forward,
                KeyAction::Leave,
                KeyAction::Wheel,
                KeyAction::Quit,
            ];
            hint(HintLevel::Waiting, "CUTTER ON", "the program switched the cutter here; it is still on", &actions)
        }
        Mode::Reverse if at_oldest => {
            hint(HintLevel::Waiting, "REVERSE", format!("at the start of the history, {back}"), &at_rest)
        }
        Mode::Forward if at_reached => hint(HintLevel::Waiting, "FORWARD", "at the furthest place", &at_rest),
        _ if model.at_rest => hint(HintLevel::Waiting, "AT REST", stands, &at_rest),
        Mode::Forward => {
            let actions = [
                KeyAction::Hold,
                KeyAction::Reverse,
                KeyAction::Leave,
                KeyAction::Wheel,
                KeyAction::ForwardRapid,
                KeyAction::Output,
                KeyAction::Quit,
            ];
            hint(HintLevel::Normal, "FORWARD", back, &actions)
        }
        _ => {
            let actions = [
                KeyAction::Hold,
                KeyAction::Forward,
                KeyAction::Leave,
                KeyAction::Wheel,
                KeyAction::ReverseRapid,
                KeyAction::Output,
                KeyAction::BackJet,
                KeyAction::Quit,
            ];
            let why = if model.recovering { format!("recovering the cut, {back} from where it stood") } else { back };
            hint(HintLevel::Normal, "REVERSE", why, &actions)
        }
    }
}

/// Steps of a pause (DNC-1 … DNC-6): text, action, and whether the step is done.
#[must_use]
pub(crate) fn steps(pause: Pause) -> Vec<(&'static str, KeyAction, bool)> {
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
    if model.hold_reason != HoldReason::Paused {
        return hint(
            HintLevel::Normal,
            "APPROACHING",
            "returning to the breakpoint",
            &[KeyAction::Hold, KeyAction::Quit],
        );
    }
    let steps = steps(pause);
    let next = steps.iter().position(|&(_, _, done)| !done).unwrap_or(0);
    let (what, act, _) = steps.get(next).copied().unwrap_or(("resume", KeyAction::CycleStart, false));
    let why = format!("step {} of {}: {what}", next + 1, steps.len());
    let mut actions = vec![act];
    // While the tool is free, the following step is available too.
    if act == KeyAction::Jog {
        actions.push(if pause.spindle != 0 { KeyAction::Spindle } else { KeyAction::Online });
    }
    for act in [
        KeyAction::Jog,
        KeyAction::Step,
        KeyAction::Spindle,
        KeyAction::Online,
        KeyAction::Output,
        KeyAction::Quit,
        KeyAction::ChangeDone,
    ] {
        if !actions.contains(&act) && (act != KeyAction::Spindle || pause.spindle != 0) {
            actions.push(act);
        }
    }
    hint(HintLevel::Waiting, "PAUSED", why, &actions)
}
