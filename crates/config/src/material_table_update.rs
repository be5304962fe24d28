//! Materials that a program declares, put into the text of a material table (`--save-materials`).
//!
//! Invariant: comments, order, and every figure that does not change stay as they are written; the text that results
//! has been parsed again and compared.

use toml::de::DeTable;

use crate::material::{FIGURES, FigureKind, MaterialConfig, MaterialUnits};
use crate::material_table::{MaterialTable, material_text};
use crate::numbered_error::NumberedError;

/// A replacement of a range of the text.
struct TextEdit {
    start: usize,
    end: usize,
    text: String,
}

impl MaterialTable {
    /// The text of a material table with these materials added, or with their figures in the place of those of the
    /// material with their number. `name` names the file in messages.
    ///
    /// # Errors
    /// `E2117` for a table with errors; `E2120` where the text cannot be changed without losing something.
    pub fn with_saved(text: &str, saved: &[MaterialConfig], name: &str) -> Result<String, NumberedError> {
        let table = Self::parse(text, name)?;
        let refused = |why: String| {
            let remedy =
                "write each material as a [[material]] table with a key on each line, or change the table by hand";
            NumberedError::new("E2120", format!("{name}: the materials cannot be saved: {why}"), remedy)
        };
        let document = DeTable::parse(text).map_err(|error| refused(error.message().to_owned()))?;
        let mut edits = Vec::new();
        let mut added = String::new();
        for material in saved {
            match (table.get(material.number), fields_of(document.get_ref(), material.number)) {
                (Some(existing), Some(fields)) => {
                    edits.extend(replacements(text, fields, existing, material, table.units()));
                }
                _ => added += &format!("\n{}", material_text(material, table.units())),
            }
        }
        // From the end to the beginning, so that the offsets stay right.
        edits.sort_by_key(|edit| std::cmp::Reverse(edit.start));
        let mut changed = text.to_owned();
        for TextEdit { start, end, text } in edits {
            changed.replace_range(start..end, &text);
        }
        if !added.is_empty() && !changed.ends_with('\n') {
            changed.push('\n');
        }
        changed += &added;
        let result = Self::parse(&changed, name).map_err(|error| refused(error.cause))?;
        table
            .differs_only_in(&result, saved)
            .map_or(Ok(changed), |number| Err(refused(format!("the table has an unusual form at material {number}"))))
    }

    /// Number of the first material that is not as it is to be: as in `saved`, or unchanged.
    fn differs_only_in(&self, result: &Self, saved: &[MaterialConfig]) -> Option<u32> {
        let wanted = |number| saved.iter().find(|material| material.number == number).or_else(|| self.get(number));
        let is_same = |one: &MaterialConfig, other: &MaterialConfig| {
            let value = |of, figure: &crate::material::FigureKey| figure.table_value(of, self.units());
            one.name == other.name && FIGURES.iter().all(|figure| value(one, figure) == value(other, figure))
        };
        let numbers = saved.iter().chain(self.materials()).map(|material| material.number);
        numbers.into_iter().find(|&number| match (wanted(number), result.get(number)) {
            (Some(wanted), Some(found)) => !is_same(wanted, found),
            _ => true,
        })
    }
}

/// The table of the material of this number.
fn fields_of<'d, 't>(document: &'d DeTable<'t>, number: u32) -> Option<&'d DeTable<'t>> {
    let materials = document.get("material")?.get_ref().as_array()?;
    let mut tables = materials.iter().filter_map(|item| item.get_ref().as_table());
    tables.find(|fields| {
        let written = fields.get("number").and_then(|value| value.get_ref().as_integer());
        written.and_then(|written| written.as_str().parse::<u32>().ok()) == Some(number)
    })
}

/// The changes that turn the figures of an existing material into those of another.
fn replacements(
    text: &str,
    fields: &DeTable<'_>,
    existing: &MaterialConfig,
    wanted: &MaterialConfig,
    units: MaterialUnits,
) -> Vec<TextEdit> {
    let mut edits = Vec::new();
    let mut missing = String::new();
    let mut set = |key: &str, value: String| match fields.get(key) {
        Some(old) => edits.push(TextEdit { start: old.span().start, end: old.span().end, text: value }),
        None => missing += &format!("{key} = {value}\n"),
    };
    if existing.name != wanted.name {
        set("name", toml::Value::String(wanted.name.clone()).to_string());
    }
    for figure in &FIGURES {
        let value = figure.table_value(wanted, units);
        if value != figure.table_value(existing, units) {
            let is_switch = figure.kind == FigureKind::Switch;
            set(&figure.name(units), if is_switch { (value != 0.0).to_string() } else { value.to_string() });
        }
    }
    if !missing.is_empty() {
        let last = fields.values().map(|value| value.span().end).max().unwrap_or_default();
        let rest = text.get(last..).unwrap_or_default();
        let (at, is_cut_off) = rest.find('\n').map_or((text.len(), true), |line_end| (last + line_end + 1, false));
        let text = if is_cut_off { format!("\n{missing}") } else { missing };
        edits.push(TextEdit { start: at, end: at, text });
    }
    edits
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: &str = "# my materials\nunits = \"inch\"\ndefault = 2\n\n[[material]]   # thin\nnumber = 2\n\
        name = \"Mild steel\"\nkerf_inch = 0.05 # measured\npierce_height_inch = 0.15\npierce_delay_s = 0.1\n\
        cut_height_inch = 0.06\nfeed_inch_per_min = 1_00\n\n[[material]]\nnumber = 1\npierce_height_inch = 0.2\n\
        pierce_delay_s = 0.3\ncut_height_inch = 0.06\nfeed_inch_per_min = 60 # slow";

    fn material(number: u32) -> MaterialConfig {
        let table = MaterialTable::parse(TABLE, "m.toml").expect("valid");
        let material = table.get(number).or_else(|| table.get(2)).expect("there").clone();
        MaterialConfig { number, ..material }
    }

    #[test]
    fn a_material_is_changed_in_its_place_and_a_new_one_is_added() {
        assert_eq!(MaterialTable::with_saved(TABLE, &[material(2)], "m.toml").as_deref(), Ok(TABLE), "nothing changes");
        let changed = MaterialConfig {
            name: "Steel \"45\"".into(),
            feed_mm_per_min: 80.0 * 25.4,
            kerf_mm: 0.06 * 25.4,
            volts: 110.0,
            height_control: false,
            ..material(2)
        };
        let last = MaterialConfig { amps: 45.0, ..material(1) };
        let new = MaterialConfig { name: "New".into(), ..material(7) };
        let text = MaterialTable::with_saved(TABLE, &[changed, last, new], "m.toml").expect("saved");
        let wanted = TABLE
            .replace("\"Mild steel\"", "'Steel \"45\"'")
            .replace("0.05 #", "0.06 #")
            .replace("1_00\n", "80\nvolts = 110\nheight_control = false\n")
            .replace("60 # slow", "60 # slow\namps = 45\n")
            + "\n[[material]]\nnumber = 7\nname = \"New\"\nkerf_inch = 0.05\npierce_height_inch = 0.15\n\
                pierce_delay_s = 0.1\ncut_height_inch = 0.06\nfeed_inch_per_min = 100\n";
        assert_eq!(text, wanted);
    }

    #[test]
    fn a_table_whose_form_is_unusual_is_refused_and_not_damaged() {
        let inline = "units = \"mm\"\nmaterial = [{ number = 1, pierce_height_mm = 4, pierce_delay_s = 0.1, \
            cut_height_mm = 1.5, feed_mm_per_min = 600 }]\n";
        for saved in [MaterialConfig { volts: 100.0, ..material(1) }, material(7)] {
            let error = MaterialTable::with_saved(inline, &[saved], "m.toml").expect_err("it is refused");
            assert_eq!(error.number, "E2120", "{error}");
        }
        let beyond = MaterialConfig { gas_bar: 60.0, ..material(2) };
        let error = MaterialTable::with_saved(TABLE, &[beyond], "m.toml").expect_err("it is refused");
        assert!(error.number == "E2120" && error.cause.contains("gas_bar"), "{error}");
    }
}
