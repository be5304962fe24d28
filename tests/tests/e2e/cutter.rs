//! The cutter at every stop and restart, at the pins of the card.
//!
//! Invariant: the outputs are checked by the trace of the card alone.

use retrace_tests::command::{Bench, CommandOutput};
use retrace_tests::pins::{Sample, run_with_pins as run, samples};
use retrace_tests::run::Run;
use retrace_tests::served::ServedCard;
use serde_json::{Value, json};

/// A small machine with a cutter of this kind on output `fire` (`spindle` for M3's), and further text of its file.
fn machine(cutter: &str, more: &str) -> String {
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = \
                100\nmax_acceleration_mm_per_s2 = 1000\n\
             max_jerk_mm_per_s3 = 20000\ntravel_mm = [-50, 500]\n"
        )
    };
    format!("{more}{cutter}{}{}{}", axis("x"), axis("y"), axis("z"))
}

const TORCH: &str = "[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nstart = { pierce_s = 0.4 }\n";
const JET: &str = "[[cutter]]\nname = \"jet\"\nkind = \"jet\"\nfire = 3\n";
const SPINDLE: &str = "[[cutter]]\nname = \"spindle\"\nkind = \"spindle\"\nfire = 64\n[code.M3]\nduration_ms = 800\n";

/// Line 4 is a cut of 2 s, line 6 a rapid, line 8 another cut.
const TORCH_PROGRAM: &str = "G21 G90 F1800\nG0 X10\nM3\nG1 X70\nM5\nG0 X100\nM3\nG1 X160\nM5\nG0 X0\nM2\n";
const JET_PROGRAM: &str = "G21 G90 F1800\nG0 X10\nM64 P3\nG4 P0.3\nG1 X70\nM65 P3\nG0 X0\nM2\n";

/// Longest time, in ms, that an output was on without a break while the machine was at rest, and its program line.
fn max_standing_ms(samples: &[Sample], output: &str) -> (u64, u64) {
    let (mut longest, mut since, mut line) = (0, None, 0);
    for sample in samples {
        if sample.at_rest && sample.is_on(output) {
            let begun = *since.get_or_insert(sample.at_us);
            if sample.at_us - begun > longest {
                (longest, line) = (sample.at_us - begun, sample.line);
            }
        } else if let Some(begun) = since.take()
            && sample.at_us - begun > longest
        {
            (longest, line) = (sample.at_us - begun, sample.line);
        }
    }
    (longest / 1000, line)
}

fn assert_off_at_the_end(samples: &[Sample], output: &str) {
    let last = samples.last().expect("a trace");
    assert!(last.at_rest && !last.is_on(output), "{last:?}");
}

/// The first moment, in ms, at which the machine moves behind `from_ms`.
fn first_motion_ms(samples: &[Sample], from_ms: u64) -> u64 {
    let moves = samples.iter().find(|sample| sample.at_us >= from_ms * 1000 && sample.rate != 0.0);
    moves.expect("it moves").at_us / 1000
}

fn time_ms(event: &serde_json::Value) -> u64 {
    (event["time_s"].as_f64().expect("a time") * 1000.0).round() as u64
}

#[test]
fn a_stop_in_the_cut_switches_the_cutter_off() {
    for (cutter, program, output, line) in
        [(TORCH, TORCH_PROGRAM, "spindle", 4), (JET, JET_PROGRAM, "out3", 5), (SPINDLE, TORCH_PROGRAM, "spindle", 4)]
    {
        let script = format!("at line {line} override 100%\nafter 0.5s stop\n");
        let (run, pins) = run(&machine(cutter, ""), program, &script, &[]);
        assert_eq!(run.report["outcome"], "stopped");
        assert!(pins.iter().any(|sample| sample.is_on(output)), "it was on before");
        assert_off_at_the_end(&pins, output);
        let off = run.of_kind("cutter_off").last().expect("it is reported");
        assert_eq!(off["reason"], "job_stopped", "{off}");
    }
}

#[test]
fn a_program_that_forgets_its_cutter_ends_with_the_cutter_off() {
    let (run, pins) = run(&machine(JET, ""), "G21 G90 F1800\nM64 P3\nG1 X20\nM2\n", "", &[]);
    run.assert_exact_and_legal();
    assert_off_at_the_end(&pins, "out3");
    assert_eq!(run.of_kind("cutter_off").last().expect("reported")["reason"], "program_end");
}

#[test]
fn a_hold_puts_out_a_torch_at_once_a_jet_after_its_grace_and_lets_a_spindle_turn() {
    let holds = "at line 4 override 100%\nafter 0.3s hold\nafter 2s recover\n";
    let (torch, pins) = run(&machine(TORCH, ""), TORCH_PROGRAM, holds, &[]);
    torch.assert_exact_and_legal();
    let out = torch.of_kind("cutter_off").next().expect("it goes out").clone();
    assert_eq!((&out["reason"], &out["line"]), (&json!("at_rest"), &json!(4)));
    // M3 takes 400 ms, and up to 100 ms may pass until the motion begins
    assert!(max_standing_ms(&pins, "spindle").0 <= 502, "{:?}", max_standing_ms(&pins, "spindle"));
    let at_rest = pins.iter().find(|sample| sample.at_us / 1000 >= time_ms(&out)).expect("a sample");
    assert!(at_rest.at_rest && !at_rest.is_on("spindle"));

    let (jet, pins) = run(&machine(JET, ""), JET_PROGRAM, &holds.replace("line 4", "line 5"), &[]);
    jet.assert_exact_and_legal();
    let (standing, line) = max_standing_ms(&pins, "out3");
    assert!((499..=502).contains(&standing) && line == 5, "{standing} ms at line {line}");
    // a hold that is shorter than the grace resumes without a restart
    let short = "at line 5 override 100%\nafter 0.3s hold\nafter 0.4s resume\n";
    let (jet, _) = run(&machine(JET, ""), JET_PROGRAM, short, &[]);
    jet.assert_exact_and_legal();
    assert_eq!(jet.of_kind("cutter_off").count() + jet.of_kind("outputs_differ").count(), 0);

    let (router, pins) = run(&machine(SPINDLE, ""), TORCH_PROGRAM, &holds.replace("recover", "resume"), &[]);
    router.assert_exact_and_legal();
    assert_eq!(router.of_kind("outputs_differ").count(), 0);
    assert!(max_standing_ms(&pins, "spindle").0 >= 1900);
}

#[test]
fn every_other_stop_puts_the_torch_out_as_well() {
    let m0 = TORCH_PROGRAM.replace("G1 X70", "G1 X40\nM0\nG1 X70");
    let cases = [
        (m0.as_str(), "at line 4 override 100%\nafter 5s recover\n", "M0"),
        (m0.as_str(), "at line 4 override 100%\nafter 5s resume\nafter 1s agree\n", "M0"),
        (
            TORCH_PROGRAM,
            "at line 4 override 100%\nafter 0.3s override 0%\nafter 2s override 100%\nafter 0s recover\n",
            "override",
        ),
        (TORCH_PROGRAM, "at line 4 single\nafter 3s single\nafter 0s recover\n", "single"),
        (
            TORCH_PROGRAM,
            "at line 4 override 100%\nafter 0.3s pause\nafter 1s spindle stop\nafter 0s spindle start\nafter 0s \
                online\nafter 0s cycle start\n",
            "pause",
        ),
    ];
    for (program, script, what) in cases {
        // in single block a step would be the contour, and the torch go out behind it by the program
        let torch = if what == "single" { format!("{TORCH}single_block = \"block\"\n") } else { TORCH.into() };
        let (run, pins) = run(&machine(&torch, ""), program, script, &[]);
        run.assert_exact_and_legal();
        let (standing, line) = max_standing_ms(&pins, "spindle");
        assert!(standing <= 502, "{what}: lit for {standing} ms at rest, line {line}");
        assert!(run.of_kind("cutter_off").any(|off| off["reason"] == "at_rest"), "{what}");
    }
}

#[test]
fn a_script_that_waits_for_a_line_that_cannot_come_ends_the_job() {
    let program = TORCH_PROGRAM.replace("G1 X70", "G1 X40\nM0\nG1 X70");
    let (run, pins) = run(&machine(TORCH, ""), &program, "at line 6 recover\n", &[]);
    assert_eq!((run.output.code, &run.report["outcome"]), (Some(4), &json!("stopped")));
    assert_off_at_the_end(&pins, "spindle");
}

#[test]
fn feed_begins_again_only_when_the_tool_is_ready() {
    for (cutter, program, ready_ms) in
        [(TORCH, TORCH_PROGRAM, 400), (JET, JET_PROGRAM, 300), (SPINDLE, TORCH_PROGRAM, 800)]
    {
        let pause = "spindle stop\nafter 0s spindle start\nafter 0s online\nafter 0s cycle start\n";
        let script = match cutter {
            SPINDLE => format!("at line 4 override 100%\nafter 0.3s pause\nafter 1s {pause}"),
            _ => "at line 5 override 100%\nafter 0.3s hold\nafter 2s recover\n"
                .replace("line 5", if cutter == TORCH { "line 4" } else { "line 5" }),
        };
        let (run, pins) = run(&machine(cutter, ""), program, &script, &[]);
        run.assert_exact_and_legal();
        let begun = time_ms(run.of_kind("restart_switching").next().expect("the instruction is carried out again"));
        let moves = first_motion_ms(&pins, begun);
        assert!(
            (begun + ready_ms..begun + ready_ms + 20).contains(&moves),
            "{cutter}: {begun} ms, moves at {moves} ms"
        );
        let output = if cutter == JET { "out3" } else { "spindle" };
        let moving = pins.iter().find(|sample| sample.at_us / 1000 >= moves).expect("a sample");
        assert!(moving.is_on(output), "{cutter}: {moving:?}");
    }
}

#[test]
fn outputs_that_were_switched_by_hand_are_asked_about_at_every_restart() {
    let spindle = machine(SPINDLE, "");
    let program = TORCH_PROGRAM.replace("M3\nG1 X70", "M3 M64 P5\nG1 X70");
    let held = "at line 4 override 100%\nafter 0.3s hold\nafter 1s output 5 off\nafter 0s resume\nafter 1s agree\n";
    let paused = "at line 4 override 100%\nafter 0.3s pause\nafter 1s output 5 off\nafter 0s spindle stop\nafter 0s \
        spindle start\n\
        after 0s online\nafter 0s cycle start\nafter 4s agree\n";
    for script in [held, paused] {
        let (run, pins) = run(&spindle, &program, script, &[]);
        run.assert_exact_and_legal();
        let asked = run.of_kind("outputs_differ").next().expect("it asks");
        let told = &asked["outputs"][0];
        let [actual, expected, line] = ["actual", "expected", "line"].map(|field| told[field].as_i64());
        assert_eq!((actual, expected, line), (Some(0), Some(1), Some(3)), "{asked}");
        assert_eq!((&told["name"], &told["code"], &told["unit"]), (&json!("output 5"), &json!("M64"), &Value::Null));
        assert_eq!(asked["outputs"].as_array().map(Vec::len), Some(1));
        let restored = time_ms(run.of_kind("outputs_restored").last().expect("it is restored"));
        let after = first_motion_ms(&pins, time_ms(asked) + 1);
        assert!(after >= restored, "it moved at {after} ms, before {restored} ms");
    }
    // without a confirmation it does not resume
    let (unanswered, pins) = run(&spindle, &program, &held.replace("after 1s agree\n", ""), &[]);
    assert_eq!(unanswered.report["outcome"], "stopped");
    let asked = time_ms(unanswered.of_kind("outputs_differ").next().expect("it asks"));
    assert!(pins.iter().all(|sample| sample.at_us / 1000 <= asked || sample.rate == 0.0));
}

#[test]
fn an_output_that_is_switched_back_while_its_instruction_runs_is_asked_about() {
    let script = "at 0.8s output 64 off\nafter 3s agree\n";
    let (run, pins) = run(&machine(SPINDLE, ""), TORCH_PROGRAM, script, &[]);
    run.assert_exact_and_legal();
    let done = run.of_kind("switched").find(|event| event["code"] == "M3").expect("M3 is carried out");
    let asked = run.of_kind("outputs_differ").next().expect("it asks");
    assert_eq!((&asked["outputs"][0]["channel"], time_ms(asked) - time_ms(done) <= 2), (&json!(64), true));
    assert!(pins.iter().all(|sample| sample.line != 4 || sample.rate == 0.0 || sample.is_on("spindle")));
}

#[test]
fn a_stop_while_the_cutter_is_started_again_leaves_no_motion_behind() {
    let script = "at line 5 override 100%\nafter 0.3s hold\nafter 2s recover\nafter 0.1s stop\n";
    let (bench, card) = (Bench::new(), ServedCard::with(&[]));
    bench.file("part.ngc", JET_PROGRAM);
    bench.file("m.toml", machine(JET, "") + "[card]\nwatchdog_ms = 2000\n");
    bench.file("s.op", script);
    let arguments = ["run", "part.ngc", "--machine", "m.toml", "--operator", "s.op", "--json", "--card", &card.port];
    let stopped = bench.retrace(arguments);
    assert_eq!(stopped.code, Some(4), "{}\n{}", stopped.out, stopped.err);
    let report: serde_json::Value = serde_json::from_str(stopped.out.lines().last().expect("a report")).expect("JSON");
    // the pierce of 300 ms ends after the job has
    std::thread::sleep(std::time::Duration::from_millis(1000));
    let told = card.end();
    assert_eq!(told["counts"][0], report["position_counts"]["x"], "it moved on behind the end: {told}");
}

#[test]
fn a_start_in_the_middle_brings_the_tool_up_first_and_lights_a_torch_at_the_cut() {
    let (router, pins) = run(&machine(SPINDLE, ""), TORCH_PROGRAM, "", &["--start-line", "8"]);
    assert_eq!(router.report["outcome"], "completed");
    let on = pins.iter().find(|sample| sample.is_on("spindle")).expect("it turns");
    assert!(first_motion_ms(&pins, 0) >= on.at_us / 1000 + 800, "{on:?}");
    let (plasma, pins) = run(&machine(TORCH, ""), TORCH_PROGRAM, "", &["--start-line", "8"]);
    assert_eq!(plasma.report["outcome"], "completed");
    let on = pins.iter().find(|sample| sample.is_on("spindle")).expect("it is lit").at_us / 1000;
    // X100 has been reached by then, and the pierce is waited for
    let before: Vec<&Sample> = pins.iter().filter(|sample| sample.at_us / 1000 <= on && sample.rate != 0.0).collect();
    assert!(before.len() > 500, "it moves there dark");
    assert!(first_motion_ms(&pins, on) >= on + 400);
    assert!(pins.iter().filter(|sample| sample.is_on("spindle") && sample.rate != 0.0).all(|sample| sample.line == 8));
}

#[test]
fn reverse_run_puts_the_cutter_out_and_the_end_of_it_lights_it_again() {
    for replayed in ["", "retrace_outputs = \"replayed\"\n"] {
        let script = "at line 5 override 100%\nafter 0.5s reverse 100%\nafter 1s leave\n";
        let (run, pins) = run(&machine(JET, replayed), JET_PROGRAM, script, &[]);
        run.assert_exact_and_legal();
        assert!(pins.iter().any(|sample| sample.rate < 0.0));
        assert!(pins.iter().all(|sample| sample.rate >= 0.0 || !sample.is_on("out3")), "{replayed}");
        let lit = run.of_kind("restart_switching").map(|event| event["code"].clone()).collect::<Vec<_>>();
        assert_eq!(lit, ["M64"], "{replayed}");
    }
}

#[test]
fn replayed_outputs_go_back_and_forth_with_m64_and_never_light_the_cutter() {
    // output 5 belongs to no cutter; the way back covers everything
    let program =
        "G21 G90 F3000\nG1 X10\nM64 P5\nG1 X20\nM64 P3\nG1 X40\nM65 P3\nG1 X60\nM65 P5\nG1 X80\nG1 X100\nM2\n";
    let script = "at line 11 reverse 100%\nafter 4s leave\n";
    let (run, pins) = run(&machine(JET, "retrace_outputs = \"replayed\"\n"), program, script, &[]);
    run.assert_exact_and_legal();
    let back: Vec<&Sample> = pins.iter().filter(|sample| sample.rate < 0.0).collect();
    assert!(back.iter().any(|sample| sample.is_on("out5")) && !back.last().expect("it went back").is_on("out5"));
    assert!(back.iter().all(|sample| !sample.is_on("out3")));
    let values: Vec<_> = run.of_kind("retrace_switched").map(|e| (e["channel"].clone(), e["value"].clone())).collect();
    assert_eq!(values, [(json!(5), json!(1)), (json!(5), json!(0)), (json!(5), json!(1)), (json!(5), json!(0))]);
    let switched = run.records.rows.iter().filter(|row| !row.retrace_switched.is_empty());
    let switched: Vec<_> = switched.map(|row| (row.retrace_switched.as_str(), row.rate_nano.signum())).collect();
    assert_eq!(switched, [("5=1", -1), ("5=0", -1), ("5=1", 1), ("5=0", 1)]);
}

#[test]
fn a_dry_run_keeps_the_cutter_and_its_gas_off_and_nothing_else() {
    let cutter = format!("{JET}abrasive = 4\n");
    let program = JET_PROGRAM.replace("M64 P3", "M64 P4 M8\nM64 P5\nM64 P3");
    let (run, pins) = run(&machine(&cutter, ""), &program, "", &["--dry-run"]);
    run.assert_exact_and_legal();
    assert!(pins.iter().all(|sample| !sample.is_on("out3") && !sample.is_on("out4")));
    assert!(pins.iter().any(|sample| sample.is_on("out5")) && pins.iter().any(|sample| sample.is_on("flood")));
    assert!(run.records.is_dry && run.report["dry_run"] == true);
    // run-up, pierce and the dwell with the jet on are left out
    let took = |waits: &str| {
        let abrasive = "[code.M8]\nduration_ms = 500\n[code.M101]\noutput = 4\nduration_ms = 900\n";
        let program = JET_PROGRAM.replace("M64 P3", "M101\nM8\nM64 P3");
        self::run(&(machine(&cutter, waits) + abrasive), &program, "", &["--dry-run"]).0.number("periods")
    };
    let (without, with) = (took(""), took("dry_waits = true\n"));
    assert!(without > 500.0 && (with - without - 900.0 - 300.0).abs() < 20.0, "{with} {without}");
}

#[test]
fn a_cutter_is_switched_off_by_hand_at_any_time_and_on_only_where_it_may_cut() {
    let cutting_jet = format!("{JET}retrace_cut = true\n");
    let script = "at line 5 override 100%\nafter 1s cutter off\nafter 1s output 3 on\nafter 0s cutter on\nafter 0s \
        reverse 50%\n\
        after 0.5s cutter on\nafter 0.3s output 3 off\nafter 0s leave\n";
    let (run, pins) = run(&machine(&cutting_jet, ""), JET_PROGRAM, script, &[]);
    run.assert_exact_and_legal();
    let refused: Vec<_> =
        run.of_kind("command_rejected").map(|event| event["reason"].as_str().unwrap_or("").to_owned()).collect();
    assert_eq!(refused.len(), 2, "{refused:?}");
    assert!(refused.iter().all(|why| why.contains("recover")), "{refused:?}");
    assert!(pins.iter().any(|sample| sample.rate < 0.0 && sample.is_on("out3")), "on while it goes back");
    let offs: Vec<_> = run.of_kind("cutter_off").map(|event| event["reason"].clone()).collect();
    assert_eq!(offs, ["operator", "operator"], "{offs:?}");
    // a torch is not lit where the path is retraced
    let script =
        "at line 4 override 100%\nafter 0.3s reverse 50%\nafter 1s cutter on\nafter 0s output 64 on\nafter 0s leave\n";
    let (torch, pins) = self::run(&machine(TORCH, ""), TORCH_PROGRAM, script, &[]);
    torch.assert_exact_and_legal();
    assert_eq!(torch.of_kind("command_rejected").count(), 2);
    assert!(pins.iter().all(|sample| sample.rate >= 0.0 || !sample.is_on("spindle")));
}

#[test]
fn backing_with_the_jet_on_stops_with_a_question_where_the_program_switched_it() {
    let cutting_jet = format!("{JET}retrace_cut = true\n");
    // line 8 is the second cut, from X80 on
    let program = "G21 G90 F1800\nM64 P3\nG1 X60\nM65 P3\nG0 X80\nM64 P3\nG4 P0.1\nG1 X140\nM65 P3\nM2\n";
    let back = "at line 8 override 100%\nafter 1s reverse 100%\nafter 0.3s cutter on\n";
    for (script, passes) in [
        ("after 1.1s cutter off\nafter 0s reverse 100%\nafter 2s leave\n", false),
        ("after 1.1s reverse 50%\nafter 0.2s cutter off\nafter 1s leave\n", true),
    ] {
        let (run, pins) = run(&machine(&cutting_jet, ""), program, &format!("{back}{script}"), &[]);
        run.assert_exact_and_legal();
        let asked = time_ms(run.of_kind("cutter_boundary").next().expect("it asks"));
        let there = pins.iter().find(|sample| sample.at_us / 1000 >= asked).expect("a sample");
        assert!(there.at_rest && there.place.fract() == 0.0, "{there:?}");
        let lit_before = pins.iter().any(|s| s.rate < 0.0 && s.is_on("out3") && s.place < there.place);
        assert_eq!(lit_before, passes, "{script}");
        assert!(pins.iter().any(|s| s.rate < 0.0 && s.place < there.place), "it went on backward");
    }
}

/// The jet goes off at the question, after its grace or by the operator: nothing moves before the operator reverses.
#[test]
fn a_jet_that_goes_off_at_the_question_starts_no_motion() {
    let cutting_jet = format!("{JET}retrace_cut = true\n");
    let back = "at line 5 override 100%\nafter 1s hold\nafter 0.4s reverse 50%\nafter 0.5s hold\n\
                after 0.5s cutter on\nafter 0.5s reverse 50%\n";
    for (script, why) in [("", "at_rest"), ("after 2.2s cutter off\n", "operator")] {
        let (run, pins) = run(&machine(&cutting_jet, ""), JET_PROGRAM, &format!("{back}{script}"), &[]);
        let asked = time_ms(run.of_kind("cutter_boundary").next().expect("it asks"));
        let off =
            run.of_kind("cutter_off").filter(|event| time_ms(event) >= asked).find(|event| event["reason"] == why);
        assert!(off.is_some(), "{why}: {}", run.output.out);
        let moved = pins.iter().find(|sample| sample.at_us / 1000 > asked && sample.rate != 0.0);
        assert!(moved.is_none(), "{why}: {moved:?}");
    }
}

/// In a dry run the state is that of the dry run; at the end of a contour it is *ending* until the cutter is off.
#[test]
fn a_dry_run_and_the_end_of_a_contour_are_states_of_the_cutter() {
    let bench = Bench::new();
    let table = bench.file(
        "materials.toml",
        "units = \"mm\"\ndefault = 1\n[[material]]\nnumber = 1\nname = \"steel\"\nkerf_mm = 1.5\n\
         pierce_height_mm = 4.0\npierce_delay_s = 0.2\n\
         cut_height_mm = 1.5\nfeed_mm_per_min = 1800.0\npause_at_end_s = 0.3\n",
    );
    let torch = format!("{TORCH}materials = {:?}\n", table.display().to_string());
    let torch = torch.replace("start = { pierce_s = 0.4 }\n", "");
    let states = |more: &[&str]| -> Vec<String> {
        let (run, _) = run(&machine(&torch, ""), TORCH_PROGRAM, "", more);
        assert_eq!(run.report["outcome"], "completed", "{}", run.output.err);
        run.of_kind("cutter_state").filter_map(|event| event["state"].as_str().map(str::to_owned)).collect()
    };
    assert_eq!(states(&["--dry-run"]), ["dry"]);
    let contour = ["piercing", "cutting", "ending", "off"];
    assert_eq!(states(&[]), [contour, contour].concat());
}

/// `retrace check` of a program, on a machine or on the built-in one.
fn check(machine: Option<String>, program: &str) -> CommandOutput {
    let bench = Bench::new();
    let program = bench.file("part.ngc", program).display().to_string();
    let machine = machine.map(|text| bench.file("m.toml", text).display().to_string());
    let mut arguments = vec!["check", &program];
    if let Some(machine) = &machine {
        arguments.extend(["--machine", machine]);
    }
    bench.retrace(arguments)
}

/// Abrasive without water clogs the mixing tube: it goes off with the jet, and comes back behind it.
#[test]
fn the_abrasive_of_a_jet_goes_off_with_it_and_comes_back_behind_it() {
    let program = "G21 G90 F1800\nG0 X10\nM64 P3\nG4 P0.3\nM64 P5\nG1 X70\nM65 P5\nM65 P3\nG0 X0\nM2\n";
    let jet = format!("{JET}abrasive = 5\n");
    let with_input = format!("{jet}ok = {{ input = 5 }}\nstart = {{ start_s = 2, pierce_s = 0.1 }}\n");
    let cases = [
        (&jet, "at line 6 override 100%\nafter 0.5s hold\nafter 3s recover\n", ""),
        (&jet, "at line 6 override 100%\nafter 0.5s cutter off\nafter 3s recover\n", ""),
        (&jet, "at line 6 override 100%\nafter 0.5s stop\n", ""),
        // the program might switch the abrasive within a contour that is skipped, so none is
        (&jet, "at line 6 override 100%\nafter 0.5s hold\nafter 2s skip contour\nafter 1s recover\n", ""),
        (&with_input, "at 4s recover\n", "lose@20"),
    ];
    for (cutter, script, faults) in cases {
        let (run, pins) = run(&machine(cutter, ""), program, script, &["--source-faults", faults]);
        let ends = if script.contains("stop") { "stopped" } else { "completed" };
        assert_eq!(run.report["outcome"], ends, "{script} {}", run.output.err);
        let mut without_water = 0;
        for sample in &pins {
            without_water = if sample.is_on("out5") && !sample.is_on("out3") { without_water + 1 } else { 0 };
            assert!(without_water <= 3, "{script}: {sample:?}");
        }
        let starts = pins.windows(2).filter(|pair| !pair[0].is_on("out5") && pair[1].is_on("out5")).count();
        assert_eq!(starts, if ends == "completed" { 2 } else { 1 }, "{script}");
    }
}

/// A jet that is switched in passing (M62, M63): the next contour is not skipped, so a hold in it asks before the feed
/// goes on, and nothing of it stays uncut.
#[test]
fn a_skip_ends_with_the_contour_of_a_jet_that_is_switched_in_passing() {
    let program =
        "G21 G90 G64 P0.1 F1800\nG1 X10\nM62 P3\nG1 X70\nM63 P3\nG1 X100\nM62 P3\nG1 X160\nM63 P3\nG1 X200\nM2\n";
    let script = "at 1s hold\nafter 1.5s skip contour\nat line 8 override 100%\nafter 0.5s hold\nafter 2s resume\n\
                  after 1s agree\n";
    let (run, pins) = run(&machine(JET, ""), program, script, &[]);
    let what = &run.output.out;
    assert_eq!((&run.report["outcome"], run.of_kind("outputs_differ").count()), (&"completed".into(), 1), "{what}");
    let lit = pins.windows(2).filter(|pair| !pair[0].is_on("out3") && pair[1].is_on("out3")).count();
    assert_eq!((lit, &run.report["contours_not_cut"]), (3, &1.into()), "{what}");
    assert!(run.number("not_cut_mm") < 41.0, "only what was skipped: {what}");
    assert_off_at_the_end(&pins, "out3");
}

/// A stop in a dwell with the jet on: it is off at once, and not after the dwell.
#[test]
fn a_stop_in_a_dwell_switches_the_jet_off() {
    let program = "G21 G90 F1800\nG1 X10\nM64 P3\nG4 P20\nG1 X70\nM65 P3\nM2\n";
    let (run, pins) = run(&machine(JET, ""), program, "at 2s stop\n", &[]);
    assert_eq!(run.report["outcome"], "stopped", "{}", run.output.out);
    let off = pins.windows(2).find(|pair| pair[0].is_on("out3") && !pair[1].is_on("out3")).expect("it was on");
    assert!((1_990_000..2_020_000).contains(&off[1].at_us), "on until {} us", off[1].at_us);
    assert_off_at_the_end(&pins, "out3");
}

#[test]
fn a_long_dwell_with_the_cutter_on_is_refused() {
    let program = |seconds: f64| format!("G21 G90 F1800\nG4 P100\nM64 P3\nG1 X10\nG4 P{seconds}\nM65 P3\nM2\n");
    assert_eq!(check(Some(machine(JET, "")), &program(30.0)).code, Some(0));
    let result = check(Some(machine(JET, "")), &program(30.5));
    assert!(result.code == Some(1) && result.err.contains("E4308") && result.err.contains(":5:"), "{}", result.err);
    assert_eq!(check(Some(machine(&format!("{JET}dwell_lit_s = 31\n"), "")), &program(30.5)).code, Some(0));
}

#[test]
fn what_a_program_does_with_its_cutter_is_checked_before_the_run() {
    // a rapid with the jet on, and on a machine that allows it
    let rapid = "G21 G90 F1800\nM64 P3\nG1 X10\nG0 X20\nM65 P3\nM2\n";
    let result = check(Some(machine(JET, "")), rapid);
    assert!(result.code == Some(1) && result.err.contains("E4306") && result.err.contains(":4:"), "{}", result.err);
    assert_eq!(check(Some(machine(&format!("{JET}rapid_lit = true\n"), "")), rapid).code, Some(0));
    // left on at the end
    let result = check(Some(machine(JET, "")), "G21 G90 F1800\nM64 P3\nG1 X10\nM2\n");
    assert!(
        result.code == Some(0) && result.err.contains("warning[W4101]: jet") && result.err.contains(":2:"),
        "{}",
        result.err
    );
    // an output that cuts, perhaps, and a machine that declares nothing
    let result = check(None, JET_PROGRAM);
    assert!(result.code == Some(0) && result.err.contains("warning[W4102]: output 3"), "{}", result.err);
    assert!(!check(Some(machine(JET, "")), JET_PROGRAM).err.contains("W410"));
    let named = machine("", "[[output]]\nnumber = 3\nname = \"air\"\n");
    assert!(!check(Some(named), JET_PROGRAM).err.contains("W410"));
}

/// The feed would begin before the cutter is ready.
#[test]
fn a_cutter_whose_start_takes_time_is_not_lit_in_passing() {
    let check = |cutter: &str, more: &str, program: &str| {
        let bench = Bench::new();
        let [machine, program] = [bench.file("m.toml", machine(cutter, more)), bench.file("part.ngc", program)];
        let [machine, program] = [machine, program].map(|path| path.display().to_string());
        bench.retrace(["check", &program, "--machine", &machine])
    };
    let program = |on: &str, off: &str| format!("G21 G90 F1800\nG1 X10\n{on}\nG1 X20\n{off}\nM2\n");
    let pierces = format!("{JET}start = {{ pierce_s = 0.5 }}\n");
    let user_code = "[code.M101]\noutput = 3\nclass = \"synchronous\"\n";
    for (cutter, code, more) in [(&*pierces, "M62 P3", ""), (&pierces, "M101", user_code)] {
        let result = check(cutter, more, &program(code, "M63 P3"));
        let names = result.err.contains("E4307") && result.err.contains(":3:") && result.err.contains(&code[..3]);
        assert!(result.code == Some(1) && names, "{}", result.err);
    }
    // at rest, or a jet that needs no time
    for (cutter, code) in [(&*pierces, "M64 P3"), (JET, "M62 P3")] {
        let result = check(cutter, "", &program(code, "M63 P3"));
        assert_eq!(result.code, Some(0), "{}", result.err);
    }
}

#[test]
fn a_beam_is_off_in_rapids_and_on_again_behind_them() {
    let beam = "[[cutter]]\nname = \"beam\"\nkind = \"beam\"\nfire = 64\n";
    let program = "G21 G90 G64 F3000\nM3\nG1 X10\nG0 X30\nG0 X40\nG1 X50\nM5\nG0 X0\nM2\n";
    let (run, pins) = run(&machine(beam, ""), program, "", &[]);
    run.assert_exact_and_legal();
    for sample in pins.iter().filter(|sample| sample.rate != 0.0) {
        // the sample of a period shows the line and the outputs at its end
        let cuts = matches!(sample.line, 3 | 6);
        assert!(sample.is_on("spindle") == cuts || sample.place.fract() == 0.0, "{sample:?}");
    }
    assert!(pins.iter().any(|sample| sample.line == 6 && sample.is_on("spindle")));
    assert!(pins.iter().all(|sample| !matches!(sample.line, 5 | 8) || !sample.is_on("spindle")));
}

#[test]
fn a_tool_change_and_an_optional_stop_wait_for_the_operator() {
    let router = machine(SPINDLE, "tool_change = \"manual\"\n");
    let program = "G21 G90 F1800\nG1 X10\nT3 M6\nG1 X20\nM1\nG1 X30\nM2\n";
    let (alone, _) = run(&router, program, "", &[]);
    alone.assert_exact_and_legal();
    assert_eq!(alone.of_kind("tool_change").count() + alone.of_kind("program_stop").count(), 0, "nobody is there");
    let script = "at 0s optional stop on\nat 4s cycle start\nat 9s cycle start\n";
    let (asked, pins) = run(&router, program, script, &[]);
    asked.assert_exact_and_legal();
    let change = asked.of_kind("tool_change").next().expect("it asks");
    assert_eq!(change["tool"], 3);
    assert!(
        asked.of_kind("message").any(|message| message["text"].as_str().is_some_and(|text| text.contains("tool 3")))
    );
    assert!(first_motion_ms(&pins, time_ms(change) + 1) >= 4000);
    let stop = asked.of_kind("program_stop").next().expect("M1 stops");
    assert!(first_motion_ms(&pins, time_ms(stop) + 1) >= 9000);
    let (off, _) =
        run(&router, program, &script.replace("stop on", "stop off").replace("at 9s cycle start\n", ""), &[]);
    off.assert_exact_and_legal();
    assert_eq!(off.of_kind("program_stop").count(), 0);
}

#[test]
fn a_wrong_cutter_is_refused_by_name() {
    let cases = [
        ("[[cutter]]\nname = \"j\"\nkind = \"jett\"\nfire = 3\n", "E2111", "jett"),
        ("[[cutter]]\nname = \"j\"\nkind = \"jet\"\nfire = 65\n", "E2112", "no such output"),
        ("[[cutter]]\nname = \"t\"\nkind = \"torch\"\nfire = 64\nretrace_cut = true\n", "E2112", "only a jet"),
        ("[[cutter]]\nname = \"t\"\nkind = \"torch\"\nfire = 3\narm = 3\n", "E2112", "uses it too"),
        ("[[cutter]]\nname = \"t\"\nkind = \"torch\"\nfire = 3\nstanding_ms = 9000\n", "E2112", "standing_ms"),
        (
            "[[output]]\nnumber = 3\nname = \"pump\"\n[[cutter]]\nname = \"t\"\nkind = \"torch\"\nfire = 3\n",
            "E2112",
            "names it",
        ),
    ];
    for (text, number, what) in cases {
        let bench = Bench::new();
        let file = bench.file("m.toml", machine(text, "")).display().to_string();
        let result = bench.retrace(["machine", "check", &file]);
        assert!(
            result.code == Some(2) && result.err.contains(number) && result.err.contains(what),
            "{text}: {}",
            result.err
        );
    }
}

#[test]
fn a_spindle_that_is_switched_off_by_hand_in_the_cut_holds_the_program() {
    let script = "at line 4 override 100%\nafter 0.5s output 64 off\nafter 2s resume\nafter 0.5s agree\n";
    let (run, pins) = run(&machine(SPINDLE, ""), TORCH_PROGRAM, script, &[]);
    run.assert_exact_and_legal();
    assert_eq!(run.of_kind("outputs_differ").count(), 1, "{:?}", run.events);
    let off = pins.iter().position(|sample| sample.line == 4 && sample.rate > 0.0 && !sample.is_on("spindle"));
    let off_us = pins[off.expect("it brakes with the spindle off")].at_us;
    let feeds = |sample: &&Sample| sample.line == 4 && sample.rate > 0.0 && !sample.is_on("spindle");
    let last_us = pins.iter().filter(feeds).map(|sample| sample.at_us).max().unwrap_or(0);
    assert!(last_us - off_us < 300_000, "it feeds for {} us with the spindle off", last_us - off_us);
}

/// A block of a stream that would leave the soft limits ends the program in the cut: the jet goes off at once.
#[test]
fn a_stream_that_is_refused_in_the_cut_leaves_the_cutter_off() {
    let bench = Bench::new();
    let (machine, vcd) = (bench.file("m.toml", machine(JET, "")).display().to_string(), bench.path("pins.vcd"));
    let program = b"G21 G90 F1800\nG0 X10\nM64 P3\nG1 X30\nG1 X9999\nM65 P3\nM2\n";
    let run = Run::of_input(&bench, program, &["--machine", &machine, "--vcd", &vcd.display().to_string()]);
    assert!(run.output.code == Some(1) && run.output.err.contains("E4304"), "{}", run.output.err);
    let samples = samples(&vcd);
    assert_off_at_the_end(&samples, "out3");
    let (standing, line) = max_standing_ms(&samples, "out3");
    assert!(standing <= 600, "{standing} ms in line {line}");
    assert!(samples.iter().any(|sample| sample.line == 4 && sample.is_on("out3")));
}

/// From the pause to the kerf the jet is off, while a length is entered and during the return with it.
#[test]
fn a_tool_length_in_a_pause_lights_nothing_before_the_kerf() {
    let script = "at line 5 override 100%\nafter 0.5s pause\nafter 1s jog z 5\nafter 0s tool length by 1.5\nafter 1s \
        online\n\
        after 0s cycle start\nafter 3s recover\n";
    let (run, samples) = run(&machine(JET, ""), JET_PROGRAM, script, &[]);
    assert_eq!(run.output.code, Some(0), "{}\n{}", run.output.err, run.output.out);
    let at = |kind: &str| time_ms(run.of_kind(kind).next().unwrap_or_else(|| panic!("{kind}: {}", run.output.out)));
    assert!(at("tool_length") > at("jogged") && at("arrived") > at("approaching"));
    let between = |sample: &&Sample| (at("jogged")..at("arrived")).contains(&(sample.at_us / 1000));
    assert!(samples.iter().filter(between).all(|sample| !sample.is_on("out3")));
    assert!(
        samples.iter().any(|sample| sample.at_us / 1000 > at("arrived") && sample.rate != 0.0 && sample.is_on("out3"))
    );
    assert_off_at_the_end(&samples, "out3");
    assert_eq!(run.report["position_mm"]["z"], 1.5, "{}", run.report);
}

/// Lengths in ms of the times for which an output was on at rest before `from_ms`.
fn pulses_ms(samples: &[Sample], output: &str, (from_ms, to_ms): (u64, u64)) -> Vec<u64> {
    let (mut lengths, mut since) = (Vec::new(), None);
    for sample in samples.iter().filter(|sample| (from_ms..to_ms).contains(&(sample.at_us / 1000))) {
        match (sample.is_on(output), since) {
            (true, None) => since = Some(sample.at_us),
            (false, Some(begun)) => {
                lengths.push((sample.at_us - begun) / 1000);
                since = None;
            }
            _ => {}
        }
        assert!(since.is_none() || sample.at_rest, "it moves in a test pulse: {sample:?}");
    }
    lengths
}

/// The test pulse is on for its time, at rest; *hold* and *cutter off* end it, and nothing else can be asked for in it.
#[test]
fn a_test_pulse_fires_at_rest_for_its_time_and_ends_by_hand() {
    let torch = TORCH.to_owned() + "pulse_s = 0.7\n";
    let torch =
        torch.replace("start = { pierce_s = 0.4 }\npulse_s = 0.7\n", "pulse_s = 0.7\nstart = { pierce_s = 0.4 }\n");
    let script = "at line 6 override 100%\nafter 0.2s test pulse\nafter 0.1s hold\nafter 1s test pulse\n\
        after 0.2s resume\nafter 1s test pulse\nafter 0.2s cutter off\nafter 1s resume\n";
    let (run, pins) = run(&machine(&torch, ""), TORCH_PROGRAM, script, &[]);
    run.assert_exact_and_legal();
    let commands: Vec<u64> =
        run.of_kind("operator").filter(|event| event["command"] == "test pulse").map(time_ms).collect();
    let rejected: Vec<&str> = run.of_kind("command_rejected").filter_map(|event| event["reason"].as_str()).collect();
    assert_eq!(rejected.len(), 2, "{rejected:?}");
    assert!(
        rejected[0].contains("needs the machine at rest") && rejected[1].contains("a test pulse is on"),
        "{rejected:?}"
    );
    let resumed =
        run.of_kind("operator").filter(|event| event["command"] == "resume").map(time_ms).last().expect("resumed");
    let lengths = pulses_ms(&pins, "spindle", (commands[1] - 1, resumed));
    assert!((699..=700).contains(&lengths[0]), "{lengths:?}");
    assert!(lengths.len() == 2 && (199..=202).contains(&lengths[1]), "{lengths:?}");
    let states: Vec<&str> = run.of_kind("cutter_state").filter_map(|event| event["state"].as_str()).collect();
    assert_eq!(states.iter().filter(|state| **state == "test").count(), 2, "{states:?}");
    // whole, and lit twice by the program
    assert_eq!(run.report["outcome"], "completed");
    assert_off_at_the_end(&pins, "spindle");
    let dry = ["--dry-run"];
    let (run, pins) = self::run(&machine(&torch, ""), TORCH_PROGRAM, script, &dry);
    assert!(pins.iter().all(|sample| !sample.is_on("spindle")), "a dry run");
    assert!(
        run.of_kind("command_rejected").any(|event| event["reason"].as_str().is_some_and(|why| why.contains("dry")))
    );
}
