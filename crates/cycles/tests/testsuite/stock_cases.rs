//! Single rules of stock removal: levels, alarms, chip breaking, closing valleys, humps, corners, the nose.
//!
//! Invariant: the calculation of each expected number is next to it.

use crate::stock;

use proptest::prelude::*;
use retrace_cycles::stock::{
    Corner, Element, Feed, Kind, LARGEST, MAX_MOVES, MoveKind, Path, Point, StockRemovalError, StockRemovalParams,
    ToolTip, Warning, plan,
};
use stock::{blocks, contour, expect, job, path};

/// The outside contour of the worked example.
fn example() -> StockRemovalParams {
    let text = "G1 X20 Z0\nZ-12\nX32 Z-18\nZ-24\nX26 Z-30\nZ-38\nX44\nG3 X50 Z-41 CR=3\nG1 Z-50";
    StockRemovalParams { fal_z: 0.1, fal_x: 0.2, ..job(contour(text), 1, 2.8) }
}

fn refused(job: &StockRemovalParams) -> (u32, Option<u32>, Option<u32>) {
    match plan(job) {
        Ok(path) => panic!("not refused:\n{}", blocks(&path).join("\n")),
        Err(fault) => (fault.number(), fault.followed_by(), fault.line()),
    }
}

fn refused_contour(text: &str) -> (u32, Option<u32>, Option<u32>) {
    refused(&job(contour(text), 1, 2.0))
}

/// The infeeds of the first section, as depths below the top.
fn steps(path: &Path) -> Vec<f64> {
    let levels = path.moves.windows(2).filter(|pair| pair[0].feed == Feed::Rapid && pair[1].feed == Feed::Rough);
    levels.map(|pair| pair[1].end.v).collect()
}

#[test]
fn a_depth_is_divided_equally() {
    for (depth, count, step) in [(39.0, 8, 4.875), (36.0, 8, 4.5), (7.0, 2, 3.5), (5.0, 1, 5.0), (10.0, 2, 5.0)] {
        let stairs = format!("G1 X20 Z0\nZ-10\nX{}\nZ-20", 20.0 + 2.0 * depth);
        let levels = steps(&path(&job(contour(&stairs), 1, 5.0)));
        let expected: Vec<f64> = (1..=count).map(|level| 10.0 + depth - step * f64::from(level)).collect();
        assert_eq!(levels, expected);
    }
    // A depth that is three infeeds except for the last digit: 0.3 / 0.1.
    let levels = steps(&path(&job(contour("G1 X20 Z0\nZ-10\nX20.6\nZ-20"), 1, 0.1)));
    assert_eq!(levels.len(), 3);
}

#[test]
fn an_unknown_machining_type_is_refused_before_anything_else() {
    for vari in [i32::MIN, -1, 0, 13, 100, 112, 200, 213, i32::MAX] {
        let job = StockRemovalParams { vari, contour: Vec::new(), mid: 0.0, ..example() };
        assert_eq!(refused(&job), (61002, None, None));
    }
}

#[test]
fn a_contour_that_cannot_be_prepared_is_refused_with_the_alarm_and_its_line() {
    let after = Some(61606);
    assert_eq!(refused_contour("G1 X20 Z0\nZ-10\nG33 X30 Z-20\nG1 Z-30"), (10930, after, Some(3)));
    assert_eq!(refused_contour("G1 X20 Z0\nX30 Z-10"), (10933, after, None));
    assert_eq!(refused_contour("G1 X20 Z0"), (10933, after, None));
    // Three quarters of a circle of radius 5, and a whole one.
    assert_eq!(refused_contour("G1 X20 Z0\nG2 X30 Z-5 CR=-5\nG1 Z-20"), (10931, after, Some(2)));
    assert_eq!(refused_contour("G1 X20 Z0\nG2 X20 Z0 I5 K0\nG1 X30 Z-20"), (10931, after, Some(2)));
    let stairs: String = (1..=60).map(|step| format!("X{0}\nZ-{0}\n", 20 + step)).collect();
    assert_eq!(refused_contour(&format!("G1 X20 Z0\n{stairs}")), (10934, after, None));
    let stairs: String = (1..=50).map(|step| format!("X{0}\nZ-{0}\n", 20 + step)).collect();
    assert!(plan(&job(contour(&format!("G1 X20 Z0\n{stairs}")), 1, 2.0)).is_ok());
    // Errors that the contour reader itself detects have their alarm here too.
    assert_eq!(
        (StockRemovalError::CompensationInside(4).number(), StockRemovalError::CompensationInside(4).followed_by()),
        (10931, after)
    );
    assert_eq!(
        (StockRemovalError::MissingMotion(1).number(), StockRemovalError::MissingAxis(1).number()),
        (15800, 61605)
    );
}

#[test]
fn a_wrong_contour_is_refused() {
    let wrong = |line| (61605, None, Some(line));
    assert_eq!(refused_contour("G1 X20 Z0\nX30 Z-20\nX40 Z-15\nX50 Z-30"), wrong(3), "an overhang");
    // A half circle whose lower half hangs over.
    assert_eq!(refused_contour("G1 X20 Z0\nZ-10\nG2 X40 Z-10 CR=5\nG1 Z-30"), wrong(3));
    assert_eq!(refused_contour("G1 X20 Z0\nZ-10\nX40\nX30\nZ-30\nX60"), wrong(4), "a wall run back over");
    assert_eq!(refused_contour("G1 X20 Z0\nX30\nX40"), (61605, None, None), "no extent");
    assert_eq!(refused_contour("G1 X20 Z0\nZ-5 RND=9\nX30\nZ-20"), wrong(2), "a rounding too large");
    assert_eq!(refused_contour("G1 X20 Z0\nZ-5 CHR=6\nX30\nZ-20"), wrong(2), "a chamfer too large");
    assert_eq!(refused_contour("G1 X20 Z0\nZ-10\nG3 X30 Z-15 I1 K-5\nG1 Z-20"), wrong(3), "radii that differ");
    let mut gap = example();
    gap.contour[3].start.u += 0.001;
    assert_eq!(refused(&gap), wrong(5));
}

#[test]
fn numbers_that_are_none_are_refused() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 2.0 * LARGEST] {
        let jobs = [
            StockRemovalParams { mid: bad, ..example() },
            StockRemovalParams { fal_z: bad, ..example() },
            StockRemovalParams { fal_x: bad, ..example() },
            StockRemovalParams { fal: bad, ..example() },
            StockRemovalParams { dam: bad, ..example() },
            StockRemovalParams { vrt: bad, ..example() },
            StockRemovalParams { nose_radius: bad, ..example() },
            StockRemovalParams { clearance_angle: bad, ..example() },
            StockRemovalParams { tip: ToolTip { u: bad, v: 0.0 }, ..example() },
            StockRemovalParams { position: Some(Point::new(0.0, bad)), ..example() },
        ];
        for job in jobs {
            assert!(matches!(plan(&job), Err(StockRemovalError::Number(_))), "{job:?}");
        }
        let mut job = example();
        job.contour[2].end.u = bad;
        assert!(plan(&job).is_err());
    }
}

#[test]
fn no_infeed_is_refused_unless_only_finishing_is_asked_for() {
    for vari in 1..=12 {
        let job = StockRemovalParams { mid: 0.0, vari, ..example() };
        if (5..=8).contains(&vari) {
            assert!(!matches!(plan(&job), Err(StockRemovalError::InfeedDepth)));
        } else {
            assert_eq!(refused(&job), (61610, None, None));
        }
    }
    assert_eq!(refused(&StockRemovalParams { mid: 1e-9, ..example() }).0, 61610);
    assert_eq!(refused(&StockRemovalParams { dam: 1e-7, ..example() }).0, 10934);
}

/// 3 mm down over 6 mm: atan(0.5) = 26.565 degrees.
#[test]
fn a_flank_steeper_than_the_tool_clears_is_refused() {
    for vari in [1, 5, 9] {
        assert_eq!(refused(&StockRemovalParams { clearance_angle: 26.0, vari, ..example() }), (61604, None, Some(5)));
        assert!(plan(&StockRemovalParams { clearance_angle: 26.57, vari, ..example() }).is_ok());
        assert!(plan(&StockRemovalParams { clearance_angle: 0.0, vari, ..example() }).is_ok());
    }
    // A falling quarter circle ends upright.
    let round = contour("G1 X30 Z0\nZ-5\nG3 X20 Z-10 CR=5\nG1 Z-15\nX40\nZ-20");
    assert_eq!(
        refused(&StockRemovalParams { clearance_angle: 89.0, ..job(round.clone(), 1, 2.0) }),
        (61604, None, Some(3))
    );
    assert!(plan(&StockRemovalParams { clearance_angle: 90.0, ..job(round, 1, 2.0) }).is_ok());
}

#[test]
fn a_tool_inside_the_blank_is_refused() {
    let at = |x: f64, z: f64, vari| StockRemovalParams { position: Some(Point::new(z, x / 2.0)), vari, ..example() };
    assert_eq!(refused(&at(40.0, -10.0, 1)), (61607, None, None));
    assert!(plan(&at(60.0, -10.0, 1)).is_ok() && plan(&at(40.0, 1.0, 1)).is_ok());
    // Before finishing alone the blank is gone already.
    assert!(plan(&at(40.0, -10.0, 5)).is_ok());
}

/// The second cut of the worked example, from Z1.1 to Z-37.9, is stopped once, at Z-18.9; 39 mm and a stop each 13 mm:
/// twice, not at the end.
#[test]
fn a_roughing_cut_is_interrupted_each_dam() {
    let stops = |dam: f64, x: f64| -> Vec<f64> {
        let path = path(&StockRemovalParams { dam, ..example() });
        let dwells = path.moves.iter().filter(|step| step.dwell_after && (2.0 * step.end.v - x).abs() < 1e-9);
        dwells.map(|step| step.end.u).collect()
    };
    let close = |found: Vec<f64>, expected: &[f64]| {
        assert_eq!(found.len(), expected.len(), "{found:?}");
        assert!(found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-9), "{found:?}");
    };
    close(stops(20.0, 40.4), &[-18.9]);
    close(stops(13.0, 40.4), &[-11.9, -24.9]);
    // In the relief cut, from Z-27.1 to Z-37.9.
    close(stops(5.0, 29.4), &[-32.1, -37.1]);
    assert_eq!(stops(0.0, 40.4), []);
    let path = path(&StockRemovalParams { dam: 3.0, ..example() });
    assert!(
        path.moves.iter().all(|step| !step.dwell_after || (step.feed == Feed::Rough && step.kind == MoveKind::Line))
    );
}

/// A groove 1 mm wide with 0.6 mm on both sides has no room: roughing bridges it, finishing cuts it.
#[test]
fn a_relief_cut_that_closes_up_is_left_to_finishing_with_a_warning() {
    let groove = contour("G1 X30 Z0\nZ-10\nX20\nZ-11\nX30\nZ-20\nX40");
    let open = path(&StockRemovalParams { fal_z: 0.4, ..job(groove.clone(), 9, 2.0) });
    assert_eq!((open.warnings.len(), open.moves.iter().any(|step| step.feed == Feed::Plunge)), (0, true));
    let closed = path(&StockRemovalParams { fal_z: 0.6, ..job(groove, 9, 2.0) });
    assert_eq!(closed.warnings, [Warning::ReliefLeftToFinishing(1)]);
    assert!(closed.moves.iter().all(|step| step.feed != Feed::Plunge));
    assert!(closed.moves.iter().any(|step| step.feed == Feed::Finish && step.end == Point::new(-10.0, 10.0)));
}

/// A V of 45 degrees from r 15: with 1 mm along Z the flanks meet 1 mm higher than at r 10, at r 11 = X22 Z-15.
#[test]
fn the_walls_of_a_narrow_valley_meet_higher() {
    let valley = contour("G1 X30 Z0\nZ-10\nX20 Z-15\nX30 Z-20\nZ-25\nX32");
    let path = path(&StockRemovalParams { fal_z: 1.0, ..job(valley, 1, 10.0) });
    let lowest = path.moves.iter().map(|step| step.end).min_by(|a, b| a.v.total_cmp(&b.v));
    assert!(lowest.is_some_and(|at| (at.u + 15.0).abs() < 1e-9 && (at.v - 11.0).abs() < 1e-9), "{lowest:?}");
}

/// Two valleys, r 15 down to r 11, hump r 13, down to r 9. First part: depth 4, n = 2, levels r 13 and r 11; the first
/// runs at the height of the hump over both. Rest: top r 13, depth 4, n = 2, levels r 11 and r 9.
#[test]
fn behind_a_hump_the_rest_is_a_section_of_its_own() {
    let humps = contour("G1 X30 Z0\nZ-5\nX22\nZ-10\nX26\nZ-12\nX18\nZ-20\nX30\nZ-22\nX32");
    expect(
        &path(&job(humps, 1, 3.0)),
        "G0 X34.000 Z1.000
         G0 X30.000             ; 1 mm in one level
         G1 Z-22.000 FF1
         G1 X32.000 FF1
         G0 X34.000 Z-21.000
         G0 Z1.000              ; already at the height of P
         G0 Z-5.000             ; the relief cut
         G0 X32.000
         G1 X30.000 FF2
         G1 X26.000 FF2
         G1 Z-20.000 FF1        ; over the hump
         G1 X30.000 FF1
         G0 X32.000 Z-19.000
         G0 Z-6.000
         G0 X28.000
         G1 X26.000 Z-5.000 FF2
         G1 X22.000 FF2
         G1 Z-10.000 FF1        ; to the hump
         G1 X26.000 FF1
         G0 X28.000 Z-9.000
         G0 X34.000
         G0 Z-12.000            ; the rest
         G0 X28.000
         G1 X26.000 FF2
         G1 X22.000 FF2
         G1 Z-20.000 FF1
         G1 X26.000 FF1
         G0 X28.000 Z-19.000
         G0 Z-13.000
         G0 X24.000
         G1 X22.000 Z-12.000 FF2
         G1 X18.000 FF2
         G1 Z-20.000 FF1
         G1 X22.000 FF1
         G0 X24.000 Z-19.000
         G0 X34.000
         G0 Z1.000",
    );
}

/// The largest diameter is not at an end: a wall at Z-20 closes the part behind it, which is a relief cut then.
#[test]
fn behind_the_largest_diameter_a_wall_is_added() {
    let path = path(&job(contour("G1 X20 Z0\nZ-5\nX30\nZ-10\nX24\nZ-20"), 1, 5.0));
    expect(
        &path,
        "G0 X32.000 Z1.000
         G0 X20.000
         G1 Z-5.000 FF1
         G1 X30.000 FF1
         G0 X32.000 Z-4.000
         G0 Z1.000
         G0 Z-10.000
         G1 X30.000 FF2
         G1 X24.000 FF2
         G1 Z-20.000 FF1
         G1 X30.000 FF1
         G0 X32.000 Z-19.000
         G0 Z1.000",
    );
}

/// A half circle of radius 5 from X20 Z-10 to X20 Z-20 rises above the cylinder; it is split at its top, X30 Z-15.
#[test]
fn an_arc_is_split_at_the_extremes_of_the_axes() {
    let path = path(&job(contour("G1 X20 Z0\nZ-10\nG3 X20 Z-20 CR=5\nG1 Z-30\nX30\nZ-35"), 1, 5.0));
    expect(
        &path,
        "G0 X32.000 Z1.000
         G0 X20.000
         G1 Z-10.000 FF1
         G3 X30.000 Z-15.000 centre X20.000 Z-15.000 FF1
         G0 X32.000 Z-14.000
         G0 Z1.000
         G0 Z-15.000
         G1 X30.000 FF2
         G3 X20.000 Z-20.000 centre X20.000 Z-15.000 FF2
         G1 Z-30.000 FF1
         G1 X30.000 FF1
         G0 X32.000 Z-29.000
         G0 Z1.000",
    );
}

/// RND 2 at a right angle: tangent points 2 mm before and behind. CHR 1: 1 mm of each side. CHF 2 at a right angle:
/// legs of 2/sqrt(2).
#[test]
fn corners_are_broken_as_programmed() {
    let text = "G1 X20 Z0\nZ-10 RND=2\nX30 CHR=1\nZ-20 CHF=2\nX40\nZ-30";
    let finishing = path(&job(contour(text), 5, 0.0));
    expect(
        &finishing,
        "G0 X42.000
         G0 Z1.000
         G42 G0 X20.000 Z0.000
         G1 Z-8.000 FF3
         G2 X24.000 Z-10.000 centre X24.000 Z-8.000 FF3
         G1 X28.000 FF3
         G1 X30.000 Z-11.000 FF3
         G1 Z-18.586 FF3
         G1 X32.828 Z-20.000 FF3
         G1 X40.000 FF3
         G1 Z-30.000 FF3
         G40 G0 X42.000 Z1.000",
    );
}

/// Between a cylinder at r 10 and a rising arc (centre r 10, Z-15, radius 5), rounded with 1: the centre of the
/// rounding is at r 11 and 5 + 1 from the arc's centre: Z = -15 + sqrt(36 - 1) = -9.084. It leaves the cylinder there,
/// and touches the arc at five sixths of the distance: r 10 + 5/6 = X21.667, Z = -15 + 5/6 * 5.916 = -10.070.
#[test]
fn a_rounding_touches_an_arc_too() {
    let path = path(&job(contour("G1 X20 Z0\nZ-10 RND=1\nG3 X30 Z-15 CR=5\nG1 Z-20"), 5, 0.0));
    assert_eq!(
        blocks(&path)[3..6],
        [
            "G1 Z-9.084 FF3",
            "G2 X21.667 Z-10.070 centre X22.000 Z-9.084 FF3",
            "G3 X30.000 Z-15.000 centre X20.000 Z-15.000 FF3"
        ]
    );
}

#[test]
fn a_sign_is_dropped_with_a_warning_and_no_lift_off_is_a_millimetre() {
    let plain = path(&example());
    let job = example();
    let signed = StockRemovalParams { mid: -job.mid, fal_z: -job.fal_z, fal_x: -job.fal_x, vrt: 0.0, ..job };
    let signed = path(&signed);
    assert_eq!(signed.moves, plain.moves);
    assert_eq!(signed.warnings, ["MID", "FALZ", "FALX"].map(Warning::SignDropped));
}

/// FAL adds to both allowances: 0.1 + 0.3 along Z, 0.2 + 0.3 along X.
#[test]
fn the_allowance_along_the_contour_adds_to_both() {
    let with = path(&StockRemovalParams { fal: 0.3, ..example() });
    let same = path(&StockRemovalParams { fal_z: 0.4, fal_x: 0.5, ..example() });
    assert_eq!(blocks(&with), blocks(&same));
}

#[test]
fn without_a_nose_compensation_in_roughing_changes_nothing() {
    let with = |nose_radius, rough_compensated| {
        blocks(&path(&StockRemovalParams {
            nose_radius,
            rough_compensated,
            tip: ToolTip::of_orientation(2),
            ..example()
        }))
    };
    assert_eq!(with(0.0, true), with(0.0, false));
    assert_eq!(with(0.8, false), with(0.0, false));
    assert_ne!(with(0.8, true), with(0.8, false));
}

/// Nose radius 1, tip at its lower left. Upright falling wall at Z-10: the tip keeps 2 mm from it (the nose is in
/// between), so the groove from Z-10 to Z-20 is cut from Z-12 to Z-20. Around the rim the centre runs from above Z-10
/// (tip at Z-11, X30) to Z-11. The floor and the wall towards +Z, which tip and nose touch together, are where they
/// are.
#[test]
fn a_compensated_nose_does_not_cut_into_falling_walls() {
    let groove = contour("G1 X30 Z0\nZ-10\nX20\nZ-20\nX32\nZ-25");
    let nose = StockRemovalParams { nose_radius: 1.0, tip: ToolTip::of_orientation(2), ..job(groove, 1, 6.0) };
    expect(
        &path(&nose),
        "G0 X34.000 Z1.000
         G0 X30.000
         G1 Z-20.000 FF1
         G3 X32.000 Z-21.000 centre X30.000 Z-21.000 FF1
         G0 X34.000 Z-20.000
         G0 Z1.000
         G0 Z-11.000
         G0 X32.000
         G1 X30.000 FF2
         G3 X28.000 Z-12.000 centre X28.000 Z-11.000 FF2
         G1 X20.000 FF2
         G1 Z-20.000 FF1
         G1 X30.000 FF1
         G0 X32.000 Z-19.000
         G0 X34.000
         G0 Z1.000",
    );
}

#[test]
fn a_nose_that_does_not_fit_the_contour_is_refused_where_finishing_is_asked_for() {
    let groove = |width: f64| contour(&format!("G1 X30 Z0\nZ-10\nX20\nZ-{}\nX32\nZ-25", 10.0 + width));
    let nose = |width, vari| StockRemovalParams { nose_radius: 0.8, ..job(groove(width), vari, 2.0) };
    assert!(plan(&nose(1.7, 5)).is_ok());
    assert_eq!(refused(&nose(1.5, 5)).0, 61604);
    assert_eq!(refused(&nose(1.5, 9)).0, 61604);
    assert_eq!(path(&nose(1.7, 1)).warnings, []);
    assert!(matches!(path(&nose(1.5, 1)).warnings[..], [Warning::NoseLeavesStock(3..=5)]));
    // A hollow of radius 0.5.
    let hollow = contour("G1 X20 Z0\nZ-10\nG2 X21 Z-10.5 CR=0.5\nG1 X30\nZ-20");
    assert_eq!(refused(&StockRemovalParams { nose_radius: 0.8, ..job(hollow, 5, 2.0) }), (61604, None, Some(3)));
}

/// Any finite or infinite number, and sometimes one of ordinary size.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![any::<f64>(), -100.0..100.0, (-20i32..20).prop_map(f64::from), Just(0.0)]
}

fn element() -> impl Strategy<Value = Element> {
    let kind = prop_oneof![
        Just(Kind::Line),
        Just(Kind::Rapid),
        Just(Kind::Clockwise),
        Just(Kind::Counterclockwise),
        Just(Kind::Other)
    ];
    let corner = (0..4, number()).prop_map(|(which, size)| match which {
        0 => Corner::None,
        1 => Corner::ChamferLength(size),
        2 => Corner::ChamferLeg(size),
        _ => Corner::Rounding(size),
    });
    (kind, [number(), number(), number(), number()], corner).prop_map(|(kind, [u, v, cu, cv], corner)| Element {
        kind,
        start: Point::default(),
        end: Point::new(u, v),
        centre: Point::new(cu, cv),
        corner,
        line: 0,
    })
}

fn cases() -> u32 {
    std::env::var("RETRACE_STOCK").ok().and_then(|count| count.parse().ok()).unwrap_or(2000)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: cases(), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn whatever_the_numbers_the_answer_is_a_bounded_finite_path_or_a_fault(
        mut contour in prop::collection::vec(element(), 0..12),
        vari in prop_oneof![1..=12, 201..=212, any::<i32>()],
        sizes in prop::array::uniform9(number()),
        tip in 0..10,
        tidy: bool,
    ) {
        // Joined, and mostly of ordinary elements in one direction, so that many pass the first checks.
        let mut at = Point::new(0.0, 20.0);
        for element in &mut contour {
            element.start = at;
            if tidy {
                let (du, dv) = (element.end.u.abs() % 10.0, element.end.v % 10.0);
                element.end = Point::new(at.u - du, at.v + dv);
                element.corner = Corner::None;
                if element.kind == Kind::Other { element.kind = Kind::Line; }
                if element.centre.u < 0.0 { element.kind = Kind::Line; }
                let radius = du.hypot(dv);
                let side = if element.centre.v > 0.0 { 1.0 } else { -1.0 };
                element.centre = Point::new(at.u - du / 2.0 - side * dv * radius / 20.0,
                    at.v + dv / 2.0 - side * du * radius / 20.0);
            }
            at = element.end;
        }
        let [mid, fal_z, fal_x, fal, dam, vrt, nose_radius, clearance_angle, _] = sizes;
        let job = StockRemovalParams {
            contour, vari, mid, fal_z, fal_x, fal, dam, vrt, nose_radius,
            tip: ToolTip::of_orientation(tip), clearance_angle, rough_compensated: true, position: None,
        };
        match plan(&job) {
            Ok(path) => {
                prop_assert!(path.moves.len() <= MAX_MOVES);
                for step in &path.moves {
                    prop_assert!([step.end.u, step.end.v, step.centre.u,
                        step.centre.v].iter().all(|value| value.is_finite()), "{step:?}");
                }
                prop_assert!([mid, fal_z, fal_x, fal, dam, vrt, nose_radius,
                    clearance_angle].iter().all(|value| value.is_finite()));
            }
            Err(fault) => prop_assert!(fault.number() > 0 && !fault.to_string().is_empty()),
        }
    }
}
