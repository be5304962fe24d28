//! Jobs that were left in a rigid tap, and are resumed in it (SPN-23, SPN-25).
//!
//! Invariant: what is asserted is read from the command's output and the pins of the card.

use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use retrace_tests::command::Bench;
use retrace_tests::pause::pause;
use retrace_tests::pins::{self, Sample};
use retrace_tests::served::ServedCard;

const SPINDLE: &str = "[spindle]\ncounts_per_turn = 400\nmax_rpm = 3000\n";
const STOP: &str = "[card]\nwatchdog_ms = 400\n[[card.input]]\nnumber = 13\nuse = \"emergency-stop\"\n";
/// Two holes: 40 mm below a start 3 mm above the work.
const TAPS: &str = "G21 G90\nS600 M3\nG0 X5 Z3\nG33.1 Z-40 K1\nG0 X10\nG33.1 Z-12 K1\nG0 X0 Z10\nM5\nM2\n";

/// A served card on which a job ended in its first tap; at rest.
struct LeftInTap {
    bench: Bench,
    card: ServedCard,
    z: i64,
}

impl LeftInTap {
    /// So long after the tap was due, the event happens: a line of the served card, or `kill`, which kills the host.
    fn new(settings: &str, event: &str, after_ms: u64) -> Self {
        let bench = Bench::new();
        let machine = bench.file("m.toml", format!("{STOP}{SPINDLE}{settings}")).display().to_string();
        bench.file("part.ngc", TAPS);
        let vcd = bench.path("card.vcd").display().to_string();
        let mut card = ServedCard::with(&["--machine", &machine, "--vcd", &vcd]);
        let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--json"];
        let mut host = bench.start(&run, Stdio::null(), "left.txt");
        wait_for(&bench, "left.txt", "\"tapping\"");
        pause(Duration::from_millis(after_ms));
        match event {
            "kill" => host.kill().expect("it is killed"),
            event => card.operate(event),
        }
        // the watchdog, and a spindle that coasts
        pause(Duration::from_millis(2500));
        host.wait().expect("it ends");
        if event.starts_with("press") {
            card.operate("release emergency-stop");
            pause(Duration::from_millis(300));
        }
        let z = card.identify(&bench)["counts"][2].as_i64().expect("a number");
        Self { bench, card, z }
    }

    /// Resumes the job in the background with an operator's script.
    fn resume(&self, script: &str) -> Child {
        self.bench.file("hand.op", script);
        let child =
            self.bench.start(&["resume", "--yes", "--operator", "hand.op", "--json"], Stdio::null(), "again.txt");
        wait_for(&self.bench, "again.txt", "\"tapping\"");
        child
    }

    fn told(&self) -> String {
        std::fs::read_to_string(self.bench.path("again.txt")).unwrap_or_default()
    }

    /// Ends the card; returns what was at its pins.
    fn end(self) -> (Bench, Vec<Sample>) {
        let _ = self.card.end();
        let samples = pins::samples(&self.bench.path("card.vcd"));
        (self.bench, samples)
    }
}

fn wait_for(bench: &Bench, file: &str, text: &str) {
    let begun = Instant::now();
    let told = || std::fs::read_to_string(bench.path(file)).unwrap_or_default();
    while !told().contains(text) {
        assert!(begun.elapsed() < Duration::from_secs(50), "{text}: {}", told());
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Samples behind the first rest at this height.
fn behind_rest(samples: &[Sample], z: i64) -> &[Sample] {
    let stopped = samples.iter().position(|sample| sample.at_rest && sample.counts[2] == z && !sample.is_on("spindle"));
    &samples[stopped.expect("it rests there")..]
}

/// A killed host, an emergency stop, before the turn and on the way out: resumed, the tool is held in its hole with
/// the spindle off. Cycle start turns the spindle again, and the tap goes on in its groove, once, and comes out; the
/// next hole is tapped as well.
#[test]
fn a_tap_that_was_left_in_its_hole_goes_on_in_its_groove() {
    for (event, after_ms) in [("kill", 2000), ("press emergency-stop", 2000), ("press emergency-stop", 6500)] {
        let left = LeftInTap::new("", event, after_ms);
        assert!((-40_000..0).contains(&left.z), "{event}: {}", left.z);
        let mut host = left.resume("at 2s cycle start\n");
        let code = host.wait().expect("it ends").code();
        let (told, z) = (left.told(), left.z);
        assert_eq!(code, Some(0), "{event}: {told}");
        assert_eq!(told.matches("\"event\":\"tapped\"").count(), 2, "{event}: {told}");
        let report: serde_json::Value = serde_json::from_str(told.lines().last().expect("a report")).expect("JSON");
        assert_eq!(report["position_counts"], serde_json::json!({"x": 0, "y": 0, "z": 10_000}), "{event}: {told}");
        assert_eq!(report["limit_violations"], 0, "{event}: {told}");
        let (_bench, samples) = left.end();
        let rest = behind_rest(&samples, z);
        let goes_on = rest.iter().position(|sample| sample.counts[2] != z).expect("it goes on");
        assert!(rest[goes_on].is_on("spindle"), "{event}: what moves the tool is the spindle");
        let on = rest.iter().position(|sample| sample.is_on("spindle")).expect("it turns");
        assert!(rest[on].at_us > rest[0].at_us + 3_000_000, "{event}: it was held, up to cycle start");
        let deepest = samples.iter().map(|sample| sample.counts[2]).min();
        assert!((-42_000..=-40_000).contains(&deepest.expect("samples")), "{event}: {deepest:?}");
        assert!(samples.iter().all(|sample| sample.counts[2] >= 0 || [5_000, 10_000].contains(&sample.counts[0])));
        assert!(samples.last().is_some_and(|sample| sample.at_rest && !sample.is_on("spindle")));
    }
}

/// The way out of a tap after an emergency stop: the operator turns the spindle by hand, and the tool comes out on the
/// helix, to where it began. There it is held; cycle start taps the hole again.
#[test]
fn a_tap_that_was_left_in_its_hole_is_turned_out_by_hand() {
    let mut left = LeftInTap::new("", "press emergency-stop", 2000);
    let mut host = left.resume("at 0.5s follow spindle\nat 50s cycle start\n");
    pause(Duration::from_millis(1500));
    // Half a turn a second.
    left.card.operate("spindle turn 1");
    pause(Duration::from_millis(2500));
    let deeper = left.z - 1000;
    left.card.operate(&format!("spindle turn {}", -((3_000 - deeper) as f64 / 1000.0 + 0.5)));
    let code = host.wait().expect("it ends").code();
    let (told, z) = (left.told(), left.z);
    assert_eq!(code, Some(0), "{told}");
    assert_eq!(told.matches("\"event\":\"tapped\"").count(), 2, "{told}");
    let (_bench, samples) = left.end();
    let rest = behind_rest(&samples, z);
    let out = rest.iter().position(|sample| sample.counts[2] == 3_000).expect("it comes out");
    assert!(rest[..out].iter().all(|sample| !sample.is_on("spindle") && sample.counts[0] == 5_000), "by hand");
    let deepest = rest[..out].iter().map(|sample| sample.counts[2]).min().expect("samples");
    assert!((deepest - deeper).abs() <= 5, "a turn deeper by hand: {deepest}, not {deeper}");
    let held = &rest[out..];
    let again = held.iter().position(|sample| sample.counts[2] != 3_000).expect("it taps again");
    assert!(held[again].is_on("spindle"));
}

/// Taken up again and stopped, the job can be resumed once more. `reverse` turns the tap back out of its hole where the
/// machine file allows it.
#[test]
fn a_tap_is_taken_up_more_than_once_and_reversed_out() {
    let left = LeftInTap::new("tap_retrace = true\n", "kill", 2000);
    let mut host = left.resume("at 0.5s stop\n");
    assert_eq!(host.wait().expect("it ends").code(), Some(4), "{}", left.told());
    let mut host = left.resume("at 0.5s reverse 100%\nat 12s stop\n");
    assert_eq!(host.wait().expect("it ends").code(), Some(4), "{}", left.told());
    assert_eq!(left.card.identify(&left.bench)["counts"][2].as_i64(), Some(3_000), "{}", left.told());
    let again = left.bench.retrace(["resume", "--yes", "--json"]);
    assert_eq!(again.code, Some(0), "{}{}", again.out, again.err);
    assert_eq!(again.out.matches("\"event\":\"tapped\"").count(), 2, "{}", again.out);
}

/// What has changed since is refused before anything moves: a card that was moved or switched off has lost the tap. A
/// spindle that was turned away is not switched on: the alarm says so, and turned back the tap goes on.
#[test]
fn a_tap_that_is_not_as_it_was_left_is_not_resumed() {
    let mut left = LeftInTap::new("", "kill", 2000);
    left.card.operate("spindle turn 0.4");
    pause(Duration::from_millis(1500));
    let mut host = left.resume("at 0.5s cycle start\n");
    assert_eq!(host.wait().expect("it ends").code(), Some(3), "{}", left.told());
    assert!(left.told().contains("E3035"), "{}", left.told());
    left.card.operate("spindle turn -0.4");
    pause(Duration::from_millis(1500));
    assert_eq!(left.card.identify(&left.bench)["counts"][2].as_i64(), Some(left.z), "it has not moved");
    let mut host = left.resume("at 0.5s cycle start\n");
    assert_eq!(host.wait().expect("it ends").code(), Some(0), "{}", left.told());
    for event in ["jog", "power off"] {
        let mut left = LeftInTap::new("", "kill", 2000);
        if event == "jog" {
            let cleared = left.bench.retrace(["card", "clear", &left.card.port, "--machine", "m.toml"]);
            assert_eq!(cleared.code, Some(0), "{}{}", cleared.out, cleared.err);
            let jogged = left.bench.retrace(["jog", "z", "1", "--card", &left.card.port, "--machine", "m.toml"]);
            assert_eq!(jogged.code, Some(0), "{}{}", jogged.out, jogged.err);
        } else {
            left.card.operate("power off");
            left.card.operate("power on");
            pause(Duration::from_millis(500));
        }
        let resumed = left.bench.retrace(["resume", "--yes", "--json"]);
        let told = format!("{}{}", resumed.out, resumed.err);
        assert!(resumed.code != Some(0) && (told.contains("E2219") || told.contains("E2213")), "{event}: {told}");
        let (_bench, samples) = left.end();
        let on = samples.iter().rposition(|sample| sample.is_on("spindle")).expect("it was on");
        let moved = samples.windows(2).rposition(|pair| pair[0].counts != pair[1].counts).expect("it moved");
        assert!(on < moved, "{event}: the spindle was not switched on again");
    }
}
