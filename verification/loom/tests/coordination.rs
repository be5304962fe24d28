//! The two threads of GMC-7 under loom: order holds in the card's own time line, no thread sleeps for ever, and the
//! coordinator is woken only when K holds, for any order of the threads and any delay of the card's reports.

use retrace_loom::coordination::Job;
use retrace_loom::explore::{explore, is_full};

/// Explores a job from just before the wrap of place numbers with two preemptions, or three in the full exploration,
/// and compares the outcomes, pairs of `due_at_once` and `woken`, with the known ones.
fn check(records: u32, markers: &[u32], lag: usize, known: &[(u32, u32)]) {
    explored(Job { start: u32::MAX, records, markers: markers.to_vec(), lag, disturbed: 0 }, known);
}

fn explored(job: Job, known: &[(u32, u32)]) {
    let Job { records, markers, lag, disturbed, .. } = &job;
    let name = format!("coordination {records} records, markers before {markers:?}, lag {lag}, disturbed {disturbed}");
    let bound = if is_full() { 3 } else { 2 };
    let report = explore(&name, Some(bound), move || job.clone().run());
    let seen: Vec<_> = report.outcomes.iter().map(|seen| (seen.due_at_once, seen.woken)).collect();
    if is_full() {
        assert!(known.iter().all(|outcome| seen.contains(outcome)), "{name}: an outcome is missing: {seen:?}");
    } else {
        assert_eq!(seen, known, "{name}: not the outcomes that are known");
    }
}

#[test]
fn one_instruction_before_any_motion() {
    check(2, &[0], 0, &[(1, 1), (1, 2)]);
}

#[test]
fn one_instruction_between_two_records() {
    check(2, &[1], 1, &[(0, 1), (0, 2), (1, 1), (1, 2)]);
}

#[test]
fn one_instruction_behind_all_motion() {
    check(2, &[2], 1, &[(0, 1), (0, 2), (1, 1), (1, 2)]);
}

#[test]
fn two_instructions_at_one_place() {
    check(1, &[1, 1], 1, &[(1, 2), (1, 3), (1, 4), (2, 2), (2, 3), (2, 4)]);
}

#[test]
fn two_instructions_and_two_records() {
    check(2, &[0, 1], 1, &[(1, 2), (1, 3), (1, 4), (2, 2), (2, 3), (2, 4)]);
}

#[test]
fn two_instructions_and_three_records() {
    let known = [(0, 2), (0, 3), (0, 4), (1, 2), (1, 3), (1, 4), (2, 3), (2, 4)];
    check(3, &[1, 3], 2, &known);
}

/// A condition variable may wake a thread without a cause; no engine does, so the card does.
#[test]
fn one_instruction_and_a_wake_up_for_nothing() {
    explored(
        Job { start: u32::MAX, records: 1, markers: vec![1], lag: 0, disturbed: 2 },
        &[(0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3)],
    );
}
