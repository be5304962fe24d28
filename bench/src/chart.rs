//! A chart as SVG: panels side by side with lines in them, axes, and one legend.
//!
//! Invariant: every point is within its panel; lines differ in their dashes and marks, not in colour alone.

use std::fmt::Write as _;

/// One panel: its title, and its lines of points.
pub(super) struct Panel {
    pub(super) title: String,
    pub(super) lines: Vec<Vec<(f64, f64)>>,
}

/// Colours that differ in brightness too, and dashes.
const STYLES: [(&str, &str); 4] = [("#b2182b", ""), ("#e08214", "7 3"), ("#2166ac", "2 3"), ("#1b1b1b", "")];

/// Size of a panel's field, and its margins.
const WIDTH: f64 = 230.0;
const HEIGHT: f64 = 220.0;
const LEFT: f64 = 52.0;
const TOP: f64 = 62.0;
const STRIDE: f64 = WIDTH + LEFT + 14.0;

/// Draws panels with lines of these names.
pub(super) fn draw(panels: &[Panel], names: &[&str], across: &str, up: &str) -> String {
    let (width, height) = (STRIDE * panels.len() as f64 + 8.0, TOP + HEIGHT + 46.0);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
            height=\"{height}\" \
         font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
    );
    for (index, name) in names.iter().enumerate() {
        let x = LEFT + 190.0 * index as f64;
        let _ = writeln!(svg, "{}", line(&[(x, 18.0), (x + 36.0, 18.0)], index));
        let _ = writeln!(svg, "{}<text x=\"{}\" y=\"22\">{name}</text>", mark(x + 18.0, 18.0, index), x + 44.0);
    }
    for (index, panel) in panels.iter().enumerate() {
        draw_panel(&mut svg, panel, LEFT + STRIDE * index as f64, across, up);
    }
    svg + "</svg>\n"
}

fn draw_panel(svg: &mut String, panel: &Panel, left: f64, across: &str, up: &str) {
    let most = |of: fn(&(f64, f64)) -> f64| panel.lines.iter().flatten().map(of).fold(0.0, f64::max);
    let (step_x, step_y) = (tick(most(|point| point.0)), tick(most(|point| point.1)));
    let end = |most: f64, step: f64| (most / step).ceil().max(1.0) * step;
    let (end_x, end_y) = (end(most(|point| point.0), step_x), end(most(|point| point.1), step_y));
    let place = |(x, y): (f64, f64)| (left + x / end_x * WIDTH, TOP + HEIGHT - y / end_y * HEIGHT);
    let middle = left + WIDTH / 2.0;
    let _ = writeln!(svg, "<text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">{}</text>", TOP - 14.0, panel.title);
    let mut at = 0.0;
    while at <= end_y * 1.001 {
        let (x, y) = place((0.0, at));
        let _ = writeln!(
            svg,
            "<path d=\"M{x} {y:.1}H{:.1}\" stroke=\"#ddd\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            x + WIDTH,
            x - 6.0,
            y + 4.0,
            rounded(at)
        );
        at += step_y;
    }
    let mut at = 0.0;
    while at <= end_x * 1.001 {
        let (x, y) = place((at, 0.0));
        let _ = writeln!(svg, "<text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>", y + 17.0, rounded(at));
        at += step_x;
    }
    let _ = writeln!(svg, "<text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">{across}</text>", TOP + HEIGHT + 36.0);
    let _ = writeln!(svg, "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{up}</text>", left - 6.0, TOP - 14.0);
    let _ = writeln!(
        svg,
        "<rect x=\"{left}\" y=\"{TOP}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"none\" stroke=\"#444\"/>"
    );
    for (index, points) in panel.lines.iter().enumerate() {
        let points: Vec<(f64, f64)> = points.iter().copied().map(place).collect();
        let _ = writeln!(svg, "{}", line(&points, index));
        for (x, y) in points {
            let _ = writeln!(svg, "{}", mark(x, y, index));
        }
    }
}

/// A tick without the rounding of the sum in its last digits.
fn rounded(at: f64) -> f64 {
    (at * 1e6).round() / 1e6
}

/// The distance of ticks: 1, 2 or 5 times a power of ten, four to nine of them up to the greatest value.
fn tick(most: f64) -> f64 {
    let power = 10_f64.powf((most.max(1e-9) / 4.0).log10().floor());
    [5.0, 2.0].into_iter().find(|times| times * power <= most / 4.0).unwrap_or(1.0) * power
}

fn line(points: &[(f64, f64)], style: usize) -> String {
    let (colour, dashes) = STYLES[style % STYLES.len()];
    let places: Vec<String> = points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
    let points = places.join(" ");
    format!(
        "<polyline points=\"{points}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.8\" \
            stroke-dasharray=\"{dashes}\"/>"
    )
}

/// Square, circle, diamond, triangle.
fn mark(x: f64, y: f64, style: usize) -> String {
    let (colour, _) = STYLES[style % STYLES.len()];
    let corners = match style % 4 {
        0 => "-3.5 -3.5h7v7h-7z",
        1 => "-4 0a4 4 0 1 0 8 0a4 4 0 1 0-8 0z",
        2 => "0-4.8l4.8 4.8l-4.8 4.8l-4.8-4.8z",
        _ => "0-4.5l4.5 8h-9z",
    };
    format!("<path transform=\"translate({x:.1} {y:.1})\" d=\"M{corners}\" fill=\"{colour}\"/>")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_four_to_nine() {
        for most in [0.013, 0.4, 1.0, 3.9, 5.0, 50.0, 99.0, 1234.5] {
            let count = most / tick(most);
            assert!((4.0..10.1).contains(&count), "{most}: {count}");
        }
    }

    #[test]
    fn every_line_is_drawn_with_its_points() {
        let lines = vec![vec![(0.0, 1.0), (10.0, 2.0)], vec![(0.0, 1.0), (10.0, 40.0)]];
        let svg = draw(&[Panel { title: "a".into(), lines }], &["one", "two"], "x", "y");
        assert_eq!(svg.matches("<polyline").count(), 4);
        assert_eq!(svg.matches("translate").count(), 6);
        assert!(svg.contains(">40</text>") && svg.ends_with("</svg>\n"));
    }
}
