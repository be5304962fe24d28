//! Programs as `retrace canon` prints them: the moves, feeds and path modes among their canonical functions.
//!
//! Invariant: what is not a move, a feed, a path mode, a plane or a unit is ignored; stops in the program are not.

use retrace_core::Flags;
use retrace_motion::{Arc, FeedRate, PathMode, Planner};

use crate::test_paths::TOLERANCE;

/// State of the reader.
struct CanonReader {
    /// Millimetres in a unit of length.
    unit: f64,
    /// Feed, mm/s.
    feed: f64,
    mode: PathMode,
    /// Axes of the plane, and the axis across it.
    plane: [usize; 3],
}

/// Gives the moves of a program to the planner, and a stop at its end.
pub(crate) fn play(text: &str, planner: &mut Planner<3>) {
    let mut reader = CanonReader { unit: 1.0, feed: 1.0, mode: PathMode::blend(TOLERANCE), plane: [0, 1, 2] };
    for (tag, line) in (1..).zip(text.lines()) {
        let Some((head, arguments)) = line.trim_end().trim_end_matches(')').split_once('(') else { continue };
        let function = head.split_whitespace().last().unwrap_or_default();
        let words: Vec<&str> = arguments.split(',').map(str::trim).collect();
        reader.execute(function, &words, planner, tag);
    }
    planner.stop(Flags::NONE);
}

impl CanonReader {
    /// Executes one canonical function.
    fn execute(&mut self, function: &str, words: &[&str], planner: &mut Planner<3>, tag: u32) {
        let number = |k: usize| words.get(k).and_then(|word| word.parse::<f64>().ok()).unwrap_or(0.0);
        let length = |k: usize| number(k) * self.unit;
        match function {
            "USE_LENGTH_UNITS" => self.unit = if words[0] == "CANON_UNITS_INCHES" { 25.4 } else { 1.0 },
            "SELECT_PLANE" => {
                self.plane = match words[0] {
                    "CANON_PLANE_XZ" => [2, 0, 1],
                    "CANON_PLANE_YZ" => [1, 2, 0],
                    _ => [0, 1, 2],
                }
            }
            "SET_FEED_RATE" => self.feed = (length(0) / 60.0).max(1e-3),
            "SET_MOTION_CONTROL_MODE" => {
                self.mode = match words[0] {
                    "CANON_EXACT_STOP" => PathMode::ExactStop,
                    "CANON_EXACT_PATH" => PathMode::ExactPath,
                    _ if length(1) > 0.0 => PathMode::blend(length(1)),
                    _ => PathMode::blend(TOLERANCE),
                }
            }
            "SET_NAIVECAM_TOLERANCE" => self.merge(length(0)),
            // A move that the planner refuses is left out; the next one begins where the last one ended.
            "STRAIGHT_FEED" | "STRAIGHT_TRAVERSE" => {
                let is_feed = function == "STRAIGHT_FEED";
                let feed = if is_feed { FeedRate::PerSecond(self.feed) } else { FeedRate::Rapid };
                let _ = planner.line([0, 1, 2].map(length), feed, self.mode, tag);
            }
            "ARC_FEED" => {
                let [p, q, across] = self.plane;
                let mut end_mm = [0.0; 3];
                (end_mm[p], end_mm[q], end_mm[across]) = (length(0), length(1), length(5));
                let centre_mm = [length(2), length(3)];
                let arc = Arc { plane: [p, q], centre_mm, rotation: number(4) as i32, end_mm };
                let _ = planner.arc(&arc, FeedRate::PerSecond(self.feed), self.mode, tag);
            }
            _ => {}
        }
    }

    /// Sets the tolerance of merging; one equal to that of blending is LinuxCNC's default for none.
    fn merge(&mut self, merge: f64) {
        if let PathMode::Blend { tolerance_mm, .. } = self.mode {
            let given = (merge - tolerance_mm).abs() > 1e-9;
            self.mode = PathMode::Blend { tolerance_mm, merge_mm: given.then_some(merge) };
        }
    }
}
