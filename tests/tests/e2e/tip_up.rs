//! The height of the rapids behind contours in which a part may have tipped up (CUT-14), seen at the card's pins.
//!
//! Invariant: what is asserted of the tool axis is its path and its layer together, which is what its steps make.

use retrace_tests::command::{Bench, assert_contains};
use retrace_tests::pins::{Sample, samples};
use retrace_tests::run::Run;
use retrace_tests::sensing_torch::{SENSE, SHEET, machine};

const MATERIALS: &str = "units = \"mm\"\ndefault = 1\n[[material]]\nnumber = 1\nname = \"Steel\"\nkerf_mm = 1.4\n\
    pierce_height_mm = 3.8\npierce_delay_s = 0.4\ncut_height_mm = 1.5\nfeed_mm_per_min = 3000\n";
/// A square with a lead-in, a circle in it, one beside it, and a line in the square; each in a line of its own.
const PROGRAM: &str = "G21 G90 F3000\nG0 X5 Y5\nM3\nG1 X10 Y10\nG1 X50\nG1 Y50\nG1 X10\nG1 Y10\nM5\nG0 X30 Y20\nM3\n\
    G2 X30 Y20 I0 J5\nM5\nG0 X80 Y20\nM3\nG3 X80 Y20 I0 J5\nM5\nG0 X20 Y40\nM3\nG1 X40\nM5\nG0 X0 Y0\nM2\n";
const SAFE: i64 = 6000;
const RETRACT: i64 = 12000;

fn heights(sense: &str) -> Vec<(u64, i64)> {
    let bench = Bench::new();
    for (name, text) in [("part.ngc", PROGRAM), ("m.toml", &machine(sense)), ("materials.toml", MATERIALS)] {
        bench.file(name, text);
    }
    let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
    let arguments = ["--machine", &machine, "--vcd", &vcd.display().to_string()];
    let run = Run::of(&bench, &bench.path("part.ngc"), &arguments);
    run.assert_exact_and_legal();
    let trace = samples(&vcd);
    // The float switch opens one pulse above the position where it closes.
    let height = |sample: &Sample| sample.counts[2] + sample.layer - SHEET - 1;
    let moves = |pair: &&[Sample]| pair[0].counts[..2] != pair[1].counts[..2] && !pair[1].is_on("spindle");
    let mut rapids: Vec<(u64, i64)> =
        trace.windows(2).filter(moves).map(|pair| (pair[1].line, height(&pair[1]))).collect();
    rapids.dedup();
    rapids
}

/// Behind a contour that ends in an area that was cut before, the rapid is at the retract height; behind any other, and
/// where that is not asked for, at the safe height.
#[test]
fn the_tool_is_retracted_where_a_part_may_have_tipped_up() {
    let retracts = format!("{SENSE}, tip_up = \"retract\", retract_mm = 30");
    let behind = |of: &[(u64, i64)]| of[1..].iter().map(|&(_, height)| height).collect::<Vec<i64>>();
    assert_eq!(behind(&heights(&retracts)), [SAFE, RETRACT, SAFE, RETRACT]);
    assert_eq!(behind(&heights(SENSE)), [SAFE; 4]);
    let bench = Bench::new();
    bench.file("part.ngc", PROGRAM);
    bench.file("materials.toml", MATERIALS);
    for (key, why) in [("retract_mm = 501", "sense.retract_mm"), ("tip_up = \"never\"", "tip_up")] {
        bench.file("m.toml", machine(&format!("{SENSE}, {key}")));
        let refused = bench.retrace(["check", "part.ngc", "--machine", "m.toml"]);
        assert_eq!(refused.code, Some(2), "{}", refused.err);
        assert_contains(&refused.err, &[why]);
    }
}
