//! Stock removal along a contour (CYCLE95): converts contour elements and parameters to a list of moves.
//!
//! Invariant: `plan` is a pure function of its parameters. Every check is made before the first move exists. For any
//! finite numbers the result is a path of at most [`MAX_MOVES`] finite moves or a [`StockRemovalError`]; numbers that
//! are not finite are refused.
//!
//! A job passes through these modules in order: `contour` (reading and checks, with `corner` for chamfers and
//! roundings), `shape` (normalised coordinates, with `frame`), `rough` (allowances, with `envelope` and `nose`),
//! `sections` (profile, relief cuts, levels), `roughing` and `relief` (the cuts), `finish` (the last pass),
//! `move_writer` (output of the moves).

mod contour;
mod corner;
mod curve;
mod envelope;
mod error;
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

pub use error::StockRemovalError;

/// Maximum number of moves of one path; a job that needs more is refused.
pub const MAX_MOVES: usize = 200_000;

/// Maximum magnitude of a coordinate or length, in the program's unit.
pub const LARGEST: f64 = 1e6;

/// Lift-off where none is programmed, mm (CYCLE95, `_VRT`).
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
    /// Creates the point at these plane coordinates.
    pub const fn new(u: f64, v: f64) -> Self {
        Self { u, v }
    }
}

/// Motion of a contour element as programmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// G0; machined like G1 in a contour.
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

/// Treatment of the corner between an element and the next one.
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

/// One element of the contour, as read from its subprogram. The first block, which only defines the start of the
/// contour, is not an element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Element {
    /// Line or arc.
    pub kind: Kind,
    /// Start: the end of the previous element.
    pub start: Point,
    /// End.
    pub end: Point,
    /// Centre of an arc; ignored for lines.
    pub centre: Point,
    /// Corner at its end, between it and the next element.
    pub corner: Corner,
    /// Line of the source, for messages.
    pub line: u32,
}

/// Position of the programmed point relative to the centre of the nose, in nose radii: each of -1, 0 or 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ToolTip {
    /// Along the first axis.
    pub u: f64,
    /// Along the second axis.
    pub v: f64,
}

impl ToolTip {
    /// Returns the tip of a turning tool from its orientation 1 to 9 in the tool table of LinuxCNC (first axis Z,
    /// second axis X). Any other number means the centre, as 9 does.
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

/// Parameters of CYCLE95. Lengths are in the program's unit; only the magnitude counts for those entered without sign.
#[derive(Clone, Debug, PartialEq)]
pub struct StockRemovalParams {
    /// The contour as programmed.
    pub contour: Vec<Element>,
    /// VARI: 1 to 12, or 201 to 212.
    pub vari: i32,
    /// MID: maximum infeed depth (radius value). 0 is refused unless the job is finishing alone.
    pub mid: f64,
    /// FALZ: finishing allowance along the first axis.
    pub fal_z: f64,
    /// FALX: finishing allowance along the second axis (radius value).
    pub fal_x: f64,
    /// FAL: finishing allowance along the contour.
    pub fal: f64,
    /// DAM: distance after which a roughing cut dwells; 0 is never.
    pub dam: f64,
    /// _VRT: lift-off; 0 is [`LIFT_OFF`].
    pub vrt: f64,
    /// Radius of the tool's nose.
    pub nose_radius: f64,
    /// Position of the programmed point at the nose.
    pub tip: ToolTip,
    /// DP24: clearance angle of the tool, in degrees; 0 switches the check of falling flanks off.
    pub clearance_angle: f64,
    /// Whether roughing is compensated for the nose too, as on the 840D. Finishing always is.
    pub rough_compensated: bool,
    /// Position of the tool at the call, if it is to be checked against the blank.
    pub position: Option<Point>,
}

/// Interpolation of a move.
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

/// Feed of a move.
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

/// Axes of the plane that a move has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// Both axes.
    Both,
    /// The first axis alone; the second keeps its position.
    First,
    /// The second axis alone.
    Second,
}

/// Change of cutter radius compensation in a move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compensation {
    /// No change.
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
    /// End of the move.
    pub end: Point,
    /// Centre of an arc; equal to `end` for any other move.
    pub centre: Point,
    /// Feed of the move.
    pub feed: Feed,
    /// Axes of the move.
    pub axes: Axes,
    /// Compensation switched with this move.
    pub compensation: Compensation,
    /// Whether the tool dwells (DT) at its end.
    pub dwell_after: bool,
}

/// A legal condition that is reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Warning {
    /// A parameter that is entered without sign was negative; its magnitude is used.
    SignDropped(&'static str),
    /// This number of relief cuts closes up under allowances and nose, and is left to finishing.
    ReliefLeftToFinishing(usize),
    /// The nose does not reach all of the contour at this line, so roughing leaves more material there.
    NoseLeavesStock(u32),
}

/// Result of `plan`.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// Start point of the cycle, where it also ends.
    pub start: Point,
    /// Moves, from the tool position to the start point and through the work.
    pub moves: Vec<Move>,
    /// Reported conditions.
    pub warnings: Vec<Warning>,
}

/// Returns the path of a job.
///
/// # Errors
/// A [`StockRemovalError`] with the control's alarm number; nothing has moved then.
pub fn plan(job: &StockRemovalParams) -> Result<Path, StockRemovalError> {
    params::execute(job)
}
