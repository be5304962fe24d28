//! The spindle as the card measures it: its speed, whether it is at speed, and what is wrong with it (SPN-3, SPN-6,
//! SPN-24).
//!
//! Invariant: without an encoder nothing is measured, and nothing is ever at speed.

use retrace_link::{Alarm, Outputs, SpindleSettings, channel};

use crate::spindle_encoder::{EncoderReading, SpindleEncoder};

/// Time without a count after which a spindle that is switched off rests, µs.
const SILENT_US: i64 = 50_000;
/// Longest time without a count in a geared stretch, µs.
const MOST_SILENT_US: i64 = 500_000;
/// Time below a tenth of the commanded speed after which a spindle has stalled, µs.
const STALLED_US: u32 = 200_000;

/// Monitor of the spindle.
#[derive(Clone, Debug, Default)]
pub struct SpindleMonitor {
    watched: Option<WatchedSpindle>,
}

/// A spindle with an encoder.
#[derive(Clone, Debug)]
struct WatchedSpindle {
    settings: SpindleSettings,
    period_us: u32,
    encoder: SpindleEncoder,
    /// Commanded speed in thousandths of a revolution per minute, signed.
    commanded: i32,
    /// Control periods in a row at the commanded speed.
    at_speed: u16,
    /// Control periods in a row below a tenth of it.
    stalled: u32,
    /// Whether it has come to half of the commanded speed since that changed.
    has_turned: bool,
}

impl WatchedSpindle {
    const fn new(settings: SpindleSettings, period_us: u32) -> Self {
        Self {
            settings,
            period_us,
            encoder: new_encoder(&settings, period_us),
            commanded: 0,
            at_speed: 0,
            stalled: 0,
            has_turned: false,
        }
    }
}

impl WatchedSpindle {
    /// Whether a spindle that has turned shows no count in the time of so many at half of the commanded speed, and in
    /// `more_us`.
    fn is_silent_for(&self, counts: i64, more_us: u32) -> bool {
        let counts_per_minute =
            i64::from(self.commanded.unsigned_abs()) * i64::from(self.settings.counts_per_turn) / 1000;
        let their_us = counts * 120_000_000 / counts_per_minute.max(1);
        self.has_turned && self.encoder.silent_us() > (their_us + i64::from(more_us)).min(MOST_SILENT_US)
    }
}

const fn new_encoder(of: &SpindleSettings, period_us: u32) -> SpindleEncoder {
    SpindleEncoder::new(of.counts_per_turn, of.is_inverted, of.highest_speed, period_us)
}

impl SpindleMonitor {
    /// Creates a monitor without an encoder.
    #[must_use]
    pub const fn new() -> Self {
        Self { watched: None }
    }

    /// Sets the spindle of an epoch. The count and the index of the same encoder are kept: then it returns true.
    pub fn configure(&mut self, settings: Option<SpindleSettings>, period_us: u32) -> bool {
        let is_same =
            self.watched.as_ref().is_some_and(|of| Some(of.settings) == settings && of.period_us == period_us);
        if !is_same {
            self.watched = settings.map(|settings| WatchedSpindle::new(settings, period_us));
        }
        is_same
    }

    /// Reads the encoder in a control period with these outputs. After an error the counts begin anew, without an
    /// index.
    pub fn read(&mut self, reading: &EncoderReading, outputs: &Outputs) -> Option<Alarm> {
        let of = self.watched.as_mut()?;
        let result = of.encoder.read(reading);
        if result.is_err() {
            of.encoder = new_encoder(&of.settings, of.period_us);
        }
        let [spindle, speed] = [channel::SPINDLE, channel::SPEED].map(|number| outputs[usize::from(number)]);
        let measured = i64::from(of.encoder.speed());
        let commanded = spindle.signum() * speed.max(0);
        let is_half = commanded != 0 && measured * i64::from(commanded.signum()) * 2 >= i64::from(commanded.abs());
        of.has_turned = is_half || of.has_turned && commanded == of.commanded;
        of.commanded = commanded;
        let commanded = i64::from(of.commanded);
        let off = (measured - commanded).abs() * 1000;
        let is_at_speed = commanded != 0 && off <= commanded.abs() * i64::from(of.settings.at_speed_permille);
        of.at_speed = if is_at_speed { of.at_speed.saturating_add(1) } else { 0 };
        let is_slow = of.has_turned && measured.abs() * 10 < commanded.abs();
        of.stalled = if is_slow { of.stalled.saturating_add(1) } else { 0 };
        if result.is_err() { Some(Alarm::EncoderFailed) } else { None }
    }

    /// Measured speed in thousandths of a revolution per minute, positive clockwise; `None` without an encoder.
    #[must_use]
    pub fn speed(&self) -> Option<i32> {
        self.watched.as_ref().map(|of| of.encoder.speed())
    }

    /// Settings of the spindle.
    #[must_use]
    pub fn settings(&self) -> Option<&SpindleSettings> {
        self.watched.as_ref().map(|of| &of.settings)
    }

    /// Whether the spindle is at its commanded speed, for as long as the settings require.
    #[must_use]
    pub fn is_at_speed(&self) -> bool {
        self.watched.as_ref().is_some_and(|of| of.at_speed > of.settings.at_speed_periods)
    }

    /// Direction in which the spindle is commanded to turn: 1 clockwise, −1 counter-clockwise, 0 stopped.
    #[must_use]
    pub fn direction(&self) -> i64 {
        self.watched.as_ref().map_or(0, |of| i64::from(of.commanded.signum()))
    }

    /// Commanded speed in thousandths of a revolution per minute, signed.
    #[must_use]
    pub fn commanded(&self) -> i32 {
        self.watched.as_ref().map_or(0, |of| of.commanded)
    }

    /// Control periods for which a spindle that is being reversed may show no count.
    #[must_use]
    pub fn reversal_periods(&self) -> u32 {
        self.watched.as_ref().map_or(0, |of| MOST_SILENT_US as u32 / of.period_us.max(1))
    }

    /// Angle of the first index, in units of [`retrace_core::gear::UNITS_PER_COUNT`]; `None` before it was seen.
    #[must_use]
    pub fn zero_angle(&self) -> Option<i64> {
        self.watched.as_ref()?.encoder.zero_angle()
    }

    /// Angle at the end of the control period after this one, in the same unit (SPN-4).
    #[must_use]
    pub fn angle_ahead(&self) -> Option<i64> {
        self.watched.as_ref().map(|of| of.encoder.angle_ahead(2 * of.period_us))
    }

    /// Whether the spindle rests: no count for longer than the angle ahead considers.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.watched
            .as_ref()
            .is_none_or(|of| of.encoder.silent_us() > SILENT_US && of.encoder.speed().unsigned_abs() < 10_000)
    }

    /// Whether an angle that has come to rest is a fault of the encoder, or of the spindle.
    #[must_use]
    pub fn seems_dead(&self) -> bool {
        self.watched.as_ref().is_some_and(|of| of.is_silent_for(2, 0))
    }

    /// The alarm of a spindle that a stretch is geared to.
    #[must_use]
    pub fn gear_alarm(&self) -> Option<Alarm> {
        let of = self.watched.as_ref()?;
        if of.is_silent_for(20, of.period_us) {
            return Some(Alarm::EncoderFailed);
        }
        (of.stalled > STALLED_US / of.period_us.max(1)).then_some(Alarm::SpindleStalled)
    }

    /// Feed per turn: the rate for a target rate, so that the feed is at most F times the measured speed (SPN-8).
    #[must_use]
    pub fn per_turn_rate(&self, target: retrace_core::Rate) -> retrace_core::Rate {
        let Some(of) = &self.watched else { return target };
        let (commanded, measured) = (i64::from(of.commanded), i64::from(of.encoder.speed()));
        if commanded == 0 || measured * commanded.signum() <= 0 {
            return retrace_core::Rate::ZERO;
        }
        let share = ((measured.abs() << 16) / commanded.abs()).min(1 << 16);
        retrace_core::Rate::from_units((target.units() >> 16) * share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spindle_encoder::{EncoderSample, MAX_ENCODER_SAMPLES};
    use retrace_core::Rate;

    const SETTINGS: SpindleSettings = SpindleSettings {
        counts_per_turn: 400,
        is_inverted: false,
        has_index: true,
        at_speed_permille: 50,
        at_speed_periods: 20,
        timeout_periods: 1000,
        highest_speed: 3_000_000,
    };

    /// Reads `periods` of 1 ms in which the spindle turns by `counts` each.
    fn turn(monitor: &mut SpindleMonitor, at: &mut u16, counts: i16, periods: u32, outputs: &Outputs) -> Option<Alarm> {
        let mut alarm = None;
        for _ in 0..periods {
            *at = at.wrapping_add_signed(counts);
            let samples = [EncoderSample { counter: *at, edge: u16::MAX }; MAX_ENCODER_SAMPLES];
            let reading = EncoderReading { samples, count: 1, ..EncoderReading::default() };
            alarm = alarm.or(monitor.read(&reading, outputs)).or(monitor.gear_alarm());
        }
        alarm
    }

    fn commanded(spindle: i32, speed: i32) -> Outputs {
        let mut outputs = [0; channel::COUNT];
        (outputs[usize::from(channel::SPINDLE)], outputs[usize::from(channel::SPEED)]) = (spindle, speed);
        outputs
    }

    #[test]
    fn the_spindle_is_at_speed_after_some_time_near_it() {
        let (mut monitor, mut at) = (SpindleMonitor::new(), 0);
        monitor.configure(Some(SETTINGS), 1000);
        // 4 counts a millisecond are 600 revolutions per minute
        let outputs = commanded(1, 600_000);
        turn(&mut monitor, &mut at, 4, 10, &outputs);
        assert!(!monitor.is_at_speed());
        turn(&mut monitor, &mut at, 4, 40, &outputs);
        assert!(monitor.is_at_speed() && monitor.direction() == 1 && !monitor.is_at_rest());
        turn(&mut monitor, &mut at, 4, 1, &commanded(-1, 600_000));
        assert!(!monitor.is_at_speed(), "the other way");
        turn(&mut monitor, &mut at, 4, 40, &commanded(1, 640_000));
        assert!(!monitor.is_at_speed(), "6 % too slow");
        turn(&mut monitor, &mut at, 4, 40, &commanded(1, 625_000));
        assert!(monitor.is_at_speed());
        assert!(!SpindleMonitor::new().is_at_speed() && SpindleMonitor::new().speed().is_none());
    }

    #[test]
    fn a_silent_encoder_and_a_stalled_spindle_are_alarms_of_a_gear() {
        let outputs = commanded(1, 600_000);
        let begun = || {
            let (mut monitor, mut at) = (SpindleMonitor::new(), 0);
            monitor.configure(Some(SETTINGS), 1000);
            assert_eq!(turn(&mut monitor, &mut at, 4, 100, &outputs), None);
            (monitor, at)
        };
        let (mut silent, mut at) = begun();
        // twenty counts at 300 revolutions per minute are 10 ms
        assert_eq!(turn(&mut silent, &mut at, 0, 10, &outputs), None);
        assert_eq!(turn(&mut silent, &mut at, 0, 2, &outputs), Some(Alarm::EncoderFailed));
        let (mut slow, mut at) = begun();
        let mut alarm = None;
        for _ in 0..30 {
            // a count in 9 ms is a 36th of the speed
            alarm = alarm.or(turn(&mut slow, &mut at, 0, 8, &outputs)).or(turn(&mut slow, &mut at, 1, 1, &outputs));
        }
        assert_eq!(alarm, Some(Alarm::SpindleStalled));
        let (mut off, mut at) = begun();
        assert_eq!(turn(&mut off, &mut at, 0, 300, &commanded(0, 600_000)), None, "commanded to stop");
        assert!(off.is_at_rest());
    }

    #[test]
    fn the_feed_per_turn_is_never_above_its_word() {
        let (mut monitor, mut at) = (SpindleMonitor::new(), 0);
        monitor.configure(Some(SETTINGS), 1000);
        assert_eq!(SpindleMonitor::new().per_turn_rate(Rate::ONE), Rate::ONE, "no encoder");
        turn(&mut monitor, &mut at, 4, 100, &commanded(1, 800_000));
        let share = f64::from(monitor.per_turn_rate(Rate::ONE));
        assert!((share - 0.75).abs() < 0.001, "{share}");
        turn(&mut monitor, &mut at, 4, 1, &commanded(1, 500_000));
        assert_eq!(monitor.per_turn_rate(Rate::ONE / 2), Rate::ONE / 2, "not faster");
        turn(&mut monitor, &mut at, 4, 1, &commanded(-1, 600_000));
        assert_eq!(monitor.per_turn_rate(Rate::ONE), Rate::ZERO, "it still turns the other way");
    }
}
