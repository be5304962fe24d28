//! Draws docs/figures/corner.svg: a corner that is passed in a glide, and the effect on the speed.
//!
//! `cargo run --release -p retrace-motion --example corner_figure > docs/figures/corner.svg`

use std::fmt::Write as _;

use retrace_core::Flags;
use retrace_motion::{FeedRate, MachineLimits, PathMode, Planner, SetPoint};

/// Length of the legs and the tolerance, mm.
const LEG: f64 = 20.0;
const TOLERANCE: f64 = 0.05;
/// Size of a panel, pixels, and the part of the corner it shows, mm.
const PANEL: (f64, f64) = (300.0, 220.0);
const SHOWN: f64 = 0.5;
/// Time shown, s, and speed, mm/s.
const TIME: f64 = 0.75;
const SPEED: f64 = 110.0;

/// Set-points every tenth of a millisecond.
fn plan(degrees: f64, mode: PathMode) -> Vec<SetPoint<2>> {
    let limits = MachineLimits { pulses_per_mm: [100_000.0; 2], period_s: 1e-4, ..MachineLimits::built_in() };
    let mut planner = Planner::new(limits, [-LEG, 0.0]).expect("valid limits");
    let (sin, cos) = degrees.to_radians().sin_cos();
    planner.line([0.0, 0.0], FeedRate::Rapid, mode, 1).expect("a valid line");
    planner.line([LEG * cos, LEG * sin], FeedRate::Rapid, mode, 2).expect("a valid line");
    planner.stop(Flags::NONE);
    let mut points = Vec::new();
    while planner.next_record().is_some() {
        points.push(*planner.set_point());
    }
    points
}

fn polyline(points: impl Iterator<Item = (f64, f64)>, style: &str) -> String {
    let list: Vec<String> = points.map(|(x, y)| format!("{x:.2},{y:.2}")).collect();
    format!("<polyline points=\"{}\" {style}/>\n", list.join(" "))
}

/// The corner, magnified.
fn corner(degrees: f64, glide: &[SetPoint<2>], number: usize) -> String {
    let (sin, cos) = degrees.to_radians().sin_cos();
    // The middle between the legs is the middle of the panel.
    let (middle_x, middle_y) = (0.3 * (cos - 1.0) * SHOWN, 0.3 * sin * SHOWN);
    let scale = PANEL.1 / (2.0 * SHOWN);
    let at = |x: f64, y: f64| (0.5 * PANEL.0 + (x - middle_x) * scale, 0.5 * PANEL.1 - (y - middle_y) * scale);
    let programmed = || [(-2.0, 0.0), (0.0, 0.0), (2.0 * cos, 2.0 * sin)].into_iter().map(|(x, y)| at(x, y));
    let mut out =
        format!("<clipPath id=\"c{number}\"><rect width=\"{}\" height=\"{}\"/></clipPath>\n", PANEL.0, PANEL.1);
    let _ = writeln!(out, "<g clip-path=\"url(#c{number})\">");
    let band = format!(
        "fill=\"none\" stroke=\"#dce6f0\" stroke-linejoin=\"round\" stroke-width=\"{}\"",
        2.0 * TOLERANCE * scale
    );
    out += &polyline(programmed(), &band);
    out += &polyline(programmed(), "fill=\"none\" stroke=\"#555\" stroke-dasharray=\"6 4\"");
    let near = glide.iter().map(|p| p.position_mm).filter(|[x, y]| x.hypot(*y) < 2.0);
    out += &polyline(near.map(|[x, y]| at(x, y)), "fill=\"none\" stroke=\"#c0392b\" stroke-width=\"2\"");
    for [x, y] in glide.iter().step_by(10).map(|p| p.position_mm).filter(|[x, y]| x.hypot(*y) < 2.0) {
        let (x, y) = at(x, y);
        let _ = writeln!(out, "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"2.2\" fill=\"#c0392b\"/>");
    }
    let bar = 0.1 * scale;
    let _ = writeln!(
        out,
        "<path d=\"M 14 {y} h {bar:.1}\" stroke=\"#000\" stroke-width=\"2\"/><text x=\"{x:.1}\" y=\"{t}\">0.1 \
            mm</text>",
        y = PANEL.1 - 14.0,
        x = 20.0 + bar,
        t = PANEL.1 - 10.0,
    );
    out + "</g>\n"
}

/// Speed along the path over time, with the glide and with a stop.
fn speeds(glide: &[SetPoint<2>], stop: &[SetPoint<2>]) -> String {
    let at = |k: usize, v: f64| (k as f64 * 1e-4 / TIME * PANEL.0, PANEL.1 - v / SPEED * PANEL.1);
    let line = |points: &[SetPoint<2>], style: &str| {
        polyline(points.iter().enumerate().step_by(5).map(|(k, p)| at(k, p.velocity_mm_s)), style)
    };
    let mut out = String::new();
    for v in [0.0, 50.0, 100.0] {
        let (_, y) = at(0, v);
        let _ = writeln!(
            out,
            "<path d=\"M 0 {y:.1} H {}\" stroke=\"#ddd\"/><text x=\"2\" y=\"{:.1}\">{v} mm/s</text>",
            PANEL.0,
            y - 3.0
        );
    }
    out += &line(stop, "fill=\"none\" stroke=\"#555\" stroke-dasharray=\"6 4\"");
    out += &line(glide, "fill=\"none\" stroke=\"#c0392b\" stroke-width=\"2\"");
    let _ = writeln!(
        out,
        "<text x=\"{}\" y=\"14\" text-anchor=\"end\">{:.0} ms, {:.0} ms with a stop</text>",
        PANEL.0,
        glide.len() as f64 * 0.1,
        stop.len() as f64 * 0.1
    );
    out
}

fn main() {
    let (gap, top) = (30.0, 40.0);
    let (width, height) = (3.0 * PANEL.0 + 4.0 * gap, 2.0 * PANEL.1 + 2.0 * gap + top);
    println!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" \
            font-size=\"12\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>"
    );
    for (number, degrees) in [30.0, 90.0, 135.0].into_iter().enumerate() {
        let glide = plan(degrees, PathMode::blend(TOLERANCE));
        let stop = plan(degrees, PathMode::ExactStop);
        let x = gap + number as f64 * (PANEL.0 + gap);
        println!(
            "<text x=\"{x}\" y=\"24\" font-size=\"15\">turn of {degrees}°, legs of {LEG} mm, P {TOLERANCE} mm</text>"
        );
        println!("<g transform=\"translate({x} {top})\">\n{}</g>", corner(degrees, &glide, number));
        println!("<g transform=\"translate({x} {})\">\n{}</g>", top + PANEL.1 + gap, speeds(&glide, &stop));
    }
    println!("</svg>");
}
