//! Height control: whether the tool moves up or down beside the path in a control period, and how fast (CUT-49 to
//! CUT-53).
//!
//! The control takes over behind a delay, once the machine has run at the programmed feed for some periods. From then
//! on it compares the filtered reading with its target. The height stays where the speed is below a share of the feed,
//! from some periods before a slow record on, over a void, and where the program or the override asks for it.
//!
//! Invariant: it asks for a motion only within the range around the layer at which it took over, and never before that.

use retrace_core::{Record, RecordIndex};
use retrace_link::{HEIGHT_CONTROLS, HeightControlSettings, HeightSource, HeightState, OutputChange, RESUME_SHARE};

/// Samples in a row with a steep slope, from which on the arc is over a void.
const STEEP_SAMPLES: u8 = 2;
/// Samples in a row without one, after which it may be over metal again.
const CALM_SAMPLES: u8 = 10;
/// Records ahead that are looked at in a control period: as many as may be passed in one.
const RECORDS_PER_PERIOD: u8 = 9;
/// Bits of a fraction of a reading.
const FRACTION_BITS: u32 = 16;

/// What the control depends on in a control period.
#[derive(Clone, Copy, Debug, Default)]
pub struct HeightConditions {
    /// Whether a cutter is on and proven, and the machine moves forward along the path with it.
    pub is_cutting: bool,
    /// Whether nothing else moves the layer, and the path does not move its axis.
    pub is_free: bool,
    /// Speed along the path as a share of the programmed feed, in units of 2⁻¹⁵.
    pub feed_share: u32,
    /// Whether a record ahead is too slow.
    pub is_slow_ahead: bool,
    /// Whether the height is to stay.
    pub is_held: bool,
    /// Active inputs, one bit each.
    pub inputs: u16,
    /// Reading of the analog input.
    pub reading: Option<u16>,
    /// What is added to the target, in readings.
    pub offset: i32,
    /// The layer.
    pub layer: i32,
    /// The lowest and the highest layer between which the sheet was sensed.
    pub bounds: [i32; 2],
}

/// What the control asks for in a control period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeightOrder {
    /// It does not act: no other motion of the layer is affected.
    None,
    /// The layer comes to rest, and stays.
    Stay,
    /// The layer moves toward `end` of the range, at this speed in units of 2⁻³² pulses per period.
    Toward {
        /// End of the range, in pulses.
        end: i32,
        /// Maximum speed.
        speed: i64,
    },
}

/// What the arc voltage shows of a void under the arc.
#[derive(Clone, Copy, Debug, Default)]
struct VoidWatch {
    /// Samples in a row with a steep slope, and without one.
    steep: u8,
    calm: u8,
    /// The reading before the slope, with its fraction.
    before: i64,
    /// Largest rise from that reading over the void that the arc is over.
    jump: Option<i64>,
    /// Control periods for which it has been over it.
    periods: u16,
}

/// Part of a cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum HeightPart {
    /// There is no cut.
    NoCut,
    /// The delay, in control periods that have passed.
    Delay(u16),
    /// Control periods in a row at the programmed feed.
    Steady(u16),
    /// The control has taken over: the lowest and the highest layer.
    Controlling([i32; 2]),
}

/// Height control of one cutter.
#[derive(Clone, Debug)]
pub struct HeightControl {
    settings: HeightControlSettings,
    part: HeightPart,
    /// The target in readings, with a fraction, once it is known.
    aim: i64,
    /// Sum of the readings that are averaged.
    sum: i64,
    /// The filtered reading, with a fraction.
    filtered: Option<i64>,
    void: VoidWatch,
    /// Whether the speed has been too low since it was last at the feed.
    is_slow: bool,
    /// Control periods in a row at an end of the range.
    at_end: u16,
    state: HeightState,
    /// First record ahead that was not looked at, and the last slow one that was seen.
    ahead: (RecordIndex, Option<RecordIndex>),
}

/// The height controls of a card: one, or none without the feature `analog`.
pub type HeightControllers = [HeightControl; HEIGHT_CONTROLS];

impl HeightControl {
    /// Creates the control of a card without settings.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            settings: HeightControlSettings::NONE,
            part: HeightPart::NoCut,
            aim: 0,
            sum: 0,
            filtered: None,
            void: VoidWatch { steep: 0, calm: 0, before: 0, jump: None, periods: 0 },
            is_slow: false,
            at_end: 0,
            state: HeightState::Off,
            ahead: (RecordIndex::new(0), None),
        }
    }

    /// The controls of a card without settings.
    pub(crate) const NONE: HeightControllers = [const { Self::new() }; HEIGHT_CONTROLS];

    /// Begins a cut, or an epoch, with these settings.
    pub fn configure(&mut self, settings: &HeightControlSettings) {
        *self = Self { settings: *settings, ..Self::new() };
    }

    /// Returns the settings.
    #[must_use]
    pub const fn settings(&self) -> &HeightControlSettings {
        &self.settings
    }

    /// Returns the state after the last period.
    #[must_use]
    pub const fn state(&self) -> HeightState {
        self.state
    }

    /// Returns the output of another controller, which is on while that one may move the axis; `None` where there is
    /// none.
    #[must_use]
    pub const fn external(&self) -> Option<OutputChange> {
        match self.settings.source {
            HeightSource::External { output } => {
                Some(OutputChange { channel: output, value: matches!(self.state, HeightState::Active) as i32 })
            }
            _ => None,
        }
    }

    /// Shifts the range: the path has moved the axis by so many pulses.
    pub const fn shift_range(&mut self, path: i32) {
        if let HeightPart::Controlling([lowest, highest]) = &mut self.part {
            (*lowest, *highest) = (lowest.saturating_sub(path), highest.saturating_sub(path));
        }
    }

    /// Whether the height stood at an end of its range for too long.
    #[must_use]
    pub const fn has_failed(&self) -> bool {
        let limit = self.settings.limit_periods;
        limit > 0 && self.at_end >= limit
    }

    /// Whether one of the next records from `here` on is too slow. It looks at a few of those that it has not seen yet.
    pub fn look_ahead<'a, const A: usize>(
        &mut self,
        here: RecordIndex,
        record: impl Fn(RecordIndex) -> Option<&'a Record<A>>,
    ) -> bool {
        let end = here + u32::from(self.settings.look_periods) + 1;
        let (mut next, mut slow) = self.ahead;
        if next.is_before(here) || end.is_before(next) {
            (next, slow) = (here, None);
        }
        for _ in 0..RECORDS_PER_PERIOD {
            let Some(seen) = record(next).filter(|_| next.is_before(end)) else { break };
            if seen.feed_share < self.settings.hold_below {
                slow = Some(next);
            }
            next += 1;
        }
        self.ahead = (next, slow);
        slow.is_some_and(|slow| !slow.is_before(here))
    }

    /// Runs one control period.
    pub fn run_period(&mut self, now: &HeightConditions) -> HeightOrder {
        if self.settings.source == HeightSource::None || !now.is_cutting {
            (self.part, self.state, self.filtered, self.at_end) = (HeightPart::NoCut, HeightState::Off, None, 0);
            return HeightOrder::None;
        }
        self.filter(now.reading);
        self.watch_speed(now);
        let order = match self.part {
            HeightPart::NoCut | HeightPart::Delay(_) | HeightPart::Steady(_) => {
                self.wait(now);
                HeightOrder::None
            }
            HeightPart::Controlling(range) => self.control(now, range),
        };
        self.state = match (self.part, order) {
            (HeightPart::Controlling(_), _) if self.at_end > 0 => HeightState::AtLimit,
            (HeightPart::Controlling(_), HeightOrder::Toward { .. }) => HeightState::Active,
            (HeightPart::Controlling(_), _) if self.is_held(now) => HeightState::Held,
            (HeightPart::Controlling(_), _) => HeightState::Active,
            _ => HeightState::Waiting,
        };
        order
    }

    /// Follows the reading with a low-pass filter, and looks for the slope of a void.
    fn filter(&mut self, reading: Option<u16>) {
        let Some(reading) = reading.map(|reading| i64::from(reading) << FRACTION_BITS) else {
            self.filtered = None;
            return;
        };
        let share = i64::from(self.settings.filter);
        let before = self.filtered.unwrap_or(reading);
        let after = if share == 0 { reading } else { before + (((reading - before) * share) >> FRACTION_BITS) };
        self.filtered = Some(after);
        // Before the control takes over, the voltage changes with the height from the pierce to the cut.
        let (slope, void) = (i64::from(self.settings.slope), &mut self.void);
        if slope == 0 || !matches!(self.part, HeightPart::Controlling(_)) {
            *void = VoidWatch::default();
            return;
        }
        // Over a void the arc is longer.
        let sign = i64::from(self.settings.gain.signum());
        let is_steep = (after - before) * sign > slope;
        if is_steep && void.steep == 0 && void.jump.is_none() {
            void.before = before;
        }
        void.steep = if is_steep { void.steep.saturating_add(1) } else { 0 };
        void.calm = if (after - before).abs() > slope { 0 } else { void.calm.saturating_add(1) };
        let away = (after - void.before) * sign;
        void.periods = if void.jump.is_some() { void.periods.saturating_add(1) } else { 0 };
        let lasts_too_long = self.settings.void_periods > 0 && void.periods >= self.settings.void_periods;
        void.jump = match void.jump {
            None if void.steep >= STEEP_SAMPLES => Some(away),
            None => None,
            // The void ends where the voltage has come back, and not only rests.
            Some(jump) if void.calm >= CALM_SAMPLES && away < jump / 2 => None,
            Some(_) if lasts_too_long => None,
            Some(jump) => Some(jump.max(away)),
        };
    }

    /// Whether the speed is below its share of the feed, until it reaches the feed again.
    fn watch_speed(&mut self, now: &HeightConditions) {
        if now.feed_share < u32::from(self.settings.hold_below.units()) {
            self.is_slow = true;
        } else if now.feed_share >= u32::from(RESUME_SHARE.units()) {
            self.is_slow = false;
        }
    }

    /// Runs the delay, and waits until the machine runs at the feed.
    fn wait(&mut self, now: &HeightConditions) {
        let HeightControlSettings { delay_periods, samples, up, down, .. } = self.settings;
        self.part = match self.part {
            HeightPart::Delay(passed) if passed < delay_periods => HeightPart::Delay(passed + 1),
            HeightPart::Delay(_) => HeightPart::Steady(0),
            HeightPart::Steady(count) => {
                let is_steady = now.feed_share >= u32::from(RESUME_SHARE.units()) && now.is_free && !self.is_held(now);
                match self.filtered {
                    _ if !is_steady => HeightPart::Steady(0),
                    reading => {
                        self.sum = if count == 0 { 0 } else { self.sum } + reading.unwrap_or(0);
                        if count + 1 < samples {
                            HeightPart::Steady(count + 1)
                        } else {
                            let mean = self.sum / i64::from(samples.max(1));
                            let known = i64::from(self.settings.target) << FRACTION_BITS;
                            self.aim = if known == 0 { mean } else { known };
                            let ([lowest, highest], layer) = (now.bounds, now.layer);
                            let lowest = layer.saturating_sub(down as i32).max(lowest).min(layer);
                            HeightPart::Controlling([lowest, layer.saturating_add(up as i32).min(highest).max(layer)])
                        }
                    }
                }
            }
            HeightPart::NoCut | HeightPart::Controlling(_) => {
                (self.is_slow, self.at_end) = (true, 0);
                HeightPart::Delay(0)
            }
        };
    }

    /// Whether the height is to stay in this period.
    const fn is_held(&self, now: &HeightConditions) -> bool {
        // Another controller knows the height.
        let knows_height = self.filtered.is_some() || !matches!(self.settings.source, HeightSource::Volts { .. });
        now.is_held || now.is_slow_ahead || self.is_slow || self.void.jump.is_some() || !knows_height
    }

    /// Controls the height within a range.
    fn control(&mut self, now: &HeightConditions, [lowest, highest]: [i32; 2]) -> HeightOrder {
        if !now.is_free {
            self.at_end = 0;
            return HeightOrder::None;
        }
        if self.is_held(now) {
            self.at_end = 0;
            return HeightOrder::Stay;
        }
        let speed = self.wanted_speed(now);
        let end = match speed.signum() {
            0 => {
                self.at_end = 0;
                return HeightOrder::Stay;
            }
            1 => highest,
            _ => lowest,
        };
        let is_at_end = if speed > 0 { now.layer >= end } else { now.layer <= end };
        self.at_end = if is_at_end { self.at_end.saturating_add(1) } else { 0 };
        HeightOrder::Toward { end, speed: speed.abs() }
    }

    /// Returns the speed that is wanted, in units of 2⁻³² pulses per period: positive is up.
    fn wanted_speed(&self, now: &HeightConditions) -> i64 {
        let HeightControlSettings { source, speed, gain, band, .. } = self.settings;
        let fastest = i64::from(speed) << 16;
        match (source, self.filtered) {
            (HeightSource::UpDown { up, down }, _) => {
                let is_active = |input: u8| i64::from(now.inputs >> (input & 15) & 1);
                fastest * (is_active(up) - is_active(down))
            }
            (HeightSource::Volts { .. }, Some(reading)) => {
                let above = reading - self.aim - (i64::from(now.offset) << FRACTION_BITS);
                let band = i64::from(band) << FRACTION_BITS;
                let beyond = above - above.clamp(-band, band);
                // at most 2³³ · 2³¹ in units of 2⁻⁴⁸
                ((-i128::from(beyond) * i128::from(gain)) >> FRACTION_BITS)
                    .clamp(-i128::from(fastest), i128::from(fastest)) as i64
            }
            // Nothing is known of the height.
            _ => 0,
        }
    }
}

impl Default for HeightControl {
    fn default() -> Self {
        Self::new()
    }
}
