//! Programs that read an input (M66, PRB-12), by the command.
//!
//! Invariant: what a program prints of #5399 is compared with the level at the card's pin.

use std::fs;
use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, CommandOutput};
use retrace_tests::served::ServedCard;
use serde_json::Value;

fn events(text: &str, kind: &str) -> Vec<Value> {
    let events = text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    events.filter(|event| event["event"] == kind).collect()
}

fn messages(text: &str) -> Vec<String> {
    events(text, "message").iter().map(|event| event["text"].as_str().unwrap_or_default().to_owned()).collect()
}

/// Waits until a job whose output goes to this file has begun so many waits for an input, and is well within the last.
fn wait_until_it_waits(bench: &Bench, file: &str, times: usize) {
    let (begun, told) = (Instant::now(), || fs::read_to_string(bench.path(file)).unwrap_or_default());
    while told().matches("\"event\":\"switching\"").count() < times {
        assert!(begun.elapsed() < Duration::from_secs(30), "wait {times} did not come: {}", told());
        thread::sleep(Duration::from_millis(5));
    }
    thread::sleep(Duration::from_millis(200));
}

/// The contact of a probe is an input like any other; it is closed below −5 mm.
#[test]
fn levels_edges_and_time_end_a_wait() {
    let bench = Bench::new();
    bench.file("m.toml", "[[card.input]]\nnumber = 0\nuse = \"probe\"\n[probe]\nguard = false\n");
    let asked = [
        ("", "L0", "0"),
        ("", "L3 Q0.5", "-1"),
        ("G1 Z-6\n", "L0", "1"),
        ("", "L3 Q5", "1"),
        ("", "L1 Q0.25", "-1"),
        ("", "L2 Q0.25", "-1"),
        ("G1 Z0\n", "L4 Q9", "0"),
        ("", "L0", "0"),
    ];
    let mut program = "G21 G90 F600\n".to_owned();
    for (before, wait, _) in asked {
        program += &format!("{before}M66 P0 {wait}\n(print,#5399)\n");
    }
    bench.file("part.ngc", program + "M2\n");
    let run =
        || -> CommandOutput { bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--work", "z<-5", "--json"]) };
    let result = run();
    assert_eq!(result.code, Some(0), "{}{}", result.out, result.err);
    let expected: Vec<String> = asked.iter().map(|(.., value)| format!("{value}.000000")).collect();
    assert_eq!(messages(&result.out), expected, "{}", result.out);
    let periods = |result: &CommandOutput| events(&result.out, "report")[0]["periods"].clone();
    let waiting = events(&result.out, "report")[0]["waiting_s"].as_f64().unwrap_or_default();
    assert!((1.0..1.05).contains(&waiting), "three waits in vain: {waiting}");
    // In virtual time the number of control periods is a function of the program alone.
    assert_eq!([periods(&run()), periods(&run())], [periods(&result), periods(&result)]);
}

#[test]
fn an_input_that_is_not_declared_is_refused() {
    let bench = Bench::new();
    bench.file("part.ngc", "G21 G90\nM66 P7 L0\nM2\n");
    let result = bench.retrace(["run", "part.ngc", "--json"]);
    assert!(result.code == Some(1) && result.err.contains("E4313"), "{}", result.err);
    assert!(!result.out.contains("\"started\""), "{}", result.out);
}

/// A cutter would burn at one place for as long as the wait may last.
#[test]
fn nothing_is_waited_for_or_probed_with_a_cutter_on() {
    let bench = Bench::new();
    let cutter = "[[cutter]]\nname = \"jet\"\nkind = \"jet\"\nfire = 3\n[[card.input]]\nnumber = 5\nuse = \"plain\"\n";
    bench.file("m.toml", format!("{cutter}[[card.input]]\nnumber = 0\nuse = \"probe\"\n"));
    for (asks, number) in [("M66 P5 L3 Q30", "E4314"), ("G38.3 Z-1 F60", "E4312"), ("M66 P5 L0", "")] {
        bench.file("part.ngc", format!("G21 G90 F600\nM64 P3\n{asks}\nM65 P3\nM2\n"));
        let result = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--json"]);
        let is_refused = result.code == Some(1) && result.err.contains(number) && !result.out.contains("\"started\"");
        assert!(is_refused || number.is_empty() && result.code == Some(0), "{asks}: {:?} {}", result.code, result.err);
    }
}

/// The first wait is answered, the host is killed in the second, and the resumed job waits there again.
#[test]
fn a_wait_ends_with_the_input_and_goes_on_in_a_resumed_job() {
    let bench = Bench::new();
    bench.file("m.toml", "[card]\nwatchdog_ms = 2000\n[[card.input]]\nnumber = 5\nuse = \"plain\"\n");
    bench.file(
        "part.ngc",
        "G21 G90 F600\nM66 P5 L1 Q60\n(print,first #5399)\nG1 X2\nM66 P5 L2 Q60\n(print,second #5399)\nG1 X4\nM2\n",
    );
    let machine = bench.path("m.toml").display().to_string();
    let mut card = ServedCard::with(&["--machine", &machine]);
    let arguments = ["run", "part.ngc", "--machine", "m.toml", "--card", &card.port, "--json", "--journal", "jobs"];
    let mut child = bench.start(&arguments, Stdio::null(), "first.txt");
    wait_until_it_waits(&bench, "first.txt", 1);
    card.operate("input 5 on");
    wait_until_it_waits(&bench, "first.txt", 2);
    child.kill().expect("it is killed");
    child.wait().expect("it ends");
    let told = fs::read_to_string(bench.path("first.txt")).expect("its output");
    assert_eq!(messages(&told), ["first 1.000000"], "{told}");
    let mut child = bench.start(&["resume", "--journal", "jobs", "--yes", "--json"], Stdio::null(), "second.txt");
    wait_until_it_waits(&bench, "second.txt", 1);
    let told = fs::read_to_string(bench.path("second.txt")).expect("its output");
    assert!(messages(&told).is_empty(), "it waits: {told}");
    card.operate("input 5 off");
    assert_eq!(child.wait().expect("it ends").code(), Some(0));
    let told = fs::read_to_string(bench.path("second.txt")).expect("its output");
    assert_eq!(messages(&told), ["second 0.000000"], "{told}");
    assert_eq!(card.identify(&bench)["counts"][0], 4000);
}

/// The host is killed after the card has executed a wait and before its answer is in the journal: the input is read
/// again.
#[test]
fn a_wait_whose_answer_is_lost_is_asked_again() {
    let bench = Bench::new();
    bench.file("m.toml", "[card]\nwatchdog_ms = 2000\n[[card.input]]\nnumber = 5\nuse = \"plain\"\n");
    bench.file(
        "part.ngc",
        "G21 G90 F600\nG1 X2\nM66 P5 L0\n(print,first #5399)\nM66 P5 L1 Q60\n(print,second #5399)\nG1 X4\nM2\n",
    );
    let machine = bench.path("m.toml").display().to_string();
    let mut card = ServedCard::with(&["--machine", &machine]);
    let arguments = ["run", "part.ngc", "--machine", "m.toml", "--card", &card.port, "--json", "--journal", "jobs"];
    let mut child = bench.start(&arguments, Stdio::null(), "first.txt");
    wait_until_it_waits(&bench, "first.txt", 2);
    child.kill().expect("it is killed");
    child.wait().expect("it ends");
    let job = fs::read_dir(bench.path("jobs")).expect("a folder").next().expect("a job").expect("readable").path();
    let journal = fs::read_to_string(job.join("journal")).expect("a journal");
    let (kept, _) = journal.split_once("{\"answer\":").expect("an answer");
    let whole_lines = &kept[..=kept.rfind('\n').expect("lines")];
    fs::write(job.join("journal"), whole_lines).expect("written");
    card.operate("input 5 on");
    let mut child = bench.start(&["resume", "--journal", "jobs", "--yes", "--json"], Stdio::null(), "second.txt");
    wait_until_it_waits(&bench, "second.txt", 2);
    card.operate("input 5 off");
    thread::sleep(Duration::from_millis(200));
    card.operate("input 5 on");
    assert_eq!(child.wait().expect("it ends").code(), Some(0));
    let told = fs::read_to_string(bench.path("second.txt")).expect("its output");
    assert_eq!(messages(&told), ["first 1.000000", "second 1.000000"], "{told}");
    assert_eq!(card.identify(&bench)["counts"][0], 4000);
}
