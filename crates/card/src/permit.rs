//! The permit: whether a cutting output may be on in a control period (CUT-3, CUT-6, CUT-8).
//!
//! A channel that fires may be on while an epoch is open, no alarm is latched, the host is alive, the card is not
//! inhibited, the path does not run backward, and the machine has not been at rest for longer than the grace time. What
//! a command, an action or an instruction requests does not matter: if a condition is missing the output is 0, and it
//! stays 0 until it is switched on again.
//!
//! Time at rest is counted for each channel from the period in which it is on and the cursor is at rest. It is not
//! counted while an instruction that needs the cutter is executed. While motion is requested, or a restart is between
//! two repeated instructions, the first `handover_periods` are not counted.
//!
//! Invariant: after [`CutterPermit::apply_period`] a channel of the settings is 0, or its permit holds; a channel that
//! is on has been at rest for at most its grace time.

use retrace_link::{CutterOff, CutterOffCause, CuttingChannel, CuttingSettings, MAX_CUTTING_CHANNELS};

/// Conditions of a control period, as far as the permit depends on them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PermitConditions {
    /// Reason why no cutting output may be on, independent of the path: no epoch is open, an alarm is latched, or the
    /// host is silent.
    pub denied: Option<CutterOffCause>,
    /// Whether the path ran backward, or is about to.
    pub backward: bool,
    /// Whether the cursor moved.
    pub moving: bool,
    /// Whether motion is requested and not blocked, or a restart is between two repeated instructions.
    pub awaits_motion: bool,
    /// Whether an instruction was executed during which time at rest is not counted.
    pub keeps_cutter: bool,
}

/// Time that the machine has been at rest with a channel on, in control periods.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PermitTimer {
    /// Periods that were not counted because motion was about to begin.
    pub handover: u16,
    /// Periods that were counted.
    pub standing: u16,
}

/// Effect of a control period on the cutting outputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PermitOutcome {
    /// Channels that were on and are off now.
    pub off: Option<CutterOff>,
    /// Whether the grace time has ended: motion must not begin before a restart.
    pub blocks: bool,
}

/// Permits of all cutting outputs.
#[derive(Clone, Debug)]
pub struct CutterPermit {
    settings: CuttingSettings,
    timers: [PermitTimer; MAX_CUTTING_CHANNELS],
    /// Channels that were on after the last period, one bit for each index in the settings.
    lit: u8,
    /// Channels that were switched off since the last period.
    pending: Option<CutterOff>,
}

impl CutterPermit {
    /// Creates the permit of a card without cutting outputs.
    #[must_use]
    pub const fn new() -> Self {
        const NONE: CuttingChannel =
            CuttingChannel { channel: 0, fires: false, standing_periods: 0, lit_in_reverse: false };
        let settings =
            CuttingSettings { channels: [NONE; MAX_CUTTING_CHANNELS], count: 0, handover_periods: 0, inhibit: false };
        let timers = [PermitTimer { handover: 0, standing: 0 }; MAX_CUTTING_CHANNELS];
        Self { settings, timers, lit: 0, pending: None }
    }

    /// Creates any state that a history may lead to: for proofs.
    #[must_use]
    pub const fn with_state(settings: CuttingSettings, timers: [PermitTimer; MAX_CUTTING_CHANNELS], lit: u8) -> Self {
        Self { settings, timers, lit, pending: None }
    }

    /// Returns the timers, one for each index in the settings.
    #[must_use]
    pub const fn timers(&self) -> &[PermitTimer; MAX_CUTTING_CHANNELS] {
        &self.timers
    }

    /// Switches off every channel that fires, with this cause.
    pub fn switch_off(&mut self, outputs: &mut [i32], cause: CutterOffCause) {
        let everything = PermitConditions { denied: Some(cause), ..PermitConditions::default() };
        let off = self.apply_conditions(outputs, &everything).off;
        self.pending = self.pending.or(off);
    }

    /// Begins an epoch: the channels that fire are switched off, both those of the old settings and those of the new
    /// ones.
    pub fn open(&mut self, settings: &CuttingSettings, outputs: &mut [i32]) {
        let mut opened = Self { settings: *settings, ..Self::new() };
        opened.lit = opened.lit_channels(outputs, |_| true);
        opened.switch_off(outputs, CutterOffCause::EpochOpened);
        self.switch_off(outputs, CutterOffCause::EpochOpened);
        *self = opened;
    }

    /// Applies one control period: switches off every channel whose permit is missing.
    pub fn apply_period(&mut self, outputs: &mut [i32], conditions: &PermitConditions) -> PermitOutcome {
        let outcome = self.apply_conditions(outputs, conditions);
        PermitOutcome { off: self.pending.take().or(outcome.off), ..outcome }
    }

    fn apply_conditions(&mut self, outputs: &mut [i32], conditions: &PermitConditions) -> PermitOutcome {
        let mut outcome = PermitOutcome::default();
        let Self { settings, timers, lit, .. } = self;
        for (index, (of, timer)) in settings.channels().iter().zip(timers).enumerate() {
            let Some(output) = outputs.get_mut(usize::from(of.channel)) else { continue };
            let was_lit = *lit >> index & 1 == 1;
            let before = if was_lit { *timer } else { PermitTimer::default() };
            *timer = PermitTimer::default();
            *lit &= !(1 << index);
            if *output == 0 {
                continue;
            }
            match check_channel(of, settings, before, conditions) {
                Ok(after) => {
                    *timer = after;
                    *lit |= 1 << index;
                }
                Err(cause) => {
                    *output = 0;
                    outcome.blocks |= cause == CutterOffCause::Standing;
                    if was_lit && of.fires {
                        let off = outcome.off.get_or_insert(CutterOff { channels: 0, cause });
                        off.channels |= 1 << index;
                    }
                }
            }
        }
        outcome
    }

    /// Whether this channel may be switched on manually now; always for one that does not cut.
    #[must_use]
    pub fn may_switch_on(&self, channel: u8, conditions: &PermitConditions) -> bool {
        let mut of_channel = self.settings.channels().iter().filter(|of| of.channel == channel);
        of_channel.all(|of| check_channel(of, &self.settings, PermitTimer::default(), conditions).is_ok())
    }

    /// Whether this channel fires and must not be on while the path runs backward. A replayed action does not switch it
    /// on.
    #[must_use]
    pub fn is_forward_only(&self, channel: u8) -> bool {
        self.settings.channels().iter().any(|of| of.channel == channel && of.fires && !of.lit_in_reverse)
    }

    /// Whether a channel is on that must be off before the path runs backward.
    #[must_use]
    pub fn is_lit_forward_only(&self, outputs: &[i32]) -> bool {
        self.lit_channels(outputs, |of| !of.lit_in_reverse) != 0
    }

    /// Whether a channel that fires is on.
    #[must_use]
    pub fn is_lit(&self, outputs: &[i32]) -> bool {
        self.lit_channels(outputs, |_| true) != 0
    }

    fn lit_channels(&self, outputs: &[i32], which: impl Fn(&CuttingChannel) -> bool) -> u8 {
        let channels = self.settings.channels().iter().enumerate();
        let lit = channels.filter(|(_, of)| {
            of.fires && which(of) && outputs.get(usize::from(of.channel)).is_some_and(|&value| value != 0)
        });
        lit.fold(0, |bits, (index, _)| bits | 1 << index)
    }
}

impl Default for CutterPermit {
    fn default() -> Self {
        Self::new()
    }
}

/// Checks the permit of a channel that is on for one control period, and returns its timer afterwards.
///
/// # Errors
/// Returns the reason why the channel must be off.
pub const fn check_channel(
    of: &CuttingChannel,
    settings: &CuttingSettings,
    timer: PermitTimer,
    now: &PermitConditions,
) -> Result<PermitTimer, CutterOffCause> {
    if !of.fires {
        return if settings.inhibit { Err(CutterOffCause::Inhibited) } else { Ok(timer) };
    }
    if let Some(cause) = now.denied {
        return Err(cause);
    }
    if settings.inhibit {
        return Err(CutterOffCause::Inhibited);
    }
    if now.backward && !of.lit_in_reverse {
        return Err(CutterOffCause::Reverse);
    }
    if now.moving || now.keeps_cutter {
        return Ok(PermitTimer { handover: 0, standing: 0 });
    }
    if now.awaits_motion && timer.handover < settings.handover_periods {
        return Ok(PermitTimer { handover: timer.handover + 1, ..timer });
    }
    if timer.standing >= of.standing_periods {
        return Err(CutterOffCause::Standing);
    }
    Ok(PermitTimer { standing: timer.standing + 1, ..timer })
}
