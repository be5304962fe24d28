//! Any input results in canonical functions or diagnostics at the right place, never in a panic, and every number is
//! finite.

use crate::outline;
use crate::writer;

use outline::{Outline, TOOLS};
use proptest::prelude::*;
use retrace_gcode::{Canon, Diagnostic, Interpreter, Program, Progress, Setup, ToolTable, check};
use writer::Writer;

/// Runs a program to its end and returns its diagnostics; every step must be finite and in order.
fn run(text: &[u8], setup: Setup) -> Vec<Diagnostic> {
    let mut program = Program::new(text, setup);
    let mut steps = Vec::new();
    let mut taken = 0;
    while program.advance(&mut steps) != Progress::End && taken < 10_000 {
        taken += 1;
        for step in steps.drain(..) {
            if let Canon::StraightTraverse(end) | Canon::StraightFeed(end) = &step.canon {
                assert!(end.0.iter().all(|coordinate| coordinate.is_finite()), "{step:?}");
            }
        }
    }
    program.interpreter().diagnostics().to_vec()
}

/// Every diagnostic names a line of the text and a range in it, and can be rendered.
fn places_are_right(text: &[u8], diagnostics: &[Diagnostic]) {
    let lines: Vec<&[u8]> = text.split(|byte| *byte == b'\n').collect();
    for diagnostic in diagnostics {
        let number = diagnostic.line as usize;
        assert!(number <= lines.len(), "{diagnostic:?} of {} lines", lines.len());
        let line = number.checked_sub(1).and_then(|index| lines.get(index)).copied().unwrap_or_default();
        assert!(diagnostic.span.start <= diagnostic.span.end, "{diagnostic:?}");
        assert!(diagnostic.span.start as usize <= line.len(), "{diagnostic:?} in {line:?}");
        let shown = diagnostic.render("program.ngc", &String::from_utf8_lossy(line));
        assert!(shown.contains(diagnostic.number()) && shown.contains("help"), "{shown}");
    }
}

fn survives(text: &[u8]) -> Vec<Diagnostic> {
    let diagnostics = run(text, Setup::rs274());
    places_are_right(text, &diagnostics);
    run(text, Setup { block_delete: true, ..Setup::default() });
    diagnostics
}

proptest! {
    #[test]
    fn any_bytes(text in prop::collection::vec(any::<u8>(), 0..400)) {
        survives(&text);
    }

    #[test]
    fn any_commands(text in "([GMXYZIJKRPLFSTHNO#=<>\\[\\]()%;/*+.0-9 \na-z-]{0,30}\n){0,12}") {
        survives(text.as_bytes());
    }

    #[test]
    fn changed_programs(seed in any::<u64>(), changes in prop::collection::vec((any::<prop::sample::Index>(),
        any::<u8>(), 0..3), 1..12)) {
        let mut text = Writer::case(seed).program.into_bytes();
        for (place, byte, change) in changes {
            let at = place.index(text.len());
            match change {
                0 => text[at] = byte,
                1 => text.insert(at, byte),
                _ => {
                    text.remove(at);
                }
            }
            if text.is_empty() {
                break;
            }
        }
        survives(&text);
    }

    /// A block has the same effect whether the program reaches it continuously or the state is moved to a new
    /// interpreter before it.
    #[test]
    fn the_state_is_all_that_a_block_builds_on(seed in any::<u64>()) {
        let text = Writer::case(seed).program;
        let lines: Vec<&str> = text.lines().filter(|line| *line != "%").collect();
        let mut whole = retrace_gcode::Interpreter::new(Setup::rs274());
        for (index, line) in lines.iter().enumerate() {
            // Named parameters are numbered by the interpreter that read them, so blocks with any stay with it.
            let is_handed_over = index % 7 == 3 && !text.contains("#<");
            if is_handed_over {
                let parameters = whole.parameters().clone();
                let tools = whole.tools().clone();
                let mut next = retrace_gcode::Interpreter::new(Setup { parameters, tools, ..Setup::rs274() });
                next.set_state(whole.state().clone());
                let (mut here, mut there) = (Vec::new(), Vec::new());
                prop_assert_eq!(next.line(line.as_bytes(), &mut there).is_ok(),
                    whole.line(line.as_bytes(), &mut here).is_ok());
                let here: Vec<_> = here.into_iter().map(|step| step.canon).collect();
                let there: Vec<_> = there.into_iter().map(|step| step.canon).collect();
                prop_assert_eq!(here, there);
                prop_assert_eq!(next.state(), whole.state());
                whole = next;
            } else {
                let _ = whole.line(line.as_bytes(), &mut Vec::new());
            }
        }
    }

    #[test]
    fn the_state_is_all_that_a_block_of_an_outline_builds_on(seed in any::<u64>()) {
        let text = Outline::program(seed);
        let setup = || Setup { tools: ToolTable::read(TOOLS).expect("a tool table"), ..Setup::rs274() };
        let mut whole = Interpreter::new(setup());
        for line in text.lines().filter(|line| !line.contains("#<")) {
            let mut next = Interpreter::new(Setup { parameters: whole.parameters().clone(), ..setup() });
            next.set_state(whole.state().clone());
            let (mut here, mut there) = (Vec::new(), Vec::new());
            prop_assert_eq!(next.line(line.as_bytes(), &mut there).is_ok(),
                whole.line(line.as_bytes(), &mut here).is_ok());
            let here: Vec<_> = here.into_iter().map(|step| step.canon).collect();
            let there: Vec<_> = there.into_iter().map(|step| step.canon).collect();
            prop_assert_eq!(here, there);
        }
    }

    #[test]
    fn changed_outlines(seed in any::<u64>(), changes in prop::collection::vec((any::<prop::sample::Index>(),
        0x20_u8..0x7f), 1..9)) {
        let mut text = Outline::program(seed).into_bytes();
        for (place, byte) in changes {
            let at = place.index(text.len());
            text[at] = byte;
        }
        survives(&text);
    }
}

/// Returns the numbers, lines and columns of the errors of a program.
fn found(text: &[u8]) -> Vec<(&'static str, u32, u32)> {
    let diagnostics = survives(text);
    diagnostics.iter().map(|found| (found.number(), found.line, found.column())).collect()
}

#[test]
fn known_killers_of_controllers() {
    let long_comment = format!("({})\nM2\n", "x".repeat(100_000));
    assert_eq!(found(long_comment.as_bytes()), [("E1001", 1, 253)]);
    for (length, wanted) in [(252, vec![]), (253, vec![("E1001", 1, 253)])] {
        assert_eq!(found(format!("({})\nM2\n", "x".repeat(length - 2)).as_bytes()), wanted, "{length}");
    }
    let long_number = format!("G0 X{}\nM2\n", "9".repeat(1000));
    assert_eq!(found(long_number.as_bytes()), [("E1001", 1, 253)]);
    let long_number = format!("G0 X{}\nG0 X1{}\nM2\n", "9".repeat(240), "0".repeat(246));
    // No machine is that large, and results calculated from such numbers are no longer finite.
    assert_eq!(found(long_number.as_bytes()), [("E1103", 1, 4), ("E1103", 2, 4)]);
    assert_eq!(found(b"N1\nM2\n"), []);
    assert_eq!(found(b"F17987547480000 G1 X1\nM2\n"), []);
    assert_eq!(found(b""), [("E1007", 0, 1)]);
    assert_eq!(found(b" \n\n"), [("E1007", 2, 1)]);
    assert_eq!(found(b"\x7fELF\x02\x01\n\xff\xfe\n\x00\nM2\n"), [("E1002", 1, 1), ("E1002", 2, 1), ("E1002", 3, 1)]);
    assert_eq!(found("(Fräser)\nM2\n".as_bytes()), []);
    assert_eq!(found(b"G0 (Fr\xe4ser) X\xe4\nM2\n"), [("E1002", 1, 14)]);
    let nested = format!("G0 X{}1{}\nM2\n", "[".repeat(100), "]".repeat(100));
    assert_eq!(found(nested.as_bytes()), []);
    let deep = format!("G0 X{}1{}\nM2\n", "[1+".repeat(60), "]".repeat(60));
    assert_eq!(found(deep.as_bytes()), [("E1207", 1, 126)]);
    let many = found(&b"X\n".repeat(1000));
    assert_eq!((many.len(), many.last()), (101, Some(&("E1010", 100, 1))));
    let warned = check([b"M3\n".repeat(1000), b"X\nM2\n".to_vec()].concat(), Setup::default());
    assert_eq!((warned.len(), warned.last().map(|found| found.line)), (101, Some(1001)));
}

#[test]
fn each_fault_is_named_where_it_is() {
    for (line, number, column) in [
        ("G0 X", "E1101", 4),
        ("G0 X[1+]", "E1101", 8),
        ("G0 X1.5.5", "E1102", 5),
        ("G0 X.", "E1102", 5),
        ("T1.5", "E1104", 1),
        ("F-5", "E1105", 1),
        ("G0 X[FOO[1]]", "E1201", 6),
        ("G0 X[1 FOO 2]", "E1201", 8),
        ("G0 X[1", "E1202", 5),
        ("G0 X1]", "E1003", 6),
        ("G0 XSIN 30", "E1203", 9),
        ("G0 X[ATAN[1]]", "E1203", 13),
        ("G0 X[1/0]", "E1204", 6),
        ("G0 X[1 MOD 0]", "E1204", 6),
        ("G0 X[SQRT[-1]]", "E1205", 6),
        ("G0 X[[-8]**.5]", "E1205", 6),
        ("G0 X[10**400]", "E1206", 6),
        ("G0 X#6000", "E1301", 5),
        ("#0=1", "E1301", 1),
        ("G0 X#<gone>", "E1302", 5),
        ("#5400=1", "E1303", 1),
        ("#<_x>=1", "E1303", 1),
        ("#1 3", "E1304", 5),
        ("G0 X#<open", "E1305", 5),
        ("G99.9", "E1401", 1),
        ("G33 Z1 K1", "E1626", 1),
        ("M10", "E1403", 1),
        ("G4", "E1505", 1),
        ("G0 G1 X1", "E1405", 4),
        ("M3 M4", "E1406", 4),
        ("G0 X1 X2", "E1407", 7),
        ("G0 X1 P1", "E1408", 7),
        ("G0 X1 A5", "E1409", 7),
        ("G0 @5", "E1711", 4),
        ("M3 M8 M48 M0 M62 P1", "E1411", 14),
        ("G80 X1", "E1502", 5),
        ("G0 G28 X1", "E1503", 4),
        ("G92", "E1504", 1),
        ("G4", "E1505", 1),
        ("M62", "E1505", 1),
        ("G53 G2 X1 R1", "E1506", 1),
        ("G91 G53 G0 X1", "E1507", 5),
        ("G1 X1", "E1508", 1),
        ("G93 G1 X1", "E1509", 5),
        ("G10 L3 P1", "E1510", 5),
        ("G10 L2 P10", "E1511", 8),
        ("F9 G2 X1", "E1601", 7),
        ("F9 G2 X1 R1 I1", "E1602", 10),
        ("F9 G2 X1 K1", "E1603", 10),
        ("F9 G2 Z1 R1", "E1604", 10),
        ("F9 G2 X0 I0", "E1605", 10),
        ("F9 G2 X5 I1", "E1606", 10),
        ("F9 G2 X0 Y0 R1", "E1607", 13),
        ("F9 G2 X5 R1", "E1608", 10),
        ("F9 G90.1 G2 X2 I1", "E1609", 16),
        ("T9", "E1701", 1),
        ("G0 X1 (open", "E1004", 7),
        ("(a(b)", "E1005", 3),
        ("G0 N5", "E1009", 4),
        ("N G0", "E1009", 1),
        ("G0 X1 /Y1", "E1003", 7),
    ] {
        let text = format!("{line}\nM2\n");
        let diagnostics = check(text.as_bytes(), Setup::default());
        let first = diagnostics.first().map(|found| (found.number(), found.line, found.column()));
        assert_eq!(first, Some((number, 1, column)), "{line}: {diagnostics:?}");
    }
    let number =
        |text: &str| check(text.as_bytes(), Setup::default()).first().map(|found| (found.number(), found.line));
    assert_eq!(number("X1\nM2\n"), Some(("E1501", 1)));
    assert_eq!(number("G0 X1\n"), Some(("E1006", 1)));
    assert_eq!(number("%\nG0 X1\n"), Some(("E1008", 2)));
    assert_eq!(number("G0 X1\nM2\n\nG0 X2\n"), Some(("W1001", 4)));
    assert_eq!(number("M3\nM2\n"), Some(("W1002", 1)));
}
