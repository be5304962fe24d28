//! A simulated card with everything connected to it: a channel in either direction, a plant, pins that are counted.
//!
//! It runs in its own time, which the caller advances: as fast as possible, or with a clock.
//!
//! Invariant: the result depends on the settings and on what the host sends when, not on the steps in which time is
//! advanced.

use std::fmt;
use std::io::{self, Write};

use retrace_link::CardStatus;

use crate::count_checker::CountChecker;
use crate::linked_card::{SimLinkedCard, TICK_HZ, identity, records};
use crate::pins::Pins;
use crate::plant::{Plant, PlantSettings};
use crate::serial_channel::{InFlightPolicy, SerialChannel, SerialChannelSettings};
use crate::trace::Trace;

/// Settings of a card simulator.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CardSimulatorSettings {
    /// Channel from host to card.
    pub up: SerialChannelSettings,
    /// Channel from card to host.
    pub down: SerialChannelSettings,
    /// Plant that is connected to the card.
    pub machine: PlantSettings,
    /// Serial number of the card.
    pub serial: u32,
    /// Number that distinguishes this start of the card from others.
    pub boot: u32,
}

/// Control period of a card that nobody has opened, ns.
const IDLE_PERIOD_NS: u64 = 1_000_000;
/// Bytes that the card's UART accepts ahead.
const FIFO: usize = 8;
/// Largest number of bytes that leave the card at a time where bytes take no time.
const BURST: usize = 4096;

/// Sample of one control period for an observer of the card, in the card's own time.
#[derive(Clone, Copy, Debug)]
pub struct PeriodSample<'a, const A: usize> {
    /// Start of the period, in microseconds.
    pub at_us: u64,
    /// The card's status at its end, as in its report to the host.
    pub status: &'a CardStatus<A>,
    /// Net pulses that were counted on each axis' wires since the start, including this period.
    pub positions: &'a [i64; A],
}

/// Callback that receives every period sample.
pub type PeriodObserver<const A: usize> = Box<dyn FnMut(&PeriodSample<'_, A>) + Send>;

/// Faults of the pins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SimulationFaults {
    /// Periods whose increments did not fit the pulse times.
    pub overfull_periods: u64,
    /// Periods after which the card's counts differ from the pulses counted at its pins. Homing, which sets counts, is
    /// not such a difference, nor is backlash that is taken up.
    pub count_mismatches: u64,
}

/// A simulated card with everything connected to it.
pub struct CardSimulator<const A: usize> {
    card: Box<SimLinkedCard<A>>,
    serial: u32,
    machine: Plant<A>,
    pins: Pins<A>,
    up: SerialChannel,
    down: SerialChannel,
    now_ns: u64,
    /// Start of the next control period.
    due_ns: u64,
    /// Time at which the card's UART can accept bytes again, if there are more.
    more_at: Option<u64>,
    compared: CountChecker<A>,
    faults: SimulationFaults,
    watcher: Option<PeriodObserver<A>>,
    trace: Option<Trace<Box<dyn Write + Send>, A>>,
}

impl<const A: usize> fmt::Debug for CardSimulator<A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("CardSimulator")
            .field("now_us", &self.now_us())
            .field("status", self.status())
            .finish_non_exhaustive()
    }
}

impl<const A: usize> CardSimulator<A> {
    /// A card simulator at rest, at time 0. `None` where the card cannot be created.
    #[must_use]
    pub fn new(settings: &CardSimulatorSettings) -> Option<Self> {
        Some(Self {
            card: Box::new(SimLinkedCard::with_records(identity::<A>(settings.serial, settings.boot), records())?),
            serial: settings.serial,
            machine: Plant::new(&settings.machine),
            pins: Pins::default(),
            up: SerialChannel::new(&settings.up),
            down: SerialChannel::new(&settings.down),
            now_ns: 0,
            due_ns: IDLE_PERIOD_NS,
            more_at: None,
            compared: CountChecker::new([0; A]),
            faults: SimulationFaults::default(),
            watcher: None,
            trace: None,
        })
    }

    /// Microseconds since the start, in the card's time.
    #[must_use]
    pub const fn now_us(&self) -> u64 {
        self.now_ns / 1000
    }

    /// Advances time, at most until `until_us`; less where a byte for the host arrives before.
    pub fn advance(&mut self, until_us: u64) {
        let until = until_us.saturating_mul(1000);
        while self.down.next_arrival().is_none_or(|due| due > self.now_ns) && self.step(until) {}
    }

    /// Advances time until `until_us`, whatever arrives.
    pub fn run(&mut self, until_us: u64) {
        while self.step(until_us.saturating_mul(1000)) {}
    }

    /// Time of the next known event, in microseconds: a control period at the latest.
    #[must_use]
    pub fn next_us(&self) -> u64 {
        self.next_ns() / 1000
    }

    fn next_ns(&self) -> u64 {
        let soon = [self.up.next_arrival(), self.more_at, self.down.next_arrival().filter(|&due| due > self.now_ns)];
        soon.into_iter().flatten().fold(self.due_ns, u64::min).max(self.now_ns)
    }

    /// Advances to the next event up to `until`; false where there is none.
    fn step(&mut self, until: u64) -> bool {
        if self.now_ns >= until {
            return false;
        }
        self.now_ns = self.next_ns().min(until);
        while let Some(byte) = self.up.receive(self.now_ns) {
            self.card.receive(byte);
        }
        if self.due_ns <= self.now_ns {
            self.period();
        }
        self.fetch();
        true
    }

    /// Runs one control period of the card.
    fn period(&mut self) {
        let inputs = self.machine.inputs(self.now_us(), self.pins.positions(), self.card.card().pulses());
        let before = self.card.status().counts;
        let status = *self.card.run_period(inputs);
        if let Some(settings) = self.card.settings() {
            self.compared.set_backlash(&settings.settings().backlash_pulses, &before, self.pins.positions());
            self.compared.set_layer(settings.settings().layer);
            self.faults.overfull_periods += u64::from(!self.pins.emit(settings.timing(), self.card.card().pulses()));
        }
        self.faults.count_mismatches += u64::from(!self.compared.counts_match(&before, &status, self.pins.positions()));
        self.machine.outputs(self.now_us(), &status.outputs);
        if let Some(watcher) = &mut self.watcher {
            let positions = self.pins.positions();
            watcher(&PeriodSample { at_us: self.now_ns / 1000, status: &status, positions });
        }
        if let Some(trace) = &mut self.trace
            && trace.period(self.now_ns, &status, self.pins.edges(), TICK_HZ).is_err()
        {
            self.trace = None;
        }
        self.due_ns +=
            self.card.settings().map_or(IDLE_PERIOD_NS, |settings| u64::from(settings.settings().period_us) * 1000);
    }

    /// Fetches from the card what its UART can send now.
    fn fetch(&mut self) {
        if self.down.free_at() > self.now_ns {
            // Bytes that the card has produced since are fetched as soon as the channel is free, however time is cut
            // into steps.
            self.more_at = Some(self.down.free_at());
            return;
        }
        let mut bytes = [0; FIFO];
        let mut left = if self.down.byte_ns() == 0 { BURST } else { FIFO };
        self.more_at = None;
        while left > 0 {
            let count = self.card.transmit(&mut bytes);
            if count == 0 {
                return;
            }
            self.down.send(self.now_ns, &bytes[..count]);
            left = left.saturating_sub(count);
        }
        self.more_at = Some(self.down.free_at().max(self.now_ns + 1));
    }

    /// Sends bytes from the host now.
    pub fn send(&mut self, bytes: &[u8]) {
        self.up.send(self.now_ns, bytes);
    }

    /// Number of bytes from the host that have not been sent yet.
    #[must_use]
    pub fn unsent(&self) -> usize {
        self.up.unsent(self.now_ns)
    }

    /// Takes out the bytes that have arrived at the host by now; returns their number.
    pub fn receive(&mut self, bytes: &mut [u8]) -> usize {
        let mut count = 0;
        while count < bytes.len()
            && let Some(byte) = self.down.receive(self.now_ns)
        {
            bytes[count] = byte;
            count += 1;
        }
        count
    }

    /// Disconnects the cable and connects it again, now.
    pub fn reconnect(&mut self, leftover: InFlightPolicy) {
        self.up.reconnect(self.now_ns, leftover);
        self.down.reconnect(self.now_ns, leftover);
    }

    /// Switches the card off and on again, now: its state, its position and the bytes in flight are lost. The machine
    /// stays where it is, and what was cut stays cut. `boot` distinguishes this start from others. Returns false where
    /// the card cannot be created.
    pub fn restart(&mut self, boot: u32) -> bool {
        let identity = identity::<A>(self.serial, boot);
        let Some(card) = SimLinkedCard::with_records(identity, records()) else { return false };
        *self.card = card;
        self.reconnect(InFlightPolicy::Lost);
        self.more_at = None;
        self.due_ns = self.now_ns + IDLE_PERIOD_NS;
        self.pins.power_off();
        self.compared = CountChecker::new(self.pins.positions().map(|position| -position));
        true
    }

    /// The report of the last period, as the card has it.
    #[must_use]
    pub fn status(&self) -> &CardStatus<A> {
        self.card.status()
    }

    /// The card.
    #[must_use]
    pub const fn card(&self) -> &SimLinkedCard<A> {
        &self.card
    }

    /// The plant, for changes by a test.
    pub const fn machine(&mut self) -> &mut Plant<A> {
        &mut self.machine
    }

    /// The wires and the pulses counted on them.
    #[must_use]
    pub const fn pins(&self) -> &Pins<A> {
        &self.pins
    }

    /// The channels: from the host, and to it.
    #[must_use]
    pub const fn lines(&self) -> [&SerialChannel; 2] {
        [&self.up, &self.down]
    }

    /// Faults of the pins so far.
    #[must_use]
    pub const fn faults(&self) -> SimulationFaults {
        self.faults
    }

    /// Calls `watcher` with every control period from now on.
    pub fn observe(&mut self, watcher: PeriodObserver<A>) {
        self.watcher = Some(watcher);
    }

    /// Writes a trace for a wave viewer from now on, with these axis names. It ends where its file cannot be written
    /// any more.
    ///
    /// # Errors
    /// The error of the writer at the beginning.
    pub fn trace(&mut self, out: Box<dyn Write + Send>, axes: &[String]) -> io::Result<()> {
        self.trace = Some(Trace::new(out, axes)?);
        Ok(())
    }

    /// Flushes the trace.
    pub fn flush(&mut self) {
        if let Some(trace) = &mut self.trace
            && trace.flush().is_err()
        {
            self.trace = None;
        }
    }
}
