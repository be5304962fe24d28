//! The metrics of a machine: name, type and present value (SHP-27).
//!
//! Invariant: names are unique, their order depends on the axes alone, and what is not known has no value: never 0.

use super::payload::{Datatype, PayloadValue};
use crate::machine_report::{MachineReport, ReportedAxis};

/// Longest text, in characters; the rest of a longer one is left out.
const MAX_TEXT: usize = 1000;

/// A metric of a machine.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeMetric {
    /// Name.
    pub name: String,
    /// Type of its values.
    pub datatype: Datatype,
    /// Present value; none where it is not known.
    pub value: Option<PayloadValue>,
}

/// The metrics of a machine with these axes, by this report.
#[must_use]
pub fn node_metrics(report: &MachineReport, axes: &[ReportedAxis]) -> Vec<NodeMetric> {
    let is_present = report.is_available();
    let present = |value: Option<PayloadValue>| value.filter(|_| is_present);
    let mut metrics = vec![
        metric("state", Datatype::String, present(report.execution().and_then(text))),
        metric("mode", Datatype::String, present(report.state("mode").and_then(text))),
        metric("program", Datatype::String, present(report.program().and_then(text))),
        metric("job", Datatype::String, report.shop_job.as_deref().and_then(text)),
        metric("line", Datatype::Int64, present(report.line().and_then(count))),
        metric("block", Datatype::String, present(report.block().and_then(text))),
        metric("feed/actual", Datatype::Double, present(report.live("feed").and_then(number))),
        metric("feed/override", Datatype::Double, present(report.state_number("override").and_then(percent))),
        metric("rate", Datatype::Double, present(report.live("rate").and_then(number))),
        metric("reverse", Datatype::Boolean, present(reverse(report))),
    ];
    for (index, axis) in axes.iter().enumerate() {
        for (of, suffix) in [("mm", "machine"), ("work", "work")] {
            let name = format!("axis/{}/{suffix}", axis.letter);
            metrics.push(metric(&name, Datatype::Double, present(report.position(of, index).and_then(number))));
        }
    }
    let alarm = report.alarm();
    metrics.extend([
        metric("spindle/speed", Datatype::Double, present(report.live("rpm").and_then(number))),
        metric("tool", Datatype::Int64, present(report.state_number("tool").and_then(whole))),
        metric("part_count", Datatype::Int64, report.pieces.and_then(|[good, _]| count(good))),
        metric("alarm/number", Datatype::String, present(alarm.and_then(|(number, _)| text(number)))),
        metric("alarm/text", Datatype::String, present(alarm.and_then(|(_, cause)| text(cause)))),
        // The socket of the state does not report these two.
        metric("retraced_s", Datatype::Double, report.live("retraced_s").and_then(number)),
        metric("held_s", Datatype::Double, report.live("held_s").and_then(number)),
        metric("version", Datatype::String, text(env!("CARGO_PKG_VERSION"))),
    ]);
    metrics
}

fn metric(name: &str, datatype: Datatype, value: Option<PayloadValue>) -> NodeMetric {
    NodeMetric { name: name.into(), datatype, value }
}

fn text(text: &str) -> Option<PayloadValue> {
    (!text.is_empty()).then(|| PayloadValue::Text(text.chars().take(MAX_TEXT).collect()))
}

fn number(number: f64) -> Option<PayloadValue> {
    number.is_finite().then_some(PayloadValue::Double(number))
}

fn percent(ratio: f64) -> Option<PayloadValue> {
    number((ratio * 1e4).round() / 100.0)
}

fn count(count: u64) -> Option<PayloadValue> {
    i64::try_from(count).is_ok().then_some(PayloadValue::Long(count))
}

/// A number that is whole, such as that of a tool.
fn whole(number: f64) -> Option<PayloadValue> {
    let is_whole = number.fract() == 0.0 && number.abs() < 1e15;
    is_whole.then_some(PayloadValue::Long((number as i64).cast_unsigned()))
}

/// Whether the path is being retraced.
fn reverse(report: &MachineReport) -> Option<PayloadValue> {
    let rate = report.live("rate")?;
    Some(PayloadValue::Boolean(rate < 0.0 && !report.is_at_rest()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    const AXES: [ReportedAxis; 2] =
        [ReportedAxis { letter: 'x', is_linear: true }, ReportedAxis { letter: 'a', is_linear: false }];

    #[test]
    fn what_is_not_reported_has_no_value() {
        let unknown = node_metrics(&MachineReport::default(), &AXES);
        let known: Vec<&str> =
            unknown.iter().filter(|metric| metric.value.is_some()).map(|metric| metric.name.as_str()).collect();
        assert_eq!(known, ["version"]);
        let mut names: Vec<&str> = unknown.iter().map(|metric| metric.name.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), unknown.len());
    }

    #[test]
    fn the_values_are_those_of_the_report() {
        let mut report = MachineReport::default();
        report.pieces = Some([3, 1]);
        report.take(json!({
            "t": "state", "stage": "job", "mode": "run", "hold_reason": "none", "program": {"name": "part.ngc"},
            "line": 12, "override": 0.557, "tool": 4,
            "alarm": {"number": "E3012", "cause": "open", "is_refusal": false},
        }));
        report.take(json!({
            "t": "live", "mm": [1.5, null], "work": [-1.5, 2], "feed": 600.0, "rate": -0.5, "rpm": null,
            "at_rest": false, "retraced_s": 1.5, "held_s": 0.0,
        }));
        report.take(json!({"t": "block", "text": "G1 X1", "line": 12}));
        report.shop_job = Some("0192".into());
        let found = |name: &str| {
            let all = node_metrics(&report, &AXES);
            all.into_iter().find(|metric| metric.name == name).expect("a metric").value
        };
        let text = |text: &str| Some(PayloadValue::Text(text.into()));
        for (name, value) in [
            ("state", text("STOPPED")),
            ("mode", text("run")),
            ("program", text("part.ngc")),
            ("job", text("0192")),
            ("line", Some(PayloadValue::Long(12))),
            ("block", text("G1 X1")),
            ("feed/actual", Some(PayloadValue::Double(600.0))),
            ("feed/override", Some(PayloadValue::Double(55.7))),
            ("rate", Some(PayloadValue::Double(-0.5))),
            ("reverse", Some(PayloadValue::Boolean(true))),
            ("axis/x/machine", Some(PayloadValue::Double(1.5))),
            ("axis/a/machine", None),
            ("axis/a/work", Some(PayloadValue::Double(2.0))),
            ("spindle/speed", None),
            ("tool", Some(PayloadValue::Long(4))),
            ("part_count", Some(PayloadValue::Long(3))),
            ("alarm/number", text("E3012")),
            ("alarm/text", text("open")),
            ("retraced_s", Some(PayloadValue::Double(1.5))),
            ("held_s", Some(PayloadValue::Double(0.0))),
        ] {
            assert_eq!(found(name), value, "{name}");
        }
    }
}
