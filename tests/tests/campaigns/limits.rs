//! Both limit checks detect a plan that exceeds the limits: the tests' own, and the command's.

use retrace_tests::command::{Bench, root};
use retrace_tests::limits::{Axis, audit};
use retrace_tests::run::Run;

/// The example's records, checked against a machine that can do less than the one it was planned for.
#[test]
fn an_over_limit_plan_is_caught_by_every_limit() {
    let run = Run::of(&Bench::new(), &root().join("examples/03-arcs.ngc"), &[]);
    run.assert_exact_and_legal();
    for order in 0..3 {
        let mut axes: Vec<Axis> = run.axes();
        for (axis, largest) in axes.iter_mut().zip(run.audit().largest) {
            axis.limits[order] = 0.9 * largest[order];
        }
        let caught = audit(&run.records, &axes, 0.001);
        assert!(caught.violations[order] > 0, "order {order}");
        let others: u64 = (0..3).filter(|&other| other != order).map(|other| caught.violations[other]).sum();
        assert_eq!(others, 0, "order {order}: {:?}", caught.first);
    }
}

/// The plan uses what the machine can do; otherwise the check would show nothing.
#[test]
fn the_plan_comes_near_the_limits_and_keeps_the_reserve() {
    let bench = Bench::new();
    let program = bench.file("long.ngc", "G21 G90\nG0 X300\nX0\nM2\n");
    let run = Run::of(&bench, &program, &[]);
    run.assert_exact_and_legal();
    let [velocity, acceleration, jerk] = run.audit().largest[0];
    assert!((98.0..=100.0).contains(&velocity), "{velocity}");
    assert!((850.0..=900.1).contains(&acceleration), "{acceleration}");
    assert!((17_000.0..=18_001.0).contains(&jerk), "{jerk}");
}
