//! Hostile input: bytes, broken programs, tables and cycle sources, each through every entry point.
//!
//! Invariant: nothing panics, hangs or uses unbounded memory; every diagnostic is within its line and every number is
//! finite. The campaign is the same test with more time: RETRACE_FUZZ_SECONDS, RETRACE_FUZZ_SEED.

use crate::harm;
#[path = "harm/seeds.rs"]
mod seeds;

use harm::{cycle, program, tables};
use proptest::prelude::*;
use seeds::{Way, case};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Maximum duration of a case on any machine; a longer one counts as a hang.
const LONGEST: Duration = Duration::from_secs(60);

/// Maximum memory of a whole campaign, MiB.
const MAX_MEMORY: u64 = 1024;

fn survives(way: Way, text: &[u8]) {
    match way {
        Way::Program => program(text),
        Way::Tables => tables(text),
        Way::Cycle => cycle(text),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    #[test]
    fn any_bytes(text in prop::collection::vec(any::<u8>(), 0..300)) {
        for way in [Way::Program, Way::Tables, Way::Cycle] {
            survives(way, &text);
        }
    }

    #[test]
    fn any_characters(text in "([GMXZCYLEHOS81235(),\":.0-9A-Fa-z=\\[\\]#<> -]{0,40}\n){0,9}") {
        for way in [Way::Program, Way::Tables, Way::Cycle] {
            survives(way, text.as_bytes());
        }
    }

    #[test]
    fn broken_programs(seed in any::<u64>()) {
        let (way, text) = case(seed);
        survives(way, &text);
    }
}

/// Returns the peak memory of this process, MiB; `None` where the system does not report it.
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.split_whitespace().next()?.parse::<u64>().ok().map(|kib| kib / 1024)
}

fn number_of(variable: &str, otherwise: u64) -> u64 {
    std::env::var(variable).ok().and_then(|text| text.parse().ok()).unwrap_or(otherwise)
}

/// State of the two workers: the seed of the current case, and when it began.
struct Watch {
    next: AtomicU64,
    is_over: AtomicBool,
    /// Number of workers that have finished.
    done: AtomicU64,
    at_work: [Mutex<Option<(u64, Instant)>>; 2],
    failed: Mutex<Vec<u64>>,
}

impl Watch {
    fn work(&self, worker: usize, until: Instant) {
        while Instant::now() < until && !self.is_over.load(Ordering::Relaxed) {
            let seed = self.next.fetch_add(1, Ordering::Relaxed);
            *self.at_work[worker].lock().expect("a worker holds nothing while it works") = Some((seed, Instant::now()));
            let (way, text) = case(seed);
            if catch_unwind(AssertUnwindSafe(|| survives(way, &text))).is_err() {
                eprintln!("seed {seed}, {way:?}:\n{}\n", String::from_utf8_lossy(&text));
                self.failed.lock().expect("as above").push(seed);
            }
            *self.at_work[worker].lock().expect("as above") = None;
        }
        self.done.fetch_add(1, Ordering::Relaxed);
    }

    /// Reports each case that hangs and aborts the process, because its worker cannot be stopped.
    fn guard(&self) {
        while self.done.load(Ordering::Relaxed) < 2 {
            std::thread::sleep(Duration::from_millis(50));
            if self.failed.lock().expect("as above").len() >= 20 {
                self.is_over.store(true, Ordering::Relaxed);
            }
            for at_work in &self.at_work {
                let now = *at_work.lock().expect("as above");
                if let Some((seed, began)) = now
                    && began.elapsed() > LONGEST
                {
                    let (way, text) = case(seed);
                    eprintln!("seed {seed} hangs, {way:?}:\n{}\n", String::from_utf8_lossy(&text));
                    std::process::exit(101);
                }
            }
        }
    }
}

/// Two seconds in the test suite, half an hour as a campaign.
#[test]
fn a_campaign_of_broken_programs() {
    if let Ok(seed) = std::env::var("RETRACE_FUZZ_ONLY") {
        let (way, text) = case(seed.parse().expect("a seed"));
        eprintln!("{way:?}:\n{}", String::from_utf8_lossy(&text));
        let began = Instant::now();
        survives(way, &text);
        return eprintln!("survived in {:?}, {:?} MiB", began.elapsed(), peak_memory());
    }
    let seconds = number_of("RETRACE_FUZZ_SECONDS", 2);
    let fresh = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).map_or(1, |since| since.as_secs());
    let seed = number_of("RETRACE_FUZZ_SEED", fresh);
    let began = Instant::now();
    let until = began + Duration::from_secs(seconds);
    let watch = Watch {
        next: AtomicU64::new(seed << 24),
        is_over: AtomicBool::new(false),
        done: AtomicU64::new(0),
        at_work: [Mutex::new(None), Mutex::new(None)],
        failed: Mutex::new(Vec::new()),
    };
    std::thread::scope(|scope| {
        for worker in 0..2 {
            let watch = &watch;
            scope.spawn(move || watch.work(worker, until));
        }
        watch.guard();
    });
    let cases = watch.next.load(Ordering::Relaxed) - (seed << 24);
    let failed = watch.failed.lock().expect("the workers are done");
    println!(
        "{cases} cases from seed {seed} in {:.0} s, at most {:?} MiB",
        began.elapsed().as_secs_f64(),
        peak_memory()
    );
    assert!(failed.is_empty(), "{} of {cases} cases from seed {seed}: {failed:?}", failed.len());
    assert!(peak_memory().is_none_or(|most| most < MAX_MEMORY), "{:?} MiB", peak_memory());
}
