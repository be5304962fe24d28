//! Offsets and coordinate systems: none of them moves the machine, and each sets the position that it defines.

use proptest::prelude::*;
use retrace_gcode::{Axis, Canon, Interpreter, LengthUnit, Pose, Setup};

/// Executes a block that must be valid.
fn block(interpreter: &mut Interpreter, text: &str) -> Vec<Canon> {
    let mut steps = Vec::new();
    interpreter.line(text.as_bytes(), &mut steps).unwrap_or_else(|_| panic!("{text}: {:?}", interpreter.diagnostics()));
    steps.into_iter().map(|step| step.canon).collect()
}

/// Returns the machine's position in millimetres.
fn machine(interpreter: &Interpreter) -> Pose {
    interpreter.state().machine_position().scaled_lengths(interpreter.state().units.millimetres())
}

fn is_near(left: &Pose, right: &Pose) -> bool {
    left.0.iter().zip(&right.0).all(|(left, right)| (left - right).abs() < 1e-9)
}

/// A block that sets an offset, and the position that it defines, if it defines one.
fn offset_block() -> impl Strategy<Value = (String, Option<(f64, f64)>)> {
    let value = -500..500_i32;
    (0..9_u8, 1..10_u8, value.clone(), value, 0..360_i32).prop_map(|(kind, system, x, y, rotation)| {
        let (x, y) = (f64::from(x) / 8.0, f64::from(y) / 8.0);
        match kind {
            0 => (format!("G10 L2 P{system} X{x} Y{y} Z1 R{rotation}"), None),
            1 => (format!("G10 L20 P0 X{x} Y{y}"), Some((x, y))),
            2 => (format!("G10 L20 P{system} Y{y} Z{x}"), None),
            3 => (format!("G92 X{x} Y{y}"), Some((x, y))),
            4 => (format!("G52 X{x} Z{y}"), None),
            5 => ((if rotation % 2 == 0 { "G92.1" } else { "G92.2" }).to_owned(), None),
            6 => (format!("G43.1 X{x} Z{y}"), None),
            7 => ((if rotation % 2 == 0 { "G20" } else { "G21" }).to_owned(), None),
            _ => (
                format!("G{}", ["54", "55", "56", "57", "58", "59", "59.1", "59.2", "59.3"][usize::from(system) - 1]),
                None,
            ),
        }
    })
}

proptest! {
    #[test]
    fn no_offset_moves_the_machine(blocks in prop::collection::vec(offset_block(), 1..20)) {
        let mut interpreter = Interpreter::new(Setup::default());
        block(&mut interpreter, "G0 X12 Y-7 Z3");
        let before = machine(&interpreter);
        for (text, position) in blocks {
            block(&mut interpreter, &text);
            prop_assert!(is_near(&machine(&interpreter), &before), "{text}: {:?}", machine(&interpreter));
            if let Some((x, y)) = position {
                let state = interpreter.state();
                let made = (state.position[Axis::X] - x, state.position[Axis::Y] - y);
                prop_assert!(made.0.abs() < 1e-9 && made.1.abs() < 1e-9, "{text}: {:?}", state.position);
            }
        }
    }

    /// G53 and G28 use machine coordinates, whatever offsets are in force.
    #[test]
    fn machine_coordinates_are_reached_through_any_offsets(blocks in prop::collection::vec(offset_block(), 1..20)) {
        let mut interpreter = Interpreter::new(Setup::default());
        block(&mut interpreter, "G0 X12 Y-7 Z3");
        block(&mut interpreter, "G28.1");
        for (text, _) in &blocks {
            block(&mut interpreter, text);
        }
        block(&mut interpreter, "G21 G53 G0 X1 Y2 Z3.5");
        prop_assert!(is_near(&machine(&interpreter), &Pose::xyz(1.0, 2.0, 3.5)), "{:?}", machine(&interpreter));
        block(&mut interpreter, "G20 G28");
        prop_assert!(is_near(&machine(&interpreter), &Pose::xyz(12.0, -7.0, 3.0)), "{:?}", machine(&interpreter));
    }
}

/// LinuxCNC is wrong here: it reads the tool offset of 12.9794 mm as 12.9794 inches.
#[test]
fn a_tool_offset_in_force_is_converted_with_the_units() {
    let mut interpreter = Interpreter::new(Setup::default());
    block(&mut interpreter, "G21 G43 H1");
    block(&mut interpreter, "G20 G53 G0 Z0");
    let offset = interpreter.state().tool_offset[Axis::Z];
    assert!((offset - 0.511).abs() < 1e-12, "{offset}");
    assert_eq!(interpreter.state().units, LengthUnit::Inch);
    assert!(machine(&interpreter)[Axis::Z].abs() < 1e-12);
}

#[test]
fn a_feed_keeps_its_meaning_when_the_units_change() {
    let mut interpreter = Interpreter::new(Setup::default());
    block(&mut interpreter, "G21 F254");
    block(&mut interpreter, "G20");
    assert!((interpreter.state().feed_rate - 10.0).abs() < 1e-12);
}

#[test]
fn a_program_starts_from_what_the_parameters_and_the_machine_say() {
    let mut parameters = retrace_gcode::Parameters::default();
    for (number, value) in [(5220, 2.0), (5241, 10.0), (5210, 1.0), (5211, 1.0)] {
        parameters.set(number, value);
    }
    let setup = Setup { parameters, position: Pose::xyz(15.0, 2.0, 0.0), ..Setup::default() };
    let interpreter = Interpreter::new(setup);
    assert_eq!(interpreter.state().coordinate_system, 2);
    assert_eq!(interpreter.state().position, Pose::xyz(4.0, 2.0, 0.0));
}
