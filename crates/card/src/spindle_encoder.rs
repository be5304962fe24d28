//! The encoder of the spindle: counts, index, speed, and the angle that is foreseen (SPN-2 … SPN-4).
//!
//! Counts are taken from a counter that wraps, with the moment of its last edge. The angle ahead is a parabola through
//! the edges of the last 12 ms, or of 8 ms where counts are fine, by least squares in integers; near standstill,
//! through the last five since it rested.
//!
//! Invariant: the count never jumps: what cannot be a step of the counter, or an index at another count than a whole
//! number of turns, is an error, and the angle is not used from then on.

use retrace_core::gear::{UNITS_PER_COUNT, extended_count};

/// Maximum number of samples of the counter in a control period.
pub const MAX_ENCODER_SAMPLES: usize = 10;

/// A sample of the encoder's counter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EncoderSample {
    /// The counter; it runs freely and wraps.
    pub counter: u16,
    /// Moment of its last edge, as a part of the control period in units of 2⁻¹⁶. Ignored where the counter has not
    /// changed since the sample before.
    pub edge: u16,
}

/// What a card has read from the spindle's encoder in a control period: at least one sample a millisecond.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EncoderReading {
    /// The samples, in the order of time; the first `count` are valid.
    pub samples: [EncoderSample; MAX_ENCODER_SAMPLES],
    /// Number of valid samples.
    pub count: u8,
    /// The counter where the index was seen last in the period.
    pub index: Option<u16>,
    /// Whether A and B changed at once.
    pub is_faulty: bool,
}

/// Edges that are kept.
const EDGES: usize = 16;
/// Edges of this age count for the angle ahead, µs.
const FIT_US: i64 = 12_000;
/// Where the spindle turns by [`FINE_COUNTS`] meanwhile, edges of this age, µs: they follow a change of the speed more
/// closely, and an edge that is off by a tenth of a count matters little.
const FINE_FIT_US: i64 = 8_000;
const FINE_COUNTS: i64 = 128;
/// Where too few for a parabola are as young, so many count, up to the age of rest.
const PARABOLA_EDGES: usize = 5;
/// Where too few are as young, older ones count up to this age, µs.
const OLDEST_US: i64 = 250_000;
/// Without an edge for this time the next one may be late, µs.
const LATE_US: i64 = 200;
/// Without an edge for this time the spindle is taken to rest, µs.
const REST_US: i64 = 60_000;

/// An edge, at a time in µs since the encoder was configured.
#[derive(Clone, Copy, Debug, Default)]
struct Edge {
    at_us: i64,
    count: i64,
}

/// State of the encoder of a spindle.
#[derive(Clone, Debug)]
pub struct SpindleEncoder {
    counts_per_turn: i64,
    is_inverted: bool,
    period_us: i64,
    highest_counts_per_s: i64,
    /// End of the last period, µs.
    now_us: i64,
    /// Count of the last sample; `None` before the first.
    count: Option<i64>,
    edges: [Edge; EDGES],
    /// Number of edges that are held; the newest is the last.
    held: usize,
    /// Count of the first index, and of the last.
    index: Option<[i64; 2]>,
}

/// The encoder lost counts, or changed by more than its counter can show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EncoderError;

impl core::fmt::Display for EncoderError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("the counts of the encoder cannot be trusted")
    }
}

impl core::error::Error for EncoderError {}

impl SpindleEncoder {
    /// Encoder with `counts_per_turn` counts in a turn, up to `highest_speed` thousandths of a revolution per minute,
    /// read once in each control period of `period_us`.
    #[must_use]
    pub const fn new(counts_per_turn: u32, is_inverted: bool, highest_speed: u32, period_us: u32) -> Self {
        Self {
            counts_per_turn: counts_per_turn as i64,
            is_inverted,
            period_us: period_us as i64,
            highest_counts_per_s: highest_speed as i64 * counts_per_turn as i64 / 60_000 + 1,
            now_us: 0,
            count: None,
            edges: [Edge { at_us: 0, count: 0 }; EDGES],
            held: 0,
            index: None,
        }
    }

    /// Reads what was sampled in a control period.
    ///
    /// # Errors
    /// The counts cannot be trusted any more.
    pub fn read(&mut self, reading: &EncoderReading) -> Result<(), EncoderError> {
        let begins_us = self.now_us;
        self.now_us += self.period_us;
        for sample in reading.samples.iter().take(usize::from(reading.count)) {
            let Some(before) = self.count else {
                self.count = Some(self.signed(i64::from(sample.counter)));
                continue;
            };
            let count = self.extended(before, sample.counter)?;
            if count != before {
                let at_us = begins_us + ((i64::from(sample.edge) * self.period_us) >> 16);
                self.count = Some(count);
                self.push(Edge { at_us, count: self.edge_of(before, count) });
            }
        }
        if reading.is_faulty {
            return Err(EncoderError);
        }
        reading.index.map_or(Ok(()), |counter| self.read_index(counter))?;
        match (self.count, self.index) {
            // The index must be seen within 1.2 turns.
            (Some(count), Some([_, last])) if (count - last).abs() * 5 > self.counts_per_turn * 6 => Err(EncoderError),
            _ => Ok(()),
        }
    }

    fn signed(&self, count: i64) -> i64 {
        if self.is_inverted { -count } else { count }
    }

    fn extended(&self, near: i64, counter: u16) -> Result<i64, EncoderError> {
        extended_count(self.signed(near), counter).map(|count| self.signed(count)).ok_or(EncoderError)
    }

    /// The angle, in counts, of the edge at which the count became `count`. A count is shown from its angle on up to
    /// that of the next one, so that the counter passes the angle of the count before where it counts down.
    fn edge_of(&self, before: i64, count: i64) -> i64 {
        match (count > before, self.is_inverted) {
            (true, false) | (false, true) => count,
            (false, false) => count + 1,
            (true, true) => count - 1,
        }
    }

    fn push(&mut self, edge: Edge) {
        if self.is_first_after_rest(edge) {
            self.held = 0;
        }
        if self.held == EDGES {
            self.edges.rotate_left(1);
            self.held -= 1;
        }
        self.edges[self.held] = edge;
        self.held += 1;
    }

    /// Whether the spindle was at rest since the edge before: the count took long, or three times as long as the one
    /// before it, more than where it slows down evenly (1 + √2 times).
    fn is_first_after_rest(&self, edge: Edge) -> bool {
        let Some([before, last]) = self.edges[..self.held].last_chunk() else { return false };
        let (us, us_before) = (edge.at_us - last.at_us, last.at_us - before.at_us);
        let (counts, counts_before) = ((edge.count - last.count).abs(), (last.count - before.count).abs());
        us > REST_US || us * counts_before > 3 * us_before * counts
    }

    /// The first index is the zero of the angle. Every later one has to be a whole number of turns from it.
    fn read_index(&mut self, counter: u16) -> Result<(), EncoderError> {
        let Some(count) = self.count else { return Ok(()) };
        let at = self.extended(count, counter)?;
        let zero = self.index.map_or(at, |[zero, _]| zero);
        let off = (at - zero + self.counts_per_turn / 2).rem_euclid(self.counts_per_turn) - self.counts_per_turn / 2;
        self.index = Some([zero, at]);
        // 2 % of a turn are 2 counts at 100 counts a turn; below them, one count.
        let tolerance = if self.counts_per_turn < 100 { (self.counts_per_turn / 50).max(1) } else { 2 };
        if off.abs() > tolerance { Err(EncoderError) } else { Ok(()) }
    }

    /// Angle of the first index, in units of [`UNITS_PER_COUNT`]; `None` before it was seen.
    #[must_use]
    pub fn zero_angle(&self) -> Option<i64> {
        self.index.map(|[zero, _]| zero * UNITS_PER_COUNT)
    }

    /// Count of the last sample; 0 before the first.
    #[must_use]
    pub fn count(&self) -> i64 {
        self.count.unwrap_or(0)
    }

    /// Microseconds since the last edge.
    #[must_use]
    pub fn silent_us(&self) -> i64 {
        if self.held == 0 { self.now_us } else { self.now_us - self.edges[self.held - 1].at_us }
    }

    /// The edges that count now, oldest first: those of the last 12 ms, or 8 ms, and older ones where these are too few
    /// for a parabola.
    fn recent_edges(&self) -> &[Edge] {
        let edges = &self.edges[..self.held];
        let from = |age_us: i64| edges.partition_point(|edge| self.now_us - edge.at_us > age_us);
        let fine = from(FINE_FIT_US);
        let is_fine = edges[fine..].first().is_some_and(|edge| (edge.count - self.count()).abs() >= FINE_COUNTS);
        let first = if is_fine { fine } else { from(FIT_US) };
        &edges[first.min(self.held.saturating_sub(PARABOLA_EDGES)).max(from(OLDEST_US))..]
    }

    /// Measured speed in thousandths of a revolution per minute.
    #[must_use]
    pub fn speed(&self) -> i32 {
        let edges = self.recent_edges();
        let [Some(first), Some(last)] = [edges.first(), edges.last()] else { return 0 };
        let (counts, us) = (last.count - first.count, last.at_us - first.at_us);
        if us <= 0 || self.silent_us() > OLDEST_US {
            return 0;
        }
        // Without an edge since, the spindle has turned by less than a count.
        let (counts, us) =
            if counts.abs() * self.silent_us() > us { (counts.signum(), self.silent_us()) } else { (counts, us) };
        (counts * 60_000_000_000 / (self.counts_per_turn * us)).clamp(-i64::from(i32::MAX), i64::from(i32::MAX)) as i32
    }

    /// Angle `ahead_us` after the end of the last period, in units of [`UNITS_PER_COUNT`].
    ///
    /// It is held within a count behind the last one, and a count before what the highest speed reaches. A spindle that
    /// rests is at its count.
    #[must_use]
    pub fn angle_ahead(&self, ahead_us: u32) -> i64 {
        let (count, ahead_us) = (self.count(), i64::from(ahead_us));
        let edges = self.recent_edges();
        if self.silent_us() > REST_US || edges.len() < 2 {
            return count * UNITS_PER_COUNT;
        }
        let by_speed = self.highest_counts_per_s * (ahead_us + self.silent_us()) / 1_000_000;
        let most = (by_speed + 1) * UNITS_PER_COUNT;
        let foreseen = fit(edges, self.now_us, count, ahead_us);
        // In the direction of the motion: at most a count back.
        let is_forward = edges[edges.len() - 1].count >= edges[0].count;
        let foreseen =
            if is_forward { foreseen.clamp(-UNITS_PER_COUNT, most) } else { foreseen.clamp(-most, UNITS_PER_COUNT) };
        // Where the next edge is late, it comes now at the earliest, and the spindle is no faster than that. The
        // moment of an edge is rounded to 1 µs, so that this says nothing about a recent one.
        let silent = self.silent_us();
        let late =
            if silent < LATE_US { most } else { UNITS_PER_COUNT + UNITS_PER_COUNT * 9 * ahead_us / (8 * silent) };
        count * UNITS_PER_COUNT + if is_forward { foreseen.min(late) } else { foreseen.max(-late) }
    }
}

/// Returns the value of the least-squares parabola through the edges, or of the line through two, `ahead_us` after
/// `now_us`, relative to `count`, in units of [`UNITS_PER_COUNT`].
fn fit(edges: &[Edge], now_us: i64, count: i64, ahead_us: i64) -> i64 {
    // Times relative to now, at most 2¹⁸ µs; counts relative to the last one.
    let (mut s, mut y) = ([0i128; 5], [0i128; 3]);
    for edge in edges {
        let (t, value) = (i128::from(edge.at_us - now_us), i128::from(edge.count - count));
        let mut power = 1;
        for (k, sum) in s.iter_mut().enumerate() {
            *sum += power;
            if let Some(sum) = y.get_mut(k) {
                *sum += power * value;
            }
            power *= t;
        }
    }
    let (ahead, units) = (i128::from(ahead_us), i128::from(UNITS_PER_COUNT));
    let line = s[0] * s[2] - s[1] * s[1];
    let parabola =
        s[0] * (s[2] * s[4] - s[3] * s[3]) - s[1] * (s[1] * s[4] - s[2] * s[3]) + s[2] * (s[1] * s[3] - s[2] * s[2]);
    let is_long = edges.last().zip(edges.first()).is_some_and(|(last, first)| last.at_us - first.at_us > REST_US);
    if edges.len() < 4 || parabola <= 0 || is_long {
        if line <= 0 {
            return 0;
        }
        let (at, slope) = (y[0] * s[2] - y[1] * s[1], s[0] * y[1] - s[1] * y[0]);
        return rounded((at + slope * ahead) * units, line);
    }
    let at =
        y[0] * (s[2] * s[4] - s[3] * s[3]) - s[1] * (y[1] * s[4] - s[3] * y[2]) + s[2] * (y[1] * s[3] - s[2] * y[2]);
    let slope =
        s[0] * (y[1] * s[4] - s[3] * y[2]) - y[0] * (s[1] * s[4] - s[2] * s[3]) + s[2] * (s[1] * y[2] - y[1] * s[2]);
    let bend =
        s[0] * (s[2] * y[2] - y[1] * s[3]) - s[1] * (s[1] * y[2] - y[1] * s[2]) + y[0] * (s[1] * s[3] - s[2] * s[2]);
    // A spindle that slows down comes to rest; what turns it back is not foreseen.
    let last = edges.last().map_or(0, |edge| i128::from(edge.at_us - now_us));
    let rests = if bend == 0 { ahead } else { -slope / (2 * bend) };
    let ahead = if rests >= last { ahead.min(rests) } else { ahead };
    rounded((at + slope * ahead + bend * ahead * ahead) * units, parabola)
}

fn rounded(dividend: i128, divisor: i128) -> i64 {
    let quotient = (dividend + divisor / 2).div_euclid(divisor);
    quotient.clamp(-(1 << 50), 1 << 50) as i64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Samples once a millisecond of a spindle whose angle in turns at a time in µs is given.
    fn read(
        encoder: &mut SpindleEncoder,
        angle: impl Fn(f64) -> f64,
        counts: u32,
        periods: u32,
    ) -> Result<(), EncoderError> {
        let period_us = encoder.period_us as f64;
        for _ in 0..periods {
            let begins = encoder.now_us as f64;
            let mut reading = EncoderReading::default();
            let samples = (encoder.period_us / 1000).max(1);
            for n in 0..samples {
                let end = begins + period_us * (n + 1) as f64 / samples as f64;
                let count = (angle(end) * f64::from(counts)).floor();
                // The edge by bisection, for a spindle that turns forward.
                let (mut low, mut high) = (end - period_us / samples as f64, end);
                for _ in 0..40 {
                    let middle = f64::midpoint(low, high);
                    if angle(middle) * f64::from(counts) < count { low = middle } else { high = middle }
                }
                let edge = ((high - begins) / period_us * 65_536.0) as u16;
                reading.samples[n as usize] = EncoderSample { counter: count as i64 as u16, edge };
                reading.count += 1;
            }
            encoder.read(&reading)?;
        }
        Ok(())
    }

    /// 1000 rpm ± 10 % at 1 Hz.
    fn swinging(us: f64) -> f64 {
        let (s, turn) = (us / 1e6, std::f64::consts::TAU);
        1.0 + 1000.0 / 60.0 * (s - 0.1 * (turn * s).cos() / turn)
    }

    #[test]
    fn the_angle_two_periods_ahead_errs_by_a_few_thousandths_of_a_turn_at_most() {
        for (period_us, counts, most) in
            [(1000, 400, 0.001), (1000, 4096, 0.001), (1000, 100, 0.002), (2000, 400, 0.0015), (5000, 400, 0.003)]
        {
            let mut encoder = SpindleEncoder::new(counts, false, 3_000_000, period_us);
            let mut worst = 0.0f64;
            for n in 0..2_000_000 / period_us {
                read(&mut encoder, swinging, counts, 1).expect("no error");
                if n > 50 {
                    let foreseen = encoder.angle_ahead(2 * period_us) as f64 / (256.0 * f64::from(counts));
                    let truth = swinging((encoder.now_us + 2 * i64::from(period_us)) as f64);
                    worst = worst.max((foreseen - truth).abs());
                }
            }
            assert!(worst < most, "{period_us} {counts}: {worst}");
        }
    }

    #[test]
    fn the_speed_is_that_of_the_spindle_and_zero_at_rest() {
        let mut encoder = SpindleEncoder::new(400, false, 3_000_000, 1000);
        read(&mut encoder, |us| us / 1e6 * 10.0, 400, 100).expect("no error");
        assert!((encoder.speed() - 600_000).abs() < 600, "{}", encoder.speed());
        let stopped = encoder.now_us as f64 / 1e6 * 10.0;
        read(&mut encoder, |_| stopped, 400, 100).expect("no error");
        assert!(encoder.speed() < 2000 && encoder.angle_ahead(2000) == encoder.count() * 256);
        read(&mut encoder, |_| stopped, 400, 200).expect("no error");
        assert_eq!(encoder.speed(), 0);
    }

    #[test]
    fn an_index_elsewhere_or_none_is_an_error() {
        let reading = |counter: u16, index: Option<u16>| EncoderReading {
            samples: [EncoderSample { counter, edge: 0 }; MAX_ENCODER_SAMPLES],
            count: 1,
            index,
            is_faulty: false,
        };
        let encoder = || {
            let mut encoder = SpindleEncoder::new(400, false, 3_000_000, 1000);
            let first = [(0, None), (50, Some(40))];
            first.into_iter().try_for_each(|(counter, index)| encoder.read(&reading(counter, index))).expect("good");
            assert_eq!(encoder.zero_angle(), Some(40 * 256));
            encoder
        };
        let ends = |steps: &[(u16, Option<u16>)]| {
            let mut encoder = encoder();
            steps.iter().try_for_each(|&(counter, index)| encoder.read(&reading(counter, index)))
        };
        assert_eq!(ends(&[(300, None), (442, Some(441))]), Ok(()));
        assert_eq!(ends(&[(300, None), (446, Some(443))]), Err(EncoderError), "three counts lost");
        assert_eq!(ends(&[(300, None), (520, None)]), Ok(()));
        assert_eq!(ends(&[(300, None), (521, None)]), Err(EncoderError), "no index for 1.2 turns");
        assert_eq!(ends(&[(65_000, None), (65_176, Some(65_176)), (64_700, None)]), Err(EncoderError), "backward");
        assert_eq!(ends(&[(30_000, None)]), Err(EncoderError), "too large a step");
    }

    proptest! {
        /// Whatever is read, nothing overflows, and the angle stays within its bounds.
        #[test]
        fn no_reading_makes_the_angle_jump(
            samples in prop::collection::vec((any::<u16>(), -3000i32..3000, any::<u16>()), 1..200),
            counts in 4u32..1 << 17,
            period_us in prop_oneof![Just(1000u32), Just(200), Just(5000)],
        ) {
            let mut encoder = SpindleEncoder::new(counts, false, 100_000_000, period_us);
            let mut counter = 0u16;
            for (edge, by, skip) in samples {
                counter = counter.wrapping_add_signed(by as i16);
                let sample = EncoderSample { counter, edge };
                let count = u8::from(skip % 4 != 0);
                let samples = [sample; MAX_ENCODER_SAMPLES];
                let reading = EncoderReading { samples, count, ..EncoderReading::default() };
                encoder.read(&reading).expect("no index");
                let angle = encoder.angle_ahead(2 * period_us) - encoder.count() * UNITS_PER_COUNT;
                let us = 2 * i64::from(period_us) + encoder.silent_us();
                let most = (encoder.highest_counts_per_s * us / 1_000_000 + 1) * 256;
                prop_assert!(angle.abs() <= most);
                let _ = encoder.speed();
            }
        }
    }
}
