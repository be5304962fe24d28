//! Dead man's switch of a jog: it goes on only as long as the page that holds the button keeps sending beats.
//!
//! Invariant: at most one jog is held; whatever ends the beats ends it within [`HELD_JOG_TIMEOUT`].

use std::time::Duration;

use retrace_tui::HELD_JOG_TIMEOUT;

use crate::control::Client;

/// The jog that is held, if there is one. Times are those since the server began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct DeadMan {
    held: Option<HeldJog>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct HeldJog {
    client: Client,
    beat: u32,
    heard: Duration,
}

impl DeadMan {
    /// A page begins to hold a jog. Beats with another number do not belong to it.
    pub(crate) fn press(&mut self, client: Client, beat: u32, now: Duration) {
        self.held = Some(HeldJog { client, beat, heard: now });
    }

    /// A beat of a page. Returns whether it ends the jog: it is one of another jog of the same page.
    pub(crate) fn beat(&mut self, client: Client, beat: u32, now: Duration) -> bool {
        match &mut self.held {
            Some(held) if held.client == client && held.beat == beat => {
                held.heard = now;
                false
            }
            Some(held) if held.client == client => self.release(client),
            _ => false,
        }
    }

    /// A page releases its jog, or is gone. Returns whether there was one.
    pub(crate) fn release(&mut self, client: Client) -> bool {
        self.held.take_if(|held| held.client == client).is_some()
    }

    /// Returns whether the jog ends because no beat has come for too long.
    pub(crate) fn is_overdue(&mut self, now: Duration) -> bool {
        self.held.take_if(|held| now >= held.heard + HELD_JOG_TIMEOUT).is_some()
    }

    /// Time until the jog ends, unless a beat comes.
    pub(crate) fn left(&self, now: Duration) -> Option<Duration> {
        self.held.map(|held| (held.heard + HELD_JOG_TIMEOUT).saturating_sub(now))
    }

    /// Whether a jog is held.
    pub(crate) fn is_held(&self) -> bool {
        self.held.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn a_jog_ends_160_ms_after_its_last_beat() {
        let mut switch = DeadMan::default();
        switch.press(1, 7, ms(0));
        assert!(!switch.beat(1, 7, ms(150)) && !switch.is_overdue(ms(309)));
        assert_eq!((switch.left(ms(300)), switch.left(ms(311))), (Some(ms(10)), Some(ms(0))));
        assert!(switch.is_overdue(ms(310)) && !switch.is_overdue(ms(311)), "it ends once");
        assert!(!switch.beat(1, 7, ms(312)) && !switch.is_held(), "a late beat does not begin it again");
    }

    #[test]
    fn a_beat_of_another_jog_ends_it_and_one_of_another_page_does_nothing() {
        let mut switch = DeadMan::default();
        switch.press(1, 7, ms(0));
        assert!(!switch.beat(2, 7, ms(10)) && !switch.release(2) && switch.is_held());
        assert!(switch.beat(1, 8, ms(20)) && !switch.is_held());
        switch.press(1, 9, ms(30));
        assert!(switch.release(1) && !switch.release(1));
    }
}
