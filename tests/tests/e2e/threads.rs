//! Threads by the command: G33 and G76 with an encoder on the spindle (SPN-12, SPN-16, SPN-17, SPN-18, SPN-25).

use std::fs;
use std::io::Write;
use std::process::Stdio;
use std::thread::sleep;
use std::time::{Duration, Instant};

use retrace_tests::command::Bench;
use retrace_tests::geared_job::{EarlyEnd, assert_refused, end_early};
use retrace_tests::pause::pause;
use retrace_tests::pins;
use retrace_tests::run::Run;
use retrace_tests::served::ServedCard;
use retrace_tests::terminal::Terminal;
use serde_json::Value;

const ENCODER: &str = "[spindle]\ncounts_per_turn = 400\nmax_rpm = 3000\n";
const THREAD: &str = "G21 G90\nS1000 M3\nG0 X2 Z5\nG33 Z-20 K1.5\nG0 X4\nG0 Z5\nM5\nM2\n";

/// The program is checked and run with the same result, and the path is exact and within the limits.
#[test]
fn threads_and_cycles_are_checked_and_cut() {
    let cycle = "G21 G18 G90\nS800 M3\nG0 X10 Z5\nG76 P1.5 Z-25 I-1 J0.3 K0.92 R1.5 Q29.5 H1 E1.5 L2\nG0 X20 Z20\nM2\n";
    let two = "G21 G90 G64 P0.05\nS600 M3\nG0 X2 Z5\nG33 Z-20 K1.5\nG33 X3 Z-30 K2\nG0 X9\nG95 F0.2\nG1 Z-10\nM2\n";
    for (program, end) in [(THREAD, [4_000, 0, 5_000]), (cycle, [20_000, 0, 20_000]), (two, [9_000, 0, -10_000])] {
        let bench = Bench::new();
        let machine = bench.file("m.toml", ENCODER).display().to_string();
        let path = bench.file("part.ngc", program);
        let checked = bench.retrace(["check", "part.ngc", "--machine", "m.toml"]);
        assert_eq!(checked.code, Some(0), "{}", checked.err);
        assert!(checked.out.contains("cannot be passed backward: G33"), "{}", checked.out);
        assert!(checked.out.contains("threads: line 4: run-in "), "{}", checked.out);
        let run = Run::of(&bench, &path, &["--machine", &machine]);
        assert_eq!(run.counts(), end);
        assert_eq!(run.number("limit_violations") + run.number("underruns"), 0.0);
    }
}

/// A program begins a thread as far before the work as its axes need: what it reads is what the check tells of the
/// thread that follows, or a little more, in its own unit.
#[test]
fn a_program_reads_the_run_in_of_its_thread() {
    for (unit, mm, pitch, rpm) in [("G21", 1.0, 1.5, 1000), ("G21", 1.0, 3.0, 600), ("G20", 25.4, 0.05, 900)] {
        let program = format!(
            "{unit} G90\nS{rpm} M3\n#<_thread_pitch> = {pitch}\nG0 X0.1 Z#<_thread_run_in>\n\
             G33 Z[-20 * {pitch}] K{pitch}\n(print,run-in #<_thread_run_in>)\nM5\nM2\n"
        );
        let bench = Bench::new();
        let machine = bench.file("m.toml", ENCODER).display().to_string();
        let path = bench.file("part.ngc", program);
        let checked = bench.retrace(["check", "part.ngc", "--machine", "m.toml", "--json"]);
        let told: Value = serde_json::from_str(checked.out.lines().last().unwrap_or_default()).expect("a report");
        let told = told["threads"][0].clone();
        let longest = ["run_in_mm", "run_out_mm"].map(|end| told[end].as_f64().expect("a distance"));
        let run = Run::of(&bench, &path, &["--machine", &machine]);
        let text = run.of_kind("message").find_map(|message| message["text"].as_str()?.strip_prefix("run-in "));
        let read: f64 = text.and_then(|text| text.parse().ok()).expect("a figure");
        let more = read * mm - longest[0].max(longest[1]);
        // At most two records of a turn that has 40 or more.
        assert!((0.0..pitch * mm / 20.0).contains(&more), "{unit} {pitch} S{rpm}: {read} for {longest:?}");
    }
}

/// Without a pitch, a speed or an encoder it has no value: nothing begins with a run-in of 0.
#[test]
fn a_run_in_that_is_not_known_is_refused() {
    let pitch = "#<_thread_pitch> = 1.5\n";
    for (machine, before) in [
        (ENCODER, "S1000 M3\n".to_owned()),
        (ENCODER, format!("M3\n{pitch}")),
        (ENCODER, format!("G96 S100 D2000 M3\n{pitch}")),
        (ENCODER, "S1000 M3\n#<_thread_pitch> = 50\n".to_owned()),
        ("[spindle]\nmax_rpm = 3000\n", format!("S1000 M3\n{pitch}")),
    ] {
        let bench = Bench::new();
        bench.file("m.toml", machine);
        bench.file("part.ngc", format!("G21 G90\n{before}G0 Z#<_thread_run_in>\nM2\n"));
        let checked = bench.retrace(["check", "part.ngc", "--machine", "m.toml"]);
        assert!(checked.code == Some(1) && checked.err.contains("_thread_run_in"), "{before}: {}", checked.err);
    }
}

#[test]
fn what_cannot_be_cut_is_refused_before_anything_moves() {
    for (machine, program, number) in [
        ("[spindle]\nmax_rpm = 3000\n", "S1000 M3\nG33 Z-20 K1.5", "E4320"),
        ("[spindle]\ncounts_per_turn = 400\nmax_rpm = 3000\nindex = false\n", "S1000 M3\nG33 Z-20 K1.5", "E4320"),
        (ENCODER, "M3\nG33 Z-20 K1.5", "E4321"),
        (ENCODER, "S0.01 M3\nG33 Z-20 K1.5", "E4321"),
        (ENCODER, "S1000 M3\nG33 Z-40 K6", "E4322"),
        (ENCODER, "S800 M3\nG76 P8 Z-40 I-1 J0.3 K0.92", "E4322"),
        (ENCODER, "S1000 M3\nG33 Z-2 K1.5", "E4323"),
        (ENCODER, "S1000 M3\nG33 Z-50 K0.0001", "E4325"),
        (ENCODER, "G61 S600 M3\nG33 Z-20 K1.5\nG33 X5 Z-30 K1.5", "E4324"),
    ] {
        assert_refused(machine, program, number);
    }
}

/// The highest speed that the refusal names is cut.
#[test]
fn the_speed_that_a_refusal_names_fits() {
    let bench = Bench::new();
    bench.file("m.toml", ENCODER);
    let check = |speed: u32| {
        bench.file("part.ngc", format!("G21 G90\nS{speed} M3\nG33 Z-60 K6\nM2\n"));
        bench.retrace(["check", "part.ngc", "--machine", "m.toml"])
    };
    let refused = check(1000).err;
    let named = refused.split("at most S").nth(1).and_then(|rest| rest.split(' ').next()).expect("a speed");
    let speed: u32 = named.parse().unwrap_or_else(|error| panic!("{error}: {refused}"));
    assert_eq!((check(speed).code, check(speed + 2).code), (Some(0), Some(1)), "{refused}");
}

/// A stop in a thread ends behind it, and the job goes on from there.
#[test]
fn a_stop_in_a_thread_ends_behind_it() {
    let bench = Bench::new();
    bench.file("m.toml", ENCODER);
    bench.file("part.ngc", THREAD);
    bench.file("stop.op", "at 0.9s stop\n");
    let stopped = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--operator", "stop.op", "--json"]);
    assert_eq!(stopped.code, Some(4), "{}{}", stopped.out, stopped.err);
    assert_eq!(report(&stopped.out)["position_counts"]["z"], -20_000);
    let resumed = bench.retrace(["resume", "--yes", "--json"]);
    assert_eq!(resumed.code, Some(0), "{}{}", resumed.out, resumed.err);
    assert_eq!(report(&resumed.out)["position_counts"]["z"], 5_000);
}

/// A job that begins at a line cuts no thread of the lines before it.
#[test]
fn a_start_line_behind_threads_does_not_cut_them() {
    let program = "G21 G90\nS600 M3\nG0 X2 Z5\nG33 Z-20 K1.5\nG33 X3 Z-30 K1.5\nG0 X4\nG0 Z5\nM5\nM2\n";
    // A thread is two instructions: its gear, and the barrier behind it.
    for (line, instructions) in [("6", 0), ("5", 2), ("4", 2)] {
        let bench = Bench::new();
        bench.file("m.toml", ENCODER);
        bench.file("part.ngc", program);
        let run = ["run", "part.ngc", "--machine", "m.toml", "--start-line", line, "--json"];
        let result = bench.retrace(run);
        assert_eq!(result.code, Some(0), "{line}: {}{}", result.out, result.err);
        assert_eq!(report(&result.out)["position_counts"]["z"], 5_000, "{line}");
        assert_eq!(result.out.matches("\"code\":\"G33\",\"event\":\"switching\"").count(), instructions, "{line}");
    }
}

/// A resumed job starts its spindle again, and waits for its speed before it moves (SPN-6).
#[test]
fn a_resumed_job_waits_for_its_spindle() {
    let bench = Bench::new();
    bench.file("m.toml", ENCODER);
    bench.file("part.ngc", "G21 G90\nS600 M3\nG1 X50 F600\nM5\nM2\n");
    bench.file("stop.op", "at 2s stop\n");
    let stopped = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--operator", "stop.op", "--json"]);
    assert_eq!(stopped.code, Some(4), "{}{}", stopped.out, stopped.err);
    let resumed = bench.retrace(["resume", "--yes", "--json"]);
    assert_eq!(resumed.code, Some(0), "{}{}", resumed.out, resumed.err);
    let period = |kind: &str| {
        let events = resumed.out.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
        let event = events.into_iter().find(|event| event["event"] == kind && event["code"] == "M3");
        event.and_then(|event| event["period"].as_u64()).unwrap_or_else(|| panic!("{kind}: {}", resumed.out))
    };
    // 600 turns a minute take 0.2 s, and they are watched for 0.1 s.
    let waited = period("restart_switched") - period("restart_switching");
    assert!((250..1000).contains(&waited), "{waited}");
}

/// The screen shows the codes of the thread while it is cut, and not those of the block behind it.
#[test]
fn the_screen_shows_the_thread_that_is_cut() {
    let bench = Bench::new();
    let machine = bench.file("m.toml", ENCODER).display().to_string();
    let part = bench.file("part.ngc", THREAD).display().to_string();
    let state = bench.path("state").display().to_string();
    let arguments = ["run", &part, "--machine", &machine, "--realtime", "--tui"];
    let terminal = Terminal::with(&arguments, 100, 30, &[("XDG_STATE_HOME", &state)]);
    terminal.wait_for_text("READY");
    terminal.keys("c");
    let text = terminal.wait_for_text("in a thread");
    assert!(text.contains("G33 G") && !text.contains("mm/min rapid"), "{text}");
    terminal.wait_for_text("program completed");
}

/// A thread is planned when the block behind it has arrived. The index names the block that begins it all the same,
/// whether the decoder waits in between, as here, or not, as when the job is resumed.
#[test]
fn a_thread_at_the_end_of_what_has_arrived_is_found_again() {
    let bench = Bench::new();
    bench.file("m.toml", ENCODER);
    bench.file("stop.op", "at 0.9s stop\n");
    let run = ["run", "-", "--machine", "m.toml", "--operator", "stop.op", "--json"];
    let mut child = bench.start(&run, Stdio::piped(), "stopped.txt");
    let mut sender = child.stdin.take().expect("a pipe");
    let (first, rest) = THREAD.split_at(THREAD.find("G0 X4").expect("behind the thread"));
    sender.write_all(first.as_bytes()).expect("it reads");
    pause(Duration::from_millis(300));
    sender.write_all(rest.as_bytes()).expect("it reads");
    drop(sender);
    assert_eq!(child.wait().expect("it ends").code(), Some(4));
    let resumed = bench.retrace(["resume", "--yes", "--json"]);
    assert_eq!(resumed.code, Some(0), "{}{}", resumed.out, resumed.err);
    assert_eq!(report(&resumed.out)["position_counts"]["z"], 5_000);
}

fn report(out: &str) -> Value {
    serde_json::from_str(out.lines().last().unwrap_or_default()).unwrap_or_else(|error| panic!("{error}: {out}"))
}

/// The host is killed in a thread: the card switches the spindle off, the axes follow it to rest on the path, and stay
/// there whatever asks the card. Resumed, the spindle turns again, and the same pass goes on in its groove to the end.
#[test]
fn a_job_that_was_killed_in_a_thread_goes_on_in_it() {
    for spindle in [ENCODER.to_owned(), format!("{ENCODER}thread_hold = \"spindle\"\n")] {
        let killed = KilledInThread::new(&spindle);
        let identified = killed.card.identify(&killed.bench);
        assert_eq!(identified["counts"][2].as_i64(), Some(killed.z), "it has not moved");
        let cleared = killed.bench.retrace(["card", "clear", &killed.card.port, "--machine", "m.toml"]);
        assert_eq!(cleared.code, Some(0), "{}{}", cleared.out, cleared.err);
        let resumed = killed.bench.retrace(["resume", "--yes", "--json"]);
        assert_eq!(resumed.code, Some(0), "{}{}", resumed.out, resumed.err);
        let report = report(&resumed.out);
        assert_eq!(report["position_counts"], serde_json::json!({"x": 4_000, "y": 0, "z": -60_000}), "{}", resumed.out);
        assert_eq!(report["limit_violations"], 0, "{}", resumed.out);
        let (z, samples) = (killed.z, killed.end());
        let stopped =
            samples.iter().position(|sample| sample.at_rest && sample.counts[2] == z).expect("it rests there");
        let (cut, rest) = samples.split_at(stopped);
        assert!(cut.iter().any(|sample| sample.is_on("spindle")) && !samples.last().expect("a trace").is_on("spindle"));
        let goes_on = rest.iter().position(|sample| sample.counts[2] != z).expect("it goes on");
        assert!(rest[..goes_on].iter().any(|sample| !sample.is_on("spindle")), "it was off");
        assert!(rest[goes_on].is_on("spindle"), "what moves the tool is the spindle");
        // on the helix, to a count of the encoder
        let mut deepest = z;
        for sample in rest[goes_on..].iter().take_while(|sample| sample.counts[2] > -60_000) {
            deepest = deepest.min(sample.counts[2]);
            assert!(sample.counts[2] <= deepest + 4 && sample.counts[0] == 2000, "{sample:?}");
        }
    }
}

/// What has changed since is refused before anything moves: a spindle that was turned by hand does not take the tool
/// along, and is not switched on; a card that was switched off has lost the thread.
#[test]
fn a_thread_that_is_not_as_it_was_left_is_not_resumed() {
    let changes =
        [("spindle turn 0.4", "E3035"), ("spindle turn -1.5", "E3035"), ("jog", "E2219"), ("power off", "E2213")];
    for (event, number) in changes {
        let mut killed = KilledInThread::new(ENCODER);
        if event == "jog" {
            let cleared = killed.bench.retrace(["card", "clear", &killed.card.port, "--machine", "m.toml"]);
            assert_eq!(cleared.code, Some(0), "{}{}", cleared.out, cleared.err);
            let jog = ["jog", "z", "1", "--card", &killed.card.port, "--machine", "m.toml"];
            let jogged = killed.bench.retrace(jog);
            assert_eq!(jogged.code, Some(0), "{}{}", jogged.out, jogged.err);
        } else {
            killed.card.operate(event);
            pause(Duration::from_millis(1200));
        }
        if event == "power off" {
            killed.card.operate("power on");
            pause(Duration::from_millis(500));
        }
        let before = killed.card.identify(&killed.bench)["counts"].clone();
        let resumed = killed.bench.retrace(["resume", "--yes", "--json"]);
        let told = format!("{}{}", resumed.out, resumed.err);
        assert!(resumed.code != Some(0) && told.contains(number), "{event}: {told}");
        assert_eq!(killed.card.identify(&killed.bench)["counts"], before, "{event}: nothing has moved");
        let samples = killed.end();
        let on = samples.iter().rposition(|sample| sample.is_on("spindle")).expect("it was on");
        let moved = samples.windows(2).rposition(|pair| pair[0].counts != pair[1].counts).expect("it moved");
        assert!(on < moved, "{event}: the spindle was not switched on again");
    }
}

/// A served card on which the host of a thread of 60 mm was killed in it; at rest.
struct KilledInThread {
    bench: Bench,
    card: ServedCard,
    z: i64,
}

impl KilledInThread {
    fn new(spindle: &str) -> Self {
        let bench = Bench::new();
        let machine = bench.file("m.toml", spindle).display().to_string();
        bench.file("part.ngc", "G21 G90\nS600 M3\nG0 X2 Z5\nG33 Z-60 K1.5\nG0 X4\nM5\nM2\n");
        let vcd = bench.path("card.vcd").display().to_string();
        let card = ServedCard::with(&["--machine", &machine, "--vcd", &vcd]);
        let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--json"];
        let mut child = bench.start(&run, Stdio::null(), "killed.txt");
        let begun = Instant::now();
        while !fs::read_to_string(bench.path("killed.txt")).unwrap_or_default().contains("G33\"") {
            assert!(begun.elapsed() < Duration::from_secs(50), "the thread begins");
            sleep(Duration::from_millis(2));
        }
        pause(Duration::from_millis(1500));
        child.kill().expect("it is killed");
        child.wait().expect("it ends");
        // the watchdog, and a spindle that coasts
        pause(Duration::from_millis(1500));
        let place = card.identify(&bench);
        let z = place["counts"][2].as_i64().unwrap_or_else(|| panic!("{place}"));
        assert!((-58_000..0).contains(&z), "inside the thread: {z}");
        Self { bench, card, z }
    }

    /// Ends the card: what was at its pins.
    fn end(self) -> Vec<pins::Sample> {
        let _ = self.card.end();
        pins::samples(&self.bench.path("card.vcd"))
    }
}

/// Whatever ends a thread early: the spindle is off, the machine is at rest inside of the thread, and nothing moves it
/// afterwards, also not a spindle that is turned by hand.
#[test]
fn whatever_ends_a_thread_early_leaves_the_spindle_off_and_the_machine_at_rest() {
    assert_early_ends_are_safe(ENCODER);
}

/// The same in a thread in which a hold stops the spindle.
#[test]
fn whatever_ends_a_held_thread_early_leaves_the_spindle_off_and_the_machine_at_rest() {
    assert_early_ends_are_safe(&format!("{ENCODER}thread_hold = \"spindle\"\n"));
}

fn assert_early_ends_are_safe(spindle: &str) {
    let events =
        [("encoder dead", "E3033"), ("press emergency-stop", "E3012"), ("unplug", ""), ("power off", ""), ("kill", "")];
    let program = "G21 G90\nS600 M3\nG0 X2 Z5\nG33 Z-60 K1.5\nG0 X4\nM5\nM2\n";
    for (event, number) in events {
        let EarlyEnd { samples } = end_early(spindle, program, ("G33\"", 1200), (event, number));
        let last = samples.last().expect("a trace");
        assert!(!last.is_on("spindle"), "{event}: {last:?}");
        let switched_off = samples.iter().rposition(|sample| sample.is_on("spindle")).expect("it was on");
        let rest = samples.iter().rev().take_while(|sample| sample.rate == 0.0).count();
        let moved_for = samples.len() - rest - switched_off;
        // 600 turns a minute coast to rest in 0.4 s.
        assert!(moved_for <= 700, "{event}: {moved_for} periods behind the switching");
    }
}
