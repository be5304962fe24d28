//! Cutter radius compensation, tested without LinuxCNC's interpreter: the tool path, the queue, and the refusals.

use proptest::prelude::*;
use retrace_gcode::{
    Axis, Canon, CanonStep, CanonText, Interpreter, LengthUnit, Pose, Program, Setup, Side, ToolTable,
};

const TOOLS: &str = "T1 D0.125\nT2 D0.0625\nT4 D-0.0625\nT8 D0.06 Q2\n";

fn setup() -> Setup {
    Setup { tools: ToolTable::read(TOOLS).expect("a tool table"), ..Setup::rs274() }
}

/// Returns the lines of the canonical text between the beginning and the end of these programs.
fn calls(program: &str) -> Vec<String> {
    let mut text = CanonText::new(Vec::new());
    for step in Program::new(program.as_bytes(), setup()) {
        text.write(&step).expect("writing to memory");
    }
    let text = String::from_utf8(text.into_inner().expect("memory")).expect("text");
    let calls = text.lines().skip(6).map(|line| line[13..].to_owned());
    calls.take_while(|call| !call.starts_with("SET_G5X") && call != "ON_RESET()").collect()
}

/// Returns the numbers and lines of the errors of a program.
fn faults(program: &str) -> Vec<(&'static str, u32)> {
    let diagnostics = retrace_gcode::check(program.as_bytes(), setup());
    diagnostics.iter().map(|found| (found.number(), found.line)).collect()
}

/// Returns all steps with their lines, of the blocks that were not refused.
fn steps(program: &str) -> Vec<CanonStep> {
    let mut interpreter = Interpreter::new(setup());
    let mut steps = Vec::new();
    for line in program.lines() {
        interpreter.line(line.as_bytes(), &mut steps).expect("a block");
    }
    steps
}

/// As `rs274 -g` prints it.
#[test]
fn a_move_waits_for_its_end_and_what_belongs_to_its_place_waits_behind_it() {
    let program = "F100 G1 X0\nT1 M6\nG41 D1\n(a)\nG1 X10 Y0\nM3 S100\n(b)\nT2\nY10\n(debug, #<_x> #<_y> #5420 #5421 \
        #<_ccomp>)\n\
        X0\nM8\nG40\nX-5\nM2\n";
    let wanted = [
        "SET_FEED_RATE(100.0000)",
        "STRAIGHT_FEED(0.0000, 0.0000, 0.0000, 0.0000, 0.0000, 0.0000)",
        "SELECT_TOOL(1)",
        "START_CHANGE()",
        "STOP_SPINDLE_TURNING(0)",
        "CHANGE_TOOL(1)",
        "COMMENT(\"interpreter: cutter radius compensation on left\")",
        "COMMENT(\"a\")",
        "SELECT_TOOL(2)",
        "STRAIGHT_FEED(8.4125, 1.5875, 0.0000, 0.0000, 0.0000, 0.0000)",
        "SET_SPINDLE_SPEED(0, 100.0000)",
        "START_SPINDLE_CLOCKWISE(0)",
        "COMMENT(\"b\")",
        "MESSAGE(\" 8.412500 10.000000 8.412500 10.000000 410.000000\")",
        "STRAIGHT_FEED(8.4125, 8.4125, 0.0000, 0.0000, 0.0000, 0.0000)",
        "STRAIGHT_FEED(-0.0000, 8.4125, 0.0000, 0.0000, 0.0000, 0.0000)",
        "FLOOD_ON()",
        "COMMENT(\"interpreter: cutter radius compensation off\")",
        "STRAIGHT_FEED(-5.0000, 10.0000, 0.0000, 0.0000, 0.0000, 0.0000)",
    ];
    assert_eq!(calls(program), wanted);
}

#[test]
fn a_step_tells_the_line_that_it_comes_from() {
    let steps = steps("F100 G1 X0\nG41.1 D1\nN3 X10\nM8\nN5 Y-10\nN6 G40\n");
    let moves: Vec<_> = steps
        .iter()
        .filter(|step| matches!(step.canon, Canon::StraightFeed(_) | Canon::ArcFeed(_) | Canon::FloodOn))
        .map(|step| (step.line, step.number.map(|number| number.value())))
        .collect();
    // The N word is that of the block that releases the step, as LinuxCNC prints it.
    assert_eq!(moves, [(1, None), (3, Some(5)), (4, Some(5)), (5, Some(5)), (5, Some(6))]);
}

#[test]
fn each_block_that_cannot_be_is_refused_by_its_number() {
    let entered = "F100 G1 X0\nG41.1 D2\nX20\n";
    for (block, number) in [
        ("G19 G41 D1", "E1651"),
        ("G41.1 D1 L2", "E1653"),
        ("G41 D8", "E1653"),
        ("G41.1", "E1505"),
        ("G41 D-1", "E1105"),
        ("G41 D1.5", "E1104"),
        ("G41 D77", "E1701"),
        ("G40 D1", "E1408"),
        ("G41 D1 G42", "E1405"),
        ("G40 L1", "E1408"),
    ] {
        assert_eq!(faults(&format!("F100\n{block}\nM2\n")), [(number, 2)], "{block}");
    }
    for block in [
        "G18",
        "M6 T1",
        "M48",
        "M50 P0",
        "M53 P1",
        "M62 P1",
        "M65 P1",
        "G43 H1",
        "G43.1 Z1",
        "G49",
        "G54",
        "G55",
        "G61",
        "G64 P1",
        "G98",
        "G28",
        "G30",
        "G28.1",
        "G30.1",
        "G52 X1",
        "G92 X1",
        "G92.1",
        "G92.2",
        "G92.3",
        "G53 G1 X1",
        "G10 L2 P1 X1",
        "G10 L20 P0 X1",
        "G40 M62 P1",
        "M66 P1",
        "M67 E1 Q2",
        "M68 E1 Q2",
        "G17.1",
        "G81 Z-1 R1",
        "G33 Z1 K1",
        "G38.2 Z-1",
        "G5.1 X1 Y1 I1 J1",
        "G76 P1 Z-1 I1 J1 R1 K1 Q1 H1",
        "G40 G18",
    ] {
        assert_eq!(faults(&format!("{entered}{block}\nM2\n")), [("E1656", 4)], "{block}");
    }
    for block in ["G10 L2 P2 X1", "G10 L20 P3 X1", "G17", "T2", "G40 G54", "G40 G92 X1", "M3 S1", "G20", "G80", "G4 P1"]
    {
        assert_eq!(faults(&format!("{entered}{block}\nM2\n")), [], "{block}");
    }
    for (blocks, number) in [
        ("G42", "E1652"),
        ("#1=#5420", "E1661"),
        ("(debug,#5420)\nX[#5428]", "E1661"),
        ("G40\nG2 X30 R10", "E1655"),
        ("G3 X21 Y1 R1", "E1659"),
        ("Y.5\nX0", "E1658"),
        ("Y.5\nX40", "E1658"),
        ("Y.5\nG40", "E1658"),
        ("Y.5\nM0", "E1658"),
        ("M0\nY20", "E1660"),
        ("G3 Y10 J5\nG2 Y0 J-5", "E1657"),
        ("G3 Y3 J1.5\nG1 Y-5", "E1657"),
    ] {
        let line = 3 + blocks.lines().count() as u32;
        assert_eq!(faults(&format!("{entered}{blocks}\nM2\n")), [(number, line)], "{blocks}");
    }
    assert_eq!(faults("F100 G1 X0\nG41.1 D2\nX1\nX30\nM2\n"), [("E1654", 3)]);
    assert_eq!(faults("F100 G1 X0\nG41.1 D2\nG2 X1 R9\nG1 X30\nM2\n"), [("E1654", 3)]);
}

#[test]
fn a_fault_is_told_once_and_the_path_is_found_again() {
    let program = "F100 G1 X0\nG41.1 D2\nX20\nY.5\nX0\nY20\nX-20\nG3 X-20.5 Y20.5 R.5\nG1 \
        Y40\nX-80\nY39.7\nG40\nX0\nG41.1 D1\nX9\nM2\n";
    assert_eq!(faults(program), [("E1658", 5), ("E1659", 8), ("E1658", 12)]);
}

/// A streamed program may never end.
#[test]
fn what_waits_has_a_bound() {
    let program = |blocks: usize| format!("F100 G1 X0\nG41.1 D1\nX10\n{}Y10\nG40\nM2\n", "M8\n".repeat(blocks));
    assert_eq!(faults(&program(9_998)), []);
    assert_eq!(faults(&program(15_000)), [("E1662", 10_003)]);
}

#[test]
fn polar_coordinates_go_on_from_the_programmed_path() {
    let calls = calls("F100 G1 X0\nG41.1 D1\nX10\nG1 @30\nG40\nM2\n");
    assert_eq!(
        calls[3..5],
        [10, 30].map(|x| format!("STRAIGHT_FEED({x}.0000, 0.5000, 0.0000, 0.0000, 0.0000, 0.0000)"))
    );
}

/// LinuxCNC emits this one immediately.
#[test]
fn a_change_to_diameters_passes_what_waits() {
    let calls = calls("F100 G1 X0\nG41.1 D1\nX10\nG7\n(last)\nG40\nM2\n");
    assert!(
        calls[3].contains("Lathe diameter mode") && calls[4].starts_with("STRAIGHT_FEED") && calls[5].contains("last")
    );
}

#[test]
fn nothing_that_waits_is_lost_at_a_closing_percent_sign() {
    let calls = calls("%\nF100 G1 X0\nG41.1 D1\nX10\n%\n");
    assert_eq!(
        calls[calls.len() - 2..],
        ["STRAIGHT_FEED(10.0000, 0.5000, 0.0000, 0.0000, 0.0000, 0.0000)", "FINISH()"]
    );
}

#[test]
fn a_feed_that_waits_is_converted_with_the_units() {
    let mut unit = LengthUnit::Millimetre;
    let mut rates = Vec::new();
    for step in steps("F254 G1 X0\nG41.1 D1\nX10\nF508\nG20\nY10\nG40\n") {
        match step.canon {
            Canon::UseLengthUnits(new) => unit = new,
            Canon::SetFeedRate(rate) => rates.push(rate * unit.millimetres()),
            _ => {}
        }
    }
    assert!((rates[0] - 254.0).abs() < 1e-9 && (rates[1] - 508.0).abs() < 1e-9, "{rates:?}");
}

/// LinuxCNC would move the tool to the end of the arc directly.
#[test]
fn a_lathe_tool_comes_to_the_arc_that_leads_to_the_path() {
    let calls = calls("F100 G18 G1 X0 Z0\nG41.1 D1 L2\nG2 Z10 X10 R20\nG1 X20\nG40\nM2\n");
    let wanted = "STRAIGHT_FEED(-0.5000, 0.0000, -0.5000, 0.0000, 0.0000, 0.0000)";
    assert!(calls.iter().any(|call| call == wanted), "{calls:?}");
}

#[test]
fn the_state_tells_side_and_both_positions() {
    let mut interpreter = Interpreter::new(setup());
    let mut steps = Vec::new();
    for line in ["F100 G1 X0", "G42 D4", "X10", "Y-20"] {
        interpreter.line(line.as_bytes(), &mut steps).expect("a block");
    }
    let state = interpreter.state();
    let compensation = state.compensation.expect("it is on");
    // The diameter of tool 4 is negative, so the tool is on the other side; its radius is 1/32 of an inch.
    assert_eq!((compensation.side, state.path_position()), (Side::Left, &Pose::xyz(10.0, -20.0, 0.0)));
    assert!((compensation.radius - 0.793_75).abs() < 1e-9);
    assert!((state.position[Axis::X] - 10.793_75).abs() < 1e-9 && (state.position[Axis::Y] + 20.0).abs() < 1e-9);
}

/// Returns the points of the tool's path from the steps.
fn path(steps: &[CanonStep]) -> Vec<(f64, f64)> {
    let mut at = (0.0, 0.0);
    let mut points = Vec::new();
    for step in steps {
        let (end, centre, turns) = match &step.canon {
            Canon::StraightFeed(end) | Canon::StraightTraverse(end) => (*end, None, 0),
            Canon::ArcFeed(arc) => (arc.end, Some((arc.first_centre, arc.second_centre)), arc.turns),
            _ => continue,
        };
        let end = (end[Axis::X], end[Axis::Y]);
        for part in 1..=40 {
            let share = f64::from(part) / 40.0;
            points.push(match centre {
                None => (at.0 + share * (end.0 - at.0), at.1 + share * (end.1 - at.1)),
                Some((x, y)) => {
                    let (from, to) = ((at.1 - y).atan2(at.0 - x), (end.1 - y).atan2(end.0 - x));
                    let turn = (to - from).rem_euclid(std::f64::consts::TAU);
                    let angle = from + share * if turns > 0 { turn } else { turn - std::f64::consts::TAU };
                    let radius = (at.0 - x).hypot(at.1 - y);
                    (x + radius * angle.cos(), y + radius * angle.sin())
                }
            });
        }
        at = end;
    }
    points
}

fn distance(point: (f64, f64), (a, b): ((f64, f64), (f64, f64))) -> f64 {
    let (along, from) = ((b.0 - a.0, b.1 - a.1), (point.0 - a.0, point.1 - a.1));
    let share = (along.0 * from.0 + along.1 * from.1) / (along.0 * along.0 + along.1 * along.1);
    let share = share.clamp(0.0, 1.0);
    (from.0 - share * along.0).hypot(from.1 - share * along.1)
}

proptest! {
    /// On either side of a polygon the tool touches it everywhere and cuts into it nowhere, except for corners of less
    /// than 0.05 rad, which count as smooth.
    #[test]
    fn the_tool_is_at_its_radius_from_a_polygon(reaches in prop::collection::vec(40.0..60.0_f64, 4..12), side in 0..2,
        radius in 0.1..2.0_f64) {
        let corners = reaches.len();
        let corner = |(index, reach): (usize, &f64)| {
            let angle = std::f64::consts::TAU * index as f64 / corners as f64;
            (reach * angle.cos(), reach * angle.sin())
        };
        let polygon: Vec<(f64, f64)> = reaches.iter().enumerate().map(corner).collect();
        // In from the middle of an edge, around, and a little beyond, so that the path is joined like any other.
        let last = polygon[corners - 1];
        let middle = (0.5 * (polygon[0].0 + last.0), 0.5 * (polygon[0].1 + last.1));
        let towards = ((middle.0 - last.0) * 0.5 + last.0, (middle.1 - last.1) * 0.5 + last.1);
        let mut program = format!("F100\nG0 X{:.9} Y{:.9}\nG4{}.1 D{:.9}\nG1 X{:.9} \
            Y{:.9}\n", towards.0, towards.1, side + 1, 2.0 * radius, middle.0, middle.1);
        for (x, y) in polygon.iter().chain([&middle]) {
            program += &format!("X{x:.9} Y{y:.9}\n");
        }
        program += "G40\n";
        let steps = steps(&program);
        // Without the moves to the start and the entry.
        let points = path(&steps).split_off(80);
        let edges: Vec<_> = (0..corners).map(|corner| (polygon[corner], polygon[(corner + 1) % corners])).collect();
        for point in points {
            let nearest = edges.iter().map(|edge| distance(point, *edge)).fold(f64::INFINITY, f64::min);
            prop_assert!((nearest - radius).abs() < 1e-6 + 0.001_3 * radius, "{point:?} is {nearest} from the \
                polygon, not {radius}\n{program}");
        }
    }
}

/// As in `rs274 -g`: after G40 the position is the end of the programmed path, and M6 uses that of the machine.
#[test]
fn a_tool_change_behind_g40_takes_the_position_of_the_tool() {
    let last = |between: &str| {
        let program = format!("F100 G41.1 D2\nG1 X10\nX20 Y0\nG40\n{between}\nG0 Z3\nM2\n");
        let steps = retrace_gcode::Program::new(program.as_bytes(), retrace_gcode::Setup::rs274()).into_iter();
        let ends = steps.filter_map(|step| match step.canon {
            retrace_gcode::Canon::StraightTraverse(end) => {
                Some(format!("{:.4} {:.4} {:.4}", end.0[0], end.0[1], end.0[2]))
            }
            _ => None,
        });
        ends.last()
    };
    assert_eq!(last("M8").as_deref(), Some("20.0000 0.0000 3.0000"));
    assert_eq!(last("T1 M6").as_deref(), Some("20.0000 1.0000 3.0000"));
    assert_eq!(last("M61 Q1").as_deref(), Some("20.0000 1.0000 3.0000"));
    assert_eq!(last("G92 X0 Y0\nT1 M6").as_deref(), Some("0.0000 1.0000 3.0000"));
    assert_eq!(last("T1 M6\nT2 M6").as_deref(), Some("20.0000 1.0000 3.0000"));
    assert_eq!(last("G1 Y0\nT1 M6").as_deref(), Some("20.0000 0.0000 3.0000"));
}
