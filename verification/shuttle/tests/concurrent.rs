//! The ring and the two threads of GMC-7 under shuttle: larger cases than loom's, a fixed seed, random and PCT
//! schedules.

use retrace_shuttle::coordination::Job;
use retrace_shuttle::explore::{explore, is_full};
use retrace_shuttle::tape::Tape;

/// Schedules of either kind, quick or full.
fn schedules(quick: usize) -> usize {
    if is_full() { 10 * quick } else { quick }
}

#[test]
fn forty_records_and_six_instructions_stay_in_order_under_every_lag() {
    for (lag, disturbed) in [(0, 0), (1, 0), (3, 0), (7, 0), (1, 9)] {
        let job = Job { start: u32::MAX - 20, records: 40, markers: vec![0, 3, 3, 17, 30, 40], lag, disturbed };
        let report = explore(&format!("coordination lag {lag} disturbed {disturbed}"), schedules(1_000), move || {
            job.clone().run()
        });
        assert!(report.outcomes.len() >= 10, "{} outcomes only", report.outcomes.len());
    }
}

#[test]
fn a_long_tape_reads_what_was_pushed() {
    for (keep, look_ahead, staged) in [(0, 8, 1), (3, 5, 3), (6, 2, 1)] {
        let tape = Tape { keep, look_ahead, start: u32::MAX - 20, records: 60, staged, turn: 7 };
        let name = format!("walk keep {keep} look-ahead {look_ahead}");
        let report = explore(&name, schedules(500), move || tape.walk());
        assert!(report.outcomes.len() > 10, "{name}: {} outcomes only", report.outcomes.len());
        let name = format!("ask keep {keep} look-ahead {look_ahead}");
        let report = explore(&name, schedules(500), move || tape.ask());
        assert!(report.outcomes.len() > 10, "{name}: {} outcomes only", report.outcomes.len());
        let name = format!("follow keep {keep} look-ahead {look_ahead}");
        let report = explore(&name, schedules(500), move || tape.follow());
        assert!(report.outcomes.len() > 10, "{name}: {} outcomes only", report.outcomes.len());
    }
}
