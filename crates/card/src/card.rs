//! A whole card without its line: the player, and around it the guard, the inputs, homing and the card's identity.
//!
//! Invariant: while an alarm is latched the motion brakes on the path and then stands, and the outputs that the settings call safe are
//! safe. After it was cleared nothing moves before a new word says so.

use retrace_core::{RateTarget, Record};
use retrace_link::{
    Alarm, CardCore, CardIdentity, CardSettings, CardStatus, CommandRefusal, CutterOffCause, HomingCommand,
    HostCommand, Outputs, PROTOCOL,
};

use crate::homing::{HomingEnd, HomingSearch};
use crate::safety_monitor::MotionState;
use crate::window::RecordStorage;
use crate::{BacklashCompensation, CheckedSettings, InputLevels, Inputs, Player, SafetyMonitor, backlash};

/// A card for `A` axes, a window of `W` records and averages of the rate law up to `M` periods.
///
/// To be called once a control period with the inputs as they are; in between it takes words. What it then says in [`Card::pulses`] is what
/// the step and direction outputs are to emit in the next period.
#[derive(Clone, Debug)]
pub struct Card<const A: usize, const W: usize, const M: usize, S = [Record<A>; W]> {
    identity: CardIdentity,
    /// The epoch's; `None` before the first.
    terms: Option<CheckedSettings<A>>,
    player: Player<A, W, M, S>,
    panel: Inputs,
    guard: SafetyMonitor,
    search: Option<HomingSearch>,
    backlash: BacklashCompensation<A>,
    /// What is to come out of the pins in the period, play among it.
    pulses: [i32; A],
    /// The counts have been moved off the path by homing: an epoch has to begin before anything is played.
    off_the_path: bool,
    is_open: bool,
    failed: bool,
}

impl<const A: usize, const W: usize, const M: usize> Card<A, W, M> {
    /// A card that nobody has opened yet, at rest, all counts and outputs zero. What the type says of it (protocol, axes, window,
    /// memory) is filled in, where the axes may be fewer. `None` where `M` is zero.
    #[must_use]
    pub const fn new(identity: CardIdentity) -> Option<Self> {
        // no `?` in a constant
        let Some(player) = Player::idle(0, identity.outputs) else { return None };
        Some(Self::with_player(identity, player))
    }
}

impl<const A: usize, const W: usize, const M: usize> Card<A, W, M, &'static mut [Record<A>]> {
    /// As [`Card::new`], with a window whose records [`Card::lend`] brings.
    #[must_use]
    pub const fn without_records(identity: CardIdentity) -> Option<Self> {
        let Some(player) = Player::idle_without_records(identity.outputs) else { return None };
        Some(Self::with_player(identity, player))
    }

    /// Where the window's records are to stand, `W` of them. To be called before anybody is listening.
    pub fn lend(&mut self, records: &'static mut [Record<A>; W]) {
        self.player.lend(records);
    }
}

impl<const A: usize, const W: usize, const M: usize, S> Card<A, W, M, S> {
    const fn with_player(identity: CardIdentity, player: Player<A, W, M, S>) -> Self {
        // no `min` and `try_into` in a constant
        let axes = if (identity.axes as usize) < A { identity.axes } else { A as u8 };
        let memory = if M < u16::MAX as usize { M as u16 } else { u16::MAX };
        let identity = CardIdentity { protocol: PROTOCOL, axes, window: W as u32, memory, ..identity };
        Self {
            identity,
            terms: None,
            player,
            panel: Inputs::new(),
            guard: SafetyMonitor::new(),
            search: None,
            backlash: BacklashCompensation::new(),
            pulses: [0; A],
            off_the_path: false,
            is_open: false,
            failed: false,
        }
    }

    /// Which of the cards of its kind it is, and the number of this start: what is only known once it runs. To be called before anybody is
    /// listening.
    pub const fn name(&mut self, serial: u32, boot: u32) {
        (self.identity.serial, self.identity.boot) = (serial, boot);
    }
}

impl<const A: usize, const W: usize, const M: usize, S: RecordStorage<A>> Card<A, W, M, S> {
    /// The axes stand at these counts and the outputs have these values: a card that kept both over its start. To be called before
    /// anything has moved.
    pub fn stand_at(&mut self, counts: [i64; A], outputs: &Outputs) {
        self.player.stand_at(counts, outputs);
    }

    /// What the epoch goes by; `None` before the first.
    #[must_use]
    pub const fn terms(&self) -> Option<&CheckedSettings<A>> {
        self.terms.as_ref()
    }

    /// A whole frame of the open epoch has come: the host is there. To be called before the frame's words are taken.
    pub const fn heard(&mut self) {
        self.guard.host_is_alive();
    }

    /// Lets one control period pass.
    pub fn period(&mut self, inputs: InputLevels) -> &CardStatus<A> {
        let wheel = self.panel.read(&inputs);
        self.failed = inputs.failed;
        let homing = self.search.as_ref().map(HomingSearch::seeks);
        // Only an open door asks for it.
        let acting =
            self.panel.active() != 0 && (homing.is_some() || self.player.is_lit() || self.player.is_about_to_act());
        if let Some(alarm) = self.guard.check(&self.panel, MotionState { acting, homing }) {
            self.latch(alarm);
        }
        let alarm = match self.search.take() {
            Some(search) => self.search_on(search),
            None => self.player.play(self.panel.active(), inputs.failed),
        };
        if let Some(alarm) = alarm {
            self.latch(alarm);
        }
        if homing.is_none()
            && let Some(alarm) = self.guard.runs_into(&self.panel, &self.player.status().increments)
        {
            self.latch(alarm);
        }
        if backlash::IS_COMPENSATED
            && let Some(terms) = &self.terms
        {
            self.pulses = self.backlash.period(&self.player.status().increments, terms);
            self.player.take_up_backlash(self.backlash.is_taking_up());
        }
        self.player.apply_permit(self.denied());
        let report = self.player.report();
        (report.inputs, report.wheel) = (self.panel.active(), wheel);
        self.player.status()
    }

    /// Why no cutting output may be on, whatever the path does.
    fn denied(&self) -> Option<CutterOffCause> {
        match self.guard.alarm() {
            Some(Alarm::HostSilent) => Some(CutterOffCause::HostSilent),
            Some(_) => Some(CutterOffCause::Alarm),
            None if !self.is_open || self.off_the_path => Some(CutterOffCause::EpochClosed),
            None => None,
        }
    }

    /// The pulses that are to come out of the pins in the last period: its increments, and what takes up play where an axis turns.
    #[must_use]
    pub const fn pulses(&self) -> &[i32; A] {
        if backlash::IS_COMPENSATED { &self.pulses } else { &self.player.status().increments }
    }

    /// One period of homing.
    fn search_on(&mut self, mut search: HomingSearch) -> Option<Alarm> {
        let (axis, upper) = search.seeks();
        let closed = self.panel.active() & self.panel.home_switch(axis, upper) != 0;
        // A switch is sought by an axis that moves with its drive.
        let (increment, ending) = if self.backlash.is_taking_up() { (0, None) } else { search.period(closed) };
        let mut increments = [0; A];
        if let Some(axis) = increments.get_mut(usize::from(axis)) {
            *axis = increment;
        }
        self.player.move_off_path(increments, ending.is_none());
        match ending {
            None => self.search = Some(search),
            Some(HomingEnd::Found(count)) => self.player.set_count(usize::from(axis), count),
            Some(HomingEnd::NotFound) => return Some(Alarm::HomingFailed { axis }),
            Some(HomingEnd::Stopped) => {}
        }
        None
    }

    /// Latches an alarm and stops what is going on. A second one changes nothing: the machine stops already.
    fn latch(&mut self, alarm: Alarm) {
        if self.guard.latch(alarm) {
            let safe = self.terms.as_ref().map_or(&[][..], |terms| terms.settings().safe());
            self.player.halt(safe);
            self.player.report().alarm = Some(alarm);
            if let Some(search) = &mut self.search {
                search.stop();
            }
        }
    }

    fn clear(&mut self) -> Result<(), CommandRefusal> {
        if self.guard.alarm().is_none() {
            return Ok(());
        }
        if !self.stands() {
            return Err(CommandRefusal::InMotion);
        }
        if !self.guard.clear(&self.panel, self.failed) {
            return Err(CommandRefusal::Alarm);
        }
        self.player.release();
        self.player.report().alarm = None;
        Ok(())
    }

    fn home(&mut self, order: HomingCommand, axes: u8, most: u16) -> Result<(), CommandRefusal> {
        if !self.stands() || !self.player.is_empty() {
            return Err(CommandRefusal::InMotion);
        }
        let switch = self.panel.home_switch(order.axis, order.upper);
        if order.axis >= axes || switch == 0 {
            return Err(CommandRefusal::Unfit);
        }
        self.search = Some(HomingSearch::new(order, most).ok_or(CommandRefusal::Unfit)?);
        self.player.leave_path();
        self.off_the_path = true;
        Ok(())
    }

    fn stands(&self) -> bool {
        self.search.is_none() && self.player.is_at_rest()
    }

    /// A word that moves the path, the motion or an instruction, while an epoch is open and the counts are on its path.
    fn take_on_the_path(&mut self, word: HostCommand<A>) -> Result<(), CommandRefusal> {
        if let HostCommand::Ahead { record, .. } | HostCommand::Behind { record, .. } = &word
            && let Some(Err(against)) = self.terms.as_ref().map(|terms| terms.check(record))
        {
            if let Some(alarm) = against {
                self.latch(alarm);
            }
            return Err(CommandRefusal::Unfit);
        }
        let until = match &word {
            HostCommand::Instruction(instruction) => instruction.until,
            HostCommand::Repeat(repeated) => repeated.until,
            _ => None,
        };
        if until.is_some_and(|until| until.input >= self.identity.inputs.min(16)) {
            return Err(CommandRefusal::Unfit);
        }
        self.player.accept(word)
    }
}

impl<const A: usize, const W: usize, const M: usize, S: RecordStorage<A>> CardCore<A> for Card<A, W, M, S> {
    fn identity(&self) -> &CardIdentity {
        &self.identity
    }

    /// An alarm stays latched over it. An instruction in hand is given up, also while it is being executed. The numbers of instructions go on where the start says.
    fn open(&mut self, settings: &CardSettings<A>) -> Result<(), CommandRefusal> {
        let terms = CheckedSettings::validate(settings, &self.identity)?;
        self.player.reopen(settings.start, settings.limits, &settings.cutting)?;
        self.is_open = true;
        self.panel.describe(&settings.inputs, self.identity.inputs);
        self.guard.expect_host(settings.watchdog_periods);
        if self.guard.alarm().is_some() {
            self.player.halt(settings.safe());
        }
        self.terms = Some(terms);
        self.off_the_path = false;
        Ok(())
    }

    fn close(&mut self) -> Result<(), CommandRefusal> {
        if !self.stands() {
            return Err(CommandRefusal::InMotion);
        }
        // nobody asks for motion any more, whatever completes later
        let _ = self.player.accept(HostCommand::rate(0));
        self.guard.expect_host(0);
        self.is_open = false;
        self.player.put_out(CutterOffCause::EpochClosed);
        Ok(())
    }

    fn host_is_alive(&mut self) {
        self.guard.host_is_alive();
    }

    fn accept(&mut self, word: HostCommand<A>) -> Result<(), CommandRefusal> {
        if let HostCommand::Rate(RateTarget::ZERO) = word {
            if let Some(search) = &mut self.search {
                search.stop();
            }
            return self.player.accept(word);
        }
        let Some(terms) = &self.terms else { return Err(CommandRefusal::Unfit) };
        let (axes, most) = (terms.settings().axes, terms.max_increment());
        let latched = self.guard.alarm().is_some();
        match word {
            HostCommand::ClearAlarm => self.clear(),
            HostCommand::Home(_) | HostCommand::Rate(_) | HostCommand::Instruction(_) | HostCommand::Repeat(_)
                if latched =>
            {
                Err(CommandRefusal::Alarm)
            }
            HostCommand::Home(order) => self.home(order, axes, most),
            HostCommand::ManualOutput(change) if !self.player.may_switch(change, self.denied()) => {
                Err(CommandRefusal::Unfit)
            }
            HostCommand::ManualOutput(_) | HostCommand::Replay { .. } => self.player.accept(word),
            _ if self.off_the_path => Err(CommandRefusal::Unfit),
            _ => self.take_on_the_path(word),
        }
    }

    fn status(&self) -> &CardStatus<A> {
        self.player.status()
    }
}
