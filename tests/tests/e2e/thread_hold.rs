//! Hold, reverse run and a spindle that is turned by hand in a thread and in a tap, by the command (SPN-20 … SPN-23).

use std::process::Stdio;
use std::thread::sleep;
use std::time::Duration;

use retrace_tests::command::{Bench, CommandOutput};
use retrace_tests::pause::pause;
use retrace_tests::pins;
use retrace_tests::served::ServedCard;
use serde_json::Value;

pub(crate) const HELD: &str =
    "[spindle]\ncounts_per_turn = 400\nmax_rpm = 3000\nthread_hold = \"spindle\"\nreverse_rpm = 300\n";
const TAPS: &str = "[spindle]\ncounts_per_turn = 400\nmax_rpm = 3000\ntap_retrace = true\n";
pub(crate) const THREAD: &str = "G21 G90\nS1000 M3\nG0 X2 Z5\nG33 Z-20 K1.5\nG0 X4\nG0 Z5\nM5\nM2\n";
const TAP: &str = "G21 G90\nS600 M3\nG0 X20 Z3\nG33.1 Z-12 K1\nG0 X40\nM5\nM2\n";

pub(crate) fn run(machine: &str, program: &str, script: &str) -> (Bench, CommandOutput) {
    let bench = Bench::new();
    bench.file("m.toml", machine);
    bench.file("part.ngc", program);
    bench.file("hand.op", script);
    let result = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--operator", "hand.op", "--json"]);
    (bench, result)
}

pub(crate) fn events(out: &str) -> impl Iterator<Item = Value> {
    out.lines().filter_map(|line| serde_json::from_str(line).ok())
}

pub(crate) fn report(out: &str) -> Value {
    events(out).last().unwrap_or_default()
}

/// Place of the machine where these operator's words were taken: record and time in ms.
pub(crate) fn taken_at(out: &str, words: &str) -> Vec<(u64, u64)> {
    let taken = events(out).filter(|event| event["event"] == "operator" && event["command"] == words);
    taken.map(|event| (event["record"].as_u64().unwrap_or(0), event["period"].as_u64().unwrap_or(0))).collect()
}

/// The job went to its end as without the operator: same counts, within the limits, without a pause for records.
pub(crate) fn assert_exact(out: &CommandOutput, end: [i64; 3]) {
    assert_eq!(out.code, Some(0), "{}{}", out.out, out.err);
    let report = report(&out.out);
    let counts = ["x", "y", "z"].map(|axis| report["position_counts"][axis].as_i64().unwrap_or(i64::MIN));
    assert_eq!(counts, end, "{report}");
    assert_eq!((&report["limit_violations"], &report["underruns"]), (&0.into(), &0.into()), "{report}");
}

/// A hold switches the spindle off and leaves the tool in the thread; cycle start goes on in the groove.
#[test]
fn a_hold_stops_the_spindle_in_the_thread() {
    let (_bench, held) = run(HELD, THREAD, "at 0.8s hold\nafter 2s resume\n");
    assert_exact(&held, [4_000, 0, 5_000]);
    let (at_hold, at_resume) = (taken_at(&held.out, "hold")[0].0, taken_at(&held.out, "resume")[0].0);
    let end = 1105;
    assert!(at_hold < at_resume && at_resume < end, "it rests inside: {at_hold} {at_resume}");
    // Without the key it finishes the thread: the end of the thread is passed while it is held.
    let (_bench, finished) = run(&HELD.replace("\"spindle\"", "\"finish\""), THREAD, "at 0.8s hold\nafter 2s resume\n");
    assert_exact(&finished, [4_000, 0, 5_000]);
    assert_eq!(taken_at(&finished.out, "resume")[0].0, end);
}

/// Reverse run in a thread turns the spindle back, and goes on along the path in front of it, to its beginning; forward
/// run cuts the same thread again. Anywhere it can be held, and turned round.
#[test]
fn a_thread_is_reversed_and_cut_again() {
    for script in [
        "at 0.8s reverse 100%\nafter 6s forward 100%\n",
        "at 0.8s hold\nafter 1s reverse 100%\nafter 0.7s hold\nafter 1s forward 100%\nafter 0.3s reverse 50%\n\
         after 1s hold\nafter 1s resume\nafter 6s leave\n",
        "at 1s reverse 100%\nafter 0.5s reverse 10%\nafter 0.5s forward 800%\nafter 0.2s hold\nafter 1s reverse 800%\n\
         after 4s leave\nafter 0.6s hold\nafter 1s resume\n",
    ] {
        let (_bench, result) = run(HELD, THREAD, script);
        assert_exact(&result, [4_000, 0, 5_000]);
        assert!(result.out.contains("\"mode\":\"reverse\"") && !result.out.contains("E3035"), "{}", result.out);
    }
    // Behind the beginning of the thread it is an ordinary reverse run, at the rate that was asked for.
    let (_bench, result) = run(HELD, THREAD, "at 0.8s reverse 100%\nafter 6s forward 100%\n");
    let start = events(&result.out).find(|event| event["event"] == "history_start_reached").expect("the beginning");
    assert_eq!(start["record"], 0);
    // 300 turns a minute are less than a third of the speed forward: 5 turns take a second.
    let took = start["period"].as_u64().expect("a period") - 800;
    assert!((1_000..4_000).contains(&took), "{took}");
}

/// A thread that was cut to its end is a barrier to reverse run. Reversed again there, its spindle turns backward, and
/// the tool goes back along the very helix; forward run cuts the same thread again, and the job goes on exactly.
#[test]
fn a_thread_that_was_cut_to_its_end_is_reversed_at_the_word() {
    let program = THREAD.replace("M5\n", "G4 P1\nM5\nG4 P2\nG0 Z6\n");
    let barrier = |out: &str| {
        let event = events(out).find(|event| event["event"] == "retrace_barrier").expect("a barrier");
        (event["record"].as_u64(), event["code"].clone())
    };
    for (script, at_start) in [
        ("at 1.8s reverse 100%\nafter 1s reverse 100%\nafter 6s forward 100%\n", 1),
        // The spindle is off there, held while it is being reversed, and turned round in the thread.
        (
            "at 4s reverse 100%\nafter 2.5s reverse 50%\nafter 0.1s hold\nafter 2s reverse 100%\nafter 2s hold\n\
          after 1s forward 100%\nafter 0.5s reverse 100%\nafter 6s leave\n",
            1,
        ),
        ("at 1.8s reverse 100%\nafter 1s reverse 100%\nafter 2s forward 100%\nafter 0.1s hold\nafter 1s leave\n", 0),
    ] {
        let (_bench, result) = run(HELD, &program, script);
        assert_exact(&result, [4_000, 0, 6_000]);
        assert_eq!(barrier(&result.out), (Some(1105), "G33".into()));
        let starts = events(&result.out).filter(|event| event["event"] == "history_start_reached").count();
        assert_eq!(starts, at_start, "{}", result.out);
        assert!(!result.out.contains("E30") && !result.out.contains("rejected"), "{}", result.out);
    }
    // One word goes to the barrier only, and so do a distance and the handwheel; behind it the job goes on.
    for script in
        ["at 1.8s reverse 100%\nafter 6s leave\n", "at 1.8s back 100 mm\nafter 6s wheel -100 for 2s\nafter 1s leave\n"]
    {
        let (_bench, result) = run(HELD, &program, script);
        assert_exact(&result, [4_000, 0, 6_000]);
        assert_eq!(taken_at(&result.out, "leave")[0].0, 1105, "{}", result.out);
    }
    // Passed again it is a barrier again.
    let again = "at 1.8s reverse 100%\nafter 1s reverse 100%\nafter 6s forward 100%\nafter 4s reverse 100%\n\
                 after 4s leave\n";
    let (_bench, result) = run(HELD, &program, again);
    assert_exact(&result, [4_000, 0, 6_000]);
    assert_eq!(taken_at(&result.out, "leave")[0].0, 1105, "{}", result.out);
    // Neither where the spindle has one direction, nor where a thread is not held.
    let script = "at 1.8s reverse 100%\nafter 1s reverse 100%\nafter 2s leave\n";
    for machine in [format!("{HELD}reversible = false\n"), HELD.replace("\"spindle\"\n", "\"finish\"\n")] {
        let (_bench, result) = run(&machine, &program, script);
        assert_exact(&result, [4_000, 0, 6_000]);
        assert_eq!(taken_at(&result.out, "leave")[0].0, 1105, "{}", result.out);
        assert_eq!(result.out.contains("reversible = false"), machine.contains("false"), "{}", result.out);
    }
    // Left inside of it the job is not resumed on another card; in front of it the thread is cut again.
    for (after, is_resumed) in [("2s", false), ("6s", true)] {
        let script = format!("at 1.8s reverse 100%\nafter 1s reverse 100%\nafter {after} stop\n");
        let (bench, result) = run(HELD, &program, &script);
        assert_eq!(result.code, Some(4), "{}{}", result.out, result.err);
        let resumed = bench.retrace(["resume", "--yes", "--json"]);
        if is_resumed {
            assert_exact(&resumed, [4_000, 0, 6_000]);
        } else {
            assert!(resumed.code != Some(0) && resumed.err.contains("E2219"), "{}{}", resumed.out, resumed.err);
        }
    }
}

/// Where the spindle rests and the operator says that the tool is free, a thread is retraced by rate: back from where
/// it is held, to be cut again from its beginning, and both ways where it was cut.
#[test]
fn a_thread_whose_tool_is_free_is_retraced_by_rate() {
    let program = THREAD.replace("M5\n", "G4 P1\nM5\nG4 P2\nG0 Z6\n");
    let words = "after 0.2s forward 100%\nafter 0.1s leave\nafter 0.1s cycle start\n";
    let script = format!("at 0.8s hold\nafter 2s tool free\n{words}after 0.1s reverse 200%\nafter 4s forward 100%\n");
    let (_bench, result) = run(HELD, &program, &script);
    assert_exact(&result, [4_000, 0, 6_000]);
    let refused = events(&result.out).filter(|event| event["event"] == "command_rejected").count();
    assert_eq!(refused, 3, "{}", result.out);
    let starts = events(&result.out).filter(|event| event["event"] == "history_start_reached").count();
    assert_eq!(starts, 1, "{}", result.out);
    // Behind a thread that was cut: by rate to its middle, forward to its end, and on.
    let script = "at 4s reverse 100%\nafter 2.5s tool free\nafter 0.1s reverse 100%\nafter 0.5s forward 100%\n";
    let (_bench, result) = run(HELD, &program, script);
    assert_exact(&result, [4_000, 0, 6_000]);
    let turned = taken_at(&result.out, "forward 100%")[0].0;
    assert!((550..650).contains(&turned), "half a second by rate: {turned}");
    assert!(!result.out.contains("E30") && !result.out.contains("rejected"), "{}", result.out);
    // With the spindle on, while it moves, and elsewhere, the word is refused.
    for script in [
        "at 0.8s tool free\n",
        "at 0.8s hold\nafter 0.05s tool free\nafter 2s resume\n",
        "at 1.8s reverse 100%\nafter 1s tool free\nafter 0.1s leave\n",
        "at 1.8s hold\nafter 1s tool free\nafter 0.1s resume\n",
    ] {
        let (_bench, result) = run(HELD, &program, script);
        assert_exact(&result, [4_000, 0, 6_000]);
        let refused = events(&result.out).filter(|event| event["event"] == "command_rejected").count();
        assert_eq!(refused, 1, "{script}: {}", result.out);
    }
    // At the barrier the spindle is switched off by hand.
    let script = "at 1.8s reverse 100%\nafter 1s output 64 off\nafter 2s tool free\nafter 0.1s reverse 100%\n\
                  after 0.3s reverse 50%\nafter 4s leave\n";
    let (_bench, result) = run(HELD, &program, script);
    assert_exact(&result, [4_000, 0, 6_000]);
    assert!(!result.out.contains("rejected"), "{}", result.out);
}

/// What would move the tool in a thread without the spindle is refused, and an override of 0 does not stop it.
#[test]
fn nothing_but_the_spindle_moves_the_tool_in_a_thread() {
    let words = ["wheel 50 for 0.01s", "back 3 mm", "back to block", "cut", "pause", "park"];
    let script: String = words.iter().map(|word| format!("after 0.02s {word}\n")).collect();
    let (_bench, result) = run(HELD, THREAD, &format!("at 0.7s override 0%\n{script}after 2s override 100%\n"));
    assert_exact(&result, [4_000, 0, 5_000]);
    let refused = events(&result.out).filter(|event| event["event"] == "command_rejected").count();
    assert_eq!(refused, words.len(), "{}", result.out);
    let end = 1105;
    assert_eq!(taken_at(&result.out, "override 100%")[0].0, end, "the thread is finished at an override of 0");
    let one_way = format!("{HELD}reversible = false\n");
    let (_bench, result) = run(&one_way, THREAD, "at 0.8s reverse 100%\n");
    assert_exact(&result, [4_000, 0, 5_000]);
    assert!(result.out.contains("reversible = false"), "{}", result.out);
    // Where nothing is held, nothing follows a spindle that is turned by hand.
    let (_bench, result) = run(HELD, THREAD, "at 0.8s follow spindle\n");
    assert!(result.out.contains("command_rejected"), "{}", result.out);
}

/// A handwheel that retraces in front of the thread stops at its beginning, and the job goes on exactly.
#[test]
fn a_handwheel_does_not_begin_a_thread() {
    let script = "at 0.8s reverse 100%\nafter 6s wheel 100 for 4s\nafter 1s leave\n";
    let (_bench, result) = run(HELD, THREAD, script);
    assert_exact(&result, [4_000, 0, 5_000]);
    assert_eq!(taken_at(&result.out, "leave")[0].0, 208, "{}", result.out);
}

/// Reversed so near to its turn that the spindle coasts over it, a tap comes out behind the turn, and is complete.
#[test]
fn a_tap_that_turns_while_it_is_reversed_comes_out() {
    let mut turned = 0;
    for at_ms in (1_700..2_300).step_by(20) {
        let (_bench, result) = run(TAPS, TAP, &format!("at {}s reverse 100%\n", f64::from(at_ms) / 1000.0));
        // Nobody starts it again where it came out before its turn.
        let report = report(&result.out);
        assert_eq!(report["position_counts"]["z"], 3_000, "{at_ms}: {report}");
        turned += u32::from(result.out.contains("\"tapped\"") && !result.out.contains("command_rejected"));
    }
    assert!(turned > 0, "none has turned");
}

/// A job that was stopped in a thread, or was reversed out of one whose end it had not reached, is not resumed: the way
/// to the furthest place is geared.
#[test]
fn a_job_that_was_stopped_in_a_thread_is_not_resumed() {
    for script in ["at 0.8s stop\n", "at 0.8s reverse 100%\nafter 2.5s stop\n"] {
        let (bench, result) = run(HELD, THREAD, script);
        assert_eq!(result.code, Some(4), "{}{}", result.out, result.err);
        assert!(report(&result.out)["position_counts"]["z"].as_i64() > Some(-20_000), "{}", result.out);
        let resumed = bench.retrace(["resume", "--yes", "--json"]);
        assert!(resumed.code != Some(0) && resumed.err.contains("E2219"), "{}{}", resumed.out, resumed.err);
    }
}

/// A held tap is reversed out of its hole. Cycle start taps it again; a stop there leaves a job that can be resumed.
#[test]
fn a_tap_is_reversed_out_of_its_hole() {
    let (_bench, again) = run(TAPS, TAP, "at 1.6s hold\nafter 1s reverse 100%\nafter 3s resume\n");
    assert_exact(&again, [40_000, 0, 3_000]);
    let (out, on) = (taken_at(&again.out, "reverse 100%")[0], taken_at(&again.out, "resume")[0]);
    assert!(on.0 < out.0 && again.out.matches("\"tapped\"").count() == 1, "{}", again.out);
    let (_bench, turned) = run(TAPS, TAP, "at 1.6s reverse 100%\nafter 0.6s resume\nafter 1s reverse 100%\n");
    assert_exact(&turned, [40_000, 0, 3_000]);
    let (bench, stopped) = run(TAPS, TAP, "at 1.6s reverse 100%\nafter 3s stop\n");
    assert_eq!(stopped.code, Some(4), "{}{}", stopped.out, stopped.err);
    assert_eq!(report(&stopped.out)["position_counts"]["z"], 3_000);
    let resumed = bench.retrace(["resume", "--yes", "--json"]);
    assert_exact(&resumed, [40_000, 0, 3_000]);
    // Without the key a tap is a barrier.
    let (_bench, barrier) = run(&TAPS.replace("true", "false"), TAP, "at 1.6s reverse 100%\n");
    assert_exact(&barrier, [40_000, 0, 3_000]);
    assert!(barrier.out.contains("tap_retrace"), "{}", barrier.out);
}

/// The spindle of a held thread is turned by hand: the axes follow it, back and forward, where the operator has asked
/// for it and while the spindle is off; and the job goes on from there.
#[test]
fn the_axes_follow_a_spindle_that_is_turned_by_hand() {
    turn_by_hand(HELD, "G21 G90\nS600 M3\nG0 X2 Z5\nG33 Z-40 K1.5\nG0 X4\nM5\nM2\n", "G33\"", -40_000);
}

/// The same in a held tap.
#[test]
fn a_tap_follows_a_spindle_that_is_turned_by_hand() {
    turn_by_hand(TAPS, "G21 G90\nS600 M3\nG0 X2 Z5\nG33.1 Z-20 K1.5\nM5\nM2\n", "rigid tap", 5_000);
}

fn turn_by_hand(machine: &str, program: &str, begins: &str, z: i64) {
    let bench = Bench::new();
    let file = bench.file("m.toml", machine).display().to_string();
    bench.file("part.ngc", program);
    bench.file("hand.op", "at 1.8s hold\nafter 1.5s follow spindle\nafter 6s follow off\nafter 2.5s resume\n");
    let vcd = bench.path("card.vcd");
    let mut card = ServedCard::with(&["--machine", &file, "--vcd", &vcd.display().to_string()]);
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--operator", "hand.op", "--json"];
    let mut host = bench.start(&run, Stdio::null(), "run.txt");
    let told = || std::fs::read_to_string(bench.path("run.txt")).unwrap_or_default();
    let wait = |words: &str| {
        for _ in 0..4000 {
            if told().contains(words) {
                return;
            }
            sleep(Duration::from_millis(10));
        }
        panic!("`{words}` is not told: {}", told());
    };
    wait(begins);
    wait("\"hold\"");
    // Turned away by more than 5 degrees, nothing follows it until it is turned back.
    pause(Duration::from_millis(900));
    card.operate("spindle turn 0.05");
    wait("follow spindle");
    pause(Duration::from_millis(400));
    card.operate("spindle turn -0.05");
    pause(Duration::from_millis(700));
    card.operate("spindle turn -1");
    pause(Duration::from_millis(3000));
    card.operate("spindle turn 0.5");
    wait("follow off");
    pause(Duration::from_millis(300));
    card.operate("spindle turn 0.02");
    pause(Duration::from_millis(400));
    card.operate("spindle turn -0.02");
    assert_eq!(host.wait().expect("it ends").code(), Some(0), "{}", told());
    let report = report(&told());
    assert_eq!(report["position_counts"]["z"], z, "{report}");
    let _ = card.end();
    let samples = pins::samples(&vcd);
    assert!(!samples.last().expect("a trace").is_on("spindle"));
    // Where z stood for a while with the spindle off, from when it had turned on: the trace tells changes only.
    let on = samples.iter().position(|sample| sample.is_on("spindle")).expect("it turns");
    let stood = samples[on..].windows(2).filter(|pair| pair[1].at_us - pair[0].at_us > 250_000);
    let rests: Vec<i64> = stood.filter(|pair| !pair[0].is_on("spindle")).map(|pair| pair[0].counts[2]).collect();
    let out = rests.iter().copied().max().unwrap_or(i64::MIN);
    let moved = [out - rests[0], rests.last().copied().unwrap_or_default() - out];
    // A turn back is 1500 counts out, half a turn forward 750 in.
    assert!((moved[0] - 1500).abs() <= 8 && (moved[1] + 750).abs() <= 8, "{rests:?}");
    assert!(!told().contains("E3035"), "{}", told());
}

/// Turned by hand out of the thread, to its beginning, the machine is held there, and nothing follows the spindle any
/// more. Forward run turns the spindle on, and cuts the thread again.
#[test]
fn a_spindle_is_turned_by_hand_out_of_the_thread() {
    let bench = Bench::new();
    let file = bench.file("m.toml", HELD).display().to_string();
    bench.file("part.ngc", "G21 G90\nS300 M3\nG0 X2 Z5\nG33 Z-20 K1.5\nG0 X4\nM5\nM2\n");
    bench.file("hand.op", "at 0.9s hold\nafter 1s follow spindle\nafter 8.5s forward 100%\n");
    let mut card = ServedCard::with(&["--machine", &file]);
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--operator", "hand.op", "--json"];
    let mut host = bench.start(&run, Stdio::null(), "run.txt");
    let told = || std::fs::read_to_string(bench.path("run.txt")).unwrap_or_default();
    while !told().contains("follow spindle") {
        assert!(host.try_wait().expect("a process").is_none(), "{}", told());
        sleep(Duration::from_millis(10));
    }
    pause(Duration::from_millis(400));
    card.operate("spindle turn -3.5");
    assert_eq!(host.wait().expect("it ends").code(), Some(0), "{}", told());
    let left = events(&told()).find(|event| event["event"] == "mode" && event["mode"] == "reverse");
    assert_eq!(left.expect("it is left at its beginning")["record"], 208);
    let (held, forward) = (taken_at(&told(), "hold")[0].0, taken_at(&told(), "forward 100%")[0].0);
    assert!(held > 208 && forward == 208, "{held} {forward}");
    let report = report(&told());
    assert_eq!((&report["position_counts"]["x"], &report["position_counts"]["z"]), (&4_000.into(), &(-20_000).into()));
    let _ = card.end();
}
