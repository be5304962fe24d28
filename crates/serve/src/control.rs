//! Who is in control: one page at a time holds it, all others watch.
//!
//! Invariant: control passes from one page to another only with the first one's consent, or where the machine is at
//! rest; passing it starts nothing. Each time it passes, the turn number grows, and orders of an older turn are
//! refused.

use std::time::Duration;

/// Time for the holder to answer a request for control.
const ANSWER_TIME: Duration = Duration::from_secs(10);

/// Time after which a page whose link is lost no longer holds control.
const LOST_TIME: Duration = Duration::from_secs(30);

/// Number of a connected page.
pub(crate) type Client = u32;

/// Why an order is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ControlError {
    /// Nobody, or another page, is in control.
    NotHolder,
    /// The order belongs to an earlier turn.
    OldTurn,
}

impl std::fmt::Display for ControlError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::NotHolder => "this page is not in control",
            Self::OldTurn => "control was taken over in between",
        })
    }
}

impl std::error::Error for ControlError {}

/// Who is in control. Times are those since the server began.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Control {
    holder: Option<Client>,
    /// When the holder's link was lost.
    lost: Option<Duration>,
    turn: u32,
    /// Page that asks for control, and when it asked.
    request: Option<(Client, Duration)>,
}

impl Control {
    /// Page in control, also while its link is lost.
    pub(crate) fn holder(&self) -> Option<Client> {
        self.holder
    }

    /// Number of the turn.
    pub(crate) fn turn(&self) -> u32 {
        self.turn
    }

    /// Page that asks for control, and the seconds that are left for an answer.
    pub(crate) fn request(&self, now: Duration) -> Option<(Client, u64)> {
        let (client, asked) = self.request?;
        Some((client, (asked + ANSWER_TIME).saturating_sub(now).as_secs_f64().ceil() as u64))
    }

    /// Checks that a page may give an order of this turn.
    pub(crate) fn check(&self, client: Client, turn: u32) -> Result<(), ControlError> {
        if self.holder != Some(client) {
            Err(ControlError::NotHolder)
        } else if turn != self.turn {
            Err(ControlError::OldTurn)
        } else {
            Ok(())
        }
    }

    /// A page takes control, or asks for it where another one has it.
    pub(crate) fn take(&mut self, client: Client, at_rest: bool, now: Duration) {
        match self.holder {
            Some(holder) if holder == client => {}
            Some(_) if !(self.lost.is_some() && at_rest) => {
                if self.request.is_none() {
                    self.request = Some((client, now));
                }
            }
            _ => self.pass_to(Some(client)),
        }
    }

    /// The holder gives control to the page that asks for it.
    pub(crate) fn give(&mut self, client: Client) {
        if let (Some(holder), Some((asking, _))) = (self.holder, self.request)
            && holder == client
        {
            self.pass_to(Some(asking));
        }
    }

    /// The holder keeps control.
    pub(crate) fn keep(&mut self, client: Client) {
        if self.holder == Some(client) {
            self.request = None;
        }
    }

    /// The holder releases control, or a page that asks for it no longer does.
    pub(crate) fn release(&mut self, client: Client) {
        if self.holder == Some(client) {
            self.pass_to(self.request.map(|(asking, _)| asking));
        } else if self.request.is_some_and(|(asking, _)| asking == client) {
            self.request = None;
        }
    }

    /// A page's link is lost. Returns whether it was in control.
    pub(crate) fn disconnect(&mut self, client: Client, now: Duration) -> bool {
        if self.request.is_some_and(|(asking, _)| asking == client) {
            self.request = None;
        }
        let was_holder = self.holder == Some(client);
        if was_holder {
            self.lost = Some(now);
        }
        was_holder
    }

    /// Lets time pass.
    pub(crate) fn advance(&mut self, at_rest: bool, now: Duration) {
        if let Some((asking, asked)) = self.request
            && at_rest
            && (now >= asked + ANSWER_TIME || self.lost.is_some())
        {
            self.pass_to(Some(asking));
        }
        if self.lost.is_some_and(|lost| now >= lost + LOST_TIME) {
            self.pass_to(self.request.map(|(asking, _)| asking));
        }
    }

    fn pass_to(&mut self, client: Option<Client>) {
        (self.holder, self.lost, self.request) = (client, None, None);
        self.turn = self.turn.wrapping_add(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const fn at(seconds: u64) -> Duration {
        Duration::from_secs(seconds)
    }

    #[test]
    fn control_is_free_at_first_and_asked_for_later() {
        let mut control = Control::default();
        control.take(1, false, at(0));
        assert_eq!((control.holder(), control.turn()), (Some(1), 1));
        control.take(2, false, at(1));
        assert_eq!((control.holder(), control.request(at(2))), (Some(1), Some((2, 9))));
        control.keep(1);
        assert_eq!(control.request(at(2)), None);
        control.take(2, false, at(3));
        control.give(2);
        assert_eq!(control.holder(), Some(1), "only the holder gives it");
        control.give(1);
        assert_eq!((control.holder(), control.turn()), (Some(2), 2));
        assert_eq!(control.check(1, 2), Err(ControlError::NotHolder));
        assert_eq!(control.check(2, 1), Err(ControlError::OldTurn));
        assert_eq!(control.check(2, 2), Ok(()));
    }

    #[test]
    fn without_an_answer_control_passes_at_rest_only() {
        let mut control = Control::default();
        control.take(1, true, at(0));
        control.take(2, true, at(1));
        control.advance(true, at(10));
        assert_eq!(control.holder(), Some(1));
        control.advance(false, at(60));
        assert_eq!(control.holder(), Some(1), "the machine moves");
        control.advance(true, at(61));
        assert_eq!(control.holder(), Some(2));
    }

    #[test]
    fn a_page_that_comes_back_is_another_one_and_has_no_control() {
        let mut control = Control::default();
        control.take(1, true, at(0));
        assert!(control.disconnect(1, at(5)) && !control.disconnect(2, at(5)));
        control.take(3, false, at(6));
        assert_eq!(control.holder(), Some(1), "the machine moves, and nobody has taken over");
        control.advance(true, at(7));
        assert_eq!(control.holder(), Some(3));
        control.disconnect(3, at(8));
        control.advance(false, at(37));
        assert_eq!(control.holder(), Some(3));
        control.advance(false, at(38));
        assert_eq!((control.holder(), control.turn()), (None, 3), "it is free again");
    }

    proptest! {
        /// Whatever pages do: control passes while the machine moves only by give, release, or from a lost page after
        /// its time; and each passing makes a new turn.
        #[test]
        fn control_passes_only_with_consent_or_at_rest(
            steps in prop::collection::vec((0u8..6, 1u32..5, any::<bool>(), 0u64..15), 1..200),
        ) {
            let mut control = Control::default();
            let mut now = Duration::ZERO;
            for (what, client, at_rest, seconds) in steps {
                now += Duration::from_secs(seconds);
                let before = control.clone();
                match what {
                    0 => control.take(client, at_rest, now),
                    1 => control.give(client),
                    2 => control.keep(client),
                    3 => control.release(client),
                    4 => _ = control.disconnect(client, now),
                    _ => control.advance(at_rest, now),
                }
                if control.holder != before.holder {
                    prop_assert_eq!(control.turn, before.turn + 1);
                    let consents = matches!(what, 1 | 3) && before.holder == Some(client);
                    let was_free = before.holder.is_none();
                    let was_lost = before.lost.is_some_and(|lost| now >= lost + LOST_TIME);
                    prop_assert!(consents || was_free || was_lost || at_rest, "{:?} {:?}", before, control);
                } else {
                    prop_assert_eq!(control.turn, before.turn);
                }
            }
        }
    }
}
