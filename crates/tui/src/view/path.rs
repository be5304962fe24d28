//! Tool path in true proportion: planned, executed and retraced motion, the tool, and the soft limits.
//!
//! Invariant: a millimetre has the same length across and down; the whole path, or the whole table, is visible unless
//! the drawing is enlarged.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Modifier, Style};

use super::canvas::Canvas;
use super::{Theme, pane, put_at};
use crate::key_state::{Fit, Frame, View};
use crate::model::{ScreenModel, ScreenStage};
use crate::sheet_text;
use crate::trail::TrailPoint;

/// Number of dots left free along each edge.
const MARGIN: f64 = 1.0;

/// Projects a point to the plane of the view, across and up, mm.
fn seen(view: View, at: [f32; 3]) -> [f64; 2] {
    let [x, y, z] = at.map(f64::from);
    match view {
        View::Xy => [x, y],
        View::Xz => [x, z],
        View::Yz => [y, z],
        // isometric, from the front right
        View::Iso => [(x - y) * 0.866, (x + y) * 0.5 + z],
        View::Zx => [z, x],
    }
}

/// Scale from mm to dots.
struct Scale {
    view: View,
    /// Point in the middle of the pane, mm.
    centre: [f64; 2],
    /// Dots per mm.
    factor: f64,
    /// Middle of the pane, dots.
    middle: [f64; 2],
}

impl Scale {
    fn fitting((view, frame): (View, Frame), corners: &[[f32; 3]], size: [f64; 2]) -> Option<Self> {
        let [least, greatest] = ends(view, corners)?;
        let room = size.map(|dots| (dots - 1.0 - 2.0 * MARGIN).max(1.0));
        let span = [0, 1].map(|i| greatest[i] - least[i]);
        if !span.iter().all(|s| s.is_finite()) {
            return None;
        }
        let fitted = [0, 1].map(|i| room[i] / span[i].max(1e-3)).into_iter().fold(f64::INFINITY, f64::min);
        let middle = size.map(|dots| (dots - 1.0) / 2.0);
        // Panning is relative to the fitted view.
        let centre = [0, 1].map(|i| (least[i] + greatest[i]) / 2.0 + frame.pan[i] * room[i] / fitted);
        Some(Self { view, centre, factor: fitted * frame.zoom, middle })
    }

    fn dot(&self, at: [f32; 3]) -> [f64; 2] {
        let seen = seen(self.view, at);
        let [x, up] = [0, 1].map(|i| (seen[i] - self.centre[i]) * self.factor);
        [self.middle[0] + x, self.middle[1] - up]
    }
}

/// Minimum and maximum of the projection of these points, mm.
fn ends(view: View, corners: &[[f32; 3]]) -> Option<[[f64; 2]; 2]> {
    let mut ends: Option<[[f64; 2]; 2]> = None;
    for at in corners.iter().map(|&corner| seen(view, corner)) {
        let [least, greatest] = ends.get_or_insert([at; 2]);
        for i in 0..2 {
            least[i] = least[i].min(at[i]);
            greatest[i] = greatest[i].max(at[i]);
        }
    }
    ends
}

/// Corners of the box between two points.
fn corners_of([least, greatest]: [[f32; 3]; 2]) -> [[f32; 3]; 8] {
    std::array::from_fn(|n| [0, 1, 2].map(|i| [least, greatest][n >> i & 1][i]))
}

/// Volume inside the soft limits, minimum and maximum, mm; 0 for a missing axis.
fn table(model: &ScreenModel) -> [[f32; 3]; 2] {
    let travel =
        |end: usize| model.facts.space().map(|axis| axis.map_or(0.0, |i| model.facts.axes[i].travel_mm[end] as f32));
    [travel(0), travel(1)]
}

/// Draws the pane.
pub(super) fn draw(out: &mut Buffer, area: Rect, model: &ScreenModel, (view, frame): (View, Frame), theme: Theme) {
    let name = match view {
        View::Xy => "path X Y",
        View::Xz => "path X Z",
        View::Yz => "path Y Z",
        View::Iso => "path, isometric",
        View::Zx => "path Z X",
    };
    let mut corners = vec![model.in_space()];
    let placed = sheet_text::placed(model);
    let placed_extent = placed.and_then(|placed| placed.path.extent());
    for extent in [model.facts.preview.path.extent(), model.trail.extent(), placed_extent].into_iter().flatten() {
        corners.extend(corners_of(extent));
    }
    let span = ends(view, &corners).map_or([0.0; 2], |[least, greatest]| [0, 1].map(|i| greatest[i] - least[i]));
    let limits = corners_of(table(model));
    if frame.fit == Fit::Table {
        corners.extend(limits);
    }
    let mut title = name.to_string();
    if span[0] + span[1] > 0.0 {
        title += &format!(" · {:.0} × {:.0} mm", span[0], span[1]);
    }
    if frame.zoom > 1.0 {
        title += &format!(" · ×{:.0}", frame.zoom);
    }
    if placed.is_some() {
        title += " · as it will lie";
    }
    let inside = pane(out, area, &title, theme);
    legend(out, area, model, theme);
    let mut canvas = Canvas::over(inside);
    let Some(scale) = Scale::fitting((view, frame), &corners, canvas.size()) else { return };
    frame_of_limits(&mut canvas, &scale, &limits, theme);
    let planned = if placed.is_some() { [theme.faint(); 2] } else { [theme.plain(), theme.faint()] };
    lines(&mut canvas, &scale, model.facts.preview.path.corners(), [3, 9], planned);
    if let Some(placed) = placed {
        lines(&mut canvas, &scale, placed.path.corners(), [1, 9], [theme.waiting(), theme.faint()]);
    }
    lines(&mut canvas, &scale, model.trail.corners(), [1, 4], [theme.normal(); 2]);
    if model.stage == ScreenStage::Job && model.back_mm() > 0.0 {
        retraced(&mut canvas, &scale, model, theme);
    }
    let tool = theme.waiting().add_modifier(Modifier::BOLD);
    canvas.sign(scale.dot(model.in_space()), '@', tool);
    canvas.show(out);
}

/// Draws the edges of the volume inside the soft limits.
fn frame_of_limits(canvas: &mut Canvas, scale: &Scale, corners: &[[f32; 3]; 8], theme: Theme) {
    for from in 0..8usize {
        for to in [1, 2, 4].map(|bit| from | bit).into_iter().filter(|&to| to != from) {
            let (a, b) = (scale.dot(corners[from]), scale.dot(corners[to]));
            if a != b {
                canvas.line(a, b, 2, None, theme.limits());
            }
        }
    }
}

/// Draws the legend in the lower edge.
fn legend(out: &mut Buffer, area: Rect, model: &ScreenModel, theme: Theme) {
    let text = if model.stage == ScreenStage::Job && model.back_mm() > 0.0 {
        " @ tool  o retraced  x furthest "
    } else {
        " @ tool  ⣿ done  ⠡ planned  ⠁ rapid "
    };
    put_at(out, area, 2, area.height.saturating_sub(1), text, theme.faint());
}

/// Draws a line through points; `every` and `styles` are the dot spacing and style of cuts and of rapid moves.
fn lines<'k>(
    canvas: &mut Canvas,
    scale: &Scale,
    knots: impl Iterator<Item = &'k TrailPoint>,
    every: [usize; 2],
    styles: [Style; 2],
) {
    let mut last: Option<[f64; 2]> = None;
    for corner in knots {
        let at = scale.dot(corner.at);
        if let Some(from) = last {
            let kind = usize::from(corner.rapid);
            canvas.line(from, at, every[kind], None, styles[kind]);
        }
        last = Some(at);
    }
}

/// Draws the section from the tool to the furthest place.
fn retraced(canvas: &mut Canvas, scale: &Scale, model: &ScreenModel, theme: Theme) {
    let from_mm = model.lengths.length_at(model.place);
    let style = theme.waiting();
    let mut last: Option<&TrailPoint> = None;
    for corner in model.trail.corners() {
        if let Some(before) = last.filter(|_| corner.along_mm >= from_mm) {
            let share = if before.along_mm < from_mm && corner.along_mm > before.along_mm {
                ((from_mm - before.along_mm) / (corner.along_mm - before.along_mm)) as f32
            } else {
                0.0
            };
            let begin = [0, 1, 2].map(|i| before.at[i] + share * (corner.at[i] - before.at[i]));
            canvas.line(scale.dot(begin), scale.dot(corner.at), 1, Some('o'), style);
        }
        last = Some(corner);
    }
    if let Some(corner) = last {
        canvas.sign(scale.dot(corner.at), 'x', style.add_modifier(Modifier::BOLD));
    }
}
