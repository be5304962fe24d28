//! A card at the other end of a line, as the controller sees it: the host's end of the protocol, and a port.
//!
//! Invariant: bytes pass only in here, between two control periods of the controller; a controller that hangs falls silent, and the card
//! stops by itself.

use core::fmt;

use crate::{
    BytePort, CardFailure, CardSettings, CardStatus, CommandRefusal, Greeting, HostCommand, HostEndpoint, LinkError,
    MotionCard, PathStart,
};

/// How long to wait, in microseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LinkTimeouts {
    /// For the first answer of a card.
    pub answer_us: u64,
    /// For a sign of life later on. A cable that is out for less than this may be plugged in again.
    pub silence_us: u64,
}

impl Default for LinkTimeouts {
    fn default() -> Self {
        Self { answer_us: 3_000_000, silence_us: 5_000_000 }
    }
}

/// What ends a run over a line for good.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkedCardError<F> {
    /// The port itself.
    Port(F),
    /// What was said over it, or not.
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

impl<F: fmt::Display> fmt::Display for LinkedCardError<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Port(fault) => fault.fmt(f),
            Self::Host(fault) => fault.fmt(f),
        }
    }
}

/// A card at the other end of a line.
#[derive(Debug)]
pub struct LinkedCard<const A: usize, P: BytePort> {
    port: P,
    host: HostEndpoint<A>,
    patience: LinkTimeouts,
    /// The line is gone, for all that is known; it may come back.
    lost: Option<P::Fault>,
    /// Number of the last question.
    nonce: u32,
    /// What the open epoch goes by.
    settings: Option<CardSettings<A>>,
}

/// So long a card is told to stop by a host that gives up.
const LET_GO_US: u64 = 40_000;

/// The longest that one look at the port waits.
const WAIT_US: u32 = 1_000;

impl<const A: usize, P: BytePort> LinkedCard<A, P> {
    /// Asks at the other end of `port` who is there, until it answers. `nonce`: any number, best one that was not used lately.
    ///
    /// # Errors
    /// Nobody answers, or the port is gone.
    pub fn find(port: P, nonce: u32, patience: LinkTimeouts) -> Result<Self, LinkedCardError<P::Fault>> {
        let mut found = Self { port, host: HostEndpoint::new(nonce), patience, lost: None, nonce, settings: None };
        found.until(|host| host.greeting().is_some())?;
        Ok(found)
    }

    /// Who answered, and where the machine stood then.
    #[must_use]
    pub fn greeting(&self) -> Option<&Greeting<A>> {
        self.host.greeting()
    }

    /// Asks again who is there and where the machine stands.
    ///
    /// # Errors
    /// As [`Wired::find`].
    pub fn request_greeting(&mut self, nonce: u32) -> Result<(), LinkedCardError<P::Fault>> {
        self.nonce = nonce;
        self.host.ask(nonce);
        self.until(|host| host.greeting().is_some())
    }

    /// Asks until the machine stands and no other host can move it: a card that its host left brakes first, and then its watchdog
    /// latches the alarm. From then on what the card says of itself stays as it is.
    ///
    /// # Errors
    /// As [`Wired::find`]; also where it does not come to that in that time: another host is there.
    pub fn settle(&mut self, nonce: u32) -> Result<(), LinkedCardError<P::Fault>> {
        self.request_greeting_until(nonce, |said| said.at_rest && (said.epoch == 0 || said.alarm.is_some()))
    }

    fn request_greeting_until(
        &mut self,
        nonce: u32,
        done: impl Fn(&Greeting<A>) -> bool,
    ) -> Result<(), LinkedCardError<P::Fault>> {
        let begun = self.port.now_us();
        let mut question = nonce;
        while !self.host.greeting().is_some_and(&done) {
            if self.port.now_us().saturating_sub(begun) > self.patience.answer_us {
                return Err(LinkedCardError::Host(LinkError::Unfit));
            }
            question = question.wrapping_add(1);
            self.request_greeting(question)?;
        }
        Ok(())
    }

    /// Begins an epoch with these settings, as the card was last asked where it stands, and waits for its first report.
    ///
    /// # Errors
    /// The card does not take the settings, falls silent, or the port is gone. An alarm that is latched is none yet.
    pub fn open(&mut self, settings: CardSettings<A>) -> Result<(), LinkedCardError<P::Fault>> {
        self.host.open(settings);
        self.settings = Some(settings);
        self.until(HostEndpoint::is_open)?;
        // its outputs and its alarm come with the first period
        let begun = self.port.now_us();
        while !self.host.next_period() {
            if self.port.now_us().saturating_sub(begun) > self.patience.answer_us {
                return Err(self.timeout_error());
            }
            self.pump(WAIT_US);
        }
        Ok(())
    }

    /// Ends the epoch; the card then needs no host any more. It has to stand.
    ///
    /// # Errors
    /// The card falls silent, or the port is gone.
    pub fn close(&mut self) -> Result<(), LinkedCardError<P::Fault>> {
        self.host.close();
        self.until(HostEndpoint::is_closed)
    }

    /// The host's end.
    #[must_use]
    pub fn host(&self) -> &HostEndpoint<A> {
        &self.host
    }

    /// The port.
    #[must_use]
    pub fn port(&self) -> &P {
        &self.port
    }

    /// The port, without the host's end.
    #[must_use]
    pub fn into_port(self) -> P {
        self.port
    }

    /// The port, to be meddled with.
    pub fn port_mut(&mut self) -> &mut P {
        &mut self.port
    }

    fn until(&mut self, done: impl Fn(&HostEndpoint<A>) -> bool) -> Result<(), LinkedCardError<P::Fault>> {
        let begun = self.port.now_us();
        while !done(&self.host) {
            if self.port.now_us().saturating_sub(begun) > self.patience.answer_us {
                return Err(self.timeout_error());
            }
            self.pump(WAIT_US);
            if let Some(fault @ (LinkError::Protocol(_) | LinkError::Unfit | LinkError::Restarted)) = self.host.fault()
            {
                return Err(LinkedCardError::Host(fault));
            }
        }
        Ok(())
    }

    /// Tells the card to stop, as far as the line goes; the card does it anyway when it hears no more.
    fn flush_closing(&mut self) {
        let _ = self.host.send(HostCommand::rate(0));
        let begun = self.port.now_us();
        while self.port.now_us().saturating_sub(begun) < LET_GO_US {
            self.pump(WAIT_US);
        }
    }

    fn timeout_error(&mut self) -> LinkedCardError<P::Fault> {
        self.lost.take().map_or(LinkedCardError::Host(LinkError::Silent), LinkedCardError::Port)
    }

    /// Puts on the line what is due, and takes off it what has come. A line that is gone may come back: a cable that is plugged in
    /// again. Until then the card is silent, and for so long it is waited for.
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
                // What the port does not take is lost like any byte on the line, and comes again.
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

    fn send(&mut self, word: HostCommand<A>) -> Result<(), CommandRefusal> {
        self.host.send(word)
    }

    fn period(&mut self) -> Result<&CardStatus<A>, Self::Fault> {
        // The line is served also where periods wait to be given out.
        self.pump(0);
        while !self.host.next_period() {
            if let Some(fault) = self.host.fault() {
                self.flush_closing();
                return Err(LinkedCardError::Host(fault));
            }
            if self.host.silent_us() > self.patience.silence_us {
                return Err(self.timeout_error());
            }
            self.pump(WAIT_US);
        }
        Ok(self.host.status())
    }

    fn begin(&mut self, start: PathStart) -> Result<(), Self::Fault> {
        let Some(settings) = self.settings else { return Err(LinkedCardError::Host(LinkError::Unfit)) };
        if let Some(fault) = self.host.fault().filter(|fault| !matches!(fault, LinkError::Alarm(_))) {
            return Err(LinkedCardError::Host(fault));
        }
        let known = self.host.status().executed;
        // Homing sets counts that no report tells: the card is asked where it stands, once it has all that was said to it.
        self.until(HostEndpoint::is_acknowledged)?;
        self.request_greeting(self.nonce.wrapping_add(1))?;
        self.request_greeting_until(self.nonce, |said| said.at_rest)?;
        // A rate that was late let it move on after the report that the caller goes by: its start is of another place.
        if !self.host.is_where_reported() {
            return Err(LinkedCardError::Host(LinkError::Moved));
        }
        // What was executed meanwhile is executed.
        let meanwhile = self.host.greeting().map_or(0, |said| said.executed.wrapping_sub(known));
        let start = PathStart { executed: start.executed.wrapping_add(meanwhile), ..start };
        self.open(CardSettings { start, ..settings })
    }

    fn status(&self) -> &CardStatus<A> {
        self.host.status()
    }

    fn arrived(&self) -> u32 {
        self.host.arrived()
    }
}
