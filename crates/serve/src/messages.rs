//! Messages of pages. The API's page, docs/serve-api.md, has what each does.
//!
//! Invariant: a field that is not known is an error, so that no misspelt safeguard is ignored.

use retrace_controller::JogSpeed;
use serde::Deserialize;

/// A message of a page.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(tag = "t", rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum PageMessage {
    /// Feed hold, and the end of a jog.
    Hold {},
    /// An order of the operator.
    Do {
        /// Number of the order, which the answer names.
        id: u32,
        /// Turn of control.
        turn: u32,
        /// Number of the state that the operator saw.
        seen: u32,
        /// What to do.
        words: String,
    },
    /// Turns the handwheel.
    Wheel {
        /// Turn of control.
        turn: u32,
        /// Counts, signed.
        counts: i32,
    },
    /// A continuous jog, held to run.
    Jog {
        /// Number of the order, which the answer names.
        id: u32,
        /// Turn of control.
        turn: u32,
        /// Number of the state that the operator saw.
        seen: u32,
        /// Axis letter.
        axis: String,
        /// Whether in positive direction.
        up: bool,
        /// How fast.
        #[serde(default)]
        speed: HeldJogSpeed,
        /// Number of its beats.
        beat: u32,
    },
    /// The jog is still held.
    Beat {
        /// Number of the jog's beats.
        beat: u32,
    },
    /// The jog is released.
    JogEnd {},
    /// Takes or passes control.
    Control {
        /// What to do.
        #[serde(rename = "do")]
        action: ControlAction,
    },
    /// Asks for chunks of the path.
    Want {
        /// Number of the path.
        path: u32,
        /// Level of detail.
        level: u8,
        /// First vertices of the chunks.
        firsts: Vec<u32>,
    },
    /// Asks which line made a record, or which records a line made.
    Where {
        /// Number of the question, which the answer names.
        id: u32,
        /// Number of the path.
        path: u32,
        /// Record.
        record: Option<u32>,
        /// Program line.
        line: Option<u32>,
    },
    /// Names the page.
    Name {
        /// Name.
        name: String,
    },
}

impl PageMessage {
    /// Reads a message: an object, and not the array that would also be taken for one.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(crate) fn read(text: &str) -> Result<Self, String> {
        if !text.trim_start().starts_with('{') {
            return Err("it is not an object".into());
        }
        serde_json::from_str(text).map_err(|error| error.to_string())
    }
}

/// How fast a jog is that a page holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub(crate) enum HeldJogSpeed {
    /// The jog speed of the axis.
    #[default]
    Full,
    /// A tenth of it.
    Slow,
}

impl From<HeldJogSpeed> for JogSpeed {
    fn from(speed: HeldJogSpeed) -> Self {
        match speed {
            HeldJogSpeed::Full => Self::Full,
            HeldJogSpeed::Slow => Self::Slow,
        }
    }
}

/// What a page does with control.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub(crate) enum ControlAction {
    /// Takes it, or asks for it.
    Take,
    /// Gives it to the page that asks.
    Give,
    /// Keeps it.
    Keep,
    /// Releases it.
    Release,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_read_and_unknown_fields_are_errors() {
        let read = PageMessage::read;
        assert_eq!(read(r#"{"t":"hold"}"#).expect("valid"), PageMessage::Hold {});
        let control = PageMessage::Control { action: ControlAction::Take };
        assert_eq!(read(r#"{"t":"control","do":"take"}"#).expect("valid"), control);
        assert_eq!(read(r#"{"t":"jog_end"}"#).expect("valid"), PageMessage::JogEnd {});
        for wrong in [
            r#"{"t":"hold","turn":1}"#,
            r#"{"t":"do","id":1,"turn":1,"words":"hold"}"#,
            r#"{"t":"do","id":-1,"turn":1,"seen":1,"words":"hold"}"#,
            r#"{"t":"control","do":"steal"}"#,
            r#"{"t":"reboot"}"#,
            r#"["hold"]"#,
        ] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }
}
