//! Inputs that have crashed controllers, one by one, with their result here.
//!
//! Invariant: each ends within seconds, and its diagnostic names the one thing that is wrong with it.

use crate::harm;

use retrace_gcode::{Parameters, Prescan, Program, Progress, Setup, Text, ToolTable, check, cycles::CycleLibrary};
use std::sync::Arc;

fn setup() -> Setup {
    Setup { cycles: Some(Arc::new(CycleLibrary::shipped())), ..Setup::default() }
}

/// Returns the findings of a check, after the program has passed every entry point.
fn found(text: &str) -> Vec<(&'static str, u32)> {
    harm::program(text.as_bytes());
    check(text.as_bytes(), setup()).iter().map(|found| (found.number(), found.line)).collect()
}

#[test]
fn loops_and_calls_without_end_are_told() {
    assert_eq!(found("O1 while [1]\nO1 endwhile\nM2\n").first().map(|found| found.0), Some("E1806"));
    // A check of each would execute ten million lines; it is enough that they do no harm.
    for text in [
        "O1 repeat [10**300]\nO1 endrepeat\nM2\n",
        "O1 do\nG0 X1\nO1 while [1]\nM2\n",
        "M98 P1 L4000000000\nM2\nO1\nG0 X1\nM99\n",
    ] {
        harm::program(text.as_bytes());
    }
    assert_eq!(found("O<a> call\nM2\nO<a> sub\nO<a> call\nO<a> endsub\n"), [("E1805", 4)]);
    assert_eq!(
        found("O<a> call\nM2\nO<a> sub\nO<b> call\nO<a> endsub\nO<b> sub\nO<a> call\nO<b> endsub\n"),
        [("E1805", 4)]
    );
}

/// Thousands of holes in every iteration of a loop: a limit on lines alone would not bound the work.
#[test]
fn a_loop_of_large_cycles_is_told_too() {
    let text = "F9 G91 G0 X1\nO1 while [1]\nG81 X1 Z-1 R1 L10000\nO1 endwhile\nM2\n";
    harm::program(text.as_bytes());
    // A hundred million functions are tested in fast builds only.
    if !cfg!(debug_assertions) {
        assert_eq!(found(text).first().map(|found| found.0), Some("E1806"));
    }
}

#[test]
fn ten_thousand_blocks_inside_each_other() {
    let open: String = (0..10_000).map(|label| format!("O{label} if [1]\n")).collect();
    let close: String = (0..10_000).rev().map(|label| format!("O{label} endif\n")).collect();
    assert_eq!(found(&format!("{open}{close}M2\n")), []);
    // Every missing end is reported, up to the maximum number of errors.
    let open: String = (0..1000).map(|label| format!("O{label} if [1]\n")).collect();
    assert_eq!(found(&format!("{open}M2\n")).len(), 101);
    let labels: String = (0..50_000).map(|label| format!("LA{label}:\n")).collect();
    assert!(found(&labels).len() < 102);
}

#[test]
fn brackets_and_digits_without_end() {
    for text in ["G0 X", "#1=", "F", "O1 call ", "CYCLE81("] {
        for piece in ["[", "SIN[", "-", "1+", "9", "#", "**", "(", "\"", ",", "ATAN[1]/["] {
            for count in [50, 120, 1000] {
                found(&format!("{text}{}\nM2\n", piece.repeat(count)));
            }
        }
    }
}

#[test]
fn a_cycle_that_asks_for_too_much_is_refused() {
    let start = "T1 M6 G43\nS500 M3 F100\nG0 X0 Y0 Z50\n";
    for (call, number) in [
        ("HOLES1(0,0,0,0,1,1000000000)", "E1823"),
        ("HOLES2(0,0,20,0,0,1000000000)", "E1823"),
        ("MCALL CYCLE83(10,0,2,-57,,,0.1,0,0,0,1)\nHOLES1(0,0,0,0,1,100000)", "E1823"),
        ("CYCLE83(10,0,2,-57,,,20,-0.001)", "E1823"),
        ("CYCLE83(10,0,2,-57,,,0.0000001)", "E1823"),
        ("CYCLE84(10,0,2,-1000000,,0,3,6,,0,100,100,,,,1,0.00001)", "E1823"),
        ("G83 X1 Z-1000 R1 Q.0000001", "E1622"),
    ] {
        let errors: Vec<_> =
            found(&format!("{start}{call}\nM2\n")).into_iter().filter(|found| found.0.starts_with('E')).collect();
        assert_eq!(errors.first().map(|found| found.0), Some(number), "{call}");
    }
}

#[test]
fn an_infeed_next_to_nothing_is_refused() {
    let contour = "O<part> sub\nG1 X10 Z0\nZ-12\nX16 Z-18\nX25\nO<part> endsub\n";
    for call in [
        "CYCLE95(\"part\",[10**-300],,,,90,50,20,1)",
        "CYCLE95(\"part\",5,,,,90,50,20,1,0,[10**-300])",
        "CYCLE95(\"part\",5,[10**300],,,90,50,20,1)",
    ] {
        let text = format!("T1 M6\nG18 F100 G0 X60 Z10\n{call}\nM2\n{contour}");
        assert_eq!(found(&text), [("E1823", 3)], "{call}");
    }
    // A contour that calls itself, and one that drills endlessly.
    for body in ["O<part> call", "G81 X1 Z2 Y-1 R1 L10000", "O9 while [1]\nO9 endwhile"] {
        let text = format!(
            "T1 M6\nG18 F100 G0 X60 Z10\nCYCLE95(\"part\",5,,,,90,50,20,1)\nM2\nO<part> sub\n{}O<part> endsub\n",
            format!("{body}\n").repeat(1)
        );
        assert_eq!(found(&text).first(), Some(&("E1823", 3)), "{body}");
        let text = format!(
            "T1 M6\nG18 F100 G0 X60 Z10\nG71 Q7 X30 Z2\nM2\nO7 sub\nG1 X1 Z2\n{}O7 endsub\n",
            format!("{body}\n").repeat(100).replace("part", "7").replace("O<7>", "O7")
        );
        assert!(!found(&text).is_empty(), "{body}");
    }
}

/// A file that calls what it should contain itself: each name is searched for once.
#[test]
fn files_that_call_each_other_are_read_once() {
    assert_eq!(found("O<f1> call\nO<f2> call\nO<f1> call\nO<g1> call\nM2\n").len(), 4);
    let calls: String = (0..2000).map(|number| format!("O<f{}> call\n", number % 7)).collect();
    harm::program(calls.as_bytes());
}

/// Ten thousand contours in one program: their labels are searched for once, not from the start for each.
#[test]
fn looking_for_labels_takes_no_square_of_time() {
    let calls: String =
        (0..10_000).map(|label| format!("CYCLE95(\"PA{label}:PB{label}\",5,,,,90,50,20,1)\n")).collect();
    let labels: String = (0..10_000).map(|label| format!("PA{label}:\nG1 X1 Z1\nPB{label}:\n")).collect();
    let text = Text::from(format!("{calls}M2\n{labels}").as_str());
    let began = std::time::Instant::now();
    let prescan = Arc::new(Prescan::scan("program", text, &setup()));
    assert!(prescan.diagnostics().is_empty());
    let mut program = Program::<&[u8]>::prescanned(prescan, setup());
    program.close(&mut Vec::new());
    program.check_after_end();
    assert!(began.elapsed().as_secs() < 20, "{:?}", began.elapsed());
}

/// A streamed program may create names, points and moves endlessly; the memory is bounded.
#[test]
fn what_a_program_that_arrives_keeps_is_bounded() {
    let names: String = (0..60_000).map(|number| format!("#<a{number}>=1\n")).collect();
    let points = format!("F9 G5.2 X1 P1\n{}", "X2 Y1 P2\n".repeat(60_000));
    let subs: String =
        (0..80_000).map(|number| format!("O{number} sub\n({})\nO{number} endsub\n", "x".repeat(240))).collect();
    let loops = format!(
        "O1 while [0]\n{}",
        "G0 X1 (xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx)\n".repeat(400_000)
    );
    for (text, number) in [(names, "E1812"), (points, "E1715"), (subs, "E1812"), (loops, "E1812")] {
        let mut program = Program::new(text.as_bytes(), setup());
        let mut steps = Vec::new();
        while program.advance(&mut steps) == Progress::Line {
            steps.clear();
        }
        let found: Vec<_> = program.interpreter().diagnostics().iter().map(|found| found.number()).collect();
        assert_eq!(found, [number], "{}", &text[..30]);
    }
}

#[test]
fn numbers_beyond_any_machine_are_refused() {
    assert_eq!(found("F17987547480000 G1 X1\nM2\n"), []);
    assert_eq!(found("G1 F[10**15] X[10**15]\nM2\n"), []);
    assert_eq!(found("G1 F9 X[10**15]\nM2\n"), [("E1512", 1)]);
    for word in ["X[10**16]", "Y-9999999999999999", "F[10**300]", "S[10**300]", "I[-10**300] X1"] {
        assert_eq!(found(&format!("F9 G3 {word}\nM2\n").replace("F9 G3 F", "G1 F")), [("E1103", 1)], "{word}");
    }
    // Offsets also reach the moves through parameters and tables.
    harm::program(
        b"#5221=[10**308]\n#5211=[10**308]\n#5210=1\nG54 G20 G92.3\nG0 X1\nG91 G0 X9\nG10 L20 P1 X5\nG28\nM2\n",
    );
    assert!(ToolTable::read("T1 P1 X1e300\n").is_err());
    assert!(Parameters::read("5211 1e308\n5221 1e308\n").is_ok());
    harm::tables(b"5161 1e308\n5210 1\n5211 1e308\n5212 -1e308\n5220 1\n5221 -1e308\n5222 1e308\n");
}

#[test]
fn a_cycle_source_without_end_is_refused() {
    for body in [
        "LOOP\nENDLOOP",
        "LOOP\nG90\nENDLOOP",
        "LOOP\nG0 X1\nENDLOOP",
        "WHILE TRUE\nMSG(\"x\")\nENDWHILE",
        "FUZZ(1)",
        "B:\nGOTOB B",
    ] {
        harm::cycle(format!("PROC FUZZ(REAL A)\n{body}\nM17\n").as_bytes());
    }
    for piece in ["(", "IF A\n", "-", "LOOP\n", "NOT ", "\"", "L: "] {
        harm::cycle(format!("PROC FUZZ(REAL A)\nA={}\nM17\n", piece.repeat(5000)).as_bytes());
        harm::cycle(format!("PROC FUZZ(REAL A)\n{}\nM17\n", piece.repeat(5000)).as_bytes());
    }
}
