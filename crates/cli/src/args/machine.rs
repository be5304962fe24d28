//! Arguments of `retrace machine`.

use std::path::PathBuf;

use clap::builder::PossibleValuesParser;
use clap::{Subcommand, ValueEnum};

use crate::known_boards;

/// `retrace machine`
#[derive(Debug, Subcommand)]
pub enum Machine {
    /// Write a commented machine file: the built-in machine with every key, or a template for a kind of machine.
    #[command(
        after_help = "Examples:\n  retrace machine new -o mill.toml\n  retrace machine new waterjet -o waterjet.toml\n\
            \x20 retrace machine new plasma --board pico -o plasma.toml"
    )]
    New {
        /// Kind of machine: waterjet, plasma, laser, router or lathe; by default the built-in machine.
        #[arg(value_enum)]
        kind: Option<MachineKind>,
        /// Kind of machine, as an option.
        #[arg(long = "kind", value_enum, value_name = "KIND", conflicts_with = "kind")]
        of_kind: Option<MachineKind>,
        /// Board that the card runs on. The file begins with the board's figures; a warning names what does not fit.
        #[arg(long, value_name = "BOARD", value_parser = PossibleValuesParser::new(known_boards::NAMES))]
        board: Option<String>,
        /// File to write, standard output by default. An existing file is not overwritten.
        #[arg(short, long, value_name = "FILE.toml")]
        output: Option<PathBuf>,
    },
    /// Write the JSON schema of the machine file, with which an editor completes and checks keys.
    #[command(
        after_help = "Example:\n  retrace machine schema -o machine-file.schema.json\n\nThen the first line of a \
            machine file is:\n  \
        #:schema ./machine-file.schema.json"
    )]
    Schema {
        /// File to write, standard output by default. An existing file is not overwritten.
        #[arg(short, long, value_name = "FILE.json")]
        output: Option<PathBuf>,
    },
    /// Check a machine file: one line per error and warning, then a summary of the machine.
    #[command(after_help = "Examples:\n  retrace machine check examples/02-back-up.toml\n  \
        retrace machine check mill.toml --card /dev/ttyUSB0\n  retrace machine check mill.toml --card pico\n\n\
        Exit codes: 0 usable, with warnings or without · 2 errors · 3 the card does not answer")]
    Check {
        /// The machine file.
        file: PathBuf,
        /// Compare it with the card at this port, `PATH[@BAUD]`, or with a board for which there is firmware, `pico`,
        /// `pico2`, `f401`, `f405` or `f411`: step rates, control period, axes, inputs and outputs.
        #[arg(long, value_name = "PORT|BOARD")]
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
