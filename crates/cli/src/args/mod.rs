//! Command line: the commands here, the arguments of each in a file of its own.
//!
//! The requirements page `interface.md` fixes names and meanings of commands and options; more may be added.
//!
//! Invariant: `--help` describes every command and every option, with an example for each command.

mod card;
mod check;
mod consumables;
mod cycles;
mod doctor;
mod machine;
mod manual;
mod materials;
mod page;
mod probe;
mod reading;
mod resume;
mod run;
mod send;
mod shared;
mod shell_files;
#[cfg(feature = "shop")]
mod shop;

use std::path::PathBuf;

use clap::builder::{ArgPredicate, TypedValueParser};
use clap::{Parser, Subcommand};

pub use self::card::{Card, Serve};
pub use self::check::{Canon, Check, Plot, Size};
pub use self::consumables::Consumables;
pub use self::cycles::{CycleFolders, Cycles, CyclesAction};
pub use self::doctor::Doctor;
pub use self::machine::{Machine, MachineKind};
pub use self::manual::{Home, Jog, ManualOptions, Mdi, MdiOptions};
pub use self::materials::{Materials, Units};
pub use self::probe::Probe;
pub use self::reading::{MAX_CHECKED_LOOP_BLOCKS, Reading};
pub use self::resume::{Jobs, JobsAction, Resume};
pub use self::run::Run;
pub use self::send::Send;
pub use self::shared::{CardPort, MachineFile, OnOff, Planning, SimulatedSource, SimulatedWork};
pub use self::shell_files::ShellFiles;
#[cfg(all(feature = "shop", unix))]
pub use self::shop::MtConnect;
#[cfg(feature = "shop")]
pub use self::shop::{Shop, ShopAction, ShopInit, ShopJobOptions, Submit};

/// Options of `retrace run` that need no program on the command line.
const WITHOUT_PROGRAM: &[&str] = if cfg!(feature = "shop") { &["tui", "job"] } else { &["tui"] };

/// CNC control that runs NC programs and retraces the executed path, exact to the pulse.
#[derive(Debug, Parser)]
#[command(name = "retrace", version, about, arg_required_else_help = true)]
#[command(
    after_help = "Example:\n  retrace run examples/01-first-cut.ngc\n\nExit codes: 0 completed · 1 the program has \
        errors · \
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
    /// Run a program: on the simulated card unless --card names a port.
    #[command(
        after_help = "Examples:\n  retrace run examples/02-back-up.ngc --operator examples/02-back-up.op --records \
            out.csv --json\n  \
        retrace run --tui --card /dev/ttyUSB0 --machine mill.toml"
    )]
    #[command(mut_arg("program", |program| {
        let any_text = clap::builder::OsStringValueParser::new().map(PathBuf::from);
        let help = "NC program; `-` is standard input; with --tui it can be loaded at the screen";
        program.value_parser(any_text).required(false).required_unless_present_any(WITHOUT_PROGRAM).default_value_ifs(
            WITHOUT_PROGRAM.iter().map(|option| (*option, ArgPredicate::IsPresent, ""))).help(help)
    }))]
    Run(Run),
    /// Serve the graphical screen as a page in a browser, with or without a program.
    #[command(
        after_help = "Examples:\n  retrace serve --demo\n  retrace serve --card /dev/ttyUSB0 --machine plasma.toml \
            --programs parts\n  retrace serve --listen 192.168.1.20:8181 --name table --tui part.ngc"
    )]
    #[command(mut_arg("program", |program| {
        let any_text = clap::builder::OsStringValueParser::new().map(PathBuf::from);
        let help = "NC program; it can be opened on the page";
        program.value_parser(any_text).required(false).default_value("").help(help)
    }))]
    #[command(mut_arg("serve", |serve| serve.hide(true)), mut_arg("json", |json| json.hide(true)))]
    #[command(mut_arg("no_tui", |no_tui| no_tui.hide(true)), mut_arg("save_materials", |save| save.hide(true)))]
    #[command(mut_arg("realtime", |realtime| realtime.hide(true)))]
    #[command(mut_arg("demo", |demo| {
        demo.hide(false).conflicts_with_all(["program", "machine", "card", "source_faults"])
    }))]
    #[cfg_attr(
        feature = "shop",
        command(mut_arg("job", |job| job.hide(true)))
    )]
    Serve(Run),
    /// Decode and pre-scan only: every diagnostic, with line and column; nothing moves.
    #[command(
        after_help = "Examples:\n  retrace check examples/01-first-cut.ngc\n  retrace check examples/01-first-cut.ngc \
            --table\n  \
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
    #[command(mut_arg("journal", |journal| journal.requires("job")))]
    Plot(Plot),
    /// Resume an interrupted job at its breakpoint.
    #[command(after_help = "Examples:\n  retrace resume\n  retrace resume 20261122-004627-part --yes\n  \
        retrace resume 20261122-004627-part --from-line 120\n  \
        retrace resume --tui")]
    Resume(Resume),
    /// List jobs: which can be resumed, which ran, how they ended.
    #[command(after_help = "Examples:\n  retrace jobs\n  retrace jobs show 20261122-004627-part")]
    #[command(mut_arg("json", |json| json.global(true)), mut_arg("journal", |journal| journal.global(true)))]
    Jobs(Jobs),
    /// Ring size for so many axes, hours, milliseconds and bytes (REV-4), and what the machine file gives.
    #[command(after_help = "Example:\n  retrace size --axes 3 --hours 0.5 --period-ms 2.5 --bytes 2")]
    Size(Size),
    /// List, check and compile the cycles that programs can call.
    #[command(after_help = "Examples:\n  retrace cycles\n  retrace cycles show CYCLE81\n  \
        retrace cycles check --cycles my-cycles\n\nExit codes: 0 no errors · 1 a cycle has errors · 2 wrong usage")]
    Cycles(Cycles),
    /// Write a commented machine file, check one.
    #[command(
        subcommand,
        after_help = "Examples:\n  retrace machine new -o mill.toml\n  retrace machine check examples/02-back-up.toml"
    )]
    Machine(Machine),
    /// Import, export and list material tables.
    #[command(
        subcommand,
        after_help = "Examples:\n  retrace materials import plasma_material.cfg --units mm --out materials.toml\n  \
            retrace materials list materials.toml"
    )]
    Materials(Materials),
    /// Wear of the consumables of a machine since they were changed: starts, time and length cut.
    #[command(after_help = "Examples:\n  retrace consumables --machine table.toml --card /dev/ttyUSB0\n  \
        retrace consumables --machine table.toml --card /dev/ttyUSB0 --changed")]
    Consumables(Consumables),
    /// Home the machine over the card's switches: one axis, or all in the machine file's order.
    #[command(
        after_help = "Examples:\n  retrace home --card /dev/ttyUSB0 --machine mill.toml\n  retrace home z --card \
            my-card --machine mill.toml"
    )]
    Home(Home),
    /// Jog an axis by a distance in mm (degrees) at its jog speed; the move ends at the soft limit.
    #[command(after_help = "Example:\n  retrace jog x -12.5 --card /dev/ttyUSB0 --machine mill.toml")]
    Jog(Jog),
    /// Execute one MDI block.
    #[command(after_help = "Examples:\n  retrace mdi 'G0 X10' --card /dev/ttyUSB0\n  retrace mdi 'G10 L20 P1 X0 Y0' \
            --params mill.var")]
    Mdi(Mdi),
    /// Probe a surface, an edge, a corner, a bore or the length of a tool, and set offsets by it.
    #[command(after_help = probe::help())]
    Probe(Probe),
    /// Measure how fast this computer and the line to a card respond, and whether the control period suits them.
    #[command(after_help = "Examples:\n  retrace doctor\n  retrace doctor /dev/ttyUSB0 --machine mill.toml")]
    Doctor(Doctor),
    /// Send a program over an RS-232 line to an old control that waits for it.
    #[command(after_help = "Example:\n  retrace send part.ngc --to 'serial:/dev/ttyUSB0?baud=4800&format=7e2'")]
    Send(Send),
    /// Serve a simulated card on a pseudo-terminal, list serial ports, identify a card.
    #[command(
        subcommand,
        after_help = "Examples:\n  retrace card serve --pty\n  retrace card identify /dev/ttyUSB0@230400"
    )]
    Card(Card),
    /// Submit jobs to this machine, check them, and list them; `retrace run --job` starts one.
    #[cfg(feature = "shop")]
    #[command(after_help = "Examples:\n  retrace shop submit part.ngc --quantity 3 --note 'for order 17'\n  \
        retrace shop agent --once\n  retrace shop jobs\n  retrace run --job 0192f0c1")]
    Shop(Shop),
    #[command(flatten)]
    ShellFiles(ShellFiles),
}
