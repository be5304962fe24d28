//! Limits and path, checked on the emitted records (Q7, Q8), and failures of the search (Q9).
//!
//! Invariant: the checks use the limits and the programmed moves, and nothing of the planner. A limit's share is taken
//! of α·limit·Tᵏ, the k-th difference of unrounded set-points; the effect of rounding of the numbers themselves is
//! subtracted first.

use retrace_core::Record;
use retrace_motion::{Arc, MachineLimits, PathMode, PlanFallbacks};

use crate::row::{Goal, Row};
use crate::test_paths::{self, Numbers, TestMove, TestPath};

/// Result for a path, each as a share of what is allowed.
#[derive(Clone, Copy, Debug, Default)]
struct Verdict {
    /// Velocity, acceleration, jerk.
    limits: [f64; 3],
    /// Share of half a pulse.
    rounding: f64,
    /// Share of the tolerance.
    path: f64,
    periods: u64,
    /// Number of set-points that are not within the tolerance of any move near their own.
    astray: u64,
    /// How often no plan was found: in all, behind a glide, into a glide.
    fallbacks: [u64; 3],
}

impl Verdict {
    fn with(self, other: Self) -> Self {
        Self {
            limits: std::array::from_fn(|k| self.limits[k].max(other.limits[k])),
            rounding: self.rounding.max(other.rounding),
            path: self.path.max(other.path),
            periods: self.periods + other.periods,
            astray: self.astray + other.astray,
            fallbacks: std::array::from_fn(|k| self.fallbacks[k] + other.fallbacks[k]),
        }
    }
}

/// Rows of Q7, Q8 and Q9 in the planner.
pub(crate) fn rows(full: bool) -> Vec<Row> {
    let (blocks, programs) = if full { (100_000, 2_000) } else { (10_000, 200) };
    let mut paths = test_paths::all(blocks);
    paths.extend((0..programs).map(random));
    let limits = MachineLimits::built_in();
    let all = paths.iter().fold(Verdict::default(), |all, path| all.with(LegalityCheck::of(path, &limits)));
    let largest = all.limits.into_iter().fold(0.0, f64::max);
    let [v, a, j] = all.limits;
    let roads_text = format!("{} generated paths, {} of them random, {} periods", paths.len(), programs, all.periods);
    let row = |name, what: &str, figure, goal, note| Row { name, what: what.to_owned(), figure, unit: "", goal, note };
    let caught = caught(&limits);
    vec![
        row(
            "Q7",
            "un-rounded set-points over α·limit·Tᵏ, largest",
            largest,
            Goal::AtMost(1.0 + 1e-7),
            format!("velocity {v:.9}, acceleration {a:.9}, jerk {j:.9}; {roads_text}"),
        ),
        row("Q7", "rounding over half a pulse, largest", all.rounding, Goal::AtMost(1.0), roads_text.clone()),
        row(
            "Q7",
            "over-limit plans that are caught, of 9",
            caught,
            Goal::AtLeast(9.0),
            "each limit of each axis 1 % lower".to_owned(),
        ),
        row(
            "Q8",
            "distance of emitted positions from the programmed path over the tolerance, largest",
            all.path,
            Goal::AtMost(1.0),
            format!("{roads_text}; exact moves within half a pulse a side, {} positions beyond", all.astray),
        ),
        row(
            "Q9",
            "sections of path for which no plan was found, so that the motion stops before them",
            all.fallbacks[0] as f64,
            Goal::AtMost(0.0),
            format!(
                "{} stops behind a glide, {} glides approached at a lower feed; {roads_text}",
                all.fallbacks[1], all.fallbacks[2]
            ),
        ),
    ]
}

/// Number of checkers, of nine with one limit lowered by a hundredth each, that detect a plan that uses all of the
/// limits.
fn caught(limits: &MachineLimits<3>) -> f64 {
    // Along one axis at a time, so that each reaches its own limits.
    let ends = [[40.0, 0.0, 0.0], [40.0, 40.0, 0.0], [40.0, 40.0, 40.0]];
    let ways = ends.map(TestMove::Line).to_vec();
    let path = TestPath { name: "one axis at a time", moves: ways, feed: 100.0, mode: PathMode::ExactStop };
    let lower: [fn(&mut MachineLimits<3>, usize); 3] = [
        |limits, axis| limits.velocity_mm_s[axis] *= 0.99,
        |limits, axis| limits.acceleration_mm_s2[axis] *= 0.99,
        |limits, axis| limits.jerk_mm_s3[axis] *= 0.99,
    ];
    let mut caught = 0.0;
    for (order, lower) in lower.into_iter().enumerate() {
        for axis in 0..3 {
            let mut tighter = *limits;
            lower(&mut tighter, axis);
            let found = LegalityCheck::of(&path, &tighter).limits;
            let alone = (0..3).all(|k| (found[k] > 1.0 + 1e-7) == (k == order));
            caught += if alone { 1.0 } else { 0.0 };
        }
    }
    caught
}

/// Checks a path while it is played.
struct LegalityCheck<'r> {
    path: &'r TestPath,
    limits: MachineLimits<3>,
    /// Rows of differences of the last set-point, for each axis: the point itself, and its first and second difference.
    last: [[f64; 3]; 3],
    counts: [i64; 3],
    verdict: Verdict,
}

/// Number of moves before and after its own to which an emitted position may be nearest.
const REACH: usize = 60;

impl<'r> LegalityCheck<'r> {
    fn of(path: &'r TestPath, limits: &MachineLimits<3>) -> Verdict {
        let mut judge =
            Self { path, limits: *limits, last: [[0.0; 3]; 3], counts: [0; 3], verdict: Verdict::default() };
        path.play(|record, planner| {
            judge.take(record, planner.set_point().position_mm);
            let PlanFallbacks { no_plan, stops_in_first_block, approaches } = planner.fallbacks();
            judge.verdict.fallbacks = [no_plan, stops_in_first_block, approaches];
        });
        for _ in 0..3 {
            let [end, ..] = judge.last;
            judge.differences(end);
        }
        judge.verdict
    }

    fn take(&mut self, record: &Record<3>, point: [f64; 3]) {
        self.verdict.periods += 1;
        self.differences(point);
        let mut emitted = [0.0; 3];
        for axis in 0..3 {
            self.counts[axis] += i64::from(record.increments[axis]);
            let wanted = point[axis] * self.limits.pulses_per_mm[axis];
            let off = (self.counts[axis] as f64 - wanted).abs();
            self.verdict.rounding = self.verdict.rounding.max(off / 0.5);
            emitted[axis] = self.counts[axis] as f64 / self.limits.pulses_per_mm[axis];
        }
        let pulse = self.limits.pulses_per_mm.map(f64::recip);
        let half = 0.5 * dot(pulse, pulse).sqrt();
        let tolerance = match self.path.mode {
            // An exact path is exact to the rounding.
            PathMode::Blend { tolerance_mm, .. } => tolerance_mm.max(half),
            _ => half,
        };
        let off = self.distance(record.line as usize, emitted, tolerance);
        self.verdict.path = self.verdict.path.max(off / tolerance);
        self.verdict.astray += u64::from(off > tolerance * (1.0 + 1e-9));
    }

    fn differences(&mut self, point: [f64; 3]) {
        let t = self.limits.period_s;
        let alpha = self.limits.alpha();
        for (axis, &at) in point.iter().enumerate() {
            let most = [
                self.limits.velocity_mm_s[axis] * t,
                alpha * self.limits.acceleration_mm_s2[axis] * t * t,
                alpha * self.limits.jerk_mm_s3[axis] * t * t * t,
            ];
            let noise = 2.0 * f64::EPSILON * (1.0 + at.abs());
            let mut value = at;
            for (k, most) in most.into_iter().enumerate() {
                let difference = value - std::mem::replace(&mut self.last[k][axis], value);
                let share = (difference.abs() - noise * f64::from(2 << k)).max(0.0) / most;
                self.verdict.limits[k] = self.verdict.limits[k].max(share);
                value = difference;
            }
        }
    }

    /// Distance of an emitted position from the moves around the one it belongs to; below a tenth of the tolerance no
    /// nearer one is searched for.
    fn distance(&self, tag: usize, point: [f64; 3], tolerance: f64) -> f64 {
        let own = tag.clamp(1, self.path.moves.len()) - 1;
        let mut nearest = f64::MAX;
        for k in 0..=REACH {
            for at in [own.checked_sub(k), Some(own + k)].into_iter().flatten().filter(|at| *at < self.path.moves.len())
            {
                let start = if at == 0 { [0.0; 3] } else { self.path.moves[at - 1].end() };
                nearest = nearest.min(match &self.path.moves[at] {
                    TestMove::Line(end) => to_line(point, start, *end),
                    TestMove::Arc(arc) => to_arc(point, start, arc),
                });
            }
            // The nearest move is near its own; farther ones are checked only where it is not.
            if nearest <= tolerance && k >= 3 {
                break;
            }
        }
        nearest
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

fn to_line(point: [f64; 3], start: [f64; 3], end: [f64; 3]) -> f64 {
    let (way, off) = (minus(end, start), minus(point, start));
    let along = (dot(off, way) / dot(way, way).max(1e-300)).clamp(0.0, 1.0);
    let across = minus(off, way.map(|x| along * x));
    dot(across, across).sqrt()
}

/// Distance from an arc in the XY plane of one height; its ends are points of it.
fn to_arc(point: [f64; 3], start: [f64; 3], arc: &Arc<3>) -> f64 {
    let [cx, cy] = arc.centre_mm;
    let out = |p: [f64; 3]| [p[0] - cx, p[1] - cy];
    let (from, (angle, sweep)) = (out(start), arc.sweep(&start));
    let to = out(point);
    let mut turned = (to[1].atan2(to[0]) - angle) * sweep.signum();
    turned = turned.rem_euclid(std::f64::consts::TAU);
    let end = minus(point, arc.end_mm);
    let ends = dot(minus(point, start), minus(point, start)).sqrt().min(dot(end, end).sqrt());
    if turned > sweep.abs() {
        return ends;
    }
    // Where the end is a little off the circle, the programmed path drifts there evenly.
    let share = turned / sweep.abs();
    let (first, last) = (from[0].hypot(from[1]), out(arc.end_mm)[0].hypot(out(arc.end_mm)[1]));
    let radial = to[0].hypot(to[1]) - (first + share * (last - first));
    radial.hypot(point[2] - start[2] - share * (arc.end_mm[2] - start[2])).min(ends)
}

/// A random path: lines and tangent arcs of 0.001 to 20 mm, turns of any size, in one of the path modes.
pub(crate) fn random(seed: u64) -> TestPath {
    let mut numbers = Numbers(1000 + seed);
    let (mut at, mut heading) = ([0.0f64; 3], 0.3f64);
    let mut ways = Vec::new();
    for _ in 0..numbers.between(3.0, 120.0) as usize {
        heading += match numbers.whole() % 5 {
            0 => 0.0,
            1 => numbers.between(-1e-4, 1e-4),
            2 => numbers.between(-0.02, 0.02),
            3 => numbers.between(-0.6, 0.6),
            _ => numbers.between(-3.15, 3.15),
        };
        let length = 10f64.powf(numbers.between(-3.0, 1.3));
        if numbers.whole() % 8 < 6 {
            let rise = if numbers.whole().is_multiple_of(4) { numbers.between(-0.3, 0.3) * length } else { 0.0 };
            at = [at[0] + length * heading.cos(), at[1] + length * heading.sin(), at[2] + rise];
            ways.push(TestMove::Line(at));
            continue;
        }
        let bend = numbers.between(0.05, 3.0);
        let sweep = if numbers.whole().is_multiple_of(2) { bend } else { -bend };
        let radius = length / bend;
        let side = heading + sweep.signum() * std::f64::consts::FRAC_PI_2;
        let centre = [at[0] + radius * side.cos(), at[1] + radius * side.sin()];
        let out = side + std::f64::consts::PI + sweep;
        heading += sweep;
        at = [centre[0] + radius * out.cos(), centre[1] + radius * out.sin(), at[2]];
        let rotation = if sweep > 0.0 { 1 } else { -1 };
        ways.push(TestMove::Arc(Arc { plane: [0, 1], centre_mm: centre, rotation, end_mm: at }));
    }
    let mode = match seed % 4 {
        0 => PathMode::ExactPath,
        _ => PathMode::blend(10f64.powf(numbers.between(-2.3, -0.7))),
    };
    TestPath { name: "random", moves: ways, feed: 10f64.powf(numbers.between(0.5, 2.0)), mode }
}
