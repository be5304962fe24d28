//! MDI blocks, one after another, compared with a program of the same lines; and the state that the program after them
//! has.

use retrace_gcode::{
    ActiveCodes, Axis, Canon, CanonStep, ErrorCode, ModalSnapshot, Pose, Program, Progress, Setup, Severity, SubFile,
    SubFiles, Tool, ToolTable,
};
use std::sync::Arc;

#[derive(Debug)]
struct Folder;

impl SubFiles for Folder {
    fn find(&self, name: &str) -> Option<SubFile> {
        let text = "O<shift> sub\nO1 repeat [#1]\nG91 G0 X1\nO1 endrepeat\nG90\n#<_shifted> = [#<_shifted> + \
            #1]\nO<shift> endsub\nM2\n";
        (name == "shift").then(|| SubFile { name: "shift.ngc".into(), text: Ok(text.into()) })
    }
}

fn setup() -> Setup {
    let mut tools = ToolTable::default();
    tools.insert(Tool { number: 1, offset: Pose::xyz(0.0, 0.0, 50.0), ..Tool::default() });
    Setup { tools, files: Some(Arc::new(Folder)), ..Setup::default() }
}

/// Returns the state after these steps, and the steps.
fn carried_out(mut program: Program<&'static [u8]>) -> (ModalSnapshot, Vec<CanonStep>) {
    let mut steps = Vec::new();
    while program.advance(&mut steps) == Progress::Line {}
    let errors: Vec<_> = program
        .interpreter()
        .diagnostics()
        .iter()
        .filter(|d| d.severity() == Severity::Error && d.code != ErrorCode::NoProgramEnd)
        .collect();
    assert!(errors.is_empty(), "{errors:?}");
    (program.interpreter().modal_snapshot(), steps)
}

/// Executes MDI blocks. Before each, the machine is where the previous block has moved it, or where `moved` puts it.
fn by_hand(lines: &[&str], moved: impl Fn(usize, Pose) -> Pose) -> (ModalSnapshot, Vec<Vec<CanonStep>>) {
    let mut carried: Option<ModalSnapshot> = None;
    let mut all = Vec::new();
    for (index, line) in lines.iter().enumerate() {
        let position = carried.as_ref().map_or(Pose::ZERO, |carried| {
            carried.state().machine_position().scaled_lengths(carried.state().units.millimetres())
        });
        let setup = Setup { position: moved(index, position), ..setup() };
        let setup = carried.iter().fold(setup, |setup, carried| setup.continuing(carried));
        let (left, steps) = carried_out(Program::mdi(line, setup).expect("an MDI block"));
        carried = Some(left);
        all.push(steps);
    }
    (carried.expect("at least one"), all)
}

fn is_move(step: &CanonStep) -> bool {
    matches!(step.canon, Canon::StraightTraverse(_) | Canon::StraightFeed(_) | Canon::ArcFeed(_))
}

const LINES: [&str; 22] = [
    "G0 X10 Y5 Z2",
    "G10 L20 P1 X0 Y0",
    "G92 Z1",
    "T1 M6",
    "G43",
    "#<_shifted> = 4",
    "G1 X3 F250",
    "Y4",
    "G55",
    "G10 L2 P2 X7 R0",
    "G2 X11 Y9 R20 F100",
    "G20",
    "G1 X0.5",
    "G21 G91",
    "G81 X1 Z-2 R1 L2",
    "X4",
    "G80 G90 G64 P0.02",
    "O<shift> call [3]",
    "G0 X#<_shifted>",
    "G93 G1 X1 F2",
    "G94 F100",
    "S100 M3",
];

#[test]
fn blocks_by_hand_do_what_the_same_lines_do_in_a_program() {
    for count in 1..=LINES.len() {
        let lines = &LINES[..count];
        let text = format!("{}\nM0\n", lines.join("\n"));
        let mut program = Program::<&[u8]>::prescanned(
            Arc::new(retrace_gcode::Prescan::scan("p", text.as_str().into(), &setup())),
            setup(),
        );
        let mut steps = Vec::new();
        while program.advance(&mut steps) == Progress::Line {}
        let (left, by_hand) = by_hand(lines, |_, position| position);
        assert_eq!(ActiveCodes::from(left.state()).to_string(), program.active().to_string(), "{lines:?}");
        for axis in Axis::ALL {
            let [hand, whole] = [left.state(), program.interpreter().state()].map(|state| state.position[axis]);
            assert!((hand - whole).abs() < 1e-9, "{lines:?}: {hand} {whole}");
        }
        let moves = by_hand.iter().flatten().filter(|step| is_move(step)).count();
        assert_eq!(moves, steps.iter().filter(|step| is_move(step)).count());
        assert_eq!(left.parameters().write(), program.interpreter().parameters().write());
    }
}

/// The modes that a track needs before the block's own steps are emitted again.
#[test]
fn each_block_tells_the_modes_that_its_moves_build_on() {
    let (_, steps) = by_hand(&["G43.1 Z5", "G18 G64 P0.1 Q0.2", "G20 F10", "G95 F0.5", "G1 X1 S100 M3"], |_, at| at);
    let canon: Vec<&Canon> = steps[4].iter().map(|step| &step.canon).collect();
    let has = |wanted: &Canon| canon.contains(&wanted);
    let length = canon
        .iter()
        .find_map(|canon| if let Canon::UseToolLengthOffset(length) = canon { Some(length[Axis::Z]) } else { None });
    assert!(length.is_some_and(|length| (length - 5.0 / 25.4).abs() < 1e-12), "{canon:?}");
    assert!(has(&Canon::SelectPlane(retrace_gcode::Plane::Zx)) && has(&Canon::SetFeedRate(0.5)), "{canon:?}");
    assert!(has(&Canon::SetFeedMode(retrace_gcode::FeedMode::UnitsPerRevolution)), "{canon:?}");
    assert!(canon.iter().any(|canon| matches!(canon, Canon::SetMotionControlMode(_))), "{canon:?}");
    assert_eq!(canon[0], &Canon::UseLengthUnits(retrace_gcode::LengthUnit::Inch));
}

/// A jog between two blocks: the second one begins at the machine position after it.
#[test]
fn the_machine_may_have_been_moved_in_between() {
    let jogged = Pose::xyz(100.0, 50.0, 25.0);
    let (left, _) =
        by_hand(&["G92 X1", "G10 L20 P1 Y0 Z0", "G91 G1 X5 F100"], |index, at| if index == 1 { jogged } else { at });
    assert_eq!(left.state().machine_position(), Pose::xyz(105.0, 50.0, 25.0));
    assert_eq!(left.state().position, Pose::xyz(106.0, 0.0, 0.0));
}

/// A program receives what a parameter file stores, the tool table and the tool; no mode, no name, no local parameter.
#[test]
fn the_program_after_them_sees_offsets_and_tools_and_no_modes() {
    let lines = [
        "G10 L20 P3 X-5",
        "G56",
        "G92 Y2",
        "G10 L1 P1 Z33",
        "T1 M6",
        "G20 G91 G18",
        "#31 = 7",
        "#5 = 9",
        "#<_name> = 1",
    ];
    let (left, _) = by_hand(&lines, |_, position| position);
    let text = "G43\nG1 X0 F#31\n#31 = [#5 + EXISTS[#<_name>]]\nM0\n";
    let follow = setup().following(&left);
    let program =
        Program::prescanned(Arc::new(retrace_gcode::Prescan::scan("p", text.into(), &follow)), follow.clone());
    let (after, _) = carried_out(program);
    let told = ActiveCodes::from(after.state()).to_string();
    assert_eq!(told, "G1 G17 G21 G40 G43 G56 G64 G80 G90 G91.1 G92 G94 G97 M5 M9 T1 F7 S0");
    assert_eq!((after.state().tool_offset[Axis::Z], after.state().origin[Axis::X]), (33.0, 5.0));
    assert_eq!(after.parameters().get(31), 0.0);
    // The same through the file.
    let file = retrace_gcode::Parameters::read(&left.parameters().write()).expect("its own text");
    assert_eq!(file, left.parameters().persistent());
}

#[test]
fn what_needs_more_than_a_line_is_refused_with_its_place() {
    let refused = |text: &str| Program::<&[u8]>::mdi(text, setup()).expect_err("refused")[0].code;
    for text in
        ["O1 while [1]", "O1 if [1]", "O1 endwhile", "O2 sub", "O100", "M99", "G41.1 D3", "G0 X1\nG0 X2", "%", "MCALL"]
    {
        assert_eq!(refused(text), ErrorCode::NotMdi, "{text}");
    }
    assert_eq!(
        (refused("  "), refused("G0 G1 X1"), refused("O<none> call")),
        (ErrorCode::EmptyProgram, ErrorCode::TwoGOfGroup, ErrorCode::NoSuchSub)
    );
    // In the block itself the diagnostics are as in a program.
    let mut program = Program::<&[u8]>::mdi("G1 X1", setup()).expect("it can be read");
    let mut steps = Vec::new();
    assert_eq!(program.advance(&mut steps), Progress::BlockError);
    assert_eq!(program.interpreter().diagnostics()[0].code, ErrorCode::ZeroFeed);
    for text in ["M2", "M30", "G40", "/G0 X1", "(MSG, hello)", "#1=2"] {
        carried_out(Program::mdi(text, setup()).expect(text));
    }
}
