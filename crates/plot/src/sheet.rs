//! Sheet of a tool path: true proportions, marked axes, a scale bar.
//!
//! Invariant: a millimetre is as long across as it is upward.

use crate::decimate;
use crate::font;
use crate::picture::{Anchor, DisplayList, Pen, Point, Text};
use crate::scale::{Scale, Ticks, decimals, fixed, round_up};
use crate::style::{self, LABEL_SIZE, TICK_SIZE, text};
use crate::tool_path::{Extents, StrokeKind, ToolPath, is_finite};
use crate::view::View;

/// Space between the path and the frame, as a share of the larger extent.
const PADDING: f64 = 0.04;
/// Minimum extent that is drawn, in mm: a single point has none.
const MIN_MM: f64 = 0.01;
/// Minimum height of a frame, as a share of the available height.
const FLATTEST: f32 = 0.3;
/// Minimum distance of two marks in pixels: side by side, and one above the other.
const TICK_GAP_ACROSS: f32 = 62.0;
const TICK_GAP_UP: f32 = 34.0;

/// Part of the drawing available for a frame, in pixels; axis labels are around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct DrawingArea {
    pub(crate) left: f32,
    pub(crate) right: f32,
    pub(crate) top: f32,
    pub(crate) bottom: f32,
}

/// Mapping of millimetres to the drawing.
pub(crate) struct Sheet {
    view: View,
    pub(crate) across: Scale,
    pub(crate) up: Scale,
}

impl Sheet {
    /// Largest scale at which everything fits, the same in both directions.
    pub(crate) fn fitting(path: &ToolPath, view: View, extents: &Extents, room: DrawingArea) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let mut include = |point: [f64; 3]| {
            for (side, value) in view.project(point).into_iter().enumerate() {
                low[side] = low[side].min(value);
                high[side] = high[side].max(value);
            }
        };
        if view == View::Iso {
            corners(extents).into_iter().for_each(&mut include);
        } else {
            path.strokes
                .iter()
                .flat_map(|stroke| &stroke.points)
                .filter(|point| is_finite(point))
                .copied()
                .for_each(include);
        }
        let padding = ((high[0] - low[0]).max(high[1] - low[1]) * PADDING).max(MIN_MM);
        let extent = |side: usize| high[side] - low[side] + 2.0 * padding;
        // The space inside the frame; in the isometric view the labels along the box need some of it.
        let inset = if view == View::Iso { 34.0 } else { 0.0 };
        let space = [room.right - room.left - 2.0 * inset, room.bottom - room.top - 2.0 * inset];
        let per_mm = (f64::from(space[0]) / extent(0)).min(f64::from(space[1]) / extent(1));
        let middle = [(room.left + room.right) / 2.0, (room.top + room.bottom) / 2.0];
        let scale = |side: usize, direction: f32| {
            let length = ((extent(side) * per_mm) as f32).clamp(space[side] * FLATTEST, space[side]);
            let centre = (low[side] + high[side]) / 2.0;
            let half_mm = f64::from(length) / per_mm / 2.0;
            let half_px = direction * length / 2.0;
            Scale {
                low: centre - half_mm,
                high: centre + half_mm,
                low_px: middle[side] - half_px,
                high_px: middle[side] + half_px,
            }
        };
        Self { view, across: scale(0, 1.0), up: scale(1, -1.0) }
    }

    /// Position of a machine point on the drawing.
    pub(crate) fn place(&self, point: [f64; 3]) -> Point {
        let [right, up] = self.view.project(point);
        [self.across.px(right), self.up.px(up)]
    }

    pub(crate) fn draw_strokes(&self, picture: &mut DisplayList, path: &ToolPath, kind: StrokeKind, pen: Pen) {
        // Strokes that follow each other in the same place are one line, so that its dashes continue.
        let mut lines: Vec<Vec<Point>> = Vec::new();
        for stroke in path.of_kind(kind) {
            let points = stroke.points.iter().filter(|point| is_finite(point)).map(|point| self.place(*point));
            let line = decimate::path(points);
            match lines.last_mut() {
                Some(last) if last.last() == line.first() => last.extend(line.into_iter().skip(1)),
                _ => lines.push(line),
            }
        }
        lines.retain(|line| line.len() > 1);
        picture.lines(lines, pen);
    }

    /// Draws a frame with marks and a grid.
    pub(crate) fn draw_axes(&self, picture: &mut DisplayList, [name_across, name_up]: [&str; 2]) {
        let (left, right) = (self.across.low_px, self.across.high_px);
        let (bottom, top) = (self.up.low_px, self.up.high_px);
        let ticks_across = self.across.ticks(TICK_GAP_ACROSS);
        let ticks_up = self.up.ticks(TICK_GAP_UP);
        let mut grid: Vec<Vec<Point>> = Vec::new();
        for &value in &ticks_across.values {
            let x = self.across.px(value);
            grid.push(vec![[x, top], [x, bottom]]);
            picture.line([x, bottom], [x, bottom + 5.0], style::FRAME);
            picture.text(text([x, bottom + 19.0], ticks_across.label(value), TICK_SIZE, Anchor::Middle));
        }
        for &value in &ticks_up.values {
            let y = self.up.px(value);
            grid.push(vec![[left, y], [right, y]]);
            picture.line([left, y], [left - 5.0, y], style::FRAME);
            picture.text(text([left - 9.0, y + 4.3], ticks_up.label(value), TICK_SIZE, Anchor::Right));
        }
        picture.items.insert(0, crate::picture::Item::Lines { lines: grid, pen: style::GRID });
        picture
            .lines(vec![vec![[left, top], [right, top], [right, bottom], [left, bottom], [left, top]]], style::FRAME);
        let middle_across = (left + right) / 2.0;
        picture.text(text([middle_across, bottom + 38.0], format!("{name_across} mm"), LABEL_SIZE, Anchor::Middle));
        let widest =
            ticks_up.values.iter().map(|&value| font::width(&ticks_up.label(value), TICK_SIZE)).fold(0.0, f32::max);
        let at = [left - 18.0 - widest, (top + bottom) / 2.0];
        picture.text(Text { is_upward: true, ..text(at, format!("{name_up} mm"), LABEL_SIZE, Anchor::Middle) });
    }

    /// Draws the box of the extents, marked along three of its edges.
    pub(crate) fn draw_box(&self, picture: &mut DisplayList, extents: &Extents) {
        let all = corners(extents).map(|corner| self.place(corner));
        // Corner numbers count X in bit 0, Y in bit 1, Z in bit 2.
        let edges = (0..8).flat_map(|from| [1, 2, 4].map(|bit| (from, from | bit))).filter(|(from, to)| from != to);
        picture.lines(edges.map(|(from, to)| vec![all[from], all[to]]).collect(), style::GRID);
        let Extents { low, high } = *extents;
        let front = [([low[0], low[1], low[2]], 0, [-0.5, 0.87]), ([high[0], low[1], low[2]], 1, [0.5, 0.87])];
        let left = ([low[0], low[1], low[2]], 2, [-1.0, 0.0]);
        for (from, axis, outward) in front.into_iter().chain([left]) {
            self.draw_edge(picture, from, axis, high[axis], outward);
        }
    }

    /// Draws the marks along one edge of the box, from `from` to `high` on its axis, labelled on its outward side.
    fn draw_edge(&self, picture: &mut DisplayList, from: [f64; 3], axis: usize, high: f64, outward: Point) {
        let at = |value: f64| {
            let mut point = from;
            point[axis] = value;
            self.place(point)
        };
        let beside = |[x, y]: Point, distance: f32| [x + outward[0] * distance, y + outward[1] * distance];
        let (start, end) = (at(from[axis]), at(high));
        let length = (end[0] - start[0]).hypot(end[1] - start[1]);
        picture.line(start, end, style::FRAME);
        let anchor = if outward[0] < 0.0 { Anchor::Right } else { Anchor::Left };
        let ticks = Ticks::within(from[axis], high, f64::from(length / TICK_GAP_ACROSS));
        for &value in ticks.values.iter().filter(|_| length > 8.0) {
            let place = at(value);
            picture.line(place, beside(place, 5.0), style::FRAME);
            let [x, y] = beside(place, 9.0);
            picture.text(text([x, y + 4.3], ticks.label(value), TICK_SIZE, anchor));
        }
        let name = ["X mm", "Y mm", "Z mm"][axis];
        let [x, y] =
            beside([(start[0] + end[0]) / 2.0, (start[1] + end[1]) / 2.0], if axis == 2 { 52.0 } else { 46.0 });
        picture.text(text([x, y + 4.3], name, LABEL_SIZE, anchor));
    }

    /// Draws a bar of a round length up to `right`, next to a legend above `bottom` that ends at `legend_end`; above it
    /// where they would overlap.
    pub(crate) fn draw_scale_bar(&self, picture: &mut DisplayList, right: f32, bottom: f32, legend_end: f32) {
        let per_mm = f64::from(self.across.high_px - self.across.low_px) / (self.across.high - self.across.low);
        let length_mm = round_up(50.0 / per_mm);
        let label = format!("{} mm", fixed(length_mm, decimals(length_mm)));
        let left = right - (length_mm * per_mm) as f32;
        let label_right = left - 8.0;
        let is_clear = label_right - font::width(&label, LABEL_SIZE) > legend_end;
        let y = bottom - if is_clear { 20.0 } else { 44.0 };
        let ends = [left, right].map(|x| vec![[x, y - 4.0], [x, y + 4.0]]);
        let bar = ends.into_iter().chain([vec![[left, y], [right, y]]]).collect();
        picture.lines(bar, Pen { width: 1.5, ..style::FRAME });
        picture.text(text([label_right, y + 4.6], label, LABEL_SIZE, Anchor::Right));
    }
}

/// Corners of the extents; the number of each counts X in bit 0, Y in bit 1, Z in bit 2.
fn corners(extents: &Extents) -> [[f64; 3]; 8] {
    std::array::from_fn(|number| {
        std::array::from_fn(|axis| if number >> axis & 1 == 0 { extents.low[axis] } else { extents.high[axis] })
    })
}
