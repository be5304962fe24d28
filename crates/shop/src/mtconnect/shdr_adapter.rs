//! SHDR adapter: agents connect and have the present value of every item, then its changes (SHP-29).
//!
//! Invariant: agents are served alike and none is waited for: one that takes nothing is disconnected at 256 KiB. What
//! they send is read and, but for `* PING`, ignored.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::{Duration, Instant};

use retrace_journal::Timestamp;

use super::data_item::{Category, DataItem, Observation, data_items};
use super::shdr_line;
use crate::machine_report::{MachineReport, ReportedAxis};

/// Interval at which an agent is to send `* PING`, in ms; without one for twice as long it counts as gone.
const HEARTBEAT_MS: u64 = 10_000;
/// Shortest interval between two values of positions and feed.
const SAMPLE_INTERVAL: Duration = Duration::from_millis(100);
/// Unsent bytes at which an agent is disconnected.
const MAX_UNSENT: usize = 256 * 1024;
/// Longest line of an agent; the rest of a longer one is ignored.
const MAX_RECEIVED: usize = 256;
/// Largest number of agents at a time.
const MAX_AGENTS: usize = 64;

/// Adapter that serves agents on a port.
#[derive(Debug)]
pub struct ShdrAdapter {
    listener: TcpListener,
    agents: Vec<ShdrAgent>,
    axes: Vec<ReportedAxis>,
    items: Vec<(DataItem, Option<Observation>)>,
    sampled: Option<Instant>,
}

impl ShdrAdapter {
    /// Serves agents that connect to this listener.
    ///
    /// # Errors
    /// The error of the system.
    pub fn new(listener: TcpListener) -> std::io::Result<Self> {
        listener.set_nonblocking(true)?;
        Ok(Self { listener, agents: Vec::new(), axes: Vec::new(), items: with_no_value(&[]), sampled: None })
    }

    /// Sends what has changed in the report, and serves agents that have connected. `axes` are those of the machine.
    pub fn serve(&mut self, report: &MachineReport, axes: &[ReportedAxis]) {
        if !axes.is_empty() && self.axes != axes {
            self.axes = axes.to_vec();
            self.items = with_no_value(axes);
        }
        let changes = self.changes(report);
        self.agents.retain_mut(|agent| agent.receive() && agent.send(&changes));
        let present = self.present();
        while let Ok((stream, _)) = self.listener.accept() {
            if self.agents.len() < MAX_AGENTS && stream.set_nonblocking(true).is_ok() {
                let mut agent = ShdrAgent::new(stream);
                if agent.send(&present) {
                    self.agents.push(agent);
                }
            }
        }
    }

    /// Number of agents that are connected.
    #[must_use]
    pub fn agents(&self) -> usize {
        self.agents.len()
    }

    /// Lines of the values that have changed, which are the present ones from then on.
    fn changes(&mut self, report: &MachineReport) -> String {
        let samples_due = self.sampled.is_none_or(|sampled| sampled.elapsed() >= SAMPLE_INTERVAL);
        if samples_due {
            self.sampled = Some(Instant::now());
        }
        let mut changed = Vec::new();
        for (item, present) in &mut self.items {
            let is_new = item.category != Category::Sample || samples_due || present.is_none();
            let value = item.observe(report);
            if is_new && present.as_ref() != Some(&value) {
                changed.push((item.key.clone(), value.clone()));
                *present = Some(value);
            }
        }
        lines(changed)
    }

    /// Lines of a new connection: the protocol, and every present value.
    fn present(&self) -> String {
        let version = env!("CARGO_PKG_VERSION");
        let known = self.items.iter().filter_map(|(item, value)| Some((item.key.clone(), value.clone()?)));
        format!("* shdrVersion: 2.0\n* adapterVersion: {version}\n{}", lines(known.collect()))
    }
}

fn with_no_value(axes: &[ReportedAxis]) -> Vec<(DataItem, Option<Observation>)> {
    data_items(axes).into_iter().map(|item| (item, None)).collect()
}

/// One line for all values, and one for each condition.
fn lines(observations: Vec<(String, Observation)>) -> String {
    let now = Timestamp::now();
    let (mut values, mut conditions) = (Vec::new(), String::new());
    for (key, observation) in observations {
        match observation {
            Observation::Value(value) => values.push((key, value)),
            Observation::Condition { level, code, text } => {
                conditions += &shdr_line::condition(now, &key, level, &code, &text);
            }
        }
    }
    if values.is_empty() { conditions } else { shdr_line::values(now, &values) + &conditions }
}

/// A connected agent.
#[derive(Debug)]
struct ShdrAgent {
    stream: TcpStream,
    unsent: Vec<u8>,
    received: Vec<u8>,
    heard: Instant,
    /// Whether it has ever sent `* PING`: one that does not is not expected to.
    pings: bool,
}

impl ShdrAgent {
    fn new(stream: TcpStream) -> Self {
        Self { stream, unsent: Vec::new(), received: Vec::new(), heard: Instant::now(), pings: false }
    }

    /// Sends text, as much of it as it takes now. False where the agent is gone, or takes nothing.
    fn send(&mut self, text: &str) -> bool {
        self.unsent.extend_from_slice(text.as_bytes());
        while !self.unsent.is_empty() {
            match self.stream.write(&self.unsent) {
                Ok(0) => return false,
                Ok(written) => drop(self.unsent.drain(..written)),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(_) => return false,
            }
        }
        self.unsent.len() <= MAX_UNSENT
    }

    /// Reads what it has sent, and answers `* PING`. False where it is gone.
    fn receive(&mut self) -> bool {
        let mut buffer = [0; 1024];
        // What one call takes is bounded, so that an agent that sends without end holds nobody up.
        for _ in 0..16 {
            match self.stream.read(&mut buffer) {
                Ok(0) => return false,
                Ok(count) => {
                    if !buffer[..count].iter().all(|&byte| self.take(byte)) {
                        return false;
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return false,
            }
        }
        !self.pings || self.heard.elapsed() < Duration::from_millis(2 * HEARTBEAT_MS)
    }

    /// Takes a byte of a line. False where the agent is gone.
    fn take(&mut self, byte: u8) -> bool {
        if byte != b'\n' {
            if self.received.len() < MAX_RECEIVED {
                self.received.push(byte);
            }
            return true;
        }
        let line = std::mem::take(&mut self.received);
        if line.trim_ascii() == b"* PING" {
            (self.heard, self.pings) = (Instant::now(), true);
            return self.send(&format!("* PONG {HEARTBEAT_MS}\n"));
        }
        true
    }
}
