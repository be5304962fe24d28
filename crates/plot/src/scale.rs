//! Scales from a quantity to pixels, and the round values at which an axis is marked.

/// Linear scale: two values and their pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scale {
    pub(crate) low: f64,
    pub(crate) high: f64,
    pub(crate) low_px: f32,
    pub(crate) high_px: f32,
}

impl Scale {
    /// Pixel of a value.
    pub(crate) fn px(&self, value: f64) -> f32 {
        let share = (value - self.low) / (self.high - self.low);
        self.low_px + (self.high_px - self.low_px) * share as f32
    }

    /// Marks of this scale, no closer than `gap_px` pixels.
    pub(crate) fn ticks(&self, gap_px: f32) -> Ticks {
        Ticks::within(self.low, self.high, f64::from((self.high_px - self.low_px).abs() / gap_px))
    }
}

/// Marks at multiples of 1, 2 or 5 times a power of ten.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Ticks {
    pub(crate) values: Vec<f64>,
    decimals: usize,
}

/// Maximum number of marks.
const MAX_MARKS: f64 = 200.0;

impl Ticks {
    /// Marks from `low` to `high`, at most `most` and one more.
    pub(crate) fn within(low: f64, high: f64, most: f64) -> Self {
        let step = round_up((high - low) / most.clamp(1.0, MAX_MARKS));
        let first = (low / step - 1e-9).ceil();
        let last = (high / step + 1e-9).floor();
        // No multiple of the step may lie within.
        let count = (last - first + 1.0).clamp(0.0, 2.0 * MAX_MARKS) as u32;
        let values = (0..count).map(|index| (first + f64::from(index)) * step).collect();
        Self { values, decimals: decimals(step) }
    }

    /// Number of a mark, with as many decimals as the step needs.
    pub(crate) fn label(&self, value: f64) -> String {
        fixed(value, self.decimals)
    }
}

/// Formats a number with this many decimals, never −0.
pub(crate) fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    if text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.')) {
        text.replace('-', "")
    } else {
        text.replace('-', "−")
    }
}

/// Formats a number with at most this many decimals and without trailing zeros.
pub(crate) fn short(value: f64, decimals: usize) -> String {
    let text = fixed(value, decimals);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Smallest of 1, 2, 5 times a power of ten that is not smaller than `value`.
pub(crate) fn round_up(value: f64) -> f64 {
    if !(value.is_finite() && value > 1e-12) {
        return 1e-12;
    }
    let power = 10_f64.powf(value.log10().floor());
    [1.0, 2.0, 5.0, 10.0]
        .map(|digit| digit * power)
        .into_iter()
        .find(|step| *step >= value * (1.0 - 1e-9))
        .unwrap_or(value)
}

/// Number of decimals that multiples of a step need.
pub(crate) fn decimals(step: f64) -> usize {
    (-(step.log10() + 1e-9).floor()).clamp(0.0, 6.0) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn marks_are_round_and_their_labels_short() {
        let labels = |low, high, most| {
            let ticks = Ticks::within(low, high, most);
            ticks.values.iter().map(|&value| ticks.label(value)).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(labels(-0.4, 1.0, 7.0), "−0.4 −0.2 0.0 0.2 0.4 0.6 0.8 1.0");
        assert_eq!(labels(0.0, 100.0, 4.0), "0 50 100");
        assert_eq!(labels(-20_000.0, 20_000.0, 5.0), "−20000 −10000 0 10000 20000");
        assert_eq!(labels(0.013, 0.021, 5.0), "0.014 0.016 0.018 0.020");
    }

    #[test]
    fn no_zero_is_negative() {
        assert_eq!([fixed(-0.001, 2), fixed(-0.01, 2), fixed(0.0, 0)], ["0.00", "−0.01", "0"]);
        assert_eq!(
            [short(-0.0001, 3), short(120.0, 3), short(-1.25, 3), short(100.0, 0)],
            ["0", "120", "−1.25", "100"]
        );
    }

    proptest! {
        #[test]
        fn marks_lie_within_and_are_never_too_many(low in -1e6..1e6_f64, length in 1e-6..1e6_f64,
            most in 1.0..50.0_f64) {
            let ticks = Ticks::within(low, low + length, most);
            prop_assert!(ticks.values.len() as f64 <= most + 1.0);
            let slack = length * 1e-6;
            prop_assert!(ticks.values.iter().all(|&value| value >= low - slack && value <= low + length + slack));
        }
    }
}
