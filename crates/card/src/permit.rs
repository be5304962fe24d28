//! The permit: whether a cutting output may be on in a control period (CUT-3, CUT-6, CUT-8).
//!
//! A channel that fires may be on while an epoch is open, no alarm is latched, the host is heard of, the card is not inhibited, the path
//! does not run backward, and the machine has not stood for longer than the grace. What a word, an action or an instruction asks for
//! does not matter: where a condition is missing the output is 0, and it stays 0 until it is switched on again.
//!
//! Standing is counted for each channel from the period in which it is lit and the cursor stands. It is not counted while an instruction
//! that needs the cutter is executed. While motion is asked for, or a restart is between two repeated instructions, the first
//! `handover_periods` are not counted.
//!
//! Invariant: after [`Permit::period`] a channel of the settings is 0, or its permit holds; a channel that is on has stood for at most its
//! grace.

use retrace_link::{CutterOff, CutterOffCause, CuttingChannel, CuttingSettings, MAX_CUTTING_CHANNELS};

/// What a control period was like, as far as the permit depends on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PermitConditions {
    /// Why no cutting output may be on whatever the path does: no epoch is open, an alarm is latched, or the host is silent.
    pub denied: Option<CutterOffCause>,
    /// The path ran backward, or is about to.
    pub backward: bool,
    /// The cursor moved.
    pub moving: bool,
    /// Motion is asked for and not blocked, or a restart is between two repeated instructions.
    pub awaits: bool,
    /// An instruction was executed during which standing is not counted.
    pub keeps: bool,
}

/// How long the machine has stood with a channel on, in control periods.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PermitTimer {
    /// Periods that were not counted because motion was about to begin.
    pub handover: u16,
    /// Periods that were counted.
    pub standing: u16,
}

/// What a control period did to the cutting outputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PermitOutcome {
    /// The channels that were on and are off now.
    pub off: Option<CutterOff>,
    /// The grace ran out: motion must not begin before a restart.
    pub blocks: bool,
}

/// The permits of all cutting outputs.
#[derive(Clone, Debug)]
pub struct CutterPermit {
    settings: CuttingSettings,
    timers: [PermitTimer; MAX_CUTTING_CHANNELS],
    /// The channels that were on after the last period, one bit for each index in the settings.
    lit: u8,
    /// Channels that were switched off since the last period.
    pending: Option<CutterOff>,
}

impl CutterPermit {
    /// A card without cutting outputs.
    #[must_use]
    pub const fn new() -> Self {
        const NONE: CuttingChannel =
            CuttingChannel { channel: 0, fires: false, standing_periods: 0, lit_in_reverse: false };
        let settings =
            CuttingSettings { channels: [NONE; MAX_CUTTING_CHANNELS], count: 0, handover_periods: 0, inhibit: false };
        let timers = [PermitTimer { handover: 0, standing: 0 }; MAX_CUTTING_CHANNELS];
        Self { settings, timers, lit: 0, pending: None }
    }

    /// A state as any history may have left it: for proofs.
    #[must_use]
    pub const fn with_state(settings: CuttingSettings, timers: [PermitTimer; MAX_CUTTING_CHANNELS], lit: u8) -> Self {
        Self { settings, timers, lit, pending: None }
    }

    /// The timers, one for each index in the settings.
    #[must_use]
    pub const fn timers(&self) -> &[PermitTimer; MAX_CUTTING_CHANNELS] {
        &self.timers
    }

    /// Switches every channel off that fires, with this cause.
    pub fn put_out(&mut self, outputs: &mut [i32], cause: CutterOffCause) {
        let everything = PermitConditions { denied: Some(cause), ..PermitConditions::default() };
        let off = self.apply(outputs, &everything).off;
        self.pending = self.pending.or(off);
    }

    /// An epoch begins: the channels that fire are switched off, those of the old settings and those of the new ones.
    pub fn open(&mut self, settings: &CuttingSettings, outputs: &mut [i32]) {
        let mut opened = Self { settings: *settings, ..Self::new() };
        opened.lit = opened.lit_now(outputs, |_| true);
        opened.put_out(outputs, CutterOffCause::EpochOpened);
        self.put_out(outputs, CutterOffCause::EpochOpened);
        *self = opened;
    }

    /// One control period: switches off every channel whose permit is missing.
    pub fn period(&mut self, outputs: &mut [i32], conditions: &PermitConditions) -> PermitOutcome {
        let outcome = self.apply(outputs, conditions);
        PermitOutcome { off: self.pending.take().or(outcome.off), ..outcome }
    }

    fn apply(&mut self, outputs: &mut [i32], conditions: &PermitConditions) -> PermitOutcome {
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
            match check(of, settings, before, conditions) {
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

    /// May this channel be switched on by hand now? Yes for one that does not cut.
    #[must_use]
    pub fn may_light(&self, channel: u8, conditions: &PermitConditions) -> bool {
        let mut of_channel = self.settings.channels().iter().filter(|of| of.channel == channel);
        of_channel.all(|of| check(of, &self.settings, PermitTimer::default(), conditions).is_ok())
    }

    /// Does this channel fire, and may it not be on while the path runs backward? An action that is replayed does not light it.
    #[must_use]
    pub fn is_forward_only(&self, channel: u8) -> bool {
        self.settings.channels().iter().any(|of| of.channel == channel && of.fires && !of.lit_in_reverse)
    }

    /// Is a channel on that must be off before the path runs backward?
    #[must_use]
    pub fn is_lit_forward_only(&self, outputs: &[i32]) -> bool {
        self.lit_now(outputs, |of| !of.lit_in_reverse) != 0
    }

    /// Is a channel on that fires?
    #[must_use]
    pub fn is_lit(&self, outputs: &[i32]) -> bool {
        self.lit_now(outputs, |_| true) != 0
    }

    fn lit_now(&self, outputs: &[i32], which: impl Fn(&CuttingChannel) -> bool) -> u8 {
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

/// The permit of a channel that is on, for one control period: its timer afterwards.
///
/// # Errors
/// Why the channel must be off.
pub const fn check(
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
    if now.moving || now.keeps {
        return Ok(PermitTimer { handover: 0, standing: 0 });
    }
    if now.awaits && timer.handover < settings.handover_periods {
        return Ok(PermitTimer { handover: timer.handover + 1, ..timer });
    }
    if timer.standing >= of.standing_periods {
        return Err(CutterOffCause::Standing);
    }
    Ok(PermitTimer { standing: timer.standing + 1, ..timer })
}
