//! A contour written as a turning program, and a path written for reading: helpers that the tests of stock removal
//! share.
//!
//! Invariant: X is a diameter in both, as in G18 with DIAMON; nothing here depends on how the cycle calculates its
//! path.

pub(crate) mod part;

use retrace_cycles::stock::{
    Axes, Compensation, Corner, Element, Feed, Kind, LIFT_OFF, Move, MoveKind, Path, Point, StockRemovalParams,
    ToolTip, plan,
};

/// Parses the contour of lines such as `G3 X50 Z-41 CR=3`; the first line is the start. A negative CR is the arc of
/// more than half a turn.
pub(crate) fn contour(text: &str) -> Vec<Element> {
    let mut elements = Vec::new();
    let (mut kind, mut at, mut begun) = (Kind::Line, Point::default(), false);
    for (number, line) in text.lines().map(str::trim).filter(|line| !line.is_empty()).enumerate() {
        let (mut end, mut centre, mut radius, mut corner) = (at, at, 0.0, Corner::None);
        for word in line.split_whitespace() {
            let value = |letters: &str| word.strip_prefix(letters).and_then(|number| number.parse::<f64>().ok());
            if let Some(code) = value("G") {
                kind = match code as i32 {
                    0 => Kind::Rapid,
                    1 => Kind::Line,
                    2 => Kind::Clockwise,
                    3 => Kind::Counterclockwise,
                    _ => Kind::Other,
                };
            } else if let Some(number) = value("CR=") {
                radius = number;
            } else if let Some(number) = value("CHF=") {
                corner = Corner::ChamferLength(number);
            } else if let Some(number) = value("CHR=") {
                corner = Corner::ChamferLeg(number);
            } else if let Some(number) = value("RND=") {
                corner = Corner::Rounding(number);
            } else if let Some(number) = value("X") {
                end.v = number / 2.0;
            } else if let Some(number) = value("Z") {
                end.u = number;
            } else if let Some(number) = value("I") {
                centre.v += number;
            } else if let Some(number) = value("K") {
                centre.u += number;
            } else {
                panic!("no word: {word}");
            }
        }
        if radius != 0.0 {
            centre = centre_of(at, end, radius, kind == Kind::Counterclockwise);
        }
        if begun {
            elements.push(Element { kind, start: at, end, centre, corner, line: number as u32 + 1 });
        }
        (at, begun) = (end, true);
    }
    elements
}

fn centre_of(start: Point, end: Point, radius: f64, counterclockwise: bool) -> Point {
    let (du, dv) = (end.u - start.u, end.v - start.v);
    let chord = du.hypot(dv);
    let height = (radius * radius - chord * chord / 4.0).max(0.0).sqrt();
    let left = if counterclockwise == (radius > 0.0) { height } else { -height };
    Point::new((start.u + end.u) / 2.0 - dv / chord * left, (start.v + end.v) / 2.0 + du / chord * left)
}

/// A job without allowances, for a pointed tool.
pub(crate) fn job(contour: Vec<Element>, vari: i32, mid: f64) -> StockRemovalParams {
    StockRemovalParams {
        contour,
        vari,
        mid,
        fal_z: 0.0,
        fal_x: 0.0,
        fal: 0.0,
        dam: 0.0,
        vrt: LIFT_OFF,
        nose_radius: 0.0,
        tip: ToolTip::default(),
        clearance_angle: 0.0,
        rough_compensated: true,
        position: None,
    }
}

/// Returns the path of a job that has one.
pub(crate) fn path(job: &StockRemovalParams) -> Path {
    plan(job).unwrap_or_else(|fault| panic!("{}: {fault}", fault.number()))
}

/// Returns one move as a block with its feed: three decimals, as in the tables of the specification.
pub(crate) fn block(step: &Move) -> String {
    let code = match step.kind {
        MoveKind::Rapid => "G0",
        MoveKind::Line => "G1",
        MoveKind::Clockwise => "G2",
        MoveKind::Counterclockwise => "G3",
    };
    let compensation = match step.compensation {
        Compensation::Unchanged => "",
        Compensation::Off => "G40 ",
        Compensation::Left => "G41 ",
        Compensation::Right => "G42 ",
    };
    let places = |value: f64| {
        let text = format!("{value:.3}");
        if text == "-0.000" { "0.000".to_owned() } else { text }
    };
    let (x, z) = (places(2.0 * step.end.v), places(step.end.u));
    let axes = match step.axes {
        Axes::Both => format!("X{x} Z{z}"),
        Axes::First => format!("Z{z}"),
        Axes::Second => format!("X{x}"),
    };
    let centre = match step.kind {
        MoveKind::Clockwise | MoveKind::Counterclockwise => {
            format!(" centre X{} Z{}", places(2.0 * step.centre.v), places(step.centre.u))
        }
        _ => String::new(),
    };
    let feed = match step.feed {
        Feed::Rapid => "",
        Feed::Rough => " FF1",
        Feed::Plunge => " FF2",
        Feed::Finish => " FF3",
    };
    let dwell = if step.dwell_after { " dwell" } else { "" };
    format!("{compensation}{code} {axes}{centre}{feed}{dwell}")
}

/// Returns all moves of a path as blocks.
pub(crate) fn blocks(path: &Path) -> Vec<String> {
    path.moves.iter().map(block).collect()
}

/// Compares a path with expected blocks, one per line; text after `;` is a comment.
pub(crate) fn expect(path: &Path, expected: &str) {
    let expected: Vec<&str> = expected
        .lines()
        .map(|line| line.split(';').next().unwrap_or("").trim())
        .filter(|line| !line.is_empty())
        .collect();
    let found = blocks(path);
    for (number, (found, expected)) in found.iter().zip(&expected).enumerate() {
        assert_eq!(found, expected, "block {number} of\n{}", found_list(path));
    }
    assert_eq!(found.len(), expected.len(), "number of blocks of\n{}", found_list(path));
}

fn found_list(path: &Path) -> String {
    blocks(path).join("\n")
}
