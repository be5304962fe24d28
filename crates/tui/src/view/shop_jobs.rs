//! Draws the page of the shop's jobs.
//!
//! Invariant: the marked job is always on the page, and the keys that apply are in its title.

use ratatui::buffer::Buffer;

use super::overlay::draw_box;
use super::{Theme, fold};
use crate::model::ScreenModel;
use crate::sheet_text;
use crate::shop_job_page::{ShopJobColumns, ShopJobMark, ShopJobView, empty_lines, marked};
use crate::shop_job_table::{ShopJobRow, ShopJobTable};

/// Most characters of a line.
const MAX_WIDTH: usize = 140;
/// Indent of the texts behind their names.
const INDENT: usize = 14;

/// Draws the page.
pub(super) fn draw(out: &mut Buffer, model: &ScreenModel, mark: &ShopJobMark, theme: Theme) {
    let width = usize::from(out.area.width).saturating_sub(5).min(MAX_WIDTH);
    let table = model.shop_jobs.as_deref();
    let found = table.and_then(|table| Some((table, marked(table, mark.chosen.as_deref())?)));
    let Some((table, row, at)) = found.and_then(|(table, at)| Some((table, table.rows.get(at)?, at))) else {
        let lines: Vec<String> = empty_lines(table).iter().flat_map(|line| fold(line, width, 2)).collect();
        draw_box(out, "jobs of the shop · any key: close", &lines, theme);
        return;
    };
    match mark.view {
        ShopJobView::List => list(out, table, at, width, theme),
        ShopJobView::Details(back) => details(out, row, back, width, theme),
        ShopJobView::Start(pieces) => {
            question(out, table, (row, pieces), sheet_text::turned(model), width.min(100), theme)
        }
    }
}

fn list(out: &mut Buffer, table: &ShopJobTable, at: usize, width: usize, theme: Theme) {
    let room = usize::from(out.area.height).saturating_sub(10).max(1);
    let columns = ShopJobColumns::of(width, &table.rows);
    // As far as possible, as many jobs are shown before the marked one as behind it.
    let first = at.saturating_sub(room / 2).min(table.rows.len().saturating_sub(room));
    // The box has the same width whatever it shows.
    let mut lines = vec![format!("{:width$}", columns.heading())];
    let rows = table.rows.iter().enumerate().skip(first).take(room);
    lines.extend(rows.map(|(number, row)| columns.row(number + 1, row, number == at)));
    lines.push(String::new());
    if let Some(row) = table.rows.get(at) {
        lines.extend(marked_text(row, width));
    }
    if table.hidden > 0 {
        lines.push(format!("{} more: `retrace shop jobs --all`", table.hidden));
    }
    lines.extend((!table.error.is_empty()).then(|| format!("! {}", table.error)));
    let title = format!("jobs of {} · ↑↓ mark · Enter show · c start · Esc close", table.machine);
    draw_box(out, &title, &lines, theme);
}

/// What the columns may have cut off of the marked job, on three lines.
fn marked_text(row: &ShopJobRow, width: usize) -> Vec<String> {
    let texts =
        [("order", &row.order_number), ("note", &row.note), ("material", &row.material), ("from", &row.submitter)];
    let told: Vec<String> =
        texts.iter().filter(|(_, text)| !text.is_empty()).map(|(name, text)| format!("{name}: {text}")).collect();
    let mut lines: Vec<String> = fold(&row.program, width, 2).into_iter().take(1).collect();
    lines.extend(fold(&told.join(" · "), width, 2).into_iter().take(2));
    lines
}

fn named(name: &str, text: &str, width: usize) -> Vec<String> {
    fold(&format!("{name:<INDENT$}{text}"), width, INDENT)
}

fn details(out: &mut Buffer, row: &ShopJobRow, back: usize, width: usize, theme: Theme) {
    let mut lines = named("job", &format!("{} · {}", row.id, row.state), width);
    lines.extend(named("program", &row.program, width));
    lines.extend(row.details.iter().flat_map(|(name, text)| named(name, text, width)));
    lines.extend(row.warnings.iter().flat_map(|warning| named("warning", warning, width)));
    let room = usize::from(out.area.height).saturating_sub(4).max(1);
    let first = back.min(lines.len().saturating_sub(room));
    let lines: Vec<String> = lines.into_iter().skip(first).take(room).collect();
    let start = if row.is_ready { "c start · " } else { "" };
    draw_box(out, &format!("job {} · ↑↓ scroll · {start}any other key: back", row.program), &lines, theme);
}

fn question(
    out: &mut Buffer,
    table: &ShopJobTable,
    asked: (&ShopJobRow, u32),
    turned: Option<String>,
    width: usize,
    theme: Theme,
) {
    let (row, pieces) = asked;
    let facts = row.start_facts(&table.machine_file);
    let mut lines: Vec<String> = facts.iter().flat_map(|(name, text)| named(name, text, width)).collect();
    let most = row.most_pieces;
    let series = (most > 1).then(|| named("series", &format!("{pieces} of at most {most} pieces · ↑↓ change"), width));
    // The keys stay in view, however long the texts are.
    lines.truncate(usize::from(out.area.height).saturating_sub(7).max(1));
    lines.extend(series.into_iter().flatten());
    lines.extend(turned);
    let start = match pieces {
        0 | 1 => "y START: the machine moves · any other key: cancel".to_owned(),
        _ => format!("y START {pieces} pieces, one after the other · any other key: cancel"),
    };
    lines.extend([String::new(), start]);
    let title = if pieces > 1 { "start a series of this job?" } else { "start a piece of this job?" };
    draw_box(out, title, &lines, theme);
}
