//! The monitor of the emitted increments: checks that every axis keeps its velocity, acceleration and jerk limits.
//!
//! Invariant: only what was actually emitted is checked, by finite differences of the positions in whole pulses over
//! windows that begin at every period; the plan is never consulted. A push allocates nothing and takes constant time.
//!
//! Method: positions are compared over strides of n = 1, 2, 4 … 64 periods of T seconds. The k-th difference, k = 1, 2,
//! 3, may not exceed limit · (nT)ᵏ plus an allowance for rounding to whole pulses: 1, 2, 4 pulses in windows in which
//! the rate is always −1, 0 or +1, and 2e, 4e, 8e pulses in all others, where e = 1 + A·T²/8 (in pulses, A the axis'
//! acceleration) also covers the chord of a record that the cursor splits. Where the rate changes within a window of
//! the third difference, the jerk limit is twice the axis limit (REV, rate law).
//!
//! The axes are at rest before the first period, and after the last where that is known; windows that reach into that
//! rest are checked too. Windows over periods that were not measured are not.

use retrace_core::Rate;

/// Limits of one axis, from the machine file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MonitorLimits {
    /// Pulses per millimetre.
    pub pulses_per_mm: f64,
    /// Maximum velocity, mm/s.
    pub velocity_mm_s: f64,
    /// Maximum acceleration, mm/s².
    pub acceleration_mm_s2: f64,
    /// Maximum jerk, mm/s³.
    pub jerk_mm_s3: f64,
}

/// Largest derivatives observed on one axis beyond the allowance for rounding, over strides of 8 … 64 periods. (Over
/// one period a single pulse would read as an enormous jerk.) Never below 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AxisExtremes {
    /// Largest velocity, mm/s.
    pub velocity_mm_s: f64,
    /// Largest acceleration, mm/s².
    pub acceleration_mm_s2: f64,
    /// Largest jerk, mm/s³.
    pub jerk_mm_s3: f64,
}

/// The first window that violated a limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LimitViolation {
    /// The period that closed the window, from 0.
    pub period: u64,
    /// Index of the axis, in the order of the increments.
    pub axis: usize,
    /// Order of the limit: 1 velocity, 2 acceleration, 3 jerk.
    pub order: u8,
    /// Stride in periods.
    pub stride: u16,
    /// Observed difference, in pulses.
    pub pulses: u32,
    /// Maximum permitted difference, in pulses.
    pub allowed_pulses: u32,
}

/// Result of the limit monitor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LimitReport<const A: usize> {
    /// Number of windows that violated a limit. Each axis, stride and order counts separately.
    pub violations: u64,
    /// Largest derivatives of each axis.
    pub extremes: [AxisExtremes; A],
    /// The first window that violated a limit.
    pub first: Option<LimitViolation>,
}

/// Strides are 2⁰ … 2⁶ periods.
const STRIDES: usize = 7;
/// Velocity, acceleration, jerk.
const ORDERS: usize = 3;
/// Length of the longest window in periods: the third difference over the longest stride.
const MAX_WINDOW: usize = ORDERS << (STRIDES - 1);
/// Number of positions in the ring buffer: a power of two above the longest window.
const RING_SIZE: usize = 256;
/// Shortest stride, as a power of two, that counts for the extremes.
const FIRST_FOR_EXTREMES: usize = 3;
/// Increments are clamped to this, so that no difference overflows. No limit comes near it.
const MAX_INCREMENT: i32 = 1 << 20;

/// Class of a window by its rates, which selects the bounds.
#[derive(Clone, Copy)]
enum RateClass {
    /// Always the same −1, 0 or +1.
    Recorded = 0,
    /// −1, 0 and +1, but not always the same.
    Switched = 1,
    /// Always the same, between whole rates.
    Scaled = 2,
    /// Changing.
    Changing = 3,
}

const RATE_CLASSES: usize = 4;

impl RateClass {
    const fn new(is_whole: bool, is_constant: bool) -> Self {
        match (is_whole, is_constant) {
            (true, true) => Self::Recorded,
            (true, false) => Self::Switched,
            (false, true) => Self::Scaled,
            (false, false) => Self::Changing,
        }
    }
}

/// Values for every stride, order, rate class and axis.
type Table<const A: usize> = [[[[i32; A]; RATE_CLASSES]; ORDERS]; STRIDES];

/// The streaming monitor for `A` axes: one [`push`](LimitMonitor::push) per period, then
/// [`finish`](LimitMonitor::finish).
#[derive(Clone, Debug)]
pub struct LimitMonitor<const A: usize> {
    axes: [MonitorLimits; A],
    period_s: f64,
    /// Positions in pulses, wrapping; period `t` ends at cell `t + 1`.
    positions: [[i32; A]; RING_SIZE],
    /// Maximum permitted differences in pulses.
    bounds: Table<A>,
    /// The same for windows with a probing move in them.
    probing_bounds: Table<A>,
    /// Number of periods since the last one of a probing move.
    since_probing: usize,
    /// Largest observed differences in pulses.
    largest: Table<A>,
    periods: u64,
    last_rate: Rate,
    /// Number of periods for which the rate has been whole (−1, 0, +1) and constant.
    whole_for: usize,
    constant_for: usize,
    /// Number of periods for which every increment has been measured.
    measured_for: usize,
    violations: u64,
    first: Option<LimitViolation>,
}

impl<const A: usize> LimitMonitor<A> {
    /// Creates a monitor of these axes for a control period in seconds. Every value must be positive and finite.
    #[must_use]
    pub fn new(axes: &[MonitorLimits; A], period_s: f64) -> Self {
        Self {
            axes: *axes,
            period_s,
            positions: [[0; A]; RING_SIZE],
            bounds: bounds(axes, period_s),
            probing_bounds: bounds(axes, period_s),
            since_probing: MAX_WINDOW,
            largest: [[[[0; A]; RATE_CLASSES]; ORDERS]; STRIDES],
            periods: 0,
            last_rate: Rate::ZERO,
            whole_for: MAX_WINDOW,
            constant_for: MAX_WINDOW,
            measured_for: MAX_WINDOW,
            violations: 0,
            first: None,
        }
    }

    /// Sets the largest jerk of each axis in a probing move, mm/s³.
    #[must_use]
    pub fn with_probing_jerks(mut self, jerks_mm_s3: &[f64; A]) -> Self {
        let axes = std::array::from_fn(|axis| MonitorLimits {
            jerk_mm_s3: self.axes[axis].jerk_mm_s3.max(jerks_mm_s3[axis]),
            ..self.axes[axis]
        });
        self.probing_bounds = bounds(&axes, self.period_s);
        self
    }

    /// Checks one period of a probing move, also of one that is retraced. Windows with it in them may have the jerk of
    /// a probing move.
    pub fn push_probing(&mut self, increments: &[i32; A], rate: Rate) {
        self.since_probing = 0;
        self.check_period(increments, rate);
    }

    /// Checks one period: the pulses that each axis emitted in it, and the rate of play.
    pub fn push(&mut self, increments: &[i32; A], rate: Rate) {
        self.since_probing = (self.since_probing + 1).min(MAX_WINDOW);
        self.check_period(increments, rate);
    }

    fn check_period(&mut self, increments: &[i32; A], rate: Rate) {
        let is_whole = rate == Rate::ZERO || rate.abs() == Rate::ONE;
        self.whole_for = if is_whole { (self.whole_for + 1).min(MAX_WINDOW) } else { 0 };
        // The rest before the first period has no rate of its own.
        let is_constant = rate == self.last_rate || self.periods == 0;
        self.constant_for = if is_constant { (self.constant_for + 1).min(MAX_WINDOW) } else { 1 };
        self.last_rate = rate;
        self.measured_for = (self.measured_for + 1).min(MAX_WINDOW);

        let at = self.periods as usize;
        let before = self.positions[at % RING_SIZE];
        let now: [i32; A] = std::array::from_fn(|axis| {
            before[axis].wrapping_add(increments[axis].clamp(-MAX_INCREMENT, MAX_INCREMENT))
        });
        self.positions[(at + 1) % RING_SIZE] = now;
        for stride in 0..STRIDES {
            self.check_stride(stride, &now);
        }
        self.periods += 1;
    }

    /// Checks the windows of one stride that end with this period.
    #[inline]
    fn check_stride(&mut self, stride: usize, now: &[i32; A]) {
        let periods = 1_usize << stride;
        // Wrapping: only the position in the ring buffer matters, and its size divides 2³².
        let newest = (self.periods as usize).wrapping_add(1);
        let back = |strides: usize| newest.wrapping_sub(strides * periods) % RING_SIZE;
        let (one, two, three) = (&self.positions[back(1)], &self.positions[back(2)], &self.positions[back(3)]);
        let mut differences = [[0_i32; A]; ORDERS];
        for axis in 0..A {
            let newer = now[axis].wrapping_sub(one[axis]);
            let middle = one[axis].wrapping_sub(two[axis]);
            let older = two[axis].wrapping_sub(three[axis]);
            differences[0][axis] = newer;
            differences[1][axis] = newer.wrapping_sub(middle);
            differences[2][axis] = newer.wrapping_sub(middle).wrapping_sub(middle.wrapping_sub(older));
        }
        for (order, difference) in differences.iter().enumerate() {
            let window = (order + 1) * periods;
            if window > self.measured_for {
                break;
            }
            let play = RateClass::new(self.whole_for >= window, self.constant_for >= window) as usize;
            let bounds = if self.since_probing < window { &self.probing_bounds } else { &self.bounds };
            let bounds = &bounds[stride][order][play];
            let largest = &mut self.largest[stride][order][play];
            let mut offences = 0;
            for axis in 0..A {
                let size = difference[axis].wrapping_abs();
                largest[axis] = largest[axis].max(size);
                offences += u64::from(size > bounds[axis]);
            }
            if offences > 0 {
                self.violations += offences;
                if self.first.is_none() {
                    self.first = find_violation(self.periods, stride, order, difference, bounds);
                }
            }
        }
    }

    /// Records that periods are missing before the next one: windows over them are not checked.
    pub fn skip_unmeasured(&mut self) {
        (self.measured_for, self.whole_for, self.constant_for) = (0, 0, 0);
    }

    /// Number of windows that violated a limit so far.
    #[must_use]
    pub const fn violations(&self) -> u64 {
        self.violations
    }

    /// Checks the rest after the last period, and returns the result.
    #[must_use]
    pub fn finish(mut self) -> LimitReport<A> {
        let rate = self.last_rate;
        for _ in 0..MAX_WINDOW {
            self.push(&[0; A], rate);
        }
        self.finish_moving()
    }

    /// Returns the result where the motion after the last period is not known.
    #[must_use]
    pub fn finish_moving(self) -> LimitReport<A> {
        let extremes = std::array::from_fn(|axis| AxisExtremes {
            velocity_mm_s: self.extreme(axis, 0),
            acceleration_mm_s2: self.extreme(axis, 1),
            jerk_mm_s3: self.extreme(axis, 2),
        });
        LimitReport { violations: self.violations, extremes, first: self.first }
    }

    /// Largest derivative of one order on one axis, in mm and seconds.
    fn extreme(&self, axis: usize, order: usize) -> f64 {
        let limits = &self.axes[axis];
        let mut extreme = 0.0_f64;
        for stride in FIRST_FOR_EXTREMES..STRIDES {
            for (play, largest) in self.largest[stride][order].iter().enumerate() {
                let pulses = f64::from(largest[axis]) - allowance(limits, self.period_s, order, is_whole(play));
                let span = span_s(stride, self.period_s).powi(order as i32 + 1);
                extreme = extreme.max(pulses / span / limits.pulses_per_mm);
            }
        }
        extreme
    }
}

/// The violation among these differences, on the first axis that has one.
#[cold]
fn find_violation<const A: usize>(
    period: u64,
    stride: usize,
    order: usize,
    difference: &[i32; A],
    bounds: &[i32; A],
) -> Option<LimitViolation> {
    let axis = (0..A).find(|&axis| difference[axis].wrapping_abs() > bounds[axis])?;
    Some(LimitViolation {
        period,
        axis,
        order: order as u8 + 1,
        stride: 1 << stride,
        pulses: difference[axis].unsigned_abs(),
        allowed_pulses: bounds[axis].unsigned_abs(),
    })
}

const fn is_whole(play: usize) -> bool {
    play == RateClass::Recorded as usize || play == RateClass::Switched as usize
}

/// Length of a stride in seconds.
fn span_s(stride: usize, period_s: f64) -> f64 {
    period_s * f64::from(1_u32 << stride)
}

/// Pulses that rounding to whole pulses may add to a difference.
fn allowance(limits: &MonitorLimits, period_s: f64, order: usize, is_whole: bool) -> f64 {
    let roundings = f64::from(1_u32 << order);
    if is_whole {
        roundings
    } else {
        let chord = limits.acceleration_mm_s2 * limits.pulses_per_mm * period_s * period_s / 8.0;
        2.0 * roundings * (1.0 + chord)
    }
}

/// Maximum whole number of pulses that each rate class permits.
fn bounds<const A: usize>(axes: &[MonitorLimits; A], period_s: f64) -> Table<A> {
    let mut table = [[[[0; A]; RATE_CLASSES]; ORDERS]; STRIDES];
    for (stride, orders) in table.iter_mut().enumerate() {
        for (order, plays) in orders.iter_mut().enumerate() {
            for (play, bounds) in plays.iter_mut().enumerate() {
                for (bound, limits) in bounds.iter_mut().zip(axes) {
                    let changes = play == RateClass::Switched as usize || play == RateClass::Changing as usize;
                    let limit = match order {
                        0 => limits.velocity_mm_s,
                        1 => limits.acceleration_mm_s2,
                        _ if changes => 2.0 * limits.jerk_mm_s3,
                        _ => limits.jerk_mm_s3,
                    };
                    let reach = limit * span_s(stride, period_s).powi(order as i32 + 1) * limits.pulses_per_mm;
                    let pulses = reach + allowance(limits, period_s, order, is_whole(play));
                    // A product that is exact in theory must not become smaller by the rounding of floats.
                    *bound = (pulses + pulses * 1e-12).floor() as i32;
                }
            }
        }
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PERIOD_S: f64 = 0.001;
    const AXIS: MonitorLimits =
        MonitorLimits { pulses_per_mm: 1000.0, velocity_mm_s: 100.0, acceleration_mm_s2: 1000.0, jerk_mm_s3: 20_000.0 };

    fn checked(increments: impl IntoIterator<Item = i32>) -> LimitReport<1> {
        let mut monitor = LimitMonitor::new(&[AXIS], PERIOD_S);
        increments.into_iter().for_each(|increment| monitor.push(&[increment], Rate::ONE));
        monitor.finish()
    }

    /// An acceleration that begins and ends at once is within the jerk of a probing move alone.
    #[test]
    fn the_jerk_of_a_probing_move_counts_in_its_windows_alone() {
        let steep = |is_probing: fn(usize) -> bool| {
            let mut monitor = LimitMonitor::new(&[AXIS], PERIOD_S).with_probing_jerks(&[1e6]);
            // 1000 mm/s² at once, for 10 ms, and off again: within the acceleration.
            for period in 0..600_usize {
                let increment = match period {
                    300..310 => period - 299,
                    310..320 => 320 - period,
                    _ => 0,
                };
                let increment = [increment as i32];
                if is_probing(period) {
                    monitor.push_probing(&increment, Rate::ONE);
                } else {
                    monitor.push(&increment, Rate::ONE);
                }
            }
            monitor.finish().violations
        };
        assert!(steep(|_| false) > 0);
        assert_eq!(steep(|period| (290..330).contains(&period)), 0);
        // Long before and long behind, the axis' own jerk counts.
        assert!(steep(|period| !(100..=500).contains(&period)) > 0);
        assert!(steep(|period| period == 319) > 0, "the window from rest into the first ramp has no probing period");
    }

    #[test]
    fn what_was_not_measured_is_not_judged() {
        // 50 mm/s with an unknown end: no rest is assumed.
        let ramp: Vec<i32> = (0..50).chain(std::iter::repeat_n(50, 300)).collect();
        let of = |skips: bool| {
            let mut monitor = LimitMonitor::new(&[AXIS], PERIOD_S);
            ramp.iter().for_each(|&increment| monitor.push(&[increment], Rate::ONE));
            if skips {
                monitor.skip_unmeasured();
            }
            (0..400).for_each(|_| monitor.push(&[5], Rate::ONE));
            monitor
        };
        let begun = of(true).violations();
        assert!(of(false).violations() > begun, "without the gap the change of velocity is judged");
        assert_eq!(of(true).finish_moving().violations, begun);
        let mut monitor = LimitMonitor::new(&[AXIS], PERIOD_S);
        (0..300).for_each(|_| monitor.push(&[90], Rate::ONE));
        let before = monitor.violations();
        assert_eq!(monitor.clone().finish_moving().violations, before);
        assert!(monitor.finish().violations > before, "a standstill that is known is judged");
    }

    /// Whole pulses of a path given in mm over seconds, as a planner rounds it.
    fn rounded(periods: usize, position_mm: impl Fn(f64) -> f64) -> Vec<i32> {
        let at = |period: usize| (position_mm(period as f64 * PERIOD_S) * AXIS.pulses_per_mm).round() as i32;
        (0..periods).map(|period| at(period + 1) - at(period)).collect()
    }

    /// A jerk-limited move from rest to rest: four equal phases of jerk +j, −j, −j, +j.
    fn move_mm(jerk: f64, phase_s: f64) -> impl Fn(f64) -> f64 {
        move |t: f64| {
            let after = |start: f64, jump: f64| jump * (t - start).max(0.0).powi(3) / 6.0;
            after(0.0, jerk)
                + after(phase_s, -2.0 * jerk)
                + after(3.0 * phase_s, 2.0 * jerk)
                + after(4.0 * phase_s, -jerk)
        }
    }

    #[test]
    fn a_move_at_the_jerk_limit_passes_and_its_extremes_are_just_below_the_limits() {
        let limit_report = checked(rounded(250, move_mm(20_000.0, 0.05)));
        assert_eq!((limit_report.violations, limit_report.first), (0, None));
        let extremes = limit_report.extremes[0];
        assert!((0.9..=1.0).contains(&(extremes.jerk_mm_s3 / 20_000.0)), "{extremes:?}");
        assert!((0.7..=1.0).contains(&(extremes.acceleration_mm_s2 / 1000.0)), "{extremes:?}");
        assert!((0.4..=0.5).contains(&(extremes.velocity_mm_s / 100.0)), "{extremes:?}");
    }

    #[test]
    fn a_move_above_the_jerk_limit_is_caught_by_the_jerk_alone() {
        let limit_report = checked(rounded(250, move_mm(21_500.0, 0.04)));
        assert!(limit_report.violations > 0);
        assert_eq!(limit_report.first.map(|violation| violation.order), Some(3));
        assert!(
            limit_report.extremes[0].jerk_mm_s3 > 20_000.0 && limit_report.extremes[0].acceleration_mm_s2 <= 1000.0
        );
    }

    #[test]
    fn too_high_a_velocity_is_caught() {
        // Up to 1.2 mm/s so gently that neither acceleration nor jerk come near their limits.
        let mut monitor = LimitMonitor::new(&[MonitorLimits { velocity_mm_s: 1.0, ..AXIS }], PERIOD_S);
        let pushed = rounded(4000, |t| if t < 2.0 { 0.3 * t * t } else { 1.2 + 1.2 * (t - 2.0) });
        pushed.iter().for_each(|&increment| monitor.push(&[increment], Rate::ONE));
        let first = monitor.first.expect("the velocity rises to 1.2 of its limit");
        assert_eq!((first.order, first.axis), (1, 0));
        // 1 mm/s is passed after 1.667 s. The mean over 64 periods is surely seen when it is 66 pulses, 1.031 mm/s:
        // 32 periods after 1.719 s.
        assert!((1667..=1751).contains(&first.period), "{first:?}");
    }

    #[test]
    fn too_high_an_acceleration_is_caught() {
        let mut monitor = LimitMonitor::new(&[MonitorLimits { jerk_mm_s3: 1e6, ..AXIS }], PERIOD_S);
        for increment in rounded(80, |t| 0.5 * 1100.0 * t * t) {
            monitor.push(&[increment], Rate::ONE);
        }
        assert_eq!(monitor.first.map(|violation| violation.order), Some(2));
    }

    #[test]
    fn a_stop_from_full_speed_is_caught_though_nothing_follows_it() {
        let ramp = rounded(300, move_mm(20_000.0, 0.05)).into_iter().take(100);
        let mut monitor = LimitMonitor::new(&[AXIS], PERIOD_S);
        ramp.for_each(|increment| monitor.push(&[increment], Rate::ONE));
        assert_eq!(monitor.violations(), 0);
        assert!(monitor.finish().violations > 0);
    }

    #[test]
    fn a_lone_pulse_is_rounding_and_two_in_one_period_are_not() {
        let lone = |size: i32| checked([0; 10].into_iter().chain([size]).chain([0; 10])).violations;
        assert_eq!(lone(1), 0);
        let slow = MonitorLimits { velocity_mm_s: 0.5, acceleration_mm_s2: 1.0, jerk_mm_s3: 1.0, ..AXIS };
        let mut monitor = LimitMonitor::new(&[slow], PERIOD_S);
        monitor.push(&[2], Rate::ONE);
        assert!(monitor.violations() > 0);
    }

    #[test]
    fn twice_the_jerk_is_allowed_while_the_rate_changes_only() {
        let increments = rounded(250, move_mm(36_000.0, 0.025));
        let violations = |rate: &dyn Fn(i64) -> Rate| {
            let mut monitor = LimitMonitor::new(&[AXIS], PERIOD_S);
            for (period, &increment) in increments.iter().enumerate() {
                monitor.push(&[increment], rate(period as i64));
            }
            monitor.finish().violations
        };
        assert_eq!(violations(&|period| Rate::from_units(period << 24)), 0);
        assert!(violations(&|_| Rate::ONE) > 0);
        assert!(violations(&|_| Rate::ONE / 2) > 0);
    }

    #[test]
    fn absurd_increments_are_violations_and_nothing_overflows() {
        let limit_report = checked([i32::MAX, i32::MIN, i32::MAX, i32::MAX, i32::MIN].into_iter().cycle().take(1000));
        assert!(limit_report.violations > 0);
    }

    /// The same rule, calculated from whole arrays in floats.
    fn brute_force(increments: &[[i32; 2]], rates: &[Rate], axes: &[MonitorLimits; 2]) -> (u64, [AxisExtremes; 2]) {
        let rest = MAX_WINDOW;
        let count = increments.len();
        let rate_at = |period: usize| rates[period.saturating_sub(rest).min(count - 1)];
        let mut violations = 0;
        let mut extremes = [[0.0_f64; 3]; 2];
        for (axis, limits) in axes.iter().enumerate() {
            let mut positions = vec![0_i64; rest + 1];
            let mut position = 0;
            for period in 0..count + rest {
                position += increments.get(period).map_or(0, |increment| i64::from(increment[axis]));
                positions.push(position);
            }
            for n in [1_usize, 2, 4, 8, 16, 32, 64] {
                let t = n as f64 * PERIOD_S;
                for end in rest + 1..positions.len() {
                    let p = |back: usize| positions[end - back * n];
                    let differences = [p(0) - p(1), p(0) - 2 * p(1) + p(2), p(0) - 3 * p(1) + 3 * p(2) - p(3)];
                    for k in 1..=3 {
                        // The window before the start takes the first rate.
                        let window: Vec<Rate> = (end - k * n..end).map(|period| rate_at(period.max(rest))).collect();
                        let emitted = &window[window.len().saturating_sub(end - rest)..];
                        let whole = emitted
                            .iter()
                            .all(|&rate| rate.units() % Rate::ONE.units() == 0 && rate.abs() <= Rate::ONE);
                        let changes = window.iter().any(|&rate| rate != window[0]);
                        let e = 1.0 + limits.acceleration_mm_s2 * limits.pulses_per_mm * PERIOD_S * PERIOD_S / 8.0;
                        let allowance = [1.0, 2.0, 4.0][k - 1] * if whole { 1.0 } else { 2.0 * e };
                        let limit = [
                            limits.velocity_mm_s,
                            limits.acceleration_mm_s2,
                            limits.jerk_mm_s3 * if changes { 2.0 } else { 1.0 },
                        ][k - 1];
                        let size = differences[k - 1].abs() as f64;
                        let span = t.powi(k as i32) * limits.pulses_per_mm;
                        violations += u64::from(size > (limit * span + allowance) * (1.0 + 1e-12));
                        if n >= 8 {
                            extremes[axis][k - 1] = extremes[axis][k - 1].max((size - allowance) / span);
                        }
                    }
                }
            }
        }
        let named = |e: [f64; 3]| AxisExtremes { velocity_mm_s: e[0], acceleration_mm_s2: e[1], jerk_mm_s3: e[2] };
        (violations, extremes.map(named))
    }

    fn rates() -> impl Strategy<Value = Rate> {
        prop_oneof![
            6 => Just(Rate::ONE),
            1 => Just(-Rate::ONE),
            1 => Just(Rate::ZERO),
            2 => (-2i64 << 32..=2 << 32).prop_map(Rate::from_units),
            1 => Just(Rate::ONE / 2),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn the_stream_is_judged_as_the_whole_is(
            stretches in prop::collection::vec((1_usize..150, rates(), -120_i32..120, -3_i32..4), 1..6),
        ) {
            let axes = [AXIS, MonitorLimits { pulses_per_mm: 320.0, velocity_mm_s: 40.0, acceleration_mm_s2: 300.0,
                jerk_mm_s3: 4_000.0 }];
            let mut monitor = LimitMonitor::new(&axes, PERIOD_S);
            let (mut increments, mut played) = (Vec::new(), Vec::new());
            for (periods, rate, x, y) in stretches {
                for _ in 0..periods {
                    monitor.push(&[x, y], rate);
                    increments.push([x, y]);
                    played.push(rate);
                }
            }
            let (violations, extremes) = brute_force(&increments, &played, &axes);
            let limit_report = monitor.finish();
            prop_assert_eq!(limit_report.violations, violations);
            prop_assert_eq!(limit_report.first.is_some(), violations > 0);
            for (ours, theirs) in limit_report.extremes.iter().zip(extremes) {
                for (a, b) in [
                    (ours.velocity_mm_s, theirs.velocity_mm_s),
                    (ours.acceleration_mm_s2, theirs.acceleration_mm_s2),
                    (ours.jerk_mm_s3, theirs.jerk_mm_s3),
                ] {
                    prop_assert!((a - b).abs() <= 1e-9 * b.abs(), "{a} {b}");
                }
            }
        }
    }
}
