//! Arguments of the commands that move nothing: `retrace check`, `canon`, `plot` and `size`.

use std::path::PathBuf;

use clap::Args;

use super::reading::Reading;
use super::shared::{JobsFolder, JsonObject, MachineFile, Planning};

/// `retrace check`
#[derive(Debug, Args)]
pub struct Check {
    #[command(flatten)]
    pub reading: Reading,
    /// Print the branch table: every jump of the program and its files, numbered, with its target.
    #[arg(long, conflicts_with = "json")]
    pub table: bool,
    #[command(flatten)]
    pub machine_file: MachineFile,
    #[command(flatten)]
    pub planning: Planning,
    /// Write the materials that the program declares with `(o=1, …)` and `(o=2, …)` into the material table of the
    /// machine, if there is no error. Comments in the table stay.
    #[arg(long)]
    pub save_materials: bool,
    #[command(flatten)]
    pub format: JsonObject,
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
    /// Draw the history of a job from its journal instead of a program: its name or a unique prefix; by default the
    /// newest.
    #[arg(long, value_name = "JOB", num_args = 0..=1,
        conflicts_with_all = ["program", "machine", "operator", "profile"])]
    pub job: Option<Option<String>>,
    #[command(flatten)]
    pub jobs: JobsFolder,
    /// Output file: `.svg` or `.png`.
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    #[command(flatten)]
    pub machine_file: MachineFile,
    #[command(flatten)]
    pub planning: Planning,
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
    #[command(flatten)]
    pub machine_file: MachineFile,
}
