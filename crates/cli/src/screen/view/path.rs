//! The tool path in true proportion: what is planned, what was cut, what is retraced, and where the tool is.
//!
//! Invariant: one mm is as long across as it is down; the whole path is in view.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Modifier, Style};

use super::canvas::Canvas;
use super::{Look, pane, put_at};
use crate::screen::hand::View;
use crate::screen::model::{Model, Stage};
use crate::screen::trail::{Knot, Trail};

/// Dots that stay free along each edge.
const MARGIN: f64 = 1.0;

/// From space to the picture's plane, across and up, mm.
fn seen(view: View, at: [f32; 3]) -> [f64; 2] {
    let [x, y, z] = at.map(f64::from);
    match view {
        View::Xy => [x, y],
        View::Xz => [x, z],
        View::Yz => [y, z],
        // isometric, from the front right
        View::Iso => [(x - y) * 0.866, (x + y) * 0.5 + z],
    }
}

/// From mm to dots.
struct Scale {
    view: View,
    least: [f64; 2],
    factor: f64,
    offset: [f64; 2],
    down: f64,
}

impl Scale {
    fn fitting(view: View, corners: &[[f32; 3]], size: [f64; 2]) -> Option<Self> {
        let mut least = [f64::INFINITY; 2];
        let mut greatest = [f64::NEG_INFINITY; 2];
        for at in corners.iter().map(|&corner| seen(view, corner)) {
            for i in 0..2 {
                least[i] = least[i].min(at[i]);
                greatest[i] = greatest[i].max(at[i]);
            }
        }
        let room = size.map(|dots| (dots - 1.0 - 2.0 * MARGIN).max(1.0));
        let span = [0, 1].map(|i| greatest[i] - least[i]);
        if !span.iter().all(|s| s.is_finite()) {
            return None;
        }
        let factor = [0, 1].map(|i| room[i] / span[i].max(1e-3)).into_iter().fold(f64::INFINITY, f64::min);
        let offset = [0, 1].map(|i| MARGIN + (room[i] - span[i] * factor) / 2.0);
        Some(Self { view, least, factor, offset, down: size[1] - 1.0 })
    }

    fn dot(&self, at: [f32; 3]) -> [f64; 2] {
        let seen = seen(self.view, at);
        let [x, up] = [0, 1].map(|i| self.offset[i] + (seen[i] - self.least[i]) * self.factor);
        [x, self.down - up]
    }
}

/// Draws the pane.
pub(super) fn draw(out: &mut Buffer, area: Rect, model: &Model, view: View, look: Look) {
    let name = match view {
        View::Xy => "path X Y",
        View::Xz => "path X Z",
        View::Yz => "path Y Z",
        View::Iso => "path, isometric",
    };
    let mut corners = vec![model.in_space()];
    let mut box_of = |trail: &Trail| {
        if let Some(extent) = trail.extent() {
            corners.extend((0..8).map(|n| [0, 1, 2].map(|i| extent[n >> i & 1][i])));
        }
    };
    box_of(&model.facts.preview.path);
    box_of(&model.trail);
    let title = match span(view, &corners) {
        Some([across, up]) if across + up > 0.0 => format!("{name} · {across:.0} × {up:.0} mm"),
        _ => name.into(),
    };
    let inside = pane(out, area, &title, look);
    legend(out, area, model, look);
    let mut canvas = Canvas::over(inside);
    let Some(scale) = Scale::fitting(view, &corners, canvas.size()) else { return };
    lines(&mut canvas, &scale, model.facts.preview.path.knots(), 3, look.faint());
    lines(&mut canvas, &scale, model.trail.knots(), 1, look.well());
    if model.stage == Stage::Job && model.back_mm() > 0.0 {
        retraced(&mut canvas, &scale, model, look);
    }
    let tool = look.waits().add_modifier(Modifier::BOLD);
    canvas.sign(scale.dot(model.in_space()), '@', tool);
    canvas.show(out);
}

fn span(view: View, corners: &[[f32; 3]]) -> Option<[f64; 2]> {
    let mut ends: Option<[[f64; 2]; 2]> = None;
    for at in corners.iter().map(|&corner| seen(view, corner)) {
        let [least, greatest] = ends.get_or_insert([at; 2]);
        for i in 0..2 {
            least[i] = least[i].min(at[i]);
            greatest[i] = greatest[i].max(at[i]);
        }
    }
    ends.map(|[least, greatest]| [greatest[0] - least[0], greatest[1] - least[1]])
}

/// What the signs mean, in the lower edge.
fn legend(out: &mut Buffer, area: Rect, model: &Model, look: Look) {
    let text = if model.stage == Stage::Job && model.back_mm() > 0.0 {
        " @ tool  o retraced  x furthest "
    } else {
        " @ tool  ⣿ done  ⠡ planned "
    };
    put_at(out, area, 2, area.height.saturating_sub(1), text, look.faint());
}

fn lines<'k>(canvas: &mut Canvas, scale: &Scale, knots: impl Iterator<Item = &'k Knot>, every: usize, style: Style) {
    let mut last: Option<[f64; 2]> = None;
    for knot in knots {
        let at = scale.dot(knot.at);
        if let Some(from) = last {
            canvas.line(from, at, if knot.rapid { 3 * every } else { every }, None, style);
        }
        last = Some(at);
    }
}

/// The stretch from where the tool is to the furthest place.
fn retraced(canvas: &mut Canvas, scale: &Scale, model: &Model, look: Look) {
    let from_mm = model.lengths.at(model.place);
    let style = look.waits();
    let mut last: Option<&Knot> = None;
    for knot in model.trail.knots() {
        if let Some(before) = last.filter(|_| knot.along_mm >= from_mm) {
            let share = if before.along_mm < from_mm && knot.along_mm > before.along_mm {
                ((from_mm - before.along_mm) / (knot.along_mm - before.along_mm)) as f32
            } else {
                0.0
            };
            let begin = [0, 1, 2].map(|i| before.at[i] + share * (knot.at[i] - before.at[i]));
            canvas.line(scale.dot(begin), scale.dot(knot.at), 1, Some('o'), style);
        }
        last = Some(knot);
    }
    if let Some(knot) = last {
        canvas.sign(scale.dot(knot.at), 'x', style.add_modifier(Modifier::BOLD));
    }
}
