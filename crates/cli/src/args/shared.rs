//! Options that several commands share.

use std::path::{Path, PathBuf};

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use retrace_config::{MachineConfig, PierceMode, PlanMode};
use retrace_journal::CommandArguments;

/// `--machine`
#[derive(Clone, Debug, Default, Args)]
pub struct MachineFile {
    /// Machine file; a three-axis machine is built in.
    #[arg(long, value_name = "FILE.toml")]
    pub machine: Option<PathBuf>,
}

impl MachineFile {
    /// Path of the machine file; `None` is the built-in machine.
    #[must_use]
    pub fn path(&self) -> Option<&Path> {
        self.machine.as_deref()
    }
}

/// `--plan`
#[derive(Clone, Copy, Debug, Default, Args)]
pub struct Planning {
    /// How the speed along the path is planned: `fast`, or `best`, which takes longer to plan and saves machine time on
    /// curves. The default is the key `plan` of the machine file, or `best`.
    #[arg(long, value_name = "MODE",
        value_parser = PossibleValuesParser::new(PlanMode::NAMES).try_map(|name| name.parse::<PlanMode>()))]
    pub plan: Option<PlanMode>,
    /// What is done with the pierces of a cutting program: `only` pierces each contour and cuts nothing, `only:X,Y` at
    /// this offset in mm from the starts of the contours; `done` cuts from the holes of such a run, without the time
    /// and height of a pierce.
    #[arg(long, value_name = "MODE", default_value = "usual", allow_hyphen_values = true)]
    pub pierces: PierceMode,
}

impl Planning {
    /// That of a job.
    #[must_use]
    pub fn of_job(arguments: &CommandArguments) -> Self {
        Self { plan: arguments.plan, pierces: arguments.pierces.unwrap_or_default() }
    }

    /// Returns the machine with the mode of this option, if it is given.
    #[must_use]
    pub fn apply_to(self, mut machine: MachineConfig) -> MachineConfig {
        machine.plan_mode = self.plan.unwrap_or(machine.plan_mode);
        machine.pierce_mode = self.pierces;
        if self.pierces == PierceMode::Done {
            machine.cutters.iter_mut().for_each(|cutter| cutter.start.pierce_s = 0.0);
        }
        machine
    }
}

/// `--card`
#[derive(Clone, Debug, Args)]
pub struct CardPort {
    /// `sim` is the simulated card in this process, which keeps no position; or a serial port such as
    /// `/dev/ttyUSB0@230400`.
    #[arg(long, default_value = "sim", value_name = "CARD")]
    pub card: String,
}

impl CardPort {
    /// Whether the card is the simulated one in this process.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        self.card == "sim"
    }
}

/// Port of a card as a positional argument.
#[derive(Clone, Debug, Args)]
pub struct CardAddress {
    /// The port, `PATH[@BAUD]`; 1000000 baud by default.
    #[arg(value_name = "PORT")]
    pub port: String,
}

/// Options of the commands that run a job. A command words the help of `--tui` and `--optional-stop` for itself.
#[derive(Clone, Debug, Default, Args)]
pub struct OperationOptions {
    /// Run in wall time; without it the simulated card runs as fast as possible.
    #[arg(long)]
    pub realtime: bool,
    /// Full-screen operation, in wall time.
    #[arg(long)]
    pub tui: bool,
    /// Scripted operator.
    #[arg(long, value_name = "FILE")]
    pub operator: Option<PathBuf>,
    /// Whether M1 stops.
    #[arg(long, value_enum, value_name = "on|off")]
    pub optional_stop: Option<OnOff>,
    /// Write what the card executed, one row per control period.
    #[arg(long, value_name = "FILE.csv")]
    pub records: Option<PathBuf>,
}

/// `--source-faults`
#[derive(Clone, Debug, Default, Args)]
pub struct SimulatedSource {
    /// With the simulated card: faults of the source of a cutter that has an `ok` input, such as
    /// `no-start=0.1,lose@120,seed=7`; see docs/simulated-machine.md.
    #[arg(long, value_name = "SPEC")]
    pub source_faults: Option<String>,
}

/// `--work`
#[derive(Clone, Debug, Default, Args)]
pub struct SimulatedWork {
    /// With the simulated card: work that its probe touches, in mm of the machine, such as `z<-20` or
    /// `box=0:50,0:30,-20:-5`; see docs/simulated-machine.md.
    #[arg(long, value_name = "BODIES", allow_hyphen_values = true)]
    pub work: Option<String>,
}

/// `--journal`
#[derive(Clone, Debug, Default, Args)]
pub struct JobsFolder {
    /// Folder of the jobs (journal, breakpoint, report); by default `retrace/jobs` in the user's state folder.
    #[arg(long, value_name = "DIR")]
    pub journal: Option<PathBuf>,
}

impl JobsFolder {
    /// Path of the folder; `None` is the default one.
    #[must_use]
    pub fn path(&self) -> Option<&Path> {
        self.journal.as_deref()
    }
}

/// `--json` of a command that prints one result.
#[derive(Clone, Copy, Debug, Default, Args)]
pub struct JsonObject {
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// `--json` of a command that prints events as they happen.
#[derive(Clone, Copy, Debug, Default, Args)]
pub struct JsonLines {
    /// Print one JSON object per line, the report last.
    #[arg(long)]
    pub json: bool,
}

/// Value `on` or `off` of an option.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum OnOff {
    /// On.
    On,
    /// Off.
    Off,
}

impl OnOff {
    /// Whether the option is on.
    #[must_use]
    pub fn is_on(self) -> bool {
        self == Self::On
    }
}
