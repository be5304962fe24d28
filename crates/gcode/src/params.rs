//! Numbered and named parameters, and the parameter file.
//!
//! Invariant: numbered parameters 1 … 5601 always have a value; a named one has a value from its first assignment.

use crate::cutting::HalValue;
use crate::diag::{BlockResult, Diagnostic, Span, fault};
use crate::error_codes::ErrorCode;
use crate::nearest::nearest;
use crate::system::SystemParameter;
use crate::unknown::{UNKNOWN, join, unknown_existence};
use std::collections::HashMap;
use std::fmt::Write as _;

/// Parameter that a reference names.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Reference {
    /// The number is calculated by the operations that have been added.
    Numbered,
    Named(NameId),
    System(SystemParameter),
}

/// Highest numbered parameter.
const LAST: usize = 5601;

/// First parameter of the position of the last probe contact; program units and degrees, X Y Z A B C U V W.
pub(crate) const PROBE_POSITION: usize = 5061;
/// 1 if the probe has made contact, otherwise 0.
pub(crate) const PROBE_TRIPPED: usize = 5070;
/// First parameter of the position that G28 goes to; machine units and degrees, X Y Z A B C U V W.
pub(crate) const G28_HOME: usize = 5161;
/// First parameter of the position that G30 goes to.
pub(crate) const G30_HOME: usize = 5181;
/// 1 while an offset of G52 or G92 is in force.
pub(crate) const G92_ACTIVE: usize = 5210;
/// First parameter of the offset of G52 and G92.
pub(crate) const G92_OFFSET: usize = 5211;
/// Number of the coordinate system in force, 1 … 9.
pub(crate) const COORDINATE_SYSTEM: usize = 5220;
/// Result of the last M66.
pub(crate) const INPUT: usize = 5399;
/// Comments with DEBUG are shown while this is above 0.
pub(crate) const SHOW_DEBUG: usize = 5599;

/// Returns the first parameter of a coordinate system's origin. Its rotation is 9 higher.
pub(crate) const fn system_origin(system: u8) -> usize {
    5201 + 20 * system as usize
}

/// Parameters that a parameter file stores; both ends of each range are included.
const PERSISTENT: [(usize, usize); 6] =
    [(31, 5000), (5161, 5169), (5181, 5189), (5210, 5219), (5220, 5230), (5241, 5390)];

/// Local numbered parameters of a call: its arguments, and the variables of a subprogram.
const LOCAL: std::ops::RangeInclusive<usize> = 1..=30;

/// Index of a parameter's name in [`Names`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct NameId {
    index: u32,
    /// Whether the name begins with an underscore and is global to all subprograms.
    is_global: bool,
}

/// All parameter names that a program has used, in lower case and without blanks.
#[derive(Clone, Debug, Default)]
pub(crate) struct Names {
    numbers: HashMap<Box<str>, NameId>,
    texts: Vec<Box<str>>,
    /// Names with fixed values.
    fixed: HashMap<Box<str>, f64>,
    /// Whether `_hal[…]` names are values of the plasma controller: the machine has a material table.
    has_hal: bool,
    /// Buffer for the name being looked up, retained to avoid allocation.
    plain: String,
    /// Cache of the last names as written; empty before the first.
    recent: Vec<Option<RecentParameters>>,
}

/// A name as written, and its parameter.
#[derive(Clone, Copy, Debug)]
struct RecentParameters {
    text: [u8; MAX_RECENT],
    length: u8,
    is: Reference,
}

/// Maximum length in bytes of a cached name.
const MAX_RECENT: usize = 24;

/// Number of cache entries.
const RECENT: usize = 64;

/// Returns the cache entry of a name as written.
fn place_of(text: &[u8]) -> usize {
    let mixed = text.iter().fold(text.len(), |mixed, &byte| mixed.wrapping_mul(31).wrapping_add(byte.into()));
    (mixed ^ (mixed >> 6)) % RECENT
}

/// Maximum number of names: a streamed program could create names without end.
const MAX_NAMES: usize = 50_000;

impl Names {
    /// Adds names with fixed values, in lower case.
    pub(crate) fn with_fixed(self, values: &[(String, f64)]) -> Names {
        let fixed = values.iter().map(|(name, value)| (name.as_str().into(), *value)).collect();
        Names { fixed, recent: Vec::new(), ..self }
    }

    /// Makes `_hal[…]` names values of the plasma controller.
    pub(crate) fn with_hal(self, has_hal: bool) -> Names {
        Names { has_hal, recent: Vec::new(), ..self }
    }

    /// Returns the parameter that `#<text>` names.
    ///
    /// # Errors
    /// There are too many names.
    pub(crate) fn resolve(&mut self, text: &[u8], at: Span) -> BlockResult<Reference> {
        if text.len() > MAX_RECENT {
            return self.look_up(text, at);
        }
        let place = place_of(text);
        if let Some(Some(recent)) = self.recent.get(place)
            && recent.text.get(..usize::from(recent.length)) == Some(text)
        {
            return Ok(recent.is);
        }
        let is = self.look_up(text, at)?;
        let mut recent = RecentParameters { text: [0; MAX_RECENT], length: text.len() as u8, is };
        recent.text[..text.len()].copy_from_slice(text);
        self.recent.resize(RECENT, None);
        self.recent[place] = Some(recent);
        Ok(is)
    }

    /// Returns the parameter of a name that is not cached.
    fn look_up(&mut self, text: &[u8], at: Span) -> BlockResult<Reference> {
        let name = &mut self.plain;
        name.clear();
        match text.is_ascii() {
            true => name.extend(
                text.iter()
                    .filter(|byte| !byte.is_ascii_whitespace())
                    .map(|byte| char::from(byte.to_ascii_lowercase())),
            ),
            false => name.extend(
                String::from_utf8_lossy(text)
                    .chars()
                    .filter(|letter| !letter.is_whitespace())
                    .map(|letter| letter.to_ascii_lowercase()),
            ),
        }
        if let Some(parameter) = SystemParameter::of_name(name) {
            return Ok(Reference::System(parameter));
        }
        if let Some(value) = self.fixed.get(name.as_str()) {
            return Ok(Reference::System(SystemParameter::Fixed(*value)));
        }
        if self.has_hal
            && let Some(pin) = name.strip_prefix("_hal[")
        {
            return hal_value(pin.trim_end_matches(']'), at);
        }
        if let Some(id) = self.numbers.get(name.as_str()) {
            return Ok(Reference::Named(*id));
        }
        if self.texts.len() >= MAX_NAMES {
            return fault(
                ErrorCode::StorageFull,
                at,
                format!("the program has more than {MAX_NAMES} names of parameters"),
            );
        }
        let id = NameId { index: self.texts.len() as u32, is_global: name.starts_with('_') };
        self.texts.push(name.as_str().into());
        self.numbers.insert(name.as_str().into(), id);
        Ok(Reference::Named(id))
    }

    /// Returns all names that a program has used.
    pub(crate) fn all(&self) -> impl Iterator<Item = (NameId, &str)> {
        self.texts
            .iter()
            .enumerate()
            .map(|(index, text)| (NameId { index: index as u32, is_global: text.starts_with('_') }, &**text))
    }

    pub(crate) fn text(&self, id: NameId) -> &str {
        self.texts.get(id.index as usize).map_or("", |text| text)
    }
}

/// Returns the value of the plasma controller that `#<_hal[pin]>` names.
///
/// # Errors
/// E1302 for an unknown one.
fn hal_value(pin: &str, at: Span) -> BlockResult<Reference> {
    let names = || HalValue::NAMES.iter().map(|(name, _)| *name);
    if let Some((_, value)) = HalValue::NAMES.iter().find(|(name, _)| *name == pin) {
        return Ok(Reference::System(SystemParameter::Hal(*value)));
    }
    let message = match nearest(pin, names()) {
        Some(near) => format!("#<_hal[{pin}]> is not known; did you mean #<_hal[{near}]>?"),
        None => format!("#<_hal[{pin}]> is not known; known are {}", names().collect::<Vec<_>>().join(", ")),
    };
    fault(ErrorCode::ParameterUndefined, at, message)
}

/// The values of all parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    numbered: Box<[f64]>,
    global: Vec<Option<f64>>,
    local: Vec<Option<f64>>,
    /// Empty frame of an earlier call, with its allocated memory.
    spare: Vec<Option<f64>>,
    /// Changes of numbered parameters, in a check that follows both sides of a branch.
    changes: Option<Box<ParameterChanges>>,
}

/// The numbered parameters that a program has assigned to, so that a copy of their values is small.
#[derive(Clone, Debug, PartialEq)]
struct ParameterChanges {
    /// Values before the program.
    before: Box<[f64]>,
    /// Numbers in the order of their first assignment.
    numbers: Vec<u16>,
    is_changed: Box<[bool]>,
}

/// A copy of the values of all parameters but those of the callers.
#[derive(Clone, Debug)]
pub(crate) struct ParameterValues {
    /// Values of the first changed parameters; the others have the value from before the program.
    numbered: Vec<f64>,
    global: Vec<Option<f64>>,
    local: Vec<Option<f64>>,
}

impl ParameterValues {
    /// Whether two copies have the same values to the bit.
    pub(crate) fn is_same(&self, other: &ParameterValues) -> bool {
        let bits = |value: &Option<f64>| value.map(f64::to_bits);
        // A value that only one of them has was assigned behind the other copy.
        self.numbered.len() == other.numbered.len()
            && self.numbered.iter().map(|value| value.to_bits()).eq(other.numbered.iter().map(|value| value.to_bits()))
            && self.global.iter().map(bits).eq(other.global.iter().map(bits))
            && self.local.iter().map(bits).eq(other.local.iter().map(bits))
    }
}

/// Joins named values; a missing one has no value.
fn join_named(values: &mut Vec<Option<f64>>, others: &[Option<f64>]) {
    values.resize(values.len().max(others.len()), None);
    for (index, value) in values.iter_mut().enumerate() {
        match (value, others.get(index).copied().flatten()) {
            (Some(value), Some(other)) => join(value, other),
            (None, None) => {}
            (value, _) => *value = Some(unknown_existence()),
        }
    }
}

/// Parameters of a caller, saved during a call.
#[derive(Clone, Debug)]
pub(crate) struct Frame {
    /// Local numbered parameters; `None` where caller and called share them, as with M98.
    numbered: Option<[f64; 30]>,
    local: Vec<Option<f64>>,
}

impl Default for Parameters {
    fn default() -> Parameters {
        let mut numbered = vec![0.0; LAST + 1].into_boxed_slice();
        numbered[COORDINATE_SYSTEM] = 1.0;
        numbered[SHOW_DEBUG] = 1.0;
        Parameters { numbered, global: Vec::new(), local: Vec::new(), spare: Vec::new(), changes: None }
    }
}

impl Parameters {
    /// Returns numbered parameter 1 … 5601; 0 for other numbers.
    #[must_use]
    pub fn get(&self, number: usize) -> f64 {
        if number == 0 { 0.0 } else { self.numbered.get(number).copied().unwrap_or(0.0) }
    }

    /// Sets numbered parameter 1 … 5601; does nothing for other numbers.
    pub fn set(&mut self, number: usize, value: f64) {
        if let Some(place) = self.numbered.get_mut(number) {
            *place = value;
            if let Some(changes) = &mut self.changes
                && !std::mem::replace(&mut changes.is_changed[number], true)
            {
                changes.numbers.push(number as u16);
            }
        }
    }

    /// Begins to record which numbered parameters change, so that [`Self::values`] and [`Self::restore`] work.
    pub(crate) fn record_changes(&mut self) {
        let before = self.numbered.clone();
        let is_changed = vec![false; before.len()].into_boxed_slice();
        self.changes = Some(Box::new(ParameterChanges { before, numbers: Vec::new(), is_changed }));
        // Calls replace these without an assignment.
        for number in LOCAL {
            self.set(number, self.get(number));
        }
    }

    /// Returns a copy of the values.
    pub(crate) fn values(&self) -> ParameterValues {
        let numbers = self.changes.iter().flat_map(|changes| &changes.numbers);
        let numbered = numbers.map(|&number| self.numbered[usize::from(number)]).collect();
        ParameterValues { numbered, global: self.global.clone(), local: self.local.clone() }
    }

    /// Sets the values to those of a copy.
    pub(crate) fn restore(&mut self, values: ParameterValues) {
        if let Some(changes) = &self.changes {
            for (index, &number) in changes.numbers.iter().enumerate() {
                let number = usize::from(number);
                self.numbered[number] = values.numbered.get(index).copied().unwrap_or(changes.before[number]);
            }
        }
        (self.global, self.local) = (values.global, values.local);
    }

    /// Joins the values with those of another branch.
    pub(crate) fn join(&mut self, values: &ParameterValues) {
        if let Some(changes) = &self.changes {
            for (index, &number) in changes.numbers.iter().enumerate() {
                let number = usize::from(number);
                let other = values.numbered.get(index).copied().unwrap_or(changes.before[number]);
                join(&mut self.numbered[number], other);
            }
        }
        join_named(&mut self.global, &values.global);
        join_named(&mut self.local, &values.local);
    }

    /// Whether any value is unknown, but for the position of G30, which is no part of a contour.
    pub(crate) fn has_unknown(&self) -> bool {
        let is_unknown = |values: &[f64]| values.iter().any(|value| value.is_nan());
        is_unknown(&self.numbered[..G30_HOME])
            || is_unknown(&self.numbered[G30_HOME + 9..])
            || self.global.iter().chain(&self.local).flatten().any(|value| value.is_nan())
    }

    /// Makes the numbered parameters from `first` on unknown.
    pub(crate) fn forget_from(&mut self, first: usize) {
        for number in first..=LAST {
            self.set(number, UNKNOWN);
        }
    }

    /// Makes all parameters unknown, named ones too.
    pub(crate) fn forget_all(&mut self) {
        self.forget_from(1);
        for value in self.global.iter_mut().chain(&mut self.local) {
            *value = Some(unknown_existence());
        }
    }

    /// Makes the position of G30 unknown: no parameter file has it (PRB-17). That of G28 is the machine's zero until
    /// G28.1 sets it.
    pub fn forget_reference_point(&mut self) {
        for number in G30_HOME..G30_HOME + 9 {
            self.set(number, UNKNOWN);
        }
    }

    /// Clears the offset of G52 and G92, and its flag.
    pub fn clear_g92(&mut self) {
        self.set(G92_ACTIVE, 0.0);
        for number in G92_OFFSET..G92_OFFSET + 9 {
            self.set(number, 0.0);
        }
    }

    /// Whether a numbered parameter exists.
    pub(crate) fn has(number: usize) -> bool {
        (1..=LAST).contains(&number)
    }

    /// Whether a program must not assign to it: the positions, the tool's data and the offset in force.
    pub(crate) const fn is_read_only(number: usize) -> bool {
        matches!(number, 5021..=5029 | 5400..=5413 | 5420..=5428)
    }

    pub(crate) fn named(&self, name: NameId) -> Option<f64> {
        let values = if name.is_global { &self.global } else { &self.local };
        values.get(name.index as usize).copied().flatten()
    }

    pub(crate) fn set_named(&mut self, name: NameId, value: f64) {
        let values = if name.is_global { &mut self.global } else { &mut self.local };
        let index = name.index as usize;
        if index >= values.len() {
            values.resize(index + 1, None);
        }
        values[index] = Some(value);
    }

    /// Saves the caller's local parameters and sets the arguments of the called subprogram; missing ones are 0. Without
    /// arguments the numbered ones are shared.
    pub(crate) fn enter(&mut self, arguments: Option<&[f64]>) -> Frame {
        let numbered = arguments.map(|arguments| {
            let mut numbered = [0.0; 30];
            numbered.copy_from_slice(&self.numbered[LOCAL]);
            for (index, number) in LOCAL.enumerate() {
                self.numbered[number] = arguments.get(index).copied().unwrap_or(0.0);
            }
            numbered
        });
        let room = std::mem::take(&mut self.spare);
        Frame { numbered, local: std::mem::replace(&mut self.local, room) }
    }

    /// Restores the caller's local parameters.
    pub(crate) fn leave(&mut self, frame: Frame) {
        if let Some(numbered) = &frame.numbered {
            self.numbered[LOCAL].copy_from_slice(numbered);
        }
        self.spare = std::mem::replace(&mut self.local, frame.local);
        self.spare.clear();
    }

    /// Returns the parameters that outlive a program: those that a parameter file stores, and no others.
    #[must_use]
    pub fn persistent(&self) -> Parameters {
        let mut persistent = Parameters::default();
        for number in Self::persistent_numbers() {
            persistent.set(number, self.get(number));
        }
        persistent
    }

    /// Returns the numbers of the parameters that a parameter file stores, in rising order.
    pub fn persistent_numbers() -> impl Iterator<Item = usize> {
        PERSISTENT.iter().flat_map(|(first, last)| *first..=*last)
    }

    /// Whether a numbered parameter is an offset of the machine: coordinate systems, G52 and G92, the positions of G28
    /// and G30. Those below are variables of programs.
    #[must_use]
    pub fn is_machine_offset(number: usize) -> bool {
        number >= G28_HOME && Self::persistent_numbers().any(|persistent| persistent == number)
    }

    /// Returns every numbered parameter that differs from its initial value, in the format of a parameter file, with
    /// enough digits to restore the same values.
    #[must_use]
    pub fn write_all(&self) -> String {
        let initial = Parameters::default();
        let mut text = String::new();
        for number in (1..=LAST).filter(|&number| self.get(number) != initial.get(number)) {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{number}\t{}", ExactNumber(self.get(number)));
        }
        text
    }

    /// Parses a parameter file: lines of a number and a value, in rising order; `#` and `;` begin a comment.
    ///
    /// # Errors
    /// E1703 for each invalid line.
    pub fn read(text: &str) -> Result<Parameters, Vec<Diagnostic>> {
        let mut parameters = Parameters::default();
        let mut diagnostics = Vec::new();
        let mut last = 0;
        for (index, line) in text.lines().enumerate() {
            let content = line.split(['#', ';']).next().unwrap_or_default();
            let words: Vec<&str> = content.split_whitespace().collect();
            let pair = match words[..] {
                [] => continue,
                [number, value] => number.parse::<usize>().ok().zip(value.parse::<f64>().ok()),
                _ => None,
            };
            match pair {
                Some((number, value)) if Parameters::has(number) && number > last && value.is_finite() => {
                    last = number;
                    parameters.set(number, value);
                }
                _ => diagnostics.push(Diagnostic {
                    code: ErrorCode::ParameterFileLine,
                    file: 0,
                    line: index as u32 + 1,
                    span: Span::new(0, line.len()),
                    message: ErrorCode::ParameterFileLine.title().to_owned(),
                }),
            }
        }
        if diagnostics.is_empty() { Ok(parameters) } else { Err(diagnostics) }
    }

    /// Returns the text of a parameter file: the persistent parameters, with enough digits to restore the same values.
    #[must_use]
    pub fn write(&self) -> String {
        let mut text = String::new();
        for (first, last) in PERSISTENT {
            for number in first..=last {
                let value = self.get(number);
                if value != 0.0 || number >= G28_HOME {
                    // Writing to a string cannot fail.
                    let _ = writeln!(text, "{number}\t{}", ExactNumber(value));
                }
            }
        }
        text
    }
}

/// Prints at least six decimals, and more where they are needed to restore the value.
struct ExactNumber(f64);

impl std::fmt::Display for ExactNumber {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let short = format!("{:.6}", self.0);
        if short.parse() == Ok(self.0) { formatter.write_str(&short) } else { write!(formatter, "{}", self.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_parameter_file_gives_the_same_values_back(values in prop::collection::vec((31_usize..5000,
            -1e6..1e6_f64), 0..20)) {
            let mut parameters = Parameters::default();
            for (number, value) in values {
                parameters.set(number, value);
            }
            let again = Parameters::read(&parameters.write()).expect("its own text");
            prop_assert_eq!(again, parameters);
        }
    }

    #[test]
    fn each_line_that_is_none_is_named() {
        let found =
            Parameters::read("5161 1\n5161 2\nx\n5170 1 2\n6000 1\n# c\n5181 inf\n").expect_err("five bad lines");
        assert_eq!(found.iter().map(|diagnostic| diagnostic.line).collect::<Vec<_>>(), [2, 3, 4, 5, 7]);
    }
}
