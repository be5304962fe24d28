//! `retrace doctor`: measures how fast this computer and the line to a card respond, and whether a machine's control
//! period suits them.
//!
//! Invariant: nothing moves and nothing is changed, but in a step test. Time in which the computer itself was suspended
//! is listed, not averaged.

use retrace_core::RecordIndex;
use std::time::{Duration, Instant};

use retrace_config::MachineConfig;
use retrace_hal_serial::LatencyTimer;
use retrace_link::PathStart;
use serde_json::{Value, json};

use crate::command_failure::CommandFailure;
use crate::linked_card;
use crate::{args, files, step_test};

/// Upper bounds of the histogram's classes, in microseconds; the last class has none.
const CLASSES_US: [u64; 12] = [10, 20, 50, 100, 200, 500, 1_000, 2_000, 5_000, 10_000, 20_000, 50_000];
/// Lateness from which a wake-up is listed, and the maximum number of those listed.
const LISTED_US: u64 = 1_000;
const MAX_LISTED: usize = 200;
/// Minimum number of requests to the card, and the pause between two.
const QUESTIONS: usize = 200;
const PAUSE: Duration = Duration::from_millis(2);
/// Duration above which a round trip is late because of the system and not the line, in microseconds.
const LATE_LINE_US: u64 = 20_000;

/// Latency of a thread that sleeps from period to period.
#[derive(Clone, Debug, Default)]
struct WakeUps {
    /// Number of wake-ups by class.
    counts: [u64; CLASSES_US.len() + 1],
    total: u64,
    worst_us: u64,
    /// Late ones: seconds since the start, and latency.
    late: Vec<(f64, u64)>,
}

impl WakeUps {
    fn record(&mut self, at_s: f64, late_us: u64) {
        let class = CLASSES_US.iter().position(|&bound| late_us <= bound).unwrap_or(CLASSES_US.len());
        self.counts[class] += 1;
        self.total += 1;
        self.worst_us = self.worst_us.max(late_us);
        if late_us > LISTED_US && self.late.len() < MAX_LISTED {
            self.late.push((at_s, late_us));
        }
    }

    /// Upper bound of the class that contains this quantile, given in millionths, in microseconds.
    fn quantile_us(&self, millionths: u64) -> u64 {
        let wanted = (self.total * millionths).div_ceil(1_000_000);
        let mut seen = 0;
        for (count, bound) in self.counts.iter().zip(CLASSES_US) {
            seen += count;
            if seen >= wanted {
                return bound.min(self.worst_us);
            }
        }
        self.worst_us
    }

    fn to_json(&self) -> Value {
        let classes: Vec<Value> = self
            .counts
            .iter()
            .enumerate()
            .map(|(class, count)| json!({"up_to_us": CLASSES_US.get(class), "count": count}))
            .collect();
        let late: Vec<Value> = self.late.iter().map(|(at, us)| json!({"at_s": at, "late_us": us})).collect();
        json!({"count": self.total, "worst_us": self.worst_us, "p99_99_us": self.quantile_us(999_900),
            "classes": classes, "late": late})
    }
}

/// Measurement of the line to a card.
#[derive(Clone, Debug)]
struct LineMeasurement {
    typical_us: u64,
    worst_us: u64,
    window: u32,
    latency: String,
}

/// Runs the command.
///
/// # Errors
/// The machine file has errors, or the card fails.
pub fn run(args: &args::Doctor) -> Result<(), CommandFailure> {
    let machine = files::machine(args.machine_file.path())?;
    if let (Some(letter), Some(port)) = (args.step_test, &args.port) {
        return step_test::run(port, &machine, letter, (args.yes, args.format.json));
    }
    let permitted = retrace_real_time::permitted();
    let seconds = args.seconds.clamp(0.1, 86_400.0);
    let stolen = steal_ticks();
    let period = Duration::from_micros(u64::from(machine.period_us));
    let measure = move || wake_ups(period, Duration::from_secs_f64(seconds));
    let wake_ups =
        std::thread::Builder::new().name("wake-ups".into()).spawn(measure).ok().and_then(|it| it.join().ok());
    let wake_ups = wake_ups.unwrap_or_default();
    let stolen = steal_ticks().zip(stolen).map(|(after, before)| after.saturating_sub(before));
    let line = args.port.as_deref().map(|port| line::<9>(port, seconds)).transpose()?;
    let verdict = PeriodVerdict::of(&machine, &wake_ups, line.as_ref());
    if args.format.json {
        crate::out::line(json!({
            "real_time": permitted.is_ok(),
            "period_ms": f64::from(machine.period_us) / 1000.0,
            "wake_ups": wake_ups.to_json(),
            "stolen_ticks": stolen,
            "round_trip_us": line.as_ref().map(|line| json!({"typical": line.typical_us, "worst": line.worst_us})),
            "usb_latency": line.as_ref().map(|line| line.latency.as_str()),
            "fits": verdict.fits,
            "watchdog_ms": verdict.watchdog_ms,
        }));
        return Ok(());
    }
    match &permitted {
        Ok(()) => say!("real-time scheduling: permitted"),
        Err(denied) => say!("real-time scheduling: {denied}\n  {GRANT}"),
    }
    say!("wake-up latency of {} periods of {} ms:", wake_ups.total, f64::from(machine.period_us) / 1000.0);
    for (class, count) in wake_ups.counts.iter().enumerate().filter(|(_, count)| **count > 0) {
        match CLASSES_US.get(class) {
            Some(bound) => say!("  up to {bound:>6} µs  {count}"),
            None => say!("      more         {count}"),
        }
    }
    say!("  worst {} µs, 99.99 % within {} µs", wake_ups.worst_us, wake_ups.quantile_us(999_900));
    for (at, late) in wake_ups.late.iter().take(20) {
        say!("  at {at:.3} s: {:.1} ms late", *late as f64 / 1000.0);
    }
    if let Some(stolen) = stolen.filter(|&stolen| stolen > 0) {
        say!("  the host of this virtual machine took {} ms of processor time during the measurement", stolen * 10);
    }
    if let Some(line) = &line {
        say!(
            "round trip to the card: typically {} µs, at most {} µs; USB latency timer: {}",
            line.typical_us,
            line.worst_us,
            line.latency
        );
    }
    if line.as_ref().is_some_and(|line| line.worst_us > LATE_LINE_US && wake_ups.worst_us < LATE_LINE_US) {
        say!("  {LATE_LINE}");
    }
    say!("{}", verdict.text(&machine));
    Ok(())
}

/// How to permit real-time scheduling, in one line.
pub const GRANT: &str = "to permit it: a file in /etc/security/limits.d with `@realtime - rtprio 90` and `@realtime - \
    memlock unlimited`, \
    and your user in the group realtime; or `sudo setcap cap_sys_nice,cap_ipc_lock+ep` on the retrace binary";

/// Cause of a late line on a prompt computer.
const LATE_LINE: &str = "the line is late although this computer wakes promptly: on Linux an ordinary kernel \
    worker (kworker/u…, events_unbound) forwards the bytes of every tty; run fewer programs, keep a core free, do \
    not group processes by session (`sysctl kernel.sched_autogroup_enabled=0`), or raise the workers' priority \
    (`chrt -f -p 45 PID`)";

/// Sleeps from period to period, under SCHED_FIFO where that is permitted.
fn wake_ups(period: Duration, length: Duration) -> WakeUps {
    // Without permission the latency is measured without it.
    let _ = retrace_real_time::enter();
    let (begun, mut found) = (Instant::now(), WakeUps::default());
    let mut due = begun + period;
    while due.duration_since(begun) < length {
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let now = Instant::now();
        found.record(due.duration_since(begun).as_secs_f64(), now.saturating_duration_since(due).as_micros() as u64);
        due += period;
        // Several periods slept through are one late wake-up.
        while due < now {
            due += period;
        }
    }
    found
}

/// Measures the round trip to a card with repeated requests.
fn line<const A: usize>(port: &str, seconds: f64) -> Result<LineMeasurement, CommandFailure> {
    let mut card = linked_card::find::<A>(port)?;
    let _ = retrace_real_time::enter();
    let mut trips = Vec::new();
    let begun = Instant::now();
    while trips.len() < QUESTIONS || begun.elapsed().as_secs_f64() < seconds {
        let asked = Instant::now();
        card.request_greeting(linked_card::nonce()).map_err(|fault| linked_card::card_error(port, &fault))?;
        trips.push(asked.elapsed().as_micros() as u64);
        std::thread::sleep(PAUSE);
    }
    let _ = retrace_real_time::leave();
    trips.sort_unstable();
    let latency = match card.port().latency() {
        LatencyTimer::None => "none".to_owned(),
        LatencyTimer::Set { ms } => format!("{ms} ms"),
        LatencyTimer::ReadOnly { ms, remedy } => format!("{ms} ms; {remedy}"),
    };
    Ok(LineMeasurement {
        typical_us: trips.get(trips.len() / 2).copied().unwrap_or(0),
        worst_us: trips.last().copied().unwrap_or(0),
        window: card.greeting().map_or(0, |greeting| greeting.identity.window),
        latency,
    })
}

/// Verdict on the machine's control period.
struct PeriodVerdict {
    fits: bool,
    /// Longest silence to be expected, in microseconds.
    worst_us: u64,
    /// Duration of the records that the card holds, in microseconds; `None` without a card.
    held_us: Option<u64>,
    watchdog_ms: u64,
    has_watchdog_ms: u64,
}

impl PeriodVerdict {
    fn of(machine: &MachineConfig, wake_ups: &WakeUps, line: Option<&LineMeasurement>) -> Self {
        let worst_us = wake_ups.worst_us + line.map_or(0, |line| line.worst_us);
        let period_us = u64::from(machine.period_us);
        let held_us = line.map(|line| u64::from(line.window.min(machine.look_ahead_records)) * period_us);
        let watchdog_periods = machine.card_settings::<9>(PathStart::at(RecordIndex::new(0))).watchdog_periods;
        let has_watchdog_ms = u64::from(watchdog_periods) * period_us / 1000;
        let watchdog_ms = (4 * worst_us / 1000).max(50).next_multiple_of(10);
        // The card runs on the records it holds: half of that time may pass without the host.
        let lasts = held_us.unwrap_or(u64::from(machine.look_ahead_records) * period_us) / 2;
        Self {
            fits: worst_us < lasts && worst_us / 1000 < has_watchdog_ms / 2,
            worst_us,
            held_us,
            watchdog_ms,
            has_watchdog_ms,
        }
    }

    fn text(&self, machine: &MachineConfig) -> String {
        let (period, worst) = (f64::from(machine.period_us) / 1000.0, self.worst_us as f64 / 1000.0);
        let held = self.held_us.map_or(String::new(), |us| format!(", the card holds records for {} ms", us / 1000));
        let fits = if self.fits { "fits" } else { "does not fit" };
        format!(
            "T = {period} ms {fits}: the host may be silent for {worst:.1} ms{held}, the watchdog of the machine file \
                is {} ms\n\
             proposed: [card] watchdog_ms = {}",
            self.has_watchdog_ms, self.watchdog_ms
        )
    }
}

/// Processor time that the host of a virtual machine took from all processors, in ticks of 10 ms.
fn steal_ticks() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/stat").ok()?;
    text.lines().next()?.split_whitespace().nth(8)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wake_ups_are_counted_by_class() {
        let mut found = WakeUps::default();
        (0..9_999).for_each(|_| found.record(0.0, 30));
        found.record(7.0, 3_000);
        assert_eq!((found.total, found.worst_us, found.late.as_slice()), (10_000, 3_000, &[(7.0, 3_000)][..]));
        assert_eq!((found.quantile_us(999_900), found.quantile_us(1_000_000)), (50, 3_000));
        let json = found.to_json();
        assert_eq!((&json["classes"][2]["count"], &json["classes"][8]["count"]), (&9_999.into(), &1.into()));
    }

    #[test]
    fn a_late_computer_does_not_fit_and_gets_a_longer_watchdog() {
        let machine = MachineConfig::built_in().expect("valid");
        let late = |us| WakeUps { worst_us: us, ..WakeUps::default() };
        assert!(PeriodVerdict::of(&machine, &late(2_000), None).fits);
        let slow = PeriodVerdict::of(&machine, &late(400_000), None);
        assert!(!slow.fits && slow.watchdog_ms == 1_600);
        assert_eq!(PeriodVerdict::of(&machine, &late(2_000), None).watchdog_ms, 50);
    }
}
