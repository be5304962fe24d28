//! The fastest speed law between two states, by a barrier method.
//!
//! Unknown are the coefficients c of a quadratic B-spline b(s) = v², with a knot at each end of a segment. The time
//! ∫ds/√b is convex in them; acceleration q″b + ½q′b′ and caps are linear; jerk, |q‴b + ³⁄₂q″b′ + ½q′b″| ≤ J/√b, has a
//! convex right side, so its tangent at the present law is a tighter limit (sequential convex programming). Newton's
//! method on the time and the logarithms of all slacks therefore moves from law to law within the limits. Each step
//! solves a system of bandwidth 2, so its cost grows with the number of knots only.
//!
//! Invariant: the number of steps is fixed, so the result depends on path and start alone. Slacks are positive at the
//! points where limits are evaluated; what lies between them is for the caller to check.

use crate::speed_law::law_path::LawPath;

/// Steps with the first weight of the time, and then with an ever greater one.
const STEPS: (usize, usize, usize) = (4, 24, 12);
const FAR: f64 = 0.5;
/// First weight of the time, in rows per duration of the first law, and its growth from step to step.
const WEIGHT: (f64, f64) = (2.0, 4.0);
/// Largest part of the way to the nearest limit.
const REACH: f64 = 0.95;
/// Factor of what exceeds a limit at the start: the limit of that row until it is met.
const RELAXED: f64 = 1.05;
/// Share of a limit below which it need not be relaxed.
const NEAR: f64 = 1.0 - 1e-9;
/// Share of each limit that is used at the points where it is evaluated.
const USED: f64 = 0.996;

/// A limit at a point: the sum of `by` times the three coefficients of the segment is at most `limit` either way, for a
/// jerk over the speed at that point.
#[derive(Clone, Copy, Debug)]
struct LimitRow {
    by: [f64; 3],
    limit: f64,
    /// The limit in force: above `limit` while the law exceeds that.
    relaxed: f64,
}

/// A point of a segment at which limits are evaluated.
#[derive(Clone, Copy, Debug)]
struct LimitPoint {
    segment: usize,
    /// v² by the three coefficients.
    speed: [f64; 3],
    /// Number of the row behind its last one; acceleration and jerk in turn.
    rows_end: usize,
}

/// Solver; it retains its memory.
#[derive(Debug, Default)]
pub(crate) struct BarrierSolver {
    points: Vec<LimitPoint>,
    rows: Vec<LimitRow>,
    /// Weights of the coefficients before each knot: see [`BarrierSolver::bezier`].
    alpha: Vec<f64>,
    lengths: Vec<f64>,
    /// Accelerations at both ends.
    ends: [f64; 2],
    /// Coefficients, and greatest values of v² at the middle coefficient of each segment and at each knot.
    pub(crate) c: Vec<f64>,
    first: Vec<f64>,
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
    pub(crate) fn prepare<const A: usize>(&mut self, path: &LawPath<A>, states: &[(f64, f64)]) {
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
        for segment in &path.segments {
            let at_end = segment.v.min(segment.exit_v);
            self.caps.push([segment.v * segment.v, before.min(segment.v).powi(2)]);
            before = at_end;
        }
        self.first.clone_from(&self.c);
        self.used.clear();
        self.used.resize(n, USED);
        self.lay_rows(path);
    }

    fn lay_rows<const A: usize>(&mut self, path: &LawPath<A>) {
        self.points.clear();
        self.rows.clear();
        for i in 0..path.segments.len() {
            let h = self.lengths[i];
            let mut at = 0.0;
            for part in path.parts_of(i) {
                for place in [0.0, part.length] {
                    let (speed, slope, bend) = self.functionals(i, ((at + place) / h).min(1.0));
                    let d = part.curve.derivatives(place);
                    for axis in 0..A {
                        let (one, two, three) = (d.first[axis], d.second[axis], d.third[axis]);
                        if one == 0.0 && two == 0.0 && three == 0.0 {
                            continue;
                        }
                        let acceleration = std::array::from_fn(|k| two * speed[k] + 0.5 * one * slope[k]);
                        let jerk =
                            std::array::from_fn(|k| three * speed[k] + 1.5 * two * slope[k] + 0.5 * one * bend[k]);
                        let row = |by, limit| LimitRow { by, limit, relaxed: f64::MAX };
                        self.rows.extend([row(acceleration, part.a[axis]), row(jerk, part.j[axis])]);
                    }
                    self.points.push(LimitPoint { segment: i, speed, rows_end: self.rows.len() });
                }
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

    /// Runs all steps; false where the law cannot be improved because it leaves no room.
    pub(crate) fn solve(&mut self) -> bool {
        let n = self.lengths.len();
        if n < 4 {
            return false;
        }
        self.c.clone_from(&self.first);
        let time: f64 = (0..n).map(|i| duration(self.bezier(i), self.lengths[i])).sum();
        let mut weight = WEIGHT.0 * (2 * self.rows.len() + 2 * n) as f64 / time;
        for row in &mut self.rows {
            row.relaxed = f64::MAX;
        }
        self.relaxed_caps.clear();
        self.relaxed_caps.resize(n, [f64::MAX; 2]);
        // Within all limits first.
        let mut steps = 0;
        while self.relax() > 0 || steps < STEPS.0 {
            steps += 1;
            if steps > STEPS.1 || self.step(weight).is_none() {
                return false;
            }
        }
        for _ in 0..STEPS.2 {
            self.relax();
            let Some(share) = self.step(weight) else { return false };
            if share > FAR {
                weight *= WEIGHT.1;
            }
        }
        true
    }

    /// Sets the limit in force of each row, and returns the number of those that are relaxed.
    fn relax(&mut self) -> usize {
        let (mut first, mut count) = (0, 0);
        for point in &self.points {
            let c = &self.c[point.segment..point.segment + 3];
            let v = dot(&point.speed, c).max(0.0).sqrt();
            for (k, row) in self.rows[first..point.rows_end].iter_mut().enumerate() {
                let value = dot(&row.by, c).abs() * if k % 2 == 0 { 1.0 } else { v };
                row.relaxed = relaxed(self.used[point.segment] * row.limit, value, &mut count);
            }
            first = point.rows_end;
        }
        for i in 0..self.lengths.len() {
            let [p0, p1, _] = self.bezier(i);
            let [cap, at_knot] = self.caps[i];
            self.relaxed_caps[i] = [relaxed(cap, p1, &mut count), relaxed(at_knot, p0, &mut count)];
        }
        count
    }

    /// One step of Newton's method. Returns the part of it that the limits allow; `None` where the system has lost its
    /// digits.
    fn step(&mut self, weight: f64) -> Option<f64> {
        let n = self.lengths.len();
        self.gradient.clear();
        self.gradient.resize(n + 2, 0.0);
        self.hessian.clear();
        self.hessian.resize(n + 2, [0.0; 3]);
        for i in 0..n {
            self.add_time(i, weight);
            self.add_caps(i);
        }
        let (mut first, points) = (0, std::mem::take(&mut self.points));
        for point in &points {
            let i = point.segment;
            let c = [self.c[i], self.c[i + 1], self.c[i + 2]];
            let b = dot(&point.speed, &c);
            let per_v = b.sqrt().recip();
            let (mut g, mut hess) = ([0.0; 3], [0.0; 6]);
            for (k, row) in self.rows[first..point.rows_end].iter().enumerate() {
                let value = dot(&row.by, &c);
                let (limit, falling) =
                    if k % 2 == 0 { (row.relaxed, 0.0) } else { (row.relaxed * per_v, 0.5 * row.relaxed * per_v / b) };
                for sign in [1.0, -1.0] {
                    let per_slack = (limit - sign * value).recip();
                    let by: [f64; 3] =
                        std::array::from_fn(|m| per_slack * (sign * row.by[m] + falling * point.speed[m]));
                    add_square(&mut g, &mut hess, &by);
                }
            }
            first = point.rows_end;
            self.add(i, &g, &hess);
        }
        self.points = points;
        self.solve_banded().then(|| self.advance())
    }

    fn add(&mut self, i: usize, g: &[f64; 3], h: &[f64; 6]) {
        for (sum, part) in self.gradient[i..].iter_mut().zip(g) {
            *sum += part;
        }
        self.hessian[i][0] += h[0];
        self.hessian[i][1] += h[1];
        self.hessian[i][2] += h[2];
        self.hessian[i + 1][0] += h[3];
        self.hessian[i + 1][1] += h[4];
        self.hessian[i + 2][0] += h[5];
    }

    fn add_time(&mut self, i: usize, weight: f64) {
        let (p, q, h) = (self.alpha[i], self.alpha[i + 1], self.lengths[i]);
        let bezier = self.bezier(i);
        let (mut g, mut hess) = ([0.0; 3], [0.0; 6]);
        for (share, [x, y, z]) in
            [(1.0 / 6.0, [1.0, 0.0, 0.0]), (4.0 / 6.0, [0.25, 0.5, 0.25]), (1.0 / 6.0, [0.0, 0.0, 1.0])]
        {
            let b = (x * bezier[0] + y * bezier[1] + z * bezier[2]).max(1e-12);
            let per_v = b.sqrt().recip();
            let (one, two) = (-0.5 * weight * share * h * per_v / b, 0.75 * weight * share * h * per_v / (b * b));
            let by = [x * p, x * (1.0 - p) + y + z * q, z * (1.0 - q)];
            for (sum, part) in g.iter_mut().zip(by) {
                *sum += one * part;
            }
            for (sum, part) in hess.iter_mut().zip(products(&by)) {
                *sum += two * part;
            }
        }
        self.add(i, &g, &hess);
    }

    fn add_caps(&mut self, i: usize) {
        let [cap, at_knot] = self.relaxed_caps[i];
        let p = self.alpha[i];
        let c = [self.c[i], self.c[i + 1], self.c[i + 2]];
        let (mut g, mut hess) = ([0.0; 3], [0.0; 6]);
        for (cap, by) in [(cap, [0.0, 1.0, 0.0]), (at_knot, [p, 1.0 - p, 0.0])] {
            let value = dot(&by, &c);
            if cap < 1e12 {
                let per_slack = (cap - value).recip();
                add_square(&mut g, &mut hess, &by.map(|x| x * per_slack));
            }
        }
        self.add(i, &g, &hess);
    }

    /// Solves for the step, into `trial`: by Cholesky's method, in place. The two coefficients at each end are fixed.
    fn solve_banded(&mut self) -> bool {
        let n = self.c.len();
        let (from, to) = (2, n - 2);
        let (h, x) = (&mut self.hessian, &mut self.trial);
        x.clear();
        x.extend(self.gradient.iter().map(|g| -g));
        // h[i] holds the row i of the upper triangle; it becomes D and the unit factors.
        for i in from..to {
            let [mut d, mut one, two] = h[i];
            if i > from {
                let [before, of, _] = h[i - 1];
                d -= before * of * of;
                // The row two before has its part in `of` already.
                one -= before * of * h[i - 1][2];
            }
            if i > from + 1 {
                let [before, _, of] = h[i - 2];
                d -= before * of * of;
            }
            if d.is_nan() || d <= 0.0 {
                return false;
            }
            let (one, two) = (if i + 1 < to { one / d } else { 0.0 }, if i + 2 < to { two / d } else { 0.0 });
            h[i] = [d, one, two];
        }
        for i in from..to {
            if i > from {
                x[i] -= h[i - 1][1] * x[i - 1];
            }
            if i > from + 1 {
                x[i] -= h[i - 2][2] * x[i - 2];
            }
        }
        for i in (from..to).rev() {
            x[i] /= h[i][0];
            if i + 1 < to {
                x[i] -= h[i][1] * x[i + 1];
            }
            if i + 2 < to {
                x[i] -= h[i][2] * x[i + 2];
            }
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
        let mut first = 0;
        for point in &self.points {
            let i = point.segment;
            let c = [self.c[i], self.c[i + 1], self.c[i + 2]];
            let change = [self.trial[i], self.trial[i + 1], self.trial[i + 2]];
            let (b, b_change) = (dot(&point.speed, &c), dot(&point.speed, &change));
            if b_change < 0.0 {
                most = most.min(-REACH * b / b_change);
            }
            let per_v = b.sqrt().recip();
            // A jerk over the speed falls at least as slowly as its tangent, as it is convex.
            let falls = -0.5 * per_v * b_change / b;
            for (k, row) in self.rows[first..point.rows_end].iter().enumerate() {
                let (value, by) = (dot(&row.by, &c), dot(&row.by, &change));
                let (limit, rises) =
                    if k % 2 == 0 { (row.relaxed, 0.0) } else { (row.relaxed * per_v, row.relaxed * falls) };
                let (slack, loses) = if by > 0.0 { (limit - value, by - rises) } else { (limit + value, -by - rises) };
                if loses * most > REACH * slack {
                    most = REACH * slack / loses;
                }
                let (slack, loses) = if by > 0.0 { (limit + value, -by - rises) } else { (limit - value, by - rises) };
                if loses * most > REACH * slack {
                    most = REACH * slack / loses;
                }
            }
            first = point.rows_end;
        }
        for (c, step) in self.c.iter_mut().zip(&self.trial) {
            *c += most * step;
        }
        most
    }
}

/// Limit in force where the limit is `limit` and the value is `value`; counts those that are relaxed.
fn relaxed(limit: f64, value: f64, count: &mut usize) -> f64 {
    if value < NEAR * limit {
        return limit;
    }
    *count += 1;
    limit.max(RELAXED * value)
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

#[inline]
fn dot(a: &[f64; 3], c: &[f64]) -> f64 {
    a[0] * c[0] + a[1] * c[1] + a[2] * c[2]
}

#[inline]
fn add_square(g: &mut [f64; 3], h: &mut [f64; 6], by: &[f64; 3]) {
    for (sum, part) in g.iter_mut().zip(by) {
        *sum += part;
    }
    for (sum, part) in h.iter_mut().zip(products(by)) {
        *sum += part;
    }
}

/// Upper triangle of the products of the components, row by row.
#[inline]
fn products([x, y, z]: &[f64; 3]) -> [f64; 6] {
    [x * x, x * y, x * z, y * y, y * z, z * z]
}
