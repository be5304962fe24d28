//! The split of an axis' acceleration and jerk on a curve between tangential motion and curvature.
//!
//! Fast motion through a curve leaves little acceleration along it. Where the speed changes much, it pays to give up
//! some speed for acceleration. Where the path is calm, that is, where gentle motion can follow what the curvature
//! allows for some time, next to none is needed. A plan uses one acceleration and jerk over many blocks, so the choice
//! is made for whole calm sections and not block by block.
//!
//! Invariant: either choice stays within the limits; choosing only decides how fast a plan is.

use crate::envelope::PathBlock;
use crate::profile::PathLimits;

/// Shares of acceleration and jerk, smallest first, that tangential motion may have on a curve; the rest is for the
/// curvature.
pub(crate) const TANGENTIAL: [(f64, f64); 9] = [
    (0.05, 0.25),
    (0.08, 0.25),
    (0.12, 0.25),
    (0.18, 0.25),
    (0.25, 0.3),
    (0.35, 0.35),
    (0.5, 0.5),
    (0.7, 0.7),
    (0.9, 0.9),
];
/// Parts of the speed that the smallest share allows. Tangential motion gets the largest share that still allows this
/// part: on a calm path, where the speed changes much on short pieces, and where it does on pieces of more than
/// [`LONG`] seconds. Found by trial.
pub(crate) const RETAINED_SPEED: (f64, f64, f64) = (0.99, 0.8, 0.95);
pub(crate) const LONG: f64 = 0.25;
/// Share of the acceleration that gentle motion uses.
pub(crate) const GENTLE: f64 = 0.25;
/// A path is calm where gentle motion reaches this share of the highest speed, for at least this many seconds. Found by
/// trial.
const CALM: (f64, f64) = (0.97, 0.3);

/// Path limits to choose from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LimitOptions {
    /// Highest speed on a curve, mm/s.
    pub(crate) v: f64,
    /// Gentle acceleration, mm/s².
    pub(crate) gentle: f64,
    /// Limits for a calm path.
    pub(crate) calm: PathLimits,
    /// Limits where the speed changes much.
    pub(crate) rough: PathLimits,
}

impl LimitOptions {
    /// These options at a speed of at most `v`, mm/s.
    pub(crate) fn up_to(&self, v: f64) -> Self {
        let limit = |limits: PathLimits| PathLimits { v: limits.v.min(v), ..limits };
        Self { v: self.v.min(v), calm: limit(self.calm), rough: limit(self.rough), ..*self }
    }

    /// The options that both allow.
    pub(crate) fn tighter(&self, other: &Self) -> Self {
        Self {
            v: self.v.min(other.v),
            gentle: self.gentle.min(other.gentle),
            calm: self.calm.tighter(other.calm),
            rough: self.rough.tighter(other.rough),
        }
    }
}

/// Selector of limits over a path of blocks; it retains its memory.
#[derive(Debug, Default)]
pub(crate) struct LimitSelector {
    /// Square of the speed of gentle motion at each junction.
    w: Vec<f64>,
}

impl LimitSelector {
    /// Sets the limits of `blocks`, each from its options. The blocks are entered at a speed of at most `v0`, and the
    /// path continues behind them unless it `ends` at rest.
    pub(crate) fn choose(&mut self, blocks: &mut [PathBlock], options: &[LimitOptions], v0: f64, ends: bool) {
        self.move_gently(blocks, options, v0, ends);
        let is_calm = |k: usize| self.w[k].min(self.w[k + 1]) >= (CALM.0 * options[k].v).powi(2);
        let mut k = 0;
        while k < blocks.len() {
            let (first, calm, mut time) = (k, is_calm(k), 0.0);
            while k < blocks.len() && is_calm(k) == calm {
                time += blocks[k].length / options[k].v;
                k += 1;
            }
            let calm = calm && time > CALM.1;
            for (block, offer) in blocks[first..k].iter_mut().zip(&options[first..k]) {
                block.limits = if calm { offer.calm } else { offer.rough };
            }
        }
    }

    /// Calculates the speed of gentle motion at each junction: backward, then forward.
    fn move_gently(&mut self, blocks: &[PathBlock], options: &[LimitOptions], v0: f64, ends: bool) {
        let n = blocks.len();
        self.w.clear();
        self.w.resize(n + 1, 0.0);
        if !ends {
            self.w[n] = options.last().map_or(0.0, |last| last.v * last.v);
        }
        let rise = |w: f64, k: usize| (w + 2.0 * options[k].gentle * blocks[k].length).min(options[k].v * options[k].v);
        for k in (0..n).rev() {
            let cap = if k > 0 { blocks[k - 1].exit_v.min(options[k - 1].v) } else { v0 };
            self.w[k] = rise(self.w[k + 1], k).min(cap * cap);
        }
        for k in 0..n {
            self.w[k + 1] = rise(self.w[k], k).min(self.w[k + 1]);
        }
    }
}
