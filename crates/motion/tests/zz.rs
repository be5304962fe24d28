mod common;
use common::*;
use retrace_motion::{Feed, Limits, PathMode};
#[test]
fn corners() {
    let limits = Limits::built_in();
    for deg in [15.0f64, 30.0, 45.0, 60.0, 90.0, 120.0, 135.0, 160.0] {
        for leg in [0.5, 2.0, 20.0] {
            for tol in [0.005, 0.05] {
                let (s, c) = deg.to_radians().sin_cos();
                let mode = PathMode::Blend { tolerance_mm: tol };
                let moves = [[leg, 0.0, 0.0], [leg + c * leg, s * leg, 0.0]].map(|p| Move { path: Path::Line(p), feed: Feed::Rapid, mode, stop: false });
                let run = play(limits, &moves, usize::MAX);
                println!("{deg} {leg} {tol}: {} {:?} {:?}", run.points.len(), judge_points(&limits, &run.points, [0.0; 3]), judge(&limits, &moves, &run, tol, 5));
            }
        }
    }
}
#[test]
fn three() {
    let limits = Limits::built_in();
    for mid in [0.028f64, 0.1, 0.3, 1.0, 3.0, 10.0] {
    for deg in [-3.059658999033388f64.to_degrees(), 170.0, 120.0, 90.0, 60.0, 30.0, 10.0] {
        let d = deg.to_radians();
        let mode = PathMode::Blend { tolerance_mm: 0.05 };
        let moves = [[1.0, 0.0, 0.0], [1.0 + mid * d.cos(), mid * d.sin(), 0.0], [1.0 + mid * d.cos() + 1.0 * (2.0 * d).cos(), mid * d.sin() + (2.0 * d).sin(), 0.0]].map(|p| Move { path: Path::Line(p), feed: Feed::Rapid, mode, stop: false });
        let run = play(limits, &moves, usize::MAX);
        println!("{mid} {deg} : {} {:?} {:?}", run.points.len(), judge_points(&limits, &run.points, [0.0; 3]), judge(&limits, &moves, &run, 0.05, 5));
    }
    }
}
#[test]
fn bad() {
    let limits = Limits::built_in();
    let s = |kind, size, turn, feed| Step { kind, size, turn, bend: 0.0, rise: 0.0, feed, stop: false };
    let steps = [s(0, 0.0, 0.0, 2.05470949603801), s(0, -1.623037303576543, -2.6999748049593233, 0.0), s(5, 0.0, 2.2825719136328804, 0.0)];
    let mode = PathMode::Blend { tolerance_mm: 0.05 };
    let moves = program(&steps, mode);
    let run = play(limits, &moves, usize::MAX);
    println!("{:?}", judge(&limits, &moves, &run, 0.05, 5));
    for n in 115..130 { println!("{n} {:?}", run.points[n]); }
}
