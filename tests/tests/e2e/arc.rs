//! A torch with an arc-ok input: starts, losses, contacts that lie, and the word that recovers the cut.

use retrace_tests::command::Bench;
use retrace_tests::cut_judge::{JudgedMachine, Verdict, judge};
use retrace_tests::pins::{Sample, samples};
use retrace_tests::run::Run;
use retrace_tests::terminal::Terminal;
use serde_json::Value;
use std::ops::Deref;
use std::path::{Path, PathBuf};

const JUDGED: JudgedMachine = JudgedMachine {
    pulses_per_mm: 200.0,
    fire: "spindle",
    input: 5,
    pierce_ms: 400.0,
    pilot_ms: 298.0,
    has_lead_ins: false,
};

/// Line 4 is a cut of 60 mm in 2 s.
const PROGRAM: &str = "G21 G90 F1800\nG0 X10\nM3 S1\nG1 X70\nM5\nG0 X100\nM3\nG1 X160\nM5\nG0 X0\nM2\n";

fn machine() -> String {
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = \
             100\nmax_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-50, 500]\n"
        )
    };
    let torch = "[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nok = { input = 5 }\n\
                 start = { start_s = 1.0, retry_s = 0.5, pierce_s = 0.4 }\n";
    format!("{torch}{}{}{}", axis("x"), axis("y"), axis("z"))
}

/// Asserts that a job has ended as the uninterrupted one did, at the same counts.
fn assert_ends_as(run: &Run, whole: &Run) {
    let end = |run: &Run| (run.report["outcome"].clone(), run.counts());
    assert_eq!(end(run), end(whole), "{}", run.output.out);
}

/// The samples of a trace, and its file for the judge, which exists as long as its bench.
struct Trace {
    samples: Vec<Sample>,
    vcd: PathBuf,
    _bench: Bench,
}

impl Deref for Trace {
    type Target = [Sample];

    fn deref(&self) -> &[Sample] {
        &self.samples
    }
}

impl AsRef<Path> for Trace {
    fn as_ref(&self) -> &Path {
        &self.vcd
    }
}

fn run(faults: &str, script: &str, more: &[&str]) -> (Run, Trace) {
    run_on(&machine(), faults, script, more)
}

fn run_on(machine: &str, faults: &str, script: &str, more: &[&str]) -> (Run, Trace) {
    let bench = Bench::new();
    let program = bench.file("part.ngc", PROGRAM);
    let (machine, vcd) = (bench.file("m.toml", machine).display().to_string(), bench.path("pins.vcd"));
    let (operator, trace) = (bench.file("s.op", script).display().to_string(), vcd.display().to_string());
    let mut arguments =
        vec!["--machine", &machine, "--vcd", &trace, "--source-faults", faults, "--operator", &operator];
    arguments.extend(more);
    let run = Run::of(&bench, &program, &arguments);
    (run, Trace { samples: samples(&vcd), vcd, _bench: bench })
}

/// What a person reads at the terminal.
fn text(faults: &str) -> String {
    let bench = Bench::new();
    let (program, machine) = (bench.file("part.ngc", PROGRAM), bench.file("m.toml", machine()));
    let [program, machine] = [program, machine].map(|path| path.display().to_string());
    bench.retrace(["run", &program, "--machine", &machine, "--source-faults", faults]).out
}

fn with_reason<'e>(run: &'e Run, reason: &str) -> Vec<&'e Value> {
    run.events.iter().filter(|event| event["event"] == "cutter_off" && event["reason"] == reason).collect()
}

#[test]
fn a_lost_arc_is_recovered_with_one_word() {
    let (whole, uninterrupted) = run("", "", &[]);
    assert_eq!(whole.report["outcome"], "completed");
    let (run, trace) = run("lose@20", "at 3s recover\n", &[]);
    assert_ends_as(&run, &whole);
    let verdict = judge(&uninterrupted, &trace, &JUDGED);
    assert!(verdict.is_good() && verdict.ignitions == 3, "{verdict:?}");
    // the place of the loss: 20 mm of cut behind the pierce at X10, in line 4
    let end = run.events.iter().find(|event| event["event"] == "cut_end").expect("a place");
    let at = |record: u64| trace.iter().find(|sample| sample.place == record as f64).expect("a sample").counts[0];
    let lost_mm = at(end["cut_record"].as_u64().expect("a record")) as f64 / 200.0;
    assert!((lost_mm - 30.0).abs() < 0.1 && end["cut_line"] == 4, "{lost_mm} {end}");
    let lost = with_reason(&run, "lost");
    assert_eq!((lost.len(), &run.report["cut_interruptions"], &run.report["not_cut_mm"]), (1, &1.into(), &0.0.into()));
    assert!(run.output.out.contains("\"moving\""), "a torch starts in motion in its kerf");
    assert!(text("lose@20").contains("torch off: E3024"));
}

/// Where M3 lights a torch, a pause has no spindle to stop and to start: on line, and cycle start. The torch is lit by
/// `recover` only.
#[test]
fn a_pause_in_a_cut_needs_no_steps_of_a_spindle() {
    let (whole, uninterrupted) = run("", "", &[]);
    let script = "at 2s pause\nafter 2s jog z 5\nafter 2s jog z -5\nafter 2s online\nafter 1s cycle start\n\
                  after 3s recover\n";
    let (run, trace) = run("", script, &[]);
    assert!(!run.output.out.contains("rejected"), "{}", run.output.out);
    assert_ends_as(&run, &whole);
    let verdict = judge(&uninterrupted, &trace, &JUDGED);
    assert!(verdict.is_good() && verdict.ignitions == 3, "{verdict:?}");
}

/// Each change of the cutter is told, as the pins show it; the arc is lost once.
#[test]
fn every_change_of_the_cutters_state_is_an_event() {
    let (run, trace) = run("lose@20", "at 3s recover\n", &[]);
    assert_eq!(run.report["outcome"], "completed", "{}", run.output.err);
    let told: Vec<(u64, &str)> = run
        .of_kind("cutter_state")
        .filter_map(|event| Some((event["period"].as_u64()?, event["state"].as_str()?)))
        .collect();
    let states: Vec<&str> = told.iter().map(|&(_, state)| state).collect();
    let whole = ["igniting", "piercing", "cutting", "lost", "igniting", "cutting", "off"];
    assert_eq!(states, [&whole[..], &["igniting", "piercing", "cutting", "off"]].concat());
    for window in told.windows(2) {
        let [(from, state), (to, _)] = [window[0], window[1]];
        let does_not_fit = |sample: &&Sample| {
            let (is_lit, is_proven) = (sample.is_on("spindle"), sample.inputs >> 5 & 1 == 1);
            !match state {
                // a loss is debounced
                "cutting" => is_lit,
                "piercing" => is_lit && is_proven && sample.rate == 0.0,
                "igniting" => is_lit && !is_proven,
                _ => !is_lit,
            }
        };
        let others = trace.iter().filter(|sample| (from..to).contains(&(sample.at_us / 1000))).filter(does_not_fit);
        // the proof of an arc that strikes in motion is debounced
        let debounced = if state == "igniting" { 10 } else { 0 };
        assert!(others.clone().count() <= debounced, "{state}: {:?}", others.clone().next());
    }
}

/// The arc does not strike at the end of the contour, and M5 passes: the contour is reported with what is missing, and
/// again when it is whole.
#[test]
fn a_contour_whose_end_is_cut_later_is_whole() {
    // the second ignition of this seed strikes no arc
    let (run, _) = run("lose@59,no-start=0.4,seed=11", "at 5.5s recover\nafter 5s recover\n", &[]);
    assert_eq!(run.report["outcome"], "completed", "{}", run.output.err);
    let missing: Vec<bool> =
        run.of_kind("contour").map(|event| event["not_cut_mm"].as_f64().expect("a length") > 0.0).collect();
    assert_eq!(missing, [true, false, false], "{}", run.output.out);
    assert_eq!((&run.report["contours"], &run.report["contours_not_cut"]), (&2.into(), &0.into()));
}

/// The operator goes back in the cut and comes forward again: what was cut on the way to rest counts as cut, and the
/// torch, which would find no metal where it went out, starts in motion.
#[test]
fn a_cut_that_was_left_backward_is_recovered() {
    let (whole, uninterrupted) = run("", "", &[]);
    let (run, trace) = run("", "at 2s reverse 100%\nafter 1s forward 100%\nafter 4s recover\n", &[]);
    assert_ends_as(&run, &whole);
    let verdict = judge(&uninterrupted, &trace, &JUDGED);
    assert!(verdict.is_good() && verdict.ignitions == 3, "{verdict:?} {}", run.output.out);
    // the arc meets metal within two cells of the sheet: at rest the torch has cut the cell that it came to
    assert!(run.number("not_cut_mm") <= 0.1, "{}", run.report);
    assert!(run.output.out.contains("\"moving\""), "{}", run.output.out);
}

/// The arc is lost so close to the end of the contour that the machine comes to rest at M5: whoever goes back and comes
/// forward again is asked about the torch, and the rest is cut.
#[test]
fn a_loss_on_the_last_way_to_rest_is_not_passed_by_reverse_run() {
    let (whole, uninterrupted) = run("", "", &[]);
    let (run, trace) = run("lose@59.9", "at 5s reverse 100%\nafter 1s forward 100%\nafter 4s recover\n", &[]);
    assert_ends_as(&run, &whole);
    let verdict = judge(&uninterrupted, &trace, &JUDGED);
    assert!(verdict.is_good(), "{verdict:?} {}", run.output.out);
    assert!(run.number("not_cut_mm") <= 0.1, "{}", run.report);
}

#[test]
fn without_an_operator_a_lost_arc_ends_the_job_with_the_torch_off() {
    let (run, trace) = run("lose@20", "", &[]);
    assert_eq!(run.report["outcome"], "stopped");
    let last = trace.last().expect("a trace");
    assert!(last.at_rest && !last.is_on("spindle"));
    assert!(run.report["alarms"].as_array().is_some_and(Vec::is_empty), "it is no alarm");
}

#[test]
fn a_torch_that_does_not_start_waits_for_the_operator() {
    let (run, trace) = run("no-start=1", "at 9s recover\n", &[]);
    assert_eq!(with_reason(&run, "not_started").len(), 2);
    assert_eq!(run.report["outcome"], "stopped");
    let ignitions = trace.windows(2).filter(|pair| !pair[0].is_on("spindle") && pair[1].is_on("spindle")).count();
    assert_eq!(ignitions, 6, "three attempts each time");
    assert!(trace.iter().all(|sample| sample.counts[0] <= 2000), "it never feeds");
    assert!(text("no-start=1").contains("torch off: E3025"));
}

/// Whatever ends a start that has not succeeded: nothing is lit from then on, neither by the attempt after it nor
/// later.
#[test]
fn a_start_that_is_ended_by_hand_lights_nothing_any_more() {
    // 1.0 s: in the first attempt, 1.6 s: between two, 2.0 s: in the second one
    for at_s in [1.0, 1.6, 2.0] {
        for end in ["cutter off", "stop", "reverse 20%"] {
            let (run, trace) = run("no-start=1", &format!("at {at_s}s {end}\n"), &[]);
            let from_us = (at_s * 1e6) as u64 + 5_000;
            let lit = trace.iter().filter(|sample| sample.at_us > from_us && sample.is_on("spindle")).count();
            assert_eq!(lit, 0, "{end} at {at_s} s\n{}", run.output.out);
            assert_eq!(run.report["outcome"], "stopped");
            let ends_us = trace.last().expect("a trace").at_us;
            if end == "stop" {
                assert!(ends_us < from_us + 100_000, "{end} at {at_s} s: it ends at {ends_us} us");
            }
            assert!(with_reason(&run, "not_started").is_empty(), "{}", run.output.out);
        }
    }
}

/// The program is held, and lights the torch anew from the beginning of its start.
#[test]
fn a_program_whose_torch_is_put_out_in_its_start_waits_and_starts_it_anew() {
    let (whole, uninterrupted) = run("", "", &[]);
    // before and after the arc has struck
    for at_s in [0.268, 0.3, 0.5, 0.7] {
        let (run, trace) = run("", &format!("at {at_s}s cutter off\nafter 3s resume\n"), &[]);
        assert_ends_as(&run, &whole);
        let verdict = judge(&uninterrupted, &trace, &JUDGED);
        assert!(verdict.is_good(), "{at_s} {verdict:?}");
        let from_us = (at_s * 1e6) as u64 + 2_000;
        let waits = trace.iter().filter(|sample| (from_us..from_us + 2_990_000).contains(&sample.at_us));
        assert!(waits.clone().all(|sample| !sample.is_on("spindle")), "{at_s}");
        assert_eq!(run.report["cut_interruptions"], 0);
    }
}

/// On the way back, while the outputs are restored, in the pilot arc, in the kerf, and beyond it.
#[test]
fn a_recovery_in_which_the_torch_is_put_out_begins_anew() {
    let (whole, uninterrupted) = run("", "", &[]);
    for after_s in [0.1, 0.5, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.5] {
        for end in ["cutter off", "reverse 5%\nafter 0.5s hold"] {
            if end != "cutter off" && after_s >= 1.0 {
                // it cuts again, so that nothing is left to be recovered
                continue;
            }
            let script = format!("at 3s recover\nafter {after_s}s {end}\nafter 2s recover\n");
            let (run, trace) = run("lose@20", &script, &[]);
            let what = format!("{end} after {after_s} s\n{}", run.output.out);
            assert_ends_as(&run, &whole);
            let verdict = judge(&uninterrupted, &trace, &JUDGED);
            assert!(verdict.is_good(), "{verdict:?}\n{what}");
        }
    }
}

/// On the way to the start, in the pierce, on the lead-in and beyond it: held, put out, or lost again.
#[test]
fn an_interrupted_lead_in_is_done_again() {
    let (whole, uninterrupted) = run("", "", &[]);
    for after_s in [0.3, 0.8, 1.1, 1.3, 1.5, 1.7, 1.9, 2.1] {
        for (end, again) in [
            ("hold", "resume"),
            ("cutter off", "shift 2 4\nafter 0.1s recover"),
            ("reverse 50%", "cutter off\nafter 0.5s shift 1 -4\nafter 0.5s recover"),
        ] {
            if end.starts_with("reverse") && !(0.7..1.5).contains(&after_s) {
                // before and behind the lead-in, it retraces the path
                continue;
            }
            // the second time, the arc is lost again 2 mm behind its strike, on the lead-in
            let script = format!("at 3s shift 0 4\nafter 0s recover\nafter {after_s}s {end}\nafter 1s {again}\n");
            let script = script + "after 4s shift -2 -3\nafter 0.1s recover\n";
            let script = script + "after 4s hold\nafter 0.5s shift -1 4\nafter 0.1s recover\n";
            let (run, trace) = run("lose@20", &script, &[]);
            let what = format!("{end} after {after_s} s\n{}", run.output.out);
            assert_ends_as(&run, &whole);
            let verdict = judge(&uninterrupted, &trace, &JudgedMachine { has_lead_ins: true, ..JUDGED });
            assert!(verdict.is_good(), "{verdict:?} {what}");
            assert_eq!(run.audit().violations, [0; 3], "{what}");
        }
    }
}

#[test]
fn a_shift_that_is_too_far_or_leaves_the_soft_limits_is_refused_before_anything_moves() {
    let reasons = |script: &str, faults: &str| {
        let (run, trace) = run_on(&machine().replace("[-50, 500]", "[-1, 500]"), faults, script, &[]);
        let rejected = run.events.iter().filter(|event| event["event"] == "command_rejected");
        let reasons: Vec<String> = rejected.map(|event| event["reason"].to_string()).collect();
        (reasons, trace.last().expect("a trace").counts)
    };
    let (far, _) = reasons("at 3s shift 8 7\n", "lose@20");
    assert!(far.len() == 1 && far[0].contains("shift_max_mm"), "{far:?}");
    // the lowest Y is -1 mm
    let (beyond, ends) = reasons("at 3s shift 2 -4\nafter 0.1s recover\nat 9s hold\n", "lose@20");
    assert!(beyond.len() == 1 && beyond[0].contains("axis Y would go beyond its soft limit"), "{beyond:?}");
    assert!(ends[1] == 0 && ends[0] < 30 * 200, "{ends:?}");
    // it has not started: nothing is interrupted
    let (early, ends) = reasons("at 6s shift 1 1\nafter 0.1s recover\n", "no-start=1");
    assert!(early.len() == 1 && early[0].contains("no cut is interrupted here"), "{early:?}");
    assert_eq!(ends, [2000, 0, 0]);
    let (moving, _) = reasons("at 1s shift 1 1\n", "");
    assert!(moving.len() == 1 && moving[0].contains("at rest"), "{moving:?}");
}

/// In single block the machine rests at the end of the block, also behind a recovery and a lead-in.
/// Where the program stands, at M0 or behind a single block, the path is retraced as in a hold; the program stands at
/// the same place again, and goes on with the next word.
#[test]
fn where_the_program_stands_the_path_is_retraced() {
    let stops = [("", "G0 X0\nM0\nM2\n"), ("at line 9 single\nafter 5s ", "G0 X0\nG0 Y10\nM2\n")];
    for (single, end) in stops {
        let bench = Bench::new();
        let program = bench.file("part.ngc", PROGRAM.replace("G0 X0\nM2\n", end));
        let (machine, vcd) = (bench.file("m.toml", machine()).display().to_string(), bench.path("pins.vcd"));
        let begin = if single.is_empty() { "at line 10 override 100%\nafter 5s " } else { single };
        let script = format!(
            "{begin}reverse 100%\nafter 1.5s hold\nafter 1s leave\nafter 5s cycle start\nafter 5s cycle start\n"
        );
        let (operator, trace) = (bench.file("s.op", script).display().to_string(), vcd.display().to_string());
        let run = Run::of(&bench, &program, &["--machine", &machine, "--vcd", &trace, "--operator", &operator]);
        assert_eq!(run.report["outcome"], "completed", "{} {}", run.output.err, run.output.out);
        assert_eq!(run.report["reversals"], 2, "{}", run.report);
        let trace = samples(&vcd);
        let back = trace.iter().filter(|now| now.rate < 0.0);
        assert!(back.clone().count() > 500, "it moves back");
        assert!(trace.iter().all(|now| now.rate >= 0.0 || !now.is_on("spindle")));
    }
}

#[test]
fn in_single_block_a_recovered_cut_ends_with_its_block() {
    let (_, uninterrupted) = run("", "", &[]);
    for shift in ["", "after 0s shift 0 4\n"] {
        let script = format!("at 2.5s single\nafter 0.5s back 15 mm\nafter 3s hold\n{shift}after 0.5s cut\n");
        let (run, trace) = run("lose@20", &script, &[]);
        // line 4 ends at X70
        assert_eq!(run.counts(), [14_000, 0, 0], "{}", run.output.out);
        assert_eq!(run.of_kind("single_block").count(), 1, "{}", run.output.out);
        let judged = JudgedMachine { has_lead_ins: true, ..JUDGED };
        let verdict = judge(&uninterrupted, &trace, &judged);
        assert_eq!((verdict.wrong_counts, verdict.too_early, verdict.backward), (0, 0, 0), "{verdict:?}");
    }
}

/// Each stop inside a contour would cost a pierce: a step ends before the torch is lit and after it is switched off.
#[test]
fn in_single_block_one_step_is_the_whole_contour() {
    let program = "G21 G90 F1800\nG0 X10\nM3 S1\nG1 X30\nG1 X40 Y10\nG4 P0.2\nM5\nG0 X100\nM3\nG1 X120\nG1 X130 Y5\n\
                   M5\nG0 X0\nM2\n";
    let bench = Bench::new();
    let program = bench.file("p.ngc", program);
    let steps = |machine: &str, starts: usize| {
        let vcd = bench.path("pins.vcd");
        let script = "at 0s single\n".to_string() + &"after 6s cycle start\n".repeat(starts);
        let (machine, operator) = (bench.file("m.toml", machine), bench.file("s.op", script));
        let [machine, operator, trace] = [&machine, &operator, &vcd].map(|path| path.display().to_string());
        let run = Run::of(&bench, &program, &["--machine", &machine, "--operator", &operator, "--vcd", &trace]);
        let ends: Vec<u64> = run.of_kind("single_block").filter_map(|event| event["line"].as_u64()).collect();
        let lit = samples(&vcd).windows(2).filter(|pair| !pair[0].is_on("spindle") && pair[1].is_on("spindle")).count();
        (ends, lit, run.report["outcome"].clone(), run.report["not_cut_mm"].clone())
    };
    assert_eq!(steps(&machine(), 4), (vec![2, 5, 8, 11], 2, "completed".into(), 0.0.into()));
    let in_blocks = machine().replace("kind = \"torch\"", "kind = \"torch\"\nsingle_block = \"block\"");
    let (ends, _, outcome, _) = steps(&in_blocks, 1);
    assert_eq!(
        (&ends[..], outcome),
        (&[2][..], "stopped".into()),
        "the pierce is part of the step, and it stops in the cut"
    );
}

/// The torch pierces beside the path and leads in to it; from the join on it is the path.
#[test]
fn a_shifted_restart_pierces_beside_the_path_and_leads_in_to_it() {
    let (whole, uninterrupted) = run("", "", &[]);
    for (shift, mm) in [("shift 3 -4", [3.0, -4.0]), ("shift n\nafter 0.1s shift nw", [-1.5, 3.0])] {
        let (run, trace) = run("lose@20", &format!("at 3s {shift}\nafter 0.1s recover\n"), &[]);
        let what = format!("{shift}\n{}", run.output.out);
        assert_ends_as(&run, &whole);
        let verdict = judge(&uninterrupted, &trace, &JudgedMachine { has_lead_ins: true, ..JUDGED });
        assert!(verdict.is_good(), "{verdict:?} {what}");
        let on_the_path = judge(&uninterrupted, &trace, &JUDGED);
        assert!(on_the_path.cut_besides > 50 && on_the_path.wrong_counts > 0, "{on_the_path:?}");
        assert_eq!(verdict.ignitions, 3, "{what}");
        assert_eq!(run.audit().violations, [0; 3], "{what}");
        // it pierces at the shifted place, 1 mm before the end of the cut at X30
        let lit = |pair: &&[Sample]| !pair[0].is_on("spindle") && pair[1].is_on("spindle");
        let pierces: Vec<[f64; 2]> =
            trace.windows(2).filter(lit).map(|pair| [0, 1].map(|axis| pair[1].counts[axis] as f64 / 200.0)).collect();
        let off = [pierces[1][0] - 29.0 - mm[0], pierces[1][1] - mm[1]];
        assert!(off[0].abs() < 0.06 && off[1].abs() < 0.01, "{pierces:?}");
        assert!(run.events.iter().any(|event| event["event"] == "joined"), "{what}");
    }
}

fn with_lowest_y(mm: f64) -> String {
    let text = machine();
    let (x, rest) = text.split_at(text.find("name = \"y\"").expect("an axis Y"));
    x.to_owned() + &rest.replacen("[-50, 500]", &format!("[{mm}, 500]"), 1)
}

/// The arc ends in the path's direction, which is joined in motion, within the limits; a hold on it changes nothing.
#[test]
fn a_shifted_restart_leads_in_along_an_arc() {
    let (whole, uninterrupted) = run("", "", &[]);
    for (shift, more) in
        [("-3 -4", ""), ("0 3", ""), ("-1 -1.5", "after 1.15s hold\nafter 1s shift -1 2\nafter 0.1s recover\n")]
    {
        let script = format!("at 2.9s lead arc\nat 3s shift {shift}\nafter 0.1s recover\n{more}");
        let (run, trace) = run("lose@20", &script, &[]);
        let what = format!("{shift}\n{}", run.output.out);
        assert_ends_as(&run, &whole);
        let verdict = judge(&uninterrupted, &trace, &JudgedMachine { has_lead_ins: true, ..JUDGED });
        let ignitions = if more.is_empty() { 3 } else { 4 };
        assert!(verdict.is_good() && verdict.ignitions == ignitions, "{verdict:?} {what}");
        assert_eq!(run.audit().violations, [0; 3], "{:?} {what}", run.audit().first);
        // it joins at X29 along X
        let join = trace.iter().rposition(|s| s.is_on("spindle") && s.counts[1] != 0).expect("a lead-in") + 1;
        assert!((trace[join].counts[0] - 29 * 200).abs() <= 60, "{:?} {what}", trace[join].counts);
        assert!(trace[join].rate >= 0.5 && !trace[join].at_rest, "{} {what}", trace[join].rate);
        let turned = [0, 1].map(|axis| (trace[join].counts[axis] - trace[join - 20].counts[axis]).abs());
        assert!(turned[0] > 3 * turned[1], "{turned:?} {what}");
    }
    let (run, _) = run("lose@20", "at 3s lead arc\nafter 0s shift 3 4\nafter 0.1s recover\nat 9s hold\n", &[]);
    let rejected = rejections(&run);
    assert!(rejected.len() == 1 && rejected[0].contains("`shift 0.000 5.000`"), "{rejected:?}");
    // start and join are within the limits of Y, the lowest part of the arc is not
    let program = "G21 G90 F1800\nG0 X10 Y20\nM3 S1\nG1 X30\nG1 Y60\nM5\nM2\n";
    for (low_mm, is_refused) in [(19.9, true), (18.0, false)] {
        let bench = Bench::new();
        let machine = with_lowest_y(low_mm);
        let (program, machine) = (bench.file("part.ngc", program), bench.file("m.toml", machine));
        let operator = bench.file("s.op", "at 4s lead arc\nafter 0s shift -4 -0.5\nafter 0.1s recover\nat 14s hold\n");
        let [machine, operator] = [machine, operator].map(|path| path.display().to_string());
        let arguments = ["--machine", &machine, "--source-faults", "lose@22.2", "--operator", &operator];
        let run = Run::of(&bench, &program, &arguments);
        let rejected = rejections(&run).iter().any(|why| why.contains("axis Y would go beyond"));
        assert_eq!(rejected, is_refused, "{low_mm} {}", run.output.out);
    }
}

/// The side of a shifted start is told; with G41 and G42 it is known to be part or scrap, and the part is asked about.
#[test]
fn a_start_on_the_side_of_the_part_is_confirmed() {
    for (code, toward) in [("G41.1 D1", ["scrap", "part"]), ("G42.1 D1", ["part", "scrap"]), ("G40", ["", ""])] {
        for (y_mm, (side, toward)) in [(3, ("left", toward[0])), (-3, ("right", toward[1]))] {
            let bench = Bench::new();
            let program = format!("G21 G90 F1800\nG0 X10 Y20\nM3 S1\n{code}\nG1 X20\nG1 X60\nG40\nG1 X70\nM5\nM2\n");
            let (program, machine) = (bench.file("part.ngc", program), bench.file("m.toml", with_lowest_y(-50.0)));
            let shift = format!("shift 0 {y_mm}\n");
            let script = format!("at 4s {shift}after 0.1s {shift}after 0.1s recover\n");
            let operator = bench.file("s.op", &script);
            let [machine, operator] = [machine, operator].map(|path| path.display().to_string());
            let arguments = ["--machine", &machine, "--source-faults", "lose@30", "--operator", &operator];
            let run = Run::of(&bench, &program, &arguments);
            let what = format!("{code} {y_mm}: {}", run.output.out);
            assert_eq!((&run.report["outcome"], run.number("not_cut_mm")), (&"completed".into(), 0.0), "{what}");
            let rejected = rejections(&run);
            assert_eq!(rejected.len(), usize::from(toward == "part"), "{what}");
            assert!(rejected.iter().all(|why| why.contains("side of the part")), "{what}");
            let told = run.of_kind("shift").next().expect("a shift");
            assert_eq!((&told["side"], told["toward"].as_str().unwrap_or("")), (&side.into(), toward), "{what}");
        }
    }
}

/// The torch is to pierce in its kerf, and does not start: another shift there moves the start.
#[test]
fn a_start_that_fails_beside_the_path_is_shifted_again() {
    let (whole, uninterrupted) = run("", "", &[]);
    for lead in ["line", "arc"] {
        let script = format!("at 2.9s lead {lead}\nat 3s shift -3 0\nafter 0.1s recover\n");
        let again = "after 7s shift 0 4\nafter 0.1s recover\n";
        let (run, trace) = run("lose@20", &(script + again), &[]);
        let what = format!("{lead} {}", run.output.out);
        assert_ends_as(&run, &whole);
        assert_eq!(with_reason(&run, "not_started").len(), 1, "{what}");
        let verdict = judge(&uninterrupted, &trace, &JudgedMachine { has_lead_ins: true, ..JUDGED });
        assert!(verdict.is_good(), "{verdict:?} {what}");
        let pierced = trace.iter().any(|sample| sample.is_on("spindle") && sample.counts[1] == 800);
        assert!(pierced && run.audit().violations == [0; 3], "{what}");
        // and back on the path, where it starts in motion
        let on_the_path = script_on_the_path(lead);
        let (run, _) = self::run("lose@20", &on_the_path, &[]);
        assert_ends_as(&run, &whole);
    }
}

fn script_on_the_path(lead: &str) -> String {
    let begin = format!("at 2.9s lead {lead}\nat 3s shift -3 0\nafter 0.1s recover\nafter 7s shift 0\n");
    begin + "after 0.1s recover\nafter 6s back to pierce\nafter 4s cut moving\n"
}

/// Over the kerf of the contour, on the path or beside it; not where the sheet is whole.
#[test]
fn a_pierce_in_a_kerf_is_warned_of() {
    for (lost, shift, warnings) in [
        ("lose@20", "shift -6 0.5", 1),
        ("lose@20", "shift -3 2", 0),
        ("lose@20", "shift 0 0.7", 1),
        ("lose@20", "shift 0 0.8", 0),
    ] {
        let script = format!("at 3s {shift}\nafter 0.1s recover\nat 9s stop\n");
        let (run, _) = run(lost, &script, &[]);
        assert_eq!(run.of_kind("start_in_kerf").count(), warnings, "{shift} {}", run.output.out);
    }
    let pierces = "at 3s back to cut end\nafter 3s cut pierce\nat 12s stop\n";
    assert_eq!(run("lose@20", pierces, &[]).0.of_kind("start_in_kerf").count(), 1);
    assert_eq!(run("lose@20", &pierces.replace("cut pierce", "cut"), &[]).0.of_kind("start_in_kerf").count(), 0);
}

#[test]
fn a_welded_contact_is_an_alarm_before_anything_is_lit() {
    let (run, trace) = run("welded", "", &[]);
    assert!(run.report["alarms"][0].as_str().is_some_and(|alarm| alarm.starts_with("E3022")), "{}", run.report);
    assert!(trace.iter().all(|sample| !sample.is_on("spindle")));
}

#[test]
fn a_source_that_does_not_go_out_is_told() {
    let (run, _) = run("stays-on", "", &[]);
    assert!(run.report["alarms"][0].as_str().is_some_and(|alarm| alarm.starts_with("E3023")), "{}", run.report);
}

#[test]
fn flickers_of_the_contact_are_no_loss() {
    let (run, trace) = run("flicker-per-m=300,flicker-ms=8,seed=5", "", &[]);
    assert_eq!(run.report["outcome"], "completed");
    let flickers = trace.windows(2).filter(|pair| pair[0].inputs != 0 && pair[1].inputs == 0).count();
    assert!(flickers > 10, "{flickers}");
    // the input goes inactive once more behind each of the two cuts, with the torch off
    assert_eq!(run.number("cutter_flickers"), (flickers - 2) as f64);
    let lit_us: u64 = trace.windows(2).filter(|p| p[0].is_on("spindle")).map(|p| p[1].at_us - p[0].at_us).sum();
    assert!((run.number("lit_s") - lit_us as f64 / 1e6).abs() < 0.01, "{lit_us}");
    assert!(with_reason(&run, "lost").is_empty());
    // nothing but a count: the cut is whole
    assert_eq!((run.number("not_cut_mm"), run.number("contours_not_cut")), (0.0, 0.0));
    let cut_mm = |run: &Run| run.of_kind("contour").filter_map(|event| event["cut_mm"].as_f64()).collect::<Vec<f64>>();
    assert_eq!(cut_mm(&run), cut_mm(&self::run("", "", &[]).0));
}

/// Where the operator confirms the outputs, the torch pierces where the machine came to rest.
#[test]
fn what_is_not_cut_is_told() {
    let (run, trace) = run("lose@20", "at 3s resume\nafter 1s agree\n", &[]);
    assert_eq!(run.report["outcome"], "completed");
    let not_cut = run.report["not_cut_mm"].as_f64().expect("a length");
    let rests = trace.iter().find(|sample| sample.at_us > 2_500_000).expect("a sample").counts[0] as f64 / 200.0;
    assert!((not_cut - (rests - 30.0)).abs() < 0.2 && not_cut > 0.5, "{not_cut} {rests}");
    assert!(run.events.iter().any(|event| event["event"] == "not_cut"));
    let contours: Vec<(u64, bool)> = run
        .of_kind("contour")
        .map(|event| (event["number"].as_u64().expect("a number"), event["not_cut_mm"] == 0.0))
        .collect();
    assert_eq!(contours, [(1, false), (2, true)]);
    assert_eq!((&run.report["contours"], &run.report["contours_not_cut"]), (&2.into(), &1.into()));
}

#[test]
fn the_operator_goes_to_the_end_of_the_cut_and_cuts_from_there() {
    let (_, uninterrupted) = run("", "", &[]);
    let script = "at 3s back to cut end\nafter 2s cut\nat 12s back to pierce\n";
    let (run, trace) = run("lose@20", script, &[]);
    assert_eq!(run.report["outcome"], "completed");
    assert!(judge(&uninterrupted, &trace, &JUDGED).is_good());
    assert!(run.output.out.contains("cut_from_here"));
}

/// One key, read off the screen.
#[test]
fn at_the_screen_an_interrupted_cut_takes_one_key() {
    let bench = Bench::new();
    let (program, machine) = (bench.file("part.ngc", PROGRAM), bench.file("m.toml", machine()));
    let [program, machine] = [program, machine].map(|path| path.display().to_string());
    let arguments = ["run", &program, "--tui", "--machine", &machine, "--source-faults", "lose@20"];
    let mut terminal = Terminal::running(&arguments, 80, 24);
    terminal.wait_for_text("READY");
    terminal.keys("c");
    let interrupted = terminal.wait_for_text("CUT INTERRUPTED");
    assert!(interrupted.contains("went out in line 4") && interrupted.contains("k recover"), "{interrupted}");
    terminal.keys("k");
    let end = terminal.wait_for_text("ENDED");
    assert!(end.contains("completed"), "{end}");
    terminal.keys("q");
    assert_eq!(terminal.wait_for_end(), Some(0));
}

/// A shift is typed, and `k` pierces there.
#[test]
fn at_the_screen_the_start_of_the_cut_is_shifted() {
    let bench = Bench::new();
    let mut terminal = at_the_screen(&bench, &machine(), "lose@20");
    terminal.wait_for_text("CUT INTERRUPTED");
    terminal.keys("D");
    terminal.wait_for_text("Start of the cut beside the path");
    terminal.keys("2,nowhere\r");
    terminal.wait_for_text("! enter X and Y in mm");
    terminal.keys(&"\u{7f}".repeat(9));
    terminal.keys("1,4\r");
    terminal.wait_for_text("X+1.000 Y+4.000 mm beside the path");
    terminal.keys("k");
    terminal.wait_for_text("the lead-in has joined the path");
    let end = terminal.wait_for_text("ENDED");
    assert!(end.contains("completed"), "{end}");
    terminal.keys("q");
    assert_eq!(terminal.wait_for_end(), Some(0));
}

/// The last contour is cut again while the part is still clamped.
#[test]
fn at_the_screen_a_contour_is_cut_again_after_the_end_of_the_program() {
    let bench = Bench::new();
    // without an input, so that it burns in the kerf as well
    let mut terminal = at_the_screen(&bench, &machine().replace("ok = { input = 5 }\n", ""), "");
    terminal.wait_for_text("ENDED");
    terminal.keys("j");
    terminal.wait_for_text("at the target of the reverse run");
    terminal.keys("K");
    terminal.wait_for_text("RUNNING");
    let end = terminal.wait_for_text("ENDED");
    assert!(end.contains("completed") && end.contains("X       0.000"), "{end}");
    terminal.keys("q");
    assert_eq!(terminal.wait_for_end(), Some(0));
}

fn at_the_screen(bench: &Bench, machine: &str, faults: &str) -> Terminal {
    let (program, machine) = (bench.file("part.ngc", PROGRAM), bench.file("m.toml", machine));
    let [program, machine] = [program, machine].map(|path| path.display().to_string());
    let arguments = ["run", &program, "--tui", "--machine", &machine, "--source-faults", faults];
    let terminal = Terminal::running(&arguments, 80, 24);
    terminal.wait_for_text("READY");
    terminal.keys("c");
    terminal
}

fn rejections(run: &Run) -> Vec<&str> {
    let rejected = run.events.iter().filter(|event| event["event"] == "command_rejected");
    rejected.filter_map(|event| event["reason"].as_str()).collect()
}

/// The operator goes back into a contour that is whole: the arc would find no metal there, and the job would stand in
/// its kerf.
#[test]
fn a_contour_that_is_cut_to_its_end_is_cut_again_only_at_the_second_word() {
    let back = "at 2.9s hold\nafter 0.5s back to pierce\nafter 4s cut moving\n";
    let (whole, uninterrupted) = run("", "", &[]);
    let (run_on, trace) = run("", &format!("{back}after 0.1s recover\n"), &[]);
    let rejected = rejections(&run_on);
    assert!(rejected.len() == 1 && rejected[0].contains("once more"), "{rejected:?}");
    assert_ends_as(&run_on, &whole);
    let verdict = judge(&uninterrupted, &trace, &JUDGED);
    assert!(verdict.is_good() && verdict.ignitions == 2, "{verdict:?}");
    // it is tried all the same, finds no metal, and the rest of the contour is passed with the torch off
    let tried = format!("{back}after 0.1s cut moving\nafter 5s recover\n");
    let (again, trace) = run("", &tried, &[]);
    assert_eq!((rejections(&again).len(), with_reason(&again, "lost").len()), (1, 1), "{}", again.output.out);
    assert_ends_as(&again, &whole);
    let verdict = judge(&uninterrupted, &trace, &JUDGED);
    assert!(verdict.is_good() && verdict.ignitions == 3, "{verdict:?}");
}

/// The torch is put out while it starts: the machine is at the pierce already, and not at that of the contour before.
#[test]
fn back_to_pierce_stays_at_the_contour_whose_start_was_interrupted() {
    let (whole, _) = run("", "", &[]);
    let second = whole.events.iter().filter(|event| event["event"] == "switching" && event["code"] == "M3").nth(1);
    let at_s = second.expect("a second contour")["time_s"].as_f64().expect("a time") + 0.02;
    let (run, trace) = run("", &format!("at {at_s:.3}s cutter off\nafter 1s back to pierce\nafter 1s recover\n"), &[]);
    let rejected = rejections(&run);
    assert!(rejected.len() == 1 && rejected[0].contains("at the pierce"), "{rejected:?}");
    assert!(trace.iter().all(|sample| sample.rate >= 0.0), "it does not go back");
    assert_ends_as(&run, &whole);
}

#[test]
fn a_word_that_does_not_apply_is_answered() {
    let (run, _) = run("", "at 0.5s cut\nafter 0s back to cut end\n", &[]);
    let reasons = rejections(&run);
    assert_eq!(reasons.len(), 2, "{reasons:?}");
    assert!(reasons[0].contains("go back first") && reasons[1].contains("no cut was interrupted"), "{reasons:?}");
    assert_eq!(run.report["outcome"], "completed");
}

#[test]
fn a_fault_of_a_source_that_there_is_not_is_refused() {
    let bench = Bench::new();
    let program = bench.file("part.ngc", PROGRAM);
    let arguments = ["run", &program.display().to_string(), "--source-faults", "lose"];
    let result = bench.retrace(arguments);
    assert_eq!(result.code, Some(2));
    assert!(result.err.contains("E2154") && result.err.contains("lose@MM"), "{}", result.err);
}

/// Numbers of the contours as they ended, and what is not cut of each, mm.
fn contours(run: &Run) -> Vec<(u64, f64)> {
    let told = run.of_kind("contour");
    told.filter_map(|event| Some((event["number"].as_u64()?, event["not_cut_mm"].as_f64()?))).collect()
}

/// The rest of a contour, or a contour whose cutter does not start, is passed with the torch off; the next one is cut.
#[test]
fn a_contour_is_skipped_and_the_next_one_is_cut() {
    let (whole, _) = run("", "", &[]);
    for script in ["at 3s skip contour\n", "at 3s back 5 mm\nafter 2s skip contour\nafter 0.1s hold\nafter 1s resume\n"]
    {
        let (run, trace) = run("lose@20", script, &[]);
        assert_ends_as(&run, &whole);
        let ended = contours(&run);
        assert!(ended.len() == 2 && (ended[0].1 - 40.0).abs() < 0.2 && ended[1] == (2, 0.0), "{script}: {ended:?}");
        let lit = trace.windows(2).filter(|pair| !pair[0].is_on("spindle") && pair[1].is_on("spindle")).count();
        assert_eq!((lit, run.audit().violations), (2, [0; 3]), "{script}");
        let dark = trace.iter().filter(|sample| (40.0 * 200.0..69.0 * 200.0).contains(&(sample.counts[0] as f64)));
        assert!(dark.filter(|sample| sample.rate > 0.0).all(|sample| !sample.is_on("spindle")), "{script}");
    }
    let (run, trace) = run("no-start=1", "at 6s skip contour\nafter 10s skip contour\n", &[]);
    assert_ends_as(&run, &whole);
    let ended = contours(&run);
    assert!(ended.len() == 2 && ended.iter().all(|(_, mm)| (mm - 60.0).abs() < 0.2), "{ended:?}");
    assert!(trace.iter().all(|sample| !sample.is_on("spindle") || sample.at_rest), "no feed with the torch on");
    // nothing is skipped where nothing is cut
    let (run, _) = self::run("", "at 0.1s hold\nafter 0.5s skip contour\nafter 0.1s resume\n", &[]);
    assert!(run.of_kind("command_rejected").any(|event| event["reason"] == "no contour is being cut"));
}

/// A cut that is lost close to the end of its contour counts as done, and what is missing is told.
#[test]
fn a_loss_close_to_the_end_of_a_contour_is_passed() {
    let machine = machine().replace("pierce_s = 0.4 }", "pierce_s = 0.4 }\nrestart = { lost_at_end_mm = 3.0 }");
    let (whole, _) = run("", "", &[]);
    let (run, trace) = run_on(&machine, "lose@58", "", &[]);
    assert_ends_as(&run, &whole);
    let ended = contours(&run);
    assert!(ended.len() == 2 && (ended[0].1 - 2.0).abs() < 0.2 && ended[1] == (2, 0.0), "{ended:?}");
    assert_eq!(run.report["cut_interruptions"], 1);
    assert!(trace.last().is_some_and(|sample| !sample.is_on("spindle")));
    let (run, _) = run_on(&machine, "lose@56", "at 6s stop\n", &[]);
    assert_eq!((&run.report["outcome"], contours(&run).len()), (&"stopped".into(), 0), "4 mm are to be cut");
}

/// A refused *cut* is confirmed by the very next word, and not by one that is said much later at the same place.
#[test]
fn a_refused_cut_is_confirmed_by_the_next_word_only() {
    let script =
        "at 3s back 0.1 mm\nafter 1s cut moving\nafter 0.2s hold\nafter 0.2s cut moving\nafter 0.2s cut moving\n";
    let (run, _) = run("lose@20", script, &[]);
    let refused = run.of_kind("command_rejected").filter_map(|event| event["reason"].as_str());
    let refused: Vec<&str> = refused.filter(|why| why.contains("ends before this place")).collect();
    assert_eq!((refused.len(), run.of_kind("cut_from_here").count()), (2, 1), "{}", run.output.out);
}

/// Runs a program on the machine of these tests.
fn run_program(program: &str, faults: &str, script: &str) -> (Run, Trace) {
    let bench = Bench::new();
    let (program, vcd) = (bench.file("part.ngc", program), bench.path("pins.vcd"));
    let (machine, operator) = (bench.file("m.toml", machine()), bench.file("s.op", script));
    let [machine, operator, trace] = [&machine, &operator, &vcd].map(|path| path.display().to_string());
    let arguments = ["--machine", &machine, "--vcd", &trace, "--source-faults", faults, "--operator", &operator];
    let run = Run::of(&bench, &program, &arguments);
    (run, Trace { samples: samples(&vcd), vcd, _bench: bench })
}

/// Losses in three of ten contours are skipped; behind the last one, the rest of them is cut, each with one start.
#[test]
fn the_rest_of_three_of_ten_contours_is_cut() {
    let cut = |n: u32| format!("G0 X{}\nM3\nG1 X{}\nM5\n", 10 + 45 * n, 50 + 45 * n);
    let program = format!("G21 G90 F1800\n{}G0 X0\nM2\n", (0..10).map(cut).collect::<String>());
    let (whole, uninterrupted) = run_program(&program, "", "");
    let skips = "at 3s skip contour\nat 11s skip contour\nat 21s skip contour\n";
    let script =
        format!("{skips}at line 42 override 100%\nafter 0.1s hold\nafter 2s back to contour 1\nafter 25s cut\n");
    let (rest, trace) = run_program(&program, "lose@20,lose@80,lose@170", &script);
    let what = &rest.output.out;
    assert_ends_as(&rest, &whole);
    let verdict = judge(&uninterrupted, &trace, &JUDGED);
    assert!(verdict.is_good(), "{verdict:?} {what}");
    assert_eq!((verdict.ignitions, rest.audit().violations), (10 + 3, [0; 3]), "{what}");
    assert_eq!((&rest.report["not_cut_mm"], with_reason(&rest, "lost").len()), (&0.0.into(), 3), "{what}");
    // the run-in burns for 5 mm in the kerf, and is dark to the source's map of the sheet
    assert!(verdict.cut_mm < 10.0 * 40.0 + 3.0, "{verdict:?}");
}

/// Losses in two of four contours are skipped; then the rest of them is cut, from the first on: what is cut already is
/// passed with the torch off, and each rest is started once.
#[test]
fn the_rest_of_several_contours_is_cut_in_one_go() {
    let cut = |x: u32| format!("G0 X{x}\nM3\nG1 X{}\nM5\n", x + 40);
    let program = format!("G21 G90 F1800\n{}{}{}{}G0 X0\nM2\n", cut(10), cut(70), cut(130), cut(190));
    let run = |faults: &str, script: &str| run_program(&program, faults, script);
    let (whole, uninterrupted) = run("", "");
    // lost in the first and in the third contour, and in the fourth a hold
    let losses = "at 3s skip contour\nafter 6s skip contour\nat line 16 override 100%\nafter 0.3s hold\n";
    let (rest, trace) = run("lose@20,lose@90", &format!("{losses}after 2s back to contour 1\nafter 6s cut\n"));
    let what = &rest.output.out;
    assert_ends_as(&rest, &whole);
    let verdict = judge(&uninterrupted, &trace, &JUDGED);
    assert!(verdict.is_good(), "{verdict:?} {what}");
    // four pierces, and three rests
    assert_eq!((verdict.ignitions, rest.audit().violations), (7, [0; 3]), "{what}");
    assert_eq!((&rest.report["not_cut_mm"], &rest.report["contours_not_cut"]), (&0.0.into(), &0.into()), "{what}");
    let starts: Vec<&str> = rest.of_kind("cut_from_here").filter_map(|event| event["start"].as_str()).collect();
    assert_eq!(starts, ["moving"; 3], "{what}");
}

/// The arc is lost twice in a contour and once in the next one, and each time the torch pierces where the machine came
/// to rest. Then only the gaps are cut, each with one start in motion.
#[test]
fn only_the_gaps_of_a_contour_are_cut() {
    let (whole, uninterrupted) = run("", "", &[]);
    let on = "resume\nafter 1s agree\n";
    let script = format!("at 3s {on}after 4s {on}after 9s {on}at line 10 override 100%\nafter 0.3s hold\n");
    let script = script + "after 2s back to contour 1\nafter 8s cut\n";
    let (run, trace) = run("lose@20,lose@35,lose@80", &script, &[]);
    let what = &run.output.out;
    assert_ends_as(&run, &whole);
    let verdict = judge(&uninterrupted, &trace, &JUDGED);
    // a torch that pierces where it came to rest is lit behind the end of its cut
    let verdict = Verdict { ignited_elsewhere: 0, good: true, ..verdict };
    assert!(verdict.is_good(), "{verdict:?} {what}");
    assert_eq!((with_reason(&run, "lost").len(), with_reason(&run, "kerf").len()), (3, 3), "{what}");
    assert_eq!((verdict.ignitions, run.audit().violations), (2 + 3 + 3, [0; 3]), "{what}");
    assert_eq!((&run.report["not_cut_mm"], &run.report["contours_not_cut"]), (&0.0.into(), &0.into()), "{what}");
}

#[test]
fn a_contour_is_gone_back_to_by_its_number_and_all_behind_it_are_cut_again_if_that_is_said() {
    let script = "at line 8 override 100%\nafter 0.5s hold\nafter 1s back to contour 7\n\
                  after 0.1s back to contour 1\nafter 6s";
    let (run, trace) = run("", &format!("{script} cut all\n"), &[]);
    assert!(run.of_kind("command_rejected").any(|e| e["reason"].as_str().is_some_and(|why| why.contains("number"))));
    let lit = trace.windows(2).filter(|pair| !pair[0].is_on("spindle") && pair[1].is_on("spindle")).count();
    // a torch finds no metal over the first kerf: it is tried three times, and the job waits
    assert_eq!((lit, run.of_kind("cut_from_here").count()), (2 + 3, 1), "{}", run.output.out);
}
