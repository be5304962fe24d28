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
    /// The output that a user code M100 to M199 switches, 0 to 63.
    pub output: Option<u8>,
    /// Whether the user code switches it off and not on.
    pub off: bool,
}

/// A user code that the machine file declares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UserCode {
    /// How it is written.
    pub name: &'static str,
    /// The output that it switches.
    pub output: u8,
    /// What the output becomes: 0 or 1.
    pub value: i32,
    /// How it stands to the motion.
    pub class: Class,
    /// Control periods that it takes, if it is exclusive.
    pub periods: u32,
}

/// The user codes by their names.
#[rustfmt::skip]
const USER_CODES: [&str; 100] = [
    "M100", "M101", "M102", "M103", "M104", "M105", "M106", "M107", "M108", "M109",
    "M110", "M111", "M112", "M113", "M114", "M115", "M116", "M117", "M118", "M119",
    "M120", "M121", "M122", "M123", "M124", "M125", "M126", "M127", "M128", "M129",
    "M130", "M131", "M132", "M133", "M134", "M135", "M136", "M137", "M138", "M139",
    "M140", "M141", "M142", "M143", "M144", "M145", "M146", "M147", "M148", "M149",
    "M150", "M151", "M152", "M153", "M154", "M155", "M156", "M157", "M158", "M159",
    "M160", "M161", "M162", "M163", "M164", "M165", "M166", "M167", "M168", "M169",
    "M170", "M171", "M172", "M173", "M174", "M175", "M176", "M177", "M178", "M179",
    "M180", "M181", "M182", "M183", "M184", "M185", "M186", "M187", "M188", "M189",
    "M190", "M191", "M192", "M193", "M194", "M195", "M196", "M197", "M198", "M199",
];

/// The codes of the machine file's `[code.…]` tables. M62 to M65 are synchronous and immediate by definition.
const CODES: [&str; 9] = ["M3", "M4", "M5", "M6", "M7", "M8", "M9", "S", "T"];

/// Class and duration in control periods of every code.
#[derive(Clone, Debug, Default)]
pub struct SwitchingTable {
    codes: BTreeMap<&'static str, (Class, u32)>,
    user_codes: BTreeMap<u8, UserCode>,
}

impl SwitchingTable {
    /// Checks the machine file's `[code.…]` tables.
    ///
    /// # Errors
    /// `E2111` for a code that is not known, `E2112` for a duration out of range or on a synchronous code.
    pub fn new(settings: &BTreeMap<String, CodeSettings>, period_us: u32) -> Result<Self, Refusal> {
        let mut codes = BTreeMap::new();
        let mut user_codes = BTreeMap::new();
        for (name, code) in settings {
            if let Some(index) = USER_CODES.iter().position(|c| c.eq_ignore_ascii_case(name)) {
                user_codes.insert(100 + index as u8, user_code(USER_CODES[index], code, period_us)?);
                continue;
            }
            let Some(&known) = CODES.iter().find(|c| c.eq_ignore_ascii_case(name)) else {
                let meant = nearest(name, CODES).map(|c| format!("; did you mean `{c}`?")).unwrap_or_default();
                return Err(Refusal::new(
                    "E2111",
                    format!("[code.{name}]: not a code that the machine file can describe"),
                    format!("one of {}, M100 to M199{meant}", CODES.join(", ")),
                ));
            };
            if code.output.is_some() || code.off {
                return Err(Refusal::new(
                    "E2112",
                    format!("[code.{name}]: only user codes, M100 to M199, name an output"),
                    "leave `output` and `off` out",
                ));
            }
            within(&format!("code.{name}: duration_ms"), code.duration_ms, 0.0, 3.6e6)?;
            if code.class == Class::Synchronous && (code.duration_ms > 0.0 || matches!(known, "M6" | "T")) {
                return Err(Refusal::new(
                    "E2112",
                    format!("[code.{name}] is synchronous: it is executed in passing and can take no time"),
                    "leave duration_ms out, or make it exclusive",
                ));
            }
            codes.insert(known, (code.class, periods(code, period_us)));
        }
        Ok(Self { codes, user_codes })
    }

    /// The user codes that are declared.
    pub fn user_codes(&self) -> impl Iterator<Item = u8> {
        self.user_codes.keys().copied()
    }

    /// What a user code switches, if it is declared.
    #[must_use]
    pub fn user_code(&self, number: u8) -> Option<UserCode> {
        self.user_codes.get(&number).copied()
    }

    /// Class and duration in control periods of a code.
    #[must_use]
    pub fn of(&self, code: &str) -> (Class, u32) {
        self.codes.get(code).copied().unwrap_or_default()
    }
}

fn periods(code: &CodeSettings, period_us: u32) -> u32 {
    (code.duration_ms * 1000.0 / f64::from(period_us)).round() as u32
}

/// Checks the table of a user code.
fn user_code(name: &'static str, code: &CodeSettings, period_us: u32) -> Result<UserCode, Refusal> {
    within(&format!("code.{name}: duration_ms"), code.duration_ms, 0.0, 3.6e6)?;
    let output = code.output.filter(|output| usize::from(*output) < retrace_link::channel::DIGITAL);
    let Some(output) = output else {
        return Err(Refusal::new(
            "E2112",
            format!("[code.{name}] names no output from 0 to 63"),
            "write `output = 3`, with the number of the output that the code switches",
        ));
    };
    if code.class == Class::Synchronous && code.duration_ms > 0.0 {
        return Err(Refusal::new(
            "E2112",
            format!("[code.{name}] is synchronous: it is executed in passing and can take no time"),
            "leave duration_ms out, or make it exclusive",
        ));
    }
    let value = i32::from(!code.off);
    Ok(UserCode { name, output, value, class: code.class, periods: periods(code, period_us) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(name: &str, class: Class, duration_ms: f64) -> Result<SwitchingTable, Refusal> {
        let settings = CodeSettings { class, duration_ms, ..CodeSettings::default() };
        SwitchingTable::new(&BTreeMap::from([(name.to_string(), settings)]), 2000)
    }

    #[test]
    fn a_user_code_switches_the_output_that_it_names() {
        let settings = |output, off| CodeSettings { output, off, duration_ms: 4.0, ..CodeSettings::default() };
        let table = |name: &str, settings| SwitchingTable::new(&BTreeMap::from([(name.to_string(), settings)]), 2000);
        let user = table("m150", settings(Some(7), true)).expect("valid").user_code(150).expect("declared");
        assert_eq!((user.name, user.output, user.value, user.periods), ("M150", 7, 0, 2));
        assert_eq!(table("M100", settings(Some(63), false)).expect("valid").user_code(100).map(|u| u.value), Some(1));
        assert_eq!(table("M100", settings(None, false)).expect_err("no output").number, "E2112");
        assert_eq!(table("M100", settings(Some(64), false)).expect_err("no such output").number, "E2112");
        assert_eq!(table("M3", settings(Some(1), false)).expect_err("M3 has its own").number, "E2112");
        assert_eq!(table("M200", settings(Some(1), false)).expect_err("no user code").number, "E2111");
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
