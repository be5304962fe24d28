//! The part of a LinuxCNC machine configuration (INI file) that the interpreter uses.
//!
//! Invariant: an entry that changes the interpreter and is not supported is refused by name. Entries for other parts of
//! a machine are ignored.

use crate::diag::{Diagnostic, Span};
use crate::error_codes::ErrorCode;

/// Entries of an INI file for the interpreter.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ini {
    /// Numbers that a program may read as `#<_ini[section]name>`, under that name in lower case. Only sections and
    /// names without lower-case letters are readable, as in LinuxCNC.
    pub values: Vec<(String, f64)>,
    /// `SUBROUTINE_PATH`: folders that are searched for files of subprograms, in order.
    pub subroutine_path: Vec<String>,
    /// Entries that a machine uses and LinuxCNC's stand-alone interpreter does not, as written.
    pub ignored: Vec<String>,
    /// Entries of the section RS274NGC that have no effect here, as written.
    pub without_effect: Vec<String>,
    /// `ORIENT_OFFSET`: angle added to the R word of M19, in degrees.
    pub orient_offset_degrees: f64,
    /// `DISABLE_G92_PERSISTENCE`: whether the offset of G92 is zero at the start.
    pub disable_g92_persistence: bool,
    /// `DISABLE_FANUC_STYLE_SUB`: whether M98, M99 and an O number alone are refused.
    pub disable_fanuc_subs: bool,
}

/// Bits of `FEATURES` that change how a program reads and are not supported, with their names.
const REFUSED_FEATURES: [(u32, &str); 3] = [(1, "RETAIN_G43"), (16, "NO_DOWNCASE_OWORD"), (32, "OWORD_WARNONLY")];

/// Bits of `FEATURES` that LinuxCNC 2.9 defines.
const KNOWN_FEATURES: u32 = 63;

/// Entries that only a whole machine uses.
const OF_MACHINES: [&str; 4] = ["PARAMETER_FILE", "RS274NGC_STARTUP_CODE", "STARTUP_CODE", "TOOL_TABLE"];

impl Ini {
    /// Parses the text of an INI file.
    ///
    /// # Errors
    /// E1730 for each line that is not valid in an INI file, E1731 for each entry that is not supported.
    pub fn read(text: &str) -> Result<Ini, Vec<Diagnostic>> {
        let (mut ini, mut diagnostics) = (Ini::default(), Vec::new());
        let mut section = "";
        for (index, line) in text.lines().enumerate() {
            let content = line.trim();
            let complain = |code: ErrorCode, message: String| Diagnostic {
                file: 0,
                code,
                line: index as u32 + 1,
                span: Span::new(0, line.len()),
                message,
            };
            if content.is_empty() || content.starts_with(['#', ';']) {
                continue;
            }
            if let Some(name) = content.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
                section = name.0.trim();
                continue;
            }
            let Some((name, value)) = content.split_once('=') else {
                diagnostics.push(complain(ErrorCode::IniLine, ErrorCode::IniLine.title().to_owned()));
                continue;
            };
            if let Err(message) = ini.apply_entry(section, name.trim(), value.trim()) {
                diagnostics.push(complain(ErrorCode::IniNotSupported, message));
            }
        }
        if diagnostics.is_empty() { Ok(ini) } else { Err(diagnostics) }
    }

    fn apply_entry(&mut self, section: &str, name: &str, value: &str) -> Result<(), String> {
        if !section.chars().chain(name.chars()).any(char::is_lowercase)
            && let Some(number) = value.parse::<f64>().ok().filter(|number| number.is_finite())
        {
            let key = format!("_ini[{}]{}", section.to_lowercase(), name.to_lowercase());
            // Of several entries of one name, the first counts.
            if self.values.iter().all(|(known, _)| *known != key) {
                self.values.push((key, number));
            }
        }
        match (section, name) {
            ("RS274NGC", "SUBROUTINE_PATH") => self.subroutine_path = value.split(':').map(str::to_owned).collect(),
            ("RS274NGC", "FEATURES") => return check_features(value),
            ("RS274NGC", "REMAP") => return Err(format!("REMAP = {value}: codes are not remapped")),
            ("RS274NGC" | "EMCIO", _) if OF_MACHINES.contains(&name) => self.ignored.push(format!("{name} = {value}")),
            ("RS274NGC", "ORIENT_OFFSET") => self.orient_offset_degrees = number_of(name, value)?,
            ("RS274NGC", "DISABLE_G92_PERSISTENCE") => self.disable_g92_persistence = number_of(name, value)? != 0.0,
            ("RS274NGC", "DISABLE_FANUC_STYLE_SUB") => self.disable_fanuc_subs = number_of(name, value)? != 0.0,
            ("RS274NGC", _) => self.without_effect.push(format!("{name} = {value}")),
            _ => {}
        }
        Ok(())
    }
}

fn number_of(name: &str, value: &str) -> Result<f64, String> {
    let number = value.parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| format!("{name} = {value}: not a number"))
}

fn check_features(value: &str) -> Result<(), String> {
    let digits = value.strip_prefix("0x").map_or_else(|| value.parse().ok(), |hex| u32::from_str_radix(hex, 16).ok());
    let Some(features) = digits else { return Err(format!("FEATURES = {value}: not a number")) };
    if features & !KNOWN_FEATURES != 0 {
        return Err(format!("FEATURES = {value}: {} is not known", features & !KNOWN_FEATURES));
    }
    match REFUSED_FEATURES.iter().find(|(bit, _)| features & bit != 0) {
        Some((bit, name)) => Err(format!("FEATURES = {value}: {name} ({bit}) is not supported")),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_can_be_asked_for_and_the_rest_is_kept_apart() {
        let text = "# c\n[RS274NGC]\nFEATURES = 12\nSUBROUTINE_PATH = a:b\nPARAMETER_FILE = \
            x.var\n[FOO]\nBAR=1.5\nBAR=2\nbaz=3\nTXT=4 mm\n";
        let ini = Ini::read(text).expect("an INI file");
        assert_eq!(ini.values, [("_ini[rs274ngc]features".to_owned(), 12.0), ("_ini[foo]bar".to_owned(), 1.5)]);
        assert_eq!(ini.subroutine_path, ["a", "b"]);
        assert_eq!(ini.ignored, ["PARAMETER_FILE = x.var"]);
    }

    #[test]
    fn keys_of_the_interpreter_are_taken_and_others_are_noted() {
        let text = "[RS274NGC]\nORIENT_OFFSET = 12.5\nDISABLE_G92_PERSISTENCE = \
            1\nDISABLE_FANUC_STYLE_SUB=1\nLOG_LEVEL=9\n[TRAJ]\nX=1\n";
        let ini = Ini::read(text).expect("an INI file");
        assert_eq!(ini.orient_offset_degrees, 12.5);
        assert!(ini.disable_g92_persistence && ini.disable_fanuc_subs);
        assert_eq!(ini.without_effect, ["LOG_LEVEL = 9"]);
        let found = Ini::read("[RS274NGC]\nORIENT_OFFSET = north\n").expect_err("not a number");
        assert_eq!(found[0].message, "ORIENT_OFFSET = north: not a number");
    }

    #[test]
    fn what_is_not_carried_out_is_named() {
        let text = "[RS274NGC]\nFEATURES=64\nFEATURES = 17\nREMAP=M400 python=x\nnothing\nFEATURES=x\n";
        let found = Ini::read(text).expect_err("five bad lines");
        let found: Vec<_> = found.iter().map(|found| (found.line, found.number(), found.message.as_str())).collect();
        assert_eq!(found.len(), 5);
        assert!(found[0] == (2, "E1731", "FEATURES = 64: 64 is not known"), "{found:?}");
        assert!(found[1] == (3, "E1731", "FEATURES = 17: RETAIN_G43 (1) is not supported"), "{found:?}");
        assert_eq!([found[2].1, found[3].1, found[4].1], ["E1731", "E1730", "E1731"]);
    }
}
