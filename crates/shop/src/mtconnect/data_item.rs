//! The data items of a machine: key, type and present value.
//!
//! Types, subtypes, units and values are those of the MTConnect standard, version 2.0, part 2 (device information
//! model) and part 3 (observations). What it has no type for is in the namespace `x`.
//!
//! Invariant: keys are unique, and the value of an item is one of its type, or `UNAVAILABLE`.

use crate::machine_report::{MachineReport, ReportedAxis};

/// What is not known.
pub(super) const UNAVAILABLE: &str = "UNAVAILABLE";

/// Category of an item.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Category {
    /// State, or text.
    Event,
    /// Figure that changes all the time: sent at most every 100 ms.
    Sample,
    /// Alarm, or none.
    Condition,
}

/// Part of the machine that an item belongs to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Part {
    /// The machine itself.
    Device,
    /// Its controller.
    Controller,
    /// The path of its program.
    Path,
    /// An axis, by its index.
    Axis(usize),
    /// The spindle.
    Spindle,
}

/// A data item.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DataItem {
    /// Key, which is its `id` in `Devices.xml`, too.
    pub key: String,
    /// Part of the machine.
    pub part: Part,
    /// Category.
    pub category: Category,
    /// Type.
    pub kind: &'static str,
    /// Subtype, where the type has any.
    pub sub_kind: Option<&'static str>,
    /// Units of the standard and of the figures here, where it has any.
    pub units: Option<[&'static str; 2]>,
    /// Coordinate system of a position.
    pub coordinate_system: Option<&'static str>,
    value: Source,
}

/// Where the value of an item comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Source {
    Availability,
    EmergencyStop,
    Execution,
    ControllerMode,
    Program,
    LineNumber,
    LineLabel,
    Block,
    FeedActual,
    FeedProgrammed,
    FeedOverride,
    Position(&'static str, usize),
    SpindleSpeed,
    ToolNumber,
    Pieces(usize),
    Direction,
    DistanceBack,
    Condition(ConditionOf),
}

/// Alarms that a condition shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ConditionOf {
    System,
    Communications,
    MotionProgram,
    LogicProgram,
}

impl ConditionOf {
    /// Condition of an alarm, by its number (docs/errors.md).
    fn of_alarm(number: &str) -> Self {
        match number {
            "E3002" | "E3003" | "E3005" | "E3007" | "E3009" | "E3011" => Self::Communications,
            _ if number.starts_with("E1") || number.starts_with("E43") => Self::MotionProgram,
            "E3006" | "E3015" | "E3016" => Self::LogicProgram,
            _ => Self::System,
        }
    }
}

/// The items of a machine with these axes, in the order in which they are sent.
#[must_use]
pub fn data_items(axes: &[ReportedAxis]) -> Vec<DataItem> {
    use Category::{Condition, Event, Sample};
    let item = |key: &str, part: Part, category, kind, value| DataItem {
        key: key.to_owned(),
        part,
        category,
        kind,
        sub_kind: None,
        units: None,
        coordinate_system: None,
        value,
    };
    let of = |sub_kind, item: DataItem| DataItem { sub_kind: Some(sub_kind), ..item };
    let feed = Some(["MILLIMETER/SECOND", "MILLIMETER/MINUTE"]);
    let mut items = vec![
        item("avail", Part::Device, Event, "AVAILABILITY", Source::Availability),
        item("estop", Part::Controller, Event, "EMERGENCY_STOP", Source::EmergencyStop),
        item("execution", Part::Path, Event, "EXECUTION", Source::Execution),
        item("mode", Part::Path, Event, "CONTROLLER_MODE", Source::ControllerMode),
        item("program", Part::Path, Event, "PROGRAM", Source::Program),
        of("ABSOLUTE", item("line", Part::Path, Event, "LINE_NUMBER", Source::LineNumber)),
        item("linelabel", Part::Path, Event, "LINE_LABEL", Source::LineLabel),
        item("block", Part::Path, Event, "BLOCK", Source::Block),
        item("tool", Part::Path, Event, "TOOL_NUMBER", Source::ToolNumber),
        of("GOOD", item("goodparts", Part::Path, Event, "PART_COUNT", Source::Pieces(0))),
        of("BAD", item("badparts", Part::Path, Event, "PART_COUNT", Source::Pieces(1))),
        of("PROGRAMMED", item("feedovr", Part::Path, Event, "PATH_FEEDRATE_OVERRIDE", Source::FeedOverride)),
        item("retrace", Part::Path, Event, "x:RETRACE", Source::Direction),
        DataItem {
            units: Some(["MILLIMETER"; 2]),
            ..item("reached", Part::Path, Sample, "x:REACHED", Source::DistanceBack)
        },
        of("ACTUAL", DataItem { units: feed, ..item("feed", Part::Path, Sample, "PATH_FEEDRATE", Source::FeedActual) }),
        of(
            "COMMANDED",
            DataItem { units: feed, ..item("feedcmd", Part::Path, Sample, "PATH_FEEDRATE", Source::FeedProgrammed) },
        ),
        of(
            "ACTUAL",
            DataItem {
                units: Some(["REVOLUTION/MINUTE"; 2]),
                ..item("speed", Part::Spindle, Sample, "ROTARY_VELOCITY", Source::SpindleSpeed)
            },
        ),
    ];
    for (index, axis) in axes.iter().enumerate() {
        let (kind, units) = if axis.is_linear { ("POSITION", "MILLIMETER") } else { ("ANGLE", "DEGREE") };
        for (suffix, system, from) in [("machine", "MACHINE", "mm"), ("work", "WORK", "work")] {
            let key = format!("{}{suffix}", axis.letter);
            let position = item(&key, Part::Axis(index), Sample, kind, Source::Position(from, index));
            let position = DataItem { units: Some([units; 2]), coordinate_system: Some(system), ..position };
            items.push(of("ACTUAL", position));
        }
    }
    for (key, kind, condition) in [
        ("system", "SYSTEM", ConditionOf::System),
        ("communications", "COMMUNICATIONS", ConditionOf::Communications),
        ("motion", "MOTION_PROGRAM", ConditionOf::MotionProgram),
        ("logic", "LOGIC_PROGRAM", ConditionOf::LogicProgram),
    ] {
        items.push(item(key, Part::Controller, Condition, kind, Source::Condition(condition)));
    }
    items
}

/// Value of an item.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Observation {
    /// One value.
    Value(String),
    /// A condition: level, number of the alarm, and its text.
    Condition {
        /// `NORMAL`, `FAULT` or `UNAVAILABLE`.
        level: &'static str,
        /// Number of the alarm, or nothing.
        code: String,
        /// Cause of the alarm, or nothing.
        text: String,
    },
}

impl DataItem {
    /// Its value by this report.
    pub(super) fn observe(&self, report: &MachineReport) -> Observation {
        if let Source::Condition(of) = self.value {
            return condition(of, report);
        }
        let is_text = |value: &String| value.chars().any(|c| !c.is_control() && !c.is_whitespace());
        Observation::Value(self.value(report).filter(is_text).unwrap_or_else(|| UNAVAILABLE.into()))
    }

    fn value(&self, report: &MachineReport) -> Option<String> {
        if let Source::Pieces(which) = self.value {
            return report.pieces.map(|pieces| pieces[which].to_string());
        }
        if !report.is_available() {
            return None;
        }
        let figure = |number: f64| number.is_finite().then(|| number.to_string());
        match self.value {
            Source::Availability => Some("AVAILABLE".into()),
            Source::EmergencyStop => {
                let is_open = report.alarm().is_some_and(|(number, _)| number == "E3012");
                Some(if is_open { "TRIGGERED" } else { "ARMED" }.into())
            }
            Source::Execution => report.execution().map(str::to_owned),
            Source::ControllerMode => Some(controller_mode(report).into()),
            Source::Program => report.program().map(str::to_owned),
            Source::LineNumber => report.line().map(|line| line.to_string()),
            Source::LineLabel => report.block().and_then(line_label),
            Source::Block => report.block().map(str::to_owned),
            Source::FeedActual => report.live("feed").and_then(figure),
            Source::FeedProgrammed => programmed_feed(report).and_then(figure),
            Source::FeedOverride => {
                // While the path is retraced, the rate is what the operator asks for.
                let is_program = report.state("mode") == Some("run");
                let rate = if is_program { report.state_number("override")? } else { report.live("rate")?.abs() };
                figure((rate * 1e4).round() / 100.0)
            }
            Source::Position(of, axis) => report.position(of, axis).and_then(figure),
            Source::SpindleSpeed => report.live("rpm").and_then(figure),
            Source::ToolNumber => report.state_number("tool").and_then(figure),
            Source::Direction => Some(direction(report).into()),
            Source::DistanceBack => report.live("back_mm").and_then(figure),
            Source::Pieces(_) | Source::Condition(_) => None,
        }
    }
}

fn condition(of: ConditionOf, report: &MachineReport) -> Observation {
    let (level, (code, text)) = match report.alarm() {
        _ if !report.is_available() => (UNAVAILABLE, ("", "")),
        Some(alarm) if ConditionOf::of_alarm(alarm.0) == of => ("FAULT", alarm),
        _ => ("NORMAL", ("", "")),
    };
    Observation::Condition { level, code: code.into(), text: text.into() }
}

fn controller_mode(report: &MachineReport) -> &'static str {
    match report.state("stage") {
        Some("job" | "resuming") => "AUTOMATIC",
        _ => "MANUAL",
    }
}

fn direction(report: &MachineReport) -> &'static str {
    match report.live("rate") {
        _ if report.is_at_rest() => "NONE",
        Some(rate) if rate < 0.0 => "REVERSE",
        _ => "FORWARD",
    }
}

/// Programmed feed in mm/min; none under G93, G95 and without a feed.
fn programmed_feed(report: &MachineReport) -> Option<f64> {
    let unit_mm = if report.has_modal("G20") { 25.4 } else { 1.0 };
    let feed = report.modal('F').filter(|_| report.has_modal("G94"))?;
    Some((feed * unit_mm * 1e4).round() / 1e4)
}

/// The N word of a block.
fn line_label(block: &str) -> Option<String> {
    let digits = block.trim_start_matches(['/', ' ']).strip_prefix(['N', 'n'])?.trim_start();
    let end = digits.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(digits.len());
    Some(digits[..end].to_owned()).filter(|label| !label.is_empty())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn report(state: serde_json::Value) -> MachineReport {
        let mut report = MachineReport::default();
        report.take(state);
        report
    }

    fn job(mode: &str, hold_reason: &str) -> serde_json::Value {
        json!({"t": "state", "stage": "job", "mode": mode, "hold_reason": hold_reason, "word": "", "why": ""})
    }

    #[test]
    fn each_state_has_its_execution() {
        let with = |mut state: serde_json::Value, key: &str, value: serde_json::Value| {
            state[key] = value;
            state
        };
        let run = || job("run", "none");
        let alarm = json!({"number": "E3012", "cause": "open", "is_refusal": false});
        let refusal = json!({"number": "E2409", "cause": "busy", "is_refusal": true});
        for (state, expected) in [
            (run(), "ACTIVE"),
            (job("run", "hold"), "FEED_HOLD"),
            (job("run", "program stop"), "PROGRAM_STOPPED"),
            (with(job("run", "program stop"), "program_stop", json!("M1")), "OPTIONAL_STOP"),
            (job("run", "end of program"), "PROGRAM_COMPLETED"),
            (job("run", "single block"), "INTERRUPTED"),
            (job("reverse", "none"), "INTERRUPTED"),
            (job("wheel", "none"), "INTERRUPTED"),
            (with(run(), "pause", json!({"stopped": true})), "INTERRUPTED"),
            (with(run(), "switching", json!("M3")), "WAIT"),
            (with(run(), "tool_change", json!(3)), "WAIT"),
            (with(run(), "alarm", alarm), "STOPPED"),
            (with(run(), "alarm", refusal), "ACTIVE"),
            (with(run(), "stage", json!("setup")), "READY"),
            (with(with(run(), "stage", json!("ended")), "why", json!("completed · motion 3 s")), "PROGRAM_COMPLETED"),
            (with(run(), "stage", json!("ended")), "STOPPED"),
        ] {
            assert_eq!(report(state.clone()).execution(), Some(expected), "{state}");
        }
    }

    #[test]
    fn what_is_not_known_is_unavailable() {
        let axes = [ReportedAxis { letter: 'x', is_linear: true }, ReportedAxis { letter: 'a', is_linear: false }];
        for item in data_items(&axes) {
            match item.observe(&MachineReport::default()) {
                Observation::Value(value) => assert_eq!(value, UNAVAILABLE, "{}", item.key),
                Observation::Condition { level, .. } => assert_eq!(level, UNAVAILABLE, "{}", item.key),
            }
        }
    }

    #[test]
    fn an_alarm_is_a_fault_of_one_condition() {
        for (number, key) in [("E3012", "system"), ("E3009", "communications"), ("E4304", "motion"), ("E3016", "logic")]
        {
            let alarm = json!({"number": number, "cause": "c", "is_refusal": false});
            let report = report(json!({"t": "state", "stage": "job", "alarm": alarm}));
            let faults: Vec<String> = data_items(&[])
                .into_iter()
                .filter(|item| matches!(item.observe(&report), Observation::Condition { level: "FAULT", .. }))
                .map(|item| item.key)
                .collect();
            assert_eq!(faults, [key]);
        }
    }

    #[test]
    fn the_programmed_feed_is_in_millimetres_a_minute() {
        let of = |modal: &str| programmed_feed(&report(json!({"t": "state", "modal": modal})));
        assert_eq!(of("G1 G21 G94 F3000 S0"), Some(3000.0));
        assert_eq!(of("G1 G20 G94 F10"), Some(254.0));
        assert_eq!((of("G1 G21 G93 F10"), of("G1 G21 G94")), (None, None));
    }

    #[test]
    fn the_label_is_the_n_word() {
        for (block, label) in [("N12 G1 X3", Some("12")), ("/ n 7.5G0", Some("7.5")), ("G1 X3", None), ("N", None)] {
            assert_eq!(line_label(block).as_deref(), label, "{block}");
        }
    }
}
