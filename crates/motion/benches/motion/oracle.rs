//! The least time through one corner inside the tolerance tube, by linear programs.
//!
//! The jerk of both axes is constant over each time step, so acceleration and jerk are within their limits at all
//! times, and positions and speeds at the ends of the steps are linear in it. Up to the switch every step's end is
//! within the tolerance of the first leg, from the switch on within that of the second. For given times before and
//! after the switch, a linear program finds the least feasible tolerance. The optimum is the least sum of both times at
//! which that is the requested tolerance.
//!
//! Direction of the error: a jerk that changes between two steps cannot be represented (too slow by an order of
//! (step)²), and between the ends of steps speed and tube are not checked (too fast by an order of (step)²). With 120
//! steps the optimum is within 0.1 % of that with 480.
//!
//! Invariant: the programs are independent of the planner: limits, legs and tolerance are their only inputs.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};

/// Limits of axes and path, less the reserve: mm/s, mm/s², mm/s³; equal for every axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Allowed {
    pub(crate) v: f64,
    pub(crate) a: f64,
    pub(crate) j: f64,
}

impl Allowed {
    /// Limits of the built-in machine, less the reserve of 10 %.
    pub(crate) const BUILT_IN: Self = Self { v: 100.0, a: 900.0, j: 18_000.0 };

    /// Least time from rest to rest over `length` mm along a direction whose largest component is `share`, s.
    pub(crate) fn straight(&self, length: f64, share: f64) -> f64 {
        let (v, a, j) = ((self.v / share).min(self.v), self.a / share, self.j / share);
        if length >= v * (v / a + a / j) {
            length / v + v / a + a / j
        } else if length >= 2.0 * a.powi(3) / (j * j) {
            let half = 0.5 * a / j;
            2.0 * (half + (half * half + length / a).sqrt())
        } else {
            4.0 * (length / (2.0 * j)).cbrt()
        }
    }
}

/// Two legs of one length: along X, and then turned by an angle in the plane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Legs {
    pub(crate) turn: f64,
    pub(crate) leg: f64,
    pub(crate) allowed: Allowed,
}

/// The fastest motion through a corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Optimum {
    pub(crate) seconds: f64,
    /// Share of the time before the switch.
    pub(crate) share: f64,
}

/// Directions of the tangents that bound the far cap of a tube, besides its end: degrees off the leg.
const TANGENTS: [f64; 5] = [-60.0, -30.0, 0.0, 30.0, 60.0];

impl Legs {
    /// Positions of the corner and of the end of the second leg.
    pub(crate) fn points(&self) -> [[f64; 2]; 2] {
        let (sin, cos) = self.turn.sin_cos();
        [[self.leg, 0.0], [self.leg + self.leg * cos, self.leg * sin]]
    }

    /// Least times of the legs, each from rest to rest.
    pub(crate) fn stopping(&self) -> [f64; 2] {
        let (sin, cos) = self.turn.sin_cos();
        [self.allowed.straight(self.leg, 1.0), self.allowed.straight(self.leg, sin.abs().max(cos.abs()))]
    }

    /// Lower bound of the time from start to end, however wide the tube.
    fn floor(&self) -> f64 {
        self.points()[1].map(|way| self.allowed.straight(way.abs(), 1.0)).into_iter().fold(0.0, f64::max)
    }

    /// The fastest motion within `tolerance` mm, with `steps` time steps.
    pub(crate) fn optimum(&self, tolerance: f64, steps: usize) -> Optimum {
        let [first, second] = self.stopping();
        let mut best = Optimum { seconds: first + second, share: first / (first + second) };
        for _ in 0..5 {
            let seconds = self.min_time(tolerance, best, steps);
            let share = self.best_share(Optimum { seconds, ..best }, steps);
            let gained = best.seconds - seconds;
            best = Optimum { seconds, share };
            if gained < 1e-4 * seconds {
                break;
            }
        }
        best
    }

    /// Least time for the given share, for which `known` has been shown to be enough.
    fn min_time(&self, tolerance: f64, known: Optimum, steps: usize) -> f64 {
        let excess = |seconds: f64| {
            let least = self.min_tolerance(Optimum { seconds, ..known }, steps);
            least.map(|least| least.cbrt() - tolerance.cbrt())
        };
        // The cube root of the tolerance decreases nearly evenly with the time.
        let (mut low, mut high) = ((self.floor() * (1.0 - 1e-9), None), (known.seconds, -tolerance.cbrt()));
        if let Some(at) = excess(high.0) {
            high.1 = at.min(-1e-9);
        }
        for round in 0..40 {
            let middle = 0.5 * (low.0 + high.0);
            let next = match low.1 {
                Some(at) if round % 3 != 2 => high.0 + (high.0 - low.0) * high.1 / (at - high.1),
                _ => middle,
            };
            let next = next.clamp(low.0 + 0.02 * (high.0 - low.0), high.0 - 0.02 * (high.0 - low.0));
            match excess(next) {
                Some(at) if at <= 0.0 => high = (next, at),
                at => low = (next, at),
            }
            if high.0 - low.0 < 3e-5 * high.0 || high.1.abs() < 1e-4 * tolerance.cbrt() {
                break;
            }
        }
        high.0
    }

    /// The share of the time before the switch that needs the least tolerance, by golden sections around the one given.
    fn best_share(&self, from: Optimum, steps: usize) -> f64 {
        let least = |share: f64| self.min_tolerance(Optimum { share, ..from }, steps).unwrap_or(f64::MAX);
        let golden = 0.5 * (5f64.sqrt() - 1.0);
        let (mut low, mut high) = (from.share - 0.02, from.share + 0.02);
        let mut inner = [high - golden * (high - low), low + golden * (high - low)];
        let mut at = inner.map(least);
        for _ in 0..7 {
            if at[0] < at[1] {
                (high, inner[1], at[1]) = (inner[1], inner[0], at[0]);
                inner[0] = high - golden * (high - low);
                at[0] = least(inner[0]);
            } else {
                (low, inner[0], at[0]) = (inner[0], inner[1], at[1]);
                inner[1] = low + golden * (high - low);
                at[1] = least(inner[1]);
            }
        }
        let best = if at[0] < at[1] { (inner[0], at[0]) } else { (inner[1], at[1]) };
        if best.1 < least(from.share) { best.0 } else { from.share }
    }

    /// The least tolerance, mm, within which the corner is passed in those times; `None` where that is impossible.
    pub(crate) fn min_tolerance(&self, times: Optimum, steps: usize) -> Option<f64> {
        let before = steps / 2;
        let each = [times.seconds * times.share, times.seconds * (1.0 - times.share)];
        let [one, two] = [each[0] / before as f64, each[1] / (steps - before) as f64];
        let lengths: Vec<f64> = (0..steps).map(|k| if k < before { one } else { two }).collect();
        let mut program = Program::new(steps, times.seconds / steps as f64, self.allowed);
        program.motion(&lengths, self.points()[1]);
        program.limits();
        program.path_speed(self.turn);
        let [corner, _] = self.points();
        program.tube(1..=before, corner, 0.0);
        program.tube(before..=steps - 1, corner, self.turn + std::f64::consts::PI);
        program.solve()
    }
}

/// A linear program under construction: a row is a sum of terms that equals, or is at most, a number.
///
/// Units are the mean step, and the work of the largest jerk in it, so that numbers are near 1.
struct Program {
    steps: usize,
    allowed: Allowed,
    /// Unit of acceleration, speed and place.
    units: [f64; 3],
    equal: Vec<(Vec<(usize, f64)>, f64)>,
    most: Vec<(Vec<(usize, f64)>, f64)>,
}

/// A kind of variable: the jerk in a step, or acceleration, speed or place at the end of one.
#[derive(Clone, Copy)]
enum Of {
    Jerk,
    Acceleration,
    Speed,
    Place,
}

impl Program {
    fn new(steps: usize, step: f64, allowed: Allowed) -> Self {
        let units = [1, 2, 3].map(|power| allowed.j * step.powi(power));
        Self { steps, allowed, units, equal: Vec::new(), most: Vec::new() }
    }

    /// Number of a variable.
    fn at(&self, axis: usize, of: Of, k: usize) -> usize {
        axis * (4 * self.steps + 3)
            + match of {
                Of::Jerk => k,
                Of::Acceleration => self.steps + k,
                Of::Speed => 2 * self.steps + 1 + k,
                Of::Place => 3 * self.steps + 2 + k,
            }
    }

    /// The number of the tolerance, the last variable.
    fn tolerance(&self) -> usize {
        2 * (4 * self.steps + 3)
    }

    /// Adds the motion from rest at the origin to rest at `end`, step by step.
    fn motion(&mut self, lengths: &[f64], end: [f64; 2]) {
        let step = (self.units[2] / self.allowed.j).cbrt();
        for (axis, end) in end.into_iter().enumerate() {
            for (of, last) in [(Of::Acceleration, 0.0), (Of::Speed, 0.0), (Of::Place, end / self.units[2])] {
                self.equal.push((vec![(self.at(axis, of, 0), 1.0)], 0.0));
                self.equal.push((vec![(self.at(axis, of, self.steps), 1.0)], last));
            }
            for (k, length) in lengths.iter().enumerate() {
                let t = length / step;
                let [j, a, v, s] = [Of::Jerk, Of::Acceleration, Of::Speed, Of::Place].map(|of| self.at(axis, of, k));
                self.equal.push((vec![(a + 1, -1.0), (a, 1.0), (j, t)], 0.0));
                self.equal.push((vec![(v + 1, -1.0), (v, 1.0), (a, t), (j, t * t / 2.0)], 0.0));
                let place = vec![(s + 1, -1.0), (s, 1.0), (v, t), (a, t * t / 2.0), (j, t.powi(3) / 6.0)];
                self.equal.push((place, 0.0));
            }
        }
    }

    /// Adds the limits of jerk, acceleration and speed of each axis.
    fn limits(&mut self) {
        let Allowed { v, a, .. } = self.allowed;
        for axis in 0..2 {
            for (of, most) in [(Of::Jerk, 1.0), (Of::Acceleration, a / self.units[0]), (Of::Speed, v / self.units[1])] {
                let from = usize::from(!matches!(of, Of::Jerk));
                for k in from..self.steps {
                    let variable = self.at(axis, of, k);
                    self.most.extend([1.0, -1.0].map(|sign| (vec![(variable, sign)], most)));
                }
            }
        }
    }

    /// Adds the limit of the speed along the path: along the second leg and half way to it.
    fn path_speed(&mut self, turn: f64) {
        for angle in [0.5 * turn, turn] {
            let (sin, cos) = angle.sin_cos();
            for k in 1..self.steps {
                let terms = vec![(self.at(0, Of::Speed, k), cos), (self.at(1, Of::Speed, k), sin)];
                self.most.push((terms, self.allowed.v / self.units[1]));
            }
        }
    }

    /// Requires the ends of those steps to be within the tolerance of a leg that ends at `corner` in the direction
    /// `angle`.
    fn tube(&mut self, steps: std::ops::RangeInclusive<usize>, corner: [f64; 2], angle: f64) {
        let directions = TANGENTS.into_iter().chain([-90.0, 90.0]).map(|off| angle + f64::to_radians(off));
        for (sin, cos) in directions.map(f64::sin_cos) {
            let most = (cos * corner[0] + sin * corner[1]) / self.units[2];
            for k in steps.clone() {
                let terms =
                    vec![(self.at(0, Of::Place, k), cos), (self.at(1, Of::Place, k), sin), (self.tolerance(), -1.0)];
                self.most.push((terms, most));
            }
        }
    }

    /// The least tolerance in mm.
    fn solve(self) -> Option<f64> {
        let columns = self.tolerance() + 1;
        let (mut rows, mut cols, mut values, mut right) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (row, (terms, most)) in self.equal.iter().chain(&self.most).enumerate() {
            for (column, value) in terms {
                rows.push(row);
                cols.push(*column);
                values.push(*value);
            }
            right.push(*most);
        }
        let cones = [SupportedConeT::ZeroConeT(self.equal.len()), SupportedConeT::NonnegativeConeT(self.most.len())];
        let matrix = CscMatrix::new_from_triplets(right.len(), columns, rows, cols, values);
        let mut cost = vec![0.0; columns];
        cost[self.tolerance()] = 1.0;
        let settings = DefaultSettingsBuilder::default().verbose(false).build().ok()?;
        let square = CscMatrix::zeros((columns, columns));
        let mut solver = DefaultSolver::new(&square, &cost, &matrix, &right, &cones, settings).ok()?;
        solver.solve();
        let found = matches!(solver.solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved);
        found.then(|| solver.solution.obj_val.max(0.0) * self.units[2])
    }
}
