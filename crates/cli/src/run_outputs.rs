//! Outputs of a run: its log lines, and the parameters and tools at the end of the program.
//!
//! Invariant: only a run writes anything, never a check. Only a program that completes leaves parameters and tools.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::sync::{Arc, Mutex, PoisonError};

use retrace_gcode::{Canon, CanonStep, Parameters, ToolTable};

/// Collects the outputs while a program is decoded.
#[derive(Debug, Default)]
pub struct RunOutputs {
    log: Option<BufWriter<File>>,
    tables: Arc<Mutex<Option<(Parameters, ToolTable)>>>,
}

/// Parameters and tools of a program that has completed.
#[derive(Debug)]
pub struct LastStatus(Arc<Mutex<Option<(Parameters, ToolTable)>>>);

impl RunOutputs {
    /// Handle for the parameters and tools.
    #[must_use]
    pub fn last_status(&self) -> LastStatus {
        LastStatus(Arc::clone(&self.tables))
    }

    /// Writes the log output of a block (LOGOPEN, LOGAPPEND, LOG, LOGCLOSE).
    pub fn write_log(&mut self, steps: &[CanonStep]) {
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

    /// Stores the parameters and tools at the end of the program.
    pub fn end(&mut self, parameters: &Parameters, tools: &ToolTable) {
        let mut last = self.tables.lock().unwrap_or_else(PoisonError::into_inner);
        *last = Some((parameters.clone(), tools.clone()));
    }
}

impl LastStatus {
    /// Parameters and tools; `None` where the program has not completed.
    #[must_use]
    pub fn tables(&self) -> Option<(Parameters, ToolTable)> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}
