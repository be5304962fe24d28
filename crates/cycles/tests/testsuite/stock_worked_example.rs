//! The worked example of the requirements (cycles, section 8): every row, to a thousandth of a millimetre.
//!
//! Invariant: the expected rows are the requirement's own table; the calculation of the path is not repeated here.

use crate::stock;

use retrace_cycles::stock::{Compensation, Element, Feed, Move, MoveKind, StockRemovalParams};
use stock::{blocks, contour, job, path};

const OUTSIDE: &str = "G1 X20 Z0\nZ-12\nX32 Z-18\nZ-24\nX26 Z-30\nZ-38\nX44\nG3 X50 Z-41 CR=3\nG1 Z-50";
const INSIDE: &str = "G1 X60 Z0\nZ-12\nX48 Z-18\nZ-24\nX54 Z-30\nZ-38\nX36\nG2 X30 Z-41 CR=3\nG1 Z-50";
/// The outside contour from its other end: arcs turn in the other direction.
const OUTSIDE_BACKWARDS: &str = "G1 X50 Z-50\nZ-41\nG2 X44 Z-38 CR=3\nG1 X26\nZ-30\nX32 Z-24\nZ-18\nX20 Z-12\nZ0";
const ROWS: &str = include_str!("stock/worked_example.txt");

fn example(elements: Vec<Element>, vari: i32) -> StockRemovalParams {
    StockRemovalParams { fal_z: 0.1, fal_x: 0.2, vrt: 0.0, ..job(elements, vari, 2.8) }
}

#[derive(Debug)]
struct Row {
    step: String,
    kind: [MoveKind; 2],
    x: [f64; 2],
    z: f64,
    feed: Feed,
}

fn rows() -> Vec<Row> {
    let kind = |code: &str| match code {
        "G0" => MoveKind::Rapid,
        "G1" => MoveKind::Line,
        "G2" => MoveKind::Clockwise,
        "G3" => MoveKind::Counterclockwise,
        _ => panic!("{code}"),
    };
    let row = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let number = |word: &str| word.parse::<f64>().unwrap_or_else(|_| panic!("{line}"));
        let feed = match words[6] {
            "-" => Feed::Rapid,
            "FF1" => Feed::Rough,
            "FF2" => Feed::Plunge,
            "FF3" => Feed::Finish,
            _ => panic!("{line}"),
        };
        let (kind, x) = ([kind(words[1]), kind(words[2])], [number(words[3]), number(words[4])]);
        Row { step: words[0].to_owned(), kind, x, z: number(words[5]), feed }
    };
    ROWS.lines().filter(|line| !line.starts_with(';')).map(row).collect()
}

fn compare(moves: &[Move], rows: &[Row], inside: usize) {
    for (step, row) in moves.iter().zip(rows) {
        assert_eq!((step.kind, step.feed), (row.kind[inside], row.feed), "{row:?}");
        let (x, z) = (2.0 * step.end.v, step.end.u);
        assert!((x - row.x[inside]).abs() < 0.000_51 && (z - row.z).abs() < 0.000_51, "{row:?}: X{x} Z{z}");
    }
    assert_eq!(moves.len(), rows.len());
}

#[test]
fn roughing_and_complete_machining_outside_and_inside_are_the_table() {
    let all = rows();
    assert_eq!(all.len(), 61);
    let roughing: Vec<Row> = rows().into_iter().filter(|row| !row.step.starts_with('3')).collect();
    for (contour_text, inside, rough, complete) in [(OUTSIDE, 0, 1, 9), (INSIDE, 1, 3, 11)] {
        for hundreds in [0, 200] {
            compare(&path(&example(contour(contour_text), hundreds + rough)).moves, &roughing, inside);
            compare(&path(&example(contour(contour_text), hundreds + complete)).moves, &all, inside);
        }
    }
}

#[test]
fn the_finishing_pass_has_the_tool_on_the_side_without_material() {
    for (contour_text, vari, side) in [(OUTSIDE, 9, Compensation::Right), (INSIDE, 11, Compensation::Left)] {
        let path = path(&example(contour(contour_text), vari));
        let switches: Vec<Compensation> = path
            .moves
            .iter()
            .map(|step| step.compensation)
            .filter(|switch| *switch != Compensation::Unchanged)
            .collect();
        assert_eq!(switches, [side, Compensation::Off]);
        assert_eq!(path.moves.last().map(|step| (step.compensation, step.end)), Some((Compensation::Off, path.start)));
    }
}

#[test]
fn the_contour_programmed_backwards_gives_the_same_roughing_and_complete_machining() {
    for vari in [1, 9] {
        let forwards = blocks(&path(&example(contour(OUTSIDE), vari)));
        let backwards = blocks(&path(&example(contour(OUTSIDE_BACKWARDS), vari)));
        assert_eq!(forwards, backwards);
    }
}

/// P is in front of the programmed start, against the travel: Z-50 - 0.1 - 1, X = 2 (25 + 0.2 + 1). The contour ends
/// low, so the tool leaves with the infeed axis first. Travel is towards +Z with the material below it, on the right:
/// G41.
#[test]
fn finishing_alone_runs_as_programmed() {
    let path = path(&example(contour(OUTSIDE_BACKWARDS), 5));
    stock::expect(
        &path,
        "G0 X52.400
         G0 Z-51.100
         G41 G0 X50.000 Z-50.000
         G1 Z-41.000 FF3
         G2 X44.000 Z-38.000 centre X44.000 Z-41.000 FF3
         G1 X26.000 FF3
         G1 Z-30.000 FF3
         G1 X32.000 Z-24.000 FF3
         G1 Z-18.000 FF3
         G1 X20.000 Z-12.000 FF3
         G1 Z0.000 FF3
         G40 G0 X52.400
         G0 Z-51.100",
    );
}

#[test]
fn finishing_alone_forwards_starts_where_roughing_starts() {
    let alone = path(&example(contour(OUTSIDE), 5));
    let complete = path(&example(contour(OUTSIDE), 9));
    assert_eq!(alone.start, complete.start);
    assert_eq!(blocks(&alone)[..2], ["G0 X52.400", "G0 Z1.100"]);
    assert_eq!(blocks(&alone)[2..], blocks(&complete)[blocks(&complete).len() - 10..]);
}
