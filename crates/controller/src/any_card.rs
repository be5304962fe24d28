//! Any motion card behind one type, so that what runs on a card is compiled once and not once for each type of card.
//!
//! Invariant: every call reaches the card, and every answer comes back, unchanged; an error keeps its number, cause and
//! remedy and loses its type.

use std::fmt;
use std::ops::DerefMut;

use retrace_link::{CardFailure, CardStatus, CommandRefusal, HostCommand, MotionCard, PathStart};

/// Any motion card.
pub type AnyCard<'c, const A: usize> = ErasedFailure<Box<dyn MotionCard<A, Fault = AnyCardFailure> + Send + 'c>>;

impl<'c, const A: usize> AnyCard<'c, A> {
    /// Hides the type of a card.
    #[must_use]
    pub fn new(card: &'c mut (impl MotionCard<A> + Send)) -> Self {
        Self(Box::new(ErasedFailure(card)))
    }
}

/// Error of any motion card.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AnyCardFailure {
    number: &'static str,
    cause: String,
    remedy: &'static str,
}

impl AnyCardFailure {
    fn new(failure: &impl CardFailure) -> Self {
        Self { number: failure.number(), cause: failure.to_string(), remedy: failure.remedy() }
    }
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

/// The card behind this pointer, with errors that do not have its own type.
pub struct ErasedFailure<P>(P);

impl<const A: usize, P: DerefMut<Target: MotionCard<A>>> MotionCard<A> for ErasedFailure<P> {
    type Fault = AnyCardFailure;

    fn window(&self) -> u32 {
        self.0.window()
    }

    fn send(&mut self, command: HostCommand<A>) -> Result<(), CommandRefusal> {
        self.0.send(command)
    }

    fn run_period(&mut self) -> Result<&CardStatus<A>, AnyCardFailure> {
        self.0.run_period().map_err(|failure| AnyCardFailure::new(&failure))
    }

    fn begin_path(&mut self, start: PathStart) -> Result<(), AnyCardFailure> {
        self.0.begin_path(start).map_err(|failure| AnyCardFailure::new(&failure))
    }

    fn status(&self) -> &CardStatus<A> {
        self.0.status()
    }

    fn acknowledged_high(&self) -> retrace_core::RecordIndex {
        self.0.acknowledged_high()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use retrace_core::RecordIndex;

    /// A card that rejects what it can, and whose figures are all different.
    struct Rejecting(CardStatus<2>);

    struct Broken(&'static str);

    impl fmt::Display for Broken {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            write!(f, "{} is broken", self.0)
        }
    }

    impl CardFailure for Broken {
        fn number(&self) -> &'static str {
            "E3000"
        }

        fn remedy(&self) -> &'static str {
            "repair it"
        }
    }

    impl MotionCard<2> for Rejecting {
        type Fault = Broken;

        fn window(&self) -> u32 {
            77
        }

        fn send(&mut self, _: HostCommand<2>) -> Result<(), CommandRefusal> {
            Err(CommandRefusal::Busy)
        }

        fn run_period(&mut self) -> Result<&CardStatus<2>, Broken> {
            Err(Broken("the period"))
        }

        fn begin_path(&mut self, _: PathStart) -> Result<(), Broken> {
            Err(Broken("the path"))
        }

        fn status(&self) -> &CardStatus<2> {
            &self.0
        }

        fn acknowledged_high(&self) -> RecordIndex {
            RecordIndex::new(5)
        }
    }

    #[test]
    fn each_call_reaches_the_card_and_its_answer_comes_back() {
        let mut card =
            Rejecting(CardStatus { counts: [3, -4], ..CardStatus::at_rest(PathStart::at(RecordIndex::new(9))) });
        let status = card.0;
        let mut card = AnyCard::new(&mut card);
        let failure = |cause: &str| AnyCardFailure { number: "E3000", cause: cause.into(), remedy: "repair it" };
        assert_eq!((card.window(), card.acknowledged_high()), (77, RecordIndex::new(5)));
        assert_eq!(card.status(), &status);
        assert_eq!(card.send(HostCommand::ClearAlarm), Err(CommandRefusal::Busy));
        assert_eq!(card.run_period().err(), Some(failure("the period is broken")));
        assert_eq!(card.begin_path(PathStart::at(RecordIndex::new(0))), Err(failure("the path is broken")));
    }
}
