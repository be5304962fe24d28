//! `retrace completions` and `retrace man`: generate the files that a package installs with the command.
//!
//! Invariant: both are generated from the definition of the command line, so that they cannot differ from `--help`.

use std::io;
use std::path::Path;

use clap::CommandFactory;
use clap_complete::Shell;
use retrace_config::NumberedError;

use crate::args::{Cli, ShellFiles};
use crate::files::unwritable;

/// Name of the command in completions and manual pages.
const NAME: &str = "retrace";

/// Runs the command.
///
/// # Errors
/// A page cannot be written.
pub fn run(command: &ShellFiles) -> Result<(), NumberedError> {
    match command {
        ShellFiles::Completions { shell } => {
            print_completions(*shell);
            Ok(())
        }
        ShellFiles::Man { folder } => write_manual(folder),
    }
}

/// Prints the completion script of a shell.
fn print_completions(shell: Shell) {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), NAME, &mut script);
    crate::out::line(String::from_utf8_lossy(&script).trim_end());
}

/// Writes one manual page for the command and one for each of its subcommands.
fn write_manual(folder: &Path) -> Result<(), NumberedError> {
    let write = || -> io::Result<()> {
        std::fs::create_dir_all(folder)?;
        clap_mangen::generate_to(Cli::command(), folder)
    };
    write().map_err(|error| unwritable(&folder.display().to_string(), &error))
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
        write_manual(&folder.path().join("man")).unwrap();
        for command in Cli::command().get_subcommands() {
            let page = folder.path().join(format!("man/retrace-{}.1", command.get_name()));
            assert_eq!(page.is_file(), !command.is_hide_set(), "{}", page.display());
        }
        let page = std::fs::read_to_string(folder.path().join("man/retrace.1")).unwrap();
        assert!(page.starts_with(".ie") || page.contains(".TH retrace 1"), "{page}");
    }
}
