//! Configuration of an interpreter: the machine, its tables, and the state that earlier blocks have left.
//!
//! Invariant: a snapshot replaces the parameters and the tools.

use crate::canon_modes::LengthUnit;
use crate::cutting::{CuttingSetup, SpindleUse};
use crate::modal::ModalState;
use crate::modal_snapshot::{ModalSnapshot, StartTables};
use crate::params::{Names, Parameters};
use crate::pose::{AxisSet, Pose};
use crate::sub_files::SubFiles;
use crate::thread_run_in::ThreadRunIn;
use crate::tool::ToolTable;
use crate::user_codes::UserCodes;
use retrace_cycles::CycleLibrary;
use std::sync::Arc;

/// Where the answers of the machine come from that a program asks for: the results of G38 and M66.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Answers {
    /// They are those of LinuxCNC's stand-alone interpreter: no contact, input off.
    #[default]
    Assumed,
    /// They are unknown, and so is what depends on them; both sides of a branch on them are followed (PRB-17, PRB-18).
    /// For the check of a program that was pre-scanned.
    Unknown,
}

/// Configuration of an interpreter.
#[derive(Clone, Debug)]
pub struct Setup {
    /// Unit of the tool table, the parameters and [`Setup::position`].
    pub machine_units: LengthUnit,
    /// Unit in force before the program has G20 or G21.
    pub program_units: LengthUnit,
    /// Axes that a program may move.
    pub axes: AxisSet,
    /// Tool table.
    pub tools: ToolTable,
    /// Parameters that earlier programs have left.
    pub parameters: Parameters,
    /// Cycles that a program may call.
    pub cycles: Option<Arc<CycleLibrary>>,
    /// Source of subprograms in files of their own.
    pub files: Option<Arc<dyn SubFiles>>,
    /// Whether lines that begin with a slash are skipped.
    pub block_delete: bool,
    /// Position of the machine, in machine coordinates and machine units.
    pub position: Pose,
    /// User codes that are declared, of M100 … M199.
    pub user_codes: UserCodes,
    /// Angle added to the R word of M19, in degrees.
    pub orient_offset_degrees: f64,
    /// Whether G74 and G84 tap rigidly, as G33.1 does: the spindle is geared to the tap on its way in and out.
    pub rigid_tapping: bool,
    /// Whether M98, M99 and an O number alone are refused.
    pub disable_fanuc_subs: bool,
    /// Named read-only parameters, such as the numbers of an INI file; names in lower case.
    pub fixed_values: Vec<(String, f64)>,
    /// Cutters and materials; `None` for a machine without a material table.
    pub cutting: Option<Arc<CuttingSetup>>,
    /// What M3 starts on a machine without a material table.
    pub spindle_use: SpindleUse,
    /// Whether M6 calls the subprogram `tool_change`, which has the M6 of its own that the machine executes.
    pub calls_tool_change: bool,
    /// What gives programs the run-in of a thread; `None` on a machine that cannot cut any.
    pub threads: Option<Arc<dyn ThreadRunIn>>,
    /// Where the answers of the machine come from.
    pub answers: Answers,
    /// State that earlier blocks have left, in place of `parameters` and `tools`: see [`Setup::continuing`] and
    /// [`Setup::following`].
    pub snapshot: Option<Arc<ModalSnapshot>>,
}

impl Default for Setup {
    /// A metric machine with X, Y and Z at its zero.
    fn default() -> Setup {
        Setup {
            machine_units: LengthUnit::Millimetre,
            program_units: LengthUnit::Millimetre,
            axes: AxisSet::XYZ,
            tools: ToolTable::samples(LengthUnit::Millimetre),
            parameters: Parameters::default(),
            cycles: None,
            files: None,
            block_delete: false,
            position: Pose::ZERO,
            user_codes: UserCodes::default(),
            orient_offset_degrees: 0.0,
            rigid_tapping: false,
            disable_fanuc_subs: false,
            fixed_values: Vec::new(),
            cutting: None,
            spindle_use: SpindleUse::Unknown,
            calls_tool_change: false,
            threads: None,
            answers: Answers::Assumed,
            snapshot: None,
        }
    }
}

impl Setup {
    /// Returns the setup of LinuxCNC's `rs274` without an INI file: an inch machine with six axes, a program that
    /// starts in millimetres.
    #[must_use]
    pub fn rs274() -> Setup {
        Setup {
            machine_units: LengthUnit::Inch,
            axes: AxisSet::XYZABC,
            tools: ToolTable::samples(LengthUnit::Inch),
            ..Setup::default()
        }
    }
}

impl Setup {
    /// Returns the initial data of an interpreter with this setup.
    #[must_use]
    pub fn start_tables(&self) -> StartTables {
        let (parameters, tools) = match &self.snapshot {
            Some(snapshot) => (&snapshot.parameters, &snapshot.tools),
            None => (&self.parameters, &self.tools),
        };
        let (current_tool, selected_tool) = self
            .snapshot
            .as_ref()
            .map_or((0, 0), |snapshot| (snapshot.state.current_tool, snapshot.state.selected_tool));
        StartTables { parameters: parameters.clone(), tools: tools.clone(), current_tool, selected_tool }
    }

    /// Returns this setup for a program that begins with these tables.
    #[must_use]
    pub fn with_start_tables(self, tables: StartTables) -> Setup {
        let StartTables { parameters, tools, current_tool, selected_tool } = tables;
        let setup = Setup { parameters, tools, snapshot: None, ..self };
        if (current_tool, selected_tool) == (0, 0) {
            return setup;
        }
        let state = ModalState { current_tool, selected_tool, ..ModalState::initial(setup.program_units) };
        let (parameters, tools) = (setup.parameters.clone(), setup.tools.clone());
        setup.continuing(&ModalSnapshot { state, parameters, tools, names: Names::default() })
    }

    /// Returns this setup for an MDI block that continues from `carried`.
    #[must_use]
    pub fn continuing(self, snapshot: &ModalSnapshot) -> Setup {
        Setup { snapshot: Some(Arc::new(snapshot.clone())), ..self }
    }

    /// Returns this setup for a program that follows: with the persistent parameters, the tool table and the tool in
    /// the spindle.
    #[must_use]
    pub fn following(self, snapshot: &ModalSnapshot) -> Setup {
        let state = ModalState {
            current_tool: snapshot.state.current_tool,
            selected_tool: snapshot.state.selected_tool,
            ..ModalState::initial(self.program_units)
        };
        let parameters = snapshot.parameters.persistent();
        let snapshot = ModalSnapshot { state, parameters, tools: snapshot.tools.clone(), names: Names::default() };
        self.continuing(&snapshot)
    }
}
