//! A program is paused, the tool is moved away and back, and the job ends as without a pause.
//!
//! Invariant: the counts and outputs are those of a job that is not paused.

use retrace_controller::{DncEvent, DncStep, Event, EventKind, OperatorCommand};
use retrace_core::Rate;
use retrace_core::mode::Mode;
use retrace_journal::HoldReason;
use retrace_link::MotionCard;

use super::jobs::{Log, complete, machine};

/// Edge of a pocket with the spindle on, and outputs switched in motion.
const EDGE: &str = "G21 G90 G17 G64 P0.05\nG0 Z5\nT1 M6\nS12000 M4\nG0 X10 Y10\nG1 Z-2 F600\nG1 X40 F1500\nG3 X50 Y20 \
    J10 I0\nG1 Y40\nM62 P3\nG1 X10\nG1 Y10\nM63 P3\nG0 Z5\nM5\nM2\n";

/// The steps of a pause.
const SEQUENCE: &str =
    "after 0s spindle stop\nafter 1s jog z 10\nafter 1s spindle start\nafter 1s online\nafter 0s cycle start\n";

fn steps(log: &Log) -> Vec<&DncStep> {
    let kinds = log.events.iter().map(|event| &event.kind);
    kinds.filter_map(|kind| if let EventKind::Dnc(DncEvent { step, .. }) = kind { Some(step) } else { None }).collect()
}

#[test]
fn a_paused_job_goes_on_where_it_was_with_its_spindle_as_it_was() {
    let machine = machine(600.0);
    let (plain, _) = complete(&machine, EDGE, "");
    for (line, code, turning) in [(6, "M4", -1), (8, "M3", 1), (11, "M4", -1)] {
        let program = EDGE.replace("M4", code);
        let (end, log) = complete(&machine, &program, &format!("at line {line} pause\n{SEQUENCE}"));
        assert_eq!(end.card.status().counts, plain.card.status().counts, "line {line}");
        let steps = steps(&log);
        assert!(
            matches!(steps[0], DncStep::Paused { spindle, speed: 12_000_000, .. } if *spindle == turning),
            "{steps:?}"
        );
        assert!(matches!(steps[2], DncStep::Jogged { axis: 'z', cut_short: false, .. }), "{steps:?}");
        let started = DncStep::SpindleStarted { spindle: turning, speed: 12_000_000 };
        assert_eq!([steps[1], steps[3]], [&DncStep::SpindleStopped, &started]);
        assert_eq!(steps[4..], [&DncStep::Online, &DncStep::Approaching, &DncStep::Arrived]);
        let paused: Vec<usize> =
            (0..log.periods.len()).filter(|&at| log.periods[at].hold_reason == HoldReason::Paused).collect();
        assert_eq!(end.stats.paused as usize, paused.len());
        // it stops at once, and turns as before from its start on
        let mut turns: Vec<i32> = paused.iter().map(|&at| log.spindle[at]).collect();
        turns.dedup();
        assert_eq!(turns, [0, turning]);
        let [first, last] = [paused[0], paused[paused.len() - 1]].map(|at| log.periods[at].counts);
        assert_eq!(first, last);
    }
}

/// What does not apply in a pause is answered, and a pause on the way back keeps the breakpoint.
#[test]
fn a_pause_on_the_way_back_keeps_the_breakpoint() {
    let machine = machine(600.0);
    let (plain, _) = complete(&machine, EDGE, "");
    let script = "at line 7 pause\nafter 0s spindle stop\nafter 0s jog z 60\nafter 0s jog x 80\n\
        after 5s spindle start\nafter 0s online\nafter 0s cycle start\nafter 0.4s spindle stop\nafter 0s pause\n\
        after 1s cycle start\nafter 0s spindle stop\nafter 0s spindle start\nafter 0s online\nafter 0s cycle start\n";
    let (end, log) = complete(&machine, EDGE, script);
    assert_eq!(end.card.status().counts, plain.card.status().counts);
    let count = |is: fn(&DncStep) -> bool| steps(&log).into_iter().filter(|step| is(step)).count();
    assert_eq!(count(|step| matches!(step, DncStep::Paused { .. })), 2);
    assert_eq!((count(|step| *step == DncStep::Approaching), count(|step| *step == DncStep::Arrived)), (2, 1));
    let refused: Vec<String> = log
        .events
        .iter()
        .filter_map(|event| match &event.kind {
            EventKind::CommandRejected(why) => Some(why.to_string()),
            _ => None,
        })
        .collect();
    assert!(refused.len() == 2 && refused[0].contains("returning to the breakpoint"), "{refused:?}");
    assert!(refused[1].contains("spindle stop"), "{refused:?}");
}

/// M0 waits for *cycle start*, M1 where optional stops are on; each stop is reported once.
#[test]
fn a_program_stop_waits_for_cycle_start() {
    let machine = machine(600.0);
    let program = "G21 G90 F1200\nG1 X10\nM0\nG1 X20\nM1\nG1 X30\nM2\n";
    let stops = |script: &str| {
        let (end, log) = complete(&machine, program, script);
        assert_eq!(end.card.status().counts[0], 30_000);
        let stops = log.events.iter().filter_map(|event| match event.kind {
            EventKind::ProgramStop(code) => Some((code, event.period)),
            _ => None,
        });
        let stops: Vec<_> = stops.collect();
        for &(code, period) in &stops {
            let waits = log.periods.iter().skip_while(|p| p.period <= period).take(1000);
            let counts = if code == "M0" { 10_000 } else { 20_000 };
            assert!(waits.clone().count() == 1000 && waits.clone().all(|p| p.counts[0] == counts), "{code}");
            assert!(waits.clone().all(|p| p.hold_reason == HoldReason::ProgramStop), "{code}");
        }
        stops.into_iter().map(|(code, _)| code).collect::<Vec<_>>()
    };
    assert_eq!(stops("at 4s cycle start\n"), ["M0"]);
    assert_eq!(stops("at 0s optional stop on\nat 4s cycle start\nafter 4s cycle start\n"), ["M0", "M1"]);
}

/// A tool of another length moves the path; history in which the tool axis would leave its soft limits is barred.
#[test]
fn another_tool_length_moves_the_path_and_bars_what_would_leave_the_limits() {
    let text = "history_hours = 1\n".to_string()
        + &["x", "y", "z"]
            .map(|axis| {
                let travel = if axis == "z" { "[-100, 20]" } else { "[-100, 100]" };
                format!(
                    "[[axis]]\nname = \"{axis}\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = 100\n\
             max_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = {travel}\n"
                )
            })
            .concat();
    let machine = retrace_config::MachineConfig::parse(&text, "low").expect("valid");
    // down from Z15: with a tool that is 8 mm longer, Z12 is the highest place of before
    let program = "G21 G90 G61.1\nG0 Z15\nG1 X10 F1200\nG1 Z-5\nG1 X60\nG1 Y40\nM2\n";
    let (plain, _) = complete(&machine, program, "");
    let script = "at line 5 override 100%\nafter 1s pause\nafter 0s tool length by 8\nafter 0s online\n\
        after 0s cycle start\nafter 3s hold\nafter 1s reverse 100%\nafter 9s leave\n";
    let (end, log) = complete(&machine, program, script);
    let mut counts = plain.card.status().counts;
    counts[2] += 8000;
    assert_eq!(end.card.status().counts, counts, "{:?}", steps(&log));
    let is_entered =
        |step: &&DncStep| matches!(step, DncStep::ToolLength { by_mm: 8.0, by_counts: 8000, axis: 'z', .. });
    assert_eq!(steps(&log).into_iter().filter(is_entered).count(), 1, "{:?}", steps(&log));
    let barrier = log.event(|kind| matches!(kind, EventKind::RetraceBarrier { .. }));
    let at_barrier = log.periods.iter().rfind(|period| period.mode == Mode::Reverse).expect("it reverses");
    assert_eq!((at_barrier.place, at_barrier.place.fraction), (barrier.place, 0));
    // the next record would be beyond Z20
    let z = at_barrier.counts[2];
    let before = log.periods.iter().rev().filter(|period| period.mode == Mode::Reverse && period.rate != Rate::ZERO);
    let step = before.map(|period| i64::from(period.increments[2])).max().expect("it moves");
    assert!(z <= 20_000 && z + 2 * step > 20_000 && step > 0, "{z} {step}");
    assert!(log.periods.iter().all(|period| period.counts[2] <= 20_000));
}

/// The operator reverses while outputs are restored: the instruction in progress ends, the next one is not executed,
/// and the machine goes back then.
#[test]
fn a_restart_that_is_cancelled_executes_nothing_more() {
    let text = "[code.M3]\nduration_ms = 800\n";
    let machine = retrace_config::MachineConfig::parse(text, "router").expect("valid");
    let script = "at line 4 override 100%\nafter 1s output 64 off\nafter 0s output 5 off\nafter 1s resume\n\
        after 0.5s agree\nafter 0.3s reverse 50%\nafter 3s leave\n";
    let (_, log) = complete(&machine, "G21 G90 F1200\nM3 S100\nM64 P5\nG1 X100\nM2\n", script);
    let at = |is: fn(&OperatorCommand) -> bool| {
        let given = |event: &Event| matches!(&event.kind, EventKind::Operator(command) if is(command));
        log.events.iter().position(given).expect("given")
    };
    let reversed = at(|command| matches!(command, OperatorCommand::Reverse(_)));
    let left = at(|command| matches!(command, OperatorCommand::Leave { .. }));
    let codes = |events: &[Event]| {
        let code = |event: &Event| match event.kind {
            EventKind::RestartSwitching(code) => Some(code),
            _ => None,
        };
        events.iter().filter_map(code).collect::<Vec<_>>()
    };
    let [before, between, behind] =
        [&log.events[..reversed], &log.events[reversed..left], &log.events[left..]].map(codes);
    assert_eq!((before.last(), between.len()), (Some(&"M3"), 0), "{before:?} {between:?}");
    assert!(behind.contains(&"M64"), "{behind:?}");
    let [from, to] = [reversed, left].map(|at| log.events[at].period);
    let moves = log.periods.iter().filter(|p| p.period > from && p.period < to && p.rate < Rate::ZERO).count();
    assert!(moves > 2000, "{moves}");
}

/// In single block the records end at the end of a block, also where the path goes on: that is no underrun.
#[test]
fn a_step_of_single_block_is_no_underrun() {
    let program = "G21 G90 G64 F2400\nG1 X20\nG1 X40\nG1 X60\nM2\n";
    let script = "at 0.1s single\nafter 3s cycle start\nafter 3s cycle start\n";
    let (end, log) = complete(&machine(600.0), program, script);
    assert_eq!((log.count(|kind| *kind == EventKind::SingleBlock), end.stats.underruns), (2, 0));
    assert!(log.periods.iter().any(|period| period.starved && period.rate != Rate::ZERO), "the records end in motion");
}
