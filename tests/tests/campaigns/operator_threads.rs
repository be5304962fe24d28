//! For any commands of the operator in a program of threads, the job reaches its regular end.
//!
//! Invariant: the card takes every record, and no alarm, limit or count tells the run from one that nobody touched.

use proptest::prelude::*;
use retrace_tests::command::Bench;
use serde_json::Value;

use crate::operator::timed;

const MACHINE: &str = "[spindle]\ncounts_per_turn = 400\nmax_rpm = 3000\nthread_hold = \"spindle\"\nreverse_rpm = 300\n\
    [[card.input]]\nnumber = 0\nuse = \"probe\"\n[probe]\nspindle = \"may-turn\"\n";

/// Three passes of a cycle, a left-hand thread of two parts behind them, and a probing move in the clear between two
/// threads that follow each other without a move.
const PROGRAM: &str = "\
G21 G90 G18 G64 P0.05
S1000 M3
F600
G0 X10 Z4
G76 P1.5 Z-8 I-1 J0.5 K0.92 R2 Q29.5 H0
G0 X12 Z4
G1 X11
M5
S800 M4
G33 Z-6 K1
G33 X12 Z-9 K1
G0 X14
G38.3 X15
G0 Z0
G33 Z6 K1
M8
G33 Z-6 K1.25
G4 P0.3
G0 X20
M5
M2
";

/// A pause off the path.
const PAUSE: &str = "hold\nafter 1s pause\nafter 1s spindle stop\nafter 1s jog x 1\nafter 1s spindle start\n\
    after 3s online\nafter 1s cycle start\nafter 2s cycle start";

fn operator_commands() -> impl Strategy<Value = String> {
    let deed = prop_oneof![
        3 => Just("hold".to_owned()),
        3 => Just("resume".to_owned()),
        8 => (1_u32..=100).prop_map(|rate| format!("reverse {rate}%")),
        2 => (100_u32..=800).prop_map(|rate| format!("reverse {rate}%")),
        3 => (1_u32..=100).prop_map(|rate| format!("forward {rate}%")),
        2 => (5_u32..=250).prop_map(|rate| format!("override {rate}%")),
        2 => (-300_i32..300, 0.1..2.0_f64).prop_map(|(counts, time)| format!("wheel {counts} for {time:.2}s")),
        3 => Just("leave".to_owned()),
        1 => Just("back 5 mm".to_owned()),
        3 => Just(PAUSE.to_owned()),
    ];
    timed(deed, 3.0)
}

fn report(bench: &Bench, script: &str) -> (Value, String) {
    bench.file("m.toml", MACHINE);
    bench.file("part.ngc", PROGRAM);
    bench.file("hand.op", script);
    let result = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--operator", "hand.op", "--json"]);
    let last = result.out.lines().next_back().and_then(|line| serde_json::from_str(line).ok());
    (last.unwrap_or_default(), format!("{}{}", result.out, result.err))
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: retrace_tests::command::cases(8),
        max_shrink_iters: 60,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]
    #[test]
    fn whatever_the_operator_does_in_threads_the_job_ends_exactly(
        deeds in prop::collection::vec(operator_commands(), 1..16),
    ) {
        let plain = report(&Bench::new(), "").0;
        // In the end the operator resumes, out of every mode.
        let end = "\nafter 3s leave\nafter 3s resume\nafter 0s override 100%\n".to_owned()
            + &"after 5s agree\nafter 5s cycle start\nafter 5s leave\nafter 5s resume\n".repeat(6);
        let (ended, all) = report(&Bench::new(), &(deeds.join("\n") + &end));
        prop_assert_eq!(&ended["outcome"], &Value::from("completed"), "{}", all);
        prop_assert_eq!(&ended["position_counts"], &plain["position_counts"], "{}", all);
        for none in ["limit_violations", "underruns"] {
            prop_assert_eq!(&ended[none], &Value::from(0), "{}: {}", none, all);
        }
    }
}
