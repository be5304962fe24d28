//! The power of a beam at the card's pins: constant with M3, by the speed with M4, 0 at rest and in rapid moves
//! (CUT-20).
//!
//! Invariant: the speed is that of the pulses in the trace; nothing is taken from the plan.

use retrace_tests::command::Bench;
use retrace_tests::pins::{Sample, samples};
use retrace_tests::run::Run;
use retrace_tests::served::ServedCard;

/// Pulses of an axis in 1 mm.
const PULSES: f64 = 2000.0;
/// S in the unit of the trace.
const S: f64 = 600_000.0;

/// A laser of S by M3 and M4, with these keys.
fn machine(power: &str) -> String {
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = {PULSES}\nmax_velocity_mm_per_s = 120\n\
             max_acceleration_mm_per_s2 = 2000\nmax_jerk_mm_per_s3 = 50000\ntravel_mm = [-500, 500]\n"
        )
    };
    format!(
        "path_velocity_mm_per_s = 120\n[[cutter]]\nname = \"laser\"\nkind = \"beam\"\nfire = 64\n{power}\n{}{}{}",
        axis("x"),
        axis("y"),
        axis("z")
    )
}

fn run(power: &str, program: &str, script: &str) -> (Run, Vec<Sample>) {
    let bench = Bench::new();
    let (machine, program) = (bench.file("m.toml", machine(power)), bench.file("part.ngc", program));
    let (vcd, operator) = (bench.path("pins.vcd"), bench.file("s.op", script));
    let [machine, trace, operator] = [&machine, &vcd, &operator].map(|path| path.display().to_string());
    let arguments = ["--machine", &machine, "--vcd", &trace, "--operator", &operator];
    (Run::of(&bench, &program, &arguments), samples(&vcd))
}

/// Way in mm and time in s between two samples.
fn step(pair: &[Sample]) -> (f64, f64) {
    let [x, y, z] = std::array::from_fn(|axis| (pair[1].counts[axis] - pair[0].counts[axis]) as f64 / PULSES);
    (x.hypot(y).hypot(z), (pair[1].at_us - pair[0].at_us) as f64 / 1e6)
}

/// Whether a sample is of one control period behind the one before.
fn is_period(pair: &[Sample]) -> bool {
    pair[1].at_us - pair[0].at_us == 1000
}

/// Energy in units of S · s, and the way in mm with the beam on.
fn energy(trace: &[Sample]) -> (f64, f64) {
    trace.windows(2).filter(|pair| pair[1].beam_power > 0.0 && is_period(pair)).fold((0.0, 0.0), |(sum, way), pair| {
        let (mm, s) = step(pair);
        (sum + pair[1].beam_power / S * s, way + mm)
    })
}

/// Never power at rest, never more than S, never without the beam.
fn assert_safe(trace: &[Sample], pierces: bool) {
    for pair in trace.windows(2) {
        let now = &pair[1];
        assert!((0.0..=S).contains(&now.beam_power), "{now:?}");
        assert!(now.beam_power == 0.0 || now.is_on("spindle"), "{now:?}");
        assert!(now.beam_power == 0.0 || now.rate != 0.0 || pierces, "power at rest: {now:?}");
    }
}

const CORNERS: &str = "G21 G90 G64 P0.01 F1500\nS600\nG0 X10\nM4\nG1 X30\nY20\nX10\nY0\nM5\nG0 X0\nM2\n";

/// With M4 each millimetre gets the same energy, in corners, in a hold and at any override.
#[test]
fn with_m4_the_power_follows_the_speed_in_every_period() {
    for script in ["", "at 1s override 40%\nat 2s hold\nafter 0.5s recover\n"] {
        let (run, trace) = run("power = {}", CORNERS, script);
        assert_eq!(run.report["outcome"], "completed", "{}", run.output.err);
        assert_safe(&trace, false);
        let feed = 25.0;
        let mut slow = 0;
        for pair in trace.windows(2).filter(|pair| is_period(pair) && pair[1].is_on("spindle")) {
            let (mm, s) = step(pair);
            let share = mm / s / feed;
            // a pulse of each axis is rounded at both ends
            let rounding = 1.5 / PULSES / s / feed;
            let power = pair[1].beam_power / S;
            assert!((power - share.min(1.0)).abs() <= rounding + 1e-4, "{power} {share} {:?}", pair[1]);
            slow += u32::from(power > 0.05 && power < 0.9);
        }
        assert!(slow > 50, "it is slow in {slow} periods");
        let (energy, way) = energy(&trace);
        assert!((way - 80.0).abs() < 0.2 && (energy * feed / way - 1.0).abs() < 1e-3, "{energy} {way}");
    }
}

/// With an exponent the power is that of the share of the feed in the period.
#[test]
fn an_exponent_bends_the_power_with_the_speed() {
    for exponent in [0.5, 1.5, 2.0] {
        let (run, trace) = run(&format!("power = {{ exponent = {exponent} }}"), CORNERS, "at 1s override 40%\n");
        assert_eq!(run.report["outcome"], "completed", "{}", run.output.err);
        assert_safe(&trace, false);
        let mut slow = 0;
        for pair in trace.windows(2).filter(|pair| is_period(pair) && pair[1].is_on("spindle")) {
            let ((mm, s), feed, power) = (step(pair), 25.0, pair[1].beam_power / S);
            let rounding = 1.5 / PULSES / s / feed;
            let law = |share: f64| share.clamp(0.0, 1.0).powf(exponent);
            let (least, most) = (law(mm / s / feed - rounding), law(mm / s / feed + rounding));
            assert!((least - 1e-4..=most + 1e-4).contains(&power), "{exponent}: {power} {least} {most}");
            slow += u32::from(power > 0.05 && power < 0.9);
        }
        assert!(slow > 50, "it is slow in {slow} periods");
    }
}

#[test]
fn with_m3_the_power_is_constant_and_a_pierce_has_it_at_rest() {
    let program = CORNERS.replace("M4", "M3").replace("G1 Y20", "G1 Y20\nG0 X12 Y18");
    let (run, trace) = run("power = {}\nstart = { pierce_s = 0.3 }", &program, "");
    assert_eq!(run.report["outcome"], "completed", "{}", run.output.err);
    assert_safe(&trace, true);
    let at_rest: Vec<&Sample> = trace.iter().filter(|now| now.rate == 0.0 && now.beam_power > 0.0).collect();
    let first = at_rest.first().expect("a pierce");
    let end = trace.iter().find(|now| now.at_us > first.at_us && now.rate != 0.0).expect("motion");
    assert!((end.at_us - first.at_us).abs_diff(300_000) <= 2000, "{} µs", end.at_us - first.at_us);
    for pair in trace.windows(2).filter(|pair| is_period(pair) && pair[1].is_on("spindle") && step(pair).0 > 0.0) {
        assert!(pair[1].beam_power == S, "{:?}", pair[1]);
    }
    for now in trace.iter().filter(|now| now.rate != 0.0 && (now.line == 3 || now.line == 10)) {
        assert_eq!(now.beam_power, 0.0, "rapid: {now:?}");
    }
}

/// S in the line of a move, M67 and a least power; M5 by hand.
#[test]
fn s_and_m67_change_the_power_in_passing() {
    let program =
        "G21 G90 G64 P0.01 F1500\nS600\nG0 X10\nM4\nG1 X30\nS300\nG1 X50\nM67 E1 Q150\nG1 X70\nS600 G1 X90\nM5\nM2\n";
    let (run, trace) = run("power = { analog = 1, least_percent = 20 }", program, "");
    assert_eq!(run.report["outcome"], "completed", "{}", run.output.err);
    assert_safe(&trace, false);
    let cut: Vec<&Sample> = trace.iter().filter(|now| now.beam_power > 0.0).collect();
    let at_x = |mm: f64| {
        let now = cut.iter().find(|now| now.counts[0] as f64 / PULSES > mm).expect("a sample");
        now.beam_power / S
    };
    for (mm, share) in [(20.0, 1.0), (40.0, 0.5), (60.0, 0.25), (80.0, 1.0)] {
        assert!((at_x(mm) - share).abs() < 1e-3, "at {mm} mm: {}", at_x(mm));
    }
    // the edge is at its place, and the speed does not change there
    for (mm, from, to) in [(30.0, 1.0, 0.5), (50.0, 0.5, 0.25)] {
        let edge = trace
            .windows(2)
            .find(|pair| {
                pair[1].beam_power / S < (from + to) / 2.0
                    && pair[1].rate > 0.0
                    && pair[0].beam_power / S > (from + to) / 2.0
            })
            .expect("an edge");
        assert!((edge[0].counts[0] as f64 / PULSES - mm).abs() <= 0.05, "{} {mm}", edge[0].counts[0]);
        assert!(step(edge).0 / step(edge).1 > 24.9, "no stop");
    }
    assert!(cut.iter().all(|now| now.beam_power / S >= 0.2 * 0.25 - 1e-6), "at least a fifth of S");
}

#[test]
fn raster_engraving_whose_edges_cannot_be_placed_is_refused() {
    let raster = |feed: u32| format!("G21 G90 F{feed}\nS100\nM4\nG1 X10\nS200\nX20\nG0 Y1\nS300\nG1 X0\nM5\nM2\n");
    let check = |program: &str, period: &str| {
        let bench = Bench::new();
        let machine = bench.file("m.toml", format!("{period}{}", machine("power = {}"))).display().to_string();
        let program = bench.file("part.ngc", program).display().to_string();
        bench.retrace(["check", &program, "--machine", &machine])
    };
    let refused = check(&raster(3600), "");
    assert!(refused.code == Some(1) && refused.err.contains("E4309") && refused.err.contains(":6:"), "{}", refused.err);
    assert!(refused.err.contains("3000 mm/min"), "{}", refused.err);
    assert_eq!(check(&raster(3000), "").code, Some(0));
    assert_eq!(check(&raster(6000), "control_period_ms = 0.5\n").code, Some(0));
    // without an edge in a cut there is nothing to place
    assert_eq!(check(&raster(9000).replace("S200\n", ""), "").code, Some(0));
    // nor where S is repeated, as many CAM systems do in every block
    assert_eq!(check(&raster(9000).replace("S200\n", "S100\n"), "").code, Some(0));
}

/// Over the serial line, and on a card that has no such output.
#[test]
fn a_served_card_has_the_power_of_the_program() {
    let bench = Bench::new();
    let vcd = bench.path("pins.vcd");
    bench.file("m.toml", format!("{}[card]\nwatchdog_ms = 2000\n", machine("power = {}")));
    let program = bench.file("part.ngc", CORNERS).display().to_string();
    let card = ServedCard::with(&["--vcd", &vcd.display().to_string()]);
    assert_eq!(card.identify(&bench)["spindle_pwm"], true);
    let run = bench.retrace(["run", &program, "--card", &card.port, "--machine", "m.toml", "--json"]);
    assert_eq!(run.code, Some(0), "{}", run.err);
    let _ = card.end();
    let trace = samples(&vcd);
    assert_safe(&trace, false);
    let (energy, way) = energy(&trace);
    assert!((way - 80.0).abs() < 0.2 && (energy * 25.0 / way - 1.0).abs() < 1e-3, "{energy} {way}");
}

/// However the job ends: the power is 0 with the beam.
#[test]
fn the_power_ends_with_the_beam() {
    for script in ["at 1s stop\n", "at 1s cutter off\n", "at 1s reverse 100%\nafter 1s stop\n"] {
        let (_, trace) = run("power = {}", CORNERS, script);
        assert_safe(&trace, false);
        let last = trace.iter().rposition(|now| now.beam_power > 0.0).expect("it cut");
        // it brakes on the path, with the beam on it
        assert!(trace[last].at_us <= 1_200_000, "{script}: {:?}", trace[last]);
    }
}

/// A test pulse has the power of S; a beam that may cut backward has the power of its speed there too.
#[test]
fn a_test_pulse_and_a_cut_backward_have_their_power() {
    let (run, trace) = run("power = {}\npulse_s = 0.3", CORNERS, "at 1s hold\nafter 1s test pulse\nafter 1s recover\n");
    assert_eq!(run.report["outcome"], "completed", "{}", run.output.err);
    assert_safe(&trace, true);
    let begins = trace.iter().position(|now| now.rate == 0.0 && now.beam_power > 0.0).expect("a pulse");
    let ends = begins + trace[begins..].iter().position(|now| now.beam_power == 0.0).expect("its end");
    let s = (trace[ends].at_us - trace[begins].at_us) as f64 / 1e6;
    let is_at_s = trace[begins..ends].iter().all(|now| now.beam_power == S && now.rate == 0.0);
    assert!((s - 0.3).abs() <= 0.01 && is_at_s, "{s} s");

    let script = "at 1.5s reverse 60%\nafter 0.3s cutter on\nafter 0.5s recover\n";
    let (run, trace) = self::run("power = {}\nretrace_cut = true", CORNERS, script);
    assert_eq!(run.report["outcome"], "completed", "{}", run.output.err);
    assert_safe(&trace, false);
    let backward = |pair: &&[Sample]| is_period(pair) && pair[0].rate < 0.0 && pair[1].rate < 0.0;
    let mut mm_cut = 0.0;
    for pair in trace.windows(2).filter(backward).filter(|pair| pair[0].is_on("spindle") && pair[1].is_on("spindle")) {
        let (mm, s) = step(pair);
        let share = (mm / s / 25.0).min(1.0);
        assert!((pair[1].beam_power / S - share).abs() <= 1.5 / PULSES / s / 25.0 + 1e-4, "{share} {:?}", pair[1]);
        mm_cut += mm;
    }
    assert!(mm_cut > 3.0, "{mm_cut} mm backward: {}", run.output.out);
}

/// A recovery that starts beside the path: the lead-in gets the energy of the path.
#[test]
fn a_lead_in_has_the_power_of_the_path() {
    for lead in ["", "after 0.2s lead arc\n"] {
        let script = format!("at 1s cutter off\nafter 1s shift -1.5 -2\n{lead}after 0.2s recover\n");
        let (run, trace) = run("power = {}\nstart = { pierce_s = 0.2 }", CORNERS, &script);
        assert_eq!(run.report["outcome"], "completed", "{} {}", run.output.err, run.output.out);
        assert_safe(&trace, true);
        let feed = 25.0;
        // beside the path, which is at Y0 there
        let beside = |sample: &Sample| sample.counts[1] < -200 && sample.is_on("spindle") && sample.rate != 0.0;
        let mut way = 0.0;
        for pair in trace.windows(2).filter(|pair| is_period(pair) && beside(&pair[0]) && beside(&pair[1])) {
            let (mm, s) = step(pair);
            let (power, share) = (pair[1].beam_power / S, (mm / s / feed).min(1.0));
            assert!((power - share).abs() <= 2.5 / PULSES / s / feed + 1e-3, "{power} {share} {:?}", pair[1]);
            way += mm;
        }
        assert!(way > 1.0, "{way} mm of lead-in: {}", run.output.out);
        let (energy, cut) = energy(&trace);
        let pierces =
            trace.windows(2).filter(|pair| pair[1].rate == 0.0 && pair[1].beam_power > 0.0 && is_period(pair));
        let pierced_s = pierces.count() as f64 * 1e-3;
        assert!(((energy - pierced_s) * feed / cut - 1.0).abs() < 5e-3, "{energy} {pierced_s} {cut}");
    }
}
