//! What passes between the threads of a job, under loom: the batches of decoded blocks, the requests for manual moves,
//! the operator's commands. No thread sleeps or waits for ever, and nothing is lost, for any order of the threads.

use std::fmt::Debug;

use retrace_loom::explore::{Report, explore, is_full};
use retrace_loom::models::blocks::Blocks;
use retrace_loom::models::commands::Commands;
use retrace_loom::models::jog::{Jog, JogEnd};

/// Explores a model of two threads with no bound on preemptions.
fn explored<M: Copy + Debug + Send + Sync + 'static>(model: M, run: fn(M) -> u32) -> Report<u32> {
    explore(&format!("{model:?}"), None, move || run(model))
}

#[test]
fn every_block_is_planned_and_the_end_is_seen_behind_the_last() {
    for (blocks, capacity, batches) in [(0, 1, vec![0]), (3, 1, vec![3]), (3, 2, vec![2, 3])] {
        let report = explored(Blocks { blocks, capacity, cancelled_after: None }, Blocks::run);
        assert!(report.outcomes.iter().eq(&batches), "not the numbers of batches that are known: {report:?}");
    }
}

#[test]
fn a_decoder_that_nobody_listens_to_ends() {
    for cancelled_after in [0, 1] {
        explored(Blocks { blocks: 3, capacity: 1, cancelled_after: Some(cancelled_after) }, Blocks::run);
    }
}

#[test]
fn every_request_wakes_the_planning_thread_and_is_answered() {
    let report = explored(Jog { requests: 2, end: JogEnd::Done }, Jog::run);
    assert!(report.outcomes.iter().eq([&2]));
}

#[test]
fn a_request_is_cancelled_and_the_next_one_is_answered() {
    let report = explored(Jog { requests: 0, end: JogEnd::Cancelled }, Jog::run);
    assert!(report.outcomes.iter().eq([&2]));
}

#[test]
fn the_planning_thread_ends_with_the_motion_path() {
    for requests in [0, 1] {
        explored(Jog { requests, end: JogEnd::Dropped }, Jog::run);
    }
}

#[test]
fn a_command_is_received_once_or_refused_and_no_count_is_lost() {
    let model = Commands { capacity: 1, commands: 2, counts: [40_000, -3] };
    let bound = if is_full() { 4 } else { 3 };
    let report = explore(&format!("{model:?}"), Some(bound), move || model.run());
    assert!(report.outcomes.len() > 1, "a command is refused in some executions only: {report:?}");
}
