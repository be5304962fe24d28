//! The contours and the materials of a program in the report of `retrace check` (CUT-27, CUT-60).
//!
//! Invariant: positions are machine positions; a script gets every contour that is listed, a person the first ones.

use std::fmt::Write as _;

use retrace_config::MachineConfig;
use retrace_controller::{ContourList, PlannedContour};
use retrace_gcode::{FIRST_TEMPORARY_MATERIAL, Material};
use serde_json::{Map, Value, json};

/// Maximum number of contours that are listed for a person.
const MAX_LISTED: usize = 20;

/// The materials and the contours as text, a line each.
pub fn text<const A: usize>(list: &ContourList<A>, machine: &MachineConfig) -> String {
    let mut text = String::new();
    for summary in &list.materials {
        let Some(material) = &summary.material else { continue };
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "\n  {}: {} · cut {:.3} m · rapids {:.3} m",
            material_text(material),
            counted(summary.contours, "contour"),
            summary.cut_mm / 1000.0,
            summary.rapid_mm / 1000.0
        );
    }
    for contour in list.contours.iter().take(MAX_LISTED) {
        let _ = write!(text, "\n  contour {}", contour_text(contour, machine));
    }
    let more = list.count.saturating_sub(MAX_LISTED as u64);
    if more > 0 {
        let _ = write!(text, "\n  and {} more; --json lists them", counted(more, "contour"));
    }
    text
}

fn counted(count: u64, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

/// A contour in one line.
pub fn contour_text<const A: usize>(contour: &PlannedContour<A>, machine: &MachineConfig) -> String {
    let PlannedContour { number, line, cutter, material, length_mm, pierce_mm, end_mm, .. } = contour;
    let sub = contour.subprogram().map(|name| format!(" in {}", crate::escape::name(name))).unwrap_or_default();
    let material = material.as_ref().map(|material| format!(", {}", material_text(material))).unwrap_or_default();
    let place = |at: &[f64; A]| {
        let axes = machine.axes.iter().zip(at).enumerate();
        let across = axes.filter(|(index, _)| Some(*index) != machine.tool_axis());
        let coordinates = across.map(|(_, (axis, mm))| format!("{} {mm:.3}", axis.name.to_ascii_uppercase()));
        coordinates.collect::<Vec<_>>().join(" ")
    };
    format!(
        "{number}: line {line}{sub}, {}{material}, {length_mm:.3} mm, from {} to {}",
        crate::escape::name(cutter),
        place(pierce_mm),
        place(end_mm)
    )
}

/// A material's number, or that it is temporary, and its name.
fn material_text(material: &Material) -> String {
    let number = if material.number >= FIRST_TEMPORARY_MATERIAL {
        "temporary material".to_owned()
    } else {
        format!("material {}", material.number)
    };
    if material.name.is_empty() { number } else { format!("{number} {}", crate::escape::name(&material.name)) }
}

/// Every listed contour.
pub fn contours_json<const A: usize>(list: &ContourList<A>, machine: &MachineConfig) -> Value {
    list.contours.iter().map(|contour| contour_json(contour, machine)).collect()
}

/// A contour of the plan.
pub fn contour_json<const A: usize>(contour: &PlannedContour<A>, machine: &MachineConfig) -> Map<String, Value> {
    let place = |at: &[f64; A]| -> Value {
        let axes = machine.axes.iter().zip(at);
        axes.map(|(axis, mm)| (axis.name.to_string(), json!(mm))).collect::<Map<_, _>>().into()
    };
    let fields = [
        ("number", json!(contour.number)),
        ("line", json!(contour.line)),
        ("subprogram", json!(contour.subprogram())),
        ("location", json!(contour.location.as_ref().map(ToString::to_string))),
        ("cutter", json!(contour.cutter)),
        ("material", json!(contour.material.as_ref().map(|material| material.number))),
        ("length_mm", json!(contour.length_mm)),
        ("pierce_mm", place(&contour.pierce_mm)),
        ("end_mm", place(&contour.end_mm)),
    ];
    fields.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
}

/// Every material that is cut, or whose contours rapids lead to.
pub fn materials_json<const A: usize>(list: &ContourList<A>) -> Value {
    let materials = list.materials.iter().filter_map(|summary| {
        let material = summary.material.as_ref()?;
        Some(json!({
            "number": material.number,
            "name": material.name,
            "contours": summary.contours,
            "cut_mm": summary.cut_mm,
            "rapid_mm": summary.rapid_mm,
        }))
    });
    materials.collect()
}
