//! The effect of M, S and T codes: channel, value, class, duration, input, and behaviour in reverse (GMC, *Two classes
//! of instruction*; REV-14).
//!
//! Invariant: every code that a program may use has an entry, so that nothing is switched that the machine file does
//! not define.

use std::collections::BTreeMap;

use retrace_link::{InputWait, MAX_INPUTS};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::numbered_error::{NumberedError, nearest};
use crate::value_range::within;

/// Class of an instruction: with or without a stop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum CodeClass {
    /// The motion stops, the instruction is executed, the motion continues.
    #[default]
    Exclusive,
    /// The instruction is executed at its place without a stop.
    Synchronous,
}

/// Effect of a code where reverse run passes it, with `retrace_outputs = "replayed"` (REV-14).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
pub enum InReverse {
    /// The outputs stay as they are.
    #[serde(rename = "unchanged")]
    Unchanged,
    /// The outputs return to the values before the code; forward again, to the values after it.
    #[serde(rename = "undone")]
    Undone,
    /// The code cannot be passed backward.
    #[serde(rename = "barrier")]
    Barrier,
}

/// Input that an instruction waits for.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WaitsFor {
    /// Number of the input.
    input: u8,
    /// Whether the input has to become active, or inactive.
    #[serde(default = "yes")]
    active: bool,
    /// Timeout in ms; 0 for none.
    #[serde(default = "ten_seconds")]
    timeout_ms: f64,
}

const fn yes() -> bool {
    true
}

const fn ten_seconds() -> f64 {
    10_000.0
}

/// What a code switches, `[code.M3]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CodeSettings {
    /// Class of the code.
    pub class: CodeClass,
    /// Minimum duration of an exclusive instruction in ms.
    pub duration_ms: f64,
    /// Input that confirms that the instruction is complete.
    pub waits_for: Option<WaitsFor>,
    /// Effect in reverse.
    pub in_reverse: Option<InReverse>,
    /// Output that a user code M100 to M199 switches, 0 to 63.
    pub output: Option<u8>,
    /// Whether the user code switches the output off instead of on.
    pub off: bool,
}

/// Execution of a code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CodeSwitching {
    /// Relation to the motion.
    pub class: CodeClass,
    /// Minimum duration in control periods, if it is exclusive.
    pub periods: u32,
    /// Input that it waits for in addition.
    pub until: Option<InputWait>,
    /// Behaviour in reverse.
    pub in_reverse: InReverse,
}

impl CodeSwitching {
    /// Executed at rest and immediately, with no effect in reverse.
    pub const AT_REST: Self =
        Self { class: CodeClass::Exclusive, periods: 0, until: None, in_reverse: InReverse::Unchanged };
}

/// A user code that the machine file declares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UserCode {
    /// Name as it is written.
    pub name: &'static str,
    /// The output that it switches.
    pub output: u8,
    /// Value of the output: 0 or 1.
    pub value: i32,
    /// Execution of the code.
    pub switching: CodeSwitching,
}

/// Names of the user codes.
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

/// The codes of the machine file's `[code.…]` tables.
const CODES: [&str; 13] = ["M3", "M4", "M5", "M6", "M7", "M8", "M9", "M62", "M63", "M64", "M65", "S", "T"];

/// Codes whose class and duration are fixed: M62 and M63 are synchronous, M64 and M65 immediate. Only `in_reverse` can
/// be set.
const OUTPUT_CODES: [&str; 4] = ["M62", "M63", "M64", "M65"];

/// Execution of every code.
#[derive(Clone, Debug, Default)]
pub struct SwitchingTable {
    codes: BTreeMap<&'static str, CodeSwitching>,
    user_codes: BTreeMap<u8, UserCode>,
}

impl SwitchingTable {
    /// Checks the machine file's `[code.…]` tables.
    ///
    /// # Errors
    /// `E2111` for an unknown code, `E2112` for a value out of range, or a setting that the code cannot have.
    pub fn new(settings: &BTreeMap<String, CodeSettings>, period_us: u32) -> Result<Self, NumberedError> {
        let mut codes = BTreeMap::new();
        let mut user_codes = BTreeMap::new();
        for (name, code) in settings {
            if let Some(index) = USER_CODES.iter().position(|c| c.eq_ignore_ascii_case(name)) {
                user_codes.insert(100 + index as u8, user_code(USER_CODES[index], code, period_us)?);
                continue;
            }
            let Some(&known) = CODES.iter().find(|c| c.eq_ignore_ascii_case(name)) else {
                let meant = nearest(name, CODES).map(|c| format!("; did you mean `{c}`?")).unwrap_or_default();
                return Err(NumberedError::new(
                    "E2111",
                    format!("[code.{name}]: not a code that the machine file can describe"),
                    format!("one of {}, M100 to M199{meant}", CODES.join(", ")),
                ));
            };
            if code.output.is_some() || code.off {
                let what = format!("[code.{name}]: only user codes, M100 to M199, name an output");
                return Err(NumberedError::new("E2112", what, "leave `output` and `off` out"));
            }
            let code = if OUTPUT_CODES.contains(&known) { &output_code(known, code)? } else { code };
            codes.insert(known, switching(known, code, period_us)?);
        }
        Ok(Self { codes, user_codes })
    }

    /// The declared user codes.
    pub fn user_codes(&self) -> impl Iterator<Item = u8> {
        self.user_codes.keys().copied()
    }

    /// Effect of a user code, if it is declared.
    #[must_use]
    pub fn user_code(&self, number: u8) -> Option<UserCode> {
        self.user_codes.get(&number).copied()
    }

    /// Execution of a code; at rest and immediately where the machine file does not define it.
    #[must_use]
    pub fn code(&self, code: &str) -> CodeSwitching {
        let usual = CodeSwitching {
            class: if matches!(code, "M62" | "M63") { CodeClass::Synchronous } else { CodeClass::Exclusive },
            in_reverse: default_in_reverse(code, CodeClass::Exclusive),
            ..CodeSwitching::AT_REST
        };
        self.codes.get(code).copied().unwrap_or(usual)
    }

    /// The codes that the machine file defines, by name, in order.
    pub fn defined_codes(&self) -> impl Iterator<Item = (&'static str, CodeSwitching)> {
        let user_codes = self.user_codes.values().map(|code| (code.name, code.switching));
        self.codes.iter().map(|(&name, &switching)| (name, switching)).chain(user_codes)
    }
}

/// Behaviour of a code in reverse where the machine file does not define it: everything is replayed, except that a
/// spindle keeps turning while the path is retraced, and a changed tool stays.
fn default_in_reverse(code: &str, class: CodeClass) -> InReverse {
    match (code, class) {
        ("M6", _) => InReverse::Barrier,
        ("M3" | "M4" | "M5" | "S" | "T", CodeClass::Exclusive) => InReverse::Unchanged,
        _ => InReverse::Undone,
    }
}

/// Parses the table of M62 … M65, with the class that the code has by definition.
fn output_code(name: &'static str, code: &CodeSettings) -> Result<CodeSettings, NumberedError> {
    let sets_more = code.class != CodeClass::default() || code.duration_ms != 0.0 || code.waits_for.is_some();
    if sets_more {
        let what = format!("[code.{name}]: class, duration and input of this code are fixed");
        return Err(NumberedError::new("E2112", what, "leave everything but in_reverse out, or declare a user code"));
    }
    let class = if matches!(name, "M62" | "M63") { CodeClass::Synchronous } else { CodeClass::Exclusive };
    Ok(CodeSettings { class, ..*code })
}

/// Checks what the table of a code has in common with all others.
fn switching(name: &'static str, code: &CodeSettings, period_us: u32) -> Result<CodeSwitching, NumberedError> {
    let refuse = |what: &str, remedy: &str| Err(NumberedError::new("E2112", format!("[code.{name}] {what}"), remedy));
    within(&format!("code.{name}: duration_ms"), code.duration_ms, 0.0, 3.6e6)?;
    let until = code.waits_for.map(|waits_for| awaited(name, waits_for, period_us)).transpose()?;
    let in_reverse = code.in_reverse.unwrap_or(default_in_reverse(name, code.class));
    let takes_time = code.duration_ms > 0.0 || until.is_some() || matches!(name, "M6" | "T");
    if code.class == CodeClass::Synchronous && takes_time {
        let what = "is synchronous: it is executed without a stop and cannot take time";
        return refuse(what, "leave duration_ms and waits_for out, or make it exclusive");
    }
    if code.class == CodeClass::Synchronous && in_reverse == InReverse::Barrier {
        return refuse("is synchronous: motion does not come to rest there, and cannot end there", "make it exclusive");
    }
    if name == "M6" && in_reverse != InReverse::Barrier {
        return refuse("changes the tool, which no motion backward can undo", "leave in_reverse out");
    }
    Ok(CodeSwitching { class: code.class, periods: periods(code.duration_ms, period_us), until, in_reverse })
}

fn awaited(name: &str, waits_for: WaitsFor, period_us: u32) -> Result<InputWait, NumberedError> {
    if usize::from(waits_for.input) >= MAX_INPUTS {
        let what = format!("[code.{name}]: waits_for.input = {}: there is no such input", waits_for.input);
        return Err(NumberedError::new("E2112", what, "an input is a number from 0 to 15"));
    }
    within(&format!("code.{name}: waits_for.timeout_ms"), waits_for.timeout_ms, 0.0, 3.6e6)?;
    let at_most = periods(waits_for.timeout_ms, period_us).max(u32::from(waits_for.timeout_ms > 0.0));
    Ok(InputWait::new(waits_for.input, waits_for.active, at_most))
}

fn periods(ms: f64, period_us: u32) -> u32 {
    (ms * 1000.0 / f64::from(period_us)).round() as u32
}

/// Checks the table of a user code.
fn user_code(name: &'static str, code: &CodeSettings, period_us: u32) -> Result<UserCode, NumberedError> {
    let output = code.output.filter(|output| usize::from(*output) < retrace_link::channel::DIGITAL);
    let Some(output) = output else {
        return Err(NumberedError::new(
            "E2112",
            format!("[code.{name}] names no output from 0 to 63"),
            "write `output = 3`, with the number of the output that the code switches",
        ));
    };
    Ok(UserCode { name, output, value: i32::from(!code.off), switching: switching(name, code, period_us)? })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine_config::MachineConfig;

    fn table(name: &str, class: CodeClass, duration_ms: f64) -> Result<SwitchingTable, NumberedError> {
        let settings = CodeSettings { class, duration_ms, ..CodeSettings::default() };
        SwitchingTable::new(&BTreeMap::from([(name.to_string(), settings)]), 2000)
    }

    #[test]
    fn a_user_code_switches_the_output_that_it_names() {
        let settings = |output, off| CodeSettings { output, off, duration_ms: 4.0, ..CodeSettings::default() };
        let table = |name: &str, settings| SwitchingTable::new(&BTreeMap::from([(name.to_string(), settings)]), 2000);
        let user = table("m150", settings(Some(7), true)).expect("valid").user_code(150).expect("declared");
        assert_eq!((user.name, user.output, user.value, user.switching.periods), ("M150", 7, 0, 2));
        assert_eq!(table("M100", settings(Some(63), false)).expect("valid").user_code(100).map(|u| u.value), Some(1));
        assert_eq!(table("M100", settings(None, false)).expect_err("no output").number, "E2112");
        assert_eq!(table("M100", settings(Some(64), false)).expect_err("no such output").number, "E2112");
        assert_eq!(table("M3", settings(Some(1), false)).expect_err("M3 has its own").number, "E2112");
        assert_eq!(table("M200", settings(Some(1), false)).expect_err("no user code").number, "E2111");
    }

    #[test]
    fn durations_become_periods_and_unknown_codes_are_refused() {
        let of = |table: Result<SwitchingTable, NumberedError>, code| {
            let switching = table.expect("valid").code(code);
            (switching.class, switching.periods)
        };
        assert_eq!(of(table("m3", CodeClass::Exclusive, 500.0), "M3"), (CodeClass::Exclusive, 250));
        assert_eq!(of(table("M8", CodeClass::Synchronous, 0.0), "M8"), (CodeClass::Synchronous, 0));
        assert_eq!(of(table("M8", CodeClass::Synchronous, 0.0), "M3"), (CodeClass::Exclusive, 0));
        assert_eq!(table("M33", CodeClass::Exclusive, 0.0).expect_err("unknown").number, "E2111");
        assert_eq!(table("M3", CodeClass::Synchronous, 1.0).expect_err("time").number, "E2112");
        assert_eq!(table("M6", CodeClass::Synchronous, 0.0).expect_err("stops").number, "E2112");
    }

    fn code(text: &str) -> Result<CodeSwitching, NumberedError> {
        MachineConfig::parse(text, "m.toml").map(|machine| machine.switching.code("M3"))
    }

    #[test]
    fn a_code_waits_for_its_input_and_fails_in_time() {
        let waits = |text: &str| code(&format!("control_period_ms = 2\n[code.M3]\nwaits_for = {{ {text} }}\n"));
        let until = waits("input = 5, active = false, timeout_ms = 3000").expect("valid").until;
        assert_eq!(until, Some(InputWait::new(5, false, 1500)));
        let until = |text: &str| waits(text).expect("valid").until.map(|until| (until.active, until.timeout_periods));
        assert_eq!((until("input = 0"), until("input = 0, timeout_ms = 0")), (Some((true, 5000)), Some((true, 0))));
        assert_eq!(until("input = 0, timeout_ms = 0.1"), Some((true, 1)));
        assert!(waits("input = 16").expect_err("16 inputs").cause.contains("waits_for.input = 16"));
        assert!(waits("input = 1, timeout_ms = -1").expect_err("no time").cause.contains("waits_for.timeout_ms"));
        assert_eq!(waits("input = 1, timeout = 1").expect_err("misspelt").number, "E2111");
        let passing = code("[code.M3]\nclass = \"synchronous\"\nwaits_for = { input = 1 }\n").expect_err("it waits");
        assert!(passing.cause.contains("cannot take time"), "{}", passing.cause);
    }

    #[test]
    fn what_becomes_of_a_code_in_reverse_is_said_or_usual() {
        let in_reverse = |text: &str| code(text).expect("valid").in_reverse;
        assert_eq!((in_reverse(""), in_reverse("[code.M3]\n")), (InReverse::Unchanged, InReverse::Unchanged));
        assert_eq!(in_reverse("[code.M3]\nclass = \"synchronous\"\n"), InReverse::Undone);
        assert_eq!(in_reverse("[code.M3]\nin_reverse = \"barrier\"\n"), InReverse::Barrier);
        assert_eq!(
            in_reverse("[code.M3]\nclass = \"synchronous\"\nin_reverse = \"unchanged\"\n"),
            InReverse::Unchanged
        );
        let table = MachineConfig::built_in().expect("valid").switching;
        assert_eq!(
            (table.code("M6").in_reverse, table.code("T").in_reverse),
            (InReverse::Barrier, InReverse::Unchanged)
        );
        let barrier = code("[code.M3]\nclass = \"synchronous\"\nin_reverse = \"barrier\"\n").expect_err("no rest");
        assert!(barrier.cause.contains("does not come to rest"), "{}", barrier.cause);
        assert_eq!(code("[code.M6]\nin_reverse = \"undone\"\n").expect_err("the tool is out").number, "E2112");
    }
}
