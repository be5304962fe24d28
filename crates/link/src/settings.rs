//! Identity and settings, exchanged before anything moves.
//!
//! Invariant: settings take effect only while the machine is at rest. Each opening has an epoch of its own, and frames
//! of another epoch are ignored.

use retrace_core::limits::RateLimits;
use retrace_core::{Place, RecordIndex};

use crate::{CuttingSettings, LayerSettings, OutputChange, SpindleSettings};

/// Maximum number of inputs of a card.
pub const MAX_INPUTS: usize = 16;
/// Maximum number of outputs that a fault switches.
pub const MAX_SAFE: usize = 16;
/// Version of the protocol that this crate implements.
pub const PROTOCOL: u8 = 21;

/// Identity and capabilities of a card.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct CardIdentity {
    /// Version of the protocol.
    pub protocol: u8,
    /// Name, ASCII, padded with zeros.
    pub name: [u8; 16],
    /// Serial number; 0 if it has none.
    pub serial: u32,
    /// Boot number, drawn at every start, so that a restarted card is recognised as such.
    pub boot: u32,
    /// Axes.
    pub axes: u8,
    /// Digital outputs, from number 0 on.
    pub outputs: u8,
    /// Inputs, at most [`MAX_INPUTS`].
    pub inputs: u8,
    /// Analog outputs and inputs.
    pub analog: AnalogCounts,
    /// Whether it has an output for S ([`SpindlePwm`]): the speed of a spindle, or the power of a beam.
    pub has_spindle_pwm: bool,
    /// Whether it reads the encoder of a spindle ([`SpindleSettings`]).
    pub has_spindle_encoder: bool,
    /// Number of records that it holds.
    pub window: u32,
    /// Maximum average of its rate law, in periods.
    pub memory: u16,
    /// Clock frequency, in ticks per second.
    pub tick_hz: u32,
    /// Shortest control period in microseconds.
    pub min_period_us: u32,
    /// Longest control period in microseconds.
    pub max_period_us: u32,
    /// Maximum pulse frequency of an axis, in pulses per second.
    pub max_pulses_hz: u32,
}

/// Numbers of the analog outputs and inputs of a card, both from number 0 on. A card without the feature `analog` has
/// none, and no memory is taken for them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct AnalogCounts([u8; if cfg!(feature = "analog") { 2 } else { 0 }]);

impl AnalogCounts {
    /// No analog output and no analog input.
    pub const NONE: Self = Self([0; if cfg!(feature = "analog") { 2 } else { 0 }]);

    /// Counts of outputs, at most [`crate::channel::ANALOG_OUTPUTS`], and inputs, at most [`crate::ANALOG_INPUTS`].
    #[must_use]
    pub const fn new(outputs: u8, inputs: u8) -> Self {
        let mut counts = Self::NONE;
        if let [first, second] = counts.0.as_mut_slice() {
            (*first, *second) = (outputs, inputs);
        }
        counts
    }

    /// Number of analog outputs.
    #[must_use]
    pub const fn outputs(self) -> u8 {
        if let [outputs, ..] = self.0.as_slice() { *outputs } else { 0 }
    }

    /// Number of analog inputs.
    #[must_use]
    pub const fn inputs(self) -> u8 {
        if let [_, inputs, ..] = self.0.as_slice() { *inputs } else { 0 }
    }
}

/// Meaning of an input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum InputUse {
    /// No meaning; the level is only reported.
    #[default]
    Plain,
    /// Limit switch of an axis, at the upper end of its travel or the lower.
    Limit {
        /// The axis, from 0.
        axis: u8,
        /// Whether it is at the upper end of the travel.
        upper: bool,
    },
    /// Home switch of an axis.
    Home {
        /// The axis, from 0.
        axis: u8,
    },
    /// A door that must be closed while there is motion.
    Door,
    /// The emergency-stop chain, which is wired to cut the power by itself; the card only reads it.
    EmergencyStop,
    /// A probe.
    Probe,
    /// A contact that shows that the tool has touched something: the breakaway of a torch, its float switch (CUT-34).
    /// No cutting output is on while it is active.
    Collision {
        /// Whether it is an alarm only while a cutting output is on, as for a float switch, which is also closed when
        /// the sheet is sensed; otherwise it is one in all motion.
        only_lit: bool,
    },
}

/// Settings of an input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct InputSetting {
    /// Meaning of the input.
    pub used_for: InputUse,
    /// Whether it is active while its level is low (a normally closed contact to ground that opens: no; a closing
    /// contact: yes).
    pub active_low: bool,
}

/// Start of an epoch: the place of the machine on the path to be played, and what was already executed of that path.
///
/// # Examples
///
/// ```
/// use retrace_core::RecordIndex;
/// use retrace_link::PathStart;
///
/// let start = PathStart::at(RecordIndex::new(100));
/// assert!(start.rests && start.is_valid());
/// assert!(!PathStart { reached: RecordIndex::new(99), ..start }.is_valid(), "it has been there already");
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct PathStart {
    /// Place of the cursor; the counts are unchanged. Inside a record, the cursor is at rest until that record has
    /// arrived.
    pub place: Place,
    /// Whether the path is at rest there, as at a planned stop. It is then left at full rate, else with a ramp. Never
    /// true inside a record.
    pub rests: bool,
    /// The furthest place ever executed, as a record boundary; not before `place`.
    pub reached: RecordIndex,
    /// Number of the last completed exclusive instruction; the next one has the number after it.
    pub executed: u32,
    /// Whether the layer is kept, and the geared stretch in which the cursor rests, or which it awaits, with its
    /// angle; otherwise the layer becomes part of the counts of its axis, and the stretch is forgotten. Nothing moves.
    /// A stretch is kept only where the path begins at the place of the cursor.
    pub keeps_state: bool,
}

impl PathStart {
    /// Returns the start of a path that begins with this record, with nothing executed.
    #[must_use]
    pub const fn at(record: RecordIndex) -> Self {
        Self { place: Place::start_of(record), rests: true, reached: record, executed: 0, keeps_state: false }
    }

    /// Whether the start is consistent: `reached` is not behind the place, and the path is in motion inside a record.
    #[must_use]
    pub const fn is_valid(&self) -> bool {
        !self.reached.is_before(self.place.boundary_ahead()) && (self.place.fraction == 0 || !self.rests)
    }
}

/// Settings of the output for S, the speed of a spindle or the power of a beam, by pulse-width modulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SpindlePwm {
    /// S at a duty cycle of 100 %, in the unit of [`crate::channel::SPEED`], 1 … 2³¹ − 1; or [`Self::BY_CURVE`].
    pub full_scale: u32,
    /// Frequency in Hz, within [`PWM_HZ`].
    pub hz: u16,
}

/// Frequencies of the output for S that every card with such an output supports.
pub const PWM_HZ: core::ops::RangeInclusive<u16> = 100..=50_000;

impl SpindlePwm {
    /// Full scale of an output that follows a curve, which the card has received since it was started; until then the
    /// output is low.
    pub const BY_CURVE: u32 = u32::MAX;

    /// Whether the settings are within their ranges.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        ((1..=i32::MAX as u32).contains(&self.full_scale) || self.full_scale == Self::BY_CURVE)
            && PWM_HZ.contains(&self.hz)
    }
}

/// Most points of a curve of the output for S.
pub const MAX_CURVE_POINTS: usize = 8;

/// A point of the curve of the output for S.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SpeedPoint {
    /// S, in the unit of [`crate::channel::SPEED`], 0 … 2³¹ − 1.
    pub speed: u32,
    /// Duty cycle in units of 2⁻¹⁶, 0 … 2¹⁶.
    pub duty: u32,
}

/// Curve of the output for S: straight between its points, and constant outside of them (SPN-5).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SpeedCurve {
    /// The points, by rising speed; the first `count` are valid.
    pub points: [SpeedPoint; MAX_CURVE_POINTS],
    /// Number of valid points, 2 … [`MAX_CURVE_POINTS`].
    pub count: u8,
}

impl SpeedCurve {
    /// Returns the valid points.
    #[must_use]
    pub fn points(&self) -> &[SpeedPoint] {
        &self.points[..usize::from(self.count).min(MAX_CURVE_POINTS)]
    }

    /// Whether the points are within their ranges, and each is at a higher speed than the one before.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let is_in_range = |point: &SpeedPoint| point.speed <= i32::MAX as u32 && point.duty <= 1 << 16;
        (2..=MAX_CURVE_POINTS).contains(&usize::from(self.count))
            && self.points().iter().all(is_in_range)
            && self.points().windows(2).all(|pair| pair[0].speed < pair[1].speed)
    }
}

/// Settings of a card for one epoch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct CardSettings<const A: usize> {
    /// Number of this opening, not 0.
    pub epoch: u16,
    /// Start on the path; the counts are unchanged.
    pub start: PathStart,
    /// Number of axes used, 1 … `A`.
    pub axes: u8,
    /// Control period in microseconds.
    pub period_us: u32,
    /// Limits for the rate law.
    pub limits: RateLimits<A>,
    /// Maximum number of periods between two reports, at least 1.
    pub report_periods: u8,
    /// Periods without a complete frame from the host after which the card stops by itself.
    pub watchdog_periods: u16,
    /// Minimum length of a step pulse, in nanoseconds.
    pub pulse_ns: u16,
    /// Time that the direction must be stable before the first step, in nanoseconds.
    pub direction_setup_ns: u16,
    /// Axes whose direction output is inverted, one bit each.
    pub direction_inverted: u16,
    /// Backlash of each axis, in pulses, compensated in addition to the counts where the axis reverses.
    pub backlash_pulses: [u16; A],
    /// Settings of the inputs.
    pub inputs: [InputSetting; MAX_INPUTS],
    /// Output changes that a fault makes; the first `safe_count` are valid.
    pub safe: [OutputChange; MAX_SAFE],
    /// Number of valid `safe` entries.
    pub safe_count: u8,
    /// Cutting outputs.
    pub cutting: CuttingSettings,
    /// Layer of the tool axis; `None` if no height is set by the card.
    pub layer: Option<LayerSettings>,
    /// Output for S; `None` if it stays low.
    pub spindle_pwm: Option<SpindlePwm>,
    /// Curve of the output for S. It is no part of the opening: a command behind it,
    /// [`crate::HostCommand::SpeedCurve`], contains it.
    pub speed_curve: Option<SpeedCurve>,
    /// Spindle with an encoder; `None` if there is none.
    pub spindle: Option<SpindleSettings>,
}

impl<const A: usize> CardSettings<A> {
    /// Returns settings for all axes with the given control period in microseconds and the path from `start` on.
    /// Defaults: reports every eighth period, a watchdog of 250 ms, no backlash, no inputs, all outputs unchanged on a
    /// fault, no cutting outputs, no layer, no output for S, and no encoder.
    #[must_use]
    pub fn new(epoch: u16, start: PathStart, period_us: u32, limits: RateLimits<A>) -> Self {
        Self {
            epoch,
            start,
            axes: A as u8,
            period_us,
            limits,
            report_periods: 8,
            watchdog_periods: (250_000 / period_us.max(1)).clamp(20, 2000) as u16,
            pulse_ns: 2000,
            direction_setup_ns: 5000,
            direction_inverted: 0,
            backlash_pulses: [0; A],
            inputs: [InputSetting::default(); MAX_INPUTS],
            safe: [OutputChange::default(); MAX_SAFE],
            safe_count: 0,
            cutting: CuttingSettings::default(),
            layer: None,
            spindle_pwm: None,
            speed_curve: None,
            spindle: None,
        }
    }

    /// Returns the changes that a fault makes.
    #[must_use]
    pub fn safe(&self) -> &[OutputChange] {
        &self.safe[..usize::from(self.safe_count).min(MAX_SAFE)]
    }
}
