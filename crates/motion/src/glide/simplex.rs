//! A small dense linear program: the largest c·z with R·z ≤ b, where z may have any sign and z = 0 is allowed.
//!
//! It is the simplex method on a compact tableau (Dantzig 1951; Chvátal, *Linear Programming*, chapters 2 and 3).
//! Because z = 0 is allowed there is no first phase, and because z is free a variable that has entered never leaves.
//!
//! Invariant: after every step the current point is allowed; work is bounded. Nothing is allocated once the memory has
//! grown.

/// A linear program and its tableau; it retains its memory.
#[derive(Debug, Default)]
pub(crate) struct LinearProgram {
    columns: usize,
    /// The coefficients as they are added, each with its row and column.
    coefficients: Vec<(usize, usize, f64)>,
    /// Coefficients of the tableau, column by column, so that all rows are calculated together.
    table: Vec<f64>,
    /// Right side of each row.
    most: Vec<f64>,
    /// Least right side of each row, and the rate above which it can become tight: rows of free variables may have any
    /// right side, and never become tight.
    least: Vec<f64>,
    least_rate: Vec<f64>,
    /// Variable of each row: free variables 0 … columns − 1, then the slacks.
    basic: Vec<usize>,
    nonbasic: Vec<usize>,
    /// Reduced costs.
    cost: Vec<f64>,
    /// Numbers of the entering column, and how far it may go until each row is tight; retained for their memory.
    factors: Vec<f64>,
    ratios: Vec<f64>,
}

/// Steps after which a program stops: at an allowed point, though maybe not the best.
const MAX_STEPS: usize = 400;
/// Smaller numbers of the entering column count as 0.
const LEAST_RATE: f64 = 1e-11;

impl LinearProgram {
    /// Resets to an empty program with `columns` variables.
    pub(crate) fn clear(&mut self, columns: usize) {
        self.columns = columns;
        self.coefficients.clear();
        self.most.clear();
        self.basic.clear();
        self.nonbasic.clear();
        self.nonbasic.extend(0..columns);
    }

    /// Adds the row `coefficients · z ≤ most`, where each coefficient has its column, and the others are 0; a negative
    /// `most` counts as 0.
    pub(crate) fn row(&mut self, coefficients: impl Iterator<Item = (usize, f64)>, most: f64) {
        let row = self.basic.len();
        self.coefficients.extend(coefficients.map(|(column, x)| (row, column, x)));
        self.most.push(most.max(0.0));
        self.basic.push(self.columns + row);
    }

    /// Maximises c·z and writes z.
    pub(crate) fn maximise(&mut self, c: &[f64], z: &mut [f64]) {
        self.begin(c);
        for step in 0..MAX_STEPS {
            let Some((column, sign)) = self.entering(step) else { break };
            self.take_column(column, sign);
            let Some(row) = self.leaving() else { break };
            self.exchange(row, column);
        }
        z.fill(0.0);
        for (&variable, most) in self.basic.iter().zip(&self.most) {
            let (variable, sign) = (variable & !FLIPPED, if variable & FLIPPED != 0 { -1.0 } else { 1.0 });
            if variable < self.columns {
                z[variable] = sign * most;
            }
        }
    }

    /// Fills the tableau from the rows.
    fn begin(&mut self, c: &[f64]) {
        let rows = self.basic.len();
        self.cost.clear();
        self.cost.extend_from_slice(c);
        self.table.clear();
        self.table.resize(self.columns * rows, 0.0);
        for &(row, column, x) in &self.coefficients {
            self.table[column * rows + row] = x;
        }
        let fill = |numbers: &mut Vec<f64>, start| {
            numbers.clear();
            numbers.resize(rows, start);
        };
        fill(&mut self.least, 0.0);
        fill(&mut self.least_rate, LEAST_RATE);
        fill(&mut self.factors, 0.0);
        fill(&mut self.ratios, 0.0);
    }

    /// Whether a variable is free, not a slack.
    fn is_free(&self, variable: usize) -> bool {
        variable & !FLIPPED < self.columns
    }

    /// The column that gains most; in late steps, the first that gains at all, which cannot cycle (Bland 1977).
    fn entering(&self, step: usize) -> Option<(usize, f64)> {
        let mut best = (1e-10, None);
        for (column, (&variable, &gain)) in self.nonbasic.iter().zip(&self.cost).enumerate() {
            let size = if self.is_free(variable) { gain.abs() } else { gain };
            if size > best.0 {
                best = (if step > MAX_STEPS / 2 { f64::MAX } else { size }, Some((column, gain.signum())));
            }
        }
        best.1
    }

    /// Copies the entering column. Reverses the sign of its free variable, if `sign` is −1.
    fn take_column(&mut self, column: usize, sign: f64) {
        let rows = self.basic.len();
        if sign < 0.0 {
            self.nonbasic[column] ^= FLIPPED;
            self.cost[column] = -self.cost[column];
        }
        for (factor, x) in self.factors.iter_mut().zip(&self.table[column * rows..]) {
            *factor = sign * x;
        }
    }

    /// The row that is the first to become tight.
    fn leaving(&mut self) -> Option<usize> {
        let rates = self.factors.iter().zip(&self.least_rate);
        for (ratio, (most, (&rate, &least))) in self.ratios.iter_mut().zip(self.most.iter().zip(rates)) {
            let own = most / rate;
            *ratio = if rate > least { own } else { f64::INFINITY };
        }
        let mut best: (f64, f64, Option<usize>) = (f64::MAX, 0.0, None);
        for (row, (&ratio, &rate)) in self.ratios.iter().zip(&self.factors).enumerate() {
            if ratio <= best.0 && (ratio < best.0 - 1e-12 || rate > best.1) {
                best = (ratio, rate, Some(row));
            }
        }
        best.2
    }

    /// Exchanges the entering variable of `column`, which was copied, and the leaving one of `row`.
    fn exchange(&mut self, row: usize, column: usize) {
        let rows = self.basic.len();
        let inverse = 1.0 / std::mem::take(&mut self.factors[row]);
        let gain = std::mem::take(&mut self.cost[column]);
        for (index, numbers) in self.table.chunks_exact_mut(rows).enumerate() {
            if index == column {
                numbers.fill(0.0);
            }
            let pivot = if index == column { inverse } else { numbers[row] * inverse };
            if pivot != 0.0 {
                for (x, factor) in numbers.iter_mut().zip(&self.factors) {
                    *x -= factor * pivot;
                }
                self.cost[index] -= gain * pivot;
            }
            numbers[row] = pivot;
        }
        let most = self.most[row] * inverse;
        for (own, (factor, &least)) in self.most.iter_mut().zip(self.factors.iter().zip(&self.least)) {
            let x = *own - factor * most;
            *own = if x > least { x } else { least };
        }
        std::mem::swap(&mut self.basic[row], &mut self.nonbasic[column]);
        self.most[row] = most;
        let is_free = self.is_free(self.basic[row]);
        self.least[row] = if is_free { f64::NEG_INFINITY } else { 0.0 };
        self.least_rate[row] = if is_free { f64::INFINITY } else { LEAST_RATE };
    }
}

/// Marks a free variable whose sign is reversed.
const FLIPPED: usize = 1 << 63;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn solve(rows: &[(Vec<f64>, f64)], c: &[f64]) -> Vec<f64> {
        let mut program = LinearProgram::default();
        program.clear(c.len());
        for (row, most) in rows {
            program.row(row.iter().copied().enumerate(), *most);
        }
        let mut z = vec![0.0; c.len()];
        program.maximise(c, &mut z);
        z
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]

        /// Weak duality from the outside: no allowed corner that random search finds is better, and the result is
        /// allowed.
        #[test]
        fn the_best_is_allowed_and_no_vertex_is_better(
            rows in prop::collection::vec((prop::collection::vec(-1.0..1.0f64, 2), 0.0..1.0f64), 3..12),
            c in prop::collection::vec(-1.0..1.0f64, 2),
        ) {
            let mut rows = rows;
            for (row, most) in [(vec![1.0, 0.0], 3.0), (vec![-1.0, 0.0], 3.0), (vec![0.0, 1.0], 3.0),
                (vec![0.0, -1.0], 3.0)] {
                rows.push((row, most));
            }
            let z = solve(&rows, &c);
            let value = c[0] * z[0] + c[1] * z[1];
            let allowed = |z: &[f64]| rows.iter().all(|(row, most)| row[0] * z[0] + row[1] * z[1] <= most + 1e-9);
            prop_assert!(allowed(&z));
            for (k, (p, a)) in rows.iter().enumerate() {
                for (q, b) in &rows[..k] {
                    let det = p[0] * q[1] - p[1] * q[0];
                    if det.abs() > 1e-6 {
                        let vertex = [(a * q[1] - b * p[1]) / det, (p[0] * b - q[0] * a) / det];
                        if allowed(&vertex) {
                            prop_assert!(c[0] * vertex[0] + c[1] * vertex[1] <= value + 1e-7);
                        }
                    }
                }
            }
        }
    }
}
