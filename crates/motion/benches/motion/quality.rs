//! How near plans come to what is possible: cut lines and windows.
//!
//! Invariant: times are counted in emitted records, so that rounding to whole periods is part of every ratio.

use retrace_core::Flags;
use retrace_motion::{Feed, PathMode, Planner};

use crate::roads::{Road, TOLERANCE};
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
