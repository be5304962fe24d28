//! Starts that are shifted to a place near the soft limits (CUT-37): each is refused exactly where it is beyond them,
//! before anything moves, and the part is whole behind one that is not.

use retrace_tests::command::{Bench, cases};
use retrace_tests::cut_judge::{JudgedMachine, judge};
use retrace_tests::run::Run;
use retrace_tests::sender::TestRandom;
use std::fmt::Write;

const PULSES: f64 = 200.0;
/// Offsets that a job draws: those beyond the limits are tried one after the other, and then the last one, which is
/// inside of them.
const OFFSETS: u32 = 20;
/// The cut is 60 mm from X10 to X70 at Y0, and lost at X30.
const PROGRAM: &str = "G21 G90 F1800\nG0 X10\nM3\nG1 X70\nM5\nG0 X0\nM2\n";
const JUDGED: JudgedMachine = JudgedMachine {
    pulses_per_mm: PULSES,
    fire: "spindle",
    input: 5,
    pierce_ms: 200.0,
    pilot_ms: 298.0,
    has_lead_ins: true,
};

/// A machine with these lower and upper limits of X and Y, in pulses.
fn machine(limits: [[i64; 2]; 2]) -> String {
    let axis = |name: &str, [low, high]: [i64; 2]| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = {PULSES}\nmax_velocity_mm_per_s = 200\n\
             max_acceleration_mm_per_s2 = 2500\nmax_jerk_mm_per_s3 = 40000\ntravel_mm = [{}, {}]\n",
            low as f64 / PULSES,
            high as f64 / PULSES
        )
    };
    format!(
        "{}{}[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nok = {{ input = 5 }}\n\
         start = {{ start_s = 0.3, retry_s = 0.1, pierce_s = 0.2 }}\n",
        axis("x", limits[0]),
        axis("y", limits[1])
    )
}

#[test]
fn a_shift_is_refused_exactly_where_it_is_beyond_the_soft_limits() {
    let first: u64 = std::env::var("RETRACE_FIRST_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(1);
    let jobs = cases(3 * OFFSETS) / OFFSETS;
    let bench = Bench::new();
    let (mut refused, mut accepted) = (0, 0);
    for seed in (first..).take(jobs as usize) {
        let mut chance = TestRandom::new(seed);
        // Y is limited near the path, or X behind the end of the cut
        let near = 100 + chance.below(1800) as i64;
        let limits = [[-1000, 16_000], if chance.below(2) == 0 { [-near, 40_000] } else { [-40_000, near] }];
        let sign = if limits[1][0] == -near { -1 } else { 1 };
        let mut script = String::from("at 3s back to cut end\n");
        let mut beyond = 0;
        for offset in 0..OFFSETS {
            let is_last = offset == OFFSETS - 1;
            let y = sign * (near + if is_last { -(chance.below(9) as i64) } else { chance.below(12) as i64 - 3 });
            // within half a pulse of a count, so that rounding is part of it
            let y_mm = (y as f64 + (chance.below(9) as f64 - 4.0) / 10.0) / PULSES;
            let x_mm = chance.below(400) as f64 / 100.0 - 2.0;
            let is_beyond = !(limits[1][0]..=limits[1][1]).contains(&((y_mm * PULSES).round() as i64));
            if !is_beyond && !is_last {
                continue;
            }
            let _ = writeln!(
                script,
                "after {}s shift {x_mm:.4} {y_mm:.4}\nafter 0.05s cut",
                if beyond == 0 { 3.0 } else { 0.05 }
            );
            beyond += u32::from(is_beyond);
        }
        let (machine, part) = (bench.file("m.toml", machine(limits)), bench.file("part.ngc", PROGRAM));
        let operator = bench.file("s.op", &script).display().to_string();
        let [machine, whole, vcd] =
            [machine, bench.path("whole.vcd"), bench.path("pins.vcd")].map(|path| path.display().to_string());
        let usual = ["--machine", &machine, "--no-journal"];
        let _ = Run::of(&bench, &part, &[&usual[..], &["--vcd", &whole]].concat());
        let more = ["--vcd", &vcd, "--source-faults", "lose@20", "--operator", &operator];
        let run = Run::of(&bench, &part, &[&usual[..], &more].concat());
        let told = format!("seed {seed}, {limits:?}\n{script}{}{}", run.output.out, run.output.err);
        let reasons: Vec<&str> = run.of_kind("command_rejected").filter_map(|event| event["reason"].as_str()).collect();
        assert_eq!(reasons.len(), beyond as usize, "{told}");
        assert!(reasons.iter().all(|reason| reason.contains("axis Y would go beyond its soft limit")), "{told}");
        assert_eq!(run.report["outcome"], "completed", "{told}");
        assert_eq!(run.report["limit_violations"], 0, "{told}");
        let verdict = judge(&whole, &vcd, &JUDGED);
        assert!(verdict.is_good(), "{verdict:?} {told}");
        (refused, accepted) = (refused + beyond, accepted + 1);
    }
    println!("{refused} offsets beyond the limits refused, {accepted} inside of them accepted");
}
