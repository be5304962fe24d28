//! Cost of a control period of the card: with a spindle that nothing follows, and in a thread, beside periods of a path
//! at a constant rate and at a rate that changes (SPN, *cost*).
//!
//! Invariant: every case plays records of the same distance, and none comes to an end of them.

use std::hint::black_box;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use retrace_card::{Card, EncoderReading, EncoderSample, InputLevels};
use retrace_core::gear::GearLimits;
use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Distance, Flags, Rate, Record, RecordIndex};
use retrace_hal_sim::identity;
use retrace_link::{
    CardCore, CardSettings, GearStart, GearState, HostCommand, Instruction, OutputChange, PathStart, SpindleControl,
    SpindleSettings, SpindleTask, channel,
};

const WINDOW: usize = 4096;
const COUNTS: u32 = 400;
const RPM: f64 = 800.0;
/// Periods that are measured at once.
const PERIODS: u64 = 1000;

type BenchCard = Card<4, WINDOW, 64, Box<[Record<4>]>>;

/// A card, and the angle of the spindle that its encoder reads, in counts.
#[derive(Clone)]
struct Machine {
    card: BenchCard,
    counts: f64,
}

#[derive(Clone, Copy, PartialEq)]
enum Case {
    Constant,
    ConstantWithEncoder,
    Changing,
    Geared,
}

impl Machine {
    fn new(case: Case) -> Self {
        let axis = PulseLimits { velocity: 200 << 32, acceleration: 12 << 32, jerk: 1 << 32 };
        let limits = RateLimits::new(13, 1 << 15, [axis; 4]).expect("valid");
        let spindle = SpindleSettings {
            counts_per_turn: COUNTS,
            is_inverted: false,
            has_index: true,
            at_speed_permille: 300,
            at_speed_periods: 10,
            timeout_periods: 10_000,
            highest_speed: 3_000_000,
        };
        let has_encoder = matches!(case, Case::ConstantWithEncoder | Case::Geared);
        let start = PathStart::at(RecordIndex::new(0));
        let settings = CardSettings {
            spindle: has_encoder.then_some(spindle),
            watchdog_periods: u16::MAX,
            ..CardSettings::new(1, start, 1000, limits)
        };
        let records = vec![Record::default(); WINDOW].into_boxed_slice();
        let mut card = BenchCard::with_records(identity::<4>(0, 0), records).expect("fits");
        card.open(&settings).expect("supported");
        for (channel, value) in [(channel::SPINDLE, 1), (channel::SPEED, (RPM * 1000.0) as i32)] {
            card.accept(HostCommand::ManualOutput(OutputChange { channel, value })).expect("a channel");
        }
        if case == Case::Geared {
            let start = GearStart {
                length: 3500,
                records_per_turn: 60,
                start_angle: 0,
                ahead: 250,
                limits: GearLimits {
                    rate: Rate::ONE * 105 / 100,
                    near_end: Distance::records(100),
                    tolerance: Distance::records(100),
                },
                ramp_share: 0,
                reverse_share: 0,
                control: SpindleControl::None,
            };
            let spindle = Some(SpindleTask::Gear(start));
            card.accept(HostCommand::Instruction(Instruction { number: 1, spindle, ..Instruction::default() }))
                .expect("at its place");
        }
        card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
        let mut machine = Self { card, counts: 0.0 };
        if case == Case::Geared {
            while machine.card.status().executed == 0 {
                machine.period(Case::Constant, 0);
            }
        }
        let flags = if case == Case::Geared { Flags::GEARED } else { Flags::NONE };
        for place in 0..3500 {
            let ramp = (place.min(40) / 2) as i16;
            let record = Record { increments: [ramp, ramp / 2, -ramp, 1], flags, line: 1, ..Record::default() };
            machine.card.accept(HostCommand::Ahead { place: RecordIndex::new(place), record }).expect("room");
        }
        for _ in 0..20_000 {
            machine.period(Case::Constant, 0);
            if machine.card.status().place.record.number() > 200 {
                assert_eq!(machine.card.status().spindle.gear == GearState::Engaged, case == Case::Geared);
                return machine;
            }
        }
        panic!("it does not begin: {:?}", machine.card.status());
    }

    /// A control period; where the rate changes, in every one.
    fn period(&mut self, case: Case, number: u64) {
        if case == Case::Changing {
            let rate = if number % 40 < 20 { Rate::ONE / 2 } else { Rate::ONE };
            self.card.accept(HostCommand::rate(rate)).expect("a rate");
        }
        let turn = f64::from(COUNTS);
        let before = self.counts;
        self.counts += RPM / 60.0 * turn / 1000.0;
        let edge = (self.counts.floor() - before) / (self.counts - before);
        let counter = self.counts.floor() as i64 as u16;
        let mut spindle = EncoderReading { count: 1, ..EncoderReading::default() };
        spindle.samples[0] = EncoderSample { counter, edge: (edge.clamp(0.0, 1.0) * 65_535.0) as u16 };
        let index = (self.counts / turn).floor() * turn;
        spindle.index = (index > before).then_some(index as i64 as u16);
        self.card.keep_alive();
        black_box(self.card.run_period(InputLevels { spindle, ..InputLevels::default() }));
    }
}

fn benches(c: &mut Criterion) {
    let mut group = c.benchmark_group("control period of the card, 4 axes");
    group.throughput(Throughput::Elements(PERIODS));
    for (name, case) in [
        ("constant rate", Case::Constant),
        ("constant rate, with the encoder of a spindle", Case::ConstantWithEncoder),
        ("changing rate", Case::Changing),
        ("in a thread", Case::Geared),
    ] {
        let machine = Machine::new(case);
        group.bench_function(name, |b| {
            b.iter_batched_ref(
                || machine.clone(),
                |machine| (0..PERIODS).for_each(|number| machine.period(case, number)),
                BatchSize::LargeInput,
            )
        });
    }
    group.finish();
}

criterion_group!(all, benches);
criterion_main!(all);
