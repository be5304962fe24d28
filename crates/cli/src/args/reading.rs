//! Options of every command that reads a program.

use std::path::PathBuf;

use clap::Args;
use retrace_journal::MachineTables;

use super::cycles::CycleFolders;

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
    /// Parameter file; a completed run rewrites it. With --machine or --card, `run` uses the machine's own file in the
    /// user's state folder by default.
    #[arg(long, value_name = "FILE")]
    pub params: Option<PathBuf>,
    /// LinuxCNC machine configuration: the entries that `rs274` reads, and its numbers as `#<_ini[section]name>`.
    #[arg(long, value_name = "FILE.ini")]
    pub ini: Option<PathBuf>,
    /// Maximum number of blocks in loops and calls that the check before the run executes; the rest is not checked
    /// (W1004).
    #[arg(long, value_name = "N", default_value_t = MAX_CHECKED_LOOP_BLOCKS)]
    pub max_loop_blocks: u64,
    /// The machine's own tables in the state folder, for tables that no option names.
    #[arg(skip)]
    pub machine_tables: Option<MachineTables>,
}
