//! Report of `retrace check` about a program that can run, for a person and for a script.
//!
//! Invariant: both forms have the same values; times are those of the plan at 100 %.

use std::fmt::Write as _;

use retrace_config::MachineConfig;
use retrace_controller::{ProgramAnalysis, TravelLeft, ValueRange, WorkExtents};
use retrace_gcode::{Axis, Tool, system_name};
use retrace_link::channel;
use serde_json::{Map, Value, json};

use crate::contour_report;
use crate::cutting_report::CuttingReport;
use crate::program::Program;

/// Program that was checked and planned.
pub struct CheckReport<'a, const A: usize> {
    pub program: &'a Program,
    pub machine: &'a MachineConfig,
    pub blocks: u64,
    pub analysis: &'a ProgramAnalysis<'a, A>,
    /// Warnings, for a script.
    pub diagnostics: Vec<Value>,
}

/// Maximum number of lines that are listed for a person; a script gets all of them.
const MAX_LISTED: usize = 10;

impl<const A: usize> CheckReport<'_, A> {
    /// Report as text.
    pub fn text(&self) -> String {
        let Self { program, blocks, analysis, .. } = self;
        let mut text = format!("{}: no errors, {blocks} blocks, {} moves", program.name(), analysis.scan.moves);
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "\n  at 100 %: {}{} total: motion {:.3} s · dwell {:.3} s · switching {:.3} s",
            if analysis.is_time_partial { "at least " } else { "" },
            clock(self.total_s()),
            self.seconds(analysis.motion_periods),
            self.seconds(analysis.dwell_periods),
            self.seconds(analysis.switch_periods)
        );
        let _ = write!(
            text,
            "\n  cutting {:.3} m · rapids {:.3} m · pierces {}",
            analysis.cutting_mm / 1000.0,
            analysis.rapid_mm / 1000.0,
            analysis.pierces
        );
        if analysis.pierce_periods > 0 {
            let _ = write!(text, ", which take {:.3} s", self.seconds(analysis.pierce_periods));
        }
        text += &self.cutting().text();
        text += &contour_report::text(&analysis.scan.contours, self.machine);
        if analysis.tool_periods.len() > 1 {
            let times = analysis.tool_periods.iter();
            let times: Vec<String> =
                times.map(|(tool, &periods)| format!("T{tool} {}", clock(self.seconds(periods)))).collect();
            let _ = write!(text, "\n  motion with each tool: {}", times.join(", "));
        }
        if let Some((line, feed)) = analysis.feed_beyond {
            let most = self.machine.path_velocity_mm_s * 60.0;
            let _ = write!(
                text,
                "\n  warning: line {line} programs a feed of {feed:.1} mm/min; the machine's maximum is {most:.1} \
                    mm/min"
            );
        }
        if let Some((most, max_s)) = self.speed_above_limit() {
            let _ = write!(
                text,
                "\n  warning: S{most} is above the highest of card.spindle_pwm, {max_s}: the output stays as at \
                 S{max_s}"
            );
        }
        for room in analysis.travel_left() {
            let TravelLeft { axis, extents_mm: [least, greatest], travel_left_mm: [below, above] } = room;
            let limits = self.machine.axes.iter().find(|one| one.name == axis).map_or([0.0; 2], |axis| axis.travel_mm);
            let _ = write!(
                text,
                "\n  {} {least:.3} … {greatest:.3} mm, within the soft limits {} … {} mm: margin {below:.3} below, \
                    {above:.3} above",
                axis.to_ascii_uppercase(),
                limits[0],
                limits[1]
            );
        }
        for work in analysis.offsets() {
            let _ = write!(text, "\n  in {}: {}", system_name(work.offset.system), self.work_text(work));
        }
        let tools: Vec<String> = analysis.tools.iter().map(|&number| self.tool_text(number)).collect();
        if !tools.is_empty() {
            let _ = write!(text, "\n  tools: {}", tools.join(", "));
        }
        let (word, unit) = if self.has_spindle() { ("spindle", " turns/min") } else { ("S", "") };
        let ranges = [("feed", analysis.feed_mm_per_min, " mm/min"), (word, analysis.speed_rpm, unit)];
        let ranges: Vec<String> =
            ranges.iter().filter_map(|(what, range, unit)| range_text(what, *range, unit)).collect();
        if !ranges.is_empty() {
            let _ = write!(text, "\n  {}", ranges.join(" · "));
        }
        text += &self.measurements_text();
        let barriers = analysis.barriers.iter().map(|barrier| format!("{} of line {}", barrier.code, barrier.line));
        text += &list_line("cannot be passed backward", barriers);
        let threads = analysis
            .threads
            .iter()
            .map(|(line, [run_in, run_out])| format!("line {line}: run-in {run_in:.2} mm, run-out {run_out:.2} mm"));
        text += &list_line("threads", threads);
        text += &list_line("stops", analysis.stops.iter().map(|line| format!("line {line}")));
        text
    }

    /// Note about the moves whose ends the machine decides; empty without any.
    fn measurements_text(&self) -> String {
        match self.analysis.scan.unknown_moves.len() {
            0 => String::new(),
            1 => "\n  note: 1 move depends on measurements; its limits are checked as it is planned".to_owned(),
            count => {
                format!("\n  note: {count} moves depend on measurements; their limits are checked as they are planned")
            }
        }
    }

    /// Whether M3 turns a spindle. Where it switches a torch, a jet or a beam, S is no speed.
    fn has_spindle(&self) -> bool {
        self.machine.cutters.iter().all(|cutter| cutter.fire != channel::SPINDLE || !cutter.kind.cuts_at_rest())
    }

    /// Returns the greatest S and `card.spindle_pwm.max_s`, if S is above it.
    fn speed_above_limit(&self) -> Option<(f64, f64)> {
        let card = &self.machine.card;
        let highest = card.speed_curve.and_then(|curve| curve.points().last().map(|point| point.speed));
        let max_s = f64::from(highest.or(self.machine.spindle_pwm().map(|pwm| pwm.full_scale))?) / 1000.0;
        let most = self.analysis.speed_rpm?.greatest;
        (most > max_s).then_some((most, max_s))
    }

    fn work_text(&self, work: &WorkExtents<A>) -> String {
        let Some(extents) = work.extents_mm else {
            return format!("rotated by {}°", work.offset.rotation_deg);
        };
        // An axis whose positions are unknown has no extents.
        let axes = self.machine.axes.iter().zip(extents).filter(|(_, [least, _])| least.is_finite());
        let ranges = axes
            .map(|(axis, [least, greatest])| format!("{} {least:.3} … {greatest:.3}", axis.name.to_ascii_uppercase()));
        ranges.collect::<Vec<_>>().join("  ") + " mm"
    }

    fn tool_text(&self, number: u32) -> String {
        let table = self.program.tool_table();
        let Some(Tool { offset, diameter, .. }) = table.and_then(|table| table.get(number)).filter(|_| number > 0)
        else {
            return format!("T{number}");
        };
        let name = table.and_then(|table| table.name(number)).map(|name| format!("{name}, ")).unwrap_or_default();
        format!("T{number} ({name}length {:.3} mm, diameter {diameter:.3} mm)", offset[Axis::Z])
    }

    /// Report as one JSON object.
    pub fn json(&self) -> Value {
        let Self { analysis, .. } = self;
        let room = analysis.travel_left();
        let each = |value: fn(&TravelLeft) -> [f64; 2]| -> Value {
            room.iter().map(|room| (room.axis.to_string(), json!(value(room)))).collect::<Map<_, _>>().into()
        };
        let table = self.program.tool_table();
        let tools = analysis.tools.iter().map(|&number| {
            let tool = table.and_then(|table| table.get(number));
            json!({
                "number": number,
                "name": table.and_then(|table| table.name(number)),
                "length_mm": tool.map(|tool| tool.offset[Axis::Z]),
                "diameter_mm": tool.map(|tool| tool.diameter),
            })
        });
        let fallbacks = analysis.plan_fallbacks();
        let range = |range: Option<ValueRange>| range.map(|range| [range.least, range.greatest]);
        let mut report = json!({
            "event": "check",
            "program": self.program.name(),
            "machine": self.machine.name,
            "blocks": self.blocks,
            "moves": analysis.scan.moves,
            "period_ms": f64::from(self.machine.period_us) / 1000.0,
            "is_time_partial": analysis.is_time_partial,
            "measured_moves": analysis.scan.unknown_moves,
            "motion_s": self.seconds(analysis.motion_periods),
            "plan_fallbacks": {
                "no_plan": fallbacks.no_plan,
                "stops_in_first_block": fallbacks.stops_in_first_block,
                "approaches": fallbacks.approaches,
            },
            "dwell_s": self.seconds(analysis.dwell_periods),
            "switch_s": self.seconds(analysis.switch_periods),
            "extents_mm": each(|room| room.extents_mm),
            "travel_left_mm": each(|room| room.travel_left_mm),
            "work_offsets": analysis.offsets().map(|work| self.work_json(work)).collect::<Vec<_>>(),
            "tools": tools.collect::<Vec<_>>(),
            "feed_mm_per_min": range(analysis.feed_mm_per_min),
            "speed_rpm": range(analysis.speed_rpm),
            "threads": analysis.threads.iter()
                .map(|(line, [run_in, run_out])| json!({ "line": line, "run_in_mm": run_in, "run_out_mm": run_out }))
                .collect::<Vec<_>>(),
            "barriers": analysis.barriers.iter().map(|b| json!({ "line": b.line, "code": b.code })).collect::<Vec<_>>(),
            "stops": analysis.stops,
            "total_s": self.total_s(),
            "cutting_mm": analysis.cutting_mm,
            "rapid_mm": analysis.rapid_mm,
            "pierces": analysis.pierces,
            "pierce_s": self.seconds(analysis.pierce_periods),
            "contours": contour_report::contours_json(&analysis.scan.contours, self.machine),
            "contour_count": analysis.scan.contours.count,
            "materials": contour_report::materials_json(&analysis.scan.contours),
            "tool_motion_s": analysis
                .tool_periods
                .iter()
                .map(|(tool, &periods)| (tool.to_string(), json!(self.seconds(periods))))
                .collect::<Map<_, _>>(),
            "diagnostics": self.diagnostics,
            "feed_above_limit": analysis.feed_beyond.map(|(line, feed)| json!({"line": line, "feed_mm_per_min": feed})),
            "speed_above_limit": self.speed_above_limit().map(|(most, max_s)| json!({"s": most, "max_s": max_s})),
        });
        if let Value::Object(fields) = &mut report {
            fields.append(&mut self.cutting().json());
        }
        report
    }

    /// Sensings, starts, abrasive and cost.
    fn cutting(&self) -> CuttingReport<'_> {
        CuttingReport::new(self.machine, self.analysis, self.total_s())
    }

    /// Time of the whole program.
    fn total_s(&self) -> f64 {
        let analysis = self.analysis;
        self.seconds(analysis.motion_periods + analysis.dwell_periods + analysis.switch_periods)
    }

    fn work_json(&self, work: &WorkExtents<A>) -> Value {
        let axes = || self.machine.axes.iter();
        let origin: Map<_, _> =
            axes().map(|axis| (axis.name.to_string(), json!(work.offset.origin_mm[Axis::ALL[axis.index()]]))).collect();
        let extents = work.extents_mm.map(|extents| {
            let known = axes().zip(extents).filter(|(_, [least, _])| least.is_finite());
            known.map(|(axis, range)| (axis.name.to_string(), json!(range))).collect::<Map<_, _>>()
        });
        json!({
            "system": system_name(work.offset.system),
            "origin_mm": origin,
            "rotation_deg": work.offset.rotation_deg,
            "extents_mm": extents,
        })
    }

    /// Converts periods to whole microseconds first, as the report of a run does.
    fn seconds(&self, periods: u64) -> f64 {
        (u128::from(periods) * u128::from(self.machine.period_us)) as f64 / 1e6
    }
}

/// Formats seconds as h:mm:ss, rounded up.
fn clock(seconds: f64) -> String {
    let seconds = seconds.ceil() as u64;
    format!("{}:{:02}:{:02}", seconds / 3600, seconds / 60 % 60, seconds % 60)
}

fn range_text(what: &str, range: Option<ValueRange>, unit: &str) -> Option<String> {
    let ValueRange { least, greatest } = range?;
    Some(if least == greatest {
        format!("{what} {least:.1}{unit}")
    } else {
        format!("{what} {least:.1} … {greatest:.1}{unit}")
    })
}

/// Formats a line with the first of many items, and the number of the others.
fn list_line(what: &str, things: impl ExactSizeIterator<Item = String>) -> String {
    let more = things.len().saturating_sub(MAX_LISTED);
    let shown: Vec<String> = things.take(MAX_LISTED).collect();
    match (shown.is_empty(), more) {
        (true, _) => String::new(),
        (false, 0) => format!("\n  {what}: {}", shown.join(", ")),
        (false, more) => format!("\n  {what}: {}, and {more} more", shown.join(", ")),
    }
}
