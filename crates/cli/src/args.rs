//! The command line (interface): what is fixed there keeps its meaning here.
//!
//! Invariant: everything the command can do is described by `--help`, with an example.

use std::path::PathBuf;

use clap::builder::TypedValueParser;
use clap::{Args, Parser, Subcommand, ValueEnum};
use retrace_controller::journal::entry::MachineTables;

use crate::shell_files::{Completions, Man};

/// retrace: machines NC programs, and runs backward along the very path it took.
#[derive(Debug, Parser)]
#[command(name = "retrace", version, about, arg_required_else_help = true)]
#[command(
    after_help = "Example:\n  retrace run examples/01-first-cut.ngc\n\nExit codes: 0 completed · 1 the program has errors · \
    2 wrong usage or machine file · 3 alarm or card fault · 4 stopped by the operator"
)]
pub struct Cli {
    /// What to do.
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
    /// Draw the tool path, velocity, acceleration and jerk over time, or what became of a job, as SVG or PNG.
    #[command(after_help = "Examples:\n  retrace plot examples/01-first-cut.ngc -o path.svg\n  \
        retrace plot examples/02-back-up.ngc --operator examples/02-back-up.op -o retraced.png\n  \
        retrace plot examples/01-first-cut.ngc --profile -o profile.svg\n  \
        retrace plot examples/01-first-cut.ngc --profile --from 4 --to 6 -o lines.svg\n  \
        retrace plot --job -o history.png")]
    #[command(mut_arg("program", |program| {
        program.required(false).required_unless_present("job").default_value("-").hide_default_value(true)
    }))]
    Plot(Plot),
    /// Take up an interrupted job at its breakpoint.
    #[command(after_help = "Examples:\n  retrace resume\n  retrace resume 20261122-004627-part --yes\n  \
        retrace resume 20261122-004627-part --from-line 120\n  \
        retrace resume --tui")]
    Resume(Resume),
    /// What can be resumed, what ran, how it ended.
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
    /// Move an axis by hand, so many mm (degrees), at its jog speed, cut short at its soft limit.
    #[command(after_help = "Example:\n  retrace jog x -12.5 --card /dev/ttyUSB0 --machine mill.toml")]
    Jog(Jog),
    /// Carry out one block by hand, as it would stand in a program.
    #[command(
        after_help = "Examples:\n  retrace mdi 'G0 X10' --card /dev/ttyUSB0\n  retrace mdi 'G10 L20 P1 X0 Y0' --params mill.var"
    )]
    Mdi(Mdi),
    /// Measure how promptly this computer and the line to a card react, and whether the machine's control period fits.
    #[command(after_help = "Examples:\n  retrace doctor\n  retrace doctor /dev/ttyUSB0 --machine mill.toml")]
    Doctor(Doctor),
    /// Serve a simulated card behind a pseudo-terminal, list serial ports, ask who is at one.
    #[command(subcommand, after_help = "Examples:\n  retrace card serve --pty\n  retrace card who /dev/ttyUSB0@230400")]
    Card(Card),
    /// Print a completion script for a shell.
    #[command(hide = true, after_help = "Example:\n  retrace completions bash > retrace.bash")]
    Completions(Completions),
    /// Write the manual pages.
    #[command(hide = true, after_help = "Example:\n  retrace man target/man")]
    Man(Man),
}

/// `retrace doctor`
#[derive(Debug, clap::Args)]
pub struct Doctor {
    /// Port of the card, `PATH[@BAUD]`; without one only this computer is measured.
    pub port: Option<String>,
    /// Machine file.
    #[arg(long, value_name = "FILE")]
    pub machine: Option<PathBuf>,
    /// How long wake-ups are measured, s.
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    pub seconds: f64,
    /// One JSON object on standard output.
    #[arg(long)]
    pub json: bool,
}

/// `retrace card`
#[derive(Debug, Subcommand)]
pub enum Card {
    /// Serve a simulated card, in wall time, until interrupted. A host may come after another has gone; the position stays.
    #[command(
        after_help = "On standard input (a pipe; a terminal with --by-hand), a line each, what is done by hand meanwhile:\n  wheel -120 for 2s     turn the handwheel, \
        counts a second; `wheel -7` by so many at once\n  press door            also emergency-stop, probe\n  release door\n  input 5 on            an input by its number\n\nExamples:\n  retrace card serve --pty --link my-card --vcd my-card.vcd\n  \
        retrace card serve --pty --faults baud=230400,rate=1e-5,seed=7\n  retrace run examples/01-first-cut.ngc --card my-card"
    )]
    Serve(Serve),
    /// List the serial ports that are there. A pseudo-terminal is never among them.
    #[command(after_help = "Example:\n  retrace card ports --json")]
    Ports {
        /// One JSON object on standard output.
        #[arg(long)]
        json: bool,
    },
    /// Ask who is at a port, where the machine stands, which outputs are on, and what alarm is latched.
    #[command(after_help = "Example:\n  retrace card who /dev/ttyUSB0@230400")]
    Who {
        /// The port, `PATH[@BAUD]`; 1000000 baud where none is named.
        #[arg(value_name = "PORT")]
        port: String,
        /// Machine file; a three-axis machine is built in.
        #[arg(long, value_name = "FILE.toml")]
        machine: Option<PathBuf>,
        /// One JSON object on standard output.
        #[arg(long)]
        json: bool,
    },
    /// Clear the alarm that a card has latched, if its cause is gone. Nothing moves.
    #[command(after_help = "Example:\n  retrace card clear /dev/ttyUSB0@230400")]
    Clear {
        /// The port, `PATH[@BAUD]`; 1000000 baud where none is named.
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
    /// Behind a pseudo-terminal, whose path is printed: the only way there is.
    #[arg(long, required = true)]
    pub pty: bool,
    /// Machine file: axes, travel and switches; a three-axis machine is built in.
    #[arg(long, value_name = "FILE.toml")]
    pub machine: Option<PathBuf>,
    /// Name to give to the pseudo-terminal: a symbolic link, replaced where it is one.
    #[arg(long, value_name = "PATH")]
    pub link: Option<PathBuf>,
    /// Trace of step, direction, outputs and place, for a wave viewer.
    #[arg(long, value_name = "FILE.vcd")]
    pub vcd: Option<PathBuf>,
    /// What goes wrong on the line, as in `rate=1e-5,seed=7` or `down.drop@1000`; docs/simulated-machine.md tells all of it.
    #[arg(long, value_name = "SPEC")]
    pub faults: Option<String>,
    /// How many times as fast as a clock its time passes: 0.01 to 100.
    #[arg(long, value_name = "N", default_value_t = 1.0)]
    pub speed: f64,
    /// End by itself after so many seconds, and tell what was counted.
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,
    /// End when standard input does, and tell what was counted.
    #[arg(long)]
    pub until_eof: bool,
    /// Take lines from standard input where it is a terminal, too; not for a card in the background.
    #[arg(long)]
    pub by_hand: bool,
    /// What is told at the end as one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// Which machine a task by hand is for, and how it is told.
#[derive(Debug, Args)]
pub struct ByHand {
    /// `sim`, a simulated card in this process, which forgets; or a serial port, as in `/dev/ttyUSB0@230400`.
    #[arg(long, default_value = "sim", value_name = "CARD")]
    pub card: String,
    /// Machine file; a three-axis machine is built in.
    #[arg(long, value_name = "FILE.toml")]
    pub machine: Option<PathBuf>,
    /// One JSON object a line on standard output, what it came to last.
    #[arg(long)]
    pub json: bool,
}

/// `retrace home`
#[derive(Debug, Args)]
pub struct Home {
    /// The axis; all in the machine file's order where none is named.
    pub axis: Option<char>,
    #[command(flatten)]
    pub by_hand: ByHand,
}

/// `retrace jog`
#[derive(Debug, Args)]
pub struct Jog {
    /// The axis.
    pub axis: char,
    /// How far, mm (degrees), signed.
    #[arg(allow_negative_numbers = true)]
    pub mm: f64,
    #[command(flatten)]
    pub by_hand: ByHand,
}

/// `retrace mdi`
#[derive(Debug, Args)]
pub struct Mdi {
    /// The block.
    pub block: String,
    /// Tool table.
    #[arg(long, value_name = "FILE")]
    pub tools: Option<PathBuf>,
    /// Parameter file: offsets and parameters come from it, and it is rewritten when the block is done. With --machine or --card the
    /// machine's own in the user's state folder is the default.
    #[arg(long, value_name = "FILE")]
    pub params: Option<PathBuf>,
    /// Only look whether it could be done; nothing moves.
    #[arg(long)]
    pub dry_run: bool,
    #[command(flatten)]
    pub by_hand: ByHand,
}

/// `retrace machine`
#[derive(Debug, Subcommand)]
pub enum Machine {
    /// Write a commented machine file: the built-in machine with every key, or one of its kind to begin with.
    #[command(
        after_help = "Examples:\n  retrace machine new -o mill.toml\n  retrace machine new waterjet -o waterjet.toml"
    )]
    New {
        /// What kind of machine: waterjet, plasma, laser, router or lathe; the built-in one where none is named.
        #[arg(value_enum)]
        kind: Option<MachineKind>,
        /// The same.
        #[arg(long = "kind", value_enum, value_name = "KIND", conflicts_with = "kind")]
        of_kind: Option<MachineKind>,
        /// File to write; standard output where none is named. A file that is there is left alone.
        #[arg(short, long, value_name = "FILE.toml")]
        output: Option<PathBuf>,
    },
    /// Check a machine file: one line for every error and warning, then what the machine comes to.
    #[command(after_help = "Examples:\n  retrace machine check examples/02-back-up.toml\n  \
        retrace machine check mill.toml --card /dev/ttyUSB0\n\nExit codes: 0 usable, with warnings or without · 2 errors · \
        3 the card cannot be asked")]
    Check {
        /// The machine file.
        file: PathBuf,
        /// Compare it with the card at this port, `PATH[@BAUD]`, too: step rates, control period, axes, inputs and outputs.
        #[arg(long, value_name = "PORT")]
        card: Option<String>,
        /// One JSON object on standard output: `errors` and `warnings`, each with `number`, `text` and `help`.
        #[arg(long)]
        json: bool,
    },
}

/// Kinds of machines that there is a file for.
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
    /// What to do; `list` where nothing is named.
    #[command(subcommand)]
    pub action: Option<CyclesAction>,
    #[command(flatten)]
    pub folders: CycleFolders,
}

/// What `retrace cycles` does.
#[derive(Debug, Subcommand)]
pub enum CyclesAction {
    /// List them: name, kind, where from, fresh or compiled now, parameters.
    #[command(after_help = "Example:\n  retrace cycles list --cycles my-cycles")]
    List,
    /// Tell every error of every source; writes nothing.
    #[command(after_help = "Example:\n  retrace cycles check --cycles my-cycles")]
    Check,
    /// Compile what is not fresh, and keep the compiled forms.
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

/// Blocks in loops and calls that a check goes through unless the command line says otherwise.
pub const MAX_CHECKED_LOOP_BLOCKS: u64 = 2_000_000;

/// What a program is read with, for every command that reads one.
#[derive(Clone, Debug, Args)]
pub struct Reading {
    /// NC program; `-` is standard input.
    // Empty where the screen opens without one.
    pub program: PathBuf,
    /// Leave out blocks that begin with `/`.
    #[arg(long)]
    pub block_delete: bool,
    /// Folder to look for subprograms in, besides the program's own; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub subs: Vec<PathBuf>,
    /// The folders of cycles that it may call.
    #[command(flatten)]
    pub cycle_folders: CycleFolders,
    /// Tool table.
    #[arg(long, value_name = "FILE")]
    pub tools: Option<PathBuf>,
    /// Parameter file; a run that comes to its end rewrites it. By default `run` uses the machine's own in the user's state folder: with
    /// --machine, and with --card.
    #[arg(long, value_name = "FILE")]
    pub params: Option<PathBuf>,
    /// LinuxCNC machine configuration: what `rs274` takes of it, its numbers as `#<_ini[section]name>` among it.
    #[arg(long, value_name = "FILE.ini")]
    pub ini: Option<PathBuf>,
    /// Blocks in loops and calls that a check before the run goes through; what follows is not checked (W1004).
    #[arg(long, value_name = "N", default_value_t = MAX_CHECKED_LOOP_BLOCKS)]
    pub max_loop_blocks: u64,
    /// The machine's own tables in the state folder, where they are used for what is not named above.
    #[arg(skip)]
    pub machine_tables: Option<MachineTables>,
}

/// `retrace run`
#[derive(Clone, Debug, Args)]
pub struct Run {
    #[command(flatten)]
    pub reading: Reading,
    /// `sim`, the simulated card in this process; or a serial port, as in `/dev/ttyUSB0@230400`.
    #[arg(long, default_value = "sim", value_name = "CARD")]
    pub card: String,
    /// Machine file; a three-axis machine is built in.
    #[arg(long, value_name = "FILE.toml")]
    pub machine: Option<PathBuf>,
    /// Play in wall time; without it the simulated card runs as fast as it can.
    #[arg(long)]
    pub realtime: bool,
    /// Full-screen operation; in wall time. The default with --realtime on a terminal.
    #[arg(long, conflicts_with = "no_tui")]
    pub tui: bool,
    /// No full-screen operation.
    #[arg(long)]
    pub no_tui: bool,
    /// Scripted operator.
    #[arg(long, value_name = "FILE")]
    pub operator: Option<PathBuf>,
    /// Whether M1 stops. Left out: it does in wall time without --operator and without the screen, where Enter goes on.
    #[arg(long, value_enum, value_name = "on|off")]
    pub optional_stop: Option<OnOff>,
    /// What the card executed, one row a control period.
    #[arg(long, value_name = "FILE.csv")]
    pub records: Option<PathBuf>,
    /// With the simulated card: its pins, outputs and inputs as a trace for wave viewers.
    #[arg(long, value_name = "FILE.vcd")]
    pub vcd: Option<PathBuf>,
    /// Dry run: the axes move, and every cutter is kept off.
    #[arg(long)]
    pub dry_run: bool,
    /// One JSON object a line on standard output, the report last.
    #[arg(long)]
    pub json: bool,
    /// Begin at this program line, with the modal state that holds there.
    #[arg(long, value_name = "N")]
    pub start_line: Option<u32>,
    /// Folder for jobs: journal, breakpoint, report; by default `retrace/jobs` in the user's state folder.
    #[arg(long, value_name = "DIR")]
    pub journal: Option<PathBuf>,
    /// Keep no journal: the job cannot be resumed.
    #[arg(long, conflicts_with = "journal")]
    pub no_journal: bool,
}

/// A switch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum OnOff {
    /// On.
    On,
    /// Off.
    Off,
}

impl OnOff {
    /// Is it on?
    #[must_use]
    pub fn is_on(self) -> bool {
        self == Self::On
    }
}

/// `retrace resume`
#[derive(Debug, Args)]
pub struct Resume {
    /// Name of the job, or how only one begins; the newest that can be resumed where none is named.
    #[arg(value_name = "JOB")]
    pub job: Option<String>,
    /// Folder of the jobs; by default `retrace/jobs` in the user's state folder.
    #[arg(long, value_name = "DIR")]
    pub journal: Option<PathBuf>,
    /// The card, where it is at another port now: `sim` for a job of the simulated card, else a serial port.
    #[arg(long, value_name = "CARD")]
    pub card: Option<String>,
    /// Agree to what will be done, outputs that are switched among it.
    #[arg(short, long)]
    pub yes: bool,
    /// Where the program is now, or is sent again: a file, `-`, or `tcp://HOST:PORT`.
    #[arg(long, value_name = "PROGRAM")]
    pub program: Option<PathBuf>,
    /// Begin at this program line instead, from where the machine stands, with the modal state that holds there: a job of its own.
    #[arg(long, value_name = "N")]
    pub from_line: Option<u32>,
    /// The card was restarted, and the machine stands where its counts say: confirms that where no home switch does, and goes back from there
    /// to the breakpoint that the journal kept last.
    #[arg(long, conflicts_with = "from_line")]
    pub at_counts: bool,
    /// Play in wall time; without it the simulated card runs as fast as it can.
    #[arg(long)]
    pub realtime: bool,
    /// Full-screen operation; in wall time.
    #[arg(long, conflicts_with = "json")]
    pub tui: bool,
    /// Scripted operator.
    #[arg(long, value_name = "FILE")]
    pub operator: Option<PathBuf>,
    /// Whether M1 stops. Left out: as it was when the job was left; else it does in wall time without --operator and without the screen, where Enter goes on.
    #[arg(long, value_enum, value_name = "on|off")]
    pub optional_stop: Option<OnOff>,
    /// What the card executed, one row a control period.
    #[arg(long, value_name = "FILE.csv")]
    pub records: Option<PathBuf>,
    /// One JSON object a line on standard output, the report last.
    #[arg(long)]
    pub json: bool,
    /// Refused: a job goes on with the machine that it began with.
    #[arg(long, value_name = "FILE.toml", hide = true)]
    pub machine: Option<PathBuf>,
}

/// `retrace jobs`
#[derive(Debug, Args)]
pub struct Jobs {
    /// What to do; all are listed where nothing is named.
    #[command(subcommand)]
    pub action: Option<JobsAction>,
    /// Every job, what never began among them; the newest 20 otherwise.
    #[arg(long)]
    pub all: bool,
    /// One JSON object on standard output.
    #[arg(long, global = true)]
    pub json: bool,
    /// Folder of the jobs; by default `retrace/jobs` in the user's state folder.
    #[arg(long, value_name = "DIR", global = true)]
    pub journal: Option<PathBuf>,
}

/// What `retrace jobs` does.
#[derive(Debug, Subcommand)]
pub enum JobsAction {
    /// Tell everything that is known of a job: how far it came, where the machine stood, what was on.
    #[command(after_help = "Example:\n  retrace jobs show 20261122-004627-part --json")]
    Show {
        /// Name of the job, or how only one begins.
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
    /// One JSON object on standard output.
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
    /// What became of a job, from its journal, in place of a program: its name, or how only one begins; the newest where none is named.
    #[arg(long, value_name = "JOB", num_args = 0..=1, conflicts_with_all = ["program", "machine", "operator", "profile"])]
    pub job: Option<Option<String>>,
    /// Folder of the jobs, for --job; by default `retrace/jobs` in the user's state folder.
    #[arg(long, value_name = "DIR", requires = "job")]
    pub journal: Option<PathBuf>,
    /// Picture to write: `.svg` or `.png`.
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Machine file; a three-axis machine is built in.
    #[arg(long, value_name = "FILE.toml")]
    pub machine: Option<PathBuf>,
    /// Scripted operator: the stretches that were retraced are marked.
    #[arg(long, value_name = "FILE")]
    pub operator: Option<PathBuf>,
    /// Velocity, acceleration and jerk over time in place of the path.
    #[arg(long)]
    pub profile: bool,
    /// With --profile: draw from the first motion of this program line on.
    #[arg(long, value_name = "N", requires = "profile")]
    pub from: Option<u32>,
    /// With --profile: draw up to the last motion of this program line.
    #[arg(long, value_name = "M", requires = "profile")]
    pub to: Option<u32>,
    /// Direction of view: xy, xz, yz or iso; by default the plane the program works in.
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
    /// Hours of reverse run wanted (h).
    #[arg(long, default_value_t = 0.5)]
    pub hours: f64,
    /// Control period in ms (T).
    #[arg(long, default_value_t = 1.0)]
    pub period_ms: f64,
    /// Bytes for one axis' pulses and direction (n).
    #[arg(long, default_value_t = 2)]
    pub bytes: u32,
    /// Machine file whose history is to be reckoned; a three-axis machine is built in.
    #[arg(long, value_name = "FILE.toml")]
    pub machine: Option<PathBuf>,
}
