//! Output of `retrace canon` for CYCLE95, called from programs, compared with manually calculated paths.
//!
//! Invariant: paths are written in the cut axis u and the infeed axis v of the requirements (section 7.4), free side
//! +v, cutting towards -u; each type of machining maps u and v to X and Z differently.

use crate::common;

use common::canon_text_with;
use retrace_gcode::{AxisSet, Setup, ToolTable, cycles::CycleLibrary};
use std::sync::Arc;

/// T2 is a turning tool with the nose towards -X and -Z, radius 0.4; T9 has none.
const TOOLS: &str = "T2 P2 D0.8 Q2\nT9 P9 D0 Q2\n";

fn setup() -> Setup {
    Setup {
        axes: AxisSet::XYZ,
        tools: ToolTable::read(TOOLS).expect("a tool table"),
        cycles: Some(Arc::new(CycleLibrary::shipped())),
        ..Setup::default()
    }
}

/// Mapping of u and v to X (a radius) and Z, for VARI modulo 4.
#[derive(Clone, Copy, Debug)]
struct Lay {
    vari: i32,
}

impl Lay {
    /// Returns X and Z of a point. X stays above 0.
    fn place(self, u: f64, v: f64) -> (f64, f64) {
        match self.vari % 4 {
            1 => (v, u),
            2 => (u + 30.0, v),
            3 => (20.0 - v, u),
            _ => (u + 30.0, -v),
        }
    }
}

/// Converts a list of points in u and v, `-` for no change, to X and Z words.
fn contour(lay: Lay, places: &str) -> String {
    let mut at = (0.0, 0.0);
    let mut lines = String::new();
    for place in places.split_whitespace() {
        let (u, v) = place.split_once(',').expect("a place");
        at = (u.parse().unwrap_or(at.0), v.parse().unwrap_or(at.1));
        let (x, z) = lay.place(at.0, at.1);
        let code = if lines.is_empty() { "G1 " } else { "" };
        lines += &format!("{code}X{x} Z{z}\n");
    }
    lines
}

/// Returns the expected moves: `T` rapid, a number is the feed, then the end.
fn meant(lay: Lay, moves: &str) -> Vec<String> {
    let mut at = (0.0, 0.0);
    let mut list = Vec::new();
    for word in moves.split_whitespace() {
        let (feed, place) = word.split_once(':').expect("a move");
        let (u, v) = place.split_once(',').expect("a place");
        at = (u.parse().unwrap_or(at.0), v.parse().unwrap_or(at.1));
        let (x, z) = lay.place(at.0, at.1);
        list.push(format!("{feed}:{:.3},{:.3}", x + 0.0, z + 0.0));
    }
    list
}

/// Returns the moves of the call, in the same form, from the canonical text; notes of compensation by their side,
/// dwells by their seconds.
fn moves(program: &str) -> Vec<String> {
    let (text, failed) = canon_text_with(program, setup());
    assert!(!failed, "{program}\n{text}");
    let lines =
        text.lines().skip_while(|line| !line.contains("BEGIN")).skip(1).take_while(|line| !line.contains("END"));
    let (mut feed, mut found) = (100.0, Vec::new());
    for line in lines {
        let call = line.get(13..).unwrap_or(line).trim();
        let (name, rest) = call.split_once('(').unwrap_or((call, ""));
        let numbers: Vec<f64> =
            rest.trim_end_matches(')').split(", ").filter_map(|number| number.parse().ok()).collect();
        match name {
            "SET_FEED_RATE" => feed = numbers[0],
            "STRAIGHT_TRAVERSE" => found.push(format!("T:{:.3},{:.3}", numbers[0] + 0.0, numbers[2] + 0.0)),
            "STRAIGHT_FEED" => found.push(format!("{feed}:{:.3},{:.3}", numbers[0] + 0.0, numbers[2] + 0.0)),
            // In G18 the end is printed as Z X, then the centre.
            "ARC_FEED" => found.push(format!("{feed}:{:.3},{:.3}", numbers[1] + 0.0, numbers[0] + 0.0)),
            "DWELL" => found.push(format!("P{}", numbers[0])),
            "COMMENT" if rest.contains("compensation on left") => found.push("G41".to_owned()),
            "COMMENT" if rest.contains("compensation on right") => found.push("G42".to_owned()),
            "COMMENT" if rest.contains("compensation off") => found.push("G40".to_owned()),
            _ => {}
        }
    }
    found
}

/// A program that calls CYCLE95 with a contour as a subprogram.
fn program(tool: &str, call: &str, contour: &str) -> String {
    format!(
        "T{tool} M6\nG18 M3 S500 F100\nG90 G0 X80 Z80\n(BEGIN)\n{call}\n(END)\nM2\nO<part> sub\n{contour}O<part> \
            endsub\n"
    )
}

/// Two cylinders, a taper between them, a shoulder of radius 12: it only rises.
const RISING: &str = "0,5 -10,5 -14,9 -20,9 -20,12";
const FALLING: &str = "-20,12 -20,9 -14,9 -10,5 0,5";
/// A relief cut of depth 3 behind a cylinder of radius 6.
const RELIEF: &str = "0,6 -10,6 -13,3 -18,3 -18,8 -20,8";

/// RISING with MID 4: D = 12 - 5 = 7 takes 2 levels of 3.5, at 8.5 and 5. P is 1 above and 1 in front: 1,13.
const ROUGH_RISING: &str = "T:1,13 T:1,8.5 90:-13.5,8.5 90:-14,9 90:-20,9 90:-20,12 T:-19,13 T:1,13 \
    T:1,5 90:-10,5 90:-13.5,8.5 T:-12.5,9.5 T:1,9.5 T:1,13";

/// RELIEF with MID 4: D = 8 - 6 = 2, one level at 6, the relief bridged, up to the top at 8 and no further; then the
/// relief of depth 3 in one level, plunged into along its flank with FF2.
const ROUGH_RELIEF: &str = "T:1,9 T:1,6 90:-18,6 90:-18,8 T:-17,9 T:1,9 \
    T:-10,9 T:-10,7 50:-10,6 50:-13,3 90:-18,3 90:-18,6 T:-17,7 T:-17,9 T:1,9";

#[test]
fn every_type_roughs_rising_falling_and_relieved_contours() {
    for vari in [1, 2, 3, 4, 201, 202, 203, 204] {
        let lay = Lay { vari };
        for (places, path) in [(RISING, ROUGH_RISING), (FALLING, ROUGH_RISING), (RELIEF, ROUGH_RELIEF)] {
            let call = format!("CYCLE95(\"part\",4,,,,90,50,20,{vari})");
            assert_eq!(moves(&program("9", &call, &contour(lay, places))), meant(lay, path), "{vari}: {places}");
        }
    }
}

/// Finishing without a nose: to P with the infeed axis first, in front of the programmed start; the contour once at FF3
/// between G41 or G42 and G40; back to P, both axes at once where the end is the highest point, otherwise the infeed
/// axis first.
#[test]
fn every_type_finishes_along_the_programmed_contour() {
    for vari in [5, 6, 7, 8, 205, 206, 207, 208] {
        let lay = Lay { vari };
        for (places, path) in [
            (RISING, "T:-,13 T:1,13 T:0,5 20:-10,5 20:-14,9 20:-20,9 20:-20,12 T:1,13"),
            (RELIEF, "T:-,9 T:1,9 T:0,6 20:-10,6 20:-13,3 20:-18,3 20:-18,8 20:-20,8 T:1,9"),
            // As programmed, towards +u: P is beyond the other end, and the end is not the highest point.
            (FALLING, "T:-,13 T:-21,13 T:-20,12 20:-20,9 20:-14,9 20:-10,5 20:0,5 T:0,13 T:-21,13"),
        ] {
            let call = format!("CYCLE95(\"part\",0,,,,90,50,20,{vari})");
            let compensation = if is_right(vari, places == FALLING) { "G42" } else { "G41" };
            let (from, path) = path.split_once(' ').expect("the first move");
            // The tool comes from X80 Z80: the infeed axis moves first.
            let (x, z) = lay.place(0.0, from[4..].parse().expect("v"));
            let first = if vari % 2 == 1 { format!("T:{x:.3},80.000") } else { format!("T:80.000,{z:.3}") };
            let wanted = [vec![first], meant(lay, path)].concat();
            let found = moves(&program("9", &call, &contour(lay, places)));
            assert_eq!(
                found.iter().filter(|word| word.contains(':')).cloned().collect::<Vec<_>>(),
                wanted,
                "{vari}: {places}"
            );
            // On with the move to the contour, off with the one after it.
            assert_eq!((found[2].as_str(), found[3 + places.split(' ').count()].as_str()), (compensation, "G40"));
        }
    }
}

/// Outside longitudinal towards -Z the tool is on the right; each mirroring and each reversal of direction changes the
/// side.
fn is_right(vari: i32, backwards: bool) -> bool {
    matches!(vari % 4, 1 | 0) != backwards
}

/// Roughing and finishing in one call: the tool continues from P, and the last pass removes what the allowances have
/// left.
#[test]
fn complete_is_roughing_and_finishing_in_the_direction_of_the_cut() {
    for vari in [9, 10, 11, 12, 209, 212] {
        let lay = Lay { vari };
        let finish = "T:0,5 20:-10,5 20:-14,9 20:-20,9 20:-20,12 T:1,13";
        for places in [RISING, FALLING] {
            let call = format!("CYCLE95(\"part\",4,,,,90,50,20,{vari})");
            let mut found = moves(&program("9", &call, &contour(lay, places)));
            found.retain(|word| word.contains(':'));
            assert_eq!(found, meant(lay, &format!("{ROUGH_RISING} {finish}")), "{vari}: {places}");
        }
    }
}

/// Allowances 0.1 along Z and 0.2 along X move RISING to v 5.2, 9.2, 12.2 and the wall to u -19.9; the taper keeps its
/// slope. P is at 1.1, 13.2; levels 8.7 and 5.2; each cut stops after a distance of 6 mm for 2 s, not at its end: the
/// second is 11 long.
#[test]
fn allowances_move_the_rough_contour_and_cuts_are_interrupted() {
    let found = moves(&program("9", "CYCLE95(\"part\",4,0.1,0.2,,90,50,20,1,2,6)", &contour(Lay { vari: 1 }, RISING)));
    let wanted = meant(
        Lay { vari: 1 },
        "T:1.1,13.2 T:1.1,8.7 90:-4.9,8.7 90:-10.9,8.7 90:-13.4,8.7 90:-13.9,9.2 90:-19.9,9.2 90:-19.9,12.2 \
            T:-18.9,13.2 T:1.1,13.2 \
         T:1.1,5.2 90:-4.9,5.2 90:-9.9,5.2 90:-13.4,8.7 T:-12.4,9.7 T:1.1,9.7 T:1.1,13.2",
    );
    assert_eq!(found.iter().filter(|word| *word != "P2").cloned().collect::<Vec<_>>(), wanted);
    let stops: Vec<usize> = (0..found.len()).filter(|index| found[*index] == "P2").collect();
    assert_eq!(stops, [3, 5, 14]);
    // FAL is added to both.
    let along = moves(&program("9", "CYCLE95(\"part\",4,,0.1,0.1,90,50,20,1,2,6)", &contour(Lay { vari: 1 }, RISING)));
    assert_eq!(along, found);
}

/// A nose of 0.4 towards -X and -Z. Its tip is on cylinders and faces; along the taper (x + z = -5) the centre stays
/// 0.4 off, so the tip runs on x + z = -5 - 0.4 (2 - sqrt 2) = -5.2343: it enters the taper at 5, -10.2343. Around the
/// edge at 9, -14 the centre turns from the normal of the taper to that of the cylinder: tip from 9 - 0.1172, -14.1172
/// to 9, -14.4. The last wall ends where the centre is at X12: the tip at 11.6.
#[test]
fn finishing_keeps_the_nose_off_the_contour() {
    let found = moves(&program("2", "CYCLE95(\"part\",4,,,,90,50,20,5)", &contour(Lay { vari: 1 }, RISING)));
    let path = [
        "20:5.000,-10.234",
        "20:8.883,-14.117",
        "20:9.000,-14.400",
        "20:9.000,-20.000",
        "20:11.600,-20.000",
        "G40",
        "T:13.000,1.000",
    ];
    assert_eq!(found[found.len() - path.len()..], path);
    // Roughing keeps the same distance without compensation: levels 8.5 and 5.
    let found = moves(&program("2", "CYCLE95(\"part\",4,,,,90,50,20,1)", &contour(Lay { vari: 1 }, RISING)));
    assert!(!found.iter().any(|word| word.starts_with('G')), "{found:?}");
    let first = [
        "T:13.000,1.000",
        "T:8.500,1.000",
        "90:8.500,-13.734",
        "90:8.883,-14.117",
        "90:9.000,-14.400",
        "90:9.000,-20.000",
    ];
    assert_eq!(found[..first.len()], first);
}

/// The worked example of section 8 in canonical text: all rows of VARI 1 and 9 outside, 3 and 11 inside, to half a
/// thousandth.
#[test]
fn the_worked_example_comes_out_of_the_command_row_by_row() {
    const ROWS: &str = include_str!("../../../cycles/tests/testsuite/stock/worked_example.txt");
    let outside = "G1 X20 Z0\nZ-12\nX32 Z-18\nZ-24\nX26 Z-30\nZ-38\nX44\nG3 X50 Z-41 I0 K-3\nG1 Z-50\n";
    let inside = "G1 X60 Z0\nZ-12\nX48 Z-18\nZ-24\nX54 Z-30\nZ-38\nX36\nG2 X30 Z-41 I0 K-3\nG1 Z-50\n";
    for (vari, contour, side) in [(1, outside, 0), (9, outside, 0), (3, inside, 1), (11, inside, 1)] {
        let call = format!("G7\nCYCLE95(\"part\",2.8,0.1,0.2,,0.3,0.15,0.1,{vari})\nG8");
        // An inside contour begins at its bore.
        let program = program("9", &call, contour)
            .replace("G0 X80 Z80", "G0 X10 Z80")
            .replace("G1 X20", "G7 G1 X20")
            .replace("G1 X60", "G7 G1 X60");
        let mut found = moves(&program);
        found.retain(|word| word.contains(':'));
        let rows = ROWS.lines().filter(|line| !line.starts_with(';')).map(|line| line.split(' ').collect::<Vec<_>>());
        let rows: Vec<_> = rows.filter(|row| vari > 4 || !row[0].starts_with('3')).collect();
        assert_eq!(found.len(), rows.len(), "{vari}: {found:?}");
        for (word, row) in found.iter().zip(rows) {
            let (feed, place) = word.split_once(':').expect("a move");
            let (x, z) = place.split_once(',').expect("two numbers");
            let number = |text: &str| text.parse::<f64>().expect("a number");
            let wanted = match row[6] {
                "FF1" => "0.3",
                "FF2" => "0.15",
                "FF3" => "0.1",
                _ => "T",
            };
            assert_eq!(feed, wanted, "{vari}: {row:?}");
            let distance = (2.0 * number(x) - number(row[3 + side])).abs().max((number(z) - number(row[5])).abs());
            assert!(distance < 0.0011, "{vari}: {row:?} {word}");
        }
    }
}

/// The same contour between labels, in a file of its own, in inches, and called in G91.
#[test]
fn a_contour_may_stand_in_many_places() {
    let wanted = meant(Lay { vari: 1 }, ROUGH_RISING);
    let contour_text = contour(Lay { vari: 1 }, RISING);
    let labels = format!(
        "T9 M6\nG18 M3 S500 F100\nG0 X80 \
            Z80\n(BEGIN)\nCYCLE95(\"FROM:TO\",4,,,,90,50,20,1)\n(END)\nM2\nFROM:\n{contour_text}TO:\n"
    );
    assert_eq!(moves(&labels), wanted);
    let incremental =
        program("9", "G91\nCYCLE95(\"part\",4,,,,90,50,20,1)\nG90", &contour_text.replacen("G1", "G90 G1", 1));
    assert_eq!(moves(&incremental), wanted);
    let numbered = program("9", "CYCLE95(\"77\",4,,,,90,50,20,1)", &contour_text).replace("O<part>", "O77");
    assert_eq!(moves(&numbered), wanted);
    // In inches everything is 25.4 times as large, except for the lift-off, which is 1 mm: P at 0.039, 12.039.
    let inch = moves(
        &program("9", "G20\nCYCLE95(\"part\",4,,,,90,50,20,1)\nG21", &contour_text.replace("X80", "X3"))
            .replace("G0 X80 Z80", "G0 X800 Z80"),
    );
    assert_eq!(inch.first().map(String::as_str), Some("T:12.039,0.039"));
}

/// Absolute centres (G90.1) of the program apply to its contour, not to the cycle's arcs.
#[test]
fn centres_mean_in_the_contour_what_they_mean_in_the_program() {
    let call = "CYCLE95(\"part\",2.8,0.1,0.2,,90,50,20,9)";
    let arcs = |centre: &str| format!("G1 X10 Z0\nZ-12\nX22 Z-38\nG3 X25 Z-41 {centre}\nG1 Z-50\n");
    let incremental = moves(&program("9", call, &arcs("I0 K-3")));
    assert!(incremental.len() > 20);
    assert_eq!(moves(&program("9", &format!("G90.1\n{call}"), &arcs("I22 K-41"))), incremental);
}
