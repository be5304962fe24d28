//! What lies over the screen: questions, alarms, outputs that differ, all keys.
//!
//! Invariant: a box says by which key it goes away.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Modifier, Style};
use ratatui::widgets::{Clear, Widget};

use super::listing::told;
use super::{Theme, fitted, folded, pane, put_at};
use crate::screen::key_state::{KeyState, OpenDialog, PendingQuestion};
use crate::screen::keys::{KeyAction, Situation, TABLE, row_for};
use crate::screen::model::{Pause, ScreenModel};
use crate::screen::status_line::{self, HintLevel, StatusHint};

/// Draws what is to be drawn over the rest.
pub(super) fn draw(
    out: &mut Buffer,
    path: Rect,
    model: &ScreenModel,
    hand: &KeyState,
    guide: &StatusHint,
    look: Theme,
) {
    if model.alarm.is_some() && !hand.alarm_aside {
        alarm(out, model, look);
        return;
    }
    match hand.open(model) {
        OpenDialog::Help(from) => help(out, model, *from, look),
        OpenDialog::Tools => tools(out, model, look),
        OpenDialog::Messages(back) => log(out, model, *back, look),
        OpenDialog::Prompt(ask, text, wrong) => prompt(out, *ask, text, wrong.as_deref(), look),
        OpenDialog::Nothing => match (&model.alarm, model.pause) {
            (None, _) if model.question.is_some() => question(out, model, look),
            (None, _) if !model.differ.is_empty() => differ(out, model, look),
            (None, Some(pause)) if guide.grade == HintLevel::Waits => pause_steps(out, path, pause, look),
            _ => {}
        },
    }
}

/// The steps of a pause, at the foot of the path's pane, so that program and figures stay in view.
fn pause_steps(out: &mut Buffer, path: Rect, pause: Pause, look: Theme) {
    let steps = status_line::steps(pause);
    let next = steps.iter().position(|&(_, _, done)| !done);
    let line = |(n, (what, act, done)): (usize, &(&str, KeyAction, bool))| {
        let sign = match (done, Some(n) == next) {
            (true, _) => "done",
            (_, true) => " -->",
            _ => "    ",
        };
        format!("{sign} {}. {what:<22} {}", n + 1, row_for(*act).map_or("", |row| row.shown))
    };
    let lines: Vec<String> = steps.iter().enumerate().map(line).collect();
    let height = (lines.len() as u16 + 2).min(path.height);
    fill(out, Rect { y: path.bottom() - height, height, ..path }, "PAUSED: the steps back", &lines, look);
}

/// A box in the middle, as large as its lines and no larger than the screen.
fn boxed(out: &mut Buffer, title: &str, lines: &[String], look: Theme) {
    let longest = lines.iter().map(|line| line.chars().count()).max().unwrap_or(0).max(title.chars().count() + 4);
    let width = (longest + 4).min(usize::from(out.area.width)) as u16;
    let height = (lines.len() + 2).min(usize::from(out.area.height.saturating_sub(2))) as u16;
    let at = Rect::new((out.area.width - width) / 2, (out.area.height.saturating_sub(height)) / 2, width, height);
    fill(out, at, title, lines, look);
}

fn fill(out: &mut Buffer, at: Rect, title: &str, lines: &[String], look: Theme) {
    let at = at.intersection(out.area);
    Clear.render(at, out);
    let inside = pane(out, at, title, look);
    for (row, line) in lines.iter().enumerate() {
        let line = fitted(line, usize::from(inside.width).saturating_sub(1));
        put_at(out, inside, 1, row as u16, &line, Style::new());
    }
    let waits = look.waits().add_modifier(Modifier::BOLD);
    put_at(out, at, 2, 0, &format!(" {} ", fitted(title, usize::from(at.width).saturating_sub(6))), waits);
}

/// All keys, a page at a time: those of this situation first, then the others by situation.
fn help(out: &mut Buffer, model: &ScreenModel, page: usize, look: Theme) {
    let width = usize::from(out.area.width).saturating_sub(5);
    let lines: Vec<String> = help_lines(Situation::of(model), width);
    let room = usize::from(out.area.height.saturating_sub(4)).max(1);
    let pages = lines.len().div_ceil(room);
    let page = page % pages.max(1);
    let mut shown: Vec<String> = lines.into_iter().skip(page * room).take(room).collect();
    // Every page is as large as the first, so that the box stays where it is.
    shown.resize(room.min(shown.len().max(room)), String::new());
    let longest = shown.iter().map(|line| line.chars().count()).max().unwrap_or(0);
    if let Some(first) = shown.first_mut() {
        *first = format!("{first:width$}", width = longest.max(60).min(width));
    }
    boxed(out, &format!("keys · page {} of {pages} · ↓ next  ↑ back  Esc closes", page + 1), &shown, look);
}

/// The help, by situation: each key under the first in which it works.
fn help_lines(situation: Situation, width: usize) -> Vec<String> {
    let mut lines = Vec::new();
    let mut listed: u128 = 0;
    let others = Situation::ALL.into_iter().filter(|&other| other != situation);
    for (number, section) in std::iter::once(situation).chain(others).enumerate() {
        let mut rows = Vec::new();
        for (bit, row) in TABLE.iter().enumerate() {
            if row.when & section as u8 != 0 && listed >> bit & 1 == 0 {
                listed |= 1 << bit;
                rows.extend(folded(&format!("  {:<7} {}", row.shown, row.long), width, 10));
            }
        }
        if rows.is_empty() {
            continue;
        }
        let now = if number == 0 { "Now, " } else { "Also " };
        lines.push(format!("{now}{}:", section.words()));
        lines.append(&mut rows);
    }
    lines
}

fn tools(out: &mut Buffer, model: &ScreenModel, look: Theme) {
    let room = usize::from(out.area.height.saturating_sub(4));
    let mut lines: Vec<String> = model.facts.tools.iter().take(room).cloned().collect();
    if lines.is_empty() {
        lines.push("No tool table was given (--tools FILE).".into());
    }
    boxed(out, "tools · any key closes", &lines, look);
}

/// All messages, each as long as it is, the newest below; `back`: lines above the newest.
fn log(out: &mut Buffer, model: &ScreenModel, back: usize, look: Theme) {
    let room = usize::from(out.area.height.saturating_sub(4)).max(1);
    let width = usize::from(out.area.width).saturating_sub(5);
    let all: Vec<String> = model.messages.iter().flat_map(|message| folded(&told(message), width, 26)).collect();
    let end = all.len().saturating_sub(back).max(room.min(all.len()));
    let mut lines = all[end.saturating_sub(room)..end].to_vec();
    if lines.is_empty() {
        lines.push("Nothing yet.".into());
    }
    boxed(out, "messages, the newest below · ↑ ↓ PgUp PgDn · any other key closes", &lines, look);
}

fn prompt(out: &mut Buffer, ask: PendingQuestion, text: &str, wrong: Option<&str>, look: Theme) {
    let (title, question, keys) = match ask {
        PendingQuestion::BackBy => ("back up", "Back along the path by how many mm?", "Enter goes · Esc does not"),
        PendingQuestion::Output => {
            ("output by hand", "Which output, by number or name? 3+ on, 3- off", "Enter switches · Esc does not")
        }
        PendingQuestion::Mdi => ("MDI", "A block, as in a program: G0 X10", "Enter executes it · Esc does not"),
        PendingQuestion::WorkZero => {
            ("work zero", "Zero here for which axis? all, or its letter", "Enter sets it · Esc does not")
        }
        PendingQuestion::ToolLength => (
            "tool length",
            "Length of the new tool in mm; with + or - by how much it is longer",
            "Enter moves the breakpoint and the path · Esc does not",
        ),
        PendingQuestion::Program => {
            ("open a program", "Which file? Tab completes its name", "Enter opens it · Esc does not")
        }
        PendingQuestion::Stop => {
            ("stop the job?", "It stops here; the breakpoint is kept.", "y stops it · any other key goes on")
        }
    };
    let mut lines = vec![question.to_string()];
    if ask != PendingQuestion::Stop {
        let shown = text.chars().count().saturating_sub(60);
        let tail: String = text.chars().skip(shown).collect();
        lines.push(format!("> {tail}_"));
    }
    lines.extend(wrong.map(|wrong| format!("! {wrong}")));
    lines.push(keys.into());
    boxed(out, title, &lines, look);
}

fn alarm(out: &mut Buffer, model: &ScreenModel, look: Theme) {
    let Some(alarm) = &model.alarm else { return };
    let width = usize::from(out.area.width.clamp(20, 90)) - 6;
    let mut lines = folded(&format!("What: {}", alarm.cause), width, 6);
    lines.extend(folded(&format!("Do:   {}", alarm.remedy), width, 6));
    lines.push(String::new());
    if alarm.is_refusal {
        lines.push("a or Esc closes this box".into());
        boxed(out, "THE PROGRAM IS REFUSED", &lines, look);
    } else {
        lines.push("a clears the alarm · Esc puts this box aside".into());
        boxed(out, &format!("ALARM {}", alarm.number), &lines, look);
    }
}

fn question(out: &mut Buffer, model: &ScreenModel, look: Theme) {
    let Some(question) = &model.question else { return };
    let width = usize::from(out.area.width.clamp(20, 110)) - 6;
    let mut lines: Vec<String> = question.lines.iter().flat_map(|line| folded(line, width, 11)).collect();
    lines.push(String::new());
    lines.push("y agrees · n does not".into());
    boxed(out, &question.title, &lines, look);
}

fn differ(out: &mut Buffer, model: &ScreenModel, look: Theme) {
    let mut lines = vec![format!("{:<16}{:>8}{:>16}", "output", "is", "program wants")];
    let room = usize::from(out.area.height.saturating_sub(9));
    let lists = model.differ.iter().take(room);
    lines.extend(
        lists.map(|(c, is, wants)| format!("{:<16}{is:>8}{wants:>16}", fitted(&model.facts.output_name(*c), 15))),
    );
    if model.differ.len() > room {
        lines.push(format!("… {} more", model.differ.len() - room));
    }
    lines.push(String::new());
    lines.push("y switches them as the program wants, and goes on".into());
    lines.push("o switches one by hand · r backs up again".into());
    boxed(out, "OUTPUTS DIFFER", &lines, look);
}
