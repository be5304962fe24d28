//! Names of the card's output channels, and texts of their values.
//!
//! Invariant: every channel has a name; a cutter's name goes before that of the machine file.

use retrace_link::channel;

use crate::analog_output::analog_amount;

/// Names of the output channels of a machine, and the units of its analog outputs.
#[derive(Clone, Debug, Default)]
pub struct ChannelNames {
    pub(crate) names: Vec<String>,
    /// Units by the number of the analog output; empty where there is none.
    pub(crate) units: [String; channel::ANALOG_OUTPUTS],
}

impl ChannelNames {
    /// Name of a channel; the usual one where there is no other.
    #[must_use]
    pub fn name(&self, channel: u8) -> String {
        self.names.get(usize::from(channel)).cloned().unwrap_or_else(|| channel_name(channel))
    }

    /// Unit of a channel: that of an analog output of the machine; `None` for any other channel.
    #[must_use]
    pub fn unit(&self, channel: u8) -> Option<&str> {
        let number = channel.checked_sub(channel::ANALOG)?;
        self.units.get(usize::from(number)).map(String::as_str).filter(|unit| !unit.is_empty())
    }

    /// Text of a value of a channel: of an analog output the amount with its unit, otherwise the number.
    #[must_use]
    pub fn value_text(&self, channel: u8, value: i32) -> String {
        match self.unit(channel) {
            Some(unit) => amount_text(value, unit),
            None => value.to_string(),
        }
    }
}

/// Text of a value of an analog output: the amount, to a ten-thousandth, with its unit.
#[must_use]
pub fn amount_text(value: i32, unit: &str) -> String {
    // Rounded values print without trailing zeros, and −0 as 0.
    let amount = (analog_amount(value) * 1e4).round() / 1e4 + 0.0;
    format!("{amount} {unit}")
}

/// The usual name of an output channel.
#[must_use]
pub fn channel_name(channel: u8) -> String {
    use retrace_link::channel as c;
    match channel {
        analog if c::is_analog(analog) => format!("analog output {}", analog - c::ANALOG),
        c::SPINDLE => "spindle".into(),
        c::SPEED => "spindle speed".into(),
        c::MIST => "mist".into(),
        c::FLOOD => "flood".into(),
        c::TOOL => "tool".into(),
        c::UNWATCHED => "loss ignored".into(),
        c::HEIGHT_HOLD => "height held".into(),
        c::HEIGHT_OFFSET => "height offset".into(),
        digital => format!("output {digital}"),
    }
}
