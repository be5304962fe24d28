//! Offsets and tools that are in force while no job runs, as screens show and edit them.
//!
//! Invariant: they are a picture of the parameters and tools of the modal context; a change replaces all of a picture
//! or nothing.

use retrace_config::MachineConfig;
use retrace_gcode::{Axis, ModalSnapshot, Parameters, Pose, Tool, ToolTable, system_name};

use crate::program_facts::ToolFacts;

/// Number of coordinate systems, G54 … G59.3.
pub const WORK_SYSTEMS: usize = 9;

/// First parameter of the origin of coordinate system 1; those of the next follow at a distance of 20.
const FIRST_ORIGIN: usize = 5221;
const SYSTEM_PARAMETERS: usize = 20;

/// Place of a system's rotation behind its origin.
const ROTATION: usize = 9;

/// Parameters of G92: whether its offset is in force, and the first axis.
const G92_ACTIVE: usize = 5210;
const FIRST_G92: usize = 5211;

/// Coordinate system.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WorkSystem {
    /// G54 … G59.3.
    pub name: String,
    /// Machine position of its origin, mm (degrees), for each axis of the machine.
    pub origin: Vec<f64>,
    /// Rotation about Z, degrees.
    pub rotation_deg: f64,
}

/// Offsets and tools.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WorkTables {
    /// Coordinate systems.
    pub systems: Vec<WorkSystem>,
    /// Offset of G92, mm (degrees), for each axis of the machine.
    pub g92: Vec<f64>,
    /// Whether the offset of G92 is in force.
    pub g92_is_active: bool,
    /// Tools.
    pub tools: Vec<ToolFacts>,
    /// Number of the tool whose length is in force.
    pub tool_in_use: Option<u32>,
}

/// Replacement of the tables: those that the operator saw, and the new ones.
#[derive(Clone, Debug, PartialEq)]
pub struct TableChange {
    /// Tables that the operator saw.
    pub before: WorkTables,
    /// New tables.
    pub after: WorkTables,
}

impl WorkTables {
    /// Tables of this modal state, for a machine of these axes; `name_of` has the names of tools.
    #[must_use]
    pub fn of(machine: &MachineConfig, modal: &ModalSnapshot, name_of: impl Fn(u32) -> String) -> Self {
        let (parameters, state) = (modal.parameters(), modal.state());
        let values = |first: usize| machine.axes.iter().map(|axis| parameters.get(first + axis.index())).collect();
        let system = |number: usize| {
            let first = FIRST_ORIGIN + number * SYSTEM_PARAMETERS;
            WorkSystem {
                name: system_name(number as u8 + 1).to_owned(),
                origin: values(first),
                rotation_deg: parameters.get(first + ROTATION),
            }
        };
        let tool = |tool: &Tool| ToolFacts {
            number: tool.number,
            diameter_mm: tool.diameter,
            length_mm: tool.offset[Axis::Z],
            name: name_of(tool.number),
        };
        Self {
            systems: (0..WORK_SYSTEMS).map(system).collect(),
            g92: values(FIRST_G92),
            g92_is_active: parameters.get(G92_ACTIVE) != 0.0,
            tools: modal.tools().tools().map(tool).collect(),
            tool_in_use: (state.tool_offset != Pose::ZERO).then_some(state.current_tool),
        }
    }
}

impl TableChange {
    /// Parameters and tools after this change: what it does not name stays.
    #[must_use]
    pub fn applied_to(&self, machine: &MachineConfig, modal: &ModalSnapshot) -> (Parameters, ToolTable) {
        let (mut parameters, mut tools) = (modal.parameters().clone(), modal.tools().clone());
        let mut set = |number: usize, before: f64, after: f64| {
            if before.to_bits() != after.to_bits() {
                parameters.set(number, after);
            }
        };
        let systems = self.before.systems.iter().zip(&self.after.systems).enumerate();
        for (number, (before, after)) in systems {
            let first = FIRST_ORIGIN + number * SYSTEM_PARAMETERS;
            for (axis, (&before, &after)) in machine.axes.iter().zip(before.origin.iter().zip(&after.origin)) {
                set(first + axis.index(), before, after);
            }
            set(first + ROTATION, before.rotation_deg, after.rotation_deg);
        }
        for (axis, (&before, &after)) in machine.axes.iter().zip(self.before.g92.iter().zip(&self.after.g92)) {
            set(FIRST_G92 + axis.index(), before, after);
        }
        set(G92_ACTIVE, f64::from(self.before.g92_is_active), f64::from(self.after.g92_is_active));
        for tool in self.after.tools.iter().filter(|tool| !self.before.tools.contains(tool)) {
            let mut changed = tools.get(tool.number).unwrap_or(Tool { number: tool.number, ..Tool::default() });
            changed.diameter = tool.diameter_mm;
            changed.offset[Axis::Z] = tool.length_mm;
            tools.insert(changed);
        }
        (parameters, tools)
    }
}
