//! How slowly the rate must change on a given machine (REV, *Rate law*).
//!
//! Invariant: with the averages chosen here, `αA·r² + V·|r′| ≤ A` and `αJ·|r|³ + 3αA·|r·r′| + V·|r″| ≤ 2J` hold on every axis at
//! every rate, whatever targets are asked when. V, the axis' highest velocity, stands for the largest increment
//! that may come; the plan uses the share α = 1 − reserve of A and J.

use retrace_core::rate::Smoothing;

use crate::machine::Axis;

/// Longest average that a card holds, in periods.
const LONGEST: u16 = Smoothing::LONGEST;

/// The shortest averages that keep every axis within its limits. `None` where none fits a card.
///
/// Two averages of one length are within a hundredth of the best pair, and a longer pair is gentler at every rate, so the
/// shortest is found by halving.
#[must_use]
pub fn smoothing(axes: &[Axis], reserve: f64, period_s: f64) -> Option<Smoothing> {
    let legal = |length: u16| keeps_limits(axes, reserve, period_s, length, length);
    let (mut low, mut high) = (0, LONGEST);
    if !legal(high) {
        return None;
    }
    while high - low > 1 {
        let middle = low.midpoint(high);
        if legal(middle) { high = middle } else { low = middle }
    }
    Smoothing::new(high, high)
}

/// Do averages over `first ≥ second` periods keep every axis within its limits?
///
/// For targets between 0 and 1 the fastest change at a rate r is the one that a plain step shows at that rate, as the
/// trapezoid of the two averages is log-concave; a step down is a step up seen from 1. So both are looked at, period by
/// period.
fn keeps_limits(axes: &[Axis], reserve: f64, period_s: f64, first: u16, second: u16) -> bool {
    let alpha = 1.0 - reserve;
    let (n1, n2) = (f64::from(first), f64::from(second));
    // r″ a second²; twice that of a plain step, since targets may change at any time
    let bend = 2.0 / (n1 * n2) / (period_s * period_s);
    let mut rate = 0.0;
    for k in 1..first + second {
        let height = f64::from(k.min(second).min(first + second - k)) / (n1 * n2);
        let next = rate + height;
        let change = height / period_s;
        // the rate somewhere within this period, from the step up and from the step down
        for r in [next, 1.0 - rate] {
            for axis in axes {
                let (v, a, j) = (axis.max_velocity_mm_per_s, axis.max_acceleration_mm_per_s2, axis.max_jerk_mm_per_s3);
                let acceleration = alpha * a * r * r + v * change;
                let jerk = alpha * j * r * r * r + 3.0 * alpha * a * r * change + v * bend;
                if acceleration > a || jerk > 2.0 * j {
                    return false;
                }
            }
        }
        rate = next;
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Machine;

    #[test]
    fn the_built_in_machine_stops_within_its_published_time() {
        let machine = Machine::built_in().expect("valid");
        let smoothing = machine.smoothing;
        // by hand: ramps of about 0.17 s keep the upper end of the triangle under (A − αAr²)/V
        assert!((340..=350).contains(&smoothing.periods()), "{smoothing:?}");
        let (first, second) = (smoothing.first(), smoothing.second());
        assert!(!keeps_limits(&machine.axes, 0.1, 0.001, first - 4, second - 4));
    }

    #[test]
    fn stiffer_machines_stop_sooner() {
        let mut axes = Machine::built_in().expect("valid").axes;
        let slow = smoothing(&axes, 0.1, 0.001).expect("fits").periods();
        for axis in &mut axes {
            axis.max_acceleration_mm_per_s2 *= 4.0;
            axis.max_jerk_mm_per_s3 *= 10.0;
        }
        assert!(smoothing(&axes, 0.1, 0.001).expect("fits").periods() * 3 < slow);
        for axis in &mut axes {
            axis.max_acceleration_mm_per_s2 = 0.1;
        }
        assert_eq!(smoothing(&axes, 0.1, 0.001), None);
    }
}
