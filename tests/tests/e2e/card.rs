//! `retrace card`: a simulated card behind a pseudo-terminal, and hosts that connect and disconnect.

use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, CommandOutput, binary};
use retrace_tests::served::ServedCard;
use serde_json::Value;

/// A square of 2 mm, and back to its corner at (1, 1).
const SQUARE: &str = "G21 G90\nG1 X1 Y1 F1200\nG1 X3\nM62 P1\nG1 Y3\nM3 S100\nG1 X1\nG1 Y1\nM2\n";

fn report(result: &CommandOutput) -> Value {
    let line = result.out.lines().last().unwrap_or_default();
    serde_json::from_str(line).unwrap_or_else(|_| panic!("no report: {}\n{}", result.out, result.err))
}

#[test]
fn a_program_on_a_served_card_ends_where_it_ends_in_process() {
    let bench = Bench::new();
    bench.file("square.ngc", SQUARE);
    let vcd = bench.path("card.vcd");
    let served = ServedCard::with(&["--vcd", &vcd.display().to_string()]);
    let before = served.identify(&bench);
    assert_eq!((&before["name"], &before["counts"][0]), (&"retrace-sim".into(), &0.into()));
    let wired = report(&served.run(&bench, "square.ngc"));
    let in_process = report(&bench.retrace(["run", "square.ngc", "--json"]));
    assert_eq!(wired["position_counts"], in_process["position_counts"]);
    assert_eq!(wired["position_counts"]["x"], 1000);
    // another host finds the machine where it was left, and begins there
    let after = served.identify(&bench);
    assert_eq!((&after["counts"][0], &after["at_rest"], &after["alarm"]), (&1000.into(), &true.into(), &Value::Null));
    assert_ne!(after["last_epoch"], before["last_epoch"]);
    let again = report(&served.run(&bench, "square.ngc"));
    assert_eq!(again["position_counts"], in_process["position_counts"]);
    let summary = served.end();
    assert_eq!((&summary["counted"], &summary["periods_apart"]), (&summary["counts"], &0.into()));
    // the runs are 5 mm and 4 mm of X, at 1000 pulses a millimetre, and a little at rounded corners
    let pulses = summary["pulses"][0].as_u64().expect("a count");
    assert!((9000..9500).contains(&pulses), "{summary}");
    let trace = std::fs::read_to_string(vcd).expect("a trace");
    let step = trace.lines().find(|line| line.ends_with(" step $end")).expect("a step wire");
    let code = step.split_whitespace().nth(3).expect("its short name");
    let rises = trace.lines().filter(|line| line.strip_prefix('1') == Some(code)).count();
    assert_eq!(rises as u64, pulses);
}

#[test]
fn a_line_with_faults_changes_nothing_but_the_time() {
    let bench = Bench::new();
    bench.file("square.ngc", SQUARE);
    let served = ServedCard::with(&["--faults", "rate=1e-4,stall-ms=20,seed=3,baud=1000000"]);
    let wired = report(&served.run(&bench, "square.ngc"));
    assert_eq!((&wired["outcome"], &wired["position_counts"]["x"]), (&"completed".into(), &1000.into()), "{wired}");
    let summary = served.end();
    assert_eq!((&summary["counted"], &summary["periods_apart"]), (&summary["counts"], &0.into()));
}

#[test]
fn a_card_that_is_switched_off_loses_its_position_and_the_machine_keeps_it() {
    let bench = Bench::new();
    bench.file("square.ngc", SQUARE);
    let mut served = ServedCard::with(&[]);
    let begun = report(&served.run(&bench, "square.ngc"));
    let before = served.identify(&bench);
    assert_eq!((&begun["outcome"], &before["counts"][0]), (&"completed".into(), &1000.into()));
    served.operate("power off");
    std::thread::sleep(Duration::from_millis(100));
    served.operate("power on");
    std::thread::sleep(Duration::from_millis(100));
    let after = served.identify(&bench);
    assert_eq!((&after["counts"][0], &after["serial"]), (&0.into(), &before["serial"]));
    assert_ne!(after["boot"], before["boot"]);
    let again = report(&served.run(&bench, "square.ngc"));
    assert_eq!(again["position_counts"]["x"], 1000);
    let summary = served.end();
    assert_eq!((&summary["counts"][0], &summary["counted"][0]), (&1000.into(), &2000.into()), "{summary}");
    assert_eq!(summary["periods_apart"], 0, "{summary}");
}

pub(crate) fn signal(process: &Child, name: &str) {
    let sent = Command::new("kill").args([format!("-{name}"), process.id().to_string()]).status();
    assert!(sent.is_ok_and(|status| status.success()), "{name}");
}

/// The card reports late that it homes an axis: until then it is at rest, as it is when it has homed the axis. The
/// alarm that the host was silent ends the homing, and is not taken for the switch.
#[test]
fn an_axis_is_homed_when_the_card_has_found_its_switch_however_late_it_reports() {
    let bench = Bench::new();
    let machine = "[[axis]]\nname = \"x\"\npulses_per_mm = 100\nmax_velocity_mm_per_s = 100\n\
                   max_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-50, 100]\n\
                   home = { switch = \"lower\", position_mm = -40, search_mm_per_s = 10, latch_mm_per_s = 5 }\n\
                   [card]\nwatchdog_ms = 2000\n\
                   [[card.input]]\nnumber = 0\nuse = \"home\"\naxis = \"x\"\n";
    let machine = bench.file("m.toml", machine).display().to_string();
    for is_silent in [true, false] {
        let served = ServedCard::with(&["--machine", &machine, "--faults", "latency-us=150000"]);
        let arguments = ["home", "--card", &served.port, "--machine", "m.toml", "--json"];
        let mut host = bench.start(&arguments, Stdio::null(), "home.txt");
        if is_silent {
            // in the way of X to its switch
            std::thread::sleep(Duration::from_millis(1600));
            signal(&host, "STOP");
            std::thread::sleep(Duration::from_millis(2500));
            signal(&host, "CONT");
        }
        let code = host.wait().expect("it ends").code();
        let told = std::fs::read_to_string(bench.path("home.txt")).unwrap_or_default();
        assert_eq!(code, Some(if is_silent { 3 } else { 0 }), "{told}");
        let summary = served.end();
        let [count, counted] = ["counts", "counted"].map(|key| summary[key][0].as_i64().expect("a count"));
        assert!(is_silent || (count + 4000).abs() <= 20 && (count - counted).abs() <= 1, "{told} {summary}");
    }
}

/// A host that runs a long program on the card.
fn long_job(bench: &Bench, served: &ServedCard) -> Child {
    let program = bench.file("long.ngc", "G21 G90\nG1 X1000 F1200\nM2\n");
    let mut host = Command::new(binary());
    host.args(["run", &program.display().to_string(), "--card", &served.port]);
    host.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the retrace command runs")
}

fn kill(mut host: Child) {
    host.kill().expect("still running");
    host.wait().expect("ended");
}

/// Killed in motion, the host leaves a machine that stops by itself, on the path, and reports so to the next one.
#[test]
fn a_host_that_is_killed_leaves_a_machine_at_rest() {
    let bench = Bench::new();
    // a computer under load may need more time until the first motion
    for seconds in [2, 6, 18] {
        let served = ServedCard::with(&[]);
        let host = long_job(&bench, &served);
        std::thread::sleep(Duration::from_secs(seconds));
        kill(host);
        let begun = Instant::now();
        let mut who = served.identify(&bench);
        while (who["at_rest"] != true || who["alarm"].is_null()) && begun.elapsed() < Duration::from_secs(20) {
            who = served.identify(&bench);
        }
        let x = who["counts"][0].as_i64().expect("a count");
        if x == 0 {
            continue;
        }
        assert_eq!((&who["at_rest"], &who["alarm"]["number"]), (&true.into(), &"E3011".into()), "{who}");
        assert!(x > 0 && x < 1_000_000, "{who}");
        let summary = served.end();
        assert_eq!((&summary["counted"], &summary["periods_apart"]), (&summary["counts"], &0.into()));
        return;
    }
    panic!("no host came to move anything");
}

#[test]
fn a_port_that_is_in_use_or_not_there_is_refused_with_what_to_do() {
    let bench = Bench::new();
    let served = ServedCard::with(&[]);
    // an early query takes the port away from the host that is to have it
    let mut asked = [1, 4, 12].into_iter().map(|seconds| {
        let mut host = long_job(&bench, &served);
        std::thread::sleep(Duration::from_secs(seconds));
        let busy = bench.retrace(["card", "identify", &served.port]);
        let _ = host.kill();
        host.wait().expect("ended");
        busy
    });
    let busy = asked.find(|busy| busy.code != Some(0)).expect("a host that has the port");
    assert_eq!(busy.code, Some(2), "{}", busy.err);
    assert!(busy.err.contains("error[E2144]") && busy.err.contains("`retrace` (process"), "{}", busy.err);
    for (arguments, number) in [
        (["card", "identify", "/dev/no-such-port"], "E2141"),
        (["card", "identify", "/dev/null"], "E2146"),
        (["card", "identify", "@9600"], "E2148"),
        (["run", "long.ngc", "--card=/dev/no-such-port"], "E2141"),
    ] {
        let result = bench.retrace(arguments);
        assert_eq!(result.code, Some(2), "{arguments:?}: {}", result.err);
        assert!(result.err.contains(&format!("error[{number}]")) && result.err.contains("help: "), "{}", result.err);
    }
    for arguments in [["--faults", "flip=2"], ["--speed", "0"], ["--link", "long.ngc"]] {
        let result = bench.retrace([&["card", "serve", "--pty"][..], &arguments].concat());
        assert!(result.code == Some(2) && result.err.contains("error[E2149]"), "{arguments:?}: {}", result.err);
    }
}

#[test]
fn a_link_gives_the_card_a_name() {
    let bench = Bench::new();
    let link = bench.path("my-card").display().to_string();
    let first = ServedCard::with(&["--link", &link]);
    assert_eq!(bench.retrace(["card", "identify", &link]).code, Some(0));
    drop(first);
    let _second = ServedCard::with(&["--link", &link]);
    assert_eq!(bench.retrace(["card", "identify", &link]).code, Some(0), "a link that was left is replaced");
}

#[test]
fn ports_are_listed() {
    let bench = Bench::new();
    let result = bench.retrace(["card", "ports", "--json"]);
    let ports: Value = serde_json::from_str(&result.out).expect("one JSON object");
    assert!(ports["ports"].is_array());
    assert!(!bench.retrace(["card", "ports"]).out.is_empty());
}

/// Corners, an arc, a dwell, spindle and coolant, a synchronous output; two seconds of motion.
const WORK: &str = "G21 G90 G64 P0.05\nF1800\nM3 S900\nG1 X8 Y2\nG2 X12 Y6 I0 J4\nM62 P2\nG1 X4 Y8\nM8\nG4 P0.1\nG1 \
    X1 Y1\nM9\nM5\n\
    G0 Z2\nG1 X0\nM2\n";

/// For any commands of the operator on a card behind a serial line, the job ends on the counts that it has in this
/// process, and every place has one position.
#[test]
fn holds_reversals_and_switching_on_a_served_card_end_exactly() {
    let bench = Bench::new();
    bench.file("work.ngc", WORK);
    let script = "at 0.25s hold\nafter 0.2s resume\nafter 0.2s reverse 100%\nafter 0.4s forward 60%\nafter 0.1s \
        reverse 150%\n\
        after 0.2s leave\nafter 0.3s wheel -120 for 0.3s\nafter 0.1s leave\nat line 10 hold\nafter 0.1s resume\n";
    bench.file("work.op", script);
    let served = ServedCard::with(&["--faults", "baud=1000000,latency-us=200"]);
    let wired = report(&served.run_with(&bench, "work.ngc", &["--operator", "work.op", "--records", "out.csv"]));
    let in_process = report(&bench.retrace(["run", "work.ngc", "--json"]));
    assert_eq!((&wired["outcome"], &wired["limit_violations"]), (&"completed".into(), &0.into()), "{wired}");
    for field in ["position_counts", "commanded_mm"] {
        assert_eq!(wired[field], in_process[field], "{field}");
    }
    assert!(wired["reversals"].as_u64().is_some_and(|count| count >= 2), "{wired}");
    let records = std::fs::read_to_string(bench.path("out.csv")).expect("records");
    let (mut at, mut positions) = ([0i64; 3], std::collections::HashMap::new());
    for row in records.lines().skip(1) {
        let columns: Vec<&str> = row.split(',').collect();
        for (sum, column) in at.iter_mut().zip(&columns[5..]) {
            *sum += column.parse::<i64>().expect("increments");
        }
        let place = (columns[3].to_owned(), columns[4].to_owned());
        assert_eq!(*positions.entry(place).or_insert(at), at, "a place with two positions: {row}");
    }
    let summary = served.end();
    assert_eq!((&summary["counted"], &summary["periods_apart"]), (&summary["counts"], &0.into()));
}

/// A latched alarm keeps the next job from moving, and is cleared by a command.
#[test]
fn a_latched_alarm_is_told_and_cleared() {
    let bench = Bench::new();
    bench.file("square.ngc", SQUARE);
    let served = ServedCard::with(&[]);
    let host = long_job(&bench, &served);
    let begun = Instant::now();
    // until it has begun to move
    std::thread::sleep(Duration::from_secs(2));
    kill(host);
    while served.identify(&bench)["alarm"].is_null() && begun.elapsed() < Duration::from_secs(20) {}
    let refused = served.run(&bench, "square.ngc");
    assert_eq!(refused.code, Some(3), "{}", refused.out);
    assert!(refused.out.contains("E3011"), "{}", refused.out);
    let cleared = bench.retrace(["card", "clear", &served.port]);
    assert_eq!(cleared.code, Some(0), "{}", cleared.err);
    assert!(served.identify(&bench)["alarm"].is_null());
    // It is at rest where it was stopped; a job begins there.
    let after = report(&served.run(&bench, "square.ngc"));
    assert_eq!((&after["outcome"], &after["position_counts"]["x"]), (&"completed".into(), &1000.into()), "{after}");
}

/// Manual changes to the machine around the card are detected by the card.
#[test]
fn an_emergency_stop_is_pressed_by_hand() {
    let bench = Bench::new();
    bench.file("square.ngc", SQUARE);
    bench.file("stop.toml", "[card]\nwatchdog_ms = 2000\n[[card.input]]\nnumber = 13\nuse = \"emergency-stop\"\n");
    let machine = bench.path("stop.toml").display().to_string();
    let mut served = ServedCard::with(&["--machine", &machine]);
    let run = |served: &ServedCard| {
        bench.retrace(["run", "square.ngc", "--card", &served.port, "--machine", "stop.toml", "--json"])
    };
    served.operate("press window");
    served.operate("press emergency-stop");
    let refused = run(&served);
    assert!(refused.code == Some(3) && refused.out.contains("E3012"), "{} {}", refused.out, refused.err);
    let place = served.identify(&bench)["place"].clone();
    served.operate("release emergency-stop");
    let cleared = bench.retrace(["card", "clear", &served.port, "--machine", "stop.toml"]);
    assert_eq!(cleared.code, Some(0), "{}", cleared.err);
    assert_eq!(served.identify(&bench)["place"], place, "it still knows where it is");
    let after = report(&run(&served));
    assert_eq!((&after["outcome"], &after["position_counts"]["x"]), (&"completed".into(), &1000.into()), "{after}");
}

/// What a card cannot do is reported before anything is opened.
#[test]
fn a_machine_that_the_card_does_not_fit_is_refused() {
    let bench = Bench::new();
    bench.file("square.ngc", SQUARE);
    let axis = "[[axis]]\nname = \"x\"\npulses_per_mm = 30000\nmax_velocity_mm_per_s = \
        100\nmax_acceleration_mm_per_s2 = 1000\n\
        max_jerk_mm_per_s3 = 20000\ntravel_mm = [-10, 10]\n";
    let file = [axis.to_owned(), axis.replace("\"x\"", "\"y\"").replace("30000", "1000")].concat();
    bench.file("fine.toml", file);
    let served = ServedCard::with(&[]);
    let result = bench.retrace(["run", "square.ngc", "--machine", "fine.toml", "--card", &served.port]);
    assert_eq!(result.code, Some(3), "{}", result.err);
    assert!(
        result.err.contains("E3008") && result.err.contains("axis X") && result.err.contains("2000000"),
        "{}",
        result.err
    );
}
