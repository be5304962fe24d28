//! The spindle with an encoder: its settings, what instructions ask of it, and what the card reports about it (SPN-1 …
//! SPN-6, SPN-14).
//!
//! Invariant: angles and counts are counted positive clockwise (M3).

use retrace_core::gear::{GearLimits, GearRatio};
use retrace_core::{Rate, RecordIndex};

/// Settings of a spindle with an encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SpindleSettings {
    /// Counts of the encoder in a turn of the spindle, that is, edges of A and B; 4 … 2¹⁷.
    pub counts_per_turn: u32,
    /// Whether the counts count up counter-clockwise (M4).
    pub is_inverted: bool,
    /// Whether the encoder has an index, once a turn.
    pub has_index: bool,
    /// Maximum difference between measured and commanded speed, in thousandths, at which the spindle is at speed.
    pub at_speed_permille: u16,
    /// Control periods in a row for which it has to be at speed.
    pub at_speed_periods: u16,
    /// Control periods after which a spindle that is not at speed is an alarm.
    pub timeout_periods: u32,
    /// Highest speed, in thousandths of a revolution per minute.
    pub highest_speed: u32,
}

impl SpindleSettings {
    /// Whether the settings are within their ranges.
    #[must_use]
    pub const fn is_valid(&self) -> bool {
        self.counts_per_turn >= 4
            && self.counts_per_turn <= retrace_core::gear::MAX_COUNTS_PER_TURN
            && self.highest_speed > 0
            && self.highest_speed <= i32::MAX as u32
    }
}

/// Gearing of the stretch that begins at the place of an instruction: motion that follows the spindle's angle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct GearStart {
    /// Records of the stretch. Its end is a planned stop.
    pub length: u32,
    /// Records that the cursor passes in a turn.
    pub records_per_turn: u16,
    /// Angle from the index at which the stretch begins, in the direction in which the spindle then turns, in units of
    /// 2⁻³² turns.
    pub start_angle: u32,
    /// Records, or all of a shorter stretch, that the card must hold before it begins.
    pub ahead: u16,
    /// Limits of the motion.
    pub limits: GearLimits,
    /// Share of the axes' acceleration that the records use near the ends, in units of 2⁻¹⁶.
    pub ramp_share: u16,
    /// Speed of the spindle where the card turns it the other way, in units of 2⁻⁸ of its speed forward; 0 where it
    /// cannot.
    pub reverse_share: u16,
    /// What the card does with the spindle.
    pub control: SpindleControl,
}

/// A geared stretch that is armed again, without the instruction at its beginning.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ArmedStretch {
    /// Its first record.
    pub first: RecordIndex,
    /// Its gearing.
    pub start: GearStart,
    /// Commanded speed of the spindle where it is passed forward, in thousandths of a revolution per minute, positive
    /// clockwise; not 0.
    pub speed: i32,
    /// Whether the cursor is at its end, from which it is passed backward; otherwise the cursor is in front of it.
    pub is_passed: bool,
    /// Place in front of it before which nothing is passed backward: the end of the stretch before it.
    pub barrier: Option<RecordIndex>,
}

/// What the card does with the spindle in a stretch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum SpindleControl {
    /// Nothing: no requested rate acts, and the stretch is finished.
    #[default]
    None,
    /// A requested rate of 0 stops it, and a negative one turns it the other way (SPN-21, SPN-22). A positive one turns
    /// it as where the stretch began.
    Held,
    /// The same, and it is reversed behind so many records: the stretch ends where it began (SPN-19). The rest of the
    /// records is for what it turns further.
    Tap(u32),
}

impl GearStart {
    /// Returns the ratio on this spindle; `None` if a number is out of its range.
    #[must_use]
    pub fn ratio(&self, settings: &SpindleSettings) -> Option<GearRatio> {
        let limits = &self.limits;
        let is_valid = (1..1 << 30).contains(&self.length)
            && limits.rate > Rate::ZERO
            && limits.rate <= Rate::MAX
            && limits.near_end.units() >= 0
            && limits.tolerance.units() > 0
            && match self.control {
                SpindleControl::None | SpindleControl::Held => true,
                SpindleControl::Tap(turn) => (1..self.length).contains(&turn) && self.reverse_share > 0,
            };
        if is_valid { GearRatio::new(settings.counts_per_turn, self.records_per_turn) } else { None }
    }
}

/// What an instruction waits for at the spindle, in addition.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SpindleTask {
    /// Until the spindle is at speed (SPN-6).
    AtSpeed,
    /// Until it is at speed and its index is known. The records behind the instruction are then geared (SPN-14).
    Gear(GearStart),
}

/// State of the gear.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum GearState {
    /// The motion follows no spindle.
    #[default]
    Off,
    /// The angle is awaited at which a stretch begins.
    Waiting,
    /// The motion follows the spindle's angle.
    Engaged,
    /// The tool is free of the stretch, which is passed by rate.
    Freed,
}

/// Measured state of the spindle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SpindleStatus {
    /// Measured speed in thousandths of a revolution per minute, positive clockwise; `None` without an encoder.
    pub speed: Option<i32>,
    /// State of the gear.
    pub gear: GearState,
    /// Largest lag in the stretch that is geared, or was geared last, in units of 2⁻¹⁶ records.
    pub largest_lag: u32,
    /// Stretches that were armed again in this epoch, modulo 256.
    pub armed_again: u8,
}
