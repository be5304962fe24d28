//! The outputs of a card: their channels and values, how an instruction changes them, and the input that it may wait
//! for.
//!
//! Invariant: a channel is below [`channel::COUNT`] on every card; [`channel::HEIGHT`] is not.

/// Output channels of a card and their meaning.
pub mod channel {
    /// Channels 0 … 63 are digital outputs, value 0 or 1 (M62–M65 P number).
    pub const DIGITAL: usize = 64;
    /// Spindle: 1 clockwise (M3), −1 counterclockwise (M4), 0 stopped (M5).
    pub const SPINDLE: u8 = 64;
    /// Spindle speed in thousandths of a revolution per minute (S).
    pub const SPEED: u8 = 65;
    /// Mist coolant (M7), 0 or 1.
    pub const MIST: u8 = 66;
    /// Flood coolant (M8), 0 or 1.
    pub const FLOOD: u8 = 67;
    /// Number of the tool in the spindle (M6).
    pub const TOOL: u8 = 68;
    /// Whether the loss of a cutter is not watched: 0 or 1 (M62 P1). 0 when an epoch begins.
    pub const UNWATCHED: u8 = 69;
    /// Whether the program holds the height where it is controlled: 0, or anything else (M62 P2). 0 when an epoch
    /// begins. Only with the feature `analog`.
    pub const HEIGHT_HOLD: u8 = 70;
    /// What the operator adds to the target of height control, in readings of its analog input, or [`HEIGHT_STAYS`].
    /// Only with the feature `analog`.
    pub const HEIGHT_OFFSET: u8 = 71;
    /// Value of [`HEIGHT_OFFSET`] with which the height stays: a kerf is crossed, or the operator has switched height
    /// control off.
    pub const HEIGHT_STAYS: i32 = i32::MIN;
    /// First analog output (M67, M68). The values of the analog outputs are in units of 1/[`ANALOG_ONE`] of the unit
    /// that the machine file gives them.
    pub const ANALOG: u8 = 72;
    /// Maximum number of analog outputs of a card; 0 without the feature `analog`.
    pub const ANALOG_OUTPUTS: usize = if cfg!(feature = "analog") { 8 } else { 0 };
    /// Value of an analog output that is at one unit.
    pub const ANALOG_ONE: i32 = 1 << 16;
    /// One more than the highest channel that is not analog.
    const NOT_ANALOG: u8 = if cfg!(feature = "analog") { ANALOG } else { UNWATCHED + 1 };
    /// Number of values in [`Outputs`](super::Outputs): one more than the highest channel.
    pub const COUNT: usize =
        if cfg!(feature = "analog") { ANALOG as usize + ANALOG_OUTPUTS } else { NOT_ANALOG as usize };
    /// No output, on any card: the `after` of an action with this channel is the height over the sheet, in pulses, to
    /// which the layer moves beside the path from there on (CUT-13). It counts where the action is passed for the first
    /// time and a cutter is on.
    pub const HEIGHT: u8 = 80;

    /// Whether the number is that of an output.
    #[must_use]
    pub const fn is_output(channel: u8) -> bool {
        channel < NOT_ANALOG || is_analog(channel)
    }

    /// Whether the number is that of an analog output.
    #[must_use]
    pub const fn is_analog(channel: u8) -> bool {
        ANALOG <= channel && (channel as usize) < COUNT
    }
}

const _: () = assert!(channel::COUNT <= channel::HEIGHT as usize);

/// Maximum number of analog inputs of a card; 0 without the feature `analog`.
pub const ANALOG_INPUTS: usize = if cfg!(feature = "analog") { 4 } else { 0 };

/// Readings of the analog inputs, in units of 2⁻¹⁶ of their range; `None` where none is known.
pub type AnalogInputs = [Option<u16>; ANALOG_INPUTS];

/// The values of all output channels.
pub type Outputs = [i32; channel::COUNT];

/// Change of one output channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct OutputChange {
    /// Channel, below [`channel::COUNT`].
    pub channel: u8,
    /// New value.
    pub value: i32,
}

/// Maximum number of changes of one instruction.
pub const MAX_CHANGES: usize = 4;

/// Input that an instruction waits for before it is complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct InputWait {
    /// Number of the input.
    pub input: u8,
    /// Whether the input must become active (true) or inactive.
    pub active: bool,
    /// Timeout in periods; 0: no timeout.
    pub timeout_periods: u32,
    /// How a cutter is started, if this switches one on. `None` for any other device: a timeout is then an alarm.
    pub ignition: Option<Ignition>,
}

impl InputWait {
    /// Returns a wait for an input of any device but a cutter.
    #[must_use]
    pub const fn new(input: u8, active: bool, timeout_periods: u32) -> Self {
        Self { input, active, timeout_periods, ignition: None }
    }
}

/// Start of a cutter whose input proves that it burns or flows (CUT-13): it is switched on, must be proven within the
/// timeout of the wait, and is switched off and on again where it is not. A start that fails is not an alarm: the
/// cutter is off, the card blocks motion, and the instruction is to be sent again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Ignition {
    /// Control periods in a row for which the input must be as awaited.
    pub stable_periods: u16,
    /// Attempts, at least 1; 0 counts as 1.
    pub attempts: u8,
    /// Control periods for which the cutter is off between two attempts.
    pub retry_periods: u16,
    /// Control periods from the proof to the end of the instruction: the pierce.
    pub delay_periods: u32,
}
