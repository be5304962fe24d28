//! Line lists: the program with the active block, and the latest messages.
//!
//! Invariant: the active block is always visible.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Modifier, Style};

use super::{Theme, pane, put_at, truncate};
use crate::message::Message;
use crate::model::{ScreenModel, ScreenStage};

/// Draws the program, with `>` at the active block and `x` at the furthest one.
pub(super) fn program(out: &mut Buffer, area: Rect, model: &ScreenModel, theme: Theme) {
    let text = &model.facts.program;
    let lines = text.lines();
    let active = model.line as usize;
    let title = match (lines, &model.stage) {
        (0, _) => format!("program · line {active}"),
        (_, ScreenStage::Job) => format!("program · line {active} of {lines}"),
        _ => format!("program · {lines} lines"),
    };
    let inside = pane(out, area, &title, theme);
    if lines == 0 {
        put_at(out, inside, 1, 0, "Streamed program:", theme.faint());
        put_at(out, inside, 1, 1, "no listing.", theme.faint());
        return;
    }
    let height = usize::from(inside.height);
    let digits = lines.to_string().len().max(3);
    // The active block is in the middle, except at both ends of the program.
    let first = active.saturating_sub(height / 2).clamp(1, (lines + 1).saturating_sub(height).max(1));
    for (row, number) in (first..=lines).take(height).enumerate() {
        let is_active = number == active && model.stage != ScreenStage::Setup;
        let is_furthest = number == model.reached_line as usize && model.stage == ScreenStage::Job;
        let sign = match (is_active, is_furthest && active != number) {
            (true, _) => '>',
            (_, true) => 'x',
            _ => ' ',
        };
        let style =
            if is_active { Style::new().add_modifier(Modifier::BOLD | Modifier::REVERSED) } else { Style::new() };
        let line = format!("{sign}{number:digits$} {}", text.line(number).unwrap_or_default());
        let width = usize::from(inside.width);
        put_at(out, inside, 0, row as u16, &format!("{:width$}", truncate(&line, width)), style);
    }
}

/// Draws the latest messages, the newest last.
pub(super) fn messages(out: &mut Buffer, area: Rect, model: &ScreenModel, theme: Theme) {
    let rows = usize::from(area.height);
    let skip = model.messages.len().saturating_sub(rows);
    let blank = rows.saturating_sub(model.messages.len());
    for (row, message) in model.messages.iter().skip(skip).enumerate() {
        let is_last = row + skip + 1 == model.messages.len();
        let style = if is_last { Style::new() } else { theme.faint() };
        let line = message_text(message);
        let line = truncate(&line, usize::from(area.width).saturating_sub(2));
        put_at(out, area, 1, (row + blank) as u16, &line, style);
    }
}

/// Formats a message: time, program line if it has one, text.
pub(super) fn message_text(message: &Message) -> String {
    let line = if message.line == 0 { String::new() } else { format!("line {}", message.line) };
    let times = if message.times > 1 { format!("  ×{}", message.times) } else { String::new() };
    format!("{:9.2} s  {line:<11}  {}{times}", message.time_s, message.text)
}
