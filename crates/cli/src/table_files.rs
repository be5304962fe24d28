//! Tool tables and parameter files, read with their errors.
//!
//! Invariant: a file with errors is refused as a whole.

use std::path::Path;

use retrace_config::NumberedError;
use retrace_gcode::{Diagnostic, Pose, Tool, ToolTable};

use crate::files;

/// Reads a table. The error has its first five diagnostics.
pub fn table<T>(path: &Path, what: &str, read: fn(&str) -> Result<T, Vec<Diagnostic>>) -> Result<T, NumberedError> {
    let text = files::text(path, what)?;
    read(&text).map_err(|faults| {
        let lines: Vec<&str> = text.lines().collect();
        let shown: Vec<String> = faults
            .iter()
            .take(5)
            .map(|f| f.render(&path.display().to_string(), lines.get(f.line.saturating_sub(1) as usize).unwrap_or(&"")))
            .collect();
        NumberedError::new(
            "E2106",
            format!("the {what} {} has errors\n{}", path.display(), shown.join("\n")),
            "correct the file",
        )
    })
}

/// Tool table for a machine without one: every tool exists and has length 0.
pub fn tools_without_length() -> ToolTable {
    let mut tools = ToolTable::default();
    for number in 1..=999 {
        tools.insert(Tool { number, offset: Pose::ZERO, ..Tool::default() });
    }
    tools
}
