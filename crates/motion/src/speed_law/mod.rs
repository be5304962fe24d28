//! Refinement of the speed law: the plan between two of its states, made faster within the exact limits of the axes.
//!
//! The look-ahead plans with constant limits along a block. On a curve they are shares of what the axes allow, as an
//! axis' acceleration is q″v² + q′a and its jerk q‴v³ + 3q″va + q′j. Here these sums themselves are limited, all along
//! the path (Verscheure et al. 2009; Debrouwere et al. 2013).
//!
//! - `law_path`: the path, cut at knots;
//! - `barrier`: the fastest law with limits at points;
//! - `axis_bound`: bounds on what a law uses between the points.
//!
//! Invariant: a law is returned only if all bounds of all axes are within the limits all along the path, and it takes
//! less time than the plan that it replaces.

mod axis_bound;
mod barrier;
pub(crate) mod law_path;

use crate::profile::Profile;
use crate::speed_law::axis_bound::{clipped, largest_shares};
use crate::speed_law::barrier::BarrierSolver;
use crate::speed_law::law_path::LawPath;

/// How often a law that exceeds a limit between the points is solved again.
const ROUNDS: usize = 4;
/// Margin below a share that was exceeded.
const MARGIN: f64 = 0.998;
/// A law must take less than this part of the time of the plan.
const PAYS: f64 = 0.999;

/// Refines speed laws; it retains its memory.
#[derive(Debug, Default)]
pub(crate) struct SpeedLawRefiner {
    solver: BarrierSolver,
}

impl SpeedLawRefiner {
    /// The fastest law over `path` between the first and the last of `states`, speed and acceleration at each knot, as
    /// one profile for each segment; `None` where none is found that takes less than `seconds`.
    pub(crate) fn refine<const A: usize>(
        &mut self,
        path: &LawPath<A>,
        states: &[(f64, f64)],
        seconds: f64,
    ) -> Option<Vec<Profile>> {
        self.solver.prepare(path, states);
        for _ in 0..ROUNDS {
            if !self.solver.solve() {
                return None;
            }
            if self.lower_used_shares(path) {
                let law = self.profiles(path);
                let time: f64 = law.iter().map(Profile::duration).sum();
                return (time < PAYS * seconds).then_some(law);
            }
        }
        None
    }

    /// Checks each segment; where a limit is exceeded, lowers the share of the limits that it may use. True where none
    /// is.
    fn lower_used_shares<const A: usize>(&mut self, path: &LawPath<A>) -> bool {
        let mut legal = true;
        for (i, segment) in path.segments.iter().enumerate() {
            let (b, h) = (self.solver.bezier(i), segment.length);
            let (mut at, mut most) = (0.0, 0.0f64);
            for part in path.parts_of(i) {
                let (a, j) = largest_shares(part, clipped(b, at / h, (at + part.length) / h));
                most = most.max(a).max(j);
                at += part.length;
            }
            let fast = b.into_iter().fold(0.0, f64::max) > segment.v * segment.v * (1.0 + 1e-9)
                || b[2] > segment.exit_v * segment.exit_v * (1.0 + 1e-9);
            if most > 1.0 || fast {
                legal = false;
                self.solver.used[i] *= MARGIN / most.max(1.0);
            }
        }
        legal
    }

    /// The law as one profile for each segment.
    fn profiles<const A: usize>(&self, path: &LawPath<A>) -> Vec<Profile> {
        path.segments
            .iter()
            .enumerate()
            .map(|(i, segment)| {
                Profile::of_squared_speed(self.solver.bezier(i), self.solver.accelerations(i), segment.length)
            })
            .collect()
    }
}
