//! Names of the card's output channels.
//!
//! Invariant: every channel has a name; a cutter's name goes before that of the machine file.

/// Names of the output channels of a machine.
#[derive(Clone, Debug, Default)]
pub struct ChannelNames(pub(crate) Vec<String>);

impl ChannelNames {
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
        c::UNWATCHED => "loss ignored".into(),
        digital => format!("output {digital}"),
    }
}
