//! The command line (interface): what is fixed there keeps its meaning here.
//!
//! Invariant: everything the command can do is described by `--help`, with an example.

use std::path::PathBuf;

use clap::builder::TypedValueParser;
use clap::{Args, Parser, Subcommand, ValueEnum};
use retrace_controller::journal::entry::MachineTables;

use crate::shell_files::ShellFiles;

/// CNC control that runs NC programs and retraces the executed path, exact to the pulse.
#[derive(Debug, Parser)]
#[command(name = "retrace", version, about, arg_required_else_help = true)]
#[command(
    after_help = "Example:\n  retrace run examples/01-first-cut.ngc\n\nExit codes: 0 completed · 1 the program has errors · \
    2 wrong usage or machine file · 3 alarm or card fault · 4 stopped by the operator"
)]
pub struct Cli {
    /// Subcommand.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Machine a program: on the simulated card unless --card says otherwise.
    #[command(
        after_help = "Examples:\n  retrace run examples/02-back-up.ngc --operator examples/02-back-up.op --records out.csv --json\n  \
        retrace run --tui --card /dev/ttyUSB0 --machine mill.toml"
    )]
    #[command(mut_arg("program", |program| {
        let any_text = clap::builder::OsStringValueParser::new().map(PathBuf::from);
        let help = "NC program; `-` is standard input; with --tui it can be loaded at the screen";
        program.value_parser(any_text).required(false).required_unless_present("tui").default_value_if("tui", "true", "").help(help)
    }))]
    Run(Run),
    /// Decode and pre-scan only: every diagnostic, with line and column; nothing moves.
    #[command(
        after_help = "Examples:\n  retrace check examples/01-first-cut.ngc\n  retrace check examples/01-first-cut.ngc --table\n  \
        retrace check examples/01-first-cut.ngc --json"
    )]
    Check(Check),
    /// Print the canonical functions, one a line, as LinuxCNC's `rs274 -g` does.
    #[command(after_help = "Example:\n  retrace canon examples/01-first-cut.ngc")]
    Canon(Canon),
    /// Draw the tool path, velocity, acceleration and jerk over time, or the history of a job, as SVG or PNG.
    #[command(after_help = "Examples:\n  retrace plot examples/01-first-cut.ngc -o path.svg\n  \
        retrace plot examples/02-back-up.ngc --operator examples/02-back-up.op -o retraced.png\n  \
        retrace plot examples/01-first-cut.ngc --profile -o profile.svg\n  \
        retrace plot examples/01-first-cut.ngc --profile --from 4 --to 6 -o lines.svg\n  \
        retrace plot --job -o history.png")]
    #[command(mut_arg("program", |program| {
        program.required(false).required_unless_present("job").default_value("-").hide_default_value(true)
    }))]
    Plot(Plot),
    /// Resume an interrupted job at its breakpoint.
    #[command(after_help = "Examples:\n  retrace resume\n  retrace resume 20261122-004627-part --yes\n  \
        retrace resume 20261122-004627-part --from-line 120\n  \
        retrace resume --tui")]
    Resume(Resume),
    /// List jobs: which can be resumed, which ran, how they ended.
    #[command(after_help = "Examples:\n  retrace jobs\n  retrace jobs show 20261122-004627-part")]
    Jobs(Jobs),
    /// Ring size for so many axes, hours, milliseconds and bytes (REV-4), and what the machine file gives.
    #[command(after_help = "Example:\n  retrace size --axes 3 --hours 0.5 --period-ms 2.5 --bytes 2")]
    Size(Size),
    /// List, check and compile the cycles that programs can call.
    #[command(after_help = "Examples:\n  retrace cycles\n  retrace cycles show CYCLE81\n  \
        retrace cycles check --cycles my-cycles\n\nExit codes: 0 well · 1 a cycle has errors · 2 wrong usage")]
    Cycles(Cycles),
    /// Write a commented machine file, check one.
    #[command(
        subcommand,
        after_help = "Examples:\n  retrace machine new -o mill.toml\n  retrace machine check examples/02-back-up.toml"
    )]
    Machine(Machine),
    /// Home the machine over the card's switches: one axis, or all in the machine file's order.
    #[command(
        after_help = "Examples:\n  retrace home --card /dev/ttyUSB0 --machine mill.toml\n  retrace home z --card my-card --machine mill.toml"
    )]
    Home(Home),
    /// Jog an axis by a distance in mm (degrees) at its jog speed; the move ends at the soft limit.
    #[command(after_help = "Example:\n  retrace jog x -12.5 --card /dev/ttyUSB0 --machine mill.toml")]
    Jog(Jog),
    /// Execute one MDI block.
    #[command(
        after_help = "Examples:\n  retrace mdi 'G0 X10' --card /dev/ttyUSB0\n  retrace mdi 'G10 L20 P1 X0 Y0' --params mill.var"
    )]
    Mdi(Mdi),
    /// Measure how fast this computer and the line to a card respond, and whether the control period suits them.
    #[command(after_help = "Examples:\n  retrace doctor\n  retrace doctor /dev/ttyUSB0 --machine mill.toml")]
    Doctor(Doctor),
    /// Serve a simulated card on a pseudo-terminal, list serial ports, identify a card.
    #[command(
        subcommand,
        after_help = "Examples:\n  retrace card serve --pty\n  retrace card identify /dev/ttyUSB0@230400"
    )]
    Card(Card),
    #[command(flatten)]
    ShellFiles(ShellFiles),
}

/// `retrace doctor`
#[derive(Debug, clap::Args)]
pub struct Doctor {
    /// Port of the card, `PATH[@BAUD]`; without a port only this computer is measured.
    pub port: Option<String>,
    /// Machine file.
    #[arg(long, value_name = "FILE")]
    pub machine: Option<PathBuf>,
    /// Duration of the wake-up measurement in s.
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    pub seconds: f64,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// `retrace card`
#[derive(Debug, Subcommand)]
pub enum Card {
    /// Serve a simulated card in wall time until interrupted. Hosts may connect one after another; the position is kept.
    #[command(
        after_help = "Manual inputs are read from standard input (a pipe; a terminal with --manual-inputs), one a line:\n  wheel -120 for 2s     turn the handwheel, \
        in counts per second; `wheel -7` turns it by 7 counts at once\n  press door            also emergency-stop, probe\n  release door\n  input 5 on            an input, by its number\n\nExamples:\n  retrace card serve --pty --link my-card --vcd my-card.vcd\n  \
        retrace card serve --pty --faults baud=230400,rate=1e-5,seed=7\n  retrace run examples/01-first-cut.ngc --card my-card"
    )]
    Serve(Serve),
    /// List the serial ports. Pseudo-terminals are not listed.
    #[command(after_help = "Example:\n  retrace card ports --json")]
    Ports {
        /// Print one JSON object.
        #[arg(long)]
        json: bool,
    },
    /// Identify the card at a port: name, position, outputs that are on, latched alarm.
    #[command(after_help = "Example:\n  retrace card identify /dev/ttyUSB0@230400")]
    Identify {
        /// The port, `PATH[@BAUD]`; 1000000 baud by default.
        #[arg(value_name = "PORT")]
        port: String,
        /// Machine file; a three-axis machine is built in.
        #[arg(long, value_name = "FILE.toml")]
        machine: Option<PathBuf>,
        /// Print one JSON object.
        #[arg(long)]
        json: bool,
    },
    /// Clear the latched alarm of a card if its cause is gone. Nothing moves.
    #[command(after_help = "Example:\n  retrace card clear /dev/ttyUSB0@230400")]
    Clear {
        /// The port, `PATH[@BAUD]`; 1000000 baud by default.
        #[arg(value_name = "PORT")]
        port: String,
        /// Machine file; a three-axis machine is built in.
        #[arg(long, value_name = "FILE.toml")]
        machine: Option<PathBuf>,
    },
}

/// `retrace card serve`
#[derive(Debug, Args)]
pub struct Serve {
    /// Serve on a pseudo-terminal and print its path. Required: no other transport is supported.
    #[arg(long, required = true)]
    pub pty: bool,
    /// Machine file: axes, travel and switches; a three-axis machine is built in.
    #[arg(long, value_name = "FILE.toml")]
    pub machine: Option<PathBuf>,
    /// Symbolic link to create for the pseudo-terminal; an existing link is replaced.
    #[arg(long, value_name = "PATH")]
    pub link: Option<PathBuf>,
    /// Trace of step, direction, outputs and place for a wave viewer.
    #[arg(long, value_name = "FILE.vcd")]
    pub vcd: Option<PathBuf>,
    /// Faults on the line, such as `rate=1e-5,seed=7` or `down.drop@1000`; see docs/simulated-machine.md.
    #[arg(long, value_name = "SPEC")]
    pub faults: Option<String>,
    /// Speed of simulated time relative to wall time: 0.01 to 100.
    #[arg(long, value_name = "N", default_value_t = 1.0)]
    pub speed: f64,
    /// Exit after this many seconds and print the counters.
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,
    /// Exit at the end of standard input and print the counters.
    #[arg(long)]
    pub until_eof: bool,
    /// Read manual inputs from a terminal too; not for a card in the background.
    #[arg(long)]
    pub manual_inputs: bool,
    /// Print the counters as one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// Options that `home`, `jog` and `mdi` share.
#[derive(Debug, Args)]
pub struct ManualOptions {
    /// `sim` is a simulated card in this process, which keeps no position; or a serial port such as `/dev/ttyUSB0@230400`.
    #[arg(long, default_value = "sim", value_name = "CARD")]
    pub card: String,
    /// Machine file; a three-axis machine is built in.
    #[arg(long, value_name = "FILE.toml")]
    pub machine: Option<PathBuf>,
    /// Print one JSON object per line, the report last.
    #[arg(long)]
    pub json: bool,
}

/// `retrace home`
#[derive(Debug, Args)]
pub struct Home {
    /// Axis to home; by default all axes in the order of the machine file.
    pub axis: Option<char>,
    #[command(flatten)]
    pub manual: ManualOptions,
}

/// `retrace jog`
#[derive(Debug, Args)]
pub struct Jog {
    /// The axis.
    pub axis: char,
    /// Distance in mm (degrees), signed.
    #[arg(allow_negative_numbers = true)]
    pub mm: f64,
    #[command(flatten)]
    pub manual: ManualOptions,
}

/// `retrace mdi`
#[derive(Debug, Args)]
pub struct Mdi {
    /// The block.
    pub block: String,
    /// Tool table.
    #[arg(long, value_name = "FILE")]
    pub tools: Option<PathBuf>,
    /// Parameter file, read before the block and rewritten after it. With --machine or --card the default is the machine's own file in
    /// the user's state folder.
    #[arg(long, value_name = "FILE")]
    pub params: Option<PathBuf>,
    /// Check the block only; nothing moves.
    #[arg(long)]
    pub dry_run: bool,
    #[command(flatten)]
    pub manual: ManualOptions,
}

/// `retrace machine`
#[derive(Debug, Subcommand)]
pub enum Machine {
    /// Write a commented machine file: the built-in machine with every key, or a template for a kind of machine.
    #[command(
        after_help = "Examples:\n  retrace machine new -o mill.toml\n  retrace machine new waterjet -o waterjet.toml"
    )]
    New {
        /// Kind of machine: waterjet, plasma, laser, router or lathe; by default the built-in machine.
        #[arg(value_enum)]
        kind: Option<MachineKind>,
        /// Kind of machine, as an option.
        #[arg(long = "kind", value_enum, value_name = "KIND", conflicts_with = "kind")]
        of_kind: Option<MachineKind>,
        /// File to write, standard output by default. An existing file is not overwritten.
        #[arg(short, long, value_name = "FILE.toml")]
        output: Option<PathBuf>,
    },
    /// Check a machine file: one line per error and warning, then a summary of the machine.
    #[command(after_help = "Examples:\n  retrace machine check examples/02-back-up.toml\n  \
        retrace machine check mill.toml --card /dev/ttyUSB0\n\nExit codes: 0 usable, with warnings or without · 2 errors · \
        3 the card does not answer")]
    Check {
        /// The machine file.
        file: PathBuf,
        /// Compare it with the card at this port, `PATH[@BAUD]`, too: step rates, control period, axes, inputs and outputs.
        #[arg(long, value_name = "PORT")]
        card: Option<String>,
        /// One JSON object on standard output: `errors` and `warnings`, each with `number`, `cause` and `remedy`.
        #[arg(long)]
        json: bool,
    },
}

/// Kinds of machines that have a template.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum MachineKind {
    /// A jet and its abrasive, with pierce times.
    Waterjet,
    /// A torch that waits for its arc.
    Plasma,
    /// A beam, its assist gas and exhaust.
    Laser,
    /// A spindle, coolant, dust extraction.
    Router,
    /// X and Z.
    Lathe,
}

/// `retrace cycles`
#[derive(Debug, Args)]
pub struct Cycles {
    /// Action; `list` by default.
    #[command(subcommand)]
    pub action: Option<CyclesAction>,
    #[command(flatten)]
    pub folders: CycleFolders,
}

/// What `retrace cycles` does.
#[derive(Debug, Subcommand)]
pub enum CyclesAction {
    /// List them: name, kind, origin, up to date or compiled now, parameters.
    #[command(after_help = "Example:\n  retrace cycles list --cycles my-cycles")]
    List,
    /// Print every error of every source; writes nothing.
    #[command(after_help = "Example:\n  retrace cycles check --cycles my-cycles")]
    Check,
    /// Compile the cycles that are not up to date, and keep the compiled forms.
    #[command(after_help = "Example:\n  retrace cycles compile --cycles my-cycles --compiled my-cache")]
    Compile,
    /// Print the source of a cycle.
    #[command(after_help = "Example:\n  retrace cycles show HOLES2")]
    Show {
        /// Name of the cycle.
        name: String,
    },
}

/// The two folders of cycles.
#[derive(Clone, Debug, Default, Args)]
pub struct CycleFolders {
    /// Folder with sources of cycles, `*.SPF`; by default `retrace/cycles` in the user's configuration folder.
    #[arg(long, value_name = "DIR", global = true)]
    pub cycles: Option<PathBuf>,
    /// Folder for their compiled forms; by default `retrace/cycles` in the user's cache folder.
    #[arg(long, value_name = "DIR", global = true)]
    pub compiled: Option<PathBuf>,
}

/// Default of `--max-loop-blocks`.
pub const MAX_CHECKED_LOOP_BLOCKS: u64 = 2_000_000;

/// Options of every command that reads a program.
#[derive(Clone, Debug, Args)]
pub struct Reading {
    /// NC program; `-` is standard input.
    // Empty where the screen opens without one.
    pub program: PathBuf,
    /// Skip blocks that begin with `/`.
    #[arg(long)]
    pub block_delete: bool,
    /// Folder with subprograms, searched after the program's own; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub subs: Vec<PathBuf>,
    /// The folders of cycles that it may call.
    #[command(flatten)]
    pub cycle_folders: CycleFolders,
    /// Tool table.
    #[arg(long, value_name = "FILE")]
    pub tools: Option<PathBuf>,
    /// Parameter file; a completed run rewrites it. With --machine or --card, `run` uses the machine's own file in the user's state
    /// folder by default.
    #[arg(long, value_name = "FILE")]
    pub params: Option<PathBuf>,
    /// LinuxCNC machine configuration: the entries that `rs274` reads, and its numbers as `#<_ini[section]name>`.
    #[arg(long, value_name = "FILE.ini")]
    pub ini: Option<PathBuf>,
    /// Maximum number of blocks in loops and calls that the check before the run executes; the rest is not checked (W1004).
    #[arg(long, value_name = "N", default_value_t = MAX_CHECKED_LOOP_BLOCKS)]
    pub max_loop_blocks: u64,
    /// The machine's own tables in the state folder, for tables that no option names.
    #[arg(skip)]
    pub machine_tables: Option<MachineTables>,
}

/// `retrace run`
#[derive(Clone, Debug, Args)]
pub struct Run {
    #[command(flatten)]
    pub reading: Reading,
    /// `sim` is the simulated card in this process; or a serial port such as `/dev/ttyUSB0@230400`.
    #[arg(long, default_value = "sim", value_name = "CARD")]
    pub card: String,
    /// Machine file; a three-axis machine is built in.
    #[arg(long, value_name = "FILE.toml")]
    pub machine: Option<PathBuf>,
    /// Run in wall time; without it the simulated card runs as fast as possible.
    #[arg(long)]
    pub realtime: bool,
    /// Full-screen operation, in wall time. Default with --realtime on a terminal.
    #[arg(long, conflicts_with = "no_tui")]
    pub tui: bool,
    /// No full-screen operation.
    #[arg(long)]
    pub no_tui: bool,
    /// Scripted operator.
    #[arg(long, value_name = "FILE")]
    pub operator: Option<PathBuf>,
    /// Whether M1 stops. By default it stops in wall time without --operator and without the screen; Enter is cycle start there.
    #[arg(long, value_enum, value_name = "on|off")]
    pub optional_stop: Option<OnOff>,
    /// Write what the card executed, one row per control period.
    #[arg(long, value_name = "FILE.csv")]
    pub records: Option<PathBuf>,
    /// With the simulated card: write a trace of pins, outputs and inputs for wave viewers.
    #[arg(long, value_name = "FILE.vcd")]
    pub vcd: Option<PathBuf>,
    /// Dry run: the axes move and every cutter stays off.
    #[arg(long)]
    pub dry_run: bool,
    /// Print one JSON object per line, the report last.
    #[arg(long)]
    pub json: bool,
    /// Start at this program line with the modal state in force there.
    #[arg(long, value_name = "N")]
    pub start_line: Option<u32>,
    /// Folder for jobs (journal, breakpoint, report); by default `retrace/jobs` in the user's state folder.
    #[arg(long, value_name = "DIR")]
    pub journal: Option<PathBuf>,
    /// Write no journal; the job cannot be resumed.
    #[arg(long, conflicts_with = "journal")]
    pub no_journal: bool,
}

/// An on/off option.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
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

/// `retrace resume`
#[derive(Debug, Args)]
pub struct Resume {
    /// Name of the job or a unique prefix; by default the newest job that can be resumed.
    #[arg(value_name = "JOB")]
    pub job: Option<String>,
    /// Folder of the jobs; by default `retrace/jobs` in the user's state folder.
    #[arg(long, value_name = "DIR")]
    pub journal: Option<PathBuf>,
    /// The card, if it is at another port now: `sim` for a job of the simulated card, else a serial port.
    #[arg(long, value_name = "CARD")]
    pub card: Option<String>,
    /// Confirm the resume, including the outputs that it switches.
    #[arg(short, long)]
    pub yes: bool,
    /// Where the program is now, or is sent from again: a file, `-`, or `tcp://HOST:PORT`.
    #[arg(long, value_name = "PROGRAM")]
    pub program: Option<PathBuf>,
    /// Start a new job at this program line instead, from the current position, with the modal state in force there.
    #[arg(long, value_name = "N")]
    pub from_line: Option<u32>,
    /// The card was restarted and the machine has not moved: trust its counts where no home switch confirms them, and return from there
    /// to the last breakpoint in the journal.
    #[arg(long, conflicts_with = "from_line")]
    pub assume_position: bool,
    /// Run in wall time; without it the simulated card runs as fast as possible.
    #[arg(long)]
    pub realtime: bool,
    /// Full-screen operation, in wall time.
    #[arg(long, conflicts_with = "json")]
    pub tui: bool,
    /// Scripted operator.
    #[arg(long, value_name = "FILE")]
    pub operator: Option<PathBuf>,
    /// Whether M1 stops. By default as when the job was interrupted; otherwise it stops in wall time without --operator and without the
    /// screen, where Enter is cycle start.
    #[arg(long, value_enum, value_name = "on|off")]
    pub optional_stop: Option<OnOff>,
    /// Write what the card executed, one row per control period.
    #[arg(long, value_name = "FILE.csv")]
    pub records: Option<PathBuf>,
    /// Print one JSON object per line, the report last.
    #[arg(long)]
    pub json: bool,
    /// Rejected: a job resumes with the machine file that it started with.
    #[arg(long, value_name = "FILE.toml", hide = true)]
    pub machine: Option<PathBuf>,
}

/// `retrace jobs`
#[derive(Debug, Args)]
pub struct Jobs {
    /// Action; lists jobs by default.
    #[command(subcommand)]
    pub action: Option<JobsAction>,
    /// List every job, including those that never started; by default the newest 20.
    #[arg(long)]
    pub all: bool,
    /// Print one JSON object.
    #[arg(long, global = true)]
    pub json: bool,
    /// Folder of the jobs; by default `retrace/jobs` in the user's state folder.
    #[arg(long, value_name = "DIR", global = true)]
    pub journal: Option<PathBuf>,
}

/// What `retrace jobs` does.
#[derive(Debug, Subcommand)]
pub enum JobsAction {
    /// Print all details of a job: progress, last position, outputs.
    #[command(after_help = "Example:\n  retrace jobs show 20261122-004627-part --json")]
    Show {
        /// Name of the job or a unique prefix.
        id: String,
    },
}

/// `retrace check`
#[derive(Debug, Args)]
pub struct Check {
    #[command(flatten)]
    pub reading: Reading,
    /// Print the branch table: every jump of the program and its files, numbered, with its target.
    #[arg(long)]
    pub table: bool,
    /// Machine file, for the soft limits and the time; a three-axis machine is built in.
    #[arg(long, value_name = "FILE.toml")]
    pub machine: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long, conflicts_with = "table")]
    pub json: bool,
}

/// `retrace canon`
#[derive(Debug, Args)]
pub struct Canon {
    #[command(flatten)]
    pub reading: Reading,
}

/// `retrace plot`
#[derive(Debug, Args)]
pub struct Plot {
    #[command(flatten)]
    pub reading: Reading,
    /// Draw the history of a job from its journal instead of a program: its name or a unique prefix; by default the newest.
    #[arg(long, value_name = "JOB", num_args = 0..=1, conflicts_with_all = ["program", "machine", "operator", "profile"])]
    pub job: Option<Option<String>>,
    /// Folder of the jobs, for --job; by default `retrace/jobs` in the user's state folder.
    #[arg(long, value_name = "DIR", requires = "job")]
    pub journal: Option<PathBuf>,
    /// Output file: `.svg` or `.png`.
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Machine file; a three-axis machine is built in.
    #[arg(long, value_name = "FILE.toml")]
    pub machine: Option<PathBuf>,
    /// Scripted operator; retraced sections are marked.
    #[arg(long, value_name = "FILE")]
    pub operator: Option<PathBuf>,
    /// Draw velocity, acceleration and jerk over time instead of the path.
    #[arg(long)]
    pub profile: bool,
    /// With --profile: start at the first motion of this program line.
    #[arg(long, value_name = "N", requires = "profile")]
    pub from: Option<u32>,
    /// With --profile: end at the last motion of this program line.
    #[arg(long, value_name = "M", requires = "profile")]
    pub to: Option<u32>,
    /// Direction of view: xy, xz, yz or iso; by default the plane of the program.
    #[arg(long, value_name = "VIEW")]
    pub view: Option<String>,
    /// Width and height in pixels.
    #[arg(long, value_name = "WxH", default_value = "1200x900")]
    pub size: String,
}

/// `retrace size`
#[derive(Debug, Args)]
pub struct Size {
    /// Axes (a).
    #[arg(long, default_value_t = 3)]
    pub axes: u32,
    /// Hours of reverse run (h).
    #[arg(long, default_value_t = 0.5)]
    pub hours: f64,
    /// Control period in ms (T).
    #[arg(long, default_value_t = 1.0)]
    pub period_ms: f64,
    /// Bytes per axis for pulses and direction (n).
    #[arg(long, default_value_t = 2)]
    pub bytes: u32,
    /// Machine file to calculate the history for; a three-axis machine is built in.
    #[arg(long, value_name = "FILE.toml")]
    pub machine: Option<PathBuf>,
}
