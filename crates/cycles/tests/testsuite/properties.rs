//! Properties: nothing panics or hangs, whatever the source, the compiled form or the call is; checks precede motion.
//!
//! Invariant: the random sources contain words of the language, so that they pass beyond the first error.

use crate::common;

use common::Recorder;
use proptest::prelude::*;
use retrace_cycles::{Argument, CycleLibrary, CycleRunError, ErrorCode, Vm, VmLimits};

const WORDS: &[&str] = &[
    "PROC TEST(REAL AA, STRING[9] BB)",
    "DEF INT II",
    "DEF REAL CC[3,2]",
    "IF",
    "ELSE",
    "ENDIF",
    "WHILE",
    "ENDWHILE",
    "FOR",
    "II",
    "TO",
    "ENDFOR",
    "LOOP",
    "ENDLOOP",
    "REPEAT",
    "UNTIL",
    "GOTOF",
    "GOTOB",
    "LA:",
    "LA",
    "RET",
    "M17",
    "MSG(",
    "SETAL(",
    "AX[",
    "IP[",
    "CC[1,II]",
    "R1",
    "R[",
    "]",
    "(",
    ")",
    "=",
    "==",
    "<>",
    "<",
    ">=",
    "<<",
    "+",
    "-",
    "*",
    "/",
    "DIV",
    "MOD",
    "AND",
    "NOT",
    "SIN(",
    "ATAN2(",
    "SQRT(",
    ",",
    "1",
    "0",
    "2.5",
    "\"t\"",
    "AA",
    "BB",
    "G0",
    "G1",
    "G2",
    "G4",
    "X",
    "Z5",
    "F",
    "S10",
    "SPOS=",
    "CR=",
    "$P_F",
    "$P_EP[",
    "$P_SUBPAR[1]",
    "$PATH[0,0]",
    "STOCKPATH(",
    "TEST(",
    "TEST",
    "\n",
    "\n",
    "\n",
    ";",
    " ",
];

fn source() -> impl Strategy<Value = String> {
    prop::collection::vec(prop::sample::select(WORDS), 0..60).prop_map(|words| words.join(" "))
}

/// Small sources that usually compile: whole statements.
fn statements() -> impl Strategy<Value = String> {
    let statement = prop::sample::select(vec![
        "II=II+1",
        "AA=AA*1.5-II",
        "R[II]=AA",
        "CC[II MOD 3,1]=AA/II",
        "IF II>3\nRET\nENDIF",
        "FOR II=0 TO AA\nG0 X=II\nENDFOR",
        "WHILE II<AA\nII=II+2\nENDWHILE",
        "LOOP\nII=II+1\nIF II>9 GOTOF DONE\nENDLOOP",
        "G1 AX[II]=SQRT(AA) F=AA",
        "MSG(BB << AA << CC[II,0])",
        "TEST(AA-1, BB)",
        "SETAL(62100 + II, BB)",
        "M=II",
        "G4 S=AA",
        "DONE: SPOS=ATAN2(AA,II)",
        "REPEAT\nII=II+1\nUNTIL II>AA",
        "IF BB==\"t\"\nAA=TAN(AA)\nELSE\nAA=LN(AA)\nENDIF",
        "TOP:",
        "IF AA>II GOTOB TOP",
    ]);
    prop::collection::vec(statement, 0..12).prop_map(|lines| {
        format!("PROC TEST(REAL AA, STRING[9] BB) SAVE\nDEF INT II\nDEF REAL CC[3,2]\n{}\nM17", lines.join("\n"))
    })
}

const SMALL: VmLimits = VmLimits { steps: 5_000, blocks: 500, depth: 6 };

/// End of a run, its blocks and its messages.
type Ran = (Result<(), CycleRunError>, Vec<String>, Vec<String>);

fn run_all(library: &CycleLibrary, number: f64) -> Vec<Ran> {
    let arguments = [Argument::Number(number), Argument::Text("t")];
    let runs = library.iter().map(|(id, cycle)| {
        let mut host = Recorder::default();
        let count = cycle.parameters().len().min(2);
        let done = Vm::new(SMALL).run(library, id, &arguments[..count], &mut host);
        (done, host.lines, host.messages)
    });
    runs.collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 800, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_text_is_answered(text in "\\PC*", number in -1e3..1e3) {
        run_all(&CycleLibrary::of_sources(&[("TEST", &text)]), number);
    }

    #[test]
    fn any_commands_are_answered_and_spans_stay_in_their_lines(text in source(), number in -1e3..1e3) {
        let library = CycleLibrary::of_sources(&[("TEST", &text)]);
        let lines: Vec<&str> = text.split('\n').collect();
        for finding in library.findings() {
            let diagnostic = &finding.diagnostic;
            let length = lines.get(diagnostic.line.saturating_sub(1) as usize).map_or(0, |line| line.len());
            prop_assert!(diagnostic.start <= diagnostic.end && diagnostic.end as usize <= length, "{diagnostic:?}");
        }
        prop_assert_eq!(library.find("TEST").is_none(),
            library.findings().iter().any(|f| f.diagnostic.number().starts_with('E')));
        run_all(&library, number);
    }

    #[test]
    fn statements_run_to_an_end(text in statements(), number in -20.0..20.0_f64) {
        let library = CycleLibrary::of_sources(&[("TEST", &text)]);
        for (done, lines, _) in run_all(&library, number.round()) {
            prop_assert!(lines.len() <= 500);
            if let Err(CycleRunError::Alarm(alarm)) = done {
                prop_assert!(alarm.code != ErrorCode::CycleUnknown && alarm.line as usize <= text.lines().count());
            }
        }
    }

    /// A shipped cycle ends for any arguments, and an alarm precedes any motion.
    #[test]
    fn shipped_cycles_check_before_they_move(
        which in 0..12_usize,
        values in prop::collection::vec(prop_oneof![
            2 => Just(None),
            3 => (-3..30).prop_map(|n| Some(f64::from(n))),
            2 => (-60.0..60.0).prop_map(Some),
            1 => prop::sample::select(vec![Some(0.0), Some(1e9), Some(-1e-9), Some(3.0), Some(0.5)]),
        ], 18),
        plane in 17..20,
        inch in 0..2,
    ) {
        let library = CycleLibrary::shipped();
        let (id, cycle) = library.iter().nth(which).expect("twelve");
        let arguments: Vec<Argument<'_>> = cycle.parameters().iter().zip(&values).map(|(parameter, value)| match value {
            None => Argument::Missing,
            Some(_) if parameter.name == "NPP" => Argument::Text("CONTOUR"),
            // A number of holes that runs in reasonable time.
            Some(value) if parameter.name == "NUM" => Argument::Number(value.min(100.0)),
            Some(value) => Argument::Number(*value),
        }).collect();
        let mut host = Recorder { plane: f64::from(plane), inch: f64::from(inch), ..Recorder::default() };
        match Vm::default().run(&library, id, &arguments, &mut host) {
            Ok(()) => {}
            Err(CycleRunError::Alarm(alarm)) => {
                prop_assert!(alarm.code == ErrorCode::CycleAlarm, "{:?}", alarm);
                prop_assert!(host.lines.is_empty(), "{:?} behind {:?}", alarm, host.lines);
                let named = alarm.text.starts_with(cycle.name());
                prop_assert!(named && alarm.number.is_some_and(|number| retrace_cycles::alarm_text(number).is_some()));
            }
            Err(CycleRunError::Stopped) => prop_assert!(false, "the host does not stop"),
        }
    }

    /// Drilling never goes below the final depth, never feeds in free air above the start plane, and ends on the
    /// retraction plane.
    #[test]
    fn drilling_stays_between_its_planes(
        which in prop::sample::select(vec!["CYCLE81", "CYCLE82", "CYCLE83", "CYCLE84", "CYCLE85", "CYCLE89"]),
        rfp in -50.0..50.0_f64, up in 0.1..50.0_f64, sdis in 0.0..5.0_f64, depth in 0.1..100.0_f64,
            first in 0.5..60.0_f64,
        dam in -1.0..10.0_f64, vari in 0..2, flip in any::<bool>(),
    ) {
        let side = if flip { -1.0 } else { 1.0 };
        let (rtp, end) = (rfp + side * (up + sdis), rfp - side * depth);
        let tail = match which {
            "CYCLE83" => format!(",,{first},{dam},,,,{vari},,0.3"),
            "CYCLE84" => ",,,3,6".to_owned(),
            _ => String::new(),
        };
        let call = format!("{which}({rtp},{rfp},{sdis},{end}{}{tail})", if which == "CYCLE83" { "," } else { "" });
        let mut host = Recorder::default();
        if common::run(&CycleLibrary::shipped(), &call, &mut host) == Ok(()) {
            let heights: Vec<f64> = host.lines.iter().filter_map(|line| {
                line.split(' ').find_map(|word| word.strip_prefix('Z')).map(|z| z.parse::<f64>().expect("a number"))
            }).map(|z| side * (z - rfp)).collect();
            let deepest = heights.iter().copied().fold(f64::INFINITY, f64::min);
            prop_assert!((deepest + depth).abs() < 1e-5, "{} goes to {}", call, deepest);
            prop_assert!((heights[0] - sdis).abs() < 1e-5, "{}: {:?}", call, heights);
            prop_assert!((heights[heights.len() - 1] - up - sdis).abs() < 1e-5);
            prop_assert!(heights[..heights.len() - 1].iter().all(|height| *height < sdis + 1e-5), "{}: \
                {:?}", call, heights);
        } else {
            prop_assert!(which == "CYCLE83", "{}", call);
        }
    }
}

proptest! {
    // Folders are slow.
    #![proptest_config(ProptestConfig { cases: 150, failure_persistence: None, ..ProptestConfig::default() })]

    /// The stored form has the same effect as the source.
    #[test]
    fn a_kept_form_behaves_as_its_source(text in statements(), number in -20.0..20.0_f64) {
        let folder = std::env::temp_dir().join(format!("retrace-cycles-kept-{}", std::process::id()));
        let sources = folder.join("sources");
        let _ = std::fs::create_dir_all(&sources);
        std::fs::write(sources.join("TEST.SPF"), &text).expect("written");
        let compiled = folder.join("compiled");
        let folders = retrace_cycles::Folders { sources: Some(&sources), compiled: Some(&compiled) };
        let (now, kept) = (CycleLibrary::open(folders), CycleLibrary::open(folders));
        let both = (run_all(&now, number), run_all(&kept, number));
        let fresh = kept.iter().all(|(_, cycle)| cycle.is_from_cache());
        let _ = std::fs::remove_dir_all(&folder);
        prop_assert_eq!(both.0, both.1);
        prop_assert!(fresh);
    }
}
