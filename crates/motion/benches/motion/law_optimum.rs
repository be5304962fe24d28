//! The fastest speed law with limited jerk over a part of a planned path, by a sequence of cone programs on a dense
//! grid.
//!
//! Unknown is b = v² at nodes about a control period of the plan apart, linear in between. The time is the sum of 2h
//! over the sum of the speeds at both ends of each interval, a cone; acceleration |q″b + ½q′b′| ≤ A and caps are
//! linear; jerk, |q‴b + ³⁄₂q″b′ + ½q′b″| ≤ J/√b, is linearised at the present law, by which its limit gets tighter. The
//! method shares nothing with the planner's own but the formulation (`docs/motion.md`): neither the form of the law nor
//! the solver nor the way limits are checked.
//!
//! Direction of the error: limits hold at the nodes only, so the optimum is too fast by an order of (spacing)². A
//! second difference over three nodes sees a sawtooth of b.
//!
//! Invariant: path, limits and the states at both ends are its only inputs; the plan is where it starts.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
use retrace_motion::PlannedPiece;

/// Node of the grid.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    /// Place, mm.
    pub(crate) s: f64,
    /// Speed and acceleration of the plan, mm/s, mm/s².
    pub(crate) v: f64,
    pub(crate) a: f64,
    /// Highest speed, mm/s.
    pub(crate) cap: f64,
    /// Derivatives of the position; the third one is the mean of both sides.
    pub(crate) q: [[f64; 3]; 3],
    /// Acceleration and jerk of each axis, mm/s², mm/s³.
    pub(crate) limits: [[f64; 3]; 2],
}

impl Node {
    /// Node in the state (v, a) at place `s`, which is `on` mm on `piece` and, where it is on a border, at the end of
    /// `before`.
    pub(crate) fn new(
        (s, v, a): (f64, f64, f64),
        (piece, on): (&PlannedPiece<3>, f64),
        before: Option<&PlannedPiece<3>>,
    ) -> Self {
        let mut q = piece.derivatives(on);
        let (mut cap, mut limits) = (piece.speed_mm_s, [piece.acceleration_mm_s2, piece.jerk_mm_s3]);
        if let Some(before) = before {
            let third = before.derivatives(before.length_mm)[2];
            q[2] = std::array::from_fn(|i| 0.5 * (q[2][i] + third[i]));
            cap = cap.min(before.speed_mm_s).min(before.exit_speed_mm_s);
            let other = [before.acceleration_mm_s2, before.jerk_mm_s3];
            limits = std::array::from_fn(|k| std::array::from_fn(|i| limits[k][i].max(other[k][i])));
        }
        Self { s, v, a, cap, q, limits }
    }
}

/// Most programs, and the gain below which the last one was enough.
const PROGRAMS: usize = 20;
const ENOUGH: f64 = 1e-4;

/// Least time over the nodes between the states of the plan at both ends, s; `None` where a program fails.
pub(crate) fn least_time(nodes: &[Node]) -> Option<f64> {
    let mut b: Vec<f64> = nodes.iter().map(|node| node.v * node.v).collect();
    let mut time = f64::MAX;
    for _ in 0..PROGRAMS {
        let next = LawProgram::new(nodes, &b).solve()?;
        let gained = time - seconds(nodes, &next);
        b = next;
        time = seconds(nodes, &b);
        if gained < ENOUGH * time {
            break;
        }
    }
    Some(time)
}

/// Time of a law, s.
fn seconds(nodes: &[Node], b: &[f64]) -> f64 {
    let interval = |k: usize| 2.0 * (nodes[k + 1].s - nodes[k].s) / (b[k].sqrt() + b[k + 1].sqrt());
    (0..nodes.len() - 1).map(interval).sum()
}

/// A cone program under construction. Unknown are x = b over the present b at each node, y ≤ √x, and z for each
/// interval: its time over the present one.
struct LawProgram<'n> {
    nodes: &'n [Node],
    b: &'n [f64],
    /// Terms of the rows: row, column, value; a row's terms are at most its right side.
    terms: Vec<(usize, usize, f64)>,
    right: Vec<f64>,
}

/// A sum of terms by node.
type Terms = Vec<(usize, f64)>;

impl<'n> LawProgram<'n> {
    fn new(nodes: &'n [Node], b: &'n [f64]) -> Self {
        Self { nodes, b, terms: Vec::new(), right: Vec::new() }
    }

    fn row(&mut self, terms: impl IntoIterator<Item = (usize, f64)>, most: f64) {
        let row = self.right.len();
        self.terms.extend(terms.into_iter().map(|(column, value)| (row, column, value)));
        self.right.push(most);
    }

    /// b, b′ and b″ at a node as sums over x, and their constant parts, which follow from the accelerations at the
    /// ends.
    fn at(&self, k: usize) -> [(Terms, f64); 3] {
        let (nodes, b) = (self.nodes, self.b);
        let last = nodes.len() - 1;
        let h = |k: usize| nodes[k + 1].s - nodes[k].s;
        let own = (vec![(k, b[k])], 0.0);
        let slope = |k: usize, by: f64| vec![(k, -b[k] * by / h(k)), (k + 1, b[k + 1] * by / h(k))];
        if k == 0 || k == last {
            let (inner, sign) = if k == 0 { (0, 1.0) } else { (k - 1, -1.0) };
            let given = 2.0 * nodes[k].a;
            let by = sign * 2.0 / h(inner);
            return [own, (Vec::new(), given), (slope(inner, by), -given * by)];
        }
        let (before, behind) = (h(k - 1), h(k));
        let both = before + behind;
        let mut first = slope(k - 1, behind / both);
        first.extend(slope(k, before / both));
        let mut second = slope(k - 1, -2.0 / both);
        second.extend(slope(k, 2.0 / both));
        [own, (first, 0.0), (second, 0.0)]
    }

    /// Adds the limits of acceleration and jerk at node `k`.
    fn limit(&mut self, k: usize) {
        let (node, b) = (&self.nodes[k], self.b[k]);
        let parts = self.at(k);
        let is_end = k == 0 || k + 1 == self.nodes.len();
        for axis in 0..3 {
            let [one, two, three] = [0, 1, 2].map(|order| node.q[order][axis]);
            let [a, j] = [0, 1].map(|order| node.limits[order][axis]);
            let sum = |by: [f64; 3], per: f64| {
                let mut terms = Terms::new();
                for ((part, _), by) in parts.iter().zip(by) {
                    terms.extend(part.iter().map(|(column, value)| (*column, by * value / per)));
                }
                (terms, parts.iter().zip(by).map(|((_, constant), by)| by * constant / per).sum::<f64>())
            };
            // The acceleration at the ends is given.
            if !is_end {
                let (terms, constant) = sum([two, 0.5 * one, 0.0], a);
                for sign in [1.0, -1.0] {
                    self.row(terms.iter().map(|(column, value)| (*column, sign * value)), 1.0 - sign * constant);
                }
            }
            let (terms, constant) = sum([three, 1.5 * two, 0.5 * one], j / b.sqrt());
            for sign in [1.0, -1.0] {
                let tangent = [(k, 0.5)];
                let all = terms.iter().map(|(column, value)| (*column, sign * value)).chain(tangent);
                self.row(all, 1.5 - sign * constant);
            }
        }
    }

    /// Adds a cone: ‖(second, third)‖ ≤ first, each a sum of terms and a constant.
    fn cone(&mut self, rows: [(&[(usize, f64)], f64); 3]) {
        for (terms, constant) in rows {
            self.row(terms.iter().map(|(column, value)| (*column, -value)), constant);
        }
    }

    /// The next law.
    fn solve(mut self) -> Option<Vec<f64>> {
        let n = self.nodes.len();
        for k in [0, n - 1] {
            self.row([(k, 1.0)], 1.0);
        }
        let equal = self.right.len();
        for k in 0..n {
            self.limit(k);
            let most = self.nodes[k].cap * self.nodes[k].cap / self.b[k];
            if k > 0 && k + 1 < n {
                self.row([(k, 1.0)], most.max(1.0));
                self.row([(k, -1.0)], -1e-2);
            }
        }
        let linear = self.right.len() - equal;
        let mut cost = vec![0.0; 3 * n - 1];
        for k in 0..n - 1 {
            let [v, w] = [k, k + 1].map(|k| self.b[k].sqrt());
            cost[2 * n + k] = 2.0 * (self.nodes[k + 1].s - self.nodes[k].s) / (v + w);
            let (y, next_y, z) = (n + k, n + k + 1, 2 * n + k);
            let (p, q) = (v / (v + w), w / (v + w));
            self.cone([(&[(z, 1.0), (y, p), (next_y, q)], 0.0), (&[], 2.0), (&[(z, 1.0), (y, -p), (next_y, -q)], 0.0)]);
        }
        for k in 0..n {
            self.cone([(&[(k, 1.0)], 1.0), (&[(n + k, 2.0)], 0.0), (&[(k, 1.0)], -1.0)]);
        }
        let mut cones = vec![SupportedConeT::ZeroConeT(equal), SupportedConeT::NonnegativeConeT(linear)];
        cones.extend(std::iter::repeat_n(SupportedConeT::SecondOrderConeT(3), 2 * n - 1));
        let rows = self.terms.iter().map(|term| term.0).collect();
        let columns = self.terms.iter().map(|term| term.1).collect();
        let values = self.terms.iter().map(|term| term.2).collect();
        let matrix = CscMatrix::new_from_triplets(self.right.len(), cost.len(), rows, columns, values);
        let settings = DefaultSettingsBuilder::default().verbose(false).build().ok()?;
        let square = CscMatrix::zeros((cost.len(), cost.len()));
        let mut solver = DefaultSolver::new(&square, &cost, &matrix, &self.right, &cones, settings).ok()?;
        solver.solve();
        let found = matches!(solver.solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved);
        found.then(|| (0..n).map(|k| solver.solution.x[k].max(1e-3) * self.b[k]).collect())
    }
}
