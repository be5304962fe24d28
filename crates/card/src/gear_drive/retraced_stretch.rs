//! A stretch that is retraced: backward from its end with the spindle turning the other way, and by rate where the
//! operator says that the tool is free (SPN-22).
//!
//! Invariant: a stretch is entered at its end only at its angle, and passed by rate only with the spindle switched off;
//! what was not cut yet is not passed forward by rate.

use retrace_core::gear::Gear;
use retrace_core::{Distance, Place, RecordIndex};
use retrace_link::{Alarm, ArmedStretch, CommandRefusal, GearStart, SpindleControl};

use super::{BehindStretch, GearDrive, GearedPeriod, GearedStretch, SpindleCourse};
use crate::spindle_monitor::SpindleMonitor;

impl GearDrive {
    /// Arms a stretch again that the path comes back to, in place of the one that is armed: the cursor is in front of
    /// it, or at rest at its end. `stop`: the furthest place that the cursor cannot avoid reaching. `high`: end of the
    /// records that are held, before which the stretch ahead and the one that is replaced have to begin.
    ///
    /// # Errors
    /// [`CommandRefusal::Unsupported`] if it does not fit the spindle, or an alarm has ended a stretch;
    /// [`CommandRefusal::InMotion`] if the cursor is elsewhere, or another stretch has it;
    /// [`CommandRefusal::OutOfOrder`] if records of a stretch are held that would be armed no more.
    pub fn arm_again(
        &mut self,
        armed: &ArmedStretch,
        ([at, stop], high): ([Place; 2], RecordIndex),
        spindle: &SpindleMonitor,
    ) -> Result<(), CommandRefusal> {
        let ArmedStretch { first, start, speed, is_passed, barrier } = *armed;
        let settings = spindle.settings().filter(|settings| speed.unsigned_abs() <= settings.highest_speed);
        let ratio = settings.and_then(|settings| start.ratio(settings));
        let is_held = matches!(start.control, SpindleControl::Held | SpindleControl::None);
        let Some(ratio) = ratio.filter(|_| is_held && speed != 0 && !self.is_halted && !self.brakes) else {
            return Err(CommandRefusal::Unsupported);
        };
        let place = Place::start_of(if is_passed { first + start.length } else { first });
        let is_there = if is_passed { at == place } else { stop.distance_to(place) >= Distance::ZERO };
        let is_free = self.engaged.is_none() && self.freed.is_none() && self.behind == BehindStretch::Free;
        if !(is_there && is_free && self.course == SpindleCourse::Forward) {
            return Err(CommandRefusal::InMotion);
        }
        let replaced = self.stretch.filter(|of| !self.is_passed(of)).map(|of| of.first);
        let begins = [replaced, Some(first).filter(|_| !is_passed)];
        if begins.into_iter().flatten().any(|begin| begin.is_before(high)) {
            return Err(CommandRefusal::OutOfOrder);
        }
        let before = if is_passed { barrier } else { barrier.or(self.passed) };
        let stretch =
            GearedStretch { first, start, ratio, direction: i64::from(speed.signum()), speed: speed.abs(), before };
        let is_turning = spindle.direction() == i64::from(speed.signum());
        *self = Self {
            stretch: Some(stretch),
            passed: if is_passed { Some(stretch.end()) } else { before },
            armed_again: self.armed_again.wrapping_add(1),
            starts_spindle: !is_passed && !is_turning,
            ..Self::new()
        };
        Ok(())
    }

    /// Switches a spindle off that was to pass the stretch backward, where that is not requested any more. It turns
    /// again once motion is requested, if it turned there before.
    pub(super) fn give_spindle_back(&mut self, stretch: &GearedStretch) -> Option<GearedPeriod> {
        if core::mem::take(&mut self.course) == SpindleCourse::Forward {
            return None;
        }
        if self.turned_at_end {
            self.behind = BehindStretch::Stopped;
        }
        let spindle = Some(stretch.spindle_values(SpindleCourse::Stopped));
        Some(GearedPeriod { moved: Distance::ZERO, alarm: None, spindle })
    }

    /// Brings the spindle to rest where the stretch ends, turns it the other way, and engages it there at its angle.
    /// Returns new values of the spindle, too.
    pub(super) fn wait_at_end(
        &mut self,
        stretch: &GearedStretch,
        angles: [i64; 2],
        spindle: &SpindleMonitor,
    ) -> (Option<Alarm>, Option<[i32; 2]>) {
        self.waited = self.waited.saturating_add(1);
        let next = match self.course {
            SpindleCourse::Forward | SpindleCourse::Return => {
                self.turned_at_end = spindle.direction() != 0;
                SpindleCourse::Stopped
            }
            SpindleCourse::Stopped if spindle.direction() == 0 && spindle.is_at_rest() => SpindleCourse::Backward,
            course => course,
        };
        let changed = (next != self.course).then(|| stretch.spindle_values(next));
        self.course = next;
        let is_ready = spindle.is_at_speed() && spindle.direction() == -stretch.direction;
        if let Some(start) = self.start_angle(stretch, spindle).filter(|_| is_ready) {
            let GearStart { length, limits, .. } = stretch.start;
            self.engaged = Gear::engage(stretch.ratio, (length, true), limits, start, angles);
        }
        if self.engaged.is_some() {
            self.passed = stretch.before;
        }
        let timeout = spindle.settings().map_or(0, |of| of.timeout_periods);
        ((self.engaged.is_none() && self.waited > timeout).then_some(Alarm::NotAtSpeed), changed)
    }

    /// Takes the gear off a stretch in which the cursor rests, or at whose end: the tool is free, and the stretch is
    /// passed by rate like any path until it is left. One that was not passed to its end is not passed forward.
    ///
    /// # Errors
    /// [`CommandRefusal::Unsupported`] if the cursor is elsewhere, or the spindle is switched on;
    /// [`CommandRefusal::InMotion`] if the spindle turns.
    pub fn free_tool(&mut self, at: Place, spindle: &SpindleMonitor) -> Result<(), CommandRefusal> {
        let is_held = |of: &GearedStretch| of.start.control == SpindleControl::Held;
        let Some(stretch) = self.stretch.filter(is_held) else { return Err(CommandRefusal::Unsupported) };
        let is_passed = self.is_passed(&stretch);
        let is_there = if is_passed { at == Place::start_of(stretch.end()) } else { self.engaged.is_some() };
        if !is_there || self.is_halted || self.brakes || spindle.direction() != 0 {
            return Err(CommandRefusal::Unsupported);
        }
        if !(self.at_rest(spindle) && spindle.is_at_rest()) {
            return Err(CommandRefusal::InMotion);
        }
        self.freed = Some(if is_passed { None } else { Some(at.boundary_ahead()) });
        (self.engaged, self.passed, self.behind) = (None, stretch.before, BehindStretch::Free);
        (self.foreseen, self.waited, self.moved) = (None, 0, Distance::ZERO);
        (self.follows_by_hand, self.is_suspended, self.course) = (false, false, SpindleCourse::Forward);
        Ok(())
    }

    /// The alarm of a stretch that is passed by rate: its spindle is switched on.
    #[must_use]
    pub fn alarm_of_freed(&self, spindle: &SpindleMonitor) -> Option<Alarm> {
        (self.freed.is_some() && spindle.direction() != 0).then_some(Alarm::ThreadLost)
    }

    /// Ends passing a stretch by rate where the cursor has left it. Returns whether it goes on.
    pub(super) fn is_passed_by_rate(&mut self, from: Place, request: i64) -> bool {
        let (Some(until), Some(stretch)) = (self.freed, self.stretch) else { return false };
        let (beginning, end) = (Place::start_of(stretch.first), Place::start_of(stretch.end()));
        let is_behind = from.record == stretch.end() && from != end || stretch.end().is_before(from.record);
        if from == beginning || from.record.is_before(stretch.first) {
            (self.freed, self.starts_spindle) = (None, true);
        } else if is_behind || until.is_none() && from == end && request > 0 {
            (self.freed, self.passed) = (None, Some(stretch.end()));
        }
        self.freed.is_some()
    }

    /// Switches the spindle on again that was off while the stretch was passed by rate, where it is awaited.
    pub(super) fn start_freed_spindle(
        &mut self,
        stretch: &GearedStretch,
        spindle: &SpindleMonitor,
    ) -> Option<[i32; 2]> {
        let is_other = spindle.direction() != stretch.direction;
        let starts = core::mem::take(&mut self.starts_spindle) && is_other && !self.is_halted;
        starts.then(|| stretch.spindle_values(SpindleCourse::Forward))
    }
}
