//! The cut cycle at random: starts that fail with a probability, losses at any place, jets with any delay, lag and
//! purge (CUT-13, CUT-19, CUT-30), each judged by the trace of the pins.
//!
//! Invariant: every figure comes from the pins; what the command reports is compared with it.

use retrace_tests::command::{Bench, cases};
use retrace_tests::pins::{Sample, samples};
use retrace_tests::run::Run;
use retrace_tests::sender::TestRandom;

/// Pulses per mm of every axis.
const PULSES: f64 = 200.0;
/// Input that proves the cutter.
const OK: u64 = 1 << 5;
/// Attempts at starting, and pierce delay in s.
const STARTS: usize = 3;
const PIERCE_S: f64 = 0.2;

fn machine(cutter: &str) -> String {
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = {PULSES}\nmax_velocity_mm_per_s = 200\n\
             max_acceleration_mm_per_s2 = 2500\nmax_jerk_mm_per_s3 = 40000\ntravel_mm = [-100, 500]\n"
        )
    };
    format!("{}{}[[cutter]]\n{cutter}", axis("x"), axis("y"))
}

const TORCH: &str = "name = \"torch\"\nkind = \"torch\"\nfire = 64\nok = { input = 5 }\n\
    start = { start_s = 0.3, retry_s = 0.1, pierce_s = 0.2 }\n";

const MATERIAL: &str = "units = \"mm\"\ndefault = 1\n[[material]]\nnumber = 1\nkerf_mm = 1\npierce_height_mm = 4\n\
    pierce_delay_s = 0.2\ncut_height_mm = 1.5\nfeed_mm_per_min = 3000\n";

fn first_seed() -> u64 {
    std::env::var("RETRACE_FIRST_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(1)
}

/// Runs a program on this machine with these faults of its source, in one folder for all jobs.
fn run(bench: &Bench, (machine, program): (&str, &str), faults: &str) -> (Run, Vec<Sample>) {
    bench.file("m.toml", machine);
    let (part, vcd, machine) = (bench.file("part.ngc", program), bench.path("pins.vcd"), bench.path("m.toml"));
    let [machine, trace] = [&machine, &vcd].map(|path| path.display().to_string());
    let run =
        Run::of(bench, &part, &["--machine", &machine, "--vcd", &trace, "--source-faults", faults, "--no-journal"]);
    (run, samples(&vcd))
}

fn seconds(from: &Sample, to: &Sample) -> f64 {
    (to.at_us - from.at_us) as f64 / 1e6
}

/// Kinds of pierce: keys of the material, and the time from the proof to the first motion. One in motion begins with
/// the proof.
const KINDS: [(&str, f64); 5] = [
    ("", PIERCE_S),
    ("pierce_mm = 1\npierce_feed_mm_per_min = 900\n", PIERCE_S),
    ("wiggle_mm = 0.5\nwiggles = 2\npierce_feed_mm_per_min = 900\n", PIERCE_S),
    ("circle_mm = 0.5\ncircles = 1\npierce_feed_mm_per_min = 900\n", PIERCE_S),
    ("pierces_in_motion = true\npierce_mm = 1\npierce_feed_mm_per_min = 900\ncreep_mm = 1\n", 0.0),
];

/// Attempts of each start, and whether it began to cut. A start ends where the machine moves along a cut, or where it
/// is not repeated within a second.
///
/// # Panics
/// Where the feed began too early: without the proof, or before the pierce was complete.
fn starts(trace: &[Sample], pierce_s: f64) -> Vec<(usize, bool)> {
    let mut starts: Vec<(usize, bool)> = Vec::new();
    let (mut lit_at, mut off_at, mut proven_at): (Option<&Sample>, Option<&Sample>, Option<&Sample>) =
        (None, None, None);
    let dark = Sample::default();
    for (before, now) in std::iter::once(&dark).chain(trace).zip(trace) {
        let (was_lit, is_lit) = (before.is_on("spindle"), now.is_on("spindle"));
        if is_lit && !was_lit {
            let is_repeated = off_at.is_some_and(|off| seconds(off, now) < 1.0);
            match starts.last_mut().filter(|start| !start.1 && is_repeated) {
                Some(start) => start.0 += 1,
                None => starts.push((1, false)),
            }
            (lit_at, proven_at) = (Some(now), None);
        }
        if was_lit && !is_lit {
            off_at = Some(now);
        }
        proven_at = proven_at.filter(|_| now.inputs & OK != 0).or((now.inputs & OK != 0 && is_lit).then_some(now));
        if is_lit && before.counts != now.counts {
            let start = starts.last_mut().expect("it is lit");
            if !start.1 {
                let proven = proven_at.unwrap_or_else(|| panic!("fed without a proof: {now:?}"));
                assert!(seconds(proven, now) >= pierce_s, "fed {} s behind the proof", seconds(proven, now));
                assert!(pierce_s > 0.0 || seconds(proven, now) < PIERCE_S, "in motion: {} s", seconds(proven, now));
                assert!(lit_at.is_some_and(|lit| seconds(lit, now) >= pierce_s), "{now:?}");
            }
            start.1 = true;
        }
    }
    starts
}

/// At most three attempts; a start fails with the cube of the probability of an attempt, within three standard
/// deviations; no feed before the start is complete, and none behind one that failed.
#[test]
fn starts_are_repeated_three_times_and_nothing_is_fed_before() {
    let contours: String = (0..10).map(|n| format!("G0 X{} Y{}\nM3\nG1 X{}\nM5\n", 10 * n, n, 10 * n + 3)).collect();
    let program = format!("G21 G90 F3000\n{contours}G0 X0 Y0\nM2\n");
    let (bench, machine) = (Bench::new(), machine(&format!("{TORCH}materials = \"materials.toml\"\nspindle = 0\n")));
    let wanted = cases(40) as usize;
    for (at, p) in [0.0, 0.1, 0.5, 1.0].into_iter().enumerate() {
        let (mut began, mut failed, mut most, mut seed) = (0, 0, 0, first_seed() + 1_000_000 * at as u64);
        while began < wanted.div_ceil(4) {
            seed += 1;
            let (figures, pierce_s) = KINDS[seed as usize % KINDS.len()];
            bench.file("materials.toml", format!("{MATERIAL}{figures}"));
            let (run, trace) = run(&bench, (&machine, &program), &format!("no-start={p},seed={seed}"));
            let all = starts(&trace, pierce_s);
            let lost = all.iter().filter(|(_, cuts)| !cuts).count();
            let ends = if lost == 0 { "completed" } else { "stopped" };
            assert_eq!(run.report["outcome"], ends, "p = {p}, seed {seed}: {all:?} {}", run.output.err);
            assert!(lost <= 1 && all.iter().all(|&(attempts, cuts)| attempts == STARTS || cuts), "{seed}: {all:?}");
            most = most.max(all.iter().map(|start| start.0).max().unwrap_or(0));
            (began, failed) = (began + all.len(), failed + lost);
        }
        let (n, cube) = (began as f64, p * p * p);
        let deviation = (n * cube * (1.0 - cube)).sqrt();
        println!(
            "p = {p}: {began} starts, {failed} without an arc ({:.1} expected), {most} attempts at most",
            n * cube
        );
        assert!(most <= STARTS && (failed as f64 - n * cube).abs() <= 3.0 * deviation + 1e-9, "p = {p}");
    }
}

/// The place of a loss that is told is that at which the input first was inactive, within a record.
#[test]
fn a_loss_is_told_where_it_happened() {
    let (bench, machine) = (Bench::new(), machine(TORCH));
    let program = "G21 G90 F3000 G64 P0.05\nG0 X5 Y5\nM3\nG1 X35\nG3 X35 Y25 I0 J10\nG1 X5\nY8\nM5\nG0 X0 Y0\nM2\n";
    let mut worst = 0.0_f64;
    for case in 0..u64::from(cases(12)) {
        let mut chance = TestRandom::new(first_seed() + case);
        let at_mm = chance.below(105_000) as f64 / 1000.0;
        let (run, trace) = run(&bench, (&machine, program), &format!("lose@{at_mm}"));
        assert!(run.of_kind("cutter_off").any(|event| event["reason"] == "lost"), "{at_mm} mm: {}", run.output.out);
        let told = run.of_kind("cut_end").next().unwrap_or_else(|| panic!("{at_mm} mm: {}", run.output.out));
        let number = |key: &str| told[key].as_f64().unwrap_or_else(|| panic!("{key}: {told}"));
        let place = number("cut_record") + number("cut_fraction") / 4_294_967_296.0;
        let first = trace.windows(2).find(|pair| {
            let cuts = pair[0].is_on("spindle") && pair[0].inputs & OK != 0 && pair[0].line > 3;
            cuts && pair[1].inputs & OK == 0
        });
        let first = first.unwrap_or_else(|| panic!("{at_mm} mm: the input stays active"))[1].place;
        worst = worst.max((place - first).abs());
        assert!((place - first).abs() <= 1.0, "{at_mm} mm: told at {place}, lost at {first}");
        assert_eq!(run.report["limit_violations"], 0);
    }
    println!("the greatest difference is {worst:.2} records");
}

/// Water, then abrasive, then the pierce; the abrasive off before the end by its lag, then water alone.
#[test]
fn the_abrasive_follows_the_water_and_ends_before_it() {
    let bench = Bench::new();
    bench.file(
        "materials.toml",
        "units = \"mm\"\ndefault = 1\n[[material]]\nnumber = 1\nname = \"Steel\"\nkerf_mm = 1\npierce_height_mm = 3\n\
         pierce_delay_s = 0.2\ncut_height_mm = 3\nfeed_mm_per_min = 1800\n",
    );
    let program = "G21 G90 F1800\nG0 X10\nM3\nG1 X40\nG3 X40 Y20 I0 J10\nM5\nG0 X0 Y0\nM2\n";
    let length_mm = 30.0 + 10.0 * std::f64::consts::PI;
    for case in 0..u64::from(cases(6)) {
        let mut chance = TestRandom::new(first_seed() + case);
        let [delay_s, purge_s] = [0; 2].map(|_| chance.below(80) as f64 / 100.0);
        let lag_mm = chance.below(700) as f64 / 10.0;
        let jet = format!(
            "name = \"jet\"\nkind = \"jet\"\nfire = 3\nabrasive = 4\nspindle = 0\nmaterials = \"materials.toml\"\n\
             ok = {{ input = 5 }}\njet = {{ abrasive_delay_s = {delay_s}, abrasive_lag_mm = {lag_mm}, \
             purge_s = {purge_s} }}\n"
        );
        let (run, trace) = run(&bench, (&machine(&jet), program), "");
        let told = format!("seed {}: {jet}", first_seed() + case);
        run.assert_exact_and_legal();
        let (water, abrasive) = (|sample: &Sample| sample.is_on("out3"), |sample: &Sample| sample.is_on("out4"));
        assert!(trace.iter().all(|sample| water(sample) || !abrasive(sample)), "{told}: abrasive without water");
        let of = |wanted: &dyn Fn(&Sample) -> bool| trace.iter().position(wanted).expect("it comes");
        let (opened, fed) = (of(&water), of(&abrasive));
        let moved =
            opened + trace[opened..].windows(2).position(|pair| pair[0].counts != pair[1].counts).expect("it cuts");
        assert!(seconds(&trace[opened], &trace[fed]) >= delay_s, "{told}");
        let pierce_s = seconds(&trace[fed], &trace[moved + 1]);
        assert!((PIERCE_S..PIERCE_S + 0.15).contains(&pierce_s), "{told}: the pierce takes {pierce_s} s");
        let last = moved + 1 + trace[moved + 1..].iter().position(|sample| !water(sample)).expect("it closes");
        let off = moved + 1 + trace[moved + 1..].iter().position(|sample| !abrasive(sample)).expect("it closes");
        let rest = trace[..last].windows(2).rposition(|pair| pair[0].counts != pair[1].counts).expect("it cuts");
        let purged_s = seconds(&trace[rest + 1], &trace[last]);
        assert!((purge_s..purge_s + 0.15).contains(&purged_s), "{told}: {purged_s} s of water");
        let way = |to: usize| -> f64 {
            let step = |pair: &[Sample]| {
                let [x, y] = [0, 1].map(|axis| (pair[1].counts[axis] - pair[0].counts[axis]) as f64 / PULSES);
                x.hypot(y)
            };
            trace[moved..=to].windows(2).map(step).sum()
        };
        let lag = if lag_mm < length_mm { lag_mm } else { 0.0 };
        assert!((way(rest + 1) - way(off) - lag).abs() < 0.3, "{told}: off {} mm before", way(rest + 1) - way(off));
    }
}
