//! Session of an edge node: connects it to its broker again and again, and publishes what it has to say (SHP-18).
//!
//! Invariant: a `bdSeq` is durable before it is sent to the broker, and each connection has a new one.

use std::fs;
use std::io::ErrorKind;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use retrace_config::NumberedError;
use retrace_journal::Timestamp;
use retrace_journal::state_file::{self, FileAccess};
use rustls::ClientConfig;

use super::edge_node::{EdgeNode, NodeName, NodeStep, Publication, ReceivedCounts};
use super::mqtt_connection::{MqttConnection, MqttEnd, MqttEvent, MqttOptions, MqttVersion};
use super::node_metric::node_metrics;
use super::reconnection_delay::{ReconnectionDelay, random};
use super::tls;
use crate::machine_folder::{MachineFolder, unusable};
use crate::machine_report::{MachineReport, ReportedAxis};
use crate::sparkplug_config::SparkplugConfig;

/// Longest wait for the broker to take the death of a node that ends.
const MAX_END_WAIT: Duration = Duration::from_secs(2);
/// A connection that has lasted as long was a good one.
const GOOD_CONNECTION: Duration = Duration::from_secs(10);
/// Most messages that are taken in one step.
const MAX_TAKEN: usize = 256;

/// What the operator is to know.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SparkplugNotice {
    /// The birth was published on a connection of this version, with this `bdSeq`.
    Born(MqttVersion, u8),
    /// The birth waits for this host application.
    AwaitsHost(String),
    /// The primary host application is offline: the node has left the broker.
    HostOffline(String),
    /// The broker is away, or refuses something.
    Error(NumberedError),
}

/// Session of the edge node of one machine.
#[expect(missing_debug_implementations, reason = "it has the password")]
pub struct SparkplugSession {
    config: SparkplugConfig,
    client: String,
    user: Option<(String, String)>,
    tls: Option<Arc<ClientConfig>>,
    node: EdgeNode,
    bd_seq_file: PathBuf,
    version: MqttVersion,
    /// Whether the broker has accepted a connection of this version: it is not left then.
    version_is_known: bool,
    connection: Option<MqttConnection>,
    connected_at: Option<Instant>,
    begun: Instant,
    delay: ReconnectionDelay,
    retry_at: Instant,
    notices: Vec<SparkplugNotice>,
    /// The last notice, which is not repeated.
    noticed: Option<SparkplugNotice>,
}

impl SparkplugSession {
    /// Session of a machine; nothing is connected yet.
    ///
    /// # Errors
    /// `E5023` for the root certificate and the password; `E5010` where the folder of the machine cannot be read.
    pub fn new(config: SparkplugConfig, machine: &MachineFolder) -> Result<Self, NumberedError> {
        let password = config.password_file.as_deref().map(tls::password).transpose()?.unwrap_or_default();
        let bd_seq_file = machine.birth_death_number();
        let name = NodeName {
            group: config.group.clone(),
            node: machine.name().to_string(),
            primary_host: config.primary_host.clone(),
        };
        let now = Instant::now();
        Ok(Self {
            client: format!("retrace-{}-{}", name.group, name.node),
            user: config.user.clone().map(|user| (user, password)),
            tls: match config.ca.as_deref() {
                Some(ca) => {
                    let identity = config.identity.as_ref().map(|(certificate, key)| (&**certificate, &**key));
                    Some(tls::client_config(ca, identity)?)
                }
                None => None,
            },
            node: EdgeNode::new(name, read_bd_seq(&bd_seq_file)?),
            config,
            bd_seq_file,
            version: MqttVersion::V5,
            version_is_known: false,
            connection: None,
            connected_at: None,
            begun: now,
            delay: ReconnectionDelay::default(),
            retry_at: now,
            notices: Vec::new(),
            noticed: None,
        })
    }

    /// Publishes what has changed in the report, and takes what has come. `axes` are those of the machine. Returns what
    /// the operator is to know.
    ///
    /// # Errors
    /// `E5010` where the number of the connection cannot be stored.
    pub fn serve(
        &mut self,
        report: &MachineReport,
        axes: &[ReportedAxis],
    ) -> Result<Vec<SparkplugNotice>, NumberedError> {
        if self.connection.is_none() && Instant::now() >= self.retry_at {
            self.connect()?;
        }
        for _ in 0..MAX_TAKEN {
            let Some(event) = self.connection.as_ref().and_then(MqttConnection::event) else { break };
            self.take(event);
        }
        if let Some(host) = self.config.primary_host.clone().filter(|_| self.node.awaits_host()) {
            self.notice(SparkplugNotice::AwaitsHost(host));
        }
        let was_born = self.node.is_born();
        match self.node.step(self.begun.elapsed(), time_ms(), node_metrics(report, axes)) {
            NodeStep::Idle => {}
            NodeStep::Publish(message) => {
                if !self.connection.as_ref().is_some_and(|connection| connection.publish(message)) {
                    self.ended(MqttEnd::Lost, "the broker takes no messages");
                } else if !was_born {
                    self.notice(SparkplugNotice::Born(self.version, self.node.bd_seq().unwrap_or_default()));
                }
            }
            NodeStep::Disconnect(death) => {
                self.leave(death);
                self.notice(SparkplugNotice::HostOffline(self.config.primary_host.clone().unwrap_or_default()));
                self.again();
            }
        }
        Ok(std::mem::take(&mut self.notices))
    }

    /// Publishes the death, and disconnects; waits for the broker, but not for long. Returns what the operator is to
    /// know.
    pub fn end(&mut self) -> Vec<SparkplugNotice> {
        if self.connected_at.is_some() {
            self.leave(self.node.death(time_ms()));
        }
        self.connection = None;
        std::mem::take(&mut self.notices)
    }

    /// What came of the messages that were received.
    #[must_use]
    pub fn received(&self) -> ReceivedCounts {
        self.node.received()
    }

    fn connect(&mut self) -> Result<(), NumberedError> {
        let will = self.node.connect(time_ms());
        let number = format!("bdSeq {}\n", self.node.bd_seq().unwrap_or_default());
        state_file::replace(&self.bd_seq_file, number.as_bytes(), FileAccess::Private)
            .map_err(|error| unusable(&self.bd_seq_file, &error))?;
        let begun = MqttConnection::begin(MqttOptions {
            version: self.version,
            client: self.client.clone(),
            host: self.config.url_host(),
            port: self.config.port,
            user: self.user.clone(),
            tls: self.tls.clone(),
            will,
        });
        match begun {
            Ok(connection) => self.connection = Some(connection),
            Err(error) => self.ended(MqttEnd::NotReached, &error.to_string()),
        }
        Ok(())
    }

    fn take(&mut self, event: MqttEvent) {
        match event {
            MqttEvent::Connected => {
                (self.connected_at, self.version_is_known) = (Some(Instant::now()), true);
                let topics = self.node.subscriptions();
                if !self.connection.as_ref().is_some_and(|connection| connection.subscribe(topics)) {
                    self.ended(MqttEnd::Lost, "the broker takes no messages");
                }
            }
            MqttEvent::Subscribed => self.node.subscribed(),
            MqttEvent::SubscriptionRefused(reason) => {
                let topics = self.node.subscriptions().join(", ");
                self.leave(self.node.death(time_ms()));
                let what = format!("the broker {} refuses to send {topics}: {reason}", self.config.address());
                let remedy = "allow this user to read the topics; docs/shop.md lists them";
                self.notice(SparkplugNotice::Error(NumberedError::new("E5025", what, remedy)));
                self.again();
            }
            MqttEvent::Message(topic, payload) => self.node.receive(&topic, &payload),
            // Deaths alone are acknowledged.
            MqttEvent::Acknowledged(_) => {}
            MqttEvent::Ended(end, why) => self.ended(end, &why),
        }
    }

    /// The connection is over.
    fn ended(&mut self, end: MqttEnd, why: &str) {
        match end {
            MqttEnd::NotReached => self.node.connect_failed(),
            MqttEnd::NoAnswer if !self.version_is_known => self.version = self.version.other(),
            MqttEnd::NoAnswer | MqttEnd::Refused | MqttEnd::Lost => {}
        }
        let address = self.config.address();
        let error = if end == MqttEnd::Refused {
            let remedy = "check `user` and `password_file`, and what the broker allows this user";
            NumberedError::new("E5024", format!("the broker {address} refuses the connection: {why}"), remedy)
        } else {
            let remedy = "nothing needs to be done at the machine; it is tried again, at least every 30 s";
            NumberedError::new("E5027", format!("the broker {address} is away: {why}"), remedy)
        };
        // The first attempt with the older version comes before it is said that the broker is away.
        if end != MqttEnd::NoAnswer || self.version_is_known || self.version == MqttVersion::V5 {
            self.notice(SparkplugNotice::Error(error));
        }
        self.again();
    }

    /// Forgets the connection, and waits before the next one.
    fn again(&mut self) {
        self.connection = None;
        self.node.lost();
        if self.connected_at.take().is_some_and(|at| at.elapsed() >= GOOD_CONNECTION) {
            self.delay.reset();
        }
        self.retry_at = Instant::now() + self.delay.next(random());
    }

    /// Publishes the death, waits until the broker has it, and disconnects in order: the will is not published.
    fn leave(&mut self, death: Publication) {
        let Some(connection) = self.connection.take() else { return };
        let until = Instant::now() + MAX_END_WAIT;
        let left = || until.saturating_duration_since(Instant::now());
        let mut goes_on = connection.publish(death);
        while goes_on && !left().is_zero() {
            goes_on = match connection.wait(left()) {
                Some(MqttEvent::Acknowledged(refusal)) => {
                    if let Some(reason) = refusal {
                        let what = format!("the broker {} refuses what is published: {reason}", self.config.address());
                        let remedy = "allow this user to write the topics; docs/shop.md lists them";
                        self.notice(SparkplugNotice::Error(NumberedError::new("E5028", what, remedy)));
                    }
                    connection.disconnect()
                }
                Some(MqttEvent::Ended(..)) | None => false,
                Some(_) => true,
            };
        }
    }

    fn notice(&mut self, notice: SparkplugNotice) {
        if self.noticed.as_ref() != Some(&notice) {
            self.noticed = Some(notice.clone());
            self.notices.push(notice);
        }
    }
}

/// The stored number of the last connection; none where there was none.
fn read_bd_seq(file: &PathBuf) -> Result<Option<u8>, NumberedError> {
    match fs::read_to_string(file) {
        Ok(text) => Ok(text.strip_prefix("bdSeq ").and_then(|number| number.trim_end().parse().ok())),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(unusable(file, &error)),
    }
}

fn time_ms() -> u64 {
    Timestamp::now().ms()
}
