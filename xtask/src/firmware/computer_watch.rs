//! How far a computer that does other things has disturbed a check that runs in real time.
//!
//! Invariant: what is said of the computer is measured while the check runs, and never makes a check pass.

use std::fmt;
use std::fs;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// A thread that only sleeps wakes within a millisecond on a computer that is free, and within some more beside builds.
const LONGEST_STALL: Duration = Duration::from_millis(60);
/// Share of the processors' time that another virtual machine may take.
const MOST_STOLEN: f64 = 0.02;
const SLEEP: Duration = Duration::from_millis(1);

/// Watches the computer until it is asked.
pub(super) struct ComputerWatch {
    ends: Arc<AtomicBool>,
    stalls: JoinHandle<Duration>,
    before: Option<[u64; 2]>,
}

/// What was taken away from a check.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Disturbance {
    /// Longest time for which a thread that had only slept waited for a processor.
    longest_stall: Duration,
    /// Share of the processors' time that another virtual machine took.
    stolen: f64,
}

impl ComputerWatch {
    pub(super) fn start() -> Self {
        let ends = Arc::new(AtomicBool::new(false));
        let is_over = Arc::clone(&ends);
        let stalls = thread::spawn(move || {
            let mut longest = Duration::ZERO;
            while !is_over.load(Ordering::Relaxed) {
                let begun = Instant::now();
                thread::sleep(SLEEP);
                longest = longest.max(begun.elapsed().saturating_sub(SLEEP));
            }
            longest
        });
        Self { ends, stalls, before: processor_time() }
    }

    pub(super) fn end(self) -> Disturbance {
        self.ends.store(true, Ordering::Relaxed);
        let longest_stall = self.stalls.join().unwrap_or_default();
        let stolen = match (self.before, processor_time()) {
            (Some([all, stolen]), Some([all_later, stolen_later])) if all_later > all => {
                (stolen_later - stolen) as f64 / (all_later - all) as f64
            }
            _ => 0.0,
        };
        Disturbance { longest_stall, stolen }
    }
}

impl Disturbance {
    /// Whether a host in real time may have been late by it.
    pub(super) fn is_large(self) -> bool {
        self.longest_stall > LONGEST_STALL || self.stolen > MOST_STOLEN
    }
}

impl fmt::Display for Disturbance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (stall_ms, percent) = (self.longest_stall.as_millis(), 100.0 * self.stolen);
        write!(f, "the computer stood still for up to {stall_ms} ms, {percent:.1} % of its time was taken away")
    }
}

/// Time of all processors, and the part that other virtual machines took; `None` where the system does not tell.
fn processor_time() -> Option<[u64; 2]> {
    times_of(&fs::read_to_string("/proc/stat").ok()?)
}

/// user, nice, system, idle, iowait, irq, softirq and steal of the first line (proc(5)).
fn times_of(stat: &str) -> Option<[u64; 2]> {
    let times = stat.lines().next()?.strip_prefix("cpu ")?.split_whitespace().take(8);
    let times = times.map(|time| time.parse().ok()).collect::<Option<Vec<u64>>>()?;
    Some([times.iter().sum(), *times.get(7)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_that_was_taken_is_the_eighth_figure() {
        assert_eq!(times_of("cpu  10 20 30 40 5 6 7 82 900 1000\ncpu0 1 1\n"), Some([200, 82]));
        assert_eq!((times_of("cpu  1 2 3\n"), times_of("intr 5\n"), times_of("")), (None, None, None));
    }

    #[test]
    fn a_stall_or_a_share_of_the_time_is_a_disturbance() {
        let of = |ms, stolen| Disturbance { longest_stall: Duration::from_millis(ms), stolen }.is_large();
        assert_eq!([of(0, 0.0), of(60, 0.02), of(61, 0.0), of(0, 0.021)], [false, false, true, true]);
    }
}
