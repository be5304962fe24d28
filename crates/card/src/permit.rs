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
//! A channel may have an input that proves that the cutter burns or flows. Once it was active for `proven_periods` the
//! cutter is watched: it is lost when the input was inactive for `lost_periods`, at the place where that began. While
//! [`channel::UNWATCHED`] is on, or in a test pulse, the input is ignored, and nothing is lost (CUT-33).
//!
//! Invariant: after [`CutterPermit::apply_period`] a channel of the settings is 0, or its permit holds; a channel that
//! is on has been at rest for at most its grace time.

use retrace_core::{Place, RecordIndex};
use retrace_link::{
    BeamPower, CutterOff, CutterOffCause, CuttingChannel, CuttingSettings, MAX_CUTTING_CHANNELS, OutputChange,
    ProofInput, channel,
};

/// Value of a counter of periods that does not count.
const NOT_WATCHED: u16 = u16::MAX;
const NOTHING_COUNTED: PermitTimer = PermitTimer { handover: 0, standing: 0, proof: ProofState::UNPROVEN };

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
    /// Whether a loss is not watched: the program says so, or that instruction is a test pulse.
    pub is_unwatched: bool,
    /// Active inputs, one bit each.
    pub inputs: u16,
    /// Place of the cursor at the beginning of the period.
    pub place: Place,
}

/// What the input that proves a cutter has shown since the cutter was switched on (CUT-5, CUT-31).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProofState {
    /// Not proven yet: the input has been active for so many control periods in a row.
    Awaited {
        /// Control periods in a row.
        active: u16,
    },
    /// Proven: the input has been inactive for so many control periods in a row.
    Proven {
        /// Control periods in a row.
        inactive: u16,
    },
}

impl Default for ProofState {
    fn default() -> Self {
        Self::UNPROVEN
    }
}

impl ProofState {
    /// State of a cutter that has just been switched on.
    pub const UNPROVEN: Self = Self::Awaited { active: 0 };

    /// Returns the state after a control period with these inputs; `None` if the cutter is lost.
    #[must_use]
    pub const fn after_period(self, of: Option<ProofInput>, inputs: u16) -> Option<Self> {
        let Some(proof) = of else { return Some(self) };
        let is_active = inputs as u32 >> (proof.input & 31) & 1 == 1;
        Some(match self {
            Self::Awaited { .. } if !is_active => Self::UNPROVEN,
            Self::Awaited { active } if active + 1 < proof.proven_periods => Self::Awaited { active: active + 1 },
            Self::Awaited { .. } => Self::Proven { inactive: 0 },
            Self::Proven { .. } if is_active => Self::Proven { inactive: 0 },
            Self::Proven { inactive } if inactive + 1 < proof.lost_periods => Self::Proven { inactive: inactive + 1 },
            Self::Proven { .. } => return None,
        })
    }
}

/// Time that the machine has been at rest with a channel on, in control periods, and whether the cutter is proven.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PermitTimer {
    /// Periods that were not counted because motion was about to begin.
    pub handover: u16,
    /// Periods that were counted.
    pub standing: u16,
    /// What the input that proves the cutter has shown.
    pub proof: ProofState,
}

/// Effect of a control period on the cutting outputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PermitOutcome {
    /// Channels that were on and are off now.
    pub off: Option<CutterOff>,
    /// Whether the grace time has ended, or a cutter is lost: motion must not begin, or must end, until a restart.
    pub blocks: bool,
    /// Whether a cutter is lost.
    pub is_lost: bool,
    /// Input of a cutter that is off and still proven.
    pub stays_on: Option<u8>,
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
    /// Place where the input of each proven channel became inactive.
    lost_at: [Place; MAX_CUTTING_CHANNELS],
    /// Control periods for which the input of each channel has been active since the channel is off; `u16::MAX` where
    /// that is not watched.
    still_proven: [u16; MAX_CUTTING_CHANNELS],
}

impl CutterPermit {
    /// Creates the permit of a card without cutting outputs.
    #[must_use]
    pub const fn new() -> Self {
        const NONE: CuttingChannel =
            CuttingChannel { channel: 0, fires: false, standing_periods: 0, lit_in_reverse: false, proof: None };
        let settings = CuttingSettings {
            channels: [NONE; MAX_CUTTING_CHANNELS],
            count: 0,
            handover_periods: 0,
            inhibit: false,
            beam_power: None,
        };
        let timers = [NOTHING_COUNTED; MAX_CUTTING_CHANNELS];
        Self::with_state(settings, timers, 0)
    }

    /// Creates any state that a history may lead to: for proofs.
    #[must_use]
    pub const fn with_state(settings: CuttingSettings, timers: [PermitTimer; MAX_CUTTING_CHANNELS], lit: u8) -> Self {
        let lost_at = [Place::start_of(RecordIndex::new(0)); MAX_CUTTING_CHANNELS];
        let still_proven = [NOT_WATCHED; MAX_CUTTING_CHANNELS];
        Self { settings, timers, lit, pending: None, lost_at, still_proven }
    }

    /// Returns the settings of a beam's power, if its output is used.
    #[must_use]
    pub(crate) const fn beam_power(&self) -> Option<BeamPower> {
        self.settings.beam_power
    }

    /// Returns the timers, one for each index in the settings.
    #[must_use]
    pub const fn timers(&self) -> &[PermitTimer; MAX_CUTTING_CHANNELS] {
        &self.timers
    }

    /// Switches off every channel that fires, with this cause; the cursor is at `place`. A loss is watched again.
    pub fn switch_off(&mut self, outputs: &mut [i32], cause: CutterOffCause, place: Place) {
        if let Some(unwatched) = outputs.get_mut(usize::from(channel::UNWATCHED)) {
            *unwatched = 0;
        }
        let everything = PermitConditions { denied: Some(cause), place, ..PermitConditions::default() };
        let off = self.apply_conditions(outputs, &everything).off;
        self.pending = self.pending.or(off);
    }

    /// Begins an epoch: the channels that fire are switched off, both those of the old settings and those of the new
    /// ones.
    pub fn open(&mut self, settings: &CuttingSettings, outputs: &mut [i32], place: Place) {
        let mut opened = Self { settings: *settings, ..Self::new() };
        opened.lit = opened.lit_channels(outputs, |_| true);
        for (index, periods) in opened.still_proven.iter_mut().enumerate() {
            if opened.lit >> index & 1 == 1 {
                *periods = 0;
            }
        }
        opened.switch_off(outputs, CutterOffCause::EpochOpened, place);
        self.switch_off(outputs, CutterOffCause::EpochOpened, place);
        *self = opened;
    }

    /// Applies one control period: switches off every channel whose permit is missing.
    pub fn apply_period(&mut self, outputs: &mut [i32], conditions: &PermitConditions) -> PermitOutcome {
        let outcome = self.apply_conditions(outputs, conditions);
        let stays_on = self.watch_proof_after_off(conditions.inputs);
        PermitOutcome { off: self.pending.take().or(outcome.off), stays_on, ..outcome }
    }

    fn apply_conditions(&mut self, outputs: &mut [i32], conditions: &PermitConditions) -> PermitOutcome {
        let mut outcome = PermitOutcome::default();
        let Self { settings, timers, lit, lost_at, .. } = self;
        for (index, (of, timer)) in settings.channels().iter().zip(timers).enumerate() {
            let Some(lost_at) = lost_at.get_mut(index) else { continue };
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
                    if before.proof == (ProofState::Proven { inactive: 0 }) {
                        *lost_at = conditions.place;
                    }
                    *timer = after;
                    *lit |= 1 << index;
                }
                Err(cause) => {
                    *output = 0;
                    let is_lost = cause == CutterOffCause::Lost;
                    outcome.is_lost |= is_lost;
                    outcome.blocks |= is_lost || cause == CutterOffCause::Standing;
                    if was_lit && of.fires {
                        if before.proof == (ProofState::Proven { inactive: 0 }) {
                            *lost_at = conditions.place;
                        }
                        let place = if is_lost { *lost_at } else { conditions.place };
                        let off = outcome.off.get_or_insert(CutterOff { channels: 0, cause, place });
                        off.channels |= 1 << index;
                    }
                }
            }
        }
        outcome
    }

    /// Reports the channels that fire and that an instruction has switched off, with this cause; the cursor is at
    /// `place`.
    pub fn report_off(&mut self, outputs: &[i32], cause: CutterOffCause, place: Place) {
        let channels = self.settings.channels().iter().enumerate().filter(|&(index, of)| {
            let is_off = outputs.get(usize::from(of.channel)).is_some_and(|&value| value == 0);
            of.fires && is_off && self.lit >> index & 1 == 1
        });
        let channels = channels.fold(0, |bits, (index, _)| bits | 1 << index);
        self.pending = self.pending.or(Some(CutterOff { channels, cause, place }));
    }

    /// Reports that the start of a cutter was cancelled by hand; the cursor is at `place`. No channel went off by
    /// itself.
    pub fn report_cancelled_start(&mut self, place: Place) {
        let cancelled = CutterOff { channels: 0, cause: CutterOffCause::NotStarted, place };
        self.pending = self.pending.or(Some(cancelled));
    }

    /// Counts for how long the input of a channel stays active after the channel went off, and returns the first input
    /// for which that is too long.
    fn watch_proof_after_off(&mut self, inputs: u16) -> Option<u8> {
        let mut too_long = None;
        let channels = self.settings.channels().iter().zip(&mut self.still_proven).enumerate();
        for (index, (of, periods)) in channels {
            let Some(proof) = of.proof.filter(|proof| proof.out_periods > 0) else { continue };
            if self.lit >> index & 1 == 1 {
                *periods = 0;
            } else if inputs >> (proof.input & 15) & 1 == 0 {
                *periods = NOT_WATCHED;
            } else if *periods != NOT_WATCHED {
                // The period in which the channel went off counts as the first.
                *periods += 1;
                if *periods > proof.out_periods {
                    *periods = NOT_WATCHED;
                    too_long = too_long.or(Some(proof.input));
                }
            }
        }
        too_long
    }

    /// Returns the input that proves a cutter which one of these changes switches on, where that input is active
    /// although the cutter is off.
    #[must_use]
    pub fn proven_before_start(&self, changes: &[OutputChange], outputs: &[i32], inputs: u16) -> Option<u8> {
        let is_off = |channel: u8| outputs.get(usize::from(channel)).is_some_and(|&value| value == 0);
        let switched_on = changes.iter().filter(|change| change.value != 0 && is_off(change.channel));
        let proofs = switched_on.flat_map(|change| {
            self.settings.channels().iter().filter(|of| of.channel == change.channel).filter_map(|of| of.proof)
        });
        proofs.map(|proof| proof.input).find(|input| inputs >> (input & 15) & 1 == 1)
    }

    /// Whether this channel may be switched on manually now; always for one that does not cut.
    #[must_use]
    pub fn may_switch_on(&self, channel: u8, conditions: &PermitConditions) -> bool {
        let mut of_channel = self.settings.channels().iter().filter(|of| of.channel == channel);
        of_channel.all(|of| check_channel(of, &self.settings, PermitTimer::default(), conditions).is_ok())
    }

    /// Whether this channel fires.
    #[must_use]
    pub fn fires(&self, channel: u8) -> bool {
        self.settings.channels().iter().any(|of| of.channel == channel && of.fires)
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

    /// Whether every channel that fires and is on is proven; `None` where none is on. The second: whether all of their
    /// inputs were active in the last period.
    #[must_use]
    pub fn proven(&self, outputs: &[i32]) -> Option<(bool, bool)> {
        let lit = self.lit_channels(outputs, |_| true);
        let channels = self.settings.channels().iter().zip(&self.timers).enumerate();
        let watched = channels.filter(|&(index, (of, _))| lit >> index & 1 == 1 && of.proof.is_some());
        let proofs = watched.map(|(_, (_, timer))| match timer.proof {
            ProofState::Awaited { .. } => (false, false),
            ProofState::Proven { inactive } => (true, inactive == 0),
        });
        (lit != 0).then(|| proofs.fold((true, true), |all, one| (all.0 && one.0, all.1 && one.1)))
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
    let proof = if now.is_unwatched { Some(timer.proof) } else { timer.proof.after_period(of.proof, now.inputs) };
    let Some(proof) = proof else { return Err(CutterOffCause::Lost) };
    if now.moving || now.keeps_cutter {
        return Ok(PermitTimer { handover: 0, standing: 0, proof });
    }
    if now.awaits_motion && timer.handover < settings.handover_periods {
        return Ok(PermitTimer { handover: timer.handover + 1, proof, ..timer });
    }
    if timer.standing >= of.standing_periods {
        return Err(CutterOffCause::Standing);
    }
    Ok(PermitTimer { standing: timer.standing + 1, proof, ..timer })
}
