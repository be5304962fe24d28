//! The glide that saves most time on two tracks (SMO-2 … SMO-6, by optimisation instead of a set ratio).
//!
//! All limits are linear in the jerks of the ramps. The time that the rest of a track takes from the end of its ramp is not; it is
//! replaced by its tangents in the points visited so far (Kelley's cutting planes, 1960) within a trust region, and each linear
//! program gives the next point. Standing until the tracks' own start is always allowed, so there is always a point to begin with.
//!
//! Invariant: what is returned keeps every limit, takes no longer than stopping in the corner would, and each track can still come
//! to rest within its room. It depends on the tracks alone.

use crate::glide::ramp::{CELLS, HALF, Ramp, Ramps};
use crate::glide::simplex::Program;
use crate::glide::tracks::{FarEnd, Track, Tracks};
use crate::limits::AxisLimits;
use crate::profile::{PathLimits, State, fastest, stopping_distance};

/// Unknown jerks.
const UNKNOWN: usize = 2 * CELLS;
/// With the times of both tracks.
const COLUMNS: usize = UNKNOWN + 2;
/// Linear programs solved for one glide at most.
const MOST_PROGRAMS: usize = 24;
/// A program that promises less than this part of the time is the last.
const ENOUGH: f64 = 1e-3;
/// Tangents kept for each track.
const MOST_TANGENTS: usize = 8;
/// Seconds are counted in this unit in the programs, so that all numbers are about 1.
const UNIT: f64 = 0.01;
/// Share of its length within which a track that moves on must be able to come to rest.
const STOPS_WITHIN: f64 = 0.8;
/// Share of the jerk with which a track that moves on can still come to rest within its room.
const GENTLE: f64 = 0.6;
/// How far the programs keep from what must stay below 0, so that their points converge from the allowed side.
const WALL_MARGIN: f64 = 0.006;

/// A tangent on a track's time: slope by each of its jerks, and the time at jerk 0, in units.
#[derive(Clone, Copy, Debug)]
struct Tangent {
    slope: [f64; CELLS],
    at_zero: f64,
}

impl Tangent {
    fn value(&self, jerks: &[f64]) -> f64 {
        self.at_zero + self.slope.iter().zip(jerks).map(|(g, x)| g * x).sum::<f64>()
    }
}

/// Finds glides; it keeps its memory.
#[derive(Debug, Default)]
pub(crate) struct Optimiser {
    program: Program,
    rows: Vec<([f64; UNKNOWN], f64)>,
    tangents: [Vec<Tangent>; 2],
    /// What must stay below 0, by its tangents.
    walls: [Vec<Tangent>; 2],
}

/// How the state at each border of the cells depends on the jerk of each cell: place, speed and acceleration.
struct Responses([[[f64; CELLS]; CELLS + 1]; 3]);

impl Responses {
    /// In units of `jerk`.
    fn new(cell: f64, jerk: f64) -> Self {
        let mut all = [[[0.0; CELLS]; CELLS + 1]; 3];
        for pulse in 0..CELLS {
            let mut jerks = [0.0; CELLS];
            jerks[pulse] = jerk;
            for (node, state) in Ramp(jerks).nodes(cell).into_iter().enumerate() {
                (all[0][node][pulse], all[1][node][pulse], all[2][node][pulse]) = (state.s, state.v, state.a);
            }
        }
        Self(all)
    }
}

/// A glide and the time that both tracks take with it, s.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Found {
    pub(crate) ramps: Ramps,
    pub(crate) time: f64,
}

/// The time both tracks take, each from its far end to the glide or from the glide to its far end, with the glide between.
pub(crate) fn time<const A: usize>(ramps: &Ramps, tracks: &Tracks<A>) -> Option<f64> {
    let [one, two] = ramps.ends();
    Some(ramps.duration() + rest_time(one, tracks, 0)? + rest_time(two, tracks, 1)?)
}

/// The limits within which a track that moves on must be able to come to rest from `state`.
pub(crate) fn gentle(limits: PathLimits, state: State) -> PathLimits {
    PathLimits { a: limits.a.max(state.a.abs()), j: GENTLE * limits.j, ..limits }
}

/// The time both tracks take with a stop in the corner.
pub(crate) fn stopping_time<const A: usize>(tracks: &Tracks<A>) -> Option<f64> {
    Some(rest_time(State::default(), tracks, 0)? + rest_time(State::default(), tracks, 1)?)
}

/// The time that track `side` takes from state `from` to rest at its far end, or to its middle, if the other half belongs to a
/// joint like this one: that is half of the time to the mirror image of the state.
fn rest_time<const A: usize>(from: State, tracks: &Tracks<A>, side: usize) -> Option<f64> {
    let track = &tracks.pair[side];
    let way = track.length - from.s;
    match track.far_end {
        FarEnd::Rest => fastest(from, State::default(), way, track.limits).ok().map(|rest| rest.duration()),
        FarEnd::Moving => {
            let stop = from.s + stopping_distance(from, gentle(track.limits, from));
            let mirrored = State::moving(from.v, -from.a);
            let both = fastest(from, mirrored, way - from.s, track.limits).ok()?;
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
    ) -> Option<Found> {
        let cell = duration / CELLS as f64;
        let jerk = tracks.pair[0].limits.j.min(tracks.pair[1].limits.j);
        let responses = Responses::new(cell, jerk);
        self.collect(tracks, axes, &responses, jerk);
        let ramps_of = |x: &[f64; UNKNOWN]| Ramps {
            cell,
            pair: [0, 1].map(|side| Ramp(std::array::from_fn(|k| x[side * CELLS + k] * jerk))),
        };
        let mut x = [0.0; UNKNOWN];
        let mut best = time(&ramps_of(&x), tracks)?;
        for side in 0..2 {
            self.tangents[side].clear();
            self.walls[side].clear();
            self.tangents[side].push(tangent(&x, side, tracks, &responses)?);
        }
        let mut trust = 0.5;
        for _ in 0..MOST_PROGRAMS {
            let (step, promised) = self.step(&x, trust);
            if promised * UNIT < ENOUGH * best {
                break;
            }
            let next: [f64; UNKNOWN] = std::array::from_fn(|k| x[k] + step[k]);
            let tangents = [0, 1].map(|side| tangent(&next, side, tracks, &responses));
            let there = time(&ramps_of(&next), tracks);
            for (kept, new) in self.tangents.iter_mut().zip(tangents) {
                kept.extend(new);
            }
            for side in 0..2 {
                let walls = &mut self.walls[side];
                for of in [overrun, overreach, undershoot, overspeed] {
                    walls.extend(wall(&next, side, tracks, &responses, of));
                }
                let many = walls.len().saturating_sub(2 * MOST_TANGENTS);
                walls.drain(..many);
            }
            match there {
                Some(time) if time < best - 0.1 * promised * UNIT => {
                    (x, best) = (next, time);
                    trust = f64::min(1.5 * trust, 8.0);
                    self.forget(&x);
                }
                Some(_) => trust *= 0.6,
                None => trust *= 0.85,
            }
            if trust < 1e-3 {
                break;
            }
        }
        let ramps = ramps_of(&x);
        let taken = ramps.taken(tracks, axes);
        let ramps = if taken > 1.0 { ramps.scaled((1.0 - 1e-12) / taken) } else { ramps };
        let time = time(&ramps, tracks)?;
        Some(Found { ramps, time })
    }

    /// The step from `x` that the tangents promise most of, and how much that is.
    fn step(&mut self, x: &[f64; UNKNOWN], trust: f64) -> ([f64; COLUMNS], f64) {
        self.program.clear(COLUMNS);
        let mut row = [0.0; COLUMNS];
        for (coefficients, most) in &self.rows {
            let used: f64 = coefficients.iter().zip(x).map(|(c, x)| c * x).sum();
            row[..UNKNOWN].copy_from_slice(coefficients);
            self.program.row(&row, most - used);
        }
        row.fill(0.0);
        for k in 0..UNKNOWN {
            for sign in [1.0, -1.0] {
                row[k] = sign;
                self.program.row(&row, trust);
            }
            row[k] = 0.0;
        }
        for side in 0..2 {
            let own = &x[side * CELLS..(side + 1) * CELLS];
            let here = self.tangents[side].iter().map(|t| t.value(own)).fold(f64::MIN, f64::max);
            for tangent in &self.tangents[side] {
                row.fill(0.0);
                row[side * CELLS..(side + 1) * CELLS].copy_from_slice(&tangent.slope);
                row[UNKNOWN + side] = -1.0;
                self.program.row(&row, here - tangent.value(own));
            }
        }
        for side in 0..2 {
            let own = &x[side * CELLS..(side + 1) * CELLS];
            for wall in &self.walls[side] {
                row.fill(0.0);
                row[side * CELLS..(side + 1) * CELLS].copy_from_slice(&wall.slope);
                self.program.row(&row, -wall.value(own) - WALL_MARGIN);
            }
        }
        let mut cost = [0.0; COLUMNS];
        cost[UNKNOWN..].fill(-1.0);
        let mut z = [0.0; COLUMNS];
        self.program.maximise(&cost, &mut z);
        (z, -(z[UNKNOWN] + z[UNKNOWN + 1]))
    }

    /// Forgets tangents that lie above the time at `x`, which they do where it is not convex, and the oldest.
    fn forget(&mut self, x: &[f64; UNKNOWN]) {
        for (side, tangents) in self.tangents.iter_mut().enumerate() {
            let own = &x[side * CELLS..(side + 1) * CELLS];
            let Some(here) = tangents.last().map(|newest| newest.value(own)) else { continue };
            tangents.retain(|tangent| tangent.value(own) <= here + 1e-4);
            let many = tangents.len().saturating_sub(MOST_TANGENTS);
            tangents.drain(..many);
        }
    }

    /// All limits as rows.
    fn collect<const A: usize>(
        &mut self,
        tracks: &Tracks<A>,
        axes: &AxisLimits<A>,
        Responses([places, speeds, accelerations]): &Responses,
        jerk: f64,
    ) {
        self.rows.clear();
        let [u, w] = tracks.pair.map(|track| track.direction);
        let mut add = |one: &[f64; CELLS], p: f64, two: &[f64; CELLS], q: f64, most: f64| {
            let mut row = [0.0; UNKNOWN];
            for k in 0..CELLS {
                row[k] = one[k] * p / most;
                row[CELLS + k] = two[k] * q / most;
            }
            if row.iter().any(|x| x.abs() > 1e-9) {
                self.rows.push((row, 1.0));
            }
        };
        let unit = |k: usize| -> [f64; CELLS] { std::array::from_fn(|i| if i == k { jerk } else { 0.0 }) };
        let none = [0.0; CELLS];
        for i in (0..A).filter(|i| u[*i] != 0.0 || w[*i] != 0.0) {
            let forward = if u[i] + w[i] < 0.0 { -1.0 } else { 1.0 };
            for k in 0..=CELLS {
                for sign in [1.0, -1.0] {
                    if k < CELLS {
                        add(&unit(CELLS - 1 - k), sign * u[i], &unit(k), sign * w[i], axes.j[i]);
                    }
                    add(&accelerations[CELLS - k], -sign * u[i], &accelerations[k], sign * w[i], axes.a[i]);
                }
                add(&speeds[CELLS - k], forward * u[i], &speeds[k], forward * w[i], axes.v[i]);
            }
        }
        let dot: f64 = u.iter().zip(w).map(|(a, b)| a * b).sum();
        let turn = dot.clamp(-1.0, 1.0).acos();
        for k in 0..=CELLS {
            let feed = match k {
                0..HALF => tracks.pair[0].feed,
                HALF => tracks.pair[0].feed.min(tracks.pair[1].feed),
                _ => tracks.pair[1].feed,
            };
            for part in [0.0, 0.25, 0.5, 0.75, 1.0] {
                let (p, q) = ((turn * part).cos(), (turn * (1.0 - part)).cos());
                add(&speeds[CELLS - k], p, &speeds[k], q, feed);
            }
        }
        // Half of both places, seen along the sum of their ways, keeps the corner within the tolerance.
        let apart = u.iter().zip(w).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
        add(&places[HALF], 0.5 * apart, &places[HALF], 0.5 * apart, tracks.tolerance);
        let band = tracks.band();
        for place in &places[1..=HALF] {
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
    Responses(responses): &Responses,
) -> Option<Tangent> {
    let own = &x[side * CELLS..(side + 1) * CELLS];
    let value = |of: usize| responses[of][CELLS].iter().zip(own).map(|(r, x)| r * x).sum::<f64>();
    let state = State { s: value(0), v: value(1), a: value(2) };
    let here = rest_time(state, tracks, side)?;
    let slope_by = |change: fn(State, f64) -> State, by: f64| {
        let (up, down) = (rest_time(change(state, by), tracks, side), rest_time(change(state, -by), tracks, side));
        match (up, down) {
            (Some(up), Some(down)) => (up - down) / (2.0 * by),
            (Some(up), None) => (up - here) / by,
            (None, Some(down)) => (here - down) / by,
            (None, None) => 0.0,
        }
    };
    let by_place = slope_by(|state, d| State { s: state.s + d, ..state }, 1e-5);
    let by_speed = slope_by(|state, d| State { v: state.v + d, ..state }, 1e-3);
    let by_acceleration = slope_by(|state, d| State { a: state.a + d, ..state }, 1e-1);
    let slope: [f64; CELLS] = std::array::from_fn(|k| {
        (by_place * responses[0][CELLS][k]
            + by_speed * responses[1][CELLS][k]
            + by_acceleration * responses[2][CELLS][k])
            / UNIT
    });
    let at_zero = here / UNIT - slope.iter().zip(own).map(|(g, x)| g * x).sum::<f64>();
    Some(Tangent { slope, at_zero })
}

/// By how much of its length a track's state cannot stop in time.
fn overrun<const A: usize>(state: State, track: &Track<A>) -> f64 {
    let (room, limits) = match track.far_end {
        FarEnd::Rest => (track.length, PathLimits { a: track.limits.a.max(state.a.abs()), ..track.limits }),
        FarEnd::Moving => (STOPS_WITHIN * track.length, gentle(track.limits, state)),
    };
    (state.s + stopping_distance(state, limits) - room) / track.length
}

/// By how much of its length a track's state cannot take its acceleration away before the middle, if the rest belongs to
/// another joint.
fn overreach<const A: usize>(state: State, track: &Track<A>) -> f64 {
    if track.far_end == FarEnd::Rest {
        return f64::MIN;
    }
    let settled = state.after(-track.limits.j, state.a.max(0.0) / track.limits.j);
    (settled.s - 0.5 * track.length) / track.length
}

/// By how much of its speed a track's state would have to go backward.
fn undershoot<const A: usize>(state: State, track: &Track<A>) -> f64 {
    (state.a * state.a.min(0.0).abs() / (2.0 * track.limits.j) - state.v) / track.limits.v
}

/// By how much a track's state comes to more than its speed.
fn overspeed<const A: usize>(state: State, track: &Track<A>) -> f64 {
    (state.v + state.a * state.a.max(0.0) / (2.0 * track.limits.j)) / track.limits.v - 1.0
}

/// The tangent at `x` on what must stay below 0.
fn wall<const A: usize>(
    x: &[f64; UNKNOWN],
    side: usize,
    tracks: &Tracks<A>,
    Responses(responses): &Responses,
    of: fn(State, &Track<A>) -> f64,
) -> Option<Tangent> {
    let own = &x[side * CELLS..(side + 1) * CELLS];
    let value = |of: usize| responses[of][CELLS].iter().zip(own).map(|(r, x)| r * x).sum::<f64>();
    let state = State { s: value(0), v: value(1), a: value(2) };
    let track = &tracks.pair[side];
    let here = of(state, track);
    if here < -0.2 || !here.is_finite() {
        return None;
    }
    let slope_by = |up: State, down: State, by: f64| (of(up, track) - of(down, track)) / (2.0 * by);
    let by_place = slope_by(State { s: state.s + 1e-5, ..state }, State { s: state.s - 1e-5, ..state }, 1e-5);
    let by_speed = slope_by(State { v: state.v + 1e-3, ..state }, State { v: state.v - 1e-3, ..state }, 1e-3);
    let by_acceleration = slope_by(State { a: state.a + 1e-1, ..state }, State { a: state.a - 1e-1, ..state }, 1e-1);
    let slope: [f64; CELLS] = std::array::from_fn(|k| {
        by_place * responses[0][CELLS][k] + by_speed * responses[1][CELLS][k] + by_acceleration * responses[2][CELLS][k]
    });
    let at_zero = here - slope.iter().zip(own).map(|(g, x)| g * x).sum::<f64>();
    Some(Tangent { slope, at_zero })
}
