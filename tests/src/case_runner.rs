//! Runs the cases of a campaign beside each other, and counts their results.
//!
//! Invariant: every case runs, and the test fails where any result is an error.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::Instant;

use crate::command::cases;

/// Seed of the first case: that of the campaign (`RETRACE_FIRST_SEED`), otherwise 1.
#[must_use]
pub fn first_seed() -> u64 {
    std::env::var("RETRACE_FIRST_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(1)
}

/// Runs `case` with each seed, so many at a time, and prints how often each result came; `remark` adds to that line.
/// `usual` is the number of cases outside of a campaign.
///
/// # Panics
/// A case is wrong.
pub fn run_cases(
    usual: u32,
    at_a_time: usize,
    case: impl Fn(u64) -> Result<String, String> + Sync,
    remark: impl Fn() -> String + Sync,
) {
    let (next, of, begun) = (AtomicU32::new(0), cases(usual), Instant::now());
    let counted: Mutex<BTreeMap<String, u32>> = Mutex::new(BTreeMap::new());
    let wrong = Mutex::new(Vec::new());
    let print = |count: u32| {
        let counted = counted.lock().expect("no panic");
        println!("{count} jobs, {} in {:.0} s: {counted:?}", remark(), begun.elapsed().as_secs_f64());
    };
    thread::scope(|scope| {
        for _ in 0..at_a_time {
            scope.spawn(|| {
                while let number = next.fetch_add(1, Ordering::Relaxed)
                    && number < of
                {
                    match case(first_seed() + u64::from(number)) {
                        Ok(what) => *counted.lock().expect("no panic").entry(what).or_default() += 1,
                        Err(what) => {
                            println!("WRONG {what}");
                            wrong.lock().expect("no panic").push(what);
                        }
                    }
                    if number % 20 == 19 {
                        print(number + 1);
                    }
                }
            });
        }
    });
    print(of);
    let wrong = wrong.into_inner().expect("no panic");
    assert!(wrong.is_empty(), "{} of {of} differ:\n{}", wrong.len(), wrong.join("\n\n"));
}
