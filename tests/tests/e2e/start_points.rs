//! A job that begins in the middle of its program, at a line or at a contour (CUT-47), and is resumed.

use retrace_tests::command::{Bench, assert_contains};
use retrace_tests::cut_judge::{JudgedMachine, judge};
use retrace_tests::pins::{Sample, samples};
use retrace_tests::run::Run;

/// Three contours: one of straight moves, one in a subprogram with an arc, one under cutter compensation.
const PROGRAM: &str = "G21 G90 F1800\nO100 sub\nG0 X40 Y5\nM3\nG1 X60\nG3 X60 Y25 I0 J10\nM5\nO100 endsub\nG0 X10\nM3\n\
    G1 X30\nY10\nM5\nO100 call\nG0 X80 Y10\nM3\nG41.1 D2\nG1 X90\nX110\nY40\nG40\nG1 X120\nM5\nG0 X0 Y0\nM2\n";
/// Of the lines that light the torch: in the program, in the subprogram, in the program.
const CONTOURS: u32 = 3;

fn machine() -> String {
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 100\n\
             max_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-50, 500]\n"
        )
    };
    format!(
        "{}{}{}[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nok = {{ input = 5 }}\n\
         start = {{ pierce_s = 0.3 }}\n",
        axis("x"),
        axis("y"),
        axis("z")
    )
}

fn bench() -> Bench {
    let bench = Bench::new();
    bench.file("m.toml", machine());
    bench.file("part.ngc", PROGRAM);
    bench
}

fn run(more: &[&str]) -> (Run, Vec<Sample>) {
    let bench = bench();
    let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
    let trace = vcd.display().to_string();
    let arguments = [&["--machine", &machine, "--vcd", &trace], more].concat();
    (Run::of(&bench, &bench.path("part.ngc"), &arguments), samples(&vcd))
}

/// Places of each cut, one after the other: every contour, as the pins have it.
fn cuts(trace: &[Sample]) -> Vec<Vec<[i64; 3]>> {
    let mut cuts: Vec<Vec<[i64; 3]>> = Vec::new();
    for pair in trace.windows(2) {
        match (pair[0].is_on("spindle"), pair[1].is_on("spindle")) {
            (false, true) => cuts.push(Vec::new()),
            (true, true) => {}
            _ => continue,
        }
        let counts = [0, 1, 2].map(|axis| pair[1].counts[axis]);
        if let Some(cut) = cuts.last_mut().filter(|cut| cut.last() != Some(&counts)) {
            cut.push(counts);
        }
    }
    cuts
}

/// From each contour on, the same contours are cut along the same places, with their pierces; before the first there
/// are rapid moves only.
#[test]
fn a_job_begins_at_any_contour() {
    let (whole, trace) = run(&[]);
    whole.assert_exact_and_legal();
    let all = cuts(&trace);
    assert_eq!(all.len(), CONTOURS as usize);
    for number in 1..=CONTOURS {
        let (job, trace) = run(&["--contour", &number.to_string()]);
        assert_eq!((&job.report["outcome"], job.counts()), (&"completed".into(), whole.counts()), "{number}");
        assert_eq!(job.report["limit_violations"], 0);
        assert_eq!(job.report["not_cut_mm"], 0.0);
        let cuts = cuts(&trace);
        let rest = &all[number as usize - 1..];
        assert_eq!(cuts.len(), rest.len(), "{number}");
        for (cut, same) in cuts.iter().zip(rest) {
            assert_eq!((cut.first(), cut.last()), (same.first(), same.last()), "{number}");
        }
        // pierced at rest: the first motion with the torch on comes at least its delay behind the start
        let lit = trace.iter().find(|sample| sample.is_on("spindle")).expect("it is lit");
        let moves = trace.windows(2).find(|pair| pair[1].is_on("spindle") && pair[0].counts != pair[1].counts);
        assert!(moves.is_some_and(|pair| pair[1].at_us - lit.at_us >= 300_000), "{number}");
    }
}

/// Fifty contours in a subprogram, every second one compensated, and a program stop behind the last.
const FIFTY: &str = "G21 G90 F1800\nO100 sub\nG0 X[#1] Y[#2]\nO101 if [#3 EQ 1]\nG41.1 D1\nO101 endif\nM3\n\
    G1 X[#1 + 8]\nG3 X[#1 + 8] Y[#2 + 6] I0 J3\nG1 X[#1]\nM5\nG40\nO100 endsub\n#10 = 0\nO102 while [#10 LT 50]\n\
    O100 call [#10 MOD 5 * 20 + 10] [FIX[#10 / 5] * 12] [#10 MOD 2]\n#10 = [#10 + 1]\nO102 endwhile\n\
    G0 X0 Y0\nM0\nM2\n";
/// Behind the last contour: the way to the program stop, at which the operator has time for it.
const AT_THE_STOP: &str = "at line 19 override 100%\nafter 30s ";

/// Each contour of a job of 50 (CUT-45, CUT-47), with the history gone, as the place where a job begins; and with the
/// history kept, as one that was lost and skipped and is cut once the program has come to its end. A slice of them;
/// all with `RETRACE_CASES=50`.
#[test]
fn each_contour_of_a_job_of_fifty_can_be_begun_at_and_gone_back_to() {
    let cases: u32 = std::env::var("RETRACE_CASES").ok().and_then(|cases| cases.parse().ok()).unwrap_or(4);
    let run = |faults: &str, script: &str, more: &[&str]| {
        let bench = bench();
        let (program, vcd) = (bench.file("fifty.ngc", FIFTY), bench.path("pins.vcd"));
        let script = bench.file("s.op", format!("{script}cycle start\n"));
        let [machine, trace, script] = [&bench.path("m.toml"), &vcd, &script].map(|path| path.display().to_string());
        let usual = ["--machine", &machine, "--vcd", &trace, "--operator", &script, "--source-faults", faults];
        let run = Run::of(&bench, &program, &[&usual[..], more].concat());
        (run, vcd, bench)
    };
    let (whole, uninterrupted, _bench) = run("", AT_THE_STOP, &[]);
    assert_eq!((&whole.report["outcome"], &whole.report["contours"]), (&"completed".into(), &50.into()));
    let whole_trace = samples(&uninterrupted);
    let all = cuts(&whole_trace);
    for case in 0..cases {
        let number = 1 + (case * 37 + 11) % 50;
        let (job, trace, _bench) = run("", AT_THE_STOP, &["--contour", &number.to_string()]);
        assert_eq!((&job.report["outcome"], job.counts()), (&"completed".into(), whole.counts()), "{number}");
        let cut = cuts(&samples(&trace));
        assert_eq!(cut.len(), all.len() - number as usize + 1, "{number}");
        for (cut, same) in cut.iter().zip(&all[number as usize - 1..]) {
            assert_eq!((cut.first(), cut.last()), (same.first(), same.last()), "{number}");
        }

        // lost in its middle, where the trace of the whole job says when that is
        let (before, contour) = (&all[..number as usize - 1], &all[number as usize - 1]);
        let lost_mm = before.iter().map(|cut| length_mm(cut)).sum::<f64>() + length_mm(contour) / 2.0;
        let middle = &contour[contour.len() / 2];
        let lost =
            whole_trace.iter().find(|now| now.is_on("spindle") && [0, 1, 2].map(|axis| now.counts[axis]) == *middle);
        let lost_s = lost.expect("the middle").at_us as f64 / 1e6;
        let skip_s = lost_s + 2.0;
        let cut = format!("back to contour {number}\nafter 200s cut\nafter 200s ");
        let script = format!("at {skip_s}s skip contour\n{AT_THE_STOP}{cut}");
        let (job, trace, _bench) = run(&format!("lose@{lost_mm:.2}"), &script, &[]);
        assert_eq!((&job.report["outcome"], job.counts()), (&"completed".into(), whole.counts()), "{number}");
        assert!(
            job.number("not_cut_mm") <= 0.1 && job.report["contours"] == 50,
            "{number}: {} {}",
            job.report,
            job.output.out
        );
        let verdict = judge(&uninterrupted, &trace, &JUDGED);
        assert!(verdict.is_good() && verdict.ignitions == 51, "{number}: {verdict:?}");
    }
}

const JUDGED: JudgedMachine = JudgedMachine {
    pulses_per_mm: 200.0,
    fire: "spindle",
    input: 5,
    pierce_ms: 300.0,
    pilot_ms: 298.0,
    has_lead_ins: false,
};

fn length_mm(cut: &[[i64; 3]]) -> f64 {
    let step = |pair: &[[i64; 3]]| ((pair[1][0] - pair[0][0]) as f64).hypot((pair[1][1] - pair[0][1]) as f64) / 200.0;
    cut.windows(2).map(step).sum()
}

/// Stopped in a cut, in a rapid and in a pierce, a job that began within its program is resumed where it was left.
#[test]
fn a_job_that_began_within_its_program_is_resumed() {
    for (start, end_s) in [("--contour", 1.2), ("--contour", 2.4), ("--start-line", 0.4), ("--start-line", 2.0)] {
        let (bench, case) = (bench(), format!("{start}, stopped after {end_s} s"));
        let machine = bench.path("m.toml").display().to_string();
        let stop = bench.file("stop.op", format!("at {end_s}s stop\n")).display().to_string();
        let number = if start == "--contour" { "2" } else { "19" };
        let arguments = ["run", "part.ngc", "--machine", &machine, "--json", start, number];
        let whole = bench.retrace([&arguments[..], &["--no-journal"]].concat());
        let stopped = bench.retrace([&arguments[..], &["--operator", &stop]].concat());
        assert_eq!(stopped.code, Some(4), "{case}: {}", stopped.err);
        let resumed = bench.retrace(["resume", "--yes", "--json"]);
        assert_eq!(resumed.code, Some(0), "{case}: {}{}", resumed.out, resumed.err);
        let report = |text: &str| -> serde_json::Value {
            serde_json::from_str(text.lines().last().unwrap_or_default()).expect("a report")
        };
        let [whole, resumed] = [report(&whole.out), report(&resumed.out)];
        assert_eq!(resumed["position_counts"], whole["position_counts"], "{case}");
        assert_eq!((&resumed["outcome"], &resumed["limit_violations"]), (&"completed".into(), &0.into()), "{case}");
    }
}

#[test]
fn a_contour_that_does_not_exist_is_refused_before_anything_moves() {
    let bench = bench();
    let beyond = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--contour", "4"]);
    assert_eq!(beyond.code, Some(2), "{}", beyond.err);
    assert_contains(&beyond.err, &["E2151", "has 3 contours", "retrace check"]);
    // a beam is lit within the step of a move
    bench.file("laser.toml", machine().replace("kind = \"torch\"", "kind = \"beam\""));
    let beam = bench.retrace(["run", "part.ngc", "--machine", "laser.toml", "--contour", "1"]);
    assert_eq!(beam.code, Some(2), "{}", beam.err);
    assert_contains(&beam.err, &["E2151", "--start-line"]);
    for both in [["--contour", "1", "--start-line", "3"], ["--contour", "0", "--seed", "1"]] {
        assert_eq!(bench.retrace([&["run", "part.ngc", "--machine", "m.toml"][..], &both].concat()).code, Some(2));
    }
}
