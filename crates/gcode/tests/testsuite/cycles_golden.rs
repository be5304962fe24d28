//! Output of `retrace canon` for the shipped cycles, called from programs, compared with manually calculated paths.
//!
//! Invariant: a call is written as its code and its coordinates: G0, G1 with X Y Z (in G18 X Z), G2, G3 as printed, G4
//! with seconds, F and S.

use crate::common;

use common::{canon_text, canon_text_with};
use retrace_gcode::{AxisSet, Setup, ToolTable, cycles::CycleLibrary};
use std::sync::Arc;

const TOOLS: &str = "T1 P1 D4\nT2 P2 D0.8 Q2\nT3 P3 D0.8 Q3\nT9 P9 D0 Q3\n";

fn setup() -> Setup {
    Setup {
        axes: AxisSet::XYZ,
        tools: ToolTable::read(TOOLS).expect("a tool table"),
        cycles: Some(Arc::new(CycleLibrary::shipped())),
        ..Setup::default()
    }
}

/// Returns the canonical functions between the comments BEGIN and END, abbreviated.
fn calls(program: &str) -> String {
    let (text, failed) = canon_text_with(program, setup());
    assert!(!failed, "{program}\n{text}");
    let lines = text.lines().skip_while(|line| !line.contains("BEGIN")).skip(1);
    let lines = lines.take_while(|line| !line.contains("END")).filter(|line| !line.contains("interpreter: "));
    lines.map(short).collect::<Vec<_>>().join("\n")
}

/// Abbreviates a line: `G0 1 2 3` for a straight move, `G3 …` for an arc, `G4`, `F`, `S` with their number; anything
/// else by name.
fn short(line: &str) -> String {
    let call = line.get(13..).unwrap_or(line).trim();
    let (name, rest) = call.split_once('(').unwrap_or((call, ""));
    let numbers = rest.trim_end_matches(')').split(", ").filter_map(|number| number.parse::<f64>().ok());
    // A zero has no sign here.
    let mut numbers: Vec<String> = numbers.map(|number| format!("{}", number + 0.0)).collect();
    let code = match name {
        "STRAIGHT_TRAVERSE" => "G0",
        "STRAIGHT_FEED" => "G1",
        "DWELL" => "G4",
        "SET_FEED_RATE" => "F",
        "SET_SPINDLE_SPEED" => {
            numbers.remove(0);
            "S"
        }
        _ => return call.to_owned(),
    };
    numbers.truncate(3);
    [&[code.to_owned()], numbers.as_slice()].concat().join(" ")
}

/// Returns a call after a start that sets tool, spindle, F100 and X1 Y2 Z50 in the modes given.
fn drilled(modes: &str, call: &str) -> String {
    calls(&format!(
        "T1 M6\nM3 S500\n{modes} F100\nG90 G0 X1 Y2 Z50\n{}\n(BEGIN)\n{call}\n(END)\nM2\n",
        if modes.contains("G91") { "G91" } else { "" }
    ))
}

/// Expands a path along Z at X1 Y2: `T` is rapid, a number is at the feed, `P` is a dwell with its seconds.
fn along_z(path: &str) -> String {
    let step = |word: &str| match word.as_bytes()[0] {
        b'T' => format!("G0 1 2 {}", &word[1..]),
        b'P' => format!("G4 {}", &word[1..]),
        b'F' => format!("F {}", &word[1..]),
        _ => format!("G1 1 2 {word}"),
    };
    path.split_whitespace().map(step).collect::<Vec<_>>().join("\n")
}

/// Sections 2 to 5 and 15 of the requirements: RTP 10, RFP 0, SDIS 2, so the start plane is Z2.
#[test]
fn drilling_cycles_go_down_and_out_as_their_tables_say() {
    for (call, path) in [
        ("CYCLE81(10,0,2,-20)", "T2 -20 T10"),
        ("CYCLE81(10,0,2,,20)", "T2 -20 T10"),
        ("CYCLE81(10,0,-2,-20)", "T2 -20 T10"),
        // Retraction below the reference plane reverses the direction.
        ("CYCLE81(-10,0,2,,15)", "T-2 15 T-10"),
        ("CYCLE81(0,0,2,-20)", "T2 -20 T0"),
        // The relative depth takes precedence.
        ("CYCLE81(10,0,2,-20,15)", "T2 -15 T10"),
        ("CYCLE82(10,0,2,-20,,1.5)", "T2 -20 P1.5 T10"),
        // Three turns at 500 per minute.
        ("CYCLE82(10,0,2,-20,,-3)", "T2 -20 P0.36 T10"),
        ("CYCLE85(10,0,2,-20,,1,50,80)", "T2 F50 -20 P1 F80 2 T10 F100"),
        ("CYCLE85(10,0,2,-20)", "T2 F100 -20 F100 2 T10"),
        ("CYCLE89(10,0,2,-20,,1)", "T2 -20 P1 2 T10"),
    ] {
        assert_eq!(drilled("", call), along_z(path), "{call}");
        // The same in both distance modes of the program.
        assert_eq!(drilled("G91", call), along_z(path), "{call} in G91");
    }
}

/// T 57, first 20, degression 5: 20, 35, 45, 50, 53.5, 57; back by 1 mm, or out and in again to 0.6 mm or a fiftieth of
/// the depth.
#[test]
fn deep_holes_break_the_chip_or_take_it_out() {
    for (call, path) in [
        (
            "CYCLE83(10,0,2,-57,,,20,5,,,0.5)",
            "T2 F50 -20 F100 -19 F100 -35 F100 -34 F100 -45 F100 -44 F100 -50 F100 -49 F100 -53.5 F100 -52.5 F100 -57 \
                T10",
        ),
        (
            "CYCLE83(10,0,2,-57,,,20,5,,,1,1)",
            "T2 F100 -20 T2 T-19.4 F100 -35 T2 T-34.3 F100 -45 T2 T-44.1 F100 -50 T2 T-49 F100 -53.5 T2 T-52.43 F100 \
                -57 T10",
        ),
        // Factor 0.5, never below 4: 20, 30, 35, 39, 43, 47; the last takes the remaining 3. Dwells: 1 s at depths, 2 s
        // above, 3 s below.
        (
            "CYCLE83(10,0,2,-46,,-20,,-0.5,1,2,1,1,3,4,,3,2)",
            "T2 F100 -20 P1 T2 P2 T-18 F100 -30 P1 T2 P2 T-28 F100 -35 P1 T2 P2 T-33 F100 -39 P1 T2 P2 T-37 F100 -43 \
                P1 T2 P2 T-41 \
             F100 -46 P3 T10",
        ),
        // No degression: 20, 40, and 17 remain: below twice 20, two strokes share the depth that remains after the
        // first.
        ("CYCLE83(10,0,2,-50,,,20,0)", "T2 F100 -20 F100 -19 F100 -35 F100 -34 F100 -50 T10"),
        ("CYCLE83(10,0,2,-5,,,20,0)", "T2 F100 -5 T10"),
    ] {
        assert_eq!(drilled("", call), along_z(path), "{call}");
    }
    // In inches the retract distance is 1 mm = 0.0394 inch: our value, not the inch that the control reportedly uses.
    let inch = calls("T1 M6\nG20\nF10\nG0 X1 Y2 Z2\n(BEGIN)\nCYCLE83(1,0,.1,-2,,,1,0)\n(END)\nM2\n");
    assert_eq!(inch, along_z("T0.1 F10 -1 F10 -0.9606 F10 -2 T1"));
}

#[test]
fn taps_and_bores_handle_the_spindle() {
    // Oriented stop, M3 with SST, in and out synchronised, RTP; then S and the direction of SDAC.
    let tap = |pitch: &str, start: &str, speed: &str, after: &str| {
        format!(
            "G0 1 2 2\nORIENT_SPINDLE(0, 90.0000, 0)\nSET_SPINDLE_MODE(0 0.0000)\nS \
                {speed}\n{start}\nSTART_SPEED_FEED_SYNC({pitch},0)\n\
             RIGID_TAP(1.0000, 2.0000, -20.0000)\nSTOP_SPEED_FEED_SYNCH()\nG0 1 2 10\nS 500\n{after}"
        )
    };
    let [cw, ccw, stop] =
        ["START_SPINDLE_CLOCKWISE(0)", "START_SPINDLE_COUNTERCLOCKWISE(0)", "STOP_SPINDLE_TURNING(0)"];
    assert_eq!(drilled("", "CYCLE84(10,0,2,-20,,,3,6,,90,300)"), tap("1.000000", cw, "300", cw));
    assert_eq!(drilled("", "CYCLE84(10,0,2,-20,,,5,-10,,90,300)"), tap("1.500000", ccw, "300", stop));
    // Twenty threads per inch are 1.27 mm.
    assert_eq!(drilled("", "CYCLE84(10,0,2,-20,,,4,,20,90,300,,,2)"), tap("1.270000", cw, "300", ccw));
    assert_eq!(
        drilled("", "CYCLE87(10,0,2,-20,,3)"),
        format!("{cw}\nG0 1 2 2\nG1 1 2 -20\n{stop}\nPROGRAM_STOP()\nG0 1 2 10")
    );
    assert_eq!(
        drilled("", "CYCLE86(10,0,2,-20,,1,4,1,-1,1,45)"),
        format!(
            "{ccw}\nG0 1 2 2\nG1 1 2 -20\nG4 1\nORIENT_SPINDLE(0, 45.0000, 0)\nG0 2 1 -19\nG0 2 1 2\nG0 2 1 10\nG0 1 \
                2 10"
        )
    );
}

#[test]
fn drilling_goes_along_the_normal_of_the_plane() {
    assert_eq!(drilled("G18", "CYCLE81(10,0,2,-20)"), "G0 1 2 50\nG1 1 -20 50\nG0 1 10 50");
}

/// Without a library no cycle can be called.
#[test]
fn a_machine_without_cycles_knows_none() {
    assert!(canon_text("CYCLE81(10,0,2,-20)\nM2\n").1);
}

/// Returns the state as a program reads it through its parameters: modes, plane, feed and speed.
fn state(modes: &str, motion: &str, call: &str) -> String {
    let shown = "#<_motion_mode> #<_plane> #<_absolute> #<_units_per_minute> #<_units_per_rev> #<_feed> #<_rpm> \
        #<_spindle_rpm_mode> \
                 #<_spindle_css_mode> #<_lathe_diameter_mode> #<_ijk_absolute_mode> #<_ccomp> #<_coord_system>";
    let program = format!(
        "T9 M6\nM3 S500\n{modes}\nF77\nG0 X1 Y2 Z50\n{motion} X2\n(BEGIN)\n{call}\n(DEBUG, {shown})\n(PRINT, \
            {shown})\n(END)\nM2\nO<part> sub\nG1 X5 Z0\nZ-10\nX9 Z-14\nX12\nO<part> endsub\n"
    );
    let (text, failed) = canon_text_with(&program, setup());
    assert!(!failed, "{program}\n{text}");
    text.lines().find(|line| line.contains("PRINT") || line.contains("MESSAGE")).map(short).expect("the state")
}

/// Section 1.3, acceptance test 12: motion, plane, distance, feed mode, F, S, spindle mode, diameters, centres,
/// compensation.
#[test]
fn after_every_cycle_the_state_is_as_before() {
    let calls = [
        "CYCLE81(10,0,2,-20)",
        "CYCLE82(10,0,2,-20,,1)",
        "CYCLE83(10,0,2,-57,,,20,5,,,0.5)",
        "CYCLE84(10,0,2,-20,,,3,6,,90,300)",
        "CYCLE85(10,0,2,-20,,1,50,80)",
        "CYCLE86(10,0,2,-20,,1,3,1,-1,1,45)",
        "CYCLE87(10,0,2,-20,,3)",
        "CYCLE88(10,0,2,-20,,1,3)",
        "CYCLE89(10,0,2,-20,,1)",
        "HOLES1(0,0,30,5,10,4)",
        "HOLES2(0,0,20,0,0,6)",
        "MCALL CYCLE83(10,0,2,-57,,,20,5,,,0.5)\nHOLES2(0,0,20,0,0,6)\nMCALL",
    ];
    for modes in [
        "G17",
        "G18 G91",
        "G19 G95",
        "G17 G96 D2000 S100",
        "G18 G7 G61",
        "G20",
        "G90.1 G64 P0.1 Q0.05",
        "G91 G61.1 G55",
    ] {
        for (call, motion) in calls.into_iter().flat_map(|call| [(call, "G0"), (call, "G1"), (call, "G81 Z1 R9")]) {
            if motion.starts_with("G81") && modes != "G17" {
                continue;
            }
            assert_eq!(state(modes, motion, call), state(modes, motion, ""), "{modes} {motion}: {call}");
        }
        let is_turned = modes.contains("G18");
        for vari in (1..=12).filter(|_| is_turned) {
            let call = format!("CYCLE95(\"part\",4,,,,90,50,20,{vari})");
            assert_eq!(state(modes, "G1", &call), state(modes, "G1", ""), "{modes}: {call}");
        }
    }
}

/// The modes that SAVE restores are also emitted as functions, because the machine has received others.
#[test]
fn the_machine_is_told_what_is_in_force_again() {
    let after = |modes: &str, call: &str| {
        let text = drilled(modes, call);
        text.lines().rev().take_while(|line| !line.starts_with("G0")).map(str::to_owned).collect::<Vec<_>>()
    };
    let tap = after("G96 D2000 S500", "CYCLE84(10,0,2,-20,,,3,6,,90,300)");
    assert!(
        tap.iter().any(|call| call == "SET_SPINDLE_MODE(0 2000.0000)") && tap.iter().any(|call| call == "S 500"),
        "{tap:?}"
    );
    assert_eq!(after("", "CYCLE85(10,0,2,-20,,1,50,80)"), ["F 100"]);
}

/// Returns the holes of a modal call along Z, one stroke of CYCLE81(5,0,1,-3) each, by their X and Y.
fn holes(program: &str) -> Vec<String> {
    let text = calls(&format!(
        "T1 M6\nF100\nG0 X0 Y0 Z50\n(BEGIN)\n{program}\n(END)\nM2\nO5 sub\nG0 X7\nO5 endsub\nO6 sub\nMCALL \
            CYCLE81(5,0,1,-4)\nG0 X8\nO6 endsub\n"
    ));
    let feeds = text.lines().filter_map(|line| line.strip_prefix("G1 "));
    feeds.map(str::to_owned).collect()
}

#[test]
fn a_modal_cycle_runs_behind_every_block_with_a_position() {
    let modal = "MCALL CYCLE81(5,0,1,-3)\n";
    for (blocks, wanted) in [
        ("X1\nG0 Y2\nX3 Y4\nMCALL\nX9", "1 0 -3, 1 2 -3, 3 4 -3"),
        // A distance of zero counts, a block without a position does not.
        ("X0\nM8\nS5\n(comment)\nF50\nG91\nG0\nG90 X0", "0 0 -3, 0 0 -3"),
        // A word of the drilling axis counts.
        ("Z20", "0 0 -3"),
        // A new modal call replaces the old one.
        ("X1\nMCALL CYCLE81(5,0,1,-4)\nX2", "1 0 -3, 2 0 -4"),
        // A modal call does not act at another level of calls; one of a subprogram ends with it.
        ("X1\nO5 call\nX2", "1 0 -3, 2 0 -3"),
        ("X1\nMCALL\nO6 call\nX2", "1 0 -3, 8 0 -4"),
        // A cycle inside the modal call does not trigger it again; a pattern triggers it at each of its holes.
        ("CYCLE81(5,0,1,-9)\nX1", "0 0 -9, 1 0 -3"),
        ("HOLES1(10,0,0,5,10,3)", "15 0 -3, 25 0 -3, 35 0 -3"),
        // From the far end: the nearer hole first.
        ("MCALL\nG0 X50\nMCALL CYCLE81(5,0,1,-3)\nHOLES1(10,0,0,5,10,3)", "35 0 -3, 25 0 -3, 15 0 -3"),
        ("HOLES1(0,0,90,0,10,2)", "0 0 -3, 0 10 -3"),
        ("HOLES2(0,0,20,0,0,4)", "20 0 -3, 0 20 -3, -20 0 -3, 0 -20 -3"),
        ("HOLES2(0,0,20,0,0,6)", "20 0 -3, 10 17.3205 -3, -10 17.3205 -3, -20 0 -3, -10 -17.3205 -3, 10 -17.3205 -3"),
        ("HOLES2(1,2,20,90,45,2)", "1 22 -3, -13.1421 16.1421 -3"),
        ("G91 HOLES2(1,2,20,90,45,1)", ""),
        ("G91\nHOLES2(1,2,20,90,45,1)\nX1", "1 22 -3, 2 22 -3"),
    ] {
        if wanted.is_empty() {
            let text = format!("T1 M6\nF1\n{blocks}\nM2\n");
            assert!(canon_text_with(&text, setup()).1, "{blocks}");
            continue;
        }
        assert_eq!(holes(&format!("{modal}{blocks}")).join(", "), wanted, "{blocks}");
    }
}

/// Acceptance tests 2, 3 and 11, and the table of section 13.1: the alarm, and no function after the call.
#[test]
fn alarms_come_before_any_motion() {
    for (call, alarm) in [
        ("CYCLE81(-10,0,2,-20)", "61101"),
        ("CYCLE81(0,0,2,,20)", "61101"),
        ("CYCLE81(10,0,2)", "61808"),
        ("F0\nCYCLE81(10,0,2,-20)", "61003"),
        ("G41 D1\nCYCLE81(10,0,2,-20)", "61815"),
        ("CYCLE83(10,0,2,-57,,5,,5)", "61107"),
        ("CYCLE83(10,0,2,-57,,,20,5,,,1,2)", "61002"),
        ("CYCLE84(10,0,2,-20,,,2,6)", "61102"),
        ("CYCLE84(10,0,2,-20,,,3)", "61001"),
        ("CYCLE84(10,0,2,-20,,,3,6,2)", "61001"),
        ("CYCLE86(10,0,2,-20,,1,5)", "61102"),
        ("HOLES1(0,0,0,0,5,0)", "61103"),
        ("HOLES2(0,0,20,0,0,0)", "61103"),
        ("HOLES2(0,0,0,0,0,4)", "61002"),
        ("CYCLE95(\"part\",4,,,,90,50,20,0)", "61002"),
        ("CYCLE95(\"part\",4,,,,90,50,20,13)", "61002"),
        ("CYCLE95(\"part\",4,,,,90,50,20,200)", "61002"),
        ("CYCLE95(\"part\",0,,,,90,50,20,1)", "61610"),
        ("CYCLE95(\"thread\",4,,,,90,50,20,1)", "10930"),
        ("CYCLE95(\"two\",4,,,,90,50,20,1)", "10933"),
        ("CYCLE95(\"left\",4,,,,90,50,20,1)", "10931"),
        ("CYCLE95(\"axis\",4,,,,90,50,20,1)", "61605"),
        ("CYCLE95(\"tool\",4,,,,90,50,20,1)", "61605"),
        ("CYCLE95(,4,,,,90,50,20,1)", "61605"),
    ] {
        let plane = if call.contains("CYCLE95") { "G18" } else { "G17" };
        let program = format!(
            "T1 M6\nM3 S500 F100\n{plane} G0 X80 Y0 Z80\n(BEGIN)\n{call}\nM2\nO<part> sub\nG1 X5 Z0\nZ-10\nX9 \
                Z-14\nX12\nO<part> endsub\n\
             O<thread> sub\nG1 X5 Z0\nZ-10\nG33 Z-12 K1\nG1 X12\nO<thread> endsub\nO<two> sub\nG1 X5 Z0\nX12\nO<two> \
             endsub\n\
             O<left> sub\nG41 G1 X5 Z0\nZ-10\nX9\nX12\nO<left> endsub\nO<axis> sub\nG1 X5\nZ-10\nX9\nX12\nO<axis> \
             endsub\n\
             O<tool> sub\nG1 X5 Z0\nZ-10\nT1 M6\nX12\nO<tool> endsub\n"
        );
        let found = retrace_gcode::check(program.as_bytes(), setup());
        assert!(
            found.iter().any(|found| found.number() == "E1823" && found.message.contains(alarm)),
            "{call}: {found:?}"
        );
        let (text, failed) = canon_text_with(&program, setup());
        let behind = text.lines().skip_while(|line| !line.contains("BEGIN")).skip(1);
        let moved = behind.filter(|line| {
            ["TRAVERSE", "STRAIGHT_FEED", "ARC", "DWELL", "SPINDLE"].iter().any(|name| line.contains(name))
        });
        assert!(failed && moved.count() == 0, "{call}: {text}");
    }
    // Both depths given and different: the relative one, and a warning.
    let found = retrace_gcode::check("T1 M6\nF100\nCYCLE81(10,0,2,-20,15)\nM2\n", setup());
    assert!(found.iter().any(|found| found.number() == "W1003" && found.message.contains("62802")), "{found:?}");
}
