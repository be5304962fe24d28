//! A pause in which something else is to happen.
//!
//! Invariant: a computer that stands still meanwhile, as a virtual machine does, makes the pause longer, so that what
//! runs beside the test still has its time.

use std::thread::sleep;
use std::time::Duration;

/// Length of a slice. Each counts as this long however long it took.
const SLICE: Duration = Duration::from_millis(10);

/// Pauses for this long of time in which the computer runs.
pub fn pause(time: Duration) {
    for _ in 0..time.as_millis().div_ceil(SLICE.as_millis()) {
        sleep(SLICE);
    }
}
