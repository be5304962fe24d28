//! The machine's cutters and materials as the interpreter needs them.
//!
//! Invariant: every figure of the material table reaches the program; a machine without a table has no cutting words.

use std::sync::Arc;

use retrace_config::{CutterKind, MachineConfig, MaterialConfig, ZWords};
use retrace_gcode::{CuttingSetup, CuttingTool, Material, MaterialList, SpindleUse};
use retrace_link::channel;

/// Cutters and materials for an interpreter; `None` where no cutter has a material table.
pub(crate) fn cutting_setup(machine: &MachineConfig) -> Option<Arc<CuttingSetup>> {
    let table = &machine.materials.as_ref()?.table;
    let cutter = machine.cutters.iter().find(|cutter| cutter.materials.is_some())?;
    let mut tools: Vec<CuttingTool> = machine
        .cutters
        .iter()
        .filter_map(|cutter| {
            let uses_speed = matches!(cutter.kind, CutterKind::Spindle | CutterKind::Beam);
            let jet = cutter.jet.as_ref();
            Some(CuttingTool {
                spindle: cutter.spindle?,
                cuts: cutter.kind.cuts_at_rest(),
                uses_speed,
                abrasive: cutter.abrasive.filter(|_| jet.is_some()),
                abrasive_lag_mm: jet.map_or(0.0, |jet| jet.abrasive_lag_mm),
                height_hold_mm: cutter.height.map_or(0.0, |height| height.end_mm),
            })
        })
        .collect();
    tools.sort_by_key(|tool| tool.spindle);
    Some(Arc::new(CuttingSetup {
        materials: Arc::new(MaterialList::new(table.materials().iter().map(material), table.default_number())),
        tools,
        float_travel_mm: cutter.sense.float_travel_mm,
        ignores_z: cutter.z_words == ZWords::Ignored,
    }))
}

/// What M3 starts on a machine without a material table.
pub(crate) fn spindle_use(machine: &MachineConfig) -> SpindleUse {
    match machine.cutter_of(channel::SPINDLE).map(|cutter| cutter.kind) {
        None | Some(CutterKind::Spindle) => SpindleUse::Speed,
        Some(CutterKind::Beam) => SpindleUse::Unknown,
        Some(CutterKind::Torch | CutterKind::Jet | CutterKind::Marker) => SpindleUse::NoSpeed,
    }
}

/// Copies a material of one type to the other. Every field is named, so that a new figure cannot be left out.
macro_rules! copied_material {
    ($of:ident: $From:ident => $To:ident { $($figure:ident),* $(,)? }) => {{
        let $From { $($figure),* } = $of.clone();
        $To { $($figure),* }
    }};
    ($of:ident: $From:ident => $To:ident) => {
        copied_material!($of: $From => $To {
            number, name, thickness_mm, kerf_mm, pierce_height_mm, pierce_delay_s, cut_height_mm, feed_mm_per_min,
            puddle_percent, puddle_s, amps, volts, pause_at_end_s, gas_bar, cut_mode, height_control, creep_percent,
            creep_mm, off_before_mm, over_cut_mm, pierce_mm, pierce_feed_mm_per_min, wiggle_mm, wiggles, circle_mm,
            circles, pierces_in_motion, ramp_height_mm, ramp_delay_percent, ramp_hold_s, creep_feed_mm_per_min,
            low_pressure_pierce, abrasive_g_per_min
        })
    };
}

/// A material of the table, for a program.
fn material(of: &MaterialConfig) -> Material {
    copied_material!(of: MaterialConfig => Material)
}

/// A material of a program, for the table (`--save-materials`).
#[must_use]
pub fn material_config(of: &Material) -> MaterialConfig {
    copied_material!(of: Material => MaterialConfig)
}
