//! Refinement of the speed law: the plan between two of its states, made faster within the exact limits of the axes.
//!
//! The look-ahead plans with constant limits along a block. On a curve they are shares of what the axes allow, as an
//! axis' acceleration is q″v² + q′a and its jerk q‴v³ + 3q″va + q′j. Here these sums themselves are limited, all along
//! the path (Verscheure et al. 2009; Debrouwere et al. 2013).
//!
//! - `law_path`: the path, cut at knots;
//! - `barrier`: the fastest law with limits at points, which are `limit_rows`;
//! - `lanes`: two numbers that are calculated with together;
//! - `axis_bound`: bounds on what a law uses between the points.
//!
//! Invariant: a law is returned only if all bounds of all axes are within the limits all along the path, and it takes
//! less time than the plan that it replaces.

mod axis_bound;
mod barrier;
mod lanes;
pub(crate) mod law_path;
mod limit_rows;

use crate::profile::Profile;
use crate::speed_law::axis_bound::{clipped, largest_shares};
use crate::speed_law::barrier::BarrierSolver;
use crate::speed_law::law_path::{LawSegment, LawWindow};

/// How often a law that exceeds a limit between the points is solved again.
const ROUNDS: usize = 4;
/// Margin below a share that was exceeded.
const MARGIN: f64 = 0.998;
/// Excess over a limit by which a bound may be above it: rounding.
const ROUNDING: f64 = 1e-9;
/// A segment leaves so many times as much of its limits as an early law uses more between the points than at them, …
const EXCESS: f64 = 2.0;
/// … and this much, but it may use at least so much.
const EXCESS_MARGIN: f64 = 1e-3;
const LEAST_USED: f64 = 0.9;
/// A law must take less than this part of the time of the plan.
const PAYS: f64 = 1.0 - 1e-6;

/// Refines speed laws; it retains its memory.
#[derive(Debug, Default)]
pub(crate) struct SpeedLawRefiner {
    solver: BarrierSolver,
}

impl SpeedLawRefiner {
    /// The fastest law over `path` between the first and the last of `states`, speed and acceleration at each knot, as
    /// one profile for each segment; `None` where none is found that takes less than `seconds`.
    ///
    /// `used` holds the share of the limits that each segment may use at the points, 0 where that is not known; it is
    /// updated where a law is found.
    pub(crate) fn refine<const A: usize>(
        &mut self,
        path: LawWindow<'_, A>,
        states: &[(f64, f64)],
        used: &mut [f64],
        seconds: f64,
    ) -> Option<Vec<Profile>> {
        self.solver.prepare(path, states, used);
        if !self.solver.solve() {
            return None;
        }
        self.lower_by_excess(path, used);
        let mut is_lowered = true;
        for _ in 0..ROUNDS {
            self.solver.return_to_first();
            if !self.solver.finish() {
                // So much lower, the limits may leave no law from the state at the start: then as much as is known.
                if !std::mem::take(&mut is_lowered) {
                    return None;
                }
                self.solver.permit(used);
                continue;
            }
            if self.lower_used_shares(path) {
                let law = self.profiles(path);
                let time: f64 = law.iter().map(Profile::duration).sum();
                // False for a time that is not a number, too.
                if time < PAYS * seconds {
                    used.copy_from_slice(&self.solver.used);
                    return Some(law);
                }
                return None;
            }
        }
        None
    }

    /// Lowers the shares of segments for which none is known by what the present law uses more between the points.
    fn lower_by_excess<const A: usize>(&mut self, path: LawWindow<'_, A>, known: &[f64]) {
        for (i, _) in known.iter().enumerate().filter(|(_, known)| **known == 0.0) {
            let most = self.largest_share(path, i);
            let excess = (most - self.solver.shares[i]).max(0.0);
            let used = (1.0 - EXCESS_MARGIN - EXCESS * excess).max(LEAST_USED);
            self.solver.used[i] = self.solver.used[i].min(used);
        }
    }

    /// Bound of the largest share of a limit that the present law uses on segment `i`.
    fn largest_share<const A: usize>(&self, path: LawWindow<'_, A>, i: usize) -> f64 {
        let (b, h) = (self.solver.bezier(i), path.segments[i].length);
        let (mut at, mut most) = (0.0, 0.0f64);
        for part in path.parts_of(i) {
            let (a, j) = largest_shares(part, clipped(b, at / h, (at + part.length) / h));
            most = most.max(a).max(j);
            at += part.length;
        }
        most
    }

    /// Checks each segment; where a limit is exceeded, lowers the share of the limits that it may use. True where none
    /// is.
    fn lower_used_shares<const A: usize>(&mut self, path: LawWindow<'_, A>) -> bool {
        let mut legal = true;
        for (i, segment) in path.segments.iter().enumerate() {
            let most = self.largest_share(path, i);
            if !is_within_limits(self.solver.bezier(i), most, segment) {
                legal = false;
                self.solver.used[i] *= MARGIN / most.max(1.0);
            }
        }
        legal
    }

    /// The law as one profile for each segment.
    fn profiles<const A: usize>(&self, path: LawWindow<'_, A>) -> Vec<Profile> {
        path.segments
            .iter()
            .enumerate()
            .map(|(i, segment)| {
                Profile::of_squared_speed(self.solver.bezier(i), self.solver.accelerations(i), segment.length)
            })
            .collect()
    }
}

/// Whether a segment with these coefficients of v², which uses at most the share `most` of a limit, keeps all limits;
/// false where a value is not a number.
fn is_within_limits(b: [f64; 3], most: f64, segment: &LawSegment) -> bool {
    let is_slow_enough = |b: f64, v: f64| 0.0 < b && b <= v * v * (1.0 + ROUNDING);
    most <= 1.0 + ROUNDING && b.iter().all(|&b| is_slow_enough(b, segment.v)) && is_slow_enough(b[2], segment.exit_v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_a_number_is_not_within_the_limits() {
        let segment = LawSegment { length: 1.0, v: 10.0, exit_v: 8.0, is_line: false, parts_end: 1 };
        assert!(is_within_limits([100.0, 90.0, 64.0], 1.0, &segment));
        for (b, most) in [
            ([101.0, 90.0, 64.0], 1.0),
            ([100.0, 90.0, 65.0], 1.0),
            ([100.0, 90.0, 64.0], 1.001),
            ([0.0, 90.0, 64.0], 1.0),
            ([100.0, f64::NAN, 64.0], 1.0),
            ([100.0, 90.0, f64::NAN], 1.0),
            ([100.0, f64::INFINITY, 64.0], 1.0),
            ([100.0, 90.0, 64.0], f64::NAN),
        ] {
            assert!(!is_within_limits(b, most, &segment), "{b:?}, {most}");
        }
    }
}
