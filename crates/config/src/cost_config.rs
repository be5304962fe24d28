//! What a program costs, `[cost]` (CUT-60).
//!
//! Invariant: a rate that is there is a number from 0 to [`MAX_RATE`]; nothing has a cost by default.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::cutter::CutterConfig;
use crate::numbered_error::NumberedError;
use crate::value_range::within;

/// Maximum rate, in the currency.
const MAX_RATE: f64 = 1e6;

/// Maximum length of the currency's name, in characters.
const MAX_CURRENCY: usize = 16;

/// Rates for the cost that `retrace check` reports, `[cost]`. What has no rate costs nothing.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CostConfig {
    /// Currency of the rates, as it is printed behind an amount.
    #[schemars(length(max = 16))]
    pub currency: String,
    /// Cost of an hour of the program.
    #[schemars(range(min = 0.0, max = 1_000_000.0))]
    pub per_hour: Option<f64>,
    /// Cost of a pierce.
    #[schemars(range(min = 0.0, max = 1_000_000.0))]
    pub per_pierce: Option<f64>,
    /// Cost of a metre of cut.
    #[schemars(range(min = 0.0, max = 1_000_000.0))]
    pub per_metre: Option<f64>,
    /// Cost of a kilogram of abrasive.
    #[schemars(range(min = 0.0, max = 1_000_000.0))]
    pub per_kg_abrasive: Option<f64>,
}

/// Cost of a program, by cause; `None` where the cause has no rate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ProgramCost {
    /// Of its time.
    pub time: Option<f64>,
    /// Of its pierces.
    pub pierces: Option<f64>,
    /// Of the length that it cuts.
    pub cut: Option<f64>,
    /// Of its abrasive.
    pub abrasive: Option<f64>,
}

impl ProgramCost {
    /// The sum.
    #[must_use]
    pub fn total(&self) -> f64 {
        [self.time, self.pierces, self.cut, self.abrasive].into_iter().flatten().sum()
    }
}

impl CostConfig {
    /// Checks the rates, and that the machine has what they are for.
    ///
    /// # Errors
    /// `E2112`
    pub(crate) fn check(&self, cutters: &[CutterConfig]) -> Result<(), NumberedError> {
        if self.currency.chars().count() > MAX_CURRENCY || self.currency.chars().any(char::is_control) {
            let what = format!("cost.currency = {:?}", self.currency);
            let remedy = format!("at most {MAX_CURRENCY} characters, such as \"EUR\"");
            return Err(NumberedError::new("E2112", what, remedy));
        }
        let cuts = cutters.iter().any(|cutter| cutter.kind.cuts_at_rest());
        let has_abrasive = cutters.iter().any(|cutter| cutter.abrasive.is_some());
        for (key, rate, is_used, remedy) in [
            ("per_hour", self.per_hour, true, ""),
            ("per_pierce", self.per_pierce, cuts, "declare the torch, jet or beam with [[cutter]], or remove the key"),
            ("per_metre", self.per_metre, cuts, "declare the torch, jet or beam with [[cutter]], or remove the key"),
            ("per_kg_abrasive", self.per_kg_abrasive, has_abrasive, "give the jet its `abrasive`, or remove the key"),
        ] {
            let Some(rate) = rate else { continue };
            within(&format!("cost.{key}"), rate, 0.0, MAX_RATE)?;
            if !is_used {
                let what = format!("cost.{key}: the machine has no cutter that it is for");
                return Err(NumberedError::new("E2112", what, remedy));
            }
        }
        Ok(())
    }

    /// Cost of a program of this time in s with this number of pierces, length of cut in mm, and mass of abrasive in
    /// kg.
    #[must_use]
    pub fn of_program(&self, seconds: f64, pierces: u64, cut_mm: f64, abrasive_kg: f64) -> ProgramCost {
        ProgramCost {
            time: self.per_hour.map(|rate| rate * seconds / 3600.0),
            pierces: self.per_pierce.map(|rate| rate * pierces as f64),
            cut: self.per_metre.map(|rate| rate * cut_mm / 1000.0),
            abrasive: self.per_kg_abrasive.map(|rate| rate * abrasive_kg),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::{MachineConfig, ProgramCost};

    const JET: &str = "[[cutter]]\nname = \"jet\"\nkind = \"jet\"\nfire = 3\nabrasive = 4\n";

    #[test]
    fn each_rate_is_for_one_cause_and_nothing_costs_without_one() {
        let file = format!(
            "{JET}[cost]\ncurrency = \"EUR\"\nper_hour = 90\nper_pierce = 0.5\nper_metre = 2\nper_kg_abrasive = 0.4\n"
        );
        let machine = MachineConfig::parse(&file, "m").expect("valid");
        let cost = machine.cost.expect("rates").of_program(1800.0, 4, 2500.0, 10.0);
        let wanted = ProgramCost { time: Some(45.0), pierces: Some(2.0), cut: Some(5.0), abrasive: Some(4.0) };
        assert_eq!((cost, cost.total()), (wanted, 56.0));
        let machine = MachineConfig::parse("[cost]\nper_hour = 36\n", "m").expect("valid");
        let cost = machine.cost.expect("a rate").of_program(10.0, 4, 2500.0, 10.0);
        assert_eq!((cost, cost.total()), (ProgramCost { time: Some(0.1), ..ProgramCost::default() }, 0.1));
        assert_eq!(MachineConfig::parse(JET, "m").expect("valid").cost, None);
    }

    #[test]
    fn a_rate_out_of_range_or_without_its_cutter_is_refused() {
        for (text, told) in [
            ("[cost]\nper_hour = -1\n", "cost.per_hour = -1"),
            ("[cost]\nper_hour = nan\n", "cost.per_hour = NaN"),
            ("[cost]\nper_pierce = 1\n", "cost.per_pierce: the machine has no cutter"),
            ("[cost]\nper_metre = 1\n", "cost.per_metre: the machine has no cutter"),
            ("cutting_outputs = [3]\n[cost]\nper_kg_abrasive = 1\n", "cost.per_kg_abrasive: the machine has no cutter"),
            ("[cost]\ncurrency = \"12345678901234567\"\n", "cost.currency"),
            ("[cost]\ncurrency = \"a\\nb\"\n", "cost.currency"),
        ] {
            let refusal = MachineConfig::parse(text, "m").expect_err(text);
            assert!(refusal.number == "E2112" && refusal.cause.contains(told), "{text}: {refusal:?}");
            let all = MachineConfig::check_machine(text, "m").errors;
            assert!(all.len() == 1 && all[0] == refusal, "{text}: {all:?}");
        }
    }
}
