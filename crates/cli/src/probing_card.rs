//! Card on a serial line with the limits of a probing move where it probes (PRB-3).
//!
//! Invariant: a path on which a probe is armed has the limits of a probing move, and every other one those of the
//! machine; nothing has moved on a path whose limits change.

use retrace_config::MachineConfig;
use retrace_core::RecordIndex;
use retrace_core::limits::RateLimits;
use retrace_hal_serial::SerialPort;
use retrace_link::{CardSettings, CardStatus, CommandRefusal, HostCommand, LinkedCard, MotionCard, PathStart};

use crate::linked_card::{SerialCard, nonce};

/// Error of a card on a serial line.
pub type Fault<const A: usize> = <LinkedCard<A, SerialPort> as MotionCard<A>>::Fault;

/// Card on a serial line, opened with the settings of the machine.
#[derive(Debug)]
pub struct ProbingCard<const A: usize> {
    card: SerialCard<A>,
    settings: CardSettings<A>,
    /// Limits of a path on which a probe is armed.
    probing: RateLimits<A>,
    /// Whether the path has them.
    is_limited: bool,
    start: PathStart,
    /// Error of a path that did not begin again for a probing move.
    failure: Option<Fault<A>>,
}

impl<const A: usize> ProbingCard<A> {
    /// A card that is opened with these settings, or will be.
    #[must_use]
    pub fn new(card: SerialCard<A>, settings: CardSettings<A>, machine: &MachineConfig) -> Self {
        let probing = machine.probing_rate_limits().unwrap_or(settings.limits);
        Self { card, settings, probing, is_limited: false, start: settings.start, failure: None }
    }

    /// Opens the card with its settings, and a path that begins here.
    ///
    /// # Errors
    /// As [`LinkedCard::open`].
    pub fn open(&mut self, start: PathStart) -> Result<(), Fault<A>> {
        self.card.open(CardSettings { start, ..self.settings })?;
        (self.start, self.is_limited) = (start, false);
        Ok(())
    }

    /// Returns the card on its line.
    pub fn card(&mut self) -> &mut SerialCard<A> {
        &mut self.card
    }

    /// Begins the path again that has just begun, with these limits. The machine rests where it begins: nothing was
    /// requested since.
    fn limit(&mut self, limits: RateLimits<A>) -> Result<(), Fault<A>> {
        self.card.request_greeting(nonce())?;
        let start = PathStart { executed: self.card.status().executed, ..self.start };
        self.card.open(CardSettings { start, limits, ..self.settings })
    }
}

impl<const A: usize> MotionCard<A> for ProbingCard<A> {
    type Fault = Fault<A>;

    fn window(&self) -> u32 {
        self.card.window()
    }

    fn send(&mut self, command: HostCommand<A>) -> Result<(), CommandRefusal> {
        let arms_probe = matches!(command, HostCommand::ArmProbe(_));
        if arms_probe && !self.is_limited && self.probing != self.settings.limits {
            if let Err(failure) = self.limit(self.probing) {
                self.failure = Some(failure);
                return Err(CommandRefusal::Busy);
            }
            self.is_limited = true;
        }
        self.card.send(command)
    }

    fn run_period(&mut self) -> Result<&CardStatus<A>, Fault<A>> {
        if let Some(failure) = self.failure.take() {
            return Err(failure);
        }
        self.card.run_period()
    }

    fn begin_path(&mut self, start: PathStart) -> Result<(), Fault<A>> {
        // That the machine rests where it was reported is found here, with whatever limits the last path had.
        self.card.begin_path(start)?;
        self.start = start;
        if self.is_limited {
            self.limit(self.settings.limits)?;
            self.is_limited = false;
        }
        Ok(())
    }

    fn status(&self) -> &CardStatus<A> {
        self.card.status()
    }

    fn acknowledged_high(&self) -> RecordIndex {
        self.card.acknowledged_high()
    }
}
