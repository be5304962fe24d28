//! A complete card without its serial line: the player, and around it the safety monitor, the inputs, homing and the
//! card's identity.
//!
//! Invariant: while an alarm is latched the motion brakes on the path and stays at rest, and the outputs that the
//! settings define as safe have their safe values. After it was cleared nothing moves before a new command.

use retrace_core::{Rate, RateTarget, Record, RecordIndex};
use retrace_link::{
    Alarm, CardCore, CardIdentity, CardSettings, CardStatus, CommandRefusal, CutterOffCause, HomingCommand,
    HostCommand, LayerMove, MAX_PULSE_US, Outputs, PROTOCOL, ProbeArming, RepeatedInstruction, SpeedCurve,
};

use crate::homing::{HomingEnd, HomingSearch};
use crate::safety_monitor::MotionState;
use crate::spindle_pwm::{PwmSignal, duty_of};
use crate::window::RecordStorage;
use crate::{
    AwaitedProbe, BacklashCompensation, CheckedSettings, InputLevels, Inputs, OutputCounts, Player, SafetyMonitor,
};

/// Card for `A` axes, a window of `W` records and averages of the rate law of up to `M` periods.
///
/// [`Card::run_period`] is called once per control period with the current inputs; between these calls it accepts
/// commands. [`Card::pulses`] then returns what the step and direction outputs are to emit in the next period.
#[derive(Clone, Debug)]
pub struct Card<const A: usize, const W: usize, const M: usize, S = [Record<A>; W]> {
    identity: CardIdentity,
    /// Settings of the epoch; `None` before the first.
    settings: Option<CheckedSettings<A>>,
    player: Player<A, W, M, S>,
    inputs: Inputs,
    safety: SafetyMonitor,
    homing: Option<HomingSearch>,
    backlash: BacklashCompensation<A>,
    /// Pulses to emit in the period, including backlash.
    pulses: [i32; A],
    /// Whether homing has moved the counts off the path: an epoch must begin before anything is played.
    epoch_required: bool,
    is_open: bool,
    instruction_failed: bool,
    /// Curve of the output for S; `None` before the host has sent one.
    speed_curve: Option<SpeedCurve>,
}

impl<const A: usize, const W: usize, const M: usize> Card<A, W, M> {
    /// Creates a card without an epoch, at rest, all counts and outputs zero. The properties defined by the type
    /// (protocol, axes, window, memory) are filled in; the axes may be fewer. Returns `None` if `M` is zero.
    #[must_use]
    pub const fn new(identity: CardIdentity) -> Option<Self> {
        // `?` is not allowed in a constant
        let Some(player) = Player::unconfigured(RecordIndex::new(0), OutputCounts::of(&identity)) else { return None };
        Some(Self::with_player(identity, player))
    }
}

impl<const A: usize, const W: usize, const M: usize> Card<A, W, M, &'static mut [Record<A>]> {
    /// Creates a card as [`Card::new`] does, with a window whose records are provided by [`Card::lend_records`].
    #[must_use]
    pub const fn without_records(identity: CardIdentity) -> Option<Self> {
        let Some(player) = Player::unconfigured_without_records(OutputCounts::of(&identity)) else { return None };
        Some(Self::with_player(identity, player))
    }

    /// Sets the storage of the window's `W` records. To be called before the serial line is served.
    pub fn lend_records(&mut self, records: &'static mut [Record<A>; W]) {
        self.player.lend_records(records);
    }
}

impl<const A: usize, const W: usize, const M: usize, S> Card<A, W, M, S> {
    const fn with_player(identity: CardIdentity, player: Player<A, W, M, S>) -> Self {
        // `min` and `try_into` are not allowed in a constant
        let axes = if (identity.axes as usize) < A { identity.axes } else { A as u8 };
        let memory = if M < u16::MAX as usize { M as u16 } else { u16::MAX };
        let identity = CardIdentity { protocol: PROTOCOL, axes, window: W as u32, memory, ..identity };
        Self {
            identity,
            settings: None,
            player,
            inputs: Inputs::new(),
            safety: SafetyMonitor::new(),
            homing: None,
            backlash: BacklashCompensation::new(),
            pulses: [0; A],
            epoch_required: false,
            is_open: false,
            instruction_failed: false,
            speed_curve: None,
        }
    }

    /// Sets the serial number and the number of this start, which are only known at run time. To be called before the
    /// serial line is served.
    pub const fn set_identity(&mut self, serial: u32, boot: u32) {
        (self.identity.serial, self.identity.boot) = (serial, boot);
    }
}

impl<const A: usize, const W: usize, const M: usize, S: RecordStorage<A>> Card<A, W, M, S> {
    /// Creates a card as [`Card::new`] does, with a window whose records are stored in `records`: a computer allocates
    /// them. Returns `None` if `records` are not `W` records, too.
    #[must_use]
    pub fn with_records(identity: CardIdentity, records: S) -> Option<Self> {
        if records.as_ref().len() != W {
            return None;
        }
        Some(Self::with_player(identity, Player::unconfigured_with_records(records, OutputCounts::of(&identity))?))
    }

    /// Restores counts and output values, for a card that retained both over a restart. To be called before anything
    /// has moved.
    pub fn restore_state(&mut self, counts: [i64; A], outputs: &Outputs) {
        self.player.restore_state(counts, outputs);
    }

    /// Returns the settings of the epoch; `None` before the first.
    #[must_use]
    pub const fn settings(&self) -> Option<&CheckedSettings<A>> {
        self.settings.as_ref()
    }

    /// Records that a complete frame of the open epoch has arrived, so the host is alive. To be called before the
    /// commands of the frame are accepted.
    pub const fn keep_alive(&mut self) {
        self.safety.record_host_frame();
    }

    /// Runs one control period.
    pub fn run_period(&mut self, inputs: InputLevels) -> &CardStatus<A> {
        let wheel = self.inputs.read(&inputs);
        self.player.observe_probe(self.inputs.active(), inputs.probe);
        self.instruction_failed = inputs.failed;
        let encoder_alarm = self.player.read_spindle(&inputs.spindle);
        let homing = self.homing.as_ref().map(HomingSearch::target_switch);
        let lit = self.player.is_lit();
        // Only the door switch and the collision inputs depend on it.
        let acting = self.inputs.active() != 0 && (homing.is_some() || lit || self.player.is_about_to_act());
        self.player.set_collision(self.inputs.collision(true, 0));
        let probe_guarded = self.inputs.active() != 0 && (homing.is_some() || self.player.is_probe_guarded());
        let motion = MotionState { moving_or_switching: acting, lit, homing, probe_guarded };
        if let Some(alarm) = self.safety.check(&self.inputs, motion).or(encoder_alarm) {
            self.latch_alarm(alarm);
        }
        let alarm = match self.homing.take() {
            Some(search) => self.run_homing_period(search),
            None => self.player.play_period(self.inputs.active(), &inputs.analog, inputs.failed),
        };
        if let Some(alarm) = alarm {
            self.latch_alarm(alarm);
        }
        // What the axes move by: the path and the layer.
        self.pulses = self.player.status().increments;
        let (axis, increment) = self.player.layer_increment();
        if let Some(pulses) = self.pulses.get_mut(axis) {
            *pulses += increment;
        }
        if homing.is_none()
            && let Some(alarm) = self.safety.check_acknowledged_limits(&self.inputs, &self.pulses)
        {
            self.latch_alarm(alarm);
        }
        if let Some(settings) = &self.settings {
            self.pulses = self.backlash.add_compensation(&self.pulses, settings);
            self.player.set_taking_up_backlash(self.backlash.is_taking_up());
        }
        if let Some(alarm) = self.player.apply_permit(self.permit_denial()) {
            self.latch_alarm(alarm);
        }
        let report = self.player.status_mut();
        (report.inputs, report.analog_inputs, report.wheel) = (self.inputs.active(), inputs.analog, wheel);
        self.player.status()
    }

    /// Returns the edge that the latch of the probe awaits, for hardware that captures it.
    #[must_use]
    pub fn awaited_probe(&self) -> Option<AwaitedProbe> {
        let ProbeArming { input, active, .. } = self.player.awaited_probe()?;
        Some(AwaitedProbe { input, is_high: active != self.inputs.is_active_low(input) })
    }

    /// Returns the reason why no cutting output may be on, independent of the path.
    fn permit_denial(&self) -> Option<CutterOffCause> {
        match self.safety.alarm() {
            Some(Alarm::HostSilent) => Some(CutterOffCause::HostSilent),
            Some(_) => Some(CutterOffCause::Alarm),
            None if !self.is_open || self.epoch_required => Some(CutterOffCause::EpochClosed),
            None if self.inputs.collisions() != 0 => Some(CutterOffCause::Collision),
            None => None,
        }
    }

    /// Returns the pulses to emit for the last period: its increments, those of the layer, and the backlash where an
    /// axis reverses.
    #[must_use]
    pub const fn pulses(&self) -> &[i32; A] {
        &self.pulses
    }

    /// Returns the output for S in the last period; `None` while it is not used.
    #[must_use]
    pub fn spindle_pwm(&self) -> Option<PwmSignal> {
        let settings = self.settings.as_ref()?.settings();
        let (pwm, status) = (settings.spindle_pwm?, self.player.status());
        let beam_power = settings.cutting.beam_power.map(|_| status.beam_power);
        Some(PwmSignal { hz: pwm.hz, duty: duty_of(pwm, self.speed_curve.as_ref(), beam_power, &status.outputs) })
    }

    /// Runs one period of homing.
    fn run_homing_period(&mut self, mut search: HomingSearch) -> Option<Alarm> {
        let (axis, upper) = search.target_switch();
        let closed = self.inputs.active() & self.inputs.home_switch(axis, upper) != 0;
        // The search pauses while backlash is crossed, so that the axis moves with its drive.
        let (increment, ending) = if self.backlash.is_taking_up() { (0, None) } else { search.run_period(closed) };
        let mut increments = [0; A];
        if let Some(axis) = increments.get_mut(usize::from(axis)) {
            *axis = increment;
        }
        self.player.move_off_path(increments, ending.is_none());
        match ending {
            None => self.homing = Some(search),
            Some(HomingEnd::Found(count)) => self.player.set_count(usize::from(axis), count),
            Some(HomingEnd::NotFound) => return Some(Alarm::HomingFailed { axis }),
            Some(HomingEnd::Stopped) => {}
        }
        None
    }

    /// Latches an alarm and stops the machine. A second alarm changes nothing: the machine already stops.
    fn latch_alarm(&mut self, alarm: Alarm) {
        if self.safety.latch(alarm) {
            let safe = self.settings.as_ref().map_or(&[][..], |settings| settings.settings().safe());
            self.player.halt(safe);
            self.player.status_mut().alarm = Some(alarm);
            if let Some(search) = &mut self.homing {
                search.stop();
            }
        }
    }

    fn clear_alarm(&mut self) -> Result<(), CommandRefusal> {
        if self.safety.alarm().is_none() {
            return Ok(());
        }
        if !self.is_at_rest() {
            return Err(CommandRefusal::InMotion);
        }
        if !self.safety.clear(&self.inputs, self.instruction_failed) {
            return Err(CommandRefusal::Alarm);
        }
        self.player.release();
        self.player.status_mut().alarm = None;
        Ok(())
    }

    fn start_homing(&mut self, order: HomingCommand, axes: u8, most: u16) -> Result<(), CommandRefusal> {
        if !self.is_at_rest() || !self.player.is_empty() {
            return Err(CommandRefusal::InMotion);
        }
        let switch = self.inputs.home_switch(order.axis, order.upper);
        if order.axis >= axes || switch == 0 || !self.player.is_layer_zero() {
            return Err(CommandRefusal::Unsupported);
        }
        self.homing = Some(HomingSearch::new(order, most).ok_or(CommandRefusal::Unsupported)?);
        self.player.leave_path();
        self.epoch_required = true;
        Ok(())
    }

    fn is_at_rest(&self) -> bool {
        self.homing.is_none() && self.player.is_at_rest()
    }

    /// Whether the card can control the height as these moves ask.
    fn supports_control(&self, moves: LayerMove) -> bool {
        let LayerMove::Start { control, .. } = moves else { return true };
        control
            .iter()
            .all(|of| of.is_valid([self.identity.inputs, self.identity.analog.inputs(), self.identity.outputs]))
    }

    /// Accepts a command that concerns the path, the motion or an instruction, while an epoch is open and the counts
    /// are on its path.
    fn accept_path_command(&mut self, command: HostCommand<A>) -> Result<(), CommandRefusal> {
        if let HostCommand::Ahead { record, .. } | HostCommand::Behind { record, .. } = &command
            && let Some(Err(against)) = self.settings.as_ref().map(|settings| settings.check_record(record))
        {
            if let Some(alarm) = against {
                self.latch_alarm(alarm);
            }
            return Err(CommandRefusal::Unsupported);
        }
        if let HostCommand::ArmProbe(arming) = &command
            && arming.input >= self.identity.inputs.min(16)
        {
            return Err(CommandRefusal::Unsupported);
        }
        let asks_spindle = matches!(&command, HostCommand::Instruction(of) if of.spindle.is_some());
        if asks_spindle && self.settings.as_ref().is_none_or(|of| of.settings().spindle.is_none()) {
            return Err(CommandRefusal::Unsupported);
        }
        let until = match &command {
            HostCommand::Instruction(instruction) => instruction.until,
            HostCommand::Repeat(repeated) => repeated.until,
            _ => None,
        };
        if until.is_some_and(|until| until.input >= self.identity.inputs.min(16)) {
            return Err(CommandRefusal::Unsupported);
        }
        let moves = match &command {
            HostCommand::Instruction(instruction) => instruction.layer,
            HostCommand::Repeat(repeated) => repeated.layer,
            _ => None,
        };
        let has_layer = self.settings.as_ref().is_some_and(|settings| settings.settings().layer.is_some());
        if moves.is_some_and(|moves| !has_layer || !moves.is_valid() || !self.supports_control(moves)) {
            return Err(CommandRefusal::Unsupported);
        }
        if let HostCommand::Repeat(RepeatedInstruction { is_pulse: true, periods, .. }) = &command {
            let period_us = self.settings.as_ref().map_or(0, |settings| settings.settings().period_us);
            if u64::from(*periods) * u64::from(period_us) > MAX_PULSE_US || until.is_some() || moves.is_some() {
                return Err(CommandRefusal::Unsupported);
            }
        }
        self.player.accept(command)
    }
}

impl<const A: usize, const W: usize, const M: usize, S: RecordStorage<A>> CardCore<A> for Card<A, W, M, S> {
    fn identity(&self) -> &CardIdentity {
        &self.identity
    }

    /// Opens an epoch. A latched alarm remains. A pending instruction is cancelled, even while it is being executed.
    /// The numbers of instructions continue from the start.
    fn open(&mut self, settings: &CardSettings<A>) -> Result<(), CommandRefusal> {
        let checked = CheckedSettings::validate(settings, &self.identity)?;
        self.player.reopen(settings, checked.max_increment())?;
        self.is_open = true;
        self.inputs.configure(&settings.inputs, self.identity.inputs, settings.period_us);
        self.safety.start_watchdog(settings.watchdog_periods);
        if self.safety.alarm().is_some() {
            self.player.lock_outputs(settings.safe());
        }
        self.speed_curve = settings.speed_curve.filter(SpeedCurve::is_valid).or(self.speed_curve);
        self.settings = Some(checked);
        self.epoch_required = false;
        Ok(())
    }

    fn close(&mut self) -> Result<(), CommandRefusal> {
        if !self.is_at_rest() {
            return Err(CommandRefusal::InMotion);
        }
        // no motion is requested any more, whatever completes later
        let _ = self.player.accept(HostCommand::rate(Rate::ZERO));
        self.safety.start_watchdog(0);
        self.is_open = false;
        self.player.switch_cutters_off(CutterOffCause::EpochClosed);
        Ok(())
    }

    fn record_host_frame(&mut self) {
        self.safety.record_host_frame();
    }

    fn accept(&mut self, command: HostCommand<A>) -> Result<(), CommandRefusal> {
        if let HostCommand::Rate(RateTarget::ZERO) = command {
            if let Some(search) = &mut self.homing {
                search.stop();
            }
            return self.player.accept(command);
        }
        let Some(settings) = &self.settings else { return Err(CommandRefusal::Unsupported) };
        let (axes, most) = (settings.settings().axes, settings.max_increment());
        let latched = self.safety.alarm().is_some();
        match command {
            HostCommand::ClearAlarm => self.clear_alarm(),
            HostCommand::Home(_)
            | HostCommand::Rate(_)
            | HostCommand::Instruction(_)
            | HostCommand::Repeat(_)
            | HostCommand::ArmProbe(_)
            | HostCommand::FollowSpindle { on: true }
            | HostCommand::FreeTool
            | HostCommand::ArmStretch(_)
                if latched =>
            {
                Err(CommandRefusal::Alarm)
            }
            HostCommand::Home(order) => self.start_homing(order, axes, most),
            HostCommand::ManualOutput(change) if !self.player.may_switch(change, self.permit_denial()) => {
                Err(CommandRefusal::Unsupported)
            }
            HostCommand::SpeedCurve(curve) if curve.is_valid() && self.identity.has_spindle_pwm => {
                self.speed_curve = Some(curve);
                Ok(())
            }
            HostCommand::ManualOutput(_) | HostCommand::Replay { .. } => self.player.accept(command),
            _ if self.epoch_required => Err(CommandRefusal::Unsupported),
            _ => self.accept_path_command(command),
        }
    }

    fn status(&self) -> &CardStatus<A> {
        self.player.status()
    }
}
