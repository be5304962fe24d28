//! Analog inputs of the card, `[[card.analog_input]]`: names, units and ranges (PRB-12).
//!
//! Invariant: the amounts at both ends of the range are numbers that differ.

use retrace_link::ANALOG_INPUTS;
use schemars::JsonSchema;
use serde::Deserialize;

use crate::analog_declaration::AnalogDeclaration;
use crate::numbered_error::NumberedError;
use crate::value_range::within;

/// Largest amount of an analog input, in its unit.
const MAX_AMOUNT: f64 = 1e6;
/// Readings of the whole range.
const READINGS: f64 = 65_536.0;

/// An analog input of the card, `[[card.analog_input]]`.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct AnalogInputSection {
    /// Number of the input: that behind E of M66.
    #[schemars(range(max = 3))]
    number: u8,
    /// Name.
    name: String,
    /// Unit of the values, such as `V` or `bar`.
    unit: String,
    /// Value at the lower end of the converter's range.
    #[serde(default)]
    #[schemars(range(min = -1e6, max = 1e6))]
    at_zero: f64,
    /// Value at the upper end of the converter's range.
    #[schemars(range(min = -1e6, max = 1e6))]
    at_full: f64,
}

/// An analog input of a machine.
#[derive(Clone, Debug, PartialEq)]
pub struct AnalogInput {
    /// Number of the input, that behind E of M66.
    pub number: u8,
    /// Name.
    pub name: String,
    /// Unit of its amounts.
    pub unit: String,
    /// Amounts at both ends of the range, in the unit.
    range: [f64; 2],
}

impl AnalogInput {
    /// The amount of a reading in units of 2⁻¹⁶ of the range, in the unit of the input.
    #[must_use]
    pub fn amount(&self, reading: u16) -> f64 {
        let [at_zero, at_full] = self.range;
        at_zero + (at_full - at_zero) * (f64::from(reading) / READINGS)
    }

    /// The difference of two amounts whose readings differ by one.
    #[must_use]
    pub fn per_reading(&self) -> f64 {
        let [at_zero, at_full] = self.range;
        (at_full - at_zero) / READINGS
    }

    /// The reading at an amount; the nearest one, or the end of the range.
    #[must_use]
    pub fn reading(&self, amount: f64) -> u16 {
        let [at_zero, at_full] = self.range;
        // out of the range it is cut off, as a converter does
        ((amount - at_zero) / (at_full - at_zero) * READINGS).round() as u16
    }
}

/// Checks the analog inputs: numbers and names that differ, and ranges.
pub(crate) fn checked(sections: &[AnalogInputSection]) -> Result<Vec<AnalogInput>, NumberedError> {
    let mut inputs: Vec<AnalogInput> = Vec::new();
    for AnalogInputSection { number, name, unit, at_zero, at_full } in sections {
        let key = |key: &str| format!("card.analog_input {number}: {key}");
        let refuse = |what: &str, remedy: &str| Err(NumberedError::new("E2112", key(what), remedy));
        let before = inputs.iter().map(|other| (other.number, other.name.as_str()));
        AnalogDeclaration { number: *number, name, unit }.check("input", ANALOG_INPUTS, before)?;
        within(&key("at_zero"), *at_zero, -MAX_AMOUNT, MAX_AMOUNT)?;
        within(&key("at_full"), *at_full, -MAX_AMOUNT, MAX_AMOUNT)?;
        if at_zero == at_full {
            return refuse("at_zero and at_full are equal", "the values at the two ends of the range");
        }
        inputs.push(AnalogInput {
            number: *number,
            name: name.clone(),
            unit: unit.clone(),
            range: [*at_zero, *at_full],
        });
    }
    inputs.sort_by_key(|input| input.number);
    Ok(inputs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MachineConfig;

    const VOLTS: &str = "[[card.analog_input]]\nnumber = 1\nname = \"arc\"\nunit = \"V\"\nat_full = 256\n";

    fn machine(text: &str) -> Result<MachineConfig, NumberedError> {
        MachineConfig::parse(text, "m.toml")
    }

    #[test]
    fn readings_become_amounts_and_back() {
        let arc = &machine(VOLTS).expect("valid").card.analog_inputs[0];
        assert_eq!((arc.number, arc.name.as_str(), arc.unit.as_str()), (1, "arc", "V"));
        assert_eq!([0, 256, 65_535].map(|reading| arc.amount(reading)), [0.0, 1.0, 256.0 - 1.0 / 256.0]);
        assert_eq!([-5.0, 1.0, 1.001, 500.0].map(|amount| arc.reading(amount)), [0, 256, 256, 65_535]);
        // A range may be turned round, and begin below 0.
        let turned =
            &machine(&format!("{VOLTS}at_zero = 10\n").replace("256", "-10")).expect("valid").card.analog_inputs[0];
        assert_eq!([0, 32_768].map(|reading| turned.amount(reading)), [10.0, 0.0]);
        assert_eq!([10.0, 0.0, -11.0].map(|amount| turned.reading(amount)), [0, 32_768, 65_535]);
        for reading in 0..=u16::MAX {
            assert_eq!(turned.reading(turned.amount(reading)), reading);
        }
    }

    #[test]
    fn what_cannot_be_is_refused_by_name() {
        let what = |text: &str| machine(text).expect_err(text).cause;
        for (from, to, part) in [
            ("number = 1", "number = 4", "card.analog_input 4: there is no such input"),
            ("\"arc\"", "\"\"", "card.analog_input 1: name is empty"),
            ("\"V\"", "\"\\n\"", "unit is empty or has control characters"),
            ("at_full = 256", "at_full = 0", "at_zero and at_full are equal"),
            ("at_full = 256", "at_full = inf", "at_full = inf"),
            ("at_full = 256", "at_full = 1\nat_zero = -2e6", "at_zero = -2000000"),
        ] {
            assert!(what(&VOLTS.replace(from, to)).contains(part), "{}", what(&VOLTS.replace(from, to)));
        }
        assert!(what(&VOLTS.repeat(2)).contains("declared twice"));
        assert!(what(&(VOLTS.to_owned() + &VOLTS.replace("= 1", "= 0"))).contains("used twice"));
    }
}
