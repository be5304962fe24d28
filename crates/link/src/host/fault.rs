//! What ends a run on a card for good, as the host's end of the line tells it.
//!
//! Invariant: every fault has one number in `docs/errors.md`, a cause and a remedy.

use core::fmt;

use crate::{Alarm, CardFailure, PROTOCOL};

/// What ends a run on a card for good.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkError {
    /// The card latched an alarm and stands.
    Alarm(Alarm),
    /// Nothing was heard from the card for too long.
    Silent,
    /// The card was restarted, or serves another host: this epoch is no longer open.
    Restarted,
    /// The card's echo of place and counts is not what the records between come to.
    Disagrees,
    /// The card had more to report than it could keep.
    ReportLost,
    /// The card refused an instruction.
    Refused(u32),
    /// The card speaks another version of the protocol.
    Protocol(u8),
    /// The card refused the settings.
    Unfit,
    /// The card has moved on since the report by which a new path was to begin.
    Moved,
}

impl CardFailure for LinkError {
    fn number(&self) -> &'static str {
        match self {
            Self::Alarm(alarm) => alarm.number(),
            Self::Silent => "E3002",
            Self::Restarted => "E3003",
            Self::Disagrees => "E3004",
            Self::ReportLost => "E3005",
            Self::Refused(_) => "E3006",
            Self::Protocol(_) => "E3007",
            Self::Unfit => "E3008",
            Self::Moved => "E3021",
        }
    }

    fn remedy(&self) -> &'static str {
        match self {
            Self::Alarm(alarm) => alarm.remedy(),
            Self::Silent => {
                "check cable and power; the card stops by itself, and says where it stands when asked again"
            }
            Self::Restarted | Self::Disagrees => "home the machine before it is moved again",
            Self::ReportLost => {
                "check the cable and the computer's load; `retrace resume` goes on where the card says that it stands"
            }
            Self::Refused(_) => "see what the card's alarm says, and run the program again; please report this",
            Self::Protocol(_) => "put the card's firmware and this program on versions that belong together",
            Self::Moved => "resume the job; check the line if it happens again",
            Self::Unfit => {
                "wait until the machine stands; compare the machine file with what `retrace card identify` says"
            }
        }
    }
}

impl fmt::Display for LinkError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Alarm(alarm) => alarm.fmt(f),
            Self::Silent => write!(f, "nothing is heard from the card"),
            Self::Restarted => write!(f, "the card was restarted, or another host has taken it over"),
            Self::Disagrees => write!(f, "the card's counts are not those of the path that was sent"),
            Self::ReportLost => write!(f, "the card could not keep all that it had to report while the line was down"),
            Self::Refused(number) => write!(f, "the card refused switching instruction {number}"),
            Self::Protocol(version) => {
                write!(f, "the card speaks version {version} of the protocol, this program version {PROTOCOL}")
            }
            Self::Moved => write!(f, "the machine moved on while a new path was to begin where it stood"),
            Self::Unfit => write!(f, "the card cannot work by these settings, or is in motion"),
        }
    }
}
