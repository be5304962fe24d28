//! `[serial]`: reception of programs over an RS-232 line (SHP-31). A program's address may override each key.
//!
//! Invariant: settings that exist are in their ranges.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::numbered_error::{NumberedError, nearest};
use crate::value_range::within;

/// Parity of the characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Parity {
    /// Even number of ones.
    Even,
    /// Odd number of ones.
    Odd,
    /// No parity bit.
    None,
}

/// Flow control: how the sender is paused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Handshake {
    /// By DC3 (XOFF) and DC1 (XON).
    XonXoff,
    /// By the RTS and CTS lines.
    RtsCts,
    /// By both methods.
    Both,
    /// None.
    None,
}

impl Handshake {
    /// Whether DC1 and DC3 are sent.
    #[must_use]
    pub fn has_xon_xoff(self) -> bool {
        matches!(self, Self::XonXoff | Self::Both)
    }

    /// Whether RTS is switched.
    #[must_use]
    pub fn has_rts_cts(self) -> bool {
        matches!(self, Self::RtsCts | Self::Both)
    }
}

/// Character code.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum CharacterCode {
    /// ISO 646 (ASCII).
    Iso,
    /// EIA RS-244.
    Eia,
    /// Detected at the first end of block.
    Auto,
}

/// The ends of a program in addition to the second percent sign.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProgramEnds {
    /// The second percent sign.
    pub percent: bool,
    /// EOT (04h).
    pub eot: bool,
    /// ETX (03h).
    pub etx: bool,
    /// A block with M02.
    pub m02: bool,
    /// A block with M30.
    pub m30: bool,
}

/// End of the program: `%`, `EOT`, `ETX`, `M02` or `M30`, or several of them.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(untagged)]
enum ProgramEndKeys {
    /// One end.
    One(String),
    /// Several ends.
    Several(Vec<String>),
}

/// The settings of a serial program source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SerialSettings {
    /// Bits per second, 110 … 115 200.
    pub baud: u32,
    /// Data bits, 7 or 8.
    pub bits: u8,
    /// Parity.
    pub parity: Parity,
    /// Stop bits, 1 or 2.
    pub stop: u8,
    /// How the sender is paused.
    pub handshake: Handshake,
    /// The code of the characters.
    pub code: CharacterCode,
    /// Timeout for the first character, s; 0: none.
    pub start_timeout_s: f64,
    /// Timeout for the next character, s; 0: none.
    pub silence_timeout_s: f64,
    /// What ends the program.
    pub end: ProgramEnds,
    /// Whether DC1 is repeated while nothing is received.
    pub dc_codes: bool,
    /// Number of NULs sent before and behind a program, where this control is the sender.
    pub leader: u32,
}

impl Default for SerialSettings {
    fn default() -> Self {
        Self {
            baud: 4800,
            bits: 7,
            parity: Parity::Even,
            stop: 2,
            handshake: Handshake::XonXoff,
            code: CharacterCode::Auto,
            start_timeout_s: 60.0,
            silence_timeout_s: 30.0,
            end: ProgramEnds { percent: true, ..ProgramEnds::default() },
            dc_codes: true,
            leader: 100,
        }
    }
}

/// Programs over a serial line, `[serial]`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct SerialSection {
    /// Bits per second.
    #[schemars(range(min = 110, max = 115_200))]
    baud: Option<u32>,
    /// Data bits.
    #[schemars(range(min = 7, max = 8))]
    bits: Option<u8>,
    /// Parity.
    parity: Option<Parity>,
    /// Stop bits.
    #[schemars(range(min = 1, max = 2))]
    stop: Option<u8>,
    /// Flow control.
    handshake: Option<Handshake>,
    /// Character code.
    code: Option<CharacterCode>,
    /// Timeout of the first character in s; 0 for none.
    start_timeout_s: Option<f64>,
    /// Timeout of the next character in s; 0 for none.
    silence_timeout_s: Option<f64>,
    /// End of the program.
    end: Option<ProgramEndKeys>,
    /// Whether DC1 is repeated while no character arrives.
    dc_codes: Option<bool>,
    /// NULs before and after a program that this control sends.
    leader: Option<u32>,
}

impl SerialSection {
    /// The settings, with every key in its range.
    pub(crate) fn checked(self) -> Result<SerialSettings, NumberedError> {
        let mut settings = SerialSettings::default();
        let end = match self.end {
            None => settings.end,
            Some(ProgramEndKeys::One(one)) => ends(&one)?,
            Some(ProgramEndKeys::Several(several)) => ends(&several.join(","))?,
        };
        settings = SerialSettings {
            baud: self.baud.unwrap_or(settings.baud),
            bits: self.bits.unwrap_or(settings.bits),
            parity: self.parity.unwrap_or(settings.parity),
            stop: self.stop.unwrap_or(settings.stop),
            handshake: self.handshake.unwrap_or(settings.handshake),
            code: self.code.unwrap_or(settings.code),
            start_timeout_s: self.start_timeout_s.unwrap_or(settings.start_timeout_s),
            silence_timeout_s: self.silence_timeout_s.unwrap_or(settings.silence_timeout_s),
            end,
            dc_codes: self.dc_codes.unwrap_or(settings.dc_codes),
            leader: self.leader.unwrap_or(settings.leader),
        };
        settings.check()?;
        Ok(settings)
    }
}

/// The names of the settings, as the machine file and a program's address write them.
const KEYS: [&str; 12] = [
    "baud",
    "bits",
    "parity",
    "stop",
    "handshake",
    "code",
    "start_timeout_s",
    "silence_timeout_s",
    "end",
    "dc_codes",
    "leader",
    "format",
];

impl SerialSettings {
    fn check(&self) -> Result<(), NumberedError> {
        within("serial.baud", f64::from(self.baud), 110.0, 115_200.0)?;
        within("serial.bits", f64::from(self.bits), 7.0, 8.0)?;
        within("serial.stop", f64::from(self.stop), 1.0, 2.0)?;
        within("serial.start_timeout_s", self.start_timeout_s, 0.0, 86_400.0)?;
        within("serial.silence_timeout_s", self.silence_timeout_s, 0.0, 86_400.0)?;
        within("serial.leader", f64::from(self.leader), 0.0, 10_000.0)
    }

    /// Sets one setting from the parameter `key=value` of a program's address; `format=7e2` sets bits, parity and stop
    /// bits.
    ///
    /// # Errors
    /// `E2301`: no such setting, or no such value.
    pub fn set(&mut self, key: &str, value: &str) -> Result<(), NumberedError> {
        let refuse = |remedy: &str| {
            NumberedError::new("E2301", format!("the serial setting {key}={value} is not known"), remedy)
        };
        let number = || value.parse::<u32>().map_err(|_| refuse("write a whole number"));
        let seconds = || value.parse::<f64>().map_err(|_| refuse("write seconds, 0 for ever"));
        match key {
            "baud" => self.baud = number()?,
            "bits" => self.bits = number()?.min(255) as u8,
            "stop" => self.stop = number()?.min(255) as u8,
            "leader" => self.leader = number()?,
            "start_timeout_s" => self.start_timeout_s = seconds()?,
            "silence_timeout_s" => self.silence_timeout_s = seconds()?,
            "parity" => self.parity = parity(value).ok_or_else(|| refuse("even, odd or none"))?,
            "handshake" => {
                self.handshake = match value {
                    "xon-xoff" => Handshake::XonXoff,
                    "rts-cts" => Handshake::RtsCts,
                    "both" => Handshake::Both,
                    "none" => Handshake::None,
                    _ => return Err(refuse("xon-xoff, rts-cts, both or none")),
                }
            }
            "code" => {
                self.code = match value {
                    "iso" => CharacterCode::Iso,
                    "eia" => CharacterCode::Eia,
                    "auto" => CharacterCode::Auto,
                    _ => return Err(refuse("iso, eia or auto")),
                }
            }
            "dc_codes" => {
                self.dc_codes = match value {
                    "on" | "true" => true,
                    "off" | "false" => false,
                    _ => return Err(refuse("on or off")),
                }
            }
            "end" => self.end = ends(value)?,
            "format" => {
                let [bits @ (b'7' | b'8'), letter, stop @ (b'1' | b'2')] = value.as_bytes() else {
                    return Err(refuse("bits, parity and stop bits, as in 7e2 or 8n1"));
                };
                let named = match letter.to_ascii_lowercase() {
                    b'e' => Parity::Even,
                    b'o' => Parity::Odd,
                    b'n' => Parity::None,
                    _ => return Err(refuse("bits, parity and stop bits, as in 7e2 or 8n1")),
                };
                (self.bits, self.parity, self.stop) = (bits - b'0', named, stop - b'0');
            }
            _ => {
                let remedy = match nearest(key, KEYS.iter().copied()) {
                    Some(key) => format!("did you mean `{key}`?"),
                    None => format!("the settings are {}", KEYS.join(", ")),
                };
                return Err(refuse(&remedy));
            }
        }
        self.check().map_err(|refusal| NumberedError { number: "E2301", ..refusal })
    }
}

fn parity(value: &str) -> Option<Parity> {
    match value {
        "even" => Some(Parity::Even),
        "odd" => Some(Parity::Odd),
        "none" => Some(Parity::None),
        _ => None,
    }
}

/// `percent`, or a list of what ends a program, separated by commas.
fn ends(text: &str) -> Result<ProgramEnds, NumberedError> {
    let mut ends = ProgramEnds::default();
    for name in text.split(',') {
        match name.trim() {
            "percent" | "%" => ends.percent = true,
            "EOT" => ends.eot = true,
            "ETX" => ends.etx = true,
            "M02" | "M2" => ends.m02 = true,
            "M30" => ends.m30 = true,
            other => {
                let what = format!("the serial setting end={other} is not known");
                return Err(NumberedError::new("E2301", what, "percent, or a list of %, EOT, ETX, M02, M30"));
            }
        }
    }
    Ok(ends)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_sets_what_the_machine_file_sets() {
        let mut settings = SerialSettings::default();
        for (key, value) in [
            ("baud", "9600"),
            ("format", "8n1"),
            ("handshake", "both"),
            ("code", "eia"),
            ("end", "EOT,M30"),
            ("dc_codes", "off"),
            ("silence_timeout_s", "0"),
        ] {
            settings.set(key, value).expect("known");
        }
        let text = "baud = 9600\nbits = 8\nparity = \"none\"\nstop = 1\nhandshake = \"both\"\ncode = \"eia\"\n\
            end = [\"EOT\", \"M30\"]\ndc_codes = false\nsilence_timeout_s = 0.0\n";
        let written: SerialSection = toml::from_str(text).expect("a table");
        assert_eq!(written.checked(), Ok(settings));
        assert_eq!(SerialSection::default().checked(), Ok(SerialSettings::default()));
    }

    #[test]
    fn what_is_not_known_is_refused_with_what_is() {
        let refused = |key: &str, value: &str| SerialSettings::default().set(key, value).expect_err("not known");
        for (key, value) in [
            ("baud", "50"),
            ("baud", "fast"),
            ("format", "9e1"),
            ("format", "7x1"),
            ("end", "STX"),
            ("parity", "mark"),
            ("bits", "5"),
        ] {
            assert_eq!(refused(key, value).number, "E2301", "{key}={value}");
        }
        assert_eq!(refused("boud", "9600").remedy, "did you mean `baud`?");
    }
}
