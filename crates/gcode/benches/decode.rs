//! Decoding speed of programs to canonical functions: `cargo bench --package retrace-gcode`.
//!
//! Feed moves, calculated moves, drilling cycles, subprograms that the pre-scan has compiled, and calls of a compiled
//! cycle; each from opening the program to its last canonical function, and the first three as text as well.
//!
//! Invariant: the measurement covers a program in memory from its text to the result; programs and cycles are created
//! before.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use retrace_gcode::cycles::CycleLibrary;
use retrace_gcode::{CanonText, Prescan, Program, Progress, Setup, Text};
use std::fmt::Write as _;
use std::hint::black_box;
use std::sync::Arc;

const LINES: u32 = 2000;

/// Creates a program whose lines `write` returns, from the number of a line and two pseudo-random numbers.
fn program(write: impl Fn(u32, u32, u32) -> String, behind: &str) -> Text {
    let mut text = String::from("G21 G90 G17\nF1000\nG0 X0 Y0 Z20\n");
    for line in 0..LINES {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{}", write(line, line * 7919 % 10_000, line * 104_729 % 10_000));
    }
    Text::from((text + "M2\n" + behind).as_str())
}

fn programs() -> [(&'static str, Text); 5] {
    let subs: String = (100..120).map(|sub| format!("O{sub} sub\nG1 X[#1] Y2\nG1 Y[#1/2]\nO{sub} endsub\n")).collect();
    [
        ("feed moves", program(|_, x, y| format!("G1 X{}.{:02} Y-{}.{:02}", x / 100, x % 100, y / 100, y % 100), "")),
        ("calculated moves", program(|_, x, y| format!("G1 X[{x}/100] Y[0-{y}*0.01]"), "")),
        ("drilling cycles", program(|_, x, y| format!("G81 X{} Y{} Z-3.5 R20", x / 100, y / 100), "")),
        ("compiled calls", program(|line, x, _| format!("O{} call [{x}]", 100 + line % 20), &subs)),
        ("calls of a cycle", program(|line, _, _| format!("CYCLE81(10, 0, 2, -{}.5)", line % 9), "")),
    ]
}

/// Decodes a program; each canonical function is passed to `take`.
fn decode(text: &Text, setup: &Setup, take: &mut impl FnMut(&retrace_gcode::CanonStep)) {
    let prescan = Arc::new(Prescan::scan("program", text.clone(), setup));
    let mut program = Program::<&[u8]>::prescanned(prescan, setup.clone());
    let mut steps = Vec::new();
    loop {
        let progress = program.advance(&mut steps);
        steps.drain(..).for_each(|step| take(&step));
        if progress == Progress::End {
            break;
        }
    }
    assert!(program.interpreter().diagnostics().is_empty(), "{:?}", program.interpreter().diagnostics());
}

fn decoding(criterion: &mut Criterion) {
    let setup = Setup { cycles: Some(Arc::new(CycleLibrary::shipped())), ..Setup::rs274() };
    let mut group = criterion.benchmark_group("decode");
    group.throughput(Throughput::Elements(LINES.into()));
    for (name, text) in programs() {
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                decode(&text, &setup, &mut |step| {
                    black_box(step);
                });
            });
        });
    }
    for (name, text) in programs().into_iter().take(3) {
        group.bench_function(format!("{name}, as text"), |bencher| {
            bencher.iter(|| {
                let mut out = CanonText::new(std::io::sink());
                decode(&text, &setup, &mut |step| out.write(step).expect("a sink"));
            });
        });
    }
    group.finish();
}

criterion_group!(benches, decoding);
criterion_main!(benches);
