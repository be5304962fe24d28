//! Centres, turns and lengths of arcs.
//!
//! Invariant: an accepted arc has a radius, and its start and end are on it within the tolerances of LinuxCNC.

use crate::angle::{plus_quarters, sweep};
use crate::canon_modes::LengthUnit;
use crate::diag::{BlockResult, Span, fault};
use crate::error_codes::ErrorCode;
use crate::modal_groups::ArcCentres;
use std::f64::consts::SQRT_2;

/// Maximum relative difference of the radii, as a share of the greater one.
const RELATIVE_TOLERANCE: f64 = 0.001;

/// An arc is a half turn when the relative difference between half the chord and the radius is below this.
const TINY: f64 = 1e-12;

/// Tolerances of radii in program units.
#[derive(Clone, Copy, Debug)]
pub(super) struct Radii {
    /// Minimum radius. Half a chord may exceed the radius by this.
    min_radius: f64,
    /// Maximum absolute difference of the radii.
    max_difference: f64,
}

impl Radii {
    /// Returns the tolerances of LinuxCNC 2.9.
    pub(super) const fn for_units(units: LengthUnit) -> Radii {
        match units {
            LengthUnit::Inch => Radii { min_radius: 0.00005, max_difference: 0.002 * SQRT_2 },
            LengthUnit::Millimetre => Radii { min_radius: 0.00127, max_difference: 0.02 * SQRT_2 },
        }
    }
}

/// Data of an arc before its centre is known.
#[derive(Clone, Copy, Debug)]
pub(super) struct ArcShape {
    pub(super) start: (f64, f64),
    pub(super) end: (f64, f64),
    /// Number of turns begun, negative clockwise.
    pub(super) turns: i32,
    pub(super) radii: Radii,
    /// Span for diagnostics.
    pub(super) at: Span,
}

impl ArcShape {
    /// Returns the length of the arc about this centre, with its rise along the normal axis.
    pub(super) fn length(&self, centre: (f64, f64), rise: f64) -> f64 {
        let radius = (centre.0 - self.start.0).hypot(centre.1 - self.start.1);
        let turn = sweep(self.start, self.end, centre, self.turns);
        if rise == 0.0 { radius * turn.abs() } else { (radius * turn).hypot(rise) }
    }
}

/// Returns the centre that centre words give.
///
/// # Errors
/// E1605 for a radius of zero, E1606 when the radii disagree.
pub(super) fn from_centre(shape: &ArcShape, words: (f64, f64), meaning: ArcCentres) -> BlockResult<(f64, f64)> {
    let centre = match meaning {
        ArcCentres::Absolute => words,
        ArcCentres::Incremental => (shape.start.0 + words.0, shape.start.1 + words.1),
    };
    let first = (centre.0 - shape.start.0).hypot(centre.1 - shape.start.1);
    let last = (centre.0 - shape.end.0).hypot(centre.1 - shape.end.1);
    if first < shape.radii.min_radius || last < shape.radii.min_radius {
        return fault(ErrorCode::ArcZeroRadius, shape.at, ErrorCode::ArcZeroRadius.title());
    }
    let difference = (first - last).abs();
    if difference > shape.radii.max_difference && difference > RELATIVE_TOLERANCE * first.max(last) {
        let message = format!("the radius is {first:.4} at the start of the arc and {last:.4} at its end");
        return fault(ErrorCode::ArcRadiiDiffer, shape.at, message);
    }
    Ok(centre)
}

/// Returns the centre that a radius gives. A negative radius selects the longer arc.
///
/// # Errors
/// E1607 when the arc ends where it starts, E1608 when the radius is too small.
pub(super) fn from_radius(shape: &ArcShape, radius: f64) -> BlockResult<(f64, f64)> {
    let ((x, y), (end_x, end_y)) = (shape.start, shape.end);
    if x == end_x && y == end_y {
        return fault(ErrorCode::ArcSamePoint, shape.at, ErrorCode::ArcSamePoint.title());
    }
    let size = radius.abs();
    let (mid_x, mid_y) = ((end_x + x) / 2.0, (end_y + y) / 2.0);
    let half = (mid_x - end_x).hypot(mid_y - end_y);
    if half - size > shape.radii.min_radius || size == 0.0 {
        let message = format!("the radius {size} is too small for a chord of {:.4}", 2.0 * half);
        return fault(ErrorCode::ArcRadiusTooSmall, shape.at, message);
    }
    // The side of the chord on which the centre is: on its right for a short clockwise arc, and so on.
    let sine = if half / size > 1.0 - TINY { 1.0 } else { half / size };
    let chord = (end_y - y).atan2(end_x - x);
    let to_centre = plus_quarters(chord, if (shape.turns < 0) == (radius > 0.0) { -1 } else { 1 }, 0.0);
    let offset = size * sine.asin().cos();
    Ok((mid_x + offset * to_centre.cos(), mid_y + offset * to_centre.sin()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn centre(radius: f64, difference: f64, units: LengthUnit) -> Result<(f64, f64), ErrorCode> {
        let end = (2.0 * radius + difference, 0.0);
        let shape = ArcShape { start: (0.0, 0.0), end, turns: 1, radii: Radii::for_units(units), at: Span::default() };
        from_centre(&shape, (radius, 0.0), ArcCentres::Incremental).map_err(|fault| fault.code)
    }

    /// Short arcs may deviate by a length, long ones by a share, as measured in LinuxCNC.
    #[test]
    fn radii_differ_by_a_length_or_a_share_at_most() {
        let (mm, inch) = (LengthUnit::Millimetre, LengthUnit::Inch);
        for (radius, most, units) in
            [(1.0, 0.028_284, mm), (100.0, 0.100_1, mm), (1.0, 0.002_828_4, inch), (100.0, 0.100_1, inch)]
        {
            assert!(centre(radius, most, units).is_ok(), "{radius} {units:?}");
            assert_eq!(centre(radius, most * 1.001, units), Err(ErrorCode::ArcRadiiDiffer), "{radius} {units:?}");
        }
        assert_eq!(centre(0.001, 0.0, mm), Err(ErrorCode::ArcZeroRadius));
    }

    #[test]
    fn a_negative_radius_goes_the_longer_way_and_a_half_turn_has_one_centre() {
        let shape = ArcShape {
            start: (0.0, 0.0),
            end: (2.0, 0.0),
            turns: -1,
            radii: Radii::for_units(LengthUnit::Millimetre),
            at: Span::default(),
        };
        let near = |centre: BlockResult<(f64, f64)>, wanted: (f64, f64)| {
            let centre = centre.expect("an arc");
            (centre.0 - wanted.0).hypot(centre.1 - wanted.1) < 1e-12
        };
        let height = 3.0_f64.sqrt();
        assert!(near(from_radius(&shape, 2.0), (1.0, -height)));
        assert!(near(from_radius(&shape, -2.0), (1.0, height)));
        assert!(near(from_radius(&shape, 1.0), (1.0, 0.0)) && near(from_radius(&shape, 0.999_5), (1.0, 0.0)));
        assert_eq!(from_radius(&shape, 0.99).map_err(|fault| fault.code), Err(ErrorCode::ArcRadiusTooSmall));
        let third = ArcShape { turns: 1, end: (1.0, 1.0), ..shape };
        assert!((third.length((1.0, 0.0), 0.0) - 1.5 * std::f64::consts::PI).abs() < 1e-12);
    }
}
