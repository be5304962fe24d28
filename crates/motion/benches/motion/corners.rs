//! Corners compared with the optimum of a linear program (Q3).
//!
//! Invariant: the optima come from a table that [`table`] recomputes; a full run solves the programs again and reports
//! the distance of the table from them.

use std::fmt::Write as _;

use retrace_core::Flags;
use retrace_motion::{FeedRate, PathMode};

use crate::oracle::{Allowed, Legs};
use crate::row::{Goal, Row, median};
use crate::test_paths::TestPath;

/// Optima: degrees, leg and tolerance in mm, least time, time with a stop in the corner, share of the time before the
/// switch.
pub(crate) const OPTIMA: &str = include_str!("corner_optimum.csv");

/// Time steps of the linear programs.
const STEPS: usize = 120;

/// A corner of the table.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Case {
    pub(crate) degrees: f64,
    pub(crate) leg: f64,
    pub(crate) tolerance: f64,
    pub(crate) optimum: f64,
}

impl Case {
    pub(crate) fn legs(&self) -> Legs {
        Legs { turn: self.degrees.to_radians(), leg: self.leg, allowed: Allowed::BUILT_IN }
    }

    /// Duration of our plan, s.
    pub(crate) fn ours(&self, mode: PathMode) -> f64 {
        let mut planner = TestPath::planner();
        for (tag, [x, y]) in (1..).zip(self.legs().points()) {
            planner.line([x, y, 0.0], FeedRate::PerSecond(100.0), mode, tag).expect("a valid line");
        }
        planner.stop(Flags::NONE);
        std::iter::from_fn(|| planner.next_record()).fold(0u32, |sum, _| sum + 1) as f64 * 1e-3
    }
}

/// The cases of the table.
pub(crate) fn cases() -> Vec<Case> {
    let line = |line: &str| {
        let numbers: Vec<f64> = line.split(',').filter_map(|number| number.parse().ok()).collect();
        let [degrees, leg, tolerance, optimum, ..]: [f64; 6] = numbers.try_into().ok()?;
        Some(Case { degrees, leg, tolerance, optimum })
    };
    OPTIMA.lines().filter_map(line).collect()
}

/// Solves every case and writes the table.
pub(crate) fn table() -> String {
    let mut text = String::from("degrees,leg_mm,tolerance_mm,optimum_s,stop_s,share_before_switch\n");
    for leg in [2.0, 20.0] {
        for degrees in [15.0f64, 30.0, 45.0, 60.0, 90.0, 120.0, 135.0] {
            for tolerance in [0.005, 0.01, 0.02, 0.05] {
                let legs = Legs { turn: degrees.to_radians(), leg, allowed: Allowed::BUILT_IN };
                let found = legs.optimum(tolerance, STEPS);
                let stop: f64 = legs.stopping().iter().sum();
                // Writing into memory cannot fail.
                let _ = writeln!(text, "{degrees},{leg},{tolerance},{:.6},{stop:.6},{:.4}", found.seconds, found.share);
            }
        }
    }
    text
}

/// Rows of Q3.
pub(crate) fn rows(full: bool) -> Vec<Row> {
    let cases = cases();
    let (mut ratios, mut above, mut note, mut off) = (Vec::new(), 0u32, String::new(), 0.0f64);
    let mut worst = (0.0, String::new());
    for case in &cases {
        let mode = PathMode::blend(case.tolerance);
        let (ours, stop) = (case.ours(mode), case.ours(PathMode::ExactStop));
        let ratio = ours / case.optimum;
        ratios.push(ratio);
        above += u32::from(ours > stop);
        let name = format!("{}° {} mm {:.0} µm", case.degrees, case.leg, 1e3 * case.tolerance);
        let _ = write!(note, "{name} {ratio:.3} (stop {:.3}); ", stop / case.optimum);
        if ratio > worst.0 {
            worst = (ratio, name);
        }
        if full {
            let again = case.legs().optimum(case.tolerance, STEPS).seconds;
            off = off.max((again / case.optimum - 1.0).abs());
        }
    }
    let (short, slowest) = short_legs();
    let oracle =
        if full { format!("solved again, the table is within {:.2} %", 1e2 * off) } else { "from the table".into() };
    let what = |of: &str| format!("{} corners, time over the optimum in the tube, {of}", cases.len());
    let row = |what, figure, goal, note| Row { name: "Q3", what, figure, unit: "", goal, note };
    vec![
        row(
            what("median"),
            median(ratios),
            Goal::AtMost(1.02),
            format!("{note}optima {oracle}; whole periods of 1 ms"),
        ),
        row(what(&format!("worst: {}", worst.1)), worst.0, Goal::AtMost(1.05), String::new()),
        row("those slower than stopping".into(), above.into(), Goal::AtMost(0.0), String::new()),
        row("corners with legs of 0.05 … 2 mm that are slower than stopping".into(), short, Goal::AtMost(0.0), slowest),
    ]
}

/// Number of corners with short legs that take longer than with a stop, and the result of the slowest.
fn short_legs() -> (f64, String) {
    let (mut slower, mut count, mut worst) = (0.0, 0, (1.0, String::from("none")));
    for degrees in [5.0, 15.0, 30.0, 45.0, 60.0, 90.0, 120.0, 135.0, 170.0] {
        for leg in [0.05, 0.1, 0.2, 0.5, 1.0, 2.0] {
            for tolerance in [0.005, 0.01, 0.02, 0.05] {
                let case = Case { degrees, leg, tolerance, optimum: f64::NAN };
                let stop = case.ours(PathMode::ExactStop);
                let ratio = case.ours(PathMode::blend(tolerance)) / stop;
                (slower, count) = (slower + f64::from(u8::from(ratio > 1.0)), count + 1);
                if ratio > worst.0 {
                    worst = (ratio, format!("{degrees}° {leg} mm {:.0} µm, {stop:.3} s with a stop", 1e3 * tolerance));
                }
            }
        }
    }
    (slower, format!("of {count}; slowest {:.3} times: {}", worst.0, worst.1))
}
