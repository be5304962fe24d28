//! The extended language where LinuxCNC's text output does not show the result: control points, inputs, user codes,
//! aborts.

use crate::common;

use common::canon_text;
use retrace_gcode::{Canon, ControlPoint, Program, Progress, Setup, UserCodes, WaitFor, WaitForInput, WaitInput};

/// Returns every canonical function of a program, and the numbers of its errors.
fn run(program: &str, setup: Setup) -> (Vec<Canon>, Vec<&'static str>) {
    let mut program = Program::new(program.as_bytes(), setup);
    let mut steps = Vec::new();
    while program.advance(&mut steps) == Progress::Line {}
    let found = program.interpreter().diagnostics().iter().map(|found| found.number()).collect();
    (steps.into_iter().map(|step| step.canon).collect(), found)
}

fn splines(program: &str) -> Vec<(u32, Vec<ControlPoint>)> {
    let (canon, found) = run(program, Setup::rs274());
    assert!(found.is_empty(), "{found:?}");
    canon
        .into_iter()
        .filter_map(|canon| match canon {
            Canon::NurbsFeed(spline) => Some((spline.order, spline.points.to_vec())),
            _ => None,
        })
        .collect()
}

fn plain(points: &[(f64, f64)]) -> Vec<ControlPoint> {
    points.iter().map(|&(x, y)| ControlPoint::plain(x, y)).collect()
}

#[test]
fn a_cubic_spline_goes_on_in_the_direction_in_which_the_last_one_ended() {
    let found = splines("F100 G5 X10 Y0 I1 J2 P-3 Q-4\nG91 G5 X10 Y5 P1 Q1\nM2\n");
    let first = plain(&[(0.0, 0.0), (1.0, 2.0), (7.0, -4.0), (10.0, 0.0)]);
    let second = plain(&[(10.0, 0.0), (13.0, 4.0), (21.0, 6.0), (20.0, 5.0)]);
    assert_eq!(found, [(4, first), (4, second)]);
}

/// The direction is a length, so it is converted with the units.
#[test]
fn the_direction_of_a_spline_follows_the_units() {
    let found = splines("F100 G5 X0 Y25.4 P0 Q-25.4\nG20 G5 X0 Y3 P0 Q0\nM2\n");
    let near = |point: ControlPoint, x: f64, y: f64| (point.x - x).hypot(point.y - y) < 1e-12;
    assert!(near(found[1].1[0], 0.0, 1.0) && near(found[1].1[1], 0.0, 2.0), "{found:?}");
}

#[test]
fn a_quadratic_spline_has_three_points() {
    let found = splines("F100 G0 X1 Y1\nG5.1 X2 Y0 I1 J3\nM2\n");
    assert_eq!(found, [(3, plain(&[(1.0, 1.0), (2.0, 4.0), (2.0, 0.0)]))]);
}

#[test]
fn control_points_are_collected_with_their_weights_until_the_end() {
    let found = splines("F100 G0 X1\nG5.2 P1 L4\nX2 Y1 P2\nX3 Y0 P.5\nM8\nX4 Y0 P1\nG5.3\nG0 X0\nM2\n");
    let weights: Vec<_> = found[0].1.iter().map(|point| point.weight).collect();
    assert_eq!((found[0].0, weights), (4, vec![1.0, 2.0, 0.5, 1.0]));
}

#[test]
fn an_input_is_asked_for_with_what_is_waited_for() {
    let (canon, found) = run("M66 P3 L2 Q1.5\nM66 E1\nM2\n", Setup::rs274());
    assert!(found.is_empty(), "{found:?}");
    let asked: Vec<_> =
        canon.into_iter().filter_map(|canon| if let Canon::Wait(wait) = canon { Some(wait) } else { None }).collect();
    assert_eq!(
        asked,
        [
            WaitForInput { input: WaitInput::Digital(3), wait_for: WaitFor::Fall, timeout: 1.5 },
            WaitForInput { input: WaitInput::Analog(1), wait_for: WaitFor::Immediate, timeout: 0.0 },
        ]
    );
}

#[test]
fn user_codes_are_carried_out_when_they_are_declared_and_refused_by_name_when_not() {
    let setup = || Setup { user_codes: UserCodes::default().with(100).with(199).with(99), ..Setup::rs274() };
    let (canon, found) = run("M100 P1.5\nM199 Q-2 M3 S1\nM2\n", setup());
    assert!(found.is_empty(), "{found:?}");
    let codes: Vec<_> = canon
        .into_iter()
        .filter_map(|canon| if let Canon::UserCode { number, p, q } = canon { Some((number, p, q)) } else { None })
        .collect();
    assert_eq!(codes, [(100, Some(1.5), None), (199, None, Some(-2.0))]);
    assert_eq!(run("M101\nM2\n", setup()).1, ["E1724"]);
    assert_eq!(run("M100 M199\nM2\n", setup()).1, ["E1406"]);
}

#[test]
fn abort_ends_a_program_with_its_text() {
    let mut program = Program::new("#1=7\n(abort,no #1)\nG0 X1\nM2\n".as_bytes(), Setup::rs274());
    let mut steps = Vec::new();
    while program.advance(&mut steps) == Progress::Line {}
    let found: Vec<_> =
        program.interpreter().diagnostics().iter().map(|found| (found.number(), found.message.as_str())).collect();
    assert_eq!(found, [("E1728", "no 7.000000")]);
}

/// LinuxCNC loses a feed that G93 has replaced, offsets that are not those of the tool in the spindle, and switches
/// that were off.
#[test]
fn saved_modes_come_back_whole() {
    let between = "G93 G20 G91 G18 G61 G55 G7 G90.1 G99 M9\nM48\nM52 P1 G49\n";
    let program = format!("F8.25 S7.5 G43.1 Z3\nM49\nM7\nG64 P.25 Q.125\nM70\n{between}M72\nM2\n");
    let mut program = Program::new(program.as_bytes(), Setup::rs274());
    let mut steps = Vec::new();
    let mut kept = None;
    while program.advance(&mut steps) == Progress::Line {
        match program.line_text().as_ref() {
            "M70" => kept = Some(program.interpreter().state().clone()),
            "M72" => break,
            _ => {}
        }
    }
    let (mut now, mut then) = (program.interpreter().state().clone(), kept.expect("M70"));
    // A change of units and back changes the last digits.
    let near = |a: f64, b: f64| (a - b).abs() < 1e-9;
    assert!(near(now.feed_rate, then.feed_rate) && near(now.naivecam_tolerance, then.naivecam_tolerance));
    assert!(now.position.minus(&then.position).0.iter().all(|way| near(*way, 0.0)));
    for state in [&mut now, &mut then] {
        (state.feed_rate, state.naivecam_tolerance, state.position) = (0.0, 0.0, retrace_gcode::Pose::ZERO);
    }
    assert_eq!(now, then);
}

#[test]
fn a_log_goes_out_as_functions_and_python_is_refused_by_name() {
    let (text, failed) = canon_text("(logopen,a b.txt)\n(log,%d#5220)\n(logclose)\nM2\n");
    let lines: Vec<_> = text.lines().skip(6).take(3).map(|line| &line[13..]).collect();
    assert!(!failed);
    assert_eq!(lines, ["LOGOPEN(\"a b.txt\")", "LOG(\"1\")", "LOGCLOSE()"]);
    for line in ["(py,x)", ";PY, x", "(PyRun,x)", "(pyreload)", "G0 X1 ; py,x"] {
        assert_eq!(run(&format!("{line}\nM2\n"), Setup::rs274()).1, ["E1729"], "{line}");
    }
}

#[test]
fn fixed_values_can_be_read_and_not_assigned() {
    let setup = || Setup { fixed_values: vec![("_ini[foo]bar".to_owned(), 2.5)], ..Setup::rs274() };
    let (canon, found) =
        run("G0 X#<_ini[FOO]BAR> Y[EXISTS[#<_INI[foo]bar>]] Z[EXISTS[#<_ini[foo]baz>]]\nM2\n", setup());
    assert!(found.is_empty(), "{found:?}");
    assert!(canon.contains(&Canon::StraightTraverse(retrace_gcode::Pose::xyz(2.5, 1.0, 0.0))), "{canon:?}");
    assert_eq!(run("#<_ini[foo]bar>=1\nM2\n", setup()).1, ["E1303"]);
}

#[test]
fn saved_modes_hold_feed_per_turn_surface_speed_and_compensation() {
    use retrace_gcode::{FeedMode, Interpreter, Side};
    let mut interpreter = Interpreter::new(Setup::rs274());
    let mut steps = Vec::new();
    for line in ["S100 M3 F1 G95", "G96 D1000 S200", "G41.1 D0.5", "M70", "G94 F10 G97 S50 G40", "M72"] {
        assert!(interpreter.line(line.as_bytes(), &mut steps).is_ok(), "{line}: {:?}", interpreter.diagnostics());
    }
    let state = interpreter.state();
    assert_eq!((state.feed_mode, state.feed_rate), (FeedMode::UnitsPerRevolution, 1.0));
    assert_eq!((state.constant_surface_speed, state.max_spindle_speed, state.spindle_speed), (true, 1000.0, 200.0));
    assert_eq!(state.compensation.map(|found| (found.side, found.radius)), Some((Side::Left, 0.25)));
}

/// Returns the texts of the messages of a program.
fn messages(program: &str) -> Vec<String> {
    let (canon, found) = run(program, Setup::rs274());
    assert!(found.is_empty(), "{program}: {found:?}");
    let texts = canon.into_iter().filter_map(|canon| match canon {
        Canon::Message(text) => Some(text.to_string()),
        _ => None,
    });
    texts.collect()
}

/// Three steps of 0.1 are a little more than 0.3.
#[test]
fn a_loop_with_le_makes_its_last_pass() {
    let program = "#<z>=.1\nO1 while [#<z> LE .3]\n(debug,#<z>)\n#<z>=[#<z>+.1]\nO1 endwhile\nM2\n";
    assert_eq!(messages(program), ["0.100000", "0.200000", "0.300000"]);
    assert_eq!(messages(&program.replace("LE .3", "LT .3")), ["0.100000", "0.200000"]);
}

#[test]
fn inverse_time_has_no_least_feed() {
    let (canon, _) = run("G93 G1 X.01 F1\nX.01 F1\nM2\n", Setup::rs274());
    let feeds = canon.iter().filter_map(|canon| if let Canon::SetFeedRate(feed) = canon { Some(*feed) } else { None });
    assert_eq!(feeds.take(2).collect::<Vec<_>>(), [0.01, 0.0]);
}

#[test]
fn the_machine_position_and_the_offset_in_force_can_be_read() {
    let offsets = "G10 L2 P1 X1\nG92 Y2\nG43.1 Z3\nG0 X5 Y6 Z7\n";
    let show = "(debug,#5021 #5022 #5023 #<_abs_x> #<_abs_y> #<_abs_z>)\n(debug,#5029 #<_abs_u> #<_abs_v> #<_abs_w>)\n";
    assert_eq!(
        messages(&format!("{offsets}{show}M2\n")),
        ["6.000000 4.000000 10.000000 6.000000 4.000000 10.000000", "0.000000 0.000000 0.000000 0.000000"]
    );
    let lengths = "(debug,#5401 #5403 #5409)\n";
    assert_eq!(
        messages(&format!("T1 M6\n{lengths}G43.1 X.5 Z25.4\n{lengths}G20\n{lengths}G49\n{lengths}M2\n")),
        [
            "0.000000 0.000000 0.000000",
            "0.500000 25.400000 0.000000",
            "0.019685 1.000000 0.000000",
            "0.000000 0.000000 0.000000"
        ]
    );
    assert_eq!(run("#5021=1\nM2\n", Setup::rs274()).1, ["E1303"]);
}

#[test]
fn g95_takes_the_number_of_the_spindle() {
    assert!(run("S100 M3 G95 $0 F.1\nM2\n", Setup::rs274()).1.is_empty());
    assert_eq!(run("G95 $1 F.1\nM2\n", Setup::rs274()).1, ["E1630"]);
}

/// Returns the functions of F, S and path mode.
fn settings(program: &str) -> Vec<Canon> {
    let (canon, found) = run(program, Setup::rs274());
    assert!(found.is_empty(), "{program}: {found:?}");
    let is_setting = |canon: &Canon| {
        matches!(
            canon,
            Canon::SetFeedRate(_)
                | Canon::SetSpindleSpeed(_)
                | Canon::SetMotionControlMode(_)
                | Canon::SetNaivecamTolerance(_)
        )
    };
    // The last one belongs to M2.
    let mut found: Vec<_> = canon.into_iter().filter(is_setting).collect();
    found.pop();
    found
}

#[test]
fn restored_modes_come_out_again_though_they_have_not_changed() {
    use retrace_gcode::PathControl;
    let again = |path: &[Canon]| {
        let mut once = vec![Canon::SetFeedRate(100.0), Canon::SetSpindleSpeed(50.0)];
        once.extend_from_slice(path);
        [once.clone(), once].concat()
    };
    let blended =
        [Canon::SetMotionControlMode(PathControl::Continuous { tolerance: 0.5 }), Canon::SetNaivecamTolerance(0.25)];
    let exact = [Canon::SetMotionControlMode(PathControl::ExactPath)];
    for (path, wanted) in [("G64 P.5 Q.25", again(&blended)), ("G61", again(&exact))] {
        let before = format!("F100 S50\n{path}\n");
        assert_eq!(settings(&format!("{before}M70\nG1 X1\nM72\nM2\n")), wanted);
        assert_eq!(settings(&format!("O1 sub\nM73\nG1 X1\nO1 endsub\n{before}O1 call\nM2\n")), wanted);
    }
    // Also under cutter compensation, which accepts no code of the path mode; F and S wait for the next corner there.
    let compensated = "F100 S50\nG61\nG41.1 D1\nG1 X5\nX9\nM70\nX12\nM72\nX15\nG40\nX0\nM2\n";
    let once = [Canon::SetFeedRate(100.0), Canon::SetSpindleSpeed(50.0)];
    assert_eq!(settings(compensated), [&once[..], &exact, &exact, &once].concat());
}

#[test]
fn comments_may_be_in_latin_1_and_a_byte_order_mark_is_skipped() {
    let program =
        b"\xef\xbb\xbf%\nG0 X1 (Fr\xe4ser \xd8 6)\n(msg,Gr\xf6\xdfe)\n(msg,Gr\xc3\xb6\xc3\x9fe)\nM2 ; \xb5m\n%\n";
    let mut program = Program::new(&program[..], Setup::rs274());
    let mut steps = Vec::new();
    while program.advance(&mut steps) == Progress::Line {}
    assert!(program.interpreter().diagnostics().is_empty(), "{:?}", program.interpreter().diagnostics());
    let texts: Vec<_> = steps
        .iter()
        .filter_map(|step| match &step.canon {
            Canon::Message(text) | Canon::Comment(text) => Some(text.to_string()),
            _ => None,
        })
        .collect();
    assert_eq!(texts, ["Fr\u{e4}ser \u{d8} 6", "Gr\u{f6}\u{df}e", "Gr\u{f6}\u{df}e"]);
    for first in ["G0 X1", "O1 sub\nG0 X1\nO1 endsub\nO1 call", "N5 G0 X1", "/G0 X1", "O7", "(c)"] {
        assert!(
            retrace_gcode::check(format!("\u{feff}{first}\nM2\n").into_bytes(), Setup::rs274()).is_empty(),
            "{first}"
        );
    }
}

#[test]
fn a_program_may_have_a_name_of_its_own() {
    for program in ["O<part>\nG0 X1\nM2\n", "%\n(c)\nO<part> (name)\nG0 X1\nM2\n%\n"] {
        assert!(retrace_gcode::check(program.as_bytes(), Setup::rs274()).is_empty(), "{program}");
    }
}

/// Returns the first diagnostic of a program: its number, its message, and the remedy.
fn first_finding(line: &str) -> (&'static str, String, String) {
    let found = retrace_gcode::check(format!("{line}\nM2\n").into_bytes(), Setup::rs274());
    let first = found.first().unwrap_or_else(|| panic!("{line} is taken"));
    (first.number(), first.message.clone(), first.help().to_owned())
}

#[test]
fn common_slips_get_an_answer_of_their_own() {
    for (line, number, message) in [
        ("GO X10", "E1013", "G is followed by the letter O; did you mean 0?"),
        ("G0 X1O", "E1013", "the letter O follows a digit; did you mean 0?"),
        ("G0 XO", "E1013", "X is followed by the letter O; did you mean 0?"),
        ("S M3", "E1101", "S is not followed by a value"),
        ("G1 X Y5", "E1101", "X is not followed by a value"),
        ("G0 X10,5", "E1014", "a comma is not a decimal point"),
        ("#1=2,5", "E1014", "a comma is not a decimal point"),
        ("G0 X[1,5]", "E1014", "a comma is not a decimal point"),
        ("#2=[#1 = 5]", "E1208", "= does not compare; use EQ"),
        ("# a comment", "E1015", "# does not begin a comment"),
        ("#comment", "E1015", "# does not begin a comment"),
        ("IF [#1 GT 5] G0 X1", "E1815", "IF is followed by a condition in brackets and GOTO or THEN"),
        ("IF [#1 GT 5] GOTO X5", "E1815", "GOTO is followed by the number of a line, as in GOTO 100"),
        ("IF [#1 EQ 5] THEN G0", "E1815", "THEN is followed by an assignment, as in IF [#1 GT 5] THEN #1=5"),
        ("DO1", "E1815", "DO must follow WHILE and its condition"),
        ("WHILE [#1 LT 5] DO4", "E1815", "DO and END are followed by 1, 2 or 3"),
        ("WHILE [#1 LT 5] G0 X1", "E1815", "WHILE is followed by a condition in brackets and DO"),
        ("GOTO 100 G0 X1", "E1815", "nothing else is allowed in this line"),
        ("G0 \u{feff}X1", "E1016", "invisible character"),
        ("G0\u{a0}X1", "E1016", "invisible character"),
        ("G0 X[depth+1]", "E1201", "there is no function DEPTH; a named parameter is written #<depth>"),
        ("G0 X[SINE[30]]", "E1201", "there is no function SINE; did you mean SIN?"),
        ("G0 X[SQR[4]]", "E1201", "there is no function SQR; did you mean SQRT?"),
        ("#<depth>=1\nG0 X#<dpeth>", "E1302", "#<dpeth> has no value yet; did you mean #<depth>?"),
        (
            "O<drill> sub\nO<drill> endsub\nO<dril> call",
            "E1804",
            "there is no subprogram O<dril>; did you mean O<drill>?",
        ),
        ("O<a call", "E1801", "the name after O< has no >; write O<name> call"),
    ] {
        let (code, said, help) = first_finding(line);
        assert_eq!((code, said.as_str()), (number, message), "{line}");
        assert!(number == "E1201" || !help.contains("ACOS"), "{line}: {help}");
    }
}

#[test]
fn a_move_that_takes_longer_than_a_day_is_refused() {
    for line in ["G1 X10 F0.00001", "G93 G1 X10 F.0001", "F1 G2 X1 Y0 I.5 J0 P9999"] {
        assert_eq!(first_finding(line).0, "E1512", "{line}");
    }
    for line in ["G1 X10 F0.01", "G93 G1 X10 F.001", "F100 G2 I1000", "S1 M3 G95 F.0001 G1 X10", "F.01 G1 X0"] {
        assert!(retrace_gcode::check(format!("{line}\nM2\n").into_bytes(), Setup::rs274()).is_empty(), "{line}");
    }
}

/// The end of a probing move is an assumption in a check: with the machine's own result, the next move has a length.
#[test]
fn probing_without_a_way_is_a_fault_only_before_the_first_answer() {
    let errors = |text: &str| {
        retrace_gcode::check(text.as_bytes(), Setup::default()).iter().map(|f| f.number()).collect::<Vec<_>>()
    };
    for code in ["G38.2", "G38.4"] {
        assert_eq!(errors(&format!("F10\nG0 X1\n{code} X1\nM2\n")), ["E1719"], "{code}");
    }
    // They ask for the state of the probe, and get it at once.
    assert_eq!(errors("F10\nG0 X1\nG38.3 X1\nG38.5 X1\nM2\n"), [""; 0]);
    assert_eq!(errors("F10\nG38.2 X1\nG38.2 X#5420\nM2\n"), [""; 0]);
}
