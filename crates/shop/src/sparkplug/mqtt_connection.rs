//! One connection to an MQTT broker, version 5 or 3.1.1, in a thread of its own.
//!
//! Invariant: one object is one connection, which is never renewed behind its user's back. Nothing is waited for but
//! the broker, in the thread alone, and the queues in both directions are bounded.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, sync_channel};
use std::thread;
use std::time::Duration;

use rumqttc::{TlsConfiguration, Transport, mqttbytes as v3, v5};
use rustls::ClientConfig;

use super::edge_node::Publication;

/// Interval of the broker's look at the connection: after one and a half of it a machine that vanished is dead.
const KEEP_ALIVE: Duration = Duration::from_secs(10);
/// Longest message that is received.
const MAX_RECEIVED: usize = 256 * 1024;
/// Longest message that is sent.
const MAX_SENT: usize = 1024 * 1024;
/// Most messages that wait in either direction.
const MAX_QUEUED: usize = 64;
/// Interval at which the thread looks whether it is to end.
const LOOK: Duration = Duration::from_millis(500);

/// Version of the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MqttVersion {
    /// Version 5.
    V5,
    /// Version 3.1.1.
    V3,
}

impl MqttVersion {
    /// The other version.
    pub(super) fn other(self) -> Self {
        if self == Self::V5 { Self::V3 } else { Self::V5 }
    }
}

/// How to connect.
pub(super) struct MqttOptions {
    pub(super) version: MqttVersion,
    pub(super) client: String,
    pub(super) host: String,
    pub(super) port: u16,
    pub(super) user: Option<(String, String)>,
    pub(super) tls: Option<Arc<ClientConfig>>,
    pub(super) will: Publication,
}

/// What happens on a connection.
#[derive(Debug)]
pub(super) enum MqttEvent {
    /// The broker has accepted it.
    Connected,
    /// It has accepted the subscriptions.
    Subscribed,
    /// It has refused one, with this reason.
    SubscriptionRefused(String),
    /// A message.
    Message(String, Vec<u8>),
    /// A message of quality 1 has arrived, or was refused with this reason.
    Acknowledged(Option<String>),
    /// The connection is over.
    Ended(MqttEnd, String),
}

/// How a connection ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum MqttEnd {
    /// The broker was not reached: nothing was sent to it.
    NotReached,
    /// The broker does not speak this version, or has not answered: one of version 3.1.1 answers version 5 with a
    /// packet that is none in that version.
    NoAnswer,
    /// The broker refuses this client, its user or its password.
    Refused,
    /// It broke off, or was ended here.
    Lost,
}

/// A connection, which breaks off when it is dropped.
pub(super) struct MqttConnection {
    client: Client,
    events: Receiver<MqttEvent>,
    is_over: Arc<AtomicBool>,
}

enum Client {
    V5(v5::Client),
    V3(rumqttc::Client),
}

enum Connection {
    V5(Box<v5::Connection>),
    V3(Box<rumqttc::Connection>),
}

impl MqttConnection {
    /// Begins to connect; [`MqttEvent::Connected`] or [`MqttEvent::Ended`] follows.
    ///
    /// # Errors
    /// The error of the system where there is no thread.
    pub(super) fn begin(options: MqttOptions) -> std::io::Result<Self> {
        let (client, connection) = match options.version {
            MqttVersion::V5 => begin_v5(options),
            MqttVersion::V3 => begin_v3(options),
        };
        let (sender, events) = sync_channel(MAX_QUEUED);
        let is_over = Arc::new(AtomicBool::new(false));
        let over = Arc::clone(&is_over);
        thread::Builder::new().name("mqtt".into()).spawn(move || poll(connection, &sender, &over))?;
        Ok(Self { client, events, is_over })
    }

    /// Asks for these topics. False where the queue is full.
    pub(super) fn subscribe(&self, topics: Vec<String>) -> bool {
        match &self.client {
            Client::V5(client) => {
                use v5::mqttbytes::{QoS, v5::Filter};
                let filter = |topic| Filter { qos: QoS::AtLeastOnce, ..Filter::new(topic, QoS::AtLeastOnce) };
                client.try_subscribe_many(topics.into_iter().map(filter)).is_ok()
            }
            Client::V3(client) => {
                let filter = |path| rumqttc::SubscribeFilter { path, qos: v3::QoS::AtLeastOnce };
                client.try_subscribe_many(topics.into_iter().map(filter)).is_ok()
            }
        }
    }

    /// Publishes a message. False where the queue is full: the broker takes nothing.
    pub(super) fn publish(&self, message: Publication) -> bool {
        let is_confirmed = message.qos == 1;
        match &self.client {
            Client::V5(client) => {
                use v5::mqttbytes::QoS;
                let qos = if is_confirmed { QoS::AtLeastOnce } else { QoS::AtMostOnce };
                client.try_publish(message.topic, qos, false, message.payload).is_ok()
            }
            Client::V3(client) => {
                let qos = if is_confirmed { v3::QoS::AtLeastOnce } else { v3::QoS::AtMostOnce };
                client.try_publish(message.topic, qos, false, message.payload).is_ok()
            }
        }
    }

    /// Asks to end the connection in order, so that the broker does not publish the will.
    pub(super) fn disconnect(&self) -> bool {
        match &self.client {
            Client::V5(client) => client.try_disconnect().is_ok(),
            Client::V3(client) => client.try_disconnect().is_ok(),
        }
    }

    /// The next event, if there is one.
    pub(super) fn event(&self) -> Option<MqttEvent> {
        match self.events.try_recv() {
            Ok(event) => Some(event),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(ended()),
        }
    }

    /// The next event, or none within this time.
    pub(super) fn wait(&self, within: Duration) -> Option<MqttEvent> {
        match self.events.recv_timeout(within) {
            Ok(event) => Some(event),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => Some(ended()),
        }
    }
}

impl Drop for MqttConnection {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
    }
}

fn ended() -> MqttEvent {
    MqttEvent::Ended(MqttEnd::Lost, "the connection is over".into())
}

fn transport(tls: Option<Arc<ClientConfig>>) -> Transport {
    tls.map_or(Transport::Tcp, |config| Transport::tls_with_config(TlsConfiguration::Rustls(config)))
}

fn begin_v5(options: MqttOptions) -> (Client, Connection) {
    use v5::mqttbytes::{QoS, v5::LastWill};
    let mut settings = v5::MqttOptions::new(options.client, options.host, options.port);
    settings.set_clean_start(true);
    settings.set_session_expiry_interval(Some(0));
    settings.set_max_packet_size(Some(MAX_RECEIVED as u32));
    settings.set_keep_alive(KEEP_ALIVE);
    settings.set_transport(transport(options.tls));
    settings.set_last_will(LastWill::new(options.will.topic, options.will.payload, QoS::AtLeastOnce, false, None));
    if let Some((user, password)) = options.user {
        settings.set_credentials(user, password);
    }
    let (client, mut connection) = v5::Client::new(settings, MAX_QUEUED);
    let mut network = connection.eventloop.options.network_options();
    network.set_tcp_nodelay(true);
    connection.eventloop.options.set_network_options(network);
    (Client::V5(client), Connection::V5(Box::new(connection)))
}

fn begin_v3(options: MqttOptions) -> (Client, Connection) {
    let mut settings = rumqttc::MqttOptions::new(options.client, options.host, options.port);
    settings.set_clean_session(true);
    settings.set_max_packet_size(MAX_RECEIVED, MAX_SENT);
    settings.set_keep_alive(KEEP_ALIVE);
    settings.set_transport(transport(options.tls));
    let (topic, payload) = (options.will.topic, options.will.payload);
    settings.set_last_will(v3::v4::LastWill::new(topic, payload, v3::QoS::AtLeastOnce, false));
    if let Some((user, password)) = options.user {
        settings.set_credentials(user, password);
    }
    let (client, mut connection) = rumqttc::Client::new(settings, MAX_QUEUED);
    let mut network = connection.eventloop.network_options();
    network.set_tcp_nodelay(true);
    connection.eventloop.set_network_options(network);
    (Client::V3(client), Connection::V3(Box::new(connection)))
}

/// What one poll has brought.
enum Polled {
    Nothing,
    Event(MqttEvent),
}

/// Serves the connection until it is over. It is never connected again.
fn poll(mut connection: Connection, events: &SyncSender<MqttEvent>, is_over: &AtomicBool) {
    let mut is_connected = false;
    while !is_over.load(Ordering::Relaxed) {
        // An attempt to connect that is broken off would begin again: it has a time limit of its own.
        let wait = if is_connected { LOOK } else { Duration::MAX };
        let polled = match &mut connection {
            Connection::V5(connection) => polled_v5(connection, wait, is_connected),
            Connection::V3(connection) => polled_v3(connection, wait, is_connected),
        };
        let Polled::Event(event) = polled else { continue };
        is_connected |= matches!(event, MqttEvent::Connected);
        let is_end = matches!(event, MqttEvent::Ended(..));
        if events.send(event).is_err() || is_end {
            return;
        }
    }
}

fn polled_v5(connection: &mut v5::Connection, wait: Duration, is_connected: bool) -> Polled {
    use v5::ConnectionError;
    use v5::mqttbytes::v5::{ConnectReturnCode, Packet, PubAckReason, SubscribeReasonCode};
    let polled = match wait {
        Duration::MAX => connection.recv().ok(),
        wait => match connection.recv_timeout(wait) {
            Err(v5::RecvTimeoutError::Timeout) => return Polled::Nothing,
            polled => polled.ok(),
        },
    };
    Polled::Event(match polled {
        Some(Ok(v5::Event::Incoming(packet))) => match packet {
            Packet::ConnAck(_) => MqttEvent::Connected,
            Packet::Publish(message) => {
                MqttEvent::Message(String::from_utf8_lossy(&message.topic).into_owned(), message.payload.to_vec())
            }
            Packet::PubAck(ack) => {
                let is_refused = !matches!(ack.reason, PubAckReason::Success | PubAckReason::NoMatchingSubscribers);
                MqttEvent::Acknowledged(is_refused.then(|| format!("{:?}", ack.reason)))
            }
            Packet::SubAck(ack) => {
                let is_refusal = |code: &&SubscribeReasonCode| !matches!(code, SubscribeReasonCode::Success(_));
                match ack.return_codes.iter().find(is_refusal) {
                    Some(code) => MqttEvent::SubscriptionRefused(format!("{code:?}")),
                    None => MqttEvent::Subscribed,
                }
            }
            _ => return Polled::Nothing,
        },
        Some(Ok(v5::Event::Outgoing(rumqttc::Outgoing::Disconnect))) => ended(),
        Some(Ok(v5::Event::Outgoing(_))) => return Polled::Nothing,
        Some(Err(error)) => {
            let end = match &error {
                _ if is_connected => MqttEnd::Lost,
                ConnectionError::Io(_) | ConnectionError::Tls(_) => MqttEnd::NotReached,
                ConnectionError::ConnectionRefused(ConnectReturnCode::UnsupportedProtocolVersion) => MqttEnd::NoAnswer,
                ConnectionError::ConnectionRefused(_) => MqttEnd::Refused,
                _ => MqttEnd::NoAnswer,
            };
            MqttEvent::Ended(end, error.to_string())
        }
        None => ended(),
    })
}

fn polled_v3(connection: &mut rumqttc::Connection, wait: Duration, is_connected: bool) -> Polled {
    use rumqttc::ConnectionError;
    use v3::v4::{ConnectReturnCode, Packet, SubscribeReasonCode};
    let polled = match wait {
        Duration::MAX => connection.recv().ok(),
        wait => match connection.recv_timeout(wait) {
            Err(rumqttc::RecvTimeoutError::Timeout) => return Polled::Nothing,
            polled => polled.ok(),
        },
    };
    Polled::Event(match polled {
        Some(Ok(rumqttc::Event::Incoming(packet))) => match packet {
            Packet::ConnAck(_) => MqttEvent::Connected,
            Packet::Publish(message) => MqttEvent::Message(message.topic, message.payload.to_vec()),
            Packet::PubAck(_) => MqttEvent::Acknowledged(None),
            Packet::SubAck(ack) if ack.return_codes.contains(&SubscribeReasonCode::Failure) => {
                MqttEvent::SubscriptionRefused("Failure".into())
            }
            Packet::SubAck(_) => MqttEvent::Subscribed,
            _ => return Polled::Nothing,
        },
        Some(Ok(rumqttc::Event::Outgoing(rumqttc::Outgoing::Disconnect))) => ended(),
        Some(Ok(rumqttc::Event::Outgoing(_))) => return Polled::Nothing,
        Some(Err(error)) => {
            let end = match &error {
                _ if is_connected => MqttEnd::Lost,
                ConnectionError::Io(_) | ConnectionError::Tls(_) => MqttEnd::NotReached,
                ConnectionError::ConnectionRefused(ConnectReturnCode::RefusedProtocolVersion) => MqttEnd::NoAnswer,
                ConnectionError::ConnectionRefused(_) => MqttEnd::Refused,
                _ => MqttEnd::NoAnswer,
            };
            MqttEvent::Ended(end, error.to_string())
        }
        None => ended(),
    })
}
