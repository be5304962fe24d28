//! The sense test (CUT-57), in a job that is held, and while no program runs; seen at the pins.
//!
//! Invariant: the place of the sheet is that of the simulated table, and nothing is lit by a test.

use retrace_tests::command::Bench;
use retrace_tests::limits::audit;
use retrace_tests::page_client::PageServer;
use retrace_tests::pins::{Sample, samples};
use retrace_tests::run::Run;
use retrace_tests::sensing_torch::{SENSE, SHEET, TOOL_PULSES, machine};
use retrace_tests::served::ServedCard;

/// Two cuts of 30 mm, with a program stop between them.
const PROGRAM: &str = "G21 G90 F1800\nG0 X10\nM3 S1\nG1 X40\nM5\nM0\nG0 X60\nM3\nG1 X90\nM5\nG0 X0\nM2\n";
const MATERIALS: &str = "units = \"mm\"\ndefault = 1\n[[material]]\nnumber = 1\nname = \"Steel\"\nkerf_mm = 1.4\n\
    pierce_height_mm = 3.8\npierce_delay_s = 0.2\ncut_height_mm = 1.5\nfeed_mm_per_min = 1800\n";
/// A contact opens one pulse above the place where it closes.
const SHEET_MM: f64 = (SHEET + 1) as f64 / TOOL_PULSES;

fn run(script: &str) -> (Run, Vec<Sample>) {
    let bench = Bench::new();
    bench.file("part.ngc", PROGRAM);
    bench.file("materials.toml", MATERIALS);
    let machine = bench.file("m.toml", machine(SENSE)).display().to_string();
    let (operator, vcd) = (bench.file("s.op", script).display().to_string(), bench.path("pins.vcd"));
    let trace = vcd.display().to_string();
    let run =
        Run::of(&bench, &bench.path("part.ngc"), &["--machine", &machine, "--vcd", &trace, "--operator", &operator]);
    assert_eq!(run.report["outcome"], "completed", "{script}: {}", run.output.err);
    assert_eq!(run.report["not_cut_mm"], 0.0, "{script}");
    let samples = samples(&vcd);
    assert_eq!(samples.last().map(|sample| sample.counts[2] + sample.layer), Some(0), "{script}");
    let audit = audit(&run.records.clone().with_layer(2), &run.axes(), 1e-3);
    assert_eq!(audit.violations, [0; 3], "{:?}", audit.first);
    (run, samples)
}

/// What the tests have found: the results, and the position of the sheet in mm where there is one.
fn results(run: &Run) -> Vec<(String, Option<f64>)> {
    let tests = run.of_kind("sense_test");
    tests.map(|test| (test["result"].as_str().unwrap_or_default().to_owned(), test["position_mm"].as_f64())).collect()
}

/// Height of the tool in pulses at this time.
fn height_at(samples: &[Sample], time_s: f64) -> i64 {
    // Where nothing changes there is no sample.
    let at = samples.partition_point(|sample| (sample.at_us as f64) <= time_s * 1e6);
    samples[at - 1].counts[2] + samples[at - 1].layer
}

fn times(run: &Run, kind: &str, key: &str, value: &str) -> Vec<f64> {
    run.of_kind(kind).filter(|event| event[key] == value).map(|event| event["time_s"].as_f64().expect("s")).collect()
}

/// A test in an interrupted cut, and one at a program stop: the sheet is found where it is, the tool is back where it
/// was, and the job goes on exactly.
#[test]
fn the_sheet_is_found_and_the_tool_returns() {
    for script in [
        "at line 4 override 100%\nafter 0.3s hold\nafter 3s sense test\nafter 9s recover\nafter 9s resume\n",
        "at 9s sense test\nafter 9s resume\n",
    ] {
        let (run, samples) = run(script);
        run.assert_exact_and_legal();
        assert_eq!(results(&run), [("sheet_found".to_owned(), Some(SHEET_MM))], "{script}");
        let asked = times(&run, "operator", "command", "sense test")[0];
        let found = times(&run, "sense_test", "result", "sheet_found")[0];
        let on = samples.iter().filter(|sample| ((asked * 1e6) as u64..(found * 1e6) as u64).contains(&sample.at_us));
        assert!(on.clone().count() > 100 && on.clone().all(|sample| !sample.is_on("spindle")), "{script}");
        let lowest = on.map(|sample| sample.counts[2] + sample.layer).min().expect("samples");
        // The float switch travels 480 pulses.
        assert!((SHEET - 780..=SHEET).contains(&lowest), "{script}: {lowest}");
        assert_eq!(height_at(&samples, asked - 0.01), height_at(&samples, found + 5.0), "{script}");
    }
}

/// A hold ends a test anywhere on its way down; while it is on, nothing else is accepted. It needs a machine that is
/// held.
#[test]
fn a_hold_ends_a_test() {
    for after in ["0.01", "0.2", "0.7", "1.5"] {
        let script = format!(
            "at line 4 override 100%\nafter 0.3s sense test\nafter 0s hold\nafter 3s sense test\n\
             after {after}s resume\nafter 0s hold\nafter 9s recover\nafter 9s resume\n"
        );
        let (run, samples) = run(&script);
        run.assert_exact_and_legal();
        assert_eq!(results(&run), [("cancelled".to_owned(), None)], "{script}");
        let refused: Vec<&str> = run.of_kind("command_rejected").filter_map(|of| of["reason"].as_str()).collect();
        assert!(refused[0].contains("needs the machine at rest"), "{refused:?}");
        assert!(refused[1].contains("a sense test is in progress"), "{refused:?}");
        let asked = times(&run, "operator", "command", "sense test")[1];
        assert_eq!(height_at(&samples, asked - 0.01), height_at(&samples, asked + 8.0), "{script}");
        let stopped = samples.iter().filter(|sample| (sample.at_us as f64) < (asked + 8.0) * 1e6);
        assert!(stopped.map(|sample| sample.counts[2] + sample.layer).min() > Some(SHEET - 780), "{script}");
    }
}

/// Over a serial line, where reports are late: found, and ended by a hold; the job goes on, and the axis is at its path
/// at the end.
#[test]
fn a_card_on_a_line_tests_as_well() {
    for end in ["", "after 0.4s hold\n"] {
        let bench = Bench::new();
        bench.file("part.ngc", PROGRAM);
        bench.file("materials.toml", MATERIALS);
        bench.file("m.toml", format!("homed = true\n{}", machine(SENSE)));
        bench.file(
            "s.op",
            format!("at 6s hold\nafter 3s sense test\n{end}after 7s recover\nafter 5s resume\nafter 5s resume\n"),
        );
        let card = ServedCard::with(&["--machine", &bench.path("m.toml").display().to_string(), "--speed", "2"]);
        let port = card.port.clone();
        let run =
            bench.retrace(["run", "part.ngc", "--card", &port, "--machine", "m.toml", "--json", "--operator", "s.op"]);
        assert_eq!(run.code, Some(0), "{}\n{}", run.err, run.out);
        let wanted = if end.is_empty() { "sheet_found" } else { "cancelled" };
        assert!(run.out.contains(&format!("\"result\":\"{wanted}\"")), "{}", run.out);
        let status = card.identify(&bench);
        assert_eq!(status["counts"][2], 0, "{status}");
        let _ = card.end();
    }
}

/// While no program runs, by the words of a page: what is found, and that no sheet is there, is in the log; the tool is
/// back, and jogs.
#[test]
fn without_a_program_the_page_tests_as_well() {
    for (faults, said) in
        [("sheet=0", format!("the sheet is at machine Z {SHEET_MM:.3} mm")), ("sheet=-40", "no sheet".into())]
    {
        let bench = Bench::new();
        bench.file("materials.toml", MATERIALS);
        let text = format!("homed = true\n{}", machine(SENSE));
        let machine = bench.file("m.toml", text).display().to_string();
        let arguments = ["--machine", &machine, "--source-faults", faults];
        let (_server, mut page) = PageServer::in_control(&bench, PROGRAM, &arguments);
        page.wait_until("live figures", |page| !page.last("live").is_null());
        page.order_when_free("sense test");
        page.wait_until(&said, |page| page.last("log").to_string().contains(&said));
        page.wait_until("the tool back", |page| page.last("live")["at_rest"] == true && page.machine_mm(2) == 0.0);
        assert_eq!(page.order_when_free("jog x 5")["t"], "done");
        page.wait_until("the jog", |page| (page.machine_mm(0) - 5.0).abs() < 0.006);
    }
}
