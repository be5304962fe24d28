//! Writes a drawing as an SVG document.
//!
//! Invariant: the document needs nothing outside itself; the same drawing gives the same text.

use crate::font;
use crate::picture::{Anchor, Colour, DisplayList, Item, Pen, Point, Text};
use crate::style::PAPER;
use std::fmt::Write;

impl DisplayList {
    /// Drawing as a complete SVG 1.1 document.
    #[must_use]
    pub fn to_svg(&self) -> String {
        let ([across, down], width, height) = (self.size.in_pixels(), self.size.width(), self.size.height());
        let mut svg = String::new();
        // Writing to a string cannot fail.
        let _ = writeln!(
            svg,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{across}\" height=\"{down}\" \
             viewBox=\"0 0 {width} {height}\" fill=\"none\" stroke-linejoin=\"round\" stroke-linecap=\"round\">\n\
             <title>{}</title>\n<rect width=\"{width}\" height=\"{height}\" {}/>",
            escaped(&self.title),
            fill(PAPER),
        );
        for item in &self.items {
            match item {
                Item::Lines { lines, pen } => {
                    let _ = writeln!(svg, "<path {} d=\"{}\"/>", stroke(pen), path(lines, false));
                }
                Item::Area { corners, fill: colour } => {
                    let _ =
                        writeln!(svg, "<path {} d=\"{}\"/>", fill(*colour), path(std::slice::from_ref(corners), true));
                }
                Item::Text(text) => {
                    let pen = Pen { colour: text.colour, width: font::pen_width(text.size, text.is_bold), dash: None };
                    let label = escaped(&text.words);
                    let lines = placed(text);
                    let _ =
                        writeln!(svg, "<path aria-label=\"{label}\" {} d=\"{}\"/>", stroke(&pen), path(&lines, false));
                }
            }
        }
        svg.push_str("</svg>\n");
        svg
    }
}

/// Strokes of a text at its position on the drawing.
pub(crate) fn placed(text: &Text) -> Vec<Vec<Point>> {
    let (mut lines, width) = font::strokes(&text.words, text.size);
    let shift = match text.anchor {
        Anchor::Left => 0.0,
        Anchor::Middle => -width / 2.0,
        Anchor::Right => -width,
    };
    for point in lines.iter_mut().flatten() {
        let (along, across) = (point[0] + shift, point[1]);
        let [x, y] = text.at;
        *point = if text.is_upward { [x + across, y - along] } else { [x + along, y + across] };
    }
    lines
}

fn path(lines: &[Vec<Point>], is_closed: bool) -> String {
    let mut path = String::new();
    for line in lines {
        for (index, [x, y]) in line.iter().enumerate() {
            path.push(match index {
                0 => 'M',
                1 => 'L',
                _ => ' ',
            });
            number(&mut path, *x);
            path.push(' ');
            number(&mut path, *y);
        }
        if is_closed {
            path.push('Z');
        }
    }
    path
}

/// Formats a coordinate in hundredths of a pixel, without trailing zeros.
fn number(text: &mut String, value: f32) {
    let hundredths = (f64::from(value) * 100.0).round() as i64;
    let (whole, rest) = (hundredths.abs() / 100, hundredths.abs() % 100);
    let sign = if hundredths < 0 { "-" } else { "" };
    let _ = match (rest, rest % 10) {
        (0, _) => write!(text, "{sign}{whole}"),
        (_, 0) => write!(text, "{sign}{whole}.{}", rest / 10),
        _ => write!(text, "{sign}{whole}.{rest:02}"),
    };
}

fn stroke(pen: &Pen) -> String {
    let Colour([red, green, blue, opacity]) = pen.colour;
    let mut text = format!("stroke=\"#{red:02x}{green:02x}{blue:02x}\" stroke-width=\"");
    number(&mut text, pen.width);
    text.push('"');
    if opacity < u8::MAX {
        let _ = write!(text, " stroke-opacity=\"{:.2}\"", f32::from(opacity) / 255.0);
    }
    if let Some([dash, gap]) = pen.dash {
        // Round ends would close the gaps.
        let _ = write!(text, " stroke-linecap=\"butt\" stroke-dasharray=\"{dash} {gap}\"");
    }
    text
}

fn fill(Colour([red, green, blue, opacity]): Colour) -> String {
    let mut text = format!("fill=\"#{red:02x}{green:02x}{blue:02x}\"");
    if opacity < u8::MAX {
        let _ = write!(text, " fill-opacity=\"{:.2}\"", f32::from(opacity) / 255.0);
    }
    text
}

/// Escapes text for XML: characters that XML cannot contain are dropped, reserved ones are escaped.
fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            letter if letter.is_control() || matches!(letter, '\u{fffe}' | '\u{ffff}') => {}
            letter => safe.push(letter),
        }
    }
    safe
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Size;
    use crate::style;

    #[test]
    fn a_small_drawing_is_written_word_for_word() -> Result<(), crate::picture::SizeError> {
        let mut picture = DisplayList::new(Size::pixels(480, 320)?, "a < b");
        picture.lines(vec![vec![[1.0, 2.5], [3.004, -4.0], [5.0, 6.126]], vec![[0.0, 0.0], [1.0, 0.0]]], style::RAPID);
        picture.area(&[[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]], style::RETRACED_BAND);
        picture.text(style::text([100.0, 50.0], "l\"", 11.0, Anchor::Right));
        let expected = "\
<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"480\" height=\"320\" viewBox=\"0 0 480 320\" fill=\"none\" \
stroke-linejoin=\"round\" stroke-linecap=\"round\">
<title>a &lt; b</title>
<rect width=\"480\" height=\"320\" fill=\"#ffffff\"/>
<path stroke=\"#8c8c8c\" stroke-width=\"1\" stroke-linecap=\"butt\" stroke-dasharray=\"5 4\" \
d=\"M1 2.5L3 -4 5 6.13M0 0L1 0\"/>
<path fill=\"#e69f00\" fill-opacity=\"0.25\" d=\"M0 0L10 0 0 10Z\"/>
<path aria-label=\"l&quot;\" stroke=\"#222222\" stroke-width=\"1.04\" \
d=\"M93.52 42.08L93.52 48.56M93.52 48.56L93.58 49.08 93.75 49.48 94.04 49.77 94.44 49.94 94.96 50M97.12 42.08L97.12 \
44.24\
M99.28 42.08L99.28 44.24\"/>
</svg>
";
        assert_eq!(picture.to_svg(), expected);
        Ok(())
    }

    #[test]
    fn upward_text_runs_upward() {
        let text = Text { is_upward: true, ..style::text([50.0, 100.0], "HH", 11.0, Anchor::Left) };
        let points = placed(&text);
        assert!(points.iter().flatten().all(|point| point[0] <= 50.0 && point[1] <= 100.0));
        assert!(points.iter().flatten().any(|point| point[1] < 90.0));
    }
}
