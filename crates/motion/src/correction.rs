//! The correction that rounds one junction of the path (SMO, glide): its shape, and the sum of many of them.
//!
//! Where the direction jumps by Δ at place c, the path is moved by `Δ·h·g((s − c)/h)`: g is even and nonzero on −1 … 1
//! only, its second derivative is a hat and its first jumps by −1 at 0, so that direction and curvature become
//! continuous and the third derivative bounded. Where the curvature jumps by Δ, it is moved by `Δ·h²·q((s − c)/h)`: q
//! is odd, and its second derivative is piecewise linear with a jump of −1 at 0. Both return to 0 with zero slope, so
//! corrections of any width may overlap: they simply add up, and in a chain of short lines they add up to a smooth
//! curve.
//!
//! Invariant: the path is never further from the programmed one, at equal s, than the sum of the corrections.

use crate::curve::Cubic;

/// Correction at one junction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Correction<const A: usize> {
    /// Place of the junction, mm.
    pub(crate) s: f64,
    /// Jump of the first derivative there.
    pub(crate) turn: [f64; A],
    /// Jump of the second derivative there, 1/mm.
    pub(crate) bend: [f64; A],
    /// Half width of the correction, mm.
    pub(crate) h: f64,
}

/// Jump of the derivatives of the correction of corner number `corner` at place `s`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CorrectionEvent {
    pub(crate) s: f64,
    pub(crate) corner: u32,
    pub(crate) knot: Knot,
}

/// Point where a correction changes its form.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Knot {
    Start,
    Rise,
    Joint,
    Fall,
    End,
}

/// Largest value of g.
pub(crate) const MAX_G: f64 = 1.0 / 6.0;

impl<const A: usize> Correction<A> {
    /// Points where the derivatives jump, in order of place.
    pub(crate) fn knots(&self) -> impl Iterator<Item = (f64, Knot)> {
        let Self { s, bend, h, .. } = *self;
        let bent = bend != [0.0; A];
        let knots = [
            (s - h, Knot::Start),
            (s - 0.5 * h, Knot::Rise),
            (s, Knot::Joint),
            (s + 0.5 * h, Knot::Fall),
            (s + h, Knot::End),
        ];
        knots.into_iter().filter(move |(_, knot)| bent || !matches!(knot, Knot::Rise | Knot::Fall))
    }
}

/// Sum of corrections at one place: value and three derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CorrectionSum<const A: usize> {
    pub(crate) s: f64,
    all: [[f64; A]; 4],
}

impl<const A: usize> CorrectionSum<A> {
    /// Sum of `corners` at place `s`, after any jump there.
    pub(crate) fn of<'a>(corners: impl Iterator<Item = &'a Correction<A>>, s: f64) -> Self {
        let mut sum = Self { s, all: [[0.0; A]; 4] };
        for corner in corners.filter(|c| c.s - c.h <= s && s < c.s + c.h) {
            let mut one = Self { s: corner.s - corner.h, all: [[0.0; A]; 4] };
            for (place, knot) in corner.knots().take_while(|(place, _)| *place <= s) {
                one.advance(place);
                one.jump(corner, knot, place);
            }
            one.advance(s);
            for (all, one) in sum.all.iter_mut().flatten().zip(one.all.iter().flatten()) {
                *all += one;
            }
        }
        sum
    }

    /// Advances to place `s`, where the next jump may be.
    #[inline]
    pub(crate) fn advance(&mut self, s: f64) {
        let t = s - self.s;
        let [value, first, second, third] = &mut self.all;
        for i in 0..A {
            let (a, b, c, d) = (value[i], first[i], second[i], third[i]);
            value[i] = a + t * (b + t * (0.5 * c + t * d / 6.0));
            first[i] = b + t * (c + 0.5 * t * d);
            second[i] = c + t * d;
        }
        self.s = s;
    }

    /// Applies the jump at a knot that is here, or so near that no piece is to be cut between: then it is still applied
    /// at its `place`.
    #[inline]
    pub(crate) fn jump(&mut self, corner: &Correction<A>, knot: Knot, place: f64) {
        let s = self.s;
        if place != s {
            self.advance(place);
        }
        let Correction { turn, bend, h, .. } = corner;
        let [_, first, second, third] = &mut self.all;
        let narrow = h.recip();
        // Jump of the third derivative: of the turn's hat, and of the bend's slopes.
        let (hat, slope) = match knot {
            Knot::Start => (1.0, -1.0 / 6.0),
            Knot::Rise => (0.0, 4.0 / 3.0),
            Knot::Joint => (-2.0, 0.0),
            Knot::Fall => (0.0, -4.0 / 3.0),
            Knot::End => (1.0, 1.0 / 6.0),
        };
        for i in 0..A {
            third[i] += narrow * (hat * narrow * turn[i] + slope * bend[i]);
        }
        if knot == Knot::Joint {
            for i in 0..A {
                first[i] -= turn[i];
                second[i] -= bend[i];
            }
        }
        if place != s {
            self.advance(s);
        }
    }

    /// Largest second and third derivative of all axes here.
    pub(crate) fn size(&self) -> (f64, f64) {
        let largest = |of: &[f64; A]| of.iter().fold(0.0f64, |most, x| most.max(x.abs()));
        (largest(&self.all[2]), largest(&self.all[3]))
    }

    /// The sum as a cubic from here on.
    pub(crate) fn cubic(&self) -> Cubic<A> {
        let [value, first, second, third] = self.all;
        [value, first, second.map(|x| 0.5 * x), third.map(|x| x / 6.0)]
    }

    /// Bound on the size of the correction over all axes and over the next `length`: that of the control points.
    pub(crate) fn size_bound(&self, length: f64) -> f64 {
        let [a, b, c, d] = self.cubic();
        let l = length;
        (0..4)
            .map(|k| {
                let point = |i: usize| match k {
                    0 => a[i],
                    1 => a[i] + b[i] * l / 3.0,
                    2 => a[i] + l * (2.0 * b[i] + l * c[i]) / 3.0,
                    _ => a[i] + l * (b[i] + l * (c[i] + l * d[i])),
                };
                (0..A).map(|i| point(i) * point(i)).sum::<f64>()
            })
            .fold(0.0, f64::max)
            .sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both shapes start and end at zero, jump at the junction by what the path lacks, and stay within their bounds.
    #[test]
    fn a_correction_cancels_the_jumps_and_vanishes_outside() {
        let corner = Correction { s: 5.0, turn: [0.3, -0.2], bend: [0.05, 0.1], h: 0.7 };
        let mut sum = CorrectionSum { s: 4.0, all: [[0.0; 2]; 4] };
        let mut largest = 0.0f64;
        for (place, knot) in corner.knots() {
            largest = largest.max(sum.size_bound(place - sum.s));
            sum.advance(place);
            sum.jump(&corner, knot, place);
            let direct = CorrectionSum::of([corner].iter(), place + 1e-9);
            let mut there = sum;
            there.advance(place + 1e-9);
            for (a, b) in direct.all.iter().flatten().zip(there.all.iter().flatten()) {
                assert!((a - b).abs() < 1e-9);
            }
        }
        assert!(sum.all.iter().flatten().all(|x| x.abs() < 1e-12), "{sum:?}");
        let size = 0.3f64.hypot(0.2);
        assert!(
            largest <= size * 0.7 * MAX_G + 0.016 * 0.7 * 0.7 * 0.05f64.hypot(0.1)
                && largest >= 0.99 * size * 0.7 * MAX_G
        );
    }
}
