//! Both ends of a contour: creep, the cutter off before the end, over cut, the abrasive of a jet (CUT-13, CUT-14,
//! CUT-19).

use crate::cutting::{run_with, setup};
use proptest::prelude::*;
use retrace_gcode::{Axis, Canon, CuttingSetup, CuttingSwitch, CuttingTool, Material, MaterialList, Pose, Setup};
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::sync::Arc;

const FEED: f64 = 3000.0;

/// A machine whose only material has these figures: creep in per cent and mm, off before, over cut.
fn machine([creep_percent, creep_mm, off_before_mm, over_cut_mm]: [f64; 4], abrasive_lag_mm: f64) -> Setup {
    let material = Material { creep_percent, creep_mm, off_before_mm, over_cut_mm, ..Material::default() };
    machine_with(material, abrasive_lag_mm)
}

fn machine_with(material: Material, abrasive_lag_mm: f64) -> Setup {
    let plain = setup();
    let cutting = plain.cutting.as_deref().unwrap().clone();
    let material = Material { feed_mm_per_min: FEED, ..material };
    let tool = CuttingTool {
        spindle: 0,
        cuts: true,
        uses_speed: false,
        abrasive: Some(5),
        abrasive_lag_mm,
        height_hold_mm: 0.0,
    };
    let materials = Arc::new(MaterialList::new([material], 0));
    Setup { cutting: Some(Arc::new(CuttingSetup { materials, tools: vec![tool], ..cutting })), ..plain }
}

/// A move of a contour: end, length in mm, feed rate, and whether cutter and abrasive are on.
#[derive(Clone, Debug)]
struct Cut {
    end: Pose,
    mm: f64,
    rate: f64,
    lit: bool,
    abrasive: bool,
}

/// The moves between M3 and M5, of a program in mm.
fn cuts(steps: &[Canon]) -> Vec<Cut> {
    let (mut at, mut rate, mut lit, mut abrasive, mut is_contour) = (Pose::ZERO, 0.0, false, false, false);
    let mut cuts = Vec::new();
    for step in steps {
        let (end, mm) = match step {
            Canon::SetFeedRate(new) => {
                rate = *new;
                continue;
            }
            Canon::StartSpindleClockwise(0) => {
                (is_contour, lit, abrasive) = (true, true, true);
                continue;
            }
            Canon::StopSpindleTurning(0) => {
                is_contour = false;
                continue;
            }
            Canon::SetCutting(CuttingSwitch::Cutter, on) => {
                lit &= on;
                continue;
            }
            Canon::ClearMotionOutputBit(5) => {
                abrasive = false;
                continue;
            }
            Canon::StraightFeed(end) | Canon::StraightTraverse(end) => {
                (*end, (end[Axis::X] - at[Axis::X]).hypot(end[Axis::Y] - at[Axis::Y]))
            }
            Canon::ArcFeed(arc) => {
                let from = (at[Axis::X] - arc.first_centre, at[Axis::Y] - arc.second_centre);
                let to = (arc.end[Axis::X] - arc.first_centre, arc.end[Axis::Y] - arc.second_centre);
                let turn = (to.1.atan2(to.0) - from.1.atan2(from.0)) * f64::from(arc.turns.signum());
                let whole = f64::from(arc.turns.abs() - 1) * TAU;
                let angle = turn.rem_euclid(TAU);
                (arc.end, (if angle < 1e-9 { TAU } else { angle } + whole) * from.0.hypot(from.1))
            }
            _ => continue,
        };
        at = end;
        if is_contour {
            cuts.push(Cut { end, mm, rate, lit, abrasive });
        }
    }
    cuts
}

/// A contour of straight moves and half circles from the origin, closed or open.
fn program(ways: &[(f64, f64, u8)], is_closed: bool) -> String {
    let mut text = format!("G21 G91.1 F{FEED}\nM3 S1\n");
    let mut at = (0.0, 0.0);
    let back = is_closed.then_some((f64::NAN, 0.0, 0));
    for &(x, y, kind) in ways.iter().chain(&back) {
        let to = if x.is_nan() { (0.0, 0.0) } else { (at.0 + x, at.1 + y) };
        let _ = match kind {
            0 => writeln!(text, "G1 X{:.4} Y{:.4}", to.0, to.1),
            kind => writeln!(text, "G{} X{:.4} Y{:.4} I{:.5} J{:.5}", 1 + kind, to.0, to.1, x / 2.0, y / 2.0),
        };
        at = to;
    }
    text + "M5\nG0 X500\n"
}

fn total(cuts: &[Cut], of: impl Fn(&Cut) -> bool) -> f64 {
    cuts.iter().filter(|cut| of(cut)).map(|cut| cut.mm).sum()
}

/// A contour is as long as the program has it, and what is slow, dark or without abrasive has the length that the
/// figures say.
fn assert_ends(ways: &[(f64, f64, u8)], is_closed: bool, figures: [f64; 4], lag_mm: f64) {
    let text = program(ways, is_closed);
    let (plain, shaped) =
        (cuts(&run_with(&text, machine([0.0; 4], 0.0)).0), cuts(&run_with(&text, machine(figures, lag_mm)).0));
    let [percent, creep_mm, off_before_mm, over_cut_mm] = figures;
    let whole = total(&plain, |_| true);
    let near = |a: f64, b: f64| (a - b).abs() < 3e-3;
    let over_cuts = is_closed && over_cut_mm > 0.0 && whole > over_cut_mm;
    let behind = if over_cuts { over_cut_mm } else { 0.0 };
    assert!(near(total(&shaped, |_| true), whole + behind), "{text}{shaped:?}");
    let creeps = if percent > 0.0 { creep_mm.min(whole) } else { 0.0 };
    assert!(near(total(&shaped, |cut| cut.rate < FEED), creeps) || percent == 100.0, "{creeps}: {text}{shaped:?}");
    assert!(shaped.iter().all(|cut| cut.rate == FEED || (cut.rate - FEED * percent / 100.0).abs() < 1e-9));
    let off = if whole >= off_before_mm { off_before_mm } else { 0.0 };
    assert!(near(total(&shaped, |cut| !cut.lit), off + behind), "{off} {behind}: {text}{shaped:?}");
    let without = if whole >= lag_mm && off_before_mm == 0.0 { lag_mm } else { 0.0 };
    let lag = total(&shaped, |cut| !cut.abrasive);
    assert!(near(lag, without + if without > 0.0 { behind } else { 0.0 }), "{without}: {text}{shaped:?}");
    // every end of the program's moves is reached, in order
    let mut ends = shaped.iter().map(|cut| cut.end);
    assert!(plain.iter().all(|cut| ends.any(|end| end == cut.end)), "{text}{shaped:?}");
}

proptest! {
    #[test]
    fn both_ends_of_a_contour_have_the_lengths_of_the_figures(
        ways in prop::collection::vec((-30.0..30.0f64, -30.0..30.0f64, 0..3u8), 1..7),
        is_closed in any::<bool>(),
        creep in (1.0..100.0f64, 0.0..60.0f64),
        end in (0..3u8, 0.0..50.0f64),
        lag_mm in 0.0..20.0f64,
    ) {
        prop_assume!(ways.iter().all(|way| way.0.hypot(way.1) > 0.1));
        let (off_before, over_cut) = match end { (1, mm) => (mm, 0.0), (2, mm) => (0.0, mm), _ => (0.0, 0.0) };
        assert_ends(&ways, is_closed, [creep.0, creep.1, off_before, over_cut], if end.0 == 0 { lag_mm } else { 0.0 });
    }
}

/// A jet that goes off before the end takes its abrasive with it, whatever its lag; moves without a length, of which a
/// program may have any number, are not kept.
#[test]
fn a_tail_is_that_of_the_cutter_and_is_bounded() {
    let text = "G21 F3000\nM3\nG1 X50\nM5\n";
    let shaped = cuts(&run_with(text, machine([0.0, 0.0, 3.0, 0.0], 10.0)).0);
    assert!((total(&shaped, |cut| !cut.lit) - 3.0).abs() < 1e-9, "{shaped:?}");
    let mut text = String::from("G21 F3000\nM3\nG1 X50\n");
    (0..25_000).for_each(|_| text += "X50\n");
    let (plain, shaped) = ([0.0; 4], [0.0, 0.0, 3.0, 0.0]);
    let of = |figures| cuts(&run_with(&format!("{text}M5\n"), machine(figures, 0.0)).0);
    assert!((total(&of(plain), |_| true) - total(&of(shaped), |_| true)).abs() < 1e-9);
}

/// A wiggle goes to and fro along the first move, a circle about its beginning, both at the feed rate of the pierce, as
/// do the first millimetres; then comes the creep.
#[test]
fn a_pierce_in_motion_ends_where_it_began() {
    const PIERCE: f64 = 500.0;
    for (text, first) in [("G21 F3000\nM3\nG1 X10\nY10\nM5\n", 10.0), ("G20 F118.110236\nM3\nG2 X1 I0.5\nM5\n", 39.9)] {
        let material = Material {
            pierce_feed_mm_per_min: PIERCE,
            pierce_mm: 2.0,
            creep_percent: 50.0,
            creep_mm: 6.0,
            wiggle_mm: 3.0,
            wiggles: 2.0,
            circle_mm: 1.5,
            circles: 3.0,
            ..Material::default()
        };
        let unit = if text.starts_with("G20") { 25.4 } else { 1.0 };
        let shaped = cuts(&run_with(text, machine_with(material, 0.0)).0);
        let plain = cuts(&run_with(text, machine([0.0; 4], 0.0)).0);
        let excursions = 2.0 * 2.0 * 3.0 + 2.0 * 1.5 + 3.0 * TAU * 1.5;
        let mm = |of: &[Cut], rate: f64| total(of, |cut| (cut.rate * unit - rate).abs() < 0.01) * unit;
        assert!((mm(&shaped, PIERCE) - excursions - 2.0).abs() < 1e-6, "{shaped:?}");
        assert!((mm(&shaped, FEED / 2.0) - 4.0).abs() < 1e-6 && first > 6.0, "{shaped:?}");
        let whole = total(&plain, |_| true) * unit;
        assert!((total(&shaped, |_| true) * unit - whole - excursions).abs() < 1e-6, "{shaped:?}");
        // both excursions end at the pierce
        let at_pierce = shaped.iter().filter(|cut| cut.end == Pose::ZERO).count();
        assert_eq!(at_pierce, 3, "{shaped:?}");
    }
}

/// The over cut follows the beginning of the contour, and the next arc begins where the program believes to be.
#[test]
fn an_over_cut_follows_the_beginning_of_the_contour() {
    let text = "G21 F3000\nM3\nG1 X10\nY10\nX0\nY0\nM5\nM3\nG2 X0 Y0 I5\nM5\n";
    let shaped = cuts(&run_with(text, machine([0.0, 0.0, 0.0, 12.5], 0.0)).0);
    let dark: Vec<(f64, f64)> =
        shaped.iter().filter(|cut| !cut.lit).map(|cut| (cut.end[Axis::X], cut.end[Axis::Y])).collect();
    assert_eq!(dark[..2], [(10.0, 0.0), (10.0, 2.5)]);
    assert!(shaped.iter().any(|cut| cut.end == Pose::ZERO && cut.lit && cut.mm > 30.0), "{shaped:?}");
}

/// A stop or a dwell within the contour is no end of it, and nothing is left out where a program ends in a contour.
#[test]
fn nothing_is_held_back_where_the_program_stops() {
    for end in ["M5", "M2", "M0\nG1 X20\nM5", "G4 P1\nG1 X20\nM5", "G54\nG1 X20\nM5"] {
        let text = format!("G21 F3000\nM3\nG1 X4\nX8\n{end}\n");
        let shaped = cuts(&run_with(&text, machine([50.0, 2.0, 3.0, 0.0], 0.0)).0);
        let plain = cuts(&run_with(&text, machine([0.0; 4], 0.0)).0);
        assert!((total(&shaped, |_| true) - total(&plain, |_| true)).abs() < 1e-9, "{end}");
        let off = if end == "M2" { 0.0 } else { 3.0 };
        assert!((total(&shaped, |cut| !cut.lit) - off).abs() < 1e-9, "{end}: {shaped:?}");
    }
}
