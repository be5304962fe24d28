//! Duration of planning per block, blends included, and of emission per control period.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use retrace_core::Flags;
use retrace_motion::{FeedRate, MachineLimits, PathMode, Planner};

const BLOCKS: usize = 100_000;

/// A row-by-row surface of short lines, as CAM systems write them: pieces of about 0.1 mm with coordinates in steps of
/// 1 µm.
fn surface() -> Vec<[f64; 4]> {
    let row = 500;
    (0..BLOCKS)
        .map(|k| {
            let (along, across) = (k % row, k / row);
            let forward = if across % 2 == 0 { along } else { row - 1 - along };
            let (x, y) = (forward as f64 * 0.1, across as f64 * 0.2);
            let z = 2.0 * (x * 0.3).sin() * (y * 0.2).cos();
            [x, y, z, 0.0].map(|c| (c * 1000.0).round() / 1000.0)
        })
        .collect()
}

fn plan(points: &[[f64; 4]], records: &mut u64) {
    let mut planner = Planner::<4>::new(MachineLimits::built_in(), [0.0; 4]).expect("the built-in machine is valid");
    let mode = PathMode::blend(0.05);
    for (k, point) in points.iter().enumerate() {
        planner.line(*point, FeedRate::PerSecond(50.0), mode, k as u32).expect("a valid line");
        if *records > 0 {
            while let Some(record) = planner.next_record() {
                black_box(record);
                *records += 1;
            }
        }
    }
    planner.stop(Flags::NONE);
    while *records > 0
        && let Some(record) = planner.next_record()
    {
        black_box(record);
        *records += 1;
    }
}

fn benches(c: &mut Criterion) {
    let points = surface();
    let mut group = c.benchmark_group("surface of 0.1 mm lines");
    group.sample_size(10);
    group.throughput(Throughput::Elements(BLOCKS as u64));
    group.bench_function("planning, per block", |b| b.iter(|| plan(&points, &mut 0)));
    let mut records = 1;
    plan(&points, &mut records);
    group.throughput(Throughput::Elements(records));
    group.bench_function("planning and emission, per period", |b| b.iter(|| plan(&points, &mut 1)));
    group.finish();

    let mut group = c.benchmark_group("one long line");
    let line = |periods: &mut u64| {
        let mut planner =
            Planner::<4>::new(MachineLimits::built_in(), [0.0; 4]).expect("the built-in machine is valid");
        planner
            .line([1000.0, 500.0, 0.0, 0.0], FeedRate::PerSecond(10.0), PathMode::ExactStop, 1)
            .expect("a valid line");
        planner.stop(Flags::NONE);
        while let Some(record) = planner.next_record() {
            black_box(record);
            *periods += 1;
        }
    };
    let mut periods = 0;
    line(&mut periods);
    group.throughput(Throughput::Elements(periods));
    group.bench_function("emission, per period", |b| b.iter(|| line(&mut 0)));
    group.finish();
}

criterion_group!(all, benches);
criterion_main!(all);
