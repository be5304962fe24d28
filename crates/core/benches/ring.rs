//! How fast records pass through the ring, between two threads and on one, beside rtrb in the same run.
//!
//! Records of 16 bytes, 4 096 cells each, the same loops around both. A last table has the two take turns, so that load
//! from elsewhere meets both alike: it is the one to read where the machine is not idle.
//!
//! Invariant: what is timed is the passing of records alone; threads are started and rings made before the clock is.

use std::hint::{black_box, spin_loop};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use criterion::{Criterion, SamplingMode, Throughput, criterion_group};
use retrace_core::ring::{Cell, Ring};
use retrace_core::{Record, RecordIndex};

const CELLS: usize = 4096;
/// History and look-ahead of the runs that keep history.
const HALF: u32 = CELLS as u32 / 2;

/// Records to push, none of them over the edge of a cache line.
#[repr(align(64))]
struct Samples([Record<4>; 64]);

/// Made beforehand: a record put together field by field could not be read back in one piece before it has left the
/// processor's store buffer, which would be most of what is timed.
fn made_beforehand() -> Samples {
    black_box(Samples(core::array::from_fn(|n| Record {
        increments: [3, -2, 1, n as i16],
        line: n as u32,
        ..Record::default()
    })))
}

fn ring(keep: u32, look_ahead: u32) -> Ring<Box<[Cell<Record<4>>]>> {
    let cells = (0..CELLS).map(|_| Cell::default()).collect();
    Ring::new(cells, keep, look_ahead, RecordIndex::new(0)).expect("a power of two of cells, as many as are promised")
}

/// `records` of them from a thread that calls `push` to this one, which calls `pop`; the time from first to last.
#[inline(always)]
fn pass(records: u64, push: impl FnMut(Record<4>) -> bool + Send, pop: impl FnMut() -> Option<Record<4>>) -> Duration {
    let samples = made_beforehand();
    // 1: the other thread is there; 2: go
    let stage = &AtomicU32::new(0);
    std::thread::scope(move |scope| {
        scope.spawn(move || {
            // each end of the ring is a local of its own thread, which the compiler keeps in registers
            let mut push = push;
            stage.store(1, Ordering::Release);
            while stage.load(Ordering::Acquire) != 2 {
                spin_loop();
            }
            for n in 0..records {
                while !push(samples.0[n as usize % samples.0.len()]) {
                    spin_loop();
                }
            }
        });
        let mut pop = pop;
        while stage.load(Ordering::Acquire) != 1 {
            spin_loop();
        }
        let begin = Instant::now();
        stage.store(2, Ordering::Release);
        for _ in 0..records {
            loop {
                if let Some(record) = pop() {
                    black_box(record);
                    break;
                }
                spin_loop();
            }
        }
        begin.elapsed()
    })
}

fn two_threads_ring(records: u64, keep: u32, look_ahead: u32) -> Duration {
    let mut ring = ring(keep, look_ahead);
    let (mut producer, mut consumer) = ring.split();
    pass(records, move |record| producer.push(record).is_ok(), move || consumer.advance())
}

/// As the planner pushes: published once for eight records, and before it waits.
fn two_threads_staged(records: u64, keep: u32, look_ahead: u32) -> Duration {
    let mut ring = ring(keep, look_ahead);
    let (mut producer, mut consumer) = ring.split();
    let mut left = records;
    let push = move |record| {
        let is_staged = producer.stage(record).is_ok();
        left -= u64::from(is_staged);
        if !is_staged || left.is_multiple_of(8) {
            producer.publish();
        }
        is_staged
    };
    pass(records, push, move || consumer.advance())
}

fn two_threads_rtrb(records: u64) -> Duration {
    let (mut producer, mut consumer) = rtrb::RingBuffer::<Record<4>>::new(CELLS);
    pass(records, move |record| producer.push(record).is_ok(), move || consumer.pop().ok())
}

/// With what rtrb has for several records: chunks of eight on both sides, as far as there are records.
fn two_threads_rtrb_chunks(records: u64) -> Duration {
    let (mut producer, mut consumer) = rtrb::RingBuffer::<Record<4>>::new(CELLS);
    let mut held = Vec::with_capacity(8);
    let mut left = records;
    let push = move |record| {
        if held.len() == 8 || left == 0 {
            return false;
        }
        held.push(record);
        left -= 1;
        if held.len() == 8 || left == 0 {
            while producer.slots() < held.len() {
                spin_loop();
            }
            let chunk = producer.write_chunk_uninit(held.len()).expect("there are slots");
            chunk.fill_from_iter(held.drain(..));
        }
        true
    };
    let mut read = std::collections::VecDeque::with_capacity(8);
    let pop = move || {
        if read.is_empty() {
            let chunk = consumer.read_chunk(consumer.slots().min(8)).expect("there are records");
            read.extend(chunk);
        }
        read.pop_front()
    };
    pass(records, push, pop)
}

/// Each record is read before the next is pushed. In line, as `pass` is: both rings' own numbers stay in registers.
#[inline(always)]
fn back_and_forth(
    records: u64,
    mut push: impl FnMut(Record<4>) -> bool,
    mut pop: impl FnMut() -> Option<Record<4>>,
) -> Duration {
    let samples = made_beforehand();
    let begin = Instant::now();
    for n in 0..records {
        black_box(push(samples.0[n as usize % samples.0.len()]));
        if let Some(record) = pop() {
            black_box(record);
        }
    }
    begin.elapsed()
}

fn one_thread_ring(records: u64) -> Duration {
    let mut ring = ring(HALF, HALF);
    // nobody else has the ring, and the compiler knows: it would leave out the stores that are for the other thread
    let (mut producer, mut consumer) = black_box(&mut ring).split();
    back_and_forth(records, |record| producer.push(record).is_ok(), || consumer.advance())
}

fn one_thread_rtrb(records: u64) -> Duration {
    let (mut producer, mut consumer) = rtrb::RingBuffer::<Record<4>>::new(CELLS);
    back_and_forth(records, |record| producer.push(record).is_ok(), || consumer.pop().ok())
}

fn benches(c: &mut Criterion) {
    let mut group = c.benchmark_group("one thread, push to read");
    group.throughput(Throughput::Elements(1));
    group.bench_function("ring", |b| b.iter_custom(one_thread_ring));
    group.bench_function("rtrb", |b| b.iter_custom(one_thread_rtrb));
    group.finish();

    let mut group = c.benchmark_group("two threads");
    group.throughput(Throughput::Elements(1)).sampling_mode(SamplingMode::Flat);
    group.bench_function("ring, half of it history", |b| b.iter_custom(|n| two_threads_ring(n, HALF, HALF)));
    group.bench_function("ring, half of it history, published by eights", |b| {
        b.iter_custom(|n| two_threads_staged(n, HALF, HALF));
    });
    group.bench_function("rtrb", |b| b.iter_custom(two_threads_rtrb));
    group.bench_function("rtrb, chunks of eight", |b| b.iter_custom(two_threads_rtrb_chunks));
    group.bench_function("ring, no history", |b| b.iter_custom(|n| two_threads_ring(n, 0, 2 * HALF)));
    group.finish();
}

type Contest<'a> = (&'a str, u64, fn(u64) -> Duration, fn(u64) -> Duration);

/// Ring and rtrb in turns: rounds so short that many of them run undisturbed.
fn contest() {
    const ROUNDS: usize = 301;
    let contests: [Contest<'_>; 5] = [
        ("one thread, push to read", 50_000, one_thread_ring, one_thread_rtrb),
        ("two threads, half of it history", 50_000, |n| two_threads_ring(n, HALF, HALF), two_threads_rtrb),
        ("two threads, published by eights", 50_000, |n| two_threads_staged(n, HALF, HALF), two_threads_rtrb),
        ("the same, rtrb by chunks too", 50_000, |n| two_threads_staged(n, HALF, HALF), two_threads_rtrb_chunks),
        ("two threads, no history", 50_000, |n| two_threads_ring(n, 0, 2 * HALF), two_threads_rtrb),
    ];
    println!("in turns, {ROUNDS} rounds, ns per record: the least, one round in ten, every other round");
    for (name, records, ours, theirs) in contests {
        let mut times = [[0.0; ROUNDS]; 2];
        for round in 0..ROUNDS {
            for (times, run) in times.iter_mut().zip([ours, theirs]) {
                times[round] = run(records).as_nanos() as f64 / records as f64;
            }
        }
        for (times, whose) in times.iter_mut().zip(["ring", "rtrb"]) {
            times.sort_unstable_by(f64::total_cmp);
            let [least, tenth, middle] = [0, ROUNDS / 10, ROUNDS / 2].map(|n| times[n]);
            println!("{name:<33} {whose} {least:>8.2} {tenth:>8.2} {middle:>8.2}");
        }
    }
}

criterion_group!(all, benches);

fn main() {
    all();
    Criterion::default().configure_from_args().final_summary();
    // `cargo test` runs benchmarks once, to see that they run
    if std::env::args().any(|argument| argument == "--bench") {
        contest();
    }
}
