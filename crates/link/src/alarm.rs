//! Alarms of a card: causes that stopped the machine and stay latched until they are cleared.
//!
//! Invariant: every alarm has one number in `docs/errors.md`, one code on the wire, a cause and a remedy.

use core::fmt;

use crate::CardFailure;

/// Cause that stopped the machine. It stays latched on the card until [`crate::HostCommand::ClearAlarm`], and no rate
/// moves the machine until then.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Alarm {
    /// No complete frame from the host arrived for [`crate::CardSettings::watchdog_periods`].
    HostSilent,
    /// The emergency-stop chain is open.
    EmergencyStop,
    /// A door that must be shut is open.
    DoorOpen,
    /// A limit switch is tripped.
    LimitSwitch {
        /// The axis, from 0.
        axis: u8,
        /// At the upper end of its travel?
        upper: bool,
    },
    /// An instruction did not complete within its time.
    TimedOut {
        /// The instruction's number.
        instruction: u32,
    },
    /// The machine reported that an instruction failed.
    Failed {
        /// The instruction's number.
        instruction: u32,
    },
    /// More pulses were requested in a control period than can be emitted.
    TooManyPulses {
        /// The axis, from 0.
        axis: u8,
    },
    /// Homing found no switch, or the switch did not open again.
    HomingFailed {
        /// The axis, from 0.
        axis: u8,
    },
    /// The input that proves a cutter is active before the cutter is switched on: a welded contact, or an arc that
    /// burns (CUT-5).
    ProvenBeforeStart {
        /// The input.
        input: u8,
    },
    /// The input that proves a cutter stays active although the cutter is off (CUT-5).
    CutterStaysOn {
        /// The input.
        input: u8,
    },
    /// A collision input became active in motion, or with a cutting output on (CUT-34).
    Collision {
        /// The input.
        input: u8,
    },
    /// A record that the drive needs was not there: a defect of the card.
    Defect,
    /// A probe tripped in motion that is no probing move (PRB-10).
    ProbeTripped {
        /// The input.
        input: u8,
    },
    /// The spindle was not at speed, or its index not seen, in the time for it (SPN-6).
    NotAtSpeed,
    /// The encoder lost counts, or showed none while the spindle was commanded to turn (SPN-3, SPN-24).
    EncoderFailed,
    /// The spindle stalled in a geared stretch (SPN-24).
    SpindleStalled,
    /// The motion could not follow the spindle within the tolerance (SPN-15).
    ThreadLost,
}

impl Alarm {
    /// Returns code and detail, as sent on the wire.
    #[must_use]
    pub const fn to_wire(self) -> (u8, u32) {
        match self {
            Self::HostSilent => (1, 0),
            Self::EmergencyStop => (2, 0),
            Self::DoorOpen => (3, 0),
            Self::LimitSwitch { axis, upper } => (4, axis as u32 | (upper as u32) << 8),
            Self::TimedOut { instruction } => (5, instruction),
            Self::Failed { instruction } => (6, instruction),
            Self::TooManyPulses { axis } => (7, axis as u32),
            Self::HomingFailed { axis } => (8, axis as u32),
            Self::Defect => (9, 0),
            Self::ProvenBeforeStart { input } => (10, input as u32),
            Self::CutterStaysOn { input } => (11, input as u32),
            Self::Collision { input } => (12, input as u32),
            Self::ProbeTripped { input } => (13, input as u32),
            Self::NotAtSpeed => (14, 0),
            Self::EncoderFailed => (15, 0),
            Self::SpindleStalled => (16, 0),
            Self::ThreadLost => (17, 0),
        }
    }

    /// Returns the alarm for a code and detail; `None` for an unknown code.
    #[must_use]
    pub const fn from_wire(code: u8, detail: u32) -> Option<Self> {
        Some(match code {
            1 => Self::HostSilent,
            2 => Self::EmergencyStop,
            3 => Self::DoorOpen,
            4 => Self::LimitSwitch { axis: detail as u8, upper: detail >> 8 & 1 == 1 },
            5 => Self::TimedOut { instruction: detail },
            6 => Self::Failed { instruction: detail },
            7 => Self::TooManyPulses { axis: detail as u8 },
            8 => Self::HomingFailed { axis: detail as u8 },
            9 => Self::Defect,
            10 => Self::ProvenBeforeStart { input: detail as u8 },
            11 => Self::CutterStaysOn { input: detail as u8 },
            12 => Self::Collision { input: detail as u8 },
            13 => Self::ProbeTripped { input: detail as u8 },
            14 => Self::NotAtSpeed,
            15 => Self::EncoderFailed,
            16 => Self::SpindleStalled,
            17 => Self::ThreadLost,
            _ => return None,
        })
    }
}

impl CardFailure for Alarm {
    fn number(&self) -> &'static str {
        match self {
            Self::HostSilent => "E3011",
            Self::EmergencyStop => "E3012",
            Self::DoorOpen => "E3013",
            Self::LimitSwitch { .. } => "E3014",
            Self::TimedOut { .. } => "E3015",
            Self::Failed { .. } => "E3016",
            Self::TooManyPulses { .. } => "E3017",
            Self::HomingFailed { .. } => "E3018",
            Self::Defect => "E3019",
            Self::ProvenBeforeStart { .. } => "E3022",
            Self::CutterStaysOn { .. } => "E3023",
            Self::Collision { .. } => "E3027",
            Self::ProbeTripped { .. } => "E3028",
            Self::NotAtSpeed => "E3032",
            Self::EncoderFailed => "E3033",
            Self::SpindleStalled => "E3034",
            Self::ThreadLost => "E3035",
        }
    }

    fn remedy(&self) -> &'static str {
        match self {
            Self::HostSilent => {
                "check the cable and the computer's load; clear the alarm, check the position, then resume"
            }
            Self::EmergencyStop => "make the machine safe, close the chain, clear the alarm, then home the machine",
            Self::DoorOpen => "close the door, clear the alarm, then resume",
            Self::LimitSwitch { .. } => "clear the alarm, jog away from the switch, then home the machine",
            Self::TimedOut { .. } | Self::Failed { .. } => "check the switched device, clear the alarm, then resume",
            Self::TooManyPulses { .. } => {
                "lower pulses_per_mm or max_velocity_mm_per_s, or lengthen the control period"
            }
            Self::HomingFailed { .. } => "check the home switch and its wiring, then home again",
            Self::Defect => "home the machine; please report this",
            Self::ProvenBeforeStart { .. } => {
                "switch the source off; check its contact and the wiring of the input, clear the alarm, then resume"
            }
            Self::CutterStaysOn { .. } => {
                "switch the source off at its own switch; check the output's relay and the contact of the input"
            }
            Self::Collision { .. } => {
                "clear the alarm, jog the tool off what it touched, check tool and position, then resume"
            }
            Self::ProbeTripped { .. } => {
                "clear the alarm, jog the probe off what it touched, check probe and position, then resume; for a tool \
                 that touches on purpose, guard = false in [probe]"
            }
            Self::NotAtSpeed => {
                "check the spindle and its drive, the S word, and counts_per_turn and direction in [spindle]; clear \
                 the alarm, then resume"
            }
            Self::EncoderFailed => {
                "check the encoder, its cable and counts_per_turn in [spindle]; clear the alarm, move the tool clear \
                 of the work, and begin the pass anew"
            }
            Self::SpindleStalled => {
                "clear the alarm, move the tool clear of the work, and begin the pass anew with a lower depth of cut"
            }
            Self::ThreadLost => {
                "lower the S word, or raise thread_margin_percent in [spindle]; clear the alarm, move the tool clear \
                 of the work, and begin the pass anew"
            }
        }
    }
}

impl core::error::Error for Alarm {}

impl fmt::Display for Alarm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::HostSilent => write!(f, "the card received nothing from the host and stopped on the path"),
            Self::EmergencyStop => write!(f, "the emergency-stop chain is open"),
            Self::DoorOpen => write!(f, "a door is open"),
            Self::LimitSwitch { axis, upper } => {
                write!(f, "{} limit switch of axis number {}", if *upper { "upper" } else { "lower" }, axis + 1)
            }
            Self::TimedOut { instruction } => write!(f, "switching instruction {instruction} did not end in its time"),
            Self::Failed { instruction } => write!(f, "switching instruction {instruction} failed"),
            Self::TooManyPulses { axis } => {
                write!(f, "axis number {} needs more pulses in a control period than the card can emit", axis + 1)
            }
            Self::HomingFailed { axis } => write!(f, "homing of axis number {} found no switch", axis + 1),
            Self::Defect => write!(f, "the card missed a record that it needed"),
            Self::ProvenBeforeStart { input } => {
                write!(f, "input {input} says that the cutter is on before it is switched on")
            }
            Self::CutterStaysOn { input } => {
                write!(f, "input {input} still says that the cutter is on after it was switched off")
            }
            Self::Collision { input } => {
                write!(f, "input {input} says that the tool has touched something; no axis moved by itself")
            }
            Self::ProbeTripped { input } => {
                write!(f, "the probe on input {input} tripped in a move that does not probe")
            }
            Self::NotAtSpeed => write!(f, "the spindle did not come to its speed in time, or its index was not seen"),
            Self::EncoderFailed => write!(f, "the encoder of the spindle lost counts, or shows none"),
            Self::SpindleStalled => write!(f, "the spindle stalled while the motion followed it"),
            Self::ThreadLost => {
                write!(f, "the axes could not follow the spindle; the spindle is off, and the tool stays on the path")
            }
        }
    }
}
