//! What a run leaves behind: the lines of its log, and the parameters that outlive a program.
//!
//! Invariant: only a run leaves anything, a check never does. Parameters are written when the program has come to its end, and then
//! whole: their file is never half a file.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use retrace_controller::refusal::Refusal;
use retrace_gcode::{Canon, Parameters, Step};

use crate::console::unwritable;

/// Gathers it while a program is decoded.
#[derive(Debug, Default)]
pub struct Left {
    log: Option<BufWriter<File>>,
    parameters: Arc<Mutex<Option<Parameters>>>,
}

/// The parameters of a program that has come to its end.
#[derive(Debug)]
pub struct Last(Arc<Mutex<Option<Parameters>>>);

impl Left {
    /// Where the parameters will be found.
    #[must_use]
    pub fn last(&self) -> Last {
        Last(Arc::clone(&self.parameters))
    }

    /// Writes what a block logs (LOGOPEN, LOGAPPEND, LOG, LOGCLOSE).
    pub fn take(&mut self, steps: &[Step]) {
        for step in steps {
            let done = match &step.canon {
                Canon::LogOpen { file, append } => self.open(file, *append),
                Canon::Log(text) => match &mut self.log {
                    Some(log) => writeln!(log, "{text}"),
                    None => Ok(()),
                },
                Canon::LogClose => self.log.take().map_or(Ok(()), |mut log| log.flush()),
                _ => continue,
            };
            if let Err(error) = done {
                eprintln!("note: line {}: the log cannot be written: {error}", step.line);
            }
        }
    }

    fn open(&mut self, file: &str, append: bool) -> std::io::Result<()> {
        let file = File::options().create(true).write(true).append(append).truncate(!append).open(file.trim())?;
        self.log = Some(BufWriter::new(file));
        Ok(())
    }

    /// Notes the parameters at the program's end.
    pub fn end(&mut self, parameters: &Parameters) {
        let mut last = self.parameters.lock().unwrap_or_else(PoisonError::into_inner);
        *last = Some(parameters.clone());
    }
}

impl Last {
    /// Writes the parameters to their file, if the program has come to its end.
    ///
    /// # Errors
    /// The file cannot be written; the old one is then still there.
    pub fn write(&self, path: &Path) -> Result<(), Refusal> {
        let last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        last.as_ref().map_or(Ok(()), |parameters| write_parameters(parameters, path))
    }
}

/// Writes a parameter file whole.
///
/// # Errors
/// The file cannot be written; the old one is then still there.
pub fn write_parameters(parameters: &Parameters, path: &Path) -> Result<(), Refusal> {
    {
        let mut beside = path.as_os_str().to_owned();
        beside.push(".new");
        let written = std::fs::write(&beside, parameters.write()).and_then(|()| std::fs::rename(&beside, path));
        written.map_err(|error| unwritable(&path.display().to_string(), &error))
    }
}
