//! The language: what cycles of a user can do, and the errors of the compiler.
//!
//! Invariant: every construct is tested by its effect, not by its compiled form.

use crate::common;

use common::{Recorder, halted, run};
use retrace_cycles::{CycleLibrary, ErrorCode, LibraryFinding};

/// Runs a source that defines `TEST`, and returns its blocks.
fn test(source: &str, call: &str) -> Recorder {
    let library = CycleLibrary::of_sources(&[("TEST", source)]);
    assert!(library.find("TEST").is_some(), "{source}\n{:?}", library.findings());
    let mut host = Recorder::default();
    assert_eq!(run(&library, call, &mut host), Ok(()), "{source}");
    host
}

fn messages(body: &str) -> Vec<String> {
    test(&format!("PROC TEST\n{body}\nM17\n"), "TEST").messages
}

fn value(expression: &str) -> String {
    messages(&format!("MSG({expression})")).join("")
}

fn faults(source: &str) -> Vec<(ErrorCode, u32)> {
    let library = CycleLibrary::of_sources(&[("TEST", source)]);
    library.findings().iter().map(|LibraryFinding { diagnostic, .. }| (diagnostic.code, diagnostic.line)).collect()
}

#[test]
fn expressions_have_the_precedence_of_the_control() {
    for (expression, expected) in [
        ("1+2*3", "7"),
        ("(1+2)*3", "9"),
        ("2-3-4", "-5"),
        ("-2*-3", "6"),
        ("7/2", "3.5"),
        ("7 DIV 2", "3"),
        ("-7 DIV 2", "-3"),
        ("7.5 MOD 2", "1.5"),
        ("(1<2) AND (2<3)", "1"),
        ("(1==1) OR (1==2) AND (1==3)", "1"),
        ("NOT (1==1)", "0"),
        ("TRUE XOR TRUE", "0"),
        ("(0.1+0.2)==0.3", "1"),
        ("(\"a\"==\"b\")", "0"),
        ("(\"a\"<>\"b\")", "1"),
        ("SIN(30)", "0.5"),
        ("COS(180)", "-1"),
        ("TAN(45)", "1"),
        ("ATAN2(1,-1)", "135"),
        ("ASIN(1)+ACOS(1)", "90"),
        ("SQRT(POT(3)+POT(4))", "5"),
        ("TRUNC(-2.7)+ROUND(2.5)", "1"),
        ("ABS(-3)+MINVAL(1,2)+MAXVAL(1,2)", "6"),
        ("BOUND(1,5,9)-BOUND(1,5,-9)", "4"),
        ("LN(EXP(2))", "2"),
        ("1.5EX2", "150"),
        ("$P_GG[6]", "1"),
        ("$P_AD[24]", "30"),
    ] {
        let shown = if expression.contains('<') || expression.contains('=') || expression.contains("NOT") {
            value(&format!("({expression})"))
        } else {
            value(expression)
        };
        assert_eq!(shown, expected, "{expression}");
    }
}

#[test]
fn structures_nest_and_loops_end() {
    assert_eq!(messages("DEF INT II\nFOR II=1 TO 3\nMSG(II)\nENDFOR\nMSG(\"end\"<<II)"), ["1", "2", "3", "end4"]);
    assert_eq!(messages("DEF INT II\nFOR II=5 TO 3\nMSG(II)\nENDFOR"), [""; 0]);
    assert_eq!(
        messages("DEF INT II=3\nWHILE II>0\nII=II-1\nIF II==1\nMSG(\"one\")\nELSE\nMSG(II)\nENDIF\nENDWHILE"),
        ["2", "one", "0"]
    );
    assert_eq!(messages("DEF INT II\nREPEAT\nII=II+1\nUNTIL II>=4\nMSG(II)"), ["4"]);
    assert_eq!(messages("DEF INT II\nLOOP\nII=II+1\nIF II==7 GOTOF OUT\nENDLOOP\nOUT: MSG(II)"), ["7"]);
    // The last value is calculated once.
    assert_eq!(messages("DEF INT II, NN=2\nFOR II=1 TO NN\nNN=9\nMSG(II)\nENDFOR"), ["1", "2"]);
}

#[test]
fn jumps_find_their_labels_in_their_direction() {
    assert_eq!(
        messages("DEF INT II\nTOP: II=II+1\nIF II<3 GOTOB TOP\nGOTOF LAST\nMSG(\"never\")\nLAST:\nMSG(II)"),
        ["3"]
    );
    assert_eq!(messages("GOTO N20\nMSG(\"never\")\nN20 MSG(\"there\")"), ["there"]);
    assert_eq!(messages("GOTOF NEXT\nNEXT: MSG(\"next\")\nIF TRUE GOTOF N5\nN5 MSG(\"and\")"), ["next", "and"]);
    assert_eq!(messages("RET\nMSG(\"never\")"), [""; 0]);
}

#[test]
fn variables_have_types_arrays_and_initial_values() {
    assert_eq!(messages("DEF INT II=2.6\nMSG(II)\nII=-2.5\nMSG(II)"), ["3", "-3"]);
    assert_eq!(messages("DEF BOOL BB=5\nMSG(BB)"), ["1"]);
    assert_eq!(messages("DEF STRING[5] TT, UU=\"abc\"\nMSG(TT<<\"|\"<<UU)\nTT=UU\nMSG(TT)"), ["|abc", "abc"]);
    assert_eq!(messages("DEF REAL AA[2,3]=(1,2,3,4,5,6)\nMSG(AA[1,0]<<AA[0,2])\nAA[1,1]=9\nMSG(AA[1,1])"), ["43", "9"]);
    assert_eq!(messages("DEF INT II\nR1=5 R2=R1*2\nR[3]=R2+1\nII=3\nMSG(R[II])"), ["11"]);
    assert_eq!(messages("DEF REAL A1=2, X=3\nA1=A1+X\nMSG(A1)"), ["5"], "names that look like words");
}

#[test]
fn parameters_are_known_by_their_places() {
    let source = "PROC TEST(REAL a, STRING[20] b, INT c=7, BOOL d) SAVE DISPLOF\n\
        MSG(a << \",\" << b << \",\" << c << \",\" << d << \":\" << $P_SUBPAR[1] << $P_SUBPAR[2] << $P_SUBPAR[3] << \
        $P_SUBPAR[4])\nM17";
    let result = |call| test(source, call).messages.concat();
    assert_eq!(result("TEST(1.5,\"xy\",2.4,3)"), "1.5,xy,2,1:1111");
    assert_eq!(result("TEST(,,,1)"), "0,,7,1:0001");
    assert_eq!(result("TEST"), "0,,7,0:0000");
    let library = CycleLibrary::of_sources(&[("TEST", source)]);
    for wrong in ["TEST(\"x\")", "TEST(1,2)", "TEST(1,\"x\",1,1,1)", "TEST(,\"123456789012345678901\")"] {
        let alarm = halted(run(&library, wrong, &mut Recorder::default()));
        assert_eq!((alarm.code, alarm.line), (ErrorCode::BadArgument, 0), "{wrong}");
    }
}

#[test]
fn blocks_are_translated_into_rs274() {
    let lines = |body: &str| test(&format!("PROC TEST\n{body}\n"), "TEST").lines;
    assert_eq!(lines("N10 G1 X10.5 Y=1+1 Z-3 F=$P_F*2"), ["G1 X10.5 Y2 Z-3 F200"]);
    assert_eq!(lines("G18 G2 AX[1]=5 AX[2]=6 IP[1]=1 IP[2]=2"), ["G18 G2 Z5 X6 K1 I2"]);
    assert_eq!(lines("G3 X1 Y2 CR=-5"), ["G3 X1 Y2 R-5"]);
    assert_eq!(lines("G4 F2\nG4 S3"), ["G4 P2", "G4 P0.3"]);
    assert_eq!(lines("SPOS=45\nM=3 S100\nM3 M8"), ["R45 M19", "S100 M3", "M3 M8"]);
    assert_eq!(lines("DIAMON\nDIAMOF\nG60\nG33.1 Z-5 K1 I2"), ["G7", "G8", "G61", "G33.1 Z-5 K1 I2"]);
    assert_eq!(lines("R1=7 G0 X=R1"), ["G0 X7"], "assignments come first");
    assert_eq!(lines("G0X1Y2 ; a comment\n\n; another\n"), ["G0 X1 Y2"]);
}

#[test]
fn cycles_call_cycles() {
    let library = CycleLibrary::of_sources(&[
        ("OUTER", "PROC OUTER(STRING[9] AA)\nDEF REAL BB=3\nINNER(BB*2,,AA)\nMSG(BB)\nINNER\n"),
        (
            "INNER",
            "PROC INNER(REAL XX, REAL YY=4, STRING[9] ZZ) SAVE\nDEF REAL BB=8\nMSG(ZZ<<XX<<YY<<$P_SUBPAR[2]<<BB)\n",
        ),
    ]);
    assert!(library.findings().is_empty(), "{:?}", library.findings());
    let mut host = Recorder::default();
    assert_eq!(run(&library, "OUTER(\"t\")", &mut host), Ok(()));
    assert_eq!(host.messages, ["t6408", "3", "0408"]);
    assert_eq!(host.entered, ["+OUTER", "+INNER", "-INNER", "+INNER", "-INNER", "-OUTER"]);
}

#[test]
fn what_goes_wrong_in_a_run_is_an_alarm_with_its_line() {
    for (body, code) in [
        ("MSG(1/0)", ErrorCode::Arithmetic),
        ("MSG(1 MOD 0)", ErrorCode::Arithmetic),
        ("MSG(SQRT(-1))", ErrorCode::Arithmetic),
        ("MSG(ASIN(2))", ErrorCode::Arithmetic),
        ("MSG(TAN(90))", ErrorCode::Arithmetic),
        ("MSG(EXP(1000))", ErrorCode::Arithmetic),
        ("R[100]=1", ErrorCode::IndexRange),
        ("R[-1]=1", ErrorCode::IndexRange),
        ("AX[4]=1", ErrorCode::IndexRange),
        ("AX[0]=1", ErrorCode::IndexRange),
        ("MSG($PATH[0,0])", ErrorCode::IndexRange),
        ("LOOP\nENDLOOP", ErrorCode::Endless),
        ("LOOP\nG0 X1\nENDLOOP", ErrorCode::Endless),
        ("TEST", ErrorCode::CallsTooDeep),
        ("M=99", ErrorCode::CodeUnknown),
        ("SETAL(61000,\"text\")", ErrorCode::CycleAlarm),
    ] {
        let library = CycleLibrary::of_sources(&[("TEST", &format!("PROC TEST\n{body}"))]);
        assert!(library.find("TEST").is_some(), "{body}: {:?}", library.findings());
        let alarm = halted(run(&library, "TEST", &mut Recorder::default()));
        let is_loop = body.starts_with("LOOP");
        assert!(alarm.code == code && (alarm.line == 2 || is_loop), "{body}: {alarm:?}");
    }
    let library = CycleLibrary::of_sources(&[("TEST", "G4 S3")]);
    let mut host = Recorder { speed: 0.0, ..Recorder::default() };
    assert_eq!(halted(run(&library, "TEST", &mut host)).code, ErrorCode::NoSpeed);
}

/// 90 000 blocks of some ten steps are more steps than the tests allow without one.
#[test]
fn a_long_cycle_is_not_an_endless_one() {
    let host = test("DEF INT II\nFOR II=1 TO 90000\nG0 X=II\nENDFOR", "TEST");
    assert_eq!(host.lines.len(), 90_000);
}

#[test]
fn the_host_can_stop_a_run() {
    let library = CycleLibrary::shipped();
    let mut host = Recorder { stop_at: Some(1), ..Recorder::default() };
    assert_eq!(run(&library, "CYCLE81(10,0,2,-20)", &mut host), Err(retrace_cycles::CycleRunError::Stopped));
    assert_eq!(host.lines, ["G0 G90 Z2"]);
}

#[test]
fn alarms_and_warnings_carry_their_text() {
    let library = CycleLibrary::of_sources(&[(
        "TEST",
        "PROC TEST(REAL AA)\nSETAL(62801,\"w\")\nSETAL(65000, \"AA=\" << AA << \"!\")",
    )]);
    let mut host = Recorder::default();
    let alarm = halted(run(&library, "TEST(0.1)", &mut host));
    assert_eq!((alarm.number, alarm.text.as_str(), alarm.line), (Some(65000), "AA=0.1!", 3));
    assert_eq!(host.warnings, [62801]);
    assert_eq!(alarm.to_string(), "alarm 65000: AA=0.1!");
}

/// One source per code; the line is that of the error.
#[test]
fn every_error_of_a_source_is_told_with_its_line() {
    let deep = format!("R1={}1{}", "(".repeat(60), ")".repeat(60));
    let long = "X".repeat(11_000);
    for (source, code, line) in [
        ("R1=1\n\u{1}", ErrorCode::NotText, 2),
        ("R1=1\nR2=1 # 2", ErrorCode::BadCharacter, 2),
        ("MSG(\"a", ErrorCode::TextNotClosed, 1),
        ("R1=1.2.3", ErrorCode::BadNumber, 1),
        ("R1", ErrorCode::NotUnderstood, 1),
        ("R1=1 5", ErrorCode::NotUnderstood, 1),
        ("MCALL CYCLE81(1)", ErrorCode::NotUnderstood, 1),
        ("R1=FOO", ErrorCode::NameUnknown, 1),
        ("R1=$P_FOO", ErrorCode::NameUnknown, 1),
        ("R100=1", ErrorCode::NameUnknown, 1),
        ("DEF REAL AA, AA", ErrorCode::NameTaken, 1),
        ("DEF REAL WHILE", ErrorCode::NameTaken, 1),
        ("R1=\"a\"", ErrorCode::TypeMismatch, 1),
        ("DEF STRING[3] TT\nTT=1", ErrorCode::TypeMismatch, 2),
        ("R1=1+\"a\"", ErrorCode::TypeMismatch, 1),
        ("R1=", ErrorCode::ValueMissing, 1),
        ("R1=1+", ErrorCode::ValueMissing, 1),
        ("G1 X", ErrorCode::ValueMissing, 1),
        ("R1=(1+2", ErrorCode::NotClosed, 1),
        (&deep, ErrorCode::TooDeep, 1),
        ("IF R1>0 AND R2>0\nENDIF", ErrorCode::ComparisonChained, 1),
        ("IF 1<R1<2\nENDIF", ErrorCode::ComparisonChained, 1),
        ("R1=SIN(1,2)", ErrorCode::FunctionArguments, 1),
        ("R1=STOCKPATH(\"a\",1)", ErrorCode::FunctionArguments, 1),
        ("R1=1\nENDIF", ErrorCode::NotOpen, 2),
        ("IF R1>1\nENDWHILE\nENDIF", ErrorCode::NotOpen, 2),
        ("R1=1\nWHILE R1>0\nR1=0", ErrorCode::StructureOpen, 2),
        ("GOTOF NOWHERE", ErrorCode::LabelMissing, 1),
        ("AA: R1=1\nAA: R1=2", ErrorCode::LabelTwice, 2),
        ("GOTOB AA\nAA: R1=1", ErrorCode::LabelDirection, 1),
        ("R1=1\nPROC TEST", ErrorCode::ProcPlace, 2),
        ("PROC TEST\nPROC TEST", ErrorCode::ProcPlace, 2),
        ("PROC TEST FOO", ErrorCode::AttributeUnknown, 1),
        ("R1=1\nDEF REAL AA", ErrorCode::DefinitionPlace, 2),
        ("DEF REAL AA[0]", ErrorCode::ArraySize, 1),
        ("DEF REAL AA[2]=(1,2,3)", ErrorCode::ArraySize, 1),
        ("DEF REAL AA[2]\nAA=1", ErrorCode::ArrayIndex, 2),
        ("DEF REAL AA\nAA[1]=1", ErrorCode::ArrayIndex, 2),
        ("T1", ErrorCode::WordUnknown, 1),
        ("X1=5", ErrorCode::WordUnknown, 1),
        ("G5 X1", ErrorCode::CodeUnknown, 1),
        ("G=R1", ErrorCode::CodeUnknown, 1),
        ("M30", ErrorCode::CodeUnknown, 1),
        ("M199", ErrorCode::CodeUnknown, 1),
        ("G1 X1 X2", ErrorCode::WordTwice, 1),
        ("G0 G0 G0 G0 G0 G0 G0 G0 G0", ErrorCode::WordTwice, 1),
        ("DEF STRING[3] TT\nTT=\"a\"<<\"b\"", ErrorCode::TextJoin, 2),
        (&long, ErrorCode::SourceTooLong, 1),
        ("R1=1\nFOO(1)", ErrorCode::CycleUnknown, 2),
        ("PROC TEST(REAL AA)\nTEST(1,2)", ErrorCode::CallArguments, 2),
        ("PROC TEST(REAL AA)\nTEST(\"a\")", ErrorCode::CallArguments, 2),
    ] {
        assert!(faults(source).contains(&(code, line)), "{source}: {:?}", faults(source));
    }
}

#[test]
fn all_errors_of_a_source_come_in_one_go() {
    let found = faults("PROC TEST\nR1=\nG1 X1\nR2=FOO\nIF R1>\nR3=1\nENDIF\nG5");
    let lines: Vec<u32> = found.iter().map(|(_, line)| *line).collect();
    assert_eq!(lines, [2, 4, 5, 8], "the structure whose condition is wrong is closed all the same: {found:?}");
    let many = "R1=\n".repeat(500);
    let found = faults(&many);
    assert_eq!((found.len(), found.last().map(|found| found.0)), (51, Some(ErrorCode::TooManyErrors)));
}

#[test]
fn spans_point_at_what_is_meant() {
    let library = CycleLibrary::of_sources(&[("TEST", "R1=1\n  R2=R1+WRONG*2")]);
    let diagnostic = &library.findings()[0].diagnostic;
    assert_eq!((diagnostic.column(), diagnostic.end - diagnostic.start), (9, 5));
    let shown = diagnostic.to_string();
    assert!(
        shown.starts_with("2:9: error[E1906]: WRONG is neither a variable") && shown.contains("\n  help: "),
        "{shown}"
    );
}
