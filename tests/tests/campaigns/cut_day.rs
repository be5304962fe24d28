//! A day of cutting: thousands of pierces with starts that fail, losses, chatter of the contact, and an operator who
//! says *recover* and nothing else. Everything is cut at the end, in a memory that does not grow with the day.
//!
//! Invariant: the figures come from the report and from the memory of the process.

use retrace_tests::command::{Bench, binary, cases};
use retrace_tests::served::ServedCard;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs::File;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Contours that the suite cuts; a day has 20 000.
const SUITE: u32 = 150;
/// Seconds of machine time between two *recover*.
const RECOVER_S: u32 = 20;
/// Contours in a column of the sheet, and length cut of each in mm.
const ROWS: u32 = 33;
const CUT_MM: f64 = 89.0;
/// Memory in MiB by which the process may grow from a tenth of the day on.
const GROWTH_MIB: u64 = 8;
/// Most contours over a line, in real time.
const MAX_ON_LINE: u32 = 200;

const MACHINE: &str = "history_hours = 0.01\n\
    [[axis]]\nname = \"x\"\npulses_per_mm = 160\nmax_velocity_mm_per_s = 200\nmax_acceleration_mm_per_s2 = 2500\n\
    max_jerk_mm_per_s3 = 40000\ntravel_mm = [-10, 2500]\n\
    [[axis]]\nname = \"y\"\npulses_per_mm = 160\nmax_velocity_mm_per_s = 200\nmax_acceleration_mm_per_s2 = 2500\n\
    max_jerk_mm_per_s3 = 40000\ntravel_mm = [-10, 1600]\n\
    [[cutter]]\nname = \"cutter\"\nkind = \"KIND\"\nfire = 64\nok = { input = 5 }\n\
    start = { pierce_s = 0.2, start_s = 1, retry_s = 0.5 }\n";

/// Narrow combs of two strokes, column beside column, with a subprogram and a loop.
fn program(contours: u32) -> String {
    format!(
        "G21 G90 G94 F1800 G64 P0.05\no100 sub\nG0 X#1 Y#2\nM3 S1\nG1 Y[#2+44]\nG1 X[#1+1]\nG1 Y[#2]\nM5\no100 endsub\n\
         #3 = 0\no101 while [#3 LT {contours}]\n#4 = [FIX[#3/{ROWS}]*2.5]\n#5 = [[#3 MOD {ROWS}]*46]\n\
         o100 call [#4] [#5]\n#3 = [#3+1]\no101 endwhile\nM2\n"
    )
}

/// A torch whose height is controlled by the arc voltage.
const HEIGHT: &str = "[[axis]]\nname = \"z\"\npulses_per_mm = 400\nmax_velocity_mm_per_s = 60\n\
    max_acceleration_mm_per_s2 = 600\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-100, 0]\n\
    [[card.analog_input]]\nnumber = 1\nname = \"arc voltage\"\nunit = \"V\"\nat_full = 256\n";
const SENSE: &str = "materials = \"materials.toml\"\nheight = { volts = 1 }\n\
    sense = { contacts = [7], sheet_mm = -70, float_travel_mm = 1.2 }\n";
const MATERIALS: &str = "units = \"mm\"\ndefault = 1\n[[material]]\nnumber = 1\nname = \"Steel\"\nkerf_mm = 0.5\n\
    pierce_height_mm = 3.8\npierce_delay_s = 0.2\ncut_height_mm = 1.5\nfeed_mm_per_min = 1800\nvolts = 115\n";

/// The files of a day of so many contours: program, machine file and the script of the operator.
fn files(bench: &Bench, kind: &str, contours: u32) -> [PathBuf; 3] {
    let machine = match kind {
        "height" => {
            bench.file("materials.toml", MATERIALS);
            let cutter = MACHINE.replace("KIND", "torch");
            cutter.replace("[[cutter]]", &format!("{HEIGHT}[[cutter]]")).replace("start =", &format!("{SENSE}start ="))
        }
        kind => MACHINE.replace("KIND", kind),
    };
    let contour_s = if kind == "height" { 14 } else { 9 };
    let mut script = String::new();
    for at in 1..=contours * contour_s / RECOVER_S + 60 {
        let _ = writeln!(script, "at {}s recover", at * RECOVER_S);
    }
    [("part.ngc", program(contours)), ("m.toml", machine), ("s.op", script)].map(|(name, text)| bench.file(name, text))
}

/// The faults of a source: starts that fail, losses every 50 m, and chatter; a sheet that is warped by 5 mm.
fn source_faults(kind: &str) -> String {
    let seed = std::env::var("RETRACE_FIRST_SEED").unwrap_or_else(|_| "1".into());
    format!("{FAULTS},seed={seed}{}", if kind == "height" { ",warp=5" } else { "" })
}

/// Runs the command to its end; returns what it has printed, and the largest resident set in MiB.
fn run_to_end(bench: &Bench, arguments: &[&str]) -> (String, u64) {
    let out = bench.path("out.json");
    let mut command = Command::new(binary());
    command.args(arguments).args(["--json", "--no-journal"]).env("XDG_STATE_HOME", bench.path("state"));
    command.stdin(Stdio::null()).stderr(Stdio::null()).stdout(File::create(&out).expect("a file"));
    let begun = Instant::now();
    let mut child = command.spawn().expect("the command runs");
    let (status, mut peak) = (format!("/proc/{}/status", child.id()), 0);
    while child.try_wait().expect("a child").is_none() {
        assert!(begun.elapsed() < Duration::from_secs(3 * 3600), "the day does not end");
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let high = text.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB")?.parse().ok());
        peak = peak.max(high.unwrap_or(0_u64) >> 10);
        std::thread::sleep(Duration::from_millis(5));
    }
    println!("{peak} MiB, {:.0} s", begun.elapsed().as_secs_f64());
    (std::fs::read_to_string(&out).expect("text"), peak)
}

/// The report of the day, the length in mm that was cut, and the largest resident set in MiB.
fn day(kind: &str, contours: u32) -> (Value, f64, u64) {
    let bench = Bench::new();
    let [part, machine, script] = files(&bench, kind, contours).map(|path| path.display().to_string());
    let faults = source_faults(kind);
    let arguments = ["run", &part, "--machine", &machine, "--operator", &script, "--source-faults", &faults];
    let (out, peak) = run_to_end(&bench, &arguments);
    let (report, cut_mm, counts) = figures(&out);
    println!("{kind}, {contours} contours: {counts:?}");
    (report, cut_mm, peak)
}

/// The report, the length in mm that was cut, and how often there was each event.
fn figures(out: &str) -> (Value, f64, BTreeMap<String, u64>) {
    let mut counts = BTreeMap::<String, u64>::new();
    let mut cut_mm = BTreeMap::<u64, f64>::new();
    for line in out.lines() {
        let event: Value = serde_json::from_str(line).expect("an event");
        let kind = event["event"].as_str().unwrap_or_default();
        *counts.entry(kind.to_owned()).or_default() += 1;
        if kind == "contour" {
            // One that is executed again is reported again.
            cut_mm.insert(event["number"].as_u64().expect("a number"), event["cut_mm"].as_f64().expect("a length"));
        }
    }
    let report: Value = serde_json::from_str(out.lines().last().unwrap_or_default()).expect("a report");
    (report, cut_mm.values().sum(), counts)
}

const FAULTS: &str = "no-start=0.03,lose-per-m=0.02,flicker-per-m=2,flicker-ms=5";

/// Asserts that all of a day is cut, within the limits.
fn assert_whole(report: &Value, cut_mm: f64, contours: u32) {
    println!("{report}");
    assert_eq!((report["outcome"].as_str(), report["not_cut_mm"].as_f64()), (Some("completed"), Some(0.0)));
    assert_eq!((report["contours"].as_u64(), report["limit_violations"].as_u64()), (Some(contours.into()), Some(0)));
    assert!((cut_mm / (f64::from(contours) * CUT_MM) - 1.0).abs() < 0.001, "{cut_mm} mm");
}

/// A torch, a torch with height control over a warped sheet, and a jet. The memory is that of the jet: for a torch the
/// simulated machine remembers the sheet, by which an arc strikes or not.
#[test]
fn a_day_of_cutting_is_cut_whole_in_constant_memory() {
    let contours = cases(SUITE);
    let days = ["torch", "height", "jet"].map(|kind| {
        let (report, cut_mm, peak) = day(kind, contours);
        assert_whole(&report, cut_mm, contours);
        if kind == "height" {
            // Path and layer together: the tool is where the program leaves it.
            assert_eq!(report["position_counts"]["z"], 0, "{report}");
        }
        peak
    });
    let (.., part) = day("jet", contours / 10);
    assert!(days[2] <= part + GROWTH_MIB, "{} MiB behind {part} MiB", days[2]);
}

/// A part of the day on a card behind a line that flips, loses and doubles bytes, in real time: the card is four times
/// as fast as a clock.
#[test]
fn over_a_line_with_faults_a_day_is_cut_whole() {
    let contours = (cases(SUITE) / 75).min(MAX_ON_LINE);
    let bench = Bench::new();
    let [part, _, script] = files(&bench, "height", contours);
    let machine = std::fs::read_to_string(bench.path("m.toml")).expect("text");
    bench.file("m.toml", format!("homed = true\n{machine}[card]\nwatchdog_ms = 2000\n"));
    let faults = source_faults("height");
    let mut card = vec!["--speed", "4", "--faults", "rate=1e-5,seed=7", "--source-faults", &faults];
    let m = bench.path("m.toml").display().to_string();
    card.extend(["--machine", &m]);
    let served = ServedCard::with(&card);
    let [part, script] = [part, script].map(|path| path.display().to_string());
    let (out, _) = run_to_end(&bench, &["run", &part, "--card", &served.port, "--machine", &m, "--operator", &script]);
    let (report, cut_mm, counts) = figures(&out);
    println!("over the line, {contours} contours: {counts:?}");
    assert_whole(&report, cut_mm, contours);
    assert_eq!(report["position_counts"]["z"], 0, "{report}");
}
