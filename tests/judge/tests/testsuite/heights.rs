//! The judge of heights: it finds each seeded defect, and nothing in a trace without one.
//!
//! Invariant: a trace without a defect is a cut along X over a sheet that rises, held where it is slow and over a kerf.

use crate::{cut_judge, figure, folder};
use std::fmt::Write;
use std::fs;

/// Pulses per mm of X and of the tool axis.
const X: f64 = 200.0;
const Z: f64 = 400.0;

/// A period of 1 ms.
#[derive(Clone, Copy, Default)]
struct Period {
    x: i64,
    y: i64,
    layer: i64,
    is_lit: bool,
    /// Whether the input that proves the cutter is inactive meanwhile.
    flickers: bool,
    rate: f64,
    /// Pulses of the tool axis that are left out.
    lost: i64,
}

/// A cut along Y at X20, and one along X from X10 to X60 over it, which is slow from X40 to X42.
fn trace() -> Vec<Period> {
    let over = |x: i64| {
        let mm = x as f64 / X;
        ((1.5 + 2.5 * (1.0 - (std::f64::consts::TAU * mm / 1000.0).cos())) * Z).round() as i64
    };
    let mut periods = Vec::new();
    let mut at = Period { x: 4000, y: -2000, layer: over(4000), rate: 1.0, ..Period::default() };
    periods.push(Period { layer: 0, ..at });
    while at.y < 2000 {
        at = Period { y: at.y + 10, is_lit: true, ..at };
        periods.push(at);
    }
    at = Period { x: 2000, y: 0, is_lit: false, layer: 0, ..at };
    periods.push(at);
    at.layer = over(2000);
    periods.push(at);
    while at.x < 12_000 {
        let is_slow = (8000..8400).contains(&at.x);
        let is_held = is_slow || (3500..4500).contains(&at.x) || (7500..8500).contains(&at.x);
        at.x += if is_slow { 5 } else { 10 };
        at.layer = if is_held { at.layer } else { over(at.x) };
        periods.push(Period { is_lit: true, ..at });
    }
    periods.push(Period { is_lit: false, ..at });
    periods.push(Period { is_lit: false, layer: 0, ..at });
    periods
}

/// A value change dump: the pulses of a period come behind its moment.
fn vcd(periods: &[Period]) -> String {
    let mut text = String::from("$timescale 1 ns $end\n");
    for axis in ["x", "y", "z"] {
        let _ = writeln!(text, "$scope module {axis} $end\n$var wire 1 {axis}s step $end");
        let _ = writeln!(text, "$var wire 1 {axis}b backward $end\n$var integer 64 {axis}c count $end\n$upscope $end");
    }
    text += "$scope module card $end\n$var real 64 p place $end\n$var real 64 r rate $end\n$var wire 1 0 at_rest $end\n\
             $var integer 8 a alarm $end\n$var integer 16 i inputs $end\n$var real 64 l layer $end\n$upscope $end\n\
             $scope module outputs $end\n$var integer 32 f spindle $end\n$upscope $end\n$enddefinitions $end\n#0\n\
             b0 zc\n";
    let mut layer = 0;
    for (number, period) in periods.iter().enumerate() {
        // A way of 100 mm between two cuts takes its time.
        let at_ns = number * 1_000_000;
        let lit = u8::from(period.is_lit);
        let _ = writeln!(
            text,
            "#{at_ns}\nr{number} p\nr{} r\nb{:b} i\nb{lit} f\nr{} l",
            period.rate,
            (lit & u8::from(!period.flickers)) << 5,
            period.layer
        );
        let _ = writeln!(text, "b{:b} xc\nb{:b} yc", period.x, period.y);
        let way = period.layer - layer;
        layer = period.layer;
        let count = (way.abs() - period.lost).max(0);
        let _ = writeln!(text, "#{}\n{}zb", at_ns + 10, u8::from(way < 0));
        for pulse in 0..count as usize {
            let _ = writeln!(text, "#{}\n1zs\n#{}\n0zs", at_ns + 20 + pulse * 20, at_ns + 30 + pulse * 20);
        }
    }
    text
}

fn verdict(name: &str, periods: &[Period], options: &[&str]) -> (i32, String) {
    // Tests run beside each other, and each judges the trace it has written itself.
    let test = std::thread::current().name().unwrap_or_default().replace("::", "_");
    let path = folder(&test).join(name);
    fs::write(&path, vcd(periods)).expect("a trace");
    let output = cut_judge(&[&["heights", &path.display().to_string(), "--sheet-mm", "0"], options].concat());
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    (output.status.code().unwrap_or(-1), text + &String::from_utf8_lossy(&output.stderr))
}

#[test]
fn a_trace_without_a_defect_is_good() {
    let (code, text) = verdict("good.vcd", &trace(), &[]);
    assert_eq!((code, figure(&text, "good"), figure(&text, "beyond")), (0, "true", "0"), "{text}");
    let over: u32 = figure(&text, "over_kerf").parse().expect("a number");
    assert!((20..=60).contains(&over), "1.4 mm to either side at most: {text}");
    let cut: u32 = figure(&text, "cut").parse().expect("a number");
    assert!((1_400..=1_450).contains(&cut), "{text}");
}

/// What was cut before a flicker of the proof is no kerf that the same cut comes to.
#[test]
fn a_flicker_of_the_proof_ends_no_cut() {
    let mut periods = trace();
    for flicker in periods.iter_mut().filter(|at| at.is_lit && at.y == 0 && (5_500..5_550).contains(&at.x)) {
        flicker.flickers = true;
    }
    let (code, text) = verdict("flicker.vcd", &periods, &[]);
    assert_eq!((code, figure(&text, "moved_over_kerf")), (0, "0"), "{text}");
    assert_eq!(figure(&text, "over_kerf"), figure(&verdict("good.vcd", &trace(), &[]).1, "over_kerf"), "{text}");
}

#[test]
fn each_seeded_defect_is_found() {
    type Defect = fn(&mut Vec<Period>);
    let defects: [(&str, &str, Defect); 8] = [
        ("a pulse too few", "wrong_pulses", |of| {
            let moves = of.windows(2).rposition(|pair| pair[1].is_lit && pair[0].layer != pair[1].layer);
            of[moves.expect("the sheet rises") + 1].lost = 1;
        }),
        ("too high", "worst_mm", |of| of[500..].iter_mut().filter(|at| at.is_lit).for_each(|at| at.layer += 201)),
        ("often too high", "beyond", |of| {
            of[900..1_000].iter_mut().filter(|at| at.is_lit).for_each(|at| at.layer += 110);
        }),
        ("a dive in the corner", "moved_in_corner", |of| {
            let corner = of.iter().position(|at| at.y == 0 && at.x == 8_200).expect("it is passed");
            of[corner].layer -= 1;
        }),
        ("a dive over the kerf", "moved_over_kerf", |of| {
            let kerf = of.iter().position(|at| at.is_lit && at.y == 0 && at.x == 4_010).expect("it is passed");
            of[kerf].layer -= 1;
        }),
        ("a move in a rapid", "moved_in_rapid", |of| {
            let last = of[of.len() - 1];
            of.extend([last; 201]);
            of.push(Period { x: last.x + 10, layer: 3, ..last });
            of.push(Period { x: last.x + 10, layer: 0, ..last });
        }),
        ("a layer at the end", "layer_at_end", |of| of.last_mut().expect("a period").layer = 1),
        ("no cut", "cut", |of| of.iter_mut().for_each(|at| at.is_lit = false)),
    ];
    let good = verdict("good.vcd", &trace(), &[]).1;
    for (name, found, seed) in defects {
        let mut periods = trace();
        seed(&mut periods);
        let (code, text) = verdict(&format!("{found}.vcd"), &periods, &[]);
        assert_eq!((code, figure(&text, "good")), (1, "false"), "{name}: {text}");
        assert_ne!(figure(&text, found), figure(&good, found), "{name}: {text}");
    }
}

#[test]
fn what_the_judge_is_told_counts() {
    for options in [["--rise-mm", "40"], ["--sheet-mm", "0.6"], ["--height-mm", "2.1"], ["--z-pulses-per-mm", "300"]] {
        assert_eq!(verdict("told.vcd", &trace(), &options).0, 1, "{options:?}");
    }
    // A hold slows the path down as well, and the layer comes to rest in it.
    let mut held = trace();
    let corner = held.iter().position(|at| at.y == 0 && at.x == 8_200).expect("it is passed");
    held[corner].layer -= 1;
    held[corner - 1..corner + 2].iter_mut().for_each(|at| at.rate = 0.5);
    assert_eq!(verdict("told.vcd", &held, &[]).0, 0);
    assert_eq!(figure(&verdict("told.vcd", &trace(), &["--kerf-mm", "0"]).1, "over_kerf"), "0");
    // At twice the feed all of it is slow, so that nothing is a corner.
    assert_eq!(figure(&verdict("told.vcd", &trace(), &["--feed", "6000"]).1, "moved_in_corner"), "0");
    for (options, part) in [
        (["--heat", "1"], "there is no option `--heat`"),
        (["--feed", "0"], "--feed is 0"),
        (["--input", "64"], "is not the number of an input"),
    ] {
        let (code, text) = verdict("told.vcd", &trace(), &options);
        assert!(code == 2 && text.contains(part), "{text}");
    }
    let none = cut_judge(&["heights"]);
    assert!(none.status.code() == Some(2) && String::from_utf8_lossy(&none.stderr).contains("no trace is named"));
    let help = cut_judge(&["heights", "--help"]);
    assert!(help.status.success() && String::from_utf8_lossy(&help.stdout).contains("moved_over_kerf"));
}
