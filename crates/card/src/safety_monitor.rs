//! The guard: watches the inputs and the host, and latches what stops the machine.
//!
//! Invariant: the first cause is kept until it is cleared, and it is not cleared while a cause is there.

use retrace_link::{Alarm, InputUse};

use crate::Inputs;

/// What is going on while the guard looks.
#[derive(Clone, Copy, Debug, Default)]
pub struct MotionState {
    /// Does the machine move, or is it about to, or is an instruction being executed?
    pub acting: bool,
    /// The axis and the end that homing seeks.
    pub homing: Option<(u8, bool)>,
}

/// The latched alarm, and what it is watched for.
#[derive(Clone, Debug, Default)]
pub struct SafetyMonitor {
    alarm: Option<Alarm>,
    /// Periods without a whole frame of the host.
    periods_without_host: u32,
    /// So many of them are too many; 0: nobody is expected yet.
    watchdog: u16,
    /// Limit switches whose alarm was cleared while they were tripped, until they open, one bit each.
    acknowledged_limits: u16,
}

impl SafetyMonitor {
    /// Nothing latched, and nobody expected.
    #[must_use]
    pub const fn new() -> Self {
        Self { alarm: None, periods_without_host: 0, watchdog: 0, acknowledged_limits: 0 }
    }

    /// What is latched.
    #[must_use]
    pub const fn alarm(&self) -> Option<Alarm> {
        self.alarm
    }

    /// An epoch begins, with this watchdog, in periods.
    pub const fn expect_host(&mut self, watchdog: u16) {
        (self.watchdog, self.periods_without_host) = (watchdog, 0);
    }

    /// The host was heard.
    pub const fn host_is_alive(&mut self) {
        self.periods_without_host = 0;
    }

    /// Latches an alarm; false where one was latched already, which stays.
    pub const fn latch(&mut self, alarm: Alarm) -> bool {
        let first = self.alarm.is_none();
        if first {
            self.alarm = Some(alarm);
        }
        first
    }

    /// A period begins with these inputs: what stops the machine, if anything does, the gravest first.
    pub fn check(&mut self, panel: &Inputs, sight: MotionState) -> Option<Alarm> {
        self.acknowledged_limits &= panel.active();
        if self.watchdog != 0 {
            self.periods_without_host = self.periods_without_host.saturating_add(1);
        }
        if panel.active() == 0 {
            // as nearly always
            return self.is_silent().then_some(Alarm::HostSilent);
        }
        if panel.is_active(InputUse::EmergencyStop) {
            return Some(Alarm::EmergencyStop);
        }
        let mut limits = panel.tripped().filter(|&(bit, axis, upper)| {
            // The switch that homing runs onto does not stop it.
            self.acknowledged_limits & bit == 0 && sight.homing != Some((axis, upper))
        });
        if let Some((_, axis, upper)) = limits.next() {
            return Some(Alarm::LimitSwitch { axis, upper });
        }
        if sight.acting && panel.is_active(InputUse::Door) {
            return Some(Alarm::DoorOpen);
        }
        self.is_silent().then_some(Alarm::HostSilent)
    }

    /// A forgiven limit switch is left, not run further into: does one of these increments go the wrong way?
    #[must_use]
    pub fn runs_into(&self, panel: &Inputs, increments: &[i32]) -> Option<Alarm> {
        if self.acknowledged_limits == 0 {
            return None;
        }
        let mut limits = panel.tripped().filter(|&(bit, axis, upper)| {
            let increment = increments.get(usize::from(axis)).copied().unwrap_or(0);
            self.acknowledged_limits & bit != 0 && (if upper { increment > 0 } else { increment < 0 })
        });
        limits.next().map(|(_, axis, upper)| Alarm::LimitSwitch { axis, upper })
    }

    /// Clears what is latched; false, and nothing changed, where a cause is there. `failed`: the machine still says that the instruction has
    /// failed.
    ///
    /// A tripped limit switch is not a cause, since only motion can open it: it is forgiven until it opens, and the axis may leave it. The
    /// door is one only where it was the cause.
    pub fn clear(&mut self, panel: &Inputs, failed: bool) -> bool {
        let Some(alarm) = self.alarm else { return true };
        let door = alarm == Alarm::DoorOpen && panel.is_active(InputUse::Door);
        let failed = failed && matches!(alarm, Alarm::Failed { .. });
        if door || failed || self.is_silent() || panel.is_active(InputUse::EmergencyStop) {
            return false;
        }
        self.acknowledged_limits = panel.tripped().fold(0, |bits, (bit, ..)| bits | bit);
        self.alarm = None;
        true
    }

    fn is_silent(&self) -> bool {
        self.watchdog != 0 && self.periods_without_host >= u32::from(self.watchdog)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::InputLevels;
    use retrace_link::{InputSetting, MAX_INPUTS};

    const LIMIT: u16 = 1;
    const DOOR: u16 = 2;
    const STOP: u16 = 4;

    fn panel(levels: u16) -> Inputs {
        let uses = [InputUse::Limit { axis: 0, upper: true }, InputUse::Door, InputUse::EmergencyStop];
        let mut settings = [InputSetting::default(); MAX_INPUTS];
        for (setting, used_for) in settings.iter_mut().zip(uses) {
            setting.used_for = used_for;
        }
        let mut panel = Inputs::default();
        panel.describe(&settings, 3);
        panel.read(&InputLevels { levels, ..InputLevels::default() });
        panel
    }

    const STANDING: MotionState = MotionState { acting: false, homing: None };
    const ACTING: MotionState = MotionState { acting: true, homing: None };

    #[test]
    fn the_gravest_cause_comes_first_and_the_first_alarm_stays() {
        let mut guard = SafetyMonitor::default();
        let limit = Alarm::LimitSwitch { axis: 0, upper: true };
        assert_eq!(guard.check(&panel(LIMIT | DOOR | STOP), ACTING), Some(Alarm::EmergencyStop));
        assert_eq!(guard.check(&panel(LIMIT | DOOR), ACTING), Some(limit));
        assert_eq!(guard.check(&panel(DOOR), ACTING), Some(Alarm::DoorOpen));
        assert_eq!(guard.check(&panel(DOOR), STANDING), None);
        assert_eq!(guard.check(&panel(LIMIT), MotionState { acting: true, homing: Some((0, true)) }), None);
        assert_eq!(guard.check(&panel(LIMIT), MotionState { acting: true, homing: Some((0, false)) }), Some(limit));
        assert!(guard.latch(limit) && !guard.latch(Alarm::EmergencyStop));
        assert_eq!(guard.alarm(), Some(limit));
    }

    #[test]
    fn nothing_is_cleared_while_its_cause_is_there() {
        let mut guard = SafetyMonitor::default();
        guard.latch(Alarm::DoorOpen);
        assert!(!guard.clear(&panel(DOOR), false) && !guard.clear(&panel(STOP), false));
        assert!(guard.clear(&panel(0), false));
        assert_eq!(guard.alarm(), None);
        guard.latch(Alarm::Failed { instruction: 3 });
        assert!(!guard.clear(&panel(0), true) && guard.clear(&panel(DOOR), false));
    }

    #[test]
    fn a_limit_switch_that_was_cleared_may_only_be_left() {
        let mut guard = SafetyMonitor::default();
        let limit = Some(Alarm::LimitSwitch { axis: 0, upper: true });
        assert!(guard.latch(Alarm::HostSilent) && guard.clear(&panel(LIMIT), false));
        assert_eq!(guard.check(&panel(LIMIT), ACTING), None);
        assert_eq!(guard.runs_into(&panel(LIMIT), &[-1]), None);
        assert_eq!(guard.runs_into(&panel(LIMIT), &[1]), limit);
        assert_eq!(guard.check(&panel(0), ACTING), None);
        assert_eq!(guard.check(&panel(LIMIT), ACTING), limit);
    }

    #[test]
    fn the_watchdog_counts_from_the_last_frame_and_not_before_an_epoch() {
        let mut guard = SafetyMonitor::default();
        let quiet = panel(0);
        assert!((0..1000).all(|_| guard.check(&quiet, STANDING).is_none()));
        guard.expect_host(20);
        assert!((0..19).all(|_| guard.check(&quiet, STANDING).is_none()));
        guard.host_is_alive();
        assert!((0..19).all(|_| guard.check(&quiet, STANDING).is_none()));
        assert_eq!(guard.check(&quiet, STANDING), Some(Alarm::HostSilent));
        guard.latch(Alarm::HostSilent);
        assert!(!guard.clear(&quiet, false));
        guard.host_is_alive();
        assert!(guard.clear(&quiet, false));
    }
}
