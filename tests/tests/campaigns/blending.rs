//! Blending as requested by programs and machine files: G64 P Q, and the source's glide.

use retrace_tests::command::Bench;
use retrace_tests::run::Run;
use std::fmt::Write;

/// Chords around a circle of 20 mm, then a zigzag with corners; and the points that it passes.
fn program(path_control: &str) -> (String, Vec<[f64; 2]>) {
    let around = (0..=180).map(|k| (f64::from(k) * 0.02).sin_cos()).map(|(sin, cos)| [20.0 * cos - 20.0, 20.0 * sin]);
    let zigzag = (1..=8).map(|k| [-20.0 - 3.0 * f64::from(k), if k % 2 == 0 { -2.0 } else { 4.0 }]);
    let points: Vec<[f64; 2]> = around.chain(zigzag).map(|p| p.map(|x| (x * 1e4).round() / 1e4)).collect();
    let mut text = format!("G21 G90 G94 F3000\n{path_control}\n");
    for [x, y] in &points {
        writeln!(text, "G1 X{x:.4} Y{y:.4}").expect("a string takes everything");
    }
    (text + "M2\n", points)
}

/// The largest distance in mm of an emitted position from the programmed path.
fn farthest(run: &Run, points: &[[f64; 2]]) -> f64 {
    let mut counts = [0i64; 2];
    let distance = |p: [f64; 2]| points.windows(2).map(|w| to_segment(p, w[0], w[1])).fold(f64::MAX, f64::min);
    run.records.rows.iter().fold(0.0, |most, row| {
        for (count, increment) in counts.iter_mut().zip(&row.increments) {
            *count += increment;
        }
        f64::max(most, distance(counts.map(|count| count as f64 / 1000.0)))
    })
}

fn to_segment(p: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let (way, to) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let squared = way[0] * way[0] + way[1] * way[1];
    let share = if squared > 0.0 { ((to[0] * way[0] + to[1] * way[1]) / squared).clamp(0.0, 1.0) } else { 0.0 };
    (to[0] - share * way[0]).hypot(to[1] - share * way[1])
}

fn run(path_control: &str, machine: &str) -> (Run, f64) {
    let bench = Bench::new();
    let (text, points) = program(path_control);
    let machine = format!("name = \"blending\"\n{machine}");
    let (program, machine) = (bench.file("blended.ngc", text), bench.file("machine.toml", machine));
    let run = Run::of(&bench, &program, &["--machine", machine.to_str().expect("a path of text")]);
    run.assert_exact_and_legal();
    let farthest = farthest(&run, &points);
    (run, farthest)
}

/// For any Q, the emitted positions are within P of the program; Q limits the distance of the merged lines.
#[test]
fn the_path_stays_within_p_whatever_q_is() {
    let records: Vec<_> = ["G64 P0.1", "G64 P0.1 Q0", "G64 P0.1 Q0.02", "G64 P0.1 Q0.5"]
        .map(|control| {
            let (run, farthest) = run(control, "");
            assert!(farthest <= 0.1 && farthest > 0.01, "{control}: {farthest} mm");
            run.records
        })
        .into();
    for (k, one) in records.iter().enumerate() {
        assert!(records[..k].iter().all(|other| other != one), "Q changes what is emitted");
    }
}

/// A machine file chooses the source's glide and its ratio; it is legal, within P, and slower than the optimum.
#[test]
fn a_machine_file_chooses_the_glide() {
    let seconds = |machine: &str| {
        let (run, farthest) = run("G64 P0.1", machine);
        assert!(farthest <= 0.1, "{machine}: {farthest} mm");
        run.number("motion_s")
    };
    let source = |ratio: f64, of: &str| {
        seconds(&format!("[blending]\nmethod = \"source\"\nglide_ratio = {ratio}\nratio_of = \"{of}\"\n"))
    };
    let optimum = seconds("[blending]\nmethod = \"optimum\"\n");
    let (small, large, by_speed) = (source(0.02, "length"), source(0.3, "length"), source(0.2, "speed"));
    assert!(optimum < large && large < small, "{optimum} s, {large} s, {small} s");
    assert!(by_speed > optimum && by_speed != large, "{by_speed} s");
}
