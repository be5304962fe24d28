//! The drilling cycles: their blocks over the parameter space, calculated manually from the rules of the control.
//!
//! Invariant: every expectation is independent of the sources of the cycles; its calculation is in the comment above
//! it.

use crate::common;

use common::{Recorder, alarm, alarm_from, blocks, blocks_from};

/// s = sign(RTP − RFP) = +1; z0 = RFP + s·SDIS = 2; zE = DP = −20, or RFP − s·DPR = −20.
#[test]
fn cycle81_drills_from_the_clearance_to_the_depth_and_retracts() {
    let expected = ["G0 G90 Z2", "G1 Z-20", "G0 Z10"];
    assert_eq!(blocks("CYCLE81(10,0,2,-20)"), expected);
    assert_eq!(blocks("CYCLE81(10,0,2,,20)"), expected);
    // RFP 5: z0 = 7, zE = 5 − 20 = −15.
    assert_eq!(blocks("CYCLE81(10,5,2,,20)"), ["G0 G90 Z7", "G1 Z-15", "G0 Z10"]);
    // Without a clearance the drill starts on the reference plane.
    assert_eq!(blocks("CYCLE81(10,0,,-20)"), ["G0 G90 Z0", "G1 Z-20", "G0 Z10"]);
}

#[test]
fn the_third_axis_of_the_plane_drills() {
    let in_plane = |plane| blocks_from("CYCLE81(10,0,2,-20)", Recorder { plane, ..Recorder::default() }).lines;
    assert_eq!(in_plane(18.0), ["G0 G90 Y2", "G1 Y-20", "G0 Y10"]);
    assert_eq!(in_plane(19.0), ["G0 G90 X2", "G1 X-20", "G0 X10"]);
}

/// Retraction below the reference plane reverses the direction: s = −1, z0 = 0 − 2, zE = 0 + 15.
#[test]
fn a_retraction_plane_below_drills_upward() {
    assert_eq!(alarm("CYCLE81(-10,0,2,-20)"), 61101);
    assert_eq!(blocks("CYCLE81(-10,0,2,,15)"), ["G0 G90 Z-2", "G1 Z15", "G0 Z-10"]);
    assert_eq!(blocks("CYCLE81(-10,0,2,15)"), ["G0 G90 Z-2", "G1 Z15", "G0 Z-10"]);
    assert_eq!(alarm("CYCLE81(10,0,2,5)"), 61101);
}

/// Equal planes: s = sign(RFP − DP) with DP alone.
#[test]
fn equal_planes_need_an_absolute_depth() {
    assert_eq!(alarm("CYCLE81(0,0,2,,20)"), 61101);
    assert_eq!(blocks("CYCLE81(0,0,2,-20)"), ["G0 G90 Z2", "G1 Z-20", "G0 Z0"]);
    assert_eq!(blocks("CYCLE81(0,0,2,20)"), ["G0 G90 Z-2", "G1 Z20", "G0 Z0"]);
    assert_eq!(alarm("CYCLE81(0,0,2,0)"), 61101);
}

#[test]
fn the_relative_depth_wins_and_says_so() {
    let host = blocks_from("CYCLE81(10,0,2,-20,15)", Recorder::default());
    assert_eq!((host.lines[1].as_str(), host.warnings.as_slice()), ("G1 Z-15", &[62802][..]));
    // Both are equal: no message. With an explicit 0 and DP, DP counts.
    assert!(blocks_from("CYCLE81(10,0,2,-20,20)", Recorder::default()).warnings.is_empty());
    let host = blocks_from("CYCLE81(10,0,2,-20,0)", Recorder::default());
    assert_eq!((host.lines[1].as_str(), host.warnings.is_empty()), ("G1 Z-20", true));
}

#[test]
fn signs_are_ignored_with_a_warning_where_none_are_meant() {
    let host = blocks_from("CYCLE81(10,0,-2,,-20)", Recorder::default());
    assert_eq!(host.lines, ["G0 G90 Z2", "G1 Z-20", "G0 Z10"]);
    assert_eq!(host.warnings, [62801, 62801]);
}

#[test]
fn what_every_drilling_cycle_needs() {
    let calls = [
        "CYCLE81(10,0,2,-20)",
        "CYCLE82(10,0,2,-20)",
        "CYCLE83(10,0,2,-20,,-5)",
        "CYCLE84(10,0,2,-20,,,3,6)",
        "CYCLE85(10,0,2,-20)",
        "CYCLE86(10,0,2,-20,,,3)",
        "CYCLE87(10,0,2,-20,,3)",
        "CYCLE88(10,0,2,-20,,,3)",
        "CYCLE89(10,0,2,-20)",
    ];
    for call in calls {
        assert_eq!(alarm_from(call, Recorder { offset: 0.0, ..Recorder::default() }), 61000, "{call}");
        assert_eq!(alarm_from(call, Recorder { compensation: 41.0, ..Recorder::default() }), 61815, "{call}");
        if !call.starts_with("CYCLE84") {
            assert_eq!(alarm_from(call, Recorder { feed: 0.0, ..Recorder::default() }), 61003, "{call}");
        }
        assert_eq!(alarm(&call.replace("-20", "")), 61808, "{call}");
        assert_eq!(alarm(&call.replace("(10", "(-10")), 61101, "{call}");
        assert_eq!(blocks_from(call, Recorder::default()).triggers, 0, "{call} calls no modal cycle");
        assert!(
            blocks(call).last().is_some_and(|last| last.contains("Z10") || call.contains("84") || call.contains("86"))
        );
    }
}

#[test]
fn cycle82_dwells_in_seconds_or_revolutions() {
    assert_eq!(blocks("CYCLE82(10,0,2,-20,,1.5)"), ["G0 G90 Z2", "G1 Z-20", "G4 P1.5", "G0 Z10"]);
    // 3 revolutions at 600 a minute: 3 · 60 / 600 = 0.3 s.
    assert_eq!(blocks("CYCLE82(10,0,2,-20,,-3)"), ["G0 G90 Z2", "G1 Z-20", "G4 P0.3", "G0 Z10"]);
    assert_eq!(blocks("CYCLE82(10,0,2,-20)"), ["G0 G90 Z2", "G1 Z-20", "G0 Z10"]);
    assert_eq!(alarm_from("CYCLE82(10,0,2,-20,,-3)", Recorder { speed: 0.0, ..Recorder::default() }), 61890);
}

/// Returns the depths that CYCLE83 reaches, with chip removal: the ends of the feed blocks.
fn depths(call: &str) -> Vec<f64> {
    let feeds = blocks(call).into_iter().filter(|line| line.starts_with("G1"));
    feeds
        .map(|line| {
            -line
                .split_whitespace()
                .find_map(|word| word.strip_prefix('Z'))
                .expect("Z")
                .parse::<f64>()
                .expect("a number")
        })
        .collect()
}

/// T = 57, first 20, DAM 5: 20 − 5 = 15, 15 − 5 = 10; 10 − 5 is not above 5, so strokes of 5 while the remainder is
/// above 10: remainder 57 − 45 = 12, one; remainder 7 is shared.
#[test]
fn cycle83_shortens_its_strokes_by_an_amount() {
    assert_eq!(depths("CYCLE83(10,0,2,,57,,20,5,,,,1)"), [20.0, 35.0, 45.0, 50.0, 53.5, 57.0]);
    // A first depth that is absolute, from another reference plane: 5 − (−15) = 20.
    let z: Vec<f64> = depths("CYCLE83(10,5,2,,57,-15,,5,,,,1)");
    assert_eq!(z, [15.0, 30.0, 40.0, 45.0, 48.5, 52.0]);
    // T = 30, first 20, DAM 5: 15 planned and 10 left, so one last stroke.
    assert_eq!(depths("CYCLE83(10,0,2,,30,,20,5,,,,1)"), [20.0, 30.0]);
    // T = 37: 15 planned, 17 left; 2 would remain, below 2.5, so the rest is shared: 8.5 and 8.5.
    assert_eq!(depths("CYCLE83(10,0,2,,37,,20,5,,,,1)"), [20.0, 28.5, 37.0]);
    // T = 38: 3 remain, which is enough; then 15 − 5 = 10 planned, 3 left: one last stroke.
    assert_eq!(depths("CYCLE83(10,0,2,,38,,20,5,,,,1)"), [20.0, 35.0, 38.0]);
    // A planned stroke that happens to be half of the rest is not shared: first 10, DAM 2, T 26: 8 of 16; then 6 of 8,
    // which leaves 2, not below 1; then 4 planned, 2 left.
    assert_eq!(depths("CYCLE83(10,0,2,,26,,10,2,,,,1)"), [10.0, 18.0, 24.0, 26.0]);
}

#[test]
fn cycle83_shortens_its_strokes_by_a_factor() {
    // 20, 16, 12.8, and the rest of 1.2.
    assert_eq!(depths("CYCLE83(10,0,2,,50,,20,-0.8,,,,1)"), [20.0, 36.0, 48.8, 50.0]);
    // Never below the smallest stroke of 15: 20, then 16, then 15 in place of 12.8, and 6 that are left.
    assert_eq!(depths("CYCLE83(10,0,2,,57,,20,-0.8,,,,1,,15)"), [20.0, 36.0, 51.0, 57.0]);
    assert_eq!(blocks_from("CYCLE83(10,0,2,,57,,20,-0.8,,,,1,,-15)", Recorder::default()).warnings, [62801]);
    assert_eq!(depths("CYCLE83(10,0,2,,57,,20,-0.8,,,,1,,-15)"), [20.0, 36.0, 51.0, 57.0]);
    // Halving from 10 never reaches 20: 20 strokes would end a millionth before it, and without _MDEP nothing stops it
    // sooner.
    assert_eq!(alarm("CYCLE83(10,0,2,,20.5,,10,-0.5,,,,1)"), 61107);
    assert_eq!(alarm("CYCLE83(10,0,2,,50,,20,-1.5,,,,1)"), 61107);
}

#[test]
fn cycle83_without_degression_shares_the_last_rest() {
    // Remainder after 20: 37, 17 < 20: one stroke; T = 57: 20, 20 (remainder 37 < 40 and > 20: shared as 18.5).
    assert_eq!(depths("CYCLE83(10,0,2,,57,,20,,,,,1)"), [20.0, 38.5, 57.0]);
    assert_eq!(depths("CYCLE83(10,0,2,,60,,20,,,,,1)"), [20.0, 40.0, 60.0]);
    assert_eq!(depths("CYCLE83(10,0,2,,35,,20,,,,,1)"), [20.0, 35.0]);
    assert_eq!(depths("CYCLE83(10,0,2,,15,,20,,,,,1)"), [15.0]);
}

#[test]
fn cycle83_needs_a_first_depth_between_the_planes() {
    assert_eq!(alarm("CYCLE83(10,0,2,-20)"), 61107);
    assert_eq!(alarm("CYCLE83(10,0,2,-20,,5)"), 61107);
    assert_eq!(alarm("CYCLE83(10,0,2,-20,,0)"), 61107);
    assert_eq!(alarm("CYCLE83(10,0,2,-20,,,0)"), 61107);
    // With an explicit 0 and an absolute depth, the absolute one counts.
    assert_eq!(depths("CYCLE83(10,0,2,-20,,-12,0,,,,,1)"), [12.0, 20.0]);
    assert_eq!(alarm("CYCLE83(10,0,2,-20,,-5,,,,,,2)"), 61002);
    assert_eq!(alarm("CYCLE83(10,0,2,-20,,,0.001)"), 61107);
}

/// Section 3 of the requirements: re-entry at −19.4 (0.6), −34.3 (35/50 = 0.7), −44.1 (0.9), −49 (1), −52.43 (1.07).
#[test]
fn cycle83_removes_chips_by_going_back_to_the_start_plane() {
    let expected = [
        "G0 G90 Z2",
        "G1 Z-20 F50",
        "G4 P0.5",
        "G0 Z2",
        "G4 P1",
        "G0 Z-19.4",
        "G1 Z-35 F100",
        "G4 P0.5",
        "G0 Z2",
        "G4 P1",
        "G0 Z-34.3",
        "G1 Z-45 F100",
        "G4 P0.5",
        "G0 Z2",
        "G4 P1",
        "G0 Z-44.1",
        "G1 Z-50 F100",
        "G4 P0.5",
        "G0 Z2",
        "G4 P1",
        "G0 Z-49",
        "G1 Z-53.5 F100",
        "G4 P0.5",
        "G0 Z2",
        "G4 P1",
        "G0 Z-52.43",
        "G1 Z-57 F100",
        "G4 P2",
        "G0 Z10",
    ];
    // DTB 0.5, DTS 1, FRF 0.5, _DTD 2.
    assert_eq!(blocks("CYCLE83(10,0,2,-57,,,20,5,0.5,1,0.5,1,,,,2)"), expected);
    // _DIS1 replaces the distance; the dwells are left out, FRF 0 is 1.
    let expected = ["G0 G90 Z2", "G1 Z-20 F100", "G0 Z2", "G0 Z-17", "G1 Z-30 F100", "G0 Z10"];
    assert_eq!(blocks("CYCLE83(10,0,2,-30,,,20,,,,,1,,,,,3)"), expected);
    // At most 7 mm: 400/50 = 8.
    assert_eq!(blocks("CYCLE83(10,0,2,-500,,,400,,,,,1)")[3], "G0 Z-393");
}

/// Back by _VRT at feed between the strokes: 20 − 1 = 19, 35 − 1 = 34 …; the dwell at the final depth is DTB where _DTD
/// is 0.
#[test]
fn cycle83_breaks_chips_by_going_back_a_little() {
    let expected = [
        "G0 G90 Z2",
        "G1 Z-20 F100",
        "G4 P0.5",
        "G1 Z-19 F100",
        "G1 Z-35 F100",
        "G4 P0.5",
        "G1 Z-34 F100",
        "G1 Z-45 F100",
        "G4 P0.5",
        "G1 Z-44 F100",
        "G1 Z-50 F100",
        "G4 P0.5",
        "G1 Z-49 F100",
        "G1 Z-53.5 F100",
        "G4 P0.5",
        "G1 Z-52.5 F100",
        "G1 Z-57 F100",
        "G4 P0.5",
        "G0 Z10",
    ];
    assert_eq!(blocks("CYCLE83(10,0,2,-57,,,20,5,0.5)"), expected);
    // _VRT 2.5; downward is upward: RTP below.
    let expected = ["G0 G90 Z-2", "G1 Z20 F100", "G1 Z17.5 F100", "G1 Z30 F100", "G0 Z-10"];
    assert_eq!(blocks("CYCLE83(-10,0,2,30,,,20,,,,,0,,,2.5)"), expected);
    // Never back beyond the start plane: depth 1, clearance 2, _VRT 5: to +2.
    assert_eq!(blocks("CYCLE83(10,0,2,-2,,,1,,,,,0,,,5)")[2], "G1 Z2 F100");
    // Revolutions: 6 at 600 a minute are 0.6 s.
    assert_eq!(blocks("CYCLE83(10,0,2,-20,,,20,,-6)")[2], "G4 P0.6");
}

#[test]
fn cycle83_drills_along_the_axis_that_is_named() {
    let axis = |n: u8| blocks(&format!("CYCLE83(10,0,2,-20,,,20,,,,,1,{n})")).join("; ");
    assert_eq!(axis(1), "G0 G90 X2; G1 X-20 F100; G0 X10");
    assert_eq!(axis(2), "G0 G90 Y2; G1 Y-20 F100; G0 Y10");
    assert_eq!(axis(3), "G0 G90 Z2; G1 Z-20 F100; G0 Z10");
    assert_eq!(axis(7), "G0 G90 Z2; G1 Z-20 F100; G0 Z10");
}

/// In inch programs the built-in millimetres are 1/25.4: 1 mm back is 0.03937 inch, 0.6 mm is 0.023622 inch.
#[test]
fn cycle83_keeps_its_millimetres_in_inch_programs() {
    let inch = |call| blocks_from(call, Recorder { inch: 1.0, ..Recorder::default() }).lines;
    assert_eq!(inch("CYCLE83(1,0,0.1,-2,,,1)")[2], "G1 Z-0.96063 F100");
    assert_eq!(inch("CYCLE83(1,0,0.1,-2,,,1,,,,,1)")[3], "G0 Z-0.976378");
}

/// M6 has a pitch of 1; SST 200, back with 300: I = 1.5. The speed before was 600.
#[test]
fn cycle84_taps_synchronised_and_sets_the_spindle_again() {
    let expected = ["G0 G90 Z2", "R90 M19", "G97 S200 M3", "G33.1 Z-20 K1 I1.5", "G0 Z10", "S600 M4"];
    assert_eq!(blocks("CYCLE84(10,0,2,-20,,,4,6,,90,200,300)"), expected);
    // Left-hand by PIT; SST is the programmed 600, SST1 the same.
    let expected = ["G0 G90 Z2", "R0 M19", "G97 S600 M4", "G33.1 Z-20 K0.75", "G0 Z10", "S600 M5"];
    assert_eq!(blocks("CYCLE84(10,0,2,-20,,,5,,-0.75)"), expected);
    assert_eq!(blocks("CYCLE84(10,0,2,-20,,,5,-12)")[2..4], ["G97 S600 M4", "G33.1 Z-20 K1.75"]);
}

#[test]
fn cycle84_reads_the_pitch_in_four_units() {
    let pitch = |call: &str| blocks(call)[3].clone();
    assert_eq!(pitch("CYCLE84(10,0,2,-20,,,3,,1.5,,,,,1)"), "G33.1 Z-20 K1.5");
    // 20 threads per inch: 25.4 / 20 = 1.27 mm.
    assert_eq!(pitch("CYCLE84(10,0,2,-20,,,3,,20,,,,,2)"), "G33.1 Z-20 K1.27");
    assert_eq!(pitch("CYCLE84(10,0,2,-20,,,3,,0.05,,,,,3)"), "G33.1 Z-20 K1.27");
    let inch = Recorder { inch: 1.0, ..Recorder::default() };
    assert_eq!(blocks_from("CYCLE84(1,0,0.1,-1,,,3,,20,,,,,2)", inch).lines[3], "G33.1 Z-1 K0.05");
    // Size and pitch may both be given, if they agree.
    assert_eq!(pitch("CYCLE84(10,0,2,-20,,,3,8,1.25)"), "G33.1 Z-20 K1.25");
    for wrong in ["8,1.5", "8,-1.25", "7", "2", "52", ",", ",0.0001", ",2001", "-5.5"] {
        assert_eq!(alarm(&format!("CYCLE84(10,0,2,-20,,,3,{wrong})")), 61001, "{wrong}");
    }
    assert_eq!(alarm("CYCLE84(10,0,2,-20,,,3,6,,,,,,4)"), 61001);
}

#[test]
fn cycle84_refuses_what_it_cannot_do() {
    for direction in ["", "0", "2", "6", "-3"] {
        assert_eq!(alarm(&format!("CYCLE84(10,0,2,-20,,,{direction},6)")), 61102, "{direction}");
    }
    assert_eq!(alarm("CYCLE84(10,0,2,-20,,,3,6,,,,,,,,3)"), 61002);
    assert_eq!(alarm("CYCLE84(10,0,2,-20,,,3,6,,,,,,,,1)"), 61002);
    assert_eq!(alarm_from("CYCLE84(10,0,2,-20,,,3,6)", Recorder { speed: 0.0, ..Recorder::default() }), 61890);
    let host = blocks_from("CYCLE84(10,0,2,-20,,1,3,6)", Recorder::default());
    assert_eq!(host.warnings, [62804]);
}

/// Depth 20 in strokes of 8: to 8, 16 and 20; each begins at the start plane.
#[test]
fn cycle84_taps_in_strokes() {
    let expected =
        ["G0 G90 Z2", "R0 M19", "G97 S600 M3", "G33.1 Z-8 K1", "G33.1 Z-16 K1", "G33.1 Z-20 K1", "G0 Z10", "S600 M3"];
    assert_eq!(blocks("CYCLE84(10,0,2,-20,,,3,6,,,,,,,,2,8)"), expected);
    let host = blocks_from("CYCLE84(10,0,2,-20,,,3,6,,,,,,,,1,8)", Recorder::default());
    assert_eq!((host.lines, host.warnings), (expected.map(str::to_owned).to_vec(), vec![62803]));
    // Strokes that divide the depth leave no remainder.
    assert_eq!(blocks("CYCLE84(10,0,2,-20,,,3,6,,,,,,,,2,10)").len(), 7);
    assert_eq!(blocks("CYCLE84(10,0,2,-0.3,,,3,6,,,,,,,,2,0.1)").len(), 8);
}

#[test]
fn cycle85_has_feeds_of_its_own() {
    let expected = ["G0 G90 Z2", "G1 Z-20 F80", "G4 P0.5", "G1 Z2 F200", "G0 Z10"];
    assert_eq!(blocks("CYCLE85(10,0,2,-20,,0.5,80,200)"), expected);
    assert_eq!(blocks("CYCLE85(10,0,2,-20)"), ["G0 G90 Z2", "G1 Z-20 F100", "G1 Z2 F100", "G0 Z10"]);
    let without_feed = Recorder { feed: 0.0, ..Recorder::default() };
    assert_eq!(alarm_from("CYCLE85(10,0,2,-20,,,80)", without_feed.clone()), 61003);
    assert_eq!(blocks_from("CYCLE85(10,0,2,-20,,,80,90)", without_feed).lines.len(), 4);
}

#[test]
fn cycle86_to_cycle89_bore() {
    let host = Recorder { position: [30.0, 40.0, 50.0], ..Recorder::default() };
    let expected =
        ["M3", "G0 G90 Z2", "G1 Z-20", "G4 P1", "R45 M19", "G0 X29 Y40 Z-18", "G0 Z2", "G0 Z10", "G0 X30 Y40"];
    assert_eq!(blocks_from("CYCLE86(10,0,2,-20,,1,3,-1,0,2,45)", host).lines, expected);
    assert_eq!(blocks("CYCLE87(10,0,2,-20,,4)"), ["M4", "G0 G90 Z2", "G1 Z-20", "M5", "M0", "G0 Z10"]);
    assert_eq!(blocks("CYCLE88(10,0,2,-20,,2,4)"), ["M4", "G0 G90 Z2", "G1 Z-20", "G4 P2", "M5", "M0", "G0 Z10"]);
    assert_eq!(blocks("CYCLE89(10,0,2,-20,,2)"), ["G0 G90 Z2", "G1 Z-20", "G4 P2", "G1 Z2", "G0 Z10"]);
    for call in ["CYCLE86(10,0,2,-20,,,5)", "CYCLE87(10,0,2,-20)", "CYCLE88(10,0,2,-20,,,2)"] {
        assert_eq!(alarm(call), 61102, "{call}");
    }
}
