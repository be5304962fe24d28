//! `retrace probe`: a probing cycle from the shell, as the MDI block that calls it (PRB-20).
//!
//! Invariant: what it does is what a program does with the same call.

use crate::args::{Direction, MdiOptions, Probe};
use crate::command_failure::CommandFailure;
use crate::manual;

/// Runs the command. Returns its exit code.
///
/// # Errors
/// Whatever prevents the cycle.
pub fn run(cycle: &Probe) -> Result<u8, CommandFailure> {
    let (name, arguments, options) = call(cycle);
    let arguments: String = arguments.iter().map(|value| format!(" [{value}]")).collect();
    manual::mdi(&format!("o<{name}> call{arguments}"), options)
}

/// Returns the name of a cycle, its arguments, and the other options.
fn call(cycle: &Probe) -> (&'static str, Vec<f64>, &MdiOptions) {
    let towards = |direction: &Direction| f64::from(direction.axis) * f64::from(direction.sign);
    let sign = |direction: &Direction| f64::from(direction.sign);
    let offset = |set: Option<u8>| f64::from(set.unwrap_or(0));
    match cycle {
        Probe::Surface { direction, travel, options } => {
            ("probe_surface", vec![towards(direction), *travel, offset(options.set)], &options.mdi)
        }
        Probe::Edge { direction, out, depth, options } => {
            ("probe_edge", vec![towards(direction), *out, *depth, offset(options.set)], &options.mdi)
        }
        Probe::OutsideCorner { x, y, out, depth, options } => {
            ("probe_outside_corner", vec![sign(x), sign(y), *out, *depth, offset(options.set)], &options.mdi)
        }
        Probe::InsideCorner { x, y, travel, depth, options } => {
            ("probe_inside_corner", vec![sign(x), sign(y), *travel, *depth, offset(options.set)], &options.mdi)
        }
        Probe::Bore { diameter, depth, options } => {
            ("probe_bore", vec![*diameter, *depth, offset(options.set)], &options.mdi)
        }
        Probe::Boss { diameter, out, depth, options } => {
            ("probe_boss", vec![*diameter, *out, *depth, offset(options.set)], &options.mdi)
        }
        Probe::Slot { axis, width, depth, options } => {
            ("probe_slot", vec![f64::from(*axis), *width, *depth, offset(options.set)], &options.mdi)
        }
        Probe::Web { axis, width, out, depth, options } => {
            ("probe_web", vec![f64::from(*axis), *width, *out, *depth, offset(options.set)], &options.mdi)
        }
        Probe::Angle { direction, along, out, depth, options } => {
            ("probe_angle", vec![towards(direction), *along, *out, *depth, offset(options.set)], &options.mdi)
        }
        Probe::ToolSetter { travel, options } => ("probe_tool_setter", vec![*travel], options),
        Probe::ToolAtWork { travel, height, options } => ("probe_tool_at_work", vec![*travel, *height], options),
        Probe::Calibrate { diameter, depth, options } => ("probe_calibrate", vec![*diameter, *depth], options),
    }
}
