//! From program text to moves in machine coordinates: units, offsets, rotation, feeds, switching.

use retrace_config::MachineConfig;
use retrace_controller::{
    BlockDecoder, Cancelled, CheckFinding, DecodedBlock, MotionSink, PlanWriteError, SwitchInstruction, feed_program,
};
use retrace_gcode::{Axis, AxisSet, CanonStep, Program, Progress, Setup};
use retrace_link::OutputChange;
use retrace_motion::{Arc, FeedRate, PathMode};

/// Code, channels with their values, periods.
type Switched = (String, Vec<(u8, i32)>, u32);

#[derive(Debug, Default)]
struct Moves {
    moves: Vec<([f64; 3], FeedRate, PathMode)>,
    arcs: Vec<Arc<3>>,
    switched: Vec<Switched>,
    actions: Vec<(u8, i32)>,
}

impl MotionSink<3> for Moves {
    fn straight(&mut self, end_mm: [f64; 3], feed: FeedRate, mode: PathMode, _: u32) -> Result<(), PlanWriteError> {
        self.moves.push((end_mm, feed, mode));
        Ok(())
    }
    fn arc(&mut self, arc: &Arc<3>, _: FeedRate, _: PathMode, _: u32) -> Result<(), PlanWriteError> {
        self.arcs.push(*arc);
        Ok(())
    }
    fn action(&mut self, change: OutputChange, _: u32) {
        self.actions.push((change.channel, change.value));
    }
    fn exclusive(&mut self, switch: SwitchInstruction<'_>) -> Result<(), Cancelled> {
        let changes = switch.changes.iter().map(|c| (c.channel, c.value)).collect();
        self.switched.push((switch.code.into(), changes, switch.periods));
        Ok(())
    }
    fn message(&mut self, _: String, _: u32) -> Result<(), Cancelled> {
        Ok(())
    }
}

struct Text(Program<std::io::Cursor<Vec<u8>>>);

impl BlockDecoder for Text {
    fn next_block(&mut self, steps: &mut Vec<CanonStep>) -> DecodedBlock {
        match self.0.advance(steps) {
            Progress::End => DecodedBlock::End,
            Progress::Line => DecodedBlock::Block,
            Progress::BlockError => DecodedBlock::BlockError(format!("{:?}", self.0.interpreter().diagnostics())),
        }
    }
}

fn run_on(machine: &MachineConfig, text: &str) -> (Moves, Vec<CheckFinding>) {
    let axes = AxisSet::from_axes(&Axis::ALL);
    let program = Program::new(std::io::Cursor::new(text.as_bytes().to_vec()), Setup { axes, ..Setup::default() });
    let mut moves = Moves::default();
    let (_, findings) = feed_program(machine, &mut Text(program), &mut moves);
    (moves, findings)
}

fn run(text: &str) -> Moves {
    let (moves, findings) = run_on(&MachineConfig::built_in().expect("valid"), text);
    assert_eq!(findings, []);
    moves
}

fn near(a: [f64; 3], b: [f64; 3]) -> bool {
    a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-9)
}

#[test]
fn inches_and_millimetres_come_out_in_millimetres() {
    let moves = run("G20\nG1 X1 Y-2 F60\nG21 X1\nG0 Z3\nM2\n").moves;
    let an_inch_a_second = |feed| matches!(feed, FeedRate::PerSecond(v) if (v - 25.4).abs() < 1e-9);
    assert!(near(moves[0].0, [25.4, -50.8, 0.0]) && an_inch_a_second(moves[0].1), "{moves:?}");
    // the feed was set in inches and stays what it was
    assert!(near(moves[1].0, [1.0, -50.8, 0.0]) && an_inch_a_second(moves[1].1));
    assert_eq!(moves[2].1, FeedRate::Rapid);
}

#[test]
fn inverse_time_gives_the_speed_that_the_block_needs() {
    // 10 mm in half a minute, then in a second
    let moves = run("G21 G93\nG1 X10 F2\nX20 F60\nM2\n").moves;
    assert_eq!(moves[0].1, FeedRate::PerSecond(20.0 / 60.0));
    assert_eq!(moves[1].1, FeedRate::PerSecond(10.0));
}

#[test]
fn work_offsets_g92_and_rotation_are_applied_in_their_order() {
    let text = "G21 G10 L2 P1 X10 Y20 Z30 R90\nG0 X1 Y0 Z0\nG92 X0\nG0 X1 Y0\nG53 G0 X0 Y0 Z0\nM2\n";
    let moves = run(text).moves;
    assert!(near(moves[0].0, [10.0, 21.0, 30.0]), "{moves:?}");
    assert!(near(moves[1].0, [10.0, 22.0, 30.0]), "{moves:?}");
    assert!(near(moves[2].0, [0.0, 0.0, 0.0]), "{moves:?}");
}

#[test]
fn arcs_keep_their_centre_plane_and_sense() {
    let arcs = run("G20 G0 X1\nG3 X0 Y1 I-1 F10\nG18 G2 X1 Z1 I1 K0\nM2\n").arcs;
    assert_eq!((arcs[0].plane, arcs[0].rotation), ([0, 1], 1));
    assert!((arcs[0].centre_mm[0]).abs() < 1e-9 && (arcs[0].end_mm[1] - 25.4).abs() < 1e-9);
    // G18 counts Z first, X second
    assert_eq!((arcs[1].plane, arcs[1].rotation), ([2, 0], -1));
    assert!((arcs[1].centre_mm[1] - 25.4).abs() < 1e-9 && arcs[1].centre_mm[0].abs() < 1e-9);
}

#[test]
fn path_modes_and_the_machine_s_own_tolerance() {
    let modes: Vec<PathMode> =
        run("G21 F100 G1 X1\nG64 P0.2 X2\nG64 X3\nG61 X4\nG61.1 X5\nM2\n").moves.iter().map(|m| m.2).collect();
    let blend = PathMode::blend;
    assert_eq!(modes, [blend(0.05), blend(0.2), blend(0.05), PathMode::ExactPath, PathMode::ExactStop]);
}

/// Q applies where it differs from P; without it they are equal. It follows the units, and its G64.
#[test]
fn the_naive_cam_tolerance_goes_with_its_path_mode() {
    let text = "G21 F100\nG64 P0.2 Q0.05 X1 G1\nG64 P0.2 X2\nG64 P0.2 Q0.2 X3\nG64 Q0.01 X4\nG64 P0.1 Q0 X5\n\
                G20 G64 P0.01 Q0.001 X0.3\nG61 X0.4\nG64 X0.5\nM2\n";
    let merges: Vec<(f64, Option<f64>)> = run(text)
        .moves
        .iter()
        .filter_map(|m| {
            if let PathMode::Blend { tolerance_mm, merge_mm } = m.2 { Some((tolerance_mm, merge_mm)) } else { None }
        })
        .collect();
    let inch = |x: f64| x * 25.4;
    assert_eq!(
        merges,
        [
            (0.2, Some(0.05)),
            (0.2, None),
            (0.2, None),
            (0.05, Some(0.01)),
            (0.1, Some(0.0)),
            (inch(0.01), Some(inch(0.001))),
            (0.05, None)
        ]
    );
}

#[test]
fn what_switches_is_exclusive_unless_the_machine_file_has_it_in_passing() {
    let machine =
        MachineConfig::parse("[code.M3]\nduration_ms = 500\n[code.M8]\nclass = \"synchronous\"\n", "m").expect("valid");
    let (moves, findings) = run_on(&machine, "S1000 M3\nM8\nG4 P0.25\nM62 P5\nM0\nM9\nM2\n");
    assert_eq!(findings, []);
    let codes: Vec<&str> = moves.switched.iter().map(|(code, ..)| code.as_str()).collect();
    assert_eq!(codes[..4], ["S", "M3", "G4", "M0"]);
    assert_eq!(moves.switched[0].1, [(65, 1_000_000)]);
    assert_eq!(moves.switched[1], ("M3".into(), vec![(64, 1)], 500));
    assert_eq!(moves.switched[2].2, 250);
    assert_eq!(moves.actions, [(67, 1), (5, 1)]);
}

#[test]
fn an_axis_that_is_not_there_and_an_output_that_is_not_there_are_named() {
    let (moves, findings) = run_on(&MachineConfig::built_in().expect("valid"), "G21 G0 X1 A5\nM64 P64\nG0 X2 A0\nM2\n");
    let numbers: Vec<(u32, &str)> = findings.iter().map(|f| (f.line, f.number)).collect();
    assert_eq!(numbers, [(1, "E4301"), (2, "E4303")]);
    assert_eq!(moves.moves.len(), 1);
}

/// A quadratic spline is a parabola: chords stay within a tenth of the tolerance, turned and shifted like any other
/// move.
#[test]
fn a_spline_becomes_chords_near_its_curve() {
    let run = run("G21 G64 P.1 F600\nG10 L2 P1 X5 Z2 R90\nG0 X0 Y0 Z3\nG5.1 X40 Y0 I20 J20\nM2\n");
    let points: Vec<_> = run.moves.iter().map(|(end, ..)| *end).collect();
    assert!(near(points[0], [5.0, 0.0, 5.0]) && near(points[points.len() - 1], [5.0, 40.0, 5.0]), "{points:?}");
    assert!((16..=64).contains(&points.len()), "{} chords", points.len());
    for pair in points.windows(2) {
        // y = t·40, x = 5 − 40·t·(1 − t) at the ends of each chord; in its middle the curve is no farther than 0.01.
        let curve = |y: f64| 5.0 - y * (40.0 - y) / 40.0;
        assert!((pair[1][0] - curve(pair[1][1])).abs() < 1e-9, "{pair:?}");
        let middle = [(pair[0][0] + pair[1][0]) / 2.0, (pair[0][1] + pair[1][1]) / 2.0];
        assert!((middle[0] - curve(middle[1])).abs() < 0.02, "{pair:?}");
    }
}

#[test]
fn what_the_card_does_not_have_is_refused_by_name() {
    let machine = MachineConfig::built_in().expect("valid");
    for code in ["G33", "G33.1"] {
        let (_, findings) = run_on(&machine, &format!("S9 M3 {code} Z1 K1\nG0 Z2\nM2\n"));
        let numbers: Vec<_> = findings.iter().map(|found| (found.line, found.number)).collect();
        assert_eq!(numbers, [(1, "E4320")], "once");
    }
    let (_, findings) = run_on(&machine, "M19 R90\nM2\n");
    assert!(findings.iter().any(|found| found.number == "E4302" && found.cause.contains("M19")), "{findings:?}");
}
