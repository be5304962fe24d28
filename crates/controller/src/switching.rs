//! What the M, S and T codes switch: channel, value, class and duration (GMC, *Two classes of instruction*).
//!
//! Invariant: every code that a program may use has an entry, so that nothing is switched that the machine file does not know.

use std::collections::BTreeMap;

use serde::Deserialize;

use crate::machine::within;
use crate::refusal::{Refusal, nearest};

/// How an instruction stands to the motion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Class {
    /// The motion comes to rest, the instruction is executed, the motion goes on.
    #[default]
    Exclusive,
    /// Executed in passing, at its place, without a stop.
    Synchronous,
}

/// A code's entry in the machine file, `[code.M3]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CodeSettings {
    /// How it stands to the motion.
    pub class: Class,
    /// How long an exclusive instruction takes, in ms.
    pub duration_ms: f64,
}

/// The codes of the machine file's `[code.…]` tables. M62 to M65 are synchronous and immediate by definition.
const CODES: [&str; 9] = ["M3", "M4", "M5", "M6", "M7", "M8", "M9", "S", "T"];

/// Class and duration in control periods of every code.
#[derive(Clone, Debug, Default)]
pub struct SwitchingTable {
    codes: BTreeMap<&'static str, (Class, u32)>,
}

impl SwitchingTable {
    /// Checks the machine file's `[code.…]` tables.
    ///
    /// # Errors
    /// `E2111` for a code that is not known, `E2112` for a duration out of range or on a synchronous code.
    pub fn new(settings: &BTreeMap<String, CodeSettings>, period_us: u32) -> Result<Self, Refusal> {
        let mut codes = BTreeMap::new();
        for (name, code) in settings {
            let Some(&known) = CODES.iter().find(|c| c.eq_ignore_ascii_case(name)) else {
                let meant = nearest(name, CODES).map(|c| format!("; did you mean `{c}`?")).unwrap_or_default();
                return Err(Refusal::new(
                    "E2111",
                    format!("[code.{name}]: not a code that the machine file can describe"),
                    format!("one of {}{meant}", CODES.join(", ")),
                ));
            };
            within(&format!("code.{name}: duration_ms"), code.duration_ms, 0.0, 3.6e6)?;
            if code.class == Class::Synchronous && (code.duration_ms > 0.0 || matches!(known, "M6" | "T")) {
                return Err(Refusal::new(
                    "E2112",
                    format!("[code.{name}] is synchronous: it is executed in passing and can take no time"),
                    "leave duration_ms out, or make it exclusive",
                ));
            }
            codes.insert(known, (code.class, (code.duration_ms * 1000.0 / f64::from(period_us)).round() as u32));
        }
        Ok(Self { codes })
    }

    /// Class and duration in control periods of a code.
    #[must_use]
    pub fn of(&self, code: &str) -> (Class, u32) {
        self.codes.get(code).copied().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(name: &str, class: Class, duration_ms: f64) -> Result<SwitchingTable, Refusal> {
        SwitchingTable::new(&BTreeMap::from([(name.to_string(), CodeSettings { class, duration_ms })]), 2000)
    }

    #[test]
    fn durations_become_periods_and_unknown_codes_are_refused() {
        assert_eq!(table("m3", Class::Exclusive, 500.0).expect("valid").of("M3"), (Class::Exclusive, 250));
        assert_eq!(table("M8", Class::Synchronous, 0.0).expect("valid").of("M8"), (Class::Synchronous, 0));
        assert_eq!(table("M8", Class::Synchronous, 0.0).expect("valid").of("M3"), (Class::Exclusive, 0));
        assert_eq!(table("M33", Class::Exclusive, 0.0).expect_err("unknown").number, "E2111");
        assert_eq!(table("M3", Class::Synchronous, 1.0).expect_err("time").number, "E2112");
        assert_eq!(table("M6", Class::Synchronous, 0.0).expect_err("stops").number, "E2112");
    }
}
