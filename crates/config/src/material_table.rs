//! The material table: a TOML file of materials, read, checked and written (CUT-22).
//!
//! Invariant: a [`MaterialTable`] has at least one material, each number once, and a default that it contains. The unit
//! of lengths is stated once in a file, and every key of a length ends in it.

use std::fmt::Write as _;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::material::{FIGURES, FIRST_TEMPORARY_MATERIAL, FigureKind, MaterialConfig, MaterialUnits};
use crate::numbered_error::{NumberedError, nearest};

/// Materials of a machine.
#[derive(Clone, Debug, PartialEq)]
pub struct MaterialTable {
    units: MaterialUnits,
    default: u32,
    /// In rising order of their numbers.
    materials: Vec<MaterialConfig>,
}

impl MaterialTable {
    /// Table of these materials; the default is the first one where `default` is `None`.
    ///
    /// # Errors
    /// What is wrong with the list: empty, a number twice, or a default that is not in it.
    pub(crate) fn new(
        units: MaterialUnits,
        default: Option<u32>,
        mut materials: Vec<MaterialConfig>,
    ) -> Result<Self, String> {
        let Some(first) = materials.first().map(|material| material.number) else {
            return Err("there is no material".into());
        };
        let default = default.unwrap_or(first);
        materials.sort_by_key(|material| material.number);
        if let Some(pair) = materials.windows(2).find(|pair| pair[0].number == pair[1].number) {
            return Err(format!("material {} is there twice", pair[0].number));
        }
        if !materials.iter().any(|material| material.number == default) {
            return Err(format!("default = {default}: there is no such material"));
        }
        Ok(Self { units, default, materials })
    }

    /// Parses the text of a material table. `name` names the file in messages.
    ///
    /// # Errors
    /// `E2117`, with the line: not TOML, an unknown or missing key, a figure out of its range, a number twice.
    pub fn parse(text: &str, name: &str) -> Result<Self, NumberedError> {
        read(text).map_err(|fault| {
            let line = text.get(..fault.at).unwrap_or_default().matches('\n').count() + 1;
            NumberedError::new("E2117", format!("{name}: line {line}: {}", fault.cause), fault.remedy)
        })
    }

    /// Text of the table, in its own units; [`MaterialTable::parse`] gives the same table again.
    #[must_use]
    pub fn write(&self) -> String {
        let mut text = format!("units = \"{}\"\ndefault = {}\n", self.units.name(), self.default);
        for material in &self.materials {
            text += &format!("\n{}", material_text(material, self.units));
        }
        text
    }

    /// Unit of lengths in its file.
    #[must_use]
    pub fn units(&self) -> MaterialUnits {
        self.units
    }

    /// Number of the default material.
    #[must_use]
    pub fn default_number(&self) -> u32 {
        self.default
    }

    /// Its materials, in rising order of their numbers.
    #[must_use]
    pub fn materials(&self) -> &[MaterialConfig] {
        &self.materials
    }

    /// The material of this number, if there is one.
    #[must_use]
    pub fn get(&self, number: u32) -> Option<&MaterialConfig> {
        self.materials.iter().find(|material| material.number == number)
    }

    /// Figures of a material with their keys, in the units of the table, for people.
    #[must_use]
    pub fn figures(&self, material: &MaterialConfig) -> Vec<(String, String)> {
        let shown = |figure: &crate::material::FigureKey| match figure.kind {
            FigureKind::Switch => if figure.table_value(material, self.units) != 0.0 { "on" } else { "off" }.to_owned(),
            _ => figure.table_value(material, self.units).to_string(),
        };
        FIGURES.iter().map(|figure| (figure.name(self.units), shown(figure))).collect()
    }
}

/// Text of a material in a table with these units.
pub(crate) fn material_text(material: &MaterialConfig, units: MaterialUnits) -> String {
    let initial = MaterialConfig::empty(0);
    let mut text = format!("[[material]]\nnumber = {}\n", material.number);
    if !material.name.is_empty() {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "name = {}", toml::Value::String(material.name.clone()));
    }
    for figure in &FIGURES {
        let value = figure.table_value(material, units);
        if !figure.is_required && value == figure.table_value(&initial, units) {
            continue;
        }
        let value = match figure.kind {
            FigureKind::Switch => (value != 0.0).to_string(),
            _ => value.to_string(),
        };
        let _ = writeln!(text, "{} = {value}", figure.name(units));
    }
    text
}

/// An error in a table, with its offset.
struct TableFault {
    at: usize,
    cause: String,
    remedy: String,
}

impl TableFault {
    fn new(at: usize, cause: impl Into<String>, remedy: impl Into<String>) -> Box<Self> {
        Box::new(Self { at, cause: cause.into(), remedy: remedy.into() })
    }
}

fn read(text: &str) -> Result<MaterialTable, Box<TableFault>> {
    let table = DeTable::parse(text).map_err(|error| {
        let at = error.span().map_or(0, |span| span.start);
        TableFault::new(at, error.message(), "correct the line; docs/materials.md shows a table")
    })?;
    let table = table.get_ref();
    for key in table.keys() {
        known(key.span().start, key.get_ref(), &["units", "default", "material"])?;
    }
    let units = table.get("units").ok_or_else(|| TableFault::new(0, "`units` is missing", UNITS))?;
    let units = units
        .get_ref()
        .as_str()
        .and_then(MaterialUnits::of_name)
        .ok_or_else(|| TableFault::new(units.span().start, "`units` is neither \"mm\" nor \"inch\"", UNITS))?;
    let default = table.get("default").map(|value| whole(value, "default")).transpose()?;
    let mut materials = Vec::new();
    let mut last_at = 0;
    if let Some(list) = table.get("material") {
        let remedy = "write [[material]] for each of them";
        let items = list
            .get_ref()
            .as_array()
            .ok_or_else(|| TableFault::new(list.span().start, "`material` is no list", remedy))?;
        for item in items.iter() {
            last_at = item.span().start;
            let fields = item.get_ref().as_table();
            let fields = fields.ok_or_else(|| TableFault::new(last_at, "a material is no table", remedy))?;
            materials.push(material(last_at, fields, units)?);
        }
    }
    let at = table.get("default").map_or(last_at, |value| value.span().start);
    MaterialTable::new(units, default, materials)
        .map_err(|cause| TableFault::new(at, cause, "each material needs a number of its own; `default` names one"))
}

/// Remedy for `units`.
const UNITS: &str = "write units = \"mm\" or units = \"inch\" once, at the top";

fn material(at: usize, fields: &DeTable<'_>, units: MaterialUnits) -> Result<MaterialConfig, Box<TableFault>> {
    let keys: Vec<String> = FIGURES.iter().map(|figure| figure.name(units)).collect();
    let all: Vec<&str> = ["number", "name"].into_iter().chain(keys.iter().map(String::as_str)).collect();
    for key in fields.keys() {
        known(key.span().start, key.get_ref(), &all)?;
    }
    let Some(number) = fields.get("number") else {
        return Err(TableFault::new(at, "a material has no `number`", "write number = 1, as in M190 P1"));
    };
    let mut material = MaterialConfig::empty(whole(number, "number")?);
    let of = format!("material {}", material.number);
    if let Some(name) = fields.get("name") {
        let text = name.get_ref().as_str().filter(|text| !text.chars().any(char::is_control));
        let refused =
            || TableFault::new(name.span().start, format!("{of}: `name`"), "a text without control characters");
        material.name = text.ok_or_else(refused)?.to_owned();
    }
    for (figure, key) in FIGURES.iter().zip(&keys) {
        let Some(value) = fields.get(key.as_str()) else {
            if figure.is_required {
                return Err(TableFault::new(at, format!("{of}: `{key}` is missing"), format!("add {key} = …")));
            }
            continue;
        };
        let refused = |remedy: String| {
            let written = written(value.get_ref());
            TableFault::new(value.span().start, format!("{of}: {key} = {written}"), remedy)
        };
        let number = match (figure.kind, value.get_ref().as_bool()) {
            (FigureKind::Switch, Some(on)) => f64::from(u8::from(on)),
            (FigureKind::Switch, None) => return Err(refused("true or false".into())),
            _ => number_of(value.get_ref()).ok_or_else(|| refused("a number".into()))?,
        };
        figure.set_table_value(&mut material, number, units).map_err(refused)?;
    }
    if material.off_before_mm > 0.0 && material.over_cut_mm > 0.0 {
        let unit = units.name();
        let cause = format!("{of}: off_before_{unit} and over_cut_{unit} exclude each other");
        return Err(TableFault::new(at, cause, "one of them: the cutter goes off before the end, or the path goes on"));
    }
    Ok(material)
}

/// Refuses a key that is not in the list, with the nearest one.
fn known(at: usize, key: &str, all: &[&str]) -> Result<(), Box<TableFault>> {
    if all.contains(&key) {
        return Ok(());
    }
    let remedy = match nearest(key, all.iter().copied()) {
        Some(near) => format!("did you mean `{near}`?"),
        None => format!("known keys here: {}", all.join(", ")),
    };
    Err(TableFault::new(at, format!("unknown key `{key}`"), remedy))
}

/// A material's number.
fn whole(value: &Spanned<DeValue<'_>>, key: &str) -> Result<u32, Box<TableFault>> {
    let number = value.get_ref().as_integer().and_then(|number| number.as_str().parse::<u32>().ok());
    number.filter(|number| *number < FIRST_TEMPORARY_MATERIAL).ok_or_else(|| {
        let cause = format!("{key} = {}", written(value.get_ref()));
        let remedy = format!("a whole number from 0 to {}", FIRST_TEMPORARY_MATERIAL - 1);
        TableFault::new(value.span().start, cause, remedy)
    })
}

fn number_of(value: &DeValue<'_>) -> Option<f64> {
    let text = match value {
        DeValue::Integer(number) if number.radix() == 10 => number.as_str(),
        DeValue::Float(number) => number.as_str(),
        _ => return None,
    };
    text.parse().ok()
}

/// A value as text, for messages.
fn written(value: &DeValue<'_>) -> String {
    match value {
        DeValue::Integer(number) => number.as_str().to_owned(),
        DeValue::Float(number) => number.as_str().to_owned(),
        DeValue::String(text) => format!("\"{text}\""),
        other => other.type_str().to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: &str = "units = \"mm\"\ndefault = 2\n\n[[material]]\nnumber = 2\nname = \"Mild steel 3 mm\"\n\
        thickness_mm = 3\nkerf_mm = 1.4\npierce_height_mm = 3.8\npierce_delay_s = 0.1\ncut_height_mm = 1.5\n\
        feed_mm_per_min = 2_500\nheight_control = false\n\n[[material]]\nnumber = 1\npierce_height_mm = 4\n\
        pierce_delay_s = 0.3\ncut_height_mm = 1.5\nfeed_mm_per_min = 1800\n";

    fn refused(text: &str) -> (String, String) {
        let error = MaterialTable::parse(text, "m.toml").expect_err(text);
        (format!("{}: {}", error.number, error.cause), error.remedy)
    }

    #[test]
    fn a_table_is_read_and_written_in_its_own_units() {
        let table = MaterialTable::parse(TABLE, "m.toml").expect("valid");
        assert_eq!((table.default_number(), table.units(), table.materials().len()), (2, MaterialUnits::Millimetre, 2));
        let steel = table.get(2).expect("there");
        assert_eq!((steel.feed_mm_per_min, steel.height_control, steel.thickness_mm), (2500.0, false, 3.0));
        assert!(table.get(1).is_some_and(|other| other.height_control && other.name.is_empty()));
        assert_eq!(MaterialTable::parse(&table.write(), "again").as_ref(), Ok(&table));
        let inch = TABLE.replace("\"mm\"", "\"inch\"").replace("_mm", "_inch").replace("2_500", "98.5");
        let inch = MaterialTable::parse(&inch.replace("1800", "71"), "i.toml").expect("valid");
        let steel = inch.get(2).expect("there");
        assert_eq!((steel.cut_height_mm, steel.feed_mm_per_min), (1.5 * 25.4, 98.5 * 25.4));
        assert_eq!(MaterialTable::parse(&inch.write(), "again").as_ref(), Ok(&inch));
    }

    #[test]
    fn every_damage_is_named_with_its_line_and_a_remedy() {
        for (from, to, cause, remedy) in [
            ("kerf_mm", "kerf_m", "line 8: unknown key `kerf_m`", "did you mean `kerf_mm`?"),
            ("kerf_mm", "kerf_inch", "line 8: unknown key `kerf_inch`", "kerf_mm"),
            ("default = 2", "default = 7", "line 2: default = 7: there is no such material", "default"),
            ("number = 1", "number = 2", "material 2 is there twice", "number of its own"),
            ("number = 1", "number = 1000000", "line 16: number = 1000000", "from 0 to 999999"),
            ("number = 1\n", "", "line 15: a material has no `number`", "number = 1"),
            ("units = \"mm\"\n", "", "line 1: `units` is missing", "units = \"mm\""),
            ("\"mm\"", "\"cm\"", "line 1: `units` is neither", "units = \"inch\""),
            ("pierce_delay_s = 0.1", "pierce_delay_s = -0.1", "line 10: material 2: pierce_delay_s = -0.1", "0 to 60"),
            ("pierce_delay_s = 0.1", "pierce_delay_s = nan", "line 10: material 2: pierce_delay_s = nan", "0 to 60"),
            ("cut_height_mm = 1.5\n", "", "material 2: `cut_height_mm` is missing", "add cut_height_mm"),
            ("= 2_500", "= \"fast\"", "line 12: material 2: feed_mm_per_min = \"fast\"", "a number"),
            ("= false", "= 0", "line 13: material 2: height_control = 0", "true or false"),
            ("height_control = false", "cut_mode = 1.5", "material 2: cut_mode = 1.5", "a whole number from 0 to 3"),
            ("kerf_mm = 1.4", "kerf_mm = ", "line 8", "correct the line"),
            ("name = \"Mild", "name = 3 # ", "line 6: material 2: `name`", "a text"),
            ("defa", "defn", "line 2: unknown key `defnult`", "did you mean `default`?"),
        ] {
            let damaged = TABLE.replacen(from, to, 1);
            assert_ne!(damaged, TABLE);
            let found = refused(&damaged);
            let is_table = found.0.starts_with("E2117");
            assert!(is_table && found.0.contains(cause) && found.1.contains(remedy), "{found:?} for {to}");
        }
        assert!(refused("units = \"mm\"\n").0.contains("there is no material"));
        assert!(refused("units = \"mm\"\nmaterial = 3\n").0.contains("line 2: `material` is no list"));
    }
}
