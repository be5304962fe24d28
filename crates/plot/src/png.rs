//! Writes a drawing as a PNG image; a pixel of the display list is scaled to the image.

use crate::font;
use crate::picture::{Colour, DisplayList, Item, Pen, Point};
use crate::style::PAPER;
use crate::svg::placed;
use thiserror::Error;
use tiny_skia::{Color, FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Stroke, StrokeDash, Transform};

/// Error of writing a PNG image.
#[derive(Debug, Error)]
pub enum PngError {
    /// The image needs more memory than available.
    #[error("an image of {width} × {height} pixels cannot be held in memory")]
    TooLarge {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
    },
    /// The image cannot be written as PNG.
    #[error("the image cannot be written as PNG: {0}")]
    Encoding(String),
}

/// Maximum number of points per section of an opaque line: the cost of a line grows faster than its length.
const STRETCH: usize = 512;

impl DisplayList {
    /// Renders the drawing as a PNG image.
    ///
    /// # Errors
    /// The image does not fit the memory, or cannot be written.
    pub fn to_png(&self) -> Result<Vec<u8>, PngError> {
        let [width, height] = self.size.in_pixels();
        let scale = Transform::from_scale(self.size.scale(), self.size.scale());
        let mut image = Pixmap::new(width, height).ok_or(PngError::TooLarge { width, height })?;
        image.fill(colour(PAPER));
        for item in &self.items {
            match item {
                Item::Lines { lines, pen } => draw_lines(&mut image, lines, pen, scale),
                Item::Area { corners, fill } => {
                    if let Some(path) = path(&[corners], true) {
                        image.fill_path(&path, &paint(*fill), FillRule::Winding, scale, None);
                    }
                }
                Item::Text(text) => {
                    let pen = Pen { colour: text.colour, width: font::pen_width(text.size, text.is_bold), dash: None };
                    draw_lines(&mut image, &placed(text), &pen, scale);
                }
            }
        }
        image.encode_png().map_err(|error| PngError::Encoding(error.to_string()))
    }
}

fn draw_lines(image: &mut Pixmap, lines: &[Vec<Point>], pen: &Pen, scale: Transform) {
    let stroke = Stroke {
        width: pen.width,
        line_cap: if pen.dash.is_some() { LineCap::Butt } else { LineCap::Round },
        line_join: LineJoin::Round,
        dash: pen.dash.and_then(|lengths| StrokeDash::new(lengths.to_vec(), 0.0)),
        ..Stroke::default()
    };
    let mut draw = |lines: &[&[Point]]| {
        if let Some(path) = path(lines, false) {
            image.stroke_path(&path, &paint(pen.colour), &stroke, scale, None);
        }
    };
    // Sections share a point, which only a translucent or dashed pen shows.
    if pen.colour.0[3] == u8::MAX && pen.dash.is_none() {
        for line in lines {
            let mut rest = line.as_slice();
            while rest.len() > STRETCH {
                draw(&[&rest[..=STRETCH]]);
                rest = &rest[STRETCH..];
            }
            draw(&[rest]);
        }
    } else {
        let lines: Vec<&[Point]> = lines.iter().map(Vec::as_slice).collect();
        draw(&lines);
    }
}

fn path(lines: &[impl AsRef<[Point]>], is_closed: bool) -> Option<Path> {
    let mut path = PathBuilder::new();
    for line in lines {
        for (index, [x, y]) in line.as_ref().iter().enumerate() {
            if index == 0 {
                path.move_to(*x, *y);
            } else {
                path.line_to(*x, *y);
            }
        }
        if is_closed {
            path.close();
        }
    }
    path.finish()
}

fn colour(Colour([red, green, blue, opacity]): Colour) -> Color {
    Color::from_rgba8(red, green, blue, opacity)
}

fn paint(ink: Colour) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color(colour(ink));
    paint.anti_alias = true;
    paint
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Size;
    use crate::style;

    #[test]
    fn ink_is_where_it_was_put_and_paper_elsewhere() -> Result<(), Box<dyn std::error::Error>> {
        let mut picture = DisplayList::new(Size::pixels(480, 320)?, "");
        let line: Vec<Point> = (0..2000).map(|at| [10.0 + at as f32 * 0.1, 50.5]).collect();
        picture.lines(vec![line], Pen { colour: style::INK, width: 2.0, dash: None });
        picture.area(&[[100.0, 100.0], [200.0, 100.0], [200.0, 200.0], [100.0, 200.0]], style::START);
        let image = Pixmap::decode_png(&picture.to_png()?)?;
        let at = |x: u32, y: u32| image.pixel(x, y).map(|pixel| [pixel.red(), pixel.green(), pixel.blue()]);
        assert_eq!((image.width(), image.height()), (480, 320));
        assert_eq!(at(5, 50), Some([255; 3]));
        assert_eq!([at(20, 50), at(150, 50), at(205, 50)], [Some([0x22; 3]); 3]);
        assert_eq!(at(150, 150), Some([0x00, 0x9e, 0x73]));
        assert_eq!(at(150, 210), Some([255; 3]));
        Ok(())
    }
}
