//! Drawing of a profile: velocity, acceleration and jerk over time, one panel above the other.

use crate::decimate;
use crate::draw_path::{draw_heading, label_beside};
use crate::font;
use crate::picture::{Anchor, DisplayList, Pen, Point, Size, Text};
use crate::profile::{Curve, Profile};
use crate::scale::{Scale, fixed, short};
use crate::style::{self, LABEL_SIZE, TICK_SIZE, text};

const LEFT: f32 = 92.0;
const RIGHT: f32 = 26.0;
const ABOVE: f32 = 66.0;
const BELOW: f32 = 78.0;
/// Space between two panels, in pixels.
const GAP: f32 = 16.0;
/// Headroom above the highest value, as a share of it.
const HEADROOM: f64 = 0.12;
const TICK_GAP_ACROSS: f32 = 72.0;
const TICK_GAP_UP: f32 = 30.0;

/// Panel of one quantity with its unit.
struct Panel {
    name: &'static str,
    unit: &'static str,
    curves: Vec<(Curve, Pen)>,
    limits: Vec<f64>,
}

/// Draws velocity, acceleration and jerk over time.
#[must_use]
pub fn draw_profile(profile: &Profile, size: Size) -> DisplayList {
    let mut picture = DisplayList::new(size, &format!("velocity, acceleration and jerk of {}", profile.title));
    let period_ms = short(profile.period_s * 1000.0, 3);
    let stride = match profile.stride_periods {
        0 | 1 => String::new(),
        stride => format!(", differences over {stride} periods"),
    };
    let [from_s, to_s] = profile.shown();
    let summary = format!("{} s in periods of {period_ms} ms{stride}", fixed(to_s - from_s, 3));
    draw_heading(&mut picture, &profile.title, "over time", &summary);
    let time = Scale {
        low: from_s,
        high: to_s.max(from_s + profile.period_s.max(1e-6)),
        low_px: LEFT,
        high_px: size.width() - RIGHT,
    };
    let panels = panels(profile);
    let height = (size.height() - ABOVE - BELOW - GAP * (panels.len() - 1) as f32) / panels.len() as f32;
    for (index, panel) in panels.iter().enumerate() {
        let top = ABOVE + index as f32 * (height + GAP);
        panel.draw(&mut picture, profile, &time, [top, top + height], index + 1 == panels.len());
    }
    let middle = (time.low_px + time.high_px) / 2.0;
    picture.text(text([middle, size.height() - BELOW + 36.0], "time s", LABEL_SIZE, Anchor::Middle));
    draw_legend(&mut picture, profile, size);
    picture
}

fn axis_pen(index: usize) -> Pen {
    style::AXES[index % style::AXES.len()]
}

fn panels(profile: &Profile) -> [Panel; 3] {
    let curves = |order: usize| -> Vec<(Curve, Pen)> {
        profile
            .axes
            .iter()
            .enumerate()
            .map(|(index, axis)| (profile.cut(profile.derivative(axis, order)), axis_pen(index)))
            .collect()
    };
    let limits = |of: fn(&crate::Derivatives<f64>) -> f64| -> Vec<f64> {
        let mut limits: Vec<f64> = profile.axes.iter().map(|axis| of(&axis.limits)).collect();
        limits.retain(|limit| limit.is_finite() && *limit > 0.0);
        limits.sort_by(f64::total_cmp);
        limits.dedup();
        limits
    };
    let mut velocities = curves(1);
    velocities.push((profile.cut(profile.path_speed()), style::PATH_SPEED));
    [
        Panel { name: "velocity", unit: "mm/s", curves: velocities, limits: limits(|of| of.velocity) },
        Panel { name: "acceleration", unit: "mm/s²", curves: curves(2), limits: limits(|of| of.acceleration) },
        Panel { name: "jerk", unit: "mm/s³", curves: curves(3), limits: limits(|of| of.jerk) },
    ]
}

impl Panel {
    fn draw(&self, picture: &mut DisplayList, profile: &Profile, time: &Scale, [top, bottom]: [f32; 2], is_last: bool) {
        let (left, right) = (time.low_px, time.high_px);
        let [low, high] = self.range();
        let up = Scale { low, high, low_px: bottom, high_px: top };
        for [from, to] in profile.retraced_s.iter().filter(|[from, to]| *to >= time.low && *from <= time.high) {
            let [from, to] = [*from, *to].map(|at| time.px(at.clamp(time.low, time.high)));
            picture.area(&[[from, top], [to, top], [to, bottom], [from, bottom]], style::RETRACED_BAND);
        }
        let across_ticks = time.ticks(TICK_GAP_ACROSS);
        let up_ticks = up.ticks(TICK_GAP_UP);
        let across = across_ticks.values.iter().map(|&at| vec![[time.px(at), top], [time.px(at), bottom]]);
        let upward = up_ticks.values.iter().map(|&value| vec![[left, up.px(value)], [right, up.px(value)]]);
        picture.lines(across.chain(upward).collect(), style::GRID);
        for &value in &up_ticks.values {
            let y = up.px(value);
            picture.line([left, y], [left - 5.0, y], style::FRAME);
            picture.text(text([left - 9.0, y + 4.3], up_ticks.label(value), TICK_SIZE, Anchor::Right));
        }
        for &at in &across_ticks.values {
            let x = time.px(at);
            picture.line([x, bottom], [x, bottom + 5.0], style::FRAME);
            if is_last {
                picture.text(text([x, bottom + 19.0], across_ticks.label(at), TICK_SIZE, Anchor::Middle));
            }
        }
        for limit in self.limits.iter().flat_map(|&limit| [limit, -limit]).filter(|limit| (low..=high).contains(limit))
        {
            picture.line([left, up.px(limit)], [right, up.px(limit)], style::LIMIT);
        }
        for (curve, pen) in &self.curves {
            let points = curve.values.iter().enumerate().filter(|(_, value)| value.is_finite());
            let place = |(index, value): (usize, &f64)| -> Point {
                [time.px(curve.start_s + index as f64 * profile.period_s), up.px(*value)]
            };
            let line = decimate::path(decimate::curve(points.map(place)));
            if line.len() > 1 {
                picture.lines(vec![line], *pen);
            }
        }
        picture
            .lines(vec![vec![[left, top], [right, top], [right, bottom], [left, bottom], [left, top]]], style::FRAME);
        let label = format!("{} {}", self.name, self.unit);
        let at = [18.0 + font::width("M", LABEL_SIZE), (top + bottom) / 2.0];
        picture.text(Text { is_upward: true, ..text(at, label, LABEL_SIZE, Anchor::Middle) });
    }

    /// Range of the panel: every value and every limit, with some headroom; only upward where nothing is negative.
    fn range(&self) -> [f64; 2] {
        let values =
            || self.curves.iter().flat_map(|(curve, _)| &curve.values).copied().filter(|value| value.is_finite());
        let largest = self.limits.iter().copied().fold(0.0, f64::max);
        let (low, high) = values().fold((0.0_f64, largest), |(low, high), value| (low.min(value), high.max(value)));
        let is_signed = low < -1e-9 * high.max(1e-9);
        let reach = high.max(-low).max(1e-6) * (1.0 + HEADROOM);
        if is_signed { [-reach, reach] } else { [0.0, reach] }
    }
}

fn draw_legend(picture: &mut DisplayList, profile: &Profile, size: Size) {
    let y = size.height() - 18.0;
    let mut x = RIGHT;
    let axes = profile.axes.iter().enumerate().map(|(index, axis)| (axis.name.clone(), axis_pen(index)));
    let path = ("path speed".to_owned(), style::PATH_SPEED);
    for (name, pen) in axes.chain([path, ("axis limit".to_owned(), style::LIMIT)]) {
        picture.line([x, y], [x + 28.0, y], pen);
        x = label_beside(picture, [x + 36.0, y], name, style::INK);
    }
    if !profile.retraced_s.is_empty() {
        picture.area(&[[x, y - 7.0], [x + 28.0, y - 7.0], [x + 28.0, y + 7.0], [x, y + 7.0]], style::RETRACED_BAND);
        label_beside(picture, [x + 36.0, y], "retraced".to_owned(), style::INK);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Item;
    use crate::profile::{AxisTrack, Derivatives};

    #[test]
    fn limits_are_drawn_and_every_curve_stays_in_its_panel() -> Result<(), crate::picture::SizeError> {
        let positions_mm = (0..3000).map(|period| 2.0 * (f64::from(period) * 0.015).sin()).collect();
        let limits = Derivatives { velocity: 100.0, acceleration: 1000.0, jerk: 20_000.0 };
        let axes = vec![AxisTrack { name: "X".to_owned(), positions_mm, limits }];
        let profile = Profile {
            title: "a".to_owned(),
            period_s: 0.001,
            stride_periods: 8,
            axes,
            retraced_s: vec![[1.0, 9.0]],
            shown_s: None,
        };
        let picture = draw_profile(&profile, Size::pixels(800, 600)?);
        let drawn = |wanted: Pen| {
            let lines = picture.items.iter().filter_map(move |item| match item {
                Item::Lines { lines, pen } if *pen == wanted => Some(lines),
                _ => None,
            });
            lines.flatten().collect::<Vec<_>>()
        };
        // One below and one above zero in each panel, and one in the legend.
        assert_eq!(drawn(style::LIMIT).len(), 7);
        let curves = drawn(style::AXES[0]);
        assert_eq!(curves.len(), 4);
        let inside =
            |point: &Point| (LEFT..=800.0 - RIGHT).contains(&point[0]) && (ABOVE..=600.0 - BELOW).contains(&point[1]);
        assert!(curves[..3].iter().all(|curve| curve.len() > 10 && curve.iter().all(inside)));
        Ok(())
    }

    #[test]
    fn an_empty_profile_is_a_sheet_without_curves() -> Result<(), crate::picture::SizeError> {
        let profile = Profile {
            title: String::new(),
            period_s: 0.001,
            stride_periods: 1,
            axes: Vec::new(),
            retraced_s: Vec::new(),
            shown_s: None,
        };
        assert!(draw_profile(&profile, Size::pixels(480, 320)?).to_svg().ends_with("</svg>\n"));
        Ok(())
    }
}
