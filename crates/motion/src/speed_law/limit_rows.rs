//! Limits of the axes at both ends of each part of the path, as rows of the barrier method.
//!
//! Invariant: a row whose limit cannot be reached is zero, and changes nothing. Values are shares of the limits.

use crate::curve::Derivatives;
use crate::speed_law::lanes::{Lanes, dot};
use crate::speed_law::law_path::LawPart;

/// Largest part of the way to the nearest limit.
pub(super) const REACH: f64 = 0.95;
/// Factor of what exceeds a limit at the start: the limit of that row until it is met.
const RELAXED: f64 = 1.05;
/// Share of a limit below which it need not be relaxed.
const NEAR: f64 = 1.0 - 1e-9;

/// Limits of one axis at both ends of a part: acceleration as a share of its limit is `acceleration` times speed² and
/// its slope; jerk over the speed is `jerk` times speed², its slope and its bend.
#[derive(Clone, Copy, Debug)]
struct AxisRow {
    acceleration: [Lanes; 2],
    jerk: [Lanes; 3],
    /// The shares in force: above what may be used while the law exceeds that.
    most_acceleration: Lanes,
    most_jerk: Lanes,
}

/// Part of a segment.
#[derive(Clone, Copy, Debug)]
struct PartRows {
    segment: usize,
    /// v² and its slope at both ends by the three coefficients of the segment.
    speed: [Lanes; 3],
    slope: [Lanes; 3],
    /// Number of the row behind its last one.
    rows_end: usize,
}

/// All rows; they retain their memory.
#[derive(Debug, Default)]
pub(super) struct LimitRows {
    parts: Vec<PartRows>,
    rows: Vec<AxisRow>,
    /// Second derivative of v² by the three coefficients of each segment.
    bends: Vec<[f64; 3]>,
}

/// Gradient and upper triangle of the second derivatives, by speed², slope and bend at both ends.
#[derive(Clone, Copy, Default)]
struct PartSums {
    g: [Lanes; 3],
    h: [Lanes; 6],
}

impl LimitRows {
    pub(super) fn clear(&mut self) {
        self.parts.clear();
        self.rows.clear();
        self.bends.clear();
    }

    /// Number of limits.
    pub(super) fn len(&self) -> usize {
        4 * self.rows.len()
    }

    /// Begins the next segment, with the second derivative of v² in it.
    pub(super) fn begin_segment(&mut self, bend: [f64; 3]) {
        self.bends.push(bend);
    }

    /// Appends a part of the last segment. `speed` and `slope` are those at its start and at its end; where the
    /// acceleration is limited already or given, its limit there is not `needed`.
    pub(super) fn push<const A: usize>(
        &mut self,
        part: &LawPart<A>,
        ends: [&Derivatives<A>; 2],
        speed: [[f64; 3]; 2],
        slope: [[f64; 3]; 2],
        needed: [bool; 2],
    ) {
        let is_line = part.curve.is_line();
        let strongest = |limits: &[f64; A]| {
            (0..A).max_by(|&p, &q| {
                let share = |i: usize| ends[0].first[i].abs() / limits[i];
                share(p).total_cmp(&share(q))
            })
        };
        let (by_a, by_j) = (strongest(&part.a), strongest(&part.j));
        for axis in 0..A {
            let at = |f: fn(&Derivatives<A>) -> &[f64; A]| Lanes([f(ends[0])[axis], f(ends[1])[axis]]);
            let (one, two, three) = (at(|d| &d.first), at(|d| &d.second), at(|d| &d.third));
            // On a line all axes have the same share of their speed.
            let is_weaker = is_line && by_a != Some(axis) && by_j != Some(axis);
            if is_weaker || [one, two, three] == [Lanes::default(); 3] {
                continue;
            }
            let (per_a, per_j) = (part.a[axis].recip(), part.j[axis].recip());
            let use_a = Lanes(needed.map(|needed| if needed { per_a } else { 0.0 }));
            self.rows.push(AxisRow {
                acceleration: [two * use_a, one * use_a * 0.5],
                jerk: [three * per_j, two * (1.5 * per_j), one * (0.5 * per_j)],
                most_acceleration: Lanes::both(f64::MAX),
                most_jerk: Lanes::both(f64::MAX),
            });
        }
        let pairs = |of: [[f64; 3]; 2]| std::array::from_fn(|k| Lanes([of[0][k], of[1][k]]));
        let segment = self.bends.len() - 1;
        self.parts.push(PartRows { segment, speed: pairs(speed), slope: pairs(slope), rows_end: self.rows.len() });
    }

    /// Sets the share in force of each row for the law with coefficients `c`, and the largest share at the ends of the
    /// parts of each segment. Returns the number of rows that are relaxed.
    pub(super) fn relax(&mut self, c: &[f64], used: &[f64], shares: &mut Vec<f64>) -> usize {
        let (mut first, mut count) = (0, 0);
        shares.clear();
        shares.resize(self.bends.len(), 0.0);
        for part in &self.parts {
            let c = three(c, part.segment);
            let (b, slope, bend) = (dot(&part.speed, c), dot(&part.slope, c), by_three(&self.bends[part.segment], c));
            let v = Lanes(b.0.map(|b| b.max(0.0))).sqrt();
            let (used, share) = (used[part.segment], &mut shares[part.segment]);
            for row in &mut self.rows[first..part.rows_end] {
                let acceleration = (row.acceleration[0] * b + row.acceleration[1] * slope).abs();
                let jerk = (row.jerk[0] * b + row.jerk[1] * slope + row.jerk[2] * bend).abs() * v;
                *share = share.max(acceleration.largest()).max(jerk.largest());
                row.most_acceleration = Lanes(acceleration.0.map(|value| relaxed(used, value, &mut count)));
                row.most_jerk = Lanes(jerk.0.map(|value| relaxed(used, value, &mut count)));
            }
            first = part.rows_end;
        }
        count
    }

    /// Adds the barriers of all rows, both signs of a row together.
    pub(super) fn add(&self, c: &[f64], gradient: &mut [f64], hessian: &mut [[f64; 3]]) {
        let mut first = 0;
        for part in &self.parts {
            let i = part.segment;
            let c = three(c, i);
            let by_bend = &self.bends[i];
            let at = (dot(&part.speed, c), dot(&part.slope, c), by_three(by_bend, c));
            let sums = sums_of(&self.rows[first..part.rows_end], at);
            first = part.rows_end;
            // From speed², slope and bend to the coefficients.
            let PartSums { g, h } = sums;
            let to = [part.speed, part.slope, [by_bend[0], by_bend[1], by_bend[2]].map(Lanes::both)];
            let by = |x: Lanes, y: Lanes, z: Lanes, k: usize| x * to[0][k] + y * to[1][k] + z * to[2][k];
            let row = |k: usize| [by(h[0], h[1], h[2], k), by(h[1], h[3], h[4], k), by(h[2], h[4], h[5], k)];
            let entry = |[x, y, z]: [Lanes; 3], j: usize| by(x, y, z, j).sum();
            let [zero, one, two] = &mut hessian[i..i + 3] else { continue };
            let rows = row(0);
            zero[0] += entry(rows, 0);
            let rows = row(1);
            zero[1] += entry(rows, 0);
            one[0] += entry(rows, 1);
            let rows = row(2);
            zero[2] += entry(rows, 0);
            one[1] += entry(rows, 1);
            two[0] += entry(rows, 2);
            for (k, sum) in gradient[i..i + 3].iter_mut().enumerate() {
                *sum += by(g[0], g[1], g[2], k).sum();
            }
        }
    }

    /// Part of the step `change`, at most `most`, that the rows allow from the law with coefficients `c`.
    pub(super) fn longest_step(&self, c: &[f64], change: &[f64], mut most: f64) -> f64 {
        let mut first = 0;
        for part in &self.parts {
            let i = part.segment;
            let (c, change) = (three(c, i), three(change, i));
            let (b, slope, bend) = (dot(&part.speed, c), dot(&part.slope, c), by_three(&self.bends[i], c));
            let (b_by, slope_by, bend_by) =
                (dot(&part.speed, change), dot(&part.slope, change), by_three(&self.bends[i], change));
            most = shortened(most, b_by * -1.0, b);
            let per_b = b.recip();
            let per_v = per_b.sqrt();
            // A jerk over the speed falls at least as slowly as its tangent, as it is convex.
            let falls = per_b * b_by * 0.5;
            for row in &self.rows[first..part.rows_end] {
                let [x, y] = row.acceleration;
                let (value, by) = (x * b + y * slope, x * b_by + y * slope_by);
                most = shortened(most, by, row.most_acceleration - value);
                most = shortened(most, by * -1.0, row.most_acceleration + value);
                let [x, y, z] = row.jerk;
                let (value, by) = (x * b + y * slope + z * bend, x * b_by + y * slope_by + z * bend_by);
                let limit = row.most_jerk * per_v;
                let lost = limit * falls;
                most = shortened(most, lost + by, limit - value);
                most = shortened(most, lost - by, limit + value);
            }
            first = part.rows_end;
        }
        most
    }
}

/// Sums of the barriers of the rows of one part, at speed², slope and bend.
#[inline(always)]
fn sums_of(rows: &[AxisRow], (b, slope, bend): (Lanes, Lanes, Lanes)) -> PartSums {
    let per_b = b.recip();
    let per_v = per_b.sqrt();
    let PartSums { mut g, mut h } = PartSums::default();
    for row in rows {
        let [x, y] = row.acceleration;
        let value = x * b + y * slope;
        let (square, of_value) = (row.most_acceleration * row.most_acceleration, value * value);
        let per_slacks = (square - of_value).recip();
        let one = value * per_slacks * 2.0;
        let two = (square + of_value) * per_slacks * per_slacks * 2.0;
        let (two_x, two_y) = (two * x, two * y);
        g[0] += one * x;
        g[1] += one * y;
        h[0] += two_x * x;
        h[1] += two_x * y;
        h[3] += two_y * y;
        let [x, y, z] = row.jerk;
        let value = x * b + y * slope + z * bend;
        let limit = row.most_jerk * per_v;
        // By how much the limit falls as speed² grows.
        let falls = limit * per_b * 0.5;
        let (square, of_value) = (limit * limit, value * value);
        let per_slacks = (square - of_value).recip();
        let one = per_slacks * 2.0;
        let two = one * (square + of_value) * per_slacks;
        let mixed = one * value * limit * per_slacks * falls * 2.0;
        let pull = one * value;
        g[0] += pull * x + one * limit * falls;
        g[1] += pull * y;
        g[2] += pull * z;
        let across = two * x + mixed;
        h[0] += x * (across + mixed) + two * falls * falls;
        h[1] += y * across;
        h[2] += z * across;
        let (two_y, two_z) = (two * y, two * z);
        h[3] += two_y * y;
        h[4] += two_y * z;
        h[5] += two_z * z;
    }
    PartSums { g, h }
}

/// The step, or as much of it as leaves a part of the slacks where the whole of it takes `lost` from them.
#[inline(always)]
fn shortened(most: f64, lost: Lanes, slack: Lanes) -> f64 {
    let over = lost * most - slack * REACH;
    if over.largest() > 0.0 {
        let of = |k: usize| if lost.0[k] > 0.0 { REACH * slack.0[k] / lost.0[k] } else { most };
        return most.min(of(0)).min(of(1));
    }
    most
}

/// Limit in force where the limit is `limit` and the value is `value`; counts those that are relaxed.
pub(super) fn relaxed(limit: f64, value: f64, count: &mut usize) -> f64 {
    if value < NEAR * limit {
        return limit;
    }
    *count += 1;
    limit.max(RELAXED * value)
}

#[inline(always)]
fn three(c: &[f64], i: usize) -> &[f64; 3] {
    c[i..].first_chunk().unwrap_or(&[0.0; 3])
}

#[inline(always)]
fn by_three(by: &[f64; 3], c: &[f64; 3]) -> Lanes {
    Lanes::both(by[0] * c[0] + by[1] * c[1] + by[2] * c[2])
}
