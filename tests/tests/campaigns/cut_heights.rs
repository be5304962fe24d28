//! Random contours that a torch cuts with height control over a warped sheet (CUT-15, CUT-50 to CUT-53, CUT-55): starts
//! that fail, losses and chatter, corners, and kerfs that are crossed.
//!
//! Invariant: heights, pulses and layer are judged by a program of its own, which sees nothing but the pins.

use retrace_tests::command::{Bench, cases};
use retrace_tests::cut_judge::judge_heights;
use retrace_tests::sender::TestRandom;
use retrace_tests::sensing_torch::{ARC_VOLTAGE, MATERIALS, SENSE, machine};
use serde_json::Value;
use std::fmt::Write;

/// Contours of a job, and those that the suite cuts.
const CONTOURS: u32 = 6;
const SUITE: u32 = 24;
/// Side of the sheet in mm, and the least distance of a start from what is cut.
const SHEET_MM: f64 = 260.0;
const CLEAR_MM: f64 = 6.0;
/// Lengths of a line in mm.
const LINE_MM: [usize; 2] = [25, 80];
/// Where the height is held for a kerf: the distance from it in mm, the longest way there, and the least way without a
/// kerf or a corner that follows. Held for longer, a torch cannot follow the sheet.
const NEAR_MM: f64 = 2.8;
const MOST_NEAR_MM: u32 = 9;
const FREE_MM: u32 = 20;
const FAULTS: &str = "warp=5,no-start=0.03,lose-per-m=0.1,flicker-per-m=2,flicker-ms=5";
/// Seconds of machine time between two *recover*.
const RECOVER_S: u32 = 20;

type Place = [f64; 2];

/// A straight line that is cut.
#[derive(Clone, Copy)]
struct Line {
    from: Place,
    /// Direction in steps of 45°.
    direction: usize,
    mm: f64,
}

impl Line {
    fn at(&self, mm: f64) -> Place {
        let (sin, cos) = (std::f64::consts::FRAC_PI_4 * self.direction as f64).sin_cos();
        [self.from[0] + mm * cos, self.from[1] + mm * sin]
    }

    fn end(&self) -> Place {
        self.at(self.mm)
    }

    fn distance_mm(&self, from: Place) -> f64 {
        let end = self.at(1.0);
        let along =
            (from[0] - self.from[0]) * (end[0] - self.from[0]) + (from[1] - self.from[1]) * (end[1] - self.from[1]);
        let near = self.at(along.clamp(0.0, self.mm));
        (from[0] - near[0]).hypot(from[1] - near[1])
    }

    /// Whether it only crosses what is cut, and crossings and corners are apart.
    fn is_free(&self, cut: &[Self]) -> bool {
        let (mut near_mm, mut free_mm) = (0, 0);
        for mm in 0..=self.mm as u32 {
            let at = self.at(mm.into());
            // Behind a corner it is near to the line before for a moment.
            let is_corner = (at[0] - self.from[0]).hypot(at[1] - self.from[1]) < CLEAR_MM;
            if cut.iter().any(|line| line.distance_mm(at) < NEAR_MM) && !is_corner {
                if near_mm == 0 && free_mm < FREE_MM {
                    return false;
                }
                (near_mm, free_mm) = (near_mm + 1, 0);
            } else {
                (near_mm, free_mm) = (0, free_mm + 1);
            }
            if near_mm > MOST_NEAR_MM {
                return false;
            }
        }
        free_mm >= FREE_MM
    }
}

fn is_on_sheet(at: Place) -> bool {
    at.iter().all(|mm| (0.0..=SHEET_MM).contains(mm))
}

/// One to four lines that turn by 45° or 90°; an arc strikes over metal alone, so that they begin beside what is cut.
fn contour(chance: &mut TestRandom, cut: &mut Vec<Line>) -> Vec<Line> {
    let start = loop {
        let at = [0; 2].map(|_| chance.below(SHEET_MM as usize * 10) as f64 / 10.0);
        if cut.iter().all(|line| line.distance_mm(at) > CLEAR_MM) {
            break at;
        }
    };
    let (mut lines, mut from, mut direction) = (Vec::<Line>::new(), start, chance.below(8));
    for _ in 0..1 + chance.below(4) {
        for _ in 0..20 {
            let mm = (LINE_MM[0] + chance.below(LINE_MM[1] - LINE_MM[0])) as f64;
            let turned = direction + [1, 2, 6, 7][chance.below(4)];
            let line = Line { from, direction: if lines.is_empty() { chance.below(8) } else { turned % 8 }, mm };
            let known: Vec<Line> = cut.iter().chain(&lines).copied().collect();
            if is_on_sheet(line.end()) && line.is_free(&known) {
                (from, direction) = (line.end(), line.direction);
                lines.push(line);
                break;
            }
        }
    }
    cut.extend(&lines);
    lines
}

fn program(chance: &mut TestRandom, contours: u32) -> String {
    let mut text = String::from("G21 G90 G94 F3000 G64 P0.05\n");
    let mut cut = Vec::new();
    for _ in 0..contours {
        let lines = contour(chance, &mut cut);
        let Some([x, y]) = lines.first().map(|line| line.from) else { continue };
        let _ = writeln!(text, "G0 X{x:.3} Y{y:.3}\nM3 S1");
        for [x, y] in lines.iter().map(Line::end) {
            let _ = writeln!(text, "G1 X{x:.3} Y{y:.3}");
        }
        text += "M5\n";
    }
    text + "G0 X0 Y0\nM2\n"
}

/// Cuts the contours of this seed; the report, and the figures of the judge.
fn cut(seed: u64, contours: u32) -> (Value, Value) {
    let bench = Bench::new();
    let cutter = machine(&format!("{SENSE} }}\nheight = {{ volts = 1, delay_s = 0.1"));
    let script: String =
        (1..=contours * 30 / RECOVER_S).map(|turn| format!("at {}s recover\n", turn * RECOVER_S)).collect();
    let program = program(&mut TestRandom::new(seed), contours);
    for (name, text) in [("part.ngc", &program), ("m.toml", &(cutter + ARC_VOLTAGE)), ("s.op", &script)] {
        bench.file(name, text);
    }
    bench.file("materials.toml", MATERIALS);
    let faults = format!("{FAULTS},seed={seed}");
    let [part, m, operator, trace] =
        ["part.ngc", "m.toml", "s.op", "pins.vcd"].map(|name| bench.path(name).display().to_string());
    let result = bench.retrace([
        "run",
        &part,
        "--json",
        "--no-journal",
        "--machine",
        &m,
        "--operator",
        &operator,
        "--source-faults",
        &faults,
        "--vcd",
        &trace,
    ]);
    assert_eq!(result.code, Some(0), "seed {seed}: {}\n{program}", result.err);
    let report = serde_json::from_str(result.out.lines().last().unwrap_or_default()).expect("a report");
    (report, judge_heights(bench.path("pins.vcd"), &[]))
}

#[test]
fn random_contours_are_cut_at_their_height_to_the_pulse() {
    let first: u64 = std::env::var("RETRACE_FIRST_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(1);
    let mut sums = [0_u64; 5];
    let mut worst_mm = 0.0_f64;
    for seed in (first..).take(cases(SUITE).div_ceil(CONTOURS) as usize) {
        let (report, figures) = cut(seed, CONTOURS);
        let number = |of: &Value, key: &str| of[key].as_u64().unwrap_or_default();
        let whole = (report["outcome"].as_str(), report["not_cut_mm"].as_f64(), report["limit_violations"].as_u64());
        assert_eq!(whole, (Some("completed"), Some(0.0), Some(0)), "seed {seed}: {report}");
        assert!(figures["good"] == true, "seed {seed}: {figures}");
        let found = [
            number(&report, "contours"),
            number(&report, "cut_interruptions"),
            number(&figures, "cut"),
            number(&figures, "beyond"),
            number(&figures, "over_kerf"),
        ];
        sums.iter_mut().zip(found).for_each(|(sum, more)| *sum += more);
        worst_mm = worst_mm.max(figures["worst_mm"].as_f64().unwrap_or(f64::INFINITY));
    }
    let [contours, losses, cut, beyond, over_kerf] = sums;
    println!(
        "{contours} contours, {losses} losses: {cut} samples of the cut, {beyond} beyond 0.25 mm, {worst_mm} mm at \
         most, {over_kerf} over a known kerf"
    );
    assert!(over_kerf > 0, "no kerf was crossed");
}
