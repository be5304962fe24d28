//! Draws the page of contours.
//!
//! Invariant: the marked contour is always on the page.

use ratatui::buffer::Buffer;

use super::overlay::draw_box;
use super::{Theme, fold};
use crate::contour_page;
use crate::model::ScreenModel;

/// Draws the page; `chosen` is the number of the contour that the operator has marked.
pub(super) fn draw(out: &mut Buffer, model: &ScreenModel, chosen: Option<u32>, theme: Theme) {
    let width = usize::from(out.area.width).saturating_sub(5);
    let room = usize::from(out.area.height).saturating_sub(8).max(1);
    let numbers = contour_page::numbers(model);
    let planned = model.facts.contours.as_deref();
    let Some(marked) = contour_page::marked(model, &numbers, chosen) else {
        draw_box(out, "contours · any key: close", &[contour_page::empty_text(model).to_owned()], theme);
        return;
    };
    // As far as possible, as many contours are shown before the marked one as behind it.
    let first = marked.saturating_sub(room / 2).min(numbers.len().saturating_sub(room));
    let mut lines = vec![contour_page::HEADING.to_owned()];
    for (at, &number) in numbers.iter().enumerate().skip(first).take(room) {
        let row = model.contours.row(number, planned);
        lines.extend(row.map(|row| contour_page::row_text(&row, at == marked)));
    }
    let detail = numbers.get(marked).and_then(|&number| model.contours.row(number, planned));
    let detail = detail.map(|row| contour_page::detail_text(model, &row)).unwrap_or_default();
    lines.extend([String::new()].into_iter().chain(fold(&detail, width, 2)));
    // The box has the same width whatever it shows.
    if let Some(heading) = lines.first_mut() {
        *heading = format!("{heading:width$}", width = width.min(86));
    }
    draw_box(out, &contour_page::title(model), &lines, theme);
}
