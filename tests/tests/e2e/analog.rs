//! Analog outputs, M67 and M68, at the card's outputs (PRB-13), and analog inputs, M66 E (PRB-12).
//!
//! Invariant: a value is that of the trace, in 1/65 536 of the unit; nothing is taken from the plan.

use std::fs;
use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, assert_contains};
use retrace_tests::pause::pause;
use retrace_tests::pins::{Sample, run_with_pins, samples};
use retrace_tests::run::Run;
use retrace_tests::served::ServedCard;
use serde_json::Value;

const OUTPUTS: &str = "[[card.analog_output]]\nnumber = 0\nname = \"gas\"\nunit = \"bar\"\nmin = 0\nmax = 16\n\
    [[card.analog_output]]\nnumber = 5\nname = \"height\"\nunit = \"V\"\nmin = -10\nmax = 10\nsafe = 2.5\n";

/// Value of one unit.
const ONE: f64 = 65_536.0;

/// Amount of an output, in its unit.
fn amount(sample: &Sample, name: &str) -> f64 {
    let value = sample.outputs.get(name).copied().unwrap_or_default();
    f64::from(value as u32 as i32) / ONE
}

fn events(text: &str, kind: &str) -> Vec<Value> {
    let events = text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    events.filter(|event| event["event"] == kind).collect()
}

fn run(machine: &str, program: &str, script: &str) -> (Run, Vec<Sample>) {
    run_with_pins(machine, program, script, &[])
}

/// M67 changes the value at its place without a stop, and the value belongs to the place: backward it is the earlier
/// one, forward again the new one. M68 changes it at rest.
#[test]
fn a_value_is_set_in_passing_at_its_place_and_undone_in_reverse() {
    let machine = format!("retrace_outputs = \"replayed\"\n{OUTPUTS}");
    let program = "G21 G90 G64 F1200\nM68 E0 Q1.5\nG1 X4\nM67 E0 Q3.25\nG1 X20\nM68 E5 Q-7.125\nG1 X24\nM2\n";
    let script = "at line 5 hold\nafter 1s reverse 100%\nafter 1.5s leave\n";
    let (run, trace) = run(&machine, program, script);
    run.assert_exact_and_legal();
    assert_eq!((&run.report["outcome"], &run.report["reversals"]), (&"completed".into(), &2.into()));
    // M68 is executed at rest: what moves behind it may begin in its period.
    let set_at_rest = |name: &str, counts: [i64; 3]| {
        let at = trace.iter().position(|now| amount(now, name) != 0.0).expect("M68");
        let was_at_rest = at == 0 || trace[at - 1].at_rest && trace[at - 1].counts == counts;
        assert!(was_at_rest && trace[at].counts == counts, "{:?}", trace[at]);
        &trace[at]
    };
    let first = set_at_rest("analog0", [0; 3]);
    assert_eq!(amount(first, "analog0"), 1.5);
    // The change is in the control period that leaves the place.
    let (mut backward, mut forward) = (0, 0);
    for pair in trace.windows(2).filter(|pair| pair[0].at_us >= first.at_us && pair[0].counts != pair[1].counts) {
        let low = pair[0].counts[0].min(pair[1].counts[0]);
        let expected = if low < 4000 { [1.5, 3.25] } else { [3.25; 2] };
        let is = amount(&pair[1], "analog0");
        assert!(expected.contains(&is) && (low > 3900 || is == 1.5), "{pair:?}");
        backward += usize::from(pair[1].rate < 0.0 && low < 4000);
        forward += usize::from(amount(&pair[0], "analog0") < amount(&pair[1], "analog0"));
        let passes = amount(&pair[0], "analog0") != amount(&pair[1], "analog0");
        assert!(!passes || !pair[0].at_rest && pair[1].rate != 0.0, "in passing: {pair:?}");
    }
    assert!(backward > 100 && forward == 2, "{backward} {forward}");
    assert_eq!(amount(set_at_rest("analog5", [20_000, 0, 0]), "analog5"), -7.125);
    let changed: Vec<&Value> = run.events.iter().filter(|event| event["event"] == "output_changed").collect();
    assert_eq!(changed.len(), 1, "{changed:?}");
    let event = changed[0];
    assert_eq!(
        (&event["channel"], &event["name"], &event["value"], &event["unit"]),
        (&72.into(), &"gas".into(), &212_992.into(), &"bar".into())
    );
    let retraced: Vec<&Value> = run.events.iter().filter(|event| event["event"] == "retrace_switched").collect();
    assert!(retraced.iter().any(|event| event["value"] == 98_304 && event["unit"] == "bar"), "{retraced:?}");
}

/// With outputs that the operator switches, a reverse run leaves an analog output as it is, too.
#[test]
fn a_reverse_run_that_replays_nothing_leaves_the_value() {
    let program = "G21 G90 G64 F1200\nG1 X4\nM67 E0 Q3\nG1 X20\nM2\n";
    let (run, trace) = run(OUTPUTS, program, "at line 4 hold\nafter 1s reverse 100%\nafter 1.5s leave\n");
    assert_eq!(run.report["outcome"], "completed");
    let values: Vec<f64> = trace.iter().map(|now| amount(now, "analog0")).collect();
    assert!(values.windows(2).filter(|pair| pair[0] != pair[1]).count() == 1 && values.last() == Some(&3.0));
}

#[test]
fn what_is_not_declared_or_out_of_range_is_refused_before_anything_moves() {
    for (machine, program, parts) in [
        (OUTPUTS, "G1 X5\nM67 E1 Q1\n", ["E4330", "M67", "1"]),
        (OUTPUTS, "G1 X5\nM68 E8 Q1\n", ["E4330", "M68", "8"]),
        ("name = \"mill\"\n", "G1 X5\nM67 E0 Q1\n", ["E4330", "M67", "[[card.analog_output]]"]),
        (OUTPUTS, "G1 X5\nM67 E0 Q16.001\n", ["E4331", "gas to 16.001 bar", "0 to 16 bar"]),
        (OUTPUTS, "G1 X5\n#1=[2-13]\nM68 E5 Q#1\n", ["E4331", "height to -11 V", "-10 to 10 V"]),
    ] {
        let bench = Bench::new();
        bench.file("m.toml", machine);
        bench.file("part.ngc", format!("G21 G90 F600\n{program}M2\n"));
        for command in ["check", "run"] {
            let result = bench.retrace([command, "part.ngc", "--machine", "m.toml", "--json"]);
            assert_eq!(result.code, Some(1), "{program}: {}", result.out);
            assert_contains(&format!("{}{}", result.out, result.err), &parts);
            assert!(!result.out.contains("\"started\""), "{}", result.out);
        }
    }
}

/// An amount that depends on the machine's answer is not known to the check; out of its range it is a planned stop.
#[test]
fn an_amount_that_is_out_of_range_in_the_run_ends_it_at_rest() {
    let machine = format!("{OUTPUTS}[[card.input]]\nnumber = 5\nuse = \"plain\"\n");
    let program = "G21 G90 F600\nG1 X2\nM66 P5 L0\nM67 E0 Q[20+#5399]\nG1 X9\nM2\n";
    let (run, trace) = run(&machine, program, "");
    let told = format!("{}{}", run.output.out, run.output.err);
    assert!(run.output.code == Some(1) && told.contains("E4331") && told.contains("20 bar"), "{told}");
    let last = trace.last().expect("a sample");
    assert!(last.at_rest && last.counts == [2000, 0, 0] && amount(last, "analog0") == 0.0, "{last:?}");
}

/// A hold and a stop leave the value as they leave a digital output, and so does the end of the program.
#[test]
fn a_stop_leaves_the_value() {
    for script in ["at line 4 hold\nafter 1s stop\n", ""] {
        let program = "G21 G90 F1200\nM64 P2\nM68 E5 Q4\nG1 X20\nM2\n";
        let (_, trace) = run(OUTPUTS, program, script);
        let set = trace.iter().position(|now| amount(now, "analog5") == 4.0).expect("M68");
        assert!(trace[set..].iter().all(|now| amount(now, "analog5") == 4.0 && now.is_on("out2")), "{script}");
    }
}

/// An emergency stop, a killed host and a lost link: the card sets the safe value by itself, in the control period of
/// the alarm. A digital output that is not in `off_at_fault` stays as it is.
#[test]
fn an_alarm_sets_the_safe_value() {
    for cause in ["input 13 on", "unplug", "kill"] {
        let bench = Bench::new();
        let stop = "[[card.input]]\nnumber = 13\nuse = \"emergency-stop\"\n";
        bench.file("m.toml", format!("[card]\nwatchdog_ms = 1000\n{OUTPUTS}{stop}"));
        bench.file("part.ngc", "G21 G90 F600\nM64 P2\nM68 E0 Q12\nM68 E5 Q-3\nG1 X1\nM67 E5 Q-4\nG1 X90\nM2\n");
        let [machine, vcd] = ["m.toml", "pins.vcd"].map(|name| bench.path(name).display().to_string());
        let mut card = ServedCard::with(&["--machine", &machine, "--vcd", &vcd]);
        let arguments = ["run", "part.ngc", "--machine", "m.toml", "--card", &card.port, "--json"];
        let mut child = bench.start(&arguments, Stdio::null(), "told.txt");
        let begun = Instant::now();
        while !fs::read_to_string(bench.path("told.txt")).unwrap_or_default().contains("\"event\":\"output_changed\"") {
            assert!(begun.elapsed() < Duration::from_secs(30), "{cause}: nothing was set");
            thread::sleep(Duration::from_millis(5));
        }
        match cause {
            "kill" => child.kill().expect("it is killed"),
            line => card.operate(line),
        }
        pause(Duration::from_millis(2000));
        let _ = card.end();
        let _ = child.kill();
        child.wait().expect("it ends");
        let trace = samples(&bench.path("pins.vcd"));
        let alarm = trace.iter().position(|now| now.alarm != 0).expect("an alarm");
        let before = &trace[alarm - 1];
        assert_eq!((amount(before, "analog0"), amount(before, "analog5")), (12.0, -4.0), "{cause}: {before:?}");
        for now in &trace[alarm..] {
            assert_eq!((amount(now, "analog0"), amount(now, "analog5")), (0.0, 2.5), "{cause}: {now:?}");
            assert!(now.is_on("out2"), "{cause}: {now:?}");
        }
    }
}

/// After a power loss of the card every output is 0 at its pins, also one whose safe value is another, until a program
/// sets it; nothing moves.
#[test]
fn a_power_loss_leaves_the_value_at_zero_until_a_program_sets_it() {
    let bench = Bench::new();
    bench.file("m.toml", format!("[card]\nwatchdog_ms = 1000\n{OUTPUTS}"));
    bench.file("part.ngc", "G21 G90 F600\nM68 E0 Q12\nM68 E5 Q-3\nG1 X1\nM67 E5 Q-4\nG1 X90\nM2\n");
    let [machine, vcd] = ["m.toml", "pins.vcd"].map(|name| bench.path(name).display().to_string());
    let mut card = ServedCard::with(&["--machine", &machine, "--vcd", &vcd]);
    let arguments = ["run", "part.ngc", "--machine", "m.toml", "--card", &card.port, "--json"];
    let mut child = bench.start(&arguments, Stdio::null(), "told.txt");
    let begun = Instant::now();
    while !fs::read_to_string(bench.path("told.txt")).unwrap_or_default().contains("\"event\":\"output_changed\"") {
        assert!(begun.elapsed() < Duration::from_secs(30), "nothing was set");
        thread::sleep(Duration::from_millis(5));
    }
    card.operate("power off");
    pause(Duration::from_millis(300));
    card.operate("power on");
    pause(Duration::from_millis(1500));
    let _ = child.kill();
    child.wait().expect("it ends");
    let _ = card.end();
    let trace = samples(&bench.path("pins.vcd"));
    let set = trace.iter().rposition(|now| amount(now, "analog5") == -4.0).expect("M67");
    assert!(trace.len() > set + 1, "the power is off");
    for now in &trace[set + 1..] {
        assert_eq!((amount(now, "analog0"), amount(now, "analog5"), now.rate), (0.0, 0.0, 0.0), "{now:?}");
    }
}

/// The values are a part of what a resumed job restores.
#[test]
fn a_resumed_job_restores_the_value() {
    let bench = Bench::new();
    bench.file("m.toml", format!("[card]\nwatchdog_ms = 1000\n{OUTPUTS}"));
    bench.file("part.ngc", "G21 G90 F1200\nM68 E5 Q-3\nG1 X1\nM67 E0 Q7.5\nG1 X60\nM2\n");
    let [machine, vcd] = ["m.toml", "pins.vcd"].map(|name| bench.path(name).display().to_string());
    let card = ServedCard::with(&["--machine", &machine, "--vcd", &vcd]);
    let arguments = ["run", "part.ngc", "--machine", "m.toml", "--card", &card.port, "--json", "--journal", "jobs"];
    let mut child = bench.start(&arguments, Stdio::null(), "told.txt");
    let begun = Instant::now();
    while !fs::read_to_string(bench.path("told.txt")).unwrap_or_default().contains("\"event\":\"output_changed\"") {
        assert!(begun.elapsed() < Duration::from_secs(30), "nothing was set");
        thread::sleep(Duration::from_millis(5));
    }
    pause(Duration::from_millis(300));
    child.kill().expect("it is killed");
    child.wait().expect("it ends");
    pause(Duration::from_millis(1500));
    let resumed = bench.retrace(["resume", "--journal", "jobs", "--yes", "--json"]);
    assert_eq!(resumed.code, Some(0), "{} {}", resumed.out, resumed.err);
    assert_eq!(events(&resumed.out, "report")[0]["outcome"], "completed");
    assert_eq!(card.identify(&bench)["counts"][0], 60_000);
    let _ = card.end();
    let trace = samples(&bench.path("pins.vcd"));
    let alarm = trace.iter().position(|now| now.alarm != 0).expect("the host is silent");
    let moves = |now: &&Sample| now.rate != 0.0 && now.alarm == 0;
    let moving: Vec<&Sample> = trace[alarm..].iter().filter(moves).collect();
    assert!(moving.len() > 100);
    for now in moving {
        assert_eq!((amount(now, "analog0"), amount(now, "analog5")), (7.5, -3.0), "{now:?}");
    }
}

/// A card that has no analog outputs is refused by name, before anything moves.
#[test]
fn a_card_without_analog_outputs_is_refused() {
    let bench = Bench::new();
    bench.file("m.toml", OUTPUTS);
    for board in ["pico", "f405"] {
        let result = bench.retrace(["machine", "check", "m.toml", "--card", board]);
        assert_eq!(result.code, Some(2), "{}", result.out);
        assert_contains(&result.err, &["E3008", "gas is analog output 0", "no analog outputs"]);
    }
}

const INPUT: &str = "[[card.analog_input]]\nnumber = 1\nname = \"arc\"\nunit = \"V\"\nat_full = 256\n";

/// M66 E reads at rest, behind the motion before it, and the answer stands: a resumed job does not ask again.
#[test]
fn a_program_learns_what_an_analog_input_shows_at_rest_and_a_resumed_job_knows_it() {
    let bench = Bench::new();
    bench.file("m.toml", format!("[card]\nwatchdog_ms = 1000\n{INPUT}"));
    bench.file("part.ngc", "G21 G90 F900\nG1 X15\nM66 E1 L0\nG1 X45 Y#5399\nF300\nX60\nM2\n");
    let machine = bench.path("m.toml").display().to_string();
    let mut card = ServedCard::with(&["--machine", &machine]);
    card.operate("analog 1 80");
    let arguments = ["run", "part.ngc", "--machine", "m.toml", "--card", &card.port, "--json", "--journal", "jobs"];
    let mut child = bench.start(&arguments, Stdio::null(), "told.txt");
    let wait_for_line = |line: i64| {
        let begun = Instant::now();
        let told = || fs::read_to_string(bench.path("told.txt")).unwrap_or_default();
        while !events(&told(), "block").iter().chain(&events(&told(), "switching")).any(|event| event["line"] == line) {
            assert!(begun.elapsed() < Duration::from_secs(30), "line {line}: {}", told());
            thread::sleep(Duration::from_millis(5));
        }
    };
    // On the way to the wait it shows something else.
    pause(Duration::from_millis(300));
    card.operate("analog 1 12.5");
    wait_for_line(3);
    pause(Duration::from_millis(500));
    card.operate("analog 1 33");
    pause(Duration::from_millis(2500));
    child.kill().expect("it is killed");
    child.wait().expect("it ends");
    pause(Duration::from_millis(1500));
    let before = card.identify(&bench)["counts"].clone();
    let x = before[0].as_i64().expect("a count");
    assert!((45_000..60_000).contains(&x) && before[1] == 12_500, "killed behind the move: {before}");
    let resumed = bench.retrace(["resume", "--journal", "jobs", "--yes", "--json"]);
    assert_eq!(resumed.code, Some(0), "{} {}", resumed.out, resumed.err);
    assert_eq!(events(&resumed.out, "report")[0]["outcome"], "completed");
    assert!(events(&resumed.out, "switching").iter().all(|event| event["code"] != "M66"), "{}", resumed.out);
    let counts = card.identify(&bench)["counts"].clone();
    assert_eq!((&counts[0], &counts[1]), (&60_000.into(), &12_500.into()));
    let _ = card.end();
}

/// An input whose reading is lost on the way to the wait, as where a module is silent, is waited for at rest: a program
/// never learns a reading of before.
#[test]
fn a_program_waits_for_a_reading_that_is_lost() {
    let bench = Bench::new();
    bench.file("m.toml", INPUT);
    bench.file("part.ngc", "G21 G90 F900\nG1 X15\nM66 E1 L0\nG1 Y#5399\nM2\n");
    let machine = bench.path("m.toml").display().to_string();
    let mut card = ServedCard::with(&["--machine", &machine]);
    card.operate("analog 1 80");
    let arguments = ["run", "part.ngc", "--machine", "m.toml", "--card", &card.port, "--json"];
    let mut child = bench.start(&arguments, Stdio::null(), "told.txt");
    let told = || fs::read_to_string(bench.path("told.txt")).unwrap_or_default();
    let begun = Instant::now();
    let wait_for = |kind: &str, line: i64| {
        while !events(&told(), kind).iter().any(|event| event["line"] == line) {
            assert!(begun.elapsed() < Duration::from_secs(30), "line {line}: {}", told());
            thread::sleep(Duration::from_millis(5));
        }
    };
    wait_for("started", 0);
    card.operate("analog 1 none");
    wait_for("switching", 3);
    pause(Duration::from_millis(500));
    assert!(!told().contains("\"event\":\"report\"") && events(&told(), "switched").is_empty(), "{}", told());
    card.operate("analog 1 12.5");
    assert_eq!(child.wait().expect("it ends").code(), Some(0), "{}", told());
    let counts = card.identify(&bench)["counts"].clone();
    assert_eq!((&counts[0], &counts[1]), (&15_000.into(), &12_500.into()));
    let _ = card.end();
}

/// Where a program reads with the torch on, the torch stands for the time of a report, and never for longer than the
/// card lets one burn at rest; it is not put out for it.
#[test]
fn a_torch_stands_for_a_report_while_a_program_reads() {
    let torch = "[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nstart = { pierce_s = 0.4 }\n";
    let program = "G21 G90 F1800\nG0 X10\nM3\nG1 X70\nM66 E1 L0\nG1 X100\nM5\nM2\n";
    for every_ms in [8, 99] {
        let (run, trace) = run(&format!("{torch}[card]\nreport_every_ms = {every_ms}\n{INPUT}"), program, "");
        run.assert_exact_and_legal();
        let burns = |now: &&Sample| now.is_on("spindle") && now.at_rest && now.counts == [70_000, 0, 0];
        let first = trace.iter().find(burns).expect("it stands");
        let behind = trace.iter().find(|now| now.at_us > first.at_us && !burns(now)).expect("it goes on");
        let stands_ms = (behind.at_us - first.at_us) / 1000;
        assert!((every_ms..=every_ms + 3).contains(&stands_ms), "{every_ms}: {stands_ms} ms");
        assert_eq!((&run.report["outcome"], &run.report["cut_interruptions"]), (&"completed".into(), &0.into()));
    }
}

/// An input that the machine file does not declare, and a card that has none.
#[test]
fn an_analog_input_that_is_not_there_is_refused_before_anything_moves() {
    let bench = Bench::new();
    bench.file("m.toml", INPUT);
    bench.file("part.ngc", "G21 G90 F600\nG1 X5\nM66 E0 L0\nM2\n");
    for command in ["check", "run"] {
        let result = bench.retrace([command, "part.ngc", "--machine", "m.toml", "--json"]);
        assert_eq!(result.code, Some(1), "{}", result.out);
        assert_contains(
            &format!("{}{}", result.out, result.err),
            &["E4332", "analog input 0", "[[card.analog_input]]"],
        );
    }
    bench.file("m.toml", INPUT.replace("number = 1", "number = 2"));
    for (board, has) in [("pico", "the card has 2 of them"), ("f405", "no analog inputs")] {
        let result = bench.retrace(["machine", "check", "m.toml", "--card", board]);
        assert_eq!(result.code, Some(2), "{}", result.out);
        assert_contains(&result.err, &["E3008", "arc is analog input 2", has]);
    }
}
