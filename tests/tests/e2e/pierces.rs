//! Piercing and cutting as two runs of one program (CUT-63), seen at the pins.
//!
//! Invariant: what is asserted of the torch is its output, with the counts of the axes.

use retrace_tests::command::Bench;
use retrace_tests::pins::{Sample, samples};
use retrace_tests::run::Run;
use retrace_tests::sensing_torch::{SENSE, SHEET, machine};
use serde_json::Value;

/// A line, an arc, and a contour in a rotated and shifted coordinate system.
const PROGRAM: &str = "G21 G90 G17 F1800 G64 P0.05\nG0 X10 Y10\nM3 S1\nG1 X40\nG3 X40 Y30 I0 J10\nM5\nG0 X100 Y50\n\
    M3\nG2 X100 Y50 I8 J0\nM5\nG10 L2 P1 X20 Y30 R90\nG0 X60 Y0\nM3\nG91 G1 X15\nG90\nM5\nG0 X0 Y0\nM2\n";
const MATERIALS: &str = "units = \"mm\"\ndefault = 1\n[[material]]\nnumber = 1\nname = \"Steel\"\nkerf_mm = 1.4\n\
    pierce_height_mm = 3.8\npierce_delay_s = 0.5\ncut_height_mm = 1.5\nfeed_mm_per_min = 1800\n";
/// Places of the starts in mm.
const STARTS: [[f64; 2]; 3] = [[10.0, 10.0], [100.0, 50.0], [20.0, 90.0]];

fn bench() -> Bench {
    let bench = Bench::new();
    for (name, text) in [("part.ngc", PROGRAM), ("m.toml", &*machine(SENSE)), ("materials.toml", MATERIALS)] {
        bench.file(name, text);
    }
    bench
}

fn run(mode: &str, script: &str) -> (Run, Vec<Sample>) {
    let bench = bench();
    let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
    let (operator, trace) = (bench.file("s.op", script).display().to_string(), vcd.display().to_string());
    let arguments = ["--machine", &machine, "--vcd", &trace, "--operator", &operator, "--pierces", mode];
    let run = Run::of(&bench, &bench.path("part.ngc"), &arguments);
    assert_eq!(run.report["outcome"], "completed", "{mode}: {}", run.output.err);
    (run, samples(&vcd))
}

fn place(sample: &Sample) -> [f64; 2] {
    [sample.counts[0] as f64 / 200.0, sample.counts[1] as f64 / 200.0]
}

/// Places at which the torch was switched on, and seconds from there until it was switched off.
fn fires(trace: &[Sample]) -> Vec<([f64; 2], f64)> {
    let mut fires = Vec::new();
    let mut since = None;
    for pair in trace.windows(2) {
        match (pair[0].is_on("spindle"), pair[1].is_on("spindle")) {
            (false, true) => since = Some((place(&pair[1]), pair[1].at_us)),
            (true, false) => {
                let (at, from_us) = since.take().expect("it was on");
                fires.push((at, (pair[1].at_us - from_us) as f64 / 1e6));
            }
            _ => {}
        }
    }
    fires
}

/// One run pierces each start, beside it by the offset, and cuts nothing; the other cuts the same path as a usual run,
/// without the time and height of the pierces.
#[test]
fn a_program_is_pierced_and_cut_in_two_runs() {
    let (usual, usual_trace) = run("usual", "");
    for (mode, offset) in [("only", [0.0, 0.0]), ("only:1.5,-2", [1.5, -2.0])] {
        let (run, trace) = run(mode, "");
        run.assert_exact_and_legal();
        let fires = fires(&trace);
        let places: Vec<[f64; 2]> = fires.iter().map(|(at, _)| *at).collect();
        // The third contour is in a system that is turned by 90 degrees: so is the offset.
        let turned = [offset, offset, [-offset[1], offset[0]]];
        let expected: Vec<[f64; 2]> =
            STARTS.iter().zip(turned).map(|(start, by)| [start[0] + by[0], start[1] + by[1]]).collect();
        let is_there =
            |(at, wanted): (&[f64; 2], &[f64; 2])| (0..2).all(|axis| (at[axis] - wanted[axis]).abs() < 0.004);
        assert!(places.iter().zip(&expected).all(is_there) && places.len() == 3, "{mode}: {places:?}");
        assert!(fires.iter().all(|(_, lit_s)| (0.5..0.8).contains(lit_s)), "{mode}: {fires:?}");
        let moved = trace.windows(2).filter(|pair| pair.iter().all(|of| of.is_on("spindle")));
        assert!(moved.clone().count() > 100 && moved.clone().all(|pair| place(&pair[0]) == place(&pair[1])), "{mode}");
        // The pierce height, and no deeper.
        let lowest = moved.map(|pair| pair[1].counts[2] + pair[1].layer).min().expect("lit");
        assert!(lowest >= SHEET + 599, "{mode}: {lowest}");
        assert_eq!((&run.report["contours"], &run.report["not_cut_mm"]), (&3.into(), &0.0.into()), "{mode}");
        assert_eq!(trace.last().map(|sample| sample.counts[2] + sample.layer), Some(0));
    }
    let (done, trace) = run("done", "");
    done.assert_exact_and_legal();
    assert_eq!(done.report["position_counts"], usual.report["position_counts"]);
    let cut = |trace: &[Sample]| -> Vec<[f64; 2]> {
        let lit = trace.windows(2).filter(|pair| pair.iter().all(|of| of.is_on("spindle")));
        lit.map(|pair| place(&pair[1])).collect::<Vec<_>>()
    };
    let ends = |mut path: Vec<[f64; 2]>| {
        path.dedup();
        path
    };
    assert_eq!(ends(cut(&trace)), ends(cut(&usual_trace)), "the same path");
    let highest = |trace: &[Sample]| {
        let lit = trace.windows(2).filter(|pair| pair.iter().all(|of| of.is_on("spindle")));
        lit.map(|pair| pair[1].counts[2] + pair[1].layer).max()
    };
    assert!(highest(&usual_trace) > Some(SHEET + 1500) && highest(&trace) <= Some(SHEET + 601));
    let [with, without] = [&usual, &done].map(|run| run.report["lit_s"].as_f64().expect("a time"));
    assert!((1.5..2.2).contains(&(with - without)), "{with} s, {without} s");
}

/// A resumed job goes on in its mode; what is no mode is refused.
#[test]
fn a_resumed_job_keeps_its_mode() {
    let bench = bench();
    bench.file("s.op", "at line 8 stop\n");
    let arguments =
        ["run", "part.ngc", "--machine", "m.toml", "--operator", "s.op", "--json", "--pierces", "only:0.5,0"];
    assert_eq!(bench.retrace(arguments).code, Some(4));
    let resumed = bench.retrace(["resume", "--yes", "--json"]);
    assert_eq!(resumed.code, Some(0), "{}", resumed.err);
    let report: Value = serde_json::from_str(resumed.out.lines().last().unwrap_or_default()).expect("a report");
    assert_eq!(report["outcome"], "completed");
    assert!(report["lit_s"].as_f64().expect("a time") < 2.5, "{report}");
    let refused = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--pierces", "only:1"]);
    assert!(refused.code == Some(2) && refused.err.contains("only:1.5,-1.5"), "{}", refused.err);
}
