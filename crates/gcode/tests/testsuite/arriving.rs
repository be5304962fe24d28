//! A streamed program has the same effect as the pre-scanned one from a file.

#[allow(dead_code)] // other tests use the remaining items
use crate::writer;

use retrace_gcode::{CanonStep, Program, Progress, Setup};
use std::io::BufRead;
use std::sync::Arc;
use writer::Writer;

/// Returns the steps of a program up to the first refused line, and the number of that error.
fn steps<R: BufRead>(mut program: Program<R>) -> (Vec<CanonStep>, Option<&'static str>) {
    let mut steps = Vec::new();
    for _ in 0..100_000 {
        match program.advance(&mut steps) {
            Progress::Line => {}
            Progress::End => break,
            Progress::BlockError => {
                let last = program.interpreter().diagnostics().last();
                return (steps, last.map(|found| found.number()));
            }
        }
    }
    (steps, None)
}

fn both(text: &str) -> [(Vec<CanonStep>, Option<&'static str>); 2] {
    let prescan = retrace_gcode::Prescan::scan("program", text.into(), &Setup::rs274());
    [
        steps(Program::<&[u8]>::prescanned(Arc::new(prescan), Setup::rs274())),
        steps(Program::new(text.as_bytes(), Setup::rs274())),
    ]
}

#[test]
fn random_programs_do_the_same_either_way() {
    let (mut whole, mut with_jumps) = (0, 0);
    for seed in 0..600 {
        let text = Writer::case(seed).program;
        let [file, arrived] = both(&text);
        // A subprogram that has not arrived cannot be called; labels of discarded regions may be used again.
        if arrived.1 == Some("E1811") {
            assert!(file.0.starts_with(&arrived.0[..arrived.0.len().min(file.0.len())]), "seed {seed}");
            continue;
        }
        if file.1.is_none() {
            assert_eq!(file, arrived, "seed {seed}\n{text}");
            whole += 1;
            with_jumps += usize::from(text.contains("call") || text.contains("repeat"));
        }
    }
    assert!(whole > 300 && with_jumps > 100, "{whole} programs, {with_jumps} with jumps");
}

#[test]
fn a_loop_is_forgotten_when_it_has_been_carried_out_and_a_subprogram_is_kept() {
    // Loops of 1 MiB each: 40 of them exceed the memory limit.
    let mut text = String::from("o1 sub\nG0 X#1\no1 endsub\n");
    for label in 10..50 {
        text += &format!("o{label} repeat [1]\n");
        text += &format!("({})\n", "x".repeat(240)).repeat(4000);
        text += &format!("o1 call [{label}]\no{label} endrepeat\n");
    }
    text += "M2\n";
    let (found, refused) = steps(Program::new(text.as_bytes(), Setup::rs274()));
    assert_eq!((refused, found.last().is_some()), (None, true));
    let kept =
        text.replace("o10 repeat [1]", "o99 sub").replace("o10 endrepeat", "").replace("M2\n", "o99 endsub\nM2\n");
    let (_, refused) = steps(Program::new(kept.as_bytes(), Setup::rs274()));
    assert_eq!(refused, Some("E1812"));
}
