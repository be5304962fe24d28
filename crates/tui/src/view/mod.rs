//! Renders the whole screen: from the model to terminal cells.
//!
//! Invariant: a pure function of model, key state, size and time. It draws something at every size, and nothing is
//! expressed by colour alone.

mod canvas;
mod contours;
mod listing;
mod overlay;
mod path;
mod readouts;
mod shop_jobs;

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Color, Modifier, Style};
use ratatui::widgets::{Block, Widget};

use crate::cut_text;
use crate::key_state::KeyState;
use crate::keys::{self, KeyAction};
use crate::layout::{self, MIN_SIZE};
use crate::model::{ScreenModel, ScreenStage};
use crate::program_facts::Planned;
use crate::status_hint::{HintLevel, StatusHint};
use crate::status_line;

/// Styles of the screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Theme {
    /// Whether colour may be used.
    pub colour: bool,
}

impl Theme {
    /// Theme from the environment: no colour where `NO_COLOR` is set or the terminal has none.
    #[must_use]
    pub(crate) fn of_environment() -> Self {
        let unwanted = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
        let has_none = std::env::var("TERM").is_ok_and(|term| term == "dumb" || term.starts_with("vt"));
        Self { colour: !unwanted && !has_none }
    }

    fn coloured(self, colour: Color) -> Style {
        if self.colour { Style::new().fg(colour) } else { Style::new() }
    }

    fn plain(self) -> Style {
        Style::new()
    }

    fn limits(self) -> Style {
        self.coloured(Color::Blue)
    }

    fn normal(self) -> Style {
        self.coloured(Color::Green)
    }

    fn waiting(self) -> Style {
        self.coloured(Color::Yellow)
    }

    fn faint(self) -> Style {
        self.coloured(Color::DarkGray)
    }

    fn of(self, grade: HintLevel) -> Style {
        match grade {
            HintLevel::Normal => self.normal(),
            HintLevel::Waiting => self.waiting(),
            HintLevel::Alarm => self.coloured(Color::Red).add_modifier(Modifier::BOLD),
        }
    }
}

/// Draws the screen.
pub(crate) fn draw(out: &mut Buffer, model: &ScreenModel, key_state: &KeyState, theme: Theme, now_ms: u64) {
    let area = out.area;
    let Some(panes) = layout::panes(area.width, area.height, model.facts.axes.len()) else {
        too_small(out, model);
        return;
    };
    let hint = status_line::of(model);
    draw_header(out, panes.head, model, &hint, theme);
    draw_reason(out, panes.why, model, &hint, theme);
    listing::program(out, panes.program, model, theme);
    path::draw(out, panes.path, model, (key_state.view(model), key_state.frame), theme);
    readouts::position(out, panes.position, model, key_state, theme);
    readouts::motion(out, panes.motion, model, theme);
    readouts::state(out, panes.state, model, key_state, theme);
    listing::messages(out, panes.messages, model, theme);
    key_line(out, panes.keys, model, &hint, key_state.notice(now_ms), theme);
    overlay::draw(out, panes.path, model, key_state, &hint, theme);
}

/// Text for a terminal below the minimum size: state, reason and the hold key.
fn too_small(out: &mut Buffer, model: &ScreenModel) {
    let hint = status_line::of(model);
    let lines = [
        format!("needs {} x {}", MIN_SIZE.0, MIN_SIZE.1),
        hint.status.to_string(),
        hint.reason,
        "Space: feed hold".into(),
    ];
    for (y, line) in (out.area.y..out.area.bottom()).zip(lines) {
        put(out, Rect { y, height: 1, ..out.area }, 0, &line, Style::new());
    }
}

fn draw_header(out: &mut Buffer, area: Rect, model: &ScreenModel, hint: &StatusHint, theme: Theme) {
    // A dry run is shown first while it is on.
    let word = if model.dry_run { format!("DRY {}", hint.status) } else { hint.status.to_owned() };
    let mut style = Style::new().add_modifier(Modifier::REVERSED | Modifier::BOLD);
    if theme.colour {
        style = style.patch(theme.of(hint.level));
    }
    out.set_style(area, style);
    let time = match (&model.stage, model.time_remaining()) {
        (ScreenStage::Job, _) if model.is_at_program_end() => format!("{} run", clock(model.run_s())),
        (ScreenStage::Job, Some(left)) => {
            let about = if left.exact { "" } else { "about " };
            format!("{} run · {about}{} left", clock(model.run_s()), clock(left.seconds))
        }
        (ScreenStage::Job, None) if model.facts.planned == Planned::Calculating => {
            format!("{} run · calculating …", clock(model.run_s()))
        }
        (ScreenStage::Job, None) => format!("{} run · end unknown", clock(model.run_s())),
        (ScreenStage::Ended(_), _) => format!("{} run", clock(model.run_s())),
        (ScreenStage::Setup | ScreenStage::Resuming, _) => match model.facts.planned {
            Planned::Known(s) => format!("{} of motion", clock(s)),
            Planned::Calculating => "calculating …".into(),
            Planned::Unknown => String::new(),
        },
    };
    let width = area.width as usize;
    let name = format!("{} on {}", model.facts.program.name, model.facts.machine);
    let name = truncate(&name, width.saturating_sub(word.len() + time.chars().count() + 8));
    put(out, area, 1, &format!("{word}  {name}"), style);
    put(out, area, (width.saturating_sub(time.chars().count() + 1)) as u16, &time, style);
}

/// Draws why the machine waits and the first keys that apply, as many as fit.
fn draw_reason(out: &mut Buffer, area: Rect, model: &ScreenModel, hint: &StatusHint, theme: Theme) {
    let mut text = hint.reason.clone();
    for (named, row) in hint.actions.iter().filter_map(|&act| keys::row_for(act)).take(3).enumerate() {
        let sign = if named == 0 { " — " } else { " · " };
        let mut labels = vec![long_label(row.action, row.short).to_owned()];
        if row.action == KeyAction::CycleStart {
            let fires = cut_text::start_fires(model);
            labels = if fires.is_empty() { labels } else { fires };
        }
        let room = usize::from(area.width).saturating_sub(text.chars().count() + 2);
        let mut more = labels.iter().map(|label| format!("{sign}{} {label}", row.shown));
        match more.find(|more| more.chars().count() <= room) {
            Some(more) => text += &more,
            None => break,
        }
    }
    put(out, area, 1, &truncate(&text, usize::from(area.width).saturating_sub(2)), theme.of(hint.level));
}

/// Long label of an action.
fn long_label(act: KeyAction, short: &'static str) -> &'static str {
    match act {
        KeyAction::CycleStart => "cycle start",
        KeyAction::Reverse => "reverse",
        KeyAction::Wheel => "handwheel",
        KeyAction::Hold => "feed hold",
        KeyAction::Leave => "forward, resume",
        KeyAction::ClearAlarm => "clear the alarm",
        KeyAction::Home => "home all axes",
        KeyAction::Spindle => "spindle stop/start",
        _ => short,
    }
}

/// Draws the keys that apply now, as many as fit; or the notice about the last key.
fn key_line(out: &mut Buffer, area: Rect, model: &ScreenModel, hint: &StatusHint, notice: Option<&str>, theme: Theme) {
    if let Some(notice) = notice {
        put(out, area, 1, notice, theme.waiting().add_modifier(Modifier::BOLD));
        return;
    }
    // The cutter key of a machine with a cutter is always shown.
    let help = if model.facts.cutters.is_empty() { "? all keys" } else { "x cutter off  ? all keys" };
    let end = area.width.saturating_sub(help.len() as u16 + 1);
    let mut x = 1;
    for row in hint.actions.iter().filter_map(|&act| keys::row_for(act)) {
        let width = (row.shown.chars().count() + row.short.chars().count() + 1) as u16;
        if x + width + 1 > end {
            break;
        }
        put(out, area, x, row.shown, Style::new().add_modifier(Modifier::REVERSED));
        put(out, area, x + row.shown.chars().count() as u16 + 1, row.short, Style::new());
        x += width + 2;
    }
    put(out, area, end, help, Style::new().add_modifier(Modifier::BOLD));
}

/// Writes a text into the first row of an area, from column `x`. Text beyond the area is cut off; control characters
/// become blanks.
fn put(out: &mut Buffer, area: Rect, x: u16, text: &str, style: Style) {
    let area = area.intersection(out.area);
    if area.height == 0 || x >= area.width {
        return;
    }
    let clean: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    out.set_stringn(area.x + x, area.y, clean, usize::from(area.width - x), style);
}

/// Writes a text into a row of the area; see [`put`].
fn put_at(out: &mut Buffer, area: Rect, x: u16, row: u16, text: &str, style: Style) {
    if row < area.height {
        put(out, Rect { y: area.y + row, height: 1, ..area }, x, text, style);
    }
}

/// Draws a pane with border and title. Returns the area inside.
fn pane(out: &mut Buffer, area: Rect, title: &str, theme: Theme) -> Rect {
    let block = Block::bordered().border_style(theme.faint());
    let inside = block.inner(area);
    block.render(area, out);
    let title = truncate(title, usize::from(area.width).saturating_sub(6));
    put(out, area, 2, &format!(" {title} "), Style::new().add_modifier(Modifier::BOLD));
    inside
}

/// Folds a text into lines of at most `width` characters, between words where possible; continuation lines are
/// indented.
fn fold(text: &str, width: usize, indent: usize) -> Vec<String> {
    let (width, indent) = (width.max(8), indent.min(width / 2));
    let mut lines = Vec::new();
    let mut rest: Vec<char> = text.trim_end().chars().collect();
    while rest.len() > width {
        let first_word = if lines.is_empty() { 0 } else { indent };
        let end = (first_word + 1..=width).rev().find(|&at| rest[at] == ' ' && rest[at - 1] != ' ').unwrap_or(width);
        let behind: Vec<char> = rest.split_off(end).into_iter().skip_while(|&c| c == ' ').collect();
        lines.push(rest.iter().collect());
        rest = std::iter::repeat_n(' ', indent).chain(behind).collect();
    }
    lines.push(rest.into_iter().collect());
    lines
}

/// Cuts a text to `width` characters; an ellipsis marks the cut.
fn truncate(text: &str, width: usize) -> String {
    if text.chars().count() <= width {
        return text.into();
    }
    let mut cut: String = text.chars().take(width.saturating_sub(1)).collect();
    cut.push('…');
    cut
}

/// Formats a duration as minutes and seconds, or with hours.
fn clock(seconds: f64) -> String {
    let whole = seconds.clamp(0.0, 3.6e9).round() as u64;
    let (hours, minutes, seconds) = (whole / 3600, whole / 60 % 60, whole % 60);
    if hours > 0 { format!("{hours}:{minutes:02}:{seconds:02}") } else { format!("{minutes}:{seconds:02}") }
}
