//! *Frame*: the rectangle around what a program cuts, or its outline, which the pointer traces before anything is cut
//! (CUT-59).
//!
//! Invariant: no corner is beyond a soft limit, and no cutter is on when the machine begins to trace.

use retrace_config::{CutterKind, MachineConfig, NumberedError};

use crate::contour_list::ContourList;

/// What is traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameShape {
    /// The rectangle along the axes of the machine.
    Rectangle,
    /// The convex hull.
    Outline,
}

/// Polygon around what a program cuts, in machine coordinates of X and Y.
#[derive(Clone, Debug, PartialEq)]
pub struct CutFrame {
    /// Its corners in the order in which they are traced, mm.
    corners_mm: Vec<[f64; 2]>,
    /// What it is.
    pub shape: FrameShape,
}

/// Distance in mm within which the outline is traced.
const OUTLINE_TOLERANCE_MM: f64 = 0.2;

fn refuse(what: impl Into<String>, remedy: &str) -> NumberedError {
    NumberedError::new("E2161", what.into(), remedy.to_owned())
}

/// Indices of the axes X and Y.
fn plane(machine: &MachineConfig) -> Result<[usize; 2], NumberedError> {
    let missing = || refuse("the machine has no axes X and Y to trace a frame with", "a machine with both");
    Ok([machine.axis_of('x').ok_or_else(missing)?, machine.axis_of('y').ok_or_else(missing)?])
}

impl CutFrame {
    /// Frame around the contours of a program: places where a cutter is lit, lead-ins and cuts.
    ///
    /// # Errors
    /// `E2161` where the program cuts nothing, or a place depends on answers of the machine, and where the frame leaves
    /// the soft limits.
    pub fn of_contours<const A: usize>(
        machine: &MachineConfig,
        contours: &ContourList<A>,
        shape: FrameShape,
    ) -> Result<Self, NumberedError> {
        let axes = plane(machine)?;
        let Some(extents) = contours.extents_mm else {
            return Err(refuse("the program lights no cutter: it has no frame", "a program with a contour"));
        };
        let [x, y] = axes.map(|axis| extents[axis]);
        let outline = contours.outline.vertices(OUTLINE_TOLERANCE_MM);
        let Some(outline) = outline.filter(|_| !x[0].is_nan() && !y[0].is_nan()) else {
            let what = "what the program cuts depends on measurements: its frame is not known";
            return Err(refuse(what, "cut it without a frame"));
        };
        for (axis, range) in axes.into_iter().zip([x, y]) {
            for mm in range {
                check_limit(machine, axis, machine.counts_of(axis, mm), "the program would cut at")?;
            }
        }
        let corners_mm = match shape {
            FrameShape::Rectangle => vec![[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]],
            FrameShape::Outline => outline,
        };
        Ok(Self { corners_mm, shape })
    }

    /// Machine position of the tool axis to which it goes up first, mm; `None` where none is set, and the tool stays at
    /// its height.
    #[must_use]
    pub fn safe_height_mm(machine: &MachineConfig) -> Option<f64> {
        let axis = machine.axes.get(machine.tool_axis()?)?;
        let sheet = machine.tool_layer().map(|layer| layer.sensing().sheet_mm + layer.sensing().safe_mm);
        machine.setting_up.retract_mm.or(sheet).map(|mm| mm.min(axis.travel_mm[1]))
    }

    /// Positions at which the pointer shows the corners, in the order in which they are traced, from the first one back
    /// to it. The tool axis is at a safe height. The machine is at `from`.
    ///
    /// # Errors
    /// `E2161` where the machine would leave its soft limits.
    pub(super) fn corners<const A: usize>(
        &self,
        machine: &MachineConfig,
        from: [i64; A],
    ) -> Result<Vec<[i64; A]>, NumberedError> {
        let axes = plane(machine)?;
        let mut start = from;
        if let Some(tool) = machine.tool_axis().filter(|&tool| tool < A) {
            let safe = Self::safe_height_mm(machine).map_or(from[tool], |mm| machine.counts_of(tool, mm));
            start[tool] = safe.max(from[tool]);
        }
        let closed = self.corners_mm.iter().chain(self.corners_mm.first());
        let corners = closed.map(|corner_mm| {
            let mut corner = start;
            for (axis, &mm) in axes.into_iter().zip(corner_mm) {
                corner[axis] = machine.counts_of(axis, mm);
            }
            for &(axis, mm) in &machine.setting_up.pointer_mm {
                if axes.contains(&axis) {
                    corner[axis] -= machine.counts_of(axis, mm);
                }
            }
            corner
        });
        let corners: Vec<[i64; A]> = corners.collect();
        for corner in &corners {
            for axis in axes {
                check_limit(
                    machine,
                    axis,
                    corner[axis],
                    "to show the frame with the pointer the machine would move to",
                )?;
            }
        }
        Ok(corners)
    }
}

/// Checks a count against the soft limits of its axis; the message has the side.
fn check_limit(machine: &MachineConfig, axis: usize, count: i64, what: &str) -> Result<(), NumberedError> {
    let of = &machine.axes[axis];
    let [low, high] = of.travel_mm.map(|mm| machine.counts_of(axis, mm));
    if (low..=high).contains(&count) {
        return Ok(());
    }
    let (letter, mm) = (of.name.to_ascii_uppercase(), of.mm_of(count));
    let (side, limit_mm) = if count < low { ("below", of.travel_mm[0]) } else { ("above", of.travel_mm[1]) };
    let (beyond_mm, which) = ((mm - limit_mm).abs(), if count < low { "lower" } else { "upper" });
    Err(refuse(
        format!("{what} {letter} {mm:.3} mm, {beyond_mm:.3} mm {side} the {which} soft limit, {limit_mm:.3} mm"),
        "move the work offset, or the work",
    ))
}

/// Checks that every torch, jet, beam and marker is off.
///
/// # Errors
/// `E2161`
pub(super) fn require_cutters_off(machine: &MachineConfig, outputs: &[i32]) -> Result<(), NumberedError> {
    let is_on = |channel: u8| outputs.get(usize::from(channel)).is_some_and(|&value| value != 0);
    match machine.cutters.iter().find(|cutter| cutter.kind != CutterKind::Spindle && is_on(cutter.fire)) {
        Some(cutter) => Err(refuse(format!("{} is on", cutter.name), "switch it off: `cutter off`")),
        None => Ok(()),
    }
}
