//! The safety monitor: checks the inputs and the host, and latches the cause that stops the machine.
//!
//! Invariant: the first cause is retained until it is cleared, and it cannot be cleared while a cause is present.

use retrace_link::{Alarm, InputUse};

use crate::Inputs;

/// State of motion that the safety monitor needs.
#[derive(Clone, Copy, Debug, Default)]
pub struct MotionState {
    /// Whether the machine moves or is about to, or an instruction is being executed.
    pub moving_or_switching: bool,
    /// Whether a cutting output is on.
    pub lit: bool,
    /// Axis and end that homing is searching.
    pub homing: Option<(u8, bool)>,
    /// Whether a probe that trips is a collision: motion that is no probing move (PRB-10).
    pub probe_guarded: bool,
}

/// Latched alarm and the state it is derived from.
#[derive(Clone, Debug, Default)]
pub struct SafetyMonitor {
    alarm: Option<Alarm>,
    /// Periods without a complete frame from the host.
    periods_without_host: u32,
    /// Maximum of these periods; 0: no host is expected yet.
    watchdog: u16,
    /// Limit switches and collision inputs that were active when an alarm was cleared, until they open, one bit each.
    acknowledged: u16,
}

impl SafetyMonitor {
    /// Creates a monitor without an alarm and without a watchdog.
    #[must_use]
    pub const fn new() -> Self {
        Self { alarm: None, periods_without_host: 0, watchdog: 0, acknowledged: 0 }
    }

    /// Returns the latched alarm.
    #[must_use]
    pub const fn alarm(&self) -> Option<Alarm> {
        self.alarm
    }

    /// Starts the watchdog with this limit in periods; 0 switches it off.
    pub const fn start_watchdog(&mut self, watchdog: u16) {
        (self.watchdog, self.periods_without_host) = (watchdog, 0);
    }

    /// Records that a complete frame from the host has arrived.
    pub const fn record_host_frame(&mut self) {
        self.periods_without_host = 0;
    }

    /// Latches an alarm. Returns false if one was already latched, which remains.
    pub const fn latch(&mut self, alarm: Alarm) -> bool {
        let first = self.alarm.is_none();
        if first {
            self.alarm = Some(alarm);
        }
        first
    }

    /// Checks the inputs at the beginning of a period and returns the cause that stops the machine, if any, the most
    /// serious first.
    pub fn check(&mut self, inputs: &Inputs, motion: MotionState) -> Option<Alarm> {
        self.acknowledged &= inputs.active();
        if self.watchdog != 0 {
            self.periods_without_host = self.periods_without_host.saturating_add(1);
        }
        if inputs.active() == 0 {
            // the usual case
            return self.host_timed_out().then_some(Alarm::HostSilent);
        }
        if inputs.is_active(InputUse::EmergencyStop) {
            return Some(Alarm::EmergencyStop);
        }
        let mut limits = inputs.tripped().filter(|&(bit, axis, upper)| {
            // The switch that homing moves onto does not stop it.
            self.acknowledged & bit == 0 && motion.homing != Some((axis, upper))
        });
        if let Some((_, axis, upper)) = limits.next() {
            return Some(Alarm::LimitSwitch { axis, upper });
        }
        if motion.moving_or_switching {
            if let Some(input) = inputs.collision(motion.lit, self.acknowledged) {
                return Some(Alarm::Collision { input });
            }
            if inputs.is_active(InputUse::Door) {
                return Some(Alarm::DoorOpen);
            }
        }
        if motion.probe_guarded
            && let Some(input) = inputs.tripped_probe()
        {
            return Some(Alarm::ProbeTripped { input });
        }
        self.host_timed_out().then_some(Alarm::HostSilent)
    }

    /// Checks that an axis on an acknowledged limit switch moves away from it, and not further into it, with these
    /// increments.
    #[must_use]
    pub fn check_acknowledged_limits(&self, inputs: &Inputs, increments: &[i32]) -> Option<Alarm> {
        if self.acknowledged == 0 {
            return None;
        }
        let mut limits = inputs.tripped().filter(|&(bit, axis, upper)| {
            let increment = increments.get(usize::from(axis)).copied().unwrap_or(0);
            self.acknowledged & bit != 0 && (if upper { increment > 0 } else { increment < 0 })
        });
        limits.next().map(|(_, axis, upper)| Alarm::LimitSwitch { axis, upper })
    }

    /// Clears the alarm. Returns false and changes nothing if a cause is present. `failed` means that the machine still
    /// reports the instruction as failed.
    ///
    /// A tripped limit switch or collision input is not such a cause, since only motion can open it: it is acknowledged
    /// until it opens, and the axis may move off it. An open door is one only if it was the cause of the alarm.
    pub fn clear(&mut self, inputs: &Inputs, failed: bool) -> bool {
        let Some(alarm) = self.alarm else { return true };
        let door = alarm == Alarm::DoorOpen && inputs.is_active(InputUse::Door);
        let failed = failed && matches!(alarm, Alarm::Failed { .. });
        if door || failed || self.host_timed_out() || inputs.is_active(InputUse::EmergencyStop) {
            return false;
        }
        self.acknowledged = inputs.tripped().fold(inputs.collisions(), |bits, (bit, ..)| bits | bit);
        self.alarm = None;
        true
    }

    fn host_timed_out(&self) -> bool {
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
    const BREAKAWAY: u16 = 8;
    const FLOAT: u16 = 16;

    fn inputs(levels: u16) -> Inputs {
        let [breakaway, float] = [false, true].map(|only_lit| InputUse::Collision { only_lit });
        let uses =
            [InputUse::Limit { axis: 0, upper: true }, InputUse::Door, InputUse::EmergencyStop, breakaway, float];
        let mut settings = [InputSetting::default(); MAX_INPUTS];
        for (setting, used_for) in settings.iter_mut().zip(uses) {
            setting.used_for = used_for;
        }
        let mut inputs = Inputs::default();
        inputs.configure(&settings, 5, 1000);
        inputs.read(&InputLevels { levels, ..InputLevels::default() });
        inputs
    }

    const STANDING: MotionState =
        MotionState { moving_or_switching: false, lit: false, homing: None, probe_guarded: false };
    const ACTING: MotionState =
        MotionState { moving_or_switching: true, lit: false, homing: None, probe_guarded: false };

    #[test]
    fn the_gravest_cause_comes_first_and_the_first_alarm_stays() {
        let mut guard = SafetyMonitor::default();
        let limit = Alarm::LimitSwitch { axis: 0, upper: true };
        assert_eq!(guard.check(&inputs(LIMIT | DOOR | STOP), ACTING), Some(Alarm::EmergencyStop));
        assert_eq!(guard.check(&inputs(LIMIT | DOOR), ACTING), Some(limit));
        assert_eq!(guard.check(&inputs(DOOR), ACTING), Some(Alarm::DoorOpen));
        assert_eq!(guard.check(&inputs(DOOR), STANDING), None);
        assert_eq!(guard.check(&inputs(LIMIT), MotionState { homing: Some((0, true)), ..ACTING }), None);
        assert_eq!(guard.check(&inputs(LIMIT), MotionState { homing: Some((0, false)), ..ACTING }), Some(limit));
        assert!(guard.latch(limit) && !guard.latch(Alarm::EmergencyStop));
        assert_eq!(guard.alarm(), Some(limit));
    }

    #[test]
    fn nothing_is_cleared_while_its_cause_is_there() {
        let mut guard = SafetyMonitor::default();
        guard.latch(Alarm::DoorOpen);
        assert!(!guard.clear(&inputs(DOOR), false) && !guard.clear(&inputs(STOP), false));
        assert!(guard.clear(&inputs(0), false));
        assert_eq!(guard.alarm(), None);
        guard.latch(Alarm::Failed { instruction: 3 });
        assert!(!guard.clear(&inputs(0), true) && guard.clear(&inputs(DOOR), false));
    }

    #[test]
    fn a_limit_switch_that_was_cleared_may_only_be_left() {
        let mut guard = SafetyMonitor::default();
        let limit = Some(Alarm::LimitSwitch { axis: 0, upper: true });
        assert!(guard.latch(Alarm::HostSilent) && guard.clear(&inputs(LIMIT), false));
        assert_eq!(guard.check(&inputs(LIMIT), ACTING), None);
        assert_eq!(guard.check_acknowledged_limits(&inputs(LIMIT), &[-1]), None);
        assert_eq!(guard.check_acknowledged_limits(&inputs(LIMIT), &[1]), limit);
        assert_eq!(guard.check(&inputs(0), ACTING), None);
        assert_eq!(guard.check(&inputs(LIMIT), ACTING), limit);
    }

    #[test]
    fn a_collision_input_stops_motion_and_may_be_left_after_its_alarm_was_cleared() {
        let mut guard = SafetyMonitor::default();
        let lit = MotionState { lit: true, ..ACTING };
        let [breakaway, float] = [3, 4].map(|input| Some(Alarm::Collision { input }));
        assert_eq!(guard.check(&inputs(BREAKAWAY | FLOAT), STANDING), None, "a torch is being changed");
        assert_eq!(guard.check(&inputs(BREAKAWAY | DOOR), ACTING), breakaway);
        assert_eq!(guard.check(&inputs(FLOAT), ACTING), None, "the sheet is being sensed");
        assert_eq!(guard.check(&inputs(FLOAT), lit), float);
        assert!(guard.latch(Alarm::Collision { input: 3 }) && guard.clear(&inputs(BREAKAWAY), false));
        assert_eq!(guard.check(&inputs(BREAKAWAY), ACTING), None, "it is lifted off");
        assert_eq!(guard.check(&inputs(BREAKAWAY | FLOAT), lit), float, "another one");
        assert_eq!((guard.check(&inputs(0), ACTING), guard.check(&inputs(BREAKAWAY), ACTING)), (None, breakaway));
    }

    #[test]
    fn the_watchdog_counts_from_the_last_frame_and_not_before_an_epoch() {
        let mut guard = SafetyMonitor::default();
        let quiet = inputs(0);
        assert!((0..1000).all(|_| guard.check(&quiet, STANDING).is_none()));
        guard.start_watchdog(20);
        assert!((0..19).all(|_| guard.check(&quiet, STANDING).is_none()));
        guard.record_host_frame();
        assert!((0..19).all(|_| guard.check(&quiet, STANDING).is_none()));
        assert_eq!(guard.check(&quiet, STANDING), Some(Alarm::HostSilent));
        guard.latch(Alarm::HostSilent);
        assert!(!guard.clear(&quiet, false));
        guard.record_host_frame();
        assert!(guard.clear(&quiet, false));
    }
}
