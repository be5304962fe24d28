//! A `retrace run` with its complete output.

use crate::command::{Bench, CommandOutput};
use crate::limits::{Audit, Axis, audit};
use crate::records::Records;
use serde_json::Value;
use std::fs;
use std::path::Path;

/// Result of a run.
#[derive(Debug)]
pub struct Run {
    /// Output of the command.
    pub output: CommandOutput,
    /// Its events, without the report.
    pub events: Vec<Value>,
    /// Its report.
    pub report: Value,
    /// What the card executed.
    pub records: Records,
}

impl Run {
    /// Runs a program with `--json` and `--records`, and more arguments.
    ///
    /// # Panics
    /// Where the report or the records are missing: both are required, however the run ends.
    #[must_use]
    pub fn of(bench: &Bench, program: &Path, more: &[&str]) -> Self {
        let result = Self::result(bench, program, more, b"");
        let text = fs::read_to_string(bench.path("records.csv")).expect("the records");
        Self::parse(result, &text)
    }

    /// Runs the program given on standard input.
    ///
    /// # Panics
    /// As [`Run::of`].
    #[must_use]
    pub fn of_input(bench: &Bench, program: &[u8], more: &[&str]) -> Self {
        let result = Self::result(bench, Path::new("-"), more, program);
        let text = fs::read_to_string(bench.path("records.csv")).expect("the records");
        Self::parse(result, &text)
    }

    fn result(bench: &Bench, program: &Path, more: &[&str], input: &[u8]) -> CommandOutput {
        let records = bench.path("records.csv");
        let mut arguments = vec!["run".as_ref(), program.as_os_str(), "--json".as_ref()];
        arguments.extend(["--records".as_ref(), records.as_os_str()]);
        arguments.extend(more.iter().map(AsRef::<std::ffi::OsStr>::as_ref));
        bench.retrace_reading(arguments, input)
    }

    fn parse(output: CommandOutput, records: &str) -> Self {
        let mut events: Vec<Value> = output
            .out
            .lines()
            .map(|line| serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line:?}\n{}", output.err)))
            .collect();
        let report = events.pop().filter(|last| last["event"] == "report");
        let report = report.unwrap_or_else(|| panic!("the last line is a report\n{}\n{}", output.out, output.err));
        let records = Records::parse(records).expect("well-formed records");
        Self { output, events, report, records }
    }

    /// The pulse counts of the card, axis by axis.
    #[must_use]
    pub fn counts(&self) -> Vec<i64> {
        let counts = self.records.axes.iter().map(|axis| self.report["position_counts"][axis].as_i64());
        counts.collect::<Option<_>>().unwrap_or_else(|| panic!("counts in {}", self.report))
    }

    /// Commanded end position of the program, in pulses.
    #[must_use]
    pub fn commanded(&self) -> Vec<i64> {
        let pulses = |axis: &String| {
            let mm = self.report["commanded_mm"][axis].as_f64()?;
            // `round` is half away from zero, as the whole system rounds.
            Some((mm * self.report["pulses_per_mm"][axis].as_f64()?).round() as i64)
        };
        let counts = self.records.axes.iter().map(pulses);
        counts.collect::<Option<_>>().unwrap_or_else(|| panic!("commanded positions in {}", self.report))
    }

    /// A number of the report.
    #[must_use]
    pub fn number(&self, name: &str) -> f64 {
        self.report[name].as_f64().unwrap_or_else(|| panic!("{name} in {}", self.report))
    }

    /// Events of one kind.
    pub fn of_kind<'a>(&'a self, kind: &'a str) -> impl Iterator<Item = &'a Value> {
        self.events.iter().filter(move |event| event["event"] == kind)
    }

    /// The axes as in the report.
    #[must_use]
    pub fn axes(&self) -> Vec<Axis> {
        let axis = |name: &String| {
            let limits = &self.report["limits"][name];
            let limit = |of: &str| limits[of].as_f64();
            Some(Axis {
                pulses_per_mm: self.report["pulses_per_mm"][name].as_f64()?,
                limits: [limit("velocity")?, limit("acceleration")?, limit("jerk")?],
            })
        };
        self.records.axes.iter().map(axis).collect::<Option<_>>().unwrap_or_else(|| panic!("limits in {}", self.report))
    }

    /// Check of the records, made here.
    #[must_use]
    pub fn audit(&self) -> Audit {
        audit(&self.records, &self.axes(), self.number("period_ms") / 1000.0)
    }

    /// Checks what holds for every run that is completed, for any commands of the operator.
    ///
    /// # Panics
    /// Where a part of it does not hold.
    pub fn assert_exact_and_legal(&self) {
        let report = &self.report;
        assert_eq!((self.output.code, report["outcome"].as_str()), (Some(0), Some("completed")), "{}", self.output.err);
        assert_eq!(report["exit_code"], 0);
        assert_eq!(self.counts(), self.commanded(), "position and command differ: {report}");
        self.assert_consistent();
    }

    /// Checks what holds for every run, however it ended.
    ///
    /// # Panics
    /// Where a part of it does not hold.
    pub fn assert_consistent(&self) {
        let report = &self.report;
        assert_eq!(self.records.totals(), self.counts(), "the rows do not add up to the position: {report}");
        assert_eq!(self.records.rows.len() as f64, self.number("periods"), "a row a period: {report}");
        let audit = self.audit();
        assert_eq!(audit.violations, [0; 3], "{:?}", audit.first);
        assert_eq!(report["limit_violations"], 0, "our audit found none: {report}");
        for (axis, ours) in self.records.axes.iter().zip(&audit.largest) {
            for (name, ours) in ["max_velocity", "max_acceleration", "max_jerk"].into_iter().zip(ours) {
                let theirs = report[name][axis].as_f64().unwrap_or(f64::NAN);
                assert!((ours - theirs).abs() <= 1e-6 * ours.abs().max(1.0), "{name} of {axis}: {ours} and {theirs}");
            }
        }
        if let Err(reason) = self.records.places_visited_twice() {
            panic!("{reason}");
        }
        let spent = ["motion_s", "dwell_s", "switch_s", "held_s", "retrace_s"].map(|name| self.number(name));
        assert!(
            spent.iter().sum::<f64>() <= self.number("periods") * self.number("period_ms") / 1000.0 + 1e-6,
            "{report}"
        );
    }
}
