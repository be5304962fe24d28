//! Drilling cycles, threads and the spindle: the expected calls are calculated manually from LinuxCNC's manual.
//!
//! Invariant: a move is written as its kind (T rapid, F at the feed) and its end along X Y Z.

use crate::common;

use common::canon_text;
use retrace_gcode::{Canon, Program, Setup, check};

/// Returns the moves of a program from X0 Y0 Z0 with F100, as `T1 2 3`; dwells, stops and starts of the spindle by
/// name.
fn moves(program: &str) -> String {
    let text = format!("F100\n{program}\nM2\n");
    let steps = Program::new(text.as_bytes(), Setup::rs274()).into_iter();
    let ends = steps.take_while(
        |step| !matches!(step.canon, Canon::SetG5xOffset { .. } if step.line as usize > 1 + program.lines().count()),
    );
    let names = ends.filter_map(|step| {
        Some(match step.canon {
            Canon::StraightTraverse(end) => format!("T{} {} {}", end.0[0], end.0[1], end.0[2]),
            Canon::StraightFeed(end) => format!("F{} {} {}", end.0[0], end.0[1], end.0[2]),
            Canon::RigidTap { end: [x, y, z], .. } => format!("tap {x} {y} {z}"),
            Canon::Dwell(seconds) => format!("dwell {seconds}"),
            Canon::StartSpindleClockwise(_) => "cw".to_owned(),
            Canon::StartSpindleCounterclockwise(_) => "ccw".to_owned(),
            Canon::StopSpindleTurning(_) => "stop".to_owned(),
            Canon::ProgramStop => "pause".to_owned(),
            Canon::OrientSpindle { degrees, mode, .. } => format!("orient {degrees} {mode}"),
            Canon::StartSpeedFeedSynch { pitch, .. } => format!("pitch {pitch}"),
            _ => return None,
        })
    });
    names.collect::<Vec<_>>().join(", ")
}

/// Returns the numbers of the errors of a program, after F100.
fn errors(program: &str) -> Vec<&'static str> {
    let text = format!("F100\n{program}\nM2\n");
    let found = check(text.as_bytes(), Setup::rs274());
    found.iter().map(|found| found.number()).filter(|number| number.starts_with('E')).collect()
}

/// Returns the holes of a program: the ends of its feed moves in the plane, with three decimals.
fn holes(program: &str) -> Vec<String> {
    let text = format!("F100 G90 G0 Z2\n{program}\nM2\n");
    let steps = Program::new(text.as_bytes(), Setup::rs274()).into_iter();
    let ends = steps.filter_map(|step| if let Canon::StraightFeed(end) = step.canon { Some(end.0) } else { None });
    let mut found: Vec<_> = ends.map(|[x, y, ..]| format!("{:.3} {:.3}", x + 0.0, y + 0.0)).collect();
    found.dedup();
    found
}

#[test]
fn polar_words_say_where_the_holes_of_a_cycle_are() {
    let six = ["0.750 1.299", "-0.750 1.299", "-1.500 0.000", "-0.750 -1.299", "0.750 -1.299", "1.500 -0.000"];
    for cycle in ["G81", "G82 P1", "G83 Q.3", "G73 Q.3", "G85", "G86 P0", "G88 P0", "G89 P0"] {
        let program = format!("M3 S10 G20 G0 X1.5\nG91 {cycle} R.1 Z-.5 ^60 L6");
        assert_eq!(holes(&program), six, "{cycle}");
    }
    assert_eq!(holes("M4 S10 G20 G0 X1.5\nG91 G74 R.1 Z-.5 ^60 L6"), six);
    // The next block of the series, and one with X and Y again.
    assert_eq!(
        holes("G0 X1.5\nG81 R.1 Z-.5 ^120\n@2 ^90\n@3\nX1 Y1\n^0"),
        ["-0.750 1.299", "0.000 2.000", "0.000 3.000", "1.000 1.000", "1.414 0.000"]
    );
    // G91: farther first, then rotated.
    assert_eq!(holes("G0 X1\nG91 G81 R1 Z-2 @1 ^30 L3"), ["1.732 1.000", "1.500 2.598", "0.000 4.000"]);
    // G87 feeds above the hole, after passing through it off its axis.
    assert_eq!(holes("M3 S1 G0 X1\nG87 R1 Z-2 I.1 J0 K-1 ^90"), ["0.000 1.000"]);
}

#[test]
fn polar_words_of_a_cycle_at_the_origin_need_a_direction_in_g91_alone() {
    assert_eq!(holes("G81 R1 Z-2 @1"), ["1.000 0.000"]);
    assert_eq!(holes("G81 R1 Z-2 ^40"), ["0.000 0.000"]);
    for words in ["@1", "^40", "@1 ^40"] {
        assert_eq!(errors(&format!("G91 G81 R1 Z-2 {words}")), ["E1711"], "{words}");
    }
    assert_eq!(errors("G81 R1 Z-2 ^40 X1"), ["E1712"]);
    assert_eq!(errors("G18 G0 X1\nG81 R1 Y-2 ^40"), ["E1711"]);
}

/// Codes that use axis words but do not move.
#[test]
fn polar_words_are_refused_where_no_motion_takes_them() {
    for line in ["G28 @1", "G30 ^2", "G92 @1", "G52 @1", "G10 L2 P1 @1", "G43.1 @1", "G53 G0 @1", "G80 @1"] {
        let found = errors(&format!("G0 X1\n{line}"));
        assert_eq!(found.len(), 1, "{line}: {found:?}");
    }
}

#[test]
fn a_hole_is_drilled_from_the_clearance_and_left_to_it_or_to_the_initial_level() {
    assert_eq!(moves("G0 Z5\nG99 G81 X1 Y2 Z-3 R1"), "T0 0 5, T1 2 5, T1 2 1, F1 2 -3, T1 2 1");
    assert_eq!(moves("G0 Z5\nG98 G81 X1 Y2 Z-3 R1"), "T0 0 5, T1 2 5, T1 2 1, F1 2 -3, T1 2 5");
    // From below the clearance the tool first moves up.
    assert_eq!(moves("G98 G81 X1 Y2 Z-3 R1"), "T0 0 1, T1 2 1, F1 2 -3, T1 2 1");
}

#[test]
fn the_next_hole_takes_over_what_is_not_given() {
    let first = "T0 0 5, T1 0 5, T1 0 1, F1 0 -3, dwell 2, T1 0 1";
    for (next, second) in [
        ("Y4", "T1 4 1, F1 4 -3, dwell 2, T1 4 1"),
        ("X2 R2", "T2 0 2, F2 0 -3, dwell 2, T2 0 2"),
        ("Z-4 P1", "T1 0 1, F1 0 -4, dwell 1, T1 0 1"),
        ("G98 Y4", "T1 4 5, T1 4 1, F1 4 -3, dwell 2, T1 4 5"),
        ("X1 L2", "T1 0 1, F1 0 -3, dwell 2, T1 0 1, T1 0 1, F1 0 -3, dwell 2, T1 0 1"),
    ] {
        assert_eq!(moves(&format!("G0 Z5\nG99 G82 X1 Z-3 R1 P2\n{next}")), format!("{first}, {second}"), "{next}");
    }
}

#[test]
fn incremental_holes_go_on_from_each_other_and_count_levels_from_the_initial_one() {
    assert_eq!(
        moves("G0 Z5\nG91 G81 X1 Y2 Z-3 R-1 L2"),
        "T0 0 5, T1 2 5, T1 2 4, F1 2 1, T1 2 4, T2 4 4, F2 4 1, T2 4 4"
    );
}

#[test]
fn the_normal_axis_of_the_plane_is_drilled_along() {
    assert_eq!(moves("G18 G81 X1 Z2 Y-3 R1"), "T0 1 0, T1 1 2, F1 -3 2, T1 1 2");
    assert_eq!(moves("G19 G81 Y1 Z2 X-3 R1"), "T1 0 0, T1 1 2, F-3 1 2, T1 1 2");
    // Words and levels of one plane have no meaning in another.
    assert_eq!(errors("G81 X1 Z-3 R1\nG18 X2"), ["E1505"]);
}

#[test]
fn pecks_go_down_to_the_bottom_and_no_further() {
    assert_eq!(
        moves("G83 X1 Z-3 R1 Q1.5"),
        "T0 0 1, T1 0 1, F1 0 -0.5, T1 0 1, T1 0 -0.246, F1 0 -2, T1 0 1, T1 0 -1.746, F1 0 -3, T1 0 1"
    );
    assert_eq!(moves("G73 X1 Z-3 R1 Q2"), "T0 0 1, T1 0 1, F1 0 -1, T1 0 -0.746, F1 0 -3, T1 0 1");
    assert_eq!(moves("G20\nG73 X1 Z-3 R1 Q2"), "T0 0 1, T1 0 1, F1 0 -1, T1 0 -0.99, F1 0 -3, T1 0 1");
}

#[test]
fn taps_turn_round_at_the_bottom_and_bores_stop_or_wait() {
    assert_eq!(moves("M3\nG84 X1 Z-3 R1"), "cw, T0 0 1, T1 0 1, F1 0 -3, stop, ccw, dwell 0, F1 0 1, stop, cw");
    assert_eq!(moves("M4\nG74 X1 Z-3 R1"), "ccw, T0 0 1, T1 0 1, F1 0 -3, stop, cw, dwell 0, F1 0 1, stop, ccw");
    assert_eq!(moves("G85 X1 Z-3 R1"), "T0 0 1, T1 0 1, F1 0 -3, F1 0 1, T1 0 1");
    assert_eq!(moves("M3\nG86 X1 Z-3 R1 P2"), "cw, T0 0 1, T1 0 1, F1 0 -3, dwell 2, stop, T1 0 1, cw");
    assert_eq!(moves("M4\nG88 X1 Z-3 R1 P2"), "ccw, T0 0 1, T1 0 1, F1 0 -3, dwell 2, stop, pause, ccw");
    assert_eq!(moves("G89 X1 Z-3 R1 P2"), "T0 0 1, T1 0 1, F1 0 -3, dwell 2, F1 0 1");
}

#[test]
fn back_boring_goes_through_beside_the_axis() {
    assert_eq!(
        moves("M3\nG87 X1 Z-3 R1 I.5 J.25 K-2"),
        "cw, T0 0 1, T1 0 1, T1.5 0.25 1, stop, orient 0 2, T1.5 0.25 -3, T1 0 -3, cw, F1 0 -2, F1 0 -3, stop, \
         orient 0 2, T1.5 0.25 -3, T1.5 0.25 1, T1 0 1, cw"
    );
}

#[test]
fn the_path_is_exact_during_a_cycle_and_as_before_after_it() {
    let calls = |mode: &str| {
        let (text, failed) = canon_text(&format!("F1 {mode}\nG81 Z-1 R1\nM2\n"));
        assert!(!failed, "{text}");
        text.lines()
            .filter_map(|line| line.split_once("CONTROL_MODE(CANON_").map(|(_, mode)| mode.to_owned()))
            .collect::<Vec<_>>()
    };
    assert_eq!(calls("G64 P.5"), ["CONTINUOUS, 0.500000)", "EXACT_PATH)", "CONTINUOUS, 0.500000)"]);
    assert_eq!(calls("G61"), ["EXACT_PATH)"]);
    assert_eq!(calls("G61.1"), ["EXACT_STOP)", "EXACT_PATH)", "EXACT_STOP)"]);
}

#[test]
fn a_series_keeps_its_lengths_when_the_units_change() {
    let metric = moves("G20\nG0 Z2\nG98 G81 X0 Z-1 R.5\nG21\nX1");
    assert!(metric.ends_with("T1 0 50.8, T1 0 12.7, F1 0 -25.4, T1 0 50.8"), "{metric}");
}

#[test]
fn cycles_refuse_what_they_cannot_do() {
    for (program, number) in [
        ("G81 X1 Z-1", "E1505"),
        ("G81 X1 R1", "E1505"),
        ("G82 X1 Z-1 R1", "E1505"),
        ("G83 X1 Z-1 R1", "E1505"),
        ("M3\nG87 X1 Z-1 R1 I1 J1", "E1505"),
        ("G81 R1", "E1504"),
        ("G81 Z-1 R1 A1", "E1621"),
        ("G81 Z-1 R1 L0", "E1622"),
        ("G81 Z-1 R1 L10001", "E1622"),
        ("G83 Z-1 R1 Q.0001", "E1622"),
        ("G81 Z2 R1", "E1623"),
        ("G83 Z-1 R1 Q0", "E1624"),
        ("G93 G81 Z-1 R1 F1", "E1625"),
        ("G84 Z-1 R1", "E1626"),
        ("M4\nG84 Z-1 R1", "E1627"),
        ("M3\nG74 Z-1 R1", "E1627"),
        ("G82 Z-1 R1 P-1", "E1105"),
        ("F0 G81 Z-1 R1", "E1508"),
        ("G81 Z-1 R1 Q1", "E1408"),
        ("G81 Z-1 R1\nG0 X1\nG81 X2", "E1505"),
        ("G81 Z-1 R1\nL2", "E1408"),
        ("G53 G81 Z-1 R1", "E1506"),
    ] {
        assert_eq!(errors(program), [number], "{program}");
    }
}

#[test]
fn moves_in_step_with_the_spindle_name_their_pitch() {
    assert_eq!(moves("M3\nG33 Z-4 K2"), "cw, pitch 2, F0 0 -4");
    // A rigid tap returns to its start.
    assert_eq!(moves("M3\nG33.1 Z-4 K2\nG91 G0 Z1"), "cw, pitch 2, tap 0 0 -4, T0 0 1");
    for (program, number) in [
        ("G33 Z-4 K2", "E1626"),
        ("M3\nG33 Z-4", "E1505"),
        ("M3\nG33 Z-4 K0", "E1631"),
        ("M3\nG33 Z-4 K1 F2", "E1408"),
        ("M3\nG33.1 A1 K1", "E1621"),
        ("M3 $1", "E1630"),
        ("M19 R361", "E1629"),
        ("M19 R1 P3", "E1629"),
        ("M19 R1 Q0", "E1629"),
        ("G96 D100", "E1505"),
        ("G95 F1\nG1 X1", "E1628"),
        ("G95\nS1 G1 X1", "E1508"),
    ] {
        assert_eq!(errors(program), [number], "{program}");
    }
    assert!(errors("M3 S1 $0\nM5 $-1\nG96 S100 D2000\nG97\nM19 R1 P2 Q3\nG95 F1\nS1 G1 X1").is_empty());
}

#[test]
fn a_thread_is_cut_deeper_with_each_pass() {
    // Drive line at 10, crests at 8, first depth 0.5, full depth 1: two passes, and a spring pass.
    let pass = |depth: f64, clear: f64| {
        format!("T{clear} 0 0, T{} 0 0, pitch 2, F{} 0 -9, T{clear} 0 -9", 8.0 - depth, 8.0 - depth)
    };
    let wanted = format!("cw, T10 0 0, {}, {}, {}, T10 0 -9", pass(0.5, 10.5), pass(1.0, 10.0), pass(1.0, 10.0));
    assert_eq!(moves("M3\nG0 X10\nG76 P2 Z-9 I-2 J.5 K1 H1"), wanted);
    // With R2 the depth grows with the root of the pass number: 0.5, 0.707, 0.866, 1.
    assert_eq!(moves("M3\nG0 X10\nG76 P2 Z-9 I-2 J.5 K1 R2").matches("pitch").count(), 4);
    for (program, number) in [
        ("G76 P2 Z-9 I-2 J.5 K1", "E1626"),
        ("M3\nG76 Z-9 I-2 J.5 K1", "E1505"),
        ("M3\nG76 P2 Z-9 I0 J.5 K1", "E1632"),
        ("M3\nG76 P2 Z-9 I1 J1 K1", "E1632"),
        ("M3\nG76 P2 Z-9 I1 J.0001 K9 R2", "E1632"),
        ("M3\nG76 P0 Z-9 I1 J.5 K1", "E1632"),
        ("M3\nG76 P1 Z-9 I1 J.5 K1 Q90", "E1632"),
        ("M3\nG76 P1 Z-9 I1 J.5 K1 L4 E1", "E1632"),
        ("M3\nG76 P1 Z-9 A1 I1 J.5 K1", "E1621"),
    ] {
        assert_eq!(errors(program), [number], "{program}");
    }
}

#[test]
fn a_tapered_thread_runs_in_and_out_along_the_flank() {
    let pitch = 2.0 * 1.0_f64.hypot(3.0) / 3.0;
    assert_eq!(
        moves("M3\nG0 X10\nG76 P2 Z-9 I-2 J.9999 K1 L3 E3").split(", T10 0 0, ").nth(2),
        Some(
            format!("pitch {pitch}, F8 0 0, F7 0 -3, pitch 2, F7 0 -6, pitch {pitch}, F8 0 -9, T10 0 -9, T10 0 -9")
                .as_str()
        )
    );
}

#[test]
fn m19_turns_by_the_offset_too_and_without_r_and_p_it_only_stops() {
    let degrees = |program: &str, offset: f64| {
        let setup = Setup { orient_offset_degrees: offset, ..Setup::rs274() };
        let steps = Program::new(program.as_bytes(), setup).into_iter();
        let turns = steps.filter_map(|step| match step.canon {
            Canon::OrientSpindle { degrees, mode, .. } => Some((degrees, mode)),
            _ => None,
        });
        turns.collect::<Vec<_>>()
    };
    assert_eq!(degrees("M19 R350 P1\nM19 P2\nM19\nM19 Q1\nM2\n", 20.0), [(370.0, 1), (20.0, 2)]);
    assert_eq!(degrees("M19 P1\nM19 R5\nM2\n", 0.0), [(0.0, 1), (5.0, 0)]);
}

#[test]
fn any_name_of_a_cycle_opens_its_call_with_parentheses_or_without() {
    use retrace_gcode::cycles::CycleLibrary;
    let sources: Vec<(String, String)> = ["NEST", "OPEN", "M7X", "PARK", "NEXT2", "_AB"]
        .iter()
        .enumerate()
        .map(|(index, name)| {
            (format!("{name}.SPF"), format!("PROC {name}(REAL AT)\nG0 X=AT+{}\nRET\n", 10 * (index + 1)))
        })
        .collect();
    let sources: Vec<(&str, &str)> = sources.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
    let library = std::sync::Arc::new(CycleLibrary::of_sources(&sources));
    assert!(library.findings().is_empty(), "{:?}", library.findings());
    let ends = |line: &str| {
        let setup = Setup { cycles: Some(library.clone()), ..Setup::rs274() };
        let text = format!("G90\n{line}\nM2\n");
        let prescan = std::sync::Arc::new(retrace_gcode::Prescan::scan("p", text.into_bytes().into(), &setup));
        let steps = Program::<&[u8]>::prescanned(prescan, setup).into_iter();
        let ends = steps.filter_map(|step| match step.canon {
            Canon::StraightTraverse(end) => Some(end.0[0]),
            _ => None,
        });
        ends.collect::<Vec<_>>()
    };
    for (line, end) in [
        ("NEST(3)", 13.0),
        ("nest (3) (comment)", 13.0),
        ("N10 NEST(3)", 13.0),
        ("OPEN()", 20.0),
        ("N5 open(1)", 21.0),
        ("M7X()", 30.0),
        ("M7X", 30.0),
        ("PARK", 40.0),
        ("N7 park ; home", 40.0),
        ("O1 repeat [1]\nPARK\nO1 endrepeat", 40.0),
        ("O1 repeat [1]\nM7X(2)\nO1 endrepeat", 32.0),
        ("NEXT2(1)", 51.0),
        ("_AB(1)", 61.0),
        // Blocks of words keep their meaning.
        ("G0X3", 3.0),
        ("XABS[-4]G0", 4.0),
        ("N3 G0 X5 (M7X)", 5.0),
        ("M7 X6 G0", 6.0),
        ("NEXT: G0 X7", 7.0),
        ("OUTER: G0 X8", 8.0),
    ] {
        assert_eq!(ends(line), [end], "{line}");
    }
}

/// The tolerances of G64 are lengths: a restore emits them in the units that are then in force.
#[test]
fn the_tolerances_of_g64_keep_their_length_when_the_units_change() {
    use retrace_gcode::PathControl;
    let program = "F10 G21 G64 P.254 Q.127\nG20\nG81 X1 Y1 Z-1 R1\nM70\nG64\nM72\nG21\nX2\nM2\n";
    let steps = Program::new(program.as_bytes(), Setup::rs274()).into_iter();
    let tolerances: Vec<f64> = steps
        .filter_map(|step| match step.canon {
            Canon::SetMotionControlMode(PathControl::Continuous { tolerance }) => Some(tolerance),
            Canon::SetNaivecamTolerance(tolerance) => Some(tolerance),
            _ => None,
        })
        .collect();
    let wanted = [0.254, 0.127, 0.01, 0.005, 0.0, 0.0, 0.01, 0.005, 0.254, 0.127];
    assert!(tolerances.len() == wanted.len(), "{tolerances:?}");
    for (tolerance, wanted) in tolerances.iter().zip(wanted) {
        assert!((tolerance - wanted).abs() < 1e-12, "{tolerances:?}");
    }
}
