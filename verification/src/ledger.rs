//! The rows of the proof ledger: each property in a sentence, with its checks and the mutants that must fail.
//!
//! Invariant: every harness, search and model belongs to exactly one row, and every row has a mutant that its checks
//! kill.

use crate::native::Harness;

/// One property.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Short name, by which commands refer to it.
    pub name: &'static str,
    /// The property in one sentence.
    pub says: &'static str,
    /// Requirements that it covers.
    pub requirement: &'static str,
    /// Bound of the engines' search.
    pub bound: &'static str,
    /// Assumptions.
    pub assumes: &'static str,
    /// Reason why that bound is enough.
    pub suffices: &'static str,
    /// Harnesses, by name: proved by Kani and CBMC, enumerated natively.
    pub harnesses: &'static [&'static str],
    /// Searches over all reachable states, and long random runs, on this machine.
    pub searches: &'static [Search],
    /// Models of threads: loom's and shuttle's tests, by package and name.
    pub models: &'static [Model],
    /// Changes to the code that a check of this row must notice.
    pub mutants: &'static [Mutant],
}

/// A search or a long random run.
#[derive(Clone, Copy, Debug)]
pub struct Search {
    /// Its name.
    pub name: &'static str,
    /// Runs it and describes the result in a few words; panics where the property does not hold.
    pub run: fn(Size) -> String,
}

/// Size of a search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Whether all of it is searched, or only as much as a test run has time for.
    pub full: bool,
    /// Seed of the drawn values.
    pub seed: u64,
}

/// A test of the thread models.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Model {
    /// `loom` or `shuttle`.
    pub engine: &'static str,
    /// The test's name.
    pub test: &'static str,
}

/// A change to the code: `find`, which occurs exactly once in `file`, becomes `put`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mutant {
    /// The defect, in a few words.
    pub name: &'static str,
    /// The file, from the workspace's root.
    pub file: &'static str,
    /// Text to find.
    pub find: &'static str,
    /// Replacement.
    pub put: &'static str,
    /// Harness, search or model test that must notice it.
    pub killer: &'static str,
}

/// Every row, with the name of its module.
pub fn rows_by_module() -> impl Iterator<Item = (&'static str, Row)> {
    MODULES.iter().flat_map(|(module, rows, _)| rows.iter().map(|row| (*module, *row)))
}

/// Every row.
#[must_use]
pub fn rows() -> Vec<Row> {
    rows_by_module().map(|(_, row)| row).collect()
}

/// Every harness.
#[must_use]
pub fn harnesses() -> Vec<Harness> {
    MODULES.iter().flat_map(|(_, _, harnesses)| harnesses.iter().copied()).collect()
}

type Module = (&'static str, &'static [Row], &'static [Harness]);

/// Lists modules with their rows and harnesses.
macro_rules! modules {
    ($($module:ident,)*) => {
        &[$((stringify!($module), crate::$module::ROWS, crate::$module::HARNESSES),)*]
    };
}

/// The property modules.
const MODULES: &[Module] = modules! {
    ring,
    literal_ring,
    playback,
    rate,
    filter_balance,
    drive,
    braking,
    rate_law,
    stopping,
    card_window,
    modes,
    gates,
    threads,
    shipped_threads,
    fine,
    gear,
    probing,
    frames,
    steps,
    permit,
    beam_power,
    sequence,
    protocol,
};

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_check_belongs_to_one_row_and_every_row_has_a_mutant() {
        let mut names = BTreeSet::new();
        let (mut claimed, mut mutants) = (BTreeSet::new(), BTreeSet::new());
        for row in rows() {
            assert!(names.insert(row.name), "two rows {}", row.name);
            assert!(!row.mutants.is_empty(), "{} has no mutant", row.name);
            let mut checks: Vec<&str> = row.harnesses.to_vec();
            checks.extend(row.searches.iter().map(|search| search.name));
            checks.extend(row.models.iter().map(|model| model.test));
            for mutant in row.mutants {
                assert!(checks.contains(&mutant.killer), "{}: no check {}", row.name, mutant.killer);
                assert!(mutants.insert(mutant.name), "two mutants {}", mutant.name);
            }
            for check in checks {
                assert!(claimed.insert(check), "{check} in two rows");
            }
        }
        for harness in harnesses() {
            assert!(claimed.contains(harness.name), "{} is in no row", harness.name);
        }
        for row in rows() {
            for name in row.harnesses {
                assert!(harnesses().iter().any(|harness| harness.name == *name), "no harness {name}");
            }
        }
    }
}
