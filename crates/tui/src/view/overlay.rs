//! Dialogs over the screen: questions, alarms, outputs that differ, the list of keys.
//!
//! Invariant: a dialog shows the key that closes it.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Modifier, Style};
use ratatui::widgets::{Clear, Widget};
use retrace_controller::ManualTask;

use super::listing::message_text;
use super::{Theme, contours, fold, pane, put_at, shop_jobs, truncate};
use crate::frame_text;
use crate::key_state::{KeyState, OpenDialog};
use crate::keys::{KeyAction, Situation, TABLE, row_for};
use crate::model::{Pause, ScreenModel, ScreenStage};
use crate::pending_question::PendingQuestion;
use crate::program_facts::ToolFacts;
use crate::sheet_text;
use crate::status_hint::{HintLevel, StatusHint};
use crate::status_line;

/// Draws the dialog that is open, if any.
pub(super) fn draw(
    out: &mut Buffer,
    path: Rect,
    model: &ScreenModel,
    key_state: &KeyState,
    hint: &StatusHint,
    theme: Theme,
) {
    if model.alarm.is_some() && !key_state.alarm_aside {
        alarm(out, model, theme);
        return;
    }
    match key_state.open(model) {
        OpenDialog::Help(from) => help(out, model, *from, theme),
        OpenDialog::Tools => tools(out, model, theme),
        OpenDialog::Contours(mark) => contours::draw(out, model, mark.chosen, theme),
        OpenDialog::ShopJobs(mark) => shop_jobs::draw(out, model, mark, theme),
        OpenDialog::Messages(back) => log(out, model, *back, theme),
        OpenDialog::Prompt(ask, text, wrong) => prompt(out, model, *ask, (text, wrong.as_deref()), theme),
        OpenDialog::Nothing => match (&model.alarm, model.pause) {
            (None, _) if model.question.is_some() => question(out, model, theme),
            (None, _) if !model.differing_outputs.is_empty() => differ(out, model, theme),
            (None, Some(pause)) if hint.level == HintLevel::Waiting => pause_steps(out, path, pause, theme),
            _ => {}
        },
    }
}

/// Draws the steps of a pause at the bottom of the path's pane, so that program and readouts stay visible.
fn pause_steps(out: &mut Buffer, path: Rect, pause: Pause, theme: Theme) {
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
    draw_filled_box(out, Rect { y: path.bottom() - height, height, ..path }, "PAUSED: steps to resume", &lines, theme);
}

/// Draws a centred box, as large as its lines and no larger than the screen.
pub(super) fn draw_box(out: &mut Buffer, title: &str, lines: &[String], theme: Theme) {
    let longest = lines.iter().map(|line| line.chars().count()).max().unwrap_or(0).max(title.chars().count() + 4);
    let width = (longest + 4).min(usize::from(out.area.width)) as u16;
    let height = (lines.len() + 2).min(usize::from(out.area.height.saturating_sub(2))) as u16;
    let at = Rect::new((out.area.width - width) / 2, (out.area.height.saturating_sub(height)) / 2, width, height);
    draw_filled_box(out, at, title, lines, theme);
}

fn draw_filled_box(out: &mut Buffer, at: Rect, title: &str, lines: &[String], theme: Theme) {
    let at = at.intersection(out.area);
    Clear.render(at, out);
    let inside = pane(out, at, title, theme);
    for (row, line) in lines.iter().enumerate() {
        let line = truncate(line, usize::from(inside.width).saturating_sub(1));
        put_at(out, inside, 1, row as u16, &line, Style::new());
    }
    let waits = theme.waiting().add_modifier(Modifier::BOLD);
    put_at(out, at, 2, 0, &format!(" {} ", truncate(title, usize::from(at.width).saturating_sub(6))), waits);
}

/// Draws all keys, one page at a time: those of this situation first, then the others by situation.
fn help(out: &mut Buffer, model: &ScreenModel, page: usize, theme: Theme) {
    let width = usize::from(out.area.width).saturating_sub(5);
    let lines: Vec<String> = help_lines(Situation::of(model), width);
    let room = usize::from(out.area.height.saturating_sub(4)).max(1);
    let pages = lines.len().div_ceil(room);
    let page = page % pages.max(1);
    let mut shown: Vec<String> = lines.into_iter().skip(page * room).take(room).collect();
    // Every page has the size of the first, so that the box does not move.
    shown.resize(room.min(shown.len().max(room)), String::new());
    let longest = shown.iter().map(|line| line.chars().count()).max().unwrap_or(0);
    if let Some(first) = shown.first_mut() {
        *first = format!("{first:width$}", width = longest.max(60).min(width));
    }
    draw_box(out, &format!("keys · page {} of {pages} · ↓ next  ↑ previous  Esc close", page + 1), &shown, theme);
}

/// Lines of the key list by situation; a key is listed under the first situation in which it applies.
fn help_lines(situation: Situation, width: usize) -> Vec<String> {
    let mut lines = Vec::new();
    let mut listed: u128 = 0;
    let others = Situation::ALL.into_iter().filter(|&other| other != situation);
    for (number, section) in std::iter::once(situation).chain(others).enumerate() {
        let mut rows = Vec::new();
        for (bit, row) in TABLE.iter().enumerate() {
            if row.situations & section as u8 != 0 && listed >> bit & 1 == 0 {
                listed |= 1 << bit;
                rows.extend(fold(&format!("  {:<7} {}", row.shown, row.long), width, 10));
            }
        }
        if rows.is_empty() {
            continue;
        }
        let now = if number == 0 { "Now, " } else { "Also " };
        lines.push(format!("{now}{}:", section.text()));
        lines.append(&mut rows);
    }
    lines
}

fn tools(out: &mut Buffer, model: &ScreenModel, theme: Theme) {
    let room = usize::from(out.area.height.saturating_sub(4));
    let mut lines: Vec<String> = model.facts.tools.iter().take(room).map(tool_line).collect();
    if lines.is_empty() {
        lines.push("No tool table is loaded (--tools FILE).".into());
    }
    draw_box(out, "tools · any key: close", &lines, theme);
}

/// Draws all messages in full, the newest last; `back` is the number of lines scrolled back.
fn log(out: &mut Buffer, model: &ScreenModel, back: usize, theme: Theme) {
    let room = usize::from(out.area.height.saturating_sub(4)).max(1);
    let width = usize::from(out.area.width).saturating_sub(5);
    let all: Vec<String> = model.messages.iter().flat_map(|message| fold(&message_text(message), width, 26)).collect();
    let end = all.len().saturating_sub(back).max(room.min(all.len()));
    let mut lines = all[end.saturating_sub(room)..end].to_vec();
    if lines.is_empty() {
        lines.push("No messages.".into());
    }
    draw_box(out, "messages, newest last · ↑ ↓ PgUp PgDn scroll · any other key: close", &lines, theme);
}

fn prompt(
    out: &mut Buffer,
    model: &ScreenModel,
    ask: PendingQuestion,
    (text, wrong): (&str, Option<&str>),
    theme: Theme,
) {
    let (title, question, keys) = match ask {
        PendingQuestion::BackBy => {
            ("back by", "Distance back along the path in mm, or a contour such as c3:", "Enter OK · Esc cancel")
        }
        PendingQuestion::Shift => (
            "shift",
            "Start of the cut beside the path, X and Y in mm: 1.5,-0.8; nw; 0; arc or line leads in:",
            "Enter OK · Esc cancel",
        ),
        PendingQuestion::Output => {
            ("output", "Output number or name, then + or -, such as 3+:", "Enter OK · Esc cancel")
        }
        PendingQuestion::Mdi => ("MDI", "One block, such as G0 X10:", "Enter OK · Esc cancel"),
        PendingQuestion::Probe => (
            "probe",
            "Cycle and its lengths in mm; with g54 to g59.3 the result becomes that zero:",
            "Enter OK, the probe MOVES · Esc cancel",
        ),
        PendingQuestion::WorkZero if model.work_rotation_deg != 0.0 => (
            "work zero, TURNED",
            "Set the zero here for this axis, or all, which stays turned; straight: end the turn:",
            "Enter OK · Esc cancel",
        ),
        PendingQuestion::WorkZero => ("work zero", "Set the zero here for this axis, or all:", "Enter OK · Esc cancel"),
        PendingQuestion::ToolLength => (
            "tool length",
            "Length in mm; with + or -, the difference; at 0: its tip touches Z0 of the work:",
            "Enter OK, moves breakpoint and path · Esc cancel",
        ),
        PendingQuestion::Program => {
            ("open a program", "Program file, Tab completes its name:", "Enter OK · Esc cancel")
        }
        PendingQuestion::StartTurned => {
            let lines = [
                sheet_text::turned(model).unwrap_or_default(),
                "Does the sheet still lie so? E sets its edge anew, z straight ends the turn.".into(),
                "y START · any other key: cancel".into(),
            ];
            draw_box(out, "the same sheet?", &lines, theme);
            return;
        }
        PendingQuestion::StartContour(number) => {
            let question = format!("The program begins at contour {number}: the cutter is lit there.");
            let lines = [Some(question), sheet_text::turned(model), Some("y begin · any other key: cancel".into())];
            draw_box(out, "begin there?", &lines.into_iter().flatten().collect::<Vec<_>>(), theme);
            return;
        }
        PendingQuestion::Frame(shape) => {
            let width = usize::from(out.area.width.clamp(20, 110)) - 6;
            let lines: Vec<String> =
                frame_text::question(model, shape).iter().flat_map(|line| fold(line, width, 0)).collect();
            draw_box(out, "frame?", &lines, theme);
            return;
        }
        PendingQuestion::SheetPoint => {
            let lines = sheet_text::FIRST_POINT.map(String::from);
            draw_box(out, "the edge of the sheet, 1st point", &lines, theme);
            return;
        }
        PendingQuestion::AlignSheet => {
            let keys = "y set zero and direction · n or Esc: forget both points".to_owned();
            let width = usize::from(out.area.width.clamp(20, 110)) - 6;
            let lines: Vec<String> = [Some(sheet_text::of(model)), sheet_text::travel_text(model), Some(keys)]
                .into_iter()
                .flatten()
                .flat_map(|line| fold(&line, width, 0))
                .collect();
            draw_box(out, "the edge of the sheet", &lines, theme);
            return;
        }
        PendingQuestion::TestPulse => (
            "test pulse?",
            "The cutter FIRES HERE for its pulse_s, with the machine at rest.",
            "y fire · any other key: cancel",
        ),
        PendingQuestion::SenseTest => (
            "sense the sheet?",
            "The tool goes DOWN to the sheet here, with the cutter off, and back up. Space stops it.",
            "y sense · any other key: cancel",
        ),
        PendingQuestion::ConsumablesChanged => {
            let mut lines = model.consumables.clone();
            if lines.is_empty() {
                lines.push("Nothing was counted yet.".into());
            }
            if model.stage == ScreenStage::Job {
                lines.push("This job is counted once it is released (u).".into());
            }
            lines.push("0: they are NEW, count from 0 · any other key: close".into());
            draw_box(out, "wear of the consumables", &lines, theme);
            return;
        }
        PendingQuestion::Stop => (
            "stop the job?",
            "The job stops here; `retrace resume` goes on from its breakpoint.",
            "y stop · any other key: cancel",
        ),
    };
    let mut lines = vec![question.to_string()];
    if ask == PendingQuestion::Probe {
        lines.extend(ManualTask::probing_forms().into_iter().map(|form| format!("  {form}")));
    }
    if ask.takes_text() {
        let shown = text.chars().count().saturating_sub(60);
        let tail: String = text.chars().skip(shown).collect();
        lines.push(format!("> {tail}_"));
    }
    lines.extend(wrong.map(|wrong| format!("! {wrong}")));
    lines.push(keys.into());
    draw_box(out, title, &lines, theme);
}

fn alarm(out: &mut Buffer, model: &ScreenModel, theme: Theme) {
    let Some(alarm) = &model.alarm else { return };
    let width = usize::from(out.area.width.clamp(20, 90)) - 6;
    let mut lines = fold(&format!("Cause:  {}", alarm.cause), width, 8);
    lines.extend(fold(&format!("Remedy: {}", alarm.remedy), width, 8));
    lines.push(String::new());
    if alarm.is_refusal {
        lines.push("a or Esc: close".into());
        let has_number = alarm.number.starts_with('E');
        let title = if has_number { format!("NOT STARTED: {}", alarm.number) } else { "PROGRAM REFUSED".into() };
        draw_box(out, &title, &lines, theme);
    } else {
        lines.push("a: clear the alarm · Esc: hide this box".into());
        draw_box(out, &format!("ALARM {}", alarm.number), &lines, theme);
    }
}

fn question(out: &mut Buffer, model: &ScreenModel, theme: Theme) {
    let Some(question) = &model.question else { return };
    let width = usize::from(out.area.width.clamp(20, 110)) - 6;
    let mut lines: Vec<String> = question.lines.iter().flat_map(|line| fold(line, width, 11)).collect();
    lines.push(String::new());
    lines.push("y confirm · n cancel".into());
    draw_box(out, &question.title, &lines, theme);
}

fn differ(out: &mut Buffer, model: &ScreenModel, theme: Theme) {
    let mut lines = vec![format!("{:<16}{:>8}{:>16}  {}", "output", "now", "program expects", "by")];
    let room = usize::from(out.area.height.saturating_sub(9));
    let lists = model.differing_outputs.iter().take(room);
    lines.extend(lists.map(|of| {
        let name = model.facts.output_name(of.channel);
        let by = if of.code.is_empty() { String::new() } else { format!("  {}, line {}", of.code, of.line) };
        format!("{:<16}{:>8}{:>16}{by}", truncate(&name, 15), of.actual, of.expected)
    }));
    if model.differing_outputs.len() > room {
        lines.push(format!("… {} more", model.differing_outputs.len() - room));
    }
    lines.push(String::new());
    let is_cutter = |channel: u8| model.facts.cutters.iter().any(|cutter| cutter.fire == channel);
    let fires = model.differing_outputs.iter().any(|of| of.expected != 0 && is_cutter(of.channel));
    let fires = if fires { ": the cutter FIRES HERE" } else { "" };
    lines.push(format!("y: switch to the expected states and resume{fires}"));
    if model.cut_end_line.is_some() {
        lines.push("k: recover the interrupted cut: go back and cut on".into());
    }
    lines.push("o: switch one output · r: reverse run".into());
    lines.push("Nothing is switched before you choose.".into());
    draw_box(out, "OUTPUTS DIFFER", &lines, theme);
}

/// Line of a tool.
fn tool_line(tool: &ToolFacts) -> String {
    format!("T{:<4} D {:>8.3}  Z {:>9.3}  {}", tool.number, tool.diameter_mm, tool.length_mm, tool.name)
}
