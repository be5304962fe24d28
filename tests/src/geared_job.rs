//! Jobs whose motion follows the spindle, refused or ended early, for tests of threads and taps.
//!
//! Invariant: what is asserted is read from the command's output and the pins of the card.

use std::process::Stdio;
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::command::Bench;
use crate::pause::pause;
use crate::pins::{self, Sample};
use crate::served::ServedCard;

/// Asserts that the third line of a program is refused, by `check` and by `run`, before anything moves.
///
/// # Panics
/// Where it is not, or with another number.
pub fn assert_refused(machine: &str, program: &str, number: &str) {
    let bench = Bench::new();
    bench.file("m.toml", machine);
    bench.file("part.ngc", format!("G21 G90\n{program}\nM2\n"));
    for command in ["check", "run"] {
        let result = bench.retrace([command, "part.ngc", "--machine", "m.toml", "--json"]);
        let told = format!("{}{}", result.out, result.err);
        assert!(result.code == Some(1) && told.contains(number), "{command} {program}: {told}");
        assert!(told.contains("part.ngc:3:") || told.contains("\"line\":3"), "{command} {program}: {told}");
        assert!(!result.out.contains("\"started\""), "{told}");
    }
}

/// How a job ended early.
#[derive(Debug)]
pub struct EarlyEnd {
    /// What was at the pins of the card. Behind the end the spindle was turned by hand.
    pub samples: Vec<Sample>,
}

/// Runs a job on a card with an emergency stop at input 13. So long after its output has `begins`, the event happens: a
/// line of the served card, or `kill`, which kills the host. The host tells `number`.
///
/// # Panics
/// Where it does not begin or tells another number.
#[must_use]
pub fn end_early(
    spindle: &str,
    program: &str,
    (begins, after_ms): (&str, u64),
    (event, number): (&str, &str),
) -> EarlyEnd {
    let bench = Bench::new();
    let stop = "[[card.input]]\nnumber = 13\nuse = \"emergency-stop\"\n";
    let machine = bench.file("m.toml", format!("{stop}{spindle}")).display().to_string();
    bench.file("part.ngc", program);
    let vcd = bench.path("card.vcd");
    let mut card = ServedCard::with(&["--machine", &machine, "--vcd", &vcd.display().to_string()]);
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--json"];
    let mut host = bench.start(&run, Stdio::null(), "run.txt");
    let told = || std::fs::read_to_string(bench.path("run.txt")).unwrap_or_default();
    let begun = Instant::now();
    while !told().contains(begins) {
        assert!(begun.elapsed() < Duration::from_secs(50), "{event}: it begins: {}", told());
        sleep(Duration::from_millis(2));
    }
    sleep(Duration::from_millis(after_ms));
    match event {
        "kill" => host.kill().expect("it is killed"),
        event => card.operate(event),
    }
    pause(Duration::from_millis(1000));
    if event == "power off" {
        card.operate("power on");
        pause(Duration::from_millis(500));
    }
    let _ = host.kill();
    host.wait().expect("it ends");
    assert!(told().contains(number), "{event}: {}", told());
    card.operate("spindle turn 0.4");
    pause(Duration::from_millis(1200));
    let _ = card.end();
    EarlyEnd { samples: pins::samples(&vcd) }
}
