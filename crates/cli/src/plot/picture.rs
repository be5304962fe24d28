//! The display list: everything a drawing consists of, in the pixels that it is laid out in, in drawing order.
//!
//! Invariant: x grows to the right and y downward from the upper left corner; every coordinate is finite.

use thiserror::Error;

/// Where a drawing has more pixels than these in both width and height, it is laid out in fewer and seen larger.
const LAID_OUT: [f32; 2] = [800.0, 320.0];

/// The size of a drawing, within 480 × 320 … 8 000 × 8 000 pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    width: u16,
    height: u16,
}

/// A drawing of that size is not made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("a drawing is 480 × 320 to 8000 × 8000 pixels large, not {width} × {height}")]
pub struct SizeError {
    width: u32,
    height: u32,
}

impl Size {
    /// A size in pixels.
    ///
    /// # Errors
    /// Where it is too small for its own labels, or too large to be held in memory with ease.
    pub fn pixels(width: u32, height: u32) -> Result<Self, SizeError> {
        match (u16::try_from(width), u16::try_from(height)) {
            (Ok(w @ 480..=8000), Ok(h @ 320..=8000)) => Ok(Self { width: w, height: h }),
            _ => Err(SizeError { width, height }),
        }
    }

    /// Width and height in pixels of the finished drawing.
    pub(super) fn in_pixels(self) -> [u32; 2] {
        [self.width, self.height].map(u32::from)
    }

    /// Pixels of the finished drawing for one that it is laid out in. A large drawing is a small one seen larger, so that letters are 9 pt
    /// high where it is printed across a sheet of A4, whatever its size; unless it is too flat for that.
    pub(super) fn scale(self) -> f32 {
        let [width, height] = [self.width, self.height].map(f32::from);
        (width / LAID_OUT[0]).min(height / LAID_OUT[1]).max(1.0)
    }

    /// The width in pixels that it is laid out in.
    #[must_use]
    pub fn width(self) -> f32 {
        f32::from(self.width) / self.scale()
    }

    /// The height in pixels that it is laid out in.
    #[must_use]
    pub fn height(self) -> f32 {
        f32::from(self.height) / self.scale()
    }
}

/// A point in pixels.
pub(super) type Point = [f32; 2];

/// A colour: red, green, blue, opacity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Colour(pub(super) [u8; 4]);

/// How a line is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pen {
    pub(super) colour: Colour,
    /// Width in pixels.
    pub(super) width: f32,
    /// Lengths in pixels of dash and gap.
    pub(super) dash: Option<[f32; 2]>,
}

/// Which point of a text stands at its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Left,
    Middle,
    Right,
}

/// A line of text, its base line through `at`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Text {
    pub(super) at: Point,
    pub(super) words: String,
    /// Size in pixels; a capital letter is 0.72 of it high.
    pub(super) size: f32,
    pub(super) anchor: Anchor,
    pub(super) colour: Colour,
    /// Does it run upward instead of to the right?
    pub(super) is_upward: bool,
    pub(super) is_bold: bool,
}

/// One thing on the drawing.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Item {
    /// Lines with one pen; where they cross, a translucent pen does not grow darker.
    Lines { lines: Vec<Vec<Point>>, pen: Pen },
    /// A filled polygon.
    Area { corners: Vec<Point>, fill: Colour },
    /// A line of text.
    Text(Text),
}

/// A finished drawing; [`Picture::to_svg`] and [`Picture::to_png`] write it.
#[derive(Clone, Debug, PartialEq)]
pub struct DisplayList {
    pub(super) size: Size,
    /// What the drawing is, for those who do not see it.
    pub(super) title: String,
    pub(super) items: Vec<Item>,
}

impl DisplayList {
    pub(super) fn new(size: Size, title: &str) -> Self {
        Self { size, title: title.to_owned(), items: Vec::new() }
    }

    pub(super) fn lines(&mut self, lines: Vec<Vec<Point>>, pen: Pen) {
        if !lines.is_empty() {
            self.items.push(Item::Lines { lines, pen });
        }
    }

    pub(super) fn line(&mut self, from: Point, to: Point, pen: Pen) {
        self.lines(vec![vec![from, to]], pen);
    }

    pub(super) fn area(&mut self, corners: &[Point], fill: Colour) {
        self.items.push(Item::Area { corners: corners.to_vec(), fill });
    }

    pub(super) fn text(&mut self, text: Text) {
        self.items.push(Item::Text(text));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_are_as_large_on_paper_whatever_the_size() {
        for (width, height) in [(800, 600), (1200, 900), (4800, 3600)] {
            let size = Size::pixels(width, height).expect("allowed");
            let paper_mm = 210.0 * crate::plot::style::TICK_SIZE * size.scale() / width as f32;
            // 9 pt are 3.175 mm; a letter's size is reckoned with the space around it.
            assert!((3.1..3.2).contains(&paper_mm), "{width}: {paper_mm}");
        }
        assert_eq!(Size::pixels(8000, 320).map(Size::scale), Ok(1.0));
    }

    #[test]
    fn a_drawing_too_small_or_too_large_is_refused() {
        assert!(Size::pixels(480, 320).is_ok() && Size::pixels(8000, 8000).is_ok());
        for (width, height) in [(0, 0), (479, 320), (480, 319), (8001, 320), (480, u32::MAX)] {
            assert_eq!(Size::pixels(width, height), Err(SizeError { width, height }));
        }
    }
}
