//! The outputs: the values of all channels, and those that a latched alarm keeps safe.
//!
//! Invariant: while an alarm is latched, the channels that the settings define as safe keep their safe values, whatever
//! is requested.

use retrace_link::{CardIdentity, CommandRefusal, OutputChange, Outputs, channel};

/// Numbers of the outputs that differ between cards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutputCounts {
    /// Digital outputs, from number 0 on.
    pub digital: u8,
    /// Analog outputs, from number 0 on.
    pub analog: u8,
}

impl OutputCounts {
    /// All that the protocol knows.
    pub const ALL: Self = Self { digital: channel::DIGITAL as u8, analog: channel::ANALOG_OUTPUTS as u8 };

    /// Returns the numbers that the identity of a card names.
    #[must_use]
    pub const fn of(identity: &CardIdentity) -> Self {
        Self { digital: identity.outputs, analog: identity.analog.outputs() }
    }

    /// Whether a card with so many outputs has this channel. The channels from [`channel::DIGITAL`] on that are not
    /// analog always exist.
    #[must_use]
    pub const fn has_channel(self, channel: u8) -> bool {
        if (channel as usize) < channel::DIGITAL {
            channel < self.digital
        } else if channel::is_analog(channel) {
            channel - channel::ANALOG < self.analog
        } else {
            channel::is_output(channel)
        }
    }
}

/// Values of all channels.
#[derive(Clone, Debug)]
pub struct OutputBank {
    values: Outputs,
    counts: OutputCounts,
    /// Channels that an alarm has locked, one bit each.
    locked: u128,
}

const _: () = assert!(channel::COUNT <= 128);

impl OutputBank {
    /// Creates a bank with all values zero and so many outputs.
    #[must_use]
    pub const fn new(counts: OutputCounts) -> Self {
        Self { values: [0; channel::COUNT], counts, locked: 0 }
    }

    /// Returns the values.
    #[must_use]
    pub const fn values(&self) -> &Outputs {
        &self.values
    }

    /// Returns the values for the permit, which overrides the safe value of an alarm.
    pub(crate) const fn values_mut(&mut self) -> &mut Outputs {
        &mut self.values
    }

    /// Whether the channel exists.
    #[must_use]
    pub const fn has_channel(&self, channel: u8) -> bool {
        self.counts.has_channel(channel)
    }

    /// Sets a channel, unless an alarm has locked it: then nothing changes. Used by instructions and actions.
    pub fn set(&mut self, change: OutputChange) {
        if self.has_channel(change.channel) && self.locked >> change.channel & 1 == 0 {
            self.values[usize::from(change.channel)] = change.value;
        }
    }

    /// Sets a channel manually.
    ///
    /// # Errors
    /// The channel does not exist, or an alarm has locked it at another value.
    pub fn set_manually(&mut self, change: OutputChange) -> Result<(), CommandRefusal> {
        if !self.has_channel(change.channel) {
            return Err(CommandRefusal::NoSuchChannel);
        }
        if self.locked >> change.channel & 1 == 1 && self.values[usize::from(change.channel)] != change.value {
            return Err(CommandRefusal::Alarm);
        }
        self.set(change);
        Ok(())
    }

    /// Makes these changes at once and locks their channels until [`OutputBank::release`].
    pub fn lock_safe(&mut self, changes: &[OutputChange]) {
        self.locked = 0;
        for &change in changes {
            self.set(change);
        }
        let existing = changes.iter().filter(|change| self.counts.has_channel(change.channel));
        self.locked = existing.fold(0, |locked, change| locked | 1 << change.channel);
    }

    /// Unlocks every channel; the values are unchanged.
    pub const fn release(&mut self) {
        self.locked = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_alarm_keeps_what_is_safe_and_nothing_else() {
        let mut bank = OutputBank::new(OutputCounts { digital: 8, analog: 2 });
        let change = |channel, value| OutputChange { channel, value };
        assert_eq!(bank.set_manually(change(8, 1)), Err(CommandRefusal::NoSuchChannel));
        assert_eq!(bank.set_manually(change(channel::COUNT as u8, 1)), Err(CommandRefusal::NoSuchChannel));
        let analog = [channel::HEIGHT, u8::MAX, channel::ANALOG + 2, channel::COUNT as u8 - 1];
        for none in analog {
            assert_eq!(bank.set_manually(change(none, 1)), Err(CommandRefusal::NoSuchChannel), "{none}");
        }
        assert_eq!(bank.set_manually(change(channel::ANALOG + 1, 5 * channel::ANALOG_ONE)), Ok(()));
        bank.set(change(3, 1));
        bank.set(change(4, 1));
        bank.lock_safe(&[change(3, 0), change(channel::SPINDLE, 0), change(200, 1)]);
        bank.set(change(3, 1));
        assert_eq!(bank.set_manually(change(channel::SPINDLE, 1)), Err(CommandRefusal::Alarm));
        assert_eq!(bank.set_manually(change(3, 0)), Ok(()));
        bank.lock_safe(&[change(3, 0), change(channel::SPINDLE, 0), change(channel::ANALOG + 1, 4)]);
        bank.set(change(channel::ANALOG + 1, 7));
        assert_eq!(bank.values()[usize::from(channel::ANALOG) + 1], 4, "an analog output has a safe value of its own");
        bank.set(change(4, 2));
        assert_eq!((bank.values()[3], bank.values()[4], bank.values()[64]), (0, 2, 0));
        bank.lock_safe(&[change(3, 7)]);
        assert_eq!((bank.values()[3], bank.set_manually(change(64, 1))), (7, Ok(())), "what is safe was said anew");
        bank.release();
        assert_eq!(bank.set_manually(change(3, 1)), Ok(()));
        assert_eq!(bank.values()[3], 1);
    }
}
