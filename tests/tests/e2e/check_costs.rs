//! What `retrace check` calculates of abrasive, starts and cost (CUT-60), compared with the pins of a run.
//!
//! Invariant: a figure is compared with the trace of the run of the same program.

use retrace_tests::command::{Bench, assert_contains};
use retrace_tests::pins::{Sample, samples};
use retrace_tests::run::Run;
use retrace_tests::sender::TestRandom;
use serde_json::{Value, json};

/// A jet with abrasive and pressure, and a torch, on X and Y; `jet` and `end` are further keys.
fn machine(jet: &str, end: &str) -> String {
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 100\n\
             max_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-500, 500]\n"
        )
    };
    format!(
        "homed = true\n{}{}[[cutter]]\nname = \"jet\"\nkind = \"jet\"\nfire = 3\nabrasive = 4\npressure = 6\n\
         spindle = 0\nmaterials = \"materials.toml\"\nok = {{ input = 5 }}\n{jet}\n\
         [[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 2\nspindle = 1\n{end}\n",
        axis("x"),
        axis("y")
    )
}

const MATERIALS: &str = "units = \"mm\"\ndefault = 1\n\
    [[material]]\nnumber = 1\npierce_height_mm = 3\npierce_delay_s = 0.5\ncut_height_mm = 3\nfeed_mm_per_min = 1800\n\
    abrasive_g_per_min = 300\n\
    [[material]]\nnumber = 2\npierce_height_mm = 3\npierce_delay_s = 1\ncut_height_mm = 3\nfeed_mm_per_min = 1200\n\
    low_pressure_pierce = true\nabrasive_g_per_min = 450\n";

/// Two cuts of the jet with a corner in blending, one of another material, and one of the torch.
const PROGRAM: &str = "G21 G90 G64 P0.05 F1800\nG0 X10\nM3\nG1 X70\nG1 Y30\nM5\nG0 X100\nM3\nG2 X140 I20\nM5\n\
    M190 P2\nF1200\nG0 X200\nM3\nG1 X260\nM5\nG0 X10 Y0\nM3 $1\nG1 X20\nM5 $1\nG0 X0\nM2\n";

fn bench(machine: &str, materials: &str, program: &str) -> Bench {
    let bench = Bench::new();
    for (name, text) in [("m.toml", machine), ("materials.toml", materials), ("p.ngc", program)] {
        bench.file(name, text);
    }
    bench
}

fn check(bench: &Bench) -> Value {
    let result = bench.retrace(["check", "p.ngc", "--machine", "m.toml", "--json"]);
    assert_eq!((result.code, result.err.as_str()), (Some(0), ""), "{}", result.out);
    serde_json::from_str(result.out.lines().next_back().unwrap_or_default()).expect("a report")
}

fn run(bench: &Bench) -> (Run, Vec<Sample>) {
    let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
    let trace = vcd.display().to_string();
    let run = Run::of(bench, &bench.path("p.ngc"), &["--machine", &machine, "--vcd", &trace]);
    assert_eq!(run.report["outcome"], "completed", "{}", run.output.err);
    (run, samples(&vcd))
}

fn number(of: &Value, key: &str) -> f64 {
    of[key].as_f64().unwrap_or_else(|| panic!("{key} of {of}"))
}

/// Times in s for which an output was on, one for each time that it was switched on.
fn times_on(trace: &[Sample], output: &str) -> Vec<f64> {
    let (mut times, mut since) = (Vec::new(), None);
    for sample in trace {
        match (sample.is_on(output), since) {
            (true, None) => since = Some(sample.at_us),
            (false, Some(from)) => {
                times.push((sample.at_us - from) as f64 / 1e6);
                since = None;
            }
            _ => {}
        }
    }
    times
}

/// Abrasive that follows the water or leads it, and ends in passing: time and mass are those of the trace.
#[test]
fn abrasive_starts_and_time_are_those_of_the_run() {
    let mut chance = TestRandom::new(60);
    for leads in [false, true, false, true] {
        let [flow_s, purge_s] = [0; 2].map(|_| chance.below(50) as f64 / 100.0);
        let (lag_mm, key) =
            (chance.below(200) as f64 / 10.0, if leads { "abrasive_lead_s" } else { "abrasive_delay_s" });
        let jet = format!(
            "jet = {{ {key} = {flow_s}, abrasive_lag_mm = {lag_mm}, purge_s = {purge_s}, pressure_input = 8 }}"
        );
        let bench = bench(&machine(&jet, ""), MATERIALS, PROGRAM);
        let checked = check(&bench);
        let (run, trace) = run(&bench);
        run.assert_exact_and_legal();
        let abrasive = times_on(&trace, "out4");
        assert_eq!(abrasive.len(), 3, "{jet}: {abrasive:?}");
        let (ran_s, said_s) = (abrasive.iter().sum::<f64>(), number(&checked, "abrasive_s"));
        // With a lead the water's proof is waited for with the abrasive on; each step begins in a period of its own.
        assert!((said_s - ran_s).abs() <= 0.01, "{jet}: {said_s} s of abrasive, and {ran_s} s in the run");
        let ran_kg = (300.0 * (abrasive[0] + abrasive[1]) + 450.0 * abrasive[2]) / 60_000.0;
        let said_kg = number(&checked, "abrasive_kg");
        assert!((said_kg - ran_kg).abs() <= 0.01 * ran_kg, "{jet}: {said_kg} kg, and {ran_kg} kg in the run");
        let (ran_s, said_s) = (run.number("periods") / 1000.0, number(&checked, "total_s"));
        assert!((said_s - ran_s).abs() <= 0.05, "{jet}: {said_s} s, and the run took {ran_s} s");
        let lit = [times_on(&trace, "out3").len(), times_on(&trace, "out2").len()];
        assert_eq!((lit, &checked["pierces"]), ([3, 1], &json!(4)));
        assert_eq!(
            (&checked["consumable_starts"], &checked["sensings"]),
            (&json!([{ "cutter": "torch", "starts": 1 }]), &json!(0))
        );
        assert_eq!(checked["motion_s"], run.report["motion_s"], "{jet}");
        let cut_mm = 90.0 + 20.0 * std::f64::consts::PI + 60.0 + 10.0;
        assert!((number(&checked, "cutting_mm") - cut_mm).abs() < 0.01, "{checked}");
    }
}

/// A program that switches the abrasive itself, in passing and on the same line of a subprogram each time.
#[test]
fn abrasive_that_the_program_switches_counts_from_its_move_on() {
    let program = "o100 sub\nG1 X[#1]\no100 endsub\nG21 G90 G64 P0.05 F1800\nG0 X10\nM3\nM64 P4\no100 call [40]\n\
        M63 P4\no100 call [80]\nM62 P4\no100 call [90]\nM65 P4\nM5\nG0 X0\nM2\n";
    let machine = machine("abrasive_g_per_min = 120", "");
    let bench = bench(&machine, &MATERIALS.replace("abrasive_g_per_min = 300\n", ""), program);
    let checked = check(&bench);
    let (_, trace) = run(&bench);
    let abrasive = times_on(&trace, "out4");
    assert_eq!(abrasive.len(), 2, "{abrasive:?}");
    let (ran_s, said_s) = (abrasive.iter().sum::<f64>(), number(&checked, "abrasive_s"));
    assert!((1.3..2.0).contains(&ran_s) && (said_s - ran_s).abs() < 0.01, "{said_s} s, and {ran_s} s in the run");
    assert!((number(&checked, "abrasive_kg") - said_s * 0.12 / 60.0).abs() < 1e-9, "the flow of the cutter");
}

#[test]
fn a_cost_is_reported_where_the_machine_file_has_rates() {
    let jet = "jet = { abrasive_delay_s = 0.2 }";
    let bench = bench(&machine(jet, ""), MATERIALS, PROGRAM);
    let free = check(&bench);
    assert_eq!(free["cost"], Value::Null);
    let text = |bench: &Bench| bench.retrace(["check", "p.ngc", "--machine", "m.toml"]).out;
    let shown = text(&bench);
    assert!(!shown.contains("cost"), "{shown}");
    assert_contains(&shown, &["\n  consumable starts of torch: 1 · abrasive 0.0"]);
    let rates = "[cost]\ncurrency = \"EUR\"\nper_hour = 90\nper_pierce = 0.5\nper_metre = 2\nper_kg_abrasive = 40\n";
    bench.file("m.toml", machine(jet, rates));
    let checked = check(&bench);
    let cost = &checked["cost"];
    let wanted = [
        ("time", 90.0 * number(&checked, "total_s") / 3600.0),
        ("pierces", 4.0 * 0.5),
        ("cut", 2.0 * number(&checked, "cutting_mm") / 1000.0),
        ("abrasive", 40.0 * number(&checked, "abrasive_kg")),
    ];
    for (item, amount) in wanted {
        assert!(amount > 0.0 && (number(cost, item) - amount).abs() < 1e-6, "{item}: {amount} in {cost}");
    }
    let total: f64 = wanted.iter().map(|(_, amount)| amount).sum();
    assert!((number(cost, "total") - total).abs() < 1e-6, "{cost}");
    assert_eq!((&cost["currency"], &cost["is_partial"]), (&json!("EUR"), &json!(false)));
    assert_contains(
        &text(&bench),
        &[&format!("\n  cost: {total:.2} EUR: time "), "pierces 2.00 · cut 0.45 · abrasive "],
    );
    bench.file("m.toml", machine(jet, "[cost]\nper_pierce = 0.25\n"));
    let cost = &check(&bench)["cost"];
    assert_eq!((&cost["time"], &cost["pierces"], &cost["total"]), (&Value::Null, &json!(1.0), &json!(1.0)));
    assert_contains(&text(&bench), &["\n  cost: 1.00\n"]);
}

#[test]
fn a_flow_that_nobody_states_makes_the_cost_partial() {
    let rates = "[cost]\nper_pierce = 1\nper_kg_abrasive = 2\n";
    let materials = MATERIALS.replace("abrasive_g_per_min = 450\n", "");
    let bench = bench(&machine("jet = { abrasive_delay_s = 0.2 }", rates), &materials, PROGRAM);
    let checked = check(&bench);
    assert_eq!((&checked["abrasive_kg"], &checked["cost"]["is_partial"]), (&Value::Null, &json!(true)));
    assert!(number(&checked, "abrasive_s") > 5.0, "{checked}");
    let text = bench.retrace(["check", "p.ngc", "--machine", "m.toml"]).out;
    assert_contains(&text, &["abrasive of unknown flow", "(abrasive_g_per_min of the material", "cost: at least "]);
    for (jet, rates, told) in [
        ("", "[cost]\nper_hour = -1\n", "cost.per_hour = -1"),
        ("", "[cost]\nper_minute = 1\n", "unknown field `per_minute`"),
        ("abrasive_g_per_min = 10001", "", "cutter jet: abrasive_g_per_min = 10001"),
        ("jet = { usual_pressure_s = 61 }", "", "jet.usual_pressure_s = 61"),
    ] {
        bench.file("m.toml", machine(jet, rates));
        let refused = bench.retrace(["check", "p.ngc", "--machine", "m.toml"]);
        assert_eq!(refused.code, Some(2), "{told}");
        assert_contains(&refused.err, &[told]);
    }
}
