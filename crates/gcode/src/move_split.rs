//! Lengths of feed moves, and their division at a length.
//!
//! Invariant: both parts together are the path of the whole move.

use crate::angle::sweep;
use crate::canon::{ArcFeed, Canon};
use crate::pose::{Axis, Pose};
use std::f64::consts::TAU;

/// Returns the length of a straight move or an arc that begins at `from`, in program units; `None` of anything else.
pub(crate) fn length(from: &Pose, canon: &Canon) -> Option<f64> {
    match canon {
        Canon::StraightFeed(end) => {
            let way = end.minus(from);
            Some([Axis::X, Axis::Y, Axis::Z].map(|axis| way[axis] * way[axis]).iter().sum::<f64>().sqrt())
        }
        Canon::ArcFeed(arc) => {
            let (angle, [radius, _]) = angle_and_radii(from, arc);
            let [.., normal] = arc.plane.axes();
            Some((angle * radius).hypot(arc.end[normal] - from[normal]))
        }
        _ => None,
    }
}

/// Returns where a move that begins at `from` ends, where that is known.
pub(crate) fn end(canon: &Canon) -> Option<Pose> {
    match canon {
        Canon::StraightFeed(end) | Canon::StraightTraverse(end) => Some(*end),
        Canon::ArcFeed(arc) => Some(arc.end),
        _ => None,
    }
}

/// Divides a straight move or an arc that begins at `from` at this share of its length, between 0 and 1. Anything else
/// is returned twice.
pub(crate) fn divided(from: &Pose, canon: &Canon, share: f64) -> [Canon; 2] {
    let between = |end: &Pose| {
        let mut place = *from;
        Axis::ALL.iter().for_each(|&axis| place[axis] += (end[axis] - from[axis]) * share);
        place
    };
    match canon {
        Canon::StraightFeed(end) => [Canon::StraightFeed(between(end)), canon.clone()],
        Canon::ArcFeed(arc) => {
            let (angle, [first_radius, last_radius]) = angle_and_radii(from, arc);
            let [first, second, _] = arc.plane.axes();
            let (x, y) = (from[first] - arc.first_centre, from[second] - arc.second_centre);
            let radius = first_radius + (last_radius - first_radius) * share;
            let (sine, cosine) = (y.atan2(x) + angle * share).sin_cos();
            let mut place = between(&arc.end);
            place[first] = arc.first_centre + radius * cosine;
            place[second] = arc.second_centre + radius * sine;
            let turns = |share: f64| arc.turns.signum() * ((angle * share / TAU).abs() as i32 + 1);
            [
                Canon::ArcFeed(ArcFeed { end: place, turns: turns(share), ..*arc }),
                Canon::ArcFeed(ArcFeed { turns: turns(1.0 - share), ..*arc }),
            ]
        }
        _ => [canon.clone(), canon.clone()],
    }
}

/// Angle of an arc in radians, and its radius at both ends.
fn angle_and_radii(from: &Pose, arc: &ArcFeed) -> (f64, [f64; 2]) {
    let [first, second, _] = arc.plane.axes();
    let centre = (arc.first_centre, arc.second_centre);
    let [start, end] = [from, &arc.end].map(|pose| (pose[first], pose[second]));
    let radius = |place: (f64, f64)| (place.0 - centre.0).hypot(place.1 - centre.1);
    (sweep(start, end, centre, arc.turns), [radius(start), radius(end)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::canon_modes::Plane;
    use proptest::prelude::*;

    proptest! {
        /// The parts have the lengths that are asked for, and join; the first end lies on the move.
        #[test]
        fn parts_make_the_whole(
            centre in [-50.0..50.0f64, -50.0..50.0f64], radius in 0.5..80.0f64, angles in [-3.1..3.1f64, 0.2..14.0f64],
            is_left in any::<bool>(), height in -5.0..5.0f64, share in 0.02..0.98f64,
        ) {
            let sign = if is_left { 1.0 } else { -1.0 };
            let at = |angle: f64, z: f64| {
                Pose::xyz(centre[0] + radius * angle.cos(), centre[1] + radius * angle.sin(), z)
            };
            let (from, to) = (at(angles[0], 0.0), at(angles[0] + sign * angles[1], height));
            let turns = sign as i32 * ((angles[1] / TAU) as i32 + 1);
            let arc = ArcFeed { plane: Plane::Xy, end: to, first_centre: centre[0], second_centre: centre[1], turns };
            for whole in [Canon::StraightFeed(to), Canon::ArcFeed(arc)] {
                let [one, other] = divided(&from, &whole, share);
                let middle = end(&one).unwrap();
                let lengths = [(&from, &whole), (&from, &one), (&middle, &other)].map(|(from, of)| length(from, of));
                let [all, first, second] = lengths.map(Option::unwrap);
                prop_assert!((first - share * all).abs() < 1e-9 * (1.0 + all), "{first} of {all}");
                prop_assert!((first + second - all).abs() < 1e-9 * (1.0 + all), "{first} + {second}: {all}");
                prop_assert_eq!(end(&other), end(&whole));
            }
        }
    }
}
