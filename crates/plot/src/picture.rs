//! Display list: all elements of a drawing, in the pixels of its layout and in drawing order.
//!
//! Invariant: x grows to the right and y downward from the upper left corner; every coordinate is finite.

use thiserror::Error;

/// Maximum layout size: a drawing with more pixels in both width and height is laid out in fewer and scaled up.
const LAID_OUT: [f32; 2] = [800.0, 320.0];

/// Size of a drawing, within 480 × 320 … 8 000 × 8 000 pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    width: u16,
    height: u16,
}

/// Error for a size out of range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("a drawing is 480 × 320 to 8000 × 8000 pixels large, not {width} × {height}")]
pub struct SizeError {
    width: u32,
    height: u32,
}

impl Size {
    /// Size in pixels.
    ///
    /// # Errors
    /// The size is too small for the drawing's labels, or too large for memory.
    pub fn pixels(width: u32, height: u32) -> Result<Self, SizeError> {
        match (u16::try_from(width), u16::try_from(height)) {
            (Ok(w @ 480..=8000), Ok(h @ 320..=8000)) => Ok(Self { width: w, height: h }),
            _ => Err(SizeError { width, height }),
        }
    }

    /// Width and height of the finished drawing in pixels.
    pub(crate) fn in_pixels(self) -> [u32; 2] {
        [self.width, self.height].map(u32::from)
    }

    /// Pixels of the finished drawing for one of its layout. A large drawing is a small one scaled up, so that letters
    /// are 9 pt high on a sheet of A4, whatever its size; unless it is too flat for that.
    pub(crate) fn scale(self) -> f32 {
        let [width, height] = [self.width, self.height].map(f32::from);
        (width / LAID_OUT[0]).min(height / LAID_OUT[1]).max(1.0)
    }

    /// Width of the layout in pixels.
    #[must_use]
    pub fn width(self) -> f32 {
        f32::from(self.width) / self.scale()
    }

    /// Height of the layout in pixels.
    #[must_use]
    pub fn height(self) -> f32 {
        f32::from(self.height) / self.scale()
    }
}

/// Point in pixels.
pub(crate) type Point = [f32; 2];

/// Colour: red, green, blue, opacity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Colour(pub(crate) [u8; 4]);

/// Style of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pen {
    pub(crate) colour: Colour,
    /// Width in pixels.
    pub(crate) width: f32,
    /// Lengths in pixels of dash and gap.
    pub(crate) dash: Option<[f32; 2]>,
}

/// Point of a text that is at its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Anchor {
    Left,
    Middle,
    Right,
}

/// Line of text, with its base line through `at`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Text {
    pub(crate) at: Point,
    pub(crate) words: String,
    /// Size in pixels; a capital letter has 0.72 of that height.
    pub(crate) size: f32,
    pub(crate) anchor: Anchor,
    pub(crate) colour: Colour,
    /// Whether it runs upward instead of to the right.
    pub(crate) is_upward: bool,
    pub(crate) is_bold: bool,
}

/// Element of a drawing.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Item {
    /// Lines with one pen; a translucent pen does not grow darker where they cross.
    Lines { lines: Vec<Vec<Point>>, pen: Pen },
    /// Filled polygon.
    Area { corners: Vec<Point>, fill: Colour },
    /// Line of text.
    Text(Text),
}

/// Finished drawing; [`DisplayList::to_svg`] and [`DisplayList::to_png`] write it.
#[derive(Clone, Debug, PartialEq)]
pub struct DisplayList {
    pub(crate) size: Size,
    /// Description of the drawing, for readers who do not see it.
    pub(crate) title: String,
    pub(crate) items: Vec<Item>,
}

impl DisplayList {
    pub(crate) fn new(size: Size, title: &str) -> Self {
        Self { size, title: title.to_owned(), items: Vec::new() }
    }

    pub(crate) fn lines(&mut self, lines: Vec<Vec<Point>>, pen: Pen) {
        if !lines.is_empty() {
            self.items.push(Item::Lines { lines, pen });
        }
    }

    pub(crate) fn line(&mut self, from: Point, to: Point, pen: Pen) {
        self.lines(vec![vec![from, to]], pen);
    }

    pub(crate) fn area(&mut self, corners: &[Point], fill: Colour) {
        self.items.push(Item::Area { corners: corners.to_vec(), fill });
    }

    pub(crate) fn text(&mut self, text: Text) {
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
            let paper_mm = 210.0 * crate::style::TICK_SIZE * size.scale() / width as f32;
            // 9 pt are 3.175 mm; the size of a letter includes the space around it.
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
