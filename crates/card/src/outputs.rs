//! The outputs: what every channel carries, and which of them a latched alarm keeps safe.
//!
//! Invariant: while an alarm is latched, the channels that the settings call safe keep their safe values, whoever asks for another.

use retrace_link::{CommandRefusal, OutputChange, Outputs, channel};

/// The values of all channels.
#[derive(Clone, Debug)]
pub struct OutputBank {
    values: Outputs,
    /// Digital outputs that there are, from number 0 on.
    digital: u8,
    /// Channels that an alarm keeps, one bit each.
    locked: u128,
}

const _: () = assert!(channel::COUNT <= 128);

impl OutputBank {
    /// All zero, with so many digital outputs; the channels above [`channel::DIGITAL`] are always there.
    #[must_use]
    pub const fn new(digital: u8) -> Self {
        Self { values: [0; channel::COUNT], digital, locked: 0 }
    }

    /// The values.
    #[must_use]
    pub const fn values(&self) -> &Outputs {
        &self.values
    }

    /// The values, for the permit, which no alarm's safe value outranks.
    pub(crate) const fn values_mut(&mut self) -> &mut Outputs {
        &mut self.values
    }

    /// Is there such a channel?
    #[must_use]
    pub const fn has(&self, channel: u8) -> bool {
        has(self.digital, channel)
    }

    /// Sets a channel, unless an alarm keeps it: then nothing changes. So do instructions and actions in passing.
    pub fn set(&mut self, change: OutputChange) {
        if self.has(change.channel) && self.locked >> change.channel & 1 == 0 {
            self.values[usize::from(change.channel)] = change.value;
        }
    }

    /// Sets a channel by hand.
    ///
    /// # Errors
    /// There is no such channel, or an alarm keeps it at another value.
    pub fn set_by_hand(&mut self, change: OutputChange) -> Result<(), CommandRefusal> {
        if !self.has(change.channel) {
            return Err(CommandRefusal::NoSuchChannel);
        }
        if self.locked >> change.channel & 1 == 1 && self.values[usize::from(change.channel)] != change.value {
            return Err(CommandRefusal::Alarm);
        }
        self.set(change);
        Ok(())
    }

    /// Makes these changes at once and keeps their channels so until [`OutputBank::release`].
    pub fn keep_safe(&mut self, changes: &[OutputChange]) {
        self.locked = 0;
        for &change in changes {
            self.set(change);
        }
        let there = changes.iter().filter(|change| has(self.digital, change.channel));
        self.locked = there.fold(0, |locked, change| locked | 1 << change.channel);
    }

    /// Every channel may be set again; the values stay.
    pub const fn release(&mut self) {
        self.locked = 0;
    }
}

/// Has a card with so many digital outputs such a channel?
pub(crate) const fn has(digital: u8, channel: u8) -> bool {
    let number = channel as usize;
    channel < digital && number < channel::DIGITAL || channel::DIGITAL <= number && number < channel::COUNT
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_alarm_keeps_what_is_safe_and_nothing_else() {
        let mut bank = OutputBank::new(8);
        let change = |channel, value| OutputChange { channel, value };
        assert_eq!(bank.set_by_hand(change(8, 1)), Err(CommandRefusal::NoSuchChannel));
        assert_eq!(bank.set_by_hand(change(channel::COUNT as u8, 1)), Err(CommandRefusal::NoSuchChannel));
        bank.set(change(3, 1));
        bank.set(change(4, 1));
        bank.keep_safe(&[change(3, 0), change(channel::SPINDLE, 0), change(200, 1)]);
        bank.set(change(3, 1));
        assert_eq!(bank.set_by_hand(change(channel::SPINDLE, 1)), Err(CommandRefusal::Alarm));
        assert_eq!(bank.set_by_hand(change(3, 0)), Ok(()));
        bank.set(change(4, 2));
        assert_eq!((bank.values()[3], bank.values()[4], bank.values()[64]), (0, 2, 0));
        bank.keep_safe(&[change(3, 7)]);
        assert_eq!((bank.values()[3], bank.set_by_hand(change(64, 1))), (7, Ok(())), "what is safe was said anew");
        bank.release();
        assert_eq!(bank.set_by_hand(change(3, 1)), Ok(()));
        assert_eq!(bank.values()[3], 1);
    }
}
