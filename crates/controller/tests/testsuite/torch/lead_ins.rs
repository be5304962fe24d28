//! Starts beside the path.

use retrace_controller::EventKind;
use retrace_core::Rate;

use super::{PROGRAM, machine, machine_text, parsed, run};

/// The torch pierces beside the path and leads in to it at the feed of the contour; from the join on it is the path.
#[test]
fn a_shifted_restart_pierces_beside_the_path_and_leads_in_to_it() {
    let whole = run(&machine(), PROGRAM, "", "");
    for (shift, mm) in [("shift 3 -4", [3.0, -4.0]), ("shift n\nafter 0.1s shift nw", [-1.5, 3.0])] {
        let job = run(&machine(), PROGRAM, "lose@20", &format!("at 3s {shift}\nafter 0.1s recover\n"));
        job.assert_part_of(&whole);
        job.assert_safe();
        // 1 mm before the end of the cut at X30
        let pierces = job.ignitions();
        let off = [pierces[1][0] - 29.0 - mm[0], pierces[1][1] - mm[1]];
        assert!(pierces.len() == 3 && off[0].abs() < 0.06 && off[1].abs() < 0.01, "{pierces:?}");
        assert_eq!(job.count(&EventKind::Joined), 1);
        // with the torch on, no period off the path is faster than the feed
        let strokes: Vec<([f64; 2], bool)> = job.strokes().collect();
        let lit_off_path = |at: usize| job.periods[at].off_path && job.lit[at];
        let lengths = (1..strokes.len()).filter(|&at| lit_off_path(at)).map(|at| {
            let [[x0, y0], [x1, y1]] = [strokes[at - 1].0, strokes[at].0];
            (x1 - x0).hypot(y1 - y0)
        });
        let (fastest, length) = lengths.fold((0.0f64, 0.0), |(most, sum), mm| (most.max(mm), sum + mm));
        assert!(fastest <= 0.03 + 0.01, "{fastest} mm in a period");
        assert!((length - mm[0].hypot(mm[1])).abs() < 0.2, "{length} mm lead in");
    }
}

/// On the way to the start, in the pierce, on the lead-in and beyond it: held, or put out.
#[test]
fn an_interrupted_lead_in_is_done_again() {
    let whole = run(&machine(), PROGRAM, "", "");
    for after_s in [0.3, 1.1, 1.5, 1.9] {
        for (end, again) in [("hold", "resume"), ("cutter off", "shift 2 4\nafter 0.1s recover")] {
            let script = format!("at 3s shift 0 4\nafter 0s recover\nafter {after_s}s {end}\nafter 1s {again}\n");
            let script = script + "after 4s shift -2 -3\nafter 0.1s recover\n";
            let script = script + "after 4s hold\nafter 0.5s shift -1 4\nafter 0.1s recover\n";
            let job = run(&machine(), PROGRAM, "lose@20", &script);
            job.assert_part_of(&whole);
            job.assert_safe();
        }
    }
}

/// While the machine is on a lead-in, commands that retrace the path are refused, and others are not.
#[test]
fn a_lead_in_is_not_retraced() {
    let script = "at 3s shift 0 4\nafter 0s recover\nafter 0.9s reverse 50%\nafter 0s single\nafter 0s pause\n\
        after 0s hold\nafter 1s recover\n";
    let job = run(&machine(), PROGRAM, "lose@20", script);
    let rejections = job.rejections();
    assert!(rejections.len() == 3 && rejections.iter().all(|why| why.contains("lead-in")), "{rejections:?}");
    let held = job.periods.iter().filter(|period| period.off_path && period.rate == Rate::ZERO).count();
    assert!(held > 800, "{held}");
    job.assert_part_of(&run(&machine(), PROGRAM, "", ""));
}

#[test]
fn a_shift_that_is_too_far_or_leaves_the_soft_limits_is_refused_before_anything_moves() {
    let text = machine_text().replace("[-50, 500]", "[-1, 500]");
    let machine = parsed(&text);
    let refused = |faults: &str, script: &str| {
        let job = run(&machine, PROGRAM, faults, script);
        (job.rejections(), job.counts())
    };
    let (far, _) = refused("lose@20", "at 3s shift 8 7\n");
    assert!(far.len() == 1 && far[0].contains("shift_max_mm"), "{far:?}");
    // the lowest Y is -1 mm
    let (beyond, ends) = refused("lose@20", "at 3s shift 2 -4\nafter 0.1s recover\nat 9s hold\n");
    assert!(beyond.len() == 1 && beyond[0].contains("axis Y would go beyond its soft limit"), "{beyond:?}");
    assert!(ends[1] == 0 && ends[0] < 30 * 200, "{ends:?}");
    // it has not started: nothing is interrupted
    let (early, ends) = refused("no-start=1", "at 6s shift 1 1\nafter 0.1s recover\n");
    assert!(early.len() == 1 && early[0].contains("no cut is interrupted here"), "{early:?}");
    assert_eq!(ends, [2000, 0, 0, 0]);
    let (moving, _) = refused("", "at 1s shift 1 1\n");
    assert!(moving.len() == 1 && moving[0].contains("at rest"), "{moving:?}");
}
