//! Reverse run to a target: the machine rests at the requested place and reports it.
//!
//! Invariant: the requested place is compared with a plain run, never with the code that searched it.

use retrace_controller::{CommandError, Event, EventKind, OperatorCommand};
use retrace_core::Rate;
use retrace_core::mode::Mode;
use retrace_link::MotionCard;

use super::jobs::{Log, boundary, complete, machine, run};

/// Lines of 20 mm with corners, the jet on from line 4 to line 9, a rapid move behind it.
const CUT: &str = "G21 G90 G64 P0.05 F1200\nG0 X5\nG1 X10\nM64 P1\nG1 X30\nG1 Y20\nG1 X10\nG1 Y0 Z1\nM65 P1\nG0 X0 \
    Y0\nG1 X40 F3000\nM2\n";

fn counts_at(log: &Log, record: u32) -> Option<[i64; 4]> {
    log.periods.iter().find(|p| p.place == boundary(record)).map(|p| p.counts)
}

/// Length of the path between two record boundaries in mm, from the counts of a separate run at rate 1.
fn length_mm(plain: &Log, from: u32, to: u32) -> f64 {
    let at = |record| counts_at(plain, record).unwrap_or([0; 4]);
    let records = (from..to).map(|n| (at(n), at(n + 1)));
    records.map(|(a, b)| (0..3).map(|i| ((b[i] - a[i]) as f64 / 1000.0).powi(2)).sum::<f64>().sqrt()).sum()
}

#[test]
fn back_by_a_length_stands_at_the_first_boundary_at_or_beyond_it() {
    let machine = machine(600.0);
    let (plain_end, plain) = complete(&machine, CUT, "");
    for (mm, at) in [(0.3, "at 2.1s"), (13.0, "at 2.9s"), (31.7, "at 3.77s")] {
        let script = format!("{at} back {mm} mm\nafter 12s leave\n");
        let (end, log) = complete(&machine, CUT, &script);
        assert_eq!(end.card.status().counts, plain_end.card.status().counts);
        let asked = log.event(|h| matches!(h, EventKind::Operator(_)));
        let there = log.event(|h| *h == EventKind::BackTargetReached);
        assert_eq!((there.place.fraction, asked.place.fraction), (0, 0));
        let (from, to) = (asked.place.record, there.place.record);
        let (length, shorter) =
            (length_mm(&plain, to.number(), from.number()), length_mm(&plain, to.number() + 1, from.number()));
        assert!(length >= mm - 1e-9 && shorter < mm, "{mm}: {shorter} {length}");
        let stood =
            log.periods.iter().filter(|p| p.mode == Mode::Reverse && p.place == there.place && p.rate == Rate::ZERO);
        assert!(stood.count() > 5000, "it stands there until told otherwise");
        let oldest = log.periods.iter().map(|p| p.place.record.number()).skip_while(|&r| r < from.number()).min();
        assert_eq!(oldest, Some(to.number()), "and goes no further back");
    }
}

#[test]
fn with_the_jet_off_it_goes_faster_than_recorded_and_with_it_on_as_recorded() {
    let machine = machine(600.0);
    let fastest = |log: &Log| log.periods.iter().map(|p| -p.rate).max().unwrap_or(Rate::ZERO);
    // In line 6 the jet is on; in line 3 it is not yet.
    let (_, cutting) = complete(&machine, CUT, "at line 6 back 5 mm\nafter 10s leave\n");
    assert!((Rate::ONE / 10 * 9..=Rate::ONE).contains(&fastest(&cutting)), "{:?}", fastest(&cutting));
    let slow = "G21 G64 F120\nG1 X40\nM2\n";
    let (_, dry) = complete(&machine, slow, "at 15s back 20 mm\nafter 10s leave\n");
    let rate: Rate = fastest(&dry);
    assert!(rate > Rate::ONE * 4, "{rate:?}");
}

#[test]
fn back_to_the_block_and_from_its_beginning_to_the_one_before() {
    let machine = machine(600.0);
    let script =
        "at line 7 hold\nafter 1s back to block\nafter 4s back to block\nafter 4s back to block\nafter 4s leave\n";
    let (_, log) = complete(&machine, CUT, script);
    let lines: Vec<[u32; 2]> = log
        .events
        .iter()
        .filter(|e| e.kind == EventKind::BackTargetReached)
        .map(|e| {
            let line = |record: u32| {
                let passed = log.periods.iter().find(|p| p.mode == Mode::Run && p.place == boundary(record));
                passed.expect("passed at rate 1").line
            };
            [line(e.place.record.number()), line(e.place.record.number() + 1)]
        })
        .collect();
    assert_eq!(lines, [[6, 7], [5, 6], [3, 5]]);
}

#[test]
fn back_to_the_jet_is_where_it_came_on_and_without_one_nothing_moves() {
    let machine = machine(600.0);
    let (_, log) = complete(&machine, CUT, "at line 10 hold\nafter 2s back to pierce\nafter 9s leave\n");
    let on = log.event(|h| *h == EventKind::Switching("M64"));
    let there = log.event(|h| *h == EventKind::BackTargetReached);
    assert_eq!(there.place, on.place);
    let (_, log) = complete(&machine, CUT, "at line 2 back to pierce\n");
    assert_eq!(log.count(|h| *h == EventKind::CommandRejected(CommandError::NoPierce)), 1);
    assert!(log.periods.iter().all(|p| p.mode == Mode::Run));
}

#[test]
fn where_history_does_not_reach_it_stands_at_the_oldest_and_says_that() {
    let machine = machine(1.0);
    let (_, log) = complete(&machine, CUT, "at line 7 back 500 mm\nafter 5s leave\n");
    assert_eq!(
        (log.count(|h| *h == EventKind::HistoryStartReached), log.count(|h| *h == EventKind::BackTargetReached)),
        (1, 0)
    );
    let (_, log) = complete(&machine, CUT, "at line 10 back to pierce\n");
    assert_eq!(
        log.count(|h| *h == EventKind::CommandRejected(CommandError::NoPierce)),
        1,
        "the jet came on before that"
    );
    // At the very beginning there is no history.
    let (_, log) = run(&machine, CUT, "at 0s back 1 mm\n");
    assert_eq!(log.count(|h| *h == EventKind::CommandRejected(CommandError::NothingBehind)), 1);
}

#[test]
fn whoever_is_going_back_already_goes_on_from_where_he_comes_to_rest() {
    let machine = machine(600.0);
    let (_, log) = complete(
        &machine,
        CUT,
        "at line 7 reverse 100%\nafter 0.6s back 0.01 mm\nafter 3s forward 50%\nafter 3s agree\n",
    );
    let there = log.event(|h| *h == EventKind::BackTargetReached);
    assert_eq!(there.place.fraction, 0);
    assert_eq!(log.count(|h| *h == EventKind::RunResumed), 1);
}

#[test]
fn the_wheel_says_when_it_has_come_forward_to_its_end() {
    let machine = machine(600.0);
    let script = "at line 7 wheel -100 for 1s\nafter 0.5s wheel 100 for 3s\nafter 1s wheel -100 for 0.2s\nafter 1s \
        wheel 100 for 2s\nafter 1s leave\n";
    let (_, log) = complete(&machine, CUT, script);
    assert_eq!(log.count(|h| *h == EventKind::HistoryEndReached), 2);
}

/// A handwheel that is held is taken again by the word that took it: the machine follows its counts again.
#[test]
fn a_held_handwheel_is_taken_again() {
    let machine = machine(600.0);
    let program = "G21 G90 G64 P0.05\nG1 X40 F1500\nG1 Y40\nG1 X0\nM2\n";
    let (plain, _) = complete(&machine, program, "");
    let script = "at line 3 wheel -50 for 0.5s\nafter 0.2s hold\nafter 0.8s wheel -50 for 0.5s\nafter 1s leave\n";
    let (end, log) = complete(&machine, program, script);
    assert_eq!(end.card.status().counts, plain.card.status().counts);
    let at = |is: fn(&OperatorCommand) -> bool| {
        let of = |event: &Event| if let EventKind::Operator(command) = &event.kind { is(command) } else { false };
        log.events.iter().rfind(|event| of(event)).expect("it was ordered").period as usize
    };
    let [taken, left] = [
        at(|word| matches!(word, OperatorCommand::Wheel { .. })),
        at(|word| matches!(word, OperatorCommand::Leave { .. })),
    ];
    assert_ne!(log.periods[taken].counts, log.periods[left].counts);
}
