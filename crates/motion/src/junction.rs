//! How two moves meet: by a full stop, with a kink, or smoothed.
//!
//! Invariant: the jumps of velocity and acceleration in a junction that is passed at its cap use no more of the jerk,
//! measured over one control period, than the share that the pieces on both sides leave.

use crate::blend::{Junction, PathSegment, size};
use crate::correction::MAX_G;
use crate::glide::tracks::FarEnd;
use crate::limits::AxisLimits;
use crate::limits::MAX_OVERRIDE;
use crate::piece::PieceJunction;
use crate::run::smallest;

/// Shares of the jerk that junctions may use: the first that allows full speed through the junction, otherwise the
/// last.
const JUNCTION_SHARES: [f64; 4] = [0.0, 0.001, 0.02, 0.25];
/// A junction that uses no more than this share of the jerk is smooth.
const SMOOTH: f64 = 5e-8;
/// Junctions that could only be passed at less than this speed, in mm/s, are stops.
const SLOWEST: f64 = 0.2;
/// Turns sharper than this (length of the difference of the unit directions) always stop: the path nearly reverses.
const SHARPEST: f64 = 1.9;

/// Speed through a rounded corner, as a share of what curvature alone would allow.
const PASSED: f64 = 0.75;

/// Decides how to pass from `last` into `next`; `None` for a full stop.
pub(crate) fn join<const A: usize>(
    last: &PathSegment<A>,
    next: &PathSegment<A>,
    axes: &AxisLimits<A>,
) -> Option<Junction<A>> {
    let (end, start) = (last.curve.derivatives(last.length), next.curve.derivatives(0.0));
    let turn: [f64; A] = std::array::from_fn(|i| start.first[i] - end.first[i]);
    let bend: [f64; A] = std::array::from_fn(|i| start.second[i] - end.second[i]);
    let tolerance = last.tolerance.min(next.tolerance);
    if tolerance > 0.0 {
        let passes = size(&turn) < SHARPEST && blend_is_faster(last, next, size(&turn), tolerance, axes);
        passes.then_some(Junction::Smooth { turn, bend })
    } else {
        let joint = kink(last, next, &turn, &bend, axes);
        (joint != PieceJunction::STOP).then_some(Junction::Kink(joint))
    }
}

/// Cap and share of a junction that is not changed.
fn kink<const A: usize>(
    last: &PathSegment<A>,
    next: &PathSegment<A>,
    turn: &[f64; A],
    bend: &[f64; A],
    axes: &AxisLimits<A>,
) -> PieceJunction {
    let shortest = last.length.min(next.length);
    // Share of the jerk, or of the acceleration, that the jumps use at speed v, measured over a period. Within three
    // periods there may be several junctions.
    let taken = |v: f64| {
        let crowd = 2.0 * (1.0 + 3.0 * v * axes.period / shortest);
        (0..A).fold(0.0f64, |most, i| {
            let (dv, da) = (v * turn[i].abs(), v * v * bend[i].abs());
            let of_jerk = (dv / axes.period + 0.75 * da) / (axes.period * axes.j[i]);
            let of_acceleration = dv / (axes.period * axes.a[i]);
            most.max(crowd * of_jerk.max(of_acceleration))
        })
    };
    let full = last.feed.min(next.feed).min(axes.path_v);
    let needed = taken(full);
    // The share is chosen for the programmed feed; an override may pass the junction as fast as that share allows.
    let raised = |share: f64| {
        let (mut low, mut high) = (full, (MAX_OVERRIDE * full).min(axes.path_v));
        if taken(high) <= share {
            return high;
        }
        for _ in 0..6 {
            let middle = 0.5 * (low + high);
            if taken(middle) <= share { low = middle } else { high = middle }
        }
        low
    };
    if needed <= SMOOTH {
        return PieceJunction { v: raised(SMOOTH), share: 0.0 };
    }
    let most = JUNCTION_SHARES[JUNCTION_SHARES.len() - 1];
    let share = JUNCTION_SHARES.into_iter().find(|&share| needed <= share).unwrap_or(most);
    if needed <= share {
        return PieceJunction { v: raised(share), share };
    }
    let (mut low, mut high) = (0.0, full);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if taken(middle) <= share { low = middle } else { high = middle }
    }
    if low < SLOWEST { PieceJunction::STOP } else { PieceJunction { v: low, share } }
}

/// Between moves longer than `GLIDES.0 / √turn − GLIDES.1` half widths of a rounding, glides are faster; in chains of
/// shorter ones rounding is, as roundings overlap. Found by trial on polygons and zigzags with moves of 0.1 … 16 mm and
/// turns of 3 … 90°.
const GLIDES: (f64, f64) = (1.75, 0.2);
/// From rest to rest, turns of more than these, about 1° and 6°, are glided: if a move is shorter than so many half
/// widths of a rounding, and in any case.
const SLIGHT: (f64, f64) = (0.02, 0.1);
const ROUNDED: f64 = 4.0;

/// Whether a corner is suited to a glide. It is not where the moves are so short, or the turn so slight, that rounding
/// costs less.
pub(crate) fn glide_is_faster<const A: usize>(
    [last, next]: [(&PathSegment<A>, FarEnd); 2],
    joined: Option<&Junction<A>>,
    tolerance: f64,
    axes: &AxisLimits<A>,
) -> bool {
    let Some(Junction::Smooth { turn, .. }) = joined else { return true };
    let turn = size(turn);
    let (a, j) = (smallest(axes.a), smallest(axes.j));
    let h = tolerance / (MAX_G * turn).max(1e-12);
    let through = PASSED * (0.5 * j * h * h / turn).cbrt().min((0.6 * a * h / turn).sqrt());
    let passes = through >= last.0.feed.min(next.0.feed).min(axes.path_v);
    if last.1 == FarEnd::Rest && next.1 == FarEnd::Rest {
        // A rounding that uses much of a move would slow down its start or stop.
        let wide = last.0.length.min(next.0.length) < ROUNDED * h;
        return !passes || turn > SLIGHT.1 || wide && turn > SLIGHT.0;
    }
    // A move that begins or ends at rest has only this junction to speed up for.
    let leg = |(segment, far_end): (&PathSegment<A>, FarEnd)| match far_end {
        FarEnd::Rest => 2.0 * segment.length,
        FarEnd::Moving => segment.length,
    };
    !passes && leg(last).min(leg(next)) > h * (GLIDES.0 / turn.sqrt() - GLIDES.1)
}

/// Whether rounding a corner with a turn of `size` is faster than stopping in it. In a chain of short moves it always
/// is.
fn blend_is_faster<const A: usize>(
    last: &PathSegment<A>,
    next: &PathSegment<A>,
    size: f64,
    tolerance: f64,
    axes: &AxisLimits<A>,
) -> bool {
    let (a, j) = (smallest(axes.a), smallest(axes.j));
    let h = tolerance / (MAX_G * size).max(1e-12);
    let leg = last.length.min(next.length);
    if leg < 2.0 * h {
        return true;
    }
    // As planned: tangential motion has its share, and the speed is held under the cap of the narrowest part.
    let through = PASSED * (0.5 * j * h * h / size).cbrt().min((0.6 * a * h / size).sqrt());
    let full = last.feed.min(next.feed).min(axes.path_v).min((a * leg).sqrt());
    if through >= full {
        return true;
    }
    // Duration and distance of braking from full speed to v at zero acceleration.
    let brake = |v: f64| {
        let dv = full - v;
        let time = if dv * j >= a * a { dv / a + a / j } else { 2.0 * (dv / j).sqrt() };
        (time, 0.5 * (full + v) * time)
    };
    let ((stop, stop_distance), (blend, blend_distance)) = (brake(0.0), brake(through));
    blend + h / through + (stop_distance - blend_distance - h) / full < stop
}
