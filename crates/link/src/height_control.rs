//! Height control of a cutter: how the card follows the sheet while it cuts (CUT-49 to CUT-53).
//!
//! Invariant: a card without the feature `analog` has no height control, and no memory is taken for it.

use retrace_core::FeedShare;

/// Maximum distance of the layer from 0, in pulses.
pub const MAX_LAYER: u32 = 1 << 24;

/// Number of height controls of a card: one with the feature `analog`.
pub const HEIGHT_CONTROLS: usize = cfg!(feature = "analog") as usize;

/// Settings of the height control of a cut; empty without the feature `analog`.
pub type HeightControls = [HeightControlSettings; HEIGHT_CONTROLS];

/// What the height is controlled by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum HeightSource {
    /// Nothing: the height is not controlled.
    #[default]
    None,
    /// The arc voltage, on this analog input.
    Volts {
        /// Number of the analog input.
        input: u8,
    },
    /// Two inputs of a separate height controller: `up` and `down` are active while the torch is too low and too high.
    UpDown {
        /// Number of the input that moves the torch up.
        up: u8,
        /// Number of the input that moves it down.
        down: u8,
    },
    /// Another controller, which moves the axis by itself while this digital output is on. The card moves nothing, and
    /// does not know the height meanwhile.
    External {
        /// Channel of the output.
        output: u8,
    },
}

/// Settings of height control. Readings are those of an analog input, in units of 2⁻¹⁶ of its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct HeightControlSettings {
    /// What the height is controlled by.
    pub source: HeightSource,
    /// Reading that the height is controlled to; 0: the mean one where the control takes over. Not used with
    /// [`HeightSource::UpDown`].
    pub target: u16,
    /// Maximum speed, in units of 2⁻¹⁶ pulses per period.
    pub speed: u32,
    /// Speed for a difference of one reading from the target, in units of 2⁻³² pulses per period. The tool moves down
    /// where the reading is above the target, up for a negative gain.
    pub gain: i32,
    /// Share of a difference by which the low-pass filter follows a reading in a period, in units of 2⁻¹⁶; 0: all.
    pub filter: u16,
    /// Difference from the target within which the height stays, in readings.
    pub band: u16,
    /// Change of the filtered reading in a period from which on the arc is over a void, in units of 2⁻¹⁶ readings: a
    /// rise, or for a negative gain a fall. 0: no void is looked for.
    pub slope: u32,
    /// Control periods after which the height is controlled again although the reading has not come back; 0: never.
    pub void_periods: u16,
    /// Distance in pulses that the tool may be above the layer at which the control took over.
    pub up: u32,
    /// Distance in pulses that it may be below it.
    pub down: u32,
    /// Control periods from the start of the cut to the control.
    pub delay_periods: u16,
    /// Control periods in a row at the programmed feed, behind the delay, before the control takes over. With a target
    /// that is sampled, also those over which it is averaged.
    pub samples: u16,
    /// Share of the programmed feed below which the height stays, until [`RESUME_SHARE`] is reached again.
    pub hold_below: FeedShare,
    /// Control periods by which the height stays before a record that is slower than that.
    pub look_periods: u16,
    /// Control periods at the end of the range after which the cut is interrupted; 0: none.
    pub limit_periods: u16,
}

/// Share of the feed that counts as the feed: 99 %.
pub const RESUME_SHARE: FeedShare = FeedShare::from_units(32_440);

impl HeightControlSettings {
    /// Settings with which the height is not controlled.
    pub const NONE: Self = Self {
        source: HeightSource::None,
        target: 0,
        speed: 0,
        gain: 0,
        filter: 0,
        band: 0,
        slope: 0,
        void_periods: 0,
        up: 0,
        down: 0,
        delay_periods: 0,
        samples: 0,
        hold_below: FeedShare::NONE,
        look_periods: 0,
        limit_periods: 0,
    };

    /// Whether the values are within their ranges, on a card with these numbers of digital and analog inputs and of
    /// digital outputs.
    #[must_use]
    pub fn is_valid(&self, [inputs, analog_inputs, outputs]: [u8; 3]) -> bool {
        let has_its_own = match self.source {
            HeightSource::None => return *self == Self::NONE,
            HeightSource::Volts { input } => input < analog_inputs && self.gain != 0,
            HeightSource::UpDown { up, down } => up < inputs.min(16) && down < inputs.min(16) && up != down,
            HeightSource::External { output } => output < outputs.min(64),
        };
        let is_bounded = self.up <= MAX_LAYER && self.down <= MAX_LAYER;
        has_its_own && is_bounded && self.speed > 0 && self.samples > 0 && self.hold_below <= RESUME_SHARE
    }
}

impl Default for HeightControlSettings {
    fn default() -> Self {
        Self::NONE
    }
}

/// State of the height control.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum HeightState {
    /// The height is not controlled: no cutter is on, or the cut has no target.
    #[default]
    Off,
    /// The control has not taken over yet.
    Waiting,
    /// It controls the height.
    Active,
    /// The height stays: a corner, a void, or the program.
    Held,
    /// The tool is at the end of its range.
    AtLimit,
}

impl HeightState {
    /// Returns the code on the wire.
    #[must_use]
    pub const fn to_wire(self) -> u8 {
        self as u8
    }

    /// Returns the state of a code on the wire; `None` for an unknown one.
    #[must_use]
    pub const fn from_wire(code: u8) -> Option<Self> {
        Some(match code {
            0 => Self::Off,
            1 => Self::Waiting,
            2 => Self::Active,
            3 => Self::Held,
            4 => Self::AtLimit,
            _ => return None,
        })
    }
}
