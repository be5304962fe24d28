//! Comments that declare a material: `(o=0, na=name, ph=…, pd=…, ch=…, fr=…)`, as QtPlasmaC reads them (CUT-24).
//!
//! Invariant: every item of such a comment has a meaning, and its figures are in their ranges; a comment that does not
//! begin with `o=` and a digit is a plain one.

use crate::canon_modes::LengthUnit;
use crate::diag::{BlockResult, Span, fault};
use crate::error_codes::ErrorCode;
use crate::material::{FIRST_TEMPORARY_MATERIAL, Material};
use crate::nearest::nearest;
use std::sync::Arc;

/// What becomes of the declared material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Declaration {
    /// o=0: a temporary material, selected at once.
    Temporary,
    /// o=1: added under its number.
    Add,
    /// o=2: added, or put in the place of that with its number.
    Overwrite,
}

/// A material comment, compiled. Its lengths are in the units that are in force when it is executed.
#[derive(Clone, Debug)]
pub(crate) struct MaterialComment {
    pub(crate) text: Arc<str>,
    pub(crate) at: Span,
    pub(crate) declaration: Declaration,
    number: Option<u32>,
    name: Option<String>,
    values: [Option<f64>; ITEMS.len()],
}

/// An item with a figure: its key, whether it is a length or a speed, its range in mm, and its field.
struct Item {
    key: &'static str,
    is_length: bool,
    range: [f64; 2],
    set: fn(&mut Material, f64),
}

const fn item(key: &'static str, is_length: bool, range: [f64; 2], set: fn(&mut Material, f64)) -> Item {
    Item { key, is_length, range, set }
}

/// The items with figures. The first four must be there, except while a tube is cut, which needs `pd` alone.
const ITEMS: [Item; 14] = [
    item("pd", false, [0.0, 60.0], |material, value| material.pierce_delay_s = value),
    item("ph", true, [0.0, 200.0], |material, value| material.pierce_height_mm = value),
    item("ch", true, [0.0, 200.0], |material, value| material.cut_height_mm = value),
    item("fr", true, [0.1, 1_000_000.0], |material, value| material.feed_mm_per_min = value),
    item("mt", true, [0.0, 500.0], |material, value| material.thickness_mm = value),
    item("kw", true, [0.0, 100.0], |material, value| material.kerf_mm = value),
    item("jh", false, [0.0, 200.0], |material, value| material.puddle_percent = value),
    item("jd", false, [0.0, 60.0], |material, value| material.puddle_s = value),
    item("ca", false, [0.0, 2000.0], |material, value| material.amps = value),
    item("cv", false, [0.0, 500.0], |material, value| material.volts = value),
    item("pe", false, [0.0, 60.0], |material, value| material.pause_at_end_s = value),
    item("gp", false, [0.0, 1000.0], |material, value| material.gas_bar = value),
    item("cm", false, [0.0, 3.0], |material, value| material.cut_mode = value as u8),
    item("th", false, [0.0, 1.0], |material, value| material.height_control = value != 0.0),
];

/// Number of items that must be there.
const REQUIRED: usize = 4;

impl MaterialComment {
    /// Whether the text of a comment declares a material.
    pub(crate) fn declares(text: &str) -> bool {
        declaration_of(text).is_some()
    }

    /// Compiles the text of a comment; `None` for a comment that declares no material.
    ///
    /// # Errors
    /// E1734 for an unknown, repeated, missing or malformed item.
    pub(crate) fn compile(text: &Arc<str>, at: Span) -> BlockResult<Option<MaterialComment>> {
        let Some(declaration) = declaration_of(text) else { return Ok(None) };
        let items = text.split(',').map(|item| item.split_once('=').map(|(key, value)| (key.trim(), value.trim())));
        let declaration = match declaration {
            "0" => Declaration::Temporary,
            "1" => Declaration::Add,
            "2" => Declaration::Overwrite,
            other => return refused(at, format!("o={other} is not known; known are o=0, o=1 and o=2")),
        };
        let text = Arc::clone(text);
        let mut comment =
            MaterialComment { text, at, declaration, number: None, name: None, values: [None; ITEMS.len()] };
        for (item, whole) in items.skip(1).zip(comment.text.clone().split(',').skip(1)) {
            match item {
                Some((key, value)) => comment.read(&key.to_ascii_lowercase(), value)?,
                None => return refused(at, format!("`{}` is not an item such as ph=3.8", whole.trim())),
            }
        }
        if comment.number.is_none() && declaration != Declaration::Temporary {
            return refused(at, "nu, the number of the material, is missing".into());
        }
        Ok(Some(comment))
    }

    fn read(&mut self, key: &str, value: &str) -> BlockResult<()> {
        let twice = |at| refused(at, format!("{key} is there twice"));
        match key {
            "na" if self.name.is_some() => return twice(self.at),
            "na" => {
                self.name = Some(value.to_owned());
                return Ok(());
            }
            "nu" if self.number.is_some() => return twice(self.at),
            "nu" => {
                let number = value.parse::<u32>().ok().filter(|number| *number < FIRST_TEMPORARY_MATERIAL);
                self.number = number;
                return match number {
                    Some(_) => Ok(()),
                    None => refused(self.at, format!("nu={value}: a whole number from 0 to 999999")),
                };
            }
            _ => {}
        }
        let Some(index) = ITEMS.iter().position(|item| item.key == key) else {
            let known = || ITEMS.iter().map(|item| item.key).chain(["na", "nu"]);
            let known = match nearest(key, known()) {
                Some(near) => format!("did you mean {near}?"),
                None => format!("known are {}", known().collect::<Vec<_>>().join(", ")),
            };
            return refused(self.at, format!("{key} is not known; {known}"));
        };
        if self.values[index].is_some() {
            return twice(self.at);
        }
        match value.parse::<f64>() {
            Ok(number) if number.is_finite() => self.values[index] = Some(number),
            _ => return refused(self.at, format!("{key}={value}: a number")),
        }
        Ok(())
    }

    /// Returns the material in units of the program. `number` is that of a temporary material.
    ///
    /// # Errors
    /// E1734 for a figure out of its range, or a missing one.
    pub(crate) fn material(&self, temporary: u32, units: LengthUnit, cuts_tube: bool) -> BlockResult<Material> {
        let number = match self.declaration {
            Declaration::Temporary => temporary,
            _ => self.number.unwrap_or_default(),
        };
        let name = self.name.clone().unwrap_or_else(|| match self.declaration {
            Declaration::Temporary => "temporary".to_owned(),
            _ => String::new(),
        });
        let mut material = Material { number, name, height_control: true, ..Material::default() };
        for (index, (item, value)) in ITEMS.iter().zip(&self.values).enumerate() {
            let factor = if item.is_length { units.millimetres() } else { 1.0 };
            let Some(value) = value else {
                if index == 0 || index < REQUIRED && !cuts_tube {
                    return refused(self.at, format!("{} is missing", item.key));
                }
                continue;
            };
            let [least, greatest] = item.range;
            if !(least..=greatest).contains(&(value * factor)) {
                let (least, greatest) = (least / factor, greatest / factor);
                return refused(self.at, format!("{}={value}: a number from {least:.6} to {greatest:.6}", item.key));
            }
            (item.set)(&mut material, value * factor);
        }
        Ok(material)
    }
}

/// The value of the first item, `o=0`, of a comment that declares a material.
fn declaration_of(text: &str) -> Option<&str> {
    let (key, value) = text.split(',').next()?.split_once('=')?;
    let (key, value) = (key.trim(), value.trim());
    let is_declaration = key.eq_ignore_ascii_case("o") && value.bytes().all(|byte| byte.is_ascii_digit());
    is_declaration.then_some(value)
}

fn refused<T>(at: Span, message: String) -> BlockResult<T> {
    fault(ErrorCode::BadMaterialComment, at, message)
}
