//! Sends what a machine does to the broker, at most once a second (SHP-2).
//!
//! Invariant: what is not known is sent as not known; nothing comes back.

use std::time::{Duration, Instant};

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
    /// Name of the program.
    pub program: Option<String>,
    /// Program line.
    pub line: Option<u64>,
    /// How much of the program is done, 0 to 100.
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
            program: report.program().map(str::to_owned),
            line: report.line(),
            done_percent: done_percent(report.live("run_s"), report.live("left_s")),
            rate: number(report.live("rate")).map(|rate| (rate * 100.0).round() / 100.0),
            override_percent: number(report.state_number("override")),
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

/// Share of the program's time that has passed.
fn done_percent(run_s: Option<f64>, left_s: Option<f64>) -> Option<f64> {
    let (run_s, left_s) = (run_s?, left_s?);
    let total = run_s + left_s;
    (total > 0.0 && total.is_finite()).then(|| (run_s / total * 1000.0).round() / 10.0)
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
    let mut states = Vec::new();
    for subject in subjects {
        let name = subject.strip_prefix("$KV.machines.").and_then(|rest| rest.strip_suffix(".state"));
        let Some(name) = name.and_then(|name| name.parse::<MachineName>().ok()) else { continue };
        let last = stream.direct_get_last_for_subject(subject.clone());
        let message = broker.run(ANSWER_LIMIT, "a state", last)?;
        // a text of another version is left out
        states.extend(serde_json::from_slice(&message.payload).ok().map(|state| (name, state)));
    }
    states.sort_by(|(a, _), (b, _): &(MachineName, MachineState)| a.cmp(b));
    Ok(states)
}
