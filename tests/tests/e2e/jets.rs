//! A jet whose abrasive is switched with it (CUT-19), and the ends of contours that its material changes (CUT-13,
//! CUT-14), seen at the card's pins.
//!
//! Invariant: what is asserted comes from the trace of the pins alone.

use retrace_tests::command::{Bench, assert_contains};
use retrace_tests::pins::{Sample, samples};
use retrace_tests::run::Run;
use retrace_tests::sender::TestRandom;

/// Two cuts of 60 mm.
const PROGRAM: &str = "G21 G90 F1800\nG0 X10\nM3\nG1 X70\nM5\nG0 X100\nM3\nG1 X160\nM5\nG0 X0\nM2\n";
const PULSES: f64 = 200.0;

/// A jet on output 3, its abrasive on output 4.
fn machine(jet: &str) -> String {
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = {PULSES}\nmax_velocity_mm_per_s = 100\n\
             max_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-500, 500]\n"
        )
    };
    format!(
        "{}{}{}[[cutter]]\nname = \"jet\"\nkind = \"jet\"\nfire = 3\nabrasive = 4\nspindle = 0\n\
         materials = \"materials.toml\"\nok = {{ input = 5 }}\nstart = {{ start_s = 2.0, retry_s = 0.2 }}\n{jet}\n",
        axis("x"),
        axis("y"),
        axis("z")
    )
}

fn material(figures: &str) -> String {
    format!(
        "units = \"mm\"\ndefault = 1\n[[material]]\nnumber = 1\nname = \"Steel\"\nkerf_mm = 1\npierce_height_mm = 3\n\
         pierce_delay_s = 0.5\ncut_height_mm = 3\nfeed_mm_per_min = 1800\n{figures}\n"
    )
}

fn run(jet: &str, figures: &str, (faults, script): (&str, &str)) -> (Run, Vec<Sample>) {
    run_on(&machine(jet), figures, (faults, script))
}

fn run_on(machine: &str, figures: &str, (faults, script): (&str, &str)) -> (Run, Vec<Sample>) {
    let bench = Bench::new();
    bench.file("materials.toml", material(figures));
    let (machine, program) = (bench.file("m.toml", machine), bench.file("part.ngc", PROGRAM));
    let (vcd, operator) = (bench.path("pins.vcd"), bench.file("s.op", script));
    let [machine, trace, operator] = [&machine, &vcd, &operator].map(|path| path.display().to_string());
    let arguments = ["--machine", &machine, "--vcd", &trace, "--source-faults", faults, "--operator", &operator];
    (Run::of(&bench, &program, &arguments), samples(&vcd))
}

/// Time in s from the first sample for which `from` holds to the next one for which `to` does.
fn seconds(trace: &[Sample], from: impl Fn(&Sample) -> bool, to: impl Fn(&Sample) -> bool) -> f64 {
    let first = trace.iter().position(from).expect("the first one");
    let then = trace[first..].iter().find(|sample| to(sample)).expect("the other one");
    (then.at_us - trace[first].at_us) as f64 / 1e6
}

/// Abrasive only with water, and no motion with the abrasive before the pierce.
fn assert_never_dry(trace: &[Sample], delay_s: f64, told: &str) {
    let mut water_since = None;
    for pair in trace.windows(2) {
        let (before, now) = (&pair[0], &pair[1]);
        water_since = water_since.filter(|_| now.is_on("out3")).or(now.is_on("out3").then_some(now.at_us));
        assert!(!now.is_on("out4") || now.is_on("out3") || before.is_on("out3"), "{told}: {now:?}");
        if !before.is_on("out4") && now.is_on("out4") {
            let since = water_since.map_or(0.0, |since| (now.at_us - since) as f64 / 1e6);
            assert!(since >= delay_s - 1e-3, "{told}: abrasive {since} s behind the water");
        }
    }
}

/// Water, then abrasive, then the pierce; the abrasive off before the end, then water alone.
#[test]
fn the_abrasive_follows_the_water_and_ends_before_it() {
    let mut chance = TestRandom::new(19);
    for _ in 0..6 {
        let [delay_s, purge_s] = [0; 2].map(|_| chance.below(50) as f64 / 100.0);
        let lag_mm = chance.below(200) as f64 / 10.0;
        let jet = format!("jet = {{ abrasive_delay_s = {delay_s}, abrasive_lag_mm = {lag_mm}, purge_s = {purge_s} }}");
        let (run, trace) = run(&jet, "", ("", ""));
        run.assert_exact_and_legal();
        assert_never_dry(&trace, delay_s, &jet);
        let (water, abrasive) = (|sample: &Sample| sample.is_on("out3"), |sample: &Sample| sample.is_on("out4"));
        let moves = |sample: &Sample| water(sample) && sample.counts[0] > (10.0 * PULSES) as i64;
        assert!(seconds(&trace, water, abrasive) >= delay_s, "{jet}");
        let pierce_s = seconds(&trace, abrasive, moves);
        assert!((0.5..0.65).contains(&pierce_s), "{jet}: moves {pierce_s} s behind the abrasive");
        let last = trace.iter().position(moves).expect("it cuts");
        let ended = trace[last..].iter().find(|sample| !abrasive(sample)).expect("it goes off");
        let from_end_mm = 70.0 - ended.counts[0] as f64 / PULSES;
        assert!((from_end_mm - lag_mm).abs() < 0.1, "{jet}: {from_end_mm} mm");
        let at_end = |sample: &Sample| sample.counts[0] == (70.0 * PULSES) as i64;
        let purged_s = seconds(&trace[last..], at_end, |sample| !water(sample));
        assert!((purge_s..purge_s + 0.2).contains(&purged_s), "{jet}: {purged_s} s of water");
    }
}

/// Held, switched off by hand, or lost in the cut, and recovered; stopped: the abrasive is never on without water, and
/// comes back behind it with its delay and its pierce.
#[test]
fn the_abrasive_comes_back_behind_the_water() {
    let jet = "jet = { abrasive_delay_s = 0.2, abrasive_lag_mm = 4, purge_s = 0.3 }";
    for case in [
        ("", "at line 4 override 100%\nafter 1s hold\nafter 3s recover\n"),
        ("", "at line 4 override 100%\nafter 1s cutter off\nafter 3s recover\n"),
        ("lose@20", "at 5s recover\nafter 5s recover\n"),
        ("", "at line 4 override 100%\nafter 1s stop\n"),
    ] {
        let (run, trace) = run(jet, "", case);
        let ends = if case.1.contains("stop") { "stopped" } else { "completed" };
        assert_eq!(run.report["outcome"], ends, "{case:?} {}", run.output.err);
        assert_never_dry(&trace, 0.2, case.1);
        let lit_dry = trace.windows(2).filter(|pair| {
            let moves = pair[0].counts[0] != pair[1].counts[0];
            moves && pair[1].is_on("out3") && !pair[1].is_on("out4") && pair[1].at_rest
        });
        assert_eq!(lit_dry.count(), 0, "{case:?}");
        if ends == "completed" {
            assert_eq!(run.report["not_cut_mm"], 0.0, "{case:?}");
        }
    }
}

/// The jet is lost at 15 and at 25 mm of the first contour, and each time it pierces where the machine came to rest.
/// Then the gaps are cut: over a kerf up to `bridge_mm` the jet stays on, over a longer one it goes off, and the
/// machine goes back to the next gap (CUT-41).
#[test]
fn a_jet_stays_on_over_a_short_kerf_between_two_gaps() {
    let on = "resume\nafter 1s agree\n";
    let script = format!("at 3s {on}after 4s {on}at line 8 override 100%\nafter 0.3s hold\n");
    let script = script + "after 2s back to contour 1\nafter 8s cut\n";
    let water = |sample: &&[Sample]| !sample[0].is_on("out3") && sample[1].is_on("out3");
    for (bridge_mm, kerfs) in [(20, 1), (5, 2)] {
        let jet = format!("restart = {{ bridge_mm = {bridge_mm} }}");
        let machine = machine(&jet).replace("abrasive = 4\n", "");
        let (run, trace) = run_on(&machine, "", ("lose@15,lose@25", &script));
        let what = &run.output.out;
        let dark = run.of_kind("cutter_off").filter(|event| event["reason"] == "kerf").count();
        assert_eq!((&run.report["outcome"], dark), (&"completed".into(), kerfs), "{bridge_mm} {what}");
        // the second contour was begun, and its rest is cut, too
        assert_eq!(run.of_kind("cut_from_here").count(), kerfs + 1, "{bridge_mm} {what}");
        // two pierces of the program, two behind the losses, and one for each stretch that is cut again
        assert_eq!(trace.windows(2).filter(water).count(), 2 + 2 + kerfs + 1, "{bridge_mm} {what}");
        assert_eq!((&run.report["not_cut_mm"], &run.report["contours_not_cut"]), (&0.0.into(), &0.into()), "{what}");
    }
}

/// An abrasive that leads is on before the water by its time, and the pierce begins with the water.
#[test]
fn an_abrasive_that_leads_is_on_before_the_water() {
    let jet = "jet = { abrasive_lead_s = 0.3, abrasive_lag_mm = 4, purge_s = 0.2 }";
    let (water, abrasive) = (|sample: &Sample| sample.is_on("out3"), |sample: &Sample| sample.is_on("out4"));
    let moves = |sample: &Sample| water(sample) && sample.counts[0] > (10.0 * PULSES) as i64;
    let (whole, trace) = run(jet, "", ("", ""));
    whole.assert_exact_and_legal();
    let lead_s = seconds(&trace, abrasive, water);
    assert!((0.3..0.35).contains(&lead_s), "{lead_s} s");
    let flowing = |sample: &Sample| water(sample) && sample.inputs >> 5 & 1 == 1;
    let pierce_s = seconds(&trace, flowing, moves);
    assert!((0.5..0.65).contains(&pierce_s), "it moves {pierce_s} s behind the water");
    let begins_s = trace.iter().find(|sample| abrasive(sample)).expect("it leads").at_us as f64 / 1e6;
    // Held, stopped and switched off by hand while it leads, in the pierce and in the cut; lost in the cut.
    let mut cases = vec![("lose@20".to_owned(), "at 6s recover\nafter 5s recover\n".to_owned())];
    for delay_s in [0.05, 0.25, 0.32, 0.6, 1.5] {
        for script in
            ["hold\nafter 2s recover\nafter 3s recover", "cutter off\nafter 2s recover\nafter 3s recover", "stop"]
        {
            cases.push((String::new(), format!("at {}s {script}\n", begins_s + delay_s)));
        }
    }
    for (faults, script) in cases {
        let (run, trace) = run(jet, "", (&faults, &script));
        let ends = if script.contains("stop") { "stopped" } else { "completed" };
        assert_eq!(run.report["outcome"], ends, "{script} {}", run.output.out);
        assert!(trace.last().is_some_and(|sample| !water(sample) && !abrasive(sample)), "{script}");
        let mut dry_us = 0;
        for pair in trace.windows(2) {
            let is_dry = abrasive(&pair[0]) && !water(&pair[0]);
            dry_us = if is_dry { dry_us + pair[1].at_us - pair[0].at_us } else { 0 };
            assert!(dry_us <= 350_000, "{script}: abrasive without water at {} us", pair[1].at_us);
        }
        if ends == "completed" {
            assert_eq!((run.counts(), &run.report["not_cut_mm"]), (whole.counts(), &0.0.into()), "{script}");
        }
    }
}

/// At low pressure it pierces, and the feed begins at high pressure, as its input shows it; a jet that cuts at high
/// pressure throughout waits for it before its water. A restart does the same.
#[test]
fn a_jet_pierces_at_low_pressure_and_cuts_at_high() {
    let jet = "pressure = 6\njet = { pressure_input = 8, purge_s = 0.2 }";
    let (water, high) = (|sample: &Sample| sample.is_on("out3"), |sample: &Sample| sample.is_on("out6"));
    let is_high = |sample: &Sample| sample.inputs >> 8 & 1 == 1;
    for (figures, pierces_low) in [("low_pressure_pierce = true", true), ("", false)] {
        let (whole, _) = run(jet, figures, ("", ""));
        whole.assert_exact_and_legal();
        for script in [
            "",
            "at 4s hold\nafter 2s recover\nafter 3s recover\n",
            "at 4s cutter off\nafter 2s recover\nafter 3s recover\n",
        ] {
            let (run, trace) = run(jet, figures, ("", script));
            assert_eq!(
                (run.counts(), &run.report["not_cut_mm"]),
                (whole.counts(), &0.0.into()),
                "{script} {}",
                run.output.out
            );
            let mut openings = 0;
            for pair in trace.windows(2) {
                let (before, now) = (&pair[0], &pair[1]);
                let feeds = before.counts[0] != now.counts[0] && water(before) && water(now) && now.rate > 0.0;
                assert!(!feeds || is_high(now) || now.at_rest, "{script}: feeds at low pressure: {now:?}");
                if water(now) && !water(before) {
                    openings += 1;
                    assert_eq!((high(now), is_high(now)), (!pierces_low, !pierces_low), "{script}: {now:?}");
                }
                if high(now) && !high(before) && pierces_low {
                    assert!(water(now), "{script}: high pressure behind the pierce: {now:?}");
                }
            }
            assert_eq!(openings, if script.is_empty() { 2 } else { 3 }, "{script}");
            assert!(trace.last().is_some_and(|sample| !water(sample) && !high(sample)), "{script}");
            if pierces_low {
                let pierce_s = seconds(&trace, |sample| water(sample) && sample.inputs >> 5 & 1 == 1, high);
                assert!((0.5..0.6).contains(&pierce_s), "{pierce_s} s of pierce");
            }
        }
    }
}

/// The first millimetres are cut slowly, and the torch or the jet is off before the end; a report tells nothing as not
/// cut that was to be dark.
#[test]
fn a_material_changes_the_ends_of_its_contours() {
    let figures = "creep_percent = 50\ncreep_mm = 20\noff_before_mm = 5";
    let (run, trace) = run("", figures, ("", ""));
    run.assert_exact_and_legal();
    assert_eq!(run.report["not_cut_mm"], 0.0);
    let place = |mm: f64| move |sample: &Sample| sample.counts[0] >= (mm * PULSES) as i64;
    let creep_s = seconds(&trace, place(15.0), place(25.0));
    let cut_s = seconds(&trace, place(40.0), place(60.0));
    assert!((creep_s - 10.0 / 15.0).abs() < 0.01 && (cut_s - 20.0 / 30.0).abs() < 0.01, "{creep_s} s, {cut_s} s");
    let cuts = trace.iter().position(place(40.0)).expect("it cuts");
    let off = trace[cuts..].iter().find(|sample| !sample.is_on("out3")).expect("it goes off");
    assert!((70.0 - off.counts[0] as f64 / PULSES - 5.0).abs() < 0.1, "{off:?}");
}

/// A pierce in motion ends exactly where it began, is within the limits, and is retraced and recovered like the rest of
/// the contour.
#[test]
fn a_jet_pierces_in_motion() {
    let figures = "pierce_mm = 4\npierce_feed_mm_per_min = 600\nwiggle_mm = 3\nwiggles = 2\ncircle_mm = 2\ncircles = 2";
    for script in [
        "",
        "at 1.6s hold\nafter 2s recover\n",
        "at 2.5s cutter off\nafter 2s recover\n",
        "at 4s reverse 100%\nafter 3s forward 100%\nafter 4s recover\nafter 4s recover\n",
    ] {
        let (run, trace) = run("", figures, ("", script));
        run.assert_exact_and_legal();
        assert_eq!(run.report["not_cut_mm"], 0.0, "{script}: {}", run.output.out);
        let most = trace.iter().filter(|sample| sample.line == 4).map(|sample| sample.counts[1].abs()).max();
        assert_eq!(most, Some((2.0 * PULSES) as i64), "{script}: the circle");
    }
    // beyond the soft limits, refused before anything moves
    let bench = Bench::new();
    bench.file("materials.toml", material("circle_mm = 40\ncircles = 1"));
    bench.file("m.toml", machine("").replacen("travel_mm = [-500, 500]", "travel_mm = [-20, 500]", 1));
    bench.file("part.ngc", PROGRAM);
    let refused = bench.retrace(["run", "part.ngc", "--machine", "m.toml"]);
    assert_eq!(refused.code, Some(1), "{}", refused.err);
    assert_contains(&refused.err, &["E4304", "part.ngc:4"]);
}

#[test]
fn what_cannot_be_is_refused() {
    for (jet, figures, why) in [
        ("jet = { purge_s = 11 }", "", "jet.purge_s"),
        ("jet = { abrasive_lead_s = 11 }", "", "jet.abrasive_lead_s"),
        ("jet = { abrasive_lead_s = 1, abrasive_delay_s = 1 }", "", "exclude each other"),
        ("jet = { pressure_input = 8 }", "", "without `pressure`"),
        ("pressure = 6\njet = { pressure_input = 5 }", "", "another use"),
        ("", "off_before_mm = 3\nover_cut_mm = 2", "over_cut_mm"),
        ("", "creep_percent = 101", "creep_percent"),
    ] {
        let bench = Bench::new();
        bench.file("materials.toml", material(figures));
        bench.file("m.toml", machine(jet));
        bench.file("part.ngc", PROGRAM);
        let refused = bench.retrace(["run", "part.ngc", "--machine", "m.toml"]);
        assert_eq!(refused.code, Some(2), "{}", refused.err);
        assert_contains(&refused.err, &[why]);
    }
    for (from, to, why) in [
        ("kind = \"jet\"", "kind = \"torch\"", "without an abrasive"),
        ("spindle = 0\n", "", "without `spindle`"),
        ("materials = \"materials.toml\"\n", "", "without a material table"),
    ] {
        let bench = Bench::new();
        bench.file("m.toml", machine("jet = { abrasive_lag_mm = 3 }").replace(from, to));
        bench.file("part.ngc", PROGRAM);
        bench.file("materials.toml", material(""));
        let refused = bench.retrace(["run", "part.ngc", "--machine", "m.toml"]);
        assert_eq!(refused.code, Some(2), "{}", refused.err);
        assert_contains(&refused.err, &[why]);
    }
}
