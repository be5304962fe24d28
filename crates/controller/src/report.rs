//! The report of a run, as `--json` prints it last and the journal stores it (interface, *run*).
//!
//! Invariant: positions come from the card, commanded positions from the program; nothing in the report is estimated.
//! What was not measured is null, with a note that gives the reason.

use retrace_config::MachineConfig;
use retrace_link::CardStatus;
use serde_json::{Map, Value, json};

use crate::limit_monitor::LimitReport;
use crate::run_stats::RunStats;
use crate::session::Outcome;

/// The data at the end of a run.
#[derive(Debug)]
pub struct Report<'a, const A: usize> {
    /// Name of the program.
    pub program: &'a str,
    /// The machine it ran on.
    pub machine: &'a MachineConfig,
    /// How the run ended.
    pub outcome: &'a Outcome,
    /// Program line that was executed last.
    pub line: u32,
    /// Time breakdown.
    pub stats: &'a RunStats,
    /// Number of blocks that were executed.
    pub blocks: u64,
    /// Number of canonical functions.
    pub canonical: u64,
    /// End position of the program on the machine's axes, mm. Empty where the program was not completed.
    pub commanded_mm: &'a [f64],
    /// Last status of the card.
    pub card: &'a CardStatus<A>,
    /// Result of the limit monitor over the emitted increments.
    pub limit_report: &'a LimitReport<A>,
    /// Wall time, s.
    pub wall_s: f64,
    /// Alarms of the run, as text.
    pub alarms: &'a [String],
}

impl Outcome {
    /// Exit code of the command (interface).
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Completed => 0,
            Self::BlockError(_) => 1,
            Self::Alarm(..) => 3,
            Self::Stopped => 4,
        }
    }

    /// The outcome as one word in the report.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::Stopped | Self::BlockError(_) => "stopped",
            Self::Alarm(..) => "alarm",
        }
    }
}

impl<const A: usize> Report<'_, A> {
    /// Duration of `periods` control periods, s.
    fn seconds(&self, periods: u64) -> f64 {
        // whole microseconds first, so that 1 500 periods of 1 ms print as 1.5
        (u128::from(periods) * u128::from(self.machine.period_us)) as f64 / 1e6
    }

    /// Machine time of program motion executed for the first time, s.
    #[must_use]
    pub fn motion_s(&self) -> f64 {
        self.seconds(self.stats.motion)
    }

    /// Counts of the machine's axes. None where the card has not confirmed where it came to rest.
    #[must_use]
    pub fn counts(&self) -> Option<[i64; A]> {
        // A fault of the card or its link ends the run without a report from the card; an alarm that the card latched
        // comes with one.
        let is_fault = matches!(self.outcome, Outcome::Alarm(number, ..) if ("E3001"..="E3009").contains(number))
            && self.card.alarm.is_none();
        (self.card.at_rest && !is_fault).then(|| self.machine.position_counts(self.card))
    }

    /// Reason why the position is not known, where it is not.
    #[must_use]
    pub fn position_note(&self) -> Option<String> {
        if self.counts().is_some() {
            return None;
        }
        let was = if self.card.at_rest { "stood" } else { "was moving" };
        let counts = self.machine.position_counts(self.card);
        let counts = &counts[..self.machine.axes.len().min(A)];
        Some(format!(
            "the card has not confirmed where it came to rest; in its last report it {was} at counts {counts:?}"
        ))
    }

    /// The report as one JSON object.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let t = self.stats;
        let counts = self.counts();
        let position_counts = counts.map_or(Value::Null, |counts| self.per_axis(|i| json!(counts[i])));
        let position_mm =
            counts.map_or(Value::Null, |counts| self.per_axis(|i| json!(self.machine.axes[i].mm_of(counts[i]))));
        let commanded = self.per_axis(|i| self.commanded_mm.get(i).map_or(Value::Null, |&mm| json!(mm)));
        let mut report = json!({
            "event": "report",
            "program": self.program,
            "machine": self.machine.name,
            "dry_run": self.machine.inhibits_outputs,
            "outcome": self.outcome.word(),
            "exit_code": self.outcome.exit_code(),
            "line": self.line,
            "blocks": self.blocks,
            "canonical": self.canonical,
            "periods": t.periods,
            "period_ms": f64::from(self.machine.period_us) / 1000.0,
            "motion_s": self.motion_s(),
            "dwell_s": self.seconds(t.dwell),
            "switch_s": self.seconds(t.switching),
            "held_s": self.seconds(t.held),
            "paused_s": self.seconds(t.paused),
            "retrace_s": self.seconds(t.retracing),
            "waiting_s": self.seconds(t.waiting),
            "wall_s": self.wall_s,
            "position_counts": position_counts,
            "position_mm": position_mm,
            "position_note": self.position_note(),
            "commanded_mm": commanded,
            "pulses_per_mm": self.per_axis(|i| json!(self.machine.axes[i].pulses_per_mm)),
            "limits": self.limits(),
            "max_velocity": self.per_axis(|i| json!(self.limit_report.extremes[i].velocity_mm_s)),
            "max_acceleration": self.per_axis(|i| json!(self.limit_report.extremes[i].acceleration_mm_s2)),
            "max_jerk": self.per_axis(|i| json!(self.limit_report.extremes[i].jerk_mm_s3)),
            "limit_violations": self.limit_report.violations,
            "first_violation": self.first_violation(),
            "underruns": t.underruns,
            "min_buffered_records": t.min_buffered_records,
            "reversals": t.reversals,
            "switch_events": t.switch_events,
            "dropped_events": t.dropped_events,
            "peak_rss_mib": peak_rss_mib(),
            "alarms": self.alarms,
        });
        if let (Value::Object(all), Value::Object(cutting)) = (&mut report, self.cutting()) {
            all.extend(cutting);
        }
        report
    }

    /// What was cut.
    fn cutting(&self) -> Value {
        let t = &self.stats;
        json!({
            "cut_interruptions": t.cut_interruptions,
            "cutter_flickers": t.cutter_flickers,
            "lit_s": self.seconds(t.lit),
            "contours": t.contours,
            "contours_not_cut": t.contours_not_cut,
            "not_cut_mm": t.not_cut_um as f64 / 1000.0,
            "not_watched_mm": (t.not_watched_nm as f64 / 1000.0).round() / 1000.0,
        })
    }

    /// The first limit violation: the period that ended the window, axis, order of the difference, stride, pulses.
    fn first_violation(&self) -> Value {
        self.limit_report.first.map_or(Value::Null, |offence| {
            json!({
                "period": offence.period,
                "axis": self.machine.axes.get(offence.axis).map(|a| a.name.to_string()),
                "order": offence.order,
                "stride": offence.stride,
                "pulses": offence.pulses,
                "allowed_pulses": offence.allowed_pulses,
            })
        })
    }

    fn limits(&self) -> Value {
        self.per_axis(|i| {
            let axis = &self.machine.axes[i];
            json!({
                "velocity": axis.max_velocity_mm_per_s,
                "acceleration": axis.max_acceleration_mm_per_s2,
                "jerk": axis.max_jerk_mm_per_s3,
            })
        })
    }

    fn per_axis(&self, value: impl Fn(usize) -> Value) -> Value {
        let axes = self.machine.axes.iter().enumerate();
        Value::Object(axes.map(|(i, axis)| (axis.name.to_string(), value(i))).collect::<Map<_, _>>())
    }
}

/// Largest resident memory of this process so far in MiB, where the system reports it (Linux); else null.
fn peak_rss_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some((kib / 1024.0 * 10.0).round() / 10.0)
}
