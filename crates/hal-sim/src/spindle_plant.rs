//! A spindle with an encoder: its speed over time, loads, and what the encoder shows (SPN-29).
//!
//! Invariant: it depends on the outputs of the card alone, and its true angle is what a judge compares with.

use retrace_card::{EncoderReading, EncoderSample, MAX_ENCODER_SAMPLES};
use retrace_link::{Outputs, channel};

/// Settings of a simulated spindle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpindleSimulation {
    /// Counts of its encoder in a turn; 0 without an encoder.
    pub counts_per_turn: u32,
    /// Whether the encoder counts up counter-clockwise.
    pub is_inverted: bool,
    /// Acceleration by the drive, in revolutions per minute per second.
    pub acceleration: f64,
    /// Deceleration while it coasts, in the same unit.
    pub coasting: f64,
    /// Periodic change of the speed: its part of the commanded speed, and its frequency in Hz.
    pub swing: [f64; 2],
    /// Dips of the speed by a load: their part of the commanded speed, their duration in s, and their distance in s.
    pub dips: [f64; 3],
    /// Change of the speed once a turn, as a part of it.
    pub ripple: f64,
    /// How far the edges of the encoder are from where they belong at most, as a part of a count.
    pub line_error: f64,
}

impl Default for SpindleSimulation {
    fn default() -> Self {
        Self {
            counts_per_turn: 0,
            is_inverted: false,
            acceleration: 3000.0,
            coasting: 1500.0,
            swing: [0.0; 2],
            dips: [0.0; 3],
            ripple: 0.0,
            line_error: 0.0,
        }
    }
}

/// Length of a step of the simulation, µs.
const STEP_US: u64 = 50;
/// Distance of two samples of the encoder, µs.
const SAMPLE_US: u64 = 1000;

/// A simulated spindle.
#[derive(Clone, Debug)]
pub struct SpindlePlant {
    settings: SpindleSimulation,
    now_us: u64,
    /// True angle in turns, and speed in turns per second, positive clockwise.
    angle: f64,
    speed: f64,
    /// Commanded speed in turns per second, signed.
    commanded: f64,
    /// A load: part of the speed that it takes, and its end.
    load: (f64, u64),
    is_stalled: bool,
    /// Turns by hand that are still to be made.
    by_hand: f64,
    /// Counts that the encoder has shown too many; negative: lost.
    wrong_counts: i64,
    /// Whether the encoder shows nothing any more, and whether its index does.
    is_dead: bool,
    is_index_lost: bool,
    last_count: i64,
    /// The reading of the period before: that is as late as the one of a card that reads and calculates in one period,
    /// and emits the pulses in the next.
    pending: EncoderReading,
}

impl SpindlePlant {
    /// A spindle at rest.
    #[must_use]
    pub fn new(settings: SpindleSimulation) -> Self {
        Self {
            settings,
            now_us: 0,
            angle: 0.35,
            speed: 0.0,
            commanded: 0.0,
            load: (0.0, 0),
            is_stalled: false,
            by_hand: 0.0,
            wrong_counts: 0,
            is_dead: false,
            is_index_lost: false,
            last_count: 0,
            pending: EncoderReading::default(),
        }
    }

    /// True angle now, in turns, positive clockwise. The index is at every whole turn.
    #[must_use]
    pub const fn angle(&self) -> f64 {
        self.angle
    }

    /// True speed now, in revolutions per minute.
    #[must_use]
    pub fn speed_rpm(&self) -> f64 {
        self.speed * 60.0
    }

    /// Loads the spindle: it loses this part of its speed for `for_us` from now on.
    pub const fn set_load(&mut self, part: f64, for_us: u64) {
        self.load = (part, self.now_us + for_us);
    }

    /// Stops the spindle at once, or lets it turn again.
    pub const fn set_stalled(&mut self, is_stalled: bool) {
        self.is_stalled = is_stalled;
    }

    /// The counter is wrong by this many counts from now on.
    pub const fn add_wrong_counts(&mut self, counts: i64) {
        self.wrong_counts += counts;
    }

    /// The encoder shows no change any more.
    pub const fn kill_encoder(&mut self) {
        self.is_dead = true;
    }

    /// The encoder shows no index any more.
    pub const fn lose_index(&mut self) {
        self.is_index_lost = true;
    }

    /// Turns the spindle by hand, by so many turns, at half a turn per second.
    pub fn turn_by_hand(&mut self, turns: f64) {
        self.by_hand += turns;
    }

    /// Applies the card's outputs.
    pub fn outputs(&mut self, outputs: &Outputs) {
        let [spindle, speed] = [channel::SPINDLE, channel::SPEED].map(|number| outputs[usize::from(number)]);
        self.commanded = f64::from(spindle.signum()) * f64::from(speed.max(0)) / 60_000.0;
    }

    /// Runs until `now_us`. Returns what the encoder showed in the period before the last.
    pub fn advance(&mut self, now_us: u64) -> EncoderReading {
        let from_us = self.now_us;
        let mut reading = EncoderReading::default();
        let period_us = now_us.saturating_sub(from_us).max(1);
        let samples = period_us.div_ceil(SAMPLE_US).clamp(1, MAX_ENCODER_SAMPLES as u64);
        let mut edge_us = 0;
        for sample in 1..=samples {
            let until_us = from_us + period_us * sample / samples;
            while self.now_us < until_us {
                self.step((until_us - self.now_us).min(STEP_US), from_us, &mut edge_us, &mut reading);
            }
            let edge = ((edge_us << 16) / (period_us * 1000)).min(65_535) as u16;
            reading.samples[usize::from(reading.count)] =
                EncoderSample { counter: self.counter(self.last_count), edge };
            reading.count += 1;
        }
        std::mem::replace(&mut self.pending, reading)
    }

    /// What the counter shows at this true count.
    const fn counter(&self, count: i64) -> u16 {
        (count + self.wrong_counts) as u16
    }

    /// One step. `edge_us`: moment of the last edge in ns from the beginning of the period.
    fn step(&mut self, us: u64, from_us: u64, edge_ns: &mut u64, reading: &mut EncoderReading) {
        let (s, before) = (us as f64 / 1e6, self.angle);
        self.accelerate(s);
        self.angle += self.speed * (1.0 + self.settings.ripple * (self.angle * std::f64::consts::TAU).cos()) * s;
        let by_hand = self.by_hand.clamp(-0.5 * s, 0.5 * s);
        self.by_hand -= by_hand;
        self.angle += by_hand;
        let began_us = self.now_us;
        self.now_us += us;
        // Counts of the encoder in a turn clockwise.
        let counts = f64::from(self.settings.counts_per_turn) * if self.settings.is_inverted { -1.0 } else { 1.0 };
        if self.is_dead || counts == 0.0 {
            return;
        }
        // A count is an edge: that of a whole count which was passed last, in the direction of the motion.
        let count = (self.angle * counts).floor() as i64;
        if count != self.last_count {
            let edge = if count > self.last_count { count } else { count + 1 };
            let edge_at = (edge as f64 + self.settings.line_error * line_share(edge, counts as i64)) / counts;
            let share = ((edge_at - before) / (self.angle - before)).clamp(0.0, 1.0);
            *edge_ns = (began_us - from_us) * 1000 + (share * us as f64 * 1000.0) as u64;
            self.last_count = count;
        }
        let turn = before.max(self.angle).floor();
        if before.min(self.angle) < turn && !self.is_index_lost {
            reading.index = Some(self.counter((turn * counts) as i64));
        }
    }

    fn accelerate(&mut self, s: f64) {
        if self.is_stalled {
            self.speed = 0.0;
            return;
        }
        let now_s = self.now_us as f64 / 1e6;
        let [part, hz] = self.settings.swing;
        let [dip, dip_s, every_s] = self.settings.dips;
        let dips = if every_s > 0.0 && now_s % every_s < dip_s {
            dip * (std::f64::consts::PI * (now_s % every_s) / dip_s).sin().powi(2)
        } else {
            0.0
        };
        let load = if self.now_us < self.load.1 { self.load.0 } else { 0.0 };
        let wanted = self.commanded * (1.0 + part * (std::f64::consts::TAU * hz * now_s).sin() - dips - load);
        let rate = if self.commanded == 0.0 { self.settings.coasting } else { self.settings.acceleration } / 60.0 * s;
        self.speed += (wanted - self.speed).clamp(-rate, rate);
    }
}

/// A share from −1 to 1 that belongs to this edge of the encoder's disc, alike in every turn.
fn line_share(edge: i64, counts: i64) -> f64 {
    let hash = (edge.rem_euclid(counts) as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32;
    hash as f64 / f64::from(1u32 << 31) - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turning(settings: SpindleSimulation, direction: i32) -> SpindlePlant {
        let mut plant = SpindlePlant::new(settings);
        let mut outputs = [0; channel::COUNT];
        (outputs[usize::from(channel::SPINDLE)], outputs[usize::from(channel::SPEED)]) = (direction, 1_200_000);
        plant.outputs(&outputs);
        plant
    }

    #[test]
    fn it_spins_up_turns_and_coasts() {
        let mut plant = turning(SpindleSimulation { counts_per_turn: 400, ..SpindleSimulation::default() }, -1);
        for ms in 1..=200 {
            plant.advance(ms * 1000);
        }
        assert!((plant.speed_rpm() + 600.0).abs() < 1.0, "{}", plant.speed_rpm());
        for ms in 201..=1000 {
            plant.advance(ms * 1000);
        }
        assert!((plant.speed_rpm() + 1200.0).abs() < 1e-6);
        plant.outputs(&[0; channel::COUNT]);
        for ms in 1001..=1400 {
            plant.advance(ms * 1000);
        }
        assert!((plant.speed_rpm() + 600.0).abs() < 1.0, "{}", plant.speed_rpm());
    }

    #[test]
    fn the_encoder_shows_the_angle_with_the_moment_of_the_edge_and_the_index_once_a_turn() {
        let settings = SpindleSimulation { counts_per_turn: 400, acceleration: 1e9, ..SpindleSimulation::default() };
        let mut plant = turning(settings, 1);
        let (mut indices, mut last) = (0, None);
        for ms in 1..=1000 {
            let (angle, speed) = (plant.angle(), 20.0);
            let reading = plant.advance(ms * 1000);
            if ms > 2 {
                // the period before the last: its end is where the last one began
                let sample = reading.samples[0];
                let at_edge = angle - (1.0 - f64::from(sample.edge) / 65_536.0) * 0.001 * speed;
                assert!((at_edge * 400.0 - f64::from(sample.counter)).abs() < 0.01, "{ms}");
                assert!(last.is_none_or(|last| (7..=9).contains(&(sample.counter - last))));
                last = Some(sample.counter);
            }
            if let Some(index) = reading.index {
                assert_eq!(index % 400, 0);
                indices += 1;
            }
        }
        assert_eq!(indices, 20);
    }

    #[test]
    fn faults_show() {
        let settings = SpindleSimulation { counts_per_turn: 100, acceleration: 1e9, ..SpindleSimulation::default() };
        let mut plant = turning(SpindleSimulation { is_inverted: true, ..settings }, 1);
        (1..=9).for_each(|ms| {
            plant.advance(ms * 1000);
        });
        let before = plant.advance(10_000).samples[0].counter as i16;
        plant.add_wrong_counts(-5);
        plant.advance(11_000);
        let after = plant.advance(12_000).samples[0].counter as i16;
        assert_eq!(after - before, -4 - 5, "it counts down, and is wrong by five counts");
        plant.kill_encoder();
        let dead = [plant.advance(13_000), plant.advance(14_000), plant.advance(15_000)];
        assert_eq!(dead[1].samples[0].counter, dead[2].samples[0].counter);
        plant.set_stalled(true);
        plant.advance(16_000);
        assert_eq!(plant.speed_rpm(), 0.0);
    }
}
