//! Events in words for the operator at the screen, without the syntax of scripts.
//!
//! Invariant: an event without words of its own is shown as everywhere else.

use retrace_controller::{DncStep, Event, EventKind, HeightCommand, OperatorCommand, rate_percent};
use retrace_core::mode::Mode;
use retrace_link::channel;

use crate::diagnostic_text;
use crate::model::ScreenModel;

/// Text lines of an event; empty where the event is of no interest to an operator.
#[must_use]
pub(crate) fn lines(model: &ScreenModel, event: &Event) -> Vec<String> {
    if event.is_detail() {
        return Vec::new();
    }
    let text = match &event.kind {
        EventKind::Started => "program started".into(),
        EventKind::Mode(mode) => match mode_text(*mode) {
            Some(words) => words.into(),
            None => return Vec::new(),
        },
        // The key that held the jog was let go, which the distance tells.
        EventKind::Operator(OperatorCommand::Hold) if model.is_jog_released => return Vec::new(),
        EventKind::Operator(command) => format!("operator: {}", command_text(model, command)),
        EventKind::CommandRejected(why) => format!("rejected: {why}"),
        EventKind::OutputChanged(number, value) => output_text(model, *number, *value),
        EventKind::RetraceSwitched(number, value) => format!("retrace: {}", output_text(model, *number, *value)),
        EventKind::CutterOn(number) => format!("{} on (manual)", model.facts.output_name(*number)),
        EventKind::CutterOff { channel, .. } => {
            let text = event.text();
            let why = text.split_once(" off: ").map_or("", |(_, why)| why);
            // The header has what the keys do; a short line is not cut off.
            let why = if why.contains("lost in the cut") { "E3024: lost in the cut; k recovers it" } else { why };
            let keys = [("recover", "k"), ("back to pierce", "j"), ("skip contour", "N"), ("cut", "K")];
            let why = keys.iter().fold(why.to_owned(), |why, (word, key)| why.replace(&format!("`{word}`"), key));
            format!("{} off: {why}", model.facts.output_name(*channel))
        }
        // the readouts show it
        EventKind::CutterState { .. } => return Vec::new(),
        EventKind::CutEnd { channel, line, .. } => {
            format!("{}: the cut ends in line {line}", model.facts.output_name(*channel))
        }
        EventKind::CutterBoundary => {
            "at rest where the program switched the cutter, which is on: x switches it off, r continues cutting".into()
        }
        EventKind::ToolChange(tool) => tool_change_text(model, *tool),
        EventKind::OutputsDiffer(some) => {
            let each = some.list().iter().map(|of| {
                format!(
                    "{}, the program expects {}{}",
                    output_text(model, of.channel, of.actual),
                    state_text(model, of.channel, of.expected),
                    of.origin()
                )
            });
            format!("outputs differ: {}", each.collect::<Vec<_>>().join("; "))
        }
        EventKind::Dnc(dnc) => match dnc.step {
            DncStep::Paused { .. } => "paused: breakpoint saved".into(),
            DncStep::Jogged { axis, mm, cut_short, .. } => {
                let short = match (model.is_jog_released, cut_short) {
                    (true, _) => " while its key was held",
                    (false, true) => ", stopped early",
                    (false, false) => "",
                };
                format!("{} moved by {mm:.3} mm{short}", axis.to_ascii_uppercase())
            }
            DncStep::ToolLength { axis, by_mm, length_mm, .. } => {
                let what = length_mm.map_or("new tool length".into(), |mm| format!("tool length {mm:.3} mm"));
                format!("{what}: path moved by {by_mm:+.3} mm along {}", axis.to_ascii_uppercase())
            }
            _ => event.text(),
        },
        EventKind::Alarm(_) => return diagnostic_text::diagnostic_lines(&event.text()),
        _ => event.text(),
    };
    vec![text]
}

/// Text of a mode. The return to the furthest place and the wait there have none; the events that follow report them.
fn mode_text(mode: Mode) -> Option<&'static str> {
    match mode {
        Mode::Run => Some("normal run"),
        Mode::Reverse => Some("reverse run"),
        Mode::Forward => Some("forward run"),
        Mode::Wheel => Some("handwheel"),
        Mode::Rejoin | Mode::AwaitOutputs => None,
    }
}

fn command_text(model: &ScreenModel, command: &OperatorCommand) -> String {
    match command {
        OperatorCommand::Hold => "feed hold".into(),
        OperatorCommand::Resume | OperatorCommand::CycleStart => "cycle start".into(),
        OperatorCommand::Reverse(rate) => format!("reverse run, {:.0} %", rate_percent(*rate)),
        OperatorCommand::Forward(rate) => format!("forward run, {:.0} %", rate_percent(*rate)),
        OperatorCommand::Override(rate) => format!("override {:.0} %", rate_percent(*rate)),
        OperatorCommand::RapidOverride(rate) => format!("rapid override {:.0} %", rate_percent(*rate)),
        OperatorCommand::SpeedOverride(rate) => format!("speed override {:.0} %", rate_percent(*rate)),
        OperatorCommand::Wheel { .. } => "handwheel".into(),
        OperatorCommand::Leave { ask: false } => "forward, then resume".into(),
        OperatorCommand::Leave { ask: true } => "forward, then resume, asking before outputs change".into(),
        OperatorCommand::Confirm => "confirmed".into(),
        OperatorCommand::Recover if model.cut_end_line.is_some() => "recover the cut".into(),
        OperatorCommand::Recover => "restart the cutter and resume".into(),
        OperatorCommand::Contours => "list of the contours".into(),
        OperatorCommand::ConsumablesChanged => "the consumables are new".into(),
        OperatorCommand::SkipContour => "skip the rest of the contour".into(),
        OperatorCommand::SkipContourAhead { number, on: true } => format!("skip contour {number}"),
        OperatorCommand::SkipContourAhead { number, on: false } => format!("cut contour {number} after all"),
        OperatorCommand::CutterOff => "cutter off".into(),
        OperatorCommand::CutterOn => "cutter on".into(),
        OperatorCommand::TestPulse => "test pulse of the cutter".into(),
        OperatorCommand::SenseTest => "sense test: the tool goes down to the sheet".into(),
        OperatorCommand::OptionalStop(on) => format!("optional stop {}", if *on { "on" } else { "off" }),
        OperatorCommand::Output { number, on } => format!("{} (manual)", output_text(model, *number, i32::from(*on))),
        OperatorCommand::Single => format!("single block {}", if model.single { "on" } else { "off" }),
        OperatorCommand::Stop if model.is_at_program_end() => "release the job".into(),
        OperatorCommand::Stop => "stop the job".into(),
        OperatorCommand::BackBy(mm) => format!("back by {mm} mm"),
        OperatorCommand::BackToBlock => "back to the start of the block".into(),
        OperatorCommand::BackToPierce => "back to the last pierce".into(),
        OperatorCommand::BackToCutEnd => "back to the end of the cut".into(),
        OperatorCommand::BackToContour(number) => format!("back to contour {number}"),
        OperatorCommand::CutAll => "cut from here, every contour again".into(),
        OperatorCommand::CutAsk => "cut from here, once the outputs are agreed to".into(),
        OperatorCommand::CutFromHere(_) => "cut from here".into(),
        OperatorCommand::Shift(_) => "shift the start of the cut".into(),
        OperatorCommand::Lead(shape) => format!("shifted starts lead in by {}", shape.name()),
        OperatorCommand::Pause => "pause".into(),
        OperatorCommand::Park => "go to the park position".into(),
        OperatorCommand::Pointer => "show the place by the pointer".into(),
        OperatorCommand::ChangeDone => "the change is done: return".into(),
        OperatorCommand::SpindleStop => "stop the spindle".into(),
        OperatorCommand::SpindleStart => "start the spindle".into(),
        OperatorCommand::Jog { axis, mm } => format!("jog {} by {mm} mm", axis.to_ascii_uppercase()),
        OperatorCommand::ToolLength(length) => length.to_string(),
        OperatorCommand::Height(HeightCommand::Up) => "height control: one step higher".into(),
        OperatorCommand::Height(HeightCommand::Down) => "height control: one step lower".into(),
        OperatorCommand::Height(HeightCommand::Reset) => "height control: back to the voltage of the material".into(),
        OperatorCommand::Height(HeightCommand::Control(true)) => "height control on".into(),
        OperatorCommand::Height(HeightCommand::Control(false)) => "height control off: the height is held".into(),
        OperatorCommand::FollowSpindle(true) => "the axes follow the spindle turned by hand".into(),
        OperatorCommand::FollowSpindle(false) => "the axes no longer follow the spindle".into(),
        OperatorCommand::ToolFree => "the tool is free of the thread, which is retraced like any path".into(),
        OperatorCommand::Online => "return to on-line mode".into(),
    }
}

/// Instruction for a manual tool change.
#[must_use]
pub(crate) fn tool_change_text(model: &ScreenModel, tool: i32) -> String {
    match (tool, model.facts.tool_names.get(&tool)) {
        (0, _) => "remove the tool".into(),
        (_, Some(name)) => format!("insert tool T{tool}: {name}"),
        (_, None) => format!("insert tool T{tool}"),
    }
}

/// Text of an output and its state: `output 3 on`, `spindle clockwise`.
fn output_text(model: &ScreenModel, number: u8, value: i32) -> String {
    format!("{} {}", model.facts.output_name(number), state_text(model, number, value))
}

/// Text of the state of an output.
fn state_text(model: &ScreenModel, number: u8, value: i32) -> String {
    match (number, value) {
        _ if model.facts.is_of_cutter(number) => if value == 0 { "off" } else { "on" }.into(),
        (channel::SPINDLE, 0) => "stopped".into(),
        (channel::SPINDLE, 1..) => "clockwise".into(),
        (channel::SPINDLE, _) => "counterclockwise".into(),
        (channel::SPEED, _) => {
            let unit = if model.facts.power_name().is_some() { "" } else { "/min" };
            format!("{:.0}{unit}", f64::from(value) / 1000.0)
        }
        (channel::TOOL, _) => format!("T{value}"),
        (_, 0) => "off".into(),
        _ => "on".into(),
    }
}
