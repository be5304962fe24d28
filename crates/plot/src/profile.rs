//! Velocity, acceleration and jerk over time, from positions by finite differences.
//!
//! Invariant: every curve of one profile starts at the same time and has the same period.

/// Track of one axis: its positions at equal intervals, and its limits.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisTrack {
    /// Name of the axis.
    pub name: String,
    /// Position in mm at the end of every period.
    pub positions_mm: Vec<f64>,
    /// Limits in mm/s, mm/s² and mm/s³.
    pub limits: Derivatives<f64>,
}

/// A value for each of velocity, acceleration and jerk.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Derivatives<T> {
    /// Value for velocity, in mm/s.
    pub velocity: T,
    /// Value for acceleration, in mm/s².
    pub acceleration: T,
    /// Value for jerk, in mm/s³.
    pub jerk: T,
}

/// Data of a drawing over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Title: the program's name.
    pub title: String,
    /// Control period in seconds.
    pub period_s: f64,
    /// Number of periods over which differences are taken: 1 for planned positions; 16 or more for whole pulses, a
    /// single one of which would read as an enormous jerk.
    pub stride_periods: usize,
    /// Axes, all with the same number of positions.
    pub axes: Vec<AxisTrack>,
    /// Intervals in seconds in which motion was retraced.
    pub retraced_s: Vec<[f64; 2]>,
    /// Interval in seconds that is drawn; `None` for all.
    pub shown_s: Option<[f64; 2]>,
}

/// Curve over time: its first time, and a value per period.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Curve {
    pub(crate) start_s: f64,
    pub(crate) values: Vec<f64>,
}

impl Curve {
    /// Part of the curve within this interval in seconds, with at most one period beyond either end.
    fn within(self, [from_s, to_s]: [f64; 2], period_s: f64) -> Self {
        let index = |at_s: f64| ((at_s - self.start_s) / period_s).max(0.0);
        let first = (index(from_s).floor() as usize).min(self.values.len());
        let end = (index(to_s).ceil() as usize).saturating_add(1).clamp(first, self.values.len());
        Self { start_s: self.start_s + first as f64 * period_s, values: self.values[first..end].to_vec() }
    }
}

impl Profile {
    /// Interval in seconds that is drawn.
    pub(crate) fn shown(&self) -> [f64; 2] {
        self.shown_s.unwrap_or([0.0, self.duration_s()])
    }

    /// Drawn part of a curve.
    pub(crate) fn cut(&self, curve: Curve) -> Curve {
        match self.shown_s {
            Some(shown_s) => curve.within(shown_s, self.period_s),
            None => curve,
        }
    }

    /// Derivative of one axis of order 1, 2 or 3, each value in the middle of its window; before the first position and
    /// after the last the axis is at rest.
    pub(crate) fn derivative(&self, axis: &AxisTrack, order: usize) -> Curve {
        let stride = self.stride_periods.max(1);
        let window = order * stride;
        let half = window / 2;
        let span = (stride as f64 * self.period_s).powi(order as i32);
        let positions = &axis.positions_mm;
        let last = positions.len().saturating_sub(1);
        let values = (half..positions.len() + half).map(|end| {
            let p = |back: usize| positions[end.saturating_sub(back * stride).min(last)];
            let difference = match order {
                1 => p(0) - p(1),
                2 => p(0) - 2.0 * p(1) + p(2),
                _ => p(0) - 3.0 * p(1) + 3.0 * p(2) - p(3),
            };
            difference / span
        });
        Curve { start_s: (half as f64 - window as f64 / 2.0) * self.period_s, values: values.collect() }
    }

    /// Speed along the path, in mm/s.
    pub(crate) fn path_speed(&self) -> Curve {
        let mut speed = Curve { start_s: 0.0, values: Vec::new() };
        for axis in &self.axes {
            let Curve { start_s, values } = self.derivative(axis, 1);
            speed.start_s = start_s;
            speed.values.resize(speed.values.len().max(values.len()), 0.0);
            for (sum, value) in speed.values.iter_mut().zip(values) {
                *sum += value * value;
            }
        }
        speed.values.iter_mut().for_each(|value| *value = value.sqrt());
        speed
    }

    /// Duration of the profile, in seconds.
    pub(crate) fn duration_s(&self) -> f64 {
        let periods = self.axes.iter().map(|axis| axis.positions_mm.len()).max().unwrap_or(0);
        periods.saturating_sub(1) as f64 * self.period_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_derivatives_of_a_cubic_are_exact_and_stand_at_the_right_time() {
        let at = |t: f64| 2.0 + 3.0 * t + 5.0 * t * t + 7.0 * t * t * t;
        let positions_mm: Vec<f64> = (0..200).map(|period| at(f64::from(period) * 0.01)).collect();
        let axis = AxisTrack { name: "X".to_owned(), positions_mm, limits: Derivatives::default() };
        let profile = Profile {
            title: String::new(),
            period_s: 0.01,
            stride_periods: 4,
            axes: vec![axis.clone()],
            retraced_s: Vec::new(),
            shown_s: None,
        };
        let acceleration = profile.derivative(&axis, 2);
        let jerk = profile.derivative(&axis, 3);
        assert_eq!((acceleration.values.len(), jerk.values.len()), (200, 200));
        // Where the window does not reach into the rest before and after.
        for (index, value) in acceleration.values.iter().enumerate().take(196).skip(4) {
            let t = acceleration.start_s + index as f64 * 0.01;
            assert!((value - (10.0 + 42.0 * t)).abs() < 1e-6);
        }
        assert!(jerk.values[6..194].iter().all(|value| (value - 42.0).abs() < 1e-4));
        assert!((profile.path_speed().values[2] - 3.0 - 10.0 * 0.02).abs() < 0.02);
        let middle = Profile { shown_s: Some([0.5, 0.7]), ..profile.clone() };
        let cut = middle.cut(middle.derivative(&axis, 2));
        assert!((cut.start_s - 0.5).abs() < 0.011 && (20..=23).contains(&cut.values.len()), "{}", cut.values.len());
        assert!((cut.values[0] - (10.0 + 42.0 * cut.start_s)).abs() < 1e-6, "not as if it stood before");
        let odd = Profile { stride_periods: 1, ..profile.clone() };
        let velocity = odd.derivative(&axis, 1);
        let at_first = velocity.start_s + 0.01;
        assert!((velocity.values[1] - (3.0 + 10.0 * at_first + 21.0 * at_first * at_first)).abs() < 1e-3);
        assert!((profile.duration_s() - 1.99).abs() < 1e-9);
    }
}
