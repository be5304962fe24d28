//! A program is paused, the tool moved away and back: the job reaches its regular end, and no step out of order is
//! accepted.

use retrace_tests::command::Bench;
use retrace_tests::run::Run;

/// Edge of a pocket with the spindle on, arcs and corners, and outputs switched in motion.
const EDGE: &str = "G21 G90 G17 G64 P0.05\nG0 Z5\nT1 M6\nS12000 M3\nG0 X10 Y10\nG1 Z-2 F600\nG1 X40 F1500\nG3 X50 Y20 \
    J10 I0\n\
    G1 Y40\nM62 P3\nG1 X10\nG1 Y10\nM63 P3\nG0 Z5\nM5\nM2\n";

/// The sequence of the interface.
const SEQUENCE: &str =
    "after 0s spindle stop\nafter 1s jog z 10\nafter 1s spindle start\nafter 1s online\nafter 0s cycle start\n";

fn run(program: &str, script: &str) -> Run {
    let bench = Bench::new();
    let (program, script) = (bench.file("edge.ngc", program), bench.file("dnc.op", script));
    Run::of(&bench, &program, &["--operator", &script.to_string_lossy()])
}

fn count(run: &Run, kind: &str) -> usize {
    run.of_kind(kind).count()
}

fn refusals(run: &Run) -> Vec<String> {
    run.of_kind("command_rejected").map(|event| event["reason"].as_str().unwrap_or_default().to_owned()).collect()
}

#[test]
fn paused_anywhere_the_job_ends_at_the_counts_of_a_run_without_a_pause() {
    let plain = run(EDGE, "");
    assert_eq!(plain.output.code, Some(0), "{}", plain.output.err);
    for line in [2, 5, 6, 7, 8, 9, 11, 12] {
        let paused = run(EDGE, &format!("at line {line} pause\n{SEQUENCE}"));
        assert_eq!(paused.output.code, Some(0), "line {line}: {}\n{}", paused.output.err, paused.output.out);
        assert_eq!(paused.counts(), plain.counts(), "line {line}");
        assert_eq!(refusals(&paused).len(), if line < 5 { 2 } else { 0 }, "line {line}: {:?}", refusals(&paused));
        for kind in ["paused", "jogged", "online", "approaching", "arrived"] {
            assert_eq!(count(&paused, kind), 1, "line {line}: {kind}");
        }
        let at = |kind| paused.of_kind(kind).next().expect(kind).clone();
        let (left, back) = (at("paused"), at("arrived"));
        for same in ["record", "fraction", "line"] {
            assert_eq!(left[same], back[same], "line {line}: {same}");
        }
        assert_eq!(
            (&left["dnc_paused"], &left["mode_changed"], &left["inhibited"]),
            (&true.into(), &true.into(), &false.into())
        );
        assert_eq!(
            (&back["dnc_paused"], &back["mode_changed"], &back["inhibited"]),
            (&false.into(), &false.into(), &false.into())
        );
        assert_eq!(at("approaching")["inhibited"], true);
        assert_eq!(at("jogged")["off_breakpoint"][2], 10_000);
        assert!(paused.number("paused_s") > 3.0, "{}", paused.report);
        assert_eq!(paused.number("limit_violations"), 0.0, "{}", paused.report);
        assert!(paused.number("motion_s") >= plain.number("motion_s"));
    }
}

#[test]
fn paused_while_retracing_and_at_a_program_stop_it_goes_on_where_it_was() {
    let plain = run(EDGE, "");
    let script = format!("at line 9 reverse 60%\nafter 1s pause\n{SEQUENCE}after 4s leave\n");
    let back = run(EDGE, &script);
    assert_eq!(
        (back.output.code, back.counts()),
        (Some(0), plain.counts()),
        "{}\n{}",
        back.output.err,
        back.output.out
    );
    assert!((count(&back, "arrived"), refusals(&back).len()) == (1, 0), "{:?}", refusals(&back));
    assert!(back.number("retrace_s") > 2.0, "{}", back.report);

    let stops = EDGE.replace("G1 Y40\n", "G1 Y40\nM0\n");
    let script = format!("at 6s pause\n{SEQUENCE}after 4s resume\n");
    let stop = run(&stops, &script);
    assert_eq!(
        (stop.output.code, stop.counts()),
        (Some(0), plain.counts()),
        "{}\n{}",
        stop.output.err,
        stop.output.out
    );
    assert_eq!((count(&stop, "program_stop"), count(&stop, "arrived")), (1, 1), "{}", stop.output.out);
}

#[test]
fn a_pause_on_the_way_back_stops_the_axes_and_keeps_the_breakpoint() {
    let plain = run(EDGE, "");
    let script = "at line 7 pause\nafter 0s spindle stop\nafter 0s jog z 60\nafter 0s jog x 80\nafter 5s spindle \
        start\nafter 0s online\n\
        after 0s cycle start\nafter 0.4s spindle stop\nafter 0s pause\nafter 1s cycle start\nafter 0s spindle \
        stop\nafter 0s spindle start\n\
        after 0s online\nafter 0s cycle start\n";
    let run = run(EDGE, script);
    assert_eq!((run.output.code, run.counts()), (Some(0), plain.counts()), "{}\n{}", run.output.err, run.output.out);
    assert_eq!(
        (count(&run, "paused"), count(&run, "approaching"), count(&run, "arrived")),
        (2, 2, 1),
        "{}",
        run.output.out
    );
    let refusals = refusals(&run);
    assert!(
        refusals.len() == 2
            && refusals[0].contains("returning to the breakpoint")
            && refusals[1].contains("spindle stop"),
        "{refusals:?}"
    );
}

#[test]
fn a_jog_is_cut_short_at_the_soft_limit_and_said() {
    let run = run(EDGE, "at line 7 pause\nafter 0s jog z 9000\nafter 0s jog z 1\nafter 0s jog a 1\nafter 60s stop\n");
    let jogged: Vec<_> = run.of_kind("jogged").collect();
    assert_eq!(
        (jogged.len(), &jogged[0]["cut_short"], &jogged[0]["mm"]),
        (1, &true.into(), &2002.0.into()),
        "{}",
        run.output.out
    );
    let why = refusals(&run);
    assert!(why[0].contains("axis Z would go beyond") && why[1].contains("no axis A"), "{why:?}");
    assert_eq!(run.report["position_counts"]["z"], 2_000_000);
}

#[test]
fn another_program_in_the_place_of_the_first_is_refused() {
    let bench = Bench::new();
    let program = bench.file("edge.ngc", EDGE);
    let script = bench.file("dnc.op", format!("at line 7 pause\nafter 7s hold\n{SEQUENCE}after 2s stop\n"));
    // It is replaced during the pause, which is long in wall time.
    let replace = std::thread::spawn({
        let program = program.clone();
        move || {
            std::thread::sleep(std::time::Duration::from_millis(5000));
            std::fs::write(program, EDGE.replace("X40", "X41")).expect("written");
        }
    });
    let run = Run::of(&bench, &program, &["--realtime", "--no-tui", "--operator", &script.to_string_lossy()]);
    replace.join().expect("replaced");
    assert!(
        refusals(&run).iter().any(|why| why.contains("another program")),
        "{:?}\n{}",
        refusals(&run),
        run.output.out
    );
    assert_eq!((run.output.code, count(&run, "arrived")), (Some(4), 0), "{}", run.output.err);
}
