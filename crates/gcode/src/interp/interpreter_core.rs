//! Data that blocks work on: the modal state, parameters and tools, and the conversion between machine and program
//! units.
//!
//! Invariant: parameters and the tool table are in machine units, the state in program units. The conversion is done
//! here only.

use crate::block_number::BlockNumber;
use crate::canon::{Canon, CanonStep};
use crate::canon_modes::LengthUnit;
use crate::compensation_queue::{CompensationQueue, QueueRole};
use crate::cutting::{CuttingSetup, SpindleUse};
use crate::diag::{BlockError, Span};
use crate::error_codes::ErrorCode;
use crate::eval::Environment;
use crate::modal::ModalState;
use crate::nearest::nearest;
use crate::number_range::LARGEST;
use crate::params::{COORDINATE_SYSTEM, G92_ACTIVE, G92_OFFSET, NameId, Names, Parameters, system_origin};
use crate::pose::{Axis, Pose};
use crate::system::SystemParameter;
use crate::thread_run_in::{self, ThreadRunIn};
use crate::tool::ToolTable;
use crate::turning::Profile;
use crate::unknown::{UNKNOWN, UnknownModes};
use crate::user_codes::UserCodes;
use std::sync::Arc;

/// State and data that blocks work on.
#[derive(Clone, Debug)]
pub(crate) struct Core {
    pub(super) machine_units: LengthUnit,
    pub(crate) state: ModalState,
    pub(super) parameters: Parameters,
    pub(crate) tools: ToolTable,
    /// Angle added to the R word of M19, in degrees.
    pub(super) orient_offset_degrees: f64,
    pub(super) rigid_tapping: bool,
    pub(super) user_codes: UserCodes,
    /// Cutters and materials; `None` on a machine without a material table.
    pub(crate) cutting: Option<Arc<CuttingSetup>>,
    /// What M3 starts where there is no [`CuttingSetup`].
    pub(crate) spindle_use: SpindleUse,
    /// Whether answers of the machine are unknown, and what depends on them.
    pub(super) follows_unknown: bool,
    /// Whether M6 is the call of a subprogram, which is made before a block is executed.
    pub(super) calls_tool_change: bool,
    /// What the machine plans threads with; `None` where it cannot cut any.
    pub(super) threads: Option<Arc<dyn ThreadRunIn>>,
    /// Profile that the subprogram of the next turning cycle has drawn.
    pub(super) profile: Option<Profile>,
}

/// Receiver of the canonical functions of one block.
pub(super) struct Emitter<'a> {
    pub(super) line: u32,
    pub(super) number: Option<BlockNumber>,
    pub(super) steps: &'a mut Vec<CanonStep>,
    /// Functions that wait for the next corner of a compensated path; empty without one.
    pub(super) waiting: &'a mut CompensationQueue,
    /// Warning for this block: legal, but suspicious.
    pub(super) warning: Option<Box<BlockError>>,
}

impl Emitter<'_> {
    /// Sets the warning for this block.
    #[cold]
    pub(super) fn warn(&mut self, code: ErrorCode, at: Span, message: String) {
        self.warning = Some(Box::new(BlockError::new(code, at, message)));
    }

    #[inline]
    pub(super) fn call(&mut self, canon: Canon) {
        if !self.waiting.is_empty() && CompensationQueue::must_wait(&canon) {
            return self.waiting.push(self.line, canon, QueueRole::Other);
        }
        self.steps.push(CanonStep { line: self.line, number: self.number, canon });
    }
}

impl Core {
    /// Loads the offsets in force from the parameters, and sets the machine position in program coordinates.
    pub(super) fn load_parameters(&mut self, position: &Pose) {
        let system = self.parameters.get(COORDINATE_SYSTEM);
        self.state.coordinate_system = if (1.0..=9.0).contains(&system) { system as u8 } else { 1 };
        let first = system_origin(self.state.coordinate_system);
        self.state.origin = self.pose_parameter(first);
        self.state.rotation_degrees = self.parameters.get(first + 9);
        if self.parameters.get(G92_ACTIVE) != 0.0 {
            self.state.g92_offset = self.pose_parameter(G92_OFFSET);
        }
        let position = self.lengths_to_program(position);
        self.state.position = self.relative(&position);
    }

    /// Returns nine parameters from `first`, converted from machine to program units.
    pub(super) fn pose_parameter(&self, first: usize) -> Pose {
        let mut pose = Pose::ZERO;
        for axis in Axis::ALL {
            // No machine is that large, and sums of offsets stay finite.
            pose[axis] = self.parameters.get(first + axis as usize).clamp(-LARGEST, LARGEST);
        }
        self.lengths_to_program(&pose)
    }

    /// Sets nine parameters from `first`, converted from program to machine units.
    pub(super) fn set_pose_parameter(&mut self, first: usize, pose: &Pose) {
        for axis in Axis::ALL {
            self.parameters.set(first + axis as usize, self.to_machine_unit(axis, pose[axis]));
        }
    }

    /// Machine units per millimetre. An inch has LinuxCNC's digits, so that results equal those of its interpreter to
    /// the last digit.
    pub(super) fn machine_units_per_mm(&self) -> f64 {
        match self.machine_units {
            LengthUnit::Inch => 0.039_370_078_740_16,
            LengthUnit::Millimetre => 1.0,
        }
    }

    pub(super) fn to_machine_unit(&self, axis: Axis, value: f64) -> f64 {
        match self.state.units {
            _ if axis.is_rotary() => value,
            LengthUnit::Inch => value * 25.4 * self.machine_units_per_mm(),
            LengthUnit::Millimetre => value * self.machine_units_per_mm(),
        }
    }

    pub(crate) fn to_program_unit(&self, axis: Axis, value: f64) -> f64 {
        match self.state.units {
            _ if axis.is_rotary() => value,
            LengthUnit::Inch => value / self.machine_units_per_mm() / 25.4,
            LengthUnit::Millimetre => value / self.machine_units_per_mm(),
        }
    }

    pub(super) fn lengths_to_program(&self, pose: &Pose) -> Pose {
        let mut program = Pose::ZERO;
        for axis in Axis::ALL {
            program[axis] = self.to_program_unit(axis, pose[axis]);
        }
        program
    }
}

/// Values that the expressions of a block may read.
pub(super) struct BlockEnvironment<'a> {
    pub(super) core: &'a Core,
    pub(super) names: &'a Names,
    pub(super) line: u32,
}

impl BlockEnvironment<'_> {
    /// Value of `#<_thread_run_in>`, where the program has set `#<_thread_pitch>`.
    #[cold]
    fn thread_run_in(&self, name: NameId) -> Option<f64> {
        let source = self.core.threads.as_deref().filter(|_| self.names.text(name) == thread_run_in::NAME)?;
        let pitch = self.names.all().find(|(_, text)| *text == thread_run_in::PITCH)?.0;
        thread_run_in::value(source, &self.core.state, self.core.parameters.named(pitch)?)
    }
}

impl Environment for BlockEnvironment<'_> {
    fn numbered(&self, number: usize) -> Option<f64> {
        let state = &self.core.state;
        let unknown = state.unknown;
        match number {
            5400 | 5410..=5413 if unknown.has(UnknownModes::CURRENT_TOOL) => Some(UNKNOWN),
            5420..=5428 if unknown.has(UnknownModes::COMPENSATION) => Some(UNKNOWN),
            5021..=5029 => Some(state.machine_position().0[number - 5021]),
            5400 => Some(state.current_tool.into()),
            5401..=5409 => Some(state.tool_offset.0[number - 5401]),
            5410..=5413 => self.core.tool_parameter(number - 5401),
            5420..=5428 => Some(state.position.0[number - 5420]),
            _ if Parameters::has(number) => Some(self.core.parameters.get(number)),
            _ => None,
        }
    }

    /// The machine position is unknown while a move waits for its end. LinuxCNC refuses these parameters from G41 to
    /// G40.
    fn is_readable(&self, number: usize) -> bool {
        !matches!(number, 5420..=5428) || self.core.state.compensation.is_none()
    }

    fn named(&self, name: NameId) -> Option<f64> {
        self.core.parameters.named(name).or_else(|| self.thread_run_in(name))
    }

    fn name(&self, name: NameId) -> &str {
        self.names.text(name)
    }

    fn nearest_name(&self, name: NameId) -> Option<&str> {
        let known = self.names.all().filter(|(id, _)| self.core.parameters.named(*id).is_some());
        nearest(self.names.text(name), known.map(|(_, text)| text))
    }

    fn system(&self, parameter: SystemParameter) -> f64 {
        let state = &self.core.state;
        let is_unknown = state.unknown.has(parameter.modes())
            || parameter == SystemParameter::ToolOffset && state.tool_offset.0.iter().any(|value| value.is_nan());
        if is_unknown {
            return UNKNOWN;
        }
        if let (SystemParameter::Hal(value), Some(setup)) = (parameter, &self.core.cutting) {
            return value.value(setup, &state.cutting, state.units);
        }
        let pocket = |tool: u32| self.core.tools.get(tool).map_or(0.0, |tool| tool.pocket.into());
        match parameter {
            SystemParameter::CurrentPocket => pocket(state.current_tool),
            SystemParameter::SelectedPocket if state.selected_tool != 0 => pocket(state.selected_tool),
            _ => parameter.value(state, self.line),
        }
    }
}
