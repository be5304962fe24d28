//! The motion path with a real planner and the simulated card, without any program text.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use retrace_config::MachineConfig;
use retrace_controller::{
    CommandSources, DifferingOutput, DifferingOutputs, Event, EventKind, ExclusiveKind, LimitMonitor, LimitReport,
    MonitorLimits, Observer, Outcome, PlanEnd, PlanSummary, PlanWriter, RecordStreamer, RunMode, RunStats,
    ScriptPlayer, Session, SwitchInstruction, Telemetry, parse_script, telemetry_channel,
};
use retrace_core::ring::{Cell, Ring};
use retrace_core::{Distance, Place, Rate, Record, RecordIndex, size};
use retrace_hal_sim::{Clock, SimCard};
use retrace_link::{CardStatus, MotionCard, OutputChange, channel};
use retrace_motion::{FeedRate, PathMode, Planner};

/// Record of everything that was executed.
struct Log {
    monitor: LimitMonitor<3>,
    positions: std::collections::HashMap<Place, [i64; 3]>,
    rows: Vec<(Place, [i64; 3], Rate)>,
    events: Vec<Event>,
}

impl Observer<3> for Log {
    fn on_telemetry(&mut self, told: &Telemetry<3>) {
        match told {
            Telemetry::Period(period) => {
                self.monitor.push(&period.increments, period.rate);
                self.rows.push((period.place, period.counts, period.rate));
                let first = *self.positions.entry(period.place).or_insert(period.counts);
                assert_eq!(first, period.counts, "place {:?} has two positions", period.place);
            }
            Telemetry::Event(event) => self.events.push(event.clone()),
            Telemetry::Output(_) | Telemetry::Active(_) => {}
        }
    }
}

struct Run {
    outcome: Outcome,
    stats: RunStats,
    status: CardStatus<3>,
    limit_report: LimitReport<3>,
    rows: Vec<(Place, [i64; 3], Rate)>,
    events: Vec<Event>,
}

impl Run {
    fn at(&self, kind: &EventKind) -> usize {
        let event = self.events.iter().find(|e| e.kind == *kind);
        event.unwrap_or_else(|| panic!("no {kind:?} in {:#?}", self.events)).period as usize
    }
}

/// Runs a program, given as calls of a plan writer, on a machine whose history lasts `history_s`.
fn run(script: &str, history_s: f64, program: impl FnOnce(&mut PlanWriter<'_, 3>) + Send) -> Run {
    let machine = MachineConfig::parse(&format!("history_hours = {}", history_s / 3600.0), "test").expect("valid");
    let start = u32::MAX - 2000;
    let cells = size::ring_cells(machine.history_records, machine.look_ahead_records).expect("fits");
    let cells: Box<[Cell<Record<3>>]> = (0..cells).map(|_| Cell::default()).collect();
    let mut ring =
        Ring::new(cells, machine.history_records, machine.look_ahead_records, RecordIndex::new(start)).expect("fits");
    let (producer, consumer) = ring.split();
    let (sender, receiver) = mpsc::sync_channel(64);
    let planner = Planner::new(machine.limits(), [0.0; 3]).expect("valid");
    let card = SimCard::<3>::new(RecordIndex::new(start), machine.rate_limits().expect("checked"), Clock::Virtual)
        .expect("fits");
    let axis = |i: usize| {
        let a = &machine.axes[i];
        MonitorLimits {
            pulses_per_mm: a.pulses_per_mm,
            velocity_mm_s: a.max_velocity_mm_per_s,
            acceleration_mm_s2: a.max_acceleration_mm_per_s2,
            jerk_mm_s3: a.max_jerk_mm_per_s3,
        }
    };
    let mut log = Log {
        monitor: LimitMonitor::new(&std::array::from_fn(axis), machine.period_s()),
        positions: Default::default(),
        rows: Vec::new(),
        events: Vec::new(),
    };
    let script = ScriptPlayer::new(parse_script(script, "script").expect("valid"), machine.period_us);
    let operators = CommandSources::from_script(script);
    let run_mode = RunMode { wall_time: false, operator: true, real_time: false };
    let outputs = card.status().outputs;
    let cancel = AtomicBool::new(false);
    let (outcome, stats, status) = std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut plan_writer = PlanWriter::new(planner, producer, sender, outputs, &cancel);
            program(&mut plan_writer);
            let commanded_mm = plan_writer.commanded_mm().to_vec();
            let summary = PlanSummary { ending: PlanEnd::Completed, blocks: 0, canonical: 0, commanded_mm };
            // a run that was stopped does not hear of the end
            let _ = plan_writer.end(summary);
        });
        let (telemetry, telemetry_receiver) = telemetry_channel(false, machine.period_s());
        scope.spawn(|| telemetry_receiver.run(&mut log));
        let streamer = RecordStreamer::new(consumer, receiver, RecordIndex::new(start), outputs, 0);
        let session = Session::new(card, &machine, streamer, operators, run_mode, telemetry);
        let (outcome, stats, card) = session.run();
        cancel.store(true, Ordering::Relaxed);
        (outcome, stats, *card.status())
    });
    Run { outcome, stats, status, limit_report: log.monitor.finish(), rows: log.rows, events: log.events }
}

const FEED: FeedRate = FeedRate::PerSecond(80.0);

fn zigzag(plan_writer: &mut PlanWriter<'_, 3>) {
    for k in 0..40u32 {
        let (x, y) = (f64::from(k % 2) * 30.0, f64::from(k) * 1.5);
        if plan_writer.straight([x, y, 0.1 * f64::from(k)], FEED, PathMode::ExactPath, k + 1).is_err() {
            return;
        }
    }
}

/// The motion path takes what belongs to a record together with it. Where the writer waits for that, every record
/// before it can be read.
#[test]
fn a_writer_that_waits_has_published_what_it_planned() {
    const LOOK_AHEAD: u32 = 256;
    let machine = MachineConfig::parse("", "test").expect("valid");
    let cells: Box<[Cell<Record<3>>]> = (0..LOOK_AHEAD).map(|_| Cell::default()).collect();
    let mut ring = Ring::new(cells, 0, LOOK_AHEAD, RecordIndex::new(0)).expect("fits");
    let (producer, mut consumer) = ring.split();
    // Room for the item of one record.
    let (sender, receiver) = mpsc::sync_channel(1);
    let planner = Planner::new(machine.limits(), [0.0; 3]).expect("valid");
    let card =
        SimCard::<3>::new(RecordIndex::new(0), machine.rate_limits().expect("checked"), Clock::Virtual).expect("fits");
    let (outputs, cancel, is_over) = (card.status().outputs, AtomicBool::new(false), AtomicBool::new(false));
    let travelled: i64 = std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut plan_writer = PlanWriter::new(planner, producer, sender, outputs, &cancel);
            (1..30).for_each(|periods| plan_writer.height(i32::MAX, periods, 1));
            let planned = plan_writer.straight([10.0, 0.0, 0.0], FEED, PathMode::ExactPath, 1);
            is_over.store(planned.is_ok() && plan_writer.rest().is_ok(), Ordering::Release);
        });
        let (begun, mut travelled) = (Instant::now(), 0);
        loop {
            let was_over = is_over.load(Ordering::Acquire);
            match consumer.advance() {
                Some(record) => {
                    travelled += i64::from(record.increments[0]);
                    let _ = receiver.try_recv();
                }
                None if was_over => break travelled,
                None if begun.elapsed() > Duration::from_secs(20) => {
                    cancel.store(true, Ordering::Relaxed);
                    break travelled;
                }
                None => std::thread::yield_now(),
            }
        }
    });
    assert_eq!(travelled, 10_000, "every record has come");
}

fn is_exact(run: &Run) {
    assert_eq!(run.outcome, Outcome::Completed);
    assert_eq!(run.status.counts, [30_000, 58_500, 3_900]);
    assert_eq!(run.limit_report.violations, 0, "{:?}", run.limit_report.first);
    assert_eq!(run.stats.underruns, 0);
}

#[test]
fn a_plain_run_takes_the_planned_periods_and_ends_exactly() {
    let run = run("", 60.0, zigzag);
    is_exact(&run);
    assert!(run.rows.iter().all(|(_, _, rate)| *rate == Rate::ONE));
    assert_eq!(run.stats.periods, run.stats.motion);
}

#[test]
fn holds_overrides_and_retracing_change_nothing_in_the_end() {
    let script = "at 1s hold\nafter 1s resume\nafter 0.5s override 40%\nafter 1s override 100%\nafter 1s reverse 100%\n\
        after 1s forward 60%\nafter 500 periods reverse 100%\nafter 4s wheel -120 for 1s\nafter 0.2s wheel 70 for \
        2s\nafter 0.5s leave\n";
    let run = run(script, 60.0, zigzag);
    is_exact(&run);
    assert!(run.stats.retracing > 5000 && run.stats.held > 500, "{:?}", run.stats);
    assert!(run.events.iter().any(|e| e.kind == EventKind::RunResumed));
}

#[test]
fn a_short_history_ends_reverse_run_at_its_oldest_record_and_says_so() {
    let run = run("at 8s reverse 100%\nafter 6s leave", 2.0, zigzag);
    is_exact(&run);
    let oldest = run.at(&EventKind::HistoryStartReached);
    let reached = run.rows[..oldest]
        .iter()
        .map(|(p, ..)| Place::start_of(RecordIndex::new(u32::MAX - 2000)).distance_to(*p))
        .max()
        .expect("ran");
    let stands = Place::start_of(RecordIndex::new(u32::MAX - 2000)).distance_to(run.rows[oldest - 1].0);
    let whole_records = |distance: Distance| distance.units() >> 32;
    let reached = whole_records(reached + Distance::from_units(u32::MAX.into()));
    assert_eq!(reached, whole_records(stands) + 2000, "history keeps 2000 records");
}

#[test]
fn instructions_stand_between_the_motion_before_and_behind() {
    let switch = |plan_writer: &mut PlanWriter<'_, 3>, value, periods| {
        let changes = [OutputChange { channel: channel::SPINDLE, value }];
        let (kind, code) = (ExclusiveKind::Switch, "M3");
        plan_writer
            .exclusive(SwitchInstruction {
                line: 9,
                kind,
                code,
                changes: &changes,
                periods,
                ..SwitchInstruction::default()
            })
            .expect("running");
    };
    let run = run("at 2s reverse 100%\nafter 1s leave", 60.0, |plan_writer| {
        switch(plan_writer, 1, 100);
        for k in 0..5 {
            plan_writer
                .straight([f64::from(k + 1) * 10.0, 0.0, 0.0], FEED, PathMode::ExactPath, k + 1)
                .expect("in range");
            plan_writer.action(OutputChange { channel: 7, value: (k % 2) as i32 }, k + 1);
            switch(plan_writer, k as i32, 50);
        }
    });
    assert_eq!((run.outcome, run.status.counts), (Outcome::Completed, [50_000, 0, 0]));
    assert_eq!(run.limit_report.violations, 0);
    assert_eq!(run.stats.switching, 100 + 5 * 50);
    let done: Vec<u64> = run.events.iter().filter(|e| e.kind == EventKind::Switched("M3")).map(|e| e.period).collect();
    for (n, &period) in done.iter().enumerate() {
        // the counts do not change during the whole instruction, exactly where the line before it ends
        let (at, before) = (period as usize - 1, period as usize - if n == 0 { 100 } else { 50 });
        assert_eq!(run.rows[before].1, [10_000 * n as i64, 0, 0]);
        assert_eq!(run.rows[at].1, run.rows[before].1);
    }
    assert_eq!(run.status.outputs[7], 0);
}

#[test]
fn a_thousand_full_stops_cost_no_period() {
    let length = |n: u32| {
        run("", 60.0, |plan_writer| {
            for k in 0..n {
                let x = f64::from(k % 2) * 0.3;
                if plan_writer.straight([x, 0.0, 0.0], FEED, PathMode::ExactStop, k).is_err() {
                    return;
                }
            }
        })
        .stats
        .periods
    };
    // from 0 to 0.3 and back, each a separate move from rest to rest
    let one = length(2) - length(1);
    assert_eq!(length(1001) - length(1), 1000 * one);
}

#[test]
fn outputs_that_were_changed_by_hand_are_asked_for_at_reached() {
    let program = |plan_writer: &mut PlanWriter<'_, 3>| {
        plan_writer.action(OutputChange { channel: 3, value: 1 }, 1);
        zigzag(plan_writer);
    };
    let script = "at 2s reverse 100%\nafter 1s output 3 off\nafter 1s leave ask\nafter 4s agree";
    let run = run(script, 60.0, program);
    is_exact(&run);
    let differs = DifferingOutput { code: "M62", line: 1, ..DifferingOutput::new(3, 0, 1) };
    let asked = run.at(&EventKind::OutputsDiffer(DifferingOutputs::first(&mut [differs].into_iter())));
    let restored = run.at(&EventKind::OutputsRestored);
    assert!(restored > asked + 500);
    assert!(run.rows[asked..restored].iter().all(|(place, ..)| *place == run.rows[asked].0));
    assert_eq!(run.status.outputs[3], 1);
}

#[test]
fn single_block_stops_at_every_block_and_goes_on_at_cycle_start() {
    let script = (0..60).fold("at 1s single\n".to_string(), |s, _| s + "after 2s cycle start\n");
    let run = run(&script, 60.0, zigzag);
    is_exact(&run);
    assert!(run.events.iter().filter(|e| e.kind == EventKind::SingleBlock).count() > 30);
}

#[test]
fn a_stop_rests_on_the_path_and_a_job_that_nobody_resumes_ends() {
    let stopped = run("at 1s stop", 60.0, zigzag);
    assert_eq!(stopped.outcome, Outcome::Stopped);
    assert!(stopped.status.at_rest && stopped.limit_report.violations == 0);
    let left = run("at 1s hold", 60.0, zigzag);
    assert_eq!(left.outcome, Outcome::Stopped);
}
