//! The control words of Fanuc's macros: GOTO, IF … GOTO, IF … THEN and WHILE … DO … END, compared with examples and
//! with a small model that executes line by line.

use crate::common;

use common::canon_text;
use proptest::prelude::*;
use retrace_gcode::{BranchDestination, CallFrame, Canon, Prescan, Program, Setup, check};

/// Returns the X coordinates of the rapid moves of a program in a file, in order.
fn moves(program: &str) -> Vec<i64> {
    let (text, failed) = canon_text(program);
    assert!(!failed, "{program}\n{text}");
    let mark = "STRAIGHT_TRAVERSE(";
    let moves = text.lines().filter_map(|line| line.split_once(mark));
    moves.map(|(_, arguments)| arguments.split('.').next().unwrap_or_default().parse().expect("a number")).collect()
}

/// Returns the same for a streamed program, or its first error and the line of it.
fn arriving(program: &str) -> Result<Vec<i64>, (&'static str, u32)> {
    let mut steps = Program::new(program.as_bytes(), Setup::default()).into_iter();
    let moves = steps.by_ref().filter_map(|step| match step.canon {
        Canon::StraightTraverse(end) => Some(end.0[0] as i64),
        _ => None,
    });
    let moves = moves.collect();
    steps.diagnostics().first().map_or(Ok(moves), |found| Err((found.number(), found.line)))
}

fn errors(program: &str) -> Vec<(&'static str, u32)> {
    check(program.as_bytes(), Setup::default()).iter().map(|found| (found.number(), found.line)).collect()
}

#[test]
fn goto_goes_to_the_line_of_its_number_forward_and_backward() {
    assert_eq!(moves("G0 X1\nGOTO 20\nG0 X2\nN20 G0 X3\nM2\n"), [1, 3]);
    let count = "#1=0\nN10 #1=[#1+1]\nG0 X#1\nIF [#1 LT 3] GOTO 10\ngoto30\nG0 X99\nN30 G0 X9 (end)\nM2\n";
    assert_eq!(moves(count), [1, 2, 3, 9]);
    assert_eq!(moves(&format!("%\n\nO1000 (part)\n{count}%\n")), [1, 2, 3, 9]);
    // the number is a value, and a line with leading zeros has the same
    assert_eq!(moves("#1=2\nGOTO [#1*10]\nN10 G0 X1\nN0020 G0 X2\nM2\n"), [2]);
    assert_eq!(moves("#1=30\nIF [1] GOTO #1\nN30 G0 X2\nM2\n"), [2]);
    // of several the next one ahead, otherwise the first
    assert_eq!(moves("GOTO 5\nN5 G0 X1\nGOTO 6\nN5 G0 X2\nN6 G0 X3\nM2\n"), [1, 3]);
    let both = "#1=0\nN5 #1=[#1+1]\nG0 X#1\nIF [#1 GT 1] GOTO 9\nGOTO 5\nN5 G0 X7\nN9 M2\n";
    assert_eq!(moves(both), [1, 7]);
    // after the end of the program and back
    assert_eq!(moves("GOTO 90\nN10 G0 X1\nM2\nN90 G0 X2\nGOTO 10\n"), [2, 1]);
    // a line that is deleted is not a target
    assert_eq!(moves("G0 X1\n/N7 GOTO 9\nN9 G0 X2\nM2\n"), [1, 2]);
}

#[test]
fn then_assigns_where_the_condition_holds_and_calculates_nothing_where_not() {
    assert_eq!(moves("#1=7\nIF [#1 GT 5] THEN #1=5\nG0 X#1\nIF[#1 EQ 4]THEN#1=0\nG0 X#1\nM2\n"), [5, 5]);
    assert_eq!(
        moves(
            "#1=0\nIF [#1 NE 0] THEN #2=[1/#1]\n#<a>=3\nIF [1] THEN #<a>=4 #3=[#<a>+1] (both)\nG0 X#<a>\nG0 X#3\nM2\n"
        ),
        [4, 4]
    );
    assert_eq!(arriving("#1=7\nIF [#1 GT 5] THEN #1=5\nG0 X#1\nM2\n"), Ok(vec![5]));
}

#[test]
fn a_subprogram_of_m98_has_line_numbers_of_its_own() {
    let program =
        "M98 P100 L2\nGOTO 10\nG0 X98\nN10 G0 X1\nM2\nO100\n#1=[#1+1]\nIF [#1 EQ 2] GOTO 10\nG0 X#1\nN10 G0 X50\nM99\n";
    assert_eq!(moves(program), [1, 50, 50, 1]);
    assert_eq!(errors("GOTO 7\nM2\nO100\nN7 M99\n").first(), Some(&("E1816", 1)));
}

#[test]
fn loops_may_be_left_and_not_entered() {
    let left = "#1=0\nWHILE [1] DO1\n#2=0\nWHILE [1] DO2\n#2=[#2+1]\nIF [#2 EQ 2] GOTO 5\nG0 X#2\nEND2\nN5 \
        #1=[#1+1]\nIF [#1 GT 2] GOTO 6\nEND1\nN6 G0 X9\nM2\n";
    assert_eq!(moves(left), [1, 1, 1, 9]);
    assert_eq!(errors("GOTO 5\nWHILE [#1 LT 1] DO1\nN5 #1=1\nEND1\nM2\n").first(), Some(&("E1817", 1)));
    assert_eq!(errors("#2=5\nGOTO #2\nWHILE [#1 LT 1] DO1\nN5 #1=1\nEND1\nM2\n").first(), Some(&("E1817", 2)));
    // a jump to its WHILE is allowed
    assert_eq!(moves("#1=1\nGOTO 4\nG0 X3\nN4 WHILE [#1 LT 2] DO1\nG0 X#1\n#1=2\nEND1\nM2\n"), [1]);
}

#[test]
fn a_loop_that_was_left_begins_anew() {
    let text = "N1 #1=[#1+1]\nWHILE [1] DO1\nG0 X#1\nGOTO 1\nEND1\nM2\n";
    let prescan = std::sync::Arc::new(Prescan::scan("part", text.into(), &Setup::default()));
    let mut program = Program::<&[u8]>::prescanned(prescan, Setup::default());
    let (mut steps, mut moves) = (Vec::new(), 0);
    while moves < 3 {
        steps.clear();
        program.advance(&mut steps);
        moves += steps.iter().filter(|step| matches!(step.canon, Canon::StraightTraverse(_))).count();
    }
    let within = program.location().frames;
    assert!(matches!(within[..], [CallFrame::Loop { iteration: 1, line: 2, .. }]), "{within:?}");
}

#[test]
fn what_cannot_be_gone_to_is_told_with_its_line() {
    assert_eq!(errors("G0 X1\nGOTO 100\nM2\n"), [("E1816", 2)]);
    assert_eq!(errors("#1=3\nIF [#1 EQ 3] GOTO #1\nM2\n"), [("E1816", 2)]);
    assert_eq!(errors("IF [0] GOTO 100\nM2\n"), [("E1816", 1)]);
    assert_eq!(errors("GOTO [-1]\nM2\n"), [("E1816", 1)]);
    assert_eq!(errors("N10 GOTO 10\nM2\n"), [("E1806", 1)]);
    // once, whatever was scanned before the GOTO was found
    assert_eq!(errors("WHILE [0] DO1\nG999\nEND1\nGOTO 5\nN5 M2\n"), [("E1401", 2)]);
    let mixed = |program: &str| errors(program).iter().any(|(number, line)| (*number, *line) == ("E1818", 3));
    for program in ["O1 if [1]\nO1 endif\nGOTO 5\nN5 M2\n", "GOTO 5\nN5\nO1 repeat [2]\nO1 endrepeat\nM2\n"] {
        assert!(mixed(program), "{program}: {:?}", errors(program));
    }
    assert!(mixed("WHILE [0] DO1\nEND1\nO<probe> call\nM2\n"));
    assert!(mixed("O1 while [0]\nO1 endwhile\nIF [1] THEN #1=2\nM2\n"));
    for (line, what) in
        [("GOTO X5", "E1"), ("IF [1] G0 X1", "E1815"), ("IF [1] THEN G0 X1", "E1815"), ("GOTO 5 G0 X1", "E1815")]
    {
        assert!(errors(&format!("{line}\nN5 M2\n"))[0].0.starts_with(what), "{line}: {:?}", errors(line));
    }
}

#[test]
fn a_program_that_arrives_goes_forward_and_never_back() {
    assert_eq!(arriving("G0 X1\nGOTO 20\nG0 X2\nO7\nWHILE [1] DO1\nN20 G0 X3\nM2\n"), Ok(vec![1, 3]));
    assert_eq!(arriving("N5 G0 X1\nGOTO 5\nM2\n"), Err(("E1819", 2)));
    assert_eq!(arriving("G0 X1\nGOTO 20\nG0 X2\nM2\n"), Err(("E1816", 2)));
    assert_eq!(arriving("%\nG0 X1\nGOTO 20\nG0 X2\n%\n"), Err(("E1816", 3)));
    // inside a loop it jumps in both directions, and out of it forward
    let looped = "#1=0\nWHILE [1] DO1\nN1 #1=[#1+1]\nG0 X#1\nIF [#1 LT 2] GOTO 1\nIF [#1 GT 3] GOTO 9\nEND1\nG0 \
        X50\nN9 G0 X6\nM2\n";
    assert_eq!(arriving(looped), Ok(vec![1, 2, 3, 4, 6]));
    assert_eq!(moves(looped), [1, 2, 3, 4, 6]);
}

#[test]
fn every_goto_is_in_the_branch_table() {
    let prescan = Prescan::scan(
        "part",
        "N10 #1=[#1+1]\nIF [#1 LT 3] GOTO 10\nGOTO #1\nGOTO 30\nN30 M2\n".into(),
        &Setup::default(),
    );
    let rows: Vec<_> = prescan.branches().iter().map(|row| (row.number, row.line, row.kind, row.target)).collect();
    let line = |line| BranchDestination::Line { file: 0, line };
    assert_eq!(rows, [(1, 2, "goto", line(1)), (2, 3, "goto", BranchDestination::Calculated), (3, 4, "goto", line(5))]);
}

/// A line of a random program.
#[derive(Clone, Debug)]
enum Line {
    Move(u8),
    Add(u8, i64),
    /// A jump to this line, calculated if the second field is true.
    GoTo(usize, bool),
    IfGoTo(u8, i64, usize, bool),
    IfThen(u8, i64, u8, i64),
    While(u8, i64),
    End,
}

/// Lines whose loops are closed, nested at most three deep.
fn lines() -> impl Strategy<Value = Vec<Line>> {
    let register = 1..4u8;
    let line = prop_oneof![
        4 => register.clone().prop_map(Line::Move),
        3 => (register.clone(), -2..4i64).prop_map(|(of, by)| Line::Add(of, by)),
        1 => (any::<prop::sample::Index>(), any::<bool>()).prop_map(|(to, calculated)| Line::GoTo(to.index(1000),
            calculated)),
        2 => (register.clone(), -2..6i64, any::<prop::sample::Index>(), any::<bool>())
            .prop_map(|(of, below, to, calculated)| Line::IfGoTo(of, below, to.index(1000), calculated)),
        2 => (register.clone(), -2..6i64, register.clone(),
            -3..9i64).prop_map(|(of, below, to, value)| Line::IfThen(of, below, to, value)),
        2 => (register, -1..6i64).prop_map(|(of, below)| Line::While(of, below)),
        2 => Just(Line::End),
    ];
    prop::collection::vec(line, 1..25).prop_map(|drawn| {
        let (mut lines, mut depth) = (Vec::new(), 0);
        for line in drawn {
            match line {
                Line::While(..) if depth == 3 => continue,
                Line::End if depth == 0 => continue,
                Line::While(..) => depth += 1,
                Line::End => depth -= 1,
                _ => {}
            }
            lines.push(line);
        }
        lines.extend((0..depth).map(|_| Line::End));
        let count = lines.len();
        for line in &mut lines {
            if let Line::GoTo(to, _) | Line::IfGoTo(.., to, _) = line {
                *to %= count + 1;
            }
        }
        lines
    })
}

/// Returns the loops around each line, by their first lines. A loop is around its lines and its end, not around itself.
fn around(lines: &[Line]) -> Vec<Vec<usize>> {
    let (mut open, mut all) = (Vec::new(), Vec::new());
    for (at, line) in lines.iter().enumerate() {
        all.push(open.clone());
        match line {
            Line::While(..) => open.push(at),
            Line::End => _ = open.pop(),
            _ => {}
        }
    }
    all.push(Vec::new());
    all
}

/// Executes the lines one after another. Returns the moves, and whether it ends within the given number of lines, or
/// enters a loop.
fn carried_out(lines: &[Line], most: usize) -> (Vec<i64>, Option<&'static str>) {
    let (mut registers, mut moves, mut at) = ([0i64; 4], Vec::new(), 0);
    let around = around(lines);
    for _ in 0..most {
        let Some(line) = lines.get(at) else { return (moves, None) };
        let mut next = at + 1;
        let mut go = None;
        match *line {
            Line::Move(of) => moves.push(registers[usize::from(of)]),
            Line::Add(of, by) => registers[usize::from(of)] += by,
            Line::GoTo(to, _) => go = Some(to),
            Line::IfGoTo(of, below, to, _) if registers[usize::from(of)] < below => go = Some(to),
            Line::IfThen(of, below, to, value) if registers[usize::from(of)] < below => {
                registers[usize::from(to)] = value
            }
            Line::While(of, below) if registers[usize::from(of)] >= below => {
                let end = (at + 1..).find(|&end| matches!(lines[end], Line::End) && around[end].last() == Some(&at));
                next = end.expect("every loop is closed") + 1;
            }
            Line::End => next = *around[at].last().expect("it ends a loop"),
            _ => {}
        }
        if let Some(to) = go {
            if !around[to].iter().all(|of| around[at].contains(of)) {
                return (moves, Some("E1817"));
            }
            next = to;
        }
        at = next;
    }
    (moves, Some("endless"))
}

fn written(lines: &[Line]) -> String {
    let mut depth = 0;
    let mut text: String = lines
        .iter()
        .enumerate()
        .map(|(at, line)| {
            let to = |to: usize, calculated: bool| {
                if calculated { format!("[{}+{to}]", 100) } else { format!("{}", 100 + to) }
            };
            let words = match *line {
                Line::Move(of) => format!("G0 X#{of}"),
                Line::Add(of, by) => format!("#{of}=[#{of}+[{by}]]"),
                Line::GoTo(line, calculated) => format!("GOTO {}", to(line, calculated)),
                Line::IfGoTo(of, below, line, calculated) => {
                    format!("IF [#{of} LT {below}] GOTO {}", to(line, calculated))
                }
                Line::IfThen(of, below, register, value) => format!("IF [#{of} LT {below}] THEN #{register}={value}"),
                Line::While(of, below) => {
                    depth += 1;
                    format!("WHILE [#{of} LT {below}] DO{depth}")
                }
                Line::End => {
                    depth -= 1;
                    format!("END{}", depth + 1)
                }
            };
            format!("N{} {words}\n", 100 + at)
        })
        .collect();
    text += &format!("N{} M2\n", 100 + lines.len());
    text
}

/// Number of cases: more in a campaign.
fn cases() -> u32 {
    std::env::var("RETRACE_CASES").ok().and_then(|text| text.parse().ok()).unwrap_or(2_000)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases()))]

    #[test]
    fn random_programs_go_from_line_to_line_as_a_machine_of_their_own_does(lines in lines()) {
        let (program, (expected, ended)) = (written(&lines), carried_out(&lines, 3_000));
        let around = around(&lines);
        // a written number is refused before anything runs, even where the program would not reach it
        let enters = |at: usize, to: usize| !around[to].iter().all(|of| around[at].contains(of));
        let is_refused = lines.iter().enumerate().any(|(at, line)| match *line {
            Line::GoTo(to, false) | Line::IfGoTo(_, _, to, false) => enters(at, to),
            _ => false,
        });
        if is_refused {
let prescan = Prescan::scan("part", program.as_str().into(), &Setup::default());
            let found = prescan.diagnostics();
            prop_assert!(found.iter().any(|found| found.number() == "E1817"), "{}", program);
        } else if ended == Some("E1817") {
            let mut found = Vec::new();
            let prescan = std::sync::Arc::new(Prescan::scan("part", program.as_str().into(), &Setup::default()));
            let mut steps = Program::<&[u8]>::prescanned(prescan, Setup::default()).into_iter();
            found.extend(steps.by_ref().filter_map(|step| match step.canon {
                Canon::StraightTraverse(end) => Some(end.0[0] as i64),
                _ => None,
            }).take(expected.len()));
            prop_assert_eq!(&found, &expected, "{}", program);
        } else if ended.is_none() {
            prop_assert_eq!(moves(&program), expected, "{}", program);
        }
    }
}
