//! Outputs of a run: its log lines and probed points, and the parameters and tools at the end of the program.
//!
//! Invariant: only a run writes anything, never a check. Only a program that completes leaves parameters and tools.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::sync::{Arc, Mutex, PoisonError};

use retrace_gcode::{Axis, Canon, CanonStep, Parameters, Pose, ToolTable};

/// Collects the outputs while a program is decoded.
#[derive(Debug, Default)]
pub struct RunOutputs {
    log: Option<BufWriter<File>>,
    probed_points: Option<BufWriter<File>>,
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

    /// Writes the log output of a block (LOGOPEN, LOGAPPEND, LOG, LOGCLOSE), and opens and closes the file of probed
    /// points (PROBEOPEN, PROBECLOSE).
    pub fn write_log(&mut self, steps: &[CanonStep]) {
        for step in steps {
            let done = match &step.canon {
                Canon::LogOpen { file, append } => opened(file, *append).map(|file| self.log = Some(file)),
                Canon::Log(text) => match &mut self.log {
                    Some(log) => writeln!(log, "{text}"),
                    None => Ok(()),
                },
                Canon::LogClose => self.log.take().map_or(Ok(()), |mut log| log.flush()),
                Canon::Comment(text) => self.apply_comment(text),
                _ => continue,
            };
            if let Err(error) = done {
                eprintln!("note: line {}: the file cannot be written: {error}", step.line);
            }
        }
    }

    /// Opens or closes the file of probed points.
    fn apply_comment(&mut self, text: &str) -> std::io::Result<()> {
        let (word, file) = text.split_once([' ', ',']).unwrap_or((text, ""));
        if word.eq_ignore_ascii_case("PROBEOPEN") {
            self.probed_points = Some(opened(file, false)?);
        } else if text.trim_end().eq_ignore_ascii_case("PROBECLOSE") {
            return self.probed_points.take().map_or(Ok(()), |mut points| points.flush());
        }
        Ok(())
    }

    /// Writes a touch: nine coordinates, in the coordinates and units of its block.
    pub fn write_probed_point(&mut self, touch: &Pose) {
        let Some(points) = &mut self.probed_points else { return };
        let numbers = Axis::ALL.map(|axis| format!("{:.6}", touch[axis]));
        if let Err(error) = writeln!(points, "{}", numbers.join(" ")).and_then(|()| points.flush()) {
            eprintln!("note: a probed point cannot be written: {error}");
        }
    }

    /// Stores the parameters and tools at the end of the program.
    pub fn end(&mut self, parameters: &Parameters, tools: &ToolTable) {
        let mut last = self.tables.lock().unwrap_or_else(PoisonError::into_inner);
        *last = Some((parameters.clone(), tools.clone()));
    }
}

fn opened(file: &str, append: bool) -> std::io::Result<BufWriter<File>> {
    let file = File::options().create(true).write(true).append(append).truncate(!append).open(file.trim())?;
    Ok(BufWriter::new(file))
}

impl LastStatus {
    /// Parameters and tools; `None` where the program has not completed.
    #[must_use]
    pub fn tables(&self) -> Option<(Parameters, ToolTable)> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}
