//! Material files of QtPlasmaC: read into a material table, and written from one (CUT-23).
//!
//! Invariant: a file that is read and written again is equal but for comments, order and missing optional keys, which
//! are 0. An error names the section and the key.

use std::fmt::Write as _;

use crate::material::{FIGURES, FIRST_TEMPORARY_MATERIAL, FigureKey, MaterialConfig, MaterialUnits};
use crate::material_table::MaterialTable;
use crate::numbered_error::{NumberedError, nearest};

/// Beginning of the name of each section.
const SECTION: &str = "MATERIAL_NUMBER_";

/// One material while its section is read.
struct Section {
    name: String,
    line: usize,
    material: MaterialConfig,
    /// Keys that it has given.
    given: Vec<String>,
}

impl MaterialTable {
    /// Reads a material file of QtPlasmaC, whose lengths are in these units. `name` names the file in messages. The
    /// default is the first material of the file.
    ///
    /// # Errors
    /// `E2118`, with line, section and key: an unknown section or key, a key or a section twice, a value that is not a
    /// number or out of range, a missing key.
    pub fn of_qtplasmac(text: &str, units: MaterialUnits, name: &str) -> Result<Self, NumberedError> {
        let refused =
            |(cause, remedy): (String, String)| NumberedError::new("E2118", format!("{name}: {cause}"), remedy);
        let mut materials = Vec::new();
        let mut open: Option<Section> = None;
        for (index, line) in text.lines().enumerate() {
            let line_number = index + 1;
            let at = |(cause, remedy): (String, String)| refused((format!("line {line_number}: {cause}"), remedy));
            let line = line.trim().trim_start_matches('\u{feff}');
            if line.is_empty() || line.starts_with(['#', ';']) {
                continue;
            }
            if let Some(heading) = line.strip_prefix('[') {
                materials.extend(open.take().map(|section| section.finish()).transpose().map_err(refused)?);
                open = Some(Section::begin(heading, line_number).map_err(at)?);
                continue;
            }
            match &mut open {
                Some(section) => section.read(line, units).map_err(at)?,
                None => {
                    let cause = format!("`{line}` before the first section");
                    return Err(at((cause, format!("begin each material with [{SECTION}1]"))));
                }
            }
        }
        materials.extend(open.map(|section| section.finish()).transpose().map_err(refused)?);
        Self::new(units, None, materials)
            .map_err(|cause| refused((cause, format!("each section [{SECTION}1] has a number of its own"))))
    }

    /// Text of a material file of QtPlasmaC in these units.
    #[must_use]
    pub fn to_qtplasmac(&self, units: MaterialUnits) -> String {
        let mut text = format!("# material file of QtPlasmaC, lengths in {}, written by retrace\n", units.name());
        for material in self.materials() {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "\n[{SECTION}{}]\nNAME = {}", material.number, material.name);
            for (figure, key) in FIGURES.iter().filter_map(|figure| Some((figure, figure.qtplasmac?))) {
                let _ = writeln!(text, "{key} = {}", figure.file_value(material, units));
            }
        }
        text
    }
}

impl Section {
    fn begin(heading: &str, line: usize) -> Result<Self, (String, String)> {
        let name = heading.trim_end_matches(']').trim().to_owned();
        let is_closed = heading.ends_with(']');
        let number = name.strip_prefix(SECTION).and_then(|digits| digits.parse::<u32>().ok());
        match number.filter(|number| is_closed && *number < FIRST_TEMPORARY_MATERIAL) {
            Some(number) => {
                let material = MaterialConfig { height_control: false, ..MaterialConfig::empty(number) };
                Ok(Self { name, line, material, given: Vec::new() })
            }
            None => Err((format!("section [{heading}"), format!("[{SECTION}n] with n from 0 to 999999"))),
        }
    }

    fn read(&mut self, line: &str, units: MaterialUnits) -> Result<(), (String, String)> {
        let of = |what: String| format!("section [{}]: {what}", self.name);
        let Some((key, value)) = line.split_once('=') else {
            return Err((of(format!("`{line}`")), "write KEY = value, or begin a comment with #".into()));
        };
        let (key, value) = (key.trim(), value.trim());
        if self.given.iter().any(|given| given == key) {
            return Err((of(format!("{key} is there twice")), "remove one of them".into()));
        }
        self.given.push(key.to_owned());
        if key == "NAME" {
            if value.chars().any(char::is_control) {
                return Err((of("NAME has control characters".into()), "remove them".into()));
            }
            value.clone_into(&mut self.material.name);
            return Ok(());
        }
        let Some(figure) = FIGURES.iter().find(|figure| figure.qtplasmac == Some(key)) else {
            return Err((of(format!("unknown key {key}")), unknown_key(key)));
        };
        let refused = |remedy: String| (of(format!("{key} = {value}")), remedy);
        let number = value.parse::<f64>().map_err(|_| refused("a number".into()))?;
        figure.set_file_value(&mut self.material, number, units).map_err(refused)
    }

    fn finish(self) -> Result<MaterialConfig, (String, String)> {
        let is_missing = |figure: &&FigureKey| {
            figure.is_required && figure.qtplasmac.is_some_and(|key| !self.given.iter().any(|given| given == key))
        };
        match FIGURES.iter().find(is_missing).and_then(|figure| figure.qtplasmac) {
            Some(key) => {
                let cause = format!("line {}: section [{}]: {key} is missing", self.line, self.name);
                Err((cause, format!("add {key} = …")))
            }
            None => Ok(self.material),
        }
    }
}

/// Remedy for an unknown key.
fn unknown_key(key: &str) -> String {
    let all = || std::iter::once("NAME").chain(FIGURES.iter().filter_map(|figure| figure.qtplasmac));
    match nearest(key, all()) {
        Some(near) => format!("did you mean {near}?"),
        None => format!("known keys: {}", all().collect::<Vec<_>>().join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    /// A file as QtPlasmaC writes it.
    const FILE: &str = "#plasmac material file\n#example only\n\n[MATERIAL_NUMBER_7]  \n\
        NAME                = 3 mm, air = 45\n\
        KERF_WIDTH          = 1.4\nTHC                 = 1\nPIERCE_HEIGHT       = 3.8\nPIERCE_DELAY        = 0.1\n\
        PUDDLE_JUMP_HEIGHT  = 0\nPUDDLE_JUMP_DELAY   = 0\nCUT_HEIGHT          = 1.5\nCUT_SPEED           = 2500\n\
        CUT_AMPS            = 45\nCUT_VOLTS           = 120\nPAUSE_AT_END        = 0\nGAS_PRESSURE        = 5\n\
        CUT_MODE            = 1\n\n\
        [MATERIAL_NUMBER_2]\nCUT_SPEED=900\nCUT_HEIGHT=1.5\nPIERCE_DELAY=1\nPIERCE_HEIGHT=4\n";

    fn refused(text: &str) -> String {
        let error = MaterialTable::of_qtplasmac(text, MaterialUnits::Millimetre, "m.cfg").expect_err(text);
        format!("{}: {} | {}", error.number, error.cause, error.remedy)
    }

    /// The sections of a file, each with its keys. Reads any file, so it is no part of the reader under test.
    fn sections(text: &str) -> BTreeMap<String, BTreeMap<String, String>> {
        let mut all = BTreeMap::new();
        let mut name = String::new();
        for line in text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#')) {
            if line.starts_with('[') {
                line.clone_into(&mut name);
            } else if let Some((key, value)) = line.split_once('=') {
                let of: &mut BTreeMap<String, String> = all.entry(name.clone()).or_default();
                of.insert(key.trim().to_owned(), value.trim().to_owned());
            }
        }
        all
    }

    #[test]
    fn a_file_of_qtplasmac_is_read_with_its_optional_keys() {
        let table = MaterialTable::of_qtplasmac(FILE, MaterialUnits::Millimetre, "m.cfg").expect("valid");
        assert_eq!((table.default_number(), table.materials().len()), (7, 2));
        let first = table.get(7).expect("there");
        assert_eq!(
            (first.name.as_str(), first.amps, first.height_control, first.cut_mode),
            ("3 mm, air = 45", 45.0, true, 1)
        );
        let second = table.get(2).expect("there");
        assert_eq!((second.name.as_str(), second.amps, second.height_control), ("", 0.0, false));
        let inch = MaterialTable::of_qtplasmac(FILE, MaterialUnits::Inch, "i.cfg");
        // 2 500 inches per minute are possible, 3.8 inches of pierce height, too.
        assert!(inch.is_ok_and(|inch| inch.get(7).is_some_and(|first| first.kerf_mm == 1.4 * 25.4)));
    }

    #[test]
    fn every_damage_is_named_with_section_and_key() {
        for (from, to, found) in [
            (
                "[MATERIAL_NUMBER_7]",
                "[MATERIAL_NUMBER_x]",
                "m.cfg: line 4: section [MATERIAL_NUMBER_x] | [MATERIAL_NUMBER_n]",
            ),
            ("[MATERIAL_NUMBER_7]", "[MATERIAL_NUMBER_7", "line 4: section [MATERIAL_NUMBER_7 |"),
            ("[MATERIAL_NUMBER_7]", "[MATERIAL_NUMBER_2]", "material 2 is there twice"),
            (
                "KERF_WIDTH ",
                "KERF_WIDHT ",
                "line 6: section [MATERIAL_NUMBER_7]: unknown key KERF_WIDHT | did you mean KERF_WIDTH?",
            ),
            ("= 2500", "= fast", "line 13: section [MATERIAL_NUMBER_7]: CUT_SPEED = fast | a number"),
            ("= 2500", "= 0", "[MATERIAL_NUMBER_7]: CUT_SPEED = 0 | a number from 0.1 to 1000000"),
            ("= 2500", "=", "[MATERIAL_NUMBER_7]: CUT_SPEED =  | a number"),
            (
                "PIERCE_DELAY=1\n",
                "",
                "line 20: section [MATERIAL_NUMBER_2]: PIERCE_DELAY is missing | add PIERCE_DELAY",
            ),
            ("CUT_SPEED=900", "CUT_HEIGHT=900", "[MATERIAL_NUMBER_2]: CUT_HEIGHT = 900"),
            ("PIERCE_DELAY=1\n", "CUT_HEIGHT=1\n", "[MATERIAL_NUMBER_2]: CUT_HEIGHT is there twice"),
            ("THC                 = 1", "THC                 = 2", "[MATERIAL_NUMBER_7]: THC = 2"),
            (
                "CUT_MODE            = 1",
                "CUT_MODE            = 1.5",
                "[MATERIAL_NUMBER_7]: CUT_MODE = 1.5 | a whole number from 0 to 3",
            ),
            (
                "KERF_WIDTH          = 1.4",
                "KERF_WIDTH 1.4",
                "section [MATERIAL_NUMBER_7]: `KERF_WIDTH 1.4` | write KEY = value",
            ),
            ("[MATERIAL_NUMBER_7]", "", "line 5: `NAME                = 3 mm, air = 45` before the first section"),
        ] {
            let damaged = FILE.replacen(from, to, 1);
            assert_ne!(damaged, FILE, "{from}");
            assert!(refused(&damaged).contains(found), "{} for {to}", refused(&damaged));
        }
        let empty = refused("# nothing\n");
        assert!(empty.starts_with("E2118") && empty.contains("there is no material"), "{empty}");
    }

    /// Text of a figure with up to `decimals` decimals between 0 and `greatest`.
    fn value(greatest: u32, decimals: u32) -> impl Strategy<Value = String> {
        let scale = 10_u32.pow(decimals);
        (0..=greatest * scale).prop_map(move |units| (f64::from(units) / f64::from(scale)).to_string())
    }

    prop_compose! {
        fn section()(
            name in "[ -~&&[^\\[#;]]{0,20}",
            speed in (1_u32..90_000),
            heights in prop::collection::vec(value(3, 4), 3),
            times in prop::collection::vec(value(60, 3), 3),
            powers in prop::collection::vec(value(200, 2), 3),
            pressure in value(40, 1),
            mode in 0_u32..4,
            thc in 0_u32..2,
            given in prop::collection::vec(any::<bool>(), 10),
        ) -> Vec<(&'static str, String)> {
            let required = [
                ("PIERCE_HEIGHT", heights[0].clone()),
                ("CUT_HEIGHT", heights[1].clone()),
                ("PIERCE_DELAY", times[0].clone()),
                ("CUT_SPEED", (f64::from(speed) / 10.0).to_string()),
                ("NAME", name.trim().to_owned()),
            ];
            let optional = [
                ("KERF_WIDTH", heights[2].clone()),
                ("PUDDLE_JUMP_HEIGHT", powers[0].clone()),
                ("PUDDLE_JUMP_DELAY", times[1].clone()),
                ("CUT_AMPS", powers[1].clone()),
                ("CUT_VOLTS", powers[2].clone()),
                ("PAUSE_AT_END", times[2].clone()),
                ("GAS_PRESSURE", pressure),
                ("CUT_MODE", mode.to_string()),
                ("THC", thc.to_string()),
            ];
            let optional = optional.into_iter().zip(given).filter(|(_, given)| *given).map(|(key, _)| key);
            required.into_iter().chain(optional).collect()
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]
        #[test]
        fn a_file_comes_back_as_it_was(
            sections_of in prop::collection::btree_map(0_u32..1000, section(), 1..8),
            is_inch in any::<bool>(),
        ) {
            let units = if is_inch { MaterialUnits::Inch } else { MaterialUnits::Millimetre };
            let mut text = String::new();
            for (number, keys) in &sections_of {
                text += &format!("[MATERIAL_NUMBER_{number}]\n");
                for (key, value) in keys {
                    text += &format!("{key} = {value}\n");
                }
            }
            let fail = |error: NumberedError| TestCaseError::fail(error.to_string());
            let table = MaterialTable::of_qtplasmac(&text, units, "random").map_err(fail)?;
            // Through the table's own text, as the command writes it.
            let again = MaterialTable::parse(&table.write(), "again").map_err(fail)?;
            prop_assert_eq!(again.units(), units);
            let (was, is) = (sections(&text), sections(&again.to_qtplasmac(units)));
            prop_assert_eq!(was.len(), is.len());
            for (name, keys) in &is {
                for (key, value) in keys {
                    let given = was[name].get(key).cloned().unwrap_or_else(|| "0".into());
                    let number = |text: &str| text.parse::<f64>().ok();
                    let same = given == *value || number(&given).is_some_and(|given| Some(given) == number(value));
                    prop_assert!(same, "{} {}: {} became {}", name, key, given, value);
                }
            }
        }
    }
}
