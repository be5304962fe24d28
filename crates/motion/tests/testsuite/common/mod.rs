//! Programs to plan, and checks of the records, written independently of the planner.

use proptest::prelude::*;
use retrace_core::{Flags, Record};
use retrace_motion::{Arc, FeedRate, MachineLimits, PathMode, PlanMode, Planner};

/// One programmed move, absolute.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Path {
    Line([f64; 3]),
    Arc(Arc<3>),
}

impl Path {
    pub(crate) fn end(&self) -> [f64; 3] {
        match self {
            Self::Line(end) => *end,
            Self::Arc(arc) => arc.end_mm,
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Move {
    pub path: Path,
    pub feed: FeedRate,
    pub mode: PathMode,
    /// Whether a stop follows.
    pub stop: bool,
}

/// Everything that a planner emitted.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Run {
    pub records: Vec<Record<3>>,
    pub points: Vec<[f64; 3]>,
}

/// Feeds `moves`, with at most `most` records taken out after each move.
pub(crate) fn play(limits: MachineLimits<3>, moves: &[Move], most: usize) -> Run {
    play_on(Planner::new(limits, [0.0; 3]).expect("valid limits"), moves, most)
}

/// Feeds `moves` to a planner that plans in `plan_mode`.
pub(crate) fn play_in(plan_mode: PlanMode, limits: MachineLimits<3>, moves: &[Move], most: usize) -> Run {
    let planner = Planner::new(limits, [0.0; 3]).expect("valid limits").with_plan_mode(plan_mode);
    play_on(planner, moves, most)
}

/// Both ways to plan.
pub(crate) fn plan_mode() -> impl Strategy<Value = PlanMode> {
    prop_oneof![Just(PlanMode::Fast), Just(PlanMode::Best)]
}

/// Feeds `moves` to a given planner.
pub(crate) fn play_on(planner: Planner<3>, moves: &[Move], most: usize) -> Run {
    play_through(planner, moves, most, |_, _| ())
}

/// Feeds `moves` to a given planner, with `before` called before each record.
pub(crate) fn play_through(
    mut planner: Planner<3>,
    moves: &[Move],
    most: usize,
    mut before: impl FnMut(&mut Planner<3>, &Run),
) -> Run {
    let mut run = Run::default();
    let mut pull = |planner: &mut Planner<3>, run: &mut Run, most: usize| {
        for _ in 0..most {
            before(planner, run);
            let Some(record) = planner.next_record() else { break };
            run.records.push(record);
            run.points.push(planner.set_point().position_mm);
        }
    };
    for (k, m) in moves.iter().enumerate() {
        let tag = k as u32 + 1;
        match &m.path {
            Path::Line(end) => planner.line(*end, m.feed, m.mode, tag).expect("a valid line"),
            Path::Arc(arc) => planner.arc(arc, m.feed, m.mode, tag).expect("a valid arc"),
        }
        if m.stop {
            planner.stop(Flags::MARKER);
        }
        pull(&mut planner, &mut run, most);
    }
    planner.stop(Flags::NONE);
    pull(&mut planner, &mut run, usize::MAX);
    run
}

/// Checks that the unrounded set-points are within α of the limits, by finite differences over single periods.
pub(crate) fn check_points(limits: &MachineLimits<3>, points: &[[f64; 3]], start: [f64; 3]) -> Result<(), String> {
    let Some(&end) = points.last() else { return Ok(()) };
    let still = |at| std::iter::repeat_n(at, 3);
    let all: Vec<[f64; 3]> = still(start).chain(points.iter().copied()).chain(still(end)).collect();
    let t = limits.period_s;
    for axis in 0..3 {
        let most = [
            limits.velocity_mm_s[axis] * t,
            limits.alpha() * limits.acceleration_mm_s2[axis] * t * t,
            limits.alpha() * limits.jerk_mm_s3[axis] * t * t * t,
        ];
        let largest = all.iter().map(|p| p[axis].abs()).fold(0.0, f64::max);
        let noise = 2.0 * f64::EPSILON * (1.0 + largest);
        let mut row: Vec<f64> = all.iter().map(|p| p[axis]).collect();
        for (k, most) in most.into_iter().enumerate() {
            row = row.windows(2).map(|w| w[1] - w[0]).collect();
            let allowed = most * (1.0 + 1e-7) + noise * f64::from(2 << k);
            if let Some(n) = row.iter().position(|d| d.abs() > allowed) {
                return Err(format!(
                    "axis {axis}, difference {}, period {n}: {} of the limit",
                    k + 1,
                    row[n].abs() / most
                ));
            }
        }
    }
    Ok(())
}

/// Checks that the records are within the limits as the interface measures them, at rate 1.
pub(crate) fn check_records(limits: &MachineLimits<3>, records: &[Record<3>]) -> Result<(), String> {
    for axis in 0..3 {
        let mut counts = vec![0i64; 192];
        for record in records {
            counts.push(counts[counts.len() - 1] + i64::from(record.increments[axis]));
        }
        counts.extend(std::iter::repeat_n(counts[counts.len() - 1], 192));
        for stride in [1usize, 2, 4, 8, 16, 32, 64] {
            let span = stride as f64 * limits.period_s;
            let ppm = limits.pulses_per_mm[axis];
            let mut row = counts.clone();
            for (limit, power, allowance) in [
                (limits.velocity_mm_s[axis], 1, 1.0),
                (limits.acceleration_mm_s2[axis], 2, 2.0),
                (limits.jerk_mm_s3[axis], 3, 4.0),
            ] {
                row = row.iter().zip(&row[stride..]).map(|(a, b)| b - a).collect();
                let most = limit * span.powi(power) * ppm + allowance;
                if let Some(n) = row.iter().position(|d| d.abs() as f64 > most) {
                    return Err(format!(
                        "axis {axis}, stride {stride}, difference {power}, at {n}: {} > {most}",
                        row[n]
                    ));
                }
            }
        }
    }
    Ok(())
}

/// Distance from `p` to the segment from `a` to `b`.
fn to_segment(p: [f64; 3], a: [f64; 3], b: [f64; 3]) -> f64 {
    let (ab, ap): ([f64; 3], [f64; 3]) = (std::array::from_fn(|i| b[i] - a[i]), std::array::from_fn(|i| p[i] - a[i]));
    let dot = |x: [f64; 3], y: [f64; 3]| x[0] * y[0] + x[1] * y[1] + x[2] * y[2];
    let t = (dot(ap, ab) / dot(ab, ab).max(1e-300)).clamp(0.0, 1.0);
    let off: [f64; 3] = std::array::from_fn(|i| ap[i] - t * ab[i]);
    dot(off, off).sqrt()
}

/// A move as a chain of points, arcs within 10⁻⁵ mm.
pub(crate) fn chain(start: [f64; 3], path: &Path) -> Vec<[f64; 3]> {
    match path {
        Path::Line(end) => vec![start, *end],
        Path::Arc(arc) => {
            let [p, q] = arc.plane;
            let (x, y) = (start[p] - arc.centre_mm[0], start[q] - arc.centre_mm[1]);
            let (ex, ey) = (arc.end_mm[p] - arc.centre_mm[0], arc.end_mm[q] - arc.centre_mm[1]);
            let sign = f64::from(arc.rotation.signum());
            let mut sweep = sign * (ey.atan2(ex) - y.atan2(x));
            if sweep <= 1e-9 {
                sweep += std::f64::consts::TAU;
            }
            sweep = sign * (sweep + std::f64::consts::TAU * f64::from(arc.rotation.abs() - 1));
            let n = ((sweep.abs() * (x.hypot(y) / 8e-5).sqrt()).ceil() as usize).max(2);
            let mut points: Vec<[f64; 3]> = (0..=n)
                .map(|k| {
                    let f = k as f64 / n as f64;
                    let (sin, cos) = (sweep * f).sin_cos();
                    let mut at: [f64; 3] = std::array::from_fn(|i| start[i] + f * (arc.end_mm[i] - start[i]));
                    at[p] = arc.centre_mm[0] + x * cos - y * sin;
                    at[q] = arc.centre_mm[1] + x * sin + y * cos;
                    at
                })
                .collect();
            points.push(arc.end_mm);
            points
        }
    }
}

/// A set-point that is further than `tolerance` from every move around the one it belongs to, and its distance.
pub(crate) fn find_astray(moves: &[Move], run: &Run, reach: usize, tolerance: f64) -> Option<(usize, f64)> {
    let mut start = [0.0; 3];
    let chains: Vec<Vec<[f64; 3]>> = moves
        .iter()
        .map(|m| {
            let points = chain(start, &m.path);
            start = m.path.end();
            points
        })
        .collect();
    let away = |(record, point): (&Record<3>, &[f64; 3])| {
        let tag = (record.line as usize).max(1) - 1;
        let mut nearest = f64::MAX;
        // Its own move first; mostly that is enough.
        for k in 0..=reach {
            for at in [tag.checked_sub(k), Some(tag + k)].into_iter().flatten().filter(|at| *at < chains.len()) {
                for w in chains[at].windows(2) {
                    nearest = nearest.min(to_segment(*point, w[0], w[1]));
                    if nearest <= tolerance {
                        return nearest;
                    }
                }
            }
        }
        nearest
    };
    let mut all = run.records.iter().zip(&run.points).map(away).enumerate();
    all.find(|(_, distance)| *distance > tolerance)
}

/// Checks everything: set-points, records, the exact end, half a pulse, the path within the tolerance.
pub(crate) fn check(
    limits: &MachineLimits<3>,
    moves: &[Move],
    run: &Run,
    tolerance: f64,
    reach: usize,
) -> Result<(), String> {
    check_points(limits, &run.points, [0.0; 3])?;
    check_records(limits, &run.records)?;
    let mut counts = [0i64; 3];
    for (record, point) in run.records.iter().zip(&run.points) {
        for i in 0..3 {
            counts[i] += i64::from(record.increments[i]);
            let wanted = point[i] * limits.pulses_per_mm[i];
            if (counts[i] as f64 - wanted).abs() > 0.5 {
                return Err(format!("{} counts for {wanted}", counts[i]));
            }
        }
    }
    let end = moves.last().map_or([0.0; 3], |m| m.path.end());
    let wanted: [i64; 3] = std::array::from_fn(|i| (end[i] * limits.pulses_per_mm[i]).round() as i64);
    if counts != wanted {
        return Err(format!("ends at {counts:?}, commanded {wanted:?}"));
    }
    match find_astray(moves, run, reach, tolerance + 2e-5) {
        Some((n, distance)) => Err(format!("period {n} is {distance} mm off the path")),
        None => Ok(()),
    }
}

/// One move of a random program, relative to its start and to the direction before it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Step {
    pub kind: u8,
    /// Logarithm of the length in mm.
    pub size: f64,
    pub turn: f64,
    pub bend: f64,
    pub rise: f64,
    pub feed: f64,
    pub stop: bool,
}

pub(crate) fn step() -> impl Strategy<Value = Step> {
    let turn = prop_oneof![
        Just(0.0),
        -1e-4..1e-4f64,
        -0.02..0.02f64,
        -0.6..0.6f64,
        -3.15..3.15f64,
        Just(std::f64::consts::FRAC_PI_2)
    ];
    (0u8..8, -3.0..1.3f64, turn, -3.0..3.0f64, -0.3..0.3f64, -1.0..2.2f64, prop::bool::weighted(0.03))
        .prop_map(|(kind, size, turn, bend, rise, feed, stop)| Step { kind, size, turn, bend, rise, feed, stop })
}

/// Turns steps into a program: lines, arcs tangent to the move before, helices, inverse time, rapids.
pub(crate) fn program(steps: &[Step], mode: PathMode) -> Vec<Move> {
    let (mut at, mut heading) = ([0.0f64; 3], 0.3f64);
    steps
        .iter()
        .map(|step| {
            heading += step.turn;
            let length = 10f64.powf(step.size);
            let path = if step.kind < 5 {
                let rise = if step.kind == 4 { step.rise * length } else { 0.0 };
                Path::Line([at[0] + length * heading.cos(), at[1] + length * heading.sin(), at[2] + rise])
            } else {
                let sweep = if step.bend.abs() < 0.05 { 0.05 } else { step.bend };
                let radius = length / sweep.abs();
                let side = heading + sweep.signum() * std::f64::consts::FRAC_PI_2;
                let centre = [at[0] + radius * side.cos(), at[1] + radius * side.sin()];
                let out = side + std::f64::consts::PI + sweep;
                heading += sweep;
                let rise = if step.kind == 7 { step.rise * length } else { 0.0 };
                let end = [centre[0] + radius * out.cos(), centre[1] + radius * out.sin(), at[2] + rise];
                let rotation = if sweep > 0.0 { 1 } else { -1 };
                Path::Arc(Arc { plane: [0, 1], centre_mm: centre, rotation, end_mm: end })
            };
            at = path.end();
            let feed = match step.kind {
                3 => FeedRate::Rapid,
                2 => FeedRate::Duration(length / 10f64.powf(step.feed)),
                _ => FeedRate::PerSecond(10f64.powf(step.feed)),
            };
            Move { path, feed, mode, stop: step.stop }
        })
        .collect()
}
