//! Checks the rows of `--records` against the axes' limits, by the definition of the interface alone.
//!
//! Invariant: written independently of the command's own limit monitor, and slowly, so that it can be read against the
//! rule:
//!
//! Differences of the emitted positions are taken over strides of n = 1, 2, 4 … 64 periods; the k-th may not exceed
//! limit · (nT)ᵏ · pulses/mm plus an allowance for rounding: 1, 2, 4 pulses for k = 1, 2, 3 where the rate is ±1 or 0
//! over the whole stride, otherwise 2e, 4e, 8e with e = 1 + A·T²/8 in pulses. Over strides in which the rate changes
//! the jerk limit is twice the axis limit.

use crate::records::{RATE_ONE, Records};

/// One axis, as in the report.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// Pulses per mm.
    pub pulses_per_mm: f64,
    /// Velocity in mm/s, acceleration in mm/s², jerk in mm/s³.
    pub limits: [f64; 3],
}

/// Result of the check.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Audit {
    /// Number of windows that exceed a limit, by velocity, acceleration, jerk.
    pub violations: [u64; 3],
    /// Description of the first of them.
    pub first: Option<String>,
    /// The largest velocity, acceleration and jerk beyond the allowance over strides 8 … 64, axis by axis.
    pub largest: Vec<[f64; 3]>,
}

/// Periods of standstill before and after: the machine is at rest when a job begins, and when it has ended.
const STANDSTILL: usize = 3 * 64;

/// Checks all rows.
#[must_use]
pub fn audit(records: &Records, axes: &[Axis], period_s: f64) -> Audit {
    let mut audit = Audit { largest: vec![[0.0; 3]; axes.len()], ..Audit::default() };
    let (Some(first), Some(last)) = (records.rows.first(), records.rows.last()) else { return audit };
    let mut rates = vec![first.rate_nano; STANDSTILL];
    rates.extend(records.rows.iter().map(|row| row.rate_nano));
    rates.extend([last.rate_nano; STANDSTILL]);
    let whole = run_lengths(&rates, |at| rates[at] == 0 || rates[at].abs() == RATE_ONE);
    let same = run_lengths(&rates, |at| at > 0 && rates[at] == rates[at - 1]);
    for (number, axis) in axes.iter().enumerate() {
        let positions = positions(records, number);
        let chord = axis.limits[1] * period_s * period_s / 8.0 * axis.pulses_per_mm;
        let e = 1.0 + chord;
        for n in [1, 2, 4, 8, 16, 32, 64] {
            for k in 1..=3 {
                let span = (n as f64 * period_s).powi(k as i32) * axis.pulses_per_mm;
                for end in k * n..positions.len() {
                    let p = |back: usize| positions[end - back * n];
                    let difference = match k {
                        1 => p(0) - p(1),
                        2 => p(0) - 2 * p(1) + p(2),
                        _ => p(0) - 3 * p(1) + 3 * p(2) - p(3),
                    };
                    // The periods of the window are end − kn … end − 1.
                    let is_whole = whole[end - 1] >= k * n;
                    let changes = same[end - 1] + 1 < k * n;
                    let allowance = f64::from(1 << (k - 1)) * if is_whole { 1.0 } else { 2.0 * e };
                    let limit = if k == 3 && changes { 2.0 * axis.limits[2] } else { axis.limits[k - 1] };
                    let size = difference.unsigned_abs() as f64;
                    if size > limit * span + allowance + 1e-6 {
                        audit.violations[k - 1] += 1;
                        audit.first.get_or_insert_with(|| {
                            let row = end.saturating_sub(STANDSTILL + 1).min(records.rows.len() - 1);
                            let (name, row) = (&records.axes[number], &records.rows[row]);
                            format!("axis {name}, k = {k}, n = {n}, at {row:?}: {size} of {}", limit * span + allowance)
                        });
                    }
                    if n >= 8 {
                        let largest = &mut audit.largest[number][k - 1];
                        *largest = largest.max((size - allowance) / span);
                    }
                }
            }
        }
    }
    audit
}

/// For each place, the number of places in a row up to it that satisfy `is_so`.
fn run_lengths(rates: &[i64], is_so: impl Fn(usize) -> bool) -> Vec<usize> {
    let mut lengths = Vec::with_capacity(rates.len());
    let mut length = 0;
    for at in 0..rates.len() {
        length = if is_so(at) { length + 1 } else { 0 };
        lengths.push(length);
    }
    lengths
}

/// Positions of one axis in pulses at every period's end, with the standstill before and after.
fn positions(records: &Records, axis: usize) -> Vec<i64> {
    let mut positions = vec![0_i64; STANDSTILL + 1];
    let mut position = 0;
    for row in &records.rows {
        position += row.increments[axis];
        positions.push(position);
    }
    positions.extend([position; STANDSTILL]);
    positions
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::records::Row;

    const AXIS: Axis = Axis { pulses_per_mm: 1000.0, limits: [100.0, 1000.0, 20_000.0] };

    /// Rows of a move of four equal phases of jerk, played at rates that the function gives.
    fn jerked(jerk: f64, phase_s: f64, rate: impl Fn(u64) -> i64) -> Records {
        let jumps = [(0.0, jerk), (1.0, -2.0 * jerk), (3.0, 2.0 * jerk), (4.0, -jerk)];
        let at =
            |t: f64| -> f64 { jumps.iter().map(|(n, jump)| jump * (t - n * phase_s).max(0.0).powi(3) / 6.0).sum() };
        let count = |period: u64| (at(period as f64 * 1e-3) * 1000.0).round() as i64;
        let row = |period: u64| Row {
            period,
            line: 1,
            rate_nano: rate(period),
            record: period + 1,
            fraction: 0,
            increments: vec![count(period + 1) - count(period)],
            layer: 0,
            retrace_switched: String::new(),
        };
        Records { axes: vec!["x".to_owned()], rows: (0..300).map(row).collect(), is_dry: false }
    }

    fn violations(records: &Records, axis: Axis) -> [u64; 3] {
        audit(records, &[axis], 1e-3).violations
    }

    #[test]
    fn a_legal_move_passes_and_its_figures_are_those_of_the_move() {
        let audit = audit(&jerked(20_000.0, 0.049, |_| RATE_ONE), &[AXIS], 1e-3);
        assert_eq!((audit.violations, audit.first), ([0; 3], None));
        let [velocity, acceleration, jerk] = audit.largest[0];
        assert!((45.0..48.1).contains(&velocity) && (850.0..980.1).contains(&acceleration));
        assert!((19_000.0..20_000.1).contains(&jerk));
    }

    #[test]
    fn each_limit_is_seen_when_it_is_broken() {
        let records = jerked(20_000.0, 0.049, |_| RATE_ONE);
        let with = |limits: [f64; 3]| violations(&records, Axis { limits, ..AXIS }).map(|count| count > 0);
        assert_eq!(with([45.0, 1000.0, 20_000.0]), [true, false, false]);
        assert_eq!(with([100.0, 900.0, 20_000.0]), [false, true, false]);
        assert_eq!(with([100.0, 1000.0, 18_000.0]), [false, false, true]);
    }

    #[test]
    fn twice_the_jerk_passes_only_while_the_rate_changes() {
        let changing = jerked(36_000.0, 0.025, |period| period as i64 * 1000);
        assert_eq!(violations(&changing, AXIS), [0; 3]);
        assert!(violations(&jerked(36_000.0, 0.025, |_| RATE_ONE), AXIS)[2] > 0);
    }

    #[test]
    fn a_halt_at_speed_is_seen_at_the_end_of_the_rows() {
        let mut records = jerked(20_000.0, 0.049, |_| RATE_ONE);
        records.rows.truncate(98);
        assert!(violations(&records, AXIS)[1] > 0);
    }
}
