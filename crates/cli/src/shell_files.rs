//! `retrace completions` and `retrace man`: the files that a package installs beside the command.
//!
//! Invariant: both are generated from the definition of the command line, so that they cannot differ from `--help`.

use std::io;
use std::path::PathBuf;

use clap::CommandFactory;
use clap_complete::Shell;
use retrace_controller::numbered_error::NumberedError;

use crate::args::Cli;
use crate::console::unwritable;

/// The name of the command in completions and manual pages.
const NAME: &str = "retrace";

/// `retrace completions`
#[derive(Debug, clap::Args)]
pub struct Completions {
    /// The shell that reads the script.
    pub shell: Shell,
}

/// `retrace man`
#[derive(Debug, clap::Args)]
pub struct Man {
    /// Folder to write the pages into; it is created where it is missing.
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
}

/// Prints the completion script of a shell.
pub fn print_completions(args: &Completions) {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), NAME, &mut script);
    crate::out::line(String::from_utf8_lossy(&script).trim_end());
}

/// Writes one manual page for the command and one for each of its subcommands.
///
/// # Errors
/// Where the folder cannot be created, or a page cannot be written.
pub fn write_manual(args: &Man) -> Result<(), NumberedError> {
    let write = || -> io::Result<()> {
        std::fs::create_dir_all(&args.folder)?;
        clap_mangen::generate_to(Cli::command(), &args.folder)
    };
    write().map_err(|error| unwritable(&args.folder.display().to_string(), &error))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::ValueEnum;

    #[test]
    fn the_completions_of_every_shell_name_the_subcommands() {
        for &shell in Shell::value_variants() {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), NAME, &mut script);
            let script = String::from_utf8(script).unwrap();
            for name in ["run", "resume", "check"] {
                assert!(script.contains(name), "{shell}: {name} is missing");
            }
        }
    }

    #[test]
    fn every_subcommand_that_is_not_hidden_has_a_page() {
        let folder = tempfile::tempdir().unwrap();
        write_manual(&Man { folder: folder.path().join("man") }).unwrap();
        for command in Cli::command().get_subcommands() {
            let page = folder.path().join(format!("man/retrace-{}.1", command.get_name()));
            assert_eq!(page.is_file(), !command.is_hide_set(), "{}", page.display());
        }
        let page = std::fs::read_to_string(folder.path().join("man/retrace.1")).unwrap();
        assert!(page.starts_with(".ie") || page.contains(".TH retrace 1"), "{page}");
    }
}
