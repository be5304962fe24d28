//! Arguments of `retrace card`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::shared::{CardAddress, JsonObject, MachineFile, SimulatedSource, SimulatedWork};

/// `retrace card`
#[derive(Debug, Subcommand)]
pub enum Card {
    /// Serve a simulated card in wall time until interrupted. Hosts may connect one after another; the position is
    /// kept.
    #[command(
        after_help = "Manual inputs are read from standard input (a pipe; a terminal with --manual-inputs), one a \
            line:\n  wheel -120 for 2s     turn the handwheel, \
        in counts per second; `wheel -7` turns it by 7 counts at once\n  press door            also emergency-stop, \
        probe\n  release door\n  input 5 on            an input, by its number\n  unplug                pulls \
        the cable of the line; also `plug in`\n  power off             switches the card off, which loses its \
        state; also `power on`\n  spindle stall         \
        also `spindle load 30% for 200ms`, `spindle free`, `spindle turn -2`\n  encoder dead          also `encoder \
        lose 7`, `encoder no-index`\n  analog 1 3.2          an analog input, \
        in its unit\n\nExamples:\n  retrace card serve --pty --link my-card --vcd my-card.vcd\n  \
        retrace card serve --pty --faults baud=230400,rate=1e-5,seed=7\n  retrace run examples/01-first-cut.ngc \
        --card my-card"
    )]
    Serve(Serve),
    /// List the serial ports. Pseudo-terminals are not listed.
    #[command(after_help = "Example:\n  retrace card ports --json")]
    Ports {
        #[command(flatten)]
        format: JsonObject,
    },
    /// Identify the card at a port: name, position, outputs that are on, latched alarm.
    #[command(after_help = "Example:\n  retrace card identify /dev/ttyUSB0@230400")]
    Identify {
        #[command(flatten)]
        address: CardAddress,
        #[command(flatten)]
        machine_file: MachineFile,
        #[command(flatten)]
        format: JsonObject,
    },
    /// Clear the latched alarm of a card if its cause is gone. Nothing moves.
    #[command(after_help = "Example:\n  retrace card clear /dev/ttyUSB0@230400")]
    Clear {
        #[command(flatten)]
        address: CardAddress,
        #[command(flatten)]
        machine_file: MachineFile,
    },
}

/// `retrace card serve`
#[derive(Debug, Args)]
pub struct Serve {
    /// Serve on a pseudo-terminal and print its path. Required: no other transport is supported.
    #[arg(long, required = true)]
    pub pty: bool,
    #[command(flatten)]
    pub machine_file: MachineFile,
    /// Symbolic link to create for the pseudo-terminal; an existing link is replaced.
    #[arg(long, value_name = "PATH")]
    pub link: Option<PathBuf>,
    /// Trace of step, direction, outputs and place for a wave viewer.
    #[arg(long, value_name = "FILE.vcd")]
    pub vcd: Option<PathBuf>,
    /// Faults on the line, such as `rate=1e-5,seed=7` or `down.drop@1000`; see docs/simulated-machine.md.
    #[arg(long, value_name = "SPEC")]
    pub faults: Option<String>,
    #[command(flatten)]
    pub source: SimulatedSource,
    #[command(flatten)]
    pub work: SimulatedWork,
    /// Axis whose step output is wired to analog input 0, which measures its frequency: for `retrace doctor
    /// --step-test`.
    #[arg(long, value_name = "AXIS")]
    pub step_wire: Option<char>,
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
