//! Settings of an epoch that this card has checked, and values derived from them.
//!
//! Invariant: the values were checked as a whole; code that has [`CheckedSettings`] need not check them again.

use retrace_core::{FeedShare, Record};
use retrace_link::{
    Alarm, CardIdentity, CardSettings, CommandRefusal, InputUse, MAX_CUTTING_CHANNELS, MAX_INPUTS, MAX_POWER_EXPONENT,
    MAX_SAFE,
};

use crate::step_direction::StepTiming;
use crate::{FOLLOWED_SPINDLES, OutputCounts};

/// Checked settings.
#[derive(Clone, Debug)]
pub struct CheckedSettings<const A: usize> {
    settings: CardSettings<A>,
    timing: StepTiming,
    max_increment: u16,
}

impl<const A: usize> CheckedSettings<A> {
    /// Checks the settings: epoch, axes, control period, reports, watchdog, backlash, pulses, inputs and safe outputs.
    /// The player checks whether the rate law fits the memory.
    ///
    /// # Errors
    /// [`CommandRefusal::Unsupported`] if the card does not support them, [`CommandRefusal::NoSuchChannel`] for a safe
    /// output or a cutting channel that does not exist.
    pub fn validate(settings: &CardSettings<A>, identity: &CardIdentity) -> Result<Self, CommandRefusal> {
        let period_us = settings.period_us;
        let numbers = settings.epoch != 0
            && (1..=identity.axes).contains(&settings.axes)
            && (identity.min_period_us..=identity.max_period_us).contains(&period_us)
            && settings.report_periods != 0
            && settings.watchdog_periods != 0
            && usize::from(settings.safe_count) <= MAX_SAFE
            && usize::from(settings.cutting.count) <= MAX_CUTTING_CHANNELS;
        let proofs = settings.cutting.channels().iter().filter_map(|of| of.proof);
        let proofs_exist = proofs.into_iter().all(|proof| proof.input < identity.inputs.min(MAX_INPUTS as u8));
        let layer_is_valid = settings.layer.is_none_or(|layer| {
            let exists = layer.axis < settings.axes && u32::from(layer.contacts) >> identity.inputs.min(16) == 0;
            exists && layer.contacts != 0 && layer.probe_speed > 0 && layer.latch_speed > 0
        });
        let cutting = &settings.cutting;
        let power_is_valid = cutting.beam_power.is_none_or(|power| {
            let enables = cutting.channels().iter().any(|of| of.channel == power.channel && of.fires);
            let is_bounded = power.least <= FeedShare::FEED && (1..=MAX_POWER_EXPONENT).contains(&power.exponent);
            identity.has_spindle_pwm && enables && is_bounded
        });
        let pwm_is_valid = settings.spindle_pwm.is_none_or(|pwm| identity.has_spindle_pwm && pwm.is_valid());
        let spindle_is_valid =
            settings.spindle.is_none_or(|of| FOLLOWED_SPINDLES > 0 && identity.has_spindle_encoder && of.is_valid());
        if !numbers
            || !spindle_is_valid
            || !power_is_valid
            || !pwm_is_valid
            || !inputs_exist(settings, identity.inputs)
            || !proofs_exist
            || !layer_is_valid
        {
            return Err(CommandRefusal::Unsupported);
        }
        let outputs = OutputCounts::of(identity);
        if !settings.safe().iter().all(|change| outputs.has_channel(change.channel)) {
            return Err(CommandRefusal::NoSuchChannel);
        }
        if !settings.cutting.channels().iter().all(|of| outputs.has_channel(of.channel)) {
            return Err(CommandRefusal::NoSuchChannel);
        }
        let (pulse_ns, setup_ns) = (settings.pulse_ns, settings.direction_setup_ns);
        let timing =
            StepTiming::of_clock(identity.tick_hz, period_us, pulse_ns, setup_ns).ok_or(CommandRefusal::Unsupported)?;
        let fastest = u64::from(identity.max_pulses_hz) * u64::from(period_us) / 1_000_000;
        // At most the limit of the timing, which is a u16.
        let most = fastest.min(u64::from(timing.max_increment())) as u16;
        // One pulse is reserved for the rounding where a period takes parts of two records.
        if most < 2 {
            Err(CommandRefusal::Unsupported)
        } else {
            Ok(Self { settings: *settings, timing, max_increment: most })
        }
    }

    /// Returns the settings.
    #[must_use]
    pub const fn settings(&self) -> &CardSettings<A> {
        &self.settings
    }

    /// Returns the timing of every axis' step and direction output.
    #[must_use]
    pub const fn timing(&self) -> StepTiming {
        self.timing
    }

    /// Returns the maximum pulses of an axis in a control period.
    #[must_use]
    pub const fn max_increment(&self) -> u16 {
        self.max_increment
    }

    /// Checks that every period that includes a part of this record can be emitted.
    ///
    /// The record is passed at most at rate 1, or at its cap if that is higher. A period that spans several records
    /// makes no more pulses than the largest of them would for a whole one, and one more for the rounding at either
    /// end; that one is reserved here. So no motion that has begun ever meets the bound.
    ///
    /// # Errors
    /// Returns the alarm to latch, or `None` if the record moves an axis that is not used.
    pub fn check_record(&self, record: &Record<A>) -> Result<(), Option<Alarm>> {
        let cap = u32::from(record.cap.get().max(16));
        for (axis, increment) in record.increments.iter().enumerate() {
            let magnitude = u32::from(increment.unsigned_abs());
            if axis >= usize::from(self.settings.axes) && magnitude != 0 {
                return Err(None);
            }
            if magnitude * cap > u32::from(self.max_increment - 1) * 16 {
                return Err(Some(Alarm::TooManyPulses { axis: axis as u8 }));
            }
        }
        Ok(())
    }
}

/// Whether the inputs with a meaning exist, and the axes that they refer to.
fn inputs_exist<const A: usize>(settings: &CardSettings<A>, inputs: u8) -> bool {
    settings.inputs.iter().enumerate().all(|(number, setting)| {
        let exists = number < usize::from(inputs).min(MAX_INPUTS);
        match setting.used_for {
            InputUse::Plain => true,
            InputUse::Limit { axis, .. } | InputUse::Home { axis } => exists && axis < settings.axes,
            InputUse::Door | InputUse::EmergencyStop | InputUse::Probe | InputUse::Collision { .. } => exists,
        }
    })
}
