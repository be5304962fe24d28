//! Probing cycles, with answers that are given here.

use retrace_gcode::{Canon, Pose, Prescan, ProbingFigures, Program, Progress, Setup, Severity, probing_cycles};
use std::sync::Arc;

const FIGURES: ProbingFigures = ProbingFigures {
    ball_diameter_mm: Some(2.0),
    feed_mm_per_min: 300.0,
    slow_feed_mm_per_min: 30.0,
    back_off_mm: 1.0,
    agree_mm: 0.1,
    tool_setter_mm: None,
};

/// Executes a program whose probing moves touch at these heights, and come to rest 0.3 mm behind. Returns the errors
/// and the program.
fn run(text: &str, touches: &[f64]) -> (Vec<String>, Program<&'static [u8]>) {
    let setup = Setup { fixed_values: FIGURES.named_values(), ..Setup::default() };
    let prescan = Arc::new(Prescan::scan("p", text.to_owned().into_bytes().into(), &setup));
    let mut program = Program::<&'static [u8]>::prescanned(prescan, setup);
    let (mut steps, mut touches) = (Vec::new(), touches.iter());
    while program.advance(&mut steps) != Progress::End {
        for step in steps.drain(..) {
            if let Canon::StraightProbe(end, _) = step.canon {
                let touch = Pose([end.0[0], end.0[1], *touches.next().expect("a touch"), 0., 0., 0., 0., 0., 0.]);
                let mut rest = touch;
                rest.0[2] -= 0.3;
                program.interpreter_mut().resolve_probe(&touch, &rest, true);
            }
        }
    }
    let found = program.interpreter().diagnostics().iter().filter(|found| found.severity() == Severity::Error);
    let errors = found.map(|found| format!("{} {}", found.number(), found.message)).collect();
    assert_eq!(touches.next(), None);
    (errors, program)
}

#[test]
fn the_slow_touch_counts_and_touches_that_differ_end_the_program() {
    let text = "G21 G90 G17\no<probe_surface> call [-3] [10]\n#1 = #<_probe_result>\nM2\n";
    let (errors, program) = run(text, &[-5.0, -5.08]);
    assert_eq!((errors, program.interpreter().parameters().get(1)), (vec![], -5.08));
    // It stands back_off_mm before the slow touch.
    assert!((program.interpreter().state().position.0[2] + 4.08).abs() < 1e-9);
    let (errors, _) = run(text, &[-5.0, -5.2]);
    assert!(errors.len() == 1 && errors[0].contains("differs from the fast one"), "{errors:?}");
}

#[test]
fn modes_units_and_feed_of_the_program_stay() {
    let text = "G20\nG91 G95 F0.01 S100\no<probe_surface> call [-3] [1]\n#1 = #<_feed>\n#2 = #<_incremental>\n\
        #3 = #<_units_per_rev>\nM2\n";
    let (errors, program) = run(text, &[-0.2, -0.2]);
    let (state, parameters) = (program.interpreter().state(), program.interpreter().parameters());
    assert_eq!((errors, [1, 2, 3].map(|number| parameters.get(number))), (vec![], [0.01, 1.0, 1.0]));
    assert!((state.position.0[2] - (-0.2 + 1.0 / 25.4)).abs() < 1e-9, "{:?}", state.position);
}

#[test]
fn each_cycle_says_what_it_does_and_can_be_replaced() {
    for (name, text) in probing_cycles() {
        assert!(text.starts_with('(') && text.contains(&format!("o<{name}> sub")), "{name}");
        assert!(text.lines().all(|line| line.len() < 160 && line.is_ascii()), "{name}");
    }
    let text = "o<probe_surface> sub\no<probe_surface> endsub [7]\no<probe_surface> call\n#1 = #<_value>\nM2\n";
    let (errors, program) = run(text, &[]);
    assert_eq!((errors, program.interpreter().parameters().get(1)), (vec![], 7.0));
}
