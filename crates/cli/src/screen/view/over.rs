//! What lies over the screen: questions, alarms, outputs that differ, all keys.
//!
//! Invariant: a box says by which key it goes away.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Modifier, Style};
use ratatui::widgets::{Clear, Widget};
use retrace_controller::event::channel_name;

use super::{Look, fitted, pane, put_at};
use crate::screen::guide::{self, Grade, Guide};
use crate::screen::hand::{Ask, Hand, Open};
use crate::screen::keys::{Act, Situation, TABLE, row_for};
use crate::screen::model::{Model, Pause};

/// Draws what is to be drawn over the rest.
pub(super) fn draw(out: &mut Buffer, path: Rect, model: &Model, hand: &Hand, guide: &Guide, look: Look) {
    if model.alarm.is_some() && !hand.alarm_aside {
        alarm(out, model, look);
        return;
    }
    match hand.open(model) {
        Open::Help(from) => help(out, model, *from, look),
        Open::Tools => tools(out, model, look),
        Open::Messages => log(out, model, look),
        Open::Prompt(ask, text, wrong) => prompt(out, *ask, text, wrong.as_deref(), look),
        Open::Nothing => match (&model.alarm, model.pause) {
            (None, _) if !model.differ.is_empty() => differ(out, model, look),
            (None, Some(pause)) if guide.grade == Grade::Waits => pause_steps(out, path, pause, look),
            _ => {}
        },
    }
}

/// The steps of a pause, at the foot of the path's pane, so that program and figures stay in view.
fn pause_steps(out: &mut Buffer, path: Rect, pause: Pause, look: Look) {
    let steps = guide::steps(pause);
    let next = steps.iter().position(|&(_, _, done)| !done);
    let line = |(n, (what, act, done)): (usize, &(&str, Act, bool))| {
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
fn boxed(out: &mut Buffer, title: &str, lines: &[String], look: Look) {
    let longest = lines.iter().map(|line| line.chars().count()).max().unwrap_or(0).max(title.chars().count() + 4);
    let width = (longest + 4).min(usize::from(out.area.width)) as u16;
    let height = (lines.len() + 2).min(usize::from(out.area.height.saturating_sub(2))) as u16;
    let at = Rect::new((out.area.width - width) / 2, (out.area.height.saturating_sub(height)) / 2, width, height);
    fill(out, at, title, lines, look);
}

fn fill(out: &mut Buffer, at: Rect, title: &str, lines: &[String], look: Look) {
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

fn help(out: &mut Buffer, model: &Model, from: usize, look: Look) {
    let situation = Situation::of(model);
    // The keys of this situation come first.
    let here = TABLE.iter().filter(|row| row.when & situation as u8 != 0);
    let others = TABLE.iter().filter(|row| row.when & situation as u8 == 0);
    let mut lines = vec![format!("Now, {}:", situation.words())];
    lines.extend(here.map(|row| format!("  {:<7} {}", row.shown, row.long)));
    lines.push(String::new());
    lines.push("At other times:".into());
    lines.extend(others.map(|row| {
        let when = Situation::ALL.into_iter().find(|&s| row.when & s as u8 != 0).map_or("", Situation::words);
        format!("  {:<7} {} ({when})", row.shown, row.long)
    }));
    let room = usize::from(out.area.height.saturating_sub(4));
    let from = from.min(lines.len().saturating_sub(room));
    let more = if from + room < lines.len() { "↓ more · " } else { "" };
    let shown: Vec<String> = lines.into_iter().skip(from).take(room).collect();
    boxed(out, &format!("keys · {more}any other key closes"), &shown, look);
}

fn tools(out: &mut Buffer, model: &Model, look: Look) {
    let room = usize::from(out.area.height.saturating_sub(4));
    let mut lines: Vec<String> = model.facts.tools.iter().take(room).cloned().collect();
    if lines.is_empty() {
        lines.push("No tool table was given (--tools FILE).".into());
    }
    boxed(out, "tools · any key closes", &lines, look);
}

fn log(out: &mut Buffer, model: &Model, look: Look) {
    let room = usize::from(out.area.height.saturating_sub(4));
    let skip = model.messages.len().saturating_sub(room);
    let mut lines: Vec<String> = model
        .messages
        .iter()
        .skip(skip)
        .map(|m| format!("{:9.2} s  line {:>6}  {}", m.time_s, m.line, m.text))
        .collect();
    if lines.is_empty() {
        lines.push("Nothing yet.".into());
    }
    boxed(out, "messages, the newest below · any key closes", &lines, look);
}

fn prompt(out: &mut Buffer, ask: Ask, text: &str, wrong: Option<&str>, look: Look) {
    let (title, question, keys) = match ask {
        Ask::BackBy => ("back up", "Back along the path by how many mm?", "Enter goes · Esc does not"),
        Ask::Output => {
            ("output by hand", "Which output? 3 switches it over; 3+ on, 3- off", "Enter switches · Esc does not")
        }
        Ask::Mdi => ("MDI", "A block, as in a program: G0 X10", "Enter executes it · Esc does not"),
        Ask::WorkZero => ("work zero", "Zero here for which axis? all, or its letter", "Enter sets it · Esc does not"),
        Ask::Program => ("open a program", "Which file? Tab completes its name", "Enter opens it · Esc does not"),
        Ask::Stop => ("stop the job?", "It stops here; the breakpoint is kept.", "y stops it · any other key goes on"),
    };
    let mut lines = vec![question.to_string()];
    if ask != Ask::Stop {
        let shown = text.chars().count().saturating_sub(60);
        let tail: String = text.chars().skip(shown).collect();
        lines.push(format!("> {tail}_"));
    }
    lines.extend(wrong.map(|wrong| format!("! {wrong}")));
    lines.push(keys.into());
    boxed(out, title, &lines, look);
}

fn alarm(out: &mut Buffer, model: &Model, look: Look) {
    let Some(alarm) = &model.alarm else { return };
    let width = usize::from(out.area.width.clamp(20, 90)) - 6;
    let mut lines = folded("What: ", &alarm.cause, width);
    lines.extend(folded("Do:   ", &alarm.remedy, width));
    lines.push(String::new());
    if alarm.is_refusal {
        lines.push("a or Esc closes this box".into());
        boxed(out, "THE PROGRAM IS REFUSED", &lines, look);
    } else {
        lines.push("a clears the alarm · Esc puts this box aside".into());
        boxed(out, &format!("ALARM {}", alarm.number), &lines, look);
    }
}

fn folded(label: &str, text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![label.to_string()];
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + word.chars().count() < width => {
                if !line.ends_with(' ') {
                    line.push(' ');
                }
                line.push_str(word);
            }
            _ => lines.push(format!("      {word}")),
        }
    }
    lines
}

fn differ(out: &mut Buffer, model: &Model, look: Look) {
    let mut lines = vec![format!("{:<16}{:>8}{:>16}", "output", "is", "program wants")];
    let room = usize::from(out.area.height.saturating_sub(9));
    let lists = model.differ.iter().take(room);
    lines.extend(lists.map(|(c, is, wants)| format!("{:<16}{is:>8}{wants:>16}", channel_name(*c))));
    if model.differ.len() > room {
        lines.push(format!("… {} more", model.differ.len() - room));
    }
    lines.push(String::new());
    lines.push("y switches them as the program wants, and goes on".into());
    lines.push("o switches one by hand · r backs up again".into());
    boxed(out, "OUTPUTS DIFFER", &lines, look);
}
