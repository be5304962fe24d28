//! Sends what a machine does to the broker, at most once a second (SHP-2).
//!
//! Invariant: what is not known is sent as not known; nothing comes back.

use std::time::{Duration, Instant};

use async_nats::jetstream::message::StreamMessage;
use retrace_config::NumberedError;
use retrace_journal::Timestamp;
use serde::{Deserialize, Serialize};

use super::broker_connection::{ANSWER_LIMIT, BrokerConnection};
use super::stores::{MACHINES, state_key};
use crate::machine_name::MachineName;
use crate::machine_report::MachineReport;

/// Shortest time between two states.
const INTERVAL: Duration = Duration::from_secs(1);
/// Time after which an unchanged state is sent again: it says that the agent is there.
const REPEAT_INTERVAL: Duration = Duration::from_secs(5);
/// States that are asked for at a time.
const AT_A_TIME: usize = 16;
/// Age of a state from which the machine counts as not reporting.
pub const MAX_STATE_AGE: Duration = Duration::from_secs(15);

/// State of a machine, as it is at the broker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MachineState {
    /// Time of this state, by the machine's clock, in UTC.
    pub when: Timestamp,
    /// Time since which this `state` is so.
    pub since: Timestamp,
    /// The word of the machine's screen, such as `RUNNING` or `HOLD`; `None` where no command operates the machine.
    pub state: Option<String>,
    /// Job of the shop that is running; states of earlier versions have none.
    pub job: Option<String>,
    /// Name of the program.
    pub program: Option<String>,
    /// Program line.
    pub line: Option<u64>,
    /// How much of the program is done, 0 to 100: by its planned time, or by its lines where there is no plan.
    pub done_percent: Option<f64>,
    /// Rate of the motion along the path: 1 as programmed, below 0 while it is retraced.
    pub rate: Option<f64>,
    /// Feed override in percent.
    pub override_percent: Option<f64>,
    /// Path feed in mm/min.
    pub feed: Option<f64>,
    /// Number and cause of the alarm.
    pub alarm: Option<(String, String)>,
    /// Good pieces, and scrap, by the ledger.
    pub pieces: Option<[u64; 2]>,
    /// Number of jobs that can be started, and of those that are interrupted.
    pub jobs: [u64; 2],
    /// Why no job is taken, where none can be: for example because the disk is full.
    pub trouble: Option<String>,
}

impl MachineState {
    /// State of this report.
    #[must_use]
    pub fn of(report: &MachineReport, now: Timestamp) -> Self {
        let number = |value: Option<f64>| value.filter(|value| value.is_finite());
        Self {
            when: now,
            since: now,
            state: report.state("word").map(str::to_owned),
            job: report.shop_job.clone(),
            program: report.program().map(str::to_owned),
            line: report.line(),
            done_percent: done_percent(report),
            rate: number(report.live("rate")).map(|rate| (rate * 100.0).round() / 100.0),
            override_percent: number(report.state_number("override")).map(|share| (share * 1000.0).round() / 10.0),
            feed: number(report.live("feed")).map(f64::round),
            alarm: report.alarm().map(|(number, cause)| (number.to_owned(), cause.to_owned())),
            pieces: report.pieces,
            jobs: [0, 0],
            trouble: None,
        }
    }

    /// State of a machine of which nothing is known.
    #[must_use]
    pub fn not_known(now: Timestamp) -> Self {
        Self { state: Some("not known".into()), ..Self::of(&MachineReport::default(), now) }
    }

    fn differs(&self, other: &Self) -> bool {
        let timeless =
            |state: &Self| Self { when: Timestamp::from_ms(0), since: Timestamp::from_ms(0), ..state.clone() };
        timeless(self) != timeless(other)
    }
}

/// How much of the program is done, 0 to 100. It falls while the path is retraced.
fn done_percent(report: &MachineReport) -> Option<f64> {
    let by_time = || {
        let planned_s = report.program_number("planned_s").filter(|&planned_s| planned_s > 0.0)?;
        // the time that is left is that at the present override
        let factor = report.state_number("override")?.max(0.01);
        Some(1.0 - report.live("left_s")? * factor / planned_s)
    };
    let by_lines = || {
        let lines = report.program_number("lines").filter(|&lines| lines > 0.0)?;
        Some(report.line()?.saturating_sub(1) as f64 / lines)
    };
    let is_completed = report.execution() == Some("PROGRAM_COMPLETED");
    let share = if is_completed { Some(1.0) } else { by_time().or_else(by_lines) };
    share.filter(|share| share.is_finite()).map(|share| (share.clamp(0.0, 1.0) * 1000.0).round() / 10.0)
}

/// Sender of a machine's state.
#[derive(Debug)]
pub struct StateSender {
    machine: MachineName,
    sent: Option<(MachineState, Instant, u64)>,
}

impl StateSender {
    /// Sender of this machine.
    #[must_use]
    pub fn new(machine: MachineName) -> Self {
        Self { machine, sent: None }
    }

    /// Sends a state where it is new, or was not sent for some time. Returns whether it was sent.
    ///
    /// # Errors
    /// `E5035`, `E5038`
    pub fn pass(&mut self, broker: &BrokerConnection, state: &MachineState) -> Result<bool, NumberedError> {
        let connection = broker.connections();
        let mut state = state.clone();
        if let Some((sent, at, over)) = &self.sent {
            if sent.state == state.state {
                state.since = sent.since;
            }
            let is_due = state.differs(sent) || at.elapsed() >= REPEAT_INTERVAL || *over != connection;
            if at.elapsed() < INTERVAL || !is_due {
                return Ok(false);
            }
        }
        let bucket = broker.bucket(MACHINES)?;
        let text = serde_json::to_vec(&state).unwrap_or_default();
        broker.run(ANSWER_LIMIT, "a state", bucket.put(state_key(&self.machine), text.into()))?;
        self.sent = Some((state, Instant::now(), connection));
        Ok(true)
    }
}

/// The states of all machines, by their names.
///
/// # Errors
/// `E5035`, `E5038`
pub fn machine_states(broker: &BrokerConnection) -> Result<Vec<(MachineName, MachineState)>, NumberedError> {
    let stream = broker.stream(&format!("KV_{MACHINES}"))?;
    let subjects = broker.run(ANSWER_LIMIT, "the machines", async {
        use futures_util::TryStreamExt;
        let found = stream.info_with_subjects("$KV.machines.*.state").await.map_err(|error| error.to_string())?;
        found.map_ok(|(subject, _)| subject).try_collect::<Vec<String>>().await.map_err(|error| error.to_string())
    })?;
    let named = subjects.into_iter().filter_map(|subject| {
        let name = subject.strip_prefix("$KV.machines.").and_then(|rest| rest.strip_suffix(".state"))?;
        Some((name.parse::<MachineName>().ok()?, subject))
    });
    // A broker may be far away: several are asked for at a time.
    let messages = broker.run(ANSWER_LIMIT, "the states", async {
        use futures_util::{StreamExt, TryStreamExt};
        let asked = futures_util::stream::iter(named).map(async |(name, subject)| {
            stream.direct_get_last_for_subject(subject).await.map(|message| (name, message))
        });
        asked.buffer_unordered(AT_A_TIME).try_collect::<Vec<_>>().await
    })?;
    // a text of another version is left out
    let read = |(name, message): (MachineName, StreamMessage)| {
        serde_json::from_slice(&message.payload).ok().map(|state| (name, state))
    };
    let mut states: Vec<(MachineName, MachineState)> = messages.into_iter().filter_map(read).collect();
    states.sort_by(|(a, _), (b, _)| a.cmp(b));
    Ok(states)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    fn state(program: Value, more: Value, live: Value) -> MachineState {
        let mut report = MachineReport::default();
        report.shop_job = Some("01a2".into());
        let mut state = json!({"t": "state", "stage": "job", "mode": "run", "hold_reason": "none", "word": "RUNNING",
            "program": program, "override": 0.5, "line": 26});
        state.as_object_mut().expect("an object").extend(more.as_object().expect("an object").clone());
        let mut live = live;
        live["t"] = "live".into();
        report.take(state);
        report.take(live);
        MachineState::of(&report, Timestamp::from_ms(1))
    }

    #[test]
    fn figures_are_those_of_the_report_in_the_units_of_the_table() {
        let planned = json!({"name": "part.ngc", "lines": 100, "planned_s": 200.0});
        let of = |more, live| state(planned.clone(), more, live);
        // 300 s are left at half the feed: 150 s of 200 s
        let half = of(json!({}), json!({"left_s": 300.0, "rate": -0.256}));
        assert_eq!((half.override_percent, half.done_percent, half.rate), (Some(50.0), Some(25.0), Some(-0.26)));
        assert_eq!((half.job.as_deref(), half.line, half.state.as_deref()), (Some("01a2"), Some(26), Some("RUNNING")));
        assert_eq!(of(json!({"override": 1.005}), json!({"left_s": 0.0})).override_percent, Some(100.5));
        // back before the beginning, and feed hold by the override
        assert_eq!(of(json!({}), json!({"left_s": 900.0})).done_percent, Some(0.0));
        assert_eq!(of(json!({"override": 0.0}), json!({"left_s": 15_000.0})).done_percent, Some(25.0));
        let by_lines = json!({"name": "part.ngc", "lines": 100, "planned_s": null});
        assert_eq!(state(by_lines.clone(), json!({}), json!({"left_s": null})).done_percent, Some(25.0));
        let ended = state(by_lines, json!({"hold_reason": "end of program"}), json!({}));
        assert_eq!(ended.done_percent, Some(100.0));
        let none = json!({"name": "", "lines": 0, "planned_s": null});
        assert_eq!(state(none, json!({}), json!({})).done_percent, None);
    }

    #[test]
    fn a_state_of_before_the_job_is_read() {
        let old = json!({"when": "1970-01-01T00:00:00.001Z", "since": "1970-01-01T00:00:00.001Z", "state": "RUNNING",
            "program": "part.ngc", "line": 7, "done_percent": null, "rate": null, "override_percent": 100.0,
            "feed": null, "alarm": null, "pieces": [1, 0], "jobs": [0, 0], "trouble": null});
        let read: MachineState = serde_json::from_value(old).expect("a state");
        assert_eq!((read.job, read.line), (None, Some(7)));
    }
}
