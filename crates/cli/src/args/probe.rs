//! Arguments of `retrace probe`.

use clap::{Args, Subcommand};

use super::manual::MdiOptions;

/// Axis and direction of a touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    /// 1, 2 or 3 for X, Y or Z.
    pub axis: u8,
    /// 1 or −1.
    pub sign: i8,
}

/// Parses `x+` … `z-`.
fn direction(text: &str) -> Result<Direction, String> {
    let (axis, sign) = match text.to_ascii_lowercase().as_bytes() {
        &[axis @ b'x'..=b'z', sign @ (b'+' | b'-')] => (axis - b'x' + 1, if sign == b'+' { 1 } else { -1 }),
        _ => return Err("give an axis and the direction of the touch: x+, x-, y+, y-, z+ or z-".into()),
    };
    Ok(Direction { axis, sign })
}

/// Parses a direction in the plane of X and Y.
fn side(text: &str) -> Result<Direction, String> {
    let why = "give an axis and the direction of the touch: x+, x-, y+ or y-";
    direction(text).ok().filter(|direction| direction.axis < 3).ok_or_else(|| why.into())
}

/// Parses the name of an axis, X or Y, into 1 or 2.
fn flat_axis(text: &str) -> Result<u8, String> {
    match text {
        "x" | "X" => Ok(1),
        "y" | "Y" => Ok(2),
        _ => Err("give x or y".into()),
    }
}

/// Parses the code of a work offset, G54 … G59.3, into 1 … 9.
fn work_offset(text: &str) -> Result<u8, String> {
    (1..=9_u8)
        .find(|&system| retrace_gcode::system_name(system).eq_ignore_ascii_case(text))
        .ok_or_else(|| "give G54, G55, G56, G57, G58, G59, G59.1, G59.2 or G59.3".into())
}

/// Parses a length above 0.
fn length(text: &str) -> Result<f64, String> {
    let length = text.parse::<f64>().ok().filter(|mm| (0.001..=100_000.0).contains(mm));
    length.ok_or_else(|| "give a length in mm above 0".into())
}

/// Parses a length of 0 or more.
fn depth(text: &str) -> Result<f64, String> {
    text.parse::<f64>().ok().filter(|mm| (0.0..=100_000.0).contains(mm)).ok_or_else(|| "give a depth in mm".into())
}

/// Parses a signed length.
fn signed(text: &str) -> Result<f64, String> {
    text.parse::<f64>().ok().filter(|mm| mm.abs() <= 100_000.0).ok_or_else(|| "give a length in mm".into())
}

/// Options of the cycles that can set a work offset.
#[derive(Debug, Args)]
pub struct ProbeOptions {
    /// Work offset whose zero the result becomes: G54 … G59.3. Without it the result is only printed, and kept in
    /// `#<_probe_…>`.
    #[arg(long, value_name = "G54", value_parser = work_offset)]
    pub set: Option<u8>,
    #[command(flatten)]
    pub mdi: MdiOptions,
}

/// `retrace probe`
#[derive(Debug, Subcommand)]
#[allow(missing_docs)] // the documentation of clap is complete
pub enum Probe {
    /// Measure a surface along one axis.
    #[command(after_help = "Example:\n  retrace probe surface z- --travel 20 --set G54 --card /dev/ttyUSB0 --machine \
                            mill.toml")]
    Surface {
        /// Axis and direction of the touch: x+, x-, y+, y-, z+, z-.
        #[arg(value_parser = direction)]
        direction: Direction,
        /// Longest way to the surface, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        travel: f64,
        #[command(flatten)]
        options: ProbeOptions,
    },
    /// Measure an edge from above: out over it, down beside the work, back against it.
    #[command(after_help = "Example:\n  retrace probe edge x+ --out 15 --depth 5 --set G54")]
    Edge {
        /// Axis and direction of the touch: x+ for the left edge.
        #[arg(value_parser = side)]
        direction: Direction,
        /// Way from the start, over the work, to a place beside it, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        out: f64,
        /// Depth of the touch below the start, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        depth: f64,
        #[command(flatten)]
        options: ProbeOptions,
    },
    /// Measure an outside corner from above.
    #[command(after_help = "Example:\n  retrace probe outside-corner x+ y+ --out 15 --depth 5 --set G54")]
    OutsideCorner {
        /// Direction of the touch in X: x+ for a corner at the left.
        #[arg(value_parser = side)]
        x: Direction,
        /// Direction of the touch in Y: y+ for a corner at the front.
        #[arg(value_parser = side)]
        y: Direction,
        /// Way from the start, over the work, to a place beside each edge, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        out: f64,
        /// Depth of the touches below the start, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        depth: f64,
        #[command(flatten)]
        options: ProbeOptions,
    },
    /// Measure an inside corner.
    #[command(after_help = "Example:\n  retrace probe inside-corner x- y- --travel 20 --depth 5 --set G54")]
    InsideCorner {
        /// Direction of the touch in X.
        #[arg(value_parser = side)]
        x: Direction,
        /// Direction of the touch in Y.
        #[arg(value_parser = side)]
        y: Direction,
        /// Longest way to a wall, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        travel: f64,
        /// Depth of the touches below the start, mm.
        #[arg(long, value_name = "MM", value_parser = depth)]
        depth: f64,
        #[command(flatten)]
        options: ProbeOptions,
    },
    /// Measure the centre and the diameter of a bore.
    #[command(after_help = "Example:\n  retrace probe bore --diameter 20 --depth 5 --set G54")]
    Bore {
        /// Diameter, about, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        diameter: f64,
        /// Depth of the touches below the start, mm; 0 where the probe is in the bore already.
        #[arg(long, value_name = "MM", value_parser = depth)]
        depth: f64,
        #[command(flatten)]
        options: ProbeOptions,
    },
    /// Measure the centre and the diameter of a boss from above.
    #[command(after_help = "Example:\n  retrace probe boss --diameter 20 --out 10 --depth 5 --set G54")]
    Boss {
        /// Diameter, about, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        diameter: f64,
        /// Way beyond its edges, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        out: f64,
        /// Depth of the touches below the start, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        depth: f64,
        #[command(flatten)]
        options: ProbeOptions,
    },
    /// Measure the middle and the width of a slot.
    #[command(after_help = "Example:\n  retrace probe slot x --width 20 --depth 5 --set G54")]
    Slot {
        /// Axis: x or y.
        #[arg(value_parser = flat_axis)]
        axis: u8,
        /// Width, about, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        width: f64,
        /// Depth of the touches below the start, mm; 0 where the probe is in the slot already.
        #[arg(long, value_name = "MM", value_parser = depth)]
        depth: f64,
        #[command(flatten)]
        options: ProbeOptions,
    },
    /// Measure the middle and the width of a web from above.
    #[command(after_help = "Example:\n  retrace probe web x --width 20 --out 10 --depth 5 --set G54")]
    Web {
        /// Axis: x or y.
        #[arg(value_parser = flat_axis)]
        axis: u8,
        /// Width, about, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        width: f64,
        /// Way beyond its edges, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        out: f64,
        /// Depth of the touches below the start, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        depth: f64,
        #[command(flatten)]
        options: ProbeOptions,
    },
    /// Measure the angle of an edge from above; with --set it turns the work offset in force.
    #[command(after_help = "Example:\n  retrace probe angle y+ --along 80 --out 15 --depth 5 --set G54")]
    Angle {
        /// Axis and direction of the touch.
        #[arg(value_parser = side)]
        direction: Direction,
        /// Way along the edge between the touches, mm, signed.
        #[arg(long, value_name = "MM", value_parser = signed, allow_negative_numbers = true)]
        along: f64,
        /// Way from the start, over the work, to a place beside it, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        out: f64,
        /// Depth of the touches below the start, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        depth: f64,
        #[command(flatten)]
        options: ProbeOptions,
    },
    /// Measure the length of the tool in the spindle at the tool setter, into the tool table and in force (G43).
    #[command(after_help = "Example:\n  retrace probe tool-setter --travel 80 --tools mill.tbl --machine mill.toml")]
    ToolSetter {
        /// Longest way down, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        travel: f64,
        #[command(flatten)]
        options: MdiOptions,
    },
    /// Measure the length of the tool in the spindle at a surface of known height, into the tool table and in force.
    #[command(after_help = "Example:\n  retrace probe tool-at-work --travel 30 --height 0 --tools mill.tbl")]
    ToolAtWork {
        /// Longest way down, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        travel: f64,
        /// Height of the surface in the work offset in force, mm.
        #[arg(long, value_name = "MM", default_value = "0", value_parser = signed, allow_negative_numbers = true)]
        height: f64,
        #[command(flatten)]
        options: MdiOptions,
    },
    /// Measure the effective diameter of the probe's ball in a ring of known size, for `ball_mm` of the machine file.
    #[command(after_help = "Example:\n  retrace probe calibrate --diameter 25.003 --depth 5")]
    Calibrate {
        /// Inner diameter of the ring, mm.
        #[arg(long, value_name = "MM", value_parser = length)]
        diameter: f64,
        /// Depth of the touches below the start, mm; 0 where the probe is in the ring already.
        #[arg(long, value_name = "MM", value_parser = depth)]
        depth: f64,
        #[command(flatten)]
        options: MdiOptions,
    },
}
