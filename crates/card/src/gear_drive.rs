//! Geared stretches of the card: the wait for the angle, and the motion that follows it (SPN-14 … SPN-16, SPN-19,
//! SPN-21 … SPN-23).
//!
//! Invariant: a stretch is entered at rest, on its first place and at its angle, or not at all; while it is engaged no
//! requested rate moves the cursor: it acts on the spindle, or not at all.

use retrace_core::gear::{Gear, GearRatio};
use retrace_core::{Distance, Place, Rate, RecordIndex};
use retrace_link::{Alarm, CommandRefusal, GearStart, GearState, SpindleControl};

use crate::spindle_monitor::SpindleMonitor;

mod retraced_stretch;

/// A geared stretch.
#[derive(Clone, Copy, Debug)]
struct GearedStretch {
    first: RecordIndex,
    start: GearStart,
    ratio: GearRatio,
    /// Direction of the spindle in which it is passed forward: 1 or −1.
    direction: i64,
    /// Speed of the spindle in thousandths of a revolution per minute, as commanded where the stretch begins.
    speed: i32,
    /// End of the stretch that was passed before, which is not passed backward.
    before: Option<RecordIndex>,
}

/// What the spindle does in a stretch in which a rate acts on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum SpindleCourse {
    /// It turns as where the stretch begins.
    #[default]
    Forward,
    /// It is switched off.
    Stopped,
    /// It turns the other way: back to the beginning.
    Backward,
    /// It turns the other way behind the turn of a tap.
    Return,
}

/// What a stretch that was left leaves to be done before anything moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum BehindStretch {
    /// Nothing.
    #[default]
    Free,
    /// It was left while the spindle was stopped: it turns again once motion is requested.
    Stopped,
    /// The spindle turns again, and its speed is awaited.
    Turning,
}

/// Share of a turn by which the spindle may be off where motion begins to follow it by hand (SPN-23): 5°.
const FOLLOW_SHARE: i64 = 72;

/// State of the gear of a card.
#[derive(Clone, Debug, Default)]
pub struct GearDrive {
    stretch: Option<GearedStretch>,
    engaged: Option<Gear>,
    /// End of the stretch that was passed last.
    passed: Option<RecordIndex>,
    /// Whether the stretch is a tap that is complete: its records are passed no more.
    is_complete: bool,
    /// Angle at the end of the last period, as it was foreseen.
    foreseen: Option<i64>,
    /// Control periods for which the angle was awaited; while engaged, for which a spindle that is switched on has been
    /// at rest.
    waited: u32,
    /// Whether the angle is worthless: the cursor brakes on the path.
    brakes: bool,
    /// Whether the spindle was switched off and rests: turned by hand it moves no axis.
    is_suspended: bool,
    /// Whether an alarm has ended the stretch: once at rest, the cursor stays where it is.
    is_halted: bool,
    /// Whether motion follows a spindle that is switched off and turned by hand.
    follows_by_hand: bool,
    course: SpindleCourse,
    /// Whether a tap has turned.
    has_turned: bool,
    behind: BehindStretch,
    /// Whether the spindle turned where it was switched off to pass the stretch backward from its end.
    turned_at_end: bool,
    /// Where the stretch is passed by rate, since its tool is free: the place that is not passed forward, if any.
    freed: Option<Option<RecordIndex>>,
    /// Whether the spindle is to be switched on where the stretch is awaited again.
    starts_spindle: bool,
    /// Stretches that were armed again in this epoch, modulo 256.
    armed_again: u8,
    /// Distance moved in the last period.
    moved: Distance,
    largest_lag: Distance,
}

/// What a geared period does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GearedPeriod {
    /// Distance that the cursor moves.
    pub moved: Distance,
    /// Alarm of the gear.
    pub alarm: Option<Alarm>,
    /// New values of the spindle's direction and speed.
    pub spindle: Option<[i32; 2]>,
}

impl GearedStretch {
    /// Values of the spindle's direction and speed.
    fn spindle_values(&self, course: SpindleCourse) -> [i32; 2] {
        let direction = self.direction as i32;
        let reverse = (i64::from(self.speed) * i64::from(self.start.reverse_share)) >> 8;
        match course {
            SpindleCourse::Forward => [direction, self.speed],
            SpindleCourse::Stopped => [0, self.speed],
            SpindleCourse::Backward | SpindleCourse::Return => [-direction, i32::try_from(reverse).unwrap_or(i32::MAX)],
        }
    }

    /// Records behind which a tap is reversed.
    const fn turn(&self) -> Option<u32> {
        match self.start.control {
            SpindleControl::Tap(turn) => Some(turn),
            SpindleControl::None | SpindleControl::Held => None,
        }
    }

    /// Whether it is passed backward from its end, with the spindle turning the other way.
    fn is_reversible(&self) -> bool {
        self.start.control == SpindleControl::Held && self.start.reverse_share > 0
    }

    fn end(&self) -> RecordIndex {
        self.first + self.start.length
    }
}

impl GearDrive {
    /// Creates a drive without a stretch.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            stretch: None,
            engaged: None,
            passed: None,
            is_complete: false,
            foreseen: None,
            waited: 0,
            brakes: false,
            is_suspended: false,
            is_halted: false,
            follows_by_hand: false,
            course: SpindleCourse::Forward,
            has_turned: false,
            behind: BehindStretch::Free,
            turned_at_end: false,
            freed: None,
            starts_spindle: false,
            armed_again: 0,
            moved: Distance::ZERO,
            largest_lag: Distance::ZERO,
        }
    }

    /// Prepares the stretch that begins with this record. Returns false if it does not fit the spindle.
    pub fn arm(&mut self, first: RecordIndex, start: GearStart, spindle: &SpindleMonitor) -> bool {
        let Some(ratio) = spindle.settings().and_then(|settings| start.ratio(settings)) else { return false };
        let (direction, speed) = (spindle.direction(), spindle.commanded().saturating_abs());
        let passed = self.passed;
        let stretch = GearedStretch { first, start, ratio, direction, speed, before: passed };
        *self = Self { stretch: Some(stretch), passed, armed_again: self.armed_again, ..Self::new() };
        direction != 0
    }

    /// State for reports.
    #[must_use]
    pub fn state(&self) -> GearState {
        match (&self.stretch, &self.engaged) {
            (_, Some(_)) => GearState::Engaged,
            _ if self.freed.is_some() => GearState::Freed,
            (Some(of), None) if !self.is_complete && !self.is_passed(of) => GearState::Waiting,
            (_, None) => GearState::Off,
        }
    }

    /// Largest lag of the stretch, in units of 2⁻¹⁶ records.
    #[must_use]
    pub fn largest_lag(&self) -> u32 {
        u32::try_from(self.largest_lag.units() >> 16).unwrap_or(u32::MAX)
    }

    /// Stretches that were armed again in this epoch, modulo 256.
    #[must_use]
    pub const fn armed_again(&self) -> u8 {
        self.armed_again
    }

    /// The end of the stretch while it is engaged and passed forward: the cursor may pass all of its records.
    #[must_use]
    pub fn reach(&self) -> Option<RecordIndex> {
        self.engaged.as_ref().filter(|_| !self.goes_back())?;
        self.stretch.map(|of| of.end())
    }

    /// The beginning of the stretch while it is engaged and passed backward.
    #[must_use]
    pub fn reach_behind(&self) -> Option<RecordIndex> {
        self.engaged.as_ref().filter(|_| self.goes_back())?;
        self.stretch.map(|of| of.first)
    }

    /// Whether the cursor moves backward, or will.
    fn goes_back(&self) -> bool {
        self.moved < Distance::ZERO || matches!(self.course, SpindleCourse::Backward | SpindleCourse::Return)
    }

    /// Sets whether motion follows a spindle that is switched off and turned by hand: the angle is where the axes
    /// stopped, within 5°.
    ///
    /// # Errors
    /// [`CommandRefusal::Unsupported`] if no stretch is engaged, the spindle is switched on or its angle is worthless;
    /// [`CommandRefusal::InMotion`] if it turns, or was turned further than that.
    pub fn follow_by_hand(&mut self, on: bool, spindle: &SpindleMonitor) -> Result<(), CommandRefusal> {
        let (Some(stretch), Some(gear)) = (&self.stretch, &self.engaged) else {
            return Err(CommandRefusal::Unsupported);
        };
        if on {
            if self.brakes || spindle.direction() != 0 {
                return Err(CommandRefusal::Unsupported);
            }
            let angle = spindle.angle_ahead().unwrap_or(0) * stretch.direction;
            let is_near = gear.lag_at(angle).abs() <= stretch.ratio.distance(stretch.ratio.turn() / FOLLOW_SHARE);
            if !(is_near && spindle.is_at_rest()) {
                return Err(CommandRefusal::InMotion);
            }
        }
        self.follows_by_hand = on;
        Ok(())
    }

    /// Whether the cursor does not move, and the spindle does not turn it.
    #[must_use]
    pub fn at_rest(&self, spindle: &SpindleMonitor) -> bool {
        self.engaged.is_none()
            || self.moved == Distance::ZERO && (self.brakes || self.is_suspended || spindle.is_at_rest())
    }

    /// The end of the stretch that was passed last, before which nothing is passed backward, and the beginning of the
    /// one that is awaited, or of the tap that is complete.
    #[must_use]
    pub fn barriers(&self) -> [Option<RecordIndex>; 2] {
        if let Some(until) = self.freed {
            return [self.passed, until];
        }
        let ahead = self.stretch.filter(|of| self.engaged.is_none() && !self.is_passed(of));
        [self.passed, ahead.map(|of| of.first)]
    }

    /// Whether the record is one of the stretch.
    #[must_use]
    pub fn has_record(&self, place: RecordIndex) -> bool {
        self.stretch.is_some_and(|of| !place.is_before(of.first) && place.is_before(of.end()))
    }

    /// Whether a stretch is engaged.
    #[must_use]
    pub const fn is_engaged(&self) -> bool {
        self.engaged.is_some()
    }

    /// The angle cannot be trusted any more.
    pub const fn lose_angle(&mut self) {
        self.brakes = true;
    }

    /// Begins an epoch at rest. A stretch that is engaged, or awaited, is kept if `keeps`, as long as its angle can be
    /// trusted: the spindle is off, and turns again once motion is requested and the records are held.
    pub fn open(&mut self, keeps: bool) {
        if !keeps || self.brakes || !matches!(self.state(), GearState::Engaged | GearState::Waiting) {
            *self = Self::new();
            return;
        }
        self.armed_again = 0;
        (self.is_halted, self.follows_by_hand, self.waited) = (false, false, 0);
        if self.engaged.is_some() {
            (self.course, self.is_suspended) = (SpindleCourse::Stopped, true);
        }
    }

    /// Ends the stretch by an alarm: the cursor follows the spindle until both rest, and moves no more. Returns whether
    /// the spindle is to be switched off.
    pub fn halt(&mut self) -> bool {
        let has_spindle = self.is_engaged() || self.course != SpindleCourse::Forward;
        (self.is_halted, self.follows_by_hand, self.behind) = (true, false, BehindStretch::Free);
        if self.engaged.is_none() {
            self.course = SpindleCourse::Forward;
        }
        self.stretch = self.stretch.filter(|of| !self.is_passed(of));
        has_spindle
    }

    /// Runs one control period with the cursor at `from`. `request`: sign of the requested rate; 1 only where nothing
    /// else holds motion forward. `[low, high]`: the records that are held. `change`: maximum change of the rate where
    /// the records use this share of the axes' acceleration, in units of 2⁻¹⁶. Returns `None` where no stretch has the
    /// cursor.
    pub fn run_period(
        &mut self,
        from: Place,
        request: i64,
        [low, high]: [RecordIndex; 2],
        change: impl Fn(u16) -> Rate,
        spindle: &SpindleMonitor,
    ) -> Option<GearedPeriod> {
        if let Some(period) = self.turn_again(request, spindle) {
            return Some(period);
        }
        let stretch = self.stretch.filter(|_| !self.is_complete)?;
        if self.is_passed_by_rate(from, request) {
            return None;
        }
        let is_entered_at_end = self.is_passed(&stretch);
        if self.engaged.is_none() && !self.is_at_entry(&stretch, from, request, low) {
            (self.foreseen, self.waited) = (None, 0);
            return self.give_spindle_back(&stretch);
        }
        let angle = spindle.angle_ahead().unwrap_or(0) * stretch.direction;
        let before = self.foreseen.replace(angle).unwrap_or(angle);
        let held = [low, high].map(|place| stretch.first.records_to(place).max(0) as u32);
        if self.engaged.is_none() {
            let (alarm, spindle) = if is_entered_at_end {
                self.wait_at_end(&stretch, [before, angle], spindle)
            } else {
                let starts = self.start_freed_spindle(&stretch, spindle);
                (self.wait(&stretch, held[1], [before, angle], spindle), starts)
            };
            if self.engaged.is_none() {
                self.moved = Distance::ZERO;
                return Some(GearedPeriod { moved: Distance::ZERO, alarm, spindle });
            }
        }
        // A spindle that was turned by hand does not take the cursor along when it is switched on again.
        let lag = self.engaged.as_ref().map_or(Distance::ZERO, |gear| gear.lag_at(angle));
        let is_away = lag.abs() > stretch.start.limits.tolerance;
        let before = self.course;
        self.course = self.next_course(&stretch, request, held, spindle);
        if is_away && self.is_suspended && before == SpindleCourse::Stopped && self.course != before {
            (self.course, self.moved) = (before, Distance::ZERO);
            return Some(GearedPeriod { moved: Distance::ZERO, alarm: Some(Alarm::ThreadLost), spindle: None });
        }
        let changed = (self.course != before).then(|| stretch.spindle_values(self.course));
        let is_on = spindle.direction() != 0;
        self.follows_by_hand &= !is_on;
        let timeout = spindle.settings().map_or(0, |of| of.timeout_periods);
        let reversal = spindle.reversal_periods();
        let gear = self.engaged.as_mut()?;
        let rests = self.moved == Distance::ZERO && spindle.is_at_rest();
        let stays = self.is_suspended && (!is_on || is_away || self.is_halted);
        self.is_suspended = !self.follows_by_hand && (rests && !is_on || stays);
        self.waited = if is_on && rests { self.waited.saturating_add(1) } else { 0 };
        if self.is_suspended && !self.brakes {
            self.moved = Distance::ZERO;
            let is_lost = is_on && is_away && !self.is_halted;
            let alarm = is_lost.then_some(Alarm::ThreadLost);
            return Some(GearedPeriod { moved: Distance::ZERO, alarm, spindle: changed });
        }
        let was_engaged = !self.brakes;
        let change = change(if gear.is_near_end() { stretch.start.ramp_share } else { 0 });
        let step = if self.brakes { gear.brake(change) } else { gear.run_period(angle, held, change) };
        self.moved = step.moved;
        self.largest_lag = self.largest_lag.max(step.lag.abs());
        let alarm = match spindle.gear_alarm() {
            Some(alarm) if was_engaged => Some(alarm),
            _ if step.is_lost && spindle.seems_dead() => Some(Alarm::EncoderFailed),
            _ if step.is_lost => Some(Alarm::ThreadLost),
            // The records behind the turn of a tap are all that its spindle may need to reverse.
            _ if stretch.turn().is_some() && gear.has_passed_end() => Some(Alarm::ThreadLost),
            // Where a tap reverses its spindle, standstill is short.
            _ if self.course == SpindleCourse::Return && self.waited > reversal => Some(Alarm::EncoderFailed),
            _ if self.waited > timeout => Some(Alarm::NotAtSpeed),
            _ => None,
        };
        self.brakes |= alarm == Some(Alarm::EncoderFailed);
        self.has_turned |= stretch.turn().is_some_and(|turn| gear.at() >= Distance::records(i64::from(turn)));
        let leaves_end = gear.has_passed_end() && stretch.turn().is_none() && self.course != SpindleCourse::Backward;
        let has_passed = (gear.has_passed_beginning(), leaves_end);
        let spindle = self.leave(&stretch, has_passed).or(changed);
        Some(GearedPeriod { moved: step.moved, alarm, spindle })
    }

    /// Leaves the stretch whose beginning or end is passed. Returns values of the spindle, which turns behind it as
    /// before.
    fn leave(&mut self, stretch: &GearedStretch, passed: (bool, bool)) -> Option<[i32; 2]> {
        match passed {
            (false, false) => return None,
            (_, true) => {
                self.engaged = None;
                self.passed = Some(stretch.end());
            }
            // It can be passed again, unless it is a tap that is complete.
            (true, false) => {
                self.engaged = None;
                self.is_complete = self.has_turned;
                self.passed = stretch.before;
            }
        }
        // Whatever the spindle turns until the stretch is awaited again is none of it.
        (self.follows_by_hand, self.foreseen, self.waited) = (false, None, 0);
        let forward = stretch.spindle_values(SpindleCourse::Forward);
        let course = core::mem::take(&mut self.course);
        if course == SpindleCourse::Stopped && !self.is_halted {
            self.behind = BehindStretch::Stopped;
        }
        self.forget_passed();
        let is_reversed = matches!(course, SpindleCourse::Backward | SpindleCourse::Return);
        (is_reversed && !self.is_halted).then_some(forward)
    }

    /// Switches the spindle on again behind a stretch that was left while it was stopped, once motion is requested, and
    /// awaits its speed. `None`: there is nothing to await.
    fn turn_again(&mut self, request: i64, spindle: &SpindleMonitor) -> Option<GearedPeriod> {
        let still = |alarm, spindle| Some(GearedPeriod { moved: Distance::ZERO, alarm, spindle });
        match self.behind {
            BehindStretch::Free => None,
            BehindStretch::Stopped if request == 0 => still(None, None),
            BehindStretch::Stopped => {
                (self.behind, self.waited) = (BehindStretch::Turning, 0);
                still(None, self.stretch.map(|of| of.spindle_values(SpindleCourse::Forward)))
            }
            BehindStretch::Turning if spindle.is_at_speed() => {
                (self.behind, self.waited) = (BehindStretch::Free, 0);
                self.forget_passed();
                None
            }
            BehindStretch::Turning => {
                self.waited = self.waited.saturating_add(1);
                let is_late = self.waited > spindle.settings().map_or(0, |of| of.timeout_periods);
                still(is_late.then_some(Alarm::NotAtSpeed), None)
            }
        }
    }

    /// Whether the stretch was passed to its end.
    fn is_passed(&self, stretch: &GearedStretch) -> bool {
        self.passed == Some(stretch.end())
    }

    /// Forgets a stretch that was passed to its end, unless its spindle is to turn again, or it is passed backward.
    fn forget_passed(&mut self) {
        if self.behind == BehindStretch::Free {
            self.stretch = self.stretch.filter(|of| !self.is_passed(of) || of.is_reversible());
        }
    }

    /// Whether the cursor is where the stretch is entered, motion into it is requested, and the records are held: at
    /// its beginning, or backward at its end once it was passed.
    fn is_at_entry(&self, stretch: &GearedStretch, from: Place, request: i64, low: RecordIndex) -> bool {
        if !self.is_passed(stretch) {
            return from == Place::start_of(stretch.first) && request > 0;
        }
        let GearStart { length, ahead, .. } = stretch.start;
        let wanted = stretch.end() - u32::from(ahead).min(length);
        from == Place::start_of(stretch.end())
            && request < 0
            && stretch.is_reversible()
            && !(self.is_halted || self.brakes || wanted.is_before(low))
    }

    /// Angle at which the stretch begins; `None` before the index was seen.
    fn start_angle(&self, stretch: &GearedStretch, spindle: &SpindleMonitor) -> Option<i64> {
        let share = (i64::from(stretch.start.start_angle) * stretch.ratio.turn()) >> 32;
        spindle.zero_angle().map(|zero| zero * stretch.direction + share)
    }

    /// What the spindle is to do now: it comes to rest between two directions, but for the turn of a tap, and turns
    /// again only where the records are held that follow.
    fn next_course(
        &self,
        stretch: &GearedStretch,
        request: i64,
        held: [u32; 2],
        spindle: &SpindleMonitor,
    ) -> SpindleCourse {
        if self.is_halted {
            return SpindleCourse::Stopped;
        }
        let wanted = match (request, self.has_turned) {
            // finished whatever is requested, but begun again only by a request
            _ if stretch.start.control == SpindleControl::None && self.course == SpindleCourse::Forward => self.course,
            (-1, _) if stretch.start.control == SpindleControl::None => SpindleCourse::Stopped,
            (1, false) => SpindleCourse::Forward,
            (1, true) => SpindleCourse::Return,
            (-1, false) if stretch.start.reverse_share > 0 => SpindleCourse::Backward,
            _ => SpindleCourse::Stopped,
        };
        match self.course {
            course if course == wanted => course,
            SpindleCourse::Forward if wanted == SpindleCourse::Return => wanted,
            SpindleCourse::Stopped
                if self.moved == Distance::ZERO
                    && spindle.is_at_rest()
                    && (wanted != SpindleCourse::Forward || self.is_supplied(stretch, held[1])) =>
            {
                wanted
            }
            _ => SpindleCourse::Stopped,
        }
    }

    /// Whether the records of the stretch are held that have to be where the spindle turns forward, up to `high`.
    fn is_supplied(&self, stretch: &GearedStretch, high: u32) -> bool {
        let GearStart { length, ahead, .. } = stretch.start;
        let at = self.engaged.as_ref().map_or(0, |gear| gear.at().units() >> 32) as u32;
        high >= at.saturating_add(u32::from(ahead)).min(length)
    }

    /// Waits for the angle at which the stretch begins, and engages it there.
    fn wait(
        &mut self,
        stretch: &GearedStretch,
        held: u32,
        angles: [i64; 2],
        spindle: &SpindleMonitor,
    ) -> Option<Alarm> {
        let GearStart { length, ahead, limits, .. } = stretch.start;
        self.waited = self.waited.saturating_add(1);
        let is_ready =
            held >= u32::from(ahead).min(length) && spindle.is_at_speed() && spindle.direction() == stretch.direction;
        if let Some(start) = self.start_angle(stretch, spindle).filter(|_| is_ready) {
            self.engaged = Gear::engage(stretch.ratio, (length, false), limits, start, angles);
        }
        let timeout = spindle.settings().map_or(0, |of| of.timeout_periods);
        (self.engaged.is_none() && self.waited > timeout).then_some(Alarm::NotAtSpeed)
    }
}
