//! The layer: moves of the tool axis that are no records, and the search for the sheet (CUT-13, CUT-15).
//!
//! Speed changes by the same amount per period; its average over [`LayerDrive::average`] periods is what is emitted,
//! which bounds the jerk. Toward a target the speed is the fastest from which the target is still reached: with k
//! periods of braking behind this one, v + (v − a) + … + (v − k a) ≤ r for every k.
//!
//! Invariant: the increments sum to the layer; at rest at a target the layer is the target, to the pulse.

use retrace_core::limits::PulseLimits;
use retrace_link::{HEIGHT_CONTROLS, LayerMove, LayerSettings, OhmicSensing, SheetSource};

/// Maximum length of the average, in periods.
const MAX_AVERAGE: usize = 64;
/// One pulse per period, in the unit of a speed.
const PULSE: i64 = 1 << 32;

const NO_OHMIC: OhmicSensing = OhmicSensing { inputs: 0, tries: 0, drop: 0 };

/// Reason why the sheet was not found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SheetFault {
    /// A contact is closed where the sheet is not, or did not open again.
    Contact,
    /// No contact closed.
    NoSheet,
}

/// Progress of the move that was begun last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayerProgress {
    /// The layer moves.
    Moving,
    /// It is at rest at its target.
    Complete,
    /// The sheet was not found; the layer comes to rest.
    Failed(SheetFault),
}

/// What the layer does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LayerTask {
    /// It comes to rest wherever it is, and stays there.
    Stop,
    /// It goes to a target.
    Move { target: i32 },
    /// It goes to a target over the sheet that an earlier start has found.
    Return { target: i32 },
    /// It goes to where the sheet is sensed from.
    Approach,
    /// It goes toward the sheet.
    Down,
    /// It has touched the sheet, and comes to rest.
    Overrun,
    /// It has found no sheet, and goes back to where it was sensed from.
    Retreat,
    /// It goes off the sheet until the contact opens.
    Up,
    /// No ohmic contact has closed: it goes back, and senses again.
    Again,
    /// The sheet was not found: it comes to rest.
    Failing(SheetFault),
    /// Height control moves it toward an end of its range.
    Steer { end: i32 },
}

/// The search for the sheet that was begun last.
#[derive(Clone, Copy, Debug, Default)]
struct SheetSearch {
    /// Layers between which the sheet is sensed.
    start: i32,
    lowest: i32,
    /// Height over the sheet to go to.
    height: i32,
    /// Attempts in which no ohmic contact has closed.
    failed: u8,
    /// Whether an ohmic contact has found the sheet.
    is_ohmic: bool,
    /// Whether the sheet that it finds counts for later starts.
    is_kept: bool,
    ohmic: OhmicSensing,
}

/// Drive of the layer.
#[derive(Clone, Debug)]
pub struct LayerDrive {
    settings: Option<LayerSettings>,
    /// Maximum speed, and its change per period.
    limits: [i64; 2],
    average: u8,
    task: LayerTask,
    search: SheetSearch,
    /// Target of the ramp in units of 2⁻³² pulses, and the speed before the average.
    position: i64,
    speed: i64,
    /// The last speeds, in a ring, their sum, and the next to be replaced.
    speeds: [i64; MAX_AVERAGE],
    sum: i64,
    next: u8,
    /// Periods for which the speed has been 0, at most `average`.
    resting: u8,
    /// What is not emitted yet, in units of 2⁻³² pulses times `average`.
    fraction: i64,
    layer: i32,
    increment: i32,
    sheet: Option<i32>,
    /// Whether the sheet counts for later starts: nothing has happened since it was found.
    is_sheet_kept: bool,
    is_held: bool,
    /// Whether it moves beside the path, and not in an instruction.
    is_beside: bool,
    /// Whether height control has moved it last: the sheet is where the tool follows it then.
    is_steered: bool,
    /// Maximum speed at which height control moves it.
    steering: [i64; HEIGHT_CONTROLS],
}

impl LayerDrive {
    /// Creates a drive without settings, with the layer 0.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            settings: None,
            limits: [0; 2],
            average: 1,
            task: LayerTask::Stop,
            search: SheetSearch {
                start: 0,
                lowest: 0,
                height: 0,
                failed: 0,
                is_ohmic: false,
                is_kept: false,
                ohmic: NO_OHMIC,
            },
            position: 0,
            speed: 0,
            speeds: [0; MAX_AVERAGE],
            sum: 0,
            next: 0,
            resting: 1,
            fraction: 0,
            layer: 0,
            increment: 0,
            sheet: None,
            is_sheet_kept: false,
            is_held: false,
            is_beside: false,
            is_steered: false,
            steering: [0; HEIGHT_CONTROLS],
        }
    }

    /// Begins an epoch, at rest, with these limits of the axis, and at most `most` pulses per period. Returns what was
    /// the layer, if it is not kept: it becomes part of the counts of the axis of the settings before.
    pub fn configure(
        &mut self,
        settings: Option<LayerSettings>,
        limits: &PulseLimits,
        most: u16,
        keeps_layer: bool,
    ) -> Option<(u8, i32)> {
        let (before, layer, sheet) = (self.settings, self.layer, self.sheet);
        *self = Self { settings, ..Self::new() };
        let (acceleration, jerk) = (limits.acceleration, limits.jerk.max(1));
        // The average of a speed whose change turns around changes its slope by twice the acceleration.
        let average = (2 * acceleration).div_ceil(jerk).clamp(1, MAX_AVERAGE as u64);
        let acceleration = acceleration.min(jerk * average / 2).max(1);
        let speed = limits.velocity.min(u64::from(most) << 32);
        (self.limits, self.average, self.resting) = ([speed as i64, acceleration as i64], average as u8, average as u8);
        let is_same = before.map(|of| of.axis) == settings.map(|of| of.axis);
        if keeps_layer && is_same {
            (self.layer, self.position, self.sheet) = (layer, i64::from(layer) * PULSE, sheet);
            return None;
        }
        before.map(|of| (of.axis, layer))
    }

    /// Returns the axis; `None` without settings.
    #[must_use]
    pub fn axis(&self) -> Option<u8> {
        self.settings.map(|settings| settings.axis)
    }

    /// Whether this input is a contact of the sheet.
    #[must_use]
    pub fn is_contact(&self, input: u8) -> bool {
        self.settings.is_some_and(|settings| settings.contacts >> (input & 15) & 1 == 1)
    }

    /// Returns the layer in pulses.
    #[must_use]
    pub const fn layer(&self) -> i32 {
        self.layer
    }

    /// Returns the increment of the last period.
    #[must_use]
    pub const fn increment(&self) -> i32 {
        self.increment
    }

    /// Whether the layer is at rest.
    #[must_use]
    pub const fn at_rest(&self) -> bool {
        self.resting >= self.average
    }

    /// Begins the moves before the switching. Returns whether there are any.
    pub fn begin_before(&mut self, moves: Option<LayerMove>) -> bool {
        let Some(LayerMove::Start { start, lowest, pierce, sheet, .. }) = moves else { return false };
        (self.is_beside, self.is_steered) = (false, false);
        let kept = self.sheet.filter(|_| self.is_sheet_kept);
        let (known, ohmic) = match sheet {
            SheetSource::Sensed(ohmic) => (None, ohmic),
            SheetSource::Kept(ohmic) => (kept, ohmic),
            SheetSource::Known(layer) => {
                self.search = SheetSearch { start, lowest, ..SheetSearch::default() };
                (self.sheet, self.is_sheet_kept) = (Some(layer), false);
                (Some(layer), NO_OHMIC)
            }
        };
        match known {
            Some(layer) => self.task = LayerTask::Return { target: layer.saturating_add(pierce) },
            None => {
                (self.sheet, self.is_sheet_kept) = (None, false);
                let is_kept = matches!(sheet, SheetSource::Sensed(_));
                self.search = SheetSearch { start, lowest, height: pierce, is_kept, ohmic, ..SheetSearch::default() };
                self.task = LayerTask::Approach;
            }
        }
        true
    }

    /// The sheet must be sensed by the next start: something has happened since it was found.
    pub fn forget_kept_sheet(&mut self) {
        self.is_sheet_kept = false;
    }

    /// Begins the moves behind the switching. Returns whether there are any.
    pub fn begin_behind(&mut self, moves: Option<LayerMove>) -> bool {
        let over = |height: i32| self.sheet.map(|sheet| sheet.saturating_add(height));
        let target = match moves {
            None => return false,
            Some(LayerMove::Start { cut, .. }) => over(cut).unwrap_or(self.layer),
            Some(LayerMove::OverSheet { height, highest }) => over(height).map_or(highest, |layer| layer.min(highest)),
            Some(LayerMove::To { layer }) => {
                self.is_sheet_kept = false;
                layer
            }
        };
        (self.task, self.is_beside, self.is_steered) = (LayerTask::Move { target }, false, false);
        true
    }

    /// Begins a move beside the path to this height over the sheet; none where no sheet is known.
    pub const fn begin_beside(&mut self, height: i32) {
        if let Some(sheet) = self.sheet {
            (self.task, self.is_beside) = (LayerTask::Move { target: sheet.saturating_add(height) }, true);
            self.is_steered = false;
        }
    }

    /// Whether height control may move it: nothing else does.
    #[must_use]
    pub fn is_free(&self) -> bool {
        matches!(self.task, LayerTask::Steer { .. }) || self.progress() == LayerProgress::Complete
    }

    /// Returns the lowest and the highest layer between which the sheet was sensed.
    #[must_use]
    pub const fn bounds(&self) -> [i32; 2] {
        [self.search.lowest, self.search.start]
    }

    /// Shifts these bounds: the path has moved the axis by so many pulses.
    pub const fn shift_bounds(&mut self, path: i32) {
        let SheetSearch { start, lowest, .. } = &mut self.search;
        (*start, *lowest) = (start.saturating_sub(path), lowest.saturating_sub(path));
    }

    /// Moves it beside the path toward an end of a range, with at most this speed in units of 2⁻³² pulses per period.
    pub const fn steer(&mut self, end: i32, speed: i64) {
        self.task = LayerTask::Steer { end };
        self.steering = [speed; HEIGHT_CONTROLS];
        (self.is_beside, self.is_steered, self.is_sheet_kept) = (true, true, false);
    }

    /// Whether it moves beside the path, comes to rest from such a move, or has made it last.
    #[must_use]
    pub const fn is_beside(&self) -> bool {
        self.is_beside
    }

    /// Ends a move by height control: it comes to rest.
    pub const fn end_steering(&mut self) {
        if matches!(self.task, LayerTask::Steer { .. }) {
            self.task = LayerTask::Stop;
        }
    }

    /// Brings the layer to rest wherever it is.
    pub fn stop(&mut self) {
        self.task = LayerTask::Stop;
    }

    /// Returns the progress of the move that was begun last.
    #[must_use]
    pub fn progress(&self) -> LayerProgress {
        match self.task {
            LayerTask::Failing(fault) => LayerProgress::Failed(fault),
            LayerTask::Stop => LayerProgress::Complete,
            LayerTask::Move { target } | LayerTask::Return { target }
                if self.at_rest() && self.layer == target && !self.is_held =>
            {
                LayerProgress::Complete
            }
            _ => LayerProgress::Moving,
        }
    }

    /// Runs one control period, with these inputs active. While `is_held` the layer comes to rest, and its task is
    /// continued afterwards.
    pub fn run_period(&mut self, active: u16, is_held: bool) {
        let Some(settings) = self.settings else { return };
        self.is_held = is_held;
        self.observe_contacts(active & settings.contacts);
        let ([fastest, _], SheetSearch { start, lowest, .. }) = (self.limits, self.search);
        let (target, speed) = match self.task {
            LayerTask::Move { target } | LayerTask::Return { target } => (target, fastest),
            LayerTask::Approach | LayerTask::Retreat | LayerTask::Again => (start, fastest),
            LayerTask::Down => (lowest, i64::from(settings.probe_speed) << 16),
            LayerTask::Up => (start, i64::from(settings.latch_speed) << 16),
            LayerTask::Steer { end } => (end, self.steering.first().copied().unwrap_or(0)),
            LayerTask::Stop | LayerTask::Overrun | LayerTask::Failing(_) => (self.layer, 0),
        };
        self.speed = if is_held || speed == 0 { self.braked() } else { self.speed_toward(target, speed.min(fastest)) };
        self.position += self.speed;
        self.emit();
    }

    /// Updates the task from the closed contacts and the layer.
    fn observe_contacts(&mut self, closed: u16) {
        let (is_at_rest, layer) = (self.at_rest(), self.layer);
        let rests_at = |target: i32| is_at_rest && layer == target;
        let SheetSearch { start, lowest, height, ohmic, .. } = self.search;
        let is_closed = closed != 0;
        // The float switch opens before the tip leaves the sheet; an ohmic contact that has failed counts no more.
        let is_touching = if self.search.is_ohmic { is_closed } else { closed & !ohmic.inputs != 0 };
        if is_closed {
            self.is_sheet_kept = false;
        }
        self.task = match self.task {
            LayerTask::Approach | LayerTask::Return { .. } if is_closed => LayerTask::Failing(SheetFault::Contact),
            LayerTask::Approach if rests_at(start) => LayerTask::Down,
            LayerTask::Down if is_closed => {
                self.search.is_ohmic = closed & ohmic.inputs != 0;
                LayerTask::Overrun
            }
            LayerTask::Down if rests_at(lowest) => LayerTask::Retreat,
            LayerTask::Retreat if rests_at(start) => LayerTask::Failing(SheetFault::NoSheet),
            LayerTask::Overrun if is_at_rest => LayerTask::Up,
            LayerTask::Up if !is_touching => {
                let is_missed = ohmic.inputs != 0 && !self.search.is_ohmic;
                if is_missed && self.search.failed < ohmic.tries {
                    self.search.failed += 1;
                    LayerTask::Again
                } else {
                    let drop = if self.search.is_ohmic { ohmic.drop } else { 0 };
                    let sheet = layer.saturating_sub(drop);
                    (self.sheet, self.is_sheet_kept) = (Some(sheet), self.search.is_kept);
                    LayerTask::Move { target: sheet.saturating_add(height) }
                }
            }
            LayerTask::Up if rests_at(start) => LayerTask::Failing(SheetFault::Contact),
            LayerTask::Again if rests_at(start) => LayerTask::Approach,
            task => task,
        };
    }

    fn braked(&self) -> i64 {
        let [_, change] = self.limits;
        self.speed - self.speed.clamp(-change, change)
    }

    /// Returns the next speed toward a target, at most `fastest`.
    fn speed_toward(&self, target: i32, fastest: i64) -> i64 {
        let [_, change] = self.limits;
        let remaining = i64::from(target) * PULSE - self.position;
        let sign = if remaining < 0 { -1 } else { 1 };
        let (remaining, speed) = (remaining * sign, self.speed * sign);
        let periods = (2 * remaining / change).unsigned_abs().isqrt() as i64;
        let mut reaching = fastest;
        for k in (periods - 1).max(0)..=periods + 1 {
            // k (k + 1) / 2 times the change is about what remains
            reaching = reaching.min((remaining + change * (k * (k + 1) / 2)) / (k + 1));
        }
        // Where the target is too near, or the speed was allowed before, it is as slow as it can be.
        (speed + change).min(reaching).max(speed - change) * sign
    }

    /// Emits the average of the last speeds.
    fn emit(&mut self) {
        let slot = &mut self.speeds[usize::from(self.next) % MAX_AVERAGE];
        self.sum += self.speed - *slot;
        *slot = self.speed;
        self.next = if self.next + 1 >= self.average { 0 } else { self.next + 1 };
        self.resting = if self.speed == 0 { (self.resting + 1).min(self.average) } else { 0 };
        let unit = PULSE * i64::from(self.average);
        self.fraction += self.sum;
        // The speed is at most 65 536 pulses per period.
        self.increment = self.fraction.div_euclid(unit) as i32;
        self.fraction = self.fraction.rem_euclid(unit);
        self.layer = self.layer.saturating_add(self.increment);
        if self.is_steered {
            self.sheet = self.sheet.map(|sheet| sheet.saturating_add(self.increment));
        }
    }
}

impl Default for LayerDrive {
    fn default() -> Self {
        Self::new()
    }
}
