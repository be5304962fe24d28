//! `retrace materials`: imports, exports, lists and shows material tables (CUT-23).
//!
//! Invariant: a table that is printed or written has been checked as a whole.

use std::fmt::Write as _;
use std::path::Path;

use retrace_config::{MaterialTable, MaterialUnits, NumberedError};

use crate::args::{self, Units};
use crate::files;
use crate::machine::write_or_print;

/// Runs the command.
///
/// # Errors
/// A file cannot be read, has errors, or cannot be written.
pub fn run(args: &args::Materials) -> Result<(), NumberedError> {
    match args {
        args::Materials::Import { file, units, out } => {
            let text = files::text(file, "material file")?;
            let table = MaterialTable::of_qtplasmac(&text, material_units(*units), &file.display().to_string())?;
            write_or_print(&table.write(), out.as_deref())
        }
        args::Materials::Export { table, units, out } => {
            let table = read(table)?;
            let units = units.map_or(table.units(), material_units);
            write_or_print(&table.to_qtplasmac(units), out.as_deref())
        }
        args::Materials::List { table } => {
            crate::out::line(listed(&read(table)?).trim_end());
            Ok(())
        }
        args::Materials::Show { table, number } => {
            let (path, table) = (table, read(table)?);
            let Some(material) = table.get(*number) else {
                let known: Vec<String> = table.materials().iter().map(|known| known.number.to_string()).collect();
                let what = format!("{}: there is no material {number}", path.display());
                return Err(NumberedError::new("E2117", what, format!("the table has {}", known.join(", "))));
            };
            let mut text = format!("number = {}\nname = {}\n", material.number, material.name);
            for (key, value) in table.figures(material) {
                // Writing to a string cannot fail.
                let _ = writeln!(text, "{key} = {value}");
            }
            crate::out::line(text.trim_end());
            Ok(())
        }
    }
}

/// Reads a material table.
fn read(path: &Path) -> Result<MaterialTable, NumberedError> {
    MaterialTable::parse(&files::text(path, "material table")?, &path.display().to_string())
}

const fn material_units(units: Units) -> MaterialUnits {
    match units {
        Units::Mm => MaterialUnits::Millimetre,
        Units::Inch => MaterialUnits::Inch,
    }
}

/// The materials of a table, one a line; `*` marks the default.
fn listed(table: &MaterialTable) -> String {
    let factor = if table.units() == MaterialUnits::Inch { 25.4 } else { 1.0 };
    let unit = table.units().name();
    let mut text = format!("{:>7} {:<32} feed {unit}/min  pierce {unit}  cut {unit}\n", "number", "name");
    for material in table.materials() {
        let mark = if material.number == table.default_number() { '*' } else { ' ' };
        let [feed, pierce, cut] =
            [material.feed_mm_per_min, material.pierce_height_mm, material.cut_height_mm].map(|mm| mm / factor);
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{:>6}{mark} {:<32} {feed:>12.1} {pierce:>10.3} {cut:>8.3}",
            material.number,
            crate::escape::name(&material.name),
        );
    }
    text
}
