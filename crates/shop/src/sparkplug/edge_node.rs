//! The edge node of a machine: what it publishes, and what it makes of messages (SHP-27).
//!
//! It has no connection and no clock. The rules are those of the Sparkplug specification 3.0, chapters 5 and 6.
//!
//! ```text
//!  connect ─> Connecting ─ subscribed ─> Waiting ─ primary host online ─> birth ─> Born ─> data …
//!     ▲                                                                             │
//!     └──────────────── lost, or the primary host goes offline: death ──────────────┘
//! ```
//!
//! Invariant: after a will, the first message is a birth with its `bdSeq` and `seq` 0; every message after it has the
//! next `seq`. A message that is received can ask for a birth, and for nothing else.

use std::time::Duration;

use serde_json::Value;

use super::node_metric::NodeMetric;
use super::payload::{Datatype, Payload, PayloadMetric, PayloadValue};
use super::value_history::ValueHistory;

/// Shortest interval between two messages.
pub(super) const MIN_INTERVAL: Duration = Duration::from_millis(500);
/// Name of the metric that counts connections.
const BD_SEQ: &str = "bdSeq";
/// Name of the only command.
const REBIRTH: &str = "Node Control/Rebirth";

/// Names of an edge node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeName {
    /// Group.
    pub group: String,
    /// Edge node: the machine.
    pub node: String,
    /// Host application that is awaited before each birth.
    pub primary_host: Option<String>,
}

/// A message to be published. None is retained.
#[derive(Clone, Debug, PartialEq)]
pub struct Publication {
    /// Topic.
    pub topic: String,
    /// Payload.
    pub payload: Vec<u8>,
    /// Quality of service: 1 of a death, otherwise 0.
    pub qos: u8,
}

/// What came of the messages that were received.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReceivedCounts {
    /// Requests of a birth.
    pub rebirths: u64,
    /// Messages that were ignored.
    pub ignored: u64,
}

/// What the connection is to do next.
#[derive(Clone, Debug, PartialEq)]
pub enum NodeStep {
    /// Nothing.
    Idle,
    /// Publish the message.
    Publish(Publication),
    /// Publish the death, and disconnect: the primary host is offline.
    Disconnect(Publication),
}

/// Phase of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// There is no connection on which anything can be published.
    Away,
    /// Subscribed, and not born yet.
    Waiting,
    /// Born.
    Born,
}

/// Edge node of one machine.
#[derive(Clone, Debug)]
pub struct EdgeNode {
    name: NodeName,
    phase: Phase,
    /// `bdSeq` of the last connection.
    bd_seq: Option<u8>,
    /// `seq` of the next message.
    seq: u8,
    /// The metrics of the last birth, with the values that were published last.
    published: Vec<NodeMetric>,
    published_at: Option<Duration>,
    /// Values of the time in which nothing could be published.
    history: ValueHistory,
    is_rebirth_due: bool,
    host_is_online: bool,
    host_timestamp: Option<u64>,
    received: ReceivedCounts,
}

impl EdgeNode {
    /// Edge node whose last connection had this `bdSeq`.
    #[must_use]
    pub fn new(name: NodeName, bd_seq: Option<u8>) -> Self {
        Self {
            name,
            phase: Phase::Away,
            bd_seq,
            seq: 0,
            published: Vec::new(),
            published_at: None,
            history: ValueHistory::default(),
            is_rebirth_due: false,
            host_is_online: false,
            host_timestamp: None,
            received: ReceivedCounts::default(),
        }
    }

    /// Begins a connection with the next `bdSeq`; returns its will.
    pub fn connect(&mut self, time_ms: u64) -> Publication {
        self.bd_seq = Some(self.bd_seq.map_or(0, |last| last.wrapping_add(1)));
        self.lost();
        self.death(time_ms)
    }

    /// The connection could not be begun: its `bdSeq` was not sent to anybody, and is that of the next one.
    pub fn connect_failed(&mut self) {
        self.bd_seq = self.bd_seq.and_then(|number| number.checked_sub(1).or(Some(255)));
        self.lost();
    }

    /// The connection stands, and what is to be subscribed to is.
    pub fn subscribed(&mut self) {
        self.phase = Phase::Waiting;
    }

    /// The connection is gone; what the primary host was is not known any more.
    pub fn lost(&mut self) {
        (self.phase, self.is_rebirth_due) = (Phase::Away, false);
        (self.host_is_online, self.host_timestamp) = (false, None);
    }

    /// Topics to be subscribed to.
    #[must_use]
    pub fn subscriptions(&self) -> Vec<String> {
        let host = self.name.primary_host.as_ref().map(|host| format!("spBv1.0/STATE/{host}"));
        [self.topic("NCMD")].into_iter().chain(host).collect()
    }

    /// `bdSeq` of the last connection.
    #[must_use]
    pub fn bd_seq(&self) -> Option<u8> {
        self.bd_seq
    }

    /// Whether a birth was published on this connection.
    #[must_use]
    pub fn is_born(&self) -> bool {
        self.phase == Phase::Born
    }

    /// Whether the birth waits for the primary host.
    #[must_use]
    pub fn awaits_host(&self) -> bool {
        self.phase == Phase::Waiting && self.name.primary_host.is_some() && !self.host_is_online
    }

    /// What came of the messages that were received.
    #[must_use]
    pub fn received(&self) -> ReceivedCounts {
        self.received
    }

    /// Takes a message: a request of a birth, the state of the primary host, or one that is ignored.
    pub fn receive(&mut self, topic: &str, payload: &[u8]) {
        if topic == self.topic("NCMD") && is_rebirth(payload) {
            self.received.rebirths += 1;
            self.is_rebirth_due = true;
        } else if self.is_host_topic(topic)
            && let Some((is_online, timestamp)) = host_state(payload)
            && self.host_timestamp.is_none_or(|known| timestamp >= known)
        {
            (self.host_is_online, self.host_timestamp) = (is_online, Some(timestamp));
        } else {
            self.received.ignored += 1;
        }
    }

    /// What is to be published now, if anything. `now` is any clock that does not go back; `time_ms` is ms since 1970.
    pub fn step(&mut self, now: Duration, time_ms: u64, metrics: Vec<NodeMetric>) -> NodeStep {
        let host_is_away = self.name.primary_host.is_some() && !self.host_is_online;
        if self.phase == Phase::Born && host_is_away {
            let death = self.death(time_ms);
            self.lost();
            return NodeStep::Disconnect(death);
        }
        if self.phase == Phase::Away || host_is_away {
            self.history.record(now, time_ms, &self.published, &metrics);
            return NodeStep::Idle;
        }
        let is_due = self.published_at.is_none_or(|at| now.saturating_sub(at) >= MIN_INTERVAL);
        if self.phase == Phase::Waiting || is_due && (self.is_rebirth_due || self.has_other_metrics(&metrics)) {
            return NodeStep::Publish(self.birth(now, time_ms, metrics));
        }
        let changed = if is_due { self.take_changes(time_ms, metrics) } else { Vec::new() };
        let historical = if is_due { self.history.take(time_ms, &self.published) } else { Vec::new() };
        let changed = [historical, changed].concat();
        if changed.is_empty() {
            return NodeStep::Idle;
        }
        NodeStep::Publish(self.publish("NDATA", now, time_ms, changed))
    }

    /// The death of this connection, which is its will, too.
    #[must_use]
    pub fn death(&self, time_ms: u64) -> Publication {
        let payload = Payload { timestamp: Some(time_ms), metrics: vec![self.bd_seq_metric(time_ms)], seq: None };
        Publication { topic: self.topic("NDEATH"), payload: payload.to_bytes(), qos: 1 }
    }

    fn birth(&mut self, now: Duration, time_ms: u64, metrics: Vec<NodeMetric>) -> Publication {
        (self.phase, self.seq, self.is_rebirth_due) = (Phase::Born, 0, false);
        self.history.pause();
        // The specification wants these two without an alias: a host names them in its commands and in the will.
        let rebirth = PayloadMetric {
            name: Some(REBIRTH.into()),
            timestamp: Some(time_ms),
            datatype: Some(Datatype::Boolean as u32),
            value: Some(PayloadValue::Boolean(false)),
            ..PayloadMetric::default()
        };
        let mut all = vec![self.bd_seq_metric(time_ms), rebirth];
        all.extend(metrics.iter().zip(1..).map(|(metric, alias)| PayloadMetric {
            name: Some(metric.name.clone()),
            datatype: Some(metric.datatype as u32),
            ..present(alias, time_ms, metric)
        }));
        self.published = metrics;
        self.publish("NBIRTH", now, time_ms, all)
    }

    /// The metrics that have changed, which are the published ones from then on.
    fn take_changes(&mut self, time_ms: u64, metrics: Vec<NodeMetric>) -> Vec<PayloadMetric> {
        let mut changed = Vec::new();
        for ((published, metric), alias) in self.published.iter_mut().zip(metrics).zip(1..) {
            if published.value != metric.value {
                changed.push(present(alias, time_ms, &metric));
                *published = metric;
            }
        }
        changed
    }

    fn publish(&mut self, kind: &str, now: Duration, time_ms: u64, metrics: Vec<PayloadMetric>) -> Publication {
        let payload = Payload { timestamp: Some(time_ms), metrics, seq: Some(self.seq.into()) };
        self.seq = self.seq.wrapping_add(1);
        self.published_at = Some(now);
        Publication { topic: self.topic(kind), payload: payload.to_bytes(), qos: 0 }
    }

    /// Whether these are not the metrics of the last birth: the machine has other axes.
    fn has_other_metrics(&self, metrics: &[NodeMetric]) -> bool {
        let names = self.published.iter().map(|metric| &metric.name);
        !names.eq(metrics.iter().map(|metric| &metric.name))
    }

    fn bd_seq_metric(&self, time_ms: u64) -> PayloadMetric {
        PayloadMetric {
            name: Some(BD_SEQ.into()),
            timestamp: Some(time_ms),
            datatype: Some(Datatype::Int64 as u32),
            value: Some(PayloadValue::Long(self.bd_seq.unwrap_or_default().into())),
            ..PayloadMetric::default()
        }
    }

    fn topic(&self, kind: &str) -> String {
        format!("spBv1.0/{}/{kind}/{}", self.name.group, self.name.node)
    }

    fn is_host_topic(&self, topic: &str) -> bool {
        self.name.primary_host.as_deref().is_some_and(|host| topic.strip_prefix("spBv1.0/STATE/") == Some(host))
    }
}

/// Value of a metric, by its alias.
fn present(alias: u64, time_ms: u64, metric: &NodeMetric) -> PayloadMetric {
    PayloadMetric {
        alias: Some(alias),
        timestamp: Some(time_ms),
        is_null: metric.value.is_none().then_some(true),
        value: metric.value.clone(),
        ..PayloadMetric::default()
    }
}

/// Whether a command asks for a birth.
fn is_rebirth(payload: &[u8]) -> bool {
    Payload::from_bytes(payload).is_some_and(|payload| {
        let is_true = |metric: &PayloadMetric| metric.value == Some(PayloadValue::Boolean(true));
        payload.metrics.iter().any(|metric| metric.name.as_deref() == Some(REBIRTH) && is_true(metric))
    })
}

/// State of a host application: whether it is online, and since when.
fn host_state(payload: &[u8]) -> Option<(bool, u64)> {
    let state: Value = serde_json::from_slice(payload).ok()?;
    Some((state["online"].as_bool()?, state["timestamp"].as_u64()?))
}
