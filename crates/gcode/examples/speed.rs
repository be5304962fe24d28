//! Measures the number of lines read per second: `cargo run --release --example speed` (package retrace-gcode).

use retrace_gcode::{Program, Progress, Setup};
use std::fmt::Write as _;
use std::time::Instant;

const LINES: usize = 100_000;

/// Returns a program of feed moves with three axes and a few feed rates.
fn feed_moves() -> String {
    let mut text = String::from("G21 G90 F1000\n");
    for line in 0..LINES {
        let (x, y) = ((line * 7919) % 100_000, (line * 104_729) % 100_000);
        // Writing to a string cannot fail.
        let _ = writeln!(text, "G1 X{}.{:04} Y-{}.{:03} Z-1.5", x / 1000, x % 1000, y / 1000, y % 1000);
    }
    text + "M2\n"
}

/// Returns a program that calculates its ends.
fn calculated_moves() -> String {
    let mut text = String::from("G21 G90 F1000\n#1=10 #2=0.5\n");
    for line in 0..LINES {
        let _ = writeln!(text, "G1 X[#1*COS[{line}]+#2] Y[#1*SIN[{line}]-#2]");
    }
    text + "M2\n"
}

/// Returns a program that is a loop.
fn looped_moves() -> String {
    format!("F1000\nO1 while [#1 LT {}]\n#1=[#1+1]\nG1 X[#1/1000] Y[#1 MOD 7]\nO1 endwhile\nM2\n", LINES / 4)
}

fn measure(name: &str, text: &str) {
    let mut best = f64::INFINITY;
    let mut taken = 0;
    for _ in 0..9 {
        let start = Instant::now();
        let mut program = Program::new(text.as_bytes(), Setup::default());
        let mut steps = Vec::new();
        taken = 0_u32;
        while program.advance(&mut steps) != Progress::End {
            taken += 1;
            std::hint::black_box(&steps);
            steps.clear();
        }
        best = best.min(start.elapsed().as_secs_f64());
    }
    println!("{name:18} {taken:7} lines, {:6.2} million lines/s", f64::from(taken) / best / 1e6);
}

fn main() {
    measure("feed moves", &feed_moves());
    measure("calculated moves", &calculated_moves());
    measure("a loop", &looped_moves());
}
