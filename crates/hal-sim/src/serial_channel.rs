//! One direction of a simulated serial line, with the delays and faults of its settings.
//!
//! Invariant: nothing is lost without being counted (`sent + duplicated = delivered + lost + in flight`), and what
//! arrives, and when, depends on what was sent when and on the settings alone, not on how often it is received.

use std::collections::VecDeque;

use crate::faults::{FaultRates, LineCounters, LineFault};
use crate::random::Random;

/// Settings of a serial channel.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SerialChannelSettings {
    /// Bits per second, ten to a byte; 0: a byte takes no time.
    pub baud: u32,
    /// Time from the end of a byte at the sender to its arrival, in microseconds.
    pub latency_us: u32,
    /// Each burst takes up to this many microseconds more, drawn for each. Bytes do not overtake each other.
    pub jitter_us: u32,
    /// Random faults.
    pub rates: FaultRates,
    /// Scripted faults, by the number of the byte, from 0, of all that are sent.
    pub script: Vec<(u64, LineFault)>,
    /// Seed of all random events.
    pub seed: u64,
}

/// What happens to the bytes in flight when a connection is renewed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InFlightPolicy {
    /// They are lost.
    Lost,
    /// They arrive together this many microseconds later, between the bytes of the new connection.
    Late {
        /// Microseconds from now.
        us: u32,
    },
}

/// A byte in flight: its arrival time, and its value.
type InFlight = (u64, u8);

/// One direction of a serial line.
#[derive(Clone, Debug)]
pub struct SerialChannel {
    byte_ns: u64,
    latency_ns: u64,
    jitter_us: u32,
    rates: Option<FaultRates>,
    script: VecDeque<(u64, LineFault)>,
    random: Random,
    /// Time at which the sender has sent all its bytes.
    free_at: u64,
    /// Additional delay of the current burst.
    burst_delay: u64,
    last_due: u64,
    /// Bytes still to be lost in a cut; `None` where it lasts to the end of the burst.
    cut: Option<Option<u32>>,
    stall_until: u64,
    stall_loses: bool,
    in_flight: VecDeque<InFlight>,
    late: VecDeque<InFlight>,
    tally: LineCounters,
}

impl SerialChannel {
    /// A channel at rest.
    #[must_use]
    pub fn new(settings: &SerialChannelSettings) -> Self {
        let mut script = settings.script.clone();
        script.sort_by_key(|&(byte, _)| byte);
        Self {
            byte_ns: if settings.baud == 0 { 0 } else { 10_000_000_000 / u64::from(settings.baud) },
            latency_ns: u64::from(settings.latency_us) * 1000,
            jitter_us: settings.jitter_us,
            rates: (!settings.rates.are_none()).then_some(settings.rates),
            script: script.into(),
            random: Random::new(settings.seed),
            free_at: 0,
            burst_delay: 0,
            last_due: 0,
            cut: None,
            stall_until: 0,
            stall_loses: false,
            in_flight: VecDeque::new(),
            late: VecDeque::new(),
            tally: LineCounters::default(),
        }
    }

    /// Passes bytes to the sender at `now_ns`, which sends them one after the other.
    pub fn send(&mut self, now_ns: u64, bytes: &[u8]) {
        for &byte in bytes {
            let begin = now_ns.max(self.free_at);
            if begin > self.free_at || self.tally.sent == 0 {
                self.begin_burst();
            }
            self.free_at = begin + self.byte_ns;
            self.pass(byte);
        }
    }

    fn begin_burst(&mut self) {
        self.burst_delay = u64::from(self.random.up_to(self.jitter_us)) * 1000;
        if self.cut == Some(None) {
            self.cut = None;
        }
    }

    fn pass(&mut self, byte: u8) {
        let fault = self.draw_fault();
        self.tally.sent += 1;
        let due = (self.free_at + self.latency_ns + self.burst_delay).max(self.last_due);
        match fault {
            Some(LineFault::Cut { bytes }) => {
                self.tally.cuts += 1;
                self.cut = Some((bytes > 0).then_some(bytes));
            }
            Some(LineFault::Stall { us, lost }) => {
                self.tally.stalls += 1;
                self.stall_until = self.stall_until.max(due + u64::from(us) * 1000);
                self.stall_loses = lost;
            }
            _ => {}
        }
        if let Some(left) = &mut self.cut {
            self.tally.cut += 1;
            if let Some(left) = left {
                *left -= 1;
                if *left == 0 {
                    self.cut = None;
                }
            }
            return;
        }
        if due < self.stall_until && self.stall_loses {
            self.tally.stalled += 1;
            return;
        }
        let due = due.max(self.stall_until);
        self.last_due = due;
        match fault {
            Some(LineFault::Drop) => self.tally.dropped += 1,
            Some(LineFault::Duplicate) => {
                self.tally.duplicated += 1;
                self.in_flight.extend([(due, byte); 2]);
            }
            Some(LineFault::Flip { bit }) => {
                self.tally.flipped += 1;
                self.in_flight.push_back((due, byte ^ 1 << (bit & 7)));
            }
            _ => self.in_flight.push_back((due, byte)),
        }
    }

    /// Draws the fault of the byte that is sent now.
    fn draw_fault(&mut self) -> Option<LineFault> {
        let drawn = self.rates.as_ref().and_then(|rates| rates.draw(&mut self.random));
        let mut scripted = None;
        while self.script.front().is_some_and(|&(byte, _)| byte <= self.tally.sent) {
            scripted = self.script.pop_front();
        }
        scripted.map_or(drawn, |(_, fault)| Some(fault))
    }

    /// Takes out the next byte that has arrived by `now_ns`.
    pub fn receive(&mut self, now_ns: u64) -> Option<u8> {
        let due = self.next_arrival().filter(|&due| due <= now_ns)?;
        let from_late = self.late.front().is_some_and(|&(at, _)| at == due);
        let queue = if from_late { &mut self.late } else { &mut self.in_flight };
        self.tally.delivered += 1;
        self.tally.late += u64::from(from_late);
        queue.pop_front().map(|(_, byte)| byte)
    }

    /// Arrival time of the next byte, in nanoseconds, if one is in flight.
    #[must_use]
    pub fn next_arrival(&self) -> Option<u64> {
        let first = |queue: &VecDeque<InFlight>| queue.front().map(|&(due, _)| due);
        first(&self.late).into_iter().chain(first(&self.in_flight)).min()
    }

    /// Time at which the sender has sent all its bytes, in nanoseconds.
    #[must_use]
    pub const fn free_at(&self) -> u64 {
        self.free_at
    }

    /// Number of bytes that the sender still has at `now_ns`, including the one being sent.
    #[must_use]
    pub fn unsent(&self, now_ns: u64) -> usize {
        match self.byte_ns {
            0 => 0,
            byte_ns => self.free_at.saturating_sub(now_ns).div_ceil(byte_ns) as usize,
        }
    }

    /// Time that a byte takes, in nanoseconds.
    #[must_use]
    pub const fn byte_ns(&self) -> u64 {
        self.byte_ns
    }

    /// Renews the connection at `now_ns`, as after disconnecting a cable.
    pub fn reconnect(&mut self, now_ns: u64, leftover: InFlightPolicy) {
        let left = self.late.drain(..).chain(self.in_flight.drain(..)).map(|(_, byte)| byte);
        match leftover {
            InFlightPolicy::Lost => self.tally.lost_at_reconnect += left.count() as u64,
            InFlightPolicy::Late { us } => {
                let due = now_ns + u64::from(us) * 1000;
                self.late = left.map(|byte| (due, byte)).collect();
            }
        }
        self.free_at = self.free_at.min(now_ns);
        self.last_due = now_ns;
        (self.cut, self.stall_until) = (None, 0);
    }

    /// Counters so far.
    #[must_use]
    pub const fn counters(&self) -> &LineCounters {
        &self.tally
    }
}
