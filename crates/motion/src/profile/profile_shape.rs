//! All profiles between two states that leave with rising acceleration, by their one free number.
//!
//! Invariant: what is returned is the profile of the least duration in its family that covers the length; phases are
//! returned in order and none is negative, up to rounding.
//!
//! The jerk is the unit: lengths are divided by it (s³), speeds (s²) and accelerations (s) too. An [`End`] is on a
//! parabola of constant jerk that crosses zero acceleration at the speed `mu`. From there to the crest c a symmetric
//! ramp leads, which covers the distance (c + mu)/2 times its duration; the part before the end itself is subtracted
//! from it and does not depend on c. So with x and y, the accelerations at which the two ramps turn, c = mu + x² = mu'
//! + y², and one equation remains:
//!
//! - no limit is met: x(mu + c) + y(mu' + c) = R, which with s = x + y is the quartic s⁴ + 4Ms² − 4Rs − D² = 0, where M
//!   = mu + mu', D = mu − mu'; the duration is 2s and a constant;
//! - one ramp meets the acceleration limit w: a quartic in the other ramp's x; both meet it: a quadratic in c.
//!
//! The same equations hold with x < 0: the acceleration then turns before it reaches zero, and there is no crest. In
//! that branch the distance need not grow with the duration where speeds are negative; its turning point has a closed
//! form too.

/// Acceleration limit, in s, and its inverse.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cap {
    pub(super) w: f64,
    pub(super) per_w: f64,
}

/// One end of a profile, seen so that time runs towards the crest; the jerk is 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct End {
    /// Speed, in s².
    pub(super) v: f64,
    /// Acceleration, in s.
    pub(super) alpha: f64,
    /// Speed at which the parabola of rising acceleration through this end has zero acceleration, in s².
    mu: f64,
    /// Speed that the end reaches when its acceleration is taken to zero at once, in s².
    pub(super) free: f64,
}

impl End {
    #[inline]
    pub(super) fn new(v: f64, alpha: f64) -> Self {
        let half = 0.5 * alpha * alpha;
        Self { v, alpha, mu: v - half, free: if alpha > 0.0 { v + half } else { v - half } }
    }

    /// The end with all signs reversed where `sign` is −1.
    #[inline]
    pub(super) fn signed(self, sign: f64) -> Self {
        Self::new(sign * self.v, sign * self.alpha)
    }

    /// Distance from the zero of the parabola to this end, negated.
    #[inline]
    fn offset(self) -> f64 {
        self.alpha * (self.mu + self.alpha * self.alpha * (1.0 / 6.0))
    }

    /// Distance of the whole ramp that gains `gain` ≥ 0 from mu.
    #[inline]
    fn distance(self, gain: f64, cap: Cap) -> f64 {
        // Both are computed, so that no branch has to be predicted.
        let (held, free) = (0.5 * (cap.w + gain * cap.per_w), gain.sqrt());
        (2.0 * self.mu + gain) * if gain > cap.w * cap.w { held } else { free }
    }

    /// Phases of the ramp from this end up to the crest at mu + `gain`.
    #[inline]
    fn ramp(self, gain: f64, cap: Cap) -> [f64; 3] {
        let free = gain.sqrt();
        let [hold, x] = if gain > cap.w * cap.w { [gain * cap.per_w - cap.w, cap.w] } else { [0.0, free] };
        [x - self.alpha, hold, x]
    }

    /// Phases of a ramp that gains `gain` and meets the limit.
    #[inline]
    fn held(self, gain: f64, cap: Cap) -> [f64; 3] {
        [cap.w - self.alpha, gain * cap.per_w - cap.w, cap.w]
    }

    /// Phases of a ramp that turns at the acceleration `x`.
    #[inline]
    fn free_ramp(self, x: f64) -> [f64; 3] {
        [x - self.alpha, 0.0, x]
    }
}

/// Phases of a profile: two ramps, each in the order of its own time, and the time between them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    pub(super) up: [f64; 3],
    pub(super) cruise: f64,
    pub(super) down: [f64; 3],
}

/// What all members of a family share; `high` is the end with the higher free speed, except in
/// [`ProfileFamily::apart`].
#[derive(Clone, Copy, Debug)]
pub(super) struct ProfileFamily {
    pub(super) high: End,
    pub(super) low: End,
    pub(super) cap: Cap,
    /// Speed limit, in s².
    pub(super) top: f64,
}

impl ProfileFamily {
    /// Difference between `length` (s³) and what the first member covers: the fastest change from one state to the
    /// other.
    #[inline]
    pub(super) fn excess(&self, length: f64) -> f64 {
        let Self { high, low, cap, .. } = *self;
        let (x, d) = (high.alpha, self.d());
        let square = x * x;
        // |x| is within the limit, so that this end's ramp does not meet it.
        self.whole(length) - x * (2.0 * high.mu + square) - low.distance(square + d, cap)
    }

    /// The first member.
    #[inline]
    pub(super) fn first(&self) -> Shape {
        let x = self.high.alpha;
        if x < 0.0 { self.without_crest_at(x) } else { self.crest_at(x * x, 0.0) }
    }

    /// The member of least duration that covers `length` (s³), which must exceed what the first one covers.
    #[inline(never)]
    pub(super) fn beyond(&self, length: f64) -> Shape {
        let Self { high, low, cap, .. } = *self;
        let r = self.whole(length);
        let is_short = high.alpha < 0.0 && (r < low.distance(self.d(), cap) || 16.0 * high.mu < cap.w * cap.w);
        match is_short.then(|| self.without_crest(r, 0.0)).flatten() {
            Some(shape) => shape,
            None => self.crest(r),
        }
    }

    /// Distance from the zero of one parabola to that of the other.
    #[inline]
    fn whole(&self, length: f64) -> f64 {
        length + self.high.offset() + self.low.offset()
    }

    /// Difference of the speed `mu` of the higher end over that of the lower; differences are taken first, to keep
    /// digits.
    #[inline]
    fn d(&self) -> f64 {
        let Self { high, low, .. } = self;
        (high.v - low.v) - 0.5 * (high.alpha * high.alpha - low.alpha * low.alpha)
    }

    /// The member of least duration among the few separate ones: both ends accelerate in the same direction, and
    /// between them the acceleration decreases without reaching zero. Here `high` is the end with the lower free speed.
    /// Where they end, the other ramp is empty; to take longer the acceleration would have to change its sign, and the
    /// duration then jumps.
    #[cold]
    pub(super) fn apart(&self, length: f64, slack: f64) -> Option<Shape> {
        let Self { high, low, cap, .. } = *self;
        let d = self.d();
        let x = high.alpha;
        let last = low.alpha * low.alpha - d;
        // The straight change, with one jerk only, is on the border of this family.
        let rounding = 1e-15 * (high.v.abs() + x * x + low.alpha * low.alpha);
        if x >= 0.0 || low.alpha <= 0.0 || high.free >= low.free || d.min(last).min(x * x - last) < -rounding {
            return None;
        }
        let excess = self.excess(length);
        if excess <= slack {
            return (excess >= -slack).then(|| self.first());
        }
        let r = self.whole(length);
        let end = -last.max(0.0).sqrt();
        let longest = end * (2.0 * high.mu + end * end) + low.distance(end * end + d, cap);
        // Near zero acceleration the distance depends strongly on the last digits of the speeds.
        let blur = 4e-16 * high.v.abs().max(low.v.abs()) * (high.mu + low.mu).abs() / -end.min(-f64::MIN_POSITIVE);
        let is_last = (r - longest).abs() <= slack + blur.min(100.0 * slack);
        self.without_crest(r, end).or_else(|| is_last.then(|| self.without_crest_at(end)))
    }

    /// The member with a crest of at least the higher free speed.
    #[inline(never)]
    fn crest(&self, r: f64) -> Shape {
        let Self { high, low, cap, .. } = *self;
        let (d, m, w) = (self.d(), high.mu + low.mu, cap.w);
        let square = w * w;
        // Crests are counted from the higher end's mu.
        let lowest = if high.alpha > 0.0 { high.alpha * high.alpha } else { 0.0 };
        let top = (self.top - high.mu).max(lowest);
        let both = |gain: f64| high.distance(gain, cap) + low.distance(gain + d, cap);
        let rest = r - both(top);
        if rest >= 0.0 {
            return self.crest_at(top, rest / self.top.max(f64::MIN_POSITIVE));
        }
        // The ramp from the lower mu meets the acceleration limit first, at g1; the other at g2.
        let (g1, g2) = (square - d.max(0.0), square - d.min(0.0));
        if top > g2 && (lowest >= g2 || both(g2) <= r) {
            let p = high.mu + 0.5 * square;
            let q = high.mu * square + 0.5 * (m * (square + d)) - w * r;
            let root = (p * p - q).max(0.0).sqrt();
            let gain = if p > 0.0 { -q / (p + root) } else { root - p };
            return self.crest_at(gain.clamp(lowest.max(g2), top), 0.0);
        }
        if top > g1 && (lowest >= g1 || both(g1) <= r) {
            let sunk = d.min(0.0);
            let z_at = |gain: f64| (gain + sunk).max(0.0).sqrt();
            let z = self.one_held(r).root(z_at(lowest.max(g1)), z_at(top.min(g2)), cap.w, None);
            let gain = z * z + d.abs();
            let (up, down) = if d >= 0.0 {
                (high.free_ramp(z), low.held(gain, cap))
            } else {
                (high.held(gain, cap), low.free_ramp(z))
            };
            return Shape { up, cruise: 0.0, down };
        }
        // Without D, s is at most the cube root of 4R and, where M > 0, at most R/M, and at least half the lesser of
        // both.
        let guess = (r > 0.0).then(|| if m > 0.0 { rough_cbrt(4.0 * r).min(r / m) } else { rough_cbrt(4.0 * r) });
        let sum = |gain: f64| gain.sqrt() + (gain + d).max(0.0).sqrt();
        let s = self.none_held(r).root(sum(lowest), sum(top.min(g1)), 0.0, guess);
        let (x, y) = halves(s, d);
        Shape { up: high.free_ramp(x), cruise: 0.0, down: low.free_ramp(y) }
    }

    #[inline]
    fn crest_at(&self, gain: f64, cruise: f64) -> Shape {
        Shape { up: self.high.ramp(gain, self.cap), cruise, down: self.low.ramp(gain + self.d(), self.cap) }
    }

    /// The member that turns at the acceleration `x` ≤ 0, before a crest.
    fn without_crest_at(&self, x: f64) -> Shape {
        let gain = x * x + self.d();
        let y = gain.max(0.0).sqrt();
        let Cap { w, per_w } = self.cap;
        let hold = if y > w { gain * per_w - w } else { 0.0 };
        let y = y.min(w);
        Shape { up: [x - self.high.alpha, 0.0, 0.0], cruise: 0.0, down: [y - self.low.alpha, hold, y + x] }
    }

    /// The first member without a crest that covers `r` and turns at an acceleration up to `end` ≤ 0, where one exists.
    fn without_crest(&self, r: f64, end: f64) -> Option<Shape> {
        let Self { high, low, cap, .. } = *self;
        let (d, m, w) = (self.d(), high.mu + low.mu, cap.w);
        let turn = -(w * w - d).max(0.0).sqrt();
        if high.alpha < turn {
            let quartic = self.one_held(r);
            let spread = w * w - 16.0 * high.mu;
            let extremes = (spread > 0.0).then(|| (-0.25 * (w + spread.sqrt()), 0.25 * (spread.sqrt() - w)));
            if let Some((begin, end)) = quartic.first_rise(high.alpha, turn.min(end), extremes) {
                return Some(self.without_crest_at(quartic.root(begin, end, cap.w, None)));
            }
        }
        if turn >= end || d <= 0.0 {
            return None;
        }
        let sum = |x: f64| d / ((x * x + d).max(0.0).sqrt() - x);
        let (begin, end) = (sum(high.alpha.max(turn)), if end < 0.0 { sum(end) } else { d.max(0.0).sqrt() });
        let spread = 4.0 * m * m - 3.0 * d * d;
        let extreme = |root: f64| ((-2.0 * m + root) / 3.0).max(0.0).sqrt();
        let extremes = (m < 0.0 && spread > 0.0).then(|| (extreme(-spread.sqrt()), extreme(spread.sqrt())));
        let quartic = self.none_held(r);
        let (begin, end) = quartic.first_rise(begin, end, extremes)?;
        let s = quartic.root(begin, end, 0.0, None);
        let (x, y) = halves(s, d);
        Some(Shape { up: [x - high.alpha, 0.0, 0.0], cruise: 0.0, down: [y - low.alpha, 0.0, s] })
    }

    /// The equation for s = x + y where no ramp meets the acceleration limit.
    #[inline]
    fn none_held(&self, r: f64) -> Quartic {
        let (d, m) = (self.d(), self.high.mu + self.low.mu);
        Quartic([-d * d, -4.0 * r, 4.0 * m, 0.0])
    }

    /// The equation for the acceleration at which the ramp from the higher mu turns, where the other one meets the
    /// limit.
    #[inline]
    fn one_held(&self, r: f64) -> Quartic {
        let Self { high, low, cap, .. } = *self;
        let (n, w) = (high.mu.max(low.mu), cap.w);
        Quartic([(high.mu + low.mu) * (self.d().abs() + w * w) - 2.0 * w * r, 4.0 * w * n, 2.0 * n + w * w, 2.0 * w])
    }
}

/// Cube root to about a twentieth, by a third of the exponent (Kahan 1991).
#[inline]
fn rough_cbrt(x: f64) -> f64 {
    f64::from_bits(x.to_bits() / 3 + 0x2A9F_7893_0000_0000)
}

/// The two numbers whose sum is `s` and whose squares differ by `d`: y² − x² = d.
#[inline]
fn halves(s: f64, d: f64) -> (f64, f64) {
    let apart = if s > 0.0 { d / s } else { 0.0 };
    (0.5 * (s - apart), 0.5 * (s + apart))
}

/// Polynomial z⁴ + q₃z³ + q₂z² + q₁z + q₀.
#[derive(Clone, Copy, Debug)]
struct Quartic([f64; 4]);

impl Quartic {
    #[inline]
    fn at(&self, z: f64) -> f64 {
        let [q0, q1, q2, q3] = self.0;
        q0 + z * (q1 + z * (q2 + z * (q3 + z)))
    }

    /// The first interval of [begin, end] on which the polynomial rises through zero. It is not positive at `begin`,
    /// and `extremes` are its maximum and the minimum behind that.
    fn first_rise(&self, begin: f64, end: f64, extremes: Option<(f64, f64)>) -> Option<(f64, f64)> {
        let (maximum, minimum) = extremes.unwrap_or((begin, begin));
        if maximum > begin && maximum < end && self.at(maximum) >= 0.0 {
            return Some((begin, maximum));
        }
        let begin = if minimum > begin && minimum < end { minimum } else { begin };
        (self.at(end) >= 0.0).then_some((begin, end))
    }

    /// The root in [low, high], where the sign changes from − to + once; exact to a few units in the last place of the
    /// root or of `scale`, whichever is larger. It uses Halley's method, confined to the bracket.
    #[inline(never)]
    fn root(&self, mut low: f64, mut high: f64, scale: f64, guess: Option<f64>) -> f64 {
        let [_, q1, q2, q3] = self.0;
        let mut z = guess.unwrap_or_else(|| {
            let (f_low, f_high) = (self.at(low), self.at(high));
            if f_low < 0.0 && f_high > f_low { low - f_low * (high - low) / (f_high - f_low) } else { high }
        });
        z = if z > low { if z < high { z } else { high } } else { low };
        for round in 0..100 {
            let f = self.at(z);
            let slope = q1 + z * (2.0 * q2 + z * (3.0 * q3 + z * 4.0));
            let bend = q2 + z * (3.0 * q3 + z * 6.0);
            if f > 0.0 {
                high = z;
            } else {
                low = z;
            }
            let (square, bent) = (slope * slope, f * bend);
            // Where the slope is small, Halley's steps lead to the extreme and not to the root.
            let sound = slope > 0.0 && square > bent.abs();
            let next = z - f * slope / (square - bent);
            // The error of a step is of third order: below this it is rounding.
            if sound && bent.abs() <= 1e-6 * square && f.abs() <= 1e-6 * slope * (z.abs() + scale) {
                return next.clamp(low, high);
            }
            z = if sound && next > low && next < high && round < 20 { next } else { 0.5 * (low + high) };
            if high - low <= 1e-16 * (z.abs() + scale) {
                return z;
            }
        }
        z
    }
}
