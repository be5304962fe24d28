//! Drawing of a tool path: heading, extents, strokes by kind, and a legend.
//!
//! Invariant: retraced strokes lie under the strokes that they repeat.

use crate::font;
use crate::picture::{Anchor, Colour, DisplayList, Pen, Point, Size, Text};
use crate::scale::{fixed, short};
use crate::sheet::{DrawingArea, Sheet};
use crate::style::{self, LABEL_SIZE, TITLE_SIZE, text};
use crate::tool_path::{StrokeKind, ToolPath};
use crate::view::View;

/// Space around the frame, in pixels: left, right, above, below.
pub(crate) const LEFT: f32 = 78.0;
pub(crate) const RIGHT: f32 = 26.0;
pub(crate) const ABOVE: f32 = 66.0;
const BELOW: f32 = 84.0;
const MARK_PX: f32 = 6.0;

/// Draws a tool path.
#[must_use]
pub fn draw_path(path: &ToolPath, view: View, size: Size) -> DisplayList {
    let mut picture = DisplayList::new(size, &format!("tool path of {}", path.title));
    let Some(extents) = path.extents() else {
        draw_heading(&mut picture, &path.title, view.name(), "no motion");
        return picture;
    };
    let room = DrawingArea { left: LEFT, right: size.width() - RIGHT, top: ABOVE, bottom: size.height() - BELOW };
    let sheet = Sheet::fitting(path, view, &extents, room);
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
    sheet.draw_scale_bar(&mut picture, size.width() - RIGHT, size.height(), legend_end);
    picture
}

/// Draws the title, the view, and a summary line.
pub(crate) fn draw_heading(picture: &mut DisplayList, title: &str, view: &str, summary: &str) {
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

/// Cuts a text to the available space.
pub(crate) fn shortened(words: &str, size: f32, space: f32) -> String {
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

pub(crate) fn draw_start(picture: &mut DisplayList, [x, y]: Point) {
    let ring = |radius: f32| {
        (0..24).map(move |step| {
            let (sin, cos) = (step as f32 / 24.0 * std::f32::consts::TAU).sin_cos();
            [x + radius * cos, y + radius * sin]
        })
    };
    picture.area(&ring(MARK_PX).collect::<Vec<_>>(), style::START);
    picture.area(&ring(MARK_PX * 0.4).collect::<Vec<_>>(), style::PAPER);
}

pub(crate) fn draw_end(picture: &mut DisplayList, [x, y]: Point) {
    let square = |half: f32| [[x - half, y - half], [x + half, y - half], [x + half, y + half], [x - half, y + half]];
    picture.area(&square(MARK_PX), style::END);
    picture.area(&square(MARK_PX * 0.35), style::PAPER);
}

/// Draws the legend in one row below the frame, with lengths where there is space. Returns its right end.
fn draw_legend(picture: &mut DisplayList, path: &ToolPath, size: Size) -> f32 {
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
        // Round ends extend the line by half its width.
        let inset = pen.width / 2.0;
        picture.line([x + inset, y], [x + 30.0 - inset, y], pen);
        x = label_beside(picture, [x + 37.0, y], name + &length, style::INK);
    }
    draw_start(picture, [x + MARK_PX, y]);
    x = label_beside(picture, [x + 20.0, y], "start".to_owned(), style::INK);
    draw_end(picture, [x + MARK_PX, y]);
    label_beside(picture, [x + 20.0, y], "end".to_owned(), style::INK)
}

/// Draws a label of the legend. Returns where the next one may begin.
pub(crate) fn label_beside(picture: &mut DisplayList, [x, y]: Point, label: String, colour: Colour) -> f32 {
    let end = x + font::width(&label, LABEL_SIZE) + 24.0;
    picture.text(Text { colour, ..text([x, y + 4.6], label, LABEL_SIZE, Anchor::Left) });
    end
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Item;
    use crate::scale::Scale;
    use crate::tool_path::Stroke;
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
                let room = DrawingArea { left: LEFT, right: width as f32 - RIGHT, top: ABOVE,
                    bottom: height as f32 - BELOW };
                let sheet = Sheet::fitting(&path, view, &extents, room);
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
