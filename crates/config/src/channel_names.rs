//! Names of the card's output channels.
//!
//! Invariant: every channel has a name; a cutter's name goes before that of the machine file.

use crate::machine_config::MachineConfig;

/// Names of the output channels of a machine.
#[derive(Clone, Debug, Default)]
pub struct ChannelNames(Vec<String>);

impl ChannelNames {
    /// Names of a machine's channels: a cutter's name, or that of the machine file, if there is one.
    #[must_use]
    pub fn of_machine(machine: &MachineConfig) -> Self {
        Self((0..retrace_link::channel::COUNT as u8).map(|channel| machine.channel_name(channel)).collect())
    }

    /// Name of a channel; the usual one where there is no other.
    #[must_use]
    pub fn name(&self, channel: u8) -> String {
        self.0.get(usize::from(channel)).cloned().unwrap_or_else(|| channel_name(channel))
    }
}

/// The usual name of an output channel.
#[must_use]
pub fn channel_name(channel: u8) -> String {
    use retrace_link::channel as c;
    match channel {
        c::SPINDLE => "spindle".into(),
        c::SPEED => "spindle speed".into(),
        c::MIST => "mist".into(),
        c::FLOOD => "flood".into(),
        c::TOOL => "tool".into(),
        digital => format!("output {digital}"),
    }
}
