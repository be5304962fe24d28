//! Approximation of splines by chords.
//!
//! Invariant: no chord is farther from the curve than requested, and the last one ends at the curve's end.

use retrace_gcode::Nurbs;

/// Minimum number of chords between two knots: one alone could cross its curve where it is sampled.
const MIN_PARTS: u32 = 4;

/// Maximum number of halvings of a part: 4 096 chords between two knots.
const MAX_HALVINGS: u32 = 10;

/// Number of parts at whose ends a chord is compared with the curve.
const PLACES: u32 = 16;

/// Safety factor: between these points the curve may deviate a little more.
const MARGIN: f64 = 0.75;

/// A point of the plane, in the units of the spline.
type Point = (f64, f64);

/// Calls `chord` with the end of each chord in order; none is farther from the curve than `deviation`, in the curve's
/// own units.
///
/// # Errors
/// The first of `chord`.
pub(crate) fn chords<E>(
    spline: &Nurbs,
    deviation: f64,
    mut chord: impl FnMut(Point) -> Result<(), E>,
) -> Result<(), E> {
    for span in 0..spline.spans() {
        for part in 0..MIN_PARTS {
            let from = span as f64 + f64::from(part) / f64::from(MIN_PARTS);
            piece(spline, (from, from + 1.0 / f64::from(MIN_PARTS)), deviation, MAX_HALVINGS, &mut chord)?;
        }
    }
    Ok(())
}

fn piece<E>(
    spline: &Nurbs,
    (from, to): (f64, f64),
    deviation: f64,
    halvings: u32,
    chord: &mut impl FnMut(Point) -> Result<(), E>,
) -> Result<(), E> {
    let (start, end) = (spline.at(from), spline.at(to));
    let at = |share: f64| spline.at(from + (to - from) * share);
    let is_near =
        (1..PLACES).all(|place| distance(at(f64::from(place) / f64::from(PLACES)), start, end) <= MARGIN * deviation);
    if is_near || halvings == 0 {
        return chord(end);
    }
    let middle = from + (to - from) / 2.0;
    piece(spline, (from, middle), deviation, halvings - 1, chord)?;
    piece(spline, (middle, to), deviation, halvings - 1, chord)
}

/// Distance from a point to the segment between two others.
fn distance(point: Point, start: Point, end: Point) -> f64 {
    let (x, y) = (end.0 - start.0, end.1 - start.1);
    let (p, q) = (point.0 - start.0, point.1 - start.1);
    let square = x * x + y * y;
    let share = if square > 0.0 { ((p * x + q * y) / square).clamp(0.0, 1.0) } else { 0.0 };
    (p - share * x).hypot(q - share * y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use retrace_gcode::ControlPoint;
    use std::convert::Infallible;

    proptest! {
        #[test]
        fn chords_stay_by_the_curve_and_end_on_it(
            p in prop::collection::vec((-90.0..90.0_f64, -90.0..90.0_f64, 0.2..5.0_f64), 3..9),
            order in 3_u32..6, deviation in 0.001..0.1_f64
        ) {
            let points = p.iter().map(|&(x, y, weight)| ControlPoint { x, y, weight }).collect();
            let spline = Nurbs { order: order.min(p.len() as u32), points };
            let mut ends = vec![spline.at(0.0)];
            let done: Result<(), Infallible> = chords(&spline, deviation, |end| {
                ends.push(end);
                Ok(())
            });
            prop_assert!(done.is_ok());
            let last = (p[p.len() - 1].0, p[p.len() - 1].1);
            let found = ends[ends.len() - 1];
            prop_assert!((found.0 - last.0).hypot(found.1 - last.1) < 1e-9);
            for step in 0..=500 {
                let point = spline.at(spline.spans() as f64 * f64::from(step) / 500.0);
                let near = ends.windows(2).map(|pair| distance(point, pair[0], pair[1])).fold(f64::MAX, f64::min);
                prop_assert!(near <= deviation, "{near} of {deviation}");
            }
        }
    }
}
