//! The contours of a running job as the console reports them: the answer to the word `contours`, and the progress of
//! the cut once a second (CUT-12, CUT-27).
//!
//! Invariant: what is not known is null, never 0; a list of any length is written row by row.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use retrace_config::MachineConfig;
use retrace_controller::{
    ContourList, ContourRow, ContourStates, CutterState, Event, EventKind, PeriodRecord, Telemetry,
};
use serde_json::{Map, Value, json};

use crate::contour_report;

/// Watches the contours of a job.
#[derive(Debug)]
pub struct CutProgress<'m> {
    machine: &'m MachineConfig,
    /// Contours of the plan, where they are known.
    planned: Option<Arc<ContourList<9>>>,
    states: ContourStates,
    /// State of each cutter that was reported, by the channel that fires it.
    cutters: BTreeMap<u8, CutterState>,
    /// Period in which each output was switched on, of those that are on.
    on_since: BTreeMap<u8, u64>,
    /// Channel of the cutter whose state changed last.
    channel: Option<u8>,
    /// Last period, and the period of the last report.
    period: u64,
    reported: u64,
}

impl<'m> CutProgress<'m> {
    /// Watches the contours of a job on this machine.
    pub fn new(machine: &'m MachineConfig, planned: Option<Arc<ContourList<9>>>) -> Self {
        Self {
            machine,
            planned,
            states: ContourStates::default(),
            cutters: BTreeMap::new(),
            on_since: BTreeMap::new(),
            channel: None,
            period: 0,
            reported: 0,
        }
    }

    /// Applies a message of the job.
    pub fn observe<const A: usize>(&mut self, message: &Telemetry<A>) {
        self.states.observe(message);
        match message {
            Telemetry::Period(period) => self.period = period.period,
            Telemetry::Output(change) if change.value == 0 => drop(self.on_since.remove(&change.channel)),
            Telemetry::Output(change) => _ = self.on_since.entry(change.channel).or_insert(self.period),
            Telemetry::Event(Event { kind: EventKind::CutterState { channel, state, .. }, .. }) => {
                self.cutters.insert(*channel, *state);
                self.channel = Some(*channel);
            }
            _ => {}
        }
    }

    /// Progress of the cut as one JSON object, once a second of machine time while a contour is being cut.
    pub fn due_json<const A: usize>(&mut self, period: &PeriodRecord<A>) -> Option<Value> {
        let (contour, cut_mm) = self.states.current()?;
        let since_s = period.period.saturating_sub(self.reported) as f64 * self.machine.period_s();
        if since_s < 1.0 && self.reported != 0 || period.off_path {
            return None;
        }
        self.reported = period.period;
        let channel = self.channel?;
        let proof = self.machine.cutter_of(channel).and_then(|cutter| cutter.proof.as_ref());
        let lit = self.on_since.get(&channel).map(|&since| period.period.saturating_sub(since) as f64);
        let planned = self.planned.as_deref();
        let mut value = json!({
            "event": "cut_progress",
            "channel": channel,
            "name": self.machine.channel_name(channel),
            "state": self.cutters.get(&channel).copied().unwrap_or_default().name(),
            "ok": proof.map(|proof| period.inputs >> (proof.input & 15) & 1 == 1),
            "lit_s": lit.map_or(0.0, |periods| periods * self.machine.period_s()),
            "contour": contour,
            "contour_count": planned.map(|list| list.count),
            "cut_mm": cut_mm,
            "length_mm": planned.and_then(|list| list.contour(contour)).map(|contour| contour.length_mm),
            "job_cut_mm": self.states.cut_mm(),
            "job_length_mm": planned.map(ContourList::cut_mm),
        });
        if let Value::Object(fields) = &mut value {
            let time_s = period.period as f64 * self.machine.period_s();
            fields.insert("period".into(), period.period.into());
            fields.insert("time_s".into(), json!(time_s));
            fields.insert("record".into(), period.place.record.number().into());
            fields.insert("fraction".into(), period.place.fraction.into());
            fields.insert("line".into(), period.line.into());
        }
        Some(value)
    }

    /// The list of all contours, where this event asks for it.
    pub fn list<'a>(&'a self, event: &'a Event) -> Option<ContourAnswer<'a>> {
        let asks = event.kind == EventKind::Operator(retrace_controller::OperatorCommand::Contours);
        asks.then_some(ContourAnswer { progress: self, event })
    }

    fn rows(&self) -> impl Iterator<Item = ContourRow<'_>> {
        let planned = self.planned.as_deref();
        self.states.numbers(planned).into_iter().filter_map(move |number| self.states.row(number, planned))
    }
}

/// The list of all contours with their states.
#[derive(Debug)]
pub struct ContourAnswer<'a> {
    progress: &'a CutProgress<'a>,
    event: &'a Event,
}

impl ContourAnswer<'_> {
    /// The list for a person, a line for each contour.
    pub fn text(&self) -> ContourAnswerText<'_> {
        ContourAnswerText(self)
    }

    /// The list as one JSON object.
    pub fn json(&self) -> ContourAnswerJson<'_> {
        ContourAnswerJson(self)
    }
}

/// See [`ContourAnswer::json`].
#[derive(Debug)]
pub struct ContourAnswerJson<'a>(&'a ContourAnswer<'a>);

impl fmt::Display for ContourAnswerJson<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ContourAnswer { progress, event } = self.0;
        let planned = progress.planned.as_deref();
        let mut head = json!({
            "event": "contours",
            "contour": progress.states.current().map(|(number, _)| number),
            "contour_count": planned.map(|list| list.count),
            "job_cut_mm": progress.states.cut_mm(),
            "job_length_mm": planned.map(ContourList::cut_mm),
            "period": event.period,
            "time_s": event.time_s,
            "record": event.place.record.number(),
            "fraction": event.place.fraction,
            "line": event.line,
        })
        .to_string();
        // The rows follow within the object: a value that holds all of them would take many times the room.
        head.pop();
        write!(f, "{head},\"contours\":[")?;
        for (number, row) in progress.rows().enumerate() {
            let comma = if number == 0 { "" } else { "," };
            write!(f, "{comma}{}", Value::Object(row_json(&row, progress.machine)))?;
        }
        write!(f, "]}}")
    }
}

fn row_json(row: &ContourRow<'_>, machine: &MachineConfig) -> Map<String, Value> {
    let mut fields = row.planned.map_or_else(
        || {
            let unknown = ["subprogram", "location", "cutter", "material", "length_mm", "pierce_mm", "end_mm"];
            unknown.into_iter().map(|key| (key.to_owned(), Value::Null)).collect()
        },
        |planned| contour_report::contour_json(planned, machine),
    );
    fields.insert("number".into(), row.number.into());
    fields.insert("line".into(), row.line.into());
    fields.insert("state".into(), row.state.name().into());
    fields.insert("cut_mm".into(), json!(row.cut_mm));
    fields.insert("not_cut_mm".into(), json!(row.not_cut_mm));
    fields
}

/// See [`ContourAnswer::text`].
#[derive(Debug)]
pub struct ContourAnswerText<'a>(&'a ContourAnswer<'a>);

impl fmt::Display for ContourAnswerText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let progress = self.0.progress;
        let count = progress.planned.as_ref().map_or("number not known".to_owned(), |list| list.count.to_string());
        write!(f, "  contours: {count}")?;
        for row in progress.rows() {
            let what = match row.planned {
                Some(planned) => contour_report::contour_text(planned, progress.machine),
                None => format!("{}: line {}", row.number, row.line),
            };
            write!(f, "\n  contour {what}: {}", row.state_text(3))?;
        }
        Ok(())
    }
}
