//! Geared stretches of the card: the wait for the angle, and the motion that follows it (SPN-14 … SPN-16).
//!
//! Invariant: a stretch is entered at rest, on its first place and at its angle, or not at all; while it is engaged no
//! requested rate moves the cursor.

use retrace_core::gear::{Gear, GearRatio};
use retrace_core::{Distance, Place, Rate, RecordIndex};
use retrace_link::{Alarm, GearStart, GearState};

use crate::spindle_monitor::SpindleMonitor;

/// A geared stretch.
#[derive(Clone, Copy, Debug)]
struct GearedStretch {
    first: RecordIndex,
    start: GearStart,
    ratio: GearRatio,
    /// Direction of the spindle in which it is passed forward: 1 or −1.
    direction: i64,
}

/// State of the gear of a card.
#[derive(Clone, Debug, Default)]
pub struct GearDrive {
    stretch: Option<GearedStretch>,
    engaged: Option<Gear>,
    /// End of the stretch that was passed last.
    passed: Option<RecordIndex>,
    /// Angle at the end of the last period, as it was foreseen.
    foreseen: Option<i64>,
    /// Control periods for which the angle was awaited.
    waited: u32,
    /// Whether the angle is worthless: the cursor brakes on the path.
    brakes: bool,
    /// Whether the spindle was switched off and rests: turned by hand it moves no axis.
    is_suspended: bool,
    /// Whether an alarm has ended the stretch: once at rest, the cursor stays where it is.
    is_halted: bool,
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
}

impl GearDrive {
    /// Creates a drive without a stretch.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            stretch: None,
            engaged: None,
            passed: None,
            foreseen: None,
            waited: 0,
            brakes: false,
            is_suspended: false,
            is_halted: false,
            moved: Distance::ZERO,
            largest_lag: Distance::ZERO,
        }
    }

    /// Prepares the stretch that begins with this record. Returns false if it does not fit the spindle.
    pub fn arm(&mut self, first: RecordIndex, start: GearStart, spindle: &SpindleMonitor) -> bool {
        let Some(ratio) = spindle.settings().and_then(|settings| start.ratio(settings)) else { return false };
        let direction = spindle.direction();
        let passed = self.passed;
        *self = Self { stretch: Some(GearedStretch { first, start, ratio, direction }), passed, ..Self::new() };
        direction != 0
    }

    /// State for reports.
    #[must_use]
    pub const fn state(&self) -> GearState {
        match (&self.stretch, &self.engaged) {
            (_, Some(_)) => GearState::Engaged,
            (Some(_), None) => GearState::Waiting,
            (None, None) => GearState::Off,
        }
    }

    /// Largest lag of the stretch, in units of 2⁻¹⁶ records.
    #[must_use]
    pub fn largest_lag(&self) -> u32 {
        u32::try_from(self.largest_lag.units() >> 16).unwrap_or(u32::MAX)
    }

    /// The end of the stretch while it is engaged: the cursor may pass all of its records.
    #[must_use]
    pub fn reach(&self) -> Option<RecordIndex> {
        self.engaged.as_ref()?;
        self.stretch.map(|of| of.first + of.start.length)
    }

    /// Whether the cursor does not move, and the spindle does not turn it.
    #[must_use]
    pub fn at_rest(&self, spindle: &SpindleMonitor) -> bool {
        self.engaged.is_none()
            || self.moved == Distance::ZERO && (self.brakes || self.is_suspended || spindle.is_at_rest())
    }

    /// The end of the stretch that was passed last, before which nothing is passed backward, and the beginning of the
    /// one that is awaited.
    #[must_use]
    pub fn barriers(&self) -> [Option<RecordIndex>; 2] {
        [self.passed, self.stretch.filter(|_| self.engaged.is_none()).map(|of| of.first)]
    }

    /// Whether the record is one of the stretch.
    #[must_use]
    pub fn has_record(&self, place: RecordIndex) -> bool {
        self.stretch.is_some_and(|of| !place.is_before(of.first) && place.is_before(of.first + of.start.length))
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

    /// Ends the stretch by an alarm: the cursor follows the spindle until both rest, and moves no more.
    pub const fn halt(&mut self) {
        self.is_halted = true;
    }

    /// Runs one control period with the cursor at `from`. `may_start`: motion forward is requested and nothing else
    /// holds it. `[low, high]`: the records that are held. `change`: maximum change of the rate where the records use
    /// this share of the axes' acceleration, in units of 2⁻¹⁶. Returns `None` where no stretch has the cursor.
    pub fn run_period(
        &mut self,
        from: Place,
        may_start: bool,
        [low, high]: [RecordIndex; 2],
        change: impl Fn(u16) -> Rate,
        spindle: &SpindleMonitor,
    ) -> Option<GearedPeriod> {
        let stretch = self.stretch?;
        if self.engaged.is_none() && (from != Place::start_of(stretch.first) || !may_start) {
            (self.foreseen, self.waited) = (None, 0);
            return None;
        }
        let angle = spindle.angle_ahead().unwrap_or(0) * stretch.direction;
        let before = self.foreseen.replace(angle).unwrap_or(angle);
        let held = [low, high].map(|place| stretch.first.records_to(place).max(0) as u32);
        if self.engaged.is_none() {
            let alarm = self.wait(&stretch, held[1], [before, angle], spindle);
            if self.engaged.is_none() {
                self.moved = Distance::ZERO;
                return Some(GearedPeriod { moved: Distance::ZERO, alarm });
            }
        }
        let is_on = spindle.direction() != 0;
        let gear = self.engaged.as_mut()?;
        // A spindle that was turned by hand does not take the cursor along when it is switched on again.
        let lag = stretch.ratio.distance(angle.saturating_sub(gear.anchor())) - gear.at();
        let is_away = lag.abs() > stretch.start.limits.tolerance;
        let rests = !is_on && self.moved == Distance::ZERO && spindle.is_at_rest();
        self.is_suspended = rests || self.is_suspended && (!is_on || is_away || self.is_halted);
        if self.is_suspended && !self.brakes {
            self.moved = Distance::ZERO;
            let is_lost = is_on && is_away && !self.is_halted;
            return Some(GearedPeriod { moved: Distance::ZERO, alarm: is_lost.then_some(Alarm::ThreadLost) });
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
            _ => None,
        };
        self.brakes |= alarm == Some(Alarm::EncoderFailed);
        if gear.has_passed_end() {
            (self.engaged, self.stretch) = (None, None);
            self.passed = Some(stretch.first + stretch.start.length);
        } else if gear.has_passed_beginning() {
            self.engaged = None;
        }
        Some(GearedPeriod { moved: step.moved, alarm })
    }

    /// Waits for the angle at which the stretch begins, and engages it there.
    fn wait(
        &mut self,
        stretch: &GearedStretch,
        held: u32,
        angles: [i64; 2],
        spindle: &SpindleMonitor,
    ) -> Option<Alarm> {
        let GearStart { length, ahead, limits, start_angle, .. } = stretch.start;
        self.waited = self.waited.saturating_add(1);
        let is_ready = held >= ahead.min(length) && spindle.is_at_speed() && spindle.direction() == stretch.direction;
        if let Some(zero) = spindle.zero_angle().filter(|_| is_ready) {
            let turn = stretch.ratio.turn();
            let start = zero * stretch.direction + ((i64::from(start_angle) * turn) >> 32);
            self.engaged = Gear::engage(stretch.ratio, (length, false), limits, start, angles);
        }
        let timeout = spindle.settings().map_or(0, |of| of.timeout_periods);
        (self.engaged.is_none() && self.waited > timeout).then_some(Alarm::NotAtSpeed)
    }
}
