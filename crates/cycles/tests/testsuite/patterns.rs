//! HOLES1 and HOLES2: order and positions of the holes; CYCLE95's blocks from a path.
//!
//! Invariant: positions are calculated here, independently of the cycles.

use crate::common;

use common::{Recorder, alarm, alarm_from, blocks, blocks_from};
use retrace_cycles::{CycleLibrary, Kind, StockFeed, StockMove, StockPathError};

/// Radius 20 around 0/0, six holes: 60° apart, the first at 20/0; sin 60° · 20 = 17.320508.
#[test]
fn holes2_spreads_its_holes_over_the_circle() {
    let host = blocks_from("HOLES2(0,0,20,0,0,6)", Recorder::default());
    let expected = [
        "G0 G90 X20 Y0",
        "G0 G90 X10 Y17.320508",
        "G0 G90 X-10 Y17.320508",
        "G0 G90 X-20 Y0",
        "G0 G90 X-10 Y-17.320508",
        "G0 G90 X10 Y-17.320508",
    ];
    assert_eq!(host.lines, expected);
    assert_eq!((host.triggers, host.warnings.is_empty()), (6, true));
}

#[test]
fn holes2_takes_an_angle_and_a_plane() {
    // From 90° in steps of −45° about 5/7, radius 10: 5/17, then 5 + 7.071068 / 7 + 7.071068.
    assert_eq!(blocks("HOLES2(5,7,10,90,-45,2)"), ["G0 G90 X5 Y17", "G0 G90 X12.071068 Y14.071068"]);
    let host = blocks_from("HOLES2(5,7,10,90,0,1)", Recorder { plane: 18.0, ..Recorder::default() });
    assert_eq!((host.lines, host.triggers), (vec!["G0 G90 Z5 X17".to_owned()], 1));
}

#[test]
fn patterns_refuse_what_is_none() {
    assert_eq!(alarm("HOLES2(0,0,20,0,0,0)"), 61103);
    assert_eq!(alarm("HOLES1(0,0,0,5,10,0)"), 61103);
    assert_eq!(alarm("HOLES1(0,0,0,5,10,-2)"), 61103);
    assert_eq!(alarm("HOLES2(0,0,0,0,0,6)"), 61002);
    assert_eq!(alarm("HOLES2(0,0,-1,0,0,6)"), 61002);
    assert_eq!(alarm_from("HOLES1(0,0,0,5,10,3)", Recorder { compensation: 42.0, ..Recorder::default() }), 61815);
    let host = blocks_from("HOLES1(0,0,0,5,10,3)", Recorder { modal_cycle: 0.0, ..Recorder::default() });
    assert_eq!((host.lines.len(), host.warnings), (3, vec![62100]), "approached all the same");
}

/// Holes at 5, 15, 25 along X from the origin.
#[test]
fn holes1_begins_at_the_nearer_end() {
    let from =
        |x: f64| blocks_from("HOLES1(0,0,0,5,10,3)", Recorder { position: [x, 0.0, 0.0], ..Recorder::default() }).lines;
    let forward = ["G0 G90 X5 Y0", "G0 G90 X15 Y0", "G0 G90 X25 Y0"];
    let mut backward = forward;
    backward.reverse();
    assert_eq!(from(0.0), forward);
    // The middle is at 15: a tie goes to the first hole.
    assert_eq!(from(15.0), forward);
    assert_eq!(from(15.1), backward);
    assert_eq!(from(100.0), backward);
}

/// 30° from 10/20: first hole at 4, so 10 + 4·cos 30° = 13.464102, 20 + 2 = 22; the next 6 further.
#[test]
fn holes1_follows_its_angle() {
    assert_eq!(blocks("HOLES1(10,20,30,4,6,2)"), ["G0 G90 X13.464102 Y22", "G0 G90 X18.660254 Y25"]);
    assert_eq!(blocks("HOLES1(10,20,180,4,6,2)"), ["G0 G90 X0 Y20", "G0 G90 X6 Y20"], "the far end is nearer to 0/0");
    let host = blocks_from("HOLES1(0,0,0,-5,-10,2)", Recorder::default());
    assert_eq!((host.lines.join("; ").as_str(), host.warnings.len()), ("G0 G90 X5 Y0; G0 G90 X15 Y0", 2));
}

#[test]
fn the_three_kinds_are_told_apart() {
    let library = CycleLibrary::shipped();
    let kind = |name| library.find(name).and_then(|id| library.get(id)).map(|cycle| cycle.kind());
    assert_eq!(kind("cycle81"), Some(Kind::Parameters));
    assert_eq!(kind("CYCLE95"), Some(Kind::Contour(0)));
    let own = CycleLibrary::of_sources(&[
        ("HOME", "G0 Z0\n"),
        ("INNER", "PROC INNER(INT AA, STRING[20] BB)\nAA=STOCKPATH(BB,1,0,0,0,1,0,1)"),
        ("OUTER", "PROC OUTER(STRING[20] CC)\nINNER(3,CC)"),
        ("FIXED", "PROC FIXED(REAL DD)\nINNER(3,\"CONTOUR\")"),
    ]);
    assert!(own.findings().is_empty(), "{:?}", own.findings());
    let kind = |name| own.find(name).and_then(|id| own.get(id)).map(|cycle| cycle.kind().number());
    assert_eq!(["HOME", "INNER", "OUTER", "FIXED"].map(kind), [Some(1), Some(3), Some(3), Some(2)]);
}

fn turning() -> Recorder {
    let arc = |compensation, dwell| StockMove {
        motion: 3,
        end: [-41.0, 25.0],
        centre: [0.0, 3.0],
        feed: StockFeed::Finish,
        compensation,
        dwell,
    };
    let line =
        |motion, feed, dwell| StockMove { motion, end: [-1.5, 10.0], centre: [0.0, 0.0], feed, compensation: 0, dwell };
    Recorder {
        plane: 18.0,
        path: Ok(vec![
            line(0, StockFeed::Rapid, false),
            line(1, StockFeed::Rough, true),
            line(1, StockFeed::Rough, false),
            line(1, StockFeed::Plunge, false),
            arc(42, false),
            StockMove { compensation: 40, ..line(0, StockFeed::Rapid, false) },
        ]),
        ..Recorder::default()
    }
}

/// Each feed is set where it changes; a dwell follows its move; compensation changes before the move.
#[test]
fn cycle95_gives_the_moves_of_its_path() {
    let host = blocks_from("CYCLE95(\"AUSSEN1\",2.8,0.1,0.2,,0.3,0.15,0.1,9,0.5,20)", turning());
    let expected = [
        "G90 G8",
        "G0 Z-1.5 X10",
        "F0.3",
        "G1 Z-1.5 X10",
        "G4 P0.5",
        "G1 Z-1.5 X10",
        "F0.15",
        "G1 Z-1.5 X10",
        "F0.1",
        "G42",
        "G3 Z-41 X25 K0 I3",
        "G40",
        "G0 Z-1.5 X10",
    ];
    assert_eq!(host.lines, expected);
    let call =
        "StockCall { contour: \"AUSSEN1\", mid: 2.8, fal_z: 0.1, fal_x: 0.2, fal: 0.0, vari: 9, dam: 20.0, vrt: 1.0 }";
    assert_eq!(host.stock_calls, [call]);
}

#[test]
fn cycle95_checks_before_it_moves() {
    let call = |text: &str| alarm_from(text, turning());
    for wrong in ["0", "13", "200", "213", "-1", ""] {
        assert_eq!(call(&format!("CYCLE95(\"C\",1,,,,,,,{wrong})")), 61002, "{wrong}");
    }
    assert_eq!(call("CYCLE95(,1,,,,,,,1)"), 61605);
    assert_eq!(call("CYCLE95(\"C\",0,,,,,,,1)"), 61610);
    assert_eq!(call("CYCLE95(\"C\",0,,,,,,,212)"), 61610);
    assert_eq!(alarm_from("CYCLE95(\"C\",1,,,,,,,1)", Recorder { feed: 0.0, ..turning() }), 61003);
    assert_eq!(alarm_from("CYCLE95(\"C\",1,,,,2,,,9)", Recorder { feed: 0.0, ..turning() }), 61003);
    assert_eq!(alarm_from("CYCLE95(\"C\",1,,,,2,,,9)", Recorder { compensation: 41.0, ..turning() }), 61815);
    let fault = StockPathError { alarm: 10933, text: "two blocks".to_owned() };
    assert_eq!(alarm_from("CYCLE95(\"C\",1,,,,2,,3,9)", Recorder { path: Err(fault), ..turning() }), 10933);
    // Finishing needs no infeed and no feed for roughing; omitted feeds follow FF1 and F.
    let host = blocks_from("CYCLE95(\"C\",,,,,,,3,205)", Recorder { feed: 0.0, ..turning() });
    assert!(host.lines.contains(&"F3".to_owned()) && host.stock_calls[0].contains("vari: 205"));
    let host = blocks_from("CYCLE95(\"C\",1,,,,,,,1)", Recorder { inch: 1.0, ..turning() });
    assert!(
        host.lines.contains(&"F100".to_owned()) && host.stock_calls[0].contains("vrt: 0.0393700"),
        "{:?}",
        host.stock_calls
    );
}
