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
    /// Length of a row in the table.
    width: usize,
    /// Rows of `columns` coefficients and the right side, with zeros up to whole lanes.
    table: Vec<f64>,
    /// Variable of each row: free variables 0 … columns − 1, then the slacks.
    basic: Vec<usize>,
    nonbasic: Vec<usize>,
    /// Reduced costs, and the value so far.
    cost: Vec<f64>,
    /// Row of the pivot, retained for its memory.
    pivot: Vec<f64>,
}

/// Rows are padded to a multiple of so many numbers, which are calculated together.
const LANES: usize = 4;
/// Steps after which a program stops: at an allowed point, though maybe not the best.
const MAX_STEPS: usize = 400;

impl LinearProgram {
    /// Resets to an empty program with `columns` variables.
    pub(crate) fn clear(&mut self, columns: usize) {
        self.columns = columns;
        self.width = (columns + 1).next_multiple_of(LANES);
        self.table.clear();
        self.basic.clear();
        self.nonbasic.clear();
        self.nonbasic.extend(0..columns);
        self.cost.clear();
        self.cost.resize(self.width, 0.0);
    }

    /// Adds the row `coefficients · z ≤ most`; a negative `most` counts as 0.
    pub(crate) fn row(&mut self, coefficients: &[f64], most: f64) {
        self.table.extend_from_slice(coefficients);
        self.table.push(most.max(0.0));
        self.table.resize(self.table.len().next_multiple_of(LANES), 0.0);
        self.basic.push(self.columns + self.basic.len());
    }

    /// Maximises c·z and writes z.
    pub(crate) fn maximise(&mut self, c: &[f64], z: &mut [f64]) {
        self.cost[..self.columns].copy_from_slice(c);
        for step in 0..MAX_STEPS {
            let Some((column, sign)) = self.entering(step) else { break };
            if sign < 0.0 {
                self.flip(column);
            }
            let Some(row) = self.leaving(column) else { break };
            self.exchange(row, column);
        }
        z.fill(0.0);
        let width = self.width;
        for (row, variable) in self.basic.iter().enumerate() {
            let (variable, sign) = (variable & !FLIPPED, if variable & FLIPPED != 0 { -1.0 } else { 1.0 });
            if variable < self.columns {
                z[variable] = sign * self.table[row * width + self.columns];
            }
        }
    }

    /// The column that gains most; in late steps, the first that gains at all, which cannot cycle (Bland 1977).
    fn entering(&self, step: usize) -> Option<(usize, f64)> {
        let mut best = (1e-10, None);
        for (column, variable) in self.nonbasic.iter().enumerate() {
            let gain = self.cost[column];
            let free = variable & !FLIPPED < self.columns;
            let size = if free { gain.abs() } else { gain };
            if size > best.0 {
                best = (if step > MAX_STEPS / 2 { f64::MAX } else { size }, Some((column, gain.signum())));
            }
        }
        best.1
    }

    /// Reverses the sign of the free variable of a column.
    fn flip(&mut self, column: usize) {
        self.nonbasic[column] ^= FLIPPED;
        self.cost[column] = -self.cost[column];
        for row in self.table.chunks_exact_mut(self.width) {
            row[column] = -row[column];
        }
    }

    /// The row that is the first to become tight; rows of free variables never do.
    fn leaving(&self, column: usize) -> Option<usize> {
        let mut best: (f64, f64, Option<usize>) = (f64::MAX, 0.0, None);
        for (row, numbers) in self.table.chunks_exact(self.width).enumerate() {
            let rate = numbers[column];
            if rate > 1e-11 && self.basic[row] & !FLIPPED >= self.columns {
                let ratio = numbers[self.columns] / rate;
                if ratio < best.0 - 1e-12 || (ratio <= best.0 && rate > best.1) {
                    best = (ratio, rate, Some(row));
                }
            }
        }
        best.2
    }

    /// Exchanges the entering variable of `column` and the leaving one of `row`.
    fn exchange(&mut self, row: usize, column: usize) {
        let width = self.width;
        let inverse = 1.0 / self.table[row * width + column];
        let own = &mut self.table[row * width..(row + 1) * width];
        own[column] = 1.0;
        for x in own.iter_mut() {
            *x *= inverse;
        }
        self.pivot.clear();
        self.pivot.extend_from_slice(own);
        for (k, numbers) in self.table.chunks_exact_mut(width).enumerate() {
            let factor = numbers[column];
            if k != row && factor != 0.0 {
                numbers[column] = 0.0;
                for (x, p) in numbers.iter_mut().zip(&self.pivot) {
                    *x -= factor * p;
                }
                numbers[self.columns] = if self.basic[k] & !FLIPPED < self.columns {
                    numbers[self.columns]
                } else {
                    numbers[self.columns].max(0.0)
                };
            }
        }
        let factor = std::mem::take(&mut self.cost[column]);
        for (x, p) in self.cost.iter_mut().zip(&self.pivot) {
            *x -= factor * p;
        }
        std::mem::swap(&mut self.basic[row], &mut self.nonbasic[column]);
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
            program.row(row, *most);
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
