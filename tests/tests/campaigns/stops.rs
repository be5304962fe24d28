//! Planned stops take the planned time: the card does not creep into them.

use retrace_tests::command::Bench;
use retrace_tests::programs::full_stops;
use retrace_tests::run::Run;

fn periods_of_motion(moves: u32, mm: f64) -> u64 {
    let bench = Bench::new();
    let program = bench.file("stops.ngc", full_stops(moves, mm));
    let run = Run::of(&bench, &program, &[]);
    run.assert_exact_and_legal();
    assert_eq!(run.number("underruns"), 0.0, "{}", run.report);
    (run.number("motion_s") / run.number("period_ms") * 1000.0).round() as u64
}

#[test]
fn a_thousand_full_stops_take_exactly_the_planned_periods() {
    // From rest to rest over 1 mm the jerk is never zero: four phases of t with d = 2 J t³, J = 0.9 · 20 000 mm/s³ (a
    // tenth is reserved). Peak acceleration 545 mm/s² and speed 16.5 mm/s are below their limits. A run between two
    // stops takes whole periods (SMO-9).
    let phase_s = (1.0_f64 / (2.0 * 0.9 * 20_000.0)).cbrt();
    let planned = (4.0 * phase_s / 0.001).ceil() as u64;
    assert_eq!(planned, 122);
    assert_eq!(periods_of_motion(1, 1.0), planned);
    assert_eq!(periods_of_motion(1000, 1.0), 1000 * planned);
}

#[test]
fn a_stop_takes_as_long_however_many_came_before() {
    for mm in [0.001, 0.01, 0.3, 7.0, 40.0] {
        assert_eq!(periods_of_motion(40, mm), 40 * periods_of_motion(1, mm), "{mm} mm");
    }
}
