//! A card on a serial line, as the controller uses it: the host's endpoint and a port.
//!
//! Invariant: bytes are exchanged only in here, between two control periods of the controller. If the controller hangs,
//! it sends nothing, and the card stops by itself.

use core::fmt;

use crate::{
    BytePort, CardFailure, CardSettings, CardStatus, CommandRefusal, Greeting, HostCommand, HostEndpoint, LinkError,
    MotionCard, PathStart,
};
use retrace_core::{Rate, RecordIndex};

/// Timeouts, in microseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LinkTimeouts {
    /// For the first answer of a card.
    pub answer_us: u64,
    /// For frames from the card after that. A cable that is unplugged for less than this may be plugged in again.
    pub silence_us: u64,
    /// For a card without its host to come to rest: its watchdog, which takes 2 s at most, and its braking.
    pub rest_us: u64,
}

impl Default for LinkTimeouts {
    fn default() -> Self {
        Self { answer_us: 3_000_000, silence_us: 5_000_000, rest_us: 10_000_000 }
    }
}

/// Error that ends a run over a serial line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkedCardError<F> {
    /// Error of the port.
    Port(F),
    /// Error of the protocol.
    Host(LinkError),
}

impl<F: CardFailure> CardFailure for LinkedCardError<F> {
    fn number(&self) -> &'static str {
        match self {
            Self::Port(fault) => fault.number(),
            Self::Host(fault) => fault.number(),
        }
    }

    fn remedy(&self) -> &'static str {
        match self {
            Self::Port(fault) => fault.remedy(),
            Self::Host(fault) => fault.remedy(),
        }
    }
}

impl<F: fmt::Debug + fmt::Display> core::error::Error for LinkedCardError<F> {}

impl<F> From<LinkError> for LinkedCardError<F> {
    fn from(error: LinkError) -> Self {
        Self::Host(error)
    }
}

impl<F: fmt::Display> fmt::Display for LinkedCardError<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Port(fault) => fault.fmt(f),
            Self::Host(fault) => fault.fmt(f),
        }
    }
}

/// A card on a serial line.
#[derive(Debug)]
pub struct LinkedCard<const A: usize, P: BytePort> {
    port: P,
    host: HostEndpoint<A>,
    timeouts: LinkTimeouts,
    /// Error of the port while the line is gone; it may come back.
    lost: Option<P::Fault>,
    /// Nonce of the last greeting request.
    nonce: u32,
    /// Settings of the open epoch.
    settings: Option<CardSettings<A>>,
}

/// Time for which a host that gives up sends a stop to the card.
const CLOSING_US: u64 = 40_000;

/// Maximum time that one read of the port waits.
const WAIT_US: u32 = 1_000;

impl<const A: usize, P: BytePort> LinkedCard<A, P> {
    /// Requests a greeting from the card at the other end of `port` until it answers. `nonce` is any number, preferably
    /// one that was not used recently.
    ///
    /// # Errors
    /// No card answers, or the port is gone.
    pub fn connect(port: P, nonce: u32, patience: LinkTimeouts) -> Result<Self, LinkedCardError<P::Fault>> {
        let mut found =
            Self { port, host: HostEndpoint::new(nonce), timeouts: patience, lost: None, nonce, settings: None };
        found.pump_until(|host| host.greeting().is_some())?;
        Ok(found)
    }

    /// Returns the greeting: the identity of the card, and the machine's position at that time.
    #[must_use]
    pub fn greeting(&self) -> Option<&Greeting<A>> {
        self.host.greeting()
    }

    /// Requests a new greeting, with the current position of the machine.
    ///
    /// # Errors
    /// As [`LinkedCard::connect`].
    pub fn request_greeting(&mut self, nonce: u32) -> Result<(), LinkedCardError<P::Fault>> {
        self.nonce = nonce;
        self.host.request_greeting(nonce);
        self.pump_until(|host| host.greeting().is_some())
    }

    /// Requests greetings until the machine is at rest and no other host can move it. A card without its host first
    /// brakes, and then its watchdog latches the alarm. From then on its reported state does not change.
    ///
    /// # Errors
    /// As [`LinkedCard::connect`]; also [`LinkError::NotAtRest`] if that state is not reached in time, because another
    /// host is connected.
    pub fn wait_at_rest(&mut self, nonce: u32) -> Result<(), LinkedCardError<P::Fault>> {
        self.request_greeting_until(nonce, |greeting| {
            greeting.at_rest && (greeting.epoch == 0 || greeting.alarm.is_some())
        })
    }

    fn request_greeting_until(
        &mut self,
        nonce: u32,
        done: impl Fn(&Greeting<A>) -> bool,
    ) -> Result<(), LinkedCardError<P::Fault>> {
        let begun = self.port.now_us();
        let mut question = nonce;
        while !self.host.greeting().is_some_and(&done) {
            if self.port.now_us().saturating_sub(begun) > self.timeouts.rest_us {
                return Err(LinkedCardError::Host(LinkError::NotAtRest));
            }
            question = question.wrapping_add(1);
            self.request_greeting(question)?;
        }
        Ok(())
    }

    /// Begins an epoch with these settings at the last reported position, and waits for its first report.
    ///
    /// # Errors
    /// The card rejects the settings, stops answering, or the port is gone. A latched alarm is not an error yet.
    pub fn open(&mut self, settings: CardSettings<A>) -> Result<(), LinkedCardError<P::Fault>> {
        self.host.open(settings);
        self.settings = Some(settings);
        self.pump_until(HostEndpoint::is_open)?;
        // its outputs and its alarm are reported with the first period
        let begun = self.port.now_us();
        while !self.host.next_period() {
            if self.port.now_us().saturating_sub(begun) > self.timeouts.answer_us {
                return Err(self.timeout_error());
            }
            self.pump(WAIT_US);
        }
        // Nothing else is queued yet.
        let curve = settings.speed_curve.map(HostCommand::SpeedCurve);
        curve
            .map_or(Ok(()), |curve| self.host.send(curve))
            .map_err(|_| LinkedCardError::Host(LinkError::SettingsRejected))
    }

    /// Ends the epoch; the card then needs no host any more. It must be at rest.
    ///
    /// # Errors
    /// The card stops answering, or the port is gone.
    pub fn close(&mut self) -> Result<(), LinkedCardError<P::Fault>> {
        self.host.close();
        self.pump_until(HostEndpoint::is_closed)
    }

    /// Returns the host's endpoint.
    #[must_use]
    pub fn host(&self) -> &HostEndpoint<A> {
        &self.host
    }

    /// Returns the port.
    #[must_use]
    pub fn port(&self) -> &P {
        &self.port
    }

    /// Returns the port and drops the host's endpoint.
    #[must_use]
    pub fn into_port(self) -> P {
        self.port
    }

    /// Returns the port for modification, for tests.
    pub fn port_mut(&mut self) -> &mut P {
        &mut self.port
    }

    fn pump_until(&mut self, done: impl Fn(&HostEndpoint<A>) -> bool) -> Result<(), LinkedCardError<P::Fault>> {
        let begun = self.port.now_us();
        while !done(&self.host) {
            if self.port.now_us().saturating_sub(begun) > self.timeouts.answer_us {
                return Err(self.timeout_error());
            }
            self.pump(WAIT_US);
            if let Some(fault @ (LinkError::Protocol(_) | LinkError::SettingsRejected | LinkError::Restarted)) =
                self.host.fault()
            {
                return Err(LinkedCardError::Host(fault));
            }
        }
        Ok(())
    }

    /// Sends a stop to the card, if the line still works; without frames the card stops anyway.
    fn flush_closing(&mut self) {
        let _ = self.host.send(HostCommand::rate(Rate::ZERO));
        let begun = self.port.now_us();
        while self.port.now_us().saturating_sub(begun) < CLOSING_US {
            self.pump(WAIT_US);
        }
    }

    fn timeout_error(&mut self) -> LinkedCardError<P::Fault> {
        self.lost.take().map_or(LinkedCardError::Host(LinkError::Silent), LinkedCardError::Port)
    }

    /// Sends what is due and receives what has arrived. A line that is gone may come back, for example a cable that is
    /// plugged in again. Until then the card counts as silent, and its timeout runs.
    fn pump(&mut self, wait_us: u32) {
        match self.exchange(wait_us) {
            Ok(()) => self.lost = None,
            Err(fault) => {
                self.lost = Some(fault);
                if self.port.revive() {
                    self.lost = None;
                }
            }
        }
    }

    fn exchange(&mut self, wait_us: u32) -> Result<(), P::Fault> {
        let mut bytes = [0; 1024];
        let room = self.port.writable_bytes().min(bytes.len());
        let mut given = self.host.transmit(self.port.now_us(), &mut bytes[..room]);
        let mut from = 0;
        while given > 0 {
            let taken = self.port.write(&bytes[from..from + given])?;
            if taken == 0 {
                // Bytes that the port does not accept are lost like any byte on the line, and are retransmitted.
                break;
            }
            (from, given) = (from + taken, given - taken);
        }
        let read = self.port.read(&mut bytes, wait_us)?;
        self.host.receive(&bytes[..read], self.port.now_us());
        Ok(())
    }
}

impl<const A: usize, P: BytePort> MotionCard<A> for LinkedCard<A, P> {
    type Fault = LinkedCardError<P::Fault>;

    fn window(&self) -> u32 {
        self.host.window()
    }

    fn send(&mut self, command: HostCommand<A>) -> Result<(), CommandRefusal> {
        self.host.send(command)
    }

    fn run_period(&mut self) -> Result<&CardStatus<A>, Self::Fault> {
        // The line is also served while received periods are waiting.
        self.pump(0);
        while !self.host.next_period() {
            if let Some(fault) = self.host.fault() {
                self.flush_closing();
                return Err(LinkedCardError::Host(fault));
            }
            if self.host.silent_us() > self.timeouts.silence_us {
                return Err(self.timeout_error());
            }
            self.pump(WAIT_US);
        }
        Ok(self.host.status())
    }

    fn begin_path(&mut self, start: PathStart) -> Result<(), Self::Fault> {
        let Some(settings) = self.settings else { return Err(LinkedCardError::Host(LinkError::SettingsRejected)) };
        if let Some(fault) = self.host.fault().filter(|fault| !matches!(fault, LinkError::Alarm(_))) {
            return Err(LinkedCardError::Host(fault));
        }
        let known = self.host.status().executed;
        // Homing sets counts that no report contains: a new greeting is requested after the card has received every
        // command.
        self.pump_until(HostEndpoint::is_acknowledged)?;
        self.request_greeting(self.nonce.wrapping_add(1))?;
        self.request_greeting_until(self.nonce, |greeting| greeting.at_rest)?;
        // A late rate command moved the machine after the report that the caller used: its start is at another place.
        if !self.host.is_where_reported() {
            return Err(LinkedCardError::Host(LinkError::Moved));
        }
        // Instructions that were executed meanwhile count as executed.
        let meanwhile = self.host.greeting().map_or(0, |greeting| greeting.executed.wrapping_sub(known));
        let start = PathStart { executed: start.executed.wrapping_add(meanwhile), ..start };
        self.open(CardSettings { start, ..settings })
    }

    fn status(&self) -> &CardStatus<A> {
        self.host.status()
    }

    fn acknowledged_high(&self) -> RecordIndex {
        self.host.acknowledged_high()
    }
}
