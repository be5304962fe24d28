//! Subprograms in files of their own: `O<part> call` finds `part.ngc`.
//!
//! Invariant: the program's own folder comes first, then those of the command line in their order; nothing outside of them is read.

use std::path::{Path, PathBuf};

use retrace_gcode::{SubFile, SubFiles};

/// The folders that are looked into.
#[derive(Debug)]
pub struct Folders(Vec<PathBuf>);

impl Folders {
    /// The folder of a program, and more.
    #[must_use]
    pub fn of(program: &Path, more: &[PathBuf]) -> Self {
        let own = if program.as_os_str() == "-" { None } else { program.parent().map(Path::to_path_buf) };
        Self(own.into_iter().chain(more.iter().cloned()).collect())
    }
}

impl SubFiles for Folders {
    fn find(&self, name: &str) -> Option<SubFile> {
        // A label is a name, not a path.
        if name.is_empty() || name.contains(['/', '\\', '\0']) || name.starts_with('.') {
            return None;
        }
        let path = self.0.iter().map(|folder| folder.join(format!("{name}.ngc"))).find(|path| path.is_file())?;
        let text = std::fs::read(&path).map(Into::into).map_err(|error| error.to_string());
        Some(SubFile { name: path.display().to_string(), text })
    }
}
