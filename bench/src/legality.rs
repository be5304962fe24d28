//! Limits of the emitted records, through holds, overrides and reversals, as the limit monitor of the command reports
//! them.
//!
//! Invariant: programs and operators follow from fixed seeds; the monitor is that of `retrace run`, on emitted
//! increments alone.

use super::generate::Numbers;
use super::motion::Row;
use std::fmt::Write as _;
use std::path::Path;

const PROGRAMS: u64 = 6;

/// Rows of the part of Q7 that is measured at the card.
pub(super) fn rows(binary: &Path, folder: &Path) -> Result<Vec<Row>, String> {
    let (mut broken, mut reversals, mut periods) = (0, 0, 0);
    for seed in 1..=PROGRAMS {
        let write = |name: &str, text: String| {
            let path = folder.join(name);
            std::fs::write(&path, text).map_err(|error| format!("{}: {error}", path.display()))?;
            Ok::<_, String>(path)
        };
        let program = write(&format!("turned-{seed}.ngc"), program(seed))?;
        let operator = write(&format!("turned-{seed}.op"), operator(seed))?;
        let report = super::peers::played(binary, &program, &["--operator", &operator.display().to_string()])?;
        let count = |key: &str| report[key].as_u64().unwrap_or(u64::MAX);
        broken += count("limit_violations");
        reversals += count("reversals");
        periods += count("periods");
    }
    let what = "limit violations at the card, through holds, overrides and reversals";
    let note =
        format!("{PROGRAMS} random programs, {periods} periods, {reversals} reversals, as `retrace run` judges them");
    Ok(vec![Row::at_most("Q7", what, broken as f64, 0.0, false, note)])
}

/// Lines from 0.05 to 20 mm and half circles in random directions, blended and not, at feeds from 5 to 100 mm/s.
fn program(seed: u64) -> String {
    let mut numbers = Numbers::new(seed);
    let mut text = String::from("G21 G90 G17 G64 P0.05\nF3000\nG1 X0 Y0 Z0\n");
    let (mut x, mut y) = (0.0f64, 0.0f64);
    for k in 0..1500 {
        let mut share = || numbers.below(1 << 20) as f64 / f64::from(1 << 20);
        let length = 0.05 * 400f64.powf(share());
        let heading = std::f64::consts::TAU * share();
        let inward = x.hypot(y) > 100.0;
        let (dx, dy) = if inward { (-0.05 * x, -0.05 * y) } else { (length * heading.cos(), length * heading.sin()) };
        let round = |value: f64| (value * 1000.0).round() / 1000.0;
        let (ex, ey) = (round(x + dx), round(y + dy));
        let (feed, z) = (300.0 * 20f64.powf(share()), round(4.0 * share()));
        let kind = numbers.below(20);
        // A write into memory cannot fail.
        let _ = match kind {
            0 => writeln!(text, "G61"),
            1 => writeln!(text, "G64 P{:.3}", 0.005 * f64::from(1 + k % 10)),
            2 => writeln!(text, "F{feed:.0}"),
            3 => writeln!(text, "G0 Z{z:.3}"),
            4..=7 => {
                writeln!(text, "G{} X{ex:.3} Y{ey:.3} I{:.4} J{:.4}", 2 + kind % 2, (ex - x) / 2.0, (ey - y) / 2.0)
            }
            _ => writeln!(text, "G1 X{ex:.3} Y{ey:.3}"),
        };
        if kind >= 4 {
            (x, y) = (ex, ey);
        }
    }
    text + "M2\n"
}

/// An operator who changes the command every second.
fn operator(seed: u64) -> String {
    let mut numbers = Numbers::new(seed + 100);
    let mut text = String::new();
    for _ in 0..20 {
        let wait = 200 + numbers.below(1500);
        let percent = 20 + numbers.below(130);
        let _ = match numbers.below(4) {
            0 => writeln!(text, "after {wait} periods hold\nafter {} periods resume", 1 + numbers.below(600)),
            1 => writeln!(
                text,
                "after {wait} periods reverse {percent}%\nafter {} periods forward 100%",
                1 + numbers.below(900)
            ),
            _ => writeln!(text, "after {wait} periods override {percent}%"),
        };
    }
    text + "after 100 periods override 100%\n"
}
