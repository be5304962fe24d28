//! Console of a run: prints JSON lines, plain lines or a progress bar; and writes the file of executed records.
//!
//! Invariant: every record is monitored and, where requested, written, whatever is printed.

use std::fs::File;
use std::io::{BufWriter, IsTerminal, Write};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use retrace_config::{ChannelNames, MachineConfig, NumberedError, RetraceOutputs};
use retrace_controller::{
    ContourList, Event, EventKind, LimitMonitor, LimitReport, MonitorLimits, Observer, PeriodRecord, Telemetry,
};
use retrace_core::Rate;
use retrace_journal::HoldReason;
use retrace_tui::ModelObserver;

use crate::cut_progress::CutProgress;
use crate::escape;
use crate::files::unwritable;

/// Form of the output.
pub enum ConsoleOptions {
    /// One JSON object per line on standard output.
    Json,
    /// Plain lines on standard output.
    Plain,
    /// Progress bar on a terminal, with events above it.
    Bar(ProgressBar),
    /// Full screen.
    Screen(Box<ModelObserver>),
}

impl ConsoleOptions {
    /// Chooses the form: JSON where requested; otherwise a bar on a terminal, plain lines elsewhere. `lines` is the
    /// length of the program, if known.
    pub fn choose(json: bool, lines: Option<u64>) -> Self {
        if json {
            return Self::Json;
        }
        if !std::io::stderr().is_terminal() {
            return Self::Plain;
        }
        let bar = lines.map_or_else(ProgressBar::no_length, ProgressBar::new);
        let template = "{bar:24} block {pos}/{len}  {elapsed_precise} < {eta_precise}  {msg}";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        Self::Bar(bar)
    }
}

/// Observer of a run for the command.
pub struct Console<'m, const A: usize> {
    show: ConsoleOptions,
    machine: &'m MachineConfig,
    monitor: LimitMonitor<A>,
    records: Option<(BufWriter<File>, Option<std::io::Error>)>,
    /// Outputs that retracing switched in the current period: `5=0 66=1`. `None` where it switches none on this
    /// machine.
    retrace_switched: Option<String>,
    alarms: Vec<String>,
    names: ChannelNames,
    cut_progress: CutProgress<'m>,
    line: u32,
    shown: Instant,
    /// Number of the last reported period, and whether the machine was at rest in it.
    last: Option<(u64, bool)>,
}

impl<'m, const A: usize> Console<'m, A> {
    /// Console; `records` is the path of the file for the records, and `contours` are those of the plan.
    ///
    /// # Errors
    /// `E2105` where that file cannot be created.
    pub fn new(
        show: ConsoleOptions,
        machine: &'m MachineConfig,
        records: Option<&Path>,
        contours: Option<Arc<ContourList<9>>>,
    ) -> Result<Self, NumberedError> {
        let axis = |i: usize| {
            let axis = &machine.axes[i.min(machine.axes.len() - 1)];
            MonitorLimits {
                pulses_per_mm: axis.pulses_per_mm,
                velocity_mm_s: axis.max_velocity_mm_per_s,
                acceleration_mm_s2: axis.max_acceleration_mm_per_s2,
                jerk_mm_s3: axis.max_jerk_mm_per_s3,
            }
        };
        let records = match records {
            None => None,
            Some(path) => Some((create(path, machine)?, None)),
        };
        let jerks = machine.probing_jerks_mm_per_s3();
        let jerk = |i: usize| jerks[i.min(jerks.len() - 1)];
        let judge = LimitMonitor::new(&std::array::from_fn(axis), machine.period_s())
            .with_probing_jerks(&std::array::from_fn(jerk));
        let names = ChannelNames::of_machine(machine);
        Ok(Self {
            show,
            machine,
            monitor: judge,
            records,
            retrace_switched: switches_while_retracing(machine).then(String::new),
            alarms: Vec::new(),
            names,
            cut_progress: CutProgress::new(machine, contours),
            line: 0,
            shown: Instant::now(),
            last: None,
        })
    }

    /// Ends the console. Returns the report of the limit monitor, the alarms, the last line executed, and `E2105` where
    /// the records could not be written completely.
    pub fn finish(self) -> (LimitReport<A>, Vec<String>, u32, Option<NumberedError>) {
        let lost = self.records.and_then(|(mut file, error)| {
            let flushed = file.flush();
            error.or(flushed.err()).map(|error| unwritable("the records", &error))
        });
        if let ConsoleOptions::Bar(bar) = &self.show {
            bar.finish_and_clear();
        }
        // Where the machine was in motion at the last report, how it came to rest was not measured.
        let is_at_rest = self.last.is_none_or(|(_, at_rest)| at_rest);
        let limit_report = if is_at_rest { self.monitor.finish() } else { self.monitor.finish_moving() };
        (limit_report, self.alarms, self.line, lost)
    }

    fn write_record(&mut self, status: &PeriodRecord<A>) {
        let Some((file, error)) = &mut self.records else { return };
        if error.is_none() {
            let switched = self.retrace_switched.as_deref();
            let columns = RecordColumns {
                axes: self.machine.axes.len(),
                has_layer: self.machine.tool_layer().is_some(),
                switched,
                is_dry: self.machine.inhibits_outputs,
            };
            *error = record_row(file, status, &columns).err();
        }
        if let Some(switched) = &mut self.retrace_switched {
            switched.clear();
        }
    }

    fn progress(&mut self, status: &PeriodRecord<A>) {
        // The clock is read rarely: a period takes some tens of nanoseconds.
        let ConsoleOptions::Bar(bar) = &self.show else { return };
        if !status.period.is_multiple_of(64) || self.shown.elapsed() < Duration::from_millis(50) {
            return;
        }
        self.shown = Instant::now();
        let mut position = String::new();
        let tool = self.machine.tool_layer().map(|layer| layer.index);
        for (at, (axis, count)) in self.machine.axes.iter().zip(&status.counts).enumerate() {
            let name = axis.name.to_ascii_uppercase();
            let layer = if tool == Some(at) { i64::from(status.layer) } else { 0 };
            position += &format!("{name}{:.3} ", axis.mm_of(count + layer));
        }
        let step: f64 = self
            .machine
            .axes
            .iter()
            .zip(&status.increments)
            .map(|(a, &i)| (f64::from(i) / a.pulses_per_mm).powi(2))
            .sum();
        let feed = step.sqrt() / self.machine.period_s() * 60.0;
        let percent = |rate: Rate| f64::from(rate) * 100.0;
        let (rate, over) = (percent(status.rate), percent(status.override_rate));
        let rapids = match status.rapid_override {
            Rate::ONE => String::new(),
            rate => format!(", rapids {:.0} %", percent(rate)),
        };
        let spindle = match status.speed_override {
            Rate::ONE => String::new(),
            rate => format!(", S {:.0} %", percent(rate)),
        };
        let off = if status.override_is_off { " (switched off by the program)" } else { "" };
        let held = status.hold_reason == HoldReason::Hold;
        let state = if held { "hold".into() } else { format!("{:?}", status.mode).to_lowercase() };
        bar.set_position(u64::from(status.line));
        bar.set_message(format!(
            "{position} F{feed:.0} mm/min  rate {rate:.0} %  override {over:.0} %{rapids}{spindle}{off}  {state}"
        ));
    }
}

impl<const A: usize> Observer<A> for Console<'_, A> {
    fn on_telemetry(&mut self, telemetry: &Telemetry<A>) {
        if !matches!(self.show, ConsoleOptions::Screen(_)) {
            self.cut_progress.observe(telemetry);
        }
        match telemetry {
            Telemetry::Period(period) => {
                if self.last.is_some_and(|(last, _)| period.period > last + 1) {
                    self.monitor.skip_unmeasured();
                }
                self.last = Some((period.period, period.at_rest));
                if period.is_probing {
                    self.monitor.push_probing(&period.increments, period.rate);
                } else {
                    self.monitor.push(&period.increments, period.rate);
                }
                self.line = period.line;
                self.write_record(period);
                self.progress(period);
                if matches!(self.show, ConsoleOptions::Json)
                    && let Some(progress) = self.cut_progress.due_json(period)
                {
                    crate::out::line(progress);
                }
            }
            Telemetry::Event(event) => self.event(event),
            Telemetry::Output(_) | Telemetry::Active(_) => {}
        }
        if let ConsoleOptions::Screen(screen) = &mut self.show {
            screen.on_telemetry(telemetry);
        }
    }
}

impl<const A: usize> Console<'_, A> {
    /// Prints a line for a person, on standard error.
    pub fn print_note(&self, text: &str) {
        match &self.show {
            ConsoleOptions::Json | ConsoleOptions::Plain => eprintln!("{}", escape::lines(text)),
            ConsoleOptions::Bar(bar) => bar.println(escape::lines(text)),
            ConsoleOptions::Screen(_) => {}
        }
    }

    fn event(&mut self, event: &Event) {
        if let EventKind::Alarm(error) = &event.kind {
            let (number, cause, _) = error.parts();
            self.alarms.push(format!("{number}: {cause}"));
        }
        if let (EventKind::RetraceSwitched(channel, value), Some(switched)) = (&event.kind, &mut self.retrace_switched)
        {
            let space = if switched.is_empty() { "" } else { " " };
            *switched += &format!("{space}{channel}={value}");
        }
        match &self.show {
            ConsoleOptions::Plain | ConsoleOptions::Bar(_) if event.is_detail() => {}
            ConsoleOptions::Json => crate::out::line(event.to_json_naming(&self.names)),
            ConsoleOptions::Plain => crate::out::line(event.to_line(&self.names)),
            ConsoleOptions::Bar(bar) => bar.println(escape::lines(&event.to_line(&self.names))),
            ConsoleOptions::Screen(_) => {}
        }
        if let Some(list) = self.cut_progress.list(event) {
            match &self.show {
                ConsoleOptions::Json => crate::out::line(list.json()),
                ConsoleOptions::Plain => crate::out::line(list.text()),
                ConsoleOptions::Bar(bar) => bar.println(escape::lines(&list.text().to_string())),
                ConsoleOptions::Screen(_) => {}
            }
        }
    }
}

fn create(path: &Path, machine: &MachineConfig) -> Result<BufWriter<File>, NumberedError> {
    let named = |error| unwritable(&path.display().to_string(), &error);
    let mut file = BufWriter::with_capacity(1 << 18, File::create(path).map_err(named)?);
    let axes: Vec<String> = machine.axes.iter().map(|a| a.name.to_string()).collect();
    let layer = if machine.tool_layer().is_some() { ",layer" } else { "" };
    let switched = if switches_while_retracing(machine) { ",retrace_switched" } else { "" };
    let dry = if machine.inhibits_outputs { ",dry_run" } else { "" };
    writeln!(file, "period,line,rate,record,fraction,{}{layer}{switched}{dry}", axes.join(",")).map_err(named)?;
    Ok(file)
}

/// Whether the machine switches outputs while the path is retraced.
fn switches_while_retracing(machine: &MachineConfig) -> bool {
    machine.retrace_outputs == RetraceOutputs::Replayed
}

/// What follows the fixed columns of a row.
struct RecordColumns<'s> {
    axes: usize,
    has_layer: bool,
    switched: Option<&'s str>,
    is_dry: bool,
}

/// Writes `period,line,rate,record,fraction,<axis>…`: the rate with nine decimals and never −0, the fraction in 2⁻³².
/// On a machine that senses the sheet `layer` follows, the layer of the tool axis in pulses at the end of the period.
/// Where retracing switches outputs, `retrace_switched` follows: `5=0 66=1`, each channel that was switched in the
/// period with its value. In a dry run `dry_run` is the last column, with 1 in every row.
fn record_row<const A: usize>(
    out: &mut impl Write,
    status: &PeriodRecord<A>,
    columns: &RecordColumns<'_>,
) -> std::io::Result<()> {
    let rate = RateText(status.rate);
    write!(out, "{},{},{rate},{},{}", status.period, status.line, status.place.record, status.place.fraction)?;
    for increment in &status.increments[..columns.axes] {
        write!(out, ",{increment}")?;
    }
    if columns.has_layer {
        write!(out, ",{}", status.layer)?;
    }
    if let Some(switched) = columns.switched {
        write!(out, ",{switched}")?;
    }
    if columns.is_dry {
        out.write_all(b",1")?;
    }
    out.write_all(b"\n")
}

/// Rate with nine decimals, rounded half away from zero; never −0.
struct RateText(Rate);

impl std::fmt::Display for RateText {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        const NANO: u128 = 1_000_000_000;
        let billionths = (u128::from(self.0.units().unsigned_abs()) * NANO + (1 << 31)) >> 32;
        let sign = if self.0 < Rate::ZERO && billionths > 0 { "-" } else { "" };
        write!(f, "{sign}{}.{:09}", billionths / NANO, billionths % NANO)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_have_nine_decimals_and_no_negative_zero() {
        let text = |rate: Rate| RateText(rate).to_string();
        assert_eq!(text(Rate::ONE), "1.000000000");
        assert_eq!(text(-Rate::ONE / 2), "-0.500000000");
        assert_eq!(text(Rate::from_units(-1)), "0.000000000");
        assert_eq!(text(Rate::MAX - Rate::from_units(1)), "8.000000000");
        assert_eq!(text(Rate::ONE / 3), "0.333333333");
    }
}
