//! Distance of plans from the optimum: cut lines and windows.

use retrace_core::Flags;
use retrace_motion::{FeedRate, MachineLimits, PathMode, Planner};

use crate::row::{Goal, Row};
use crate::test_paths::{self, TOLERANCE, TestPath};

/// Number of records of the moves that `give` puts into a planner.
fn periods(mut planner: Planner<3>, give: impl FnOnce(&mut Planner<3>)) -> u64 {
    give(&mut planner);
    planner.stop(Flags::NONE);
    std::iter::from_fn(|| planner.next_record()).fold(0, |sum, _| sum + 1)
}

/// Q2: a straight 100 mm line in n pieces.
pub(crate) fn cut_line(_full: bool) -> Vec<Row> {
    let mode = PathMode::blend(TOLERANCE);
    let time = |pieces: u32, end: [f64; 3]| {
        periods(TestPath::planner(), |planner| {
            for k in 1..=pieces {
                let at = end.map(|x| x * f64::from(k) / f64::from(pieces));
                planner.line(at, FeedRate::PerSecond(100.0), mode, k).expect("a valid line");
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

/// Q4: a window of 1 000 blocks against the whole path.
pub(crate) fn windows(full: bool) -> Vec<Row> {
    let blocks = if full { 100_000 } else { 10_000 };
    let time = |path: &TestPath, planner: Planner<3>| {
        periods(planner, |planner| (0..path.moves.len()).for_each(|k| path.push(planner, k))) as f64
    };
    let window = |blocks| {
        let planner = Planner::with_look_ahead(MachineLimits::built_in(), [0.0; 3], blocks);
        planner.expect("the built-in machine is valid")
    };
    let (mut narrow_worst, mut whole_worst, mut note) = ((0.0f64, ""), (0.0f64, ""), String::new());
    for path in &test_paths::all(blocks) {
        let name = path.name;
        let [narrow, wide, whole] = [1000, 10_000, usize::MAX].map(|blocks| time(path, window(blocks)));
        let usual = time(path, TestPath::planner());
        note += &format!(
            "{name} {narrow}, of 10 000 {wide}, whole {whole}, as the planner does by itself {usual} periods; "
        );
        for (worst, ratio) in [(&mut narrow_worst, narrow / whole), (&mut whole_worst, whole / usual.min(narrow))] {
            *worst = if ratio > worst.0 { (ratio, name) } else { *worst };
        }
    }
    note += "a block here is a part of the blended path, several to a programmed move; at least half the window is \
        retained";
    let row = |what, figure, note| Row { name: "Q4", what, figure, unit: "", goal: Goal::AtMost(1.002), note };
    vec![
        row(
            format!("window of 1 000 blocks over unlimited look-ahead, worst: {}", narrow_worst.1),
            narrow_worst.0,
            note,
        ),
        row(
            format!("unlimited look-ahead over less, worst: {}", whole_worst.1),
            whole_worst.0,
            "more look-ahead must not make a plan slower, or the row before says nothing".to_owned(),
        ),
    ]
}
