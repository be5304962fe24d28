//! `cargo xtask campaign`: the random end-to-end tests, in a size that the test suite has no time for.
//!
//! Invariant: a campaign is one of the tests of the suite with more cases and a seed of its own; what the suite runs of it is a
//! slice.

use std::path::Path;
use std::process::Command;

/// One campaign.
pub(crate) struct Campaign {
    pub(crate) name: &'static str,
    pub(crate) purpose: &'static str,
    /// The end-to-end test that it is: file and name.
    test: [&'static str; 2],
    /// Cases of a full run; the suite's own number without `--full`.
    full: u32,
}

/// Every campaign.
pub(crate) const CAMPAIGNS: &[Campaign] = &[
    Campaign {
        name: "operator",
        purpose: "whatever an operator does, the job ends exactly and within the limits",
        test: ["operator", "whatever_the_operator_does_the_job_ends_exactly"],
        full: 3000,
    },
    Campaign {
        name: "program",
        purpose: "any program ends exactly and within the limits",
        test: ["any_program", "any_program_ends_exactly_and_within_the_limits"],
        full: 3000,
    },
];

/// Runs a campaign and says whether it passed.
pub(crate) fn run(root: &Path, campaign: &Campaign, full: bool, seed: u64) -> bool {
    let [file, test] = campaign.test;
    let cases = if full { campaign.full.to_string() } else { "24".into() };
    println!("campaign {}: {} ({cases} cases, seed {seed})", campaign.name, campaign.purpose);
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(["test", "--release", "--package", "retrace-tests", "--test", file, "--", test]);
    command.env("RETRACE_CASES", cases).env("PROPTEST_RNG_SEED", seed.to_string()).env_remove("RETRACE_BIN");
    match command.current_dir(root).status() {
        Ok(status) => status.success(),
        Err(error) => {
            eprintln!("xtask: cargo could not be run: {error}");
            false
        }
    }
}
