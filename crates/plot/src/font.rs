//! Small stroke font: letters as lines, so that a drawing needs no font of the computer it is made on.
//!
//! Invariant: every printable ASCII character has a glyph, and so has every other character of our labels; any other is
//! a box.
//!
//! A glyph is a list of strokes; a point is two hexadecimal digits, x and y. The base line is y = 3, a capital ends at
//! y = 14, a small letter at y = 11, and a descender at y = 0. A stroke that opens with `~` is a curve: its inner
//! points are the corners of a quadratic B-spline.

use crate::picture::Point;

/// Height of a capital letter, as a share of the size of the text.
const CAPITAL_HEIGHT: f32 = 0.72;
const BASE_LINE: f32 = 3.0;
const CAPITAL_UNITS: f32 = 11.0;
/// Space between two letters, in units of the glyphs.
const SPACING: f32 = 3.0;
/// Number of straight segments for each corner of a curve.
const PIECES: usize = 5;

/// Character, width in units, strokes.
type Glyph = (char, u8, &'static str);

#[rustfmt::skip]
const GLYPHS: &[Glyph] = &[
    (' ', 3, ""),
    ('!', 2, "1e 17;13 14"),
    ('"', 4, "0e 0b;3e 3b"),
    ('#', 7, "24 3d;54 6d;06 76;0b 7b"),
    ('$', 7, "~7b 7d 0d 08 79 74 04 06;4f 42"),
    ('%', 8, "03 8e;~1e 0e 0a 3a 3e 1e;~77 57 53 83 87 77"),
    ('&', 8, "83 1b;~1b 0e 5e 5a 29;~29 08 03 63 88"),
    ('\'', 2, "1e 1b"),
    ('(', 3, "~3f 0c 04 31"),
    (')', 3, "~0f 3c 34 01"),
    ('*', 6, "3d 37;0c 68;6c 08"),
    ('+', 6, "08 68;3b 35"),
    (',', 2, "14 13 01"),
    ('-', 5, "08 58"),
    ('.', 2, "13 14"),
    ('/', 6, "02 6f"),
    ('0', 7, "~08 0e 7e 73 03 08"),
    ('1', 7, "1b 4e 43;13 73"),
    ('2', 7, "~0b 0e 7e 79 03;03 73"),
    ('3', 7, "~0c 0e 7e 79 39;~39 79 73 03 05"),
    ('4', 7, "53 5e 06 76"),
    ('5', 7, "6e 1e 09;~09 1a 7a 73 03 05"),
    ('6', 7, "~6e 0d 06;~06 03 73 7a 0a 06"),
    ('7', 7, "0e 7e 33"),
    ('8', 7, "~1b 1e 6e 69 19 1b;~06 09 79 73 03 06"),
    ('9', 7, "~7b 7e 0e 07 77 7b;~7b 74 13"),
    (':', 2, "14 15;19 1a"),
    (';', 2, "14 13 01;19 1a"),
    ('<', 6, "6c 08 64"),
    ('=', 6, "0a 6a;06 66"),
    ('>', 6, "0c 68 04"),
    ('?', 6, "~0b 0e 6e 69 39 37;33 34"),
    ('@', 9, "~69 3b 35 65 6a;6a 66;~66 64 94 9e 0e 03 73"),
    ('A', 8, "03 4e 83;16 76"),
    ('B', 8, "03 0e 4e;~4e 7e 79 49;09 49;~49 89 83 43;43 03"),
    ('C', 8, "~8b 8e 0e 03 83 86"),
    ('D', 8, "03 0e 3e;~3e 8e 83 33;33 03"),
    ('E', 7, "7e 0e 03 73;09 69"),
    ('F', 7, "7e 0e 03;09 69"),
    ('G', 8, "~8b 8e 0e 03 83 88;88 58"),
    ('H', 8, "0e 03;8e 83;09 89"),
    ('I', 4, "0e 4e;2e 23;03 43"),
    ('J', 6, "6e 67;~67 63 03 06"),
    ('K', 8, "0e 03;7e 07;3a 83"),
    ('L', 7, "0e 03 73"),
    ('M', 9, "03 0e 47 8e 83"),
    ('N', 8, "03 0e 83 8e"),
    ('O', 8, "~4e 0e 03 83 8e 4e"),
    ('P', 8, "03 0e 4e;~4e 8e 88 48;48 08"),
    ('Q', 8, "~4e 0e 03 83 8e 4e;56 82"),
    ('R', 8, "03 0e 4e;~4e 8e 88 48;48 08;48 83"),
    ('S', 7, "~7b 7e 0e 09 78 73 03 06"),
    ('T', 8, "0e 8e;4e 43"),
    ('U', 8, "0e 07;~07 03 83 87;87 8e"),
    ('V', 8, "0e 43 8e"),
    ('W', 10, "0e 23 5c 83 ae"),
    ('X', 8, "0e 83;8e 03"),
    ('Y', 8, "0e 48 8e;48 43"),
    ('Z', 8, "0e 8e 03 83"),
    ('[', 3, "3f 0f 01 31"),
    ('\\', 6, "0f 62"),
    (']', 3, "0f 3f 31 01"),
    ('^', 6, "0b 3e 6b"),
    ('_', 7, "01 71"),
    ('`', 3, "0e 2c"),
    ('a', 6, "~3b 0b 03 63 6b 3b;6b 63"),
    ('b', 6, "0e 03;~3b 0b 03 63 6b 3b"),
    ('c', 6, "~69 6b 0b 03 63 65"),
    ('d', 6, "6e 63;~3b 0b 03 63 6b 3b"),
    ('e', 6, "07 67;~67 6b 0b 03 63 65"),
    ('f', 5, "~5e 2e 2b;2b 23;0b 5b"),
    ('g', 6, "~3b 0b 03 63 6b 3b;6b 63;~63 60 00 01"),
    ('h', 6, "0e 03;~08 0b 6b 67;67 63"),
    ('i', 2, "1b 13;1e 1d"),
    ('j', 2, "2b 23;~23 20 00;2e 2d"),
    ('k', 6, "0e 03;6b 06;28 63"),
    ('l', 3, "1e 15;~15 13 33"),
    ('m', 8, "0b 03;~08 0b 4b 47;47 43;~48 4b 8b 87;87 83"),
    ('n', 6, "0b 03;~08 0b 6b 67;67 63"),
    ('o', 6, "~3b 0b 03 63 6b 3b"),
    ('p', 6, "0b 00;~3b 0b 03 63 6b 3b"),
    ('q', 6, "6b 60;~3b 0b 03 63 6b 3b"),
    ('r', 4, "0b 03;~07 0b 4b"),
    ('s', 6, "~69 6b 0b 07 67 63 03 05"),
    ('t', 5, "2e 26;~26 23 53;0b 5b"),
    ('u', 6, "0b 07;~07 03 63 66;6b 63"),
    ('v', 6, "0b 33 6b"),
    ('w', 8, "0b 23 4a 63 8b"),
    ('x', 6, "0b 63;6b 03"),
    ('y', 6, "0b 33;6b 20"),
    ('z', 6, "0b 6b 03 63"),
    ('{', 4, "~4f 2f 2c;~2c 29 08;~08 27 24;~24 21 41"),
    ('|', 2, "1f 11"),
    ('}', 4, "~0f 2f 2c;~2c 29 48;~48 27 24;~24 21 01"),
    ('~', 7, "~07 0a 37 47;~47 77 79"),
    ('°', 4, "~0c 0e 4e 4a 0a 0c"),
    ('±', 6, "09 69;3c 36;03 63"),
    ('²', 4, "~0d 0f 4f 4d 08;08 48"),
    ('³', 4, "~0e 0f 4f 4c 2c;~2c 4c 48 08 09"),
    ('·', 2, "18 19"),
    ('×', 6, "0b 65;6b 05"),
    ('µ', 6, "0b 00;~07 03 63 66;6b 63"),
    ('–', 8, "08 88"),
    ('−', 6, "08 68"),
    ('…', 10, "13 14;53 54;93 94"),
    // Glyph of every other character.
    ('\u{fffd}', 6, "03 0e 6e 63 03"),
];

/// Strokes of a text and its width, both in pixels; the text begins at the origin, its base line is y = 0.
pub(crate) fn strokes(words: &str, size: f32) -> (Vec<Vec<Point>>, f32) {
    let unit = size * CAPITAL_HEIGHT / CAPITAL_UNITS;
    let mut lines = Vec::new();
    let mut x = 0.0;
    for letter in words.chars() {
        let (_, width, shape) = glyph(letter);
        for stroke in shape.split(';').filter(|stroke| !stroke.is_empty()) {
            let place = |[px, py]: Point| [(x + px) * unit, (BASE_LINE - py) * unit];
            lines.push(points(stroke).into_iter().map(place).collect());
        }
        x += f32::from(*width) + SPACING;
    }
    (lines, (x - SPACING).max(0.0) * unit)
}

/// Width of a text in pixels.
pub(crate) fn width(words: &str, size: f32) -> f32 {
    let units: f32 = words.chars().map(|letter| f32::from(glyph(letter).1) + SPACING).sum();
    (units - SPACING).max(0.0) * size * CAPITAL_HEIGHT / CAPITAL_UNITS
}

/// Width in pixels of the line that a text of this size is drawn with.
pub(crate) fn pen_width(size: f32, is_bold: bool) -> f32 {
    size * if is_bold { 0.13 } else { 0.095 }
}

fn glyph(letter: char) -> &'static Glyph {
    GLYPHS.iter().find(|glyph| glyph.0 == letter).unwrap_or(&GLYPHS[GLYPHS.len() - 1])
}

/// Points of one stroke, in units.
fn points(stroke: &str) -> Vec<Point> {
    let (is_curve, stroke) = stroke.strip_prefix('~').map_or((false, stroke), |rest| (true, rest));
    let corners: Vec<Point> = stroke.split(' ').filter_map(point).collect();
    if is_curve { curve(&corners) } else { corners }
}

/// Parses two hexadecimal digits.
fn point(digits: &str) -> Option<Point> {
    let mut digits = digits.chars().filter_map(|digit| digit.to_digit(16)).map(|digit| digit as f32);
    Some([digits.next()?, digits.next()?])
}

/// Quadratic B-spline from the first corner to the last.
fn curve(corners: &[Point]) -> Vec<Point> {
    let middle = |a: Point, b: Point| [(a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0];
    let Some(&start) = corners.first() else { return Vec::new() };
    let mut line = vec![start];
    let mut from = start;
    for at in 1..corners.len().saturating_sub(1) {
        let (corner, next) = (corners[at], corners[at + 1]);
        let to = if at + 2 == corners.len() { next } else { middle(corner, next) };
        for piece in 1..=PIECES {
            let t = piece as f32 / PIECES as f32;
            let blend = |a: f32, b: f32, c: f32| (1.0 - t) * (1.0 - t) * a + 2.0 * t * (1.0 - t) * b + t * t * c;
            line.push([blend(from[0], corner[0], to[0]), blend(from[1], corner[1], to[1])]);
        }
        from = to;
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_printable_character_has_a_glyph_of_its_own() {
        for letter in (' '..='~').chain("°±²³·×µ–−…".chars()) {
            assert_eq!(GLYPHS.iter().filter(|glyph| glyph.0 == letter).count(), 1, "{letter:?}");
        }
        assert_eq!(glyph('\u{4e2d}').0, '\u{fffd}');
    }

    #[test]
    fn strokes_are_well_formed_and_stay_within_their_width() {
        for (letter, width, shape) in GLYPHS {
            for stroke in shape.split(';').filter(|stroke| !stroke.is_empty()) {
                let digits = stroke.trim_start_matches('~');
                assert!(digits.split(' ').all(|point| point.len() == 2), "{letter:?}");
                let points = points(stroke);
                assert!(points.len() >= 2, "{letter:?}");
                assert!(points.iter().all(|point| point[0] <= f32::from(*width)), "{letter:?}");
                if stroke.starts_with('~') {
                    assert!(digits.split(' ').count() >= 3, "{letter:?} has a curve without a corner");
                }
            }
        }
    }

    #[test]
    fn a_text_is_as_wide_as_it_says_and_a_capital_as_high() {
        let (lines, drawn) = strokes("Hx", 10.0);
        let farthest = lines.iter().flatten().map(|point| point[0]).fold(0.0, f32::max);
        let highest = lines.iter().flatten().map(|point| -point[1]).fold(0.0, f32::max);
        assert!((drawn - width("Hx", 10.0)).abs() < 1e-4 && (drawn - farthest).abs() < 1e-4);
        assert!((highest - 7.2).abs() < 1e-4);
        assert!(width("", 10.0).abs() < 1e-6);
    }
}
