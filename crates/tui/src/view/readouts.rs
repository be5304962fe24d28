//! Readouts: positions, speeds with their bars, and switched states.
//!
//! Invariant: a value has its unit, and a bar repeats a value that is shown in digits.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Modifier, Style};
use retrace_controller::{CutterState, JogSpeed};
use retrace_link::{GearState, channel};

use super::{Theme, fold, pane, put_at, truncate};
use crate::cut_text;
use crate::height_text::{self, HeightFigures};
use crate::key_state::{JogStep, KeyState};
use crate::model::{AxisHoming, ScreenModel, ScreenStage};
use crate::program_facts::CutterFacts;

/// Draws machine position, work position and distance to go of every axis.
pub(super) fn position(out: &mut Buffer, area: Rect, model: &ScreenModel, key_state: &KeyState, theme: Theme) {
    let marks = if model.homing.contains(&AxisHoming::NotHomed) {
        " · ✓ homed  ? not"
    } else if model.homing.contains(&AxisHoming::Homed) {
        " · ✓ homed"
    } else {
        ""
    };
    let turned = match model.work_rotation_deg {
        0.0 => String::new(),
        degrees => format!(" · turned {degrees:+.3}°"),
    };
    // While a torch is over its sheet, that matters more than the marks.
    let marks = height_text::over_sheet_text(model).map_or(marks.into(), |height| format!(" · {height}"));
    let inside = pane(out, area, &format!("position, mm{marks}{turned}"), theme);
    let header = format!("{:>12}{:>12}{:>11}", "machine", "work", "to go");
    put_at(out, inside, 2, 0, &header, theme.faint());
    let is_jogged = model.stage == ScreenStage::Setup || model.pause.is_some();
    for (axis, facts) in model.facts.axes.iter().enumerate() {
        let row = axis as u16 + 1;
        let to_go = model.to_go_mm(axis).map_or("-".into(), length_text);
        let line =
            format!("{:>12}{:>12}{to_go:>11}", length_text(model.machine_mm(axis)), length_text(model.work_mm(axis)));
        let name = facts.letter.to_ascii_uppercase().to_string();
        put_at(out, inside, 2, row, &line, Style::new().add_modifier(Modifier::BOLD));
        put_at(out, inside, 1, row, &name, Style::new().add_modifier(Modifier::BOLD));
        match model.homing.get(axis) {
            Some(AxisHoming::Homed) => put_at(out, inside, 3, row, "✓", theme.normal()),
            Some(AxisHoming::NotHomed) => put_at(out, inside, 3, row, "?", theme.waiting()),
            _ => {}
        }
        if is_jogged && axis == key_state.axis {
            put_at(out, inside, 0, row, ">", theme.waiting());
        }
    }
}

/// Formats a length with three decimals and at most eleven characters, never as −0.
fn length_text(mm: f64) -> String {
    let rounded = (mm * 1000.0).round() / 1000.0 + 0.0;
    if rounded.abs() < 999_999.5 { format!("{rounded:.3}") } else { format!("{rounded:.1e}") }
}

/// Draws feed, rate, override, history and look-ahead.
pub(super) fn motion(out: &mut Buffer, area: Rect, model: &ScreenModel, theme: Theme) {
    let inside = pane(out, area, "motion", theme);
    let (history_s, history_mm) = model.history();
    let asked = model.override_rate;
    let back = model.back_mm();
    let effect = match model.override_is_off {
        true => ReadoutColumn::Text("off (M49)".into()),
        false => ReadoutColumn::Bar(asked),
    };
    let rows: [(&str, String, ReadoutColumn); 5] = [
        ("feed", format!("{:.0} mm/min", model.feed_mm_min), ReadoutColumn::Text(programmed(model))),
        ("rate", format!("{:.0} %", model.rate * 100.0), ReadoutColumn::Bar(model.rate)),
        ("override", overrides(asked, model), effect),
        (
            "history",
            format!("{} · {}", seconds(history_s), length(history_mm)),
            ReadoutColumn::History(history_mm, back),
        ),
        ("ahead", seconds(model.ahead_s()), ReadoutColumn::Text(buffer_text(model))),
    ];
    for (row, (name, text, side)) in rows.iter().enumerate() {
        let row = row as u16;
        put_at(out, inside, 1, row, name, theme.faint());
        put_at(out, inside, 10, row, text, Style::new().add_modifier(Modifier::BOLD));
        let at = 11 + text.chars().count().max(9) as u16;
        match side {
            ReadoutColumn::Text(text) => put_at(out, inside, at, row, text, Style::new()),
            ReadoutColumn::History(behind, back) => {
                let line = history_line(*behind, *back, inside.width.saturating_sub(at + 1));
                put_at(out, inside, at, row, &line, theme.waiting());
            }
            ReadoutColumn::Bar(share) => {
                let style = if *share < 0.0 { theme.waiting() } else { theme.normal() };
                put_at(out, inside, at, row, &bar(*share, inside.width.saturating_sub(at + 1)), style);
            }
        }
    }
}

/// Formats the feed override, with the rapid override where it is not 100 %.
fn overrides(feed: f64, model: &ScreenModel) -> String {
    let mut text = format!("{:.0} %", feed * 100.0);
    for (what, share) in [("rapids", model.rapid_override), ("S", model.speed_override)] {
        let percent = (share * 100.0).round();
        if percent != 100.0 {
            text += &format!(", {what} {percent:.0} %");
        }
    }
    text
}

/// Column to the right of a value.
enum ReadoutColumn {
    /// Text.
    Text(String),
    /// Length of the history behind the cursor and length retraced, mm.
    History(f64, f64),
    /// Bar: 1 fills half of it; below 0 it is drawn with another sign.
    Bar(f64),
}

fn programmed(model: &ScreenModel) -> String {
    if model.is_rapid() {
        return "rapid".into();
    }
    model.active.feed.map_or(String::new(), |feed| format!("of F{feed:.0}"))
}

fn buffer_text(model: &ScreenModel) -> String {
    let held = model.window[1].since(model.window[0]);
    match model.underruns {
        0 => format!("card holds {held}"),
        n => format!("card {held} · {n} x dry"),
    }
}

/// Draws a bar whose middle, which has a mark, is 100 %.
fn bar(share: f64, width: u16) -> String {
    let width = usize::from(width).min(40);
    let half = width / 2;
    let filled = ((share.abs() * half as f64).round() as usize).min(width);
    let sign = if share < 0.0 { '<' } else { '■' };
    (0..width)
        .map(|n| {
            if n < filled {
                sign
            } else if n + 1 == half {
                '|'
            } else {
                '·'
            }
        })
        .collect()
}

/// Draws the history as a line: the part that can still be retraced, the tool, the part that was retraced.
fn history_line(behind_mm: f64, back_mm: f64, width: u16) -> String {
    let cells = usize::from(width.min(40)).saturating_sub(1);
    let whole = behind_mm + back_mm;
    let behind = if whole > 0.0 { (behind_mm / whole * cells as f64).round() as usize } else { 0 };
    let ahead = if whole > 0.0 { cells.saturating_sub(behind) } else { 0 };
    format!("{}@{}", "=".repeat(behind.min(cells)), "o".repeat(ahead))
}

fn seconds(s: f64) -> String {
    match s {
        ..10.0 => format!("{s:.2} s"),
        ..600.0 => format!("{s:.1} s"),
        _ => format!("{:.1} min", s / 60.0),
    }
}

fn length(mm: f64) -> String {
    if mm < 10_000.0 { format!("{mm:.1} mm") } else { format!("{:.1} m", mm / 1000.0) }
}

/// Draws outputs, inputs and the modal state.
pub(super) fn state(out: &mut Buffer, area: Rect, model: &ScreenModel, key_state: &KeyState, theme: Theme) {
    let inside = pane(out, area, "state", theme);
    let width = usize::from(inside.width).saturating_sub(2);
    let mut lines: Vec<String> = cutters(model).iter().flat_map(|line| fold(line, width, 2)).collect();
    lines.extend(HeightFigures::of(model).map(|of| of.text()).iter().flat_map(|line| fold(line, width, 2)));
    if lines.is_empty() {
        lines.extend([Some(spindle(model)), measured(model), Some(outputs(model))].into_iter().flatten());
    } else {
        lines.extend(fold(&format!("{} · {}", spindle(model), outputs(model)), width, 0));
    }
    if model.stage == ScreenStage::Setup || model.pause.is_some() {
        let step = key_state.jog_step();
        let step = match step {
            JogStep::Held(speed) if model.pause.is_none() => {
                let slow = if speed == JogSpeed::Slow { "slow " } else { "" };
                format!("jog held: {slow}{} mm/min · a tap {} mm", jog_speeds(model, speed), step.tap_mm())
            }
            _ => format!("jog step {} mm", step.tap_mm()),
        };
        let optional = if model.optional_stop { " · M1 stops" } else { "" };
        // First: whoever jogs has to see it on a small screen, too.
        lines.splice(0..0, fold(&(step + optional), width, 2));
    } else {
        let single = if model.single { "single block ON" } else { "single block off" };
        let inputs: Vec<String> = (0..16).filter(|n| model.inputs >> n & 1 == 1).map(|n| n.to_string()).collect();
        let inputs = if inputs.is_empty() { "none".into() } else { inputs.join(" ") };
        let optional = if model.optional_stop { "M1 stops · " } else { "" };
        lines.push(format!("{single} · {optional}inputs {inputs}"));
    }
    lines.extend(wrap(&model.active.modal, width));
    if lines.len() < usize::from(inside.height) {
        let redraw = model.redraw;
        lines.push(format!("redraw mean {:.1} ms, max {:.0} ms", redraw.mean_ms, redraw.max_ms));
    }
    for (row, line) in lines.iter().enumerate() {
        put_at(out, inside, 1, row as u16, &truncate(line, width), Style::new());
    }
}

/// Speeds of a held jog, mm/min: that of the first linear axis, and those of others that differ.
fn jog_speeds(model: &ScreenModel, speed: JogSpeed) -> String {
    let linear = || model.facts.axes.iter().filter(|axis| !matches!(axis.letter, 'a'..='c'));
    let mm_min = |mm_s: f64| (speed.share() * mm_s * 60.0).round();
    let first = linear().next().map_or(0.0, |axis| mm_min(axis.jog_mm_s));
    let others = linear().filter(|axis| mm_min(axis.jog_mm_s) != first);
    others.fold(format!("{first:.0}"), |text, axis| {
        format!("{text}, {} {:.0}", axis.letter.to_ascii_uppercase(), mm_min(axis.jog_mm_s))
    })
}

/// What a cutter does, beyond on and off.
fn cutter_state(model: &ScreenModel, channel: u8) -> String {
    let (state, _) = model.cutter_states.get(&channel).copied().unwrap_or_default();
    match state {
        CutterState::Off => String::new(),
        CutterState::Sensing => " · sensing".into(),
        CutterState::Igniting => " · igniting".into(),
        CutterState::Piercing => " · piercing".into(),
        CutterState::Cutting => " · cutting".into(),
        CutterState::Ending => " · end of the contour".into(),
        CutterState::Lost => {
            let why = model.cutter_off_reasons.get(&channel).map_or(String::new(), |why| format!(": {why}"));
            format!(" · cut interrupted{}", why.replace('_', " "))
        }
        CutterState::Dry => " · dry run".into(),
        CutterState::Test => " · test pulse".into(),
    }
}

/// Lines for the cutters: state, and the state that the program expects at this place.
fn cutters(model: &ScreenModel) -> Vec<String> {
    let line = |cutter: &CutterFacts| {
        // Capitals are for what is lit.
        let program = if model.stage == ScreenStage::Job && !model.off_path {
            format!(" · program here {}", if model.program_output(cutter.fire) == 0 { "off" } else { "on" })
        } else {
            String::new()
        };
        let doing = cutter_state(model, cutter.fire);
        let value = model.output(cutter.fire);
        let lit = if value == 0 { String::new() } else { format!(" · {:.0} s", model.on_s(cutter.fire)) };
        let ok = match cutter.ok_input.map(|input| model.inputs >> (input & 15) & 1 == 1) {
            Some(true) => " · ok",
            Some(false) if value != 0 => " · no ok",
            _ => "",
        };
        let state = if value == 0 { "off" } else { "ON" };
        format!("{} {state}{program}{doing}{lit}{ok}", cutter.name)
    };
    let mut lines: Vec<String> = model.facts.cutters.iter().map(line).collect();
    let is_off = |cutter: &CutterFacts| {
        model.cutter_states.get(&cutter.fire).is_none_or(|(state, _)| *state == CutterState::Off)
    };
    let cuts = model.facts.cutters.iter().position(|cutter| !is_off(cutter)).unwrap_or(0);
    if let (Some(progress), Some(line)) = (cut_text::progress_text(model), lines.get_mut(cuts)) {
        *line += &format!(" · {progress}");
    }
    lines
}

fn spindle(model: &ScreenModel) -> String {
    let speed = f64::from(model.output(channel::SPEED)) / 1000.0;
    let spindle = match model.output(channel::SPINDLE) {
        _ if model.facts.is_of_cutter(channel::SPINDLE) => {
            model.facts.power_name().map_or_else(String::new, |name| format!("{name} {speed:.0} · "))
        }
        // A machine with another kind of cutter shows its spindle only while it turns.
        0 if !model.facts.cutters.is_empty() => String::new(),
        0 => "spindle stopped · ".to_string(),
        1.. => format!("spindle cw {speed:.0}/min · "),
        _ => format!("spindle ccw {speed:.0}/min · "),
    };
    let coolant = match (model.output(channel::MIST) != 0, model.output(channel::FLOOD) != 0) {
        (false, false) => "coolant off",
        (true, false) => "mist ON",
        (false, true) => "flood ON",
        (true, true) => "mist, flood ON",
    };
    let tool = model.active.tool.unwrap_or(model.output(channel::TOOL));
    format!("{spindle}{coolant} · T{tool}")
}

/// Measured speed of a spindle with an encoder, and what the motion does with it.
fn measured(model: &ScreenModel) -> Option<String> {
    let speed = model.spindle.speed?;
    let gear = match model.spindle.gear {
        GearState::Off => "",
        GearState::Waiting => " · waits for its angle",
        GearState::Engaged => " · in a thread",
        GearState::Freed => " · tool free",
    };
    Some(format!("measured {:.0}/min{gear}", f64::from(speed) / 1000.0))
}

/// Lists the digital outputs that are on, by name, except those that fire a cutter.
fn outputs(model: &ScreenModel) -> String {
    let fires: Vec<u8> = model.facts.cutters.iter().map(|cutter| cutter.fire).collect();
    let on: Vec<String> = model
        .outputs_on()
        .filter(|number| !fires.contains(number))
        .map(|number| {
            let name = model.facts.output_name(number);
            name.strip_prefix("output ").map_or(name.clone(), str::to_owned)
        })
        .collect();
    match (on.is_empty(), fires.is_empty()) {
        (true, true) => "outputs all off".into(),
        (true, false) => "other outputs off".into(),
        (false, _) => format!("outputs ON: {}", on.join(" ")),
    }
}

/// Breaks a text between words into lines of at most `width` characters.
fn wrap(text: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.into()),
        }
    }
    lines
}
