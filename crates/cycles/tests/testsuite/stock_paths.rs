//! Golden paths: every VARI over a rising, a falling and a relief contour, next to their manual calculation.
//!
//! Invariant: the lists of the other three positions are those of outside longitudinal turning, mirrored or with the
//! axes swapped. A test checks this, so the manual calculation covers all of them.

use crate::stock;

use retrace_cycles::stock::{Element, Point, StockRemovalParams};
use stock::{blocks, contour, job, path};

const PATHS: &str = include_str!("stock/paths.txt");

/// The contours of outside longitudinal turning, as the calculations in the list take them.
fn longitudinal(name: &str) -> (Vec<Element>, f64) {
    match name {
        "rising" => (contour("G1 X20 Z0\nZ-10\nX40 Z-20\nZ-30"), 6.0),
        "falling" => (contour("G1 X40 Z0\nZ-10\nG2 X32 Z-14 CR=4\nG1 X20\nZ-24"), 6.0),
        "relief" => (contour("G1 X20 Z0\nZ-6\nX12 Z-10\nZ-18\nX30\nZ-26"), 3.0),
        _ => panic!("{name}"),
    }
}

/// Inside: X80 - X. Face: the radius becomes Z, and Z becomes the radius, with 40 mm added so that it stays positive.
fn place(at: Point, face: bool, inside: bool) -> Point {
    let infeed = if inside { 40.0 - at.v } else { at.v };
    if face { Point::new(infeed, at.u + 40.0) } else { Point::new(at.u, infeed) }
}

fn example(name: &str, vari: i32) -> StockRemovalParams {
    let (elements, mid) = longitudinal(name);
    let (face, inside) = (vari % 2 == 0, matches!((vari - 1) % 4, 2 | 3));
    let elements = elements.into_iter().map(|mut element| {
        for point in [&mut element.start, &mut element.end, &mut element.centre] {
            *point = place(*point, face, inside);
        }
        if face != inside {
            element.kind = match element.kind {
                retrace_cycles::stock::Kind::Clockwise => retrace_cycles::stock::Kind::Counterclockwise,
                retrace_cycles::stock::Kind::Counterclockwise => retrace_cycles::stock::Kind::Clockwise,
                kind => kind,
            };
        }
        element
    });
    // Half a millimetre along the cut, one along the infeed.
    let (fal_z, fal_x) = if face { (1.0, 0.5) } else { (0.5, 1.0) };
    StockRemovalParams { fal_z, fal_x, ..job(elements.collect(), vari, mid) }
}

/// The lists: name of the contour, VARI, blocks.
fn lists() -> Vec<(String, i32, Vec<String>)> {
    let mut lists: Vec<(String, i32, Vec<String>)> = Vec::new();
    for line in PATHS.lines().map(|line| line.split(';').next().unwrap_or("").trim()).filter(|line| !line.is_empty()) {
        if let Some(head) = line.strip_prefix("# ") {
            let (name, vari) = head.split_once(" VARI ").unwrap_or_else(|| panic!("{head}"));
            lists.push((name.to_owned(), vari.parse().unwrap_or_else(|_| panic!("{head}")), Vec::new()));
        } else if let Some((_, _, blocks)) = lists.last_mut() {
            blocks.push(line.to_owned());
        }
    }
    lists
}

#[test]
fn every_vari_over_every_contour_is_the_list() {
    let lists = lists();
    assert_eq!(lists.len(), 36);
    for (name, vari, expected) in &lists {
        for hundreds in [0, 200] {
            let found = blocks(&path(&example(name, vari + hundreds)));
            assert_eq!(&found, expected, "{name} VARI {vari}:\n{}", found.join("\n"));
        }
    }
}

/// Returns a block of outside longitudinal turning as expected in another position.
fn moved(block: &str, face: bool, inside: bool) -> String {
    let turned = face != inside;
    let number = |word: &str| word[1..].parse::<f64>().unwrap_or_else(|_| panic!("{word}"));
    let word = |word: &str| match word {
        "G2" if turned => "G3".to_owned(),
        "G3" if turned => "G2".to_owned(),
        "G41" if turned => "G42".to_owned(),
        "G42" if turned => "G41".to_owned(),
        _ if word.starts_with('X') => {
            let v = if inside { 80.0 - number(word) } else { number(word) };
            if face { format!("Z{:.3}", v / 2.0) } else { format!("X{v:.3}") }
        }
        _ if word.starts_with('Z') && face => format!("X{:.3}", 2.0 * (number(word) + 40.0)),
        _ => word.to_owned(),
    };
    let mut words: Vec<String> = block.split(' ').map(word).collect();
    // X comes before Z.
    for place in 1..words.len() {
        if words[place - 1].starts_with('Z') && words[place].starts_with('X') {
            words.swap(place - 1, place);
        }
    }
    words.join(" ")
}

#[test]
fn the_lists_of_the_other_positions_are_the_first_one_turned() {
    let lists = lists();
    for (name, vari, list) in &lists {
        let (face, inside) = (vari % 2 == 0, matches!((vari - 1) % 4, 2 | 3));
        let outside = (vari - 1) / 4 * 4 + 1;
        let first = lists.iter().find(|(other, number, _)| other == name && *number == outside);
        let turned: Vec<String> =
            first.map(|(_, _, list)| list.iter().map(|block| moved(block, face, inside)).collect()).unwrap_or_default();
        assert_eq!(&turned, list, "{name} VARI {vari}");
    }
}
