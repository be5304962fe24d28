//! The fastest speed law between two states, by a barrier method.
//!
//! Unknown are the coefficients c of a quadratic B-spline b(s) = v², with a knot at each end of a segment. The time
//! ∫ds/√b is convex in them; acceleration q″b + ½q′b′ and caps are linear; jerk, |q‴b + ³⁄₂q″b′ + ½q′b″| ≤ J/√b, has a
//! convex right side, so its tangent at the present law is a tighter limit (sequential convex programming). Newton's
//! method on the time and the logarithms of all slacks therefore moves from law to law within the limits. Each step
//! solves a system of bandwidth 2, so its cost grows with the number of knots only.
//!
//! Invariant: the number of steps is bounded and depends on the law alone, so the result depends on path and start
//! alone. Slacks are positive at the points where limits are evaluated; what lies between them is for the caller to
//! check.

use crate::curve::Derivatives;
use crate::speed_law::law_path::LawWindow;
use crate::speed_law::limit_rows::{LimitRows, REACH, relaxed};

/// Fewest and most steps until all limits are kept, with the first weight of the time.
const FIRST_STEPS: (usize, usize) = (3, 24);
/// Steps that follow, with an ever greater weight. More of them leave a law that touches its limits; from a state of
/// such a law the next window finds none.
const STEPS: usize = 9;
/// Part of a step beyond which the weight grows.
const FAR: f64 = 0.5;
/// First weight of the time, in limits per duration of the first law, and its growth from step to step.
const WEIGHT: (f64, f64) = (1.0, 4.0);
/// Share of each limit that is used at the points where it is evaluated.
const USED: f64 = 0.998;

/// Solver; it retains its memory.
#[derive(Debug, Default)]
pub(crate) struct BarrierSolver {
    rows: LimitRows,
    /// Weights of the coefficients before each knot: see [`BarrierSolver::bezier`].
    alpha: Vec<f64>,
    lengths: Vec<f64>,
    /// Accelerations at both ends.
    ends: [f64; 2],
    /// Weight of the time, and the first one.
    weight: f64,
    first_weight: f64,
    /// Largest share of a limit at the points of each segment.
    pub(crate) shares: Vec<f64>,
    /// Coefficients, and those of the law from which the steps go on.
    pub(crate) c: Vec<f64>,
    first: Vec<f64>,
    /// Greatest values of v² at the middle coefficient of each segment and at each knot.
    caps: Vec<[f64; 2]>,
    relaxed_caps: Vec<[f64; 2]>,
    gradient: Vec<f64>,
    hessian: Vec<[f64; 3]>,
    trial: Vec<f64>,
    /// Share of its limits that each segment may use.
    pub(crate) used: Vec<f64>,
}

impl BarrierSolver {
    /// Prepares the rows of `path` and starts from the law that has these speeds and accelerations at the knots.
    pub(crate) fn prepare<const A: usize>(&mut self, path: LawWindow<'_, A>, states: &[(f64, f64)], used: &[f64]) {
        let n = path.segments.len();
        self.lengths.clear();
        self.lengths.extend(path.segments.iter().map(|segment| segment.length));
        self.alpha.clear();
        self.alpha.extend((0..=n).map(|k| match k {
            0 => 1.0,
            k if k == n => 0.0,
            k => self.lengths[k] / (self.lengths[k - 1] + self.lengths[k]),
        }));
        self.ends = [states[0].1, states[n].1];
        self.c.clear();
        self.c.push(states[0].0 * states[0].0);
        for i in 0..n {
            let ((v, a), (next_v, next_a), h) = (states[i], states[i + 1], self.lengths[i]);
            let (forward, back) = (v * v + h * a, next_v * next_v - h * next_a);
            let c = match i {
                0 => forward,
                i if i == n - 1 => back,
                _ => 0.5 * (forward + back),
            };
            self.c.push(c.max(1e-3 * (v * v).min(next_v * next_v)));
        }
        self.c.push(states[n].0 * states[n].0);
        self.caps.clear();
        let mut before = f64::MAX;
        for segment in path.segments {
            let at_end = segment.v.min(segment.exit_v);
            self.caps.push([segment.v * segment.v, before.min(segment.v).powi(2)]);
            before = at_end;
        }
        // The speeds at both ends are given, and may be the highest allowed.
        (self.caps[0], self.caps[n - 1][0]) = ([f64::MAX; 2], f64::MAX);
        self.first.clone_from(&self.c);
        self.permit(used);
        self.lay_rows(path);
    }

    /// Lets each segment use this share of its limits, and where that is 0, not known yet, the usual one.
    pub(crate) fn permit(&mut self, used: &[f64]) {
        self.used.clear();
        self.used.extend(used.iter().map(|&used| if used > 0.0 { used } else { USED }));
    }

    fn lay_rows<const A: usize>(&mut self, path: LawWindow<'_, A>) {
        self.rows.clear();
        let mut before: Option<Derivatives<A>> = None;
        let n = path.segments.len();
        for i in 0..n {
            let h = self.lengths[i];
            let (mut at, parts) = (0.0, path.parts_of(i));
            self.rows.begin_segment(self.functionals(i, 0.0).2);
            for (k, part) in parts.iter().enumerate() {
                let ends = [0.0, part.length].map(|place| part.curve.derivatives(place));
                let by = [0.0, part.length].map(|place| self.functionals(i, ((at + place) / h).min(1.0)));
                // At both ends of the path the acceleration is given.
                let is_first = i == 0 && k == 0;
                let is_last = i + 1 == n && k + 1 == parts.len();
                let is_limited = before.is_some_and(|before| continues(&before, &ends[0]));
                let needed = [!is_first && !is_limited, !is_last];
                self.rows.push(part, [&ends[0], &ends[1]], by.map(|by| by.0), by.map(|by| by.1), needed);
                before = Some(ends[1]);
                at += part.length;
            }
        }
    }

    /// v², its slope and its second derivative at share `u` of segment `i`, by the three coefficients of the segment.
    fn functionals(&self, i: usize, u: f64) -> ([f64; 3], [f64; 3], [f64; 3]) {
        let (h, p, q) = (self.lengths[i], self.alpha[i], self.alpha[i + 1]);
        let (w0, w1, w2) = ((1.0 - u) * (1.0 - u), 2.0 * u * (1.0 - u), u * u);
        let of = |x: f64, y: f64, z: f64| [x * p, x * (1.0 - p) + y + z * q, z * (1.0 - q)];
        let (d0, d1, d2) = (-2.0 * (1.0 - u) / h, (2.0 - 4.0 * u) / h, 2.0 * u / h);
        let s = 2.0 / (h * h);
        (of(w0, w1, w2), of(d0, d1, d2), of(s, -2.0 * s, s))
    }

    /// Bézier coefficients of segment `i`.
    pub(crate) fn bezier(&self, i: usize) -> [f64; 3] {
        bezier(&self.c, &self.alpha, i)
    }

    /// Accelerations at the ends of segment `i`: differences of coefficients over whole segments, which do not lose
    /// digits where the segment is short.
    pub(crate) fn accelerations(&self, i: usize) -> [f64; 2] {
        let at = |k: usize| {
            let (before, behind) =
                (k.checked_sub(1).map_or(0.0, |k| self.lengths[k]), self.lengths.get(k).unwrap_or(&0.0));
            (self.c[k + 1] - self.c[k]) / (before + behind)
        };
        let [first, last] = self.ends;
        let n = self.lengths.len();
        [if i == 0 { first } else { at(i) }, if i + 1 == n { last } else { at(i + 1) }]
    }

    /// Finds a law within all limits, from the first one; false where there is no room for one.
    pub(crate) fn solve(&mut self) -> bool {
        let n = self.lengths.len();
        if n < 4 {
            return false;
        }
        self.c.clone_from(&self.first);
        let time: f64 = (0..n).map(|i| duration(self.bezier(i), self.lengths[i])).sum();
        self.first_weight = WEIGHT.0 * (2 * self.rows.len() + 2 * n) as f64 / time;
        self.weight = self.first_weight;
        self.relaxed_caps.resize(n, [f64::MAX; 2]);
        let found = self.enter(FIRST_STEPS.0);
        // From there on where the law is solved again.
        self.first.clone_from(&self.c);
        found
    }

    /// Returns to the law that [`Self::solve`] has found.
    pub(crate) fn return_to_first(&mut self) {
        self.c.clone_from(&self.first);
        self.weight = self.first_weight;
    }

    /// Makes the law faster that [`Self::solve`] has found; false where the system has lost its digits.
    pub(crate) fn finish(&mut self) -> bool {
        if !self.enter(0) {
            return false;
        }
        for _ in 0..STEPS {
            let Some(share) = self.step() else { return false };
            if share > FAR {
                self.weight *= WEIGHT.1;
            }
        }
        true
    }

    /// Makes at least `fewest` steps until all limits are kept; false where too many do not suffice.
    fn enter(&mut self, fewest: usize) -> bool {
        let mut steps = 0;
        while self.relax() > 0 || steps < fewest {
            steps += 1;
            if steps > FIRST_STEPS.1 || self.step().is_none() {
                return false;
            }
        }
        true
    }

    /// Sets the limit in force of each row, and returns the number of those that are relaxed.
    fn relax(&mut self) -> usize {
        let mut count = self.rows.relax(&self.c, &self.used, &mut self.shares);
        for i in 0..self.lengths.len() {
            let [p0, p1, _] = self.bezier(i);
            let [cap, at_knot] = self.caps[i];
            self.relaxed_caps[i] = [relaxed(cap, p1, &mut count), relaxed(at_knot, p0, &mut count)];
        }
        count
    }

    /// One step of Newton's method. Returns the part of it that the limits allow; `None` where the system has lost its
    /// digits.
    fn step(&mut self) -> Option<f64> {
        let n = self.lengths.len();
        self.gradient.clear();
        self.gradient.resize(n + 2, 0.0);
        self.hessian.clear();
        self.hessian.resize(n + 2, [0.0; 3]);
        for i in 0..n {
            self.add_segment(i);
        }
        self.rows.add(&self.c, &mut self.gradient, &mut self.hessian);
        self.solve_banded().then(|| self.advance())
    }

    /// Adds the time over segment `i`, by Simpson's rule, and the barriers of its caps.
    fn add_segment(&mut self, i: usize) {
        let (p, q, h, weight) = (self.alpha[i], self.alpha[i + 1], self.lengths[i], self.weight);
        let r = 1.0 - p;
        let [c0, c1, c2] = [self.c[i], self.c[i + 1], self.c[i + 2]];
        let before = if i == 0 { 0.0 } else { self.lengths[i - 1] };
        let at_knot = p * c0 + r * c1;
        let by = [0.25 * p, 0.75 - 0.25 * (p - q), 0.25 * (1.0 - q)];
        let at_middle = by[0] * c0 + by[1] * c1 + by[2] * c2;
        let (one, two) = of_time(at_knot, weight / 6.0 * (before + h));
        let (cap_one, cap_two) = of_cap(self.relaxed_caps[i][1], at_knot);
        let (knot_one, knot_two) = (one + cap_one, two + cap_two);
        let (one, two) = of_time(at_middle, weight / 1.5 * h);
        let (cap_one, cap_two) = of_cap(self.relaxed_caps[i][0], c1);
        let gradient = &mut self.gradient[i..i + 3];
        gradient[0] += knot_one * p + one * by[0];
        gradient[1] += knot_one * r + one * by[1] + cap_one;
        gradient[2] += one * by[2];
        let [zero, next, last] = &mut self.hessian[i..i + 3] else { return };
        zero[0] += knot_two * p * p + two * by[0] * by[0];
        zero[1] += knot_two * p * r + two * by[0] * by[1];
        zero[2] += two * by[0] * by[2];
        next[0] += knot_two * r * r + two * by[1] * by[1] + cap_two;
        next[1] += two * by[1] * by[2];
        last[0] += two * by[2] * by[2];
    }

    /// Solves for the step, into `trial`: by Cholesky's method, in place. The two coefficients at each end are fixed.
    fn solve_banded(&mut self) -> bool {
        let n = self.c.len();
        let (from, to) = (2, n - 2);
        let (h, x) = (&mut self.hessian, &mut self.trial);
        x.clear();
        x.extend(self.gradient.iter().map(|g| -g));
        // h[i] holds row i of the upper triangle; it becomes 1/D and the unit factors, and x the solution of the lower
        // triangle.
        let (mut before, mut two_before) = ([0.0; 4], [0.0; 4]);
        for i in from..to {
            let [d, one, two] = h[i];
            // D, both factors and x of the rows before.
            let [d1, one1, two1, x1] = before;
            let [d2, _, two2, x2] = two_before;
            let of_before = d1 * one1;
            let d = d - of_before * one1 - d2 * two2 * two2;
            let one = one - of_before * two1;
            if d.is_nan() || d <= 0.0 {
                return false;
            }
            let per_d = d.recip();
            let (one, two) = (if i + 1 < to { one * per_d } else { 0.0 }, if i + 2 < to { two * per_d } else { 0.0 });
            x[i] -= one1 * x1 + two2 * x2;
            (two_before, before) = (before, [d, one, two, x[i]]);
            h[i] = [per_d, one, two];
        }
        let (mut x1, mut x2) = (0.0, 0.0);
        for i in (from..to).rev() {
            let [per_d, one, two] = h[i];
            x[i] = x[i] * per_d - one * x1 - two * x2;
            (x1, x2) = (x[i], x1);
        }
        for k in [0, 1, n - 2, n - 1] {
            x[k] = 0.0;
        }
        true
    }

    /// Makes as much of the step as the limits allow.
    fn advance(&mut self) -> f64 {
        let n = self.lengths.len();
        let mut most = 1.0f64;
        for i in 2..n {
            if self.trial[i] < 0.0 {
                most = most.min(-REACH * self.c[i] / self.trial[i]);
            }
        }
        for i in 0..n {
            let p = self.alpha[i];
            for (cap, by) in [(self.relaxed_caps[i][0], [0.0, 1.0]), (self.relaxed_caps[i][1], [p, 1.0 - p])] {
                let value = by[0] * self.c[i] + by[1] * self.c[i + 1];
                let change = by[0] * self.trial[i] + by[1] * self.trial[i + 1];
                if change > 0.0 {
                    most = most.min(REACH * (cap - value) / change);
                }
            }
        }
        most = self.rows.longest_step(&self.c, &self.trial, most);
        for (c, step) in self.c.iter_mut().zip(&self.trial) {
            *c += most * step;
        }
        most
    }
}

/// First and second derivative of the time by v² = `b`, times `weight`.
#[inline(always)]
fn of_time(b: f64, weight: f64) -> (f64, f64) {
    let per_b = b.max(1e-12).recip();
    let one = -0.5 * weight * per_b * per_b.sqrt();
    (one, -1.5 * one * per_b)
}

/// First and second derivative of the barrier of a cap.
#[inline(always)]
fn of_cap(cap: f64, value: f64) -> (f64, f64) {
    let per_slack = (cap - value).recip();
    (per_slack, per_slack * per_slack)
}

/// Whether the path has the same curvature at both places: then one limit of the acceleration is enough.
fn continues<const A: usize>(before: &Derivatives<A>, behind: &Derivatives<A>) -> bool {
    let same = |x: &[f64; A], y: &[f64; A]| x.iter().zip(y).all(|(x, y)| (x - y).abs() <= 1e-9 * (1.0 + x.abs()));
    same(&before.first, &behind.first) && same(&before.second, &behind.second)
}

fn bezier(c: &[f64], alpha: &[f64], i: usize) -> [f64; 3] {
    let (p, q) = (alpha[i], alpha[i + 1]);
    [p * c[i] + (1.0 - p) * c[i + 1], c[i + 1], q * c[i + 1] + (1.0 - q) * c[i + 2]]
}

/// Time over a segment by Simpson's rule.
fn duration([x, y, z]: [f64; 3], h: f64) -> f64 {
    let at = |b: f64| b.max(1e-12).sqrt().recip();
    h / 6.0 * (at(x) + 4.0 * at(0.25 * (x + 2.0 * y + z)) + at(z))
}
