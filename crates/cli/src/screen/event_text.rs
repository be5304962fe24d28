//! Events in words for the operator at the screen: what he did and what the machine did, without the syntax of scripts.
//!
//! Invariant: whatever has no words of its own here is shown as everywhere else.

use retrace_controller::dnc::Step;
use retrace_controller::event::{Event, Happening};
use retrace_controller::operator::{Deed, percent};
use retrace_link::channel;

use super::diagnostic_text;
use super::model::Model;

/// An event in words, a line each; none where it is no news for an operator.
#[must_use]
pub fn lines(model: &Model, event: &Event) -> Vec<String> {
    let text = match &event.happening {
        Happening::Started => "the program begins".into(),
        Happening::Mode(mode) => match mode_words(mode) {
            Some(words) => words.into(),
            None => return Vec::new(),
        },
        Happening::Operator(deed) => format!("you: {}", deed_words(model, deed)),
        Happening::OrderRefused(why) => format!("not possible: {why}"),
        Happening::SwitchedInPassing(number, value) => output_words(model, *number, *value),
        Happening::RetraceSwitched(number, value) => format!("retrace: {}", output_words(model, *number, *value)),
        Happening::CutterOn(number) => format!("{} on by hand", model.facts.output_name(*number)),
        Happening::CutterOff { channel, .. } => {
            let text = event.text();
            let why = text.split_once(" off: ").map_or("", |(_, why)| why);
            format!("{} off: {}", model.facts.output_name(*channel), why.replace("`recover`", "k"))
        }
        Happening::CutterBoundary => {
            "standing where the program switched the cutter, and it is on: x switches it off, r cuts on".into()
        }
        Happening::ToolChange(tool) => tool_change_words(model, *tool),
        Happening::OutputsDiffer(some) => {
            let each = some.list().iter().map(|(number, is, wants)| {
                format!(
                    "{}, the program wants {}",
                    output_words(model, *number, *is),
                    state_words(model, *number, *wants)
                )
            });
            format!("outputs differ: {}", each.collect::<Vec<_>>().join("; "))
        }
        Happening::Dnc(dnc) => match dnc.step {
            Step::Paused { .. } => "paused: the breakpoint is kept".into(),
            Step::Jogged { axis, mm, cut_short, .. } => {
                let short = if cut_short { ", cut short" } else { "" };
                format!("{} moved by {mm:.3} mm{short}", axis.to_ascii_uppercase())
            }
            Step::ToolLength { axis, by_mm, length_mm, .. } => {
                let what = length_mm.map_or("new tool length".into(), |mm| format!("tool length {mm:.3} mm"));
                format!("{what}: path moved by {by_mm:+.3} mm along {}", axis.to_ascii_uppercase())
            }
            _ => event.text(),
        },
        Happening::Alarm(_) => return diagnostic_text::in_words(&event.text()),
        _ => event.text(),
    };
    vec![text]
}

/// A mode of operation. The way back to the furthest place and the wait there are said by what follows.
fn mode_words(mode: &str) -> Option<&'static str> {
    Some(match mode {
        "run" => "along the program",
        "reverse" => "reverse run",
        "forward" => "forward run",
        "wheel" => "handwheel",
        _ => return None,
    })
}

fn deed_words(model: &Model, deed: &Deed) -> String {
    match deed {
        Deed::Hold => "feed hold".into(),
        Deed::Resume | Deed::CycleStart => "cycle start".into(),
        Deed::Reverse(rate) => format!("reverse run, {:.0} %", percent(*rate)),
        Deed::Forward(rate) => format!("forward run, {:.0} %", percent(*rate)),
        Deed::Override(rate) => format!("override {:.0} %", percent(*rate)),
        Deed::RapidOverride(rate) => format!("rapid override {:.0} %", percent(*rate)),
        Deed::Wheel { .. } => "handwheel".into(),
        Deed::Leave { ask: false } => "forward and on with the program".into(),
        Deed::Leave { ask: true } => "forward and on, asking before outputs change".into(),
        Deed::Agree => "agreed".into(),
        Deed::Recover => "start the cutter again and go on".into(),
        Deed::CutterOff => "cutter off".into(),
        Deed::CutterOn => "cutter on".into(),
        Deed::OptionalStop(on) => format!("optional stop {}", if *on { "on" } else { "off" }),
        Deed::Output { number, on } => format!("{} by hand", output_words(model, *number, i32::from(*on))),
        Deed::Single => format!("single block {}", if model.single { "on" } else { "off" }),
        Deed::Stop => "stop the job".into(),
        Deed::BackBy(mm) => format!("back by {mm} mm"),
        Deed::BackToBlock => "back to the start of the block".into(),
        Deed::BackToJet => "back to where the jet came on".into(),
        Deed::Pause => "pause".into(),
        Deed::SpindleStop => "stop the spindle".into(),
        Deed::SpindleStart => "start the spindle".into(),
        Deed::Jog { axis, mm } => format!("jog {} by {mm} mm", axis.to_ascii_uppercase()),
        Deed::ToolLength(length) => length.to_string(),
        Deed::Online => "back to on-line mode".into(),
    }
}

/// What is to be done at a tool change by hand.
#[must_use]
pub fn tool_change_words(model: &Model, tool: i32) -> String {
    match (tool, model.facts.tool_names.get(&tool)) {
        (0, _) => "take the tool out".into(),
        (_, Some(name)) => format!("insert tool T{tool}: {name}"),
        (_, None) => format!("insert tool T{tool}"),
    }
}

/// An output and its state: `output 3 on`, `spindle clockwise`.
fn output_words(model: &Model, number: u8, value: i32) -> String {
    format!("{} {}", model.facts.output_name(number), state_words(model, number, value))
}

/// The state of an output in words.
fn state_words(model: &Model, number: u8, value: i32) -> String {
    match (number, value) {
        _ if model.facts.is_of_cutter(number) => if value == 0 { "off" } else { "on" }.into(),
        (channel::SPINDLE, 0) => "stopped".into(),
        (channel::SPINDLE, 1..) => "clockwise".into(),
        (channel::SPINDLE, _) => "counterclockwise".into(),
        (channel::SPEED, _) => format!("{:.0}/min", f64::from(value) / 1000.0),
        (channel::TOOL, _) => format!("T{value}"),
        (_, 0) => "off".into(),
        _ => "on".into(),
    }
}
