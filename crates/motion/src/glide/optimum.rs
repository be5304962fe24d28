//! The glide that saves most time on two tracks (SMO-2 … SMO-6, by optimisation instead of a set ratio).
//!
//! All limits are linear in the jerks of the ramps. The time that the rest of a track takes from the end of its ramp is
//! not. It is replaced by its tangents in the points visited so far (Kelley's cutting planes, 1960) within a trust
//! region, and each linear program gives the next point. Remaining at rest until the tracks' own start is always
//! allowed, so there is always a point to begin with.
//!
//! Invariant: a glide that is returned stays within every limit, takes no longer than stopping in the corner would, and
//! each track can still come to rest within its length. It depends on the tracks alone.

use std::cmp::Ordering;
use std::ops::Range;

use crate::glide::ramp_pair::{CELLS, Ramp, RampPair};
use crate::glide::simplex::LinearProgram;
use crate::glide::tracks::{FarEnd, Track, Tracks};
use crate::limits::AxisLimits;
use crate::profile::{KinematicState, PathLimits, fastest, stopping_distance};

/// Largest number of unknown jerks, …
const UNKNOWN: usize = 2 * CELLS;
/// … and with them the times of both tracks.
const COLUMNS: usize = UNKNOWN + 2;

/// Effort of the search for a glide.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Effort {
    /// Intervals of constant jerk in each ramp; a divisor of [`CELLS`], and even.
    pub(crate) stretches: usize,
    /// Largest number of linear programs.
    pub(crate) programs: usize,
}

impl Effort {
    /// For corners of which a program may have very many.
    pub(crate) const QUICK: Self = Self { stretches: 6, programs: 8 };
    /// For corners of which it has few.
    pub(crate) const THOROUGH: Self = Self { stretches: 12, programs: 24 };
}
/// Size of the first step, as a share of the jerk.
const TRUST: f64 = 2.0;
/// A program that promises less than this part of the time is the last.
const ENOUGH: f64 = 2e-3;
/// Number of tangents retained for each track.
const MAX_TANGENTS: usize = 8;
/// Unit of time in the programs, s, so that all numbers are about 1.
const UNIT: f64 = 0.01;
/// Share of its length within which a track that continues must be able to come to rest.
const STOPS_WITHIN: f64 = 0.8;
/// Share of the jerk with which a track that continues can still come to rest within its length.
const GENTLE: f64 = 0.6;
/// A row of which no step uses more than this share is left out.
const NEVER_TIGHT: f64 = 0.999;
/// Distance of the programs from what must stay below 0, so that their points converge from the allowed side.
const WALL_MARGIN: f64 = 0.006;

/// A tangent on a track's time: slope by each of its jerks, and the time at jerk 0, in units.
#[derive(Clone, Copy, Debug)]
struct Tangent {
    slope: [f64; CELLS],
    at_zero: f64,
}

impl Tangent {
    /// The tangent with this slope whose value is `here` at `jerks`.
    fn through(jerks: &[f64], here: f64, slope: [f64; CELLS]) -> Self {
        Self { slope, at_zero: here - slope.iter().zip(jerks).map(|(g, x)| g * x).sum::<f64>() }
    }

    fn value(&self, jerks: &[f64]) -> f64 {
        self.at_zero + self.slope.iter().zip(jerks).map(|(g, x)| g * x).sum::<f64>()
    }
}

/// A limit: the sum of the jerks with these coefficients is at most 1.
#[derive(Clone, Debug)]
struct LimitRow {
    coefficients: [f64; UNKNOWN],
    /// Jerks of each track outside of which the coefficients are 0.
    used: [Range<usize>; 2],
    /// The only jerk that has a coefficient.
    only: Option<usize>,
}

impl LimitRow {
    /// `None` where no jerk has an effect.
    fn new(n: usize, coefficients: [f64; UNKNOWN]) -> Option<Self> {
        if coefficients.iter().all(|x| x.abs() <= 1e-9) {
            return None;
        }
        let used = [0..n, n..2 * n].map(|mut side| {
            let has = |k: &usize| coefficients[*k] != 0.0;
            side.clone().find(has).map_or(0..0, |first| first..side.rfind(has).unwrap_or(first) + 1)
        });
        let mut own = (0..2 * n).filter(|k| coefficients[*k] != 0.0);
        let first = own.next();
        let only = if own.next().is_none() { first } else { None };
        Some(Self { coefficients, used, only })
    }

    /// The jerks with their coefficients.
    fn iter(&self) -> impl Iterator<Item = (usize, f64)> {
        let [one, two] = self.used.clone();
        one.chain(two).map(|k| (k, self.coefficients[k]))
    }
}

/// Search for glides; it retains its memory.
#[derive(Debug, Default)]
pub(crate) struct Optimiser {
    program: LinearProgram,
    /// Intervals of constant jerk in each ramp.
    n: usize,
    rows: Vec<LimitRow>,
    tangents: [Vec<Tangent>; 2],
    /// Tangents on what must stay below 0.
    walls: [Vec<Tangent>; 2],
}

/// Dependence of the state at each border of the intervals on the jerk of each interval: place, speed and acceleration.
struct Responses {
    n: usize,
    by: [[[f64; CELLS]; CELLS + 1]; 3],
}

impl Responses {
    /// Responses of `n` intervals, in units of `jerk`.
    fn new(n: usize, stretch: f64, jerk: f64) -> Self {
        let mut by = [[[0.0; CELLS]; CELLS + 1]; 3];
        for pulse in 0..n {
            let mut jerks = [0.0; CELLS];
            jerks[pulse] = jerk;
            for (node, state) in Ramp(jerks).nodes(stretch).into_iter().enumerate() {
                (by[0][node][pulse], by[1][node][pulse], by[2][node][pulse]) = (state.s, state.v, state.a);
            }
        }
        Self { n, by }
    }

    /// State at the end of a ramp of these jerks.
    fn end(&self, jerks: &[f64]) -> KinematicState {
        let [s, v, a] = [0, 1, 2].map(|of: usize| {
            self.by[of][self.n].iter().zip(jerks).map(|(response, jerk)| response * jerk).sum::<f64>()
        });
        KinematicState { s, v, a }
    }

    /// Slope by each jerk of a quantity with these slopes by place, speed and acceleration at the end.
    fn slope(&self, [by_s, by_v, by_a]: [f64; 3]) -> [f64; CELLS] {
        let [s, v, a] = [0, 1, 2].map(|of: usize| &self.by[of][self.n]);
        std::array::from_fn(|k| by_s * s[k] + by_v * v[k] + by_a * a[k])
    }
}

/// A glide and the time that both tracks take with it, s.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OptimiserOutcome {
    pub(crate) ramps: RampPair,
    pub(crate) time: f64,
}

/// Time that both tracks take, each from its far end to the glide or from the glide to its far end, with the glide
/// between.
pub(crate) fn time<const A: usize>(ramps: &RampPair, tracks: &Tracks<A>) -> Option<f64> {
    let [one, two] = ramps.ends();
    Some(ramps.duration() + rest_time(one, tracks, 0)? + rest_time(two, tracks, 1)?)
}

/// Limits within which a track that continues must be able to come to rest from `state`.
pub(crate) fn gentle(limits: PathLimits, state: KinematicState) -> PathLimits {
    PathLimits { a: limits.a.max(state.a.abs()), j: GENTLE * limits.j, ..limits }
}

/// Time that both tracks take with a stop in the corner.
pub(crate) fn stopping_time<const A: usize>(tracks: &Tracks<A>) -> Option<f64> {
    Some(rest_time(KinematicState::default(), tracks, 0)? + rest_time(KinematicState::default(), tracks, 1)?)
}

/// Time that track `side` takes from state `from` to rest at its far end, or to its middle, if the other half belongs
/// to a junction like this one: that is half of the time to the mirror image of the state.
pub(crate) fn rest_time<const A: usize>(from: KinematicState, tracks: &Tracks<A>, side: usize) -> Option<f64> {
    let track = &tracks.pair[side];
    let distance = track.length - from.s;
    match track.far_end {
        FarEnd::Rest => {
            fastest(from, KinematicState::default(), distance, track.limits).ok().map(|rest| rest.duration())
        }
        FarEnd::Moving => {
            let stop = from.s + stopping_distance(from, gentle(track.limits, from));
            let mirrored = KinematicState::moving(from.v, -from.a);
            let both = fastest(from, mirrored, distance - from.s, track.limits).ok()?;
            (stop <= STOPS_WITHIN * track.length).then(|| 0.5 * both.duration())
        }
    }
}

impl Optimiser {
    /// The best glide of `duration` seconds that is found; `None` where none is faster than stopping.
    pub(crate) fn find<const A: usize>(
        &mut self,
        tracks: &Tracks<A>,
        axes: &AxisLimits<A>,
        duration: f64,
        effort: Effort,
    ) -> Option<OptimiserOutcome> {
        let n = effort.stretches;
        self.n = n;
        let jerk = tracks.pair[0].limits.j.min(tracks.pair[1].limits.j);
        let responses = Responses::new(n, duration / n as f64, jerk);
        self.collect(tracks, axes, &responses, jerk);
        let ramps_of = |x: &[f64; UNKNOWN]| RampPair {
            cell: duration / CELLS as f64,
            pair: [0, 1].map(|side| Ramp(std::array::from_fn(|k| x[side * n + k * n / CELLS] * jerk))),
        };
        let mut x = [0.0; UNKNOWN];
        let mut best = time(&ramps_of(&x), tracks)?;
        for side in 0..2 {
            self.tangents[side].clear();
            self.walls[side].clear();
            self.tangents[side].push(tangent(&x, side, tracks, &responses)?);
        }
        let mut trust = TRUST;
        for _ in 0..effort.programs {
            let (step, promised) = self.step(&x, trust);
            if promised * UNIT < ENOUGH * best {
                break;
            }
            let next: [f64; UNKNOWN] = std::array::from_fn(|k| x[k] + step[k]);
            let tangents = [0, 1].map(|side| tangent(&next, side, tracks, &responses));
            let there = time(&ramps_of(&next), tracks);
            for (tangents, new) in self.tangents.iter_mut().zip(tangents) {
                tangents.extend(new);
            }
            for side in 0..2 {
                let walls = &mut self.walls[side];
                for of in [overrun, overreach, undershoot, overspeed] {
                    walls.extend(wall(&next, side, tracks, &responses, of));
                }
                let many = walls.len().saturating_sub(2 * MAX_TANGENTS);
                walls.drain(..many);
            }
            match there {
                Some(time) if time < best - 0.1 * promised * UNIT => {
                    (x, best) = (next, time);
                    trust = f64::min(2.0 * trust, 4.0 * TRUST);
                    self.prune(&x);
                }
                Some(_) => trust *= 0.6,
                None => trust *= 0.85,
            }
            if trust < 1e-3 {
                break;
            }
        }
        let ramps = ramps_of(&x);
        let taken = ramps.used_share(tracks, axes);
        let ramps = if taken > 1.0 { ramps.scaled((1.0 - 1e-12) / taken) } else { ramps };
        let time = time(&ramps, tracks)?;
        Some(OptimiserOutcome { ramps, time })
    }

    /// The step from `x` that the tangents promise most of, and how much that is.
    fn step(&mut self, x: &[f64; UNKNOWN], trust: f64) -> ([f64; COLUMNS], f64) {
        let (n, unknown) = (self.n, 2 * self.n);
        self.program.clear(unknown + 2);
        let bounds = self.bounds(x, trust);
        for row in &self.rows {
            let (mut taken, mut used) = (0.0, 0.0);
            for part in &row.used {
                for ((c, x), [least, most]) in
                    row.coefficients[part.clone()].iter().zip(&x[part.clone()]).zip(&bounds[part.clone()])
                {
                    taken += c * x;
                    used += f64::max(c * least, c * most);
                }
            }
            let free = 1.0 - taken;
            // A row that no step makes tight takes time and changes nothing.
            if used >= NEVER_TIGHT * free {
                self.program.row(row.iter(), free);
            }
        }
        for (k, [least, most]) in bounds[..unknown].iter().enumerate() {
            for (sign, bound) in [(1.0, *most), (-1.0, -least)] {
                if bound >= NEVER_TIGHT * trust {
                    self.program.row([(k, sign)].into_iter(), trust);
                }
            }
        }
        for side in 0..2 {
            let own = &x[side * n..(side + 1) * n];
            let here = self.tangents[side].iter().map(|t| t.value(own)).fold(f64::MIN, f64::max);
            for tangent in &self.tangents[side] {
                let slope = (side * n..).zip(tangent.slope[..n].iter().copied());
                self.program.row(slope.chain([(unknown + side, -1.0)]), here - tangent.value(own));
            }
        }
        for side in 0..2 {
            let own = &x[side * n..(side + 1) * n];
            for wall in &self.walls[side] {
                let slope = (side * n..).zip(wall.slope[..n].iter().copied());
                self.program.row(slope, -wall.value(own) - WALL_MARGIN);
            }
        }
        let mut cost = [0.0; COLUMNS];
        cost[unknown..].fill(-1.0);
        let mut z = [0.0; COLUMNS];
        self.program.maximise(&cost[..unknown + 2], &mut z[..unknown + 2]);
        (z, -(z[unknown] + z[unknown + 1]))
    }

    /// Least and greatest step of each jerk: within the trust region, and within the limits of that jerk alone.
    fn bounds(&self, x: &[f64; UNKNOWN], trust: f64) -> [[f64; 2]; UNKNOWN] {
        let mut bounds = [[-trust, trust]; UNKNOWN];
        for row in &self.rows {
            if let Some(k) = row.only {
                let c = row.coefficients[k];
                let bound = (1.0 - c * x[k]).max(0.0) / c;
                let [least, most] = &mut bounds[k];
                if c > 0.0 {
                    *most = most.min(bound);
                } else {
                    *least = least.max(bound);
                }
            }
        }
        bounds
    }

    /// Removes tangents that are above the time at `x`, which happens where it is not convex, and the oldest.
    fn prune(&mut self, x: &[f64; UNKNOWN]) {
        let n = self.n;
        for (side, tangents) in self.tangents.iter_mut().enumerate() {
            let own = &x[side * n..(side + 1) * n];
            let Some(here) = tangents.last().map(|newest| newest.value(own)) else { continue };
            tangents.retain(|tangent| tangent.value(own) <= here + 1e-4);
            let many = tangents.len().saturating_sub(MAX_TANGENTS);
            tangents.drain(..many);
        }
    }

    /// Collects all limits as rows.
    fn collect<const A: usize>(&mut self, tracks: &Tracks<A>, axes: &AxisLimits<A>, responses: &Responses, jerk: f64) {
        self.rows.clear();
        let (n, half) = (self.n, self.n / 2);
        let [places, speeds, accelerations] = &responses.by;
        let [u, w] = tracks.pair.map(|track| track.direction);
        let mut add = |one: &[f64; CELLS], p: f64, two: &[f64; CELLS], q: f64, most: f64| {
            let mut row = [0.0; UNKNOWN];
            for k in 0..n {
                row[k] = one[k] * p / most;
                row[n + k] = two[k] * q / most;
            }
            self.rows.extend(LimitRow::new(n, row));
        };
        let unit = |k: usize| -> [f64; CELLS] { std::array::from_fn(|i| if i == k { jerk } else { 0.0 }) };
        let none = [0.0; CELLS];
        for i in (0..A).filter(|i| u[*i] != 0.0 || w[*i] != 0.0) {
            let forward = if u[i] + w[i] < 0.0 { -1.0 } else { 1.0 };
            for k in 0..=n {
                for sign in [1.0, -1.0] {
                    if k < n {
                        add(&unit(n - 1 - k), sign * u[i], &unit(k), sign * w[i], axes.j[i]);
                    }
                    add(&accelerations[n - k], -sign * u[i], &accelerations[k], sign * w[i], axes.a[i]);
                }
                add(&speeds[n - k], forward * u[i], &speeds[k], forward * w[i], axes.v[i]);
            }
        }
        let dot: f64 = u.iter().zip(w).map(|(a, b)| a * b).sum();
        let turn = dot.clamp(-1.0, 1.0).acos();
        for k in 0..=n {
            let [before, after] = tracks.pair.map(|track| track.feed);
            let feed = match k.cmp(&half) {
                Ordering::Less => before,
                Ordering::Equal => before.min(after),
                Ordering::Greater => after,
            };
            for part in [0.0, 0.25, 0.5, 0.75, 1.0] {
                let (p, q) = ((turn * part).cos(), (turn * (1.0 - part)).cos());
                add(&speeds[n - k], p, &speeds[k], q, feed);
            }
        }
        // Half of both places, projected on the sum of their directions, keeps the corner within the tolerance.
        let apart = u.iter().zip(w).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
        add(&places[half], 0.5 * apart, &places[half], 0.5 * apart, tracks.tolerance);
        let band = tracks.band();
        for place in &places[1..=half] {
            for sign in [1.0, -1.0] {
                add(place, sign, &none, 0.0, band);
                add(&none, 0.0, place, sign, band);
            }
        }
    }
}

/// The tangent on the time of track `side` at `x`, by differences.
fn tangent<const A: usize>(
    x: &[f64; UNKNOWN],
    side: usize,
    tracks: &Tracks<A>,
    responses: &Responses,
) -> Option<Tangent> {
    let own = &x[side * responses.n..(side + 1) * responses.n];
    let state = responses.end(own);
    let here = rest_time(state, tracks, side)?;
    let slopes = DIFFERENCES.map(|by| {
        let both = [1.0, -1.0].map(|sign| rest_time(moved(state, by, sign), tracks, side));
        let by: f64 = by.iter().sum();
        match both {
            [Some(up), Some(down)] => (up - down) / (2.0 * by),
            [Some(up), None] => (up - here) / by,
            [None, Some(down)] => (here - down) / by,
            [None, None] => 0.0,
        }
    });
    Some(Tangent::through(own, here / UNIT, responses.slope(slopes.map(|slope| slope / UNIT))))
}

/// The tangent at `x` on what must stay below 0; `None` where it is far below.
fn wall<const A: usize>(
    x: &[f64; UNKNOWN],
    side: usize,
    tracks: &Tracks<A>,
    responses: &Responses,
    of: fn(KinematicState, &Track<A>) -> f64,
) -> Option<Tangent> {
    let own = &x[side * responses.n..(side + 1) * responses.n];
    let (state, track) = (responses.end(own), &tracks.pair[side]);
    let here = of(state, track);
    if here < -0.2 || !here.is_finite() {
        return None;
    }
    let slopes = DIFFERENCES.map(|by| {
        let [up, down] = [1.0, -1.0].map(|sign| of(moved(state, by, sign), track));
        (up - down) / (2.0 * by.iter().sum::<f64>())
    });
    Some(Tangent::through(own, here, responses.slope(slopes)))
}

/// Steps in place, speed and acceleration by which slopes are found.
const DIFFERENCES: [[f64; 3]; 3] = [[1e-5, 0.0, 0.0], [0.0, 1e-3, 0.0], [0.0, 0.0, 1e-1]];

fn moved(state: KinematicState, [s, v, a]: [f64; 3], sign: f64) -> KinematicState {
    KinematicState { s: state.s + sign * s, v: state.v + sign * v, a: state.a + sign * a }
}

/// Share of its length that a track's state lacks to stop in time.
fn overrun<const A: usize>(state: KinematicState, track: &Track<A>) -> f64 {
    let (room, limits) = match track.far_end {
        FarEnd::Rest => (track.length, PathLimits { a: track.limits.a.max(state.a.abs()), ..track.limits }),
        FarEnd::Moving => (STOPS_WITHIN * track.length, gentle(track.limits, state)),
    };
    (state.s + stopping_distance(state, limits) - room) / track.length
}

/// Share of its length that a track's state lacks to reach zero acceleration before the middle, if the rest belongs to
/// another junction.
fn overreach<const A: usize>(state: KinematicState, track: &Track<A>) -> f64 {
    if track.far_end == FarEnd::Rest {
        return f64::MIN;
    }
    let settled = state.after(-track.limits.j, state.a.max(0.0) / track.limits.j);
    (settled.s - 0.5 * track.length) / track.length
}

/// Share of its speed at which a track's state would have to run backward.
fn undershoot<const A: usize>(state: KinematicState, track: &Track<A>) -> f64 {
    (state.a * state.a.min(0.0).abs() / (2.0 * track.limits.j) - state.v) / track.limits.v
}

/// Share of its speed by which a track's state exceeds it.
fn overspeed<const A: usize>(state: KinematicState, track: &Track<A>) -> f64 {
    (state.v + state.a * state.a.max(0.0) / (2.0 * track.limits.j)) / track.limits.v - 1.0
}
