//! Threads before the last one in reverse run, and threads that the card has forgotten: armed again (SPN-22).

use retrace_tests::command::{Bench, CommandOutput};
use retrace_tests::pins::{self, Sample};
use retrace_tests::served::ServedCard;

use crate::thread_hold::{HELD, THREAD, assert_exact, events, report, run, taken_at};

/// Four passes of a cycle.
const CYCLE: &str = "G21 G90 G18\nS1000 M3\nG0 X10 Z5\nG76 P1.5 Z-10 I-1 J0.3 K0.92 R1.2 Q29.5\nG0 X20\nG4 P9\nM5\n\
    G0 X21\nM2\n";
const PROBE: &str = "[[card.input]]\nnumber = 0\nuse = \"probe\"\n[probe]\nspindle = \"may-turn\"\n";

fn barriers(out: &str) -> Vec<u64> {
    let events = events(out).filter(|event| event["event"] == "retrace_barrier");
    events.filter_map(|event| event["record"].as_u64()).collect()
}

fn assert_untroubled(result: &CommandOutput) {
    for word in ["E30", "command_rejected", "alarm\""] {
        assert!(!result.out.contains(word), "{word}: {}", result.out);
    }
}

/// Each pass is a barrier of its own, and passed at a word of its own; forward run cuts them all again. Between them
/// the path is held and turned round.
#[test]
fn all_passes_of_a_cycle_are_reversed_and_cut_again() {
    // Reverse run begins once the dwell has ended.
    let reverse = "after 10s reverse 100%\n".to_owned() + &"after 6s reverse 100%\n".repeat(3);
    for way in ["after 6s leave\n", "after 1s hold\nafter 2s forward 100%\nafter 0.7s reverse 30%\nafter 20s leave\n"] {
        let (_bench, result) = run(HELD, CYCLE, &format!("at 8s reverse 100%\n{reverse}{way}"));
        assert_exact(&result, [21_000, 0, -10_000]);
        assert_untroubled(&result);
        let passed = barriers(&result.out);
        assert!(passed.len() >= 4 && passed.windows(2).all(|pair| pair[1] <= pair[0]), "{passed:?}");
        if !way.contains("hold") {
            assert_eq!(passed.len(), 4, "each is told once");
            assert_eq!(taken_at(&result.out, "leave")[0].0, 0, "they are all passed backward");
        }
    }
}

/// The path is cut anew from the beginning of an earlier pass, and the last end is a barrier again.
#[test]
fn an_earlier_pass_that_was_cut_again_is_a_barrier_again() {
    let script = "at 8s reverse 100%\nafter 10s reverse 100%\nafter 6s reverse 100%\nafter 6s forward 100%\n\
                  after 2s reverse 100%\nafter 9s leave\n";
    let (_bench, result) = run(HELD, CYCLE, script);
    assert_exact(&result, [21_000, 0, -10_000]);
    assert_untroubled(&result);
    let passed = barriers(&result.out);
    assert!(
        passed.len() == 4 && passed[0] > passed[1] && passed[1] > passed[2] && passed[3] >= passed[1],
        "{passed:?}"
    );
}

/// Threads of either direction of the spindle, and another speed: each is passed as it was cut.
#[test]
fn each_thread_keeps_its_speed_and_its_direction() {
    let program = "G21 G90\nS1000 M3\nG0 X2 Z5\nG33 Z-10 K1.5\nG0 X4\nG0 Z5\nM5\nS600 M4\nG0 X6\nG33 Z-10 K1\nG0 X8\n\
                   G4 P9\nM5\nG0 X9\nM2\n";
    let script = "at 6s reverse 100%\nafter 9s reverse 100%\nafter 9s reverse 100%\nafter 12s leave\n";
    let bench = Bench::new();
    bench.file("m.toml", HELD);
    bench.file("part.ngc", program);
    bench.file("hand.op", script);
    let arguments = ["run", "part.ngc", "--machine", "m.toml", "--operator", "hand.op", "--json", "--vcd", "pins.vcd"];
    let result = bench.retrace(arguments);
    assert_exact(&result, [9_000, 0, -10_000]);
    assert_untroubled(&result);
    assert_eq!(taken_at(&result.out, "leave")[0].0, 0, "{}", result.out);
    let samples = pins::samples(&bench.path("pins.vcd"));
    let direction = |sample: &Sample| *sample.outputs.get("spindle").unwrap_or(&0) as u32 as i32;
    let mut directions: Vec<i32> = samples.iter().map(direction).collect();
    directions.dedup();
    directions.retain(|&direction| direction != 0);
    // M4, then each thread backward and forward, with its own direction, and the second one again at the end.
    assert_eq!(directions, [1, -1, 1, -1, -1, 1, -1]);
    assert!(!samples.last().expect("a trace").is_on("spindle"));
}

/// Off the path in a pause the card forgets the thread that it awaits: back on it, it is cut all the same.
#[test]
fn a_pause_in_front_of_a_thread_leaves_it_to_be_cut() {
    let script = "at 0.8s reverse 100%\nafter 4s pause\nafter 1s spindle stop\nafter 1s jog x 1\n\
                  after 1s spindle start\nafter 1s online\nafter 2s cycle start\nafter 3s forward 100%\n";
    let (_bench, result) = run(HELD, THREAD, script);
    assert_exact(&result, [4_000, 0, 5_000]);
    assert!(!result.out.contains("E30"), "{}", result.out);
}

/// So it does behind a probing move, whose path is one of its own: the thread before it is still passed backward.
#[test]
fn a_thread_before_a_probing_move_is_reversed() {
    let program = "G21 G90\nS1000 M3\nG0 X2 Z5\nG33 Z-20 K1.5\nG0 X4\nG0 Z5\nF300\nG38.3 X5\nG0 Z5.2\nG4 P1\nM5\n\
                   G4 P2\nG0 Z6\nM2\n";
    let script = "at 3.3s reverse 100%\nafter 2s reverse 100%\nafter 6s forward 100%\n";
    let (_bench, result) = run(&format!("{HELD}{PROBE}"), program, script);
    assert_exact(&result, [5_000, 0, 6_000]);
    assert_untroubled(&result);
    assert_eq!(taken_at(&result.out, "forward 100%")[0].0, 0, "{}", result.out);
}

/// The same over a line that loses, doubles and damages bytes: what the card has not reported is not relied upon.
#[test]
fn passes_are_reversed_over_a_faulty_line() {
    let bench = Bench::new();
    // A computer that is busy with other tests is not what ends the job.
    let machine = bench.file("m.toml", format!("[card]\nwatchdog_ms = 2000\n{HELD}")).display().to_string();
    bench.file("part.ngc", CYCLE.replace("G4 P9", "G4 P4"));
    bench.file("hand.op", "at 9.5s reverse 100%\nafter 4s reverse 100%\nafter 6s reverse 100%\nafter 6s leave\n");
    let vcd = bench.path("card.vcd").display().to_string();
    let faults = "baud=1000000,latency-us=500,jitter-us=1000,flip=0.0001,drop=0.0001,duplicate=0.0001,seed=5";
    let card = ServedCard::with(&["--machine", &machine, "--vcd", &vcd, "--faults", faults]);
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--operator", "hand.op", "--json"];
    let result = bench.retrace(run);
    assert_eq!(result.code, Some(0), "{}{}", result.out, result.err);
    let ended = report(&result.out);
    assert_eq!((&ended["position_counts"]["x"], &ended["position_counts"]["z"]), (&21_000.into(), &(-10_000).into()));
    assert_untroubled(&result);
    assert!(barriers(&result.out).len() >= 3, "{}", result.out);
    let _ = card.end();
    assert!(!pins::samples(bench.path("card.vcd").as_path()).last().expect("a trace").is_on("spindle"));
}
