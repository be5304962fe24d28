//! The drawing of a tool path: true proportions, marked axes, extents, legend and a bar for the scale.

use super::decimate;
use super::font;
use super::picture::{Anchor, Colour, Pen, Picture, Point, Size, Text};
use super::scale::{Scale, Ticks, decimals, fixed, round_up, short};
use super::style::{self, LABEL_SIZE, TICK_SIZE, TITLE_SIZE, text};
use super::tool_path::{Extents, StrokeKind, ToolPath, is_finite};
use super::view::View;

/// Space around the frame, in pixels: left, right, above, below.
const LEFT: f32 = 78.0;
const RIGHT: f32 = 26.0;
const ABOVE: f32 = 66.0;
const BELOW: f32 = 84.0;
/// Space between the path and the frame, as a share of the larger extent.
const PADDING: f64 = 0.04;
/// The smallest extent that is drawn, in mm: a single point has none.
const SMALLEST_MM: f64 = 0.01;
/// A frame is no flatter than this share of the space there is.
const FLATTEST: f32 = 0.3;
/// The least distance of two marks in pixels: side by side, and one above the other.
const TICK_GAP_ACROSS: f32 = 62.0;
const TICK_GAP_UP: f32 = 34.0;
const MARK_PX: f32 = 6.0;

/// Draws a tool path.
#[must_use]
pub fn draw_path(path: &ToolPath, view: View, size: Size) -> Picture {
    let mut picture = Picture::new(size, &format!("tool path of {}", path.title));
    let Some(extents) = path.extents() else {
        draw_heading(&mut picture, &path.title, view.name(), "no motion");
        return picture;
    };
    let sheet = Sheet::fitting(path, view, &extents, size);
    let told = path.program_extents().unwrap_or(extents);
    let millimetres = |axis: usize| format!("{} … {}", short(told.low[axis], 3), short(told.high[axis], 3));
    let summary = format!("X {}   Y {}   Z {} mm", millimetres(0), millimetres(1), millimetres(2));
    draw_heading(&mut picture, &path.title, view.name(), &summary);
    match view.axes() {
        Some(names) => sheet.draw_axes(&mut picture, names),
        None => sheet.draw_box(&mut picture, &extents),
    }
    sheet.draw_strokes(&mut picture, path, StrokeKind::Retraced, style::RETRACED);
    sheet.draw_strokes(&mut picture, path, StrokeKind::Rapid, style::RAPID);
    sheet.draw_strokes(&mut picture, path, StrokeKind::Feed, style::FEED);
    if let Some([start, end]) = path.ends() {
        draw_end(&mut picture, sheet.place(end));
        draw_start(&mut picture, sheet.place(start));
    }
    let legend_end = draw_legend(&mut picture, path, size);
    sheet.draw_scale_bar(&mut picture, size, legend_end);
    picture
}

/// How millimetres lie on the drawing.
struct Sheet {
    view: View,
    across: Scale,
    up: Scale,
}

impl Sheet {
    /// The largest scale at which everything fits, the same in both directions.
    fn fitting(path: &ToolPath, view: View, extents: &Extents, size: Size) -> Self {
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
        let padding = ((high[0] - low[0]).max(high[1] - low[1]) * PADDING).max(SMALLEST_MM);
        let extent = |side: usize| high[side] - low[side] + 2.0 * padding;
        // The space inside the frame; in the isometric view the labels along the box need some of it.
        let inset = if view == View::Iso { 34.0 } else { 0.0 };
        let space = [size.width() - LEFT - RIGHT - 2.0 * inset, size.height() - ABOVE - BELOW - 2.0 * inset];
        let per_mm = (f64::from(space[0]) / extent(0)).min(f64::from(space[1]) / extent(1));
        let middle = [LEFT + inset + space[0] / 2.0, ABOVE + inset + space[1] / 2.0];
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

    /// Where a point of the machine stands on the drawing.
    fn place(&self, point: [f64; 3]) -> Point {
        let [right, up] = self.view.project(point);
        [self.across.px(right), self.up.px(up)]
    }

    fn draw_strokes(&self, picture: &mut Picture, path: &ToolPath, kind: StrokeKind, pen: Pen) {
        // What follows at once in the same place is one line: a dash then runs on over it.
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

    /// A frame with marks and a grid.
    fn draw_axes(&self, picture: &mut Picture, [name_across, name_up]: [&str; 2]) {
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
        picture.items.insert(0, super::picture::Item::Lines { lines: grid, pen: style::GRID });
        picture
            .lines(vec![vec![[left, top], [right, top], [right, bottom], [left, bottom], [left, top]]], style::FRAME);
        let middle_across = (left + right) / 2.0;
        picture.text(text([middle_across, bottom + 38.0], format!("{name_across} mm"), LABEL_SIZE, Anchor::Middle));
        let widest =
            ticks_up.values.iter().map(|&value| font::width(&ticks_up.label(value), TICK_SIZE)).fold(0.0, f32::max);
        let at = [left - 18.0 - widest, (top + bottom) / 2.0];
        picture.text(Text { is_upward: true, ..text(at, format!("{name_up} mm"), LABEL_SIZE, Anchor::Middle) });
    }

    /// The box of the extents, marked along three of its edges.
    fn draw_box(&self, picture: &mut Picture, extents: &Extents) {
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

    /// Marks along one edge of the box, from `from` to `high` on its axis, labelled on its outward side.
    fn draw_edge(&self, picture: &mut Picture, from: [f64; 3], axis: usize, high: f64, outward: Point) {
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

    /// A bar of a round length at the lower right; above the legend where it would meet it.
    fn draw_scale_bar(&self, picture: &mut Picture, size: Size, legend_end: f32) {
        let per_mm = f64::from(self.across.high_px - self.across.low_px) / (self.across.high - self.across.low);
        let length_mm = round_up(50.0 / per_mm);
        let label = format!("{} mm", fixed(length_mm, decimals(length_mm)));
        let right = size.width() - RIGHT;
        let left = right - (length_mm * per_mm) as f32;
        let label_right = left - 8.0;
        let is_clear = label_right - font::width(&label, LABEL_SIZE) > legend_end;
        let y = size.height() - if is_clear { 20.0 } else { 44.0 };
        let ends = [left, right].map(|x| vec![[x, y - 4.0], [x, y + 4.0]]);
        let bar = ends.into_iter().chain([vec![[left, y], [right, y]]]).collect();
        picture.lines(bar, Pen { width: 1.5, ..style::FRAME });
        picture.text(text([label_right, y + 4.6], label, LABEL_SIZE, Anchor::Right));
    }
}

/// The corners of the extents; the number of each counts X in bit 0, Y in bit 1, Z in bit 2.
fn corners(extents: &Extents) -> [[f64; 3]; 8] {
    std::array::from_fn(|number| {
        std::array::from_fn(|axis| if number >> axis & 1 == 0 { extents.low[axis] } else { extents.high[axis] })
    })
}

/// The title, what is seen, and a line below.
pub(super) fn draw_heading(picture: &mut Picture, title: &str, view: &str, summary: &str) {
    let right = picture.size.width() - RIGHT;
    picture.text(Text { colour: style::PALE_INK, ..text([right, 28.0], view, LABEL_SIZE, Anchor::Right) });
    let space = right - 16.0 - font::width(view, LABEL_SIZE) - RIGHT;
    picture.text(Text {
        is_bold: true,
        ..text([RIGHT, 28.0], shortened(title, TITLE_SIZE, space), TITLE_SIZE, Anchor::Left)
    });
    let summary = shortened(summary, LABEL_SIZE, right - RIGHT);
    picture.text(Text { colour: style::PALE_INK, ..text([RIGHT, 49.0], summary, LABEL_SIZE, Anchor::Left) });
}

/// A text cut to the space there is.
fn shortened(words: &str, size: f32, space: f32) -> String {
    if font::width(words, size) <= space {
        return words.to_owned();
    }
    let mut short: String = words.to_owned();
    while !short.is_empty() && font::width(&short, size) + font::width(" …", size) > space {
        short.pop();
    }
    short.push('…');
    short
}

fn draw_start(picture: &mut Picture, [x, y]: Point) {
    let ring = |radius: f32| {
        (0..24).map(move |step| {
            let (sin, cos) = (step as f32 / 24.0 * std::f32::consts::TAU).sin_cos();
            [x + radius * cos, y + radius * sin]
        })
    };
    picture.area(&ring(MARK_PX).collect::<Vec<_>>(), style::START);
    picture.area(&ring(MARK_PX * 0.4).collect::<Vec<_>>(), style::PAPER);
}

fn draw_end(picture: &mut Picture, [x, y]: Point) {
    let square = |half: f32| [[x - half, y - half], [x + half, y - half], [x + half, y + half], [x - half, y + half]];
    picture.area(&square(MARK_PX), style::END);
    picture.area(&square(MARK_PX * 0.35), style::PAPER);
}

/// What each line and mark means in one row below the frame, with lengths where there is room; returns where it ends.
fn draw_legend(picture: &mut Picture, path: &ToolPath, size: Size) -> f32 {
    let kinds = [
        ("feed", StrokeKind::Feed, style::FEED),
        ("rapid", StrokeKind::Rapid, style::RAPID),
        ("retraced", StrokeKind::Retraced, style::RETRACED),
    ];
    let kinds = kinds.into_iter().filter(|(_, kind, _)| path.of_kind(*kind).next().is_some());
    let mut entries: Vec<(String, String, Pen)> = kinds
        .map(|(name, kind, pen)| (name.to_owned(), format!(" {} mm", fixed(path.length_mm(kind), 1)), pen))
        .collect();
    let labels: f32 =
        entries.iter().map(|(name, length, _)| font::width(&format!("{name}{length}"), LABEL_SIZE) + 64.0).sum();
    if RIGHT + labels + 140.0 > size.width() {
        entries.iter_mut().for_each(|(_, length, _)| length.clear());
    }
    let y = size.height() - 20.0;
    let mut x = RIGHT;
    for (name, length, pen) in entries {
        // Round ends reach beyond the line by half its width.
        let inset = pen.width / 2.0;
        picture.line([x + inset, y], [x + 30.0 - inset, y], pen);
        x = label_beside(picture, [x + 37.0, y], name + &length, style::INK);
    }
    draw_start(picture, [x + MARK_PX, y]);
    x = label_beside(picture, [x + 20.0, y], "start".to_owned(), style::INK);
    draw_end(picture, [x + MARK_PX, y]);
    label_beside(picture, [x + 20.0, y], "end".to_owned(), style::INK)
}

/// Writes a label of the legend and returns where the next one may begin.
pub(super) fn label_beside(picture: &mut Picture, [x, y]: Point, label: String, colour: Colour) -> f32 {
    let end = x + font::width(&label, LABEL_SIZE) + 24.0;
    picture.text(Text { colour, ..text([x, y + 4.6], label, LABEL_SIZE, Anchor::Left) });
    end
}

#[cfg(test)]
mod tests {
    use super::super::picture::Item;
    use super::super::tool_path::Stroke;
    use super::*;
    use proptest::prelude::*;

    fn sized(width: u32, height: u32) -> Size {
        Size::pixels(width, height).expect("the sizes of these tests are allowed")
    }

    proptest! {
        #[test]
        fn proportions_are_true_and_everything_is_on_the_sheet(
            points in prop::collection::vec(prop::array::uniform3(-2000.0..2000.0_f64), 1..20),
            stretch in 1e-3..1.0_f64,
            width in 480_u32..2000,
            height in 320_u32..2000,
        ) {
            let points: Vec<_> = points.into_iter().map(|[x, y, z]| [x, y * stretch, z * stretch]).collect();
            let kinds = [StrokeKind::Rapid, StrokeKind::Feed, StrokeKind::Retraced];
            let strokes = kinds.map(|kind| Stroke { kind, points: points.clone() }).to_vec();
            let path = ToolPath { title: "a program with a long name".repeat(4), strokes };
            let extents = path.extents().expect("there is a point");
            for view in [View::Xy, View::Xz, View::Yz, View::Iso] {
                let sheet = Sheet::fitting(&path, view, &extents, sized(width, height));
                let per_mm = |scale: &Scale| f64::from((scale.high_px - scale.low_px).abs()) / (scale.high - scale.low);
                let (across, up) = (per_mm(&sheet.across), per_mm(&sheet.up));
                prop_assert!((across / up - 1.0).abs() < 1e-4, "{across} {up}");
                let picture = draw_path(&path, view, sized(width, height));
                for item in &picture.items {
                    let Item::Lines { lines, .. } = item else { continue };
                    for [x, y] in lines.iter().flatten() {
                        prop_assert!((0.0..=width as f32).contains(x) && (0.0..=height as f32).contains(y));
                    }
                }
            }
        }
    }

    #[test]
    fn a_path_without_a_point_is_a_sheet_that_says_so() {
        let picture = draw_path(&ToolPath::default(), View::Xy, sized(480, 320));
        assert!(picture.to_svg().contains("aria-label=\"no motion\""));
    }

    #[test]
    fn a_feed_a_rapid_and_a_retraced_stretch_are_told_apart() {
        let stroke = |kind, y: f64| Stroke { kind, points: vec![[0.0, y, 0.0], [10.0, y, 0.0]] };
        let kinds = [(StrokeKind::Feed, 0.0), (StrokeKind::Rapid, 5.0), (StrokeKind::Retraced, 0.0)];
        let strokes = kinds.map(|(kind, y)| stroke(kind, y)).to_vec();
        let picture = draw_path(&ToolPath { title: String::new(), strokes }, View::Xy, sized(480, 320));
        let at = |wanted: Pen| {
            let is_wanted = |item: &Item| matches!(item, Item::Lines { pen, .. } if *pen == wanted);
            picture.items.iter().position(is_wanted)
        };
        let order = [at(style::RETRACED), at(style::RAPID), at(style::FEED)];
        assert!(order.iter().all(Option::is_some) && order.is_sorted(), "{order:?}");
    }
}
