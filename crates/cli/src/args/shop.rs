//! Arguments of `retrace shop`, and the options of `retrace run` for a job of the shop.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use retrace_shop::RunRecorder;

use super::shared::JsonObject;

/// `retrace shop`
#[derive(Debug, Args)]
pub struct Shop {
    /// Action.
    #[command(subcommand)]
    pub action: ShopAction,
    /// Shop file; by default `shop.toml` in the user's state folder, if there is one.
    #[arg(long, value_name = "FILE.toml", global = true)]
    pub shop_file: Option<PathBuf>,
}

/// Actions of `retrace shop`. None of them moves a machine.
#[derive(Debug, Subcommand)]
pub enum ShopAction {
    /// Submit a program with its subprograms as a job; prints the name of the job.
    #[command(after_help = "Example:\n  retrace shop submit part.ngc pocket.ngc --quantity 3 --material 'steel 4 mm'")]
    Submit(Submit),
    /// Take submitted jobs and check them; with `[watch]` in the shop file also submit the files of a folder.
    #[command(after_help = "Examples:\n  retrace shop agent\n  retrace shop agent --once")]
    Agent {
        /// End when nothing is left to be done.
        #[arg(long)]
        once: bool,
    },
    /// List the jobs of this machine, in their order.
    #[command(after_help = "Examples:\n  retrace shop jobs\n  retrace shop jobs --json")]
    Jobs {
        #[command(flatten)]
        format: JsonObject,
        /// List finished jobs, too; by default the last 20 of them.
        #[arg(long)]
        all: bool,
    },
    /// Print all details of a job: files, check, runs.
    #[command(after_help = "Example:\n  retrace shop show 0192f0c1")]
    Show {
        /// Name of the job or a unique prefix.
        id: String,
        #[command(flatten)]
        format: JsonObject,
    },
    /// Send the jobs submitted here to the broker until machines have taken them, and make its streams.
    #[command(after_help = "Examples:\n  retrace shop host\n  retrace shop host --once")]
    Host {
        /// End when every job was sent.
        #[arg(long)]
        once: bool,
    },
    /// Show what the machines of the shop do, until interrupted.
    #[command(after_help = "Examples:\n  retrace shop watch\n  retrace shop watch --once --json")]
    Watch {
        /// Print the table once.
        #[arg(long)]
        once: bool,
        #[command(flatten)]
        format: JsonObject,
    },
    /// Take a job back that is neither running nor interrupted; one of another machine through the broker.
    #[command(after_help = "Example:\n  retrace shop recall 0192f0c1")]
    Recall {
        /// Name of the job or a unique prefix.
        id: String,
    },
    /// Show a text to the operator of a machine.
    #[command(after_help = "Example:\n  retrace shop say mill-3 'the material comes at two'")]
    Say {
        /// Machine.
        machine: String,
        /// Text, one line.
        text: String,
    },
    /// Write keys, shop files and the configuration of a nats-server for a shop of machines.
    #[command(
        after_help = "Example:\n  retrace shop init shop --machine mill-1 --machine mill-2 --submitter office \\\n    \
        --group mills=mill-1,mill-2"
    )]
    Init(ShopInit),
    /// Print the public key of a seed, which the shop files of machines name, or make a new seed.
    #[command(after_help = "Examples:\n  retrace shop key --new office.seed\n  retrace shop key office.seed")]
    Key {
        /// File with the seed.
        file: PathBuf,
        /// Make a new seed in a new file.
        #[arg(long)]
        new: bool,
    },
    /// Give a job up: what is missing of it is not cut.
    #[command(after_help = "Example:\n  retrace shop give-up 0192f0c1")]
    GiveUp {
        /// Name of the job or a unique prefix.
        id: String,
    },
    /// Count a piece that was sent to an old machine as good, by the operator's word.
    #[command(after_help = "Example:\n  retrace shop good 0192f0c1 20261122-004627-sent")]
    Good {
        /// Name of the job or a unique prefix.
        id: String,
        /// Name of the run, or a unique prefix.
        run: String,
    },
    /// Mark the piece of a run as scrap: it does not count, and another one can be started.
    #[command(after_help = "Example:\n  retrace shop scrap 0192f0c1 20261122-004627-part")]
    Scrap {
        /// Name of the job or a unique prefix.
        id: String,
        /// Name of the run in `retrace jobs`, or a unique prefix.
        run: String,
    },
    /// Check that one machine has each job, and that no piece was run twice, by ledgers and journals.
    #[command(after_help = "Examples:\n  retrace shop audit\n  retrace shop audit --root /mnt/mill --root /mnt/lathe")]
    Audit {
        /// Root of a shop; may be given more than once. By default that of the shop file.
        #[arg(long, value_name = "DIR")]
        root: Vec<PathBuf>,
        /// Read events and claims at the broker instead of ledgers and journals.
        #[arg(long, conflicts_with = "root")]
        broker: bool,
        #[command(flatten)]
        format: JsonObject,
    },
    /// Check shop file, ledger, broker and permissions of this computer; changes nothing.
    #[command(after_help = "Example:\n  retrace shop doctor")]
    Doctor,
    /// Serve what the machine does to an MTConnect agent (SHDR), until interrupted; nothing is taken from it.
    #[cfg(unix)]
    #[command(after_help = "Examples:\n  retrace shop mtconnect\n  retrace shop mtconnect --devices > Devices.xml")]
    Mtconnect(MtConnect),
    /// Publish what the machine does to an MQTT broker (Sparkplug B), until interrupted; a birth can be asked for, and
    /// nothing else.
    #[cfg(unix)]
    #[command(after_help = "Example, with `[sparkplug]` and `broker = \"mqtt://HOST\"` in the shop file:\n  \
                            retrace shop sparkplug")]
    Sparkplug {
        /// Machine file, for its axes; by default that of the shop file, or the built-in machine.
        #[arg(long, value_name = "FILE.toml")]
        machine: Option<PathBuf>,
    },
}

/// `retrace shop mtconnect`
#[cfg(unix)]
#[derive(Debug, Args)]
pub struct MtConnect {
    /// Address and port to listen on; another computer's agent needs one of this computer on its network.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:7878")]
    pub listen: String,
    /// Print the device file of the agent instead.
    #[arg(long)]
    pub devices: bool,
    /// Machine file, for its axes; by default that of the shop file, or the built-in machine.
    #[arg(long, value_name = "FILE.toml")]
    pub machine: Option<PathBuf>,
}

/// `retrace shop init`
#[derive(Debug, Args)]
pub struct ShopInit {
    /// Folder for the files; seeds and shop files that are there are kept.
    pub folder: PathBuf,
    /// Machine; may be given more than once.
    #[arg(long, value_name = "NAME")]
    pub machine: Vec<String>,
    /// Computer that submits jobs, beside the one that is named `host`; may be given more than once.
    #[arg(long, value_name = "NAME")]
    pub submitter: Vec<String>,
    /// Group of machines; may be given more than once.
    #[arg(long, value_name = "NAME=MACHINE,MACHINE")]
    pub group: Vec<String>,
    /// Server as the computers of the shop reach it; by default at the address of --listen, not encrypted.
    #[arg(long, value_name = "URL")]
    pub server: Option<String>,
    /// Address and port that the server listens on.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:4222")]
    pub listen: String,
    /// Certificate of the server.
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    pub tls_cert: Option<PathBuf>,
    /// Private key of that certificate.
    #[arg(long, value_name = "FILE", requires = "tls_cert")]
    pub tls_key: Option<PathBuf>,
    /// Root certificate that the computers verify the server with, as their shop files name it.
    #[arg(long, value_name = "FILE")]
    pub ca: Option<PathBuf>,
    /// Allow an unencrypted connection to another computer.
    #[arg(long)]
    pub insecure: bool,
    /// Have the server make each message durable before it acknowledges it; needs nats-server 2.10 or later.
    #[arg(long)]
    pub always_synced: bool,
    /// Print the configuration of the server instead.
    #[arg(long)]
    pub print_config: bool,
}

/// `retrace shop submit`
#[derive(Debug, Args)]
pub struct Submit {
    /// The program, then its subprograms and the sources of its cycles, `*.SPF`. A job with cycles is run with these
    /// and the built-in ones alone.
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Machine that the job is for; by default this one. With `[broker]` in the shop file it can be any machine.
    #[arg(long, value_name = "NAME")]
    pub machine: Option<String>,
    /// Group of machines that the job is for: the first one that has nothing to do takes it.
    #[arg(long, value_name = "NAME", conflicts_with = "machine")]
    pub group: Option<String>,
    /// Wait until a machine has taken the job.
    #[arg(long)]
    pub wait: bool,
    /// Number of pieces; each is a run of its own.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub quantity: u32,
    /// Let the operator start several pieces at once, one after the other, by `retrace run --job ID --repeat N`.
    #[arg(long)]
    pub may_repeat: bool,
    /// Number of the office's order that the job belongs to, as text.
    #[arg(long, value_name = "NUMBER", default_value = "", hide_default_value = true)]
    pub order: String,
    /// Text for the operator.
    #[arg(long, value_name = "TEXT", default_value = "", hide_default_value = true)]
    pub note: String,
    /// The material, as text.
    #[arg(long, value_name = "TEXT", default_value = "", hide_default_value = true)]
    pub material: String,
    /// Machine file that the job was made for; with another one the operator is warned.
    #[arg(long, value_name = "FILE.toml")]
    pub made_for: Option<PathBuf>,
    /// Refuse to run the job with another machine file.
    #[arg(long, requires = "made_for")]
    pub only_made_for: bool,
}

/// Options of `retrace run` for a job of the shop.
#[derive(Clone, Debug, Default, Args)]
pub struct ShopJobOptions {
    /// Run the next piece of this job of the shop: its name in `retrace shop jobs`, or a unique prefix.
    #[arg(long, value_name = "ID", conflicts_with_all = [
        "program", "no_journal", "dry_run", "start_line", "contour", "save_materials", "serve",
    ])]
    pub job: Option<String>,
    /// Run so many pieces of --job, one after the other without a pause, if the job permits it.
    #[arg(long, value_name = "N", requires = "job", conflicts_with_all = ["tui"])]
    pub repeat: Option<u32>,
    /// Shop file of --job and of the jobs at the screen; by default `shop.toml` in the user's state folder, if there is
    /// one.
    #[arg(long, value_name = "FILE.toml")]
    pub shop_file: Option<PathBuf>,
    /// Recorder of the runs of the job that was found.
    #[arg(skip)]
    pub recorder: Option<RunRecorder>,
}
