//! Checks of programs that ask the machine: unknown values, branches on them, and what stays known (PRB-17, PRB-18).

use retrace_gcode::{Answers, Canon, Diagnostic, Pose, Prescan, Program, Progress, Setup, Severity};
use std::sync::Arc;

/// What is known behind the end of a program.
struct Outcome {
    program: Program<&'static [u8]>,
    steps: Vec<Canon>,
    has_ended: bool,
}

impl Outcome {
    /// Executes a program to its end, or for 200 000 lines.
    fn of(text: &str, answers: Answers) -> Outcome {
        let setup = Setup { answers, ..Setup::default() };
        let prescan = Arc::new(Prescan::scan("p", text.to_owned().into_bytes().into(), &setup));
        let mut program = Program::<&'static [u8]>::prescanned(prescan, setup);
        let (mut steps, mut all) = (Vec::new(), Vec::new());
        for _ in 0..200_000 {
            if program.advance(&mut steps) == Progress::End {
                all.extend(steps.drain(..).map(|step| step.canon));
                return Outcome { program, steps: all, has_ended: true };
            }
            all.extend(steps.drain(..).map(|step| step.canon));
        }
        Outcome { program, steps: all, has_ended: false }
    }

    fn has_error(&self) -> bool {
        self.program.interpreter().diagnostics().iter().any(|found| found.severity() == Severity::Error)
    }

    fn checked(text: &str) -> Outcome {
        let outcome = Outcome::of(text, Answers::Unknown);
        assert!(outcome.has_ended, "{text}");
        outcome
    }

    fn get(&self, number: usize) -> f64 {
        self.program.interpreter().parameters().get(number)
    }

    fn position(&self) -> Pose {
        self.program.interpreter().state().position
    }

    fn numbers(&self) -> Vec<&'static str> {
        self.program.interpreter().diagnostics().iter().map(Diagnostic::number).collect()
    }

    /// Ends of straight moves, NaN where unknown.
    fn ends(&self) -> Vec<[f64; 3]> {
        let ends = self.steps.iter().filter_map(|canon| match canon {
            Canon::StraightTraverse(end) | Canon::StraightFeed(end) => Some([end.0[0], end.0[1], end.0[2]]),
            _ => None,
        });
        ends.collect()
    }
}

/// Parameters 101 … of a program, `None` where unknown.
fn known<const N: usize>(text: &str) -> [Option<f64>; N] {
    let outcome = Outcome::checked(text);
    assert_eq!(outcome.numbers(), Vec::<&str>::new(), "{text}");
    std::array::from_fn(|index| Some(outcome.get(101 + index)).filter(|value| !value.is_nan()))
}

#[test]
fn what_is_calculated_from_an_answer_is_unknown() {
    let text = "G21 F100\nG38.2 Z-5\n#101=[#5063 + 1]\n#102=EXISTS[#5063]\n#103=[#5070 AND 0]\n#104=[#5070 OR 1]\n\
                #105=[SQRT[#5063] LT 2]\n#106=##5070\nG92 Z0\nM2\n";
    assert_eq!(known(text), [None, Some(1.0), Some(0.0), Some(1.0), None, None]);
    assert_eq!(known("M66 P0 L0\n#101=#5399\n#102=5\nM2\n"), [None, Some(5.0)]);
    assert_eq!(known("#<a>=#5399\n#101=#<a>\n#102=EXISTS[#<a>]\nM2\n"), [Some(0.0), Some(1.0)]);
}

#[test]
fn behind_a_probing_move_the_position_is_unknown_along_the_axes_that_moved() {
    let outcome = Outcome::checked("G21 G90 F100\nG0 X1 Y2 Z3\nG38.2 Z-5\nG1 X4\nG0 Z9\nG1 X5\nM2\n");
    let ends = outcome.ends();
    assert_eq!(ends[0], [1.0, 2.0, 3.0]);
    assert!(ends[1][2].is_nan() && ends[1][..2] == [4.0, 2.0], "{ends:?}");
    assert_eq!(ends[2..], [[4.0, 2.0, 9.0], [5.0, 2.0, 9.0]]);
    assert_eq!(outcome.numbers(), Vec::<&str>::new());
}

#[test]
fn a_probing_move_that_must_trip_needs_a_known_way() {
    assert_eq!(Outcome::checked("G21 F100\nG38.2 Z0\nM2\n").numbers(), ["E1719"]);
    assert_eq!(Outcome::checked("G21 F100\nG38.2 Z-5\nG38.2 Z-5\nM2\n").numbers(), Vec::<&str>::new());
    // Without a way it asks for the state; nothing moves.
    let outcome = Outcome::checked("G21 F100\nG0 Z5\nG38.5 Z5\nM2\n");
    assert_eq!(outcome.position().0[2], 5.0);
    assert!(outcome.get(5070).is_nan());
}

#[test]
fn both_sides_of_a_branch_are_followed_and_joined() {
    let text =
        "M66 P0 L0\n#101=1 #102=1\no1 if [#5399 EQ 1]\n#101=2\n#102=7\no1 else\n#102=7\no1 endif\n#103=[#102+1]\nM2\n";
    assert_eq!(known(text), [None, Some(7.0), Some(8.0)]);
    let elseif = "M66 P0 L0\no1 if [#5399 EQ 1]\n#101=1 #102=3\no1 elseif [#5399 EQ 2]\n#101=2 #102=3\no1 elseif [1]\n\
                  #101=1 #102=3\no1 else\n#101=9 #102=9\no1 endif\nM2\n";
    assert_eq!(known(elseif), [None, Some(3.0)]);
    assert_eq!(
        known("M66 P0 L0\nIF [#5399 EQ 1] GOTO 20\n#101=1\n#102=4\nGOTO 30\nN20 #101=2\n#102=4\nN30 M2\n"),
        [None, Some(4.0)]
    );
    assert_eq!(known("M66 P0 L0\n#101=1\nIF [#5399 EQ 1] THEN #101=2\n#102=1\nM2\n"), [None, Some(1.0)]);
}

#[test]
fn modes_that_differ_are_unknown_until_they_are_set() {
    let text = "G21 G90 F100\nM66 P0 L0\no1 if [#5399]\nG91\no1 endif\n#101=#<_absolute>\n#102=#<_metric>\nG0 X1\nG90\n\
                #103=#<_absolute>\nG0 X2\nM2\n";
    let outcome = Outcome::checked(text);
    assert!(outcome.get(101).is_nan());
    assert_eq!((outcome.get(102), outcome.get(103)), (1.0, 1.0));
    let ends = outcome.ends();
    assert!(ends[0][0].is_nan() && ends[1] == [2.0, 0.0, 0.0], "{ends:?}");
    let units = "M66 P0 L0\no1 if [#5399]\nG20\no1 else\nG21\no1 endif\nG0 X1\n#101=#<_metric>\n#102=1\nM2\n";
    assert_eq!(known(units), [None, Some(1.0)]);
}

#[test]
fn lengths_saved_states_tools_and_retract_planes_of_two_branches_are_not_mixed_up() {
    let ask = |then: &str, other: &str| format!("M66 P0 L0\no1 if [#5399]\n{then}\no1 else\n{other}\no1 endif\n");
    let units = format!("{}G21\n#101=#5420\n#102=1\nM2\n", ask("G20 G0 X1", "G21 G0 X1"));
    assert_eq!(known(&units), [None, Some(1.0)]);
    let saved = format!("{}G90\nM72\n#101=#<_absolute>\n#102=1\nM2\n", ask("G91\nM70", "G90\nM70"));
    let outcome = Outcome::checked(&saved);
    assert!(outcome.get(101).is_nan() && outcome.numbers() == ["W1011"], "{:?}", outcome.numbers());
    let tools = format!("{}T1 M6\nG43\n#101=#5403\n#102=#5400\nM2\n", ask("G10 L1 P1 Z4", "G4 P0"));
    assert_eq!(known(&tools), [None, Some(1.0)]);
    let retract = format!("G0 Z5\n{}G81 X1 Z1 R3 F9\n#101=#5422\n#102=#5420\nM2\n", ask("G98", "G99"));
    assert_eq!(known(&retract), [None, Some(1.0)]);
}

#[test]
fn a_cycle_with_a_contour_has_an_unknown_way_where_the_contour_may_depend_on_an_answer() {
    let text = "G18 G21 G8 G90 F100\nO100 sub\nG1 X[20 + #5399]\nG1 Z-20\nO100 endsub\nG0 X50 Z5\nASK\n\
                G71 Q100 X40 Z0 D2 I1 R1\n#101=#5422\n#102=1\nM2\n";
    assert_eq!(known(&text.replace("ASK", "M66 P0 L0")), [None, Some(1.0)]);
    assert!(known::<2>(&text.replace("ASK", "G4 P0"))[0].is_some());
}

#[test]
fn an_error_on_one_side_is_an_error() {
    let text = "M66 P0 L0\no1 if [#5399]\n#101=[1/0]\no1 endif\no2 if [#5399]\no2 else\n#102=SQRT[-1]\no2 endif\nM2\n";
    assert_eq!(Outcome::checked(text).numbers(), ["E1204", "E1205"]);
}

#[test]
fn an_abort_ends_its_side_of_a_branch_and_is_an_error_only_where_it_comes_whatever_the_answer_is() {
    let abort = "G38.3 Z-5\n#1 = 1\no1 if [#5070 EQ 1]\n#1 = 2\n(ABORT, contact)\no1 endif\nG0 X[#1]\nM2\n";
    let outcome = Outcome::checked(&format!("G21 F100\n{abort}"));
    assert_eq!((outcome.has_error(), outcome.get(1)), (false, 1.0), "{:?}", outcome.numbers());
    // Whatever goes on behind it, the program comes there in every run that is not aborted.
    let is_certain = outcome.steps.iter().rev().find_map(|canon| match canon {
        Canon::FollowBranch(branch) => Some(branch.is_certain),
        _ => None,
    });
    assert_eq!(is_certain, Some(true));
    let last = Outcome::checked("G21 F100\nG38.3 Z-5\no1 if [#5070]\nM2\no1 endif\n#2 = 5\n(ABORT, none)\nM2\n");
    assert_eq!((last.has_error(), last.get(2)), (false, 0.0));
    assert!(Outcome::checked("G21 F100\nG38.3 Z-5\n(ABORT, always)\nM2\n").has_error());
}

#[test]
fn a_program_that_may_have_ended_is_not_certain_to_go_on() {
    let text = "G21 F100\nG38.3 Z-5\no1 if [#5070 EQ 1]\nM2\no1 endif\nG0 X5\nM2\n";
    let certain = Outcome::checked(text).steps.into_iter().filter_map(|canon| match canon {
        Canon::FollowBranch(branch) => Some(branch.is_certain),
        _ => None,
    });
    assert_eq!(certain.last(), Some(false));
}

#[test]
fn loops_on_unknown_end_with_what_they_change_unknown() {
    let change = "#101=0 #102=5\nM66 P0 L0\n";
    for text in [
        "o1 while [#5399 EQ 0]\n#101=[#101+1]\nM66 P0 L0\no1 endwhile\n",
        "o1 do\n#101=[#101+1]\nM66 P0 L0\no1 while [#5399 EQ 0]\n",
        "o1 repeat [#5399]\n#101=[#101+1]\no1 endrepeat\n",
        "o1 while [1]\n#101=[#101+1]\no2 if [#5399]\no1 break\no2 endif\no1 endwhile\n",
        "o1 while [#5399]\n#101=[#101+1]\no2 if [#5399 EQ 2]\no1 continue\no2 endif\n#103=1\no1 endwhile\n",
    ] {
        assert_eq!(known(&format!("{change}{text}M2\n")), [None, Some(5.0)], "{text}");
    }
}

#[test]
fn a_loop_with_a_known_count_stays_exact_around_unknown_values() {
    let text = "#101=0 #102=0\no1 repeat [5]\n#101=[#101+1]\no2 while [#5070 NE 0]\nM66 P0 L0\n\
                #5070=#5399\no2 endwhile\n\
                o3 if [#5399]\n#103=1\no3 else\n#103=2\no3 endif\no4 if [#5399 EQ 7]\no1 continue\no4 endif\n\
                #102=[#102+1]\n\
                o1 endrepeat\nM2\n";
    let text = text.replace("#101=0", "#5070=1 #101=0");
    assert_eq!(known(&text), [Some(5.0), None, None]);
    let text = "#101=0\no1 while [#101 LT 5]\n#101=[#101+1]\nM66 P0 L0\no2 if [#5399]\no1 continue\no2 endif\n#102=1\n\
                o1 endwhile\nM2\n";
    assert_eq!(known(text), [Some(5.0), None]);
    // The known bound of a loop with a break is a bound of its values.
    let text = "#101=0\nM66 P0 L0\no1 repeat [3]\n#101=[#101+1]\no2 if [#5399]\no1 break\no2 endif\n#102=#101\n\
                o1 endrepeat\n\
                M2\n";
    assert_eq!(known(text), [None, None]);
}

#[test]
fn calls_returns_and_ends_inside_branches_are_followed() {
    let sub = "o<s> sub\no1 if [#5399]\no<s> return [#1 + 1]\no1 endif\n#102=8\no<s> endsub [2]\n";
    let text =
        format!("{sub}M66 P0 L0\n#101=3\n#102=8\no<s> call [1]\n#103=#<_value>\no<s> call [7]\n#101=#<_value>\nM2\n");
    assert_eq!(known(&text), [None, Some(8.0), Some(2.0)]);
    let ends = "M66 P0 L0\n#101=1\no1 if [#5399]\n#102=2\nM2\no1 endif\n#103=3\nM2\n";
    assert_eq!(known(ends), [Some(1.0), None, None]);
    let in_sub = "o<s> sub\no1 if [#5399]\nM2\no1 endif\no<s> endsub\nM66 P0 L0\no<s> call\n#101=1\nM2\n";
    let outcome = Outcome::checked(in_sub);
    assert!(outcome.get(101).is_nan());
    assert_eq!(outcome.numbers(), Vec::<&str>::new());
}

#[test]
fn an_unknown_target_of_an_assignment_is_reported_once() {
    let text = "#101=5\nM66 P0 L0\no1 repeat [3]\n#[#5399]=1\no1 endrepeat\n#102=4\nG#5399\nM2\n";
    let outcome = Outcome::checked(text);
    assert_eq!(outcome.numbers(), ["W1011", "W1011"]);
    assert!(outcome.get(101).is_nan());
    assert_eq!(outcome.get(102), 4.0);
}

#[test]
fn the_program_for_the_stand_alone_interpreter_is_as_before() {
    let outcome = Outcome::of("G21 F100\nG0 Z5\nG38.2 Z-5\nM2\n", Answers::Assumed);
    assert_eq!((outcome.get(5070), outcome.get(5063)), (0.0, -5.0));
    assert!((outcome.position().0[2] - -4.746).abs() < 1e-9);
}

mod random {
    use super::*;
    use proptest::prelude::*;

    /// A value in an expression.
    fn value() -> impl Strategy<Value = String> {
        prop_oneof![
            (0..4_i32).prop_map(|number| number.to_string()),
            (101..105_usize).prop_map(|number| format!("#{number}")),
            Just("#5399".to_owned()),
            (101..105_usize, 0..3_i32).prop_map(|(number, by)| format!("[#{number} - {by}]")),
            (101..105_usize, 0..3_i32).prop_map(|(number, to)| format!("[#{number} GT {to}]")),
            Just("[#5399 AND #102]".to_owned()),
            Just("#<_absolute>".to_owned()),
            Just("#5420".to_owned()),
            Just("#5021".to_owned()),
            Just("EXISTS[#<a>]".to_owned()),
        ]
    }

    /// A line that sets a mode or depends on modes.
    fn mode() -> impl Strategy<Value = String> {
        prop::sample::select(vec![
            "G90",
            "G91",
            "G20",
            "G21",
            "G54",
            "G55",
            "G92.1",
            "G43.1 X1",
            "G49",
            "G1 X3 F100",
            "G0 Y2",
            "G80",
            "G18",
            "G17",
            "G2 X3 Y1 R9",
            "G81 X1 Z1 R3 F9",
            "M70",
            "M72",
            "G7",
            "G8",
            "G28.1",
            "G28",
            "M2",
            "X1",
            "X2 Y1",
            "G53 G0 X1",
            "G42.1 D1",
            "G40",
            "G10 L2 P2 X5",
            "G10 L2 P0 X3",
            "G10 L20 P0 X1",
            "#<b>=1",
            "#104=EXISTS[#<b>]",
            "G93",
            "G94",
            "F50",
            "#103=#<_feed>",
            "#103=#<_metric>",
            "#103=#<_motion_mode>",
            "#103=#<_plane>",
            "T1 M6",
            "#103=#5400",
            "G43",
            "#103=#<_coord_system>",
            "#103=#5401",
            "G98",
            "G99",
            "M3 S100",
            "#103=#<_spindle_on>",
            "#103=#<_rpm>",
            "M8",
            "#103=#<_flood>",
            "G92 Y3",
            "G10 L1 P1 Z4",
        ])
        .prop_map(|line| format!("{line}\n"))
    }

    /// Lines of a program; `ASK` is replaced by a question, and `@` by a label.
    fn lines(depth: u32) -> BoxedStrategy<String> {
        let line = prop_oneof![
            4 => (101..105_usize, value()).prop_map(|(number, value)| format!("#{number}={value}\n")),
            1 => value().prop_map(|value| format!("#<a>={value}\n")),
            3 => Just("ASK\n".to_owned()),
            1 => value().prop_map(|value| format!("G0 X{value}\n")),
            1 => value().prop_map(|value| format!("G1 Y{value} F100\n")),
            1 => value().prop_map(|value| format!("G92 X{value}\n")),
            1 => value().prop_map(|value| format!("G10 L2 P1 Y{value}\n")),
            2 => mode(),
            1 => Just("o<s> call [#101]\n#102=#<_value>\n".to_owned()),
        ];
        if depth == 0 {
            return prop::collection::vec(line, 0..4).prop_map(|lines| lines.concat()).boxed();
        }
        let inner = || lines(depth - 1);
        let nested = prop_oneof![
            4 => line,
            1 => (value(), inner(), inner()).prop_map(|(value, then, other)| {
                format!("o@ if [{value}]\n{then}o@ else\n{other}o@ endif\n")
            }),
            3 => (mode(), mode(), prop::collection::vec(mode(), 1..4)).prop_map(|(then, other, behind)| {
                format!("ASK\no@ if [#5399]\n{then}o@ else\n{other}o@ endif\n{}", behind.concat())
            }),
            1 => (value(), value(), inner(), inner()).prop_map(|(first, second, then, other)| {
                format!("o@ if [{first}]\n{then}o@ elseif [{second}]\n{other}o@ endif\n")
            }),
            1 => (value(), inner(), value(), inner(), prop::bool::ANY).prop_map(|parts| {
                let (value, before, leaves, behind, ends) = parts;
                let leave = if ends { "break" } else { "continue" };
                let leaves = format!("o@! if [{leaves}]\no@ {leave}\no@! endif\n");
                let head = format!("o@ while [{value} AND [#105 LT 40]]\n#105=[#105+1]\n");
                format!("{head}{before}{leaves}{behind}o@ endwhile\n")
            }),
            1 => (value(), inner()).prop_map(|(value, inner)| {
                format!("o@ do\n#105=[#105+1]\n{inner}o@ while [{value} AND [#105 LT 40]]\n")
            }),
            1 => (value(), inner(), value(), inner()).prop_map(|(value, inner, leaves, behind)| {
                format!("o@ repeat [{value}]\n{inner}o@! if [{leaves}]\no@ break\no@! endif\n{behind}o@ endrepeat\n")
            }),
        ];
        prop::collection::vec(nested, 0..5).prop_map(|lines| lines.concat()).boxed()
    }

    /// Gives every block a label of its own.
    fn labelled(text: &str) -> String {
        let (mut open, mut next, mut out) = (Vec::new(), 100, String::new());
        for line in text.lines() {
            let Some(rest) = line.strip_prefix("o@") else {
                out += &format!("{line}\n");
                continue;
            };
            let words: Vec<&str> = rest.trim_start_matches('!').split_whitespace().collect();
            let is_do_end = words[0] == "while" && open.last().is_some_and(|(_, keyword)| *keyword == "do");
            let opens = matches!(words[0], "if" | "do" | "repeat") || words[0] == "while" && !is_do_end;
            if opens {
                open.push((next, words[0].to_owned()));
                next += 1;
            }
            let label = match words[0] {
                "break" | "continue" => open.iter().rev().find(|(_, keyword)| keyword != "if").map_or(0, |open| open.0),
                _ => open.last().map_or(0, |open| open.0),
            };
            out += &format!("o{label} {}\n", rest.trim_start_matches('!').trim());
            if is_do_end || words[0].starts_with("end") {
                open.pop();
            }
        }
        out
    }

    fn program() -> impl Strategy<Value = String> {
        (lines(1), lines(2), value()).prop_map(|(sub, main, returned)| {
            let main = labelled(&main);
            let sub = labelled(&sub.replace("o<s> call [#101]\n", ""));
            format!("o<s> sub\n{sub}o<s> endsub [{returned}]\n#101=1 #102=2 #105=0\n{main}#104=#104\nM2\n")
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 3000, ..ProptestConfig::default() })]

        /// Every run with answers ends in a state that the check has said, or in what it calls unknown.
        #[test]
        fn a_run_with_any_answers_is_contained_in_the_check(
            text in program(),
            answers in prop::collection::vec(0..3_i32, 1..5),
        ) {
            let check = Outcome::of(&text.replace("ASK", "M66 P0 L0"), Answers::Unknown);
            // A condition with an error is not decided.
            prop_assert!(check.has_ended || check.has_error(), "the check does not end:\n{}", text);
            // The answers are read one after another from a list that begins again.
            let count = answers.len();
            let list: String =
                answers.iter().enumerate().map(|(index, answer)| format!("#{}={answer} ", 301 + index)).collect();
            let head = format!("{list}#300=0\n");
            let ask = format!("#5399=#[301 + [#300 MOD {count}]] #300=[#300+1]");
            let concrete = format!("{head}{}", text.replace("ASK", &ask));
            let run = Outcome::of(&concrete, Answers::Assumed);
            // A run stops at its first error, and a loop of a run may not end.
            if run.has_error() || check.has_error() || !run.has_ended {
                return Ok(());
            }
            let is_contained = |name: &str, known: f64, value: f64| {
                prop_assert!(known.is_nan() || known.to_bits() == value.to_bits(), "{} is {}, not {}:\n{}\n{:?}", name,
                    value, known, text, answers);
                Ok(())
            };
            for number in (101..=105).chain(5161..=5169).chain(5210..=5230).chain(5241..=5250) {
                is_contained(&format!("#{number}"), check.get(number), run.get(number))?;
            }
            let axes = check.position().0.into_iter().zip(run.position().0);
            for (index, (known, value)) in axes.enumerate() {
                is_contained(&format!("coordinate {index}"), known, value)?;
            }
        }
    }
}
