//! What programs say to a machine with a material table (CUT-24).

use proptest::prelude::*;
use retrace_gcode::{
    Canon, CanonStep, CuttingSetup, CuttingSwitch, CuttingTool, Diagnostic, Material, MaterialList, Pose, Program,
    Progress, Setup, Tool, ToolTable,
};
use std::sync::Arc;

/// A torch ($0) and a scribe ($1), materials 0, 3 and 4, of which 3 is the default.
pub(crate) fn setup() -> Setup {
    let material = |number: u32, feed_mm_per_min: f64| Material {
        number,
        feed_mm_per_min,
        kerf_mm: 1.5,
        pierce_height_mm: 3.8,
        cut_height_mm: 1.5,
        pierce_delay_s: 0.25,
        ..Material::default()
    };
    let tools = [0, 1].map(|spindle| CuttingTool { spindle, cuts: spindle == 0, ..CuttingTool::default() });
    let mut table = ToolTable::default();
    for number in [0, 1] {
        table.insert(Tool { number, offset: Pose::ZERO, ..Tool::default() });
    }
    Setup {
        tools: table,
        cutting: Some(Arc::new(CuttingSetup {
            materials: Arc::new(MaterialList::new([material(3, 3000.0), material(0, 2000.0), material(4, 2540.0)], 3)),
            tools: tools.into(),
            float_travel_mm: 1.27,
            ignores_z: true,
        })),
        ..Setup::default()
    }
}

/// Steps and diagnostics of a program; M2 is added.
pub(crate) fn run_with(text: &str, setup: Setup) -> (Vec<Canon>, Vec<Diagnostic>) {
    let text = format!("{text}\nM2\n");
    let mut program = Program::new(text.as_bytes(), setup);
    let mut steps: Vec<CanonStep> = Vec::new();
    while program.advance(&mut steps) != Progress::End {}
    let found = program.interpreter().diagnostics().to_vec();
    (steps.into_iter().map(|step| step.canon).collect(), found)
}

fn run(text: &str) -> (Vec<Canon>, Vec<Diagnostic>) {
    run_with(text, setup())
}

/// Steps of a program without diagnostics.
fn steps(text: &str) -> Vec<Canon> {
    let (steps, found) = run(text);
    assert!(found.is_empty(), "{text}: {found:?}");
    steps
}

/// The only diagnostic of a program: its number and message.
fn refusal(text: &str) -> String {
    let (_, found) = run(text);
    let [only] = &found[..] else { panic!("{text}: {found:?}") };
    format!("{}: {}", only.code.number(), only.message)
}

fn feeds(steps: &[Canon]) -> Vec<f64> {
    let feeds = steps.iter().filter_map(|canon| if let Canon::SetFeedRate(rate) = canon { Some(*rate) } else { None });
    feeds.collect()
}

fn materials(steps: &[Canon]) -> Vec<u32> {
    let of = |canon: &Canon| if let Canon::SelectMaterial(material) = canon { Some(material.number) } else { None };
    steps.iter().filter_map(of).collect()
}

fn has(steps: &[Canon], wanted: &Canon) -> bool {
    steps.contains(wanted)
}

#[test]
fn the_default_material_is_selected_at_the_beginning_and_m190_selects_others() {
    assert_eq!(materials(&steps("G21")), [3]);
    assert_eq!(materials(&steps("M190 P4\nM66 P3 L3 Q1\nM190 P-1\nM190 P[2+2]\nM190 P0")), [3, 4, 3, 4, 0]);
    assert!(refusal("M190 P7").starts_with("E1733: there is no material 7; the table has 0, 3, 4"));
    assert!(refusal("M190").starts_with("E1505"));
    assert!(refusal("M190 P-2").starts_with("E1733"));
}

#[test]
fn the_wait_for_a_material_goes_on_at_once_and_other_waits_stay() {
    let waits = |text| steps(text).iter().filter(|canon| matches!(canon, Canon::Wait(_))).count();
    assert_eq!(waits("M190 P4\nM66 P3 L3 Q1"), 0);
    assert_eq!([waits("M66 P3 L3 Q1"), waits("M190 P4\nM66 P2 L3 Q1"), waits("M190 P4\nM66 P3 L4 Q1")], [1; 3]);
    // The wait has succeeded.
    assert!(feeds(&steps("M190 P4\nM66 P3 L3 Q1\nG0 X#5399\nG1 X2 F[2540*#5399]")).contains(&2540.0));
}

#[test]
fn values_of_the_plasma_controller_are_in_the_units_of_the_program() {
    assert!(feeds(&steps("F#<_hal[plasmac.cut-feed-rate]>")).contains(&3000.0));
    assert!(feeds(&steps("G20\nM190 P4\nF#<_hal[plasmac.cut-feed-rate]>")).contains(&100.0));
    let ends = steps("G0 X#<_HAL[plasmac.float-switch-travel]> Y#<_hal[plasmac.kerf-width]>");
    assert!(has(&ends, &Canon::StraightTraverse(Pose::xyz(1.27, 1.5, 0.0))));
    assert!(refusal("F#<_hal[plasmac.cut-feed-rat]>").contains("did you mean #<_hal[plasmac.cut-feed-rate]>?"));
    let unknown = refusal("F#<_hal[spindle.0.at-speed]>");
    assert!(unknown.starts_with("E1302") && unknown.contains("known are plasmac.cut-feed-rate,"), "{unknown}");
}

#[test]
fn a_feed_rate_that_is_not_the_materials_is_a_warning() {
    assert!(refusal("F2500").starts_with("W1005: F is 2500; the feed rate of material 3 is 3000.000"));
    assert!(steps("F3000.9\nF2999.1").len() > 2);
    assert!(refusal("G20\nF119.2").starts_with("W1005") && steps("G20\nF119").len() > 2);
}

#[test]
fn the_number_behind_the_dollar_selects_the_cutter() {
    let all = steps("M3 $0 S1\nG1 X1 F3000\nM5 $0\nM3 $1 S1\nM5 $1\nM4 $1\nM5 $-1\nM3\nM5");
    let switched: Vec<String> = all
        .iter()
        .filter_map(|canon| match canon {
            Canon::StartSpindleClockwise(n) => Some(format!("3 {n}")),
            Canon::StartSpindleCounterclockwise(n) => Some(format!("4 {n}")),
            Canon::StopSpindleTurning(n) => Some(format!("5 {n}")),
            _ => None,
        })
        .collect();
    assert_eq!(switched, ["3 0", "5 0", "3 1", "5 1", "4 1", "5 0", "5 1", "3 0", "5 0", "5 0"]);
    assert!(!all.iter().any(|canon| matches!(canon, Canon::SetSpindleSpeed(_))), "S of a torch is no speed");
    assert!(refusal("M3 $-1 S1").starts_with("E1630"));
    // A cutter that the program forgets is off at its end.
    assert!(has(&steps("M3 $1"), &Canon::StopSpindleTurning(1)));
}

#[test]
fn comments_declare_materials() {
    let all =
        steps("(o=0, na=Steel 3mm \"new\", ph=3.1, pd=0.1, ch=1.1, fr=3001, kw=1.1)\nF#<_hal[plasmac.cut-feed-rate]>");
    assert_eq!((materials(&all), feeds(&all)[0]), (vec![3, 1_000_000], 3001.0));
    let Some(Canon::SelectMaterial(last)) = all.iter().rev().find(|canon| matches!(canon, Canon::SelectMaterial(_)))
    else {
        panic!("none");
    };
    assert_eq!((last.name.as_str(), last.pierce_height_mm, last.kerf_mm), ("Steel 3mm \"new\"", 3.1, 1.1));
    let inch = steps("G20\nN40 (o=0, ph=0.1, pd=0.1, ch=0.05, fr=100)\nF#<_hal[plasmac.cut-feed-rate]>");
    assert!(feeds(&inch).contains(&100.0), "{inch:?}");
    assert!(inch.iter().any(|canon| matches!(canon, Canon::SelectMaterial(of) if of.cut_height_mm == 0.05 * 25.4)));
    // o=1 and o=2 add to the list of this program.
    let new = "nu=9, na=x, ph=3, pd=0.1, ch=1, fr=900";
    assert_eq!(materials(&steps(&format!("(o=1, {new})\n(o=1, {new})\nM190 P9"))), [3, 9]);
    assert_eq!(materials(&steps(&format!("(o=2, {})\nM190 P3", new.replace('9', "3")))), [3, 3]);
    assert!(refusal(&format!("(o=1, {})", new.replace("nu=9", "nu=4"))).contains("material 4 exists"));
    for (text, found) in [
        ("(o=3, ph=1, pd=1, ch=1, fr=100)", "o=3 is not known"),
        ("(o=0, ph=1, pd=1, ch=1)", "fr is missing"),
        ("(o=0, ph=1, pd=1, ch=1, fr=100, kv=1)", "kv is not known; did you mean"),
        ("(o=0, ph=1, ph=1, pd=1, ch=1, fr=100)", "ph is there twice"),
        ("(o=0, ph=high, pd=1, ch=1, fr=100)", "ph=high: a number"),
        ("(o=0, ph=1, pd=61, ch=1, fr=100)", "pd=61: a number from 0"),
        ("(o=0, ph=1, pd=1, ch=1, fr=100, thick)", "`thick` is not an item"),
        ("(o=1, ph=1, pd=1, ch=1, fr=100)", "nu, the number of the material, is missing"),
        ("(o=1, nu=1000000, ph=1, pd=1, ch=1, fr=100)", "nu=1000000"),
    ] {
        let refused = refusal(text);
        assert!(refused.starts_with("E1734") && refused.contains(found), "{refused} for {text}");
    }
    // These are comments like any other.
    assert_eq!(materials(&steps("(o=x)\n(only, ph=1)\n(offset o=0, ph=1)")), [3]);
    assert_eq!(materials(&steps("#<tube-cut> = 1\n(o=0, pd=0.5)")), [3, 1_000_000]);
}

#[test]
fn outputs_1_to_3_are_those_of_qtplasmac_and_the_others_stay() {
    use CuttingSwitch::{Cutter, HeightControl, IgnoreArcOk};
    let all = steps("M64 P1\nM65 P1\nM62 P2\nM63 P2\nM62 P3\nM65 P3\nM64 P4\nM62 P0");
    let switched: Vec<(CuttingSwitch, bool)> = all
        .iter()
        .filter_map(|canon| if let Canon::SetCutting(of, on) = canon { Some((*of, *on)) } else { None })
        .collect();
    assert_eq!(
        switched,
        [
            (IgnoreArcOk, true),
            (IgnoreArcOk, false),
            (HeightControl, false),
            (HeightControl, true),
            (Cutter, false),
            (Cutter, true)
        ]
    );
    assert!(has(&all, &Canon::SetAuxOutputBit(4)) && has(&all, &Canon::SetMotionOutputBit(0)));
    // What a program leaves forbidden is allowed at its end.
    assert!(has(&steps("M64 P3"), &Canon::SetCutting(Cutter, true)));
}

#[test]
fn what_a_program_ignores_is_watched_at_its_end() {
    let (all, found) = run("M62 P1\nM2");
    assert!(found.is_empty(), "{found:?}");
    assert!(has(&all, &Canon::SetCutting(CuttingSwitch::IgnoreArcOk, true)));
    assert!(has(&all, &Canon::SetCutting(CuttingSwitch::IgnoreArcOk, false)));
    assert!(!has(&steps("M62 P1\nM63 P1"), &Canon::SetAuxOutputBit(1)));
}

#[test]
fn the_spotting_torch_is_refused_by_its_name() {
    assert!(refusal("M3 $2 S1").starts_with("E1735: $2 marks points with the torch"));
    assert!(refusal("M5 $2").starts_with("E1735"));
    assert!(refusal("M3 $3 S1").contains("there is no spindle 3; the cutters of this machine are $0, $1"));
}

/// M159 changes the material in force and those that are selected later, until P609 resets it.
#[test]
fn m159_sets_the_figures_of_pierces_in_motion() {
    let material_after = |text: &str| {
        let (all, found) = run(text);
        assert!(found.is_empty(), "{found:?}");
        let of = |canon: &Canon| match canon {
            Canon::SelectMaterial(material) => Some(Arc::clone(material)),
            _ => None,
        };
        all.iter().rev().find_map(of).expect("a material")
    };
    let ramp = "m159 p601 q2\nm159 p602 q50\nm159 p603 q[5/2]\nm159 p604 q1\nm159 p605 q980\nm159 p606 q5\n\
        m159 p607 q245\nm159 p608 q3\n";
    let inches = format!("G20\n{}", ramp.replace("[5/2]", "0.1").replace("q5\n", "q0.2\n").replace("q3\n", "q0.1\n"));
    for declaration in ["", "(o=0, ph=4, pd=1, ch=1.5, fr=490)\n"] {
        let of = material_after(&format!("{ramp}{declaration}"));
        assert_eq!(
            (of.pierces_in_motion, of.ramp_height_mm, of.ramp_delay_percent, of.ramp_hold_s),
            (true, 2.5, 50.0, 1.0)
        );
        assert_eq!((of.pierce_mm, of.pierce_feed_mm_per_min), (5.0, 980.0));
        assert_eq!((of.creep_mm, of.creep_feed_mm_per_min), (8.0, 245.0), "the creep begins behind the gouge");
        for reset in ["m159 p609", "M159 P609 Q0.5"] {
            let of = material_after(&format!("{ramp}{declaration}{reset}\n"));
            assert_eq!((of.pierces_in_motion, of.ramp_height_mm, of.pierce_mm, of.creep_mm), (false, 0.0, 0.0, 0.0));
        }
        let of = material_after(&format!("{ramp}m159 p601 q1\n{declaration}"));
        assert_eq!((of.pierces_in_motion, of.ramp_height_mm, of.pierce_mm, of.creep_mm), (true, 0.0, 0.0, 0.0));
    }
    let of = material_after(&inches);
    assert_eq!((of.ramp_height_mm, of.pierce_mm, of.creep_feed_mm_per_min), (2.54, 0.2 * 25.4, 245.0 * 25.4));
    assert!(has(&run(ramp).0, &Canon::SetPierceValue { number: 603, value: 2.5 }));
    assert!(refusal("M159 P610 Q1").starts_with("E1511"));
    assert!(refusal("M159 P601").starts_with("E1505"));
    for bad in ["P601 Q3", "P601 Q0.5", "P602 Q101", "P603 Q-1", "P604 Q61", "P605 Q-1", "P608 Q1000"] {
        assert!(refusal(&format!("M159 {bad}")).starts_with("E1736"), "{bad}");
    }
}

#[test]
fn z_words_have_no_effect_where_the_cycle_rules_the_height() {
    let (all, found) = run("M3\nG0 Z5\nG1 X1 Z-3 F3000\nG2 X3 I1 Z2\nI1 Z4\nG1 Z1");
    assert_eq!(found.iter().map(|one| one.code.number()).collect::<Vec<_>>(), ["W1006"], "once for all of them");
    let moves: Vec<&Canon> = all
        .iter()
        .filter(|canon| matches!(canon, Canon::StraightTraverse(_) | Canon::StraightFeed(_) | Canon::ArcFeed(_)))
        .collect();
    let [Canon::StraightFeed(first), Canon::ArcFeed(arc), Canon::ArcFeed(second)] = moves[..] else {
        panic!("{moves:?}")
    };
    assert_eq!(
        (*first, arc.end, second.end),
        (Pose::xyz(1.0, 0.0, 0.0), Pose::xyz(3.0, 0.0, 0.0), Pose::xyz(3.0, 0.0, 0.0))
    );
    // A place of the machine, and what a program insists on, is meant.
    assert!(has(&steps("G53 G0 Z5"), &Canon::StraightTraverse(Pose::xyz(0.0, 0.0, 5.0))));
    for name in ["keep-z-motion", "tube-cut", "tube_cut"] {
        assert!(has(&steps(&format!("#<{name}> = 1\nG0 Z5")), &Canon::StraightTraverse(Pose::xyz(0.0, 0.0, 5.0))));
    }
}

proptest! {
    /// The share acts on every feed rate, before and after it, and ends at 100 % and at the end of the program.
    #[test]
    fn m67_and_m68_set_a_share_of_the_feed_rate(share in -50.0_f64..150.0, is_immediate in any::<bool>()) {
        let code = if is_immediate { 68 } else { 67 };
        let (all, found) = run(&format!("F3000\nM{code} E3 Q{share:.3}\nG1 X1\nF3000\nM67 E3 Q0\nG1 X2"));
        let written: f64 = format!("{share:.3}").parse().expect("a number");
        let is_share = written > 0.0 && written < 100.0;
        let slow = if is_share { 3000.0 * written / 100.0 } else { 3000.0 };
        prop_assert_eq!(feeds(&all), [3000.0, slow, slow, 3000.0, 0.0]);
        let numbers: Vec<&str> = found.iter().map(|one| one.code.number()).collect();
        let is_small = is_share && written < 10.0;
        prop_assert_eq!(numbers, if is_small { vec!["W1007"] } else { Vec::new() });
    }

    /// Without a material table every one of these words means what it means in LinuxCNC.
    #[test]
    fn a_machine_without_materials_reads_as_before(word in prop::sample::select(vec![
        "M190 P1", "M159 P601 Q1", "M3 $1 S1", "F#<_hal[plasmac.cut-feed-rate]>", "M62 P3", "M65 P1", "M67 E3 Q50",
        "(o=0, ph=1)", "(o=3)", "#<holes> = 4", "M66 P3 L3 Q1", "G0 Z5", "M5 $-1",
    ])) {
        let (all, found) = run_with(&format!("F100\n{word}\nG0 X1"), Setup::default());
        let own = |canon: &Canon| {
            matches!(canon, Canon::SelectMaterial(_) | Canon::SetCutting(..) | Canon::SetPierceValue { .. })
        };
        prop_assert!(!all.iter().any(own));
        let numbers: Vec<&str> = found.iter().map(|one| one.code.number()).collect();
        let wanted: &[&str] = match word {
            "M190 P1" | "M159 P601 Q1" => &["E1724"],
            "M3 $1 S1" => &["E1630"],
            "F#<_hal[plasmac.cut-feed-rate]>" => &["E1302"],
            _ => &[],
        };
        prop_assert_eq!(numbers, wanted);
    }
}

#[test]
fn a_program_that_only_pierces_has_no_feed_moves_while_it_cuts() {
    let body = "F3000\nG0 X10\nM3\nG1 X20\nG3 X30 I5\nM5\nG0 X50\nM3 $1\nG1 X60\nM5 $1\nG0 X5";
    let moves = |text: &str| {
        let all = steps(text);
        let of = |canon: &Canon| match canon {
            Canon::StraightTraverse(end) => Some(("G0", end.0[0])),
            Canon::StraightFeed(end) => Some(("G1", end.0[0])),
            Canon::ArcFeed(arc) => Some(("G3", arc.end.0[0])),
            _ => None,
        };
        all.iter().filter_map(of).collect::<Vec<_>>()
    };
    assert_eq!(moves(&format!("#<pierce-only> = 1\n{body}")), [("G0", 10.0), ("G0", 50.0), ("G1", 60.0), ("G0", 5.0)]);
    assert_eq!(moves(body).len(), 6);
    // Under cutter compensation, moves wait for the next one.
    let compensated = "#<pierce-only> = 1\nF3000\nG0 X10\nM3\nG41.1 D2\nG1 X20\nX30 Y10\nG40\nG1 X40\nM5\nG0 X5";
    assert_eq!(moves(compensated), [("G0", 10.0), ("G0", 5.0)]);
}

/// End and turns of each arc.
fn arcs(steps: &[Canon]) -> Vec<(f64, f64, i32)> {
    let of = |canon: &Canon| match canon {
        Canon::ArcFeed(arc) => Some((arc.end.0[0], arc.end.0[1], arc.turns)),
        _ => None,
    };
    steps.iter().filter_map(of).collect()
}

#[test]
fn small_holes_are_slow_and_over_cut_whatever_they_are_written_with() {
    let hole = "G21 F3000\nG0 X10\nM3\nG1 X16\nG3 I-6\nM5\nG0 X0";
    let slow = [3000.0, 1800.0, 3000.0, 0.0];
    assert_eq!(feeds(&steps(hole)), [3000.0, 0.0], "without #<holes>");
    assert_eq!(feeds(&steps(&format!("#<holes> = 1\n{hole}"))), slow);
    assert_eq!(feeds(&steps(&format!("#<holes> = 1\n#<h_velocity> = 40\n{hole}")))[1], 1200.0);
    assert_eq!(feeds(&steps(&format!("#<holes> = 1\n#<h_diameter> = 11.9\n{hole}"))), [3000.0, 0.0]);
    assert_eq!(
        feeds(&steps(&format!("#<holes> = 1\n{hole}").replace("M3\n", "M3 $1\n").replace("M5", "M5 $1"))).len(),
        2
    );
    // From a loop with expressions in a subprogram, clockwise, and in inches.
    let sub = "o1 sub\nG1 X[10+#1] Y0\no2 repeat [1]\nG2 X[#5420] Y0 I[0-#1]\no2 endrepeat\no1 endsub\n";
    let body = "G0 X10\nM3\no1 call [6]\nM5\nG0 X0";
    assert_eq!(feeds(&steps(&format!("{sub}#<holes> = 2\nF3000\n{body}"))), slow);
    let inch = "G20\n#<holes> = 1\n#<h_diameter> = 0.5\nF#<_hal[plasmac.cut-feed-rate]>\nM3\nG3 I0.2\nG3 I0.3\nM5";
    assert_eq!(feeds(&steps(inch)).len(), 4, "one of two is small enough");
    // Arcs that do not close only with 3 and 4; a great arc never.
    let arc = "F3000\nM3\nG1 X16\nG3 X4 I-6\nG3 X60 I28\nM5";
    assert_eq!(feeds(&steps(&format!("#<holes> = 2\n{arc}"))), [3000.0, 0.0]);
    assert_eq!(feeds(&steps(&format!("#<holes> = 3\n{arc}"))), slow);

    let over = steps(&format!("#<holes> = 2\n{hole}"));
    let angle: f64 = 4.0 / 6.0;
    let [whole, tail] = arcs(&over)[..] else { panic!("{over:?}") };
    assert_eq!(whole, (16.0, 0.0, 1));
    assert!(
        (tail.0 - (10.0 + 6.0 * angle.cos())).abs() < 1e-9 && (tail.1 - 6.0 * angle.sin()).abs() < 1e-9 && tail.2 == 1
    );
    let order: Vec<String> = over
        .iter()
        .filter_map(|canon| match canon {
            Canon::SetCutting(CuttingSwitch::Cutter, on) => Some(format!("allowed {on}")),
            Canon::ArcFeed(_) => Some("arc".into()),
            Canon::StartSpindleClockwise(_) => Some("on".into()),
            Canon::StopSpindleTurning(_) => Some("off".into()),
            _ => None,
        })
        .collect();
    assert_eq!(order, ["on", "arc", "allowed false", "arc", "off", "allowed true", "off"]);
    let long = steps(&format!("#<holes> = 2\n#<oclength> = 6\n{hole}"));
    assert!((arcs(&long)[1].0 - (10.0 + 6.0 * 1.0_f64.cos())).abs() < 1e-9);
    let clockwise = steps(&format!("#<holes> = 2\n{}", hole.replace("G3", "G2")));
    let tail = arcs(&clockwise)[1];
    assert!((tail.1 + 6.0 * angle.sin()).abs() < 1e-9 && tail.2 == -1, "{tail:?}");
    // The program continues from the end of its own circle.
    let next = steps(&format!("#<holes> = 2\n{}", hole.replace("M5\nG0 X0", "G3 X22 I3\nG91 G1 X1\nM5")));
    let back = next.iter().filter(|canon| **canon == Canon::StraightFeed(Pose::xyz(16.0, 0.0, 0.0))).count();
    assert_eq!(back, 2, "to the hole, and back to its end before an arc: {next:?}");
    assert!(has(&next, &Canon::StraightFeed(Pose::xyz(23.0, 0.0, 0.0))));
}

/// Many programs write a circle as two or four arcs. It is known to be a hole only where it closes.
#[test]
fn a_hole_of_several_arcs_is_over_cut_where_it_closes() {
    let over_cuts = |mode: u8, body: &str| {
        let all = steps(&format!("#<holes> = {mode}\nF3000\nG0 X10\nM3\nG1 X16\n{body}\nM5\nG0 X0"));
        let order: String = all
            .iter()
            .filter_map(|canon| match canon {
                Canon::SetCutting(CuttingSwitch::Cutter, false) => Some('o'),
                Canon::ArcFeed(_) => Some('a'),
                _ => None,
            })
            .collect();
        (order, feeds(&all), arcs(&all).last().copied().expect("an arc"))
    };
    let halves = "G3 X4 I-6\nG3 X16 I6";
    let (order, rates, tail) = over_cuts(2, halves);
    assert_eq!((order.as_str(), rates), ("aaoa", vec![3000.0, 0.0]));
    let angle: f64 = 4.0 / 6.0;
    assert!(
        (tail.0 - (10.0 + 6.0 * angle.cos())).abs() < 1e-9 && (tail.1 - 6.0 * angle.sin()).abs() < 1e-9,
        "{tail:?}"
    );
    let (order, rates, _) = over_cuts(4, halves);
    assert_eq!((order.as_str(), rates), ("aaoa", vec![3000.0, 1800.0, 3000.0, 1800.0, 3000.0, 0.0]));
    // Rounded coordinates, clockwise, and four of them.
    let quarters = "G2 X10.0004 Y-6 I-6\nG2 X4 Y0.0003 I-0.0004 J6\nG2 X10 Y6 I6\nG2 X16 Y0 I0 J-6";
    assert_eq!(over_cuts(2, quarters).0, "aaaaoa");
    for body in [
        "G3 X4 I-6\nG1 X4 Y0\nG3 X16 I6",
        "G3 X4 I-6\nG3 X18 I7",
        "G3 X4 I-6\nG2 X16 I6",
        "G3 X4 I-6",
        "G3 X10 Y6 I-6\nG3 X4 Y0 J-6\nG3 X10 Y-6 I6",
    ] {
        assert!(!over_cuts(2, body).0.contains('o'), "{body}");
    }
    assert!(!over_cuts(1, halves).0.contains('o') && !over_cuts(0, halves).0.contains('o'));
}

/// Under compensation the path of the tool decides what is small: a hole of 34 mm is cut along a circle of 31 mm.
#[test]
fn holes_under_cutter_compensation_are_slow() {
    let rates = |mode: u8, code: &str, radius: f64, tool: f64| {
        let text = format!(
            "#<holes> = {mode}\nF3000\nG0 X100 Y100\nM3\n{code} D{tool}\nG1 X[100+{radius}] Y100\n\
                G3 I[0-{radius}]\nG40\nG1 X100 Y100\nM5"
        );
        let all = steps(&text);
        assert!(!all.contains(&Canon::SetCutting(CuttingSwitch::Cutter, false)), "no over cut");
        feeds(&all)
    };
    let slow = [3000.0, 1800.0, 3000.0, 0.0];
    assert_eq!(rates(1, "G41.1", 17.0, 3.0), slow);
    assert_eq!(rates(2, "G41.1", 17.0, 3.0), slow);
    assert_eq!(rates(0, "G41.1", 17.0, 3.0), [3000.0, 0.0]);
    assert_eq!(rates(1, "G41.1", 18.0, 3.0), [3000.0, 0.0], "33 mm");
    assert_eq!(rates(1, "G42.1", 15.0, 3.0), [3000.0, 0.0], "the tool is outside, at 33 mm");
}

#[test]
fn a_cutter_that_went_off_in_passing_is_allowed_behind_m5() {
    use CuttingSwitch::Cutter;
    let order = |text: &str| {
        let all = steps(text);
        let of = |canon: &Canon| match canon {
            Canon::SetCutting(Cutter, on) => Some(if *on { "allowed" } else { "forbidden" }),
            Canon::StopSpindleTurning(_) => Some("off"),
            _ => None,
        };
        all.iter().filter_map(of).collect::<Vec<&str>>().join(" ")
    };
    assert_eq!(order("M3\nG1 X1 F3000\nM62 P3\nG1 X2\nM5\nM3\nM5"), "forbidden off allowed off off");
    assert_eq!(order("M3\nG1 X1 F3000\nM62 P3\nG1 X2\nM63 P3\nM5\nM3\nM5"), "forbidden allowed off off off");
    // Forbidden while it was off, it stays so: a program that shows its path.
    assert_eq!(order("M64 P3\nM3\nG1 X1 F3000\nM5\nM3\nM5"), "forbidden off off off allowed");
}

proptest! {
    /// With over cuts or without, the program goes to the same places: the moves that are not over cuts are the same.
    #[test]
    fn an_over_cut_changes_no_other_move(
        holes in prop::collection::vec((-50.0_f64..50.0, 1.0_f64..20.0, any::<bool>(), 0_u8..3), 1..6),
    ) {
        let mut text = String::from("F3000\n");
        for (x, radius, clockwise, next) in &holes {
            let turn = if *clockwise { 2 } else { 3 };
            text += &format!("G0 X{x:.3} Y0\nM3\nG1 X{:.3}\nG{turn} I{:.3}\n", x + radius, -radius);
            text += match next {
                0 => "M5\n",
                1 => "G1 Y3\nM5\n",
                _ => "G3 Y4 J2\nM5\n",
            };
        }
        let plain = steps(&text);
        let over = steps(&format!("#<holes> = 2\n{text}"));
        let ends = |steps: &[Canon]| {
            let mut ends = Vec::new();
            let mut is_forbidden = false;
            for canon in steps {
                match canon {
                    Canon::SetCutting(CuttingSwitch::Cutter, on) => is_forbidden = !on,
                    Canon::StraightTraverse(end) => ends.push((*end, 0)),
                    Canon::StraightFeed(end) if !is_forbidden => ends.push((*end, 1)),
                    Canon::ArcFeed(arc) if !is_forbidden => ends.push((arc.end, 2)),
                    _ => {}
                }
            }
            ends
        };
        // What follows an over cut before M5 is not cut, so it is no part of the comparison.
        let cut: Vec<_> = ends(&over);
        let all = ends(&plain);
        prop_assert!(cut.iter().all(|end| all.contains(end)), "{:?} {:?}", cut, all);
        let is_small = |radius: &f64| 2.0 * radius <= 32.0;
        let small = holes.iter().filter(|(_, radius, _, _)| is_small(&((radius * 1e3).round() / 1e3))).count();
        let is_over_cut = |canon: &&Canon| matches!(canon, Canon::SetCutting(CuttingSwitch::Cutter, false));
        let overs = over.iter().filter(is_over_cut).count();
        prop_assert_eq!(overs, small);
    }
}
