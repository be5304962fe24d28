//! Location of a program, compared with counters that the program keeps itself.

use retrace_gcode::{CallFrame, LoopKind, Prescan, Program, ProgramLocation, Progress, Setup, SubFile, SubFiles};
use std::io::BufRead;
use std::sync::Arc;

/// Every loop counts its own iterations in a parameter; at the marked lines all of them are compared.
const COUNTED: &str = "\
#1 = 0
O10 while [#1 LT 3]
  #1 = [#1 + 1]
  #2 = 0
  O20 repeat [#1 + 1]
    #2 = [#2 + 1]
    O21 if [#2 EQ 3]
      O20 continue
    O21 endif
    #3 = 0
    O30 do
      #3 = [#3 + 1]
      #4 = 0
      O40 while [1]
        #4 = [#4 + 1]
        O41 if [#4 EQ 2]
          O40 break
        O41 endif
        (mark)
      O40 endwhile
      O42 if [[#3 EQ 3] AND [#1 EQ 2]]
        O30 break
      O42 endif
      (mark)
    O30 while [#3 LT 4]
    (mark)
  O20 endrepeat
  (mark)
O10 endwhile
(mark)
M2
";

/// Returns the result of `see` at the marked lines of a program.
fn at_marks<R: BufRead, T>(mut program: Program<R>, see: impl Fn(&Program<R>) -> T) -> Vec<T> {
    let (mut steps, mut seen) = (Vec::new(), Vec::new());
    while program.advance(&mut steps) == Progress::Line {
        if program.line_text().contains("(mark)") {
            seen.push(see(&program));
        }
    }
    assert!(program.interpreter().diagnostics().is_empty(), "{:?}", program.interpreter().diagnostics());
    seen
}

fn prescanned(text: &str, setup: Setup) -> Program<&'static [u8]> {
    Program::prescanned(Arc::new(Prescan::scan("part.ngc", text.into(), &setup)), setup)
}

fn rounds(whereabouts: &ProgramLocation) -> Vec<(LoopKind, u64, Option<u64>)> {
    let of = |within: &CallFrame| match within {
        CallFrame::Loop { kind, iteration: round, iterations: of, .. } => Some((*kind, *round, *of)),
        CallFrame::Sub { .. } => None,
    };
    whereabouts.frames.iter().filter_map(of).collect()
}

#[test]
fn rounds_are_those_that_the_program_counts_itself() {
    let counted = |program: &Program<&'static [u8]>| {
        let count = |number: usize| program.interpreter().parameters().get(number) as u64;
        let kinds = [(4, LoopKind::While), (3, LoopKind::Do), (2, LoopKind::Repeat), (1, LoopKind::While)];
        let line = program.location().line;
        let begins = [(14, 20), (11, 25), (5, 27), (2, 29)];
        let open = kinds.iter().zip(begins).filter(|(_, (begin, end))| (*begin..=*end).contains(&line));
        let expected: Vec<_> = open
            .map(|((number, kind), _)| {
                let of = (*kind == LoopKind::Repeat).then(|| count(1) + 1);
                (*kind, count(*number), of)
            })
            .collect();
        (program.location(), expected)
    };
    let seen = at_marks(prescanned(COUNTED, Setup::default()), counted);
    assert!(seen.len() > 40, "{}", seen.len());
    for (whereabouts, expected) in &seen {
        assert_eq!(rounds(whereabouts), *expected, "{whereabouts}");
    }
    let mut arrived = at_marks(Program::new(COUNTED.as_bytes(), Setup::default()), Program::location);
    for whereabouts in &mut arrived {
        assert_eq!(std::mem::replace(&mut whereabouts.file, "part.ngc".into()), "");
    }
    assert_eq!(arrived, seen.into_iter().map(|(whereabouts, _)| whereabouts).collect::<Vec<_>>());
}

#[derive(Debug)]
struct Folder;

impl SubFiles for Folder {
    fn find(&self, name: &str) -> Option<SubFile> {
        let text = "O<hole> sub\nO1 repeat [2]\nG0 X#1 (mark)\nO1 endrepeat\nO<hole> endsub\nM2\n";
        (name == "hole").then(|| SubFile { name: "hole.ngc".into(), text: Ok(text.into()) })
    }
}

#[test]
fn calls_are_told_from_inside_to_outside_with_file_line_and_time() {
    let setup = Setup { files: Some(Arc::new(Folder)), ..Setup::default() };
    let body =
        "G21\n#1 = 0\nO5 while [#1 LT 2]\n#1 = [#1 + 1]\nM98 P100 L3\nO5 endwhile\nM2\nO100\nO<hole> call [5]\nM99\n";
    let seen = at_marks(prescanned(body, setup), |program| program.location().to_string());
    assert_eq!(seen.len(), 2 * 3 * 2);
    assert_eq!(
        seen[9],
        "hole.ngc line 3, in the repeat loop of line 2, 2nd iteration of 2, in O<hole> called from part.ngc line 9, \
         in O100 called from line 5 for the 2nd of 3 times, in the while loop of line 3, 2nd iteration"
    );
}

#[test]
fn cycles_are_named() {
    let text = "G0 Z5\nG81 X1 Y1 Z-1 R1 F100 (mark)\nX2 (mark)\nG80 (mark)\nM2\n";
    let seen = at_marks(prescanned(text, Setup::default()), |program| program.location().to_string());
    assert_eq!(seen, ["part.ngc line 2, in G81", "part.ngc line 3, in G81", "part.ngc line 4"]);
    let library = retrace_gcode::cycles::CycleLibrary::shipped();
    let setup = Setup { cycles: Some(Arc::new(library)), ..Setup::default() };
    let text = "F100 S100 M3\nCYCLE81(10, 0, 2, -5) (mark)\nMCALL CYCLE81(10, 0, 2, -5)\nG0 X2 (mark)\nMCALL \
        (off)\nG0 X3 (mark)\nM2\n";
    let seen = at_marks(prescanned(text, setup), |program| program.location().to_string());
    // A region of compiled lines begins and ends with a step of its own, which reads no line.
    let mut lines = seen;
    lines.dedup();
    let cycle = ["part.ngc line 1", "part.ngc line 2, in CYCLE81", "part.ngc line 4, in CYCLE81", "part.ngc line 6"];
    assert_eq!(lines, cycle);
}
