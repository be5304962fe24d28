//! Drawing of the table of machines: `cargo bench --package retrace-shop`. SHP-36 allows 5 ms for fifty rows.
//!
//! Invariant: the measurement covers the states in memory to the text of the table; writing it to a terminal is not
//! part of it.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use retrace_journal::Timestamp;
use retrace_shop::{MachineName, MachineReport, MachineState, machine_table};

/// States of so many machines, each with a text in every column.
fn states(count: u64, now: Timestamp) -> Vec<(MachineName, MachineState)> {
    let state = |number: u64| {
        let name = MachineName::parse(&format!("mill-{number}")).ok()?;
        let state = MachineState {
            state: Some("RUNNING".into()),
            job: Some(format!("01a22509-1fde-7f8d-b56a-{number:012}")),
            program: Some(format!("hydraulic-manifold-upper-half-rev-{number}.ngc")),
            line: Some(number * 1000),
            done_percent: Some(41.6),
            rate: Some(-0.5),
            override_percent: Some(110.0),
            alarm: Some(("E2201".into(), "X would leave its limits".into())),
            ..MachineState::of(&MachineReport::default(), now)
        };
        Some((name, state))
    };
    (0..count).filter_map(state).collect()
}

fn draw(bench: &mut Criterion) {
    let now = Timestamp::now();
    let states = states(50, now);
    bench.bench_function("fifty machines", |bencher| bencher.iter(|| machine_table(black_box(&states), now)));
}

criterion_group!(benches, draw);
criterion_main!(benches);
