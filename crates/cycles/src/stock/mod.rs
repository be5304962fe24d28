//! Stock removal along a contour (CYCLE95): from contour elements and a job to the list of moves.
//!
//! Invariant: `plan` is a pure function of the job. Every check runs before the first move exists; whatever finite numbers come in,
//! the answer is a path of at most [`MAX_MOVES`] finite moves or a [`Fault`], and numbers that are not finite are refused.
//!
//! The rooms, in the order in which a `job` passes through them: `contour` (reading and checks, with `corner` for chamfers and roundings),
//! `shape` (normalised coordinates, with `frame`), `rough` (allowances, with `envelope` and `nose`), `sections` (profile, relief cuts,
//! levels), `roughing` and `relief` (the cuts), `finish` (the last pass), `pen` (what writes the moves down).

mod contour;
mod corner;
mod curve;
mod envelope;
mod fault;
mod finish;
mod frame;
mod move_writer;
mod nose;
mod params;
mod piece;
mod relief;
mod rough;
mod roughing;
mod sections;
mod segment;
mod shape;

pub use fault::StockRemovalError;

/// The largest number of moves of one path; a job that needs more is refused.
pub const MAX_MOVES: usize = 200_000;

/// The largest magnitude of a coordinate or length that is accepted, in the program's unit.
pub const LARGEST: f64 = 1e6;

/// The lift-off where none is programmed, mm (CYCLE95, `_VRT`).
pub const LIFT_OFF: f64 = 1.0;

/// A point of the machining plane, as plain coordinates (radius values), in the program's unit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    /// First axis of the plane (in G18: Z).
    pub u: f64,
    /// Second axis of the plane (in G18: X, as a radius).
    pub v: f64,
}

impl Point {
    /// The point at these plane coordinates.
    pub const fn new(u: f64, v: f64) -> Self {
        Self { u, v }
    }
}

/// How a contour element was programmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// G0; in a contour it is machined like G1.
    Rapid,
    /// G1.
    Line,
    /// G2, clockwise as seen with the first axis to the right and the second upwards.
    Clockwise,
    /// G3.
    Counterclockwise,
    /// Any other interpolation (G33, ...): refused with alarm 10930.
    Other,
}

/// What stands at the corner between an element and the next one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Corner {
    /// The corner stays sharp.
    #[default]
    None,
    /// CHF: a chamfer of this length.
    ChamferLength(f64),
    /// CHR: a chamfer that takes this much of each element.
    ChamferLeg(f64),
    /// RND: a tangent arc of this radius.
    Rounding(f64),
}

/// One element of the contour, as its subprogram tells it. The first block, which only tells where the contour begins, is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Element {
    /// Line or arc.
    pub kind: Kind,
    /// Where it begins: where the element before it ends.
    pub start: Point,
    /// Where it ends.
    pub end: Point,
    /// Centre of an arc; not looked at for lines.
    pub centre: Point,
    /// What stands at its end, between it and the next element.
    pub corner: Corner,
    /// Line of the source, for messages.
    pub line: u32,
}

/// Where the point lies that the program moves, seen from the centre of the nose, in nose radii: each of -1, 0 or 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ToolTip {
    /// Along the first axis.
    pub u: f64,
    /// Along the second axis.
    pub v: f64,
}

impl ToolTip {
    /// The tip of a turning tool from its orientation 1 to 9 in the tool table of LinuxCNC (first axis Z, second axis X).
    /// Any other number means the centre, as 9 does.
    pub fn of_orientation(number: i32) -> Self {
        let (u, v) = match number {
            1 => (1.0, -1.0),
            2 => (-1.0, -1.0),
            3 => (-1.0, 1.0),
            4 => (1.0, 1.0),
            5 => (1.0, 0.0),
            6 => (0.0, -1.0),
            7 => (-1.0, 0.0),
            8 => (0.0, 1.0),
            _ => (0.0, 0.0),
        };
        Self { u, v }
    }
}

/// What CYCLE95 is asked to do. Lengths in the program's unit; those entered without sign are taken by their magnitude.
#[derive(Clone, Debug, PartialEq)]
pub struct StockRemovalParams {
    /// The contour as programmed.
    pub contour: Vec<Element>,
    /// VARI: 1 to 12, or 201 to 212.
    pub vari: i32,
    /// MID: largest infeed depth (radius value). 0 is refused unless the job is finishing alone.
    pub mid: f64,
    /// FALZ: finishing allowance along the first axis.
    pub fal_z: f64,
    /// FALX: finishing allowance along the second axis (radius value).
    pub fal_x: f64,
    /// FAL: finishing allowance along the contour.
    pub fal: f64,
    /// DAM: path after which a roughing cut dwells; 0 is never.
    pub dam: f64,
    /// _VRT: lift-off; 0 is [`LIFT_OFF`].
    pub vrt: f64,
    /// Radius of the tool's nose.
    pub nose_radius: f64,
    /// Where the programmed point lies at the nose.
    pub tip: ToolTip,
    /// DP24: clearance angle of the tool, degrees; 0 switches the check of falling flanks off.
    pub clearance_angle: f64,
    /// Is roughing compensated for the nose too, as on the 840D? Finishing always is.
    pub rough_compensated: bool,
    /// Where the tool stands at the call, when that is to be checked against the blank.
    pub position: Option<Point>,
}

/// How a move is interpolated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MoveKind {
    /// G0.
    Rapid,
    /// G1.
    Line,
    /// G2.
    Clockwise,
    /// G3.
    Counterclockwise,
}

/// Which feed a move has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Feed {
    /// Rapid traverse.
    Rapid,
    /// FF1.
    Rough,
    /// FF2, plunging into a relief cut.
    Plunge,
    /// FF3.
    Finish,
}

/// Which axes of the plane a move carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// Both at once.
    Both,
    /// The first axis alone; the second keeps its place.
    First,
    /// The second axis alone.
    Second,
}

/// What a move says about cutter radius compensation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compensation {
    /// Nothing.
    Unchanged,
    /// G40: off.
    Off,
    /// G41: the tool is left of the contour.
    Left,
    /// G42: the tool is right of the contour.
    Right,
}

/// One move of the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// Line, arc or rapid.
    pub kind: MoveKind,
    /// Where it ends.
    pub end: Point,
    /// Centre of an arc; equal to `end` for anything else.
    pub centre: Point,
    /// Which feed.
    pub feed: Feed,
    /// Which axes.
    pub axes: Axes,
    /// Compensation switched with this move.
    pub compensation: Compensation,
    /// Does the tool dwell (DT) at its end?
    pub dwell_after: bool,
}

/// What is legal and worth telling.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Warning {
    /// A parameter that is entered without sign was negative; its magnitude is taken.
    SignDropped(&'static str),
    /// So many relief cuts close up under allowances and nose, and are left to finishing.
    ReliefLeftToFinishing(usize),
    /// The nose does not reach all of the contour at this line, so roughing leaves more there.
    NoseLeavesStock(u32),
}

/// What `plan` answers.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// The cycle's start point, where it also ends.
    pub start: Point,
    /// The moves, from wherever the tool stands to the start point and through the work.
    pub moves: Vec<Move>,
    /// What is worth telling.
    pub warnings: Vec<Warning>,
}

/// The path of a job, or why there is none.
///
/// # Errors
/// A [`Fault`] with the control's alarm number; nothing has moved then.
pub fn plan(job: &StockRemovalParams) -> Result<Path, StockRemovalError> {
    params::carry_out(job)
}
