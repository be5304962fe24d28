//! The terms of an epoch: settings that this card can work by, and what follows from them.
//!
//! Invariant: what stands here was checked as a whole; whoever has terms need not look at the settings again.

use retrace_core::Record;
use retrace_link::{
    Alarm, CardIdentity, CardSettings, CommandRefusal, InputUse, MAX_CUTTING_CHANNELS, MAX_INPUTS, MAX_SAFE,
};

use crate::step_direction::StepTiming;
use crate::{backlash, outputs};

/// Agreed settings.
#[derive(Clone, Debug)]
pub struct CheckedSettings<const A: usize> {
    settings: CardSettings<A>,
    timing: StepTiming,
    most: u16,
}

impl<const A: usize> CheckedSettings<A> {
    /// Looks the settings through: epoch, axes, control period, reports, watchdog, play, pulses, inputs and safe outputs. Whether the rate law
    /// fits the memory is for the player to say.
    ///
    /// # Errors
    /// [`Refusal::Unfit`] where the card cannot work by them, [`Refusal::NoSuchChannel`] for a safe output or a cutting channel that is not there.
    pub fn validate(settings: &CardSettings<A>, identity: &CardIdentity) -> Result<Self, CommandRefusal> {
        let period_us = settings.period_us;
        let numbers = settings.epoch != 0
            && (1..=identity.axes).contains(&settings.axes)
            && (identity.min_period_us..=identity.max_period_us).contains(&period_us)
            && settings.report_periods != 0
            && settings.watchdog_periods != 0
            && usize::from(settings.safe_count) <= MAX_SAFE
            && usize::from(settings.cutting.count) <= MAX_CUTTING_CHANNELS;
        let play = backlash::IS_COMPENSATED || settings.backlash_pulses.iter().all(|&pulses| pulses == 0);
        if !numbers || !play || !inputs_are_there(settings, identity.inputs) {
            return Err(CommandRefusal::Unfit);
        }
        if !settings.safe().iter().all(|change| outputs::has(identity.outputs, change.channel)) {
            return Err(CommandRefusal::NoSuchChannel);
        }
        if !settings.cutting.channels().iter().all(|of| outputs::has(identity.outputs, of.channel)) {
            return Err(CommandRefusal::NoSuchChannel);
        }
        let (pulse_ns, setup_ns) = (settings.pulse_ns, settings.direction_setup_ns);
        let timing =
            StepTiming::of_clock(identity.tick_hz, period_us, pulse_ns, setup_ns).ok_or(CommandRefusal::Unfit)?;
        let fastest = u64::from(identity.max_pulses_hz) * u64::from(period_us) / 1_000_000;
        // No more than the timing's, which is a u16.
        let most = fastest.min(u64::from(timing.max_increment())) as u16;
        // One pulse is kept for the rounding where a period takes parts of two records.
        if most < 2 { Err(CommandRefusal::Unfit) } else { Ok(Self { settings: *settings, timing, most }) }
    }

    /// The settings.
    #[must_use]
    pub const fn settings(&self) -> &CardSettings<A> {
        &self.settings
    }

    /// The times of every axis' step and direction output.
    #[must_use]
    pub const fn timing(&self) -> StepTiming {
        self.timing
    }

    /// The most pulses of an axis in a control period.
    #[must_use]
    pub const fn max_increment(&self) -> u16 {
        self.most
    }

    /// Can every period be emitted that this record may have a part in?
    ///
    /// It is passed at rate 1, or at its cap where that is higher, at most. A period that lies in several records makes no more pulses than
    /// the greatest of them would for a whole one, and one more for the rounding at either end; that one is kept back here. So no
    /// motion that has begun ever meets the bound.
    ///
    /// # Errors
    /// What stands against it: the alarm to be latched, or none where the record moves an axis that is not used.
    pub fn check(&self, record: &Record<A>) -> Result<(), Option<Alarm>> {
        let cap = u32::from(record.cap.get().max(16));
        for (axis, increment) in record.increments.iter().enumerate() {
            let magnitude = u32::from(increment.unsigned_abs());
            if axis >= usize::from(self.settings.axes) && magnitude != 0 {
                return Err(None);
            }
            if magnitude * cap > u32::from(self.most - 1) * 16 {
                return Err(Some(Alarm::TooManyPulses { axis: axis as u8 }));
            }
        }
        Ok(())
    }
}

/// Do the inputs that mean something exist, and the axes that they name?
fn inputs_are_there<const A: usize>(settings: &CardSettings<A>, inputs: u8) -> bool {
    settings.inputs.iter().enumerate().all(|(number, setting)| {
        let there = number < usize::from(inputs).min(MAX_INPUTS);
        match setting.used_for {
            InputUse::Plain => true,
            InputUse::Limit { axis, .. } | InputUse::Home { axis } => there && axis < settings.axes,
            InputUse::Door | InputUse::EmergencyStop | InputUse::Probe => there,
        }
    })
}
