//! Drawing of a job's history: its path, and below it the place over time with labelled events.
//!
//! Invariant: an event without space for its label still has a mark at its time.

use crate::draw_path::{ABOVE, LEFT, RIGHT, draw_end, draw_heading, draw_start, label_beside, shortened};
use crate::font;
use crate::history::{Activity, History, Priority};
use crate::picture::{Anchor, DisplayList, Pen, Point, Size, Text};
use crate::scale::{Scale, fixed};
use crate::sheet::{DrawingArea, Sheet};
use crate::style::{self, LABEL_SIZE, TICK_SIZE, text};
use crate::tool_path::StrokeKind;
use crate::view::View;

/// Share of the path in the height between heading and legend.
const SHARE_OF_PATH: f32 = 0.47;
/// Space below a frame, for its marks and the name of its axis, in pixels.
const BELOW_FRAME: f32 = 44.0;
/// Height of the legend's row.
const LEGEND: f32 = 38.0;
/// Height of the strip with the labels, as a share of the height, and its maximum in pixels.
const STRIP: f32 = 0.17;
const STRIP_MOST: f32 = 165.0;
/// Height of the strip with the activity.
const DOING: f32 = 20.0;
/// Distance of two columns of labels, in pixels.
const COLUMN: f32 = 17.0;
const TICK_GAP_ACROSS: f32 = 72.0;
const TICK_GAP_UP: f32 = 30.0;

/// Draws the history of a job.
#[must_use]
pub fn draw_history(history: &History, view: View, size: Size) -> DisplayList {
    let mut picture = DisplayList::new(size, &format!("history of {}", history.path.title));
    draw_heading(&mut picture, &history.path.title, "history", &history.summary);
    let height = size.height() - ABOVE - LEGEND;
    let middle = ABOVE + height * SHARE_OF_PATH;
    if let Some(extents) = history.path.extents() {
        let right = size.width() - RIGHT;
        let room = DrawingArea { left: LEFT, right, top: ABOVE, bottom: middle - BELOW_FRAME };
        let sheet = Sheet::fitting(&history.path, view, &extents, room);
        match view.axes() {
            Some(names) => sheet.draw_axes(&mut picture, names),
            None => sheet.draw_box(&mut picture, &extents),
        }
        sheet.draw_strokes(&mut picture, &history.path, StrokeKind::Retraced, style::RETRACED);
        sheet.draw_strokes(&mut picture, &history.path, StrokeKind::Executed, style::FEED);
        if let Some([start, end]) = history.path.ends() {
            draw_end(&mut picture, sheet.place(history.stands_mm.unwrap_or(end)));
            draw_start(&mut picture, sheet.place(start));
        }
    }
    let strip = (size.height() * STRIP).min(STRIP_MOST);
    let bottom = size.height() - LEGEND - BELOW_FRAME;
    PlaceCurve::of(history, size, [middle + strip, bottom]).draw(&mut picture, middle);
    draw_legend(&mut picture, history, size);
    picture
}

/// Curve of the place over time.
struct PlaceCurve<'h> {
    history: &'h History,
    time: Scale,
    place: Scale,
    bottom: f32,
}

impl<'h> PlaceCurve<'h> {
    fn of(history: &'h History, size: Size, [top, bottom]: [f32; 2]) -> Self {
        let furthest = history.samples.iter().map(|moment| moment.reached_s.max(moment.place_s)).fold(1e-3, f64::max);
        let time =
            Scale { low: 0.0, high: history.duration_s().max(1e-3), low_px: LEFT, high_px: size.width() - RIGHT };
        let place = Scale { low: 0.0, high: furthest * 1.06, low_px: bottom - DOING, high_px: top };
        Self { history, time, place, bottom }
    }

    fn draw(&self, picture: &mut DisplayList, words_top: f32) {
        self.draw_grid(picture);
        self.draw_stretches(picture);
        let reached =
            self.history.samples.iter().map(|moment| [self.time.px(moment.time_s), self.place.px(moment.reached_s)]);
        picture.lines(vec![reached.collect()], style::REACHED);
        let mut retraced: Vec<Vec<Point>> = Vec::new();
        let mut run: Vec<Vec<Point>> = Vec::new();
        for pair in self.history.samples.windows(2) {
            let line = [pair[0], pair[1]].map(|moment| [self.time.px(moment.time_s), self.place.px(moment.place_s)]);
            let lines = if pair[0].activity.is_retracing() { &mut retraced } else { &mut run };
            match lines.last_mut() {
                Some(last) if last.last() == Some(&line[0]) => last.push(line[1]),
                _ => lines.push(line.to_vec()),
            }
        }
        picture.lines(run, style::FEED);
        picture.lines(retraced, style::GONE_OVER);
        self.draw_remarks(picture, words_top);
        let (left, right, top) = (self.time.low_px, self.time.high_px, self.place.high_px);
        let corners = vec![[left, top], [right, top], [right, self.bottom], [left, self.bottom], [left, top]];
        picture.lines(vec![corners], style::FRAME);
    }

    fn draw_grid(&self, picture: &mut DisplayList) {
        let (left, right) = (self.time.low_px, self.time.high_px);
        let (low, top) = (self.place.low_px, self.place.high_px);
        let (across, up) = (self.time.ticks(TICK_GAP_ACROSS), self.place.ticks(TICK_GAP_UP));
        let vertical = across.values.iter().map(|&at| vec![[self.time.px(at), top], [self.time.px(at), low]]);
        let level = up.values.iter().map(|&at| vec![[left, self.place.px(at)], [right, self.place.px(at)]]);
        picture.lines(vertical.chain(level).collect(), style::GRID);
        for &at in &across.values {
            let x = self.time.px(at);
            picture.line([x, self.bottom], [x, self.bottom + 5.0], style::FRAME);
            picture.text(text([x, self.bottom + 19.0], across.label(at), TICK_SIZE, Anchor::Middle));
        }
        for &at in &up.values {
            let y = self.place.px(at);
            picture.line([left, y], [left - 5.0, y], style::FRAME);
            picture.text(text([left - 9.0, y + 4.3], up.label(at), TICK_SIZE, Anchor::Right));
        }
        let middle = f32::midpoint(left, right);
        picture.text(text([middle, self.bottom + 37.0], "machine time s", LABEL_SIZE, Anchor::Middle));
        let name = if low - top > 130.0 { "place: motion s" } else { "place s" };
        let at = [18.0 + font::width("M", LABEL_SIZE), f32::midpoint(low, top)];
        picture.text(Text { is_upward: true, ..text(at, name, LABEL_SIZE, Anchor::Middle) });
    }

    /// Draws the activity as a strip below the curve: shaded except in normal run, with a label where there is space.
    fn draw_stretches(&self, picture: &mut DisplayList) {
        let (top, bottom) = (self.place.low_px, self.bottom);
        picture.line([self.time.low_px, top], [self.time.high_px, top], style::GRID);
        for (doing, [from, to]) in self.history.stretches() {
            let [from, to] = [from, to].map(|at| self.time.px(at));
            if doing != Activity::Run {
                let fill = if doing.is_retracing() { style::RETRACED_BAND } else { style::STANDING_BAND };
                picture.area(&[[from, top], [to, top], [to, bottom], [from, bottom]], fill);
                picture.lines(vec![vec![[from, top], [from, bottom]], vec![[to, top], [to, bottom]]], style::LEADER);
            }
            let word = doing.word();
            if font::width(word, TICK_SIZE) + 6.0 < to - from {
                picture.text(text([f32::midpoint(from, to), bottom - 5.5], word, TICK_SIZE, Anchor::Middle));
            }
        }
    }

    /// Draws the labels, upward above the frame, each with a line to its place; only a short mark where there is no
    /// space.
    fn draw_remarks(&self, picture: &mut DisplayList, words_top: f32) {
        let top = self.place.high_px;
        let remarks = &self.history.events;
        let mut order: Vec<usize> = (0..remarks.len()).collect();
        order.sort_by_key(|&index| remarks[index].priority);
        let mut columns: Vec<f32> = Vec::new();
        let mut marks = Vec::new();
        for index in order {
            let remark = &remarks[index];
            let x = self.time.px(remark.time_s);
            // A column next to the place is possible too, if the line leads there.
            let column = [0.0, 1.0, -1.0, 2.0, -2.0].map(|side| x + side * COLUMN * 0.8).into_iter().find(|at| {
                (self.time.low_px..=self.time.high_px + RIGHT - COLUMN).contains(at)
                    && columns.iter().all(|taken| (taken - at).abs() >= COLUMN)
            });
            let Some(at) = column else {
                marks.push(vec![[x, top], [x, top + 7.0]]);
                continue;
            };
            columns.push(at);
            let y = self.history.place_s(remark.time_s).map_or(top, |place| self.place.px(place));
            picture.lines(vec![vec![[at, top - 14.0], [x, top], [x, y]]], style::LEADER);
            draw_dot(picture, [x, y]);
            let words = shortened(&remark.label, TICK_SIZE, top - 24.0 - words_top);
            let is_bold = remark.priority == Priority::Ending;
            let words =
                Text { is_upward: true, is_bold, ..text([at + 4.3, top - 18.0], words, TICK_SIZE, Anchor::Left) };
            picture.text(words);
        }
        picture.lines(marks, style::LEADER);
    }
}

fn draw_dot(picture: &mut DisplayList, [x, y]: Point) {
    let half = 2.5;
    picture.area(&[[x - half, y], [x, y - half], [x + half, y], [x, y + half]], style::INK);
}

fn draw_legend(picture: &mut DisplayList, history: &History, size: Size) {
    let y = size.height() - 18.0;
    let mut x = RIGHT;
    let retraced_mm = history.path.length_mm(StrokeKind::Retraced);
    let is_retraced = history.samples.iter().any(|moment| moment.activity.is_retracing());
    let mut entry = |label: String, pens: &[Pen]| {
        for pen in pens {
            let inset = pen.width / 2.0;
            picture.line([x + inset, y], [x + 30.0 - inset, y], *pen);
        }
        x = label_beside(picture, [x + 37.0, y], label, style::INK);
    };
    entry("run".into(), &[style::FEED]);
    if is_retraced {
        let is_wide = size.width() > 700.0;
        let label = if is_wide { format!("retraced {} mm", fixed(retraced_mm, 1)) } else { "retraced".into() };
        entry(label, &[style::RETRACED, style::GONE_OVER]);
        entry("furthest".into(), &[style::REACHED]);
    }
    draw_start(picture, [x + 6.0, y]);
    x = label_beside(picture, [x + 20.0, y], "start".into(), style::INK);
    draw_end(picture, [x + 6.0, y]);
    label_beside(picture, [x + 20.0, y], "at rest".into(), style::INK);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::history::{HistoryEvent, HistorySample};
    use crate::picture::Item;
    use crate::tool_path::{Stroke, ToolPath};
    use proptest::prelude::*;

    fn doing() -> impl Strategy<Value = Activity> {
        prop::sample::select(vec![Activity::Run, Activity::Reverse, Activity::Hold, Activity::Wheel, Activity::Paused])
    }

    fn history(moments: Vec<(f64, f64, Activity)>, remarks: Vec<(f64, String)>) -> History {
        let (mut time_s, mut reached_s) = (0.0, 0.0);
        let course = moments.into_iter().map(|(passed, place_s, doing)| {
            time_s += passed;
            reached_s = f64::max(reached_s, place_s);
            HistorySample { time_s, place_s, reached_s, activity: doing }
        });
        let course = course.collect();
        let remarks = remarks.into_iter().map(|(time_s, words)| HistoryEvent {
            time_s,
            priority: Priority::Operator,
            label: words,
        });
        let points = vec![[0.0, 0.0, 0.0], [10.0, 5.0, 0.0]];
        let strokes = vec![Stroke { kind: StrokeKind::Executed, points }];
        let path = ToolPath { title: "a job".into(), strokes };
        History { path, samples: course, events: remarks.collect(), ..History::default() }
    }

    proptest! {
        #[test]
        fn everything_is_on_the_sheet_and_nothing_that_happened_is_without_a_mark(
            moments in prop::collection::vec((0.0..5.0_f64, 0.0..100.0_f64, doing()), 0..20),
            remarks in prop::collection::vec((0.0..100.0_f64, ".{0,40}"), 0..80),
            width in 480_u32..2000,
            height in 320_u32..2000,
        ) {
            let history = history(moments, remarks);
            let size = Size::pixels(width, height).expect("allowed");
            let picture = draw_history(&history, View::Xy, size);
            let mut leads = 0;
            for item in &picture.items {
                match item {
                    Item::Lines { lines, pen } => {
                        for [x, y] in lines.iter().flatten() {
                            prop_assert!((0.0..=width as f32).contains(x) && (0.0..=height as f32).contains(y), "{x} \
                                {y}");
                        }
                        // Lines of the strip have two points, and so do marks; both begin at their upper end.
                        let is_lead = |line: &&Vec<Point>| *pen == style::LEADER
                            && (line.len() == 3 || line[1][1] - line[0][1] < 8.0);
                        leads += lines.iter().filter(is_lead).count();
                    }
                    Item::Area { .. } | Item::Text(_) => {}
                }
            }
            prop_assert_eq!(leads, history.events.len());
        }
    }

    #[test]
    fn what_ended_the_job_has_room_before_what_went_by() {
        let mut history = history(vec![(0.0, 0.0, Activity::Run), (100.0, 100.0, Activity::Run)], Vec::new());
        let remark = |rank, words: &str| HistoryEvent { time_s: 50.0, priority: rank, label: words.into() };
        history.events = (0..30).map(|_| remark(Priority::Passing, "passing")).collect();
        history.events.push(remark(Priority::Ending, "ALARM"));
        let picture = draw_history(&history, View::Xy, Size::pixels(800, 600).expect("allowed"));
        let words: Vec<&str> = picture
            .items
            .iter()
            .filter_map(|item| match item {
                Item::Text(Text { words, is_upward: true, .. }) => Some(words.as_str()),
                _ => None,
            })
            .collect();
        assert!(words.contains(&"ALARM"), "{words:?}");
    }
}
