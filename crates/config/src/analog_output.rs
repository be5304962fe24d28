//! Analog outputs of the card, `[[card.analog_output]]`: names, units, ranges and safe values (PRB-13).
//!
//! Invariant: the range and the safe value of an output fit the values of the link, and the safe value is in the range.

use retrace_link::{OutputChange, channel};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::analog_declaration::AnalogDeclaration;
use crate::numbered_error::NumberedError;
use crate::value_range::within;

/// Largest amount of an analog output, in its unit: what the link can represent.
const MAX_AMOUNT: f64 = 32_767.0;

/// An analog output of the card, `[[card.analog_output]]`.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct AnalogOutputSection {
    /// Number of the output: that behind E of M67 and M68.
    #[schemars(range(max = 7))]
    number: u8,
    /// Name.
    name: String,
    /// Unit of the values, such as `bar` or `V`.
    unit: String,
    /// Smallest value that a program may set.
    #[schemars(range(min = -32_767.0, max = 32_767.0))]
    min: f64,
    /// Largest value that a program may set.
    #[schemars(range(min = -32_767.0, max = 32_767.0))]
    max: f64,
    /// Value in an alarm.
    #[serde(default)]
    safe: f64,
}

/// An analog output of a machine.
#[derive(Clone, Debug, PartialEq)]
pub struct AnalogOutput {
    /// Number of the output, that behind E of M67 and M68.
    pub number: u8,
    /// Name.
    pub name: String,
    /// Unit of its values.
    pub unit: String,
    /// Smallest value that a program may set, in the unit.
    pub min: f64,
    /// Largest value that a program may set, in the unit.
    pub max: f64,
    /// Value in an alarm, in units of 1/[`channel::ANALOG_ONE`].
    safe: i32,
}

impl AnalogOutput {
    /// Its channel.
    #[must_use]
    pub const fn channel(&self) -> u8 {
        channel::ANALOG + self.number
    }

    /// The change to this amount, in the unit of the output; `None` if it is out of the range or not a number.
    #[must_use]
    pub fn change_to(&self, amount: f64) -> Option<OutputChange> {
        let is_in_range = (self.min..=self.max).contains(&amount);
        is_in_range.then(|| OutputChange { channel: self.channel(), value: value_of(amount) })
    }

    /// The change that an alarm makes.
    #[must_use]
    pub(crate) const fn safe_change(&self) -> OutputChange {
        OutputChange { channel: self.channel(), value: self.safe }
    }
}

/// The value on the link of an amount within [`MAX_AMOUNT`].
fn value_of(amount: f64) -> i32 {
    (amount * f64::from(channel::ANALOG_ONE)).round() as i32
}

/// The amount of a value on the link, in the unit of its output, exact.
#[must_use]
pub fn analog_amount(value: i32) -> f64 {
    f64::from(value) / f64::from(channel::ANALOG_ONE)
}

/// Checks the analog outputs: numbers and names that differ, ranges, and safe values.
pub(crate) fn checked(sections: &[AnalogOutputSection]) -> Result<Vec<AnalogOutput>, NumberedError> {
    let mut outputs: Vec<AnalogOutput> = Vec::new();
    for AnalogOutputSection { number, name, unit, min, max, safe } in sections {
        let key = |key: &str| format!("card.analog_output {number}: {key}");
        let refuse = |what: &str, remedy: &str| Err(NumberedError::new("E2112", key(what), remedy));
        let before = outputs.iter().map(|other| (other.number, other.name.as_str()));
        AnalogDeclaration { number: *number, name, unit }.check("output", channel::ANALOG_OUTPUTS, before)?;
        within(&key("min"), *min, -MAX_AMOUNT, MAX_AMOUNT)?;
        within(&key("max"), *max, -MAX_AMOUNT, MAX_AMOUNT)?;
        if min >= max {
            return refuse("min is not below max", "min below max");
        }
        within(&key("safe"), *safe, *min, *max)?;
        let (name, unit) = (name.clone(), unit.clone());
        outputs.push(AnalogOutput { number: *number, name, unit, min: *min, max: *max, safe: value_of(*safe) });
    }
    outputs.sort_by_key(|output| output.number);
    Ok(outputs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MachineConfig;
    use retrace_core::RecordIndex;
    use retrace_link::PathStart;

    const PRESSURE: &str = "[[card.analog_output]]\nnumber = 2\nname = \"gas\"\nunit = \"bar\"\nmin = -1\nmax = 16.5\n";

    fn machine(text: &str) -> Result<MachineConfig, NumberedError> {
        MachineConfig::parse(text, "m.toml")
    }

    #[test]
    fn amounts_in_the_range_become_values_and_others_none() {
        let machine = machine(PRESSURE).expect("valid");
        let gas = &machine.card.analog_outputs[0];
        let change = |value| Some(OutputChange { channel: 74, value });
        assert_eq!([3.25, -1.0, 16.5].map(|amount| gas.change_to(amount)), [212_992, -65_536, 1_081_344].map(change));
        assert_eq!([-1.001, 16.6, f64::NAN].map(|amount| gas.change_to(amount)), [None; 3]);
        assert_eq!(analog_amount(212_992), 3.25);
        assert_eq!((machine.channel_name(74), machine.channel_named("GAS")), ("gas".into(), Some(74)));
    }

    /// A fault sets every analog output, the digital ones that it always did, and each once.
    #[test]
    fn a_fault_sets_the_safe_value() {
        let text =
            format!("cutting_outputs = [3]\n{PRESSURE}safe = 1.5\n{}", PRESSURE.replace("2", "0").replace("gas", "v"));
        let settings = machine(&text).expect("valid").card_settings::<4>(PathStart::at(RecordIndex::new(0)));
        let safe: Vec<(u8, i32)> = settings.safe().iter().map(|change| (change.channel, change.value)).collect();
        assert_eq!(safe, [(3, 0), (channel::SPINDLE, 0), (72, 0), (74, 98_304)]);
    }

    #[test]
    fn what_cannot_be_is_refused_by_name() {
        let what = |text: &str| machine(text).expect_err(text).cause;
        for (from, to, part) in [
            ("number = 2", "number = 8", "card.analog_output 8: there is no such output"),
            ("\"gas\"", "\" \"", "card.analog_output 2: name is empty"),
            ("\"bar\"", "\"\"", "card.analog_output 2: unit is empty"),
            ("max = 16.5", "max = -1", "min is not below max"),
            ("max = 16.5", "max = 32768", "max = 32768"),
            ("min = -1", "min = nan", "min = NaN"),
            ("min = -1", "min = 4", "safe = 0"),
        ] {
            assert!(what(&PRESSURE.replace(from, to)).contains(part), "{}", what(&PRESSURE.replace(from, to)));
        }
        assert!(what(&PRESSURE.repeat(2)).contains("declared twice"));
        assert!(what(&(PRESSURE.to_owned() + &PRESSURE.replace("number = 2", "number = 1"))).contains("used twice"));
        let output = "[[output]]\nnumber = 4\nname = \"Gas\"\n";
        assert!(what(&(PRESSURE.to_owned() + output)).contains("the name is used twice"));
        let laser = "[[cutter]]\nname = \"laser\"\nkind = \"beam\"\nfire = 64\n";
        assert!(what(&format!("{PRESSURE}{laser}power = {{ analog = 2 }}\n")).contains("the power of laser"));
        assert!(what(&format!("{}{laser}", PRESSURE.replace("gas", "Laser"))).contains("used twice"));
        let torch = "[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 1\nmaterials = \"m.cfg\"\n";
        assert!(what(&format!("{}{torch}", PRESSURE.replace("= 2", "= 3"))).contains("share of the feed rate"));
        let fault = "[card]\noff_at_fault = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15]\n";
        assert!(what(&(fault.to_owned() + PRESSURE)).contains("at most 16"));
    }
}
