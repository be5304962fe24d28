//! A card of whatever kind, so that what runs on one is compiled once and not for each kind.
//!
//! Invariant: every call reaches the card unchanged; only the type of its errors is lost, and not what they say.

use std::fmt;

use retrace_link::{CardFailure, CardStatus, CommandRefusal, HostCommand, MotionCard, PathStart};

/// A card of whatever kind.
pub struct AnyCard<'c, const A: usize>(Box<dyn MotionCard<A, Fault = AnyCardFailure> + Send + 'c>);

impl<'c, const A: usize> AnyCard<'c, A> {
    /// The card without its kind.
    #[must_use]
    pub fn new(card: impl MotionCard<A> + Send + 'c) -> Self {
        Self(Box::new(OfKind(card)))
    }
}

/// What the error of a card says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AnyCardFailure {
    number: &'static str,
    cause: String,
    remedy: &'static str,
}

impl fmt::Display for AnyCardFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.cause)
    }
}

impl CardFailure for AnyCardFailure {
    fn number(&self) -> &'static str {
        self.number
    }

    fn remedy(&self) -> &'static str {
        self.remedy
    }
}

fn of_any_kind(failure: &impl CardFailure) -> AnyCardFailure {
    AnyCardFailure { number: failure.number(), cause: failure.to_string(), remedy: failure.remedy() }
}

/// A card of this kind.
struct OfKind<C>(C);

impl<const A: usize, C: MotionCard<A>> MotionCard<A> for OfKind<C> {
    type Fault = AnyCardFailure;

    fn window(&self) -> u32 {
        self.0.window()
    }

    fn send(&mut self, command: HostCommand<A>) -> Result<(), CommandRefusal> {
        self.0.send(command)
    }

    fn run_period(&mut self) -> Result<&CardStatus<A>, AnyCardFailure> {
        self.0.run_period().map_err(|failure| of_any_kind(&failure))
    }

    fn begin_path(&mut self, start: PathStart) -> Result<(), AnyCardFailure> {
        self.0.begin_path(start).map_err(|failure| of_any_kind(&failure))
    }

    fn status(&self) -> &CardStatus<A> {
        self.0.status()
    }

    fn acknowledged_high(&self) -> retrace_core::RecordIndex {
        self.0.acknowledged_high()
    }
}

impl<const A: usize> MotionCard<A> for AnyCard<'_, A> {
    type Fault = AnyCardFailure;

    fn window(&self) -> u32 {
        self.0.window()
    }

    fn send(&mut self, command: HostCommand<A>) -> Result<(), CommandRefusal> {
        self.0.send(command)
    }

    fn run_period(&mut self) -> Result<&CardStatus<A>, AnyCardFailure> {
        self.0.run_period()
    }

    fn begin_path(&mut self, start: PathStart) -> Result<(), AnyCardFailure> {
        self.0.begin_path(start)
    }

    fn status(&self) -> &CardStatus<A> {
        self.0.status()
    }

    fn acknowledged_high(&self) -> retrace_core::RecordIndex {
        self.0.acknowledged_high()
    }
}
