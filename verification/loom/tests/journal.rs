//! The journal's queue under loom: no entry is lost or out of order, no thread sleeps for ever, and nothing counts as
//! saved or durable before it is, for any order of the threads and any moment at which a limit of time passes.

use retrace_loom::explore::{explore, is_full};
use retrace_loom::journal_queue::Durability::{Synced, Written};
use retrace_loom::models::journal::Journal;

/// A job whose disk works.
const JOB: Journal = Journal { durability: Synced, capacity: 1, marks: 1, events: 1, failures: 0, waits: true };

fn check(name: &str, job: Journal) {
    let bound = if is_full() { 4 } else { 3 };
    let report = explore(&format!("journal {name} {job:?}"), Some(bound), move || job.run());
    let may_lose = job.failures > 0 || job.durability == Synced;
    assert!(may_lose || report.outcomes.iter().eq([&0]), "nothing is lost while the disk works");
}

#[test]
fn what_is_pushed_is_saved_before_waiting_ends() {
    check("synced", JOB);
    check("synced, two marks", Journal { marks: 2, waits: false, ..JOB });
}

#[test]
fn pushing_waits_for_space_and_is_woken() {
    check("written", Journal { durability: Written, ..JOB });
    check("written, two marks", Journal { durability: Written, marks: 2, events: 1, waits: false, ..JOB });
}

#[test]
fn a_disk_that_fails_once_is_written_again() {
    for durability in [Synced, Written] {
        check("fails once", Journal { durability, failures: 1, ..JOB });
    }
}

#[test]
fn a_disk_that_never_works_ends_the_writer() {
    for durability in [Synced, Written] {
        check("never works", Journal { durability, failures: u32::MAX, ..JOB });
    }
}
