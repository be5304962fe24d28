//! A feed move waits for a spindle without an encoder: for its input, or for its spin-up time (SPN-6).
//!
//! Invariant: at the card's outputs, the spindle has turned for that time wherever a feed move begins.

use retrace_tests::command::Bench;
use retrace_tests::pins::{Sample, run_with_pins};
use serde_json::Value;

const SPIN_UP: &str = "[spindle]\nspin_up_s = 0.5\n";
const PROGRAM: &str = "G21 G90 F600\nS1000 M3\nG0 X5\nG1 X10\nS1030\nG1 X12\nS2000\nG1 X15\nM5\nM3\nG0 X16\nG1 X20\n\
                       M5\nM2\n";

/// Time in ms from the last motion before a line to its first.
fn gap_ms(trace: &[Sample], line: u64) -> u64 {
    let moves = |sample: &&Sample| sample.rate != 0.0;
    let first = trace.iter().position(|sample| sample.line == line && sample.rate != 0.0).expect("motion");
    let before = trace[..first].iter().rev().find(moves).map_or(0, |sample| sample.at_us);
    (trace[first].at_us - before) / 1000
}

#[test]
fn a_feed_move_waits_for_the_spin_up_and_a_rapid_does_not() {
    let (run, trace) = run_with_pins(SPIN_UP, PROGRAM, "", &[]);
    run.assert_exact_and_legal();
    let gaps = [3, 4, 6, 8, 11, 12].map(|line| gap_ms(&trace, line));
    assert!(gaps[1] >= 500 && gaps[1] < 700, "behind M3: {gaps:?}");
    assert!(gaps[3] >= 500 && gaps[5] >= 500, "behind S2000, and behind M5 and M3: {gaps:?}");
    assert!([gaps[0], gaps[2], gaps[4]].iter().all(|&gap| gap < 300), "rapids, and 3 % more: {gaps:?}");
    let (run, trace) = run_with_pins("[spindle]\n", PROGRAM, "", &[]);
    run.assert_exact_and_legal();
    assert!(gap_ms(&trace, 4) < 100, "without the key nothing waits");
}

#[test]
fn a_feed_move_waits_for_the_input_of_the_drive() {
    // The input of the simulated machine follows M3 where that waits for it.
    let machine = |follows: bool| {
        let code = if follows { "[code.M3]\nwaits_for = { input = 4 }\n" } else { "" };
        format!(
            "[spindle]\nat_speed_input = 4\nat_speed_ms = 200\nat_speed_timeout_s = 1\n{code}\
             [[card.input]]\nnumber = 4\nuse = \"plain\"\n"
        )
    };
    let (run, trace) = run_with_pins(&machine(true), PROGRAM, "", &[]);
    run.assert_exact_and_legal();
    assert!((200..400).contains(&gap_ms(&trace, 4)), "{}", gap_ms(&trace, 4));
    // It never comes: the feed move does not begin, and the spindle is off.
    let (run, trace) = run_with_pins(&machine(false), PROGRAM, "", &[]);
    assert_eq!(run.report["outcome"], "alarm", "{}", run.report);
    assert!(!trace.iter().any(|sample| sample.line == 4 && sample.rate != 0.0), "it has moved");
    let alarm = trace.iter().find(|sample| sample.alarm != 0).expect("an alarm");
    let rests = trace.iter().rev().find(|sample| sample.rate != 0.0).expect("the rapid move").at_us;
    assert!((1200..1500).contains(&((alarm.at_us - rests) / 1000)), "{alarm:?}");
    assert!(!trace.last().expect("a sample").is_on("spindle"));
}

/// Time in ms for which the spindle had turned where motion began behind its last start.
fn turned_ms(trace: &[Sample]) -> u64 {
    let starts = |pair: &[Sample]| !pair[0].is_on("spindle") && pair[1].is_on("spindle");
    let on = trace.windows(2).rposition(starts).expect("a start") + 1;
    let begins = trace[on..].iter().find(|sample| sample.rate != 0.0).expect("motion");
    (begins.at_us - trace[on].at_us) / 1000
}

#[test]
fn a_spindle_that_is_started_again_is_awaited() {
    let program = "G21 G90 F600\nS1000 M3\nG1 X40\nM5\nM2\n";
    let steps = "at 2s pause\nafter 1s spindle stop\nafter 1s spindle start\nafter 0s online\nafter 0s cycle start\n";
    let (run, trace) = run_with_pins(SPIN_UP, program, steps, &[]);
    run.assert_exact_and_legal();
    assert!((500..1500).contains(&turned_ms(&trace)), "{}", turned_ms(&trace));
    // The same where the job is resumed.
    let bench = Bench::new();
    bench.file("m.toml", SPIN_UP);
    bench.file("part.ngc", program);
    bench.file("stop.op", "at 2s stop\n");
    let stopped = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--operator", "stop.op", "--json"]);
    assert_eq!(stopped.code, Some(4), "{}{}", stopped.out, stopped.err);
    let resumed = bench.retrace(["resume", "--yes", "--json"]);
    assert_eq!(resumed.code, Some(0), "{}{}", resumed.out, resumed.err);
    let events: Vec<Value> = resumed.out.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
    let period = |kind: &str| {
        let switched = events.iter().filter(|event| event["event"] == kind);
        switched.filter_map(|event| event["period"].as_u64()).max().unwrap_or_else(|| panic!("{kind}: {}", resumed.out))
    };
    assert!((500..1000).contains(&(period("restart_switched") - period("restart_switching"))), "{}", resumed.out);
}
