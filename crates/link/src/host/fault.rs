//! Errors that end a run on a card, as the host's endpoint detects them.
//!
//! Invariant: every error has one number in `docs/errors.md`, a cause and a remedy.

use core::fmt;

use crate::{Alarm, CardFailure, PROTOCOL};

/// Error that ends a run on a card.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LinkError {
    /// The card latched an alarm and is at rest.
    Alarm(Alarm),
    /// No frame arrived from the card for too long.
    Silent,
    /// The card was restarted, or serves another host: this epoch is no longer open.
    Restarted,
    /// The card's check of place and counts does not match the records in between.
    StateMismatch,
    /// The card had more to report than it could store.
    ReportLost,
    /// The card rejected an instruction.
    Refused(u32),
    /// The card uses another version of the protocol.
    Protocol(u8),
    /// The card rejected the settings.
    SettingsRejected,
    /// The machine does not come to rest, or another host can still move it.
    NotAtRest,
    /// The card has moved since the report from which a new path was to begin.
    Moved,
}

impl CardFailure for LinkError {
    fn number(&self) -> &'static str {
        match self {
            Self::Alarm(alarm) => alarm.number(),
            Self::Silent => "E3002",
            Self::Restarted => "E3003",
            Self::StateMismatch => "E3004",
            Self::ReportLost => "E3005",
            Self::Refused(_) => "E3006",
            Self::Protocol(_) => "E3007",
            Self::SettingsRejected => "E3008",
            Self::Moved => "E3021",
            Self::NotAtRest => "E3037",
        }
    }

    fn remedy(&self) -> &'static str {
        match self {
            Self::Alarm(alarm) => alarm.remedy(),
            Self::Silent => {
                "check cable and power; the card stops by itself and reports its position when it is connected again"
            }
            Self::Restarted | Self::StateMismatch => "home the machine before it is moved again",
            Self::ReportLost => {
                "check the cable and the computer's load; `retrace resume` continues at the position that the card \
                    reports"
            }
            Self::Refused(_) => "check the card's alarm, and run the program again; please report this",
            Self::Protocol(_) => "install matching versions of the card's firmware and this program",
            Self::NotAtRest => {
                "end the other program that uses the card; if there is none, wait until the machine is at rest"
            }
            Self::Moved => "resume the job; check the line if it happens again",
            Self::SettingsRejected => {
                "wait until the machine is at rest; compare the machine file with the output of `retrace card identify`"
            }
        }
    }
}

impl core::error::Error for LinkError {}

impl fmt::Display for LinkError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Alarm(alarm) => alarm.fmt(f),
            Self::Silent => write!(f, "the card does not answer"),
            Self::Restarted => write!(f, "the card was restarted, or another host has taken it over"),
            Self::StateMismatch => write!(f, "the card's counts are not those of the path that was sent"),
            Self::ReportLost => write!(f, "the card could not store all its reports while the line was down"),
            Self::Refused(number) => write!(f, "the card rejected switching instruction {number}"),
            Self::Protocol(version) => {
                write!(f, "the card uses protocol version {version}, this program version {PROTOCOL}")
            }
            Self::Moved => write!(f, "the machine moved while a new path was to begin at its position"),
            Self::NotAtRest => write!(f, "the machine is in motion, or another host is connected to the card"),
            Self::SettingsRejected => write!(f, "the card does not support these settings, or is in motion"),
        }
    }
}
