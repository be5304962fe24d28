//! Check of a machine file that finds all errors, not only the first one.
//!
//! Invariant: [`MachineConfig::parse`] accepts a file if and only if this check finds no error.

use std::collections::BTreeMap;

use crate::axis::AxisConfig;
use crate::card_config::CardSection;
use crate::cutter::CutterConfig;
use crate::cutter_doubt::doubt_of_kind;
use crate::machine_config::{MachineConfig, output_names};
use crate::machine_file::{MachineFile, WheelSettings};
use crate::manual_config::{HomingSection, ManualConfig, ManualSection, Written};
use crate::numbered_error::NumberedError;
use crate::switching::SwitchingTable;
use crate::{axis, cutter};

/// Maximum number of lines that cannot be parsed and are skipped.
const MAX_MISREAD_LINES: usize = 100;

/// Result of checking a machine file.
#[derive(Clone, Debug)]
pub struct MachineCheck {
    /// Errors that make the file unusable, in the order of the file's tables. Empty for a usable file.
    pub errors: Vec<NumberedError>,
    /// The machine, if there is no error.
    pub machine: Option<MachineConfig>,
}

impl MachineConfig {
    /// Checks the text of a machine file for all errors. `name` names the file in messages.
    #[must_use]
    pub fn check_machine(text: &str, name: &str) -> MachineCheck {
        let mut errors = Vec::new();
        let file = readable_part(text, name, &mut errors);
        let misread = !errors.is_empty();
        if let Some(file) = &file {
            let found = errors_of(file);
            errors.extend(found.into_iter().map(|r| NumberedError { cause: format!("{name}: {}", r.cause), ..r }));
        }
        // Errors that only the whole file shows; a part of a file may lack what the rest of it needs.
        let machine = match file.filter(|_| !misread).map(Self::check) {
            Some(Ok(machine)) if errors.is_empty() => Some(machine),
            Some(Err(refusal)) if errors.is_empty() => {
                errors.push(NumberedError { cause: format!("{name}: {}", refusal.cause), ..refusal });
                None
            }
            _ => None,
        };
        MachineCheck { errors, machine }
    }

    /// Numbers of the inputs that codes and cutters wait for and that no `[[card.input]]` declares, each with the first
    /// that waits for it.
    #[must_use]
    pub fn undeclared_inputs(&self) -> BTreeMap<u8, String> {
        let mut undeclared = BTreeMap::new();
        for cutter in &self.cutters {
            if let Some(proof) = cutter.proof.filter(|proof| !self.card.declares_input(proof.input)) {
                undeclared.entry(proof.input).or_insert_with(|| format!("[[cutter]] {}", cutter.name));
            }
        }
        for (code, switching) in self.switching.defined_codes() {
            if let Some(until) = switching.until.filter(|until| !self.card.declares_input(until.input)) {
                undeclared.entry(until.input).or_insert_with(|| format!("code.{code}"));
            }
        }
        undeclared
    }

    /// The cutters whose kind does not fit the rest of their table, each with the reason: a spindle that is named as a
    /// cutter, or the reverse (CUT-10).
    #[must_use]
    pub fn cutters_of_doubtful_kind(&self) -> Vec<(&CutterConfig, String)> {
        self.cutters.iter().filter_map(|cutter| Some((cutter, doubt_of_kind(cutter)?))).collect()
    }
}

/// The part of a machine file that can be parsed: other lines and tables are reported and skipped. `None` where the
/// syntax is wrong.
fn readable_part(text: &str, name: &str, errors: &mut Vec<NumberedError>) -> Option<MachineFile> {
    let mut rest = text.to_owned();
    for _ in 0..MAX_MISREAD_LINES {
        let error = match toml::from_str(&rest) {
            Ok(file) => return Some(file),
            Err(error) => error,
        };
        let is_syntax = toml::from_str::<toml::Table>(&rest).is_err();
        if is_syntax && !errors.is_empty() {
            // More than a line was skipped: the errors before it have to be corrected first.
            return None;
        }
        errors.push(crate::machine_file::misread_in_a_line(&error, &rest, name));
        let at = error.span().map(|span| span.start).filter(|&at| !is_syntax && at < rest.len());
        rest = without_the_entry_at(&rest, at?)?;
    }
    None
}

/// The text with the line at this offset blank, or with the whole table blank where the line is its heading. `None`
/// where the line is blank already.
fn without_the_entry_at(text: &str, at: usize) -> Option<String> {
    let (mut kept, mut begins, mut in_table) = (String::with_capacity(text.len()), 0, false);
    let mut has_changed = false;
    for line in text.split_inclusive('\n') {
        let is_here = (begins..begins + line.len()).contains(&at);
        let is_heading = line.trim_start().starts_with('[');
        in_table = is_heading && is_here || in_table && !is_heading;
        if is_here || in_table {
            has_changed |= !line.trim().is_empty();
            kept.extend(line.chars().map(|c| if c == '\n' { "\n" } else { " " }.repeat(c.len_utf8())));
        } else {
            kept += line;
        }
        begins += line.len();
    }
    has_changed.then_some(kept)
}

/// The errors of each part of a file separately.
fn errors_of(file: &MachineFile) -> Vec<NumberedError> {
    let mut errors = Vec::new();
    errors.extend(file.ranges().into_iter().filter_map(Result::err));
    errors.extend(file.blending.checked().err());
    let mut axes: Vec<AxisConfig> = file.axis.clone();
    axes.iter_mut().for_each(|axis| axis.name = axis.name.to_ascii_lowercase());
    let whole = errors.len();
    for axis in &axes {
        errors.extend(alone(file, axis).err());
        errors.extend(axis.homing().err());
    }
    if errors.len() == whole {
        errors.extend(axis::checked(axes.clone()).err());
    }
    let cutters_begin = errors.len();
    errors.extend(file.cutter.iter().filter_map(|one| cutter::checked(vec![one.clone()], &[]).err()));
    let cutters = match cutter::checked(file.cutter.clone(), &file.cutting_outputs) {
        Ok(cutters) => cutters,
        Err(refusal) => {
            if errors.len() == cutters_begin {
                errors.push(refusal);
            }
            Vec::new()
        }
    };
    if errors.len() == cutters_begin {
        errors.extend(file.cost.as_ref().and_then(|cost| cost.check(&cutters).err()));
    }
    errors.extend(cutter::no_code_starts_a_cutter(&file.cutter, file.code.keys()).err());
    let outputs_begin = errors.len();
    errors.extend(file.output.iter().filter_map(|one| output_names(vec![one.clone()], &cutters).err()));
    if errors.len() == outputs_begin {
        errors.extend(output_names(file.output.clone(), &cutters).err());
    }
    errors.extend(set_up_errors(file, &axes, &cutter::off_at_fault(&cutters, file.spindle.orient_output)));
    errors.extend(file.serial.clone().checked().err());
    let period_us = (file.control_period_ms.clamp(0.1, 20.0) * 1000.0).round() as u32;
    for (code, settings) in &file.code {
        errors.extend(SwitchingTable::new(&BTreeMap::from([(code.clone(), *settings)]), period_us).err());
    }
    errors
}

/// A machine with this axis only, without a home switch: checks its values, and its limits with the control period.
fn alone(file: &MachineFile, axis: &AxisConfig) -> Result<MachineConfig, NumberedError> {
    let within =
        |value: f64, least: f64, greatest: f64| if value.is_nan() { least } else { value.clamp(least, greatest) };
    axis::checked(vec![axis.clone()])?;
    let period_ms = within(file.control_period_ms, 0.1, 20.0);
    let usual = WheelSettings::default();
    let filter_ms = usual.filter_ms.clamp(period_ms, 500.0 * period_ms);
    let checked = MachineConfig::check(MachineFile {
        wheel: WheelSettings { filter_ms, ..usual },
        control_period_ms: period_ms,
        path_velocity_mm_per_s: within(file.path_velocity_mm_per_s, 0.001, 100_000.0),
        override_reserve_percent: within(file.override_reserve_percent, 1.0, 50.0),
        axis: vec![axis.without_home()],
        ..MachineFile::default()
    });
    checked.map_err(|refusal| NumberedError { cause: format!("axis {}: {}", axis.name, refusal.cause), ..refusal })
}

/// The errors of `[card]`, `[homing]`, the homes of the axes, the tool axis and the retract plane.
fn set_up_errors(file: &MachineFile, axes: &[AxisConfig], cutting: &[u8]) -> Vec<NumberedError> {
    let period_ms = file.control_period_ms.clamp(0.1, 20.0);
    let mut errors: Vec<NumberedError> =
        file.card.parts().into_iter().filter_map(|part| part.checked(axes, cutting, period_ms).err()).collect();
    let checked = file.card.clone().checked(axes, cutting, period_ms);
    let is_sound = checked.is_ok();
    let card = checked.or_else(|refusal| {
        if errors.is_empty() {
            errors.push(refusal);
        }
        // Settings that do not depend on the switches are checked nevertheless.
        CardSection::default().checked(axes, cutting, period_ms)
    });
    let Ok(card) = card else { return errors };
    let nothing = || Written {
        homing: HomingSection::default(),
        manual: ManualSection::default(),
        homed: Some(true),
        tool_axis: None,
        retract_mm: None,
    };
    let without_homes: Vec<AxisConfig> = axes.iter().map(AxisConfig::without_home).collect();
    let begin = errors.len();
    for (index, axis) in axes.iter().enumerate() {
        let mut one_home = without_homes.clone();
        one_home[index] = axis.clone();
        let is_told = !is_sound || axis.homing().is_err();
        errors.extend(ManualConfig::checked(nothing(), &one_home, &card).err().filter(|_| !is_told));
    }
    let tool = Written { tool_axis: file.tool_axis, retract_mm: file.retract_mm, ..nothing() };
    errors.extend(ManualConfig::checked(tool, &without_homes, &card).err());
    if is_sound && errors.len() == begin && axes.iter().all(|axis| axis.homing().is_ok()) {
        let order = Written { homing: file.homing.clone(), homed: file.homed, ..nothing() };
        errors.extend(ManualConfig::checked(order, axes, &card).err());
    }
    errors
}

#[cfg(test)]
mod tests {
    use super::*;

    fn errors(text: &str) -> Vec<String> {
        let found = MachineConfig::check_machine(text, "m.toml");
        assert_eq!(found.errors.is_empty(), found.machine.is_some());
        assert_eq!(found.machine.is_some(), MachineConfig::parse(text, "m.toml").is_ok(), "{text}");
        found.errors.iter().map(|error| format!("{} {}", error.number, error.cause)).collect()
    }

    #[test]
    fn every_wrong_figure_of_a_file_has_an_error_of_its_own() {
        let text = "control_period_ms = 0\nhistory_hours = 99\nretract_mm = 9999\n\
            [card]\nwatchdog_ms = 1\ninverted_axes = [\"a\", \"b\"]\n[[card.input]]\nnumber = 16\nuse = \"door\"\n\
            [[card.input]]\nnumber = 1\nuse = \"home\"\n[code.M3]\nduration_ms = -1\n[code.M6]\nclass = \
            \"synchronous\"\n\
            [[cutter]]\nname = \"\"\nkind = \"torch\"\nfire = 1\n[[cutter]]\nname = \"jet\"\nkind = \"jet\"\nfire = \
            99\n\
            [[output]]\nnumber = 70\nname = \"fan\"\n[[output]]\nnumber = 7\nname = \"\"\n";
        let found = errors(text);
        for part in [
            "control_period_ms = 0",
            "history_hours = 99",
            "retract_mm",
            "card.watchdog_ms",
            "axis `a`",
            "axis `b`",
            "no input 16",
            "card.input 1",
            "code.M3",
            "M6",
            "[[cutter]] :",
            "fire = 99",
            "[[output]] 70",
            "[[output]] 7:",
        ] {
            assert_eq!(found.iter().filter(|one| one.contains(part)).count(), 1, "{part} in {found:#?}");
        }
        assert_eq!(found.len(), 14, "{found:#?}");
    }

    #[test]
    fn every_misspelt_key_has_its_own_line_and_the_rest_is_checked_too() {
        let text = "nam = \"mill\"\nhistory_hours = 99\n[crad]\nwatchdog_ms = 3\n[wheel]\nmean_over_m = \
            3\nfull_rate_counts_per_s = \"x\"\n";
        let found = errors(text);
        let parts = [
            "line 1, column 1: unknown field `nam`",
            "line 3, column 2: unknown field `crad`",
            "line 6, column 1: unknown field `mean_over_m`",
            "line 7, column 26: invalid type",
            "history_hours = 99",
        ];
        for part in parts {
            assert_eq!(found.iter().filter(|one| one.contains(part)).count(), 1, "{part} in {found:#?}");
        }
        assert_eq!(found.len(), 5, "{found:#?}");
        assert_eq!(errors("name = \n").len(), 1);
        assert!(errors("").is_empty());
    }

    #[test]
    fn an_error_of_several_parts_together_is_found() {
        let axis = "[[axis]]\nname = \"x\"\npulses_per_mm = 100\nmax_velocity_mm_per_s = \
            1e3\nmax_acceleration_mm_per_s2 = 1e4\n\
            max_jerk_mm_per_s3 = 1e6\ntravel_mm = [0, 1]\n";
        assert_eq!(errors(&axis.repeat(2)).len(), 1);
        let home = "home = { switch = \"lower\" }\n";
        let two = format!("{axis}{home}{}{home}", axis.replace("\"x\"", "\"y\""));
        let found = errors(&two);
        assert!(found.len() == 2 && found[0].contains("axis x: there is a `home`"), "{found:#?}");
        let found = errors(&(axis.to_owned() + "[homing]\norder = [\"x\"]\n"));
        assert!(found.len() == 1 && found[0].contains("homing.order"), "{found:#?}");
        let input = "[[card.input]]\nnumber = 3\nuse = \"plain\"\n";
        let found = errors(&input.repeat(2));
        assert!(found.len() == 1 && found[0].contains("card.input 3: declared twice"), "{found:#?}");
    }

    #[test]
    fn an_input_that_is_waited_for_and_not_declared_is_named_with_its_code() {
        let text = "[code.M3]\nwaits_for = { input = 5 }\n[code.M4]\nwaits_for = { input = 5 }\n[code.M8]\nwaits_for \
            = { input = 6 }\n\
            [[card.input]]\nnumber = 6\nuse = \"plain\"\n";
        let machine = MachineConfig::parse(text, "m.toml").expect("valid");
        assert_eq!(machine.undeclared_inputs(), BTreeMap::from([(5, "code.M3".to_owned())]));
    }
}
