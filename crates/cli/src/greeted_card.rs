//! A card that has been greeted, before its path starts.
//!
//! Invariant: it is opened where it was greeted, at rest, or not at all.

use retrace_core::RecordIndex;
use retrace_link::{CardStatus, HostCommand, LinkError, LinkedCardError, MotionCard, PathStart};

use crate::linked_card::nonce;
use crate::probing_card::{Fault, ProbingCard};

/// Number of control periods within which a card reports that it has cleared an alarm.
const CLEARED_WITHIN: u32 = 500;

/// Card that has been greeted and is opened when its path starts: until then it needs no host, however long the
/// operator takes.
#[derive(Debug)]
pub struct GreetedCard<const A: usize> {
    card: ProbingCard<A>,
    /// Status when it was greeted.
    status: CardStatus<A>,
    boot: u32,
    is_open: bool,
}

impl<const A: usize> GreetedCard<A> {
    /// Card with this status.
    #[must_use]
    pub fn new(card: ProbingCard<A>, status: CardStatus<A>, boot: u32) -> Self {
        Self { card, status, boot, is_open: false }
    }

    /// Ends the epoch, if one is open.
    pub fn close(mut self) {
        if self.is_open {
            // The card is at rest, or has an alarm that says more than an error here would.
            let _ = self.card.card().close();
        }
    }

    fn open(&mut self, start: PathStart) -> Result<(), Fault<A>> {
        self.card.card().wait_at_rest(nonce())?;
        let mut counts = self.status.counts;
        let same = |greeting: &retrace_link::Greeting<A>| {
            // The card's greeting includes the layer.
            counts
                .iter_mut()
                .skip(usize::from(greeting.layer.0))
                .take(1)
                .for_each(|n| *n += i64::from(self.status.layer));
            greeting.identity.boot == self.boot && greeting.counts == counts
        };
        if !self.card.card().greeting().is_some_and(same) {
            return Err(LinkedCardError::Host(LinkError::Restarted));
        }
        self.card.open(start)?;
        self.is_open = true;
        if self.card.status().alarm.is_some() {
            // A rejected command shows in the card's reports.
            let _ = self.card.send(HostCommand::ClearAlarm);
            for _ in 0..CLEARED_WITHIN {
                if self.card.run_period()?.alarm.is_none() {
                    break;
                }
            }
        }
        Ok(())
    }
}

impl<const A: usize> MotionCard<A> for GreetedCard<A> {
    type Fault = Fault<A>;

    fn window(&self) -> u32 {
        self.card.window()
    }

    fn send(&mut self, word: HostCommand<A>) -> Result<(), retrace_link::CommandRefusal> {
        if self.is_open { self.card.send(word) } else { Err(retrace_link::CommandRefusal::Unsupported) }
    }

    fn run_period(&mut self) -> Result<&CardStatus<A>, Fault<A>> {
        self.card.run_period()
    }

    fn begin_path(&mut self, start: PathStart) -> Result<(), Fault<A>> {
        if self.is_open { self.card.begin_path(start) } else { self.open(start) }
    }

    fn status(&self) -> &CardStatus<A> {
        if self.is_open { self.card.status() } else { &self.status }
    }

    fn acknowledged_high(&self) -> RecordIndex {
        if self.is_open { self.card.acknowledged_high() } else { self.status.high }
    }
}
