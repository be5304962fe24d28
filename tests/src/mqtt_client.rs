//! A client of MQTT 3.1.1, and the broker mosquitto on a port of this computer.
//!
//! Invariant: it shares nothing with the client that is tested; the broker ends with the test.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use retrace_task_support::tools;

/// A message as it came.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MqttMessage {
    /// Topic.
    pub topic: String,
    /// Quality of service.
    pub qos: u8,
    /// Whether the broker had kept it.
    pub is_retained: bool,
    /// Payload.
    pub payload: Vec<u8>,
}

/// A client that is connected.
#[derive(Debug)]
pub struct MqttClient {
    stream: TcpStream,
    rest: Vec<u8>,
}

impl MqttClient {
    /// Connects to a broker on this computer, with a user and password where it asks for them.
    ///
    /// # Panics
    /// Where it does not accept the client within ten seconds.
    #[must_use]
    pub fn connect(port: u16, name: &str, user: Option<(&str, &str)>) -> Self {
        let begun = Instant::now();
        let stream = loop {
            match TcpStream::connect(("127.0.0.1", port)) {
                Ok(stream) => break stream,
                Err(error) => assert!(begun.elapsed() < Duration::from_secs(10), "no broker: {error}"),
            }
            sleep(Duration::from_millis(20));
        };
        stream.set_read_timeout(Some(Duration::from_millis(20))).expect("a time");
        let mut client = Self { stream, rest: Vec::new() };
        let flags = if user.is_some() { 0b1100_0010 } else { 0b10 };
        // clean session, no keep-alive
        let mut body = [&text("MQTT")[..], &[4, flags, 0, 0], &text(name)].concat();
        for part in user.iter().flat_map(|&(user, password)| [user, password]) {
            body.extend(text(part));
        }
        client.send(0x10, &body);
        assert_eq!(client.wait_packet(), (0x20, vec![0, 0]), "the broker accepts the client");
        client
    }

    /// Subscribes to these topics.
    ///
    /// # Panics
    /// Where the broker refuses.
    pub fn subscribe(&mut self, topics: &[&str]) {
        let filters = topics.iter().flat_map(|topic| [text(topic), vec![1]].concat());
        self.send(0x82, &[vec![0, 1], filters.collect()].concat());
        let answer = self.wait_packet();
        assert!(answer.0 == 0x90 && !answer.1.contains(&0x80), "{answer:?}");
    }

    /// Publishes a message of quality 0.
    ///
    /// # Panics
    /// Where the broker is gone.
    pub fn publish(&mut self, topic: &str, payload: &[u8], is_retained: bool) {
        self.send(0x30 | u8::from(is_retained), &[&text(topic), payload].concat());
    }

    /// The next message, where one comes within this time. One of quality 1 is acknowledged.
    ///
    /// # Panics
    /// Where the broker sends anything else.
    pub fn receive(&mut self, within: Duration) -> Option<MqttMessage> {
        let until = Instant::now() + within;
        loop {
            if let Some((first, body)) = self.packet() {
                assert_eq!(first >> 4, 3, "a message");
                return Some(self.message(first, &body));
            }
            if Instant::now() > until || !self.fill(!within.is_zero()) {
                return None;
            }
        }
    }

    fn message(&mut self, first: u8, body: &[u8]) -> MqttMessage {
        let (qos, is_retained) = (first >> 1 & 3, first & 1 == 1);
        let length = usize::from(u16::from_be_bytes([body[0], body[1]]));
        let (topic, mut payload) = body[2..].split_at(length);
        if qos > 0 {
            self.send(0x40, &payload[..2]);
            payload = &payload[2..];
        }
        let topic = String::from_utf8(topic.to_vec()).expect("text");
        MqttMessage { topic, qos, is_retained, payload: payload.to_vec() }
    }

    fn wait_packet(&mut self) -> (u8, Vec<u8>) {
        let begun = Instant::now();
        loop {
            if let Some(packet) = self.packet() {
                return packet;
            }
            assert!(self.fill(true) && begun.elapsed() < Duration::from_secs(10), "the broker does not answer");
        }
    }

    /// The first packet of what was received: its first byte, and what follows its length.
    fn packet(&mut self) -> Option<(u8, Vec<u8>)> {
        let (mut length, mut begin) = (0, 1);
        loop {
            let byte = *self.rest.get(begin)?;
            length |= usize::from(byte & 0x7F) << (7 * (begin - 1));
            begin += 1;
            if byte < 0x80 {
                break;
            }
        }
        let body = self.rest.get(begin..begin + length)?.to_vec();
        let first = self.rest[0];
        self.rest.drain(..begin + length);
        Some((first, body))
    }

    /// Reads what has come, or comes within a short time where it may wait. False where the broker is gone.
    fn fill(&mut self, may_wait: bool) -> bool {
        let mut buffer = [0; 4096];
        self.stream.set_nonblocking(!may_wait).expect("a socket");
        let read = self.stream.read(&mut buffer);
        self.stream.set_nonblocking(false).expect("a socket");
        match read {
            Ok(0) => false,
            Ok(count) => {
                self.rest.extend_from_slice(&buffer[..count]);
                true
            }
            Err(error) => matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted),
        }
    }

    fn send(&mut self, first: u8, body: &[u8]) {
        let (mut packet, mut length) = (vec![first], body.len());
        loop {
            let more = if length < 128 { 0 } else { 128 };
            packet.push((length % 128) as u8 | more);
            length /= 128;
            if length == 0 {
                break;
            }
        }
        packet.extend_from_slice(body);
        self.stream.write_all(&packet).expect("the broker is there");
    }
}

fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u16).to_be_bytes()[..], text.as_bytes()].concat()
}

/// The broker mosquitto.
#[derive(Debug)]
pub struct Mosquitto {
    child: Child,
    config: PathBuf,
    /// Its port.
    pub port: u16,
}

impl Mosquitto {
    /// Starts it on a free port, with these further lines of its configuration; none where it is not installed.
    ///
    /// # Panics
    /// Where it cannot be started.
    #[must_use]
    pub fn start(folder: &Path, lines: &str) -> Option<Self> {
        let program = tools::server("mosquitto")?;
        let port = free_port();
        let config = folder.join("mosquitto.conf");
        let access = if lines.contains("allow_anonymous") { "" } else { "allow_anonymous true\n" };
        let text = format!("listener {port} 127.0.0.1\nuser root\npersistence false\n{access}{lines}");
        std::fs::write(&config, text).expect("a file of the test");
        let child = spawn(&program, &config);
        Some(Self { child, config, port })
    }

    /// Kills it.
    ///
    /// # Panics
    /// Where it cannot be killed.
    pub fn kill(&mut self) {
        self.child.kill().expect("it is killed");
        self.child.wait().expect("it ends");
    }

    /// Starts it again, on the same port.
    ///
    /// # Panics
    /// Where it is not installed any more.
    pub fn restart(&mut self) {
        self.child = spawn(&tools::server("mosquitto").expect("it is installed"), &self.config);
    }
}

impl Drop for Mosquitto {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn spawn(program: &Path, config: &Path) -> Child {
    let mut command = Command::new(program);
    command.arg("-c").arg(config).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.spawn().expect("the broker runs")
}

/// A port of this computer that nobody has.
///
/// # Panics
/// Where there is none.
#[must_use]
pub fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr()).expect("a port").port()
}
