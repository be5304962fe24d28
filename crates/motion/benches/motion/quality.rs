//! How near plans come to what is possible: cut lines and windows.
//!
//! Invariant: times are counted in emitted records, so that rounding to whole periods is part of every ratio.

use retrace_core::Flags;
use retrace_motion::{Feed, Limits, PathMode, Planner};

use crate::roads::{self, Road, TOLERANCE};
use crate::row::{Goal, Row};

/// Records of the moves that `give` puts into a planner.
fn periods(mut planner: Planner<3>, give: impl FnOnce(&mut Planner<3>)) -> u64 {
    give(&mut planner);
    planner.stop(Flags::NONE);
    std::iter::from_fn(|| planner.next_record()).fold(0, |sum, _| sum + 1)
}

/// Q2: a straight 100 mm line in n pieces.
pub(crate) fn cut_line(_full: bool) -> Vec<Row> {
    let mode = PathMode::Blend { tolerance_mm: TOLERANCE };
    let time = |pieces: u32, end: [f64; 3]| {
        periods(Road::planner(), |planner| {
            for k in 1..=pieces {
                let at = end.map(|x| x * f64::from(k) / f64::from(pieces));
                planner.line(at, Feed::PerSecond(100.0), mode, k).expect("a valid line");
            }
        })
    };
    let (mut worst, mut note) = (0.0f64, String::new());
    for (name, end) in [("along X", [100.0, 0.0, 0.0]), ("in space", [48.0, 64.0, 60.0])] {
        let whole = time(1, end);
        note += &format!("{name} {whole} periods uncut;");
        for pieces in [10, 100, 1_000, 10_000] {
            let cut = time(pieces, end);
            worst = worst.max(cut as f64 / whole as f64);
            note += &format!(" {pieces}: {cut}");
        }
        note.push('.');
    }
    let what = "straight 100 mm in 10 … 10⁴ pieces over the uncut line, worst".to_owned();
    vec![Row { name: "Q2", what, figure: worst, unit: "", goal: Goal::AtMost(1.001), note }]
}

/// Q4: a window of 1 000 blocks against the whole road.
pub(crate) fn windows(full: bool) -> Vec<Row> {
    let blocks = if full { 100_000 } else { 10_000 };
    let time = |road: &Road, window: usize| {
        let planner = Planner::with_look_ahead(Limits::built_in(), [0.0; 3], window);
        periods(planner.expect("the built-in machine is valid"), |planner| {
            (0..road.ways.len()).for_each(|k| road.push(planner, k));
        })
    };
    let (mut worst, mut note) = ((0.0f64, ""), String::new());
    let roads = roads::all(blocks);
    for road in &roads {
        let [narrow, wide, whole] = [1000, 10_000, usize::MAX].map(|window| time(road, window));
        let usual = periods(Road::planner(), |planner| (0..road.ways.len()).for_each(|k| road.push(planner, k)));
        // More look-ahead must not make a plan slower; where it does, what is known to be possible is compared with.
        let least = wide.min(whole).min(usual);
        let ratio = narrow as f64 / least as f64;
        let name = road.name;
        note += &format!(
            "{name} {narrow}, of 10 000 {wide}, whole {whole}, as the planner does by itself {usual} periods; "
        );
        if ratio > worst.0 {
            worst = (ratio, name);
        }
    }
    let what =
        format!("window of 1 000 blocks over more or unlimited look-ahead, the best of them, worst: {}", worst.1);
    note += "a block here is a part of the blended road, several to a programmed move; at least half the window is kept back";
    vec![Row { name: "Q4", what, figure: worst.0, unit: "", goal: Goal::AtMost(1.002), note }]
}
