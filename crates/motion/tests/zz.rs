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
#[test]
fn chains() {
    let limits = Limits::built_in();
    for tol in [0.005, 0.05] {
    for leg in [0.2, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0] {
    for deg in [3.0f64, 6.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 75.0, 90.0] {
        let mut line = format!("{tol:5} {leg:4} {deg:3}");
        for zigzag in [false, true] {
            let mut t = vec![];
            for k in ["glide", "stop"] {
                let mode = if k == "stop" { PathMode::ExactStop } else { PathMode::Blend { tolerance_mm: tol } };
                let (mut at, mut h) = ([0.0f64; 3], 0.1f64);
                let moves: Vec<Move> = (0..24).map(|i| {
                    let d = deg.to_radians();
                    h += if zigzag && i % 2 == 0 { -d } else { d };
                    at = [at[0] + leg * h.cos(), at[1] + leg * h.sin(), 0.0];
                    Move { path: Path::Line(at), feed: Feed::Rapid, mode, stop: false }
                }).collect();
                let run = play(limits, &moves, usize::MAX);
                t.push(run.points.len());
            }
            let h = tol * 6.0 / deg.to_radians();
            line += &format!("  | glide {:5} stop {:5}  leg/h {:.2} g/s {:.2}", t[0], t[1], leg / h, t[0] as f64 / t[1] as f64);
        }
        println!("{line}");
    }}}
}
#[test]
fn oracle_table() {
    let mut limits = Limits::built_in();
    let mut all = vec![];
    for line in std::fs::read_to_string("/tmp/corner_optima.csv").unwrap().lines().skip(1) {
        let f: Vec<f64> = line.split(',').map(|x| x.parse().unwrap()).collect();
        let (deg, leg, tol, opt) = (f[0], f[1], f[2], f[3]);
        let (s, c) = deg.to_radians().sin_cos();
        let mode = PathMode::Blend { tolerance_mm: tol };
        limits.pulses_per_mm = [100_000.0; 3];
        limits.period_s = 0.0001;
        let moves = [[leg, 0.0, 0.0], [leg + c * leg, s * leg, 0.0]].map(|p| Move { path: Path::Line(p), feed: Feed::Rapid, mode, stop: false });
        let t0 = std::time::Instant::now();
        let run = play(limits, &moves, usize::MAX);
        let el = t0.elapsed().as_secs_f64() * 1e3;
        let r = (run.points.len() as f64 - 0.5) * limits.period_s / opt;
        all.push(r);
        println!("{deg} {leg} {tol} ratio {r:.4} {el:.1} ms");
    }
    all.sort_by(f64::total_cmp);
    println!("median {} worst {}", all[all.len() / 2], all[all.len() - 1]);
}
