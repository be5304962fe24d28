//! Cutting outputs: the settings of the channels that light a torch, open a jet or enable a beam, and what the card
//! reports about them.
//!
//! Invariant: the settings alone define which channel fires; the card applies its permit to these channels whatever the
//! commands request.

use retrace_core::{FeedShare, Place};

use crate::{InputWait, LayerMove, MAX_CHANGES, OutputChange};

/// Longest test pulse of a cutter, in microseconds (CUT-9).
pub const MAX_PULSE_US: u64 = 3_000_000;
/// Maximum number of cutting channels of a card.
pub const MAX_CUTTING_CHANNELS: usize = 8;
/// Maximum number of cutting channels with a [`ProofInput`]: the settings then fit a frame.
pub const MAX_PROOFS: usize = 1;

/// Exponent of a power that is proportional to the speed, in quarters.
pub const LINEAR_POWER: u8 = 4;
/// Greatest exponent of a power, in quarters.
pub const MAX_POWER_EXPONENT: u8 = 16;

/// One output channel of a cutter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct CuttingChannel {
    /// Output channel, below [`crate::channel::COUNT`].
    pub channel: u8,
    /// Whether the channel lights the torch, opens the jet or enables the beam: it is then subject to the card's
    /// permit. False for an auxiliary channel (arm, assist, abrasive), which only [`CuttingSettings::inhibit`] keeps
    /// off.
    pub fires: bool,
    /// Grace time, in control periods: how long the machine may be at rest with the channel on. 0 for a torch or a
    /// beam.
    pub standing_periods: u16,
    /// Whether the channel stays on, and may be switched on, while the path runs backward: a jet with `retrace_cut =
    /// true`.
    pub lit_in_reverse: bool,
    /// Input that proves that the cutter burns or flows, if it has one.
    pub proof: Option<ProofInput>,
}

/// Input that proves that a cutter burns or flows: the arc-transfer contact of a plasma source, the pressure switch of
/// a jet (CUT-5, CUT-29).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ProofInput {
    /// Number of the input; active while the cutter burns or flows.
    pub input: u8,
    /// Control periods in a row with the input active, after which the cutter is proven and its loss is watched.
    pub proven_periods: u16,
    /// Control periods in a row with the input inactive, after which a proven cutter is lost; 0 counts as 1.
    pub lost_periods: u16,
    /// Control periods for which the input may stay active after the cutter is off; 0: for any time.
    pub out_periods: u16,
}

/// Cutting channels of an epoch, and the rules that the card applies to them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct CuttingSettings {
    /// Channels; the first `count` are valid.
    pub channels: [CuttingChannel; MAX_CUTTING_CHANNELS],
    /// Number of valid `channels`, at most [`MAX_CUTTING_CHANNELS`].
    pub count: u8,
    /// Control periods at rest that are not counted while a rate above 0 is requested; also the longest pause between
    /// two repeated instructions.
    pub handover_periods: u16,
    /// Dry run: every channel of the list stays 0.
    pub inhibit: bool,
    /// Power output of a beam, if one is used.
    pub beam_power: Option<BeamPower>,
}

/// Power of a beam, which the card computes in each control period (CUT-20).
///
/// The power is the value of [`crate::channel::SPEED`], S, while the beam pierces. Otherwise it is 0 unless the cursor
/// moves along feed motion with the beam on. Where the beam's channel is negative (M4) it follows the speed:
/// S · (v / F)^γ, with the path speed v in the period and the programmed feed F, at least `least` of S and at most S.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct BeamPower {
    /// Output channel that enables the beam; one of [`CuttingSettings::channels`] that fires.
    pub channel: u8,
    /// Least power in motion with M4, as a share of S in units of 2⁻¹⁵, at most 1.
    pub least: FeedShare,
    /// The exponent γ, in quarters: 1 to [`MAX_POWER_EXPONENT`], and [`LINEAR_POWER`] for 1.
    pub exponent: u8,
}

impl CuttingSettings {
    /// Returns the valid channels.
    #[must_use]
    pub fn channels(&self) -> &[CuttingChannel] {
        &self.channels[..usize::from(self.count).min(MAX_CUTTING_CHANNELS)]
    }
}

/// Completed switching that is executed again, at rest, at any place and with any requested rate.
///
/// Time at rest is not counted while it is executed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct RepeatedInstruction {
    /// Number: 1 for the first one of an epoch, then consecutive.
    pub number: u32,
    /// Output changes; the first `count` are valid.
    pub changes: [OutputChange; MAX_CHANGES],
    /// Number of valid `changes`.
    pub count: u8,
    /// Shortest duration, in control periods.
    pub periods: u32,
    /// Input that is awaited in addition.
    pub until: Option<InputWait>,
    /// Whether this is a test pulse: what it switches on is switched off again at its end (CUT-9).
    pub is_pulse: bool,
    /// Moves of the layer before and behind the switching.
    pub layer: Option<LayerMove>,
}

impl RepeatedInstruction {
    /// Returns the valid changes.
    #[must_use]
    pub fn changes(&self) -> &[OutputChange] {
        &self.changes[..usize::from(self.count).min(MAX_CHANGES)]
    }
}

/// Reason why the card switched a cutting output off.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CutterOffCause {
    /// The machine was at rest for longer than the grace time. The card blocks motion until
    /// [`crate::HostCommand::Restart`].
    Standing,
    /// The path is about to run backward.
    Reverse,
    /// Dry run.
    Inhibited,
    /// An alarm is latched.
    Alarm,
    /// No frame from the host arrived for as long as the watchdog allows.
    HostSilent,
    /// The epoch was closed.
    EpochClosed,
    /// An epoch was opened.
    EpochOpened,
    /// The input that proves the cutter became inactive: the arc went out, the pressure fell. The card brakes on the
    /// path and blocks motion until [`crate::HostCommand::Restart`].
    Lost,
    /// The cutter was not proven in any of its attempts, or was switched off manually in its start: no channel is named
    /// then. The card blocks motion until [`crate::HostCommand::Restart`].
    NotStarted,
    /// A collision input is active.
    Collision,
    /// The cutter was not started, since no sheet was found. The card blocks motion as for `NotStarted`.
    NoSheet,
    /// The cutter was not started, since a contact for sensing was closed over the sheet, or did not open. The card
    /// blocks motion as for `NotStarted`.
    SheetContact,
    /// The height stood at the end of its range for too long. The card brakes on the path and blocks motion as for
    /// `Lost`.
    HeightLimit,
}

impl CutterOffCause {
    /// Whether the card has cancelled the instruction that it was executing: the cutter was lost or not started.
    #[must_use]
    pub const fn cancels_start(self) -> bool {
        matches!(self, Self::Lost | Self::NotStarted | Self::NoSheet | Self::SheetContact)
    }

    /// Whether a cutter went off in its cut, which is to be continued where it ended.
    #[must_use]
    pub const fn ends_cut(self) -> bool {
        matches!(self, Self::Lost | Self::HeightLimit)
    }

    /// Returns the code on the wire.
    #[must_use]
    pub const fn to_wire(self) -> u8 {
        self as u8
    }

    /// Returns the cause for a code on the wire; `None` for an unknown one.
    #[must_use]
    pub const fn from_wire(code: u8) -> Option<Self> {
        Some(match code {
            0 => Self::Standing,
            1 => Self::Reverse,
            2 => Self::Inhibited,
            3 => Self::Alarm,
            4 => Self::HostSilent,
            5 => Self::EpochClosed,
            6 => Self::EpochOpened,
            7 => Self::Lost,
            8 => Self::NotStarted,
            9 => Self::Collision,
            10 => Self::NoSheet,
            11 => Self::SheetContact,
            12 => Self::HeightLimit,
            _ => return None,
        })
    }
}

/// Cutting outputs that were on and that the card switched off in a control period because the permit was missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct CutterOff {
    /// Channels, one bit for each index in [`CuttingSettings::channels`].
    pub channels: u8,
    /// Cause; the first one if several apply in one period.
    pub cause: CutterOffCause,
    /// Place of the cursor: for [`CutterOffCause::Lost`] at the beginning of the first period in which the input was
    /// inactive (CUT-30), for any other cause at the end of the period.
    pub place: Place,
}
