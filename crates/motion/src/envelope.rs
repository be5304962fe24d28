//! The acceleration-limited envelope of a path of blocks, and the accelerations that it proposes to the jerk-limited
//! plan.
//!
//! Invariant: no jerk-limited motion that observes the caps is anywhere faster than the envelope; where the envelope
//! does not touch a cap, the acceleration limit alone keeps every legal motion below that cap.

use crate::profile::PathLimits;

/// Part of the path with uniform limits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PathBlock {
    /// Length, mm, above 0.
    pub(crate) length: f64,
    /// Limits along the path.
    pub(crate) limits: PathLimits,
    /// Cap on the speed at the end of the block, mm/s.
    pub(crate) exit_v: f64,
}

/// Half width, in units of A/J, of the time window over which the acceleration of a proposal is averaged …
const WIDE: f64 = 0.75;
/// … and where the envelope is smooth enough to be followed closely.
const NARROW: f64 = 0.1;

/// Envelope over `n` blocks; everything is indexed by junction, 0 … n, unless stated otherwise.
#[derive(Debug, Default)]
pub(crate) struct Envelope {
    /// Place, mm.
    pub(crate) s: Vec<f64>,
    /// Cap on the speed, mm/s.
    pub(crate) cap: Vec<f64>,
    /// Speed of the envelope, mm/s.
    pub(crate) v: Vec<f64>,
    /// Duration of the envelope over block k, s.
    pub(crate) time: Vec<f64>,
    /// Acceleration proposed where the envelope touches its cap, mm/s².
    pub(crate) a: Vec<f64>,
    /// Whether the envelope touches its cap.
    pub(crate) touches: Vec<bool>,
}

impl Envelope {
    /// Computes the envelope for a path entered at `v0` and left at `v1`.
    pub(crate) fn compute(&mut self, blocks: &[PathBlock], v0: f64, v1: f64) {
        let n = blocks.len();
        for list in [&mut self.s, &mut self.cap, &mut self.v, &mut self.a] {
            list.clear();
            list.resize(n + 1, 0.0);
        }
        self.touches.clear();
        for (k, block) in blocks.iter().enumerate() {
            self.s[k + 1] = self.s[k] + block.length;
            self.cap[k + 1] = blocks.get(k + 1).map_or(v1, |next| block.exit_v.min(block.limits.v).min(next.limits.v));
        }
        self.cap[0] = v0;
        // First backward, then forward, in v².
        let mut w = v1 * v1;
        self.v[n] = w;
        for k in (1..n).rev() {
            w = (w + 2.0 * blocks[k].limits.a * blocks[k].length).min(self.cap[k] * self.cap[k]);
            self.v[k] = w;
        }
        w = v0 * v0;
        self.v[0] = w;
        for k in 1..=n {
            w = (w + 2.0 * blocks[k - 1].limits.a * blocks[k - 1].length).min(self.v[k]);
            self.v[k] = w;
        }
        self.touches.extend(self.v.iter().zip(&self.cap).map(|(w, cap)| *w >= cap * cap));
        for w in &mut self.v {
            *w = w.sqrt();
        }
        self.time_blocks(blocks);
        self.propose(blocks);
    }

    fn time_blocks(&mut self, blocks: &[PathBlock]) {
        self.time.clear();
        self.time.extend(blocks.iter().enumerate().map(|(k, block)| {
            let PathLimits { v, a, .. } = block.limits;
            let (enter, exit) = (self.v[k], self.v[k + 1]);
            let peak_squared = 0.5 * (enter * enter + exit * exit) + a * block.length;
            if peak_squared <= v * v {
                (2.0 * peak_squared.sqrt() - enter - exit) / a
            } else {
                (2.0 * v - enter - exit) / a + (peak_squared - v * v) / (a * v)
            }
        }));
    }

    /// Speed of the envelope in block k, `t` seconds after its start.
    fn within(&self, blocks: &[PathBlock], k: usize, t: f64) -> f64 {
        let PathLimits { v, a, .. } = blocks[k].limits;
        (self.v[k] + a * t).min(self.v[k + 1] + a * (self.time[k] - t)).min(v)
    }

    /// Whether the envelope at junction `k`, which is not one of the ends, is no higher than in the blocks on both
    /// sides, and lower than in one of them. It may rise and fall again within a block.
    pub(crate) fn is_valley(&self, blocks: &[PathBlock], k: usize) -> bool {
        let speed = self.v[k];
        let compare_block = |block: usize, junction: usize| {
            let PathLimits { v, a, .. } = blocks[block].limits;
            let peak_squared = 0.5 * (self.v[block].powi(2) + self.v[block + 1].powi(2)) + a * blocks[block].length;
            (self.v[junction] >= speed, peak_squared.sqrt().min(v) > speed * (1.0 + 1e-9))
        };
        let ((level_before, higher_before), (level_after, higher_after)) =
            (compare_block(k - 1, k - 1), compare_block(k, k + 1));
        (level_before || higher_before) && (level_after || higher_after) && (higher_before || higher_after)
    }

    /// Proposes an acceleration where the envelope touches a cap: its own slope if a motion of limited jerk can follow
    /// it, otherwise its mean slope over a wider window. That is 0 in a sharp valley and −A in the middle of a long
    /// braking.
    fn propose(&mut self, blocks: &[PathBlock]) {
        let n = blocks.len();
        // Four places that follow each junction: narrow and wide, behind and ahead of it.
        let mut walkers = [(0usize, 0.0f64); 4];
        let mut now = 0.0;
        for k in 1..n {
            now += self.time[k - 1];
            if !self.touches[k] {
                continue;
            }
            let (left, right) = (blocks[k - 1].limits, blocks[k].limits);
            let ramp = (left.a / left.j).max(right.a / right.j);
            let (narrow, wide) = (NARROW * ramp, WIDE * ramp);
            let mut v = [0.0; 4];
            for ((at, began), (v, t)) in
                walkers.iter_mut().zip(v.iter_mut().zip([now - narrow, now + narrow, now - wide, now + wide]))
            {
                while *at < n && *began + self.time[*at] < t {
                    *began += self.time[*at];
                    *at += 1;
                }
                *v = match t {
                    t if t <= 0.0 => self.v[0],
                    _ if *at >= n => self.v[n],
                    t => self.within(blocks, *at, t - *began),
                };
            }
            let both = left.tighter(right);
            let smooth = (v[0] + v[1] - 2.0 * self.v[k]).abs() <= both.j * narrow * narrow;
            let mean = if smooth { (v[1] - v[0]) / (2.0 * narrow) } else { (v[3] - v[2]) / (2.0 * wide) };
            let around = walkers.map(|(at, _)| blocks[at.min(n - 1)].limits.a).into_iter().fold(both.a, f64::min);
            let most = gate_acceleration(self.cap[k], PathLimits { a: 0.999 * around, ..both });
            self.a[k] = mean.clamp(-most, most);
        }
    }
}

/// Largest acceleration that a gate at speed `v` may have: more would require a negative speed on one of its sides.
pub(crate) fn gate_acceleration(v: f64, limits: PathLimits) -> f64 {
    limits.a.min((1.9 * limits.j * v).sqrt())
}
