//! `--save-materials`: writes the materials that a program declares with `(o=1, …)` and `(o=2, …)` into the material
//! table of the machine (CUT-24).
//!
//! Invariant: nothing is written without that option, and nothing for a program with errors; the table is replaced
//! whole or not at all.

use std::path::Path;

use retrace_config::{MachineConfig, MaterialConfig, MaterialTable, NumberedError};
use retrace_controller::material_config;
use retrace_journal::state_file::{self, FileAccess};

use crate::files;
use crate::program::Program;

/// Checks that the materials of the program can be saved, before anything moves.
///
/// # Errors
/// `E2120`
pub fn check(program: &Program, machine: &MachineConfig) -> Result<(), NumberedError> {
    changed_table(program, machine).map(|_| ())
}

/// Writes the materials that the program declares into the table.
///
/// # Errors
/// `E2120`, or `E2105` where the file cannot be written; the old file is still there then.
pub fn save(program: &Program, machine: &MachineConfig) -> Result<(), NumberedError> {
    let Some(ChangedTable { path, text, numbers }) = changed_table(program, machine)? else {
        eprintln!("note: --save-materials: the table has every material that the program declares");
        return Ok(());
    };
    state_file::replace(Path::new(&path), text.as_bytes(), FileAccess::Usual)
        .map_err(|error| files::unwritable(&format!("the material table {path}"), &error))?;
    let numbers: Vec<String> = numbers.iter().map(ToString::to_string).collect();
    eprintln!("note: saved in {path}: material {}", numbers.join(", "));
    Ok(())
}

/// A material table with the materials of a program.
struct ChangedTable {
    path: String,
    text: String,
    /// Numbers of the materials that are saved.
    numbers: Vec<u32>,
}

/// The table with the materials that the program declares; `None` where it has them already.
fn changed_table(program: &Program, machine: &MachineConfig) -> Result<Option<ChangedTable>, NumberedError> {
    let refused = |what: &str, remedy: &str| NumberedError::new("E2120", format!("--save-materials: {what}"), remedy);
    let Some(table) = &machine.materials else {
        let remedy = "name one with materials = \"materials.toml\" in its [[cutter]] table";
        return Err(refused("no cutter of the machine has a material table", remedy));
    };
    let Some(declared) = program.declared_materials() else {
        return Err(refused("a stream is not known before it runs", "name a file"));
    };
    let materials: Vec<MaterialConfig> = declared.iter().map(|material| material_config(material)).collect();
    if materials.is_empty() {
        return Ok(None);
    }
    let path = table.path.clone();
    let old = files::text(Path::new(&path), "material table")?;
    let text = MaterialTable::with_saved(&old, &materials, &path)?;
    let numbers = materials.iter().map(|material| material.number).collect();
    Ok((text != old).then_some(ChangedTable { path, text, numbers }))
}
