//! Motion that follows the spindle: geared stretches, and the feed per turn (SPN-8, SPN-14 … SPN-16).
//!
//! Invariant: a record of a geared stretch is never passed at a requested rate, and an alarm switches off the spindle
//! that an engaged stretch follows: the axes follow it until it rests.

use retrace_core::drive::{CursorStep, RecordWindow};
use retrace_core::limits::PulseLimits;
use retrace_core::{Flags, Place, Rate, RateTarget, Record, RecordIndex};
use retrace_link::{Alarm, ArmedStretch, CardSettings, CommandRefusal, OutputChange, SpindleStatus, channel};

use super::Player;
use crate::played_window::PlayedWindow;
use crate::window::RecordStorage;
use crate::{CardWindow, EncoderReading, SpindleFollower};

impl<const A: usize, const W: usize, const M: usize, S: RecordStorage<A>> Player<A, W, M, S> {
    /// Reads the spindle's encoder in a control period.
    pub(crate) fn read_spindle(&mut self, reading: &EncoderReading) -> Option<Alarm> {
        let followed = self.followed.first_mut()?;
        let alarm = followed.monitor.read(reading, self.outputs.values());
        let alarm = alarm.or(followed.gear.alarm_of_freed(&followed.monitor));
        if alarm.is_some() {
            followed.gear.lose_angle();
        }
        alarm
    }

    /// Whether the cursor is at rest on the path.
    pub(super) fn path_is_at_rest(&self) -> bool {
        self.drive.at_rest() && self.followed.iter().all(|followed| followed.gear.at_rest(&followed.monitor))
    }

    pub(super) fn spindle_status(&self) -> SpindleStatus {
        self.followed.first().map_or(SpindleStatus::default(), |SpindleFollower { monitor, gear }| SpindleStatus {
            speed: monitor.speed(),
            gear: gear.state(),
            largest_lag: gear.largest_lag(),
            armed_again: gear.armed_again(),
        })
    }

    /// Begins an epoch for the gear: a stretch is kept where the path begins at the place of the cursor.
    pub(super) fn open_gear(&mut self, settings: &CardSettings<A>) {
        let keeps = settings.start.keeps_state && settings.start.place == self.status.place;
        for SpindleFollower { monitor, gear } in &mut self.followed {
            let is_same_spindle = monitor.configure(settings.spindle, settings.period_us);
            gear.open(keeps && is_same_spindle);
        }
    }

    /// Handles an alarm: switches the spindle off that the motion follows.
    pub(super) fn halt_gear(&mut self) {
        let Some(followed) = self.followed.first_mut() else { return };
        if followed.gear.halt() {
            self.outputs.set(OutputChange { channel: channel::SPINDLE, value: 0 });
        }
    }

    /// Sets whether motion follows the spindle that is turned by hand.
    pub(super) fn follow_by_hand(&mut self, on: bool) -> Result<(), CommandRefusal> {
        let Some(SpindleFollower { monitor, gear }) = self.followed.first_mut() else {
            return Err(CommandRefusal::Unsupported);
        };
        gear.follow_by_hand(on, monitor)
    }

    /// Takes the gear off the stretch whose tool is free.
    pub(super) fn free_tool(&mut self) -> Result<(), CommandRefusal> {
        let at = self.status.place;
        match self.followed.first_mut() {
            Some(SpindleFollower { monitor, gear }) if self.drive.at_rest() => gear.free_tool(at, monitor),
            Some(_) => Err(CommandRefusal::InMotion),
            None => Err(CommandRefusal::Unsupported),
        }
    }

    /// Arms a stretch again that the path comes back to.
    pub(super) fn arm_stretch(&mut self, armed: &ArmedStretch) -> Result<(), CommandRefusal> {
        if self.switching.is_busy() || armed.is_passed && !self.drive.at_rest() {
            return Err(CommandRefusal::InMotion);
        }
        let places = ([self.status.place, self.stopping_place()], self.window.high());
        let followed = self.followed.first_mut().ok_or(CommandRefusal::Unsupported)?;
        followed.gear.arm_again(armed, places, &followed.monitor)
    }

    /// Runs a control period of the gear, if a stretch has the cursor. `request`: sign of the requested rate.
    pub(super) fn run_gear(&mut self, from: Place, request: i64) -> Option<(CursorStep, Option<Alarm>)> {
        let SpindleFollower { monitor, gear } = self.followed.first_mut()?;
        let held = [self.window.low(), self.window.high()];
        let (window, axes) = (&self.window, self.drive.limits().axes());
        let change = |share: u16| max_change(axes, window.record(from.record), share);
        let period = gear.run_period(from, request, held, change, monitor)?;
        for (channel, value) in [channel::SPINDLE, channel::SPEED].into_iter().zip(period.spindle.into_iter().flatten())
        {
            self.outputs.set(OutputChange { channel, value });
        }
        let step = CursorStep { to: from.moved(period.moved), starved: false };
        Some((step, period.alarm))
    }

    /// The target rates: limited while the probe is armed, and in proportion to the measured speed of the spindle where
    /// the feed is per turn.
    pub(super) fn requested_target(&self, from: Place) -> RateTarget {
        let target = self.probing_target(self.target);
        let is_per_turn = || self.window.record(from.record).is_some_and(|of| of.flags.contains(Flags::PER_TURN));
        match self.followed.first() {
            Some(followed) if target.feed.signum() > 0 && is_per_turn() => {
                RateTarget { feed: followed.monitor.per_turn_rate(target.feed), ..target }
            }
            _ => target,
        }
    }

    /// The places between which the drive may move the cursor: not back into a geared stretch that was passed, and not
    /// past an instruction that is not executed, or into a stretch.
    pub(super) fn barriers(&self) -> [Option<RecordIndex>; 2] {
        let [passed, ahead] = self.followed.first().map_or([None; 2], |followed| followed.gear.barriers());
        let end = match (self.switching.barrier(), ahead) {
            (Some(place), Some(ahead)) => Some(if ahead.is_before(place) { ahead } else { place }),
            (place, ahead) => place.or(ahead),
        };
        [passed, end]
    }

    /// Advances the cursor by the drive. `None`: it comes to rest.
    pub(super) fn step_drive(&mut self, from: Place, target: Option<RateTarget>) -> CursorStep {
        let [begin, end] = self.barriers();
        let window = PlayedWindow::new(&self.window, begin, end);
        let target = target.map_or(Rate::ZERO, |target| self.drive.within_overrides(from, target, &window));
        self.drive.step(from, target, &window)
    }

    /// The window in which the drive may move the cursor.
    pub(super) fn record_window(&self) -> PlayedWindow<'_, CardWindow<A, W, S>> {
        let [begin, end] = self.barriers();
        PlayedWindow::new(&self.window, begin, end)
    }

    /// Whether a record may be held: one of a geared stretch only while that has the cursor, or waits for it.
    pub(super) fn may_hold(&self, place: RecordIndex, record: &Record<A>) -> bool {
        !record.flags.contains(Flags::GEARED) || self.followed.iter().any(|followed| followed.gear.has_record(place))
    }
}

/// Returns the maximum change of the rate per period on this record, whose axes use `share` of their acceleration for
/// the path, in units of 2⁻¹⁶.
fn max_change<const A: usize>(axes: &[PulseLimits; A], record: Option<&Record<A>>, share: u16) -> Rate {
    let Some(record) = record else { return Rate::MAX };
    let changes = axes.iter().zip(&record.increments).map(|(axis, increment)| {
        let spare = axis.acceleration - (axis.acceleration >> 16) * u64::from(share);
        // at most 2⁴⁸; a pulse more for the rounding of the record
        spare / (u64::from(increment.unsigned_abs()) + 1)
    });
    Rate::from_units(changes.min().unwrap_or(0).clamp(1, Rate::MAX.units() as u64) as i64)
}
