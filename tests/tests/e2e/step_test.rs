//! `retrace doctor PORT --step-test`: the steps of an axis, counted at a wire by the card itself.

use std::process::Stdio;
use std::time::Duration;

use retrace_tests::command::{Bench, retrace_command};
use retrace_tests::pins::samples;
use retrace_tests::served::ServedCard;
use serde_json::Value;

fn counts(bench: &Bench, port: &str) -> Value {
    let told = bench.retrace(["card", "identify", port, "--json"]);
    serde_json::from_str::<Value>(&told.out).expect("JSON")["counts"].clone()
}

/// The wired axis passes at each speed and ends where it began; another one does not, which is exit code 3. Nothing
/// moves before somebody has agreed.
#[test]
fn the_steps_at_the_wire_are_those_that_were_ordered() {
    let (bench, card) = (Bench::new(), ServedCard::with(&["--step-wire", "x"]));
    let test = |more: &[&str]| bench.retrace([&["doctor", &card.port, "--step-test"], more].concat());
    let began = counts(&bench, &card.port);
    let asked = test(&["x"]);
    assert!(asked.code == Some(2) && asked.err.contains("E2164"), "{}", asked.err);
    assert_eq!(counts(&bench, &card.port), began, "nothing has moved");

    let passed = test(&["x", "--yes", "--json"]);
    assert_eq!(passed.code, Some(0), "{} {}", passed.out, passed.err);
    let told: Value = serde_json::from_str(&passed.out).expect("JSON");
    let found = &told["step_test"];
    let rates = found["rates"].as_array().expect("rates");
    assert!(found["passed"] == true && rates.len() == 6, "{found}");
    for (rate, hz) in rates.iter().zip([10_000.0, 10_000.0, 30_000.0, 30_000.0, 100_000.0, 100_000.0]) {
        let of = |name: &str| rate[name].as_f64().expect("a number");
        assert!((of("ordered_hz") - hz).abs() < 0.005 * hz, "{rate}");
        assert!((of("measured_hz") - of("ordered_hz")).abs() < 0.002 * hz, "{rate}");
    }
    assert_eq!(counts(&bench, &card.port), began, "it ends where it began");

    let failed = test(&["y", "--yes"]);
    assert!(failed.code == Some(3) && failed.err.contains("E2164"), "{}", failed.err);
    assert!(failed.out.contains("FAILED") && failed.out.matches("WRONG").count() == 6, "{}", failed.out);
    let none = test(&["w", "--yes"]);
    assert!(none.code == Some(2) && none.err.contains("E2161"), "{}", none.err);
}

/// A signal ends the test at rest, and so does the loss of its host.
#[test]
fn a_signal_and_a_killed_host_end_the_test_at_rest() {
    // In a move, and between two.
    for (signal, after_ms) in [("-TERM", 700), ("-TERM", 900), ("-TERM", 1000), ("-TERM", 1100), ("-KILL", 900)] {
        let bench = Bench::new();
        let vcd = bench.path("pins.vcd");
        let card = ServedCard::with(&["--step-wire", "x", "--vcd", &vcd.display().to_string()]);
        let mut command = retrace_command(["doctor", &card.port, "--step-test", "x", "--yes"]);
        let mut host = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("it runs");
        std::thread::sleep(Duration::from_millis(after_ms));
        let pid = host.id().to_string();
        std::process::Command::new("kill").args([signal, &pid]).status().expect("kill");
        let ended = host.wait().expect("it ends");
        assert!(!ended.success(), "{signal} after {after_ms} ms: {ended}");
        std::thread::sleep(Duration::from_millis(1000));
        let stands = counts(&bench, &card.port);
        std::thread::sleep(Duration::from_millis(300));
        assert_eq!(counts(&bench, &card.port), stands, "{signal}: at rest");
        let _ = card.end();
        let trace = samples(&vcd);
        assert!(trace.iter().all(|sample| sample.outputs.is_empty()), "{signal}: no output is switched");
        assert!(trace.last().is_some_and(|sample| sample.at_rest && sample.counts[1..] == [0, 0]), "{signal}");
    }
}
